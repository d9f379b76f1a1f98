//! The simulated camera: a frame source that renders what the truth implies.
//!
//! A measured frame is rendered at full quality when it is asked for. While somebody watches, coarse previews are
//! rendered at the preview rate; nobody watching costs nothing. Of a bench at rest a frame's noise alone is new.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use async_trait::async_trait;
use tokio::sync::{Notify, watch};
use tokio::time::Instant;
use tokio_util::sync::{CancellationToken, DropGuard};

use super::picture::Picture;
use super::truth::{Pose, Truth};
use crate::config::Config;
use crate::device::faults::Faults;
use crate::device::light::{ControlName, ControlUnit, LightControl};
use crate::device::{AxisPose, CameraState, DeviceError, Frame, FrameSource, Stage};
use plenoptics::raw::RawImage;

/// What the camera is called in errors.
const NAME: &str = "the simulated camera";
/// Why it gives no frame while it is unplugged.
const UNPLUGGED: &str = "it is unplugged";
/// Least, greatest and usual exposure of a simulated frame, and the step between two, ms.
const EXPOSURE_MS: [f64; 4] = [0.1, 100.0, 10.0, 0.1];
/// The same of its gain, as a factor.
const GAIN: [f64; 4] = [1.0, 16.0, 1.0, 0.1];

/// How the camera is set.
#[derive(Debug, Clone, Copy)]
struct Settings {
    exposure_ms: f64,
    gain: f64,
}

/// The simulated camera.
pub struct SimulatedCamera {
    shared: Arc<Shared>,
    /// Ends the camera's tasks with it.
    _tasks: DropGuard,
}

struct Shared {
    truth: Arc<Truth>,
    picture: Arc<Picture>,
    focus: Arc<dyn Stage>,
    e: Arc<dyn Stage>,
    config: Arc<Config>,
    state: watch::Sender<CameraState>,
    live: watch::Sender<Option<Arc<Frame>>>,
    watched: Notify,
    seq: AtomicU64,
    faults: watch::Receiver<Faults>,
    settings: Mutex<Settings>,
    /// The newest picture, given again by a driver that hangs.
    last: Mutex<Option<Arc<RawImage>>>,
    /// One frame is rendered at a time: they all use every core.
    rendering: tokio::sync::Mutex<()>,
}

impl SimulatedCamera {
    /// A camera over the truth, beside the stages whose readings its frames carry. Must be made within a tokio runtime.
    #[must_use]
    pub fn new(truth: Arc<Truth>, focus: Arc<dyn Stage>, e: Arc<dyn Stage>) -> Self {
        let config = Arc::new(truth.config().clone());
        let size = (config.sensor.width_px as usize, config.sensor.height_px as usize);
        let state = CameraState {
            driver: "simulated".to_owned(),
            identity: "SIMULATED exact-ray renderer".to_owned(),
            online: true,
            fault: None,
            frames_lost: 0,
            frames_damaged: 0,
            notes: Vec::new(),
            replay: false,
            unfit: None,
            size: Some(size),
            white: None,
        };
        let shared = Arc::new(Shared {
            picture: Arc::new(Picture::new(&config)),
            faults: truth.faults(),
            last: Mutex::default(),
            settings: Mutex::new(Settings { exposure_ms: EXPOSURE_MS[2], gain: GAIN[2] }),
            truth,
            focus,
            e,
            config,
            state: watch::Sender::new(state),
            live: watch::Sender::new(None),
            watched: Notify::new(),
            seq: AtomicU64::new(0),
            rendering: tokio::sync::Mutex::new(()),
        });
        let end = CancellationToken::new();
        let preview = Arc::clone(&shared);
        tokio::spawn(end.clone().run_until_cancelled_owned(async move { preview.preview().await }));
        let plug = Arc::clone(&shared);
        tokio::spawn(end.clone().run_until_cancelled_owned(async move { plug.follow_the_plug().await }));
        Self { shared, _tasks: end.drop_guard() }
    }
}

impl Shared {
    /// Says that the camera is gone while it is unplugged.
    async fn follow_the_plug(&self) {
        let mut faults = self.faults.clone();
        loop {
            let unplugged = faults.borrow_and_update().camera.unplugged;
            self.state.send_if_modified(|state| {
                let changed = state.online == unplugged;
                state.online = !unplugged;
                state.fault = unplugged.then(|| UNPLUGGED.to_owned());
                changed
            });
            if unplugged {
                self.live.send_replace(None);
            }
            if faults.changed().await.is_err() {
                return;
            }
        }
    }

    fn unplugged(&self) -> Result<(), DeviceError> {
        if self.faults.borrow().camera.unplugged {
            return Err(DeviceError::Disconnected { device: NAME.to_owned(), reason: UNPLUGGED.to_owned() });
        }
        Ok(())
    }

    fn settings(&self) -> Settings {
        *self.settings.lock().unwrap_or_else(PoisonError::into_inner)
    }

    async fn preview(&self) {
        let rate = self.config.bench.simulation.preview_rate_hz;
        let interval = Duration::from_secs_f64(1.0 / rate);
        loop {
            if self.live.is_closed() {
                self.watched.notified().await;
                continue;
            }
            let begin = Instant::now();
            if let Ok(_turn) = self.rendering.try_lock()
                && let Ok(frame) = self.take(self.config.bench.simulation.preview_rays, true).await
            {
                self.live.send_replace(Some(frame));
            }
            tokio::time::sleep_until(begin + interval).await;
        }
    }

    fn axis_pose(stage: &Arc<dyn Stage>, settle_ms: u64, from: Instant) -> AxisPose {
        let state = stage.state().borrow().clone();
        let settled = state.at_rest_since.is_some_and(|rest| rest + Duration::from_millis(settle_ms) <= from);
        AxisPose { position: state.homed.then_some(state.position), settled }
    }

    async fn take(&self, rays: u32, preview: bool) -> Result<Arc<Frame>, DeviceError> {
        self.unplugged()?;
        let exposed_from = Instant::now();
        let pose = self.truth.pose();
        let focus = Self::axis_pose(&self.focus, self.config.bench.focus.settle_ms, exposed_from);
        let e = Self::axis_pose(&self.e, self.config.bench.e.settle_ms, exposed_from);
        let exposure = Duration::from_secs_f64(self.settings().exposure_ms / 1000.0);
        tokio::time::sleep(exposure).await;
        let end = self.truth.pose();
        let seq = self.seq.fetch_add(1, Ordering::SeqCst) + 1;
        let image = self.image(pose, end, rays, seq, preview).await?;
        self.unplugged()?;
        Ok(Arc::new(Frame {
            image,
            seq,
            exposed_from,
            exposed_to: exposed_from + exposure,
            exposure_assumed: false,
            captured_at: jiff::Timestamp::now(),
            // What the controllers say: a camera does not know whether it is true.
            focus,
            e,
            preview,
            simulated: true,
            replayed: false,
        }))
    }

    async fn image(
        &self,
        from: Pose,
        to: Pose,
        rays: u32,
        seq: u64,
        preview: bool,
    ) -> Result<Arc<RawImage>, DeviceError> {
        let faults = *self.faults.borrow();
        let last = || self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let hanging = if faults.camera.frozen { last().clone() } else { None };
        if let Some(image) = hanging {
            return Ok(image);
        }
        let picture = Arc::clone(&self.picture);
        let take = if preview { Picture::preview } else { Picture::take };
        let image = tokio::task::spawn_blocking(move || take(&picture, &from, &to, rays, seq, &faults))
            .await
            .map_err(|error| DeviceError::Disconnected { device: NAME.to_owned(), reason: error.to_string() })?;
        let image = Arc::new(image);
        *last() = Some(Arc::clone(&image));
        Ok(image)
    }
}

#[async_trait]
impl FrameSource for SimulatedCamera {
    fn state(&self) -> watch::Receiver<CameraState> {
        self.shared.state.subscribe()
    }

    fn live(&self) -> watch::Receiver<Option<Arc<Frame>>> {
        let receiver = self.shared.live.subscribe();
        self.shared.watched.notify_one();
        receiver
    }

    fn newest(&self) -> Option<Arc<Frame>> {
        self.shared.live.borrow().clone()
    }

    async fn frame(&self, not_before: Instant) -> Result<Arc<Frame>, DeviceError> {
        tokio::time::sleep_until(not_before).await;
        let _turn = self.shared.rendering.lock().await;
        let frame = self.shared.take(self.shared.config.bench.simulation.rays, false).await?;
        self.shared.live.send_replace(Some(Arc::clone(&frame)));
        Ok(frame)
    }

    async fn controls(&self) -> Result<Vec<LightControl>, DeviceError> {
        self.shared.unplugged()?;
        let Settings { exposure_ms, gain } = self.shared.settings();
        let control = |name: ControlName, unit, value, [minimum, maximum, default, step]: [f64; 4]| LightControl {
            name,
            key: name.name().to_owned(),
            unit,
            value: Some(value),
            minimum,
            maximum,
            step,
            default,
            automatic: false,
            locked: None,
        };
        Ok(vec![
            control(ControlName::Exposure, ControlUnit::Ms, exposure_ms, EXPOSURE_MS),
            control(ControlName::Gain, ControlUnit::Factor, gain, GAIN),
        ])
    }

    async fn set_control(&self, name: ControlName, value: f64) -> Result<(), DeviceError> {
        self.shared.unplugged()?;
        // What is being exposed is exposed as it began.
        let _turn = self.shared.rendering.lock().await;
        let mut settings = self.shared.settings();
        match name {
            ControlName::Exposure => settings.exposure_ms = value,
            ControlName::Gain => settings.gain = value,
        }
        *self.shared.settings.lock().unwrap_or_else(PoisonError::into_inner) = settings;
        self.shared.picture.set_exposed(settings.exposure_ms / EXPOSURE_MS[2], settings.gain);
        Ok(())
    }
}
