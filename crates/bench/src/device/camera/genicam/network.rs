//! Asking which cameras there are on the network: on the interfaces that are named, and on no other.

use std::collections::HashSet;
use std::net::Ipv4Addr;
use std::time::Duration;

use viva_genicam::blocking;
use viva_genicam::gige::{DeviceInfo, DiscoveryOptions, Iface};

use super::bounded::apart;

/// How long cameras are waited for: what they may take to answer.
const ANSWER_WITHIN: Duration = Duration::from_secs(1);

/// The cameras that answer on an interface.
///
/// # Errors
/// Why none can be looked for, in words.
pub(super) fn answering(interface: &str) -> Result<Vec<DeviceInfo>, String> {
    let there = Iface::from_system(interface)
        .map_err(|_| format!("there is no network interface {interface:?} (bench.camera.interfaces)"))?;
    if there.ipv4().is_none() {
        return Err(format!("the network interface {interface:?} has no IPv4 address to look for cameras from"));
    }
    let options = DiscoveryOptions::new().interface(interface);
    let answers = apart(|| blocking::discover_with(ANSWER_WITHIN, &options))?;
    answers.map_err(|error| format!("cameras cannot be looked for on {interface}: {error}"))
}

/// The camera at an address.
///
/// # Errors
/// Why there is none, in words.
pub(super) fn at(address: Ipv4Addr) -> Result<DeviceInfo, String> {
    let answer = apart(|| blocking::discover_ip(address, ANSWER_WITHIN))?;
    let found = answer.map_err(|error| format!("{address} cannot be reached: {error}"))?;
    found.ok_or_else(|| format!("no camera answers at {address}; connect it, or correct bench.camera.device"))
}

/// The name of the interface on which an address is reached; empty where that is not known.
pub(super) fn interface_to(address: Ipv4Addr) -> String {
    Iface::from_remote_ipv4(address).map(|interface| interface.name().to_owned()).unwrap_or_default()
}

/// One camera may answer on two interfaces, and is one.
pub(super) fn distinct<T>(answers: Vec<T>, info: impl Fn(&T) -> &DeviceInfo) -> Vec<T> {
    let mut seen = HashSet::new();
    let mut is_new = |answer: &T| {
        let DeviceInfo { ip, mac, serial, .. } = info(answer);
        seen.insert((*ip, *mac, serial.clone()))
    };
    answers.into_iter().filter(|answer| is_new(answer)).collect()
}

/// Why a camera that answers cannot be reached, where its address is of another network.
pub(super) fn elsewhere(info: &DeviceInfo) -> Option<String> {
    (info.shares_subnet_with_host() == Some(false)).then(|| {
        let ours = info.local_ip.map_or_else(String::new, |ip| format!(" (this machine is {ip})"));
        format!("its address {} is of another network than this machine's{ours}: give one of the two another", info.ip)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_that_answers_on_two_interfaces_is_one() {
        let camera = |last| DeviceInfo::from_ip(Ipv4Addr::new(10, 0, 0, last));
        let (one, other) = (camera(1), camera(2));
        let heard = vec![one.clone(), other.clone(), DeviceInfo { local_ip: Some(other.ip), ..one.clone() }];
        assert_eq!(distinct(heard, |info| info), [one, other]);
    }

    #[test]
    fn a_camera_of_another_network_says_so() {
        let mask = Some(Ipv4Addr::new(255, 255, 255, 0));
        let near = DeviceInfo {
            subnet: mask,
            local_ip: Some(Ipv4Addr::new(10, 0, 0, 9)),
            local_netmask: mask,
            ..DeviceInfo::from_ip(Ipv4Addr::new(10, 0, 0, 1))
        };
        assert_eq!(elsewhere(&near), None);
        let far = DeviceInfo { local_ip: Some(Ipv4Addr::new(10, 0, 7, 9)), ..near };
        assert!(elsewhere(&far).unwrap().contains("this machine is 10.0.7.9"));
    }
}
