//! GVSP: a frame in packets, and the link that they are sent over, many to a system call.

use std::io::{self, IoSlice};
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::os::fd::AsRawFd as _;
use std::time::{Duration, Instant};

use nix::errno::Errno;
use nix::sys::socket::{MsgFlags, MultiHeaders, getsockopt, sendmmsg, sockopt};

use super::SLICE;
use super::faults::Sending;
use super::format::{Format, Region};
use super::settings::Destination;

/// Bytes of a packet that are not contents: headers of IP, UDP and GVSP.
const HEADERS: usize = 20 + 8 + GVSP_HEADER;
const GVSP_HEADER: usize = 8;
/// Kinds of packets.
const LEADER: u8 = 1;
const TRAILER: u8 = 2;
const PAYLOAD: u8 = 3;
/// What a leader and a trailer are of.
const IMAGE: u16 = 1;
/// Statuses of packets: sent once more; asked for, but not there any more.
const AGAIN: u16 = 0x0100;
const UNAVAILABLE: u16 = 0x800c;
/// Most packets to a system call.
const AT_ONCE: usize = 64;
/// Packets that go to one system call leave within about so long: a longer delay is waited for.
const BURST: Duration = Duration::from_millis(1);

/// A frame as it is sent.
#[derive(Debug)]
pub(super) struct Block {
    /// Its number, from 1 on.
    pub(super) id: u16,
    /// The stamp, ticks.
    pub(super) ticks: u64,
    pub(super) format: Format,
    pub(super) region: Region,
    pub(super) bytes: Vec<u8>,
}

impl Block {
    fn leader(&self) -> Vec<u8> {
        let Region { left, top, width, height } = self.region;
        let mut leader = vec![0, 0];
        leader.extend(IMAGE.to_be_bytes());
        leader.extend(self.ticks.to_be_bytes());
        let words = [self.format.code as usize, width, height, left, top];
        leader.extend(words.iter().flat_map(|&word| (word as u32).to_be_bytes()));
        // No padding, of rows or of the whole.
        leader.extend([0; 4]);
        leader
    }

    fn trailer(&self) -> Vec<u8> {
        let mut trailer = vec![0, 0];
        trailer.extend(IMAGE.to_be_bytes());
        trailer.extend((self.region.height as u32).to_be_bytes());
        trailer
    }
}

fn header(status: u16, block: u16, kind: u8, packet: u32) -> [u8; GVSP_HEADER] {
    let [s0, s1] = status.to_be_bytes();
    let [b0, b1] = block.to_be_bytes();
    let [_, p0, p1, p2] = packet.to_be_bytes();
    [s0, s1, b0, b1, kind, p0, p1, p2]
}

/// A way to whoever takes the frames.
#[derive(Debug)]
pub(super) struct Link {
    socket: UdpSocket,
    to: Destination,
    /// Bytes a second that the camera's own link carries.
    bytes_per_s: f64,
    /// How long a tick of the camera's clock lasts, for the delay between packets.
    tick: Duration,
}

impl Link {
    /// The way from an address to a destination.
    ///
    /// # Errors
    /// Where there is none.
    pub(super) fn open(from: Ipv4Addr, to: Destination, bytes_per_s: f64, tick: Duration) -> io::Result<Self> {
        let socket = UdpSocket::bind(SocketAddrV4::new(from, 0))?;
        socket.connect(SocketAddrV4::new(to.address, to.port))?;
        Ok(Self { socket, to, bytes_per_s, tick })
    }

    /// Whether this is the way to there.
    pub(super) fn leads_to(&self, to: &Destination) -> bool {
        self.to == *to
    }

    /// From which port it sends.
    pub(super) fn port(&self) -> u16 {
        self.socket.local_addr().map_or(0, |address| address.port())
    }

    /// How large a packet comes through as far as this machine knows. A larger one is lost where nothing may cut it up: by
    /// default Linux cuts up what is too large for its own interface.
    fn largest(&self) -> usize {
        let known = getsockopt(&self.socket, sockopt::IpMtu).ok().and_then(|mtu| usize::try_from(mtu).ok());
        known.filter(|_| self.to.whole).unwrap_or(usize::MAX)
    }

    /// Sends a packet of the size that is set, to see whether it arrives.
    pub(super) fn test(&self) {
        if self.to.packet_bytes <= self.largest() {
            let mut packet = header(0, 0, PAYLOAD, 0).to_vec();
            packet.resize(self.to.packet_bytes - HEADERS + GVSP_HEADER, 0);
            // Nobody may be there any more.
            let _ = self.socket.send(&packet);
        }
    }

    fn contents_bytes(&self) -> usize {
        self.to.packet_bytes - HEADERS
    }

    /// How many packets a frame is: leader and trailer are the first and the last.
    pub(super) fn packets(&self, block: &Block) -> u32 {
        u32::try_from(block.bytes.len().div_ceil(self.contents_bytes()) + 2).unwrap_or(u32::MAX)
    }

    /// Says of packets that they cannot be sent again.
    pub(super) fn miss(&self, block: u16, packets: impl Iterator<Item = u32>) {
        for packet in packets {
            let _ = self.socket.send(&header(UNAVAILABLE, block, PAYLOAD, packet));
        }
    }

    /// Sends packets of a frame at the link's pace, until `ended`. `again` says that they were asked for.
    pub(super) fn send(&self, block: &Block, sendings: &[Sending], again: bool, ended: impl Fn() -> bool) {
        let (leader, trailer) = (block.leader(), block.trailer());
        let last = self.packets(block) - 1;
        let status = if again { AGAIN } else { 0 };
        let (size, largest) = (self.contents_bytes(), self.largest());
        let packet = |sending: &Sending| {
            let (kind, contents) = match sending.packet {
                0 => (LEADER, leader.as_slice()),
                packet if packet == last => (TRAILER, trailer.as_slice()),
                packet => {
                    let from = (packet as usize - 1) * size;
                    (PAYLOAD, &block.bytes[from..(from + size).min(block.bytes.len())])
                }
            };
            (header(status, block.id.wrapping_add(sending.misnumbered), kind, sending.packet), contents)
        };
        let packets: Vec<([u8; GVSP_HEADER], &[u8])> =
            sendings.iter().map(packet).filter(|(_, contents)| contents.len() + HEADERS <= largest).collect();
        let each = self.to.packet_bytes as f64 / self.bytes_per_s + (self.tick * self.to.delay_ticks).as_secs_f64();
        let at_once = ((BURST.as_secs_f64() / each) as usize).clamp(1, AT_ONCE);
        let begin = Instant::now();
        for (burst, packets) in packets.chunks(at_once).enumerate() {
            let due = Duration::try_from_secs_f64(each * (burst * at_once) as f64).unwrap_or(Duration::MAX);
            // In slices: it may be hours at the least pace that a client can set.
            loop {
                if ended() {
                    return;
                }
                let wait = due.saturating_sub(begin.elapsed());
                if wait.is_zero() {
                    break;
                }
                std::thread::sleep(wait.min(SLICE));
            }
            self.send_at_once(packets);
        }
    }

    fn send_at_once(&self, packets: &[([u8; GVSP_HEADER], &[u8])]) {
        let mut sent = 0;
        // What is refused once is lost: nobody may be there any more.
        let mut refused = 0;
        while let Some(rest) = packets.get(sent..).filter(|rest| !rest.is_empty()) {
            let slices: Vec<[IoSlice<'_>; 2]> =
                rest.iter().map(|(header, contents)| [IoSlice::new(header), IoSlice::new(contents)]).collect();
            let addresses: Vec<Option<()>> = vec![None; rest.len()];
            let mut headers = MultiHeaders::<()>::preallocate(rest.len(), None);
            match sendmmsg(self.socket.as_raw_fd(), &mut headers, &slices, &addresses, [], MsgFlags::empty()) {
                Ok(results) => sent += results.count().max(1),
                Err(Errno::EINTR) => {}
                // Of an earlier packet, which nobody took: this one is yet to be sent.
                Err(Errno::ECONNREFUSED) if refused < 2 => refused += 1,
                Err(error) => {
                    tracing::debug!(%error, "a packet was not sent");
                    (sent, refused) = (sent + 1, 0);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 256;

    /// A way to a socket of this machine, for packets that hold 220 bytes.
    fn link() -> (Link, UdpSocket) {
        let receiver = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        receiver.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        let to = Destination {
            address: Ipv4Addr::LOCALHOST,
            port: receiver.local_addr().unwrap().port(),
            packet_bytes: SIZE,
            whole: true,
            delay_ticks: 0,
        };
        (Link::open(Ipv4Addr::LOCALHOST, to, 1e9, Duration::from_nanos(1)).unwrap(), receiver)
    }

    fn block() -> Block {
        let region = Region { left: 2, top: 4, width: 50, height: 10 };
        let format = Format::offered(None)[0];
        Block { id: 0x0102, ticks: 0x0304_0506_0708, format, region, bytes: (0..500).map(|n| n as u8).collect() }
    }

    fn received(receiver: &UdpSocket) -> Vec<u8> {
        let mut packet = [0; 2 * SIZE];
        let length = receiver.recv(&mut packet).unwrap();
        packet[..length].to_vec()
    }

    #[test]
    fn a_frame_is_a_leader_its_bytes_in_order_and_a_trailer() {
        let ((link, receiver), block) = (link(), block());
        let packets = link.packets(&block);
        assert_eq!(packets, 5, "500 bytes are three packets of 220");
        let sendings: Vec<Sending> = (0..packets).map(|packet| Sending { packet, misnumbered: 0 }).collect();
        link.send(&block, &sendings, false, || false);
        let leader = received(&receiver);
        assert_eq!(leader[..8], [0, 0, 1, 2, 1, 0, 0, 0]);
        assert_eq!(leader[8..20], [0, 0, 0, 1, 0, 0, 3, 4, 5, 6, 7, 8]);
        let words: Vec<u32> = leader[20..40].as_chunks().0.iter().map(|bytes| u32::from_be_bytes(*bytes)).collect();
        assert_eq!(words, [0x0108_0001, 50, 10, 2, 4]);
        assert_eq!(leader.len(), 44);
        let contents: Vec<u8> = (1..4u8)
            .flat_map(|number| {
                let packet = received(&receiver);
                assert_eq!(packet[..8], [0, 0, 1, 2, 3, 0, 0, number]);
                packet[8..].to_vec()
            })
            .collect();
        assert_eq!(contents, block.bytes);
        assert_eq!(received(&receiver), [0, 0, 1, 2, 2, 0, 0, 4, 0, 0, 0, 1, 0, 0, 0, 10]);
    }

    #[test]
    fn what_is_sent_again_wrong_or_gone_says_so() {
        let ((link, receiver), block) = (link(), block());
        link.send(&block, &[Sending { packet: 2, misnumbered: 0 }], true, || false);
        let again = received(&receiver);
        assert_eq!((&again[..8], &again[8..]), (&[1, 0, 1, 2, 3, 0, 0, 2][..], &block.bytes[220..440]));
        link.send(&block, &[Sending { packet: 1, misnumbered: 5 }], false, || false);
        assert_eq!(received(&receiver)[..8], [0, 0, 1, 7, 3, 0, 0, 1]);
        link.miss(9, std::iter::once(3));
        assert_eq!(received(&receiver), [0x80, 0x0c, 0, 9, 3, 0, 0, 3]);
        link.test();
        assert_eq!(received(&receiver).len(), SIZE - 28, "with the headers of IP and UDP as large as was asked for");
    }
}
