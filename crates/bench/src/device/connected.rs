//! What is connected to this machine: cameras and serial ports, each with the names it can be configured by.

use std::path::{Path, PathBuf};

use tokio_serial::{SerialPortInfo, SerialPortType};

use super::camera::find::{self, Node};
use super::camera::offer;
use super::serial::USB_PREFIX;

/// Where udev puts names of serial ports that stay.
const BY_ID: &str = "/dev/serial/by-id";

/// A camera that is connected.
#[derive(Debug, Clone, PartialEq)]
pub struct ConnectedCamera {
    /// Its device file.
    pub node: Node,
    /// The formats it offers that this program reads, by their V4L2 names.
    pub formats: Vec<String>,
}

impl ConnectedCamera {
    /// What `bench.camera.device` can be to mean it, the steadiest name first.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        let Node { path, by_id, card, usb_serial, .. } = &self.node;
        let mut names: Vec<String> = by_id.iter().map(|link| link.display().to_string()).collect();
        names.extend(usb_serial.iter().map(|serial| format!("usb:{serial}")));
        names.extend((!card.is_empty()).then(|| format!("card:{card}")));
        names.push(path.display().to_string());
        names
    }
}

/// A serial port that is there.
#[derive(Debug, Clone, PartialEq)]
pub struct ConnectedPort {
    /// Its device file.
    pub path: PathBuf,
    /// What a controller's `port` can be to mean it, the steadiest name first.
    pub names: Vec<String>,
    /// What its USB device calls itself; absent for what is no USB device.
    pub product: Option<String>,
}

/// Every camera that is connected. Opens each for a moment.
#[must_use]
pub fn cameras() -> Vec<ConnectedCamera> {
    let connected = |node: Node| {
        let offers = match (&node.unusable, find::open(&node.path)) {
            (None, Ok(device)) => offer::offers(&device),
            _ => Vec::new(),
        };
        let formats = offers.into_iter().filter(|offer| offer.readable).map(|offer| offer.format).collect();
        ConnectedCamera { node, formats }
    };
    find::nodes().into_iter().map(connected).collect()
}

/// Every serial port that is there, in the order of their paths. Opens none.
#[must_use]
pub fn ports() -> Vec<ConnectedPort> {
    let links = std::fs::read_dir(BY_ID).into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path()));
    let links: Vec<(PathBuf, PathBuf)> =
        links.filter_map(|link| std::fs::canonicalize(&link).ok().map(|to| (link, to))).collect();
    let mut ports: Vec<_> =
        tokio_serial::available_ports().unwrap_or_default().iter().map(|info| port(info, &links)).collect();
    ports.sort_by(|one, other| one.path.cmp(&other.path));
    ports
}

/// A port as the system lists it, with the links that lead to it.
fn port(info: &SerialPortInfo, links: &[(PathBuf, PathBuf)]) -> ConnectedPort {
    let path = Path::new(&info.port_name).to_owned();
    let leading = links.iter().filter(|(_, to)| *to == path).map(|(link, _)| link.display().to_string());
    let mut names: Vec<String> = leading.collect();
    let mut product = None;
    if let SerialPortType::UsbPort(usb) = &info.port_type {
        names.extend(usb.serial_number.iter().map(|serial| format!("{USB_PREFIX}{serial}")));
        product = usb.product.clone();
    }
    names.push(info.port_name.clone());
    ConnectedPort { path, names, product }
}

#[cfg(test)]
mod tests {
    use tokio_serial::UsbPortInfo;

    use super::*;

    #[test]
    fn a_port_is_named_in_every_way_it_can_be_configured_by() {
        let usb = UsbPortInfo {
            vid: 0x0403,
            pid: 0x6001,
            serial_number: Some("A50285BI".to_owned()),
            manufacturer: None,
            product: Some("FT232R".to_owned()),
        };
        let info = SerialPortInfo { port_name: "/dev/ttyUSB1".to_owned(), port_type: SerialPortType::UsbPort(usb) };
        let links = [("/dev/serial/by-id/usb-FTDI", "/dev/ttyUSB1"), ("/dev/serial/by-id/usb-else", "/dev/ttyUSB0")];
        let found = port(&info, &links.map(|(link, to)| (link.into(), to.into())));
        assert_eq!(found.names, ["/dev/serial/by-id/usb-FTDI", "usb:A50285BI", "/dev/ttyUSB1"]);
        assert_eq!(found.product.as_deref(), Some("FT232R"));
        let plain = SerialPortInfo { port_name: "/dev/ttyS0".to_owned(), port_type: SerialPortType::Unknown };
        assert_eq!(port(&plain, &[]).names, ["/dev/ttyS0"]);
    }

    #[test]
    fn a_camera_is_named_in_every_way_it_can_be_configured_by() {
        let node = Node {
            path: "/dev/video2".into(),
            by_id: vec!["/dev/v4l/by-id/usb-Mono-index0".into()],
            card: "Mono".to_owned(),
            driver: "uvcvideo".to_owned(),
            bus: "usb-1".to_owned(),
            usb_serial: Some("A1".to_owned()),
            unusable: None,
        };
        let camera = ConnectedCamera { node, formats: Vec::new() };
        assert_eq!(camera.names(), ["/dev/v4l/by-id/usb-Mono-index0", "usb:A1", "card:Mono", "/dev/video2"]);
    }
}
