//! A Trinamic module's firmware, TMCL in direct mode, as a TMCM-6214 has it.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::Firmware;
use super::drive::{Drive, DriveConfig, Event};
use crate::device::stage::tmcl::{FRAME, Frame, OK, Reply, Request, SEARCH_RIGHT, command, is_whole, parameter};
use crate::sim::plant::Plant;

/// Address of the module, and of the host that it answers.
const MODULE: u8 = 1;
const HOST: u8 = 2;
/// Model, and version 1.07.
const VERSION: i32 = (6214 << 16) | (1 << 8) | 7;

const DAMAGED: u8 = 1;
const UNKNOWN_COMMAND: u8 = 2;
const WRONG_TYPE: u8 = 3;
const INVALID_VALUE: u8 = 4;

struct Axis {
    drive: Drive,
    target: i32,
    reached: bool,
    parameters: BTreeMap<u8, i32>,
}

impl Axis {
    fn units(&self) -> f64 {
        self.drive.config.units_per_mm
    }

    fn position(&self) -> i32 {
        (self.drive.position() * self.units()).round() as i32
    }
}

/// A module with a motor for every drive, numbered from 0.
pub struct TmclFirmware {
    axes: Vec<Axis>,
    globals: BTreeMap<(u8, u8), i32>,
    bytes: Vec<u8>,
    out: Vec<u8>,
}

/// The parameters that are only numbers, as they are at power-up.
fn parameters(config: &DriveConfig) -> BTreeMap<u8, i32> {
    let pps = |mm: f64| (mm * config.units_per_mm).round() as i32;
    BTreeMap::from([
        (parameter::SPEED, pps(config.speed_mm_per_s)),
        (parameter::ACCELERATION, pps(config.acceleration_mm_per_s2)),
        (6, 128),
        (parameter::STANDBY_CURRENT, 8),
        (parameter::RIGHT_DISABLED, 0),
        (parameter::LEFT_DISABLED, 0),
        (140, 8),
        (parameter::SEARCH_MODE, 1),
        (194, pps(config.speed_mm_per_s)),
        (195, pps(config.speed_mm_per_s) / 4),
        (parameter::REVERSE_SHAFT, i32::from(config.motor_inverted)),
        (parameter::UNIT_MODE, 1),
    ])
}

impl TmclFirmware {
    /// A module just powered up.
    #[must_use]
    pub fn new(axes: Vec<DriveConfig>, plant: &Arc<dyn Plant>) -> Self {
        let axes = axes.into_iter().enumerate().map(|(index, config)| Axis {
            parameters: parameters(&config),
            drive: Drive::new(config, index, Arc::clone(plant)),
            target: 0,
            reached: true,
        });
        Self { axes: axes.collect(), globals: BTreeMap::new(), bytes: Vec::new(), out: Vec::new() }
    }

    fn take(&mut self, frame: &Frame) {
        let request = Request::read(frame);
        tracing::debug!(?request, "a twin was told");
        if !is_whole(frame) {
            self.reply(request.command, DAMAGED, 0);
            return;
        }
        if request.address != MODULE {
            return;
        }
        if request.command == command::VERSION && request.kind == 0 {
            // The one answer that is text.
            self.out.push(HOST);
            self.out.extend_from_slice(b"6214V107");
            return;
        }
        match self.execute(request) {
            Ok(value) => self.reply(request.command, OK, value),
            Err(status) => self.reply(request.command, status, 0),
        }
    }

    fn reply(&mut self, command: u8, status: u8, value: i32) {
        self.out.extend(Reply { host: HOST, address: MODULE, status, command, value }.frame());
    }

    fn execute(&mut self, request: Request) -> Result<i32, u8> {
        let Request { command, kind, motor, value, .. } = request;
        match command {
            command::VERSION if kind == 1 => return Ok(VERSION),
            command::SGP | command::GGP => {
                let slot = self.globals.entry((motor, kind)).or_insert(0);
                if command == command::SGP {
                    *slot = value;
                }
                return Ok(*slot);
            }
            _ => {}
        }
        let axis = self.axes.get_mut(usize::from(motor)).ok_or(INVALID_VALUE)?;
        let units = axis.units();
        match (command, kind) {
            (command::MST, _) => axis.drive.stop(),
            // Rotate right, rotate left.
            (1, _) => axis.drive.run(f64::from(value) / units),
            (2, _) => axis.drive.run(-f64::from(value) / units),
            (command::MVP, 0 | 1) => {
                axis.target = if kind == 0 { value } else { axis.position().saturating_add(value) };
                axis.reached = false;
                axis.drive.speed = f64::from(axis.parameters[&parameter::SPEED]) / units;
                axis.drive.acceleration = f64::from(axis.parameters[&parameter::ACCELERATION]) / units;
                axis.drive.move_to(f64::from(axis.target) / units);
                return Ok(axis.target);
            }
            (command::MVP, _) => return Err(WRONG_TYPE),
            (command::RFS, 0) => {
                let mode = axis.parameters[&parameter::SEARCH_MODE];
                axis.drive.homing_speed = f64::from(axis.parameters[&194]) / units;
                axis.drive.home_towards(mode & SEARCH_RIGHT == 0);
            }
            (command::RFS, 1) => {
                if axis.drive.is_homing() {
                    axis.drive.stop();
                }
            }
            (command::RFS, 2) => return Ok(i32::from(axis.drive.is_homing())),
            (command::RFS, _) => return Err(WRONG_TYPE),
            (command::GAP, number) => return axis.get(number).ok_or(WRONG_TYPE),
            (command::SAP, number) => axis.set(number, value)?,
            _ => return Err(UNKNOWN_COMMAND),
        }
        Ok(value)
    }
}

impl Axis {
    fn get(&self, number: u8) -> Option<i32> {
        let velocity = (self.drive.velocity() * self.units()).round() as i32;
        // Below one step a second it still moves.
        let velocity = if velocity == 0 && self.drive.is_moving() { 1 } else { velocity };
        let positive = self.drive.positive_limit;
        Some(match number {
            0 => self.target,
            parameter::POSITION => self.position(),
            2 | parameter::ACTUAL_SPEED => velocity,
            8 => i32::from(self.reached),
            9 => i32::from(self.drive.home_switch_closed()),
            parameter::RIGHT_SWITCH => i32::from(self.drive.at_limit() && positive),
            parameter::LEFT_SWITCH => i32::from(self.drive.at_limit() && !positive),
            _ => *self.parameters.get(&number)?,
        })
    }

    fn set(&mut self, number: u8, value: i32) -> Result<(), u8> {
        match number {
            parameter::POSITION => self.drive.set_position(f64::from(value) / self.units()),
            0 => {
                self.target = value;
                self.reached = false;
                self.drive.move_to(f64::from(value) / self.units());
            }
            2 => self.drive.run(f64::from(value) / self.units()),
            parameter::SPEED | parameter::ACCELERATION if value <= 0 => return Err(INVALID_VALUE),
            _ => {
                *self.parameters.get_mut(&number).ok_or(WRONG_TYPE)? = value;
                if number == parameter::REVERSE_SHAFT {
                    self.drive.inverted = value != 0;
                }
            }
        }
        Ok(())
    }
}

impl Firmware for TmclFirmware {
    fn receive(&mut self, byte: u8) {
        self.bytes.push(byte);
        if self.bytes.len() == FRAME {
            let mut frame = [0u8; FRAME];
            frame.copy_from_slice(&self.bytes);
            self.bytes.clear();
            self.take(&frame);
        }
    }

    /// What is unfinished after a pause is no command.
    fn pause(&mut self) {
        self.bytes.clear();
    }

    fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.out)
    }

    fn advance(&mut self, seconds: f64) {
        for axis in &mut self.axes {
            match axis.drive.advance(seconds) {
                Some(Event::Homed) => {
                    axis.drive.set_position(0.0);
                    (axis.target, axis.reached) = (0, true);
                }
                Some(Event::Arrived) => axis.reached = true,
                // A module searches on for ever, also against the end of the slide.
                Some(Event::HomingFailed) => {
                    axis.drive.home_towards(axis.parameters[&parameter::SEARCH_MODE] & SEARCH_RIGHT == 0);
                }
                Some(Event::Stopped | Event::Limit) | None => {}
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
        self.bytes.clear();
        self.globals.clear();
        for axis in &mut self.axes {
            axis.drive.power_cycle();
            axis.parameters = parameters(&axis.drive.config);
            (axis.target, axis.reached) = (0, true);
        }
    }
}
