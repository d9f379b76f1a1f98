//! The shell loop (Eq. 16): with the shell on, e is translated until the spacing meets its target; where that lies
//! beyond the wall, e stays at its optimum and Δv is trimmed (Eq. 8 with e fixed). Pure: measurement in, decision out.
//!
//! The wall holds twice: in the homed axis's coordinate, and in e as the picture has it. Until scale and zero of the
//! axis are confirmed by the picture, a move towards the shell covers at most 85 % of the estimated distance, and ends this
//! side of the wall at any scale of the axis that the picture has not excluded: what the configuration says of the scale is
//! what a wrong `steps_per_mm` makes untrue. Beside it the [`Room`] holds: e may be wrong by more than the picture scatters.

mod decide;

use super::at_pose::AtPose;
use super::axis_model::{AxisModel, MoveFault, check_move, follows};
use super::calibrated::CalibratedCamera;
use super::room::Room;
use bench::config::ShellStep;
use bench::device::AxisName;

/// Share of the estimated distance to the optimum that a move may cover before scale and zero are confirmed.
const UNCONFIRMED_SHARE: f64 = 0.85;
/// The picture's e must be known this well (mm) where a move is to end before scale and zero count as confirmed.
const CONFIRMED_SIGMA_MM: f64 = 0.4;
/// Measurements at one pose before the uncertainty is called too large.
const MAX_MEASUREMENTS_AT_A_POSE: u32 = 11;
/// Moves of either axis before the loop gives up, the probe not counted.
const MAX_MOVES: u32 = 12;
/// The last of them, which are for the spacing: held off by the room, e goes nearer to the shell with the others alone.
const MOVES_FOR_SPACING: u32 = 3;
/// The last trim scales the next one, unless it differs by more than this factor from what the camera says.
const TOLD_WITHIN: f64 = 2.0;
/// A trim that the picture contradicts by no more than this is not held against the focus axis at once, mm: a carriage that
/// sticks arrives as far beside its reading.
const STICKS_MM: f64 = super::axis_model::READBACK_TOLERANCE_MM;
/// Standard uncertainties of what the picture shows of a trim that are no contradiction.
const TOLD_SIGMAS: f64 = 4.0;
/// This many contradictions in a row are a fault: one in a thousand of the carriages that stick shows as many.
const MOST_STUCK: u32 = 6;
/// Standard uncertainties of e, as the picture scatters, that a move keeps away from the wall: where the picture cannot tell
/// e, only as much of the way is gone as the axis alone is good for.
const WALL_SIGMAS: f64 = 3.0;
/// The axis's scale is told once what the picture has not excluded is within this share of what it shows.
const SCALE_TOLD: f64 = 0.1;
/// An axis that the picture has not been seen to follow goes on so many times as far as it has gone, to be told.
const UNFOLLOWED: f64 = 4.0;

/// What the loop is to reach, and what it may use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShellGoal {
    /// e wanted: max(0, l_bound), mm.
    pub e_mm: f64,
    /// The wall: no reading and no estimated e may pass it, mm.
    pub wall_mm: f64,
    /// Tolerance of e, mm.
    pub tolerance_mm: f64,
    /// Spacing wanted (Eq. 16), px.
    pub spacing_px: f64,
    /// By how much it may be off, px.
    pub spacing_tolerance_px: f64,
    /// What may be changed.
    pub step: ShellStep,
    /// Greatest reading of the e axis, mm.
    pub high_limit_mm: f64,
    /// Standard relative uncertainty of the e axis's scale.
    pub scale_sigma: f64,
    /// Standard uncertainty of the e axis's zero, mm.
    pub zero_sigma_mm: f64,
    /// Lost motion of the e axis on reversal, mm, at most.
    pub backlash_mm: f64,
    /// How far below its target the e axis goes on its way there, mm: 0 where it is approached from above.
    pub leg_mm: f64,
    /// Reading of the e axis at its home, where its zero is best known, mm.
    pub home_mm: f64,
    /// Length of the first move, mm; twice that is to be free on both sides of the axis.
    pub probe_mm: f64,
    /// Longest move of e, mm.
    pub most_mm: f64,
    /// Longest trim of Δv, mm: more than the air step can have left and e's zero can ask for.
    pub most_trim_mm: f64,
    /// How far e may be taken from its optimum to meet the criterion before Δv is trimmed instead, mm.
    pub departure_mm: f64,
}

/// What was measured at one pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShellObservation {
    /// Readback of the e axis, mm.
    pub e_reading_mm: f64,
    /// Δv less that of the end of the air step, as the focus axis's model has it, mm.
    pub trim_mm: f64,
    /// Spacing on axis, px.
    pub spacing_px: f64,
    /// Its standard uncertainty, px.
    pub sigma_px: f64,
    /// The part of it that is from pixel noise, px.
    pub sigma_random_px: f64,
}

impl ShellObservation {
    /// Puts it at the end of what was measured at pose after pose: the measurements of one pose come combined.
    pub fn put_after(self, poses: &mut Vec<Self>) {
        poses.pop_if(|last| last.e_reading_mm == self.e_reading_mm && last.trim_mm == self.trim_mm);
        poses.push(self);
    }
}

/// What to do next.
#[derive(Debug, Clone, PartialEq)]
pub enum ShellDecision {
    /// Make the first, short move of the e axis and see whether the picture follows.
    ProbeE {
        /// Reading to go to, mm.
        to_mm: f64,
    },
    /// Move the e axis.
    MoveE {
        /// Reading to go to, mm.
        to_mm: f64,
        /// Spacing expected there, px.
        predicted_px: f64,
    },
    /// Trim Δv with e held.
    Trim {
        /// Change of the trim, mm.
        by_mm: f64,
        /// Spacing expected after it, px.
        predicted_px: f64,
    },
    /// Measure again at the same place and combine.
    MoreFrames,
    /// The criterion is met once: measure again to be sure.
    Verify,
    /// The criterion is met and verified.
    Done,
    /// The criterion cannot be met.
    NotConverged {
        /// Why, in words.
        why: String,
    },
    /// The picture contradicts the moves.
    Fault(MoveFault),
}

/// The loop's memory.
#[derive(Debug, Clone)]
pub struct ShellLoop {
    goal: ShellGoal,
    camera: CalibratedCamera,
    model: AxisModel,
    pose: Option<Pose>,
    previous: Option<ShellObservation>,
    /// e by the picture alone wherever the axis stood before any trim, the last place last.
    shown: Vec<Shown>,
    probed: bool,
    moves: u32,
    at_optimum: bool,
    trimmed: bool,
    /// Trims in a row that the picture has contradicted by as little as an axis sticks.
    stuck: u32,
    verifying: bool,
    /// The room between lens and shell by all that was seen; nothing goes towards the shell without.
    room: Option<Room>,
    /// Whether the room, and not the wall, has kept e away from where it was wanted.
    held_off: bool,
}

/// The measurements at the present pose, combined.
#[derive(Debug, Clone)]
struct Pose {
    combined: ShellObservation,
    measurements: AtPose,
}

/// e by the picture alone at a reading of the axis, mm.
#[derive(Debug, Clone, Copy)]
struct Shown {
    reading: f64,
    e: f64,
    sigma: f64,
}

/// A way of the e axis by its readings, what the picture shows of it, and the standard uncertainty of that; mm.
#[derive(Debug, Clone, Copy)]
struct Way {
    travel: f64,
    seen: f64,
    sigma: f64,
    /// By how much it may be another than is shown, play included, mm.
    untold: f64,
}

impl Way {
    fn is_followed(self) -> bool {
        follows(self.travel, self.seen, self.sigma)
    }

    fn tells_scale(self) -> bool {
        self.is_followed() && self.untold <= SCALE_TOLD * self.seen
    }
}

impl ShellLoop {
    /// A loop that has seen nothing.
    #[must_use]
    pub fn new(goal: ShellGoal, camera: CalibratedCamera) -> Self {
        assert!(goal.tolerance_mm > 0.0 && goal.wall_mm < goal.high_limit_mm);
        let model = AxisModel::new(goal.home_mm, goal.home_mm, goal.zero_sigma_mm, goal.scale_sigma);
        Self {
            goal,
            camera,
            model,
            pose: None,
            previous: None,
            shown: Vec::new(),
            probed: false,
            moves: 0,
            at_optimum: false,
            trimmed: false,
            stuck: 0,
            verifying: false,
            room: None,
            held_off: false,
        }
    }

    /// Moves decided so far, the probe not counted.
    #[must_use]
    pub fn moves(&self) -> u32 {
        self.moves
    }

    /// What the e axis's readings mean, once the picture has told their scale.
    #[must_use]
    pub fn told(&self) -> Option<AxisModel> {
        self.way().is_some_and(Way::tells_scale).then_some(self.model)
    }

    /// What the e axis's readings will mean once it has been homed, where the picture shows it to go further than they say.
    #[must_use]
    pub fn when_homed(&self) -> Option<AxisModel> {
        let ShellGoal { home_mm, zero_sigma_mm, backlash_mm, .. } = self.goal;
        let way = self.way()?;
        let (scale, sigma) = (way.seen / way.travel, way.sigma.hypot(backlash_mm) / way.travel);
        let covariance = [[zero_sigma_mm * zero_sigma_mm, 0.0], [0.0, sigma * sigma]];
        (scale > 1.0).then(|| AxisModel::known(home_mm, [home_mm, scale], covariance))
    }

    /// What the e axis's readings mean, as far as the picture has shown.
    #[must_use]
    pub fn model(&self) -> &AxisModel {
        &self.model
    }

    /// True travel of e over commanded travel, once the picture has followed a move: until then it is the configuration's.
    #[must_use]
    pub fn scale(&self) -> Option<f64> {
        self.way().is_some_and(Way::is_followed).then(|| self.model.scale().0)
    }

    /// The measurements at the present pose, combined.
    #[must_use]
    pub fn here(&self) -> Option<ShellObservation> {
        self.pose.as_ref().map(|pose| pose.combined)
    }

    /// Whether Δv was trimmed.
    #[must_use]
    pub fn trimmed(&self) -> bool {
        self.trimmed
    }

    /// The room between lens and shell by all that was seen.
    #[must_use]
    pub fn room(&self) -> Option<Room> {
        self.room
    }

    /// Whether e stays further from the shell than wanted, because it is not known well enough to go nearer.
    #[must_use]
    pub fn held_off(&self) -> bool {
        self.held_off
    }

    /// Whether the wall, which is of the axis's reading, keeps e from its optimum.
    #[must_use]
    pub fn walled_off(&self) -> bool {
        let Some(here) = self.here() else { return false };
        let (e, sigma) = self.model.predict(here.e_reading_mm);
        let at_wall = here.e_reading_mm - self.goal.wall_mm <= self.goal.tolerance_mm;
        at_wall && e - self.goal.e_mm > self.goal.tolerance_mm.max(2.0 * sigma)
    }

    /// Takes in a measurement and decides. `room` is the room between lens and shell once what was measured at this pose is
    /// known: without one nothing goes towards the shell.
    pub fn next(
        &mut self,
        observation: ShellObservation,
        room: impl FnOnce(ShellObservation) -> Option<Room>,
    ) -> ShellDecision {
        let same_place = self.here().is_some_and(|here| {
            (here.e_reading_mm - observation.e_reading_mm).abs() < 1e-6
                && (here.trim_mm - observation.trim_mm).abs() < 1e-9
        });
        if !same_place {
            self.previous = self.here();
        }
        let mut pose = self
            .pose
            .take()
            .filter(|_| same_place)
            .unwrap_or_else(|| Pose { combined: observation, measurements: AtPose::new() });
        let combined =
            pose.measurements.take(observation.spacing_px, observation.sigma_px, observation.sigma_random_px);
        (pose.combined.spacing_px, pose.combined.sigma_px) = (combined.value, combined.sigma);
        let (here, measurements) = (pose.combined, pose.measurements.count());
        self.pose = Some(pose);
        self.room = room(here);
        if !same_place
            && let Some(previous) = self.previous
            && let Some(fault) = self.contradiction(previous, here)
        {
            if !self.trimmed {
                self.keep_shown(here);
            }
            return ShellDecision::Fault(fault);
        }
        if !self.trimmed {
            // After a trim the spacing says what the trim did, no longer where e is.
            let e = self.camera.e_mm(observation.spacing_px, observation.trim_mm);
            let sigma = self.camera.e_sigma_mm(e, observation.trim_mm, observation.sigma_px);
            if e.is_finite() && sigma.is_finite() {
                self.model.observe(observation.e_reading_mm, e, sigma);
            }
            self.keep_shown(here);
            if let Some(fault) = self.model.fault(AxisName::E, observation.e_reading_mm) {
                return ShellDecision::Fault(fault);
            }
        }
        self.decide(here, measurements)
    }

    fn keep_shown(&mut self, here: ShellObservation) {
        let e = self.camera.e_mm(here.spacing_px, here.trim_mm);
        let sigma = self.camera.e_sigma_mm(e, here.trim_mm, here.sigma_px);
        if e.is_finite() && sigma.is_finite() {
            let reading = here.e_reading_mm;
            self.shown.pop_if(|last| (last.reading - reading).abs() < 1e-6);
            self.shown.push(Shown { reading, e, sigma });
        }
    }

    /// The longest way that the axis has gone, as the picture has it.
    fn way(&self) -> Option<Way> {
        let by_reading = |one: &&Shown, other: &&Shown| one.reading.total_cmp(&other.reading);
        let (low, high) = self.shown.iter().min_by(by_reading).zip(self.shown.iter().max_by(by_reading))?;
        let travel = high.reading - low.reading;
        let sigma = low.sigma.hypot(high.sigma);
        let untold = TOLD_SIGMAS * sigma + self.goal.backlash_mm;
        (travel > 0.0).then_some(Way { travel, seen: high.e - low.e, sigma, untold })
    }

    /// The reading (mm) nearest to the shell that one move may go to: this side of the wall at any scale that the picture
    /// has not excluded, and anywhere once the scale is told.
    fn nearest(&self, here: ShellObservation) -> f64 {
        let from = here.e_reading_mm;
        let Some(way) = self.way() else { return from - self.goal.probe_mm };
        if way.tells_scale() {
            return f64::NEG_INFINITY;
        }
        let free = (self.model.predict(from).0 - self.goal.wall_mm).max(0.0);
        let clear = free * way.travel / (way.seen.abs() + way.untold);
        from - if way.is_followed() { clear } else { clear.min(UNFOLLOWED * way.travel) }
    }

    fn contradiction(&mut self, previous: ShellObservation, here: ShellObservation) -> Option<MoveFault> {
        let travel = here.e_reading_mm - previous.e_reading_mm;
        if travel.abs() > 1e-6 {
            let estimate = |o: ShellObservation| self.camera.e_mm(o.spacing_px, o.trim_mm);
            let (from, to) = (estimate(previous), estimate(here));
            let sigma = |e: f64, o: ShellObservation| o.sigma_px / self.camera.slope_e(e, o.trim_mm).abs();
            let sigma_mm = sigma(from, previous).hypot(sigma(to, here));
            return check_move(AxisName::E, self.model.scale().0 * travel, to - from, sigma_mm, self.goal.backlash_mm);
        }
        let trim = here.trim_mm - previous.trim_mm;
        let e = self.model.predict(here.e_reading_mm).0;
        let measured = self.camera.trim_between(previous.spacing_px, here.spacing_px, e, previous.trim_mm);
        let slope = |o: ShellObservation| self.camera.slope_delta_v(e, o.trim_mm).abs();
        let sigma_mm = (previous.sigma_px / slope(previous)).hypot(here.sigma_px / slope(here));
        // The focus axis is allowed a micrometre beyond its uncertainty: a trim may be as short as that.
        let fault = check_move(AxisName::Focus, trim, measured, sigma_mm, 0.002);
        let sticks = fault.is_some() && (measured - trim).abs() <= STICKS_MM + TOLD_SIGMAS * sigma_mm;
        self.stuck = if sticks { self.stuck + 1 } else { 0 };
        // It is made again, as if it had not been.
        self.moves = self.moves.saturating_sub(u32::from(sticks));
        fault.filter(|_| !sticks || self.stuck >= MOST_STUCK)
    }
}

#[cfg(test)]
mod tests;
