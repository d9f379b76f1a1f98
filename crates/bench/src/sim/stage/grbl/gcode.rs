//! What the firmware makes of a line: `$` commands, jogs, and the few words of G-code that move axes.

use super::settings::Heir;
use super::{GrblFirmware, State};

/// What becomes of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Answer {
    /// Done, or queued.
    Ok,
    /// Answered when it has been carried out.
    AtEnd,
}

/// Why a line is not carried out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Refusal {
    /// One of Grbl's errors.
    Error(u8),
    /// Beyond the soft limits: an alarm.
    SoftLimit,
}

/// What G-code remembers from line to line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Modal {
    rapid: bool,
    relative: bool,
    inches: bool,
    feed_mm_per_min: f64,
}

impl Default for Modal {
    fn default() -> Self {
        Self { rapid: true, relative: false, inches: false, feed_mm_per_min: 0.0 }
    }
}

/// The words of one line.
#[derive(Debug, Default)]
struct Words {
    axes: [Option<f64>; 3],
    feed: Option<f64>,
    rapid: Option<bool>,
    relative: Option<bool>,
    inches: Option<bool>,
}

impl Words {
    fn parse(text: &str) -> Result<Self, u8> {
        let mut words = Self::default();
        let mut rest = text;
        while let Some(letter) = rest.chars().next() {
            if !letter.is_ascii_uppercase() {
                return Err(1);
            }
            rest = &rest[1..];
            let end = rest.find(|c: char| !(c.is_ascii_digit() || "+-.".contains(c))).unwrap_or(rest.len());
            let value: f64 = rest[..end].parse().map_err(|_| 2u8)?;
            rest = &rest[end..];
            match letter {
                'X' => words.axes[0] = Some(value),
                'Y' => words.axes[1] = Some(value),
                'Z' => words.axes[2] = Some(value),
                'F' if value < 0.0 => return Err(4),
                'F' => words.feed = Some(value),
                'G' => match (value * 10.0).round() as i64 {
                    0 => words.rapid = Some(true),
                    10 => words.rapid = Some(false),
                    200 => words.inches = Some(true),
                    210 => words.inches = Some(false),
                    900 => words.relative = Some(false),
                    910 => words.relative = Some(true),
                    // Machine coordinates: work coordinates are the same here, so nothing changes but the words.
                    530 | 540 | 170 | 940 => {}
                    _ => return Err(20),
                },
                // Program words and the spindle's have nothing to act on.
                'M' | 'S' | 'T' | 'N' => {}
                _ => return Err(20),
            }
        }
        Ok(words)
    }
}

impl GrblFirmware {
    /// Carries out a line.
    pub(super) fn execute(&mut self, line: &[u8]) -> Result<Answer, Refusal> {
        if let Some(answer) = self.fluid_command(line) {
            return answer;
        }
        let text: String = String::from_utf8_lossy(line)
            .chars()
            .filter(|c| !c.is_whitespace())
            .map(|c| c.to_ascii_uppercase())
            .collect();
        if text.is_empty() {
            return Ok(Answer::Ok);
        }
        match text.strip_prefix('$') {
            Some(command) => self.command(command),
            None if matches!(self.state, State::Alarm | State::Door | State::Jog | State::Sleep) => {
                Err(Refusal::Error(9))
            }
            None => self.gcode(&text),
        }
    }

    fn command(&mut self, command: &str) -> Result<Answer, Refusal> {
        let at_rest = matches!(self.state, State::Idle | State::Alarm);
        if let Some(words) = command.strip_prefix("J=") {
            return match self.state {
                State::Idle | State::Jog => self.jog(words),
                _ => Err(Refusal::Error(8)),
            };
        }
        match command {
            "" => self.say("[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]"),
            "$" if matches!(self.state, State::Run | State::Hold) => return Err(Refusal::Error(8)),
            "$" => self.say_settings(),
            _ if !at_rest => return Err(Refusal::Error(8)),
            "I" => {
                let version = self.config.version.split(' ').next_back().unwrap_or_default().to_owned();
                self.say(&format!("[VER:{version}.20190825:]"));
                let (zero, single) = (self.homes_to_zero(), self.homes_single_axes());
                self.say(&format!("[OPT:V{}{},15,128]", if zero { "Z" } else { "" }, if single { "H" } else { "" }));
                if self.config.heir == Heir::GrblHal {
                    self.say("[FIRMWARE:grblHAL]");
                }
            }
            "G" => self.say("[GC:G0 G54 G17 G21 G90 G94 M5 M9 T0 F0 S0]"),
            "X" => {
                if self.state == State::Alarm {
                    self.say("[MSG:Caution: Unlocked]");
                    self.state = State::Idle;
                }
            }
            "SLP" => {
                self.say("[MSG:Sleeping]");
                self.state = State::Sleep;
            }
            "H" | "HX" | "HY" | "HZ" => {
                if !self.settings.is_on(22) {
                    return Err(Refusal::Error(5));
                }
                let axis = "XYZ".find(&command[1..]).filter(|_| command.len() == 2);
                if axis.is_some_and(|axis| !self.homes_single_axes() || self.config.axes[axis].is_none()) {
                    return Err(Refusal::Error(if self.config.heir == Heir::GrblHal { 5 } else { 3 }));
                }
                self.home(axis);
                return Ok(Answer::AtEnd);
            }
            setting => {
                let (number, value) = setting.split_once('=').ok_or(Refusal::Error(3))?;
                let number = number.parse().map_err(|_| Refusal::Error(3))?;
                let value = value.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or(Refusal::Error(2))?;
                self.settings.set(number, value).map_err(Refusal::Error)?;
            }
        }
        Ok(Answer::Ok)
    }

    fn jog(&mut self, text: &str) -> Result<Answer, Refusal> {
        let words = Words::parse(text).map_err(Refusal::Error)?;
        if words.rapid.is_some() {
            return Err(Refusal::Error(16));
        }
        if words.axes == [None; 3] {
            return Err(Refusal::Error(26));
        }
        let inches = words.inches.unwrap_or(self.modal.inches);
        let relative = words.relative.unwrap_or(self.modal.relative);
        let scale = if inches { 25.4 } else { 1.0 };
        let feed = words.feed.ok_or(Refusal::Error(22))? * scale;
        let mut target = self.target(words.axes, scale, relative);
        if self.fluid.is_some() {
            target = self.fluid_jog_target(target);
        } else if self.settings.is_on(40) {
            // grblHAL draws every axis that is homed into its limits.
            target =
                std::array::from_fn(|i| self.envelope[i].map_or(target[i], |(low, high)| target[i].clamp(low, high)));
        } else if self.beyond_travel(target) {
            return Err(Refusal::Error(15));
        }
        self.plan(target, feed / 60.0, State::Jog);
        Ok(Answer::Ok)
    }

    fn gcode(&mut self, text: &str) -> Result<Answer, Refusal> {
        let words = Words::parse(text).map_err(Refusal::Error)?;
        self.modal.inches = words.inches.unwrap_or(self.modal.inches);
        let scale = if self.modal.inches { 25.4 } else { 1.0 };
        self.modal.rapid = words.rapid.unwrap_or(self.modal.rapid);
        self.modal.relative = words.relative.unwrap_or(self.modal.relative);
        self.modal.feed_mm_per_min = words.feed.map_or(self.modal.feed_mm_per_min, |feed| feed * scale);
        if words.axes == [None; 3] {
            return Ok(Answer::Ok);
        }
        if !self.modal.rapid && self.modal.feed_mm_per_min <= 0.0 {
            return Err(Refusal::Error(22));
        }
        let target = self.target(words.axes, scale, self.modal.relative);
        if self.beyond_travel(target) {
            return Err(Refusal::SoftLimit);
        }
        let speed = if self.modal.rapid { f64::INFINITY } else { self.modal.feed_mm_per_min / 60.0 };
        self.plan(target, speed, State::Run);
        Ok(Answer::Ok)
    }

    fn target(&self, axes: [Option<f64>; 3], scale: f64, relative: bool) -> [f64; 3] {
        let from = self.planned_mm();
        std::array::from_fn(|i| match axes[i] {
            Some(value) if relative => from[i] + value * scale,
            Some(value) => value * scale,
            None => from[i],
        })
    }

    /// Whether soft limits are on and a machine position (mm) lies outside them: machine space is negative.
    fn beyond_travel(&self, target: [f64; 3]) -> bool {
        // A tenth of a micrometre, for the decimals of a line.
        let spare = 1e-4;
        if self.fluid.is_some() {
            return self.fluid_beyond(target);
        }
        let limits = |i: usize| match self.config.heir {
            Heir::GrblHal => self.envelope[i],
            _ => self.config.axes[i].as_ref().map(|_| (-self.settings.of_axis(130, i), 0.0)),
        };
        let beyond =
            |i: usize| limits(i).is_some_and(|(low, high)| target[i] < low - spare || target[i] > high + spare);
        self.settings.is_on(20) && (0..3).any(beyond)
    }
}
