//! The homing cycle: every axis of a block through its phases together, at the rate of the slowest.

use super::motion::{Homing, HomingPhase};
use super::settings::Heir;
use super::{GrblFirmware, State};

impl GrblFirmware {
    /// Starts homing one axis, or all that are fitted.
    pub(super) fn home(&mut self, axis: Option<usize>) {
        let blocks: Vec<Vec<usize>> = match axis {
            Some(axis) => vec![vec![axis]],
            None if self.fluid.is_some() => self.fluid_cycles(),
            None => self.blocks(),
        };
        self.homing = Homing::of(blocks);
        self.state = State::Home;
        self.leave_switches();
    }

    /// Which axes home together: as the stock firmware is built, Z first and X and Y together; as grblHAL is set.
    fn blocks(&self) -> Vec<Vec<usize>> {
        let masks = match self.config.heir {
            Heir::GrblHal => (44..50).map(|cycle| self.settings.get(cycle) as u32).collect(),
            _ => vec![4, 3],
        };
        let fitted = |mask: u32| (0..3).filter(|&i| mask & (1 << i) != 0 && self.config.axes[i].is_some()).collect();
        masks.into_iter().map(fitted).filter(|block: &Vec<usize>| !block.is_empty()).collect()
    }

    /// Whether single axes can be homed: as it was built, or set.
    pub(super) fn homes_single_axes(&self) -> bool {
        match self.config.heir {
            Heir::GrblHal => self.settings.has_bit(22, 1),
            _ => self.config.single_axis_homing,
        }
    }

    /// Whether homing makes home the machine's zero.
    pub(super) fn homes_to_zero(&self) -> bool {
        self.config.heir == Heir::GrblHal && self.settings.has_bit(22, 3)
    }

    pub(super) fn homes_negative(&self, axis: usize) -> bool {
        if let Some(fluid) = &self.fluid {
            return !fluid.axis_flag(axis, "homing/positive_direction");
        }
        self.settings.has_bit(23, axis)
    }

    /// What a block's axes do in a phase: the rate of each, mm/s, and the longest way, mm. A block is one straight line
    /// to the firmware, so that the slowest axis governs all, and the longest way is every axis's.
    fn homing_line(&self, homing: &Homing) -> (f64, f64) {
        let slowest =
            homing.axes.iter().map(|axis| self.settings.of_axis(110, axis.axis)).fold(f64::INFINITY, f64::min);
        let travel = homing.axes.iter().map(|axis| self.settings.of_axis(130, axis.axis)).fold(0.0, f64::max);
        let pull_off = self.settings.get(27);
        let (rate, longest) = match homing.phase {
            HomingPhase::Seek => (self.settings.get(25), 1.5 * travel),
            HomingPhase::Locate => (self.settings.get(24), 5.0 * pull_off),
            HomingPhase::Leave | HomingPhase::PullOff | HomingPhase::Settle => (self.settings.get(25), pull_off),
        };
        (rate.min(slowest) / 60.0, longest)
    }

    pub(super) fn advance_homing(&mut self, dt: f64) {
        let Some(mut homing) = self.homing.take() else { return };
        if homing.pause_s > 0.0 {
            homing.pause_s -= dt;
            self.homing = Some(homing);
            return;
        }
        let phase = homing.phase;
        let line = self.homing_line(&homing);
        for axis in &mut homing.axes {
            let index = axis.axis;
            let (rate, longest_mm) = self.fluid.as_ref().map_or(line, |fluid| fluid.homing_line(index, phase));
            let steps_per_mm = self.settings.of_axis(100, index);
            axis.due += rate * steps_per_mm * dt;
            let longest = (longest_mm * steps_per_mm).round() as i64;
            let towards = if self.homes_negative(index) { -1 } else { 1 };
            let direction = match phase {
                HomingPhase::Leave => self.leaving[index],
                _ if phase.approaches() => towards,
                _ => -towards,
            };
            while !axis.done && axis.steps < axis.due as i64 {
                // Whichever of the two switches it is: they share the pin.
                if phase.approaches() && self.pin_pressed(index) {
                    axis.done = true;
                } else if axis.steps >= longest {
                    if phase.approaches() {
                        self.homing = Some(homing);
                        return self.abort(9);
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
        if !phase.approaches() && homing.axes.iter().any(|axis| self.pin_pressed(axis.axis)) {
            self.homing = Some(homing);
            return self.abort(8);
        }
        if phase == HomingPhase::Settle {
            self.set_home(&homing);
        }
        let block_ends = phase == HomingPhase::Settle;
        if block_ends {
            self.note_homed(&homing);
        }
        if homing.go_on(self.settings.get(26) / 1000.0) {
            self.homing = Some(homing);
            if block_ends {
                self.leave_switches();
            }
            return;
        }
        self.pins_before = self.pins();
        self.state = if self.is_homed_enough() { State::Idle } else { State::Alarm };
        self.say("ok");
        if std::mem::take(&mut self.report_due) {
            self.report();
        }
        self.work();
    }

    /// Has a block's axes stand a pull-off from their switches.
    fn set_home(&mut self, homing: &Homing) {
        let pull_off = self.settings.get(27);
        for axis in &homing.axes {
            let index = axis.axis;
            let (travel, negative) = (self.settings.of_axis(130, index), self.homes_negative(index));
            // Machine space is negative: zero is the positive end of the travel, but where home is made zero.
            let machine_mm = match (self.homes_to_zero(), negative) {
                _ if self.fluid.is_some() => self.fluid_home_mm(index),
                (true, _) => 0.0,
                (false, true) => -travel + pull_off,
                (false, false) => -pull_off,
            };
            self.origin[index] = (machine_mm * self.settings.of_axis(100, index)).round() as i64 - self.steps[index];
            // Where the switches are on, grblHAL keeps a pull-off from both.
            let kept = if self.settings.is_on(21) { pull_off } else { 0.0 };
            self.envelope[index] = Some(match (self.homes_to_zero(), negative) {
                (true, true) => (0.0, travel - kept),
                (true, false) => (kept - travel, 0.0),
                (false, _) => (kept - travel, -kept),
            });
        }
    }
}
