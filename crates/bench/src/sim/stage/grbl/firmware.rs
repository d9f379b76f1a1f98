//! The firmware as its wire and its motors know it.

use super::{GrblFirmware, Heir, RECEIVE_BYTES, State, TICK};
use crate::sim::stage::Firmware;

impl Firmware for GrblFirmware {
    fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.out)
    }

    fn is_moving(&self) -> bool {
        self.motion.is_some() || self.homing.is_some() || self.message.is_some() || self.silent_s > 0.0
    }

    fn stall(&mut self, axis: usize, stalled: bool) {
        if let Some(slot) = self.stalled.get_mut(axis) {
            *slot = stalled;
        }
    }

    fn receive(&mut self, byte: u8) {
        if self.message.is_some() && self.fluid.is_none() {
            return;
        }
        if self.silent_s > 0.0 {
            self.unheard.push(byte);
            return;
        }
        match byte {
            0x18 if self.message.is_some() => self.reset_due = true,
            0x18 => self.reset(),
            // Deaf, it takes nothing else.
            b'?' if self.config.heir == Heir::GrblHal => self.report(),
            _ if self.deaf && self.fluid.is_none() => {}
            b'?' => self.report(),
            b'!' => self.hold(),
            b'~' => self.resume(),
            0x85 => {
                if self.state == State::Jog {
                    self.decelerate();
                }
            }
            0x84 => self.open_door(),
            // Overrides and the rest of the real-time bytes: taken out of the stream.
            0x80..=0xFF => {}
            b'\r' | b'\n' => {
                let line = std::mem::take(&mut self.line);
                self.waiting_bytes += 1;
                self.waiting.push_back(line);
                self.work();
            }
            _ => {
                if self.waiting_bytes + self.line.len() < RECEIVE_BYTES {
                    self.line.push(byte);
                }
            }
        }
    }

    fn advance(&mut self, seconds: f64) {
        if self.limits_trip() {
            self.alarm(1);
        }
        let mut left = seconds;
        while left > 0.0 && self.is_moving() {
            let dt = left.min(TICK);
            left -= dt;
            if self.message.is_some() {
                self.advance_message(dt);
            } else if self.silent_s > 0.0 {
                self.advance_silence(dt);
            } else if self.homing.is_some() {
                self.advance_homing(dt);
            } else {
                self.advance_motion(dt);
            }
        }
    }

    fn power_cycle(&mut self) {
        // The motors stay where they are; what the firmware knew of them is gone.
        self.origin = std::array::from_fn(|i| -self.steps[i]);
        self.envelope = [None; 3];
        self.state = State::Alarm;
        self.deaf = false;
        self.owed_ok = false;
        self.reports = 0;
        self.reset_due = false;
        self.clear();
        if self.fluid.is_some() {
            return self.fluid_power_up();
        }
        self.start();
    }
}
