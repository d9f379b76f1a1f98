//! The configured camera, where it is on the network: whether it is there, and whether its frames come through.

use crate::cli::doctor::facts::NetworkCameraFacts;
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

pub(super) fn check(config: &Config, found: &Result<NetworkCameraFacts, String>) -> Vec<Finding> {
    let (what, camera) = ("camera", &config.bench.camera);
    let facts = match found {
        Ok(facts) => facts,
        Err(why) => {
            let detail = format!("device = {:?}: {why}", camera.device);
            return vec![Finding::problem("camera.device", what, detail, "plenalign camera list")];
        }
    };
    let called = format!("{} at {}", facts.camera.model, facts.camera.address);
    if let Some(why) = &facts.camera.unusable {
        return vec![Finding::problem("camera.device", what, format!("{called}: {why}"), "plenalign camera list")];
    }
    if !facts.camera.formats.is_empty() && !facts.camera.formats.contains(&camera.format) {
        let readable = facts.camera.readable();
        let mend = readable
            .first()
            .map_or_else(|| "plenalign camera list".to_owned(), |format| format!("[bench.camera] format = {format:?}"));
        let detail = format!("it does not offer {}: it offers {}", camera.format, facts.camera.formats.join(", "));
        return vec![Finding::problem("camera.format", what, detail, mend)];
    }
    let mut all = vec![Finding::ok(
        "camera.device",
        what,
        format!(
            "{called}, {} {}x{} at {} Hz",
            camera.format, config.sensor.width_px, config.sensor.height_px, camera.frame_rate_hz
        ),
    )];
    all.extend(link(config, facts));
    all
}

/// What on the way would lose frames.
fn link(config: &Config, facts: &NetworkCameraFacts) -> Vec<Finding> {
    let Some(format) = config.bench.camera.pixel_format() else { return Vec::new() };
    let pixels = config.sensor.width_px as usize * config.sensor.height_px as usize;
    let frame_bytes = format.row_bytes(pixels);
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
fn packet_size(config: &Config, facts: &NetworkCameraFacts, mtu: u32) -> Option<Finding> {
    let (interface, bytes) = (&facts.camera.interface, config.bench.camera.packet_bytes.filter(|bytes| *bytes > mtu)?);
    Some(Finding::problem(
        "camera.packet_size",
        WHAT,
        format!("packets of {bytes} bytes are configured, and {interface} carries {mtu} bytes"),
        format!("sudo ip link set {interface} mtu {bytes}    # or [bench.camera] packet_bytes = {mtu}"),
    ))
}

/// Whether the frames' packets come through as often as frames are taken.
fn pace(config: &Config, facts: &NetworkCameraFacts, mtu: u32, frame_bytes: usize) -> Vec<Finding> {
    let (camera, interface) = (&config.bench.camera, &facts.camera.interface);
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
fn buffer(facts: &NetworkCameraFacts, frame_bytes: usize) -> Option<Finding> {
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
    use super::*;
    use crate::config::{CameraConfig, CameraDriver};
    use crate::device::camera::genicam::find::NetworkCamera;

    fn config() -> Config {
        let mut config = Config::default();
        config.bench.camera = CameraConfig {
            driver: CameraDriver::Genicam,
            device: "serial:A1".to_owned(),
            format: "Mono8".to_owned(),
            frame_rate_hz: 25.0,
            ..CameraConfig::default()
        };
        (config.sensor.width_px, config.sensor.height_px) = (4096, 3072);
        config
    }

    fn facts() -> NetworkCameraFacts {
        NetworkCameraFacts {
            camera: NetworkCamera {
                address: std::net::Ipv4Addr::new(10, 0, 0, 5),
                model: "Maker Mono".to_owned(),
                serial: Some("A1".to_owned()),
                user_name: None,
                interface: "eth1".to_owned(),
                formats: vec!["Mono8".to_owned(), "Mono12p".to_owned()],
                unusable: None,
            },
            mtu: Some(9000),
            link_mbit_per_s: Some(10_000),
            most_buffer_bytes: Some(64 << 20),
        }
    }

    fn ids(config: &Config, facts: NetworkCameraFacts) -> Vec<&'static str> {
        check(config, &Ok(facts)).iter().map(|finding| finding.id).collect()
    }

    #[test]
    fn what_would_lose_frames_is_told_before_it_does() {
        let config = config();
        assert_eq!(ids(&config, facts()), ["camera.device"]);
        // 12.6 million bytes, 25 times a second: 2.5 Gbit/s.
        let slow = NetworkCameraFacts { link_mbit_per_s: Some(1000), ..facts() };
        let found = check(&config, &Ok(slow));
        assert_eq!(found[1].id, "camera.link");
        assert!(found[1].detail.contains("2538 Mbit/s"), "{}", found[1].detail);
        let plain = NetworkCameraFacts { mtu: Some(1500), ..facts() };
        assert_eq!(ids(&config, plain), ["camera.device", "camera.packets"]);
        let narrow = NetworkCameraFacts { most_buffer_bytes: Some(212_992), ..facts() };
        assert_eq!(ids(&config, narrow), ["camera.device", "camera.buffer"]);
    }

    #[test]
    fn what_is_told_to_type_mends_it() {
        let mended = |mut config: Config, facts: NetworkCameraFacts, id: &str, key: &str| {
            let found = check(&config, &Ok(facts.clone()));
            let finding = found.iter().find(|finding| finding.id == id).unwrap_or_else(|| panic!("{id}: {found:?}"));
            let number = finding.mend.as_ref().and_then(|mend| mend.split(&format!("{key} = ")).nth(1)).unwrap();
            let number: f64 = number.split(' ').next().and_then(|number| number.parse().ok()).unwrap();
            let camera = &mut config.bench.camera;
            match key {
                "frame_rate_hz" => camera.frame_rate_hz = number,
                "packet_delay_us" => camera.packet_delay_us = Some(number),
                _ => camera.packet_bytes = Some(number as u32),
            }
            assert_eq!(ids(&config, facts), ["camera.device"], "{finding:?}");
            number
        };
        let slow = NetworkCameraFacts { link_mbit_per_s: Some(1000), ..facts() };
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
        let unknown = NetworkCameraFacts { mtu: None, link_mbit_per_s: None, most_buffer_bytes: None, ..facts() };
        assert_eq!(ids(&config(), unknown), ["camera.device"]);
        let mut spread = config();
        spread.bench.camera.packet_delay_us = Some(100.0);
        let unknown = NetworkCameraFacts { link_mbit_per_s: None, ..facts() };
        assert_eq!(ids(&spread, unknown), ["camera.device", "camera.packet_delay"], "the delay alone is too much");
    }

    #[test]
    fn a_camera_that_does_not_fit_says_why() {
        let mut wanted = config();
        wanted.bench.camera.format = "Mono16".to_owned();
        assert_eq!(ids(&wanted, facts()), ["camera.format"]);
        let mut held = facts();
        held.camera.unusable = Some("another program has it".to_owned());
        assert_eq!(ids(&config(), held), ["camera.device"]);
        let missing = check(&config(), &Err("no camera on eth1".to_owned()));
        assert!(missing[0].detail.contains("no camera on eth1"), "{}", missing[0].detail);
    }
}
