//! The capture thread: opens the camera, takes frames off its queue and publishes the newest, and begins anew after
//! whatever goes wrong.

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use nix::time::{ClockId, clock_gettime};
use tokio::sync::watch;
use v4l::Device;
use v4l::buffer::Flags;

use super::brightness::{self, Exposure};
use super::controls::KeptControls;
use super::exposure::{self, Clock, Stamp};
use super::kernel::{Filled, Queue, Taken};
use super::setup::{self, Agreed};
use super::unpack::{UnpackError, frames_lost, unpack};
use super::v4l2::PoseSource;
use super::{controls, find};
use crate::config::CameraConfig;
use crate::device::{CameraState, Frame};
use plenoptics::raw::{PixelFormat, RawImage};

/// First and longest pause before a lost device is opened again.
const PAUSES: (Duration, Duration) = (Duration::from_millis(250), Duration::from_secs(5));
/// Buffers in the driver's queue: enough that one is always free while the newest is read.
const BUFFERS: u32 = 4;
/// The end of the camera is looked for this often.
const SLICE: Duration = Duration::from_millis(200);
/// How often a frame's exposure is judged.
const JUDGE_EVERY: Duration = Duration::from_secs(1);

/// What the capture thread works with.
pub(super) struct Capturer {
    pub(super) config: CameraConfig,
    pub(super) set_by_hand: Arc<KeptControls>,
    pub(super) format: PixelFormat,
    pub(super) size: (usize, usize),
    pub(super) poses: PoseSource,
    pub(super) state: watch::Sender<CameraState>,
    pub(super) live: watch::Sender<Option<Arc<Frame>>>,
    /// When a frame last came.
    pub(super) seen_at: watch::Sender<Option<tokio::time::Instant>>,
    pub(super) ended: Arc<AtomicBool>,
    pub(super) seq: u64,
}

/// What is known of the stream since it began.
struct Stream {
    agreed: Agreed,
    clock: Clock,
    last_sequence: Option<u32>,
    /// Time and driver's count of the last frame, for the interval that frames really have.
    last: Option<(f64, u32)>,
    exposure: Exposure,
    judged_at: Option<Instant>,
    exposure_note: Option<String>,
    good_at: Instant,
    /// Why the last frame was not good.
    damage: Option<String>,
}

/// What came of what was taken off the queue.
#[derive(Default)]
struct Count {
    lost: u64,
    damaged: u64,
}

impl Capturer {
    /// Runs until the camera is dropped.
    pub(super) fn run(mut self) {
        let mut pause = PAUSES.0;
        while !self.ended.load(Ordering::Relaxed) {
            let before = self.seq;
            // The crate panics where the end of a device is unexpected; the camera is then lost and opened anew like any
            // other.
            let fault = match catch_unwind(AssertUnwindSafe(|| self.capture())) {
                Ok(Ok(())) => return,
                Ok(Err(fault)) => fault,
                Err(_) => "its driver answered something unexpected".to_owned(),
            };
            self.go_offline(fault);
            pause = if self.seq > before { PAUSES.0 } else { (pause * 2).min(PAUSES.1) };
            self.sleep(pause);
        }
    }

    fn go_offline(&self, fault: String) {
        // What was seen last is no picture of now.
        self.live.send_replace(None);
        let news = self.state.send_if_modified(|state| {
            let news = state.fault.as_ref() != Some(&fault);
            (state.online, state.fault) = (false, Some(fault.clone()));
            state.notes.clear();
            news
        });
        if news {
            tracing::warn!(device = %self.config.device, fault = %fault, "the camera is offline");
        }
    }

    /// Sleeps in pieces, so that the end is not kept waiting.
    fn sleep(&self, pause: Duration) {
        let until = Instant::now() + pause;
        while !self.ended.load(Ordering::Relaxed) && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// The configuration with what was set by hand since: a camera that was without power has forgotten it.
    fn as_set_by_hand(&self) -> CameraConfig {
        let set = self.set_by_hand.lock().unwrap_or_else(PoisonError::into_inner);
        let mut config = self.config.clone();
        config.controls.retain(|name, _| !set.contains_key(&controls::key_of(name)));
        config.controls.extend(set.iter().map(|(key, value)| (key.clone(), value.clone())));
        config
    }

    /// Opens the device and publishes frames until the end (`Ok`) or an error, in words.
    fn capture(&mut self) -> Result<(), String> {
        let path = find::resolve(&self.config.device)?;
        let device = find::open(&path)?;
        let agreed = setup::agree(&device, &self.as_set_by_hand(), self.format, self.size)?;
        let mut queue =
            Queue::start(&device, BUFFERS).map_err(|error| format!("its stream does not start: {error}"))?;
        let mut stream = Stream {
            agreed,
            clock: Clock::default(),
            last_sequence: None,
            last: None,
            exposure: Exposure::Good,
            judged_at: None,
            exposure_note: None,
            good_at: Instant::now(),
            damage: None,
        };
        let timeout = Duration::from_millis(self.config.timeout_ms);
        while !self.ended.load(Ordering::Relaxed) {
            let left = timeout.saturating_sub(stream.good_at.elapsed());
            if left.is_zero() {
                let why = stream.damage.map_or_else(String::new, |why| format!("; the last one was damaged: {why}"));
                return Err(format!("no good frame came within {} ms{why}", timeout.as_millis()));
            }
            if queue.wait(left.min(SLICE)).map_err(lost)? {
                let taken = queue.take(|taken| self.see(&device, &mut stream, taken)).map_err(lost)?;
                match taken {
                    Some(count) => self.tell(&stream, &count?),
                    // Ready and nothing there: an error that the driver will tell in a moment.
                    None => std::thread::sleep(Duration::from_millis(5)),
                }
            }
        }
        Ok(())
    }

    /// Publishes the newest good frame of what was taken.
    ///
    /// # Errors
    /// What no later frame will mend.
    fn see(&mut self, device: &Device, stream: &mut Stream, taken: &Taken<'_>) -> Result<Count, String> {
        let mut count = Count::default();
        let mut newest_seq = self.seq;
        for (index, buffer) in taken.filled.iter().enumerate() {
            let lost =
                stream.last_sequence.replace(buffer.sequence).map_or(0, |last| frames_lost(last, buffer.sequence));
            self.seq += 1 + u64::from(lost);
            count.lost += u64::from(lost);
            if buffer.is_damaged() {
                count.damaged += 1;
                stream.damage = Some("its driver marked it so".to_owned());
            }
            if index == taken.newest {
                newest_seq = self.seq;
            }
        }
        let Some(newest) = taken.filled.get(taken.newest).filter(|buffer| !buffer.is_damaged()) else {
            return Ok(count);
        };
        match unpack(taken.bytes, self.size.0, self.size.1, stream.agreed.stride, self.format) {
            Ok(image) => {
                let frame = self.frame(stream, image, newest, newest_seq, taken.arrived_after);
                stream.good_at = Instant::now();
                stream.damage = None;
                let image = Arc::clone(&frame.image);
                self.live.send_replace(Some(Arc::new(frame)));
                self.seen_at.send_replace(Some(tokio::time::Instant::now()));
                stream.judge(device, &image);
            }
            Err(error @ (UnpackError::Stride { .. } | UnpackError::Depth { .. })) => {
                return Err(format!("its frames are not what {} says: {error}", self.format.name()));
            }
            Err(error) => {
                count.damaged += 1;
                stream.damage = Some(error.to_string());
            }
        }
        Ok(count)
    }

    fn tell(&self, stream: &Stream, count: &Count) {
        let good = stream.damage.is_none();
        let notes: Vec<String> =
            [&stream.agreed.notes[..], &stream.clock.complaint().into_iter().collect::<Vec<_>>()[..]]
                .concat()
                .into_iter()
                .chain(stream.exposure_note.clone())
                .collect();
        self.state.send_if_modified(|state| {
            let lost = count.lost + count.damaged;
            let back = good && (!state.online || state.fault.is_some());
            let changed = back || lost > 0 || state.notes != notes;
            if back {
                tracing::info!(device = %self.config.device, camera = %stream.agreed.identity, "the camera is online");
                (state.online, state.fault) = (true, None);
                state.identity.clone_from(&stream.agreed.identity);
                (state.size, state.white) = (Some(self.size), Some(stream.agreed.white));
            }
            state.frames_lost += lost;
            state.frames_damaged += count.damaged;
            state.notes = notes;
            changed
        });
    }

    fn frame(&self, stream: &mut Stream, image: RawImage, of: &Filled, seq: u64, arrived_after: Instant) -> Frame {
        let now = tokio::time::Instant::now();
        let flags = Flags::from(of.flags);
        let now_s = monotonic_now().unwrap_or(f64::NAN);
        let stamp = Stamp {
            at_s: flags.contains(Flags::TIMESTAMP_MONOTONIC).then_some(of.at_s),
            now_s,
            at_start: flags.contains(Flags::TSTAMP_SRC_SOE),
        };
        let longest = Duration::from_millis(self.config.timeout_ms) + 4 * stream.agreed.interval;
        let believed = stream.clock.judge(stamp, longest);
        // A camera may well be slower than its driver says: then its exposures may be longer, too.
        let at_s = if believed.is_some() { of.at_s } else { now_s };
        let interval = stream.agreed.interval.max(stream.interval_since_last(at_s, of.sequence));
        let delay = Duration::from_millis(self.config.pipeline_delay_ms);
        let window = exposure::window(believed, arrived_after.elapsed(), interval, delay);
        let back = |age: Duration| now.checked_sub(age).unwrap_or(now);
        let (exposed_from, exposed_to) = (back(window.from_age), back(window.to_age));
        let (focus, e) = (self.poses)(exposed_from, exposed_to);
        let captured_at = jiff::Timestamp::now();
        Frame {
            image: Arc::new(image),
            seq,
            exposed_from,
            exposed_to,
            exposure_assumed: window.assumed,
            captured_at: captured_at.checked_sub(window.to_age).unwrap_or(captured_at),
            focus,
            e,
            preview: false,
            simulated: false,
            replayed: false,
        }
    }
}

impl Stream {
    /// The time a frame has taken since the last one; zero where that cannot be told.
    fn interval_since_last(&mut self, at_s: f64, sequence: u32) -> Duration {
        let Some((last_s, last_sequence)) = self.last.replace((at_s, sequence)) else { return Duration::ZERO };
        let frames = f64::from(frames_lost(last_sequence, sequence)) + 1.0;
        Duration::try_from_secs_f64((at_s - last_s) / frames).unwrap_or_default()
    }

    /// Judges a frame's exposure now and then.
    fn judge(&mut self, device: &Device, image: &RawImage) {
        if self.judged_at.is_some_and(|at| at.elapsed() < JUDGE_EVERY) {
            return;
        }
        self.judged_at = Some(Instant::now());
        let exposure = brightness::judge(image, self.agreed.white);
        if !exposure.is_like(self.exposure) {
            self.exposure = exposure;
            let controls = if exposure == Exposure::Good { String::new() } else { controls::of_brightness(device) };
            self.exposure_note = exposure.note(&controls);
        }
    }
}

/// What an error of the queue means.
fn lost(error: io::Error) -> String {
    match error.raw_os_error() {
        Some(nix::libc::ENODEV) => "it is gone: unplugged, or let go by its driver".to_owned(),
        Some(nix::libc::EIO) => "its driver gave up: an input or output error".to_owned(),
        _ => format!("waiting for a frame failed: {error}"),
    }
}

fn monotonic_now() -> Option<f64> {
    clock_gettime(ClockId::CLOCK_MONOTONIC).ok().map(|t| t.tv_sec() as f64 + t.tv_nsec() as f64 * 1e-9)
}
