//! A bench of stand-ins for tests of the wire: axes that stand where they are told, a camera fed by the test.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use async_trait::async_trait;
use plenalign::device::faults::Faults;
use plenalign::device::light::{ControlName, LightControl};
use plenalign::device::{
    AxisName, AxisPose, Bench, CameraState, DeviceError, Frame, FrameSource, MoveTime, Setup, SimulatedOperator, Stage,
    StageInfo, StageState, StopDelivery,
};
use plenalign::raw::RawImage;
use plenalign::sim::truth::Truth;
use plenalign::units::Millimetres;
use tokio::sync::watch;
use tokio::time::Instant;

/// An axis that is where it was told to go at once.
pub(crate) struct StillStage {
    axis: AxisName,
    state: watch::Sender<StageState>,
    /// What a stop comes to.
    pub(crate) delivery: Mutex<StopDelivery>,
    /// The other axis, where it is to be homed with that one only.
    pub(crate) homes_also: Mutex<Option<AxisName>>,
    /// The other axis, where only one of the two may move at a time.
    pub(crate) takes_turns_with: Mutex<Option<AxisName>>,
    /// How far its controller lets it go, mm.
    pub(crate) limits_mm: Mutex<Option<(f64, f64)>>,
    /// Where it was told to go, mm.
    pub(crate) told: Mutex<Vec<f64>>,
    /// While this is set, neither a move nor a stop ends.
    pub(crate) held: watch::Sender<bool>,
}

impl StillStage {
    fn new(axis: AxisName) -> Self {
        let (state, _) = watch::channel(StageState {
            connected: true,
            homed: true,
            position: Millimetres(if axis == AxisName::E { 30.0 } else { 0.0 }),
            moving: false,
            at_rest_since: Some(Instant::now()),
            limit_switch: false,
            fault: None,
        });
        Self {
            axis,
            state,
            delivery: Mutex::new(StopDelivery::Confirmed),
            homes_also: Mutex::new(None),
            takes_turns_with: Mutex::new(None),
            limits_mm: Mutex::new(None),
            told: Mutex::default(),
            held: watch::channel(false).0,
        }
    }

    async fn let_go(&self) {
        // The sender lives as long as the stage.
        let _ = self.held.subscribe().wait_for(|held| !held).await;
    }

    /// Since when it has been at rest.
    pub(crate) fn at_rest_since(&self) -> Option<Instant> {
        self.state.borrow().at_rest_since
    }

    /// Has it be at rest since then, or move.
    pub(crate) fn rest(&self, since: Option<Instant>) {
        self.state.send_modify(|state| (state.at_rest_since, state.moving) = (since, since.is_none()));
    }
}

#[async_trait]
impl Stage for StillStage {
    fn info(&self) -> StageInfo {
        StageInfo {
            axis: self.axis,
            driver: "still".into(),
            identity: "stand-in".into(),
            location: "test".into(),
            disagreements: vec![],
            contradictions: vec![],
            firmware_limits: self.limits_mm.lock().unwrap().map(|(low, high)| (Millimetres(low), Millimetres(high))),
        }
    }

    fn state(&self) -> watch::Receiver<StageState> {
        self.state.subscribe()
    }

    async fn read_state(&self) -> Result<StageState, DeviceError> {
        Ok(self.state.borrow().clone())
    }

    fn homes_also(&self) -> Option<AxisName> {
        *self.homes_also.lock().unwrap()
    }

    fn takes_turns_with(&self) -> Option<AxisName> {
        *self.takes_turns_with.lock().unwrap()
    }

    async fn home(&self, _: u64) -> Result<(), DeviceError> {
        Ok(())
    }

    fn forget_position(&self) {
        self.state.send_modify(|state| state.homed = false);
    }

    async fn release(&self, _: u64) -> Result<(), DeviceError> {
        Ok(())
    }

    fn generation(&self) -> u64 {
        0
    }

    fn move_time(&self, _: Millimetres, _: Millimetres) -> MoveTime {
        MoveTime { predicted: Duration::ZERO, maximum: Duration::ZERO }
    }

    async fn set_position(&self, position: Millimetres, _: u64) -> Result<(), DeviceError> {
        self.state.send_modify(|state| state.position = position);
        Ok(())
    }

    async fn move_at(&self, target: Millimetres, _: f64, _: u64) -> Result<Millimetres, DeviceError> {
        self.told.lock().unwrap().push(target.value());
        self.let_go().await;
        self.state.send_modify(|state| state.position = target);
        Ok(target)
    }

    async fn stop(&self) -> StopDelivery {
        self.let_go().await;
        *self.delivery.lock().unwrap()
    }
}

/// A camera that shows what the test gives it.
pub(crate) struct FedCamera {
    state: watch::Sender<CameraState>,
    live: watch::Sender<Option<Arc<Frame>>>,
    hangs: watch::Sender<bool>,
    /// What it says it can be set by; it gives no answer to being set.
    pub(crate) controls: Mutex<Vec<LightControl>>,
}

impl FedCamera {
    /// How many watch the live picture.
    pub(crate) fn viewers(&self) -> usize {
        self.live.receiver_count()
    }

    /// From now on whoever wants a frame to measure waits, until that is over.
    pub(crate) fn hang(&self) {
        self.hangs.send_replace(true);
    }

    /// Whoever wants a frame to measure gets none.
    pub(crate) fn give_up(&self) {
        self.hangs.send_replace(false);
    }

    /// Takes a grey frame of 64 x 48.
    pub(crate) fn take(&self, seq: u64) {
        self.take_sized(seq, 64, 48);
    }

    /// Takes grey frames of a size one after another, as a camera of that rate does.
    pub(crate) async fn film(&self, seqs: impl IntoIterator<Item = u64>, [width, height]: [usize; 2], every: Duration) {
        for seq in seqs {
            self.take_sized(seq, width, height);
            tokio::time::sleep(every).await;
        }
    }

    /// Takes a grey frame of a size.
    pub(crate) fn take_sized(&self, seq: u64, width: usize, height: usize) {
        self.take_image(seq, RawImage::from_u8(width, height, vec![seq as u8; width * height]));
    }

    /// Takes a frame.
    pub(crate) fn take_image(&self, seq: u64, image: RawImage) {
        let pose = |mm| AxisPose { position: Some(Millimetres(mm)), settled: true };
        let now = Instant::now();
        let frame = Frame {
            image: Arc::new(image),
            seq,
            exposed_from: now - Duration::from_millis(10),
            exposed_to: now,
            exposure_assumed: true,
            captured_at: jiff::Timestamp::now(),
            focus: pose(0.25),
            e: AxisPose { position: None, settled: true },
            preview: true,
            simulated: false,
            replayed: false,
        };
        self.live.send_replace(Some(Arc::new(frame)));
    }
}

#[async_trait]
impl FrameSource for FedCamera {
    fn state(&self) -> watch::Receiver<CameraState> {
        self.state.subscribe()
    }

    fn live(&self) -> watch::Receiver<Option<Arc<Frame>>> {
        self.live.subscribe()
    }

    fn newest(&self) -> Option<Arc<Frame>> {
        self.live.borrow().clone()
    }

    async fn frame(&self, _: Instant) -> Result<Arc<Frame>, DeviceError> {
        // The sender lives as long as the camera.
        let _ = self.hangs.subscribe().wait_for(|hangs| !hangs).await;
        Err(DeviceError::Disconnected { device: "camera".into(), reason: "a stand-in".into() })
    }

    async fn controls(&self) -> Result<Vec<LightControl>, DeviceError> {
        Ok(self.controls.lock().unwrap().clone())
    }

    async fn set_control(&self, _: ControlName, _: f64) -> Result<(), DeviceError> {
        Err(DeviceError::Disconnected { device: "camera".into(), reason: "gone while it was set".into() })
    }
}

/// The stand-ins, for a test to hold on to.
pub(crate) struct Fakes {
    pub(crate) focus: Arc<StillStage>,
    pub(crate) e: Arc<StillStage>,
    pub(crate) camera: Arc<FedCamera>,
    pub(crate) bench: Bench,
}

pub(crate) fn fakes() -> Fakes {
    let state = CameraState {
        driver: "fed".into(),
        identity: "stand-in".into(),
        online: true,
        fault: None,
        frames_lost: 0,
        frames_damaged: 0,
        notes: Vec::new(),
        replay: false,
        unfit: None,
        size: None,
        white: None,
    };
    let camera = Arc::new(FedCamera {
        state: watch::channel(state).0,
        live: watch::channel(None).0,
        hangs: watch::channel(false).0,
        controls: Mutex::default(),
    });
    let e = Arc::new(StillStage::new(AxisName::E));
    let focus = Arc::new(StillStage::new(AxisName::Focus));
    let bench = Bench { focus: focus.clone(), e: e.clone(), camera: camera.clone(), simulated: None };
    Fakes { focus, e, camera, bench }
}

/// Whoever stands at a simulated bench and sets up what a job asks for; confirming it is the test's.
pub(crate) struct Hand {
    pub(crate) truth: Arc<Truth>,
    /// Whether it pushes the lens to the least e by hand, where a job asks for that.
    pub(crate) pushes_the_lens: bool,
}

impl SimulatedOperator for Hand {
    fn obey(&self, setup: &Setup) {
        if self.pushes_the_lens || !matches!(setup, Setup::LeastE { .. }) {
            self.truth.obey(setup);
        }
    }

    fn confirms(&self) -> bool {
        false
    }

    fn truth(&self) -> serde_json::Value {
        self.truth.report()
    }

    fn faults(&self) -> Faults {
        Faults::default()
    }

    fn set_faults(&self, _: Faults) {}
}
