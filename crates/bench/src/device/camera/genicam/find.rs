//! Finding a camera: by serial number, by the name that a user gave it, by address on the network, by product on USB.
//! On the network cameras are looked for on the interfaces that are named, and on no other.

use std::net::Ipv4Addr;
use std::time::Instant;

use viva_genicam::u3v::U3vDeviceInfo;

use super::allowance::Allowance;
use super::bounded::{OPEN_WITHIN, Wanted, apart, within};
use super::features;
use super::found::FoundCamera;
use super::known::{self, InUse};
use super::listing::{self, Feature};
use super::read::{self, Opened, Reader};
use super::target::Target;
use super::turn::Turn;
use super::usb::Names;
use super::{network, survey, usb};
use crate::config::{CameraConfig, GenicamName};

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
    Ok(survey::look_at(&target, &interface, &mut Allowance::of(1)))
}

/// The features of the camera that the configuration means, and what is to be known of setting them, one sentence each:
/// with `apply` the configured ones are set first and its automatics switched off, for which the camera is taken for a
/// moment. One on USB is taken for a moment in any case.
///
/// # Errors
/// Why there is no such camera, or why it cannot be read or set, in words.
pub fn features_of(config: &CameraConfig, apply: bool) -> Result<(Vec<Feature>, Vec<String>), String> {
    let target = resolve(config)?;
    if let (Target::Network(info), false) = (&target, apply) {
        let until = Instant::now() + OPEN_WITHIN;
        return apart(|| Reader::open(info.ip)?.look(until, |device| Ok((listing::list(device), Vec::new()))))?;
    }
    let controls = config.controls.clone();
    within(OPEN_WITHIN, move |wanted| {
        let (in_use, mut opened) = open(&target, wanted)?;
        let applied = if apply { features::apply(&mut opened.device, &controls) } else { Ok(Vec::new()) };
        let listed = applied.map(|notes| (listing::list(&opened.device), notes));
        // In use until it is let go of.
        drop((opened, in_use));
        listed
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
    let mut answers = usb::targets().unwrap_or_else(|why| {
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
    let mut allowance = Allowance::of(0);
    ask_where_needed(&mut answers, &name, |info| {
        match allowance.time_for(&usb::device_file(info).display().to_string()) {
            Some(until) => usb::names(info, until),
            None => Ok(Names::default()),
        }
    });
    wrong.extend(allowance.notes());
    let target = chosen(answers, &name, config).map_err(|why| {
        wrong.insert(0, why);
        wrong.join("; ")
    })?;
    match &target {
        Target::Network(info) => network::elsewhere(info).map_or(Ok(target), Err),
        Target::Usb(..) => Ok(target),
    }
}

/// Has those on USB say what they are, which takes opening them: only where none that is there is known to have this
/// name, by what the kernel tells or by its answer from the network.
fn ask_where_needed(
    there: &mut [Target],
    name: &GenicamName,
    mut ask: impl FnMut(&U3vDeviceInfo) -> Result<Names, String>,
) {
    let by_word_of_its_own = matches!(name, GenicamName::Serial(_) | GenicamName::Name(_));
    if !by_word_of_its_own || there.iter().any(|target| target.is_called(name)) {
        return;
    }
    for target in there {
        if let Target::Usb(info, names) = target {
            *names = ask(info);
        }
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

/// Takes control of a camera while that is `wanted`, which is this program's own while the other that is returned
/// lives: to be done [`within`] bounded time.
///
/// # Errors
/// Why not, and what to do, in words.
pub(super) fn open(target: &Target, wanted: &Wanted) -> Result<(InUse, Opened), String> {
    let in_use = InUse::begin(target.site());
    let (opened, _turn) = match target {
        Target::Network(info) => {
            let opened = Reader::open(info.ip)?.take(wanted).map_err(|why| match is_controlled(info.ip) {
                // Some refuse, some say nothing.
                true => features::CONTROLLED.to_owned(),
                false => why,
            });
            (opened?, None)
        }
        Target::Usb(info, _) => {
            // Whoever lists it has done so first, or waits until what it offers is known.
            let turn = Turn::at(target.site(), wanted)?;
            (usb::open(info, wanted)?, Some(turn))
        }
    };
    // For whoever lists cameras meanwhile. What cannot be read now is read then.
    if let (Ok(place), Ok(formats)) = (opened.device.transport().place(wanted), read::formats(&opened.device)) {
        known::keep(&target.known_as(), &place, &formats);
    }
    Ok((in_use, opened))
}

/// Whether somebody has control of a camera; `false` where it does not say.
fn is_controlled(address: Ipv4Addr) -> bool {
    Reader::open(address).is_ok_and(|mut reader| reader.is_controlled())
}

#[cfg(test)]
pub(super) mod tests {
    use viva_genicam::gige::DeviceInfo;

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
    pub(in super::super) fn on_usb(address: u8, serial: &str, names: Result<[&str; 2], &str>) -> Target {
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
    fn no_camera_on_usb_is_opened_where_it_is_known_which_is_meant() {
        let unasked = || {
            let usb = [on_usb(5, "0A5", Ok(["", ""])), on_usb(6, "0A6", Ok(["", ""]))];
            usb.into_iter().chain([camera(1, "A1", "left")]).collect::<Vec<_>>()
        };
        let asked = |device: &str| {
            let (mut there, mut asked) = (unasked(), 0);
            ask_where_needed(&mut there, &GenicamName::of(device).unwrap(), |info| {
                asked += 1;
                Ok(Names { serial: Some(info.address.to_string()), user_name: Some("right".to_owned()) })
            });
            (asked, found(there, device).ok())
        };
        let known = |site: &str| (0, Some(site.to_owned()));
        assert_eq!(asked("name:left"), known("10.0.0.1"));
        assert_eq!(asked("serial:A1"), known("10.0.0.1"));
        assert_eq!(asked("serial:0A6"), known("usb:2676:ba06"));
        assert_eq!(asked("usb:2676:ba05"), known("usb:2676:ba05"));
        assert_eq!(asked("serial:6"), (2, Some("usb:2676:ba06".to_owned())));
        assert_eq!(asked("name:right"), (2, None), "two have that name");
    }

    #[test]
    fn an_interface_that_is_not_there_is_named() {
        let interfaces = vec!["no-such-interface".to_owned()];
        let (_, wrong) = survey::cameras(&interfaces);
        assert!(wrong[0].contains("no network interface \"no-such-interface\""), "{wrong:?}");
        let config = CameraConfig { device: "serial:A1".to_owned(), interfaces, ..CameraConfig::default() };
        let why = resolve(&config).unwrap_err();
        assert!(why.contains("no camera") && why.contains("no network interface"), "{why}");
    }
}
