//! The Fjell F2's firmware, as its manual has it.

use std::sync::Arc;

use plenalign::sim::plant::Plant;
use plenalign::sim::stage::Firmware;
use plenalign::sim::stage::drive::{Drive, DriveConfig, Event};

/// Longest line taken.
const LONGEST_LINE: usize = 80;

struct Axis {
    drive: Drive,
    on: bool,
    homed: bool,
    fault: u8,
}

/// A controller with a motor for every axis.
pub(super) struct FjellTwin {
    axes: Vec<Axis>,
    line: Vec<u8>,
    out: Vec<u8>,
}

impl FjellTwin {
    /// A controller just powered up: motors off, nothing homed.
    pub(super) fn new(axes: Vec<DriveConfig>, plant: &Arc<dyn Plant>) -> Self {
        let axes = axes.into_iter().enumerate().map(|(index, config)| Axis {
            drive: Drive::new(config, index, Arc::clone(plant)),
            on: false,
            homed: false,
            fault: 0,
        });
        Self { axes: axes.collect(), line: Vec::new(), out: Vec::new() }
    }

    /// What a line is answered with.
    fn answer(&mut self, line: &str) -> String {
        let mut words = line.split(' ');
        let word = words.next().unwrap_or_default();
        if word == "ID" {
            return "ID Fjell F2 1.04 00317".to_owned();
        }
        let numbers: Vec<f64> = words.map_while(|word| word.parse().ok()).collect();
        let axis = self.axes.iter_mut().find(|axis| word.strip_prefix(axis.drive.config.name.as_str()).is_some());
        let Some(axis) = axis else { return format!("{word} E1") };
        let units = axis.drive.config.units_per_mm;
        let in_units = |mm: f64| (mm * units).round();
        match (&word[1..], numbers.as_slice()) {
            ("?", []) => {
                let position = in_units(axis.drive.position());
                let [moving, homed] = [axis.drive.is_moving(), axis.homed].map(u8::from);
                format!("{word} {position:+09.0} {moving} {homed} {}", axis.fault)
            }
            ("L", []) => {
                let [low, high] = [axis.drive.config.low_mm, axis.drive.config.high_mm].map(in_units);
                format!("{word} {low:+09.0} {high:+09.0}")
            }
            ("P", [on]) => {
                (axis.on, axis.fault) = (*on != 0.0, 0);
                axis.drive.halt();
                axis.homed &= axis.on;
                format!("{word} OK")
            }
            ("H" | "G", _) if !axis.on || axis.fault != 0 => format!("{word} E4"),
            ("H", []) => {
                axis.homed = false;
                axis.drive.home();
                format!("{word} OK")
            }
            ("G", _) if !axis.homed => format!("{word} E2"),
            ("G", [to, speed]) => {
                let to = to / units;
                if !(axis.drive.config.low_mm - 1e-9..=axis.drive.config.high_mm + 1e-9).contains(&to) {
                    return format!("{word} E3");
                }
                axis.drive.speed = (speed / units).max(1e-3);
                axis.drive.move_to(to);
                format!("{word} OK")
            }
            _ => format!("{word} E1"),
        }
    }
}

impl Firmware for FjellTwin {
    fn receive(&mut self, byte: u8) {
        match byte {
            b'!' => self.axes.iter_mut().for_each(|axis| axis.drive.stop()),
            b'\r' => {
                let line = std::mem::take(&mut self.line);
                if !line.is_empty() {
                    let answer = self.answer(&String::from_utf8_lossy(&line));
                    self.out.extend_from_slice(answer.as_bytes());
                    self.out.push(b'\r');
                }
            }
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
                    axis.drive.set_position(0.0);
                    axis.homed = true;
                }
                Some(Event::Limit | Event::HomingFailed) => (axis.on, axis.homed, axis.fault) = (false, false, 1),
                Some(Event::Arrived | Event::Stopped) | None => {}
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
            (axis.on, axis.homed, axis.fault) = (false, false, 0);
        }
    }
}
