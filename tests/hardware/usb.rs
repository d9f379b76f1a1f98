//! Cameras on USB3 Vision, against the guest's kernel: found, set, streamed, dated, lost and found again; and Aravis's
//! word on the camera that they are tried with.

use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use plenalign::config::{CameraConfig, CameraDriver, ControlValue, TimestampMeans};
use plenalign::device::Frame;
use plenalign::device::camera::genicam::{find, survey};
use plenalign::device::light::ControlName;

use crate::Test;
use crate::bench::{Camera, sample};
use crate::u3v::{self, NAME, Running, SENSOR, SERIAL};
use crate::until::{until_blocking, when};
use crate::usbip::{Plugged, Speed, plug};

pub(crate) const TESTS: &[Test] = &[
    ("usb_aravis_takes_the_camera_for_one", aravis),
    ("usb_camera_is_listed_and_found_by_each_name", listed),
    ("usb_listing_and_opening_keep_out_of_each_others_way", side_by_side),
    ("usb_frames_are_exact", || exact("Mono8")),
    ("usb_packed_frames_are_exact", || exact("Mono12p")),
    ("usb_frames_are_dated_no_later_than_they_were_exposed", dated),
    ("usb_frames_by_arrival_are_dated_no_later_either", dated_by_arrival),
    ("usb_exposure_and_gain_are_set", light),
    ("usb_lost_and_damaged_frames_are_counted_and_never_shown", damaged),
    ("usb_stall_is_got_over", stalled),
    ("usb_camera_is_unplugged_and_comes_back", unplugged),
    ("usb_camera_that_stops_sending_or_answering_says_so", silent),
    ("usb_camera_that_another_has_says_so", held),
    ("usb_2_is_told", slow),
];

/// The camera that is tried, plugged in.
struct Bench {
    plugged: Option<Plugged>,
    running: Running,
}

impl Bench {
    fn at(speed: Speed) -> Self {
        let running = Running::start(speed);
        let plugged = Some(plug(&running.camera, speed));
        let bench = Self { plugged, running };
        bench.until_there();
        bench
    }

    fn new() -> Self {
        Self::at(Speed::Super)
    }

    /// Waits until the kernel has seen to it.
    fn until_there(&self) {
        until_blocking("the kernel lists the camera", || !survey::cameras(&[]).0.is_empty());
    }

    fn unplug(&mut self) {
        self.plugged = None;
    }

    fn plug(&mut self, speed: Speed) {
        self.plugged = Some(plug(&self.running.camera, speed));
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.unplug();
        until_blocking("the kernel lets go of the camera", || survey::cameras(&[]).0.is_empty());
    }
}

fn config(device: &str, format: &str) -> CameraConfig {
    CameraConfig {
        driver: CameraDriver::Genicam,
        device: device.to_owned(),
        format: format.to_owned(),
        frame_rate_hz: 10.0,
        timeout_ms: 5000,
        ..CameraConfig::default()
    }
}

fn size() -> (usize, usize) {
    (SENSOR.0 as usize, SENSOR.1 as usize)
}

fn online(config: &CameraConfig) -> Camera {
    let camera = Camera::start_for(config, size());
    camera.until("be online", |state| state.online);
    camera
}

fn by_serial(format: &str) -> CameraConfig {
    config(&format!("serial:{SERIAL}"), format)
}

/// The number that a frame shows, where each of its samples is as it was sent.
#[track_caller]
fn number_of(frame: &Frame, bench: &Bench) -> u64 {
    let image = &frame.image;
    let white = image.white_level();
    let is = |number: u64| {
        (0..image.height())
            .all(|y| (0..image.width()).all(|x| sample(image, x, y) == u3v::Camera::sample(number, x, y, white)))
    };
    let exposures = bench.running.camera.exposures();
    let found = exposures.iter().map(|(number, _)| *number).find(|number| is(*number));
    found.unwrap_or_else(|| panic!("frame {} is none of those that were sent", frame.seq))
}

fn told(program: &str, arguments: &[&str]) -> String {
    let done = Command::new(program).args(arguments).output().unwrap();
    String::from_utf8_lossy(&done.stdout).into_owned() + &String::from_utf8_lossy(&done.stderr)
}

fn aravis() {
    let _bench = Bench::new();
    let name = format!("Plenalign-120900000042-{SERIAL}");
    let list = told("arv-tool-0.8", &[]);
    assert!(list.contains(&name) && list.contains("USB3"), "it finds no {name}: {list}");
    let features = told("arv-tool-0.8", &["control", "Width", "PixelFormat", "DeviceUserID", "PayloadSize"]);
    for line in ["Width = 320", "PixelFormat = Mono8", "DeviceUserID = left", "PayloadSize = 64000"] {
        assert!(features.contains(line), "{line}: {features}");
    }
    // Its transfers wait 100 ms and throw away what comes while they are given up: where frames are further apart, that can
    // be every leader, and on a loaded machine a part of a frame. Each that is given up is told of.
    let frames = told("env", &["ARV_DEBUG=sp:2", "arv-camera-test-0.8", "--duration=8", "-f", "50"]);
    let number = |label: &str| {
        let line = frames.lines().find(|line| line.contains(label)).unwrap_or_else(|| panic!("{label}: {frames}"));
        line.rsplit(['=', ' ']).find_map(|word| word.trim().parse::<u64>().ok()).unwrap()
    };
    let (completed, failures) = (number("n_completed_buffers"), number("n_failures"));
    let given_up = frames.matches("LIBUSB_ERROR_TIMEOUT").count() as u64;
    // How many come in that time is the emulated machine's pace, and no claim.
    assert!(completed > 0 && failures <= given_up, "{frames}");
}

fn listed() {
    let _bench = Bench::new();
    let (found, notes) = survey::cameras(&[]);
    let [camera] = &found[..] else { panic!("{found:?}") };
    assert_eq!((notes, &camera.unusable), (Vec::new(), &None));
    assert_eq!((camera.standard(), camera.model.as_str()), ("USB3 Vision", "Plenalign Counter"));
    let names = [format!("serial:{SERIAL}"), format!("name:{NAME}"), "usb:1209:0001".to_owned()];
    assert_eq!(
        (camera.names(), camera.formats.as_slice()),
        (names.to_vec(), ["Mono8", "Mono12p"].map(String::from).as_slice())
    );
    for name in names {
        let state = online(&config(&name, "Mono8")).state();
        assert!(state.identity.contains("Plenalign Counter") && state.identity.contains("USB3 Vision"), "{state:?}");
    }
    let read = || find::features_of(&by_serial("Mono8"), false);
    let (features, _) = until_blocking("its features are read, once it is free", read);
    let exposure = features.iter().find(|feature| feature.key == "ExposureTime").unwrap();
    assert_eq!((&exposure.value, exposure.unit.as_deref()), (&Some(ControlValue::Real(5000.0)), Some("us")));
    let missing = find::configured(&config("serial:none", "Mono8")).unwrap_err();
    assert!(missing.contains("no camera on USB") && missing.contains(SERIAL), "{missing}");
}

fn side_by_side() {
    let _bench = Bench::new();
    let names = [format!("serial:{SERIAL}"), format!("name:{NAME}"), "usb:1209:0001".to_owned()];
    let ended = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let lists = scope.spawn(|| {
            let mut lists = 0;
            while !ended.load(Ordering::SeqCst) {
                let (found, notes) = survey::cameras(&[]);
                let [camera] = &found[..] else { panic!("{found:?}") };
                // While it is in use, too.
                assert_eq!((&camera.unusable, notes, camera.formats.len()), (&None, Vec::new(), 2), "{camera:?}");
                assert_eq!(camera.names(), names);
                lists += 1;
            }
            lists
        });
        // By name it is asked before it is opened. Whatever this comes to, the lists end.
        let opened = std::panic::catch_unwind(|| {
            for device in ["name:left", "usb:1209:0001", "name:left"] {
                let camera = Camera::start_for(&config(device, "Mono8"), size());
                camera.until("be online", |state| {
                    let fault = state.fault.as_deref().unwrap_or_default();
                    assert!(fault == "not opened yet" || fault.is_empty(), "{fault}");
                    state.online
                });
                drop(camera);
                until_blocking("it is free", || find::features_of(&by_serial("Mono8"), false));
            }
        });
        ended.store(true, Ordering::SeqCst);
        let lists = lists.join().unwrap_or_else(|said| std::panic::resume_unwind(said));
        opened.unwrap_or_else(|said| std::panic::resume_unwind(said));
        assert!(lists > 3, "{lists} lists");
    });
}

fn exact(format: &str) {
    let bench = Bench::new();
    let camera = online(&by_serial(format));
    let numbers: Vec<u64> = camera.watch(5).iter().map(|frame| number_of(frame, &bench)).collect();
    assert!(numbers.windows(2).all(|pair| pair[0] < pair[1]), "{numbers:?}");
    // While it sends, it is listed by what is known of it.
    let (found, _) = survey::cameras(&[]);
    assert_eq!((found[0].formats.len(), &found[0].unusable), (2, &None), "{found:?}");
    assert!(camera.state().online);
}

/// Frames are taken for no younger than they are, where they are sent so long (ms) after their exposure began.
fn assert_dated(config: &CameraConfig, late_ms: u32, assumed: bool) {
    let bench = Bench::new();
    bench.running.camera.faults.late_ms.store(late_ms, Ordering::SeqCst);
    let camera = online(config);
    // Those by arrival are further apart.
    for _ in 0..if assumed { 5 } else { 10 } {
        let frame = camera.frame();
        let number = number_of(&frame, &bench);
        let exposures = bench.running.camera.exposures();
        let exposed = exposures.iter().find(|(of, _)| *of == number).unwrap().1;
        let from: Instant = frame.exposed_from.into();
        let (early, most) = (exposed.saturating_duration_since(from), if assumed { 10 } else { 3 });
        assert!(from <= exposed, "taken for younger than it is, by {:?}", from - exposed);
        assert!(early < Duration::from_secs(most), "{early:?}");
        println!("dated from {early:?} before its exposure");
        assert_eq!(frame.exposure_assumed, assumed, "{:?}", camera.state());
    }
}

fn dated() {
    assert_dated(&by_serial("Mono8"), 0, false);
    let start = CameraConfig { timestamp_means: TimestampMeans::ExposureStart, ..by_serial("Mono8") };
    assert_dated(&start, 0, false);
}

/// Before a frame arrives it may have been exposed, read out and sent for an interval each, and have waited for up to
/// four more in the transfers that are under way. It takes five and a half here: who leaves out the first three, or the
/// wait, takes it for younger than it is.
fn dated_by_arrival() {
    let slow = CameraConfig { frame_rate_hz: 5.0, ..by_serial("Mono8") };
    assert_dated(&CameraConfig { timestamp_means: TimestampMeans::Arrival, ..slow }, 1100, true);
}

fn light() {
    let _bench = Bench::new();
    let mut config = by_serial("Mono8");
    config.controls.insert("ExposureTime".to_owned(), ControlValue::Real(8000.0));
    let camera = online(&config);
    let value = |name: ControlName| camera.controls().into_iter().find(|control| control.name == name).unwrap().value;
    assert_eq!(value(ControlName::Exposure), Some(8.0));
    camera.set_control(ControlName::Gain, 6.0).unwrap();
    assert_eq!(value(ControlName::Gain), Some(6.0));
}

fn damaged() {
    let bench = Bench::new();
    let camera = online(&by_serial("Mono8"));
    let faults = &bench.running.camera.faults;
    faults.cut.store(2, Ordering::SeqCst);
    camera.until("count the damaged frames", |state| state.frames_damaged >= 2);
    let before = camera.state().frames_lost;
    faults.skipped.store(3, Ordering::SeqCst);
    camera.until("count the lost frames", |state| state.frames_lost >= before + 3);
    for frame in camera.watch(3) {
        number_of(&frame, &bench);
    }
    assert!(camera.state().online);
}

fn stalled() {
    let bench = Bench::new();
    let camera = online(&by_serial("Mono8"));
    camera.watch(2);
    bench.running.camera.faults.stalls.store(1, Ordering::SeqCst);
    until_blocking("it has stalled", || bench.running.camera.faults.stalls.load(Ordering::SeqCst) == 0);
    for frame in camera.watch(4) {
        number_of(&frame, &bench);
    }
    assert!(camera.state().online);
}

fn unplugged() {
    let mut bench = Bench::new();
    let camera = online(&by_serial("Mono8"));
    camera.watch(2);
    bench.unplug();
    let fault = camera.until_fault("unplugged");
    println!("unplugged: {fault}");
    camera.until_fault("no camera on USB");
    bench.plug(Speed::Super);
    camera.until("be online again", |state| state.online);
    number_of(&camera.frame(), &bench);
}

fn silent() {
    let bench = Bench::new();
    let camera = online(&by_serial("Mono8"));
    let faults = &bench.running.camera.faults;
    faults.silent.store(true, Ordering::SeqCst);
    camera.until_fault("it answers and is this program's own");
    faults.silent.store(false, Ordering::SeqCst);
    camera.until("be online again", |state| state.online);
    faults.deaf.store(true, Ordering::SeqCst);
    camera.until_fault("it does not answer");
    faults.deaf.store(false, Ordering::SeqCst);
    camera.until("be online after that", |state| state.online);
}

fn held() {
    let _bench = Bench::new();
    let first = online(&by_serial("Mono8"));
    // Another program is another handle on the same device.
    let second = Camera::start_for(&by_serial("Mono8"), size());
    second.until_fault("another program has it");
    assert!(first.state().online);
    drop(first);
    second.until("be online", |state| state.online);
}

fn slow() {
    let _bench = Bench::at(Speed::High);
    let camera = online(&by_serial("Mono8"));
    let noted = when(camera.state().notes, |notes| notes.iter().any(|note| note.contains("USB 3 port")));
    assert!(noted.is_ok(), "{noted:?}");
}
