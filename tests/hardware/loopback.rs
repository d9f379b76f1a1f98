//! v4l2loopback: frames of known content and age, and a writer that goes away.

use std::io::Write as _;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU16, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use plenalign::raw::{PixelFormat, RawImage, Samples};
use v4l::video::Output as _;
use v4l::{Device, Format, FourCC};

use crate::Test;
use crate::bench::{Camera, LOOP, LOOP_EXCLUSIVE, SIZE, config, sample};
use crate::until::until_blocking;

pub(crate) const TESTS: &[Test] = &[
    ("loopback_y16_is_exact", y16),
    ("loopback_bayer_is_exact", bayer),
    ("loopback_frames_are_fresh", fresh),
    ("loopback_writer_goes_and_comes", writer_away),
    ("loopback_without_writer_is_no_camera", exclusive),
];

/// Writes frames into a loopback until it is dropped.
struct Writer {
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Writer {
    /// Writes what `frame` makes for each count, some twenty times a second.
    fn start(device: &str, format: &str, frame: impl Fn(u16) -> Vec<u8> + Send + 'static) -> Self {
        let code = FourCC::new(&PixelFormat::from_name(format).unwrap().fourcc());
        let format = Format::new(SIZE.0 as u32, SIZE.1 as u32, code);
        // It keeps the format of before until everybody has closed it, this writer too.
        let mut device = until_blocking(&format!("the loopback takes {code}"), || {
            let opened = Device::with_path(device).unwrap();
            (opened.set_format(&format).unwrap().fourcc == code).then_some(opened)
        });
        let end = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&end);
        let thread = std::thread::spawn(move || {
            let mut count = 0u16;
            while !ended.load(Ordering::Relaxed) {
                count = count.wrapping_add(1);
                device.write_all(&frame(count)).unwrap();
                std::thread::sleep(Duration::from_millis(50));
            }
        });
        Self { end, thread: Some(thread) }
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Samples that differ from their neighbours and use all 16 bits.
fn scrambled(index: usize) -> u16 {
    (index as u32).wrapping_mul(40_503) as u16
}

fn words(of: impl Fn(usize) -> u16) -> Vec<u8> {
    (0..SIZE.0 * SIZE.1).flat_map(|index| of(index).to_le_bytes()).collect()
}

fn y16() {
    let _writer = Writer::start(LOOP, "Y16", |_| words(scrambled));
    let camera = Camera::online(&config(LOOP, "Y16"));
    let frame = camera.frame();
    assert_eq!(frame.image.bits(), 16);
    let expected = (0..SIZE.0 * SIZE.1).map(scrambled).collect();
    assert_eq!(*frame.image, RawImage::from_u16(SIZE.0, SIZE.1, 16, expected));
}

fn bayer() {
    let _writer = Writer::start(LOOP, "RGGB", |_| (0..SIZE.0 * SIZE.1).map(|i| scrambled(i) as u8).collect());
    let camera = Camera::online(&config(LOOP, "RGGB"));
    let expected = (0..SIZE.0 * SIZE.1).map(|i| scrambled(i) as u8).collect();
    assert_eq!(camera.frame().image.samples(), &Samples::U8(expected));
}

/// The count that a frame carries, over the count that was written last when it was asked for: never less.
fn fresh() {
    let written = Arc::new(AtomicU16::new(0));
    let notes = Arc::clone(&written);
    let _writer = Writer::start(LOOP, "Y16", move |count| {
        notes.store(count, Ordering::Relaxed);
        words(|_| count)
    });
    let camera = Camera::online(&config(LOOP, "Y16"));
    for _ in 0..10 {
        // Every buffer of the queue is filled with frames of before.
        let begun = written.load(Ordering::Relaxed);
        until_blocking("eight are written", || written.load(Ordering::Relaxed) >= begun + 8);
        let before = written.load(Ordering::Relaxed);
        let frame = camera.frame();
        let count = sample(&frame.image, 5, 5);
        assert!(count > before, "frame {count} was written before it was asked for, when {before} was the last");
        assert!(count - before < 60, "frame {count} came long after {before}");
    }
    println!("{:?}", camera.state().notes);
}

fn writer_away() {
    let writer = Writer::start(LOOP, "GREY", |count| vec![count as u8; SIZE.0 * SIZE.1]);
    let camera = Camera::online(&config(LOOP, "GREY"));
    let before = camera.frame().seq;
    drop(writer);
    println!("{}", camera.until_fault("no good frame came within 3000 ms"));
    assert!(camera.camera.newest().is_none(), "a frame of before is shown");
    let _writer = Writer::start(LOOP, "GREY", |count| vec![count as u8; SIZE.0 * SIZE.1]);
    // A run that needs a frame now is not lost by it.
    let frame = camera.measured().expect("a camera that was here a moment ago is waited for");
    assert!(frame.seq > before);
}

fn exclusive() {
    let camera = Camera::start(&config(LOOP_EXCLUSIVE, "GREY"));
    println!("{}", camera.until_fault("captures no video now"));
    let _writer = Writer::start(LOOP_EXCLUSIVE, "GREY", |_| vec![50; SIZE.0 * SIZE.1]);
    camera.until("come online", |state| state.online);
    assert_eq!(sample(&camera.frame().image, 3, 3), 50);
}
