//! Finding a camera: by device file, by the name of its card, by its USB serial number.

use std::io;
use std::path::{Path, PathBuf};

use serde::Serialize;
use v4l::Device;
use v4l::capability::Flags;

use super::kernel::guarded;

/// Where udev puts names that stay.
const BY_ID: &str = "/dev/v4l/by-id";

/// A video device file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Node {
    /// The device file.
    pub path: PathBuf,
    /// Names of it that stay the same, where udev makes them.
    pub by_id: Vec<PathBuf>,
    /// What its driver calls the device.
    pub card: String,
    /// Its driver.
    pub driver: String,
    /// Where it is plugged in.
    pub bus: String,
    /// Serial number of the USB device that it belongs to.
    pub usb_serial: Option<String>,
    /// Why no frames can be had of it; absent where they can.
    pub unusable: Option<String>,
}

/// Every video device file there is, in the order of their numbers.
#[must_use]
pub fn nodes() -> Vec<Node> {
    let named = |entry: std::io::Result<std::fs::DirEntry>| {
        let name = entry.ok()?.file_name().into_string().ok()?;
        name.strip_prefix("video")?.parse::<u32>().ok()
    };
    let mut numbers: Vec<u32> = std::fs::read_dir("/dev").into_iter().flatten().filter_map(named).collect();
    numbers.sort_unstable();
    numbers.into_iter().map(node).collect()
}

fn node(number: u32) -> Node {
    let path = PathBuf::from(format!("/dev/video{number}"));
    let links = std::fs::read_dir(BY_ID).into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path()));
    let by_id = links.filter(|link| std::fs::canonicalize(link).is_ok_and(|to| to == path)).collect();
    let mut node = Node {
        by_id,
        card: String::new(),
        driver: String::new(),
        bus: String::new(),
        usb_serial: usb_serial(Path::new(&format!("/sys/class/video4linux/video{number}/device"))),
        unusable: None,
        path,
    };
    match guarded(|| Device::with_path(&node.path)?.query_caps()) {
        Ok(caps) => {
            node.unusable = unusable(caps.capabilities);
            (node.card, node.driver, node.bus) = (caps.card, caps.driver, caps.bus);
        }
        Err(error) => node.unusable = Some(format!("it cannot be opened: {error}")),
    }
    node
}

/// Why no frames can be had of a device with these capabilities.
pub(super) fn unusable(capabilities: Flags) -> Option<String> {
    let why = if !capabilities.contains(Flags::VIDEO_CAPTURE) {
        if capabilities.contains(Flags::VIDEO_CAPTURE_MPLANE) {
            "its frames come in several planes, which this program does not read"
        } else {
            "it captures no video now"
        }
    } else if !capabilities.contains(Flags::STREAMING) {
        "it has no buffers to stream with"
    } else {
        return None;
    };
    Some(why.to_owned())
}

/// The serial number of the USB device above a device in sysfs.
fn usb_serial(device: &Path) -> Option<String> {
    let device = std::fs::canonicalize(device).ok()?;
    let usb = device.ancestors().take(6).find(|folder| folder.join("idVendor").exists())?;
    let serial = std::fs::read_to_string(usb.join("serial")).ok()?;
    Some(serial.trim().to_owned()).filter(|serial| !serial.is_empty())
}

/// The device file of a configured `device`: itself, or the one that `card:NAME` or `usb:SERIAL` describes.
///
/// # Errors
/// Why there is none, or more than one, naming what there is.
pub fn resolve(device: &str) -> Result<PathBuf, String> {
    match device.split_once(':') {
        Some(("card", name)) => chosen(&nodes(), device, |node| node.card == name.trim()),
        Some(("usb", serial)) => chosen(&nodes(), device, |node| node.usb_serial.as_deref() == Some(serial.trim())),
        _ => Ok(PathBuf::from(device)),
    }
}

/// Opens a device file.
///
/// # Errors
/// Why not, and what to do, in words.
pub fn open(path: &Path) -> Result<Device, String> {
    let shown = path.display();
    guarded(|| Device::with_path(path)).map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => format!("there is no {shown}; connect the camera, or correct its `device`"),
        io::ErrorKind::PermissionDenied => {
            format!("{shown} may not be opened by this user: add it to the group `video`")
        }
        _ => format!("{shown} cannot be opened: {error}"),
    })
}

fn chosen(nodes: &[Node], device: &str, fits: impl Fn(&Node) -> bool) -> Result<PathBuf, String> {
    let mut fitting: Vec<&Node> = nodes.iter().filter(|node| fits(node)).collect();
    // One camera often has several files, of which one gives frames.
    if fitting.iter().any(|node| node.unusable.is_none()) {
        fitting.retain(|node| node.unusable.is_none());
    }
    match fitting[..] {
        [one] => Ok(one.path.clone()),
        [] => {
            let there: Vec<String> = nodes.iter().map(described).collect();
            let there = if there.is_empty() { "no video device".to_owned() } else { there.join(", ") };
            Err(format!("no camera is {device:?}: there is {there}; connect it, or correct bench.camera.device"))
        }
        _ => {
            let several: Vec<String> = fitting.into_iter().map(described).collect();
            Err(format!("{device:?} is more than one camera: {}; name one by its device file", several.join(", ")))
        }
    }
}

fn described(node: &Node) -> String {
    let serial = node.usb_serial.as_ref().map_or_else(String::new, |serial| format!(", usb:{serial}"));
    format!("{} (card:{}{serial})", node.path.display(), node.card)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(number: u32, card: &str, serial: &str, unusable: bool) -> Node {
        Node {
            path: format!("/dev/video{number}").into(),
            by_id: vec![],
            card: card.to_owned(),
            driver: "uvcvideo".to_owned(),
            bus: "usb-1".to_owned(),
            usb_serial: Some(serial.to_owned()),
            unusable: unusable.then(|| "it captures no video now".to_owned()),
        }
    }

    #[test]
    fn one_camera_is_found_among_its_files_and_others() {
        let nodes = [camera(0, "Mono", "A1", false), camera(1, "Mono", "A1", true), camera(2, "Mono", "B2", false)];
        let by = |serial: &'static str| {
            chosen(&nodes, &format!("usb:{serial}"), move |node| node.usb_serial.as_deref() == Some(serial))
        };
        assert_eq!(by("A1"), Ok("/dev/video0".into()));
        assert_eq!(by("B2"), Ok("/dev/video2".into()));
        let missing = by("C3").unwrap_err();
        assert!(missing.contains("\"usb:C3\"") && missing.contains("/dev/video2 (card:Mono, usb:B2)"), "{missing}");
        let several = chosen(&nodes, "card:Mono", |node| node.card == "Mono").unwrap_err();
        assert!(several.contains("more than one") && several.contains("/dev/video0"), "{several}");
        assert!(chosen(&[], "card:Mono", |_| true).unwrap_err().contains("there is no video device"));
    }

    #[test]
    fn a_device_file_stands_for_itself() {
        assert_eq!(resolve("/dev/v4l/by-id/usb-x"), Ok("/dev/v4l/by-id/usb-x".into()));
        assert_eq!(
            resolve("/dev/v4l/by-path/pci-0000:00:14.0-usb"),
            Ok("/dev/v4l/by-path/pci-0000:00:14.0-usb".into())
        );
    }

    #[test]
    fn a_usb_device_is_found_above_its_interface() {
        let folder = tempfile::tempdir().unwrap();
        let interface = folder.path().join("usb1/1-2/1-2:1.0");
        std::fs::create_dir_all(&interface).unwrap();
        assert_eq!(usb_serial(&interface), None);
        std::fs::write(folder.path().join("usb1/1-2/idVendor"), "1d6b\n").unwrap();
        std::fs::write(folder.path().join("usb1/1-2/serial"), "SN 42\n").unwrap();
        assert_eq!(usb_serial(&interface).as_deref(), Some("SN 42"));
    }

    #[test]
    fn only_a_capture_device_with_buffers_will_do() {
        assert_eq!(unusable(Flags::VIDEO_CAPTURE | Flags::STREAMING), None);
        assert!(unusable(Flags::META_CAPTURE | Flags::STREAMING).unwrap().contains("no video"));
        assert!(unusable(Flags::VIDEO_CAPTURE_MPLANE | Flags::STREAMING).unwrap().contains("planes"));
        assert!(unusable(Flags::VIDEO_CAPTURE).unwrap().contains("buffers"));
    }
}
