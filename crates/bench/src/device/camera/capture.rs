//! Taking frames off the queue of a V4L2 device.

use std::io;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use nix::time::{ClockId, clock_gettime};
use v4l::Device;
use v4l::buffer::Flags;

use super::controls::KeptControls;
use super::exposure::{self, Clock, Stamp, Window};
use super::feed::{Capture, Count, Judge, News, Outlet};
use super::kernel::{Filled, Queue, Taken};
use super::setup::{self, Agreed};
use super::unpack::{UnpackError, frames_lost, unpack};
use super::{controls, find};
use crate::config::CameraConfig;
use plenoptics::raw::PixelFormat;

/// Buffers in the driver's queue: enough that one is always free while the newest is read.
const BUFFERS: u32 = 4;
/// The end of the camera is looked for this often.
const SLICE: Duration = Duration::from_millis(200);

/// What the capture thread works with.
pub(super) struct Capturer {
    pub(super) config: CameraConfig,
    pub(super) set_by_hand: Arc<KeptControls>,
    pub(super) format: PixelFormat,
    pub(super) outlet: Outlet,
}

/// What is known of the stream since it began.
struct Stream {
    agreed: Agreed,
    clock: Clock,
    last_sequence: Option<u32>,
    /// Time and driver's count of the last frame, for the interval that frames really have.
    last: Option<(f64, u32)>,
    judge: Judge,
    good_at: Instant,
    /// Why the last frame was not good.
    damage: Option<String>,
}

impl Capturer {
    /// The configuration with what was set by hand since: a camera that was without power has forgotten it.
    fn as_set_by_hand(&self) -> CameraConfig {
        let set = self.set_by_hand.lock().unwrap_or_else(PoisonError::into_inner);
        let mut config = self.config.clone();
        config.controls.retain(|name, _| !set.contains_key(&controls::key_of(name)));
        config.controls.extend(set.iter().map(|(key, value)| (key.clone(), value.clone())));
        config
    }

    /// A stream begins, of which this was agreed.
    fn begin(&self, agreed: Agreed) -> Stream {
        self.outlet.pace(agreed.interval);
        Stream {
            agreed,
            clock: Clock::default(),
            last_sequence: None,
            last: None,
            judge: Judge::default(),
            good_at: Instant::now(),
            damage: None,
        }
    }

    /// Publishes the newest good frame of what was taken.
    ///
    /// # Errors
    /// What no later frame will mend.
    fn see(&mut self, device: &Device, stream: &mut Stream, taken: &Taken<'_>) -> Result<Count, String> {
        let mut count = Count::default();
        let mut newest_seq = self.outlet.seq;
        for (index, buffer) in taken.filled.iter().enumerate() {
            let lost =
                stream.last_sequence.replace(buffer.sequence).map_or(0, |last| frames_lost(last, buffer.sequence));
            self.outlet.seq += 1 + u64::from(lost);
            count.lost += u64::from(lost);
            if buffer.is_damaged() {
                count.damaged += 1;
                stream.damage = Some("its driver marked it so".to_owned());
            }
            if index == taken.newest {
                newest_seq = self.outlet.seq;
            }
        }
        let Some(newest) = taken.filled.get(taken.newest).filter(|buffer| !buffer.is_damaged()) else {
            return Ok(count);
        };
        let (width, height) = self.outlet.size();
        match unpack(taken.bytes, width, height, stream.agreed.stride, self.format) {
            Ok(image) => {
                let dated_at = tokio::time::Instant::now();
                let (image, window) = (Arc::new(image), self.window(stream, newest, taken.arrived_after));
                stream.good_at = Instant::now();
                stream.damage = None;
                self.outlet.publish(Arc::clone(&image), newest_seq, (window, dated_at));
                stream.judge.see(&image, stream.agreed.white, || controls::of_brightness(device));
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

    fn tell(&self, stream: &Stream, count: Count) {
        let said = stream.clock.complaint().into_iter().chain(stream.judge.note());
        self.outlet.tell(News {
            good: stream.damage.is_none(),
            identity: &stream.agreed.identity,
            white: stream.agreed.white,
            notes: stream.agreed.notes.iter().cloned().chain(said).collect(),
            count,
        });
    }

    /// When a buffer's frame was exposed.
    fn window(&self, stream: &mut Stream, of: &Filled, arrived_after: Instant) -> Window {
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
        self.outlet.pace(interval);
        let delay = Duration::from_millis(self.config.pipeline_delay_ms);
        exposure::window(believed, arrived_after.elapsed(), interval, delay)
    }
}

impl Capture for Capturer {
    fn outlet(&self) -> &Outlet {
        &self.outlet
    }

    fn capture(&mut self) -> Result<(), String> {
        let path = find::resolve(&self.config.device)?;
        let device = find::open(&path)?;
        let agreed = setup::agree(&device, &self.as_set_by_hand(), self.format, self.outlet.size())?;
        let mut queue =
            Queue::start(&device, BUFFERS).map_err(|error| format!("its stream does not start: {error}"))?;
        let mut stream = self.begin(agreed);
        let timeout = Duration::from_millis(self.config.timeout_ms);
        while !self.outlet.has_ended() {
            let left = timeout.saturating_sub(stream.good_at.elapsed());
            if left.is_zero() {
                let why = stream.damage.map_or_else(String::new, |why| format!("; the last one was damaged: {why}"));
                return Err(format!("no good frame came within {} ms{why}", timeout.as_millis()));
            }
            if queue.wait(left.min(SLICE)).map_err(lost)? {
                let taken = queue.take(|taken| self.see(&device, &mut stream, taken)).map_err(lost)?;
                match taken {
                    Some(count) => self.tell(&stream, count?),
                    // Ready and nothing there: an error that the driver will tell in a moment.
                    None => std::thread::sleep(Duration::from_millis(5)),
                }
            }
        }
        Ok(())
    }
}

impl Stream {
    /// The time a frame has taken since the last one; zero where that cannot be told.
    fn interval_since_last(&mut self, at_s: f64, sequence: u32) -> Duration {
        let Some((last_s, last_sequence)) = self.last.replace((at_s, sequence)) else { return Duration::ZERO };
        let frames = f64::from(frames_lost(last_sequence, sequence)) + 1.0;
        Duration::try_from_secs_f64((at_s - last_s) / frames).unwrap_or_default()
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

#[cfg(test)]
mod tests {
    use super::super::feed;
    use super::*;
    use crate::device::{AxisPose, CameraState};

    /// What is set is in force after some frames, and a frame is waited for as long as some take.
    #[test]
    fn users_are_told_the_interval_that_was_granted_and_that_frames_have() {
        let config = CameraConfig { frame_rate_hz: 100.0, format: "GREY".to_owned(), ..CameraConfig::default() };
        let unknown = AxisPose { position: None, settled: false };
        let state = CameraState::not_yet("v4l2", "not opened yet");
        let (feed, outlet) = feed::feed(&config, (4, 4), Arc::new(move |_, _| (unknown, unknown)), state);
        assert_eq!(feed.interval(), Duration::from_millis(10), "as configured, before the camera is asked");
        let format = PixelFormat::from_name("GREY").unwrap();
        let capturer = Capturer { config, set_by_hand: Arc::default(), format, outlet };
        let interval = Duration::from_millis(40);
        let agreed = Agreed { identity: String::new(), stride: 4, interval, white: 255, notes: Vec::new() };
        let mut stream = capturer.begin(agreed);
        assert_eq!(feed.interval(), interval, "as granted");
        let now_s = monotonic_now().unwrap();
        let monotonic = u32::from(Flags::TIMESTAMP_MONOTONIC);
        let mut taken = |before_s: f64, sequence| {
            capturer.window(&mut stream, &Filled::of(monotonic, now_s - before_s, sequence), Instant::now());
            feed.interval()
        };
        assert_eq!(taken(0.9, 1), interval, "as granted, until two frames have come");
        // One was lost between.
        let slow = taken(0.4, 3).as_secs_f64();
        assert!((slow - 0.25).abs() < 1e-6, "{slow} s");
        assert_eq!(taken(0.39, 4), interval);
    }
}
