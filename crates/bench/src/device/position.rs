//! What is plugged in where: one device is one, however its port is spelled.

use std::fs;
use std::path::Path;

use super::serial::{TERMINALS, find};

/// What the kernel knows the device behind a port of the configuration by: for a USB adapter the place where it is plugged
/// in, which is the same for its `/dev/serial/by-id` name, its `usb:` serial number and its `/dev/ttyUSB0`; for any other
/// port its file, links followed. `None` while nothing is there.
#[must_use]
pub fn position(port: &Path) -> Option<String> {
    let path = find("port", port).ok()?;
    position_in(Path::new(TERMINALS), &path)
}

fn position_in(terminals: &Path, path: &Path) -> Option<String> {
    let file = fs::canonicalize(path).ok()?;
    let name = file.file_name()?;
    Some(usb_position(&terminals.join(name).join("device")).unwrap_or_else(|| file.display().to_string()))
}

/// Where a terminal's device is plugged in; `None` where it is not of USB.
fn usb_position(device: &Path) -> Option<String> {
    let device = fs::canonicalize(device).ok()?;
    device.ancestors().find(|above| above.join("idVendor").is_file())?;
    // Below its interface a converter has a folder for each of its ports, named after the terminal, whose number says only
    // when it was plugged in.
    let Ok(port) = fs::read_to_string(device.join("port_number")) else { return Some(device.display().to_string()) };
    Some(format!("{}.{}", device.parent()?.display(), port.trim()))
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    /// A system in which one USB converter has two ports, a second device is of USB without ports of its own, and a third
    /// terminal is none of USB.
    struct System {
        folder: tempfile::TempDir,
    }

    impl System {
        fn new() -> Self {
            let folder = tempfile::tempdir().unwrap();
            let at = |path: &str| folder.path().join(path);
            for usb in ["1-2", "1-3"] {
                fs::create_dir_all(at(&format!("devices/usb1/{usb}"))).unwrap();
                fs::write(at(&format!("devices/usb1/{usb}/idVendor")), "0403\n").unwrap();
            }
            fs::create_dir_all(at("dev/by-id")).unwrap();
            fs::create_dir_all(at("devices/platform/serial8250")).unwrap();
            fs::create_dir_all(at("devices/usb1/1-3/1-3:1.0")).unwrap();
            let system = Self { folder };
            system.plug("ttyUSB0", Some("0"));
            system.plug("ttyUSB1", Some("1"));
            system.terminal("ttyACM0", "devices/usb1/1-3/1-3:1.0");
            system.terminal("ttyS0", "devices/platform/serial8250");
            system
        }

        fn at(&self, path: &str) -> std::path::PathBuf {
            self.folder.path().join(path)
        }

        fn terminal(&self, name: &str, device: &str) {
            fs::create_dir_all(self.at(&format!("class/{name}"))).unwrap();
            symlink(self.at(device), self.at(&format!("class/{name}/device"))).unwrap();
            fs::write(self.at(&format!("dev/{name}")), "").unwrap();
        }

        fn plug(&self, name: &str, port: Option<&str>) {
            let device = format!("devices/usb1/1-2/1-2:1.0/{name}");
            fs::create_dir_all(self.at(&device)).unwrap();
            if let Some(port) = port {
                fs::write(self.at(&format!("{device}/port_number")), format!("{port}\n")).unwrap();
            }
            self.terminal(name, &device);
        }

        fn of(&self, path: &str) -> Option<String> {
            position_in(&self.at("class"), &self.at(path))
        }
    }

    #[test]
    fn a_device_is_one_however_its_port_is_spelled() {
        let system = System::new();
        symlink("../ttyUSB1", system.at("dev/by-id/usb-adapter-if00-port1")).unwrap();
        let found = system.of("dev/by-id/usb-adapter-if00-port1").unwrap();
        assert_eq!(Some(&found), system.of("dev/ttyUSB1").as_ref());
        assert!(found.ends_with("devices/usb1/1-2/1-2:1.0.1"), "{found}");
        assert_ne!(system.of("dev/ttyUSB0"), system.of("dev/ttyUSB1"));
        assert!(system.of("dev/ttyACM0").unwrap().ends_with("1-3:1.0"));
        // All ports of a board's own share a folder in the system.
        assert_eq!(system.of("dev/ttyS0"), Some(system.at("dev/ttyS0").canonicalize().unwrap().display().to_string()));
        assert_eq!(system.of("dev/by-id/nobody"), None);
    }

    #[test]
    fn a_device_that_comes_back_under_another_name_is_the_same() {
        let system = System::new();
        let before = system.of("dev/ttyUSB0");
        fs::remove_dir_all(system.at("devices/usb1/1-2/1-2:1.0/ttyUSB0")).unwrap();
        system.plug("ttyUSB7", Some("0"));
        assert_eq!(system.of("dev/ttyUSB7"), before);
    }
}
