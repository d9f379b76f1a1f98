//! The network that the camera is on: its interface, and the sockets that it hears and answers by.

use std::io;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsFd as _, AsRawFd as _};
use std::time::Duration;

use nix::errno::Errno;
use nix::ifaddrs::getifaddrs;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::socket::{self, AddressFamily, SockFlag, SockType, SockaddrIn, SockaddrStorage, setsockopt, sockopt};

/// Where GigE Vision cameras are spoken to.
pub(super) const PORT: u16 = 3956;

/// A network interface with an address of its own for the camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Interface {
    pub(super) name: String,
    /// The camera's address on it.
    pub(super) address: Ipv4Addr,
    pub(super) mask: Ipv4Addr,
    /// Where everybody on its network is reached.
    pub(super) broadcast: Option<Ipv4Addr>,
    /// The camera's hardware address: made up, and one that the standards leave for that.
    pub(super) mac: [u8; 6],
}

/// An address of this machine's.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Own {
    name: String,
    address: Ipv4Addr,
    mask: Ipv4Addr,
    broadcast: Option<Ipv4Addr>,
}

/// Where an address is: at the interface that has it, or else at that of the smallest network with it in it, as the kernel
/// routes.
fn nearest(own: impl Iterator<Item = Own>, address: Ipv4Addr) -> Option<Own> {
    let network = |address: Ipv4Addr, mask: Ipv4Addr| u32::from(address) & u32::from(mask);
    own.filter(|own| network(own.address, own.mask) == network(address, own.mask))
        .max_by_key(|own| (own.address == address, u32::from(own.mask)))
}

impl Interface {
    /// The interface on whose network an address is; the camera's hardware address is made of its serial number.
    ///
    /// # Errors
    /// Where there is none.
    pub(super) fn of(address: Ipv4Addr, serial: &str) -> io::Result<Self> {
        let ipv4 =
            |address: Option<SockaddrStorage>| address.and_then(|address| address.as_sockaddr_in().map(SockaddrIn::ip));
        let own = getifaddrs()?.filter_map(|interface| {
            let (own, mask) = (ipv4(interface.address)?, ipv4(interface.netmask)?);
            // Where an interface has none, the C library tells its own address.
            let broadcast = ipv4(interface.broadcast).filter(|to| !own.is_loopback() && *to != own);
            Some(Own { name: interface.interface_name, address: own, mask, broadcast })
        });
        let Some(Own { name, mask, broadcast, .. }) = nearest(own, address) else {
            return Err(io::Error::new(
                io::ErrorKind::AddrNotAvailable,
                format!("this machine has no interface on {address}'s network; `ip address` lists those that it has"),
            ));
        };
        let mut hash: u64 = 0xcbf2_9ce4_8422_2325;
        for byte in serial.bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
        let [a, b, c, d, e, ..] = hash.to_le_bytes();
        Ok(Self { name, address, mask, broadcast, mac: [0x02, a, b, c, d, e] })
    }

    /// The socket that the camera is spoken to by, and answers by.
    pub(super) fn control_socket(&self) -> io::Result<UdpSocket> {
        UdpSocket::bind(SocketAddrV4::new(self.address, PORT))
    }

    /// Sockets that hear what is said to everybody on this interface's network, and on no other's.
    pub(super) fn broadcast_sockets(&self) -> io::Result<Vec<UdpSocket>> {
        [Some(Ipv4Addr::BROADCAST), self.broadcast].into_iter().flatten().map(|to| self.heard(to)).collect()
    }

    fn heard(&self, to: Ipv4Addr) -> io::Result<UdpSocket> {
        let socket = socket::socket(AddressFamily::Inet, SockType::Datagram, SockFlag::SOCK_CLOEXEC, None)?;
        // Every camera of this machine hears them.
        setsockopt(&socket, sockopt::ReuseAddr, &true)?;
        setsockopt(&socket, sockopt::BindToDevice, &self.name.clone().into())?;
        socket::bind(socket.as_raw_fd(), &SockaddrIn::from(SocketAddrV4::new(to, PORT)))?;
        Ok(UdpSocket::from(socket))
    }
}

/// Waits until any of the sockets has something to be read.
pub(super) fn wait(sockets: &[&UdpSocket], at_most: Duration) -> io::Result<()> {
    let mut polled: Vec<PollFd<'_>> =
        sockets.iter().map(|socket| PollFd::new(socket.as_fd(), PollFlags::POLLIN)).collect();
    let timeout = PollTimeout::try_from(at_most).unwrap_or(PollTimeout::MAX);
    match poll(&mut polled, timeout) {
        Ok(_) | Err(Errno::EINTR) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_is_where_the_kernel_routes_it() {
        let own = |name: &str, last: [u8; 2], bits: u32| Own {
            name: name.to_owned(),
            address: Ipv4Addr::new(10, 9, last[0], last[1]),
            mask: Ipv4Addr::from(u32::MAX << (32 - bits)),
            broadcast: None,
        };
        let there = [own("wide", [0, 1], 16), own("near", [7, 1], 24), own("other", [7, 9], 16)];
        let name = |last| nearest(there.iter().cloned(), Ipv4Addr::new(10, 9, 7, last)).map(|own| own.name);
        assert_eq!(name(20).as_deref(), Some("near"));
        assert_eq!(name(9).as_deref(), Some("other"), "it has the address itself");
        assert_eq!(nearest(there.into_iter(), Ipv4Addr::new(10, 8, 7, 1)), None);
    }
}
