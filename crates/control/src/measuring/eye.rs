//! What the jobs see: frames taken at rest, measured away from the runtime's threads.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use jiff::Timestamp;
use tokio::sync::watch;
use tokio::time::Instant;

use super::repeats::Repeats;
use super::sight::{CameraSeen, HoldB, Measured, Sight, Unseen};
use crate::budget::AirStep;
use crate::clock::{Part, enter};
use crate::events::{FieldMap, InView, MeasurementView, ShellState, TargetSource};
use crate::history::journal::Journal;
use crate::loops::calibrated::CalibratedCamera;
use crate::motion::Motion;
use crate::plan::{AcceptedWithin, AirBoards, most_trim_mm};
use crate::recording::{Answer, Happening};
use crate::running::end::JobEnd;
use crate::set_up::{Moment, SetUp};
use crate::spacing::{SpacingReading, TiltChange};
use bench::config::{Config, SpacingTarget};
use bench::device::{AxisName, AxisPose, Bench, DeviceError, Frame};
use bench::telemetry;
use plenoptics::imaging::clarity::{self, Sharpness};
use plenoptics::imaging::measurement::evened;
use plenoptics::optics::{CameraDesign, Solution};
use plenoptics::raw::RawImage;
use plenoptics::units::Millimetres;

/// How long the axes may take to settle after a move that has ended.
const SETTLING_ALLOWED: Duration = Duration::from_secs(10);
/// A frame that spans motion is taken again this often.
const FRAME_TRIES: u32 = 5;
/// Frames that look as if the spacing had changed while the shutter was open are taken again this often: one alone may be
/// wrong about it, or have caught the last of a movement.
const SMEARED_TRIES: usize = 3;
/// So many standard uncertainties of their difference the spacings of frames may be apart that show the same.
const SMEARED_SIGMAS: f64 = 4.0;
/// Levels between which a pixel's noise shows, as shares of white, and the share of such pixels by which a frame is known.
const NOISY: [f32; 2] = [0.1, 0.9];
const LEAST_NOISY: f64 = 0.01;
/// What is said of a frame that has the very picture of one before it.
pub(crate) const OLD_PICTURE: &str = "two frames are the same to the last pixel: the camera gives an old picture again \
                                      as if it were new; unplug it and plug it in again";

/// A frame has the very picture of one before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct OldPicture;

impl From<OldPicture> for DeviceError {
    fn from(_: OldPicture) -> Self {
        Self::Protocol { device: "the camera".to_owned(), detail: OLD_PICTURE.to_owned() }
    }
}

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
    air_step: Mutex<Option<KeptAirStep>>,
    set_up: watch::Sender<SetUp>,
    /// The frame that was looked at last.
    looked_at: Mutex<Option<Arc<Frame>>>,
    measured: watch::Sender<Option<MeasurementView>>,
    map: watch::Sender<Option<Arc<FieldMap>>>,
    /// The e that is aimed at behind the shell, mm; `None` for the joint solution's.
    aim_mm: Mutex<Option<f64>>,
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
            air_step: Mutex::new(None),
            set_up: watch::Sender::new(SetUp { in_view: InView::Unknown, since: Moment::now() }),
            looked_at: Mutex::new(None),
            measured: watch::Sender::new(None),
            map: watch::Sender::new(None),
            aim_mm: Mutex::new(None),
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

    fn publish_map(&self, frame: &Frame, seen: &Measured) {
        if let Some(map) = &seen.map {
            self.map.send_replace(Some(Arc::new(FieldMap {
                frame_seq: frame.seq,
                captured_at: frame.captured_at,
                micro_image_pitch_px: seen.micro_image_pitch_px,
                spacing_target_px: self.target_px(),
                map: Arc::clone(map),
            })));
        }
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

    /// Forgets the white frame and what it taught: the camera is set otherwise than it was then.
    pub(crate) fn forget_white(&self) {
        *self.sight.lock().unwrap_or_else(PoisonError::into_inner) = None;
        *self.white.lock().unwrap_or_else(PoisonError::into_inner) = None;
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
    pub(crate) async fn learn(&self, frame: Arc<Frame>) -> Result<Arc<Sight>, JobEnd> {
        let (white, config, from) = (Arc::clone(&frame), Arc::clone(&self.config), Instant::now());
        let sight = Arc::new(blocking(move || Sight::from_white(&white.image, &config)).await?);
        telemetry::learnt(from.elapsed());
        *self.sight.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&sight));
        *self.white.lock().unwrap_or_else(PoisonError::into_inner) = Some(frame);
        Ok(sight)
    }

    fn need_sight(&self) -> Result<Arc<Sight>, JobEnd> {
        self.sight().ok_or_else(|| JobEnd::failed("no white frame has been taken"))
    }

    /// Whether the camera's frames may be measured at all: asked before anything moves for them.
    pub(crate) fn check_camera(&self) -> Result<(), JobEnd> {
        match &self.bench.camera.state().borrow().unfit {
            Some(why) => Err(JobEnd::failed(format!("the camera's frames are not measured: {why}"))),
            None => Ok(()),
        }
    }

    /// A frame exposed wholly while both axes stood settled, with another picture than those before it.
    async fn frame(&self) -> Result<Arc<Frame>, JobEnd> {
        let mut ended = JobEnd::failed(format!("{FRAME_TRIES} frames in a row spanned motion of an axis"));
        for _ in 0..FRAME_TRIES {
            let _settling = enter(Part::Settling);
            let settled = tokio::time::timeout(SETTLING_ALLOWED, async {
                loop {
                    if let Some(from) = self.motion.settled_from() {
                        return from;
                    }
                    tokio::time::sleep(Duration::from_millis(20)).await;
                }
            });
            let Ok(from) = settled.await else {
                let why = self.motion.unrest().join("; ");
                return Err(JobEnd::failed(format!(
                    "the axes did not come to rest within {SETTLING_ALLOWED:?}: {why}"
                )));
            };
            let before = self.bench.camera.newest();
            let frame = match self.frame_from(from).await {
                Ok(frame) => frame,
                Err(error) => {
                    self.journal.happened(|| Happening::Answer(Answer::no_frame(error.clone())));
                    return Err(error.into());
                }
            };
            if frame.is_settled() {
                self.journal.happened(|| Happening::Frame(Arc::clone(&frame)));
                self.check_size(&frame)?;
                if self.check_new(before.as_deref(), &frame).is_ok() {
                    return Ok(frame);
                }
                ended = JobEnd::OldPicture;
            }
        }
        Err(ended)
    }

    /// The camera's first frame from a moment on: until then what is waited for is that the axes settle.
    async fn frame_from(&self, from: Instant) -> Result<Arc<Frame>, DeviceError> {
        let mut frame = self.bench.camera.frame(from.max(Instant::now()));
        if let Ok(frame) = tokio::time::timeout_at(from, &mut frame).await {
            return frame;
        }
        let _waiting = enter(Part::Frames);
        frame.await
    }

    /// Whether a frame is of the size that is configured.
    pub(crate) fn check_size(&self, frame: &Frame) -> Result<(), DeviceError> {
        let (width, height) = (self.config.sensor.width_px, self.config.sensor.height_px);
        if (frame.image.width(), frame.image.height()) == (width as usize, height as usize) {
            return Ok(());
        }
        Err(DeviceError::WrongDevice {
            device: "the camera".to_owned(),
            expected: format!("frames of {width}x{height} px"),
            found: format!("frames of {}x{} px", frame.image.width(), frame.image.height()),
        })
    }

    /// Whether a frame is a new picture, and not the one looked at last nor `before`: noise makes no two the same to the
    /// last pixel, unless the driver gives an old one again.
    pub(crate) fn check_new(&self, before: Option<&Frame>, frame: &Arc<Frame>) -> Result<(), OldPicture> {
        let looked_at = self.looked_at.lock().unwrap_or_else(PoisonError::into_inner).replace(Arc::clone(frame));
        if ![looked_at.as_deref(), before].into_iter().flatten().any(|old| self.repeats(old, frame)) {
            return Ok(());
        }
        Err(OldPicture)
    }

    /// The frame that was looked at last.
    pub(crate) fn looked_at(&self) -> Option<Arc<Frame>> {
        self.looked_at.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The first of the frames in a row, up to this one, that have its very picture, by its sequence number.
    pub(crate) async fn first_alike(self: &Arc<Self>, frame: &Arc<Frame>) -> u64 {
        let eye = Arc::clone(self);
        self.repeats.first(frame, move |before, frame| eye.repeats(before, frame)).await
    }

    /// Whether a frame has the very picture of one before it.
    pub(crate) fn repeats(&self, before: &Frame, frame: &Frame) -> bool {
        let simulation = &self.config.bench.simulation;
        let noiseless = frame.simulated && simulation.read_noise_levels == 0.0 && simulation.electrons_per_level == 0.0;
        !noiseless && before.seq != frame.seq && is_same_picture(&before.image, &frame.image)
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

    async fn frames(&self, count: u32) -> Result<Vec<Arc<Frame>>, JobEnd> {
        let mut frames = Vec::with_capacity(count as usize);
        for _ in 0..count.max(1) {
            frames.push(self.frame().await?);
        }
        Ok(frames)
    }

    /// Takes a white frame and learns grid and vignetting from it. Returns what was found, in words.
    pub(crate) async fn take_white(&self) -> Result<String, JobEnd> {
        Ok(self.learn(self.frame().await?).await?.describe())
    }

    /// Whether the white frame no longer fits the camera as it stands: why, in words.
    pub(crate) async fn white_misfit(&self) -> Result<Option<String>, JobEnd> {
        let sight = self.need_sight()?;
        let frame = self.frame().await?;
        blocking(move || sight.misfit(&frame.image)).await
    }

    /// How sharp the raw frame is that the camera gives at rest.
    pub(crate) async fn sharpness(&self) -> Result<Sharpness, JobEnd> {
        let (frame, mosaic) = (self.frame().await?, self.config.sensor.mosaic);
        blocking(move || Ok(clarity::sharpness(&evened(&frame.image, mosaic)))).await
    }

    /// The spacing of the flat board over so many frames, which is neither kept nor shown.
    pub(crate) async fn glance(&self, count: u32) -> Result<SpacingReading, JobEnd> {
        let (_, seen) = self.unsmeared(count, Sight::spacing_alone).await?;
        Ok(seen.spacing)
    }

    /// Measures the spacing of the flat board over so many frames; `near_px` is what it was last seen to be (px).
    pub(crate) async fn spacing(&self, count: u32, near_px: Option<f64>) -> Result<Seen, JobEnd> {
        let (frames, seen) = self
            .unsmeared(count, move |sight, images| {
                let from = Instant::now();
                let seen = sight.spacing(images, near_px);
                telemetry::measured(from.elapsed());
                seen
            })
            .await?;
        Ok(self.seen(&frames, seen.of_one_board()?))
    }

    /// Measures boards in air over so many frames: one with b held at what is known of it (mm), three levels with b held
    /// far from focus alone.
    pub(crate) async fn calibrate(
        &self,
        boards: AirBoards,
        known_b: (f64, f64),
        hold_b: Option<HoldB>,
        count: u32,
    ) -> Result<SeenInAir, JobEnd> {
        let look = move |sight: &Sight, images: &[&RawImage]| match boards {
            AirBoards::Levels(levels_mm) => sight.triple(images, &levels_mm, hold_b),
            AirBoards::Flat(distance_mm) => sight.flat(images, distance_mm, known_b),
        };
        let (frames, (camera, middle)) = self.unsmeared(count, look).await?;
        let middle = match boards {
            AirBoards::Levels(_) => middle,
            AirBoards::Flat(_) => middle.of_one_board()?,
        };
        Ok(SeenInAir { camera, middle: self.seen(&frames, middle) })
    }

    /// So many frames and what is seen in them; others where they look smeared. Where all do, and yet show the same, nothing
    /// has moved.
    async fn unsmeared<T: Saw + Send + 'static>(
        &self,
        count: u32,
        look: impl Fn(&Sight, &[&RawImage]) -> Result<T, Unseen> + Copy + Send + 'static,
    ) -> Result<(Vec<Arc<Frame>>, T), JobEnd> {
        let sight = self.need_sight()?;
        let mut before = Vec::new();
        loop {
            let frames = self.frames(count).await?;
            let last = before.len() + 1 == SMEARED_TRIES;
            let (taken, earlier, sight) = (frames.clone(), before.clone(), Arc::clone(&sight));
            let seen = blocking(move || match look(&sight, &images(&taken)) {
                Err(Unseen::Smeared(_)) if !last => Ok(None),
                Err(Unseen::Smeared(why)) => {
                    let still = sight.at_rest();
                    let seen = look(&still, &images(&taken))?;
                    let agree = |frames: &Vec<Arc<Frame>>| -> Result<bool, String> {
                        let (one, other) = (seen.saw(), look(&still, &images(frames))?.saw().clone());
                        let sigma = one.spacing_sigma_px.hypot(other.spacing_sigma_px);
                        Ok((one.spacing_px - other.spacing_px).abs() <= SMEARED_SIGMAS * sigma)
                    };
                    for frames in &earlier {
                        if !agree(frames)? {
                            return Err(why);
                        }
                    }
                    Ok(Some(seen))
                }
                seen => Ok(Some(seen?)),
            });
            if let Some(seen) = seen.await? {
                return Ok((frames, seen));
            }
            before.push(frames);
        }
    }

    fn seen(&self, frames: &[Arc<Frame>], seen: Measured) -> Seen {
        let last = frames.last();
        let position =
            |pose: fn(&Frame) -> AxisPose| last.and_then(|frame| pose(frame).position).map(Millimetres::value);
        let (focus_mm, e_mm) = (position(|frame| frame.focus), position(|frame| frame.e));
        if let Some(frame) = last {
            let view = self.view(frame, &seen);
            self.journal.measured(&view);
            self.publish_map(frame, &seen);
            // Of three boards there is none.
            let map = seen.map.as_ref().and_then(|_| self.map.borrow().clone());
            self.journal.happened(|| Happening::Measured(Box::new(view.clone()), map));
            self.measured.send_replace(Some(view));
        }
        let eog = seen.eog.map(|eog| eog.mean_per_pixel);
        let taken = last.map_or_else(Instant::now, |frame| frame.exposed_to);
        let Measured { spacing, sigma_random_px, tilt_sigma_px, window_px, picture, .. } = seen;
        let target_px = self.target_px();
        let in_view = self.in_view();
        Seen {
            taken,
            spacing,
            in_view,
            target_px,
            focus_mm,
            e_mm,
            eog,
            sigma_random_px,
            tilt_sigma_px,
            window_px,
            picture,
        }
    }

    fn view(&self, frame: &Frame, seen: &Measured) -> MeasurementView {
        let (spacing_target_px, spacing_target_source) = self.target();
        let spacing_px = seen.spacing.spacing_px;
        // One level alone has no map.
        let near = if seen.map.is_some() { self.is_field_in_focus(spacing_px) } else { self.is_in_focus(spacing_px) };
        MeasurementView {
            frame_seq: frame.seq,
            captured_at: frame.captured_at,
            focus_mm: frame.focus.position.map(Millimetres::value),
            e_mm: frame.e.position.map(Millimetres::value),
            settled: frame.is_settled(),
            spacing: seen.spacing.clone(),
            spacing_target_px,
            spacing_target_source,
            spacing_tolerance_px: Some(self.tolerance_px()),
            in_focus: seen.two_boards.is_none() && near,
            // A board of several levels is one that shows several.
            two_boards: seen.two_boards.filter(|_| self.in_view() != InView::SteppedBoard),
            micro_image_pitch_px: seen.micro_image_pitch_px,
            micro_image_pitch_sigma_px: Some(seen.micro_image_pitch_sigma_px),
            eog: seen.eog.map(|eog| eog.mean_per_pixel),
            eog_sum: seen.eog.map(|eog| eog.sum),
            ssim: seen.ssim,
        }
    }

    /// Measures the newest live frame, coarse as it may be; `None` where there is nothing to be measured. The error is why it cannot
    /// be, and whether nothing but motion is to blame.
    pub(crate) async fn measure_live(&self) -> Option<Result<MeasurementView, Unmeasured>> {
        self.sight()?;
        let mut live = self.bench.camera.live();
        let frame =
            tokio::time::timeout(Duration::from_secs(2), live.wait_for(Option::is_some)).await.ok()?.ok()?.clone()?;
        let at_rest = frame.is_settled();
        Some(self.measured_whole(&frame).await.map_err(|unseen| Unmeasured {
            by_motion: !at_rest || matches!(unseen, Unseen::Smeared(_)),
            why: unseen.into(),
        }))
    }

    /// Measures the spacing in one frame; the error is why it cannot be, in words.
    pub(crate) async fn measure_frame(&self, frame: &Arc<Frame>) -> Result<MeasurementView, String> {
        Ok(self.measured_whole(frame).await?)
    }

    async fn measured_whole(&self, frame: &Arc<Frame>) -> Result<MeasurementView, Unseen> {
        let sight = self.sight().ok_or_else(|| "no white frame has been taken".to_owned())?;
        let (image, from) = (Arc::clone(&frame.image), Instant::now());
        let seen = tokio::task::spawn_blocking(move || sight.spacing(&[&image], None))
            .await
            .map_err(|error| format!("the measurement ended unexpectedly: {error}"))??;
        telemetry::measured(from.elapsed());
        self.publish_map(frame, &seen);
        Ok(self.view(frame, &seen))
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

/// What has a spacing in it that was seen.
trait Saw {
    /// The spacing.
    fn saw(&self) -> &SpacingReading;
}

impl Saw for Measured {
    fn saw(&self) -> &SpacingReading {
        &self.spacing
    }
}

impl Saw for (CameraSeen, Measured) {
    fn saw(&self) -> &SpacingReading {
        &self.1.spacing
    }
}

fn images(frames: &[Arc<Frame>]) -> Vec<&RawImage> {
    frames.iter().map(|frame| &*frame.image).collect()
}

/// Whether two frames are the same to the last pixel, and noisy: a sensor that sees nothing but black or white may well
/// repeat itself. In the dark those pixels are noisy that are not as black as the blackest.
fn is_same_picture(one: &RawImage, other: &RawImage) -> bool {
    let white = f32::from(one.white_level());
    let is_noisy = |frame: &RawImage| {
        let levels = frame.to_f32();
        let blackest = levels.iter().copied().fold(f32::INFINITY, f32::min);
        let noisy = |&&level: &&f32| level < NOISY[1] * white && (level > blackest || level >= NOISY[0] * white);
        levels.iter().filter(noisy).count() as f64 >= LEAST_NOISY * levels.len() as f64
    };
    one == other && is_noisy(one)
}

async fn blocking<T: Send + 'static>(work: impl FnOnce() -> Result<T, String> + Send + 'static) -> Result<T, JobEnd> {
    let _measuring = enter(Part::Measuring);
    match tokio::task::spawn_blocking(work).await {
        Ok(result) => result.map_err(|why| JobEnd::Unmeasurable { why }),
        Err(error) => Err(JobEnd::failed(format!("a measurement ended unexpectedly: {error}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_known_again_by_its_noise() {
        let frame = |level: u8, one: u8| {
            let mut samples = vec![level; 100 * 100];
            samples[17] = one;
            RawImage::from_u8(100, 100, samples)
        };
        assert!(is_same_picture(&frame(120, 130), &frame(120, 130)));
        assert!(!is_same_picture(&frame(120, 130), &frame(120, 131)));
        // A cap on the lens, and a lamp in it.
        assert!(!is_same_picture(&frame(0, 130), &frame(0, 130)));
        assert!(!is_same_picture(&frame(255, 130), &frame(255, 130)));
        let dark = |seed: usize| {
            RawImage::from_u8(
                100,
                100,
                (0..100 * 100).map(|i| u8::from((i * 7919 + seed).is_multiple_of(23))).collect(),
            )
        };
        assert!(is_same_picture(&dark(1), &dark(1)));
        assert!(!is_same_picture(&dark(1), &dark(2)));
    }
}
