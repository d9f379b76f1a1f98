//! Serial ports, controllers and cameras, and the device files that they are.

use std::fs;
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};

use nix::unistd::{AccessFlags, Gid, Group, eaccess};

use super::is_hardware;
use super::processes::OpenDevices;
use crate::cli::doctor::facts::{
    CameraSource, ControllerFacts, DeviceFile, GenicamFacts, NetworkFacts, PortFacts, UsbFacts, VideoFacts, WayFacts,
};
use crate::config::{CameraConfig, CameraDriver, Config, ControllerConfig};
use crate::device::camera::genicam::found::Way;
use crate::device::camera::{files, find, genicam, offer};
use crate::device::connected::{self, ConnectedCamera};
use crate::device::serial;

/// Where udev keeps what it knows of devices.
const UDEV_DATA: &str = "/run/udev/data";
/// What in it keeps ModemManager away.
const IGNORED: [&str; 2] = ["E:ID_MM_DEVICE_IGNORE=1", "E:ID_MM_PORT_IGNORE=1"];

/// Every serial port.
pub(super) fn ports(open: &OpenDevices) -> Vec<PortFacts> {
    let facts = |port: connected::ConnectedPort| Some(PortFacts { file: device_file(&port.path, open).ok()?, port });
    connected::ports().into_iter().filter_map(facts).collect()
}

/// The controllers of the configured axes; none on a simulated bench.
pub(super) fn controllers(config: &Config, open: &OpenDevices) -> Vec<ControllerFacts> {
    let bench = &config.bench;
    if !is_hardware(config) {
        return Vec::new();
    }
    let mut names = vec![&bench.focus.controller, &bench.e.controller];
    names.dedup();
    let of = |name: &String| {
        let config = bench.controllers.get(name)?;
        let port = controller_port(name, config, open);
        Some(ControllerFacts { name: name.clone(), config: config.clone(), port, identity: None })
    };
    names.into_iter().filter_map(of).collect()
}

fn controller_port(name: &str, config: &ControllerConfig, open: &OpenDevices) -> Result<DeviceFile, String> {
    let path = serial::find(&format!("controller `{name}`"), &config.port).map_err(|error| match error {
        crate::device::DeviceError::Disconnected { reason, .. } => reason,
        other => other.to_string(),
    })?;
    device_file(&path, open)
}

/// Every video device.
pub(super) fn cameras(open: &OpenDevices) -> Vec<VideoFacts> {
    let facts = |node: find::Node| {
        let offers = match (&node.unusable, find::open(&node.path)) {
            (None, Ok(device)) => offer::offers(&device),
            _ => Vec::new(),
        };
        let file = device_file(&node.path, open).ok()?;
        let camera = ConnectedCamera { node, formats: Vec::new() };
        Some(VideoFacts { names: camera.names(), node: camera.node, offers, file })
    };
    find::nodes().into_iter().filter_map(facts).collect()
}

/// Where the configured camera's frames come from; nowhere on a simulated bench.
pub(super) fn camera_source(config: &Config, open: &OpenDevices) -> Option<CameraSource> {
    let camera = &config.bench.camera;
    if !is_hardware(config) {
        return None;
    }
    Some(match camera.driver {
        CameraDriver::V4l2 => CameraSource::Device(resolved(&camera.device)),
        CameraDriver::Genicam => CameraSource::Genicam(genicam_camera(camera, open).map(Box::new)),
        CameraDriver::Files => CameraSource::Files(files::matching(&camera.files).map(|found| found.len())),
    })
}

fn genicam_camera(config: &CameraConfig, open: &OpenDevices) -> Result<GenicamFacts, String> {
    let camera = genicam::find::configured(config)?;
    let way = match &camera.way {
        Way::Network { interface, .. } => WayFacts::Network(network(interface)),
        Way::Usb { file, .. } => {
            WayFacts::Usb { file: device_file(file, open), memory_mib: genicam::usb::memory_mib() }
        }
    };
    Ok(GenicamFacts { camera, way })
}

fn network(interface: &str) -> NetworkFacts {
    let folder = Path::new("/sys/class/net").join(interface);
    let told = |path: &Path| fs::read_to_string(path).ok().map(|text| text.trim().to_owned());
    NetworkFacts {
        mtu: told(&folder.join("mtu")).and_then(|text| text.parse().ok()),
        // -1 where the link is down or has no speed.
        link_mbit_per_s: told(&folder.join("speed")).and_then(|text| text.parse().ok()),
        most_buffer_bytes: genicam::most_buffer_bytes(),
        interface: interface.to_owned(),
    }
}

fn resolved(device: &str) -> Result<PathBuf, String> {
    let path = find::resolve(device)?;
    fs::canonicalize(&path).map_err(|error| absent(&path, &error))
}

fn absent(path: &Path, error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::NotFound => format!("there is no {}", path.display()),
        _ => format!("{}: {error}", path.display()),
    }
}

/// A device file, every link followed, without opening it.
fn device_file(path: &Path, open: &OpenDevices) -> Result<DeviceFile, String> {
    let real = fs::canonicalize(path).map_err(|error| absent(path, &error))?;
    let found = fs::metadata(&real).map_err(|error| absent(&real, &error))?;
    let group = Group::from_gid(Gid::from_raw(found.gid())).ok().flatten();
    Ok(DeviceFile {
        is_device: found.file_type().is_char_device(),
        mode: found.mode() & 0o7777,
        uid: found.uid(),
        gid: found.gid(),
        group: group.map_or_else(|| found.gid().to_string(), |group| group.name),
        ours: eaccess(&real, AccessFlags::R_OK | AccessFlags::W_OK).is_ok(),
        open_in: open.get(&real).cloned().unwrap_or_default(),
        usb: usb(Path::new("/sys/dev/char"), Path::new(UDEV_DATA), found.rdev()),
        path: real,
    })
}

/// The USB device that a character device belongs to.
fn usb(devices: &Path, udev: &Path, number: u64) -> Option<UsbFacts> {
    let number = format!("{}:{}", nix::sys::stat::major(number), nix::sys::stat::minor(number));
    let device = fs::canonicalize(devices.join(&number).join("device")).ok()?;
    let folder = device.ancestors().find(|folder| folder.join("idVendor").is_file())?.to_owned();
    let control = fs::read_to_string(folder.join("power/control")).unwrap_or_default();
    // Below 0 it is never switched off.
    let delay = fs::read_to_string(folder.join("power/autosuspend_delay_ms")).unwrap_or_default();
    let never = delay.trim().parse::<i64>().is_ok_and(|delay| delay < 0);
    let told = fs::read_to_string(udev.join(format!("c{number}"))).unwrap_or_default();
    Some(UsbFacts {
        autosuspend: control.trim() == "auto" && !never,
        modem_manager_ignores: told.lines().any(|line| IGNORED.contains(&line)),
        folder,
    })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn a_device_files_permissions_are_read_without_opening_it() {
        let open = OpenDevices::new();
        let file = device_file(Path::new("/dev/null"), &open).unwrap();
        assert!(file.is_device && file.ours && file.usb.is_none());
        assert_eq!((file.mode, file.path.as_path()), (0o666, Path::new("/dev/null")));
        let missing = device_file(Path::new("/dev/no-such-port"), &open).unwrap_err();
        assert_eq!(missing, "there is no /dev/no-such-port");
        let plain = tempfile::NamedTempFile::new().unwrap();
        assert!(!device_file(plain.path(), &open).unwrap().is_device);
    }

    #[test]
    fn a_usb_device_that_may_sleep_is_told_from_one_that_may_not() {
        // As sysfs has it: the number's folder leads to the interface below the USB device.
        let root = tempfile::tempdir().unwrap();
        let (numbers, udev) = (root.path().join("char"), root.path().join("udev"));
        let device = root.path().join("usb1/1-2");
        fs::create_dir_all(device.join("1-2:1.0/ttyUSB0")).unwrap();
        fs::create_dir_all(device.join("power")).unwrap();
        fs::create_dir_all(numbers.join("188:0")).unwrap();
        fs::create_dir_all(&udev).unwrap();
        symlink(device.join("1-2:1.0/ttyUSB0"), numbers.join("188:0/device")).unwrap();
        let number = nix::sys::stat::makedev(188, 0);
        assert_eq!(usb(&numbers, &udev, number), None, "nothing says that it is a USB device");
        let write = |name: &str, text: &str| fs::write(device.join(name), text).unwrap();
        write("idVendor", "0403\n");
        write("power/control", "auto\n");
        write("power/autosuspend_delay_ms", "2000\n");
        let found = usb(&numbers, &udev, number).unwrap();
        assert!(found.autosuspend && !found.modem_manager_ignores);
        assert_eq!(found.power_control(), device.canonicalize().unwrap().join("power/control"));
        fs::write(udev.join("c188:0"), "I:123\nE:ID_MM_DEVICE_IGNORE=1\n").unwrap();
        write("power/autosuspend_delay_ms", "-1\n");
        let found = usb(&numbers, &udev, number).unwrap();
        assert!(!found.autosuspend && found.modem_manager_ignores);
        write("power/autosuspend_delay_ms", "2000\n");
        write("power/control", "on\n");
        assert!(!usb(&numbers, &udev, number).unwrap().autosuspend);
    }
}
