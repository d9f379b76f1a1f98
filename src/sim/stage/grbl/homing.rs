//! The homing cycle: every axis through its phases together.

use super::motion::{Homing, HomingPhase};
use super::{GrblFirmware, State};

impl GrblFirmware {
    /// Starts homing one axis, or all that are fitted.
    pub(super) fn home(&mut self, axis: Option<usize>) {
        let axes: Vec<usize> =
            (0..3).filter(|&i| self.config.axes[i].is_some() && axis.is_none_or(|axis| axis == i)).collect();
        self.homing = Some(Homing::new(axes.into_iter()));
        self.state = State::Home;
    }

    fn homes_negative(&self, axis: usize) -> bool {
        (self.settings.get(23) as u32) & (1 << axis) != 0
    }

    pub(super) fn advance_homing(&mut self, dt: f64) {
        let Some(mut homing) = self.homing.take() else { return };
        let phase = homing.phase;
        let pull_off = self.settings.get(27);
        for axis in &mut homing.axes {
            let index = axis.axis;
            let rate = match phase {
                HomingPhase::Locate => self.settings.get(24),
                _ => self.settings.get(25),
            };
            let steps_per_mm = self.settings.of_axis(100, index);
            axis.due += rate.min(self.settings.of_axis(110, index)) / 60.0 * steps_per_mm * dt;
            // Grbl's bounds: 1.5 travels for the search, five pull-offs for the slow approach.
            let longest_mm = match phase {
                HomingPhase::Seek => 1.5 * self.settings.of_axis(130, index),
                HomingPhase::Locate => 5.0 * pull_off,
                HomingPhase::PullOff | HomingPhase::Settle => pull_off,
            };
            let longest = (longest_mm * steps_per_mm).round() as i64;
            let towards = if self.homes_negative(index) { -1 } else { 1 };
            let direction = if phase.approaches() { towards } else { -towards };
            while !axis.done && axis.steps < axis.due as i64 {
                if phase.approaches() && self.plant.home_switch_closed(index) {
                    axis.done = true;
                } else if axis.steps >= longest {
                    if phase.approaches() {
                        self.fail_homing(9);
                        return;
                    }
                    axis.done = true;
                } else {
                    axis.steps += 1;
                    self.turn(index, self.steps[index] + direction);
                }
            }
        }
        if homing.axes.iter().any(|axis| !axis.done) {
            self.homing = Some(homing);
            return;
        }
        if !phase.approaches() && homing.axes.iter().any(|axis| self.plant.home_switch_closed(axis.axis)) {
            self.fail_homing(8);
            return;
        }
        if let Some(next) = phase.next() {
            homing.enter(next);
            self.homing = Some(homing);
            return;
        }
        for axis in &homing.axes {
            let index = axis.axis;
            // Machine space is negative: zero is the positive end of the travel.
            let machine_mm = match self.homes_negative(index) {
                true => -self.settings.of_axis(130, index) + pull_off,
                false => -pull_off,
            };
            self.origin[index] = (machine_mm * self.settings.of_axis(100, index)).round() as i64 - self.steps[index];
            self.limit_closed[index] = self.plant.limit_switch_closed(index);
        }
        self.state = State::Idle;
        self.say("ok");
        if std::mem::take(&mut self.report_due) {
            self.report();
        }
        self.work();
    }

    fn fail_homing(&mut self, alarm: u8) {
        self.say(&format!("ALARM:{alarm}"));
        self.state = State::Alarm;
        self.homing = None;
        self.reset();
    }
}
