//! A PI controller's firmware, GCS 2, as a C-863 has it.

use std::sync::Arc;

use super::drive::{Drive, DriveConfig, Event};
use super::pi_parameters::{self as parameters, STAGE};
use super::{FAR_SWITCH_MM, Firmware, PULL_OFF_MM};
use crate::sim::plant::Plant;

/// Longest line taken.
const LONGEST_LINE: usize = 256;
/// Motor steps of a stage with an encoder, mm.
const RESOLUTION_MM: f64 = 1e-4;
/// Farthest from its target that an axis is on it, mm.
const WINDOW_MM: f64 = 1e-3;

const PARAMETER: i32 = 1;
const UNKNOWN_COMMAND: i32 = 2;
const UNREFERENCED_OR_SERVO_OFF: i32 = 5;
const POSITION_OUT_OF_LIMITS: i32 = 7;
const SPEED_OUT_OF_LIMITS: i32 = 8;
const STOPPED: i32 = 10;
const INVALID_AXIS: i32 = 15;
const REFERENCE_OFF: i32 = 50;
const UNKNOWN_PARAMETER: i32 = 54;
const MOTION_ERROR: i32 = -1024;

/// A stage on the controller.
pub(super) struct Axis {
    pub(super) drive: Drive,
    referenced: bool,
    /// Whether it has to be referenced before it is moved.
    reference_on: bool,
    servo: bool,
    target: f64,
    pub(super) low: f64,
    pub(super) high: f64,
}

impl Axis {
    pub(super) fn name(&self) -> &str {
        &self.drive.config.name
    }

    /// Where a reference move ends: 0 at the home switch, and at the other end where that stands to it.
    fn reference(&self) -> f64 {
        let config = &self.drive.config;
        let from_limit = PULL_OFF_MM - FAR_SWITCH_MM;
        match (self.drive.seeks_home(), config.homes_negative) {
            (true, _) => 0.0,
            (false, true) => config.high_mm - from_limit,
            (false, false) => config.low_mm + from_limit,
        }
    }

    fn on_target(&self) -> bool {
        self.servo && !self.drive.is_moving() && (self.drive.position() - self.target).abs() <= WINDOW_MM
    }
}

/// A controller with a stage for every drive.
pub struct PiFirmware {
    axes: Vec<Axis>,
    error: i32,
    line: Vec<u8>,
    out: Vec<u8>,
}

impl PiFirmware {
    /// A controller just powered up: servos off, nothing referenced. Its limits begin where a reference move ends.
    #[must_use]
    pub fn new(axes: Vec<DriveConfig>, plant: &Arc<dyn Plant>) -> Self {
        let axes = axes.into_iter().enumerate().map(|(index, mut config)| {
            config.step_mm = RESOLUTION_MM;
            let (low, high) = if config.homes_negative { (0.0, config.high_mm) } else { (config.low_mm, 0.0) };
            let drive = Drive::new(config, index, Arc::clone(plant));
            Axis { drive, referenced: false, reference_on: true, servo: false, target: 0.0, low, high }
        });
        Self { axes: axes.collect(), error: 0, line: Vec::new(), out: Vec::new() }
    }

    fn say(&mut self, lines: &[String]) {
        for (index, line) in lines.iter().enumerate() {
            self.out.extend_from_slice(line.as_bytes());
            self.out.extend_from_slice(if index + 1 < lines.len() { b" \n" } else { b"\n" });
        }
    }

    fn at_once(&mut self, byte: u8) {
        match byte {
            5 => {
                let mask: u64 =
                    self.axes.iter().enumerate().map(|(i, axis)| u64::from(axis.drive.is_moving()) << i).sum();
                self.say(&[format!("{mask:X}")]);
            }
            7 => {
                let ready = !self.axes.iter().any(|axis| axis.drive.is_homing());
                self.out.extend_from_slice(&[if ready { 0xB1 } else { 0xB0 }, b'\n']);
            }
            24 => self.stop(|_| true, true),
            _ => {}
        }
    }

    fn stop(&mut self, which: impl Fn(&str) -> bool, at_once: bool) {
        for axis in self.axes.iter_mut().filter(|axis| which(axis.name())) {
            if at_once {
                axis.drive.halt();
                axis.target = axis.drive.position();
            } else {
                axis.drive.stop();
            }
        }
        self.error = STOPPED;
    }

    fn take(&mut self, line: &str) {
        let mut words = line.split_whitespace();
        let Some(word) = words.next() else { return };
        let arguments: Vec<&str> = words.collect();
        if let Err(error) = self.execute(&word.to_ascii_uppercase(), &arguments) {
            self.error = error;
        }
    }

    /// The axes that a command names, or every one.
    fn named(&self, arguments: &[&str]) -> Result<Vec<usize>, i32> {
        if arguments.is_empty() {
            return Ok((0..self.axes.len()).collect());
        }
        let find = |name: &&str| self.axes.iter().position(|axis| axis.name() == *name).ok_or(INVALID_AXIS);
        arguments.iter().map(find).collect()
    }

    /// The axes and values that a command gives in pairs.
    fn pairs(&self, arguments: &[&str]) -> Result<Vec<(usize, f64)>, i32> {
        if arguments.is_empty() || !arguments.len().is_multiple_of(2) {
            return Err(PARAMETER);
        }
        let pair = |pair: &[&str]| {
            let value = pair[1].parse().ok().filter(|value: &f64| value.is_finite()).ok_or(PARAMETER)?;
            Ok((self.named(&pair[..1])?[0], value))
        };
        arguments.chunks(2).map(pair).collect()
    }

    fn answer(&mut self, arguments: &[&str], value: impl Fn(&Axis) -> String) -> Result<(), i32> {
        let named = self.named(arguments)?;
        let lines: Vec<String> =
            named.into_iter().map(|i| format!("{}={}", self.axes[i].name(), value(&self.axes[i]))).collect();
        self.say(&lines);
        Ok(())
    }

    fn execute(&mut self, word: &str, arguments: &[&str]) -> Result<(), i32> {
        let yes = |yes: bool| u8::from(yes).to_string();
        match word {
            "*IDN?" => {
                let identity = "(c)2013 Physik Instrumente (PI) GmbH & Co. KG, C-863.12, 0115500218, 1.2.5.3";
                self.say(&[identity.to_owned()]);
                Ok(())
            }
            "ERR?" => {
                let error = std::mem::take(&mut self.error);
                self.say(&[error.to_string()]);
                Ok(())
            }
            "SAI?" if arguments.iter().all(|word| *word == "ALL") => {
                let names: Vec<String> = self.axes.iter().map(|axis| axis.name().to_owned()).collect();
                self.say(&names);
                Ok(())
            }
            "CSV?" => {
                self.say(&["2.0".to_owned()]);
                Ok(())
            }
            "HLP?" => {
                self.say(&parameters::help());
                Ok(())
            }
            "HPA?" => {
                self.say(&parameters::parameters());
                Ok(())
            }
            "VER?" => {
                self.say(&["FW_DSP: V1.2.5.3".to_owned(), "HW: V1.0".to_owned()]);
                Ok(())
            }
            "RBT" => {
                self.power_cycle();
                Ok(())
            }
            "SPA?" => self.tell_parameters(arguments),
            "SPA" => self.set_parameters(arguments),
            "GOH" => {
                let home: Vec<(usize, f64)> = self.named(arguments)?.into_iter().map(|axis| (axis, 0.0)).collect();
                self.move_axes(&home, false)
            }
            "RON" => {
                for (axis, on) in self.pairs(arguments)? {
                    self.axes[axis].reference_on = on != 0.0;
                }
                Ok(())
            }
            "RON?" => self.answer(arguments, |axis| yes(axis.reference_on)),
            "POS?" => self.answer(arguments, |axis| format!("{:.6}", axis.drive.position())),
            "MOV?" => self.answer(arguments, |axis| format!("{:.6}", axis.target)),
            "VEL?" => self.answer(arguments, |axis| format!("{:.6}", axis.drive.speed)),
            "ACC?" | "DEC?" => self.answer(arguments, |axis| format!("{:.6}", axis.drive.acceleration)),
            "TMN?" => self.answer(arguments, |axis| format!("{:.6}", axis.low)),
            "TMX?" => self.answer(arguments, |axis| format!("{:.6}", axis.high)),
            "PUN?" => self.answer(arguments, |_| "MM".to_owned()),
            "CST?" => self.answer(arguments, |_| STAGE.to_owned()),
            "SVO?" => self.answer(arguments, |axis| yes(axis.servo)),
            "LIM?" | "TRS?" => self.answer(arguments, |_| "1".to_owned()),
            "FRF?" => self.answer(arguments, |axis| yes(axis.referenced)),
            "ONT?" => self.answer(arguments, |axis| yes(axis.on_target())),
            "SVO" => {
                for (axis, on) in self.pairs(arguments)? {
                    let axis = &mut self.axes[axis];
                    axis.servo = on != 0.0;
                    axis.target = axis.drive.position();
                    if !axis.servo {
                        axis.drive.halt();
                    }
                }
                Ok(())
            }
            "VEL" | "ACC" | "DEC" => {
                for (axis, value) in self.pairs(arguments)? {
                    if value <= 0.0 {
                        return Err(SPEED_OUT_OF_LIMITS);
                    }
                    match word {
                        "VEL" => self.axes[axis].drive.speed = value,
                        _ => self.axes[axis].drive.acceleration = value,
                    }
                }
                Ok(())
            }
            "MOV" | "MVR" => self.move_axes(&self.pairs(arguments)?, word == "MVR"),
            "FRF" | "FNL" | "FPL" => self.reference(&self.named(arguments)?, word),
            "STP" => {
                self.stop(|_| true, true);
                Ok(())
            }
            "HLT" => {
                self.named(arguments)?;
                self.stop(|name| arguments.is_empty() || arguments.contains(&name), false);
                Ok(())
            }
            _ => Err(UNKNOWN_COMMAND),
        }
    }

    /// The parameters asked for, in pairs of axis and number, or every one.
    fn tell_parameters(&mut self, arguments: &[&str]) -> Result<(), i32> {
        let mut lines = Vec::new();
        if arguments.is_empty() {
            self.axes.iter().for_each(|axis| lines.extend(parameters::all(axis)));
        }
        for pair in arguments.chunks(2) {
            let axis = &self.axes[self.named(&pair[..1])?[0]];
            let parameter = pair.get(1).and_then(|number| parameters::parameter(number)).ok_or(UNKNOWN_PARAMETER)?;
            lines.push(parameter.line(axis));
        }
        self.say(&lines);
        Ok(())
    }

    fn set_parameters(&mut self, arguments: &[&str]) -> Result<(), i32> {
        if arguments.is_empty() || !arguments.len().is_multiple_of(3) {
            return Err(PARAMETER);
        }
        for triple in arguments.chunks(3) {
            let axis = self.named(&triple[..1])?[0];
            let parameter = parameters::parameter(triple[1]).ok_or(UNKNOWN_PARAMETER)?;
            if !parameter.set(&mut self.axes[axis], triple[2]) {
                return Err(PARAMETER);
            }
        }
        Ok(())
    }

    /// All of them or none.
    fn move_axes(&mut self, pairs: &[(usize, f64)], relative: bool) -> Result<(), i32> {
        let target = |axis: &Axis, value: f64| if relative { axis.target + value } else { value };
        for &(index, value) in pairs {
            let axis = &self.axes[index];
            if !axis.servo || (axis.reference_on && !axis.referenced) || axis.drive.is_homing() {
                return Err(UNREFERENCED_OR_SERVO_OFF);
            }
            if !(axis.low - 1e-9..=axis.high + 1e-9).contains(&target(axis, value)) {
                return Err(POSITION_OUT_OF_LIMITS);
            }
        }
        for &(index, value) in pairs {
            let axis = &mut self.axes[index];
            axis.target = target(axis, value);
            axis.drive.move_to(axis.target);
        }
        Ok(())
    }

    /// To the negative limit, the positive one, or the reference switch, which is the home switch.
    fn reference(&mut self, named: &[usize], word: &str) -> Result<(), i32> {
        if named.iter().any(|&index| !self.axes[index].servo) {
            return Err(UNREFERENCED_OR_SERVO_OFF);
        }
        if named.iter().any(|&index| !self.axes[index].reference_on) {
            return Err(REFERENCE_OFF);
        }
        for &index in named {
            self.axes[index].referenced = false;
            let drive = &mut self.axes[index].drive;
            match word {
                "FNL" => drive.home_towards(true),
                "FPL" => drive.home_towards(false),
                _ => drive.home(),
            }
        }
        Ok(())
    }
}

impl Firmware for PiFirmware {
    fn receive(&mut self, byte: u8) {
        match byte {
            b'\n' => {
                let line = std::mem::take(&mut self.line);
                let line = String::from_utf8_lossy(&line).into_owned();
                tracing::debug!(line = %line, "a twin was told");
                self.take(&line);
            }
            0..=0x1F => self.at_once(byte),
            _ if self.line.len() < LONGEST_LINE => self.line.push(byte),
            _ => {}
        }
    }

    fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.out)
    }

    fn advance(&mut self, seconds: f64) {
        for axis in &mut self.axes {
            match axis.drive.advance(seconds) {
                Some(Event::Homed) => {
                    let at = axis.reference();
                    axis.drive.set_position(at);
                    (axis.referenced, axis.target) = (true, at);
                }
                // The servo gives up.
                Some(Event::HomingFailed | Event::Limit) => {
                    axis.servo = false;
                    self.error = MOTION_ERROR;
                }
                Some(Event::Stopped) => axis.target = axis.drive.position(),
                Some(Event::Arrived) | None => {}
            }
        }
    }

    fn is_moving(&self) -> bool {
        self.axes.iter().any(|axis| axis.drive.is_moving())
    }

    fn stall(&mut self, axis: usize, stalled: bool) {
        if let Some(axis) = self.axes.get_mut(axis) {
            axis.drive.stalled = stalled;
        }
    }

    fn power_cycle(&mut self) {
        self.line.clear();
        self.error = 0;
        for axis in &mut self.axes {
            axis.drive.power_cycle();
            (axis.referenced, axis.reference_on, axis.servo, axis.target) = (false, true, false, 0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::BenchConfig;
    use crate::sim::plant::Slides;

    fn twin() -> PiFirmware {
        let bench = BenchConfig::default();
        let mut drive = DriveConfig::of(&bench.e);
        drive.name = "1".to_owned();
        let plant: Arc<dyn Plant> = Slides::new(&[(&bench.e, 20.0)]);
        PiFirmware::new(vec![drive], &plant)
    }

    fn told(twin: &mut PiFirmware, line: &str) -> String {
        line.bytes().chain([b'\n']).for_each(|byte| twin.receive(byte));
        String::from_utf8_lossy(&twin.take_output()).into_owned()
    }

    #[test]
    fn every_command_that_it_lists_is_known_to_it() {
        for line in parameters::COMMANDS.iter().filter(|line| !line.starts_with('#')) {
            let mut twin = twin();
            told(&mut twin, line.split(' ').next().unwrap());
            assert_ne!(twin.error, UNKNOWN_COMMAND, "{line}");
        }
    }

    #[test]
    fn a_stop_makes_its_place_the_target() {
        for stop in ["STP", "HLT 1", "\u{18}"] {
            let mut twin = twin();
            for line in ["SVO 1 1", "RON 1 0", "VEL 1 5"] {
                told(&mut twin, line);
            }
            assert_eq!(told(&mut twin, "MOV 1 -4"), "");
            twin.advance(0.5);
            assert_eq!(told(&mut twin, "ONT? 1"), "1=0\n");
            told(&mut twin, stop);
            twin.advance(1.0);
            let at = twin.axes[0].drive.position();
            assert!(at < -0.5 && at > -3.9, "{stop}: it is stopped on its way, at {at}");
            assert_eq!(told(&mut twin, "MOV? 1"), format!("1={at:.6}\n"), "{stop}");
            assert_eq!((told(&mut twin, "ONT? 1"), told(&mut twin, "ERR?")), ("1=1\n".into(), "10\n".into()), "{stop}");
        }
    }
}
