//! Alarms and errors in words.

use std::fmt;

/// An alarm, by its number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Alarm(pub u8);

impl Alarm {
    /// Reads `ALARM:n`.
    #[must_use]
    pub fn from_line(line: &str) -> Option<Self> {
        line.strip_prefix("ALARM:")?.trim().parse().ok().map(Self)
    }

    /// Whether the controller answers nothing at all until it is reset.
    #[must_use]
    pub const fn needs_reset(self) -> bool {
        matches!(self.0, 1 | 2)
    }
}

impl fmt::Display for Alarm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = match self.0 {
            1 => "a limit switch was hit or let go; stop (which resets the controller), then home",
            2 => "the target was beyond the controller's soft limits; stop (which resets the controller), then home",
            3 => "it was reset while moving and its position is lost; home it",
            4 | 5 => "a probe cycle failed; home it",
            6 => "it was reset while homing; home it again",
            7 => "the safety door was opened while homing; close it and home again",
            8 => {
                "homing could not pull off the switch: it sticks, is the other end's, or the pull-off ($27) is too short; look"
            }
            9 => "homing found no switch within the travel; check switch, wiring and travel ($130 to $132), home again",
            10 => "homing found no second switch; check the switches and home again",
            _ => "an alarm unknown to this driver; home it",
        };
        write!(f, "ALARM:{}: {words}", self.0)
    }
}

/// What an `error:n` line means.
#[must_use]
pub fn error_meaning(line: &str) -> &'static str {
    match line.strip_prefix("error:").and_then(|number| number.trim().parse::<u8>().ok()) {
        Some(1) => "a word without its letter",
        Some(2) => "a number is missing or malformed",
        Some(3) => "the command is not known to it",
        Some(4) => "a negative value where a positive one is needed",
        Some(5) => "homing is not enabled in its settings ($22)",
        Some(6) => "the step pulse is too short",
        Some(7) => "its settings memory could not be read and was reset",
        Some(8) => "it is not idle",
        Some(9) => "it is locked by an alarm; home it",
        Some(10) => "soft limits ($20) need homing ($22)",
        Some(11) => "the line is too long",
        Some(12) => "the setting asks for more steps a second than it can make",
        Some(13) => "the safety door is open",
        Some(14) => "the text is too long for its memory",
        Some(15) => "the target is beyond its travel",
        Some(16) => "the jog command is malformed",
        Some(17) => "laser mode needs a variable spindle",
        Some(20) => "a G-code word is not supported",
        Some(22) => "no feed rate was given",
        Some(33) => "the motion's target is invalid",
        _ => "see Grbl's table of errors",
    }
}
