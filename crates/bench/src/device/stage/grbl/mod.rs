//! Grbl 1.1's protocol and that of its heirs, bytes in and bytes out: commands, status reports, settings, messages.
//!
//! Sources: Grbl 1.1's interface and commands documents; grblHAL's and FluidNC's documentation and behaviour. Lengths are millimetres and rates millimetres a minute, as the
//! controller has them.

mod dialect;
mod lines;
mod settings;
mod status;
mod tree;
mod words;

pub use dialect::{Dialect, Version, banner, version};
pub use lines::Grbl;
pub use settings::{Settings, Votes, homes_single_axes, homes_to_zero, setting};
pub use status::{Mode, Status, status};
pub use tree::Tree;
pub use words::{Alarm, error_meaning};

/// Real-time byte: report the status.
pub const STATUS: u8 = b'?';
/// Real-time byte: feed hold.
pub const HOLD: u8 = b'!';
/// Real-time byte: end a jog, with the axis's deceleration, and drop what is queued of it.
pub const JOG_CANCEL: u8 = 0x85;
/// Real-time byte: soft reset.
pub const RESET: u8 = 0x18;
/// Asks for the settings.
pub const SETTINGS: &[u8] = b"$$\n";
/// Asks FluidNC for its configuration.
pub const DUMP: &[u8] = b"$CD\n";
/// Asks for version and build options.
pub const BUILD_INFO: &[u8] = b"$I\n";
/// Leaves the lock that the controller starts in.
pub const UNLOCK: &[u8] = b"$X\n";
/// Puts the controller to sleep: every motor is switched off.
pub const SLEEP: &[u8] = b"$SLP\n";

/// One of the controller's axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Letter {
    /// Axis 0.
    X,
    /// Axis 1.
    Y,
    /// Axis 2.
    Z,
}

impl Letter {
    /// All, in the controller's order.
    pub const ALL: [Self; 3] = [Self::X, Self::Y, Self::Z];

    /// The axis of a name in the configuration: `X`, `Y` or `Z`, in either case.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|letter| name.eq_ignore_ascii_case(letter.name()))
    }

    /// The letter.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::X => "X",
            Self::Y => "Y",
            Self::Z => "Z",
        }
    }

    /// The controller's number for it.
    #[must_use]
    pub const fn index(self) -> usize {
        match self {
            Self::X => 0,
            Self::Y => 1,
            Self::Z => 2,
        }
    }
}

/// A jog of one axis to a machine position (mm) at a feed rate (mm/min). A jog is checked against the soft limits
/// before it starts, and ends at once on [`JOG_CANCEL`].
#[must_use]
pub fn jog(axis: Letter, machine_mm: f64, feed_mm_per_min: f64) -> Vec<u8> {
    // Four decimals: finer than any motor step; more would lengthen the line and be cut by the controller's floats.
    format!("$J=G90 G21 G53 {}{machine_mm:.4} F{feed_mm_per_min:.2}\n", axis.name()).into_bytes()
}

/// A jog of one axis by a distance (mm) from where it stands.
#[must_use]
pub fn jog_by(axis: Letter, distance_mm: f64, feed_mm_per_min: f64) -> Vec<u8> {
    format!("$J=G91 G21 {}{distance_mm:.4} F{feed_mm_per_min:.2}\n", axis.name()).into_bytes()
}

/// Whether a line refuses a target beyond the soft limits.
#[must_use]
pub fn is_beyond_travel(line: &str) -> bool {
    line.trim() == "error:15"
}

/// Homing of every axis that the controller homes, or of one where it was built for that.
#[must_use]
pub fn home(axis: Option<Letter>) -> Vec<u8> {
    match axis {
        None => b"$H\n".to_vec(),
        Some(axis) => format!("$H{}\n", axis.name()).into_bytes(),
    }
}

/// A line without the real-time bytes that an echoing adapter sends back in front of it.
#[must_use]
pub fn without_echo(line: &str) -> &str {
    line.trim_start_matches(['?', '!', '~', '\u{18}', '\u{fffd}'])
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::device::port::Protocol as _;

    #[test]
    fn commands_are_written_as_grbl_reads_them() {
        assert_eq!(jog(Letter::Y, -1.25, 300.0), b"$J=G90 G21 G53 Y-1.2500 F300.00\n");
        assert_eq!(jog_by(Letter::X, -0.2, 60.0), b"$J=G91 G21 X-0.2000 F60.00\n");
        assert_eq!(home(None), b"$H\n");
        assert_eq!(home(Some(Letter::X)), b"$HX\n");
    }

    proptest! {
        #[test]
        fn no_bytes_break_the_readers(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            let line = String::from_utf8_lossy(&bytes).into_owned();
            let mut grbl = Grbl::default();
            for message in grbl.frame(&bytes) {
                let _ = (grbl.classify(&message, None), grbl.classify(&message, Some(DUMP)));
            }
            let _ = (status(&line), setting(&line), banner(&line), version(std::slice::from_ref(&line)));
            for dialect in [Dialect::Grbl, Dialect::GrblHal, Dialect::FluidNc] {
                let _ = (Alarm::from_line(&line, dialect), error_meaning(&line, dialect));
            }
            let _ = homes_single_axes(&[line]);
        }
    }
}
