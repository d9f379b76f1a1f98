//! Trinamic's TMCL in direct mode, bytes in and bytes out: frames of nine bytes.
//!
//! Source: Trinamic's TMCL reference and firmware manuals. A command is `address, command, type, motor, value, checksum`,
//! an answer `host, address, status, command, value, checksum`: which parameter an answer is about it does not say.

use std::collections::VecDeque;

use crate::device::port::{Kind, Protocol, Recovery};

/// Bytes of a frame.
pub const FRAME: usize = 9;
/// Status of an answer to a command that was carried out.
pub const OK: u8 = 100;

/// Commands.
pub mod command {
    /// Stop a motor.
    pub const MST: u8 = 3;
    /// Move to a position; type 0 is absolute.
    pub const MVP: u8 = 4;
    /// Set an axis's parameter.
    pub const SAP: u8 = 5;
    /// Get an axis's parameter.
    pub const GAP: u8 = 6;
    /// Set a global parameter.
    pub const SGP: u8 = 9;
    /// Get a global parameter.
    pub const GGP: u8 = 10;
    /// Reference search: type 0 starts, 1 stops, 2 asks.
    pub const RFS: u8 = 13;
    /// Version of the firmware; type 1 for the binary form.
    pub const VERSION: u8 = 136;
}

/// Axis parameters.
pub mod parameter {
    /// Actual position, microsteps.
    pub const POSITION: u8 = 1;
    /// Actual speed, microsteps a second.
    pub const ACTUAL_SPEED: u8 = 3;
    /// Greatest speed of positioning, microsteps a second.
    pub const SPEED: u8 = 4;
    /// Acceleration, microsteps a second squared.
    pub const ACCELERATION: u8 = 5;
    /// Current at rest, 0 to 255.
    pub const STANDBY_CURRENT: u8 = 7;
    /// Whether the right limit switch is closed.
    pub const RIGHT_SWITCH: u8 = 10;
    /// Whether the left limit switch is closed.
    pub const LEFT_SWITCH: u8 = 11;
    /// Whether the right limit switch stops nothing.
    pub const RIGHT_DISABLED: u8 = 12;
    /// Whether the left limit switch stops nothing.
    pub const LEFT_DISABLED: u8 = 13;
    /// Whether speeds are microsteps a second (1) or numbers of the module's own (0), where it has the choice.
    pub const UNIT_MODE: u8 = 255;
    /// Whether the motor turns the other way round, where it can.
    pub const REVERSE_SHAFT: u8 = 251;
    /// How the reference is searched.
    pub const SEARCH_MODE: u8 = 193;
}

/// Adding this to a search mode searches to the right.
pub const SEARCH_RIGHT: i32 = 64;
/// Search mode: the left limit switch.
pub const SEARCH_LEFT_SWITCH: i32 = 1;
/// Bank of the global parameters that a program may use for itself.
pub const USER_BANK: u8 = 2;

/// Models whose speeds are numbers of their own instead of microsteps a second.
pub const INTERNAL_UNITS: &[u16] = &[1021, 1110, 1140, 1141, 1160, 1161, 1180, 1181, 3110, 6110];

/// Models whose axis parameters 12 and 13 switch the limit switches on and not off.
pub const STOPS_BY_ONE: &[u16] = &[1276, 1278];

/// A command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Request {
    /// Address of the module.
    pub address: u8,
    /// Command number.
    pub command: u8,
    /// Type number.
    pub kind: u8,
    /// Motor, or bank.
    pub motor: u8,
    /// Value.
    pub value: i32,
}

/// An answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reply {
    /// Address of the host.
    pub host: u8,
    /// Address of the module.
    pub address: u8,
    /// What became of the command.
    pub status: u8,
    /// Command number.
    pub command: u8,
    /// Value.
    pub value: i32,
}

/// A frame, whichever way it goes.
pub type Frame = [u8; FRAME];

fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0u8, |sum, &byte| sum.wrapping_add(byte))
}

fn frame(head: [u8; 4], value: i32) -> Frame {
    let mut bytes = [0u8; FRAME];
    bytes[..4].copy_from_slice(&head);
    bytes[4..8].copy_from_slice(&value.to_be_bytes());
    bytes[8] = checksum(&bytes[..8]);
    bytes
}

/// Whether a frame's checksum is right.
#[must_use]
pub fn is_whole(bytes: &Frame) -> bool {
    checksum(&bytes[..8]) == bytes[8]
}

fn value(bytes: &Frame) -> i32 {
    i32::from_be_bytes([bytes[4], bytes[5], bytes[6], bytes[7]])
}

impl Request {
    /// As bytes.
    #[must_use]
    pub fn frame(&self) -> Frame {
        frame([self.address, self.command, self.kind, self.motor], self.value)
    }

    /// Out of bytes whose checksum is right.
    #[must_use]
    pub fn read(bytes: &Frame) -> Self {
        Self { address: bytes[0], command: bytes[1], kind: bytes[2], motor: bytes[3], value: value(bytes) }
    }
}

impl Reply {
    /// As bytes.
    #[must_use]
    pub fn frame(&self) -> Frame {
        frame([self.host, self.address, self.status, self.command], self.value)
    }

    /// Out of bytes whose checksum is right.
    #[must_use]
    pub fn read(bytes: &Frame) -> Self {
        Self { host: bytes[0], address: bytes[1], status: bytes[2], command: bytes[3], value: value(bytes) }
    }
}

/// What the status of a refused command means.
#[must_use]
pub const fn status_meaning(status: u8) -> &'static str {
    match status {
        1 => "it got a damaged command",
        2 => "it does not know the command",
        3 => "it does not know the parameter",
        4 => "the value is out of range",
        5 => "its settings memory is locked",
        6 => "the command cannot be carried out now",
        _ => "see Trinamic's table of status codes",
    }
}

/// Cuts the stream into frames: a byte too many or too few costs the frame it is in.
#[derive(Debug, Default)]
pub struct Tmcl {
    bytes: VecDeque<u8>,
}

impl Protocol for Tmcl {
    type Message = Frame;
    const RECOVERY: Recovery = Recovery::Required;
    const URGENT_ANYWHERE: bool = false;

    fn frame(&mut self, bytes: &[u8]) -> Vec<Frame> {
        let mut frames = Vec::new();
        for &byte in bytes {
            self.bytes.push_back(byte);
            if self.bytes.len() < FRAME {
                continue;
            }
            let mut frame = [0u8; FRAME];
            for (slot, &byte) in frame.iter_mut().zip(&self.bytes) {
                *slot = byte;
            }
            if is_whole(&frame) {
                frames.push(frame);
                self.bytes.clear();
            } else {
                // Out of step: the frame begins later.
                self.bytes.pop_front();
            }
        }
        frames
    }

    /// Frames are written without pauses: what is unfinished after one lost its rest.
    fn gap(&mut self) {
        self.bytes.clear();
    }

    fn classify(&self, frame: &Frame, request: Option<&[u8]>) -> Kind {
        let Some(request) = request else { return Kind::Noise };
        if frame.as_slice() == request {
            // An echo.
            return Kind::Notice;
        }
        let reply = Reply::read(frame);
        match request {
            [address, command, ..] if reply.address == *address && reply.command == *command => {
                if reply.status == OK {
                    Kind::Last
                } else {
                    Kind::Refused
                }
            }
            _ => Kind::Noise,
        }
    }

    fn text(&self, frame: &Frame) -> String {
        Reply::read(frame).status.to_string()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const ASKED: Request = Request { address: 1, command: command::GAP, kind: 1, motor: 0, value: 0 };
    const TOLD: Reply = Reply { host: 2, address: 1, status: OK, command: command::GAP, value: 711 };

    #[test]
    fn frames_are_the_manuals() {
        // TMCM-1141's firmware manual, "GAP 0, 1": position 711.
        assert_eq!(ASKED.frame(), [1, 6, 1, 0, 0, 0, 0, 0, 8]);
        assert_eq!(TOLD.frame()[..8], [2, 1, 0x64, 6, 0, 0, 2, 0xC7]);
        assert_eq!(Reply::read(&TOLD.frame()), TOLD);
        let back = Request { value: -711, ..ASKED };
        assert_eq!(Request::read(&back.frame()), back);
        assert!(is_whole(&back.frame()));
    }

    #[test]
    fn an_answer_is_told_from_an_echo_and_from_others() {
        let (tmcl, asked) = (Tmcl::default(), ASKED.frame());
        assert_eq!(tmcl.classify(&TOLD.frame(), Some(&asked)), Kind::Last);
        assert_eq!(tmcl.classify(&Reply { status: 4, ..TOLD }.frame(), Some(&asked)), Kind::Refused);
        assert_eq!(tmcl.classify(&asked, Some(&asked)), Kind::Notice, "an echo");
        let stop = Reply { command: command::MST, ..TOLD }.frame();
        assert_eq!(tmcl.classify(&stop, Some(&asked)), Kind::Noise, "a stop's");
        assert_eq!(tmcl.classify(&Reply { address: 3, ..TOLD }.frame(), Some(&asked)), Kind::Noise);
    }

    proptest! {
        #[test]
        fn noise_costs_the_frame_it_is_in_and_a_pause_ends_it(
            noise in proptest::collection::vec(any::<u8>(), 0..500), cut in 1usize..20,
        ) {
            let mut tmcl = Tmcl::default();
            for piece in noise.chunks(cut) {
                let _ = tmcl.frame(piece);
                prop_assert!(tmcl.bytes.len() < FRAME);
            }
            tmcl.gap();
            prop_assert_eq!(tmcl.frame(&TOLD.frame()), vec![TOLD.frame()]);
        }

        #[test]
        fn a_lost_byte_costs_its_frame_even_without_a_pause(at in 0usize..9) {
            let mut tmcl = Tmcl::default();
            let mut bytes = TOLD.frame().to_vec();
            bytes.remove(at);
            for _ in 0..4 {
                bytes.extend(TOLD.frame());
            }
            let frames = tmcl.frame(&bytes);
            prop_assert!(frames.iter().filter(|frame| **frame == TOLD.frame()).count() >= 3, "{frames:?}");
        }
    }
}
