//! Capture over Video4Linux2: a named thread that waits for frames with a bound and publishes the newest.
//!
//! On any error the stream is dropped and made anew, because the crate's stream is of no use after one: having timed
//! out once, every later wait fails. While the device is away its thread tries again at growing intervals, and the
//! state says why.

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use nix::time::{ClockId, clock_gettime};
use tokio::sync::watch;
use tokio::time::Instant;
use v4l::buffer::{Flags, Metadata, Type};
use v4l::io::mmap::Stream;
use v4l::io::traits::CaptureStream;
use v4l::video::Capture;
use v4l::video::capture::Parameters;
use v4l::{Device, Format, FourCC};

use super::exposure::{self, Stamp};
use super::unpack::{PixelFormat, frames_lost, unpack};
use crate::config::CameraConfig;
use crate::device::{AxisPose, CameraState, DeviceError, Frame, FrameSource};

/// Tells the poses of focus and e axis over an exposure, from its begin to its end.
pub type PoseSource = Arc<dyn Fn(Instant, Instant) -> (AxisPose, AxisPose) + Send + Sync>;

/// First and longest pause before a lost device is opened again.
const PAUSES: (Duration, Duration) = (Duration::from_millis(250), Duration::from_secs(5));
/// Buffers in the driver's queue.
const BUFFERS: u32 = 4;

/// A V4L2 capture device.
pub struct V4l2Camera {
    name: String,
    timeout: Duration,
    state: watch::Receiver<CameraState>,
    live: watch::Receiver<Option<Arc<Frame>>>,
    ended: Arc<AtomicBool>,
}

struct Capturer {
    config: CameraConfig,
    format: PixelFormat,
    size: (usize, usize),
    poses: PoseSource,
    state: watch::Sender<CameraState>,
    live: watch::Sender<Option<Arc<Frame>>>,
    ended: Arc<AtomicBool>,
    seq: u64,
}

impl V4l2Camera {
    /// Starts capturing frames of `size` (columns and rows) from the configured device. A device that is missing or
    /// unsuitable is not an error here: the state says so, and it is tried again.
    ///
    /// # Errors
    /// [`DeviceError::Refused`] for a pixel format that this program does not read, [`DeviceError::Disconnected`] when
    /// no thread can be started.
    pub fn start(config: &CameraConfig, size: (usize, usize), poses: PoseSource) -> Result<Self, DeviceError> {
        let name = config.device.display().to_string();
        let format = PixelFormat::from_code(&config.format).ok_or_else(|| DeviceError::Refused {
            device: name.clone(),
            reason: format!("frames in `{}` are not read; set `format` to GREY or YUYV", config.format),
        })?;
        let (state, state_out) = watch::channel(CameraState {
            driver: "v4l2".to_owned(),
            identity: String::new(),
            online: false,
            fault: Some("not opened yet".to_owned()),
            frames_lost: 0,
            size: None,
        });
        let (live, live_out) = watch::channel(None);
        let ended = Arc::new(AtomicBool::new(false));
        let capturer =
            Capturer { config: config.clone(), format, size, poses, state, live, ended: Arc::clone(&ended), seq: 0 };
        std::thread::Builder::new().name("camera".to_owned()).spawn(move || capturer.run()).map_err(|error| {
            DeviceError::Disconnected { device: name.clone(), reason: format!("no thread for it: {error}") }
        })?;
        Ok(Self { name, timeout: Duration::from_millis(config.timeout_ms), state: state_out, live: live_out, ended })
    }
}

impl Drop for V4l2Camera {
    fn drop(&mut self) {
        // The thread sees it after its present wait, which is bounded.
        self.ended.store(true, Ordering::Relaxed);
    }
}

#[async_trait]
impl FrameSource for V4l2Camera {
    fn state(&self) -> watch::Receiver<CameraState> {
        self.state.clone()
    }

    fn live(&self) -> watch::Receiver<Option<Arc<Frame>>> {
        self.live.clone()
    }

    fn newest(&self) -> Option<Arc<Frame>> {
        self.live.borrow().clone()
    }

    async fn frame(&self, not_before: Instant) -> Result<Arc<Frame>, DeviceError> {
        let mut live = self.live.clone();
        let fresh = live.wait_for(|frame| frame.as_ref().is_some_and(|frame| frame.exposed_from >= not_before));
        let waited = tokio::time::timeout_at(Instant::now().max(not_before) + self.timeout, fresh).await;
        if let Ok(Ok(frame)) = &waited
            && let Some(frame) = frame.as_ref()
        {
            return Ok(Arc::clone(frame));
        }
        drop(waited);
        let fault = self.state.borrow().fault.clone();
        Err(match fault {
            Some(reason) => DeviceError::Disconnected { device: self.name.clone(), reason },
            None => DeviceError::Timeout {
                device: self.name.clone(),
                what: "send a frame".to_owned(),
                allowed: self.timeout,
            },
        })
    }
}

impl Capturer {
    fn run(mut self) {
        let mut pause = PAUSES.0;
        while !self.ended.load(Ordering::Relaxed) {
            let before = self.seq;
            // The crate panics where a driver's answer or the end of a stream is unexpected; the camera is then lost
            // and opened anew like any other.
            let fault = match catch_unwind(AssertUnwindSafe(|| self.capture())) {
                Ok(Ok(())) => return,
                Ok(Err(fault)) => fault,
                Err(_) => "its driver answered something unexpected".to_owned(),
            };
            let changed = self.state.borrow().fault.as_ref() != Some(&fault);
            if changed {
                tracing::warn!(device = %self.config.device.display(), fault = %fault, "the camera is offline");
                self.state.send_modify(|state| {
                    state.online = false;
                    state.fault = Some(fault);
                });
            }
            pause = if self.seq > before { PAUSES.0 } else { (pause * 2).min(PAUSES.1) };
            self.sleep(pause);
        }
    }

    /// Sleeps in pieces, so that the end is not kept waiting.
    fn sleep(&self, pause: Duration) {
        let until = std::time::Instant::now() + pause;
        while !self.ended.load(Ordering::Relaxed) && std::time::Instant::now() < until {
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Opens the device and publishes frames until the end (`Ok`) or an error, in words.
    fn capture(&mut self) -> Result<(), String> {
        let path = self.config.device.display().to_string();
        let device = Device::with_path(&self.config.device).map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => format!("there is no {path}; connect the camera, or correct its `device`"),
            _ => format!("{path} cannot be opened: {error}"),
        })?;
        let identity = device.query_caps().map_err(|error| format!("{path} is no video device: {error}"))?.card;
        let stride = self.configure(&device)?;
        let interval = self.frame_interval(&device);
        let mut stream = Stream::with_buffers(&device, Type::VideoCapture, BUFFERS)
            .map_err(|error| format!("no buffers for frames: {error}"))?;
        stream.set_timeout(Duration::from_millis(self.config.timeout_ms.clamp(1, 60_000)));
        let mut last_sequence = None;
        while !self.ended.load(Ordering::Relaxed) {
            let (bytes, meta) = CaptureStream::next(&mut stream).map_err(|error| match error.kind() {
                io::ErrorKind::TimedOut => format!("no frame came within {} ms", self.config.timeout_ms),
                _ => format!("waiting for a frame failed: {error}"),
            })?;
            let lost = last_sequence.map_or(0, |last| frames_lost(last, meta.sequence));
            last_sequence = Some(meta.sequence);
            // A buffer marked as damaged is a frame lost.
            let damaged = meta.flags.contains(Flags::ERROR);
            self.seq += 1 + u64::from(lost);
            let used = match meta.bytesused as usize {
                0 => bytes.len(),
                used => used.min(bytes.len()),
            };
            let lost = u64::from(lost) + u64::from(damaged);
            if !damaged {
                let image = unpack(&bytes[..used], self.size.0, self.size.1, stride, self.format)
                    .map_err(|error| format!("a frame does not fit its format: {error}"))?;
                let frame = self.frame(image, meta, interval);
                self.live.send_replace(Some(Arc::new(frame)));
            }
            let size = self.size;
            self.state.send_if_modified(|state| {
                let changed = !state.online || lost > 0;
                state.online = true;
                state.fault = None;
                state.frames_lost += lost;
                state.size = Some(size);
                if changed {
                    state.identity.clone_from(&identity);
                }
                changed
            });
        }
        Ok(())
    }

    /// Sets format and size and returns the bytes a row; a device that delivers anything else is refused.
    fn configure(&self, device: &Device) -> Result<usize, String> {
        let (width, height) = self.size;
        let code = FourCC::new(self.format.code());
        // Made anew, with stride and size zero: a driver keeps an old stride that it is handed.
        let asked = Format::new(width as u32, height as u32, code);
        let got = device.set_format(&asked).map_err(|error| format!("the format cannot be set: {error}"))?;
        if got.fourcc != code || (got.width as usize, got.height as usize) != self.size {
            return Err(format!(
                "it delivers {}x{} {} instead of the configured {width}x{height} {code}",
                got.width, got.height, got.fourcc
            ));
        }
        Ok(got.stride as usize)
    }

    /// The time between frames: as the driver grants it, or as configured where it does not say.
    fn frame_interval(&self, device: &Device) -> Duration {
        let rate = self.config.frame_rate_hz.clamp(0.01, 1000.0);
        let granted = device
            .set_params(&Parameters::with_fps(rate.round().max(1.0) as u32))
            .ok()
            .map(|params| params.interval)
            .filter(|interval| interval.numerator > 0 && interval.denominator > 0);
        let seconds = granted.map_or(1.0 / rate, |i| f64::from(i.numerator) / f64::from(i.denominator));
        Duration::from_secs_f64(seconds.clamp(1e-4, 100.0))
    }

    fn frame(&self, image: crate::raw::RawImage, meta: &Metadata, interval: Duration) -> Frame {
        let arrived = Instant::now();
        let monotonic = meta.flags.contains(Flags::TIMESTAMP_MONOTONIC);
        let now_s = clock_gettime(ClockId::CLOCK_MONOTONIC).ok().map(|t| t.tv_sec() as f64 + t.tv_nsec() as f64 * 1e-9);
        let stamp = now_s.filter(|_| monotonic).map(|now_s| Stamp {
            age_s: now_s - (meta.timestamp.sec as f64 + meta.timestamp.usec as f64 * 1e-6),
            at_start: meta.flags.contains(Flags::TSTAMP_SRC_SOE),
        });
        let delay = Duration::from_millis(self.config.pipeline_delay_ms);
        let longest = Duration::from_millis(self.config.timeout_ms) + 4 * interval;
        let window = exposure::window(stamp, interval, delay, longest);
        let back = |age: Duration| arrived.checked_sub(age).unwrap_or(arrived);
        let (exposed_from, exposed_to) = (back(window.from_age), back(window.to_age));
        let (focus, e) = (self.poses)(exposed_from, exposed_to);
        let captured_at = jiff::Timestamp::now();
        Frame {
            image: Arc::new(image),
            seq: self.seq,
            exposed_from,
            exposed_to,
            exposure_assumed: window.assumed,
            captured_at: captured_at.checked_sub(window.to_age).unwrap_or(captured_at),
            focus,
            e,
            preview: false,
            simulated: false,
        }
    }
}

/// The poses of two stages over an exposure, from their states: settled when an axis has been at rest since `settle`
/// before the exposure began.
#[must_use]
pub fn poses_of_stages(
    focus: (watch::Receiver<crate::device::StageState>, Duration),
    e: (watch::Receiver<crate::device::StageState>, Duration),
) -> PoseSource {
    let pose = |(state, settle): &(watch::Receiver<crate::device::StageState>, Duration), from: Instant| {
        let state = state.borrow();
        AxisPose {
            position: (state.homed && state.connected).then_some(state.position),
            settled: state.at_rest_since.is_some_and(|since| since + *settle <= from),
        }
    };
    Arc::new(move |from, _to| (pose(&focus, from), pose(&e, from)))
}
