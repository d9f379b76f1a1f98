//! A Zaber controller's firmware, ASCII protocol, version 7.

use std::sync::Arc;

use super::Firmware;
use super::drive::{Drive, DriveConfig, Event};
use crate::device::stage::zaber::{ACCELERATION_UNIT, SPEED_UNIT, checksum};
use crate::sim::plant::Plant;

/// Longest line taken.
const LONGEST_LINE: usize = 120;

struct Axis {
    drive: Drive,
    /// Whether it has a reference position.
    referenced: bool,
    enabled: bool,
    /// A limit switch was hit, or homing found none.
    limit: bool,
    lost: bool,
    /// A motion was interrupted by another command, and none has begun at rest since: no clearing takes that away.
    interrupted: bool,
    low: f64,
    high: f64,
}

impl Axis {
    fn units(&self) -> f64 {
        self.drive.config.units_per_mm
    }

    fn position(&self) -> i64 {
        (self.drive.position() * self.units()).round() as i64
    }

    /// Its flags, the gravest first.
    fn flags(&self) -> Vec<&'static str> {
        let flags = [
            (!self.enabled, "FO"),
            (self.lost, "FE"),
            (self.limit, "WL"),
            (!self.referenced, "WR"),
            (self.interrupted, "NI"),
        ];
        flags.into_iter().filter(|(set, _)| *set).map(|(_, flag)| flag).collect()
    }
}

/// A device with an axis for every drive, at address 1.
pub struct ZaberFirmware {
    axes: Vec<Axis>,
    /// What it says its version is.
    version: String,
    /// Whether it says by itself when an axis has come to rest.
    alerts: bool,
    line: Vec<u8>,
    out: Vec<u8>,
}

impl ZaberFirmware {
    /// A device just powered up, its axes numbered in order.
    #[must_use]
    pub fn new(axes: Vec<DriveConfig>, plant: &Arc<dyn Plant>) -> Self {
        let axes = axes.into_iter().enumerate().map(|(index, config)| Axis {
            low: (config.low_mm * config.units_per_mm).round(),
            high: (config.high_mm * config.units_per_mm).round(),
            drive: Drive::new(config, index, Arc::clone(plant)),
            referenced: false,
            enabled: true,
            limit: false,
            lost: false,
            interrupted: false,
        });
        Self { axes: axes.collect(), version: "7.36".to_owned(), alerts: false, line: Vec::new(), out: Vec::new() }
    }

    /// Makes it say that it is another version.
    #[must_use]
    pub fn with_version(mut self, version: &str) -> Self {
        version.clone_into(&mut self.version);
        self
    }

    fn take(&mut self, line: &str) {
        let Some(mut body) = line.trim_end().strip_prefix('/') else { return };
        if let Some((before, digits)) = body.rsplit_once(':').filter(|(_, digits)| digits.len() == 2) {
            // A damaged command is not answered.
            if u8::from_str_radix(digits, 16) != Ok(checksum(before)) {
                return;
            }
            body = before;
        }
        let mut words: Vec<&str> = body.split(' ').filter(|word| !word.is_empty()).collect();
        let mut numbers = Vec::new();
        while numbers.len() < 3 && words.first().is_some_and(|word| word.bytes().all(|b| b.is_ascii_digit())) {
            numbers.push(words.remove(0));
        }
        if words.first() == Some(&"--") {
            words.remove(0);
        }
        let device = numbers.first().map_or(Some(0), |number| number.parse::<u8>().ok());
        let axis = numbers.get(1).map_or(Some(0), |number| number.parse::<usize>().ok());
        let (Some(0..=1), Some(axis)) = (device, axis) else { return };
        let answer = if axis > self.axes.len() { Err("BADAXIS") } else { self.execute(axis, &words) };
        self.reply(axis, numbers.get(2).copied(), &answer);
    }

    fn scope(&self, axis: usize) -> std::ops::Range<usize> {
        if axis == 0 { 0..self.axes.len() } else { axis - 1..axis }
    }

    fn reply(&mut self, axis: usize, id: Option<&str>, answer: &Result<String, &'static str>) {
        let scope = self.scope(axis.min(self.axes.len()));
        let busy = self.axes[scope.clone()].iter().any(|axis| axis.drive.is_moving());
        let flag = self.gravest(scope);
        let (word, data) = match answer {
            Ok(data) if data.is_empty() => ("OK", "0"),
            Ok(data) => ("OK", data.as_str()),
            Err(reason) => ("RJ", *reason),
        };
        let id = id.map(|id| format!(" {id}")).unwrap_or_default();
        let busy = if busy { "BUSY" } else { "IDLE" };
        self.out.extend(format!("@01 {axis}{id} {word} {busy} {flag} {data}\r\n").bytes());
    }

    /// The gravest flag of some axes.
    fn gravest(&self, scope: std::ops::Range<usize>) -> &'static str {
        let flags: Vec<&str> = self.axes[scope].iter().flat_map(Axis::flags).collect();
        let order = ["FO", "FE", "WL", "WR", "NI"];
        order.into_iter().find(|flag| flags.contains(flag)).unwrap_or("--")
    }

    /// Says that an axis has come to rest, where that is wanted.
    fn alert(&mut self, index: usize) {
        if self.alerts {
            let flag = self.gravest(index..index + 1);
            self.out.extend(format!("!01 {} IDLE {flag}\r\n", index + 1).bytes());
        }
    }

    fn execute(&mut self, axis: usize, words: &[&str]) -> Result<String, &'static str> {
        let scope = self.scope(axis);
        match words {
            [] => Ok(String::new()),
            ["get", name] => self.get(axis, name),
            ["set", name, value] => self.set(axis, name, value),
            ["tools", "echo", rest @ ..] => Ok(rest.join(" ")),
            ["system", "reset"] if axis == 0 => {
                self.power_cycle();
                Ok(String::new())
            }
            ["warnings", rest @ ..] => {
                let flags: Vec<&str> = self.axes[scope.clone()].iter().flat_map(Axis::flags).collect();
                if *rest == ["clear"] {
                    for axis in &mut self.axes[scope] {
                        (axis.limit, axis.lost) = (false, false);
                    }
                }
                Ok(format!("{:02} {}", flags.len(), flags.join(" ")).trim().to_owned())
            }
            ["driver", word @ ("enable" | "disable")] => {
                for index in scope {
                    self.axes[index].enabled = *word == "enable";
                    if *word == "disable" {
                        self.halt(index);
                    }
                }
                Ok(String::new())
            }
            ["stop"] | ["estop"] => {
                for index in scope {
                    let axis = &mut self.axes[index];
                    axis.interrupted |= axis.drive.is_moving();
                    if words == ["estop"] {
                        self.halt(index);
                    } else {
                        axis.drive.stop();
                    }
                }
                Ok(String::new())
            }
            ["home"] | ["move", ..] => {
                if self.axes[scope.clone()].iter().any(|axis| !axis.enabled) {
                    return Err("DRIVERDISABLED");
                }
                for index in scope {
                    self.begin(index, words)?;
                }
                Ok(String::new())
            }
            _ => Err("BADCOMMAND"),
        }
    }

    fn halt(&mut self, index: usize) {
        let moved = self.axes[index].drive.is_moving();
        self.axes[index].drive.halt();
        if moved {
            self.alert(index);
        }
    }

    fn begin(&mut self, index: usize, words: &[&str]) -> Result<(), &'static str> {
        let axis = &mut self.axes[index];
        let units = axis.units();
        let number = |word: &&str| word.parse::<f64>().ok().filter(|n| n.is_finite()).ok_or("BADDATA");
        let now = axis.position() as f64;
        let (target, rest) = match words {
            ["home"] => {
                axis.interrupted = axis.drive.is_moving();
                axis.referenced = false;
                axis.limit = false;
                axis.drive.speed = axis.drive.config.speed_mm_per_s;
                axis.drive.home();
                return Ok(());
            }
            ["move", "vel", velocity, ..] => {
                let velocity = number(velocity)?;
                axis.interrupted = axis.drive.is_moving();
                axis.drive.acceleration = axis.drive.config.acceleration_mm_per_s2;
                axis.drive.run(velocity / SPEED_UNIT / units);
                return Ok(());
            }
            ["move", "abs", target, rest @ ..] if axis.referenced => (number(target)?, rest),
            ["move", "rel", by, rest @ ..] => (now + number(by)?, rest),
            ["move", "min", rest @ ..] if axis.referenced => (axis.low, rest),
            ["move", "max", rest @ ..] if axis.referenced => (axis.high, rest),
            _ => return Err("BADCOMMAND"),
        };
        if axis.referenced && !(axis.low..=axis.high).contains(&target) {
            return Err("BADDATA");
        }
        let speed = rest.first().map(number).transpose()?.map(|speed| speed / SPEED_UNIT / units);
        let acceleration = rest.get(1).map(number).transpose()?.map(|a| a / ACCELERATION_UNIT / units);
        axis.drive.speed = speed.unwrap_or(axis.drive.config.speed_mm_per_s);
        axis.drive.acceleration = acceleration.unwrap_or(axis.drive.config.acceleration_mm_per_s2);
        axis.interrupted = axis.drive.is_moving();
        axis.drive.move_to(target / units);
        Ok(())
    }

    fn get(&self, axis: usize, name: &str) -> Result<String, &'static str> {
        let device = match name {
            "device.id" | "deviceid" => Some("50081".to_owned()),
            "version" => Some(self.version.clone()),
            "system.serial" => Some("104233".to_owned()),
            "system.axiscount" => Some(self.axes.len().to_string()),
            "system.access" => Some("1".to_owned()),
            "system.platform" => Some("50081".to_owned()),
            "comm.address" => Some("1".to_owned()),
            "comm.checksum" => Some("0".to_owned()),
            "comm.alert" => Some(u8::from(self.alerts).to_string()),
            "comm.packet.size.max" => Some("80".to_owned()),
            "version.build" => Some("13914".to_owned()),
            _ => None,
        };
        if let Some(value) = device {
            return Ok(value);
        }
        let values: Option<Vec<String>> = self.axes[self.scope(axis)]
            .iter()
            .map(|axis| {
                let units = axis.units();
                Some(match name {
                    "pos" => axis.position().to_string(),
                    "vel" => format!("{:.0}", axis.drive.velocity() * units * SPEED_UNIT),
                    "limit.min" => format!("{:.0}", axis.low),
                    "limit.max" => format!("{:.0}", axis.high),
                    "maxspeed" => format!("{:.0}", axis.drive.config.speed_mm_per_s * units * SPEED_UNIT),
                    "accel" | "motion.accelonly" | "motion.decelonly" => {
                        format!("{:.0}", axis.drive.config.acceleration_mm_per_s2 * units * ACCELERATION_UNIT)
                    }
                    "resolution" => "64".to_owned(),
                    "limit.home.triggered" | "limit.home.state" => {
                        u8::from(axis.drive.home_switch_closed()).to_string()
                    }
                    "driver.enabled" => u8::from(axis.enabled).to_string(),
                    "peripheral.id" | "peripheralid" => "70374".to_owned(),
                    _ => return None,
                })
            })
            .collect();
        values.map(|values| values.join(" ")).ok_or("BADCOMMAND")
    }

    fn set(&mut self, axis: usize, name: &str, value: &str) -> Result<String, &'static str> {
        let value: f64 = value.parse().ok().filter(|value: &f64| value.is_finite()).ok_or("BADDATA")?;
        if name == "comm.alert" {
            self.alerts = if value == 0.0 || value == 1.0 { value == 1.0 } else { return Err("BADDATA") };
            return Ok(String::new());
        }
        let scope = self.scope(axis);
        for axis in &mut self.axes[scope] {
            let units = axis.units();
            match name {
                "maxspeed" if value >= 1.0 => axis.drive.config.speed_mm_per_s = value / SPEED_UNIT / units,
                "accel" if value >= 1.0 => axis.drive.config.acceleration_mm_per_s2 = value / ACCELERATION_UNIT / units,
                "limit.min" if value < axis.high => axis.low = value,
                "limit.max" if value > axis.low => axis.high = value,
                "pos" => {
                    axis.drive.set_position(value / units);
                    axis.referenced = true;
                }
                "maxspeed" | "accel" | "limit.min" | "limit.max" => return Err("BADDATA"),
                _ => return Err("BADCOMMAND"),
            }
        }
        Ok(String::new())
    }
}

impl Firmware for ZaberFirmware {
    fn receive(&mut self, byte: u8) {
        match byte {
            b'\n' | b'\r' => {
                let line = std::mem::take(&mut self.line);
                let line = String::from_utf8_lossy(&line).into_owned();
                tracing::debug!(line = %line, "a twin was told");
                self.take(&line);
            }
            // A command begins anew with its first character.
            b'/' => {
                self.line.clear();
                self.line.push(byte);
            }
            _ if self.line.len() < LONGEST_LINE => self.line.push(byte),
            _ => {}
        }
    }

    fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.out)
    }

    fn advance(&mut self, seconds: f64) {
        for index in 0..self.axes.len() {
            let axis = &mut self.axes[index];
            let event = axis.drive.advance(seconds);
            match event {
                Some(Event::Homed) => {
                    axis.drive.set_position(0.0);
                    axis.referenced = true;
                    (axis.limit, axis.lost) = (false, false);
                }
                Some(Event::HomingFailed) => axis.lost = true,
                Some(Event::Limit) => axis.limit = true,
                Some(Event::Arrived | Event::Stopped) | None => {}
            }
            if event.is_some() {
                self.alert(index);
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
        for axis in &mut self.axes {
            axis.drive.power_cycle();
            (axis.referenced, axis.enabled) = (false, true);
            (axis.limit, axis.lost, axis.interrupted) = (false, false, false);
        }
    }
}
