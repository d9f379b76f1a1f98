//! One motor of a Thorlabs controller's twin: its parameters, its status, and what it does about a message.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::super::PULL_OFF_MM;
use super::super::drive::{Drive, DriveConfig, Event};
use crate::sim::plant::Plant;

/// Sets of parameters, by the number of the message that sets them; the two numbers after it ask for and tell them.
const SPEED: u16 = 0x0413;
const JOG: u16 = 0x0416;
const LIMITS: u16 = 0x0423;
const POWER: u16 = 0x0426;
const BACKLASH: u16 = 0x043A;
const HOMING: u16 = 0x0440;
const DISTANCE: u16 = 0x0445;
const TARGET: u16 = 0x0450;

const FORWARD: u8 = 1;

/// What it drives, which decides what its numbers of speed mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Motor {
    Servo,
    Stepper,
}

impl Motor {
    /// Numbers of speed and acceleration for one unit of position a second, and a second squared.
    fn scales(self) -> (f64, f64) {
        match self {
            Self::Servo => {
                let cycle = 2048.0 / 6.0e6;
                (65536.0 * cycle, 65536.0 * cycle * cycle)
            }
            Self::Stepper => (53.68, 53.68 * 204.94e-6),
        }
    }
}

/// What a motor has to say by itself.
pub(super) enum Told {
    Homed,
    Completed,
    Stopped,
}

pub(super) struct Channel {
    pub(super) drive: Drive,
    motor: Motor,
    parameters: BTreeMap<u16, Vec<u8>>,
    homed: bool,
    enabled: bool,
    jogging: bool,
    /// Which limit in numbers it stands at: the greater one or the lesser.
    at_soft_limit: Option<bool>,
    /// Where its limits in numbers end the motion under way.
    cut_short: Option<bool>,
}

fn block(words: &[u16], longs: &[f64], rest: &[u16]) -> Vec<u8> {
    let mut data = 1u16.to_le_bytes().to_vec();
    data.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    data.extend(longs.iter().flat_map(|long| (long.round() as i32).to_le_bytes()));
    data.extend(rest.iter().flat_map(|word| word.to_le_bytes()));
    data
}

/// The parameters at power-up. A controller keeps its own; these suit the axis.
fn parameters(config: &DriveConfig, motor: Motor) -> BTreeMap<u16, Vec<u8>> {
    let units = config.units_per_mm;
    let (speed, acceleration) = motor.scales();
    let speed = config.speed_mm_per_s * units * speed;
    let acceleration = config.acceleration_mm_per_s2 * units * acceleration;
    let (direction, switch) = if config.homes_negative { (2, 1) } else { (1, 4) };
    BTreeMap::from([
        (SPEED, block(&[], &[0.0, acceleration, speed], &[])),
        (JOG, block(&[2], &[0.1 * units, 0.0, acceleration, speed], &[2])),
        // Both switches make contact; the limits in numbers stop at once.
        (LIMITS, block(&[2, 2], &[config.high_mm * units, config.low_mm * units], &[2])),
        (POWER, block(&[10, 100], &[], &[])),
        (BACKLASH, block(&[], &[0.0], &[])),
        (HOMING, block(&[direction, switch], &[speed, PULL_OFF_MM * units], &[])),
        (DISTANCE, block(&[], &[0.0], &[])),
        (TARGET, block(&[], &[0.0], &[])),
    ])
}

impl Channel {
    pub(super) fn new(config: DriveConfig, motor: Motor, index: usize, plant: &Arc<dyn Plant>) -> Self {
        Self {
            parameters: parameters(&config, motor),
            drive: Drive::new(config, index, Arc::clone(plant)),
            motor,
            homed: false,
            enabled: true,
            jogging: false,
            at_soft_limit: None,
            cut_short: None,
        }
    }

    pub(super) fn power_cycle(&mut self) {
        self.drive.power_cycle();
        self.parameters = parameters(&self.drive.config, self.motor);
        (self.homed, self.enabled, self.jogging) = (false, true, false);
        (self.at_soft_limit, self.cut_short) = (None, None);
    }

    fn units(&self) -> f64 {
        self.drive.config.units_per_mm
    }

    pub(super) fn position(&self) -> i32 {
        (self.drive.position() * self.units()).round() as i32
    }

    pub(super) fn set_position(&mut self, position: i32) {
        self.drive.set_position(f64::from(position) / self.units());
    }

    fn word(&self, set: u16, at: usize) -> u16 {
        let bytes = self.parameters.get(&set).and_then(|data| data.get(at..at + 2));
        bytes.map_or(0, |bytes| u16::from_le_bytes([bytes[0], bytes[1]]))
    }

    fn long(&self, set: u16, at: usize) -> f64 {
        let bytes = self.parameters.get(&set).and_then(|data| data.get(at..at + 4));
        bytes.map_or(0.0, |b| f64::from(i32::from_le_bytes([b[0], b[1], b[2], b[3]])))
    }

    /// Takes a set of parameters, where it is one.
    pub(super) fn set(&mut self, number: u16, data: &[u8]) {
        if let Some(held) = self.parameters.get_mut(&number).filter(|held| held.len() == data.len()) {
            held.copy_from_slice(data);
        }
    }

    /// A set of parameters, by the number of the message that asks for it.
    pub(super) fn get(&self, number: u16) -> Option<&[u8]> {
        self.parameters.get(&number.checked_sub(1)?).map(Vec::as_slice)
    }

    pub(super) fn enable(&mut self, on: bool) {
        self.enabled = on;
        if !on {
            self.drive.halt();
        }
    }

    pub(super) fn is_enabled(&self) -> bool {
        self.enabled
    }

    /// Gets ready to move at the speed of a set of parameters; nothing moves while the motor is off.
    fn begins(&mut self, set: u16, (acceleration, speed): (usize, usize), jogging: bool) -> bool {
        let (of_speed, of_acceleration) = self.motor.scales();
        self.drive.speed = (self.long(set, speed) / of_speed / self.units()).max(1e-6);
        self.drive.acceleration = (self.long(set, acceleration) / of_acceleration / self.units()).max(1e-3);
        self.jogging = jogging;
        (self.at_soft_limit, self.cut_short) = (None, None);
        if self.enabled && self.drive.is_homing() {
            self.homed = false;
        }
        self.enabled
    }

    /// The limits in numbers, least first, mm, where they are in force.
    fn soft_limits(&self) -> Option<(f64, f64)> {
        let (a, b) = (self.long(LIMITS, 6) / self.units(), self.long(LIMITS, 10) / self.units());
        matches!(self.word(LIMITS, 14) & 0x7F, 2 | 3).then(|| (a.min(b), a.max(b)))
    }

    fn go(&mut self, target: f64) {
        let mut to = target / self.units();
        if let Some((low, high)) = self.soft_limits() {
            self.cut_short = if to > high { Some(true) } else { (to < low).then_some(false) };
            // One that is beyond already may come back.
            let here = self.drive.position();
            to = to.clamp(low.min(here), high.max(here));
        }
        self.drive.move_to(to);
    }

    pub(super) fn move_absolute(&mut self, target: Option<i32>) {
        let target = target.map_or_else(|| self.long(TARGET, 2), f64::from);
        if self.begins(SPEED, (6, 10), false) {
            self.go(target);
        }
    }

    pub(super) fn move_relative(&mut self, distance: Option<i32>) {
        let distance = distance.map_or_else(|| self.long(DISTANCE, 2), f64::from);
        if self.begins(SPEED, (6, 10), false) {
            self.go(f64::from(self.position()) + distance);
        }
    }

    /// Which way a direction is: clients that others wrote hold a servo's forward to be towards smaller counts.
    fn sign(&self, direction: u8) -> f64 {
        if (direction == FORWARD) == (self.motor == Motor::Stepper) { 1.0 } else { -1.0 }
    }

    pub(super) fn jog(&mut self, direction: u8) {
        let sign = self.sign(direction);
        if !self.begins(JOG, (12, 16), true) {
            return;
        }
        if self.word(JOG, 2) == 1 {
            self.drive.run(sign * self.drive.speed);
        } else {
            self.go(f64::from(self.position()) + sign * self.long(JOG, 4));
        }
    }

    pub(super) fn run(&mut self, direction: u8) {
        if self.begins(SPEED, (6, 10), false) {
            self.drive.run(self.sign(direction) * self.drive.speed);
        }
    }

    pub(super) fn home(&mut self) {
        let velocity = self.long(HOMING, 6);
        if self.begins(SPEED, (6, 10), false) {
            self.homed = false;
            self.drive.homing_speed = (velocity / self.motor.scales().0 / self.units()).max(1e-6);
            self.drive.home_towards(self.word(HOMING, 2) == 2);
        }
    }

    /// Stops; tells whether it stands already.
    pub(super) fn stop(&mut self, at_once: bool) -> Option<Told> {
        let moved = self.drive.is_moving();
        if at_once {
            self.drive.halt();
            return moved.then_some(Told::Stopped);
        }
        self.drive.stop();
        None
    }

    pub(super) fn advance(&mut self, seconds: f64) -> Option<Told> {
        let event = self.drive.advance(seconds);
        if let (false, Some((low, high))) = (self.drive.is_homing(), self.soft_limits()) {
            // A motion without a target ends at them, too.
            let (at, speed) = (self.drive.position(), self.drive.velocity());
            let beyond = if at > high && speed > 0.0 { Some(true) } else { (at < low && speed < 0.0).then_some(false) };
            if beyond.is_some() && self.homed {
                self.drive.halt();
                self.at_soft_limit = beyond;
                return Some(Told::Stopped);
            }
        }
        Some(match event? {
            Event::Homed => {
                self.drive.set_position(0.0);
                self.homed = true;
                Told::Homed
            }
            Event::Arrived => {
                self.at_soft_limit = self.cut_short.take();
                Told::Completed
            }
            Event::Stopped | Event::Limit => Told::Stopped,
            Event::HomingFailed => return None,
        })
    }

    pub(super) fn bits(&self) -> u32 {
        let (drive, moving) = (&self.drive, self.drive.is_moving());
        let forward = (drive.velocity() >= 0.0) == (self.motor == Motor::Stepper);
        // By those clients the lower bit of either pair is the lower end's.
        let at_limit = drive.at_limit();
        let in_place = self.motor == Motor::Servo && self.enabled;
        [
            (at_limit && !drive.positive_limit, 0),
            (at_limit && drive.positive_limit, 1),
            (self.at_soft_limit == Some(false), 2),
            (self.at_soft_limit == Some(true), 3),
            (moving && forward && !self.jogging, 4),
            (moving && !forward && !self.jogging, 5),
            (moving && forward && self.jogging, 6),
            (moving && !forward && self.jogging, 7),
            (true, 8),
            (drive.is_homing(), 9),
            (self.homed, 10),
            (in_place, 12),
            (in_place && !moving, 13),
            (self.enabled, 31),
        ]
        .into_iter()
        .map(|(set, bit)| u32::from(set) << bit)
        .sum()
    }

    /// Position and status, as the message that tells both has them.
    pub(super) fn state(&self) -> Vec<u8> {
        let mut data = 1u16.to_le_bytes().to_vec();
        data.extend(self.position().to_le_bytes());
        match self.motor {
            Motor::Servo => {
                let speed = (self.drive.velocity() * self.units() * self.motor.scales().0 / 65536.0).round() as i16;
                data.extend(speed.to_le_bytes());
                data.extend([0, 0]);
            }
            // Without an encoder there is nothing to count.
            Motor::Stepper => data.extend([0; 4]),
        }
        data.extend(self.bits().to_le_bytes());
        data
    }
}
