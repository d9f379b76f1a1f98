//! Every fault that vivid injects: seen, said, and got over.

use std::collections::HashSet;

use crate::Test;
use crate::bench::{Camera, WEBCAM, config, driver, set};
use crate::until::until_blocking;

pub(crate) const TESTS: &[Test] = &[
    ("fault_damaged_buffers_are_never_shown", damaged),
    ("fault_dropped_buffers_are_counted", dropped),
    ("fault_sequence_wraps", wrapped),
    ("fault_qbuf", || survives("inject_vidioc_qbuf_error")),
    ("fault_fatal_streaming_error", || survives("inject_fatal_streaming_error")),
    ("fault_reqbufs", || survives_at_start("inject_vidioc_reqbufs_error")),
    ("fault_streamon", || survives_at_start("inject_vidioc_streamon_error")),
    ("fault_disconnect", disconnected),
    ("fault_unbind_and_bind", unbound),
    ("fault_missing_at_start", missing),
];

/// A camera whose clock is honest, so that nothing but the fault is said.
fn webcam() -> Camera {
    set(WEBCAM, "timestamp_source", 1);
    Camera::online(&config(WEBCAM, "GREY"))
}

fn damaged() {
    let camera = webcam();
    let mut seen = HashSet::new();
    for round in 1..=5 {
        set(WEBCAM, "inject_v4l2_buf_flag_error", 1);
        camera.until("count the damaged frame", |state| state.frames_damaged >= round);
        seen.extend(camera.watch(3).iter().map(|frame| frame.seq));
    }
    let state = camera.state();
    assert!(state.online && state.frames_lost >= state.frames_damaged, "{state:?}");
    assert!(seen.len() >= 10, "{seen:?}");
}

fn dropped() {
    let camera = webcam();
    let before = camera.state().frames_lost;
    set(WEBCAM, "percentage_of_dropped_buffers", 60);
    let frames = camera.watch(30);
    set(WEBCAM, "percentage_of_dropped_buffers", 0);
    let lost = camera.state().frames_lost - before;
    assert!(lost >= 10, "{lost} lost of some 75");
    assert!(frames.windows(2).all(|pair| pair[0].seq < pair[1].seq));
    let span = frames[29].seq - frames[0].seq;
    assert!(span >= 29 + 10, "the numbers have no gaps: {span}");
    assert!(camera.state().online);
}

fn wrapped() {
    set(WEBCAM, "wrap_sequence_number", 1);
    let camera = webcam();
    let frames = camera.watch(200);
    set(WEBCAM, "wrap_sequence_number", 0);
    let (first, last) = (frames[0].seq, frames[199].seq);
    // It begins 128 before the wrap.
    assert!(last - first >= 199 && last - first < 2000, "from {first} to {last}");
    assert!(camera.state().frames_lost < 1000, "{:?}", camera.state());
}

/// A fault in the middle of the stream: it is opened anew, and says why meanwhile.
fn survives(control: &str) {
    let camera = webcam();
    let before = camera.frame().seq;
    set(WEBCAM, control, 1);
    let fault = camera.until_fault("");
    println!("{control}: {fault}");
    assert!(camera.camera.newest().is_none(), "a frame of before is shown");
    camera.until("come back", |state| state.online);
    assert!(camera.frame().seq > before);
}

/// A fault at the start of the stream, once.
fn survives_at_start(control: &str) {
    drop(webcam());
    let open = || std::fs::read_dir("/proc/self/fd").unwrap().flatten().filter_map(|file| file.path().read_link().ok());
    until_blocking("it is closed", || !open().any(|file| file == std::path::Path::new(WEBCAM)));
    set(WEBCAM, control, 1);
    let camera = Camera::start(&config(WEBCAM, "GREY"));
    println!("{control}: {}", camera.until_fault("its stream does not start"));
    camera.until("come online", |state| state.online);
    camera.frame();
}

fn disconnected() {
    let camera = webcam();
    set(WEBCAM, "disconnect", 1);
    camera.until_fault("it is gone");
    assert!(camera.camera.newest().is_none());
    camera.until("come back", |state| state.online);
    camera.frame();
}

fn unbound() {
    let camera = webcam();
    let before = camera.frame().seq;
    driver("unbind");
    camera.until_fault("there is no /dev/video10; connect the camera");
    assert!(camera.camera.newest().is_none());
    assert!(!std::path::Path::new(WEBCAM).exists());
    driver("bind");
    camera.until("come back", |state| state.online);
    assert!(camera.frame().seq > before);
}

fn missing() {
    let camera = Camera::start(&config("/dev/video99", "GREY"));
    camera.until_fault("there is no /dev/video99");
    let error = camera.measured().unwrap_err().to_string();
    assert!(error.contains("/dev/video99 is not connected: there is no"), "{error}");
}
