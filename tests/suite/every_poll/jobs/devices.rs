//! A stage and a camera of the simulated bench that tell when they are used. Frames of the same place, taken in the same
//! order, are rendered once for all runs: they cost most of a job's time.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, Mutex};
use std::time::Duration;

use async_trait::async_trait;
use plenalign::config::AxisConfig;
use plenalign::device::stage::supervisor::ControllerStage;
use plenalign::device::{
    AxisName, AxisPose, CameraState, DeviceError, Frame, FrameSource, MoveTime, Stage, StageInfo, StageState,
    StopDelivery,
};
use plenalign::raw::RawImage;
use plenalign::sim::camera::SimulatedCamera;
use plenalign::sim::truth::Truth;
use plenalign::units::Millimetres;
use tokio::sync::watch;
use tokio::time::Instant;

use super::super::super::until::elapse;
use super::points::{Point, Points};

/// A stage that tells of every command that moves before it passes it on.
pub(super) struct Told {
    pub(super) stage: ControllerStage,
    pub(super) axis: AxisName,
    pub(super) points: Arc<Points>,
}

impl Told {
    fn arrived(&self, what: &'static str) {
        self.points.pass(Point::Arrived(self.axis, what));
    }
}

#[async_trait]
impl Stage for Told {
    fn info(&self) -> StageInfo {
        self.stage.info()
    }

    fn state(&self) -> watch::Receiver<StageState> {
        self.stage.state()
    }

    async fn read_state(&self) -> Result<StageState, DeviceError> {
        self.stage.read_state().await
    }

    fn homes_also(&self) -> Option<AxisName> {
        self.stage.homes_also()
    }

    fn takes_turns_with(&self) -> Option<AxisName> {
        self.stage.takes_turns_with()
    }

    fn generation(&self) -> u64 {
        self.stage.generation()
    }

    fn move_time(&self, from: Millimetres, to: Millimetres) -> MoveTime {
        self.stage.move_time(from, to)
    }

    async fn home(&self, generation: u64) -> Result<(), DeviceError> {
        self.arrived("home");
        self.stage.home(generation).await
    }

    async fn set_position(&self, position: Millimetres, generation: u64) -> Result<(), DeviceError> {
        self.arrived("set position");
        self.stage.set_position(position, generation).await
    }

    async fn move_at(&self, target: Millimetres, speed: f64, generation: u64) -> Result<Millimetres, DeviceError> {
        self.arrived("move");
        self.stage.move_at(target, speed, generation).await
    }

    fn forget_position(&self) {
        self.stage.forget_position();
    }

    async fn release(&self, generation: u64) -> Result<(), DeviceError> {
        self.arrived("release");
        self.stage.release(generation).await
    }

    fn stop_sent(&self) -> Option<Instant> {
        self.stage.stop_sent()
    }

    async fn stop(&self) -> StopDelivery {
        self.stage.stop().await
    }
}

/// Exposure of a frame.
const EXPOSURE: Duration = Duration::from_millis(10);

/// Pictures by what they show, and their place in a run, which makes their noise.
static RENDERED: LazyLock<Mutex<Pictures>> = LazyLock::new(Mutex::default);

type Pictures = HashMap<(String, u64), Arc<RawImage>>;

/// The simulated camera, which tells when a frame is asked for and when it is taken.
pub(super) struct Watched {
    pub(super) camera: SimulatedCamera,
    pub(super) truth: Arc<Truth>,
    pub(super) stages: [Arc<dyn Stage>; 2],
    pub(super) points: Arc<Points>,
    pub(super) seq: AtomicU64,
}

fn pose(stage: &Arc<dyn Stage>, axis: &AxisConfig, from: Instant) -> AxisPose {
    let state = stage.state().borrow().clone();
    let settled = state.at_rest_since.is_some_and(|rest| rest + Duration::from_millis(axis.settle_ms) <= from);
    AxisPose { position: state.homed.then_some(state.position), settled }
}

impl Watched {
    async fn take(&self) -> Result<Arc<Frame>, DeviceError> {
        let seq = self.seq.fetch_add(1, Ordering::SeqCst) + 1;
        let key = (format!("{:?}", self.truth.pose()), seq);
        let rendered = RENDERED.lock().unwrap().get(&key).cloned();
        let Some(image) = rendered else {
            let frame = self.camera.frame(Instant::now()).await?;
            RENDERED.lock().unwrap().insert(key, Arc::clone(&frame.image));
            return Ok(frame);
        };
        let (config, exposed_from) = (&self.truth.config().bench, Instant::now());
        let [focus, e] = &self.stages;
        let (focus, e) = (pose(focus, &config.focus, exposed_from), pose(e, &config.e, exposed_from));
        elapse(EXPOSURE).await;
        Ok(Arc::new(Frame {
            image,
            seq,
            exposed_from,
            exposed_to: exposed_from + EXPOSURE,
            exposure_assumed: false,
            captured_at: jiff::Timestamp::now(),
            focus,
            e,
            preview: false,
            simulated: true,
            replayed: false,
        }))
    }
}

#[async_trait]
impl FrameSource for Watched {
    fn state(&self) -> watch::Receiver<CameraState> {
        self.camera.state()
    }

    fn live(&self) -> watch::Receiver<Option<Arc<Frame>>> {
        self.camera.live()
    }

    fn newest(&self) -> Option<Arc<Frame>> {
        self.camera.newest()
    }

    async fn frame(&self, not_before: Instant) -> Result<Arc<Frame>, DeviceError> {
        self.points.pass(Point::Asked);
        elapse(not_before.saturating_duration_since(Instant::now())).await;
        let frame = self.take().await;
        self.points.pass(Point::Taken);
        frame
    }
}
