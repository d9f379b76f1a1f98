//! The configured camera, where it is a GenICam camera: whether it is there, and whether its frames come through.

use super::{network, usb};
use crate::cli::doctor::facts::{Facts, GenicamFacts, WayFacts};
use crate::cli::doctor::finding::Finding;
use crate::config::Config;

const WHAT: &str = "camera";

pub(super) fn check(config: &Config, found: &Result<Box<GenicamFacts>, String>, facts: &Facts) -> Vec<Finding> {
    let camera = match found {
        Ok(camera) => camera,
        Err(why) => {
            let detail = format!("device = {:?}: {why}", config.bench.camera.device);
            return vec![Finding::problem("camera.device", WHAT, detail, "plenalign camera list")];
        }
    };
    // What cannot be opened has no formats to be judged.
    if let WayFacts::Usb { file: Ok(file), .. } = &camera.way
        && let Some(wrong) = usb::permission(file, facts)
    {
        return vec![wrong];
    }
    let mut all = offered(config, camera);
    if all.iter().any(|finding| finding.mend.is_some()) {
        return all;
    }
    let Some(format) = config.bench.camera.pixel_format() else { return all };
    let frame_bytes = format.row_bytes(config.sensor.width_px as usize * config.sensor.height_px as usize);
    all.extend(match &camera.way {
        WayFacts::Network(way) => network::check(config, way, frame_bytes),
        WayFacts::Usb { file, memory_mib } => {
            usb::check(config, &camera.camera, file.as_ref().ok(), *memory_mib, frame_bytes)
        }
    });
    all
}

/// Whether it offers what is configured.
fn offered(config: &Config, facts: &GenicamFacts) -> Vec<Finding> {
    let (camera, found) = (&config.bench.camera, &facts.camera);
    let called = format!("{} at {} ({})", found.model, found.path(), found.standard());
    if let Some(why) = &found.unusable {
        return vec![Finding::problem("camera.device", WHAT, format!("{called}: {why}"), "plenalign camera list")];
    }
    if !found.formats.is_empty() && !found.formats.contains(&camera.format) {
        let readable = found.readable();
        let mend = readable
            .first()
            .map_or_else(|| "plenalign camera list".to_owned(), |format| format!("[bench.camera] format = {format:?}"));
        let detail = format!("it does not offer {}: it offers {}", camera.format, found.formats.join(", "));
        return vec![Finding::problem("camera.format", WHAT, detail, mend)];
    }
    let size = format!("{}x{}", config.sensor.width_px, config.sensor.height_px);
    vec![Finding::ok(
        "camera.device",
        WHAT,
        format!("{called}, {} {size} at {} Hz", camera.format, camera.frame_rate_hz),
    )]
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::cli::doctor::facts::NetworkFacts;
    use crate::config::{CameraConfig, CameraDriver};
    use crate::device::camera::genicam::found::{FoundCamera, Way};

    /// Frames of 12.6 million bytes, 25 times a second.
    pub(in super::super) fn config() -> Config {
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

    pub(in super::super) fn camera(way: Way) -> FoundCamera {
        FoundCamera {
            way,
            model: "Maker Mono".to_owned(),
            serial: Some("A1".to_owned()),
            user_name: None,
            formats: vec!["Mono8".to_owned(), "Mono12p".to_owned()],
            unusable: None,
        }
    }

    fn facts() -> GenicamFacts {
        let way = NetworkFacts {
            interface: "eth1".to_owned(),
            mtu: Some(9000),
            link_mbit_per_s: Some(10_000),
            most_buffer_bytes: Some(64 << 20),
        };
        let address = std::net::Ipv4Addr::new(10, 0, 0, 5);
        let camera = camera(Way::Network { address, interface: "eth1".to_owned() });
        GenicamFacts { camera, way: WayFacts::Network(way) }
    }

    fn found(config: &Config, camera: Result<GenicamFacts, String>) -> Vec<Finding> {
        check(config, &camera.map(Box::new), &super::super::tests::well())
    }

    #[test]
    fn a_camera_that_does_not_fit_says_why() {
        let ids = |config: &Config, facts| found(config, Ok(facts)).iter().map(|one| one.id).collect::<Vec<_>>();
        assert_eq!(ids(&config(), facts()), ["camera.device"]);
        let mut wanted = config();
        wanted.bench.camera.format = "Mono16".to_owned();
        assert_eq!(ids(&wanted, facts()), ["camera.format"]);
        let mut held = facts();
        held.camera.unusable = Some("another program has it".to_owned());
        assert_eq!(ids(&config(), held), ["camera.device"]);
        let missing = found(&config(), Err("no camera on eth1".to_owned()));
        assert!(missing[0].detail.contains("no camera on eth1"), "{}", missing[0].detail);
    }
}
