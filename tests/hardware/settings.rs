//! What is configured reaches the camera, and what cannot be is refused with the choices.

use plenalign::config::{CameraConfig, ControlValue};
use plenalign::device::camera::find;
use plenalign::device::light::{ControlName, ControlUnit};

use crate::Test;
use crate::bench::{BLACK, Camera, GRABBER, LOOP, WEBCAM, WHITE, config, driver, get, sample, set, show, v4l2_ctl};

pub(crate) const TESTS: &[Test] = &[
    ("controls_are_set_and_automatics_off", controls),
    ("controls_that_cannot_be_are_refused", refused_controls),
    ("size_that_is_not_offered_is_refused", refused_size),
    ("rate_that_is_not_granted_is_said", rate),
    ("region_is_cropped", cropped),
    ("scaling_is_said", scaled),
    ("exposure_is_judged", exposure),
    ("gain_is_set_by_hand_and_again_after_a_loss", by_hand),
    ("cameras_are_found_by_card", found),
    ("cameras_are_listed_on_the_command_line", listed),
    ("clock_in_the_future_is_not_believed", clock),
    ("clock_that_wraps_is_not_believed", wrapping_clock),
];

fn with(name: &str, value: ControlValue) -> CameraConfig {
    let mut config = config(WEBCAM, "GREY");
    config.controls.insert(name.to_owned(), value);
    config
}

fn controls() {
    set(WEBCAM, "gain_automatic", 1);
    let mut wanted = with("Gain", ControlValue::Number(77));
    wanted.controls.insert("menu".to_owned(), ControlValue::Item("Menu Item 4".to_owned()));
    wanted.controls.insert("integer_64_bits".to_owned(), ControlValue::Number(-9_000_000_000));
    wanted.controls.insert("boolean".to_owned(), ControlValue::Switch(false));
    let camera = Camera::online(&wanted);
    assert_eq!(get(WEBCAM, "gain_automatic"), 0);
    assert_eq!(get(WEBCAM, "gain"), 77);
    assert_eq!(get(WEBCAM, "integer_64_bits"), -9_000_000_000);
    assert_eq!(get(WEBCAM, "boolean"), 0);
    assert!(v4l2_ctl(&["-d", WEBCAM, "-C", "menu"]).contains('4'));
    assert!(!camera.state().notes.iter().any(|note| note.contains("gain")), "{:?}", camera.state());
    drop(camera);
    // Configured, an automatic stays on.
    let camera = Camera::online(&with("gain_automatic", ControlValue::Switch(true)));
    assert_eq!(get(WEBCAM, "gain_automatic"), 1);
    drop(camera);
}

fn by_hand() {
    let camera = Camera::online(&config(WEBCAM, "GREY"));
    let told = camera.controls();
    let [gain] = &told[..] else { panic!("vivid has a gain and no exposure: {told:?}") };
    assert_eq!((gain.name, gain.unit, gain.key.as_str()), (ControlName::Gain, ControlUnit::Driver, "gain"));
    assert_eq!((gain.minimum, gain.maximum, gain.step), (0.0, 255.0, 1.0));
    assert_eq!((gain.automatic, &gain.locked), (false, &None));
    camera.set_control(ControlName::Gain, 77.0).unwrap();
    assert_eq!((get(WEBCAM, "gain"), camera.controls()[0].value), (77, Some(77.0)));
    let refused = camera.set_control(ControlName::Exposure, 10.0).unwrap_err().to_string();
    assert!(refused.contains("no control of its exposure"), "{refused}");
    // Bound anew the driver begins with its defaults.
    driver("unbind");
    camera.until_fault("there is no /dev/video10");
    driver("bind");
    camera.until("come back", |state| state.online);
    assert_eq!(get(WEBCAM, "gain"), 77);
    // What it adjusts by itself by now is not set by hand.
    set(WEBCAM, "gain_automatic", 1);
    let refused = camera.set_control(ControlName::Gain, 78.0).unwrap_err().to_string();
    assert!(refused.contains("adjusts it by itself: `gain_automatic` is"), "{refused}");
    assert!(camera.controls()[0].automatic);
}

fn refused_controls() {
    for (name, value, words) in [
        ("gian", ControlValue::Number(1), "no control `gian`"),
        ("gain", ControlValue::Number(256), "`gain` cannot be 256: it takes 0 to 255"),
        ("gain", ControlValue::Item("high".to_owned()), "0 to 255"),
        ("menu", ControlValue::Number(2), "1 \"Menu Item 1\", 3 \"Menu Item 3\", 4 \"Menu Item 4\""),
        ("bitmask", ControlValue::Number(1), "0x0 to 0x"),
        ("read_only_integer_32_bits", ControlValue::Number(1), "cannot be set"),
    ] {
        let camera = Camera::start(&with(name, value));
        let fault = camera.until_fault(words);
        println!("{fault}");
        assert!(camera.camera.newest().is_none());
    }
}

fn refused_size() {
    let camera = Camera::start_for(&config(WEBCAM, "GREY"), (648, 486));
    let fault = camera.until_fault("instead of the configured 648x486 GREY");
    assert!(fault.contains("GREY 320x180 640x360"), "{fault}");
}

fn rate() {
    let camera = Camera::online(&CameraConfig { frame_rate_hz: 1000.0, ..config(WEBCAM, "GREY") });
    camera.until("say so", |state| state.notes.iter().any(|note| note.contains("1000 frames a second were asked for")));
}

fn cropped() {
    show(GRABBER, 20);
    let grabber =
        |left, top| CameraConfig { crop_left_px: Some(left), crop_top_px: Some(top), ..config(GRABBER, "Y12") };
    let camera = Camera::online(&grabber(200, 100));
    let selection = v4l2_ctl(&["-d", GRABBER, "--get-selection", "target=crop"]);
    assert!(selection.contains("Left 200, Top 100, Width 640, Height 360"), "{selection}");
    // The ramp of the left edge, and further on: the picture is the region's and no other's.
    let at = |camera: &Camera| sample(&camera.frame().image, 0, 180);
    let here = at(&camera);
    drop(camera);
    let further = at(&Camera::online(&grabber(600, 100)));
    assert!(here != further, "the ramp is {here} at column 200 and {further} at column 600");
    let camera = Camera::start(&grabber(700, 100));
    println!("{}", camera.until_fault("crop_left_px"));
}

fn scaled() {
    v4l2_ctl(&["-d", GRABBER, "--set-selection", "target=crop,left=0,top=0,width=1280,height=720"]);
    let camera = Camera::online(&config(GRABBER, "GREY"));
    camera.until("say that it scales", |state| state.notes.iter().any(|note| note.contains("scales a region")));
}

fn exposure() {
    show(WEBCAM, WHITE);
    let camera = Camera::online(&config(WEBCAM, "Y16"));
    let has = |words: &'static str| {
        move |state: &plenalign::device::CameraState| state.notes.iter().any(|note| note.contains(words))
    };
    let state = camera.until("say that it is saturated", has("100.0 % of the pixels are saturated: lower `gain` (now"));
    println!("{:?}", state.notes);
    show(WEBCAM, BLACK);
    camera.until("say that it is dark", has("the picture is dark"));
    show(WEBCAM, 0);
    camera.until("be content", |state| !has("saturated")(state) && !has("dark")(state));
}

fn found() {
    let nodes = find::nodes();
    let webcam = nodes.iter().find(|node| node.path.as_os_str() == WEBCAM).unwrap();
    assert_eq!((webcam.driver.as_str(), webcam.unusable.as_deref()), ("vivid", None), "{webcam:?}");
    assert_eq!(find::resolve("card:Loop A").unwrap().as_os_str(), LOOP);
    let missing = find::resolve("card:Loop Z").unwrap_err();
    assert!(missing.contains("/dev/video20 (card:Loop A)"), "{missing}");
    assert!(find::resolve("usb:1234").unwrap_err().contains("no camera is"));
    let camera = Camera::start(&config("card:Loop Z", "GREY"));
    camera.until_fault("no camera is \"card:Loop Z\"");
}

fn listed() {
    let plenalign = |arguments: &[&str]| {
        let done = std::process::Command::new("/mnt/host/plenalign").args(arguments).output().unwrap();
        let (out, error) = (String::from_utf8(done.stdout).unwrap(), String::from_utf8(done.stderr).unwrap());
        (done.status.success(), out, error)
    };
    let json = |arguments: &[&str]| -> serde_json::Value {
        let (ok, out, error) = plenalign(arguments);
        assert!(ok, "{arguments:?}: {error}");
        serde_json::from_str(&out).unwrap()
    };
    let cameras = json(&["camera", "list", "--json"])["cameras"].as_array().unwrap().clone();
    let webcam = cameras.iter().find(|camera| camera["path"] == WEBCAM).unwrap();
    let formats = webcam["formats"].as_array().unwrap();
    assert!(formats.iter().any(|format| format["format"] == "Y12" && format["readable"] == true), "{webcam}");
    let (_, text, _) = plenalign(&["camera", "list"]);
    assert!(text.contains("  device = \"card:Loop A\"") && text.contains("  format = \"Y12\""), "{text}");
    assert!(text.lines().any(|line| line.starts_with("    640x360  ")), "{text}");
    // Only listing changes nothing; applying sets what is configured.
    set(WEBCAM, "gain", 3);
    let controls = json(&["camera", "controls", WEBCAM, "--json"])["controls"].as_array().unwrap().clone();
    let gain = controls.iter().find(|control| control["key"] == "gain").unwrap();
    assert_eq!((&gain["minimum"], &gain["maximum"]), (&0.into(), &255.into()));
    let setting = ["--set", "bench.camera.controls.gain=91", "camera", "controls", WEBCAM, "--apply"];
    let (ok, text, error) = plenalign(&setting);
    assert!(
        ok && text.lines().any(|line| line.trim_start().starts_with("gain ") && line.contains("= 91 ")),
        "{text}{error}"
    );
    assert_eq!(get(WEBCAM, "gain"), 91);
    let (ok, _, error) =
        plenalign(&["--set", "bench.camera.controls.gain=900", "camera", "controls", WEBCAM, "--apply"]);
    assert!(!ok && error.contains("`gain` cannot be 900: it takes 0 to 255"), "{error}");
    let (ok, _, error) = plenalign(&["camera", "controls", "card:Loop Z"]);
    assert!(!ok && error.contains("no camera is") && error.lines().count() == 1, "{error}");
}

fn clock() {
    set(WEBCAM, "timestamp_source", 0);
    let camera = Camera::online(&config(WEBCAM, "GREY"));
    camera.until("doubt the clock", |state| state.notes.iter().any(|note| note.contains("lie in the future")));
    let frame = camera.frame();
    assert!(frame.exposure_assumed && frame.exposed_to <= tokio::time::Instant::now());
    drop(camera);
    set(WEBCAM, "timestamp_source", 1);
    let camera = Camera::online(&config(WEBCAM, "GREY"));
    let frames = camera.watch(20);
    assert!(frames.iter().all(|frame| !frame.exposure_assumed), "{:?}", camera.state().notes);
    assert!(frames.windows(2).all(|pair| pair[0].exposed_from < pair[1].exposed_from));
}

fn wrapping_clock() {
    set(WEBCAM, "timestamp_source", 1);
    set(WEBCAM, "wrap_timestamp", 1);
    let camera = Camera::online(&config(WEBCAM, "GREY"));
    camera.until("doubt the clock", |state| state.notes.iter().any(|note| note.contains("timestamps")));
    assert!(camera.frame().exposure_assumed);
    drop(camera);
    set(WEBCAM, "wrap_timestamp", 0);
}
