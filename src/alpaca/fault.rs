//! Errors of a device, by the specification's numbers.

use crate::control::{Refusal, ServiceError};
use crate::device::DeviceError;

/// A member that this device does not have.
const NOT_IMPLEMENTED: i32 = 0x400;
/// A value that is out of range.
const INVALID_VALUE: i32 = 0x401;
/// A value that is not known yet.
const VALUE_NOT_SET: i32 = 0x402;
/// The client is not connected to the device.
const NOT_CONNECTED: i32 = 0x407;
/// Not possible in the state that the device is in.
const INVALID_OPERATION: i32 = 0x40B;
/// An action that this device does not have.
const ACTION_NOT_IMPLEMENTED: i32 = 0x40C;
/// What was under way was ended by somebody.
const CANCELLED: i32 = 0x40E;
/// A controller or the camera failed. From here on numbers are the driver's own.
const DEVICE: i32 = 0x500;
/// The history cannot be written, without which nothing moves.
const HISTORY: i32 = 0x501;

/// Why a device did not do what it was asked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Fault {
    pub(super) number: i32,
    pub(super) message: String,
}

/// Why a request got no value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Refused {
    /// It cannot be read.
    Malformed(String),
    /// The device's word.
    Fault(Fault),
}

impl From<Fault> for Refused {
    fn from(fault: Fault) -> Self {
        Self::Fault(fault)
    }
}

impl From<ServiceError> for Refused {
    fn from(error: ServiceError) -> Self {
        Self::Fault(error.into())
    }
}

impl Fault {
    fn new(number: i32, message: impl Into<String>) -> Self {
        Self { number, message: message.into() }
    }

    pub(super) fn not_implemented(member: &str, why: &str) -> Self {
        Self::new(NOT_IMPLEMENTED, format!("{member} is not implemented: {why}"))
    }

    pub(super) fn no_such_action(name: &str, there_are: &[&str]) -> Self {
        let there_are = if there_are.is_empty() { "none".to_owned() } else { there_are.join(", ") };
        Self::new(ACTION_NOT_IMPLEMENTED, format!("there is no action {name:?}; there are: {there_are}"))
    }

    pub(super) fn invalid_value(message: impl Into<String>) -> Self {
        Self::new(INVALID_VALUE, message)
    }

    pub(super) fn not_set(message: impl Into<String>) -> Self {
        Self::new(VALUE_NOT_SET, message)
    }

    pub(super) fn not_connected(message: impl Into<String>) -> Self {
        Self::new(NOT_CONNECTED, message)
    }

    pub(super) fn invalid_operation(message: impl Into<String>) -> Self {
        Self::new(INVALID_OPERATION, message)
    }

    pub(super) fn cancelled(message: impl Into<String>) -> Self {
        Self::new(CANCELLED, message)
    }

    pub(super) fn device(message: impl Into<String>) -> Self {
        Self::new(DEVICE, message)
    }
}

impl From<Refusal> for Fault {
    fn from(refusal: Refusal) -> Self {
        let message = refusal.to_string();
        let number = match refusal {
            Refusal::Limit { .. } | Refusal::Wall { .. } | Refusal::Step { .. } | Refusal::Speed { .. } => {
                INVALID_VALUE
            }
            Refusal::LeaseRequired | Refusal::LeaseLost { .. } => NOT_CONNECTED,
            Refusal::NoHistory { .. } => HISTORY,
            Refusal::Stopped => {
                let where_ = "on the page of this bench, or by DELETE /api/v1/stop";
                return Self::new(INVALID_OPERATION, format!("{message} ({where_})"));
            }
            _ => INVALID_OPERATION,
        };
        Self::new(number, message)
    }
}

impl From<DeviceError> for Fault {
    fn from(error: DeviceError) -> Self {
        match error {
            DeviceError::NotHomed { .. } => Self::invalid_operation(error.to_string()),
            DeviceError::Stopped { .. } => Self::cancelled(error.to_string()),
            error => Self::device(error.to_string()),
        }
    }
}

impl From<ServiceError> for Fault {
    fn from(error: ServiceError) -> Self {
        match error {
            ServiceError::Refused(refusal) => refusal.into(),
            ServiceError::Device(error) => error.into(),
            ServiceError::Invalid { .. } => Self::invalid_value(error.to_string()),
            ServiceError::NoSuchJob { .. } => Self::invalid_operation(error.to_string()),
            ServiceError::Unreadable { .. } => Self::new(HISTORY, error.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::AxisName;
    use crate::units::Millimetres;

    #[test]
    fn refusals_have_the_specifications_numbers_and_their_own_words() {
        let wall = Refusal::Wall { target: Millimetres(-0.2), wall: Millimetres(-0.1), untold: false };
        let held = Refusal::LeaseHeld { owner: "ada".to_owned(), note: None, job: None };
        let gone = DeviceError::Disconnected { device: "the e stage".to_owned(), reason: "unplugged".to_owned() };
        let cases: [(Fault, i32, &str); 7] = [
            (wall.into(), 1025, "the lens could touch the shell"),
            (held.into(), 1035, "ada has the control lease"),
            (Refusal::Stopped.into(), 1035, "the stop is latched; reset it first"),
            (Refusal::LeaseRequired.into(), 1031, "take it first"),
            (gone.into(), 1280, "unplugged"),
            (Refusal::NoHistory { why: "the disk is full".to_owned() }.into(), 1281, "the disk is full"),
            (DeviceError::Stopped { axis: AxisName::E }.into(), 1038, "the e axis was stopped"),
        ];
        for (fault, number, words) in cases {
            assert_eq!(fault.number, number, "{fault:?}");
            assert!(fault.message.contains(words), "{fault:?}");
        }
    }
}
