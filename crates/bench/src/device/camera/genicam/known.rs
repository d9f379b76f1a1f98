//! What this program has learned of the cameras that are there: what each offers, so that no description is read anew each
//! time cameras are listed; and which of them it has in use itself, so that none of those is disturbed for a list.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use viva_genicam::gige::DeviceInfo;
use viva_genicam::u3v::U3vDeviceInfo;

use super::target::Site;
use super::usb;

/// Of so many cameras what they offer is kept: of those that were read last.
const KEPT: usize = 64;

/// Which camera it is, and of which make: what it offers depends on nothing else.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Identity {
    site: Site,
    mac: [u8; 6],
    words: [Option<String>; 4],
}

impl Identity {
    pub(super) fn of(info: &DeviceInfo) -> Self {
        let words = [&info.manufacturer, &info.model, &info.version, &info.serial].map(Clone::clone);
        Self { site: Site::Network(info.ip), mac: info.mac, words }
    }

    pub(super) fn of_usb(info: &U3vDeviceInfo) -> Self {
        let product = Some(format!("{:04x}:{:04x}", info.vendor_id, info.product_id));
        let [maker, model, serial] = [&info.manufacturer, &info.model, &info.serial].map(Clone::clone);
        let site = usb::site(info);
        Self { site, mac: [0; 6], words: [maker, model, product, serial] }
    }
}

/// What was read of a camera.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Read {
    identity: Identity,
    /// Where it says that its description is, which is another when its firmware is.
    place: Vec<u8>,
    formats: Vec<String>,
}

#[derive(Debug)]
struct Known {
    read: VecDeque<Read>,
    in_use: Vec<Site>,
}

static KNOWN: Mutex<Known> = Mutex::new(Known::new());

fn known() -> MutexGuard<'static, Known> {
    KNOWN.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Known {
    const fn new() -> Self {
        Self { read: VecDeque::new(), in_use: Vec::new() }
    }

    fn keep(&mut self, identity: &Identity, place: &[u8], formats: &[String]) {
        self.read.retain(|read| read.identity.site != identity.site);
        self.read.push_back(Read { identity: identity.clone(), place: place.to_vec(), formats: formats.to_vec() });
        if self.read.len() > KEPT {
            self.read.pop_front();
        }
    }

    fn formats(&self, identity: &Identity, place: Option<&[u8]>) -> Option<Vec<String>> {
        let same = |read: &&Read| read.identity == *identity && place.is_none_or(|place| read.place == place);
        self.read.iter().find(same).map(|read| read.formats.clone())
    }

    fn let_go(&mut self, site: &Site) {
        if let Some(at) = self.in_use.iter().position(|used| used == site) {
            self.in_use.swap_remove(at);
        }
    }
}

/// Keeps what a camera offers, which says that its description is at `place`.
pub(super) fn keep(identity: &Identity, place: &[u8], formats: &[String]) {
    known().keep(identity, place, formats);
}

/// What a camera offers, where that was read of it; by the `place` of its description, too, where that is known.
pub(super) fn formats(identity: &Identity, place: Option<&[u8]>) -> Option<Vec<String>> {
    known().formats(identity, place)
}

/// A camera that this program has in use, for as long as this lives.
#[derive(Debug)]
pub(super) struct InUse(Site);

impl InUse {
    /// The camera there is in use.
    pub(super) fn begin(site: Site) -> Self {
        known().in_use.push(site.clone());
        Self(site)
    }
}

impl Drop for InUse {
    fn drop(&mut self) {
        known().let_go(&self.0);
    }
}

/// Whether this program itself has the camera there in use.
pub(super) fn is_in_use(site: &Site) -> bool {
    known().in_use.contains(site)
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    fn camera(address: Ipv4Addr, version: &str) -> Identity {
        Identity::of(&DeviceInfo { version: Some(version.to_owned()), ..DeviceInfo::from_ip(address) })
    }

    #[test]
    fn what_was_read_holds_for_the_same_camera_of_the_same_making() {
        let (mut known, address) = (Known::new(), Ipv4Addr::new(10, 99, 0, 1));
        let mono = vec!["Mono8".to_owned()];
        known.keep(&camera(address, "1"), b"local:a;1;2", &mono);
        let formats_of = |version: &str, place: Option<&[u8]>| known.formats(&camera(address, version), place);
        assert_eq!(formats_of("1", None), Some(mono.clone()));
        assert_eq!(formats_of("1", Some(b"local:a;1;2")), Some(mono));
        assert_eq!(formats_of("1", Some(b"local:b;1;2")), None, "its description is another");
        assert_eq!(formats_of("2", None), None, "its firmware is another");
        known.keep(&camera(address, "2"), b"local:b;1;2", &[]);
        assert_eq!(known.formats(&camera(address, "1"), None), None, "it was replaced");
    }

    #[test]
    fn no_more_is_kept_than_there_is_room_for() {
        let (mut known, at) = (Known::new(), |index: usize| Ipv4Addr::new(10, 98, 0, index as u8));
        for index in 0..=KEPT {
            known.keep(&camera(at(index), "1"), b"", &[]);
        }
        assert_eq!(known.formats(&camera(at(0), "1"), None), None);
        assert_eq!(known.formats(&camera(at(KEPT), "1"), None), Some(Vec::new()));
        assert_eq!(known.read.len(), KEPT);
    }

    #[test]
    fn a_camera_is_in_use_as_long_as_somebody_has_it() {
        let site = Site::Network(Ipv4Addr::new(10, 97, 0, 1));
        let (one, other) = (InUse::begin(site.clone()), InUse::begin(site.clone()));
        drop(one);
        assert!(is_in_use(&site));
        drop(other);
        assert!(!is_in_use(&site));
    }
}
