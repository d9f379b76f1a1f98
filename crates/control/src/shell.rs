//! The shell loop (Eq. 16): with the shell on, e is translated until the spacing meets its target; where that lies
//! beyond the wall, e stays at its optimum and Δv is trimmed (Eq. 8 with e fixed). Pure: measurement in, decision out.
//!
//! The wall holds twice: in the homed axis's coordinate, and in e as the picture has it. Until scale and zero of the
//! axis are confirmed by the picture, a move towards the shell covers at most 85 % of the estimated distance. Beside it the
//! [`Room`] holds: e may be wrong by more than the picture scatters.

use super::air::FREE_PROBES;
use super::at_pose::AtPose;
use super::axis_model::{AxisModel, MoveFault, check_move};
use super::calibrated::CalibratedCamera;
use super::room::Room;
use bench::config::ShellStep;

/// Share of the estimated distance to the optimum that a move may cover before scale and zero are confirmed.
const UNCONFIRMED_SHARE: f64 = 0.85;
/// The picture's e must be known this well (mm) where a move is to end before scale and zero count as confirmed.
const CONFIRMED_SIGMA_MM: f64 = 0.4;
/// Measurements at one pose before the uncertainty is called too large.
const MAX_MEASUREMENTS_AT_A_POSE: u32 = 11;
/// Moves of either axis before the loop gives up, the probe not counted.
const MAX_MOVES: u32 = 9;
/// A trim that the picture contradicts by no more than this is not held against the focus axis at once, mm: a carriage that
/// sticks arrives as far beside its reading.
const STICKS_MM: f64 = super::motion::READBACK_TOLERANCE_MM;
/// Standard uncertainties of what the picture shows of a trim that are no contradiction.
const TOLD_SIGMAS: f64 = 4.0;
/// This many contradictions in a row are a fault: one in a thousand of the carriages that stick shows as many.
const MOST_STUCK: u32 = 6;
/// Standard uncertainties of e, as the picture scatters, that a move keeps away from the wall: where the picture cannot tell
/// e, only as much of the way is gone as the axis alone is good for.
const WALL_SIGMAS: f64 = 3.0;

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

    /// What the e axis's readings mean, as far as the picture has shown.
    #[must_use]
    pub fn model(&self) -> &AxisModel {
        &self.model
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
            return ShellDecision::Fault(fault);
        }
        if !self.trimmed {
            // After a trim the spacing says what the trim did, no longer where e is.
            let e = self.camera.e_mm(observation.spacing_px, observation.trim_mm);
            let sigma = self.camera.e_sigma_mm(e, observation.trim_mm, observation.sigma_px);
            if e.is_finite() && sigma.is_finite() {
                self.model.observe(observation.e_reading_mm, e, sigma);
            }
        }
        self.decide(here, measurements)
    }

    fn contradiction(&mut self, previous: ShellObservation, here: ShellObservation) -> Option<MoveFault> {
        let travel = here.e_reading_mm - previous.e_reading_mm;
        if travel.abs() > 1e-6 {
            let estimate = |o: ShellObservation| self.camera.e_mm(o.spacing_px, o.trim_mm);
            let (from, to) = (estimate(previous), estimate(here));
            let sigma = |e: f64, o: ShellObservation| o.sigma_px / self.camera.slope_e(e, o.trim_mm).abs();
            let sigma_mm = sigma(from, previous).hypot(sigma(to, here));
            return check_move("e", self.model.scale().0 * travel, to - from, sigma_mm, self.goal.backlash_mm);
        }
        let trim = here.trim_mm - previous.trim_mm;
        let e = self.model.predict(here.e_reading_mm).0;
        let slope = self.camera.slope_delta_v(e, here.trim_mm).abs();
        let measured = (previous.spacing_px - here.spacing_px) / slope;
        let measured = if self.camera.slope_delta_v(e, here.trim_mm) < 0.0 { measured } else { -measured };
        let sigma_mm = previous.sigma_px.hypot(here.sigma_px) / slope;
        // The focus axis is allowed a micrometre beyond its uncertainty: a trim may be as short as that.
        let fault = check_move("focus", trim, measured, sigma_mm, 0.002);
        let sticks = fault.is_some() && (measured - trim).abs() <= STICKS_MM + TOLD_SIGMAS * sigma_mm;
        self.stuck = if sticks { self.stuck + 1 } else { 0 };
        // It is made again, as if it had not been.
        self.moves = self.moves.saturating_sub(u32::from(sticks));
        fault.filter(|_| !sticks || self.stuck >= MOST_STUCK)
    }

    fn decide(&mut self, here: ShellObservation, measurements: u32) -> ShellDecision {
        if !self.probed {
            return self.probe(here);
        }
        if let Some(to_mm) = self.way_back(here.e_reading_mm) {
            // It is no attempt at the criterion, and is never one too many.
            (self.at_optimum, self.verifying) = (false, false);
            let predicted_px = self.camera.spacing_px(self.model.predict(to_mm).0, here.trim_mm);
            return ShellDecision::MoveE { to_mm, predicted_px };
        }
        let goal = self.goal;
        let tolerance_px = goal.spacing_tolerance_px;
        let error_px = here.spacing_px - goal.spacing_px;
        if self.at_optimum {
            if error_px.abs() <= tolerance_px && here.sigma_px <= tolerance_px {
                if self.verifying {
                    return ShellDecision::Done;
                }
                self.verifying = true;
                return ShellDecision::Verify;
            }
            self.verifying = false;
            let near = error_px.abs() <= tolerance_px + 2.0 * here.sigma_px;
            if near && here.sigma_px > 0.5 * tolerance_px && measurements < MAX_MEASUREMENTS_AT_A_POSE {
                return ShellDecision::MoreFrames;
            }
            if error_px.abs() <= tolerance_px {
                return ShellDecision::NotConverged {
                    why: format!(
                        "uncertainty: the spacing is {:.4} ± {:.4} px after {measurements} measurements, too uncertain for a tolerance of {tolerance_px:.4} px",
                        here.spacing_px, here.sigma_px
                    ),
                };
            }
        }
        if self.moves >= MAX_MOVES {
            return ShellDecision::NotConverged {
                why: format!(
                    "after {} moves the spacing is {:.3} px and does not settle within {tolerance_px:.3} px of {:.3} px",
                    self.moves, here.spacing_px, goal.spacing_px
                ),
            };
        }
        if self.at_optimum { self.correct(here) } else { self.travel(here) }
    }

    fn probe(&mut self, here: ShellObservation) -> ShellDecision {
        self.probed = true;
        let goal = self.goal;
        // Towards the shell, the side from which every later target is approached; the wall is far by the check below.
        let free = (here.e_reading_mm - goal.wall_mm).min(goal.high_limit_mm - here.e_reading_mm);
        let e = self.model.predict(here.e_reading_mm).0;
        let free = free.min(e - goal.wall_mm);
        let needed = FREE_PROBES * goal.probe_mm;
        if free < needed {
            return ShellDecision::NotConverged {
                why: format!(
                    "the e axis stands {free:.2} mm from the wall or an end of its travel; its first move needs {needed:.2} mm free on both sides"
                ),
            };
        }
        let nearer = here.e_reading_mm - goal.probe_mm;
        let to_mm = if self.lets(nearer) { nearer } else { here.e_reading_mm + goal.probe_mm };
        ShellDecision::ProbeE { to_mm }
    }

    /// The way to the optimum, in pieces until scale and zero are confirmed.
    fn travel(&mut self, here: ShellObservation) -> ShellDecision {
        let goal = self.goal;
        let (e, sigma) = self.model.predict(here.e_reading_mm);
        let optimum = self.allowed(self.model.reading_for(goal.e_mm), here.e_reading_mm);
        let confirmed = self.model.predict(optimum).1 <= CONFIRMED_SIGMA_MM;
        let towards_shell = optimum < here.e_reading_mm;
        let to = if confirmed || !towards_shell {
            optimum
        } else {
            let estimated = (e - goal.e_mm).min(here.e_reading_mm - goal.e_mm);
            self.allowed(here.e_reading_mm - UNCONFIRMED_SHARE * estimated, here.e_reading_mm)
        };
        // Where e is not known better from picture to picture, another short move leads nowhere.
        let short = if confirmed { 0.5 * goal.tolerance_mm } else { (0.5 * goal.tolerance_mm).max(0.5 * sigma) };
        if (to - here.e_reading_mm).abs() <= short {
            if self.held_off && self.room.is_none() {
                return ShellDecision::NotConverged {
                    why: "how near the lens is to the shell cannot be told: what was seen of the boards in air and through the shell fits no camera like the configured one".to_owned(),
                };
            }
            // As near as the wall, or the picture, lets it come.
            self.at_optimum = true;
            return self.decide_again(here);
        }
        self.at_optimum = confirmed;
        self.move_e(to, here.trim_mm)
    }

    /// At the optimum by the axis's model: what the spacing still lacks.
    fn correct(&mut self, here: ShellObservation) -> ShellDecision {
        let goal = self.goal;
        let crossing_offset =
            self.camera.e_mm(goal.spacing_px, here.trim_mm) - self.camera.e_mm(here.spacing_px, here.trim_mm);
        let reading = here.e_reading_mm + crossing_offset / self.model.scale().0;
        let (e, sigma) = self.model.predict(reading);
        let clear = reading >= here.e_reading_mm || self.lets(reading);
        let known = reading >= here.e_reading_mm || sigma <= CONFIRMED_SIGMA_MM;
        let within_wall = known && reading >= goal.wall_mm && e >= goal.wall_mm && reading <= goal.high_limit_mm;
        let translate = match goal.step {
            ShellStep::TranslateE => true,
            // Far from its optimum e is not where the design wants it: Δv is what is off.
            ShellStep::TranslateEThenTrim => {
                !self.trimmed && within_wall && clear && (e - goal.e_mm).abs() <= goal.departure_mm
            }
            ShellStep::HoldETrim => false,
        };
        if translate {
            if !within_wall {
                return ShellDecision::NotConverged {
                    why: format!(
                        "the spacing {:.3} px would be met at e = {e:.2} ± {sigma:.2} mm, which may be beyond the wall at {:.2} mm; the best point is {:.3} px at e = {:.2} mm",
                        goal.spacing_px,
                        goal.wall_mm,
                        here.spacing_px,
                        self.model.predict(here.e_reading_mm).0
                    ),
                };
            }
            if !clear {
                let touches = self.room.map_or_else(String::new, |room| format!(", e = {:.2} mm", room.contact.e_mm));
                return ShellDecision::NotConverged {
                    why: format!(
                        "the spacing {:.3} px would be met at e = {e:.2} mm, nearer to where the lens touches the shell{touches} than three of what e is uncertain by (assembly.clearance_mm says how far it is; shell_step = \"translate_e_then_trim\" trims Δv instead); the best point is {:.3} px at e = {:.2} mm",
                        goal.spacing_px,
                        here.spacing_px,
                        self.model.predict(here.e_reading_mm).0
                    ),
                };
            }
            return self.move_e(reading, here.trim_mm);
        }
        let e_here = self.model.predict(here.e_reading_mm).0;
        let by = (goal.spacing_px - here.spacing_px) / self.camera.slope_delta_v(e_here, here.trim_mm);
        if (here.trim_mm + by).abs() > goal.most_trim_mm {
            return ShellDecision::NotConverged {
                why: format!(
                    "Δv would have to be trimmed by {:.3} mm, more than {:.3} mm: shell, water or board are not what is configured, or the air step no longer holds",
                    here.trim_mm + by,
                    goal.most_trim_mm
                ),
            };
        }
        self.trimmed = true;
        self.moves += 1;
        ShellDecision::Trim { by_mm: by, predicted_px: goal.spacing_px }
    }

    fn decide_again(&mut self, here: ShellObservation) -> ShellDecision {
        let measurements = self.pose.as_ref().map_or(1, |pose| pose.measurements.count());
        self.decide(here, measurements)
    }

    fn move_e(&mut self, to_mm: f64, trim_mm: f64) -> ShellDecision {
        self.moves += 1;
        let predicted_px = self.camera.spacing_px(self.model.predict(to_mm).0, trim_mm);
        ShellDecision::MoveE { to_mm, predicted_px }
    }

    /// Where the lens is taken back to from a reading (mm) at which there is too little room for it.
    fn way_back(&self, from: f64) -> Option<f64> {
        let room = self.room.filter(|room| room.asks_back(from))?;
        let (leg, highest) = (self.goal.leg_mm, self.goal.high_limit_mm.min(from + self.goal.most_mm));
        let to = room.least_mm(from - leg, highest - leg).map_or(highest, |least| least + leg);
        (to - from > 0.5 * self.goal.tolerance_mm).then_some(to)
    }

    /// Whether the room lets the lens be taken to a reading, mm, with what the axis goes beyond it on the way.
    fn lets(&self, reading: f64) -> bool {
        self.room.is_some_and(|room| room.lets(reading - self.goal.leg_mm))
    }

    /// The reading nearest the one wanted that is one move away, for which there is room, and which passes the wall neither by
    /// reading nor by estimate, and, coming from `from`, not even by an estimate that is [`WALL_SIGMAS`] off.
    fn allowed(&mut self, reading: f64, from: f64) -> f64 {
        let (wall, high) = (self.goal.wall_mm, self.goal.high_limit_mm);
        let wanted = reading.max(wall).max(self.model.reading_for(wall)).min(high);
        let leg = self.goal.leg_mm;
        let least = self.room.and_then(|room| room.least_mm(wanted - leg, high - leg));
        let reading = least.map_or_else(|| from.max(wanted), |least| least + leg);
        self.held_off = reading - wanted > 0.5 * self.goal.tolerance_mm;
        let reading = reading.clamp(from - self.goal.most_mm, from + self.goal.most_mm);
        let safe = |at: f64| {
            let (e, sigma) = self.model.predict(at);
            e - WALL_SIGMAS * sigma >= wall
        };
        if reading >= from || safe(reading) {
            return reading;
        }
        // Nearer to the shell e is known worse or as well: halving finds where it is just safe.
        let (mut near, mut far) = (reading, from);
        for _ in 0..40 {
            let middle = f64::midpoint(near, far);
            if safe(middle) {
                far = middle;
            } else {
                near = middle;
            }
        }
        far
    }
}

#[cfg(test)]
mod tests {
    use super::super::calibrated::tests::preset;
    use super::super::room::Contact;
    use super::*;

    fn goal(step: ShellStep) -> ShellGoal {
        ShellGoal {
            e_mm: 0.0,
            wall_mm: -0.1,
            tolerance_mm: 0.1,
            spacing_px: preset().design.mla.target_spacing() / preset().pixel_mm,
            step,
            high_limit_mm: 32.0,
            scale_sigma: 0.05,
            zero_sigma_mm: 0.2,
            backlash_mm: 0.05,
            leg_mm: 0.0,
            home_mm: 30.0,
            probe_mm: 0.5,
            most_mm: 40.0,
            spacing_tolerance_px: 0.016,
            most_trim_mm: 0.2,
            departure_mm: 0.6,
        }
    }

    struct Outcome {
        decisions: Vec<ShellDecision>,
        least_e: f64,
        least_reading: f64,
        spacing: f64,
        e: f64,
    }

    /// Runs the loop against a bench: true e of a reading, and what the air step left of Δv: a residual that it knows
    /// and an error that it does not.
    fn run(step: ShellStep, e_of: impl Fn(f64) -> f64, residual: f64, delta_v_error: f64, sigma: f64) -> Outcome {
        run_sticking(step, e_of, residual, |_, trim| trim + delta_v_error, sigma)
    }

    /// The same with the true trim at a turn of one by the reading.
    fn run_sticking(
        step: ShellStep,
        e_of: impl Fn(f64) -> f64,
        residual: f64,
        true_trim: impl Fn(u32, f64) -> f64,
        sigma: f64,
    ) -> Outcome {
        let mut camera = preset();
        camera.lens_to_mla_mm += residual;
        let mut shell = ShellLoop::new(goal(step), camera);
        let known =
            Room { contact: Contact { e_mm: -0.5, measured_sigma_mm: None }, e: AxisModel::new(30.0, 30.0, 0.0, 0.0) };
        let (mut reading, mut trim) = (30.0, 0.0);
        let (mut decisions, mut least_e, mut least_reading) = (Vec::new(), f64::INFINITY, f64::INFINITY);
        // Where the carriage stands does not change before it is moved again.
        let mut truly = true_trim(0, trim);
        for turn in 0..40u32 {
            least_e = least_e.min(e_of(reading));
            least_reading = least_reading.min(reading);
            let spacing = camera.spacing_px(e_of(reading), truly);
            let noise = if turn % 2 == 0 { sigma } else { -sigma };
            let seen = ShellObservation {
                e_reading_mm: reading,
                trim_mm: trim,
                spacing_px: spacing + noise,
                sigma_px: sigma,
                sigma_random_px: sigma,
            };
            let decision = shell.next(seen, |_| Some(known));
            decisions.push(decision.clone());
            match decision {
                ShellDecision::ProbeE { to_mm } | ShellDecision::MoveE { to_mm, .. } => reading = to_mm,
                ShellDecision::Trim { by_mm, .. } => {
                    trim += by_mm;
                    truly = true_trim(turn, trim);
                }
                ShellDecision::MoreFrames | ShellDecision::Verify => {}
                _ => break,
            }
        }
        let spacing = camera.spacing_px(e_of(reading), truly);
        Outcome { decisions, least_e, least_reading, spacing, e: e_of(reading) }
    }

    fn moves(outcome: &Outcome) -> usize {
        let is_move = |d: &&ShellDecision| matches!(d, ShellDecision::MoveE { .. } | ShellDecision::Trim { .. });
        outcome.decisions.iter().filter(is_move).count()
    }

    #[test]
    fn scale_zero_and_delta_v_errors_converge_without_passing_the_wall() {
        for scale in [0.95, 1.0, 1.05] {
            for zero in [-0.15, 0.0, 0.15] {
                for delta_v_error in [-0.004, 0.0, 0.004] {
                    let outcome = run(
                        ShellStep::TranslateEThenTrim,
                        |q| 30.0 + zero + scale * (q - 30.0),
                        delta_v_error / 2.0,
                        delta_v_error / 4.0,
                        0.006,
                    );
                    let what = format!("scale {scale} zero {zero} Δv {delta_v_error}: {:?}", outcome.decisions);
                    assert_eq!(outcome.decisions.last(), Some(&ShellDecision::Done), "{what}");
                    assert!((outcome.spacing - goal(ShellStep::TranslateE).spacing_px).abs() < 0.03, "{what}");
                    assert!(outcome.least_reading >= -0.1 - 1e-9, "{what}");
                    assert!(outcome.least_e >= -0.1 - 0.2, "{} {what}", outcome.least_e);
                    assert!(moves(&outcome) <= 5, "{what}");
                }
            }
        }
    }

    #[test]
    fn the_first_long_move_covers_at_most_its_share() {
        let outcome = run(ShellStep::TranslateEThenTrim, |q| q, 0.0, 0.0, 0.004);
        assert!(matches!(outcome.decisions[0], ShellDecision::ProbeE { to_mm } if (to_mm - 29.5).abs() < 1e-9));
        assert!(
            matches!(outcome.decisions[1], ShellDecision::MoveE { to_mm, .. } if to_mm >= 29.5 * 0.15 - 0.1),
            "{:?}",
            outcome.decisions
        );
    }

    #[test]
    fn beyond_the_wall_the_papers_loop_ends_and_ours_trims() {
        // Δv too large: the criterion is met only at negative e.
        let plain = run(ShellStep::TranslateE, |q| q, 0.01, 0.0, 0.004);
        assert!(matches!(plain.decisions.last(), Some(ShellDecision::NotConverged { why }) if why.contains("wall")));
        let ours = run(ShellStep::TranslateEThenTrim, |q| q, 0.01, 0.0, 0.004);
        assert_eq!(ours.decisions.last(), Some(&ShellDecision::Done), "{:?}", ours.decisions);
        assert!(ours.decisions.iter().any(|d| matches!(d, ShellDecision::Trim { .. })));
        assert!(ours.e.abs() < 0.8, "{}", ours.e);
        let held = run(ShellStep::HoldETrim, |q| q, 0.01, 0.0, 0.004);
        assert_eq!(held.decisions.last(), Some(&ShellDecision::Done), "{:?}", held.decisions);
        assert!(held.decisions.iter().any(|d| matches!(d, ShellDecision::Trim { .. })));
    }

    /// A carriage that arrives up to a hundredth of a millimetre short of its reading is trimmed again; one that never moves
    /// is a fault.
    #[test]
    fn a_focus_axis_that_sticks_is_trimmed_again() {
        let mut done = 0;
        for seed in 0..40u32 {
            let short_mm = |turn: u32| 0.01 * f64::from((seed * 97 + turn * 389 + turn * turn * 61) % 101) / 100.0;
            let sticks = |turn: u32, trim: f64| trim + 0.005 - short_mm(turn);
            let outcome = run_sticking(ShellStep::HoldETrim, |q| q, 0.0, sticks, 0.002);
            let last = outcome.decisions.last().unwrap();
            assert!(!matches!(last, ShellDecision::Fault(_)), "{seed}: {:?}", outcome.decisions);
            if *last == ShellDecision::Done {
                done += 1;
                assert!((outcome.spacing - goal(ShellStep::TranslateE).spacing_px).abs() < 0.03, "{}", outcome.spacing);
            }
        }
        assert!(done >= 36, "{done} of 40");
        let dead = run_sticking(ShellStep::HoldETrim, |q| q, 0.0, |_, _| 0.008, 0.002);
        assert!(
            matches!(dead.decisions.last(), Some(ShellDecision::Fault(MoveFault::NotMoving { .. }))),
            "{:?}",
            dead.decisions
        );
    }

    #[test]
    fn a_dead_or_reversed_axis_ends_the_loop_after_the_probe() {
        let dead = run(ShellStep::TranslateEThenTrim, |_| 30.0, 0.0, 0.0, 0.004);
        assert!(
            matches!(dead.decisions.last(), Some(ShellDecision::Fault(MoveFault::NotMoving { .. }))),
            "{:?}",
            dead.decisions
        );
        assert_eq!(dead.decisions.len(), 2);
        let reversed = run(ShellStep::TranslateEThenTrim, |q| 60.0 - q, 0.0, 0.0, 0.004);
        assert!(
            matches!(reversed.decisions.last(), Some(ShellDecision::Fault(MoveFault::Reversed { .. }))),
            "{:?}",
            reversed.decisions
        );
        assert_eq!(reversed.decisions.len(), 2);
    }

    /// A bench of which water, board or radii are not as configured: the picture has e too large, and all that was seen and is
    /// known says by how much it may.
    fn run_with_room(e_of: impl Fn(f64) -> f64, shown: impl Fn(f64) -> f64, sigma_mm: f64) -> Outcome {
        let camera = preset();
        let mut shell = ShellLoop::new(goal(ShellStep::TranslateEThenTrim), camera);
        let (mut reading, mut trim) = (30.0, 0.0);
        let mut outcome = Outcome {
            decisions: Vec::new(),
            least_e: f64::INFINITY,
            least_reading: f64::INFINITY,
            spacing: 0.0,
            e: 0.0,
        };
        for _ in 0..40 {
            outcome.least_e = outcome.least_e.min(e_of(reading));
            outcome.least_reading = outcome.least_reading.min(reading);
            let seen = ShellObservation {
                e_reading_mm: reading,
                trim_mm: trim,
                spacing_px: camera.spacing_px(shown(e_of(reading)), trim),
                sigma_px: 0.004,
                sigma_random_px: 0.004,
            };
            let shows = shown(e_of(reading));
            let decision = shell.next(seen, |here| {
                let e = AxisModel::new(here.e_reading_mm, shows, sigma_mm, 0.0);
                Some(Room { contact: Contact { e_mm: -0.5, measured_sigma_mm: None }, e })
            });
            outcome.decisions.push(decision.clone());
            match decision {
                ShellDecision::ProbeE { to_mm } | ShellDecision::MoveE { to_mm, .. } => reading = to_mm,
                ShellDecision::Trim { by_mm, .. } => trim += by_mm,
                ShellDecision::MoreFrames | ShellDecision::Verify => {}
                _ => break,
            }
        }
        (outcome.e, outcome.spacing) = (e_of(reading), camera.spacing_px(shown(e_of(reading)), trim));
        outcome
    }

    /// The picture is wrong by as much as three standard uncertainties, either way: the lens never touches, the focus is found
    /// all the same, and e is no further off than it has to be.
    #[test]
    fn a_lens_stays_clear_by_what_e_is_uncertain_by() {
        for sigma_mm in [0.05, 0.19, 0.4, 1.0] {
            for off in [-2.9, 0.0, 2.9] {
                let outcome = run_with_room(|q| q, |e| e + off * sigma_mm, sigma_mm);
                let what = format!("σ(e) {sigma_mm} mm, {off} of it off: {:?}", outcome.decisions);
                assert_eq!(outcome.decisions.last(), Some(&ShellDecision::Done), "{what}");
                assert!(outcome.least_e > -0.5, "touched at {} {what}", outcome.least_e);
                // The axis's reading does not pass the wall either.
                let wanted = 0.0_f64.max(3.0 * sigma_mm - 0.5).max(off * sigma_mm - 0.1);
                assert!((outcome.e + off * sigma_mm - wanted).abs() < 0.2, "{} {what}", outcome.e);
            }
        }
    }

    /// Whatever was decided before, and however often: a picture that leaves less than two and a half standard uncertainties
    /// takes the lens back to where there are three, and nothing is done before.
    #[test]
    fn a_lens_that_is_found_too_near_is_taken_back() {
        /// By then it has come to its optimum.
        const NEAR: i32 = 3;
        for late in 1..5 {
            let camera = preset();
            let mut shell = ShellLoop::new(goal(ShellStep::TranslateEThenTrim), camera);
            let (mut reading, mut trim, mut back) = (30.0, 0.0, None);
            for turn in 0..40 {
                // From then on e is known to 0.4 mm only.
                let sigma_mm = if turn < late { 0.02 } else { 0.4 };
                let seen = ShellObservation {
                    e_reading_mm: reading,
                    trim_mm: trim,
                    spacing_px: camera.spacing_px(reading, trim),
                    sigma_px: 0.004,
                    sigma_random_px: 0.004,
                };
                let decision = shell.next(seen, |here| {
                    let e = AxisModel::new(here.e_reading_mm, here.e_reading_mm, sigma_mm, 0.0);
                    Some(Room { contact: Contact { e_mm: -0.5, measured_sigma_mm: None }, e })
                });
                let too_near = turn >= late && reading + 0.5 < 2.5 * 0.4;
                match decision {
                    ShellDecision::MoveE { to_mm, .. } if too_near => {
                        assert!((to_mm + 0.5 - 3.0 * 0.4).abs() < 1e-6, "{late}, {turn}: to {to_mm}");
                        (reading, back) = (to_mm, Some(turn));
                    }
                    other if too_near => panic!("{late}, {turn}: {other:?} at {reading}"),
                    ShellDecision::ProbeE { to_mm } | ShellDecision::MoveE { to_mm, .. } => reading = to_mm,
                    ShellDecision::Trim { by_mm, .. } => trim += by_mm,
                    ShellDecision::MoreFrames | ShellDecision::Verify => {}
                    ShellDecision::Done => break,
                    other => panic!("{late}, {turn}: {other:?}"),
                }
            }
            assert!(reading + 0.5 > 2.5 * 0.4, "{late}: the lens is left at {reading}");
            // Before it is near it does not go there.
            assert_eq!(back.is_some(), late >= NEAR, "{late}: {back:?}");
        }
    }

    /// Without a budget nobody can say how near the lens is.
    #[test]
    fn nothing_goes_towards_the_shell_without_room() {
        for (step, start) in [
            (ShellStep::TranslateEThenTrim, 30.0),
            (ShellStep::TranslateE, 30.0),
            (ShellStep::TranslateE, 1.5),
            (ShellStep::HoldETrim, 30.0),
        ] {
            let camera = preset();
            let mut shell = ShellLoop::new(goal(step), camera);
            let (mut reading, mut trim, mut nearest): (f64, f64, f64) = (start, 0.0, start);
            for _ in 0..20 {
                let seen = ShellObservation {
                    e_reading_mm: reading,
                    trim_mm: trim,
                    spacing_px: camera.spacing_px(reading, trim),
                    sigma_px: 0.004,
                    sigma_random_px: 0.004,
                };
                match shell.next(seen, |_| None) {
                    ShellDecision::ProbeE { to_mm } | ShellDecision::MoveE { to_mm, .. } => reading = to_mm,
                    ShellDecision::Trim { by_mm, .. } => trim += by_mm,
                    ShellDecision::MoreFrames | ShellDecision::Verify => {}
                    _ => break,
                }
                nearest = nearest.min(reading);
            }
            assert!(nearest >= start, "{step:?} from {start}: {nearest}");
        }
    }
}
