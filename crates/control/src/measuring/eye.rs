//! What the jobs see: frames taken at rest, measured away from the runtime's threads.

pub(crate) mod frames;
mod whole;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use jiff::Timestamp;
use tokio::sync::watch;
use tokio::time::Instant;

use super::repeats::Repeats;
use super::sight::{CameraSeen, Sight};
use crate::budget::AirStep;
use crate::clock::{Part, enter};
use crate::events::{FieldMap, InView, MeasurementView, ShellState, TargetSource};
use crate::history::journal::Journal;
use crate::loops::calibrated::CalibratedCamera;
use crate::measuring::not_measured::NotMeasured;
use crate::motion::Motion;
use crate::plan::{AcceptedWithin, most_trim_mm};
use crate::set_up::{Moment, SetUp};
use crate::spacing::{SpacingReading, TiltChange};
use bench::config::{Config, SpacingTarget};
use bench::device::{AxisName, Bench, Frame};
use bench::telemetry;
use plenoptics::optics::{CameraDesign, Solution};

/// A spacing seen, with the pose of its last frame.
#[derive(Debug, Clone)]
pub(crate) struct Seen {
    /// End of the last frame's exposure.
    pub(crate) taken: Instant,
    /// The spacing.
    pub(crate) spacing: SpacingReading,
    /// What stood before the lens then.
    pub(crate) in_view: InView,
    /// The spacing that was wanted then, px.
    pub(crate) target_px: f64,
    /// Readback of the focus axis, mm; `None` while unknown.
    pub(crate) focus_mm: Option<f64>,
    /// Readback of the e axis, mm; `None` while unknown.
    pub(crate) e_mm: Option<f64>,
    /// Energy of gradient of the central view, mean per pixel, of a single board.
    pub(crate) eog: Option<f64>,
    /// The part of the spacing's standard uncertainty that is from pixel noise, px.
    pub(crate) sigma_random_px: f64,
    /// Standard uncertainty of either tilt, px per half frame width.
    pub(crate) tilt_sigma_px: f64,
    /// Radius of the masks that pairs were compared with, px.
    pub(crate) window_px: f64,
    /// The central view, a JPEG, of a single board.
    pub(crate) picture: Option<Arc<Vec<u8>>>,
}

impl Seen {
    /// How the tilt has changed through the shell since boards in air were seen.
    pub(crate) fn tilt_change_since(&self, in_air: &Self) -> TiltChange {
        let (one, other) = (&in_air.spacing, &self.spacing);
        TiltChange {
            px: [other.tilt_x_px - one.tilt_x_px, other.tilt_y_px - one.tilt_y_px],
            sigma_px: in_air.tilt_sigma_px.hypot(self.tilt_sigma_px),
            least_sigma_px: one.least_tilt_sigma_px().hypot(other.least_tilt_sigma_px()),
        }
    }
}

/// Boards in air seen.
#[derive(Debug, Clone)]
pub(crate) struct SeenInAir {
    /// What their spacings say about the camera.
    pub(crate) camera: CameraSeen,
    /// The middle one, or the only one.
    pub(crate) middle: Seen,
}

/// Why a live frame could not be measured in whole.
#[derive(Debug)]
pub(crate) struct Unmeasured {
    /// In words.
    pub(crate) why: String,
    /// Whether it spans motion, or looks as if it did: the next may not.
    pub(crate) by_motion: bool,
}

/// A white frame that a change of the camera's setting has dropped.
struct DroppedWhite {
    /// How the camera was set for it, in words.
    set: String,
    sight: Arc<Sight>,
    frame: Arc<Frame>,
}

/// What an air step left.
struct KeptAirStep {
    step: AirStep,
    /// Whether something can go on from it: the focus axis's place has been known ever since.
    holds: bool,
}

/// The bench's camera with what is known of its micro-images.
pub(crate) struct Eye {
    config: Arc<Config>,
    design: CameraDesign,
    bench: Bench,
    motion: Arc<Motion>,
    repeats: Repeats,
    journal: Arc<Journal>,
    sight: Mutex<Option<Arc<Sight>>>,
    /// The frame that it was learnt from.
    white: Mutex<Option<Arc<Frame>>>,
    dropped_white: Mutex<Option<DroppedWhite>>,
    air_step: Mutex<Option<KeptAirStep>>,
    set_up: watch::Sender<SetUp>,
    /// The frame that was looked at last.
    looked_at: Mutex<Option<Arc<Frame>>>,
    measured: watch::Sender<Option<MeasurementView>>,
    map: watch::Sender<Option<Arc<FieldMap>>>,
    /// The e that is aimed at behind the shell, mm; `None` for the joint solution's.
    aim_mm: Mutex<Option<f64>>,
    /// That the picture through the shell is not what the configuration says, in words, and since when what was seen then stands there.
    contradicted: Mutex<Option<(Instant, String)>>,
    /// The exact target that was worked out last, px: of which camera, at which e (mm).
    exact: Mutex<Option<(CalibratedCamera, f64, f64)>>,
}

impl Eye {
    /// An eye that has seen no white frame yet.
    pub(crate) fn new(config: Arc<Config>, bench: Bench, motion: Arc<Motion>, journal: Arc<Journal>) -> Self {
        Self {
            design: config.design(),
            config,
            bench,
            motion,
            journal,
            repeats: Repeats::default(),
            sight: Mutex::new(None),
            white: Mutex::new(None),
            dropped_white: Mutex::new(None),
            air_step: Mutex::new(None),
            set_up: watch::Sender::new(SetUp { in_view: InView::Unknown, since: Moment::now() }),
            looked_at: Mutex::new(None),
            measured: watch::Sender::new(None),
            map: watch::Sender::new(None),
            aim_mm: Mutex::new(None),
            contradicted: Mutex::new(None),
            exact: Mutex::new(None),
        }
    }

    /// What the jobs measured last.
    pub(crate) fn measured(&self) -> watch::Receiver<Option<MeasurementView>> {
        self.measured.subscribe()
    }

    /// The spacing over the field in the newest measurement of a single board.
    pub(crate) fn map(&self) -> watch::Receiver<Option<Arc<FieldMap>>> {
        self.map.subscribe()
    }

    /// Side of a pixel, mm.
    pub(crate) fn pixel_mm(&self) -> f64 {
        self.config.pixel_pitch().millimetres()
    }

    /// Eq. 16's spacing, px.
    pub(crate) fn paraxial_target_px(&self) -> f64 {
        self.design.mla.target_spacing() / self.pixel_mm()
    }

    /// The spacing wanted now, px: what every measurement is compared with.
    pub(crate) fn target_px(&self) -> f64 {
        self.target().0
    }

    /// The spacing wanted now, px, and what says so: through the shell what the estimator measures there by exact rays,
    /// where that is configured.
    pub(crate) fn target(&self) -> (f64, TargetSource) {
        let through_shell = self.motion.shell() == ShellState::On;
        if self.config.assembly.spacing_target == SpacingTarget::Paraxial || !through_shell {
            return (self.paraxial_target_px(), TargetSource::Paraxial);
        }
        let e = self.aimed().e;
        // A camera stays what it is when its axis's place is lost.
        match self.kept_air_step().as_ref() {
            Some(air) => (self.exact_target_px(air.step.camera, e), TargetSource::Calibration),
            None => (self.exact_target_px(CalibratedCamera::designed(&self.config, e), e), TargetSource::Design),
        }
    }

    /// By how much a spacing may be off the one wanted now where a job accepts it, px.
    pub(crate) fn tolerance_px(&self) -> f64 {
        let within = AcceptedWithin::of(&self.config, &self.aimed());
        match self.motion.shell() {
            ShellState::On => within.through_shell_px,
            ShellState::Off | ShellState::Unknown => within.in_air_px,
        }
    }

    /// A camera's exact target at e (mm), px: worked out once and kept, as every frame is compared with it.
    fn exact_target_px(&self, camera: CalibratedCamera, e: f64) -> f64 {
        let mut kept = self.exact.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((of, at, target_px)) = *kept
            && (of, at) == (camera, e)
        {
            return target_px;
        }
        let target_px = camera.exact_target_px(e);
        *kept = Some((camera, e, target_px));
        target_px
    }

    /// Sets the e (mm) that is aimed at behind the shell.
    pub(crate) fn aim_at(&self, e_mm: f64) {
        *self.aim_mm.lock().unwrap_or_else(PoisonError::into_inner) = Some(e_mm);
    }

    /// The e (mm) that is aimed at behind the shell; `None` for the joint solution's.
    pub(crate) fn aim_mm(&self) -> Option<f64> {
        *self.aim_mm.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The solution that is aimed at.
    pub(crate) fn aimed(&self) -> Solution {
        let joint = || self.design.joint(self.motion.l_bound_mm());
        self.aim_mm().map_or_else(joint, |e| self.design.clarity(e))
    }

    /// Whether a white frame has been taken.
    pub(crate) fn has_white(&self) -> bool {
        self.sight().is_some()
    }

    /// What stands before the lens.
    pub(crate) fn in_view(&self) -> InView {
        self.set_up.borrow().in_view
    }

    /// Tells whenever somebody says anew what stands there.
    pub(crate) fn setups(&self) -> watch::Receiver<SetUp> {
        self.set_up.subscribe()
    }

    /// Since when what stands there does, and the shell is on or off; now, where the clock was set back since.
    pub(crate) fn set_up_at(&self) -> Timestamp {
        self.set_up.borrow().since.wall.max(self.motion.shell_since().wall).min(Timestamp::now())
    }

    /// The same on the clock that nobody sets.
    pub(crate) fn set_up_instant(&self) -> Instant {
        self.set_up.borrow().since.unset.max(self.motion.shell_since().unset)
    }

    /// That this stands before the lens from now on; with `None` what stood there does, set up anew.
    pub(crate) fn see(&self, view: Option<InView>) {
        self.set_up.send_modify(|set_up| {
            *set_up = SetUp { in_view: view.unwrap_or(set_up.in_view), since: Moment::now() };
        });
    }

    /// That the picture through the shell is not what the configuration says, in words.
    pub(crate) fn contradict(&self, why: &str) {
        let contradicted = (self.set_up_instant(), why.to_owned());
        *self.contradicted.lock().unwrap_or_else(PoisonError::into_inner) = Some(contradicted);
    }

    /// Why the picture is not what the configuration says, in words, until something else is set up.
    pub(crate) fn contradicted(&self) -> Option<String> {
        let contradicted = self.contradicted.lock().unwrap_or_else(PoisonError::into_inner);
        contradicted.as_ref().filter(|(set_up, _)| *set_up == self.set_up_instant()).map(|(_, why)| why.clone())
    }

    /// Keeps what an air step left, for a job that goes on from it.
    pub(crate) fn keep_air_step(&self, air: AirStep) {
        *self.kept_air_step() = Some(KeptAirStep { step: air, holds: true });
    }

    /// What the newest air step left: nothing once the focus axis's position has been unknown, because a new homing
    /// repeats to tenths of a millimetre and Δv is held to thousandths.
    pub(crate) fn air_step(&self) -> Option<AirStep> {
        self.last_air_step().filter(|(_, holds)| *holds).map(|(step, _)| step)
    }

    /// What the newest air step left, and whether something can go on from it.
    pub(crate) fn last_air_step(&self) -> Option<(AirStep, bool)> {
        self.kept_air_step().as_ref().map(|kept| (kept.step.clone(), kept.holds))
    }

    fn kept_air_step(&self) -> MutexGuard<'_, Option<KeptAirStep>> {
        self.air_step.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What the newest air step left, for a shell step that goes on from it and aims at a solution.
    ///
    /// # Errors
    /// Why it cannot, in words.
    pub(crate) fn air_step_for(&self, solution: &Solution) -> Result<AirStep, String> {
        let Some(kept) = self.air_step() else {
            return Err("the shell step needs the calibration of an air step, and none has been made since the focus axis was homed: run air_only or joint_alignment first".to_owned());
        };
        if !self.has_white() {
            return Err("no white frame has been taken with the camera set as it is, and the shell step takes none: run calibration, which takes one, or air_only again".to_owned());
        }
        // The focus axis is brought back to where the air step left it, for which its place has to be known.
        self.motion.position_mm(AxisName::Focus).map_err(|error| error.to_string())?;
        let most_trim_mm = most_trim_mm(&self.config, solution);
        let (delta_v_mm, _) = kept.delta_v;
        if (delta_v_mm - solution.delta_v).abs() > most_trim_mm {
            return Err(format!(
                "the newest air step brought Δv to {delta_v_mm:.3} mm, too far from the {:.3} mm of the joint solution: run air_only or joint_alignment first",
                solution.delta_v
            ));
        }
        Ok(kept)
    }

    /// Whether a shell step can go on from the newest air step.
    pub(crate) fn air_step_holds(&self) -> bool {
        self.air_step_for(&self.design.joint(self.motion.l_bound_mm())).is_ok()
    }

    /// Forgets what the air step left.
    pub(crate) fn forget_air_step(&self) {
        *self.kept_air_step() = None;
    }

    /// That the focus axis's place has become unknown: nothing can go on from what the air step left, and the camera that it
    /// found is still that.
    pub(crate) fn lose_air_step(&self) {
        if let Some(kept) = self.kept_air_step().as_mut() {
            kept.holds = false;
        }
    }

    /// What the newest white frame taught.
    pub(crate) fn sight(&self) -> Option<Arc<Sight>> {
        self.sight.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Drops the white frame and what it taught: the camera, which was set as these words say, is set otherwise now.
    pub(crate) fn drop_white(&self, set: Option<String>) {
        let sight = self.sight.lock().unwrap_or_else(PoisonError::into_inner).take();
        let frame = self.white.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let (Some(sight), Some(frame)) = (sight, frame) {
            *self.dropped_white.lock().unwrap_or_else(PoisonError::into_inner) =
                set.map(|set| DroppedWhite { set, sight, frame });
        }
    }

    /// Takes the dropped white frame back where the camera is set again as it was for it. Returns whether it did.
    pub(crate) fn take_white_back(&self, set: Option<&str>) -> bool {
        let mut dropped = self.dropped_white.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(white) = dropped.take_if(|white| set == Some(white.set.as_str())) else { return false };
        *self.sight.lock().unwrap_or_else(PoisonError::into_inner) = Some(white.sight);
        *self.white.lock().unwrap_or_else(PoisonError::into_inner) = Some(white.frame);
        true
    }

    /// How the camera is set, in words, where it says so.
    pub(crate) async fn camera_set(&self) -> Option<String> {
        let controls = self.bench.camera.controls().await.ok()?;
        let each = controls.iter().filter_map(|control| {
            let by_itself = if control.automatic { " (which it adjusts by itself)" } else { "" };
            Some(format!("{} {}{}{by_itself}", control.name, control.value?, control.unit.suffix()))
        });
        Some(each.collect::<Vec<_>>().join(", ")).filter(|set| !set.is_empty())
    }

    /// The newest white frame.
    pub(crate) fn white_frame(&self) -> Option<Arc<Frame>> {
        self.white.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Learns grid and vignetting from a white frame taken before.
    ///
    /// # Errors
    /// Why it is none, in words.
    pub(crate) async fn learn(&self, frame: Arc<Frame>) -> Result<Arc<Sight>, NotMeasured> {
        let (white, config, from) = (Arc::clone(&frame), Arc::clone(&self.config), Instant::now());
        let sight = Arc::new(blocking(move || Sight::from_white(&white.image, &config)).await?);
        telemetry::learnt(from.elapsed());
        *self.sight.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&sight));
        *self.white.lock().unwrap_or_else(PoisonError::into_inner) = Some(frame);
        *self.dropped_white.lock().unwrap_or_else(PoisonError::into_inner) = None;
        Ok(sight)
    }

    fn need_sight(&self) -> Result<Arc<Sight>, NotMeasured> {
        self.sight().ok_or_else(|| NotMeasured::failed("no white frame has been taken"))
    }

    /// Whether a spacing (px) is within the blur limit of the one wanted.
    fn is_in_focus(&self, spacing_px: f64) -> bool {
        (spacing_px - self.target_px()).abs() <= self.config.assembly.blur_limit_px
    }

    /// The same for a spacing (px) of the whole field: of a board of several levels, or of one elsewhere, it is not the
    /// one that is wanted.
    pub(crate) fn is_field_in_focus(&self, spacing_px: f64) -> bool {
        self.in_view().is_aimed_at() && self.is_in_focus(spacing_px)
    }

    /// The devices that it sees through and past.
    pub(crate) const fn bench(&self) -> &Bench {
        &self.bench
    }

    /// The axes' motion.
    pub(crate) fn motion(&self) -> &Motion {
        &self.motion
    }

    /// Where measurements are kept.
    pub(crate) fn journal(&self) -> &Journal {
        &self.journal
    }
}

async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, String> + Send + 'static,
) -> Result<T, NotMeasured> {
    let _measuring = enter(Part::Measuring);
    match tokio::task::spawn_blocking(work).await {
        Ok(result) => result.map_err(|why| NotMeasured::Unmeasurable { why }),
        Err(error) => Err(NotMeasured::failed(format!("a measurement ended unexpectedly: {error}"))),
    }
}
