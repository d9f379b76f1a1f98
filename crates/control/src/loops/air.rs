//! The in-air loop (Eq. 15): from Δv_1 = v_ADJ − v, as the triple-level board gives it, to the next move of the focus
//! axis. Pure: measurement in, decision out.

use super::at_pose::AtPose;
use super::axis_model::{AxisModel, MoveFault, check_move};
use bench::device::AxisName;

/// What the loop is to reach, and what it may use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AirGoal {
    /// Δv wanted, mm.
    pub delta_v_mm: f64,
    /// Δv_TOL, mm.
    pub tolerance_mm: f64,
    /// Least reading allowed, mm.
    pub low_limit_mm: f64,
    /// Greatest reading allowed, mm.
    pub high_limit_mm: f64,
    /// Standard relative uncertainty of the axis's scale.
    pub scale_sigma: f64,
    /// Standard uncertainty of the axis's zero, mm.
    pub zero_sigma_mm: f64,
    /// Lost motion on reversal, mm, at most.
    pub backlash_mm: f64,
    /// Length of the first move, mm; twice that is to be free on both sides of the axis.
    pub probe_mm: f64,
    /// Longest move, mm.
    pub most_mm: f64,
}

/// What was measured at one pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AirObservation {
    /// Readback of the focus axis, mm.
    pub reading_mm: f64,
    /// Δv_1 = v_ADJ − v, mm.
    pub delta_v_mm: f64,
    /// Its standard uncertainty, mm.
    pub sigma_mm: f64,
    /// Where most of `sigma_mm` is an error that neighbouring poses share, what they scatter by without it, mm.
    pub repeatability_mm: Option<f64>,
}

/// What to do next.
#[derive(Debug, Clone, PartialEq)]
pub enum AirDecision {
    /// Make the first, short move and see whether the picture follows.
    Probe {
        /// Reading to go to, mm.
        to_mm: f64,
    },
    /// Go to the reading at which Δv should be right.
    Move {
        /// Reading to go to, mm.
        to_mm: f64,
    },
    /// Measure again at the same place and combine.
    MoreFrames,
    /// The criterion is met once: measure again to be sure.
    Verify,
    /// The criterion is met and verified.
    Done,
    /// The boards do not tell Δv well enough; others may.
    TooUncertain {
        /// Why, in words.
        why: String,
    },
    /// The criterion cannot be met.
    NotConverged {
        /// Why, in words.
        why: String,
    },
    /// The picture contradicts the moves.
    Fault(MoveFault),
}

/// Travel that has to be free on both sides of an axis before its first move, in lengths of that move.
pub(crate) const FREE_PROBES: f64 = 2.0;
/// Measurements combined at one pose before the uncertainty is called too large.
const MAX_MEASUREMENTS_AT_A_POSE: u32 = 9;
/// Moves before the loop gives up, the probe not counted.
const MAX_MOVES: u32 = 6;
/// Readings nearer to one another than this are of one pose, mm.
const SAME_POSE_MM: f64 = 1e-6;

/// The loop's memory.
#[derive(Debug, Clone)]
pub struct AirLoop {
    goal: AirGoal,
    model: Option<AxisModel>,
    pose: Option<Pose>,
    previous: Option<AirObservation>,
    probed: bool,
    moves: u32,
    /// Whether the picture has followed a move.
    followed: bool,
    verifying: bool,
}

/// The measurements at the present pose, combined.
#[derive(Debug, Clone)]
struct Pose {
    combined: AirObservation,
    measurements: AtPose,
}

impl AirLoop {
    /// A loop that has seen nothing.
    #[must_use]
    pub fn new(goal: AirGoal) -> Self {
        assert!(goal.tolerance_mm > 0.0 && goal.low_limit_mm < goal.high_limit_mm);
        Self {
            goal,
            model: None,
            pose: None,
            previous: None,
            probed: false,
            moves: 0,
            followed: false,
            verifying: false,
        }
    }

    /// Moves decided so far, the probe not counted.
    #[must_use]
    pub fn moves(&self) -> u32 {
        self.moves
    }

    /// What the axis's readings mean, as far as the picture has shown.
    #[must_use]
    pub fn model(&self) -> Option<&AxisModel> {
        self.model.as_ref()
    }

    /// True travel over commanded travel, once the picture has followed a move: until then it is the configuration's.
    #[must_use]
    pub fn scale(&self) -> Option<f64> {
        self.model.filter(|_| self.followed).map(|model| model.scale().0)
    }

    /// The measurements at the present pose, combined.
    #[must_use]
    pub fn here(&self) -> Option<AirObservation> {
        self.pose.as_ref().map(|pose| pose.combined)
    }

    /// Forgets what was seen at a reading (mm) of other boards or through another aperture: it is not to be combined with
    /// what is seen there now.
    pub fn seen_otherwise(&mut self, reading_mm: f64) {
        if self.here().is_some_and(|here| (here.reading_mm - reading_mm).abs() <= SAME_POSE_MM) {
            (self.pose, self.previous) = (None, None);
        }
    }

    /// Takes in a measurement and decides.
    pub fn next(&mut self, observation: AirObservation) -> AirDecision {
        let away = |here: AirObservation| (here.reading_mm - observation.reading_mm).abs() > SAME_POSE_MM;
        let moved = self.here().is_none_or(away);
        if moved {
            self.previous = self.here();
        }
        let mut pose = self
            .pose
            .take()
            .filter(|_| !moved)
            .unwrap_or_else(|| Pose { combined: observation, measurements: AtPose::new() });
        let random_mm = observation.repeatability_mm.unwrap_or(observation.sigma_mm);
        let combined = pose.measurements.take(observation.delta_v_mm, observation.sigma_mm, random_mm);
        (pose.combined.delta_v_mm, pose.combined.sigma_mm) = (combined.value, combined.sigma);
        let (here, measurements) = (pose.combined, pose.measurements.count());
        self.pose = Some(pose);
        if moved
            && let Some(previous) = self.previous
            && let Some(fault) = self.contradiction(previous, here)
        {
            return AirDecision::Fault(fault);
        }
        self.followed |= moved && self.previous.is_some();
        let goal = self.goal;
        self.model
            .get_or_insert_with(|| {
                // The picture says where the axis stands; its zero is known to the homing only.
                AxisModel::new(
                    observation.reading_mm,
                    observation.delta_v_mm,
                    goal.zero_sigma_mm + 1.0,
                    goal.scale_sigma,
                )
            })
            .observe(observation.reading_mm, observation.delta_v_mm, observation.sigma_mm);
        if let Some(fault) = self.model.and_then(|model| model.fault(AxisName::Focus, observation.reading_mm)) {
            return AirDecision::Fault(fault);
        }
        self.decide(here, measurements)
    }

    fn contradiction(&self, previous: AirObservation, here: AirObservation) -> Option<MoveFault> {
        let scale = self.model.map_or(1.0, |model| model.scale().0);
        let expected = scale * (here.reading_mm - previous.reading_mm);
        let sigma = match (previous.repeatability_mm, here.repeatability_mm) {
            (Some(one), Some(other)) => one.hypot(other),
            _ => previous.sigma_mm.hypot(here.sigma_mm),
        };
        check_move(AxisName::Focus, expected, here.delta_v_mm - previous.delta_v_mm, sigma, self.goal.backlash_mm)
    }

    fn decide(&mut self, here: AirObservation, measurements: u32) -> AirDecision {
        let goal = self.goal;
        let error = here.delta_v_mm - goal.delta_v_mm;
        let sigma_mm = here.sigma_mm;
        if error.abs() + 2.0 * sigma_mm < goal.tolerance_mm {
            if self.verifying {
                return AirDecision::Done;
            }
            self.verifying = true;
            return AirDecision::Verify;
        }
        self.verifying = false;
        // Too uncertain to be judged even when exactly on target: better measurements come before further moves.
        let near = error.abs() < goal.tolerance_mm + 2.0 * sigma_mm;
        if near && 2.0 * sigma_mm > 0.6 * goal.tolerance_mm {
            if measurements < MAX_MEASUREMENTS_AT_A_POSE {
                return AirDecision::MoreFrames;
            }
            if 2.0 * sigma_mm >= goal.tolerance_mm {
                return AirDecision::TooUncertain {
                    why: format!(
                        "uncertainty: Δv is {:.4} ± {sigma_mm:.4} mm after {measurements} measurements, which cannot be told to lie within {:.4} mm of {:.4} mm: are the boards where they were asked for, in the light, and is the aperture as it was set?",
                        here.delta_v_mm, goal.tolerance_mm, goal.delta_v_mm
                    ),
                };
            }
        }
        self.next_move(here)
    }

    fn next_move(&mut self, here: AirObservation) -> AirDecision {
        let goal = self.goal;
        let Some(model) = self.model else {
            return AirDecision::MoreFrames;
        };
        let target = model.reading_for(goal.delta_v_mm);
        if !self.probed {
            self.probed = true;
            let direction = if target >= here.reading_mm { 1.0 } else { -1.0 };
            let free = (here.reading_mm - goal.low_limit_mm).min(goal.high_limit_mm - here.reading_mm);
            let needed = FREE_PROBES * goal.probe_mm;
            if free < needed {
                return AirDecision::NotConverged {
                    why: format!(
                        "the focus axis stands {free:.2} mm from an end of its travel; its first move needs {needed:.2} mm free on both sides"
                    ),
                };
            }
            return AirDecision::Probe { to_mm: here.reading_mm + direction * goal.probe_mm };
        }
        if self.moves >= MAX_MOVES {
            return AirDecision::NotConverged {
                why: format!(
                    "after {} moves Δv is {:.4} mm and does not settle within {:.4} mm of {:.4} mm",
                    self.moves, here.delta_v_mm, goal.tolerance_mm, goal.delta_v_mm
                ),
            };
        }
        if target < goal.low_limit_mm || target > goal.high_limit_mm {
            return AirDecision::NotConverged {
                why: format!(
                    "Δv = {:.4} mm needs the focus axis at {target:.3} mm, outside its travel of {} to {} mm",
                    goal.delta_v_mm, goal.low_limit_mm, goal.high_limit_mm
                ),
            };
        }
        self.moves += 1;
        let way = (target - here.reading_mm).clamp(-goal.most_mm, goal.most_mm);
        AirDecision::Move { to_mm: here.reading_mm + way }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOAL: AirGoal = AirGoal {
        delta_v_mm: 2.205,
        tolerance_mm: 0.005,
        low_limit_mm: -2.0,
        high_limit_mm: 5.0,
        scale_sigma: 0.05,
        zero_sigma_mm: 0.2,
        backlash_mm: 0.05,
        probe_mm: 0.5,
        most_mm: 40.0,
    };

    /// Runs the loop against an axis and returns the decisions and the true Δv at the end.
    fn run(goal: AirGoal, truth: impl Fn(f64) -> f64, sigma: impl Fn(f64) -> f64) -> (Vec<AirDecision>, f64) {
        let mut air = AirLoop::new(goal);
        let (mut reading, mut decisions) = (0.0, Vec::new());
        for turn in 0..40 {
            let value = truth(reading);
            let s = sigma(value);
            // A deterministic error of one sigma, alternating.
            let measured = value + if turn % 2 == 0 { s } else { -s };
            let decision = air.next(AirObservation {
                reading_mm: reading,
                delta_v_mm: measured,
                sigma_mm: s,
                repeatability_mm: None,
            });
            decisions.push(decision.clone());
            match decision {
                AirDecision::Probe { to_mm } | AirDecision::Move { to_mm } => reading = to_mm,
                AirDecision::MoreFrames | AirDecision::Verify => {}
                _ => break,
            }
        }
        (decisions, truth(reading))
    }

    #[test]
    fn a_scale_error_costs_one_more_move() {
        for scale in [0.95, 1.0, 1.05] {
            let (decisions, end) =
                run(GOAL, |x| 0.02 + scale * x, |v| 0.0005 + 0.003 * (v - GOAL.delta_v_mm).abs() / 2.2);
            assert_eq!(decisions.last(), Some(&AirDecision::Done), "{decisions:?}");
            assert!((end - GOAL.delta_v_mm).abs() < 0.005, "{end}");
            let moves = decisions.iter().filter(|d| matches!(d, AirDecision::Move { .. })).count();
            assert!(moves <= 3, "{moves} moves: {decisions:?}");
            assert!(matches!(decisions[0], AirDecision::Probe { to_mm } if (to_mm - 0.5).abs() < 1e-9));
        }
    }

    #[test]
    fn too_large_an_uncertainty_is_said() {
        let (decisions, _) = run(GOAL, |x| x, |_| 0.008);
        let Some(AirDecision::TooUncertain { why }) = decisions.last() else {
            panic!("{decisions:?}");
        };
        assert!(why.starts_with("uncertainty"), "{why}");
        assert!(decisions.contains(&AirDecision::MoreFrames));
    }

    /// What a far board said of a pose does not count with what the one at the solution says there, nor is it taken for a move.
    #[test]
    fn other_boards_at_one_pose_are_measured_anew() {
        let mut air = AirLoop::new(GOAL);
        let seen = |delta_v_mm, sigma_mm| AirObservation {
            reading_mm: 2.2,
            delta_v_mm,
            sigma_mm,
            repeatability_mm: Some(0.1 * sigma_mm),
        };
        assert_eq!(air.next(seen(2.193, 0.0125)), AirDecision::MoreFrames);
        air.seen_otherwise(2.2);
        assert_eq!(air.next(seen(2.206, 0.0006)), AirDecision::Verify);
        // At another reading there is nothing to forget.
        air.seen_otherwise(2.1);
        assert_eq!(air.next(seen(2.206, 0.0006)), AirDecision::Done);
    }

    #[test]
    fn a_dead_and_a_reversed_axis_are_told_apart() {
        let (dead, _) = run(GOAL, |_| 0.1, |_| 0.001);
        assert!(matches!(dead.last(), Some(AirDecision::Fault(MoveFault::NotMoving { .. }))), "{dead:?}");
        assert_eq!(dead.len(), 2, "no move follows the probe");
        let (reversed, _) = run(GOAL, |x| 0.1 - x, |_| 0.001);
        assert!(matches!(reversed.last(), Some(AirDecision::Fault(MoveFault::Reversed { .. }))), "{reversed:?}");
        let (double, _) = run(GOAL, |x| 2.0 * x, |_| 0.001);
        assert!(matches!(double.last(), Some(AirDecision::Fault(MoveFault::WrongScale { .. }))), "{double:?}");
    }

    #[test]
    fn a_target_outside_the_travel_is_refused() {
        let (decisions, _) = run(AirGoal { delta_v_mm: 6.0, ..GOAL }, |x| x, |_| 0.001);
        assert!(matches!(decisions.last(), Some(AirDecision::NotConverged { .. })), "{decisions:?}");
        assert!(!decisions.iter().any(|d| matches!(d, AirDecision::Move { .. })));
    }

    #[test]
    fn no_probe_without_free_travel() {
        let (decisions, _) = run(AirGoal { low_limit_mm: -0.5, ..GOAL }, |x| x, |_| 0.001);
        assert_eq!(decisions.len(), 1);
        assert!(matches!(&decisions[0], AirDecision::NotConverged { why } if why.contains("free")));
    }
}
