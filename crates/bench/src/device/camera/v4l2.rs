//! Capture over Video4Linux2: the frame source in front of the capture thread.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use tokio::sync::watch;
use tokio::time::Instant;

use super::capture::Capturer;
use super::controls::KeptControls;
use super::{controls, find};
use crate::config::CameraConfig;
use crate::device::light::{ControlName, ControlUnit, LightControl};
use crate::device::{AxisPose, CameraState, DeviceError, Frame, FrameSource, StageState};
use plenoptics::raw::PixelFormat;

/// Tells the poses of focus and e axis over an exposure, from its begin to its end.
pub type PoseSource = Arc<dyn Fn(Instant, Instant) -> (AxisPose, AxisPose) + Send + Sync>;

/// A camera that sent frames is waited for this long after the last one: a plug pushed back in does not cost a run.
const RETURN_ALLOWED: Duration = Duration::from_secs(30);

/// Frames that may have been under way, or already exposed, when a control was set: it is in force from the next one on.
const FRAMES_UNDER_WAY: u32 = 3;
/// How long a driver may take to tell or to set its controls.
const CONTROLS_ALLOWED: Duration = Duration::from_secs(5);

/// A V4L2 capture device.
pub struct V4l2Camera {
    name: String,
    timeout: Duration,
    /// The time between frames, as configured.
    interval: Duration,
    pipeline_delay: Duration,
    set_by_hand: Arc<KeptControls>,
    state: watch::Receiver<CameraState>,
    live: watch::Receiver<Option<Arc<Frame>>>,
    seen_at: watch::Receiver<Option<Instant>>,
    ended: Arc<AtomicBool>,
}

impl V4l2Camera {
    /// Starts capturing frames of `size` (columns and rows) from the configured device. A device that is missing or
    /// unsuitable is not an error here: the state says so, and it is tried again.
    ///
    /// # Errors
    /// [`DeviceError::Refused`] for a pixel format that this program does not read, [`DeviceError::Disconnected`] when
    /// no thread can be started.
    pub fn start(config: &CameraConfig, size: (usize, usize), poses: PoseSource) -> Result<Self, DeviceError> {
        let name = config.device.clone();
        let format = PixelFormat::from_name(&config.format).ok_or_else(|| DeviceError::Refused {
            device: name.clone(),
            reason: format!("frames in `{}` are not read; `plenalign camera list` shows what is", config.format),
        })?;
        let unfit = format.is_recompressed().then(|| {
            format!(
                "its frames are for viewing only: {} has been through a lossy code; set bench.camera.format to one of its \
                 raw formats",
                format.name()
            )
        });
        let (state, state_out) =
            watch::channel(CameraState { unfit, ..CameraState::not_yet("v4l2", "not opened yet") });
        let (live, live_out) = watch::channel(None);
        let (seen_at, seen_at_out) = watch::channel(None);
        let ended = Arc::new(AtomicBool::new(false));
        let set_by_hand = Arc::<KeptControls>::default();
        let capturer = Capturer {
            config: config.clone(),
            set_by_hand: Arc::clone(&set_by_hand),
            format,
            size,
            poses,
            state,
            live,
            seen_at,
            ended: Arc::clone(&ended),
            seq: 0,
        };
        std::thread::Builder::new().name("camera".to_owned()).spawn(move || capturer.run()).map_err(|error| {
            DeviceError::Disconnected { device: name.clone(), reason: format!("no thread for it: {error}") }
        })?;
        // What passes besides the wait for the camera: exposure, read-out, and what its pictures are late by.
        let interval = Duration::try_from_secs_f64(1.0 / config.frame_rate_hz).unwrap_or_default();
        let pipeline_delay = Duration::from_millis(config.pipeline_delay_ms);
        let timeout = Duration::from_millis(config.timeout_ms) + pipeline_delay + 3 * interval;
        Ok(Self {
            name,
            timeout,
            interval,
            pipeline_delay,
            set_by_hand,
            state: state_out,
            live: live_out,
            seen_at: seen_at_out,
            ended,
        })
    }

    /// Does something with the device, by a handle of its own: frames are taken meanwhile.
    async fn at_device<T: Send + 'static>(
        &self,
        what: &str,
        work: impl FnOnce(&v4l::Device) -> Result<T, String> + Send + 'static,
    ) -> Result<T, DeviceError> {
        let device = || self.name.clone();
        let fault = self.state.borrow().fault.clone();
        if let Some(reason) = fault {
            return Err(DeviceError::Disconnected { device: device(), reason });
        }
        let name = self.name.clone();
        let opened = move || {
            let gone = |reason| DeviceError::Disconnected { device: name.clone(), reason };
            let opened = find::resolve(&name).and_then(|path| find::open(&path)).map_err(gone)?;
            work(&opened).map_err(|reason| DeviceError::Refused { device: name, reason })
        };
        let late = || DeviceError::Timeout { device: device(), what: what.to_owned(), allowed: CONTROLS_ALLOWED };
        let done = tokio::time::timeout(CONTROLS_ALLOWED, tokio::task::spawn_blocking(opened)).await;
        let ended = |error: tokio::task::JoinError| {
            let detail = error.to_string();
            DeviceError::Protocol { device: device(), detail }
        };
        done.map_err(|_| late())?.map_err(ended)?
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
        if let Some(reason) = self.state.borrow().unfit.clone() {
            return Err(DeviceError::Refused { device: self.name.clone(), reason });
        }
        let mut until = Instant::now().max(not_before) + self.timeout;
        loop {
            let mut live = self.live.clone();
            let fresh = live.wait_for(|frame| frame.as_ref().is_some_and(|frame| frame.exposed_from >= not_before));
            if let Ok(Ok(frame)) = tokio::time::timeout_at(until, fresh).await
                && let Some(frame) = frame.as_ref()
            {
                return Ok(Arc::clone(frame));
            }
            // Lost on the way: it may come back.
            let returned = self.seen_at.borrow().map(|seen_at| seen_at + RETURN_ALLOWED);
            let offline = self.state.borrow().fault.is_some();
            match returned.filter(|returned| offline && *returned > Instant::now()) {
                Some(returned) => until = returned,
                None => break,
            }
        }
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

    async fn controls(&self) -> Result<Vec<LightControl>, DeviceError> {
        self.at_device("tell its controls", |device| Ok(controls::light(device))).await
    }

    async fn set_control(&self, name: ControlName, value: f64) -> Result<(), DeviceError> {
        let kept = Arc::clone(&self.set_by_hand);
        self.at_device("set its controls", move |device| controls::set_light(device, name, value, &kept)).await?;
        // A long exposure has the camera slow down.
        let exposures = self.controls().await?.into_iter().filter(|control| control.unit == ControlUnit::Ms);
        let longest_ms = exposures.filter_map(|control| control.value).fold(0.0, f64::max);
        let interval = self.interval.max(Duration::try_from_secs_f64(longest_ms / 1000.0).unwrap_or_default());
        tokio::time::sleep(FRAMES_UNDER_WAY * interval + self.pipeline_delay).await;
        Ok(())
    }
}

/// The poses of two stages over an exposure, from their states: settled when an axis has been at rest since `settle`
/// before the exposure began.
#[must_use]
pub fn poses_of_stages(
    focus: (watch::Receiver<StageState>, Duration),
    e: (watch::Receiver<StageState>, Duration),
) -> PoseSource {
    let pose = |(state, settle): &(watch::Receiver<StageState>, Duration), from: Instant| {
        let state = state.borrow();
        AxisPose {
            position: (state.homed && state.connected).then_some(state.position),
            settled: state.at_rest_since.is_some_and(|since| since + *settle <= from),
        }
    };
    Arc::new(move |from, _to| (pose(&focus, from), pose(&e, from)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(device: &str, format: &str) -> V4l2Camera {
        let config = CameraConfig {
            device: device.to_owned(),
            format: format.to_owned(),
            timeout_ms: 50,
            ..CameraConfig::default()
        };
        let unknown = AxisPose { position: None, settled: false };
        V4l2Camera::start(&config, (64, 48), Arc::new(move |_, _| (unknown, unknown))).unwrap()
    }

    #[tokio::test]
    async fn a_camera_that_is_not_there_says_so() {
        let absent = camera("/dev/plenalign-no-such-camera", "GREY");
        let mut state = absent.state();
        let told =
            state.wait_for(|state| state.fault.as_ref().is_some_and(|fault| fault.contains("connect the camera")));
        tokio::time::timeout(Duration::from_secs(20), told).await.unwrap().unwrap();
        let error = absent.frame(Instant::now()).await.unwrap_err();
        assert!(matches!(error, DeviceError::Disconnected { .. }), "{error}");
        assert!(error.to_string().contains("there is no /dev/plenalign-no-such-camera"), "{error}");
        assert!(absent.newest().is_none());
    }

    #[tokio::test(start_paused = true)]
    async fn an_axis_has_settled_when_it_stood_since_its_time_before_the_exposure() {
        let rest = Instant::now();
        let state = StageState {
            connected: true,
            homed: true,
            position: plenoptics::units::Millimetres(1.5),
            moving: false,
            at_rest_since: Some(rest),
            limit_switch: false,
            fault: None,
        };
        let (focus, e) = (watch::Sender::new(state.clone()), watch::Sender::new(state));
        let ms = Duration::from_millis;
        let poses = poses_of_stages((focus.subscribe(), ms(100)), (e.subscribe(), ms(300)));
        let settled = |from: Instant| {
            let (focus, e) = poses(from, from + ms(50));
            (focus.settled, e.settled)
        };
        assert_eq!(settled(rest + ms(99)), (false, false));
        assert_eq!(settled(rest + ms(100)), (true, false));
        assert_eq!(settled(rest + ms(300)), (true, true));
        // In motion now: whatever stood before may have begun to move during the exposure.
        e.send_modify(|state| (state.moving, state.at_rest_since) = (true, None));
        assert_eq!(settled(rest + ms(900)), (true, false));
        let position = || poses(rest, rest).0.position.map(plenoptics::units::Millimetres::value);
        assert_eq!(position(), Some(1.5));
        // Not homed, or not connected, an axis's position says nothing.
        focus.send_modify(|state| state.homed = false);
        assert_eq!(position(), None);
        focus.send_modify(|state| (state.homed, state.connected) = (true, false));
        assert_eq!(position(), None);
    }

    #[tokio::test]
    async fn a_file_that_is_no_camera_says_so() {
        let none = camera("/dev/null", "Y12");
        let mut state = none.state();
        let told = state.wait_for(|state| state.fault.as_ref().is_some_and(|fault| fault.contains("no video device")));
        tokio::time::timeout(Duration::from_secs(20), told).await.unwrap().unwrap();
    }

    #[tokio::test]
    async fn recompressed_frames_are_not_measured() {
        let error = camera("/dev/null", "MJPG").frame(Instant::now()).await.unwrap_err();
        assert!(
            matches!(error, DeviceError::Refused { .. }) && error.to_string().contains("for viewing only"),
            "{error}"
        );
    }
}
