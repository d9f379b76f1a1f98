//! Every camera that is there, for whoever lists cameras: what each is and offers, asked within bounded time.

use super::allowance::Allowance;
use super::bounded::apart;
use super::found::{FoundCamera, Way};
use super::known;
use super::target::Target;
use super::{network, read, usb};

/// So many cameras are listed: whoever is on the network may answer in the name of any number.
const MOST_LISTED: usize = 64;
/// So many cameras are read when cameras are listed, those not counted that were read before.
const MOST_READ: usize = 16;

/// Every camera that is connected to USB or answers on these interfaces, with what it offers; and what cannot be said,
/// one sentence each: of an interface on which none can be looked for, why; and which cameras there was no time for.
/// Takes a second for each interface, and as long as it takes to ask the cameras, 20 s at most; takes no camera from
/// whoever has it, and disturbs none that this program uses itself.
#[must_use]
pub fn cameras(interfaces: &[String]) -> (Vec<FoundCamera>, Vec<String>) {
    let (mut answers, mut notes) = (Vec::new(), Vec::new());
    for interface in interfaces {
        match network::answering(interface) {
            Ok(there) => answers.extend(there.into_iter().map(|info| (info, interface.clone()))),
            Err(why) => notes.push(why),
        }
    }
    let mut targets = usb::targets().unwrap_or_else(|why| {
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
    notes.extend(allowance.notes());
    (found, notes)
}

/// A camera that is there, with what it offers, where it may be asked.
pub(super) fn look_at(target: &Target, interface: &str, allowance: &mut Allowance) -> FoundCamera {
    let way = match target {
        Target::Network(info) => Way::Network { address: info.ip, interface: interface.to_owned() },
        Target::Usb(info, _) => {
            let product = format!("{:04x}:{:04x}", info.vendor_id, info.product_id);
            let carried_mbit_per_s = info.speed.and_then(usb::carried_mbit_per_s);
            Way::Usb { file: usb::device_file(info), product, carried_mbit_per_s }
        }
    };
    let mut camera = FoundCamera {
        way,
        model: target.model(),
        serial: target.serial(),
        user_name: target.user_name(),
        formats: Vec::new(),
        unusable: None,
    };
    match offered(target, &camera.path(), allowance) {
        Ok(formats) => camera.formats = formats.unwrap_or_default(),
        Err(why) => match known_of(target).filter(|_| known::is_in_use(&target.site())) {
            // It was taken by another part of this program meanwhile.
            Some(formats) => camera.formats = formats,
            None if allowance.is_over() => allowance.miss(&camera.path()),
            None => camera.unusable = Some(why),
        },
    }
    if let Target::Usb(info, _) = target
        && camera.unusable.is_none()
        && let Some(names) = usb::said(info)
    {
        let told = Target::Usb(info.clone(), Ok(names));
        (camera.serial, camera.user_name) = (told.serial(), told.user_name());
    }
    camera
}

/// What a camera offers; `None` where it is not known and not to be asked now.
///
/// # Errors
/// Why it cannot be used, in words.
fn offered(target: &Target, place: &str, allowance: &mut Allowance) -> Result<Option<Vec<String>>, String> {
    let in_use = known::is_in_use(&target.site());
    match target {
        // It is being opened, or sends frames.
        Target::Network(_) if in_use => return Ok(known_of(target)),
        // One that is being opened is waited for.
        Target::Usb(..) if in_use && allowance.is_over() => return Ok(known_of(target)),
        Target::Network(info) => network::elsewhere(info).map_or(Ok(()), Err)?,
        Target::Usb(..) => {}
    }
    let Some(until) = allowance.time_for(place) else { return Ok(None) };
    apart(|| match target {
        Target::Network(info) => read::offered(info.ip, &target.known_as(), until, || allowance.take()),
        Target::Usb(info, _) => usb::offered(info, until, || allowance.take()),
    })
    .flatten()
}

/// What was read of a camera before.
fn known_of(target: &Target) -> Option<Vec<String>> {
    known::formats(&target.known_as(), None)
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;
    use std::sync::PoisonError;

    use viva_genicam::gige::DeviceInfo;

    use super::super::bounded::ALONE;
    use super::super::find::tests::on_usb;
    use super::super::known::InUse;
    use super::*;

    #[test]
    fn a_camera_in_use_is_listed_by_what_is_known_of_it_and_not_disturbed() {
        // Nothing is there.
        let network = Target::Network(DeviceInfo::from_ip(Ipv4Addr::new(127, 97, 0, 1)));
        let _alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
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
    fn a_camera_that_there_is_no_time_for_is_named_and_not_asked() {
        let mut late = Allowance::over();
        let network = Target::Network(DeviceInfo::from_ip(Ipv4Addr::new(127, 96, 0, 1)));
        for target in [network, on_usb(254, "0C1", Ok(["1", ""]))] {
            let there = look_at(&target, "lo", &mut late);
            assert_eq!((there.unusable, there.formats.len()), (None, 0));
        }
        let notes = late.notes();
        assert!(notes[0].contains("no time to ask 127.96.0.1, /dev/bus/usb/002/254"), "{notes:?}");
        // What this program uses itself is known without asking.
        let used = on_usb(253, "0C2", Ok(["1", ""]));
        known::keep(&used.known_as(), b"", &["Mono8".to_owned()]);
        let _in_use = InUse::begin(used.site());
        assert_eq!(look_at(&used, "", &mut late).formats, ["Mono8"]);
        assert_eq!(late.notes(), notes);
    }
}
