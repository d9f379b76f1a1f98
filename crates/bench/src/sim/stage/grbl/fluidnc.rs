//! What FluidNC does otherwise than Grbl, by its documentation and behaviour: a configuration in place of numbered settings,
//! a machine position after homing that is set in it, jogs that are shortened to the soft limits and not refused, alarms of
//! its own, reports while it homes and in every alarm. Not run beside the firmware.

use super::alarms::After;
use super::configuration::{Fluid, letter};
use super::gcode::{Answer, Refusal};
use super::motion::{Homing, HomingPhase};
use super::{GrblFirmware, State};

impl GrblFirmware {
    fn fluid(&self) -> Option<&Fluid> {
        self.fluid.as_ref()
    }

    fn fitted(&self) -> impl Iterator<Item = usize> + use<'_> {
        (0..3).filter(|&axis| self.config.axes[axis].is_some())
    }

    /// Which axes home together, by their cycles.
    pub(super) fn fluid_cycles(&self) -> Vec<Vec<usize>> {
        let Some(fluid) = self.fluid() else { return Vec::new() };
        let of = |cycle: u32| {
            self.fitted()
                .filter(|&axis| fluid.axis_number(axis, "homing/cycle") == f64::from(cycle))
                .collect::<Vec<_>>()
        };
        (1..=6).map(of).filter(|axes| !axes.is_empty()).collect()
    }

    pub(super) fn fluid_home_mm(&self, axis: usize) -> f64 {
        self.fluid().map_or(0.0, |fluid| fluid.axis_number(axis, "homing/mpos_mm"))
    }

    /// Has the axes that stand on a switch leave it first, where it can be told which one it is.
    pub(super) fn leave_switches(&mut self) {
        let Some(homing) = self.homing.as_ref().filter(|_| self.fluid.is_some()) else { return };
        let pressed: Vec<usize> = homing.axes.iter().map(|a| a.axis).filter(|&axis| self.pin_pressed(axis)).collect();
        if pressed.is_empty() {
            return;
        }
        for &axis in &pressed {
            let towards_home = if self.homes_negative(axis) { -1 } else { 1 };
            self.leaving[axis] = if self.plant.home_switch_closed(axis) { -towards_home } else { towards_home };
        }
        if let Some(homing) = &mut self.homing {
            homing.phase = HomingPhase::Leave;
            for axis in &mut homing.axes {
                axis.done = !pressed.contains(&axis.axis);
            }
        }
    }

    /// Notes that a block of axes is homed, and says so.
    pub(super) fn note_homed(&mut self, homing: &Homing) {
        let Some(fluid) = &mut self.fluid else { return };
        let mut letters = String::new();
        for axis in &homing.axes {
            fluid.homed[axis.axis] = true;
            letters.push(letter(axis.axis).to_ascii_uppercase());
        }
        self.say(&format!("[MSG:Homed:{letters}]"));
    }

    /// Whether it is locked no longer after homing.
    pub(super) fn is_homed_enough(&self) -> bool {
        self.fluid().is_none_or(|fluid| !fluid.must_home() || self.fitted().all(|axis| fluid.homed[axis]))
    }

    fn forget_homing(&mut self) {
        if let Some(fluid) = &mut self.fluid {
            fluid.homed = [false; 3];
        }
    }

    /// What it says at power-up, after which it is locked.
    pub(super) fn fluid_power_up(&mut self) {
        self.forget_homing();
        let version = self.config.version.clone();
        for line in ["rst:0x1 (POWERON_RESET),boot:0x13 (SPI_FAST_FLASH_BOOT)", &format!("[MSG:INFO: {version}]")] {
            self.say(line);
        }
        self.say("[MSG:INFO: Machine a bench]");
        self.fluid_start();
        if self.is_homed_enough() {
            self.state = State::Idle;
        } else {
            self.say_alarm(14, After::Locked { owes_ok: false });
        }
    }

    /// What it says after every reset.
    pub(super) fn fluid_start(&mut self) {
        let version = self.config.version.clone();
        let number = version.rsplit('v').next().and_then(|v| v.rsplit_once('.')).map_or("3.9", |(number, _)| number);
        self.say(&format!("\r\nGrbl {number} [{version} (wifi) '$' for help]"));
        self.pins_before = self.pins();
        if self.state == State::Alarm {
            self.say("[MSG:INFO: '$H'|'$X' to unlock]");
        }
    }

    /// The reset byte.
    pub(super) fn fluid_reset(&mut self) {
        if self.homing.take().is_some() {
            return self.say_alarm(6, After::Start { owes_ok: false });
        }
        if self.motion.take().is_some() {
            return self.say_alarm(3, After::Start { owes_ok: false });
        }
        if std::mem::take(&mut self.deaf) {
            if self.last_alarm == 1 {
                self.forget_homing();
            }
            if !self.is_homed_enough() {
                return self.say_alarm(14, After::Start { owes_ok: false });
            }
            self.state = State::Idle;
        } else if self.state != State::Alarm {
            self.state = State::Idle;
        }
        self.clear();
        self.fluid_start();
    }

    /// Where a jog really ends: within the soft limits, whatever was asked for.
    pub(super) fn fluid_jog_target(&self, target: [f64; 3]) -> [f64; 3] {
        let (Some(fluid), now) = (self.fluid(), self.machine_mm()) else { return target };
        std::array::from_fn(|axis| {
            let fitted = self.config.axes[axis].is_some();
            if !fitted || !fluid.axis_flag(axis, "soft_limits") || target[axis] == now[axis] {
                return target[axis];
            }
            let (low, high) = fluid.limits(axis);
            let outwards = if target[axis] > now[axis] { now[axis] > high } else { now[axis] < low };
            if !outwards {
                return target[axis].clamp(low, high);
            }
            // From outside only a switch is left, by a pull-off at most, and that in one direction whichever was asked for.
            let most = fluid.axis_number(axis, "motor0/pulloff_mm");
            match self.pin_pressed(axis) {
                false => now[axis],
                true if (target[axis] - now[axis]).abs() > most => now[axis] + most,
                true => target[axis],
            }
        })
    }

    /// Whether a line of G-code leads beyond the soft limits.
    pub(super) fn fluid_beyond(&self, target: [f64; 3]) -> bool {
        let Some(fluid) = self.fluid() else { return false };
        self.fitted().any(|axis| {
            let (low, high) = fluid.limits(axis);
            fluid.axis_flag(axis, "soft_limits") && !(low - 1e-3..=high + 1e-3).contains(&target[axis])
        })
    }

    /// Commands that are not Grbl's, or that it answers otherwise.
    pub(super) fn fluid_command(&mut self, line: &[u8]) -> Option<Result<Answer, Refusal>> {
        let fluid = self.fluid.as_mut()?;
        let text = String::from_utf8_lossy(line).trim().to_owned();
        let command = text.strip_prefix('$')?;
        if let Some(setting) = command.strip_prefix('/') {
            return Some(self.fluid_setting(setting));
        }
        let critical = self.deaf;
        match command.to_ascii_uppercase().as_str() {
            "CD" => {
                let lines: Vec<String> = fluid.dump().collect();
                lines.iter().for_each(|line| self.say(line));
            }
            "I" if matches!(self.state, State::Idle | State::Alarm) => {
                let version = self.config.version.clone();
                for line in [&format!("[VER:3.9 {version}:]"), "[OPT:PHS]", "[MSG:Machine: a bench]"] {
                    self.say(line);
                }
            }
            "$" if !matches!(self.state, State::Run | State::Jog) => {
                let lines: Vec<String> = self.settings.lines().collect();
                // What its configuration has in place of these is not numbered.
                let known = |line: &&String| {
                    ["$10=", "$20=", "$21=", "$22=", "$10", "$11", "$12", "$13"].iter().any(|n| line.starts_with(n))
                };
                lines.iter().filter(known).for_each(|line| self.say(line));
            }
            "SLP" if !critical => return None,
            "X" if self.state == State::Alarm && !critical => {
                fluid.homed = [true; 3];
                self.say("[MSG:INFO: Caution: Unlocked]");
                self.state = State::Idle;
            }
            "X" => {}
            home if home.starts_with('H') && !critical => return Some(self.fluid_homing(&home[1..])),
            jog if jog.starts_with("J=") => return None,
            _ if command.contains('=') => return Some(Err(Refusal::Error(3))),
            _ => return Some(Err(Refusal::Error(if critical { 8 } else { 3 }))),
        }
        Some(Ok(Answer::Ok))
    }

    fn fluid_homing(&mut self, which: &str) -> Result<Answer, Refusal> {
        if !matches!(self.state, State::Idle | State::Alarm) {
            return Err(Refusal::Error(8));
        }
        let axis = match which {
            "" => None,
            letter => Some("XYZ".find(letter).filter(|_| letter.len() == 1).ok_or(Refusal::Error(3))?),
        };
        let Some(fluid) = &mut self.fluid else { return Err(Refusal::Error(3)) };
        if let Some(axis) = axis {
            if self.config.axes[axis].is_none() || !fluid.axis_flag(axis, "homing/allow_single_axis") {
                return Err(Refusal::Error(19));
            }
            if fluid.axis_number(axis, "homing/cycle") < 0.0 {
                // Its position is set, and nothing moves.
                fluid.homed[axis] = true;
                let home =
                    (fluid.axis_number(axis, "homing/mpos_mm") * self.settings.of_axis(100, axis)).round() as i64;
                self.origin[axis] = home - self.steps[axis];
                return Ok(Answer::Ok);
            }
        }
        // A switch that both ends share: which one is pressed it cannot tell.
        if !self.config.separate_pins && self.pins().contains(&true) {
            self.abort(12);
            self.message = self.message.take().map(|(left, _)| (left, After::Locked { owes_ok: true }));
            return Ok(Answer::AtEnd);
        }
        self.home(axis);
        if self.homing.is_none() {
            self.state = State::Alarm;
            return Ok(Answer::Ok);
        }
        Ok(Answer::AtEnd)
    }

    /// Tells or changes a value of the configuration until the next start.
    fn fluid_setting(&mut self, setting: &str) -> Result<Answer, Refusal> {
        let (path, value) = match setting.split_once('=') {
            Some((path, value)) => (path, Some(value.trim().to_owned())),
            None => (setting, None),
        };
        let Some(fluid) = &mut self.fluid else { return Err(Refusal::Error(3)) };
        let found = fluid.item(path).ok_or(Refusal::Error(3))?;
        let Some(value) = value else {
            let line = format!("$/{}={}", found.0, found.1);
            self.say(&line);
            return Ok(Answer::Ok);
        };
        // Pins are taken when it starts.
        if path.ends_with("_pin") {
            return Err(Refusal::Error(162));
        }
        found.1 = value.clone();
        let axis = path.split('/').nth(1).and_then(|name| "xyz".find(name));
        if let (Some(axis), Ok(number)) = (axis, value.parse::<f64>()) {
            let group = match path.rsplit('/').next() {
                Some("steps_per_mm") if number > 0.0 => Some(100),
                Some("max_rate_mm_per_min") if number > 0.0 => Some(110),
                Some("acceleration_mm_per_sec2") if number > 0.0 => Some(120),
                Some("max_travel_mm") if number > 0.0 => Some(130),
                _ => None,
            };
            if let Some(group) = group {
                self.settings.follow(group + axis as u16, number);
            }
        }
        Ok(Answer::Ok)
    }
}
