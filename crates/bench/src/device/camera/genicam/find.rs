//! Finding a camera on the network: by serial number, by the name that a user gave it, by address. Cameras are looked for on
//! the interfaces that are named, and on no other.

use std::net::Ipv4Addr;
use std::time::Duration;

use serde::Serialize;
use viva_genicam::genapi::RegisterIo as _;
use viva_genicam::gige::{DeviceInfo, DiscoveryOptions, Iface};
use viva_genicam::{Access, blocking};

use super::features::{self, Device, state};
use crate::config::{CameraConfig, GenicamName};
use plenoptics::raw::PixelFormat;

/// How long cameras are waited for: what they may take to answer.
const ANSWER_WITHIN: Duration = Duration::from_secs(1);

/// The register that every GigE Vision device tells at whether it is controlled, and the bits of its last byte that say so.
const CONTROL_PRIVILEGE: u64 = 0x0a00;
const CONTROLLED_BITS: u8 = 3;

/// A camera on the network.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct NetworkCamera {
    /// Its address.
    pub address: Ipv4Addr,
    /// Who made it, and the model.
    pub model: String,
    /// Its serial number.
    pub serial: Option<String>,
    /// The name that a user gave it.
    pub user_name: Option<String>,
    /// The interface on which it answered.
    pub interface: String,
    /// The formats it offers, by their PFNC names.
    pub formats: Vec<String>,
    /// Why no frames can be had of it; absent where they can.
    pub unusable: Option<String>,
}

impl NetworkCamera {
    /// What `bench.camera.device` can be to mean it, the steadiest name first.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        let serial = self.serial.iter().map(|serial| format!("serial:{serial}"));
        let user_name = self.user_name.iter().map(|name| format!("name:{name}"));
        serial.chain(user_name).chain([self.address.to_string()]).collect()
    }

    /// The formats of it that this program reads.
    #[must_use]
    pub fn readable(&self) -> Vec<String> {
        self.formats.iter().filter(|name| PixelFormat::from_genicam_name(name).is_some()).cloned().collect()
    }
}

/// Every camera that answers on these interfaces, with what it offers; and of each interface on which none can be looked for,
/// why. Takes a second for each interface; takes no camera from whoever has it.
#[must_use]
pub fn cameras(interfaces: &[String]) -> (Vec<NetworkCamera>, Vec<String>) {
    let mut wrong = Vec::new();
    let mut found = Vec::new();
    for interface in interfaces {
        match answering(interface) {
            Ok(answers) => found.extend(answers.iter().map(|info| look_at(info, interface))),
            Err(why) => wrong.push(why),
        }
    }
    (found, wrong)
}

/// Runs what may be run in no thread of an asynchronous runtime.
fn apart<T: Send>(work: impl FnOnce() -> T + Send) -> Result<T, String> {
    let joined = std::thread::scope(|scope| scope.spawn(work).join());
    joined.map_err(|_| "the camera's library answered something unexpected".to_owned())
}

fn answering(interface: &str) -> Result<Vec<DeviceInfo>, String> {
    let there = Iface::from_system(interface)
        .map_err(|_| format!("there is no network interface {interface:?} (bench.camera.interfaces)"))?;
    if there.ipv4().is_none() {
        return Err(format!("the network interface {interface:?} has no IPv4 address to look for cameras from"));
    }
    let options = DiscoveryOptions::new().interface(interface);
    let answers = apart(|| blocking::discover_with(ANSWER_WITHIN, &options))?;
    answers.map_err(|error| format!("cameras cannot be looked for on {interface}: {error}"))
}

fn look_at(info: &DeviceInfo, interface: &str) -> NetworkCamera {
    let words = [&info.manufacturer, &info.model].into_iter().flatten();
    let mut camera = NetworkCamera {
        address: info.ip,
        model: words.map(|word| word.trim().to_owned()).collect::<Vec<_>>().join(" "),
        serial: given(info.serial.as_ref()),
        user_name: given(info.user_name.as_ref()),
        interface: interface.to_owned(),
        formats: Vec::new(),
        unusable: elsewhere(info),
    };
    if camera.unusable.is_none() {
        match apart(|| formats(info)) {
            Ok(Ok(formats)) => camera.formats = formats,
            Ok(Err(why)) | Err(why) => camera.unusable = Some(why),
        }
    }
    camera
}

fn given(text: Option<&String>) -> Option<String> {
    text.map(|text| text.trim().to_owned()).filter(|text| !text.is_empty())
}

/// Why a camera that answers cannot be reached, where its address is of another network.
fn elsewhere(info: &DeviceInfo) -> Option<String> {
    (info.shares_subnet_with_host() == Some(false)).then(|| {
        let ours = info.local_ip.map_or_else(String::new, |ip| format!(" (this machine is {ip})"));
        format!("its address {} is of another network than this machine's{ours}: give one of the two another", info.ip)
    })
}

fn formats(info: &DeviceInfo) -> Result<Vec<String>, String> {
    let (device, _) = blocking::connect_as(info, Access::Monitor).map_err(|error| features::why(&error))?;
    Ok(state(&device, "PixelFormat")?.and_then(|state| state.enum_entries).unwrap_or_default())
}

/// The camera that the configuration means, with what it offers.
///
/// # Errors
/// Why there is none, or more than one, naming what there is.
pub fn configured(config: &CameraConfig) -> Result<NetworkCamera, String> {
    let info = resolve(config)?;
    let interface = Iface::from_remote_ipv4(info.ip).map(|interface| interface.name().to_owned()).unwrap_or_default();
    Ok(look_at(&info, &interface))
}

/// As [`configured`], for whoever opens it.
pub(super) fn resolve(config: &CameraConfig) -> Result<DeviceInfo, String> {
    let name = GenicamName::of(&config.device)
        .ok_or_else(|| format!("{:?} names no GenICam camera (bench.camera.device)", config.device))?;
    if let GenicamName::Address(address) = name {
        let answer = apart(|| blocking::discover_ip(address, ANSWER_WITHIN))?;
        let found = answer.map_err(|error| format!("{address} cannot be reached: {error}"))?;
        return found
            .ok_or_else(|| format!("no camera answers at {address}; connect it, or correct bench.camera.device"));
    }
    let mut answers = Vec::new();
    for interface in &config.interfaces {
        answers.extend(answering(interface)?);
    }
    let info = chosen(answers, &name, config)?;
    elsewhere(&info).map_or(Ok(info), Err)
}

fn chosen(answers: Vec<DeviceInfo>, name: &GenicamName, config: &CameraConfig) -> Result<DeviceInfo, String> {
    let fits = |info: &DeviceInfo| match name {
        GenicamName::Serial(serial) => given(info.serial.as_ref()).as_ref() == Some(serial),
        GenicamName::Name(wanted) => given(info.user_name.as_ref()).as_ref() == Some(wanted),
        GenicamName::Address(address) => info.ip == *address,
    };
    let described = |info: &DeviceInfo| {
        let serial = given(info.serial.as_ref()).map_or_else(String::new, |serial| format!(", serial:{serial}"));
        let named = given(info.user_name.as_ref()).map_or_else(String::new, |named| format!(", name:{named}"));
        format!("{} ({}{serial}{named})", info.ip, info.model.as_deref().unwrap_or("of no name"))
    };
    // One camera may answer on two interfaces.
    let mut fitting: Vec<&DeviceInfo> = answers.iter().filter(|info| fits(info)).collect();
    fitting.dedup_by_key(|info| info.ip);
    match fitting[..] {
        [one] => Ok(one.clone()),
        [] => {
            let there: Vec<String> = answers.iter().map(described).collect();
            let there = if there.is_empty() { "none".to_owned() } else { there.join(", ") };
            Err(format!(
                "no camera on {} is {:?}: there is {there}; connect it, or correct bench.camera.device",
                config.interfaces.join(", "),
                config.device
            ))
        }
        _ => {
            let several: Vec<String> = fitting.into_iter().map(described).collect();
            Err(format!("{:?} is more than one camera: {}; name one by its address", config.device, several.join(", ")))
        }
    }
}

/// Takes control of a camera.
///
/// # Errors
/// Why not, and what to do, in words.
pub(super) fn open(info: &DeviceInfo) -> Result<Device, String> {
    blocking::connect(info).map_err(|error| match is_controlled(info) {
        // Some refuse, some say nothing.
        true => features::CONTROLLED.to_owned(),
        false => features::why(&error),
    })
}

/// Whether somebody has control of a camera; `false` where it does not say.
fn is_controlled(info: &DeviceInfo) -> bool {
    let Ok((device, _)) = blocking::connect_as(info, Access::Monitor) else { return false };
    let privilege = device.transport().read(CONTROL_PRIVILEGE, 4);
    privilege.is_ok_and(|bytes| bytes.last().is_some_and(|last| last & CONTROLLED_BITS != 0))
}

/// What a camera is, in a line.
pub(super) fn identity(info: &DeviceInfo) -> String {
    let maker = info.manufacturer.as_deref().unwrap_or_default();
    let model = info.model.as_deref().unwrap_or("GenICam camera");
    let serial = given(info.serial.as_ref()).map_or_else(String::new, |serial| format!("{serial}, "));
    format!("{} ({serial}{})", format!("{maker} {model}").trim(), info.ip)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(last: u8, serial: &str, user_name: &str) -> DeviceInfo {
        DeviceInfo {
            model: Some("Mono".to_owned()),
            serial: Some(serial.to_owned()),
            user_name: Some(user_name.to_owned()),
            ..DeviceInfo::from_ip(Ipv4Addr::new(10, 0, 0, last))
        }
    }

    #[test]
    fn one_camera_is_found_by_serial_number_or_name() {
        let there = || vec![camera(1, "A1", "left"), camera(2, "B2", "spare"), camera(3, "C3", "spare")];
        let config = |device: &str| CameraConfig {
            device: device.to_owned(),
            interfaces: vec!["eth1".to_owned()],
            ..CameraConfig::default()
        };
        let of = |device: &str| chosen(there(), &GenicamName::of(device).unwrap(), &config(device)).map(|info| info.ip);
        assert_eq!(of("serial:B2"), Ok(Ipv4Addr::new(10, 0, 0, 2)));
        assert_eq!(of("name:left"), Ok(Ipv4Addr::new(10, 0, 0, 1)));
        let several = of("name:spare").unwrap_err();
        assert!(several.contains("more than one camera: 10.0.0.2 (Mono, serial:B2, name:spare)"), "{several}");
        let none = of("serial:D4").unwrap_err();
        assert!(none.contains("no camera on eth1 is \"serial:D4\"") && none.contains("serial:A1"), "{none}");
        // The same one, heard twice.
        let twice =
            chosen(vec![camera(1, "A1", ""), camera(1, "A1", "")], &GenicamName::Serial("A1".into()), &config("x"));
        assert_eq!(twice.map(|info| info.ip), Ok(Ipv4Addr::new(10, 0, 0, 1)));
    }

    #[test]
    fn a_camera_of_another_network_says_so() {
        let mask = Some(Ipv4Addr::new(255, 255, 255, 0));
        let near = DeviceInfo {
            subnet: mask,
            local_ip: Some(Ipv4Addr::new(10, 0, 0, 9)),
            local_netmask: mask,
            ..camera(1, "A1", "")
        };
        assert_eq!(elsewhere(&near), None);
        let far = DeviceInfo { local_ip: Some(Ipv4Addr::new(10, 0, 7, 9)), ..near };
        assert!(elsewhere(&far).unwrap().contains("this machine is 10.0.7.9"));
    }

    #[test]
    fn an_interface_that_is_not_there_is_named() {
        let (found, wrong) = cameras(&["no-such-interface".to_owned()]);
        assert!(found.is_empty() && wrong[0].contains("no network interface \"no-such-interface\""), "{wrong:?}");
    }
}
