//! The driver of GenICam cameras against the simulated one, which shares no protocol with it: no frame of a slide in motion
//! is taken for one at rest, whatever the camera's stamps are of; and whatever goes wrong on the way is told and mends, while
//! every frame that is shown is whole.

use std::fs::File;
use std::io::Write as _;
use std::net::Ipv4Addr;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use plenalign::config::{CameraConfig, CameraDriver, Config, TimestampMeans};
use plenalign::device::camera::genicam::GenicamCamera;
use plenalign::device::{AxisPose, CameraState, Frame, FrameSource as _};
use plenalign::raw::Samples;
use plenalign::sim::gige::{Exposure, GigeCamera, GigeFaults, LinkFaults, Options, Taken};
use rand::{RngExt as _, SeedableRng as _};
use rand_pcg::Pcg64;
use tokio::sync::watch;
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

/// A camera whose stamps are of `means`, at an address of its own.
fn camera(test: u8, means: TimestampMeans, link: LinkFaults, slides: Option<&Path>) -> GigeCamera {
    let options = Options {
        address: own_address(test),
        serial: "T-1".to_owned(),
        user_name: String::new(),
        means,
        link_mbit_s: 1000.0,
        // One of the two kinds that there are.
        names_controller: means != TimestampMeans::Arrival,
        faults: GigeFaults { link, ..GigeFaults::default() },
        seed: 7,
        slides: slides.into_iter().map(|path| path.to_str().unwrap().parse().unwrap()).collect(),
    };
    GigeCamera::start(&world(), options).unwrap()
}

/// A driver that takes its stamps for stamps of `told`.
fn driver(test: u8, told: TimestampMeans, timeout_ms: u64) -> GenicamCamera {
    started(&CameraConfig { timeout_ms, timestamp_means: told, ..config(test) })
}

fn config(test: u8) -> CameraConfig {
    CameraConfig {
        driver: CameraDriver::Genicam,
        device: own_address(test).to_string(),
        format: "Mono8".to_owned(),
        frame_rate_hz: RATE_HZ,
        ..CameraConfig::default()
    }
}

fn started(config: &CameraConfig) -> GenicamCamera {
    let at_rest = AxisPose { position: None, settled: true };
    let size = (SIDE as usize, SIDE as usize);
    GenicamCamera::start(config, size, Arc::new(move |_, _| (at_rest, at_rest))).unwrap()
}

/// The exposure that a frame is of, where it is whole.
fn exposure_of(camera: &GigeCamera, frame: &Frame) -> Option<Exposure> {
    let Samples::U8(samples) = frame.image.samples() else { panic!("Mono8 is of 8 bits") };
    let checksum = Exposure::checksum(samples);
    camera.exposures().into_iter().find(|exposure| exposure.checksum == checksum)
}

/// Has slides move before a camera whose stamps are of `means`, which the driver takes for stamps of `told`. How long the frames
/// that it admits after a motion have to be waited for, in the mean; or what is wrong with one.
async fn admitted(
    [means, told]: [TimestampMeans; 2],
    test: u8,
    rounds: u32,
    link: LinkFaults,
) -> Result<Duration, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("slides");
    let mut record = File::create(&path).unwrap();
    let camera = camera(test, means, link, Some(&path));
    let driver = driver(test, told, 5000);
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
        let exposure = exposure_of(&camera, &frame).expect("a frame that was taken");
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
    let good = LinkFaults::default();
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
    let faults = LinkFaults {
        lost_one_in: 200,
        late_one_in: 300,
        doubled_one_in: 100,
        misnumbered_one_in: 2000,
        ..LinkFaults::default()
    };
    let waited = admitted([TimestampMeans::ExposureStart; 2], 10, 6, faults).await;
    assert!(waited.is_ok(), "{waited:?}");
    let lost = LinkFaults { lost_one_in: 2000, ..LinkFaults::default() };
    let waited = admitted([TimestampMeans::Arrival; 2], 11, 3, lost).await;
    assert!(waited.is_ok(), "{waited:?}");
}

/// What the others look for is there to be found.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn stamps_that_are_taken_for_what_they_are_not_are_seen() {
    let wrong = [TimestampMeans::ExposureEnd, TimestampMeans::ExposureStart];
    let seen = admitted(wrong, 20, 6, LinkFaults::default()).await.unwrap_err();
    assert!(seen.contains("exposed"), "{seen}");
}

/// What the driver is to notice of a camera whose heartbeat is the usual one.
const HEARTBEAT: Duration = Duration::from_secs(3);

async fn told(state: &mut watch::Receiver<CameraState>, what: &str) {
    let is_told = |state: &CameraState| state.fault.as_ref().is_some_and(|fault| fault.contains(what));
    let waited = tokio::time::timeout(Duration::from_secs(60), state.wait_for(is_told)).await.is_ok();
    assert!(waited, "{what:?} is not told: {:?}", *state.borrow());
}

async fn online(state: &mut watch::Receiver<CameraState>) {
    let waited = tokio::time::timeout(Duration::from_secs(60), state.wait_for(|state| state.online)).await.is_ok();
    assert!(waited, "it does not come back: {:?}", *state.borrow());
}

/// Waits for another frame, which is a good one.
async fn good_frame(driver: &GenicamCamera) {
    let seq = || driver.newest().map(|frame| frame.seq);
    let before = seq();
    until("another good frame", async || {
        let state = driver.state();
        let fault = state.borrow().fault.clone();
        seq().filter(|_| seq() != before).ok_or_else(|| format!("{fault:?}"))
    })
    .await;
}

/// Has everything go wrong on the way from a camera, one thing after the other.
async fn all_that_goes_wrong_mends(test: u8, means: TimestampMeans) {
    let camera = camera(test, means, LinkFaults::default(), None);
    let driver = driver(test, means, 1000);
    let mut state = driver.state();
    online(&mut state).await;
    let set = |link| camera.set_faults(GigeFaults { link, ..GigeFaults::default() });

    // What is lost is counted, and every frame that is shown is whole.
    let link = LinkFaults { lost_one_in: 25, late_one_in: 40, doubled_one_in: 15, misnumbered_one_in: 60, ..good() };
    set(link);
    let (mut live, mut shown) = (driver.live(), 0);
    until("frames are shown, and one comes damaged", async || {
        if live.has_changed().unwrap()
            && let Some(frame) = live.borrow_and_update().clone()
        {
            assert!(exposure_of(&camera, &frame).is_some(), "frame {} is no frame that was taken", frame.seq);
            shown += 1;
        }
        let damaged = state.borrow().frames_damaged;
        if shown >= 10 && damaged > 0 { Ok(()) } else { Err(format!("{shown} shown, {damaged} damaged")) }
    })
    .await;
    // What a packet says of its frame's number is not believed beyond what there was time for.
    let (lost, taken) = (state.borrow().frames_lost, camera.exposures().len() as u64);
    assert!((state.borrow().frames_damaged..2 * taken).contains(&lost), "{lost} of {taken}");
    set(good());

    for (link, words) in [
        (LinkFaults { silent: true, ..good() }, "it has stopped sending"),
        (LinkFaults { deaf: true, ..good() }, "it does not answer"),
        (LinkFaults { taken: Taken::Control, ..good() }, "another program took control of it"),
        (LinkFaults { taken: Taken::Exclusive, ..good() }, "another program took control of it"),
    ] {
        good_frame(&driver).await;
        let began = Instant::now();
        set(link);
        told(&mut state, words).await;
        if link.taken != Taken::No {
            assert!(began.elapsed() < HEARTBEAT, "{link:?}: told after {:?}", began.elapsed());
            // Its frames go on, and are nobody's here.
            assert!(driver.newest().is_none());
            told(&mut state, "another program controls it: end that one").await;
        }
        set(good());
        online(&mut state).await;
    }
    good_frame(&driver).await;
    camera.restart(Duration::ZERO);
    told(&mut state, "it let go of this program").await;
    online(&mut state).await;
}

fn good() -> LinkFaults {
    LinkFaults::default()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn whatever_goes_wrong_on_the_way_is_told_and_mends_and_every_frame_is_whole() {
    tokio::join!(
        all_that_goes_wrong_mends(30, TimestampMeans::ExposureStart),
        all_that_goes_wrong_mends(31, TimestampMeans::Arrival)
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn packets_that_the_camera_does_not_send_are_refused_by_what_it_takes() {
    let _camera = camera(40, TimestampMeans::ExposureStart, good(), None);
    for bytes in [9004, 1501, 252] {
        let driver = started(&CameraConfig { packet_bytes: Some(bytes), ..config(40) });
        let words = format!("`GevSCPSPacketSize` is not set to {bytes}: it takes 256 to 9000 B in steps of 4");
        told(&mut driver.state(), &words).await;
        driver.end().await;
    }
    let driver = started(&CameraConfig { packet_bytes: Some(1500), ..config(40) });
    online(&mut driver.state()).await;
}
