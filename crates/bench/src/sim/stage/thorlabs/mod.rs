//! The firmware of Thorlabs controllers, APT protocol: a KDC101 with one brushed servo motor, a KST101 with one stepper
//! motor, a BSC203 with a stepper motor in every bay that has one.

mod channel;

use std::sync::Arc;

use super::Firmware;
use super::drive::DriveConfig;
use crate::sim::plant::Plant;
use channel::{Channel, Motor, Told};

const HOST: u8 = 0x01;
const USB_UNIT: u8 = 0x50;
const MAIN_BOARD: u8 = 0x11;
const FIRST_BAY: u8 = 0x21;
/// A destination with this bit has data behind the header.
const DATA: u8 = 0x80;
const HEADER: usize = 6;
/// Time between two states that are said without being asked for, s.
const UPDATE_S: f64 = 0.1;
/// So many of them without a word that they are heard, and the unit falls silent.
const UNHEARD: u32 = 50;

struct Unit {
    address: u8,
    channel: Channel,
    /// Time since the last state that was not asked for; `None` where none are said.
    updates: Option<f64>,
    unheard: u32,
}

/// A controller.
pub struct ThorlabsFirmware {
    model: &'static str,
    serial: u32,
    motor: Motor,
    has_bays: bool,
    units: Vec<Unit>,
    /// Whether the ends of motions are told.
    tells_ends: bool,
    bytes: Vec<u8>,
    out: Vec<u8>,
}

impl ThorlabsFirmware {
    /// What has so many axes: a KDC101 has one, a BSC203 more.
    #[must_use]
    pub fn of(mut axes: Vec<DriveConfig>, plant: &Arc<dyn Plant>) -> Self {
        match axes.pop() {
            Some(only) if axes.is_empty() => Self::kdc101(only, plant),
            last => {
                axes.extend(last);
                Self::bsc203(axes, plant)
            }
        }
    }

    /// A KDC101: one brushed servo motor.
    #[must_use]
    pub fn kdc101(axis: DriveConfig, plant: &Arc<dyn Plant>) -> Self {
        Self::new(("KDC101", 27_250_417), Motor::Servo, vec![(USB_UNIT, axis)], plant)
    }

    /// A KST101: one stepper motor.
    #[must_use]
    pub fn kst101(axis: DriveConfig, plant: &Arc<dyn Plant>) -> Self {
        Self::new(("KST101", 26_004_871), Motor::Stepper, vec![(USB_UNIT, axis)], plant)
    }

    /// A BSC203: a stepper motor in each bay that an axis is named by.
    #[must_use]
    pub fn bsc203(axes: Vec<DriveConfig>, plant: &Arc<dyn Plant>) -> Self {
        let bay = |axis: &DriveConfig| FIRST_BAY + axis.name.parse::<u8>().unwrap_or(1).clamp(1, 3) - 1;
        let axes = axes.into_iter().map(|axis| (bay(&axis), axis)).collect();
        Self { has_bays: true, ..Self::new(("BSC203", 70_184_932), Motor::Stepper, axes, plant) }
    }

    /// Makes it say that it is another model.
    #[must_use]
    pub fn with_model(mut self, model: &'static str) -> Self {
        self.model = model;
        self
    }

    fn new(
        (model, serial): (&'static str, u32),
        motor: Motor,
        axes: Vec<(u8, DriveConfig)>,
        plant: &Arc<dyn Plant>,
    ) -> Self {
        let units = axes.into_iter().enumerate().map(|(index, (address, axis))| Unit {
            address,
            channel: Channel::new(axis, motor, index, plant),
            updates: None,
            unheard: 0,
        });
        Self {
            model,
            serial,
            motor,
            has_bays: false,
            units: units.collect(),
            tells_ends: true,
            bytes: Vec::new(),
            out: Vec::new(),
        }
    }

    /// What it is, in 84 bytes.
    fn info(&self) -> Vec<u8> {
        let mut data = self.serial.to_le_bytes().to_vec();
        let mut name = self.model.as_bytes().to_vec();
        name.resize(8, 0);
        data.extend(name);
        // A kind of hardware; firmware 2.1.9, the last number first.
        data.extend([if self.has_bays { 45 } else { 16 }, 0, 9, 1, 2, 0]);
        data.extend([0; 60]);
        data.extend([2, 0, 1, 0]);
        data.extend(if self.has_bays { 3u16 } else { 1 }.to_le_bytes());
        data
    }

    fn take(&mut self, number: u16, (first, second): (u8, u8), dest: u8, data: Option<&[u8]>) {
        tracing::debug!(number, first, second, dest, ?data, "a twin was told");
        let main = if self.has_bays { MAIN_BOARD } else { USB_UNIT };
        match number {
            0x0005 if dest == main || self.units.iter().any(|unit| unit.address == dest) => {
                let info = self.info();
                say_data(&mut self.out, 0x0006, dest, &info);
                return;
            }
            0x0060 if self.has_bays && dest == MAIN_BOARD => {
                let used = self.units.iter().any(|unit| unit.address == FIRST_BAY.saturating_add(first));
                say(&mut self.out, 0x0061, dest, first, if used { 1 } else { 2 });
                return;
            }
            0x046B => self.tells_ends = false,
            0x046C => self.tells_ends = true,
            _ => {}
        }
        let Some(unit) = self.units.iter_mut().find(|unit| unit.address == dest) else { return };
        match number {
            0x0011 => (unit.updates, unit.unheard) = (Some(0.0), 0),
            0x0012 => (unit.updates, unit.unheard) = (None, 0),
            0x0492 => unit.unheard = 0,
            _ => {}
        }
        if unit.unheard > UNHEARD {
            return;
        }
        match data {
            None if first == 1 => unit.short(number, second, self.motor, &mut self.out),
            Some(data) if data.get(..2) == Some(&[1, 0]) => unit.long(number, data),
            // There is one channel.
            _ => {}
        }
    }
}

impl Unit {
    /// A message to its channel without data.
    fn short(&mut self, number: u16, second: u8, motor: Motor, out: &mut Vec<u8>) {
        let (channel, source) = (&mut self.channel, self.address);
        let of_channel = |bytes: &[u8]| [&[1, 0], bytes].concat();
        match (number, motor) {
            (0x0210, _) => channel.enable(second == 1),
            (0x0211, _) => say(out, 0x0212, source, 1, if channel.is_enabled() { 1 } else { 2 }),
            (0x0411, _) => say_data(out, 0x0412, source, &of_channel(&channel.position().to_le_bytes())),
            (0x0429, _) => say_data(out, 0x042A, source, &of_channel(&channel.bits().to_le_bytes())),
            (0x0480, Motor::Stepper) => say_data(out, 0x0481, source, &channel.state()),
            (0x0490, Motor::Servo) => say_data(out, 0x0491, source, &channel.state()),
            (0x0443, _) => channel.home(),
            (0x0448, _) => channel.move_relative(None),
            (0x0453, _) => channel.move_absolute(None),
            (0x0457, _) => channel.run(second),
            (0x046A, _) => channel.jog(second),
            (0x0465, _) => {
                if let Some(told) = channel.stop(second == 1) {
                    self.tell(&told, out);
                }
            }
            _ => {
                if let Some(data) = channel.get(number) {
                    say_data(out, number + 1, source, data);
                }
            }
        }
    }

    /// A message to its channel with data.
    fn long(&mut self, number: u16, data: &[u8]) {
        let value = data.get(2..6).and_then(|bytes| bytes.try_into().ok()).map(i32::from_le_bytes);
        match (number, value, data.len()) {
            (0x0410, Some(position), 6) => self.channel.set_position(position),
            (0x0448, Some(distance), 6) => self.channel.move_relative(Some(distance)),
            (0x0453, Some(target), 6) => self.channel.move_absolute(Some(target)),
            _ => self.channel.set(number, data),
        }
    }

    /// Tells the end of a motion.
    fn tell(&self, told: &Told, out: &mut Vec<u8>) {
        match told {
            Told::Homed => say(out, 0x0444, self.address, 1, 0),
            Told::Completed => say_data(out, 0x0464, self.address, &self.channel.state()),
            Told::Stopped => say_data(out, 0x0466, self.address, &self.channel.state()),
        }
    }

    /// Lets time pass; says what came to an end, and how it is where that is wanted again and again.
    fn advance(&mut self, seconds: f64, motor: Motor, tells_ends: bool, out: &mut Vec<u8>) {
        if let Some(told) = self.channel.advance(seconds)
            && tells_ends
            && self.unheard <= UNHEARD
        {
            self.tell(&told, out);
        }
        let Some(since) = &mut self.updates else { return };
        *since += seconds;
        while *since >= UPDATE_S {
            *since -= UPDATE_S;
            if self.unheard <= UNHEARD {
                self.unheard += 1;
                let number = if motor == Motor::Servo { 0x0491 } else { 0x0481 };
                say_data(out, number, self.address, &self.channel.state());
            }
        }
    }
}

fn say(out: &mut Vec<u8>, number: u16, source: u8, first: u8, second: u8) {
    out.extend(number.to_le_bytes());
    out.extend([first, second, HOST, source]);
}

fn say_data(out: &mut Vec<u8>, number: u16, source: u8, data: &[u8]) {
    out.extend(number.to_le_bytes());
    out.extend((data.len() as u16).to_le_bytes());
    out.extend([HOST | DATA, source]);
    out.extend(data);
}

impl Firmware for ThorlabsFirmware {
    fn receive(&mut self, byte: u8) {
        self.bytes.push(byte);
        while let Some(&[a, b, first, second, dest, source]) = self.bytes.first_chunk::<HEADER>() {
            let address = dest & !DATA;
            let length = if dest & DATA == 0 { 0 } else { usize::from(u16::from_le_bytes([first, second])) };
            let known = matches!(address, USB_UNIT | MAIN_BOARD | FIRST_BAY..=0x2A);
            if source != HOST || !known || length > 255 {
                // Out of step: the message begins later.
                self.bytes.remove(0);
                continue;
            }
            if self.bytes.len() < HEADER + length {
                return;
            }
            let message: Vec<u8> = self.bytes.drain(..HEADER + length).collect();
            let data = (dest & DATA != 0).then(|| &message[HEADER..]);
            self.take(u16::from_le_bytes([a, b]), (first, second), address, data);
        }
    }

    /// What is unfinished after a pause is no message.
    fn pause(&mut self) {
        self.bytes.clear();
    }

    fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.out)
    }

    fn advance(&mut self, seconds: f64) {
        for unit in &mut self.units {
            unit.advance(seconds, self.motor, self.tells_ends, &mut self.out);
        }
    }

    fn is_moving(&self) -> bool {
        self.units.iter().any(|unit| unit.channel.drive.is_moving() || unit.updates.is_some())
    }

    fn stall(&mut self, axis: usize, stalled: bool) {
        if let Some(unit) = self.units.get_mut(axis) {
            unit.channel.drive.stalled = stalled;
        }
    }

    fn power_cycle(&mut self) {
        self.bytes.clear();
        self.tells_ends = true;
        for unit in &mut self.units {
            unit.channel.power_cycle();
            (unit.updates, unit.unheard) = (None, 0);
        }
    }
}
