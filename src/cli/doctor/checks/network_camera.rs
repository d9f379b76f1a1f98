//! The configured camera, where it is on the network: whether it is there, and whether its frames come through.

use crate::cli::doctor::facts::NetworkCameraFacts;
use crate::cli::doctor::finding::Finding;
use crate::config::Config;

/// What IP, UDP and GigE Vision take of a packet, bytes.
const HEADERS: u32 = 36;
/// Of a link's rate, what is used at most without frames being lost.
const LINK_SHARE: f64 = 0.9;
/// More packets a second than these cost more of a processor than it is worth: larger ones are to be had.
const MANY_PACKETS: f64 = 20_000.0;
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
    let (what, camera) = ("camera's network", &config.bench.camera);
    let interface = &facts.camera.interface;
    let Some(format) = camera.pixel_format() else { return Vec::new() };
    let pixels = config.sensor.width_px as usize * config.sensor.height_px as usize;
    let frame_bytes = format.row_bytes(pixels) as f64;
    let mut all = Vec::new();
    if let Some(mtu) = facts.mtu {
        let packet = camera.packet_bytes.unwrap_or(mtu).min(mtu);
        let payload = f64::from(packet.saturating_sub(HEADERS).max(1));
        let packets = frame_bytes / payload * camera.frame_rate_hz;
        let megabits = packets * f64::from(packet) * 8e-6;
        if let Some(carried) = facts.link_mbit_per_s.map(f64::from).filter(|carried| megabits > carried * LINK_SHARE) {
            let rate = camera.frame_rate_hz * carried * LINK_SHARE / megabits;
            all.push(Finding::problem(
                "camera.link",
                what,
                format!("frames need {megabits:.0} Mbit/s, and {interface} carries {carried:.0} Mbit/s"),
                format!("[bench.camera] frame_rate_hz = {:.1}", (rate * 10.0).floor() / 10.0),
            ));
        }
        if packets > MANY_PACKETS && mtu < 9000 {
            all.push(Finding::warning(
                "camera.packets",
                what,
                format!("frames come in {packets:.0} packets a second of {packet} bytes on {interface}"),
                format!("sudo ip link set {interface} mtu 9000    # where camera and switches carry that, too"),
            ));
        }
    }
    let needed = LEAST_BUFFER.max(2 * frame_bytes as u64);
    if let Some(most) = facts.most_buffer_bytes.filter(|most| *most < needed) {
        all.push(Finding::warning(
            "camera.buffer",
            what,
            format!("a socket's buffer holds at most {most} bytes, of {needed} that frames of this size should have"),
            format!("echo net.core.rmem_max={needed} | sudo tee /etc/sysctl.d/90-plenalign.conf; sudo sysctl --system"),
        ));
    }
    all
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
        assert!(found[1].detail.contains("2527 Mbit/s"), "{}", found[1].detail);
        let plain = NetworkCameraFacts { mtu: Some(1500), ..facts() };
        assert_eq!(ids(&config, plain), ["camera.device", "camera.packets"]);
        let narrow = NetworkCameraFacts { most_buffer_bytes: Some(212_992), ..facts() };
        assert_eq!(ids(&config, narrow), ["camera.device", "camera.buffer"]);
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
