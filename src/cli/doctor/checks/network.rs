//! The network between the configured camera and this machine: whether frames come through.

use crate::cli::doctor::facts::NetworkFacts;
use crate::cli::doctor::finding::Finding;
use crate::config::Config;

/// What IP, UDP and GigE Vision take of a packet, bytes.
const HEADERS: u32 = 36;
/// What Ethernet takes besides, on the wire: its header, its checksum, and the gap before the next, bytes.
const WIRE: u32 = 38;
/// Of a link's rate, what is used at most without frames being lost.
const LINK_SHARE: f64 = 0.9;
/// More packets a second than these cost more of a processor than it is worth: larger ones are to be had.
const MANY_PACKETS: f64 = 20_000.0;
/// What interfaces and switches carry that carry large packets, bytes.
const JUMBO: u32 = 9000;
/// The least that a driver's buffer holds, bytes: what comes while it is not running must have room.
const LEAST_BUFFER: u64 = 4 << 20;

/// What on the way would lose frames of so many bytes.
pub(super) fn check(config: &Config, facts: &NetworkFacts, frame_bytes: usize) -> Vec<Finding> {
    let mut all = Vec::new();
    if let Some(mtu) = facts.mtu {
        all.extend(packet_size(config, facts, mtu));
        all.extend(pace(config, facts, mtu, frame_bytes));
    }
    all.extend(buffer(facts, frame_bytes));
    all
}

const WHAT: &str = "camera's network";

/// Packets larger than the interface carries do not arrive.
fn packet_size(config: &Config, facts: &NetworkFacts, mtu: u32) -> Option<Finding> {
    let (interface, bytes) = (&facts.interface, config.bench.camera.packet_bytes.filter(|bytes| *bytes > mtu)?);
    Some(Finding::problem(
        "camera.packet_size",
        WHAT,
        format!("packets of {bytes} bytes are configured, and {interface} carries {mtu} bytes"),
        format!("sudo ip link set {interface} mtu {bytes}    # or [bench.camera] packet_bytes = {mtu}"),
    ))
}

/// Whether the frames' packets come through as often as frames are taken.
fn pace(config: &Config, facts: &NetworkFacts, mtu: u32, frame_bytes: usize) -> Vec<Finding> {
    let (camera, interface) = (&config.bench.camera, &facts.interface);
    let packet = camera.packet_bytes.unwrap_or(mtu).min(mtu);
    let of_frame = (frame_bytes as f64 / f64::from(packet.saturating_sub(HEADERS).max(1))).ceil();
    let packets = of_frame * camera.frame_rate_hz;
    let megabits = packets * f64::from(packet + WIRE) * 8e-6;
    let tenths = |number: f64| (number * 10.0).floor() / 10.0;
    let mut all = Vec::new();
    let carried = facts.link_mbit_per_s.map(f64::from);
    let too_slow = carried.filter(|carried| megabits > carried * LINK_SHARE);
    if let Some(carried) = too_slow {
        all.push(Finding::problem(
            "camera.link",
            WHAT,
            format!("frames need {megabits:.0} Mbit/s, and {interface} carries {carried:.0} Mbit/s"),
            format!(
                "[bench.camera] frame_rate_hz = {:.1}",
                tenths(camera.frame_rate_hz * carried * LINK_SHARE / megabits)
            ),
        ));
    }
    let delay_us = camera.packet_delay_us.unwrap_or(0.0);
    // A packet goes out, then the camera waits.
    let packet_us = carried.map_or(0.0, |carried| f64::from(packet + WIRE) * 8.0 / carried);
    let (frame_ms, interval_ms) = (of_frame * (packet_us + delay_us) * 1e-3, 1e3 / camera.frame_rate_hz);
    if delay_us > 0.0 && too_slow.is_none() && frame_ms > interval_ms {
        let most_us = (interval_ms * 1e3 * LINK_SHARE / of_frame - packet_us).max(0.0);
        all.push(Finding::problem(
            "camera.packet_delay",
            WHAT,
            format!(
                "with {delay_us} µs between {of_frame} packets a frame is under way for {frame_ms:.1} ms, and one is taken every \
                 {interval_ms:.1} ms"
            ),
            format!("[bench.camera] packet_delay_us = {:.1}", tenths(most_us)),
        ));
    }
    let larger = match camera.packet_bytes {
        Some(bytes) if bytes < mtu => Some(format!("[bench.camera] packet_bytes = {mtu}    # or without it")),
        _ if mtu < JUMBO => {
            Some(format!("sudo ip link set {interface} mtu {JUMBO}    # where camera and switches carry that, too"))
        }
        _ => None,
    };
    if packets > MANY_PACKETS
        && let Some(larger) = larger
    {
        let detail = format!("frames come in {packets:.0} packets a second of {packet} bytes on {interface}");
        all.push(Finding::warning("camera.packets", WHAT, detail, larger));
    }
    all
}

/// What comes while the driver is not running has to wait somewhere.
fn buffer(facts: &NetworkFacts, frame_bytes: usize) -> Option<Finding> {
    let needed = LEAST_BUFFER.max(2 * frame_bytes as u64);
    let most = facts.most_buffer_bytes.filter(|most| *most < needed)?;
    Some(Finding::warning(
        "camera.buffer",
        WHAT,
        format!("a socket's buffer holds at most {most} bytes, of {needed} that frames of this size should have"),
        format!("echo net.core.rmem_max={needed} | sudo tee /etc/sysctl.d/90-plenalign.conf; sudo sysctl --system"),
    ))
}

#[cfg(test)]
mod tests {
    use super::super::genicam::tests::config;
    use super::*;

    const FRAME: usize = 4096 * 3072;

    fn facts() -> NetworkFacts {
        NetworkFacts {
            interface: "eth1".to_owned(),
            mtu: Some(9000),
            link_mbit_per_s: Some(10_000),
            most_buffer_bytes: Some(64 << 20),
        }
    }

    fn ids(config: &Config, facts: NetworkFacts) -> Vec<&'static str> {
        check(config, &facts, FRAME).iter().map(|finding| finding.id).collect()
    }

    #[test]
    fn what_would_lose_frames_is_told_before_it_does() {
        let config = config();
        assert_eq!(ids(&config, facts()), [""; 0]);
        // 12.6 million bytes, 25 times a second: 2.5 Gbit/s.
        let slow = NetworkFacts { link_mbit_per_s: Some(1000), ..facts() };
        let found = check(&config, &slow, FRAME);
        assert_eq!(found[0].id, "camera.link");
        assert!(found[0].detail.contains("2538 Mbit/s"), "{}", found[0].detail);
        let plain = NetworkFacts { mtu: Some(1500), ..facts() };
        assert_eq!(ids(&config, plain), ["camera.packets"]);
        let narrow = NetworkFacts { most_buffer_bytes: Some(212_992), ..facts() };
        assert_eq!(ids(&config, narrow), ["camera.buffer"]);
    }

    #[test]
    fn what_is_told_to_type_mends_it() {
        let mended = |mut config: Config, facts: NetworkFacts, id: &str, key: &str| {
            let found = check(&config, &facts, FRAME);
            let finding = found.iter().find(|finding| finding.id == id).unwrap_or_else(|| panic!("{id}: {found:?}"));
            let number = finding.mend.as_ref().and_then(|mend| mend.split(&format!("{key} = ")).nth(1)).unwrap();
            let number: f64 = number.split(' ').next().and_then(|number| number.parse().ok()).unwrap();
            let camera = &mut config.bench.camera;
            match key {
                "frame_rate_hz" => camera.frame_rate_hz = number,
                "packet_delay_us" => camera.packet_delay_us = Some(number),
                _ => camera.packet_bytes = Some(number as u32),
            }
            assert_eq!(ids(&config, facts), [""; 0], "{finding:?}");
            number
        };
        let slow = NetworkFacts { link_mbit_per_s: Some(1000), ..facts() };
        // 1404 packets of 9038 bytes a frame, of 900 Mbit/s.
        assert_eq!(mended(config(), slow, "camera.link", "frame_rate_hz"), 8.8);
        let mut spread = config();
        spread.bench.camera.packet_delay_us = Some(30.0);
        // 40 ms are 28.5 µs a packet, of which it takes 7.2 µs to send one, and a tenth is left free.
        assert_eq!(mended(spread, facts(), "camera.packet_delay", "packet_delay_us"), 18.4);
        let mut small = config();
        small.bench.camera.packet_bytes = Some(1500);
        mended(small, facts(), "camera.packets", "packet_bytes");
        let mut large = config();
        large.bench.camera.packet_bytes = Some(9014);
        mended(large, facts(), "camera.packet_size", "packet_bytes");
    }

    #[test]
    fn a_link_of_no_known_speed_is_not_judged() {
        let unknown = NetworkFacts { mtu: None, link_mbit_per_s: None, most_buffer_bytes: None, ..facts() };
        assert_eq!(ids(&config(), unknown), [""; 0]);
        let mut spread = config();
        spread.bench.camera.packet_delay_us = Some(100.0);
        let unknown = NetworkFacts { link_mbit_per_s: None, ..facts() };
        assert_eq!(ids(&spread, unknown), ["camera.packet_delay"], "the delay alone is too much");
    }
}
