//! Finding a camera: by serial number, by the name that a user gave it, by address on the network, by product on USB. On the
//! network cameras are looked for on the interfaces that are named, and on no other.

use std::net::Ipv4Addr;
use std::time::{Duration, Instant};

use viva_genicam::u3v::U3vDeviceInfo;

use super::bounded::{OPEN_WITHIN, Wanted, apart, within};
use super::features;
use super::found::{FoundCamera, Way};
use super::known::{self, InUse};
use super::listing::{self, Feature};
use super::read::{self, Opened, Reader};
use super::target::{Target, given};
use super::{network, usb};
use crate::config::{CameraConfig, GenicamName};

/// So many cameras are listed: whoever is on the network may answer in the name of any number.
const MOST_LISTED: usize = 64;
/// So many cameras are read when cameras are listed, those not counted that were read before.
const MOST_READ: usize = 16;
/// No more cameras are read after so long.
const LOOK_WITHIN: Duration = Duration::from_secs(20);

/// Every camera that is connected to USB or answers on these interfaces, with what it offers; and what cannot be said, one
/// sentence each: of an interface on which none can be looked for, why. Takes a second for each interface, and as long as it
/// takes to read the cameras that were not read before; takes no camera from whoever has it, and disturbs none that this
/// program uses itself.
#[must_use]
pub fn cameras(interfaces: &[String]) -> (Vec<FoundCamera>, Vec<String>) {
    let (mut answers, mut notes) = (Vec::new(), Vec::new());
    for interface in interfaces {
        match network::answering(interface) {
            Ok(there) => answers.extend(there.into_iter().map(|info| (info, interface.clone()))),
            Err(why) => notes.push(why),
        }
    }
    let mut targets = usb::targets(|_| true).unwrap_or_else(|why| {
        notes.push(why);
        Vec::new()
    });
    let usb = targets.len();
    let answers = network::distinct(answers, |(info, _)| info);
    let (heard, interfaces): (Vec<_>, Vec<_>) =
        answers.into_iter().map(|(info, interface)| (Target::Network(info), interface)).unzip();
    targets.extend(heard);
    if targets.len() > MOST_LISTED {
        notes.push(format!("{} cameras answer: {MOST_LISTED} of them are listed", targets.len()));
        targets.truncate(MOST_LISTED);
    }
    let mut allowance = Allowance::of(MOST_READ);
    // Those on USB come by no interface.
    let interfaces = std::iter::repeat_n(String::new(), usb).chain(interfaces);
    let found = targets.iter().zip(interfaces).map(|(target, by)| look_at(target, &by, &mut allowance)).collect();
    if allowance.refused > 0 {
        let refused = allowance.refused;
        notes.push(format!("what {refused} more of the cameras offer has not been read yet: look again"));
    }
    (found, notes)
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

fn look_at(target: &Target, interface: &str, allowance: &mut Allowance) -> FoundCamera {
    let (way, unusable) = match target {
        Target::Network(info) => {
            (Way::Network { address: info.ip, interface: interface.to_owned() }, network::elsewhere(info))
        }
        Target::Usb(info, names) => {
            let product = format!("{:04x}:{:04x}", info.vendor_id, info.product_id);
            let carried_mbit_per_s = info.speed.and_then(usb::carried_mbit_per_s);
            (Way::Usb { file: usb::device_file(info), product, carried_mbit_per_s }, names.as_ref().err().cloned())
        }
    };
    let mut camera = FoundCamera {
        way,
        model: target.model(),
        serial: target.serial(),
        user_name: target.user_name(),
        formats: Vec::new(),
        unusable,
    };
    let identity = target.known_as();
    if known::is_in_use(&target.site()) {
        // It is being opened, or sends frames.
        (camera.formats, camera.unusable) = (known::formats(&identity, None).unwrap_or_default(), None);
    } else if camera.unusable.is_none() && allowance.has_time() {
        let offered = apart(|| match target {
            Target::Network(info) => read::offered(info.ip, &identity, || allowance.take()),
            Target::Usb(info, _) => usb::offered(info, || allowance.take()),
        });
        match offered {
            Ok(Ok(formats)) => camera.formats = formats.unwrap_or_default(),
            Ok(Err(why)) | Err(why) => camera.unusable = Some(why),
        }
    }
    camera
}

/// The camera that the configuration means, with what it offers.
///
/// # Errors
/// Why there is none, or more than one, naming what there is.
pub fn configured(config: &CameraConfig) -> Result<FoundCamera, String> {
    let target = resolve(config)?;
    let interface = match &target {
        Target::Network(info) => network::interface_to(info.ip),
        Target::Usb(..) => String::new(),
    };
    Ok(look_at(&target, &interface, &mut Allowance::of(1)))
}

/// The features of the camera that the configuration means, and what is to be known of setting them, one sentence each: with
/// `apply` the configured ones are set first and its automatics switched off, for which the camera is taken for a moment. One
/// on USB is taken for a moment in any case.
///
/// # Errors
/// Why there is no such camera, or why it cannot be read or set, in words.
pub fn features_of(config: &CameraConfig, apply: bool) -> Result<(Vec<Feature>, Vec<String>), String> {
    let target = resolve(config)?;
    if let (Target::Network(info), false) = (&target, apply) {
        return apart(|| Reader::open(info.ip)?.look(|device| Ok((listing::list(device), Vec::new()))))?;
    }
    let controls = config.controls.clone();
    within(OPEN_WITHIN, move |wanted| {
        let (mut opened, _in_use) = open(&target, wanted)?;
        let notes = if apply { features::apply(&mut opened.device, &controls)? } else { Vec::new() };
        Ok((listing::list(&opened.device), notes))
    })
}

/// As [`configured`], for whoever opens it.
pub(super) fn resolve(config: &CameraConfig) -> Result<Target, String> {
    let name = GenicamName::of(&config.device)
        .ok_or_else(|| format!("{:?} names no GenICam camera (bench.camera.device)", config.device))?;
    if let GenicamName::Address(address) = name {
        return network::at(address).map(Target::Network);
    }
    let (mut heard, mut wrong) = (Vec::new(), Vec::new());
    // Mostly the kernel knows which it is, and none has to be opened to be asked.
    let asks = |there: &[U3vDeviceInfo]| match &name {
        GenicamName::Serial(serial) => !there.iter().any(|info| given(info.serial.as_ref()).as_ref() == Some(serial)),
        GenicamName::Name(_) => true,
        GenicamName::Product(..) | GenicamName::Address(_) => false,
    };
    let mut answers = usb::targets(asks).unwrap_or_else(|why| {
        wrong.push(why);
        Vec::new()
    });
    let on_network = !matches!(name, GenicamName::Product(..));
    for interface in config.interfaces.iter().filter(|_| on_network) {
        match network::answering(interface) {
            Ok(there) => heard.extend(there),
            // The camera may be on another.
            Err(why) => wrong.push(why),
        }
    }
    answers.extend(network::distinct(heard, |info| info).into_iter().map(Target::Network));
    let target = chosen(answers, &name, config).map_err(|why| {
        wrong.insert(0, why);
        wrong.join("; ")
    })?;
    match &target {
        Target::Network(info) => network::elsewhere(info).map_or(Ok(target), Err),
        Target::Usb(..) => Ok(target),
    }
}

fn chosen(answers: Vec<Target>, name: &GenicamName, config: &CameraConfig) -> Result<Target, String> {
    let (mut fitting, others): (Vec<Target>, Vec<Target>) =
        answers.into_iter().partition(|target| target.is_called(name));
    let described = |targets: &[Target]| targets.iter().map(Target::described).collect::<Vec<_>>().join(", ");
    if fitting.len() > 1 {
        let several = described(&fitting);
        return Err(format!(
            "{:?} is more than one camera: {several}; name one by its serial number or address",
            config.device
        ));
    }
    fitting.pop().ok_or_else(|| {
        let there = if others.is_empty() { "none".to_owned() } else { described(&others) };
        let by_product = matches!(name, GenicamName::Product(..));
        let interfaces = if by_product { &[] } else { &config.interfaces[..] };
        let on: Vec<&str> = std::iter::once("USB").chain(interfaces.iter().map(String::as_str)).collect();
        let unasked = if interfaces.is_empty() && !by_product {
            " (on the network none is looked for: bench.camera.interfaces is empty)"
        } else {
            ""
        };
        format!(
            "no camera on {} is {:?}: there is {there}; connect it, or correct bench.camera.device{unasked}",
            on.join(", "),
            config.device
        )
    })
}

/// Takes control of a camera while that is `wanted`, which is this program's own while the other that is returned lives: to be
/// done [`within`] bounded time.
///
/// # Errors
/// Why not, and what to do, in words.
pub(super) fn open(target: &Target, wanted: &Wanted) -> Result<(Opened, InUse), String> {
    let in_use = InUse::begin(target.site());
    let opened = match target {
        Target::Network(info) => Reader::open(info.ip)?.take(wanted).map_err(|why| match is_controlled(info.ip) {
            // Some refuse, some say nothing.
            true => features::CONTROLLED.to_owned(),
            false => why,
        })?,
        Target::Usb(info, _) => usb::open(info)?,
    };
    // For whoever lists cameras meanwhile. What cannot be read now is read then.
    if let (Ok(place), Ok(formats)) = (read::place(&opened.device), read::formats(&opened.device)) {
        known::keep(&target.known_as(), &place, &formats);
    }
    Ok((opened, in_use))
}

/// Whether somebody has control of a camera; `false` where it does not say.
fn is_controlled(address: Ipv4Addr) -> bool {
    Reader::open(address).is_ok_and(|mut reader| reader.is_controlled())
}

#[cfg(test)]
mod tests {
    use viva_genicam::gige::DeviceInfo;

    use super::super::usb::Names;
    use super::*;

    fn camera(last: u8, serial: &str, user_name: &str) -> Target {
        Target::Network(DeviceInfo {
            model: Some("Mono".to_owned()),
            serial: Some(serial.to_owned()),
            user_name: Some(user_name.to_owned()),
            ..DeviceInfo::from_ip(Ipv4Addr::new(10, 0, 0, last))
        })
    }

    /// One whose USB device has another serial number than it says itself.
    fn on_usb(address: u8, serial: &str, names: Result<[&str; 2], &str>) -> Target {
        let info = U3vDeviceInfo {
            bus: "002".to_owned(),
            address,
            vendor_id: 0x2676,
            product_id: 0xba00 + u16::from(address),
            serial: Some(serial.to_owned()),
            manufacturer: Some("Maker".to_owned()),
            model: Some("Fast".to_owned()),
            speed: None,
        };
        let names =
            names.map(|[serial, name]| Names { serial: Some(serial.to_owned()), user_name: Some(name.to_owned()) });
        Target::Usb(info, names.map_err(str::to_owned))
    }

    fn config(device: &str) -> CameraConfig {
        CameraConfig { device: device.to_owned(), interfaces: vec!["eth1".to_owned()], ..CameraConfig::default() }
    }

    fn found(there: Vec<Target>, device: &str) -> Result<String, String> {
        chosen(there, &GenicamName::of(device).unwrap(), &config(device)).map(|target| target.said_site())
    }

    #[test]
    fn one_camera_is_found_by_serial_number_or_name() {
        let there = || vec![camera(1, "A1", "left"), camera(2, "B2", "spare"), camera(3, "C3", "spare")];
        assert_eq!(found(there(), "serial:B2").unwrap(), "10.0.0.2");
        assert_eq!(found(there(), "name:left").unwrap(), "10.0.0.1");
        let several = found(there(), "name:spare").unwrap_err();
        assert!(several.contains("more than one camera: 10.0.0.2 (Mono, serial:B2, name:spare)"), "{several}");
        let none = found(there(), "serial:D4").unwrap_err();
        assert!(none.contains("no camera on USB, eth1 is \"serial:D4\"") && none.contains("serial:A1"), "{none}");
    }

    #[test]
    fn a_camera_on_usb_is_found_by_either_serial_number_its_name_or_its_product() {
        let there =
            || vec![camera(1, "A1", "left"), on_usb(5, "0A5", Ok(["55", "right"])), on_usb(6, "0A6", Err("held"))];
        for device in ["serial:0A5", "serial:55", "name:right", "usb:2676:ba05"] {
            assert_eq!(found(there(), device).unwrap(), "usb:2676:ba05", "{device}");
        }
        let none = found(there(), "name:third").unwrap_err();
        assert!(none.contains("usb:2676:ba06 (Fast, serial:0A6; held)"), "{none}");
        let both = vec![camera(1, "A1", "left"), on_usb(5, "0A5", Ok(["55", "left"]))];
        assert!(found(both, "name:left").unwrap_err().contains("more than one"));
    }

    #[test]
    fn a_camera_in_use_is_listed_by_what_is_known_of_it_and_not_disturbed() {
        // Nothing is there.
        let network = Target::Network(DeviceInfo::from_ip(Ipv4Addr::new(127, 97, 0, 1)));
        for (target, why) in [(network, "does not answer"), (on_usb(255, "0B1", Ok(["1", ""])), "not connected")] {
            let there = look_at(&target, "lo", &mut Allowance::of(1));
            assert!(there.unusable.as_ref().is_some_and(|told| told.contains(why)), "{there:?}");
            known::keep(&target.known_as(), b"", &["Mono8".to_owned()]);
            let _in_use = InUse::begin(target.site());
            let there = look_at(&target, "lo", &mut Allowance::of(1));
            assert_eq!((there.formats, there.unusable), (vec!["Mono8".to_owned()], None));
        }
    }

    #[test]
    fn no_more_cameras_are_read_than_allowed_nor_longer() {
        let mut few = Allowance::of(1);
        assert!(few.take() && !few.take() && !few.take() && few.has_time());
        assert_eq!(few.refused, 2);
        let mut late = Allowance { until: Instant::now(), ..Allowance::of(1) };
        assert!(!late.has_time());
        let target = Target::Network(DeviceInfo::from_ip(Ipv4Addr::new(127, 96, 0, 1)));
        let there = look_at(&target, "lo", &mut late);
        assert_eq!((there.unusable, there.formats.len(), late.refused), (None, 0, 2), "it was not asked");
    }

    #[test]
    fn an_interface_that_is_not_there_is_named() {
        let interfaces = vec!["no-such-interface".to_owned()];
        let (_, wrong) = cameras(&interfaces);
        assert!(wrong[0].contains("no network interface \"no-such-interface\""), "{wrong:?}");
        let config = CameraConfig { device: "serial:A1".to_owned(), interfaces, ..CameraConfig::default() };
        let why = resolve(&config).unwrap_err();
        assert!(why.contains("no camera") && why.contains("no network interface"), "{why}");
    }
}
