//! What the loop does next: a probe, a long move, a correction, a trim, or the end.

use super::{
    CONFIRMED_SIGMA_MM, MAX_MEASUREMENTS_AT_A_POSE, MAX_MOVES, MOVES_FOR_SPACING, ShellDecision, ShellLoop,
    ShellObservation, TOLD_SIGMAS, TOLD_WITHIN, UNCONFIRMED_SHARE, WALL_SIGMAS,
};
use crate::loops::air::FREE_PROBES;
use bench::config::ShellStep;

impl ShellLoop {
    pub(super) fn decide(&mut self, here: ShellObservation, measurements: u32) -> ShellDecision {
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

    pub(super) fn probe(&mut self, here: ShellObservation) -> ShellDecision {
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
    pub(super) fn travel(&mut self, here: ShellObservation) -> ShellDecision {
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
        let nearest = self.nearest(here);
        let (to, confirmed) = (to.max(nearest), confirmed && to >= nearest);
        // Where e is not known better from picture to picture, another short move leads nowhere.
        let short = if confirmed { 0.5 * goal.tolerance_mm } else { (0.5 * goal.tolerance_mm).max(0.5 * sigma) };
        // What each picture adds to the room may go on for long, by less and less.
        let near_enough = self.held_off && self.moves + MOVES_FOR_SPACING >= MAX_MOVES;
        if near_enough || (to - here.e_reading_mm).abs() <= short {
            if self.held_off && self.room.is_none() {
                return ShellDecision::NotConverged {
                    why: "how near the lens is to the shell cannot be told: what was seen of the boards in air and through the shell fits no camera like the configured one".to_owned(),
                };
            }
            // As near as the wall, or the picture, lets it come.
            self.at_optimum = true;
            return self.decide_again(here);
        }
        // What is measured nearer to the shell may let it come nearer still.
        self.at_optimum = confirmed && !self.held_off;
        self.move_e(to, here.trim_mm)
    }

    /// At the optimum by the axis's model: what the spacing still lacks.
    pub(super) fn correct(&mut self, here: ShellObservation) -> ShellDecision {
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
            return self.move_e(reading.max(self.nearest(here)), here.trim_mm);
        }
        let e_here = self.model.predict(here.e_reading_mm).0;
        let by = self.trim_to(goal.spacing_px, e_here, here);
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

    /// The trim (mm) to a spacing (px) at an e (mm): what the camera says, scaled by what the last trim took.
    fn trim_to(&self, spacing_px: f64, e_mm: f64, here: ShellObservation) -> f64 {
        let between =
            |from: ShellObservation, to_px| self.camera.trim_between(from.spacing_px, to_px, e_mm, from.trim_mm);
        let last = self.previous.filter(|previous| {
            // A short trim shows noise.
            let sigma_px = previous.sigma_px.hypot(here.sigma_px);
            (previous.e_reading_mm - here.e_reading_mm).abs() < 1e-6
                && (here.spacing_px - previous.spacing_px).abs() > TOLD_SIGMAS * sigma_px
        });
        let told = last.map(|previous| (here.trim_mm - previous.trim_mm) / between(previous, here.spacing_px));
        let share = told.filter(|share| (1.0 / TOLD_WITHIN..=TOLD_WITHIN).contains(share)).unwrap_or(1.0);
        share * between(here, spacing_px)
    }

    pub(super) fn decide_again(&mut self, here: ShellObservation) -> ShellDecision {
        let measurements = self.pose.as_ref().map_or(1, |pose| pose.measurements.count());
        self.decide(here, measurements)
    }

    pub(super) fn move_e(&mut self, to_mm: f64, trim_mm: f64) -> ShellDecision {
        self.moves += 1;
        let predicted_px = self.camera.spacing_px(self.model.predict(to_mm).0, trim_mm);
        ShellDecision::MoveE { to_mm, predicted_px }
    }

    /// Where the lens is taken back to from a reading (mm) at which there is too little room for it.
    pub(super) fn way_back(&self, from: f64) -> Option<f64> {
        let room = self.room.filter(|room| room.asks_back(from))?;
        let (leg, highest) = (self.goal.leg_mm, self.goal.high_limit_mm.min(from + self.goal.most_mm));
        let to = room.least_mm(from - leg, highest - leg).map_or(highest, |least| least + leg);
        (to - from > 0.5 * self.goal.tolerance_mm).then_some(to)
    }

    /// Whether the room lets the lens be taken to a reading, mm, with what the axis goes beyond it on the way.
    pub(super) fn lets(&self, reading: f64) -> bool {
        self.room.is_some_and(|room| room.lets(reading - self.goal.leg_mm))
    }

    /// The reading nearest the one wanted that is one move away, for which there is room, and which passes the wall neither by
    /// reading nor by estimate, and, coming from `from`, not even by an estimate that is [`WALL_SIGMAS`] off.
    pub(super) fn allowed(&mut self, reading: f64, from: f64) -> f64 {
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
