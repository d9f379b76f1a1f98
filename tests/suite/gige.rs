//! The driver of GenICam cameras against the simulated one, which shares no protocol with it: no frame of a slide in motion
//! is taken for one at rest, whatever the camera's stamps are of.

use std::fs::File;
use std::io::Write as _;
use std::net::Ipv4Addr;
use std::sync::Arc;
use std::time::Duration;

use plenalign::config::{CameraConfig, CameraDriver, Config, TimestampMeans};
use plenalign::device::camera::genicam::GenicamCamera;
use plenalign::device::{AxisPose, FrameSource as _};
use plenalign::raw::Samples;
use plenalign::sim::gige::{GigeCamera, Options, PacketFaults};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use tokio::time::Instant;

use super::until::until;

/// Columns and rows: as many bytes as leave room for few frames in the kernel's buffer, which a frame that is dated by its
/// arrival may have waited in.
const SIDE: u32 = 400;
const RATE_HZ: f64 = 20.0;

/// An address that this process and this test have for themselves.
fn own_address(test: u8) -> Ipv4Addr {
    let [.., high, low] = std::process::id().to_be_bytes();
    Ipv4Addr::new(127, 64 + test, high, low)
}

fn world() -> Arc<Config> {
    let mut config = Config::default();
    (config.sensor.width_px, config.sensor.height_px) = (SIDE, SIDE);
    config.bench.simulation.rays = 2;
    Arc::new(config)
}

/// Moves the focus slide to and fro for a while, and tells it as `sim-stage` does.
async fn move_slide(record: &mut File, steps: u32) {
    for step in 0..steps {
        let place = 1.0 + 0.01 * f64::from(step);
        let told = format!("{} 0 {place:.4}\n", jiff::Timestamp::now().as_microsecond());
        record.write_all(told.as_bytes()).unwrap();
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    record.write_all(format!("{} 0 1.5\n", jiff::Timestamp::now().as_microsecond()).as_bytes()).unwrap();
}

/// Has slides move before a camera whose stamps are of `means`, which the driver takes for stamps of `told`. How long the frames
/// that it admits after a motion have to be waited for, in the mean; or what is wrong with one.
async fn admitted(
    [means, told]: [TimestampMeans; 2],
    test: u8,
    rounds: u32,
    packets: PacketFaults,
) -> Result<Duration, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("slides");
    let mut record = File::create(&path).unwrap();
    let address = own_address(test);
    let options = Options {
        address,
        serial: "T-1".to_owned(),
        user_name: String::new(),
        means,
        link_mbit_s: 1000.0,
        packets,
        seed: 7,
        slides: vec![path.to_str().unwrap().parse().unwrap()],
    };
    let camera = GigeCamera::start(&world(), options).unwrap();
    let config = CameraConfig {
        driver: CameraDriver::Genicam,
        device: address.to_string(),
        format: "Mono8".to_owned(),
        frame_rate_hz: RATE_HZ,
        timeout_ms: 5000,
        timestamp_means: told,
        ..CameraConfig::default()
    };
    let at_rest = AxisPose { position: None, settled: true };
    let driver =
        GenicamCamera::start(&config, (SIDE as usize, SIDE as usize), Arc::new(move |_, _| (at_rest, at_rest)));
    let driver = driver.unwrap();
    let state = driver.state();
    until("a first frame", async || {
        let state = state.borrow();
        if driver.newest().is_some() { Ok(()) } else { Err(format!("{:?} {:?}", state.fault, state.notes)) }
    })
    .await;
    let mut random = Pcg64::seed_from_u64(u64::from(test));
    let mut waited = Duration::ZERO;
    for round in 0..rounds {
        move_slide(&mut record, random.random_range(4..30)).await;
        let rest = Instant::now();
        let frame = driver.frame(rest).await.unwrap();
        waited += rest.elapsed();
        let Samples::U8(samples) = frame.image.samples() else { panic!("Mono8 is of 8 bits") };
        let half = samples.len() / 2;
        let exposures = camera.exposures();
        let exposure = exposures.iter().find(|exposure| samples[half..].starts_with(&exposure.middle));
        let exposure = exposure.expect("a frame that was taken");
        let early = rest.into_std().saturating_duration_since(exposure.from);
        if !early.is_zero() {
            return Err(format!("round {round}: exposed from {early:?} before the slide stood"));
        }
        // What is said of the exposure holds it.
        let (from, to) = (frame.exposed_from.into_std(), frame.exposed_to.into_std());
        if from > exposure.from || to < exposure.to {
            let by = (from.saturating_duration_since(exposure.from), exposure.to.saturating_duration_since(to));
            return Err(format!("round {round}: exposed outside of what is said, by {by:?}"));
        }
        assert_eq!(frame.exposure_assumed, means == TimestampMeans::Arrival);
    }
    Ok(waited / rounds)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_frame_of_motion_is_admitted_whatever_the_stamps_are_of() {
    let good = PacketFaults::default();
    for (test, (means, rounds)) in [
        (TimestampMeans::ExposureStart, 6),
        (TimestampMeans::ExposureEnd, 6),
        (TimestampMeans::Readout, 6),
        (TimestampMeans::Arrival, 3),
    ]
    .into_iter()
    .enumerate()
    {
        let waited = admitted([means; 2], test as u8, rounds, good).await;
        println!("{means:?}: a frame was waited for {waited:?}");
        assert!(waited.is_ok(), "{means:?}: {waited:?}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nor_where_packets_are_lost_late_doubled_and_misnumbered() {
    let faults = PacketFaults { lost_one_in: 200, late_one_in: 300, doubled_one_in: 100, misnumbered_one_in: 2000 };
    let waited = admitted([TimestampMeans::ExposureStart; 2], 10, 6, faults).await;
    assert!(waited.is_ok(), "{waited:?}");
    let lost = PacketFaults { lost_one_in: 2000, ..PacketFaults::default() };
    let waited = admitted([TimestampMeans::Arrival; 2], 11, 3, lost).await;
    assert!(waited.is_ok(), "{waited:?}");
}

/// What the others look for is there to be found.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn stamps_that_are_taken_for_what_they_are_not_are_seen() {
    let wrong = [TimestampMeans::ExposureEnd, TimestampMeans::ExposureStart];
    let seen = admitted(wrong, 20, 6, PacketFaults::default()).await.unwrap_err();
    assert!(seen.contains("exposed"), "{seen}");
}
