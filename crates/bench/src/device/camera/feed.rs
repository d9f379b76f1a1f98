//! What the drivers of cameras share: the thread that takes frames and begins anew after whatever goes wrong, and the
//! frame source in front of it.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use tokio::sync::watch;
use tokio::time::Instant;

use super::brightness::{self, Exposure};
use super::exposure::Window;
use super::poses::PoseSource;
use crate::config::CameraConfig;
use crate::device::light::{ControlName, ControlUnit, LightControl};
use crate::device::{CameraState, DeviceError, Frame, FrameSource};
use plenoptics::raw::RawImage;

/// How long a driver may take to tell or to set its camera's controls.
pub(super) const CONTROLS_ALLOWED: Duration = Duration::from_secs(5);
/// A camera that sent frames is waited for this long after the last one: a plug pushed back in does not cost a run.
const RETURN_ALLOWED: Duration = Duration::from_secs(30);
/// A driver may take so long to find out that a camera is lost which sends nothing any more: one on a network is asked, and
/// asked again where it does not answer.
const VERDICT_ALLOWED: Duration = Duration::from_secs(6);
/// Frames that may have been under way, or already exposed, when a control was set: it is in force from the next one on.
const FRAMES_UNDER_WAY: u32 = 3;
/// First and longest pause before a lost device is opened again.
const PAUSES: (Duration, Duration) = (Duration::from_millis(250), Duration::from_secs(5));
/// How long a driver may take to let its camera go.
const END_ALLOWED: Duration = Duration::from_secs(1);
/// How often a frame's exposure is judged.
const JUDGE_EVERY: Duration = Duration::from_secs(1);

/// A driver's frames as its users have them.
pub struct Feed {
    pub(super) name: String,
    /// Longest wait for a frame.
    timeout: Duration,
    /// The time between frames, ns: as configured, or as the camera has it where its driver says so.
    interval_ns: Arc<AtomicU64>,
    /// How long before it came a frame may have been exposed, ns: of the newest.
    age_ns: Arc<AtomicU64>,
    pipeline_delay: Duration,
    state: watch::Receiver<CameraState>,
    live: watch::Receiver<Option<Arc<Frame>>>,
    seen_at: watch::Receiver<Option<Instant>>,
    there_since: watch::Receiver<Option<Instant>>,
    ended: Arc<AtomicBool>,
}

/// The other end of a [`Feed`], which the thread that takes the frames has.
pub(super) struct Outlet {
    device: String,
    size: (usize, usize),
    poses: PoseSource,
    state: watch::Sender<CameraState>,
    live: watch::Sender<Option<Arc<Frame>>>,
    /// When a frame last came.
    seen_at: watch::Sender<Option<Instant>>,
    /// Since when the camera is there: first, or again.
    there_since: watch::Sender<Option<Instant>>,
    ended: Arc<AtomicBool>,
    interval_ns: Arc<AtomicU64>,
    age_ns: Arc<AtomicU64>,
    /// The newest frame's number.
    pub(super) seq: u64,
}

/// Both ends of what a driver takes frames by, of `size` (columns and rows).
pub(super) fn feed(
    config: &CameraConfig,
    size: (usize, usize),
    poses: PoseSource,
    state: CameraState,
) -> (Feed, Outlet) {
    let (state, state_out) = watch::channel(state);
    let (live, live_out) = watch::channel(None);
    let (seen_at, seen_at_out) = watch::channel(None);
    let (there_since, there_since_out) = watch::channel(None);
    let ended = Arc::new(AtomicBool::new(false));
    let device = config.device.clone();
    let interval = Duration::try_from_secs_f64(1.0 / config.frame_rate_hz).unwrap_or_default();
    let interval_ns = Arc::new(AtomicU64::new(nanoseconds(interval)));
    let age_ns = Arc::<AtomicU64>::default();
    let pipeline_delay = Duration::from_millis(config.pipeline_delay_ms);
    let feed = Feed {
        name: device.clone(),
        timeout: Duration::from_millis(config.timeout_ms),
        interval_ns: Arc::clone(&interval_ns),
        age_ns: Arc::clone(&age_ns),
        pipeline_delay,
        state: state_out,
        live: live_out,
        seen_at: seen_at_out,
        there_since: there_since_out,
        ended: Arc::clone(&ended),
    };
    (feed, Outlet { device, size, poses, state, live, seen_at, there_since, ended, interval_ns, age_ns, seq: 0 })
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

impl Drop for Feed {
    fn drop(&mut self) {
        // The thread sees it after its present wait, which is bounded.
        self.ended.store(true, Ordering::Relaxed);
    }
}

impl Feed {
    /// Whether the camera is there.
    ///
    /// # Errors
    /// Why it is not.
    pub(super) fn require_there(&self) -> Result<(), DeviceError> {
        let fault = self.state.borrow().fault.clone();
        fault.map_or(Ok(()), |reason| Err(DeviceError::Disconnected { device: self.name.clone(), reason }))
    }

    /// As [`FrameSource::frame`].
    async fn next(&self, not_before: Instant) -> Result<Arc<Frame>, DeviceError> {
        if let Some(reason) = self.state.borrow().unfit.clone() {
            return Err(DeviceError::Refused { device: self.name.clone(), reason });
        }
        let began = Instant::now().max(not_before);
        let mut allowed = self.allowed();
        let mut until = began + allowed;
        loop {
            let mut live = self.live.clone();
            let fresh = live.wait_for(|frame| frame.as_ref().is_some_and(|frame| frame.exposed_from >= not_before));
            match tokio::time::timeout_at(until, fresh).await {
                Ok(Ok(frame)) => {
                    if let Some(frame) = frame.as_ref() {
                        return Ok(Arc::clone(frame));
                    }
                }
                // Nobody takes frames any more.
                Ok(Err(_)) => break,
                Err(_) => {}
            }
            // Lost on the way, it may come back; and one that is back has as long as any other, from then on.
            let returns_by = self.seen_at.borrow().map(|seen_at| seen_at + RETURN_ALLOWED);
            let back_at = self.there_since.borrow().filter(|since| returns_by.is_some_and(|by| *since <= by));
            let offline = self.state.borrow().fault.is_some();
            // Frames may have come to count as older meanwhile, too.
            allowed = self.allowed();
            let due = back_at.map_or(began, |back_at| back_at.max(began)) + allowed;
            let later = match offline {
                true => returns_by,
                // Its driver is finding out why.
                false if self.is_silent() => Some(due + VERDICT_ALLOWED),
                false => Some(due),
            };
            match later.filter(|later| *later > Instant::now()) {
                Some(later) => until = later,
                None => break,
            }
        }
        self.require_there()?;
        Err(DeviceError::Timeout { device: self.name.clone(), what: "send a frame".to_owned(), allowed })
    }

    /// Whether no frame came for as long as is waited for one.
    fn is_silent(&self) -> bool {
        self.seen_at.borrow().is_some_and(|seen_at| seen_at.elapsed() >= self.timeout)
    }

    /// How long a camera that is there may take for a frame: the wait for the camera, and what passes besides: exposure,
    /// read-out, what its pictures are late by, and how much older than that they count as where their times are not known any
    /// better.
    fn allowed(&self) -> Duration {
        let age = Duration::from_nanos(self.age_ns.load(Ordering::Relaxed));
        self.timeout + (self.pipeline_delay + FRAMES_UNDER_WAY * self.interval()).max(age)
    }

    /// Has the thread that takes frames end, and waits for it.
    async fn end(&self) {
        self.ended.store(true, Ordering::Relaxed);
        // It takes the other end with it.
        let mut state = self.state.clone();
        let gone = async { while state.changed().await.is_ok() {} };
        if tokio::time::timeout(END_ALLOWED, gone).await.is_err() {
            tracing::warn!(device = %self.name, "the camera was not let go in time");
        }
    }

    /// The time between frames.
    pub(super) fn interval(&self) -> Duration {
        Duration::from_nanos(self.interval_ns.load(Ordering::Relaxed))
    }

    /// Waits until what was set is in force in whatever frame is exposed next.
    async fn let_pass(&self, controls: &[LightControl]) {
        // A long exposure has the camera slow down.
        let exposures = controls.iter().filter(|control| control.unit == ControlUnit::Ms);
        let longest_ms = exposures.filter_map(|control| control.value).fold(0.0, f64::max);
        let interval = self.interval().max(Duration::try_from_secs_f64(longest_ms / 1000.0).unwrap_or_default());
        tokio::time::sleep(FRAMES_UNDER_WAY * interval + self.pipeline_delay).await;
    }
}

/// A camera whose frames come through a feed.
#[async_trait]
pub trait Driven: Send + Sync {
    /// Its users' end of the feed.
    fn feed(&self) -> &Feed;

    /// As [`FrameSource::controls`].
    async fn tell_controls(&self) -> Result<Vec<LightControl>, DeviceError>;

    /// Sets a control, which is in force from some frame on.
    async fn change_control(&self, name: ControlName, value: f64) -> Result<(), DeviceError>;
}

#[async_trait]
impl<D: Driven> FrameSource for D {
    fn state(&self) -> watch::Receiver<CameraState> {
        self.feed().state.clone()
    }

    fn live(&self) -> watch::Receiver<Option<Arc<Frame>>> {
        self.feed().live.clone()
    }

    fn newest(&self) -> Option<Arc<Frame>> {
        self.feed().live.borrow().clone()
    }

    async fn frame(&self, not_before: Instant) -> Result<Arc<Frame>, DeviceError> {
        self.feed().next(not_before).await
    }

    async fn controls(&self) -> Result<Vec<LightControl>, DeviceError> {
        self.tell_controls().await
    }

    async fn set_control(&self, name: ControlName, value: f64) -> Result<(), DeviceError> {
        self.change_control(name, value).await?;
        self.feed().let_pass(&self.tell_controls().await?).await;
        Ok(())
    }

    async fn end(&self) {
        self.feed().end().await;
    }
}

/// What takes frames of one camera.
pub(super) trait Capture: Send + 'static {
    /// Where its frames go.
    fn outlet(&self) -> &Outlet;

    /// Opens the camera and publishes frames until the end (`Ok`) or an error, in words.
    fn capture(&mut self) -> Result<(), String>;
}

/// Has a thread of its own take frames until the feed is dropped.
///
/// # Errors
/// [`DeviceError::Disconnected`] when no thread can be started.
pub(super) fn spawn(mut capture: impl Capture) -> Result<(), DeviceError> {
    let device = capture.outlet().device.clone();
    let started = std::thread::Builder::new().name("camera".to_owned()).spawn(move || run(&mut capture));
    started
        .map(drop)
        .map_err(|error| DeviceError::Disconnected { device, reason: format!("no thread for it: {error}") })
}

fn run(capture: &mut impl Capture) {
    let mut pause = PAUSES.0;
    while !capture.outlet().has_ended() {
        let before = capture.outlet().seq;
        // A driver's library may panic where the end of a device is unexpected; the camera is then lost and opened anew like
        // any other.
        let fault = match catch_unwind(AssertUnwindSafe(|| capture.capture())) {
            Ok(Ok(())) => return,
            Ok(Err(fault)) => fault,
            Err(_) => "its driver answered something unexpected".to_owned(),
        };
        let outlet = capture.outlet();
        outlet.go_offline(fault);
        pause = if outlet.seq > before { PAUSES.0 } else { (pause * 2).min(PAUSES.1) };
        outlet.sleep(pause);
    }
}

/// What came of frames since it was last told.
#[derive(Debug, Default)]
pub(super) struct Count {
    /// Frames that never came.
    pub(super) lost: u64,
    /// Frames that came damaged.
    pub(super) damaged: u64,
}

/// What is to be told of a camera that is open.
pub(super) struct News<'n> {
    /// Whether the last frame was good.
    pub(super) good: bool,
    pub(super) identity: &'n str,
    /// From this level on a pixel is saturated.
    pub(super) white: u16,
    pub(super) notes: Vec<String>,
    pub(super) count: Count,
}

impl Outlet {
    /// Whether nobody wants frames any more.
    pub(super) fn has_ended(&self) -> bool {
        self.ended.load(Ordering::Relaxed)
    }

    /// Columns and rows of a frame.
    pub(super) const fn size(&self) -> (usize, usize) {
        self.size
    }

    /// Says how long the camera takes from one frame to the next.
    pub(super) fn pace(&self, interval: Duration) {
        self.interval_ns.store(nanoseconds(interval), Ordering::Relaxed);
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
            tracing::warn!(device = %self.device, fault = %fault, "the camera is offline");
        }
    }

    /// Sleeps in pieces, so that the end is not kept waiting.
    fn sleep(&self, pause: Duration) {
        let until = Instant::now() + pause;
        while !self.has_ended() && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    /// Publishes a frame as the newest, exposed in a window whose ages are those at `dated_at`: what passes until it is
    /// published makes it no younger.
    pub(super) fn publish(&self, image: Arc<RawImage>, seq: u64, (window, dated_at): (Window, Instant)) {
        self.age_ns.store(nanoseconds(window.from_age), Ordering::Relaxed);
        let back = |age: Duration| dated_at.checked_sub(age).unwrap_or(dated_at);
        let (exposed_from, exposed_to) = (back(window.from_age), back(window.to_age));
        let (focus, e) = (self.poses)(exposed_from, exposed_to);
        let captured_at = jiff::Timestamp::now();
        let ended_before = window.to_age + dated_at.elapsed();
        self.live.send_replace(Some(Arc::new(Frame {
            image,
            seq,
            exposed_from,
            exposed_to,
            exposure_assumed: window.assumed,
            captured_at: captured_at.checked_sub(ended_before).unwrap_or(captured_at),
            focus,
            e,
            preview: false,
            simulated: false,
            replayed: false,
        })));
        self.seen_at.send_replace(Some(Instant::now()));
    }

    /// Renews the state.
    pub(super) fn tell(&self, news: News<'_>) {
        self.state.send_if_modified(|state| {
            let lost = news.count.lost.saturating_add(news.count.damaged);
            let back = news.good && (!state.online || state.fault.is_some());
            let changed = back || lost > 0 || state.notes != news.notes;
            if back {
                self.there_since.send_replace(Some(Instant::now()));
                tracing::info!(device = %self.device, camera = %news.identity, "the camera is online");
                (state.online, state.fault) = (true, None);
                news.identity.clone_into(&mut state.identity);
                (state.size, state.white) = (Some(self.size), Some(news.white));
            }
            state.frames_lost = state.frames_lost.saturating_add(lost);
            state.frames_damaged = state.frames_damaged.saturating_add(news.count.damaged);
            state.notes = news.notes;
            changed
        });
    }
}

/// How frames are exposed, judged now and then.
pub(super) struct Judge {
    exposure: Exposure,
    judged_at: Option<Instant>,
    note: Option<String>,
}

impl Default for Judge {
    fn default() -> Self {
        Self { exposure: Exposure::Good, judged_at: None, note: None }
    }
}

impl Judge {
    /// Judges a frame whose scale ends at `white`; `controls` names what makes a picture brighter or darker.
    pub(super) fn see(&mut self, image: &RawImage, white: u16, controls: impl FnOnce() -> String) {
        if self.judged_at.is_some_and(|at| at.elapsed() < JUDGE_EVERY) {
            return;
        }
        self.judged_at = Some(Instant::now());
        let exposure = brightness::judge(image, white);
        if !exposure.is_like(self.exposure) {
            self.exposure = exposure;
            let controls = if exposure == Exposure::Good { String::new() } else { controls() };
            self.note = exposure.note(&controls);
        }
    }

    /// What is wrong, where something is.
    pub(super) fn note(&self) -> Option<String> {
        self.note.clone()
    }
}

#[cfg(test)]
mod tests;
