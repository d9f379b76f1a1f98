//! The simulated camera: a frame source that renders what the truth implies.
//!
//! A measured frame is rendered at full quality when it is asked for. While somebody watches, coarse previews are
//! rendered at the preview rate; nobody watching costs nothing.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use async_trait::async_trait;
use tokio::sync::{Notify, watch};
use tokio::time::Instant;
use tokio_util::sync::{CancellationToken, DropGuard};

use super::picture::Picture;
use super::truth::Truth;
use crate::config::Config;
use crate::device::{AxisPose, CameraState, DeviceError, Frame, FrameSource, Stage};

/// Exposure of a simulated frame.
const EXPOSURE: Duration = Duration::from_millis(10);

/// The simulated camera.
pub struct SimulatedCamera {
    shared: Arc<Shared>,
    /// Ends the preview task with the camera.
    _preview: DropGuard,
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
        };
        let shared = Arc::new(Shared {
            picture: Arc::new(Picture::new(&config)),
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
        Self { shared, _preview: end.drop_guard() }
    }
}

impl Shared {
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
        let exposed_from = Instant::now();
        let pose = self.truth.pose();
        let focus = Self::axis_pose(&self.focus, self.config.bench.focus.settle_ms, exposed_from);
        let e = Self::axis_pose(&self.e, self.config.bench.e.settle_ms, exposed_from);
        tokio::time::sleep(EXPOSURE).await;
        let end = self.truth.pose();
        let still = end == pose;
        let seq = self.seq.fetch_add(1, Ordering::SeqCst) + 1;
        let picture = Arc::clone(&self.picture);
        let image =
            tokio::task::spawn_blocking(move || picture.take(&pose, &end, rays, seq)).await.map_err(|error| {
                DeviceError::Disconnected { device: "the simulated camera".to_owned(), reason: error.to_string() }
            })?;
        Ok(Arc::new(Frame {
            image: Arc::new(image),
            seq,
            exposed_from,
            exposed_to: exposed_from + EXPOSURE,
            exposure_assumed: false,
            captured_at: jiff::Timestamp::now(),
            focus: AxisPose { settled: focus.settled && still, ..focus },
            e: AxisPose { settled: e.settled && still, ..e },
            preview,
            simulated: true,
            replayed: false,
        }))
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
}
