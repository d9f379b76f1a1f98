//! Addresses that are trusted, and what they may say of whom they ask for.

use std::net::IpAddr;

/// Addresses and networks, as `10.0.0.0/8`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Networks(Vec<(IpAddr, u8)>);

impl Networks {
    /// Reads addresses and networks.
    ///
    /// # Errors
    /// What is wrong with the first that is none.
    pub fn parse<'a>(texts: impl IntoIterator<Item = &'a str>) -> Result<Self, String> {
        texts.into_iter().map(parse).collect::<Result<_, _>>().map(Self)
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether an address is among them.
    #[must_use]
    pub fn contains(&self, address: IpAddr) -> bool {
        let address = address.to_canonical();
        self.0
            .iter()
            .any(|&(network, length)| bits(network, length) == bits(address, length) && same_kind(network, address))
    }

    /// Who asks through a chain of proxies: the nearest address that is not trusted itself. `chain` has the addresses
    /// that the proxies name, furthest first; `nearest` is the far end of the connection.
    #[must_use]
    pub fn origin<'a>(&self, nearest: IpAddr, chain: impl DoubleEndedIterator<Item = &'a str>) -> Option<IpAddr> {
        let mut origin = nearest;
        for text in chain.rev() {
            if !self.contains(origin) {
                break;
            }
            origin = forwarded_address(text)?;
        }
        Some(origin.to_canonical())
    }
}

fn parse(text: &str) -> Result<(IpAddr, u8), String> {
    let wrong = || format!("{text:?} is neither an address nor a network such as 10.0.0.0/8");
    let (address, length) = text.split_once('/').map_or((text, None), |(address, length)| (address, Some(length)));
    let address = address.parse::<IpAddr>().map_err(|_| wrong())?.to_canonical();
    let whole = if address.is_ipv4() { 32 } else { 128 };
    let length = length.map_or(Ok(whole), |length| length.parse().map_err(|_| wrong()))?;
    if length > whole { Err(wrong()) } else { Ok((address, length)) }
}

fn same_kind(one: IpAddr, other: IpAddr) -> bool {
    one.is_ipv4() == other.is_ipv4()
}

/// The first `length` bits of an address.
fn bits(address: IpAddr, length: u8) -> u128 {
    let length = u32::from(length);
    match address {
        IpAddr::V4(address) => u128::from(u32::from(address).checked_shr(32_u32.saturating_sub(length)).unwrap_or(0)),
        IpAddr::V6(address) => u128::from(address).checked_shr(128_u32.saturating_sub(length)).unwrap_or(0),
    }
}

/// An address as proxies write it: perhaps with a port, perhaps in brackets.
fn forwarded_address(text: &str) -> Option<IpAddr> {
    let text = text.trim().trim_matches('"');
    if let Ok(address) = text.parse::<IpAddr>() {
        return Some(address);
    }
    if let Ok(address) = text.parse::<std::net::SocketAddr>() {
        return Some(address.ip());
    }
    text.strip_prefix('[')?.strip_suffix(']')?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ip(text: &str) -> IpAddr {
        text.parse().unwrap()
    }

    #[test]
    fn networks_hold_their_addresses_and_no_others() {
        let networks = Networks::parse(["10.1.0.0/16", "192.168.1.7", "fd00::/8", "0.0.0.0/32"]).unwrap();
        for inside in ["10.1.255.1", "192.168.1.7", "fd12::1", "::ffff:10.1.0.1"] {
            assert!(networks.contains(ip(inside)), "{inside}");
        }
        for outside in ["10.2.0.1", "192.168.1.8", "fe80::1", "::1", "127.0.0.1"] {
            assert!(!networks.contains(ip(outside)), "{outside}");
        }
        let everyone = Networks::parse(["0.0.0.0/0"]).unwrap();
        assert!(everyone.contains(ip("203.0.113.9")) && !everyone.contains(ip("fd00::1")));
        for wrong in ["", "proxy", "10.0.0.0/33", "10.0.0.0/x", "10.0.0/8", "::/129"] {
            assert!(Networks::parse([wrong]).unwrap_err().contains("10.0.0.0/8"), "{wrong}");
        }
    }

    #[test]
    fn a_chain_is_believed_as_far_as_it_is_trusted() {
        let trusted = Networks::parse(["127.0.0.1", "10.0.0.0/8"]).unwrap();
        let origin = |nearest: &str, chain: &[&str]| trusted.origin(ip(nearest), chain.iter().copied());
        assert_eq!(origin("127.0.0.1", &["203.0.113.9"]), Some(ip("203.0.113.9")));
        // What the client itself wrote in front is not believed.
        assert_eq!(origin("127.0.0.1", &["127.0.0.1", "203.0.113.9", "10.0.0.2"]), Some(ip("203.0.113.9")));
        assert_eq!(origin("127.0.0.1", &[" \"[2001:db8::1]:4711\" "]), Some(ip("2001:db8::1")));
        assert_eq!(origin("127.0.0.1", &["unknown"]), None);
        assert_eq!(origin("192.0.2.1", &["203.0.113.9"]), Some(ip("192.0.2.1")));
    }
}
