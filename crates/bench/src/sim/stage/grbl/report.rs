//! Status reports.

use super::settings::Heir;
use super::{GrblFirmware, State};
use crate::sim::stage::Firmware as _;

impl GrblFirmware {
    /// Answers `?`.
    pub(super) fn report(&mut self) {
        if self.homing.is_some() && self.fluid.is_none() {
            // The homing loop answers nothing; the report comes after it.
            self.report_due = true;
            return;
        }
        let state = match self.state {
            State::Idle => "Idle",
            State::Jog => "Jog",
            State::Run => "Run",
            State::Hold if self.motion.is_some() => "Hold:1",
            State::Hold => "Hold:0",
            State::Alarm if self.deaf && self.config.heir == Heir::GrblHal => &format!("Alarm:{}", self.last_alarm),
            State::Alarm => "Alarm",
            State::Door if self.motion.is_some() => "Door:2",
            State::Door => "Door:0",
            State::Home => "Home",
            State::Sleep => "Sleep",
        };
        let [x, y, z] = self.machine_mm();
        let position = if self.settings.get(10) as u32 & 1 != 0 { "MPos" } else { "WPos" };
        let feed = self.motion.as_ref().map_or(0.0, |motion| motion.speed() * 60.0);
        // FluidNC reports the axes that it is configured for.
        let z = if self.fluid.is_some() && self.config.axes[2].is_none() { String::new() } else { format!(",{z:.3}") };
        let mut report = format!("<{state}|{position}:{x:.3},{y:.3}{z}|FS:{feed:.0},0");
        let pressed: String =
            "XYZ".chars().zip(self.pins()).filter_map(|(name, pressed)| pressed.then_some(name)).collect();
        // grblHAL tells them only where $10 says so.
        let told = self.config.heir != Heir::GrblHal || self.settings.get(10) as u32 & 16 != 0;
        if !pressed.is_empty() && told {
            report.push_str("|Pn:");
            report.push_str(&pressed);
        }
        // Grbl adds the offset to one report in ten at rest and one in thirty in motion, the overrides to the next.
        let period = if self.is_moving() { 30 } else { 10 };
        match self.reports % period {
            0 => report.push_str("|WCO:0.000,0.000,0.000"),
            1 => report.push_str("|Ov:100,100,100"),
            _ => {}
        }
        self.reports = self.reports.wrapping_add(1);
        report.push('>');
        self.say(&report);
    }
}
