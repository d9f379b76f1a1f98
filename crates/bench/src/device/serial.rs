//! Serial ports: found by path or by the USB serial number of what they belong to, opened exclusively.
//!
//! A device that was unplugged comes back under another name (`ttyUSB1` for `ttyUSB0`): its `/dev/serial/by-id` link
//! and its USB serial number stay. Both are looked up anew at every opening.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Duration;

use async_trait::async_trait;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio_serial::{ClearBuffer, FlowControl, SerialPort as _, SerialPortBuilderExt, SerialStream};

use super::DeviceError;
use crate::config::ControllerConfig;

/// What marks a port given by USB serial number in the configuration.
pub const USB_PREFIX: &str = "usb:";
/// Rest before and after what came earlier is forgotten.
const DWELL: Duration = Duration::from_millis(50);
/// Where the kernel lists terminals.
pub(super) const TERMINALS: &str = "/sys/class/tty";

/// A stream of bytes to a controller and back.
pub trait Stream: AsyncRead + AsyncWrite + Send + Unpin {}

impl<T: AsyncRead + AsyncWrite + Send + Unpin> Stream for T {}

/// A stream of bytes to a controller, of whatever kind.
pub type Wire = Box<dyn Stream>;

/// A way to a controller that can be taken again and again.
#[async_trait]
pub trait Dial: Send + Sync {
    /// Where it leads, for people.
    fn location(&self) -> String;

    /// Opens a stream to the controller.
    ///
    /// # Errors
    /// [`DeviceError::Busy`] when another program holds it, [`DeviceError::Disconnected`] when it is not there or cannot
    /// be opened.
    async fn open(&self) -> Result<Wire, DeviceError>;
}

/// A serial port of the configuration: a path, or `usb:` and a USB serial number.
#[derive(Debug, Clone, PartialEq)]
pub struct SerialDial {
    /// What is at the other end, for errors.
    pub device: String,
    /// Path or `usb:` and a serial number.
    pub port: PathBuf,
    /// Baud rate.
    pub baud: u32,
    /// Whether it has the handshake of RTS and CTS.
    pub handshake: bool,
}

impl SerialDial {
    /// The way to a controller of the configuration; `device` is its name, for errors.
    #[must_use]
    pub fn of(device: &str, config: &ControllerConfig) -> Self {
        let (device, port) = (device.to_owned(), config.port.clone());
        Self { device, port, baud: config.baud(), handshake: config.driver.handshake() }
    }
}

#[async_trait]
impl Dial for SerialDial {
    fn location(&self) -> String {
        self.port.display().to_string()
    }

    async fn open(&self) -> Result<Wire, DeviceError> {
        let dial = self.clone();
        // A driver may take its time to open a port.
        let opened = tokio::task::spawn_blocking(move || {
            let path = find(&dial.device, &dial.port)?;
            let mut stream = open_serial(&dial.device, &path, dial.baud, dial.handshake)?;
            if dial.handshake {
                settle(&mut stream);
            }
            Ok(stream)
        });
        let stream = opened.await.unwrap_or_else(|_| {
            Err(DeviceError::Disconnected { device: self.device.clone(), reason: "opening it failed".to_owned() })
        })?;
        Ok(Box::new(stream))
    }
}

/// The path of a port of the configuration, now.
///
/// # Errors
/// [`DeviceError::Disconnected`] when no terminal belongs to a USB device of that serial number, or more than one does.
pub fn find(device: &str, port: &Path) -> Result<PathBuf, DeviceError> {
    let Some(serial) = port.to_str().and_then(|name| name.strip_prefix(USB_PREFIX)) else {
        return Ok(port.to_owned());
    };
    let found = by_usb_serial(Path::new(TERMINALS), serial);
    let reason = match found.as_slice() {
        [one] => return Ok(Path::new("/dev").join(one)),
        [] => format!(
            "no serial port belongs to a USB device with the serial number {serial}; connect it, or correct \
                       its `port`"
        ),
        several => format!(
            "{} belong to USB devices with the serial number {serial}; give its `port` by its /dev/serial/by-path name",
            several.join(" and ")
        ),
    };
    Err(DeviceError::Disconnected { device: device.to_owned(), reason })
}

/// Names of the terminals that belong to USB devices of a serial number, in order.
fn by_usb_serial(terminals: &Path, serial: &str) -> Vec<String> {
    let Ok(entries) = fs::read_dir(terminals) else { return Vec::new() };
    let mut names: Vec<String> = entries
        .flatten()
        .filter(|entry| {
            let device = entry.path().join("device").canonicalize();
            device.is_ok_and(|device| usb_serial(&device).is_some_and(|found| found == serial))
        })
        .filter_map(|entry| entry.file_name().into_string().ok())
        .collect();
    names.sort();
    names
}

/// The serial number of the USB device that a device in sysfs is part of: the nearest folder above with a vendor number.
fn usb_serial(device: &Path) -> Option<String> {
    let usb = device.ancestors().find(|folder| folder.join("idVendor").is_file())?;
    Some(fs::read_to_string(usb.join("serial")).ok()?.trim().to_owned())
}

/// Raises RTS and forgets what came before, as Thorlabs has it of a program that opens a port to its controllers. A port
/// without such lines, as a pseudo-terminal, is as good.
fn settle(stream: &mut SerialStream) {
    let told = stream.write_request_to_send(true).and_then(|()| {
        std::thread::sleep(DWELL);
        stream.clear(ClearBuffer::All)
    });
    if let Err(error) = told {
        tracing::debug!(%error, "a port has no handshake");
    }
    std::thread::sleep(DWELL);
}

/// Opens a serial port, 8 data bits, no parity, one stop bit, with or without the handshake of RTS and CTS.
///
/// # Errors
/// [`DeviceError::Busy`] when another program holds it, [`DeviceError::Disconnected`] when it is not there or cannot be
/// opened.
pub fn open_serial(device: &str, path: &Path, baud: u32, handshake: bool) -> Result<SerialStream, DeviceError> {
    let gone = |reason| DeviceError::Disconnected { device: device.to_owned(), reason };
    let flow = if handshake { FlowControl::Hardware } else { FlowControl::None };
    let port = tokio_serial::new(path.to_string_lossy(), baud).flow_control(flow);
    port.open_native_async().map_err(|error| match error.kind() {
        // The crate says so when the exclusive lock is taken, not when there is no device.
        tokio_serial::ErrorKind::NoDevice => {
            DeviceError::Busy { device: device.to_owned(), reason: format!("{}: {error}", path.display()) }
        }
        tokio_serial::ErrorKind::Io(ErrorKind::NotFound) => {
            gone(format!("there is no {}; connect it, or correct its `port`", path.display()))
        }
        tokio_serial::ErrorKind::Io(ErrorKind::PermissionDenied) => gone(format!(
            "{} may not be opened by this user; add the user to the group that owns it (dialout on Debian)",
            path.display()
        )),
        _ => gone(format!("{} cannot be opened: {error}", path.display())),
    })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn a_missing_port_is_told_from_a_busy_one() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let _guard = runtime.enter();
        let error = open_serial("controller `main`", Path::new("/dev/does-not-exist"), 115_200, false).unwrap_err();
        assert!(matches!(error, DeviceError::Disconnected { .. }), "{error}");
        assert!(error.to_string().contains("/dev/does-not-exist"));
    }

    #[test]
    fn a_port_is_found_by_the_serial_number_of_its_usb_device_under_whatever_name() {
        // As sysfs has it: the terminal's `device` is a link below the USB device's folder.
        let root = tempfile::tempdir().unwrap();
        let (class, usb) = (root.path().join("class"), root.path().join("usb1/1-2"));
        let add = |name: &str, usb: &Path, serial: &str| {
            let port = usb.join("1-2:1.0").join(name);
            fs::create_dir_all(&port).unwrap();
            fs::write(usb.join("idVendor"), "0403\n").unwrap();
            fs::write(usb.join("serial"), format!("{serial}\n")).unwrap();
            fs::create_dir_all(class.join(name)).unwrap();
            symlink(&port, class.join(name).join("device")).unwrap();
        };
        add("ttyUSB0", &usb, "A50285BI");
        add("ttyACM3", &root.path().join("usb1/1-4"), "other");
        fs::create_dir_all(class.join("tty1")).unwrap();
        assert_eq!(by_usb_serial(&class, "A50285BI"), ["ttyUSB0"]);
        assert_eq!(by_usb_serial(&class, "A5028"), Vec::<String>::new());
        // Unplugged and back under another name.
        fs::remove_dir_all(class.join("ttyUSB0")).unwrap();
        assert_eq!(by_usb_serial(&class, "A50285BI"), Vec::<String>::new());
        add("ttyUSB1", &usb, "A50285BI");
        assert_eq!(by_usb_serial(&class, "A50285BI"), ["ttyUSB1"]);
        let error = find("controller `main`", Path::new("usb:nobody-has-this")).unwrap_err();
        assert!(error.to_string().contains("nobody-has-this"), "{error}");
    }
}
