//! What goes wrong with a device.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::AxisName;

/// What went wrong with a device, by what its user can do next.
#[derive(Debug, Clone, PartialEq, thiserror::Error, Serialize, Deserialize)]
pub enum DeviceError {
    /// The device is not there, or went away: wait for its return, or connect it.
    #[error("{device} is not connected: {reason}")]
    Disconnected {
        /// Which device.
        device: String,
        /// What was seen.
        reason: String,
    },
    /// The port or device file is held by another program.
    #[error("{device} is in use by another program: {reason}")]
    Busy {
        /// Which device.
        device: String,
        /// What was seen.
        reason: String,
    },
    /// Another device answers than the one configured.
    #[error("{device} is not what is configured: expected {expected}, found {found}")]
    WrongDevice {
        /// Which device.
        device: String,
        /// What the configuration says.
        expected: String,
        /// What answered.
        found: String,
    },
    /// No answer, or no end of a motion, within the time allowed.
    #[error("{device} did not {what} within {allowed:?}")]
    Timeout {
        /// Which device.
        device: String,
        /// What was waited for.
        what: String,
        /// How long.
        allowed: Duration,
    },
    /// An answer that makes no sense.
    #[error("{device} sent an answer that cannot be understood: {detail}")]
    Protocol {
        /// Which device.
        device: String,
        /// What was sent.
        detail: String,
    },
    /// A healthy device refuses: its own words are given.
    #[error("{device} refuses: {reason}")]
    Refused {
        /// Which device.
        device: String,
        /// Its reason.
        reason: String,
    },
    /// The device is in an alarm that has to be cleared (homing, as a rule).
    #[error("{device} is in alarm: {reason}")]
    Alarm {
        /// Which device.
        device: String,
        /// Which alarm, and how to leave it.
        reason: String,
    },
    /// The axis's position is unknown: home it first.
    #[error("the {axis} axis is not homed; home it first")]
    NotHomed {
        /// Which axis.
        axis: AxisName,
    },
    /// A stop ended the motion.
    #[error("the {axis} axis was stopped")]
    Stopped {
        /// Which axis.
        axis: AxisName,
    },
}
