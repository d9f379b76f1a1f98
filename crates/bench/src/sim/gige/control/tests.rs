//! What is asked of the camera's registers.

use std::net::UdpSocket;

use super::super::addresses::PRIMARY_ADDRESS;
use super::super::registers::tests::identity;
use super::*;

fn client(port: u16) -> SocketAddrV4 {
    SocketAddrV4::new(Ipv4Addr::LOCALHOST, port)
}

/// A camera and the number of the last request to it.
struct Asked(Control, u16);

impl Asked {
    fn new(now: Instant) -> Self {
        let interface = Interface::of(Ipv4Addr::LOCALHOST, "T-1").unwrap();
        Self(Control::new(identity(), interface, 1e9, Chance::new(1), now), 0)
    }

    /// The answer's status and contents.
    fn ask(&mut self, code: u16, words: &[u32], from: SocketAddrV4, now: Instant) -> (u16, Vec<u8>) {
        self.1 += 1;
        let mut datagram = vec![0x42, 1];
        datagram.extend([code, 4 * words.len() as u16, self.1].iter().flat_map(|word| word.to_be_bytes()));
        datagram.extend(words.iter().flat_map(|word| word.to_be_bytes()));
        let answer = self.0.hear(&datagram, from, now).unwrap_or_else(|| vec![0xff; 8]);
        (u16::from_be_bytes([answer[0], answer[1]]), answer[8..].to_vec())
    }

    fn write(&mut self, at: u32, value: u32, from: SocketAddrV4, now: Instant) -> u16 {
        self.ask(0x82, &[at, value], from, now).0
    }
}

const PORT_OF_STREAM: u32 = 0x0d00;
const START: u32 = 0x8038;
const DENIED: u16 = 0x8006;

#[test]
fn one_client_controls_others_look_and_an_exclusive_one_has_it_alone() {
    let now = Instant::now();
    let mut camera = Asked::new(now);
    let (one, other) = (client(1000), client(2000));
    assert_eq!(camera.write(0x0938, 1000, one, now), DENIED, "without control nothing is written");
    assert_eq!(camera.write(PRIVILEGE, CONTROL, one, now), 0);
    assert_eq!(camera.write(PRIVILEGE, CONTROL, other, now), DENIED);
    assert_eq!(camera.write(0x0938, 1000, other, now), DENIED);
    assert_eq!(camera.ask(0x80, &[PRIVILEGE], other, now), (0, vec![0, 0, 0, 2]));
    assert_eq!(camera.write(PRIVILEGE, EXCLUSIVE, one, now), 0);
    assert_eq!(camera.ask(0x80, &[PRIVILEGE], other, now).0, DENIED);
    assert_eq!(camera.ask(0x02, &[], other, now).1.len(), IDENTITY.len(), "whoever asks is told who it is");
    assert_eq!(camera.write(PRIVILEGE, 0, one, now), 0);
    assert_eq!(camera.write(PRIVILEGE, CONTROL, other, now), 0);
}

#[test]
fn whoever_is_silent_for_too_long_loses_control_and_its_frames_end() {
    let now = Instant::now();
    let mut camera = Asked::new(now);
    let (one, other) = (client(1000), client(2000));
    let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
    let port = receiver.local_addr().unwrap().port().into();
    camera.write(PRIVILEGE, CONTROL, one, now);
    assert_eq!(camera.write(START, 1, one, now), 0x8002, "nobody has said where frames go");
    for (at, value) in [(0x0938, 800), (PORT_OF_STREAM, port), (0x0d18, 0x7f00_0001), (START, 1)] {
        assert_eq!(camera.write(at, value, one, now), 0);
    }
    assert!(camera.0.registers.acquiring);
    let at = |ms| now + Duration::from_millis(ms);
    assert_eq!(camera.ask(0x80, &[PRIVILEGE], one, at(700)).0, 0);
    assert_eq!(camera.write(PRIVILEGE, CONTROL, other, at(1400)), DENIED);
    assert_eq!(camera.write(PRIVILEGE, CONTROL, other, at(1501)), 0);
    assert!(!camera.0.registers.acquiring);
    assert_eq!(camera.0.registers.destination(), None);
}

#[test]
fn a_request_that_comes_again_is_answered_again_and_not_done() {
    let now = Instant::now();
    let mut camera = Asked::new(now);
    camera.write(PRIVILEGE, CONTROL, client(1000), now);
    camera.0.registers.acquiring = true;
    let trigger = [0x42, 1, 0, 0x82, 0, 8, 9, 9, 0, 0, 0x80, 0x4c, 0, 0, 0, 1];
    let first = camera.0.hear(&trigger, client(1000), now);
    assert_eq!(camera.0.hear(&trigger, client(1000), now), first);
    assert_eq!(camera.0.triggers, 1);
    // Asking again is being heard of; and what was granted is gone with the control.
    let heartbeat = Duration::from_millis(camera.0.registers.heartbeat_ms());
    let later = now + heartbeat;
    assert_eq!(camera.0.hear(&trigger, client(1000), later), first);
    assert_ne!(camera.0.hear(&trigger, client(1000), later + 2 * heartbeat), first);
}

#[test]
fn a_trigger_for_which_nobody_waits_takes_no_frame_later() {
    let now = Instant::now();
    let mut camera = Asked::new(now);
    camera.write(PRIVILEGE, CONTROL, client(1000), now);
    camera.write(0x804c, 1, client(1000), now);
    assert_eq!(camera.0.triggers, 0);
}

#[test]
fn the_clock_is_read_when_it_is_latched() {
    let now = Instant::now();
    let mut camera = Asked::new(now);
    camera.write(PRIVILEGE, CONTROL, client(1000), now);
    let later = now + Duration::from_millis(1500);
    camera.write(0x0944, 2, client(1000), later);
    let (_, read) = camera.ask(0x80, &[0x0948, 0x094c], client(1000), later + Duration::from_secs(1));
    assert_eq!(u64::from_be_bytes(read.try_into().unwrap()), 1_500_000_000);
}

#[test]
fn a_camera_that_was_switched_off_has_forgotten_who_had_it() {
    let now = Instant::now();
    let mut camera = Asked::new(now);
    camera.write(PRIVILEGE, CONTROL, client(1000), now);
    camera.0.restart(Duration::from_secs(2), now);
    assert_eq!(camera.write(PRIVILEGE, CONTROL, client(1000), now + Duration::from_secs(1)), 0xffff, "no answer");
    let back = now + Duration::from_secs(2);
    assert_eq!(camera.ask(0x80, &[PRIVILEGE], client(1000), back), (0, vec![0; 4]));
    assert_eq!(camera.0.ticks(back + Duration::from_secs(1)), 1_000_000_000);
}

#[test]
fn a_name_may_have_any_length() {
    let now = Instant::now();
    let mut camera = Asked::new(now);
    camera.write(PRIVILEGE, CONTROL, client(1000), now);
    for name in [[u32::from_be_bytes(*b"left"), 0].as_slice(), &[u32::from_be_bytes(*b"rear")]] {
        let words = [&[USER_NAME.start], name].concat();
        assert_eq!(camera.ask(0x86, &words, client(1000), now).0, 0);
    }
    let (_, read) = camera.ask(0x84, &[USER_NAME.start, 16], client(1000), now);
    assert_eq!(&read[4..12], b"rear\0\0\0\0");
}

#[test]
fn another_program_takes_it_and_leaves_its_frames_going() {
    let now = Instant::now();
    let mut camera = Asked::new(now);
    camera.write(PRIVILEGE, CONTROL, client(1000), now);
    camera.0.registers.acquiring = true;
    camera.0.set_link_faults(LinkFaults { taken: Taken::Control, ..LinkFaults::default() });
    assert_eq!(camera.write(0x0938, 1000, client(1000), now), DENIED);
    assert_eq!(camera.write(PRIVILEGE, CONTROL, client(1000), now), DENIED);
    assert_eq!(camera.ask(0x80, &[PRIVILEGE, PRIMARY_ADDRESS], client(1000), now).1, [0, 0, 0, 2, 192, 0, 2, 1]);
    camera.0.expire(now + Duration::from_secs(60));
    assert!(camera.0.registers.acquiring);
    camera.0.set_link_faults(LinkFaults { taken: Taken::Exclusive, ..LinkFaults::default() });
    assert_eq!(camera.ask(0x80, &[PRIVILEGE], client(1000), now).0, DENIED);
    camera.0.set_link_faults(LinkFaults::default());
    assert!(!camera.0.registers.acquiring);
    assert_eq!(camera.write(PRIVILEGE, CONTROL, client(1000), now), 0);
}
