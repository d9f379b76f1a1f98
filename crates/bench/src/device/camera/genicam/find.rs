//! Finding a camera on the network: by serial number, by the name that a user gave it, by address. Cameras are looked for on
//! the interfaces that are named, and on no other.

use std::collections::HashSet;
use std::net::Ipv4Addr;
use std::time::{Duration, Instant};

use serde::Serialize;
use viva_genicam::blocking;
use viva_genicam::gige::{DeviceInfo, DiscoveryOptions, Iface};

use super::bounded::{OPEN_WITHIN, Wanted, within};
use super::features;
use super::known::{self, Identity, InUse};
use super::listing::{self, Feature};
use super::read::{self, Opened, Reader};
use crate::config::{CameraConfig, GenicamName};
use plenoptics::raw::PixelFormat;

/// How long cameras are waited for: what they may take to answer.
const ANSWER_WITHIN: Duration = Duration::from_secs(1);

/// So many cameras are listed: whoever is on the network may answer in the name of any number.
const MOST_LISTED: usize = 64;
/// So many cameras are read when cameras are listed, those not counted that were read before.
const MOST_READ: usize = 16;
/// No more cameras are read after so long.
const LOOK_WITHIN: Duration = Duration::from_secs(20);

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

/// Every camera that answers on these interfaces, with what it offers; and what cannot be said, one sentence each: of an
/// interface on which none can be looked for, why. Takes a second for each interface, and as long as it takes to read the
/// cameras that were not read before; takes no camera from whoever has it, and disturbs none that this program uses itself.
#[must_use]
pub fn cameras(interfaces: &[String]) -> (Vec<NetworkCamera>, Vec<String>) {
    let (mut answers, mut notes) = (Vec::new(), Vec::new());
    for interface in interfaces {
        match answering(interface) {
            Ok(there) => answers.extend(there.into_iter().map(|info| (info, interface.clone()))),
            Err(why) => notes.push(why),
        }
    }
    let mut answers = distinct(answers, |(info, _)| info);
    if answers.len() > MOST_LISTED {
        notes.push(format!("{} cameras answer: {MOST_LISTED} of them are listed", answers.len()));
        answers.truncate(MOST_LISTED);
    }
    let mut allowance = Allowance::of(MOST_READ);
    let found = answers.iter().map(|(info, interface)| look_at(info, interface, &mut allowance)).collect();
    if allowance.refused > 0 {
        let refused = allowance.refused;
        notes.push(format!("what {refused} more of the cameras offer has not been read yet: look again"));
    }
    (found, notes)
}

/// One camera may answer on two interfaces, and is one.
fn distinct<T>(answers: Vec<T>, info: impl Fn(&T) -> &DeviceInfo) -> Vec<T> {
    let mut seen = HashSet::new();
    let mut is_new = |answer: &T| {
        let DeviceInfo { ip, mac, serial, .. } = info(answer);
        seen.insert((*ip, *mac, serial.clone()))
    };
    answers.into_iter().filter(|answer| is_new(answer)).collect()
}

/// How many cameras may still be read, and until when.
struct Allowance {
    cameras: usize,
    until: Instant,
    /// How many were not, for that.
    refused: usize,
}

impl Allowance {
    fn of(cameras: usize) -> Self {
        Self { cameras, until: Instant::now() + LOOK_WITHIN, refused: 0 }
    }

    /// Whether there is time for another camera.
    fn has_time(&mut self) -> bool {
        let granted = Instant::now() < self.until;
        self.refused += usize::from(!granted);
        granted
    }

    /// Whether another camera may be read.
    fn take(&mut self) -> bool {
        let granted = self.cameras > 0;
        self.cameras = self.cameras.saturating_sub(1);
        self.refused += usize::from(!granted);
        granted
    }
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

fn look_at(info: &DeviceInfo, interface: &str, allowance: &mut Allowance) -> NetworkCamera {
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
    let identity = Identity::of(info);
    if known::is_in_use(info.ip) {
        // It is being opened, or sends frames.
        camera.formats = known::formats(&identity, None).unwrap_or_default();
    } else if camera.unusable.is_none() && allowance.has_time() {
        match apart(|| read::offered(&identity, || allowance.take())) {
            Ok(Ok(formats)) => camera.formats = formats.unwrap_or_default(),
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

/// The camera that the configuration means, with what it offers.
///
/// # Errors
/// Why there is none, or more than one, naming what there is.
pub fn configured(config: &CameraConfig) -> Result<NetworkCamera, String> {
    let info = resolve(config)?;
    let interface = Iface::from_remote_ipv4(info.ip).map(|interface| interface.name().to_owned()).unwrap_or_default();
    let mut allowance = Allowance::of(1);
    Ok(look_at(&info, &interface, &mut allowance))
}

/// The features of the camera that the configuration means, and what is to be known of setting them, one sentence each: with
/// `apply` the configured ones are set first and its automatics switched off, for which the camera is taken for a moment.
///
/// # Errors
/// Why there is no such camera, or why it cannot be read or set, in words.
pub fn features_of(config: &CameraConfig, apply: bool) -> Result<(Vec<Feature>, Vec<String>), String> {
    let info = resolve(config)?;
    if !apply {
        return apart(|| Reader::open(info.ip)?.look(|device| Ok((listing::list(device), Vec::new()))))?;
    }
    let controls = config.controls.clone();
    within(OPEN_WITHIN, move |wanted| {
        let (mut opened, _in_use) = open(&info, wanted)?;
        let notes = features::apply(&mut opened.device, &controls)?;
        Ok((listing::list(&opened.device), notes))
    })
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
    if config.interfaces.is_empty() {
        return Err("bench.camera.interfaces names no network interface to look for the camera on".to_owned());
    }
    let (mut answers, mut wrong) = (Vec::new(), Vec::new());
    for interface in &config.interfaces {
        match answering(interface) {
            Ok(there) => answers.extend(there),
            // The camera may be on another.
            Err(why) => wrong.push(why),
        }
    }
    let info = chosen(answers, &name, config).map_err(|why| {
        wrong.insert(0, why);
        wrong.join("; ")
    })?;
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
    let answers = distinct(answers, |info| info);
    let fitting: Vec<&DeviceInfo> = answers.iter().filter(|info| fits(info)).collect();
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

/// Takes control of a camera while that is `wanted`, which is this program's own while the other that is returned lives: to be
/// done [`within`] bounded time.
///
/// # Errors
/// Why not, and what to do, in words.
pub(super) fn open(info: &DeviceInfo, wanted: &Wanted) -> Result<(Opened, InUse), String> {
    let in_use = InUse::begin(info.ip);
    let opened = Reader::open(info.ip)?.take(wanted).map_err(|why| match is_controlled(info.ip) {
        // Some refuse, some say nothing.
        true => features::CONTROLLED.to_owned(),
        false => why,
    })?;
    // For whoever lists cameras meanwhile. What cannot be read now is read then.
    if let (Ok(place), Ok(formats)) = (read::place(&opened.device), read::formats(&opened.device)) {
        known::keep(&Identity::of(info), &place, &formats);
    }
    Ok((opened, in_use))
}

/// Whether somebody has control of a camera; `false` where it does not say.
fn is_controlled(address: Ipv4Addr) -> bool {
    Reader::open(address).is_ok_and(|mut reader| reader.is_controlled())
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
    fn a_camera_that_answers_on_two_interfaces_is_one() {
        let (one, other) = (camera(1, "A1", "spare"), camera(2, "B2", "spare"));
        let heard = vec![one.clone(), other.clone(), DeviceInfo { local_ip: Some(other.ip), ..one.clone() }];
        assert_eq!(distinct(heard.clone(), |info| info), [one, other]);
        let config = CameraConfig { interfaces: vec!["a".to_owned(), "b".to_owned()], ..CameraConfig::default() };
        let several = chosen(heard, &GenicamName::Name("spare".to_owned()), &config).unwrap_err();
        assert_eq!(several.matches("10.0.0.1").count(), 1, "{several}");
    }

    #[test]
    fn a_camera_in_use_is_listed_by_what_is_known_of_it_and_not_disturbed() {
        // Nothing is there.
        let info = DeviceInfo::from_ip(Ipv4Addr::new(127, 97, 0, 1));
        let there = look_at(&info, "lo", &mut Allowance::of(1));
        assert!(there.unusable.is_some_and(|why| why.contains("does not answer")));
        known::keep(&Identity::of(&info), b"", &["Mono8".to_owned()]);
        let _in_use = InUse::begin(info.ip);
        let there = look_at(&info, "lo", &mut Allowance::of(1));
        assert_eq!((there.formats, there.unusable), (vec!["Mono8".to_owned()], None));
    }

    #[test]
    fn no_more_cameras_are_read_than_allowed_nor_longer() {
        let mut few = Allowance::of(1);
        assert!(few.take() && !few.take() && !few.take() && few.has_time());
        assert_eq!(few.refused, 2);
        let mut late = Allowance { until: Instant::now(), ..Allowance::of(1) };
        assert!(!late.has_time());
        let info = DeviceInfo::from_ip(Ipv4Addr::new(127, 96, 0, 1));
        let there = look_at(&info, "lo", &mut late);
        assert_eq!((there.unusable, there.formats.len(), late.refused), (None, 0, 2), "it was not asked");
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
        let interfaces = vec!["no-such-interface".to_owned()];
        let (found, wrong) = cameras(&interfaces);
        assert!(found.is_empty() && wrong[0].contains("no network interface \"no-such-interface\""), "{wrong:?}");
        let config = CameraConfig { device: "serial:A1".to_owned(), interfaces, ..CameraConfig::default() };
        let why = resolve(&config).unwrap_err();
        assert!(why.contains("no camera") && why.contains("no network interface"), "{why}");
    }
}
