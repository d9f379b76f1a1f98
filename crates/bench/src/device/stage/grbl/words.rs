//! Alarms and errors in words, by the firmware whose numbers they are.

use std::fmt;

use super::Dialect;

/// An alarm, by its number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Alarm {
    /// Its number.
    pub number: u8,
    /// Whose number that is.
    pub dialect: Dialect,
}

impl Alarm {
    /// Reads `ALARM:n`, as a firmware says it.
    #[must_use]
    pub fn from_line(line: &str, dialect: Dialect) -> Option<Self> {
        let number = line.strip_prefix("ALARM:")?.trim().parse().ok()?;
        Some(Self { number, dialect })
    }

    /// An alarm whose number could not be read.
    #[must_use]
    pub const fn unknown(dialect: Dialect) -> Self {
        Self { number: 0, dialect }
    }

    /// Whether it is the one of a limit switch.
    #[must_use]
    pub const fn is_hard_limit(self) -> bool {
        self.number == 1
    }

    /// Whether it says that homing could not pull off its switch.
    #[must_use]
    pub const fn is_pull_off(self) -> bool {
        self.number == 8
    }

    /// Whether it says no more than that the axes have not been homed since power-up: FluidNC starts with it.
    #[must_use]
    pub fn is_unhomed(self) -> bool {
        self.dialect == Dialect::FluidNc && self.number == 14
    }

    /// Whether the controller does nothing at all until it is reset.
    #[must_use]
    pub const fn needs_reset(self) -> bool {
        match self.dialect {
            Dialect::Grbl => matches!(self.number, 1 | 2),
            Dialect::GrblHal => matches!(self.number, 1 | 2 | 10 | 17 | 20),
            Dialect::FluidNc => matches!(self.number, 1 | 2 | 13 | 16),
        }
    }

    /// Whether the controller does not even report until then.
    #[must_use]
    pub const fn is_mute(self) -> bool {
        self.needs_reset() && !matches!(self.dialect, Dialect::FluidNc)
    }
}

impl fmt::Display for Alarm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let own = match self.dialect {
            Dialect::Grbl => grbl_alarm(self.number),
            Dialect::GrblHal => grblhal_alarm(self.number),
            Dialect::FluidNc => fluidnc_alarm(self.number),
        };
        let words = own.or_else(|| common_alarm(self.number)).unwrap_or("an alarm unknown to this driver; home it");
        write!(f, "ALARM:{}: {words}", self.number)
    }
}

/// What all of them mean by a number.
const fn common_alarm(number: u8) -> Option<&'static str> {
    Some(match number {
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
        _ => return None,
    })
}

const fn grbl_alarm(number: u8) -> Option<&'static str> {
    match number {
        10 => Some("homing found no second switch; check the switches and home again"),
        _ => None,
    }
}

const fn grblhal_alarm(number: u8) -> Option<&'static str> {
    Some(match number {
        10 => "its emergency stop is pressed; release it, stop (which resets the controller), then home",
        11 => "it takes no motion before it is homed; home it",
        12 => "a limit switch is pressed; have the axis leave it, then home",
        13 => "its probe's protection has tripped; clear the probe, then home",
        14 => "its spindle did not reach its speed; switch the spindle off in its settings, then home",
        15 => "homing found no second switch of an axis with two motors; check the switches and home again",
        16 => "its self-test at power-up has failed; look at its drivers and supply, then power it up anew",
        17 => {
            "a motor driver reports a fault; look at the motor and its supply, stop (which resets the controller), then home"
        }
        18 => "its settings for homing cannot be worked with ($22 to $27, $44 to $46); set them right, then home",
        19 => "a Modbus device of its own does not answer; see to it, or switch it off in the settings, then home",
        20 => "its input and output expander does not answer; see to it, stop (which resets the controller), then home",
        21 => "its settings memory has failed; look at every setting ($$) before anything moves",
        22 => "its receive buffer has overflowed; does another program command it? home it",
        _ => return None,
    })
}

const fn fluidnc_alarm(number: u8) -> Option<&'static str> {
    Some(match number {
        1 => "a limit switch was hit; stop (which resets the controller), then home",
        8 => "homing could not pull off the switch: it sticks, is the other end's, or pulloff_mm is too short; look",
        9 => {
            "homing found no switch within the travel; check switch, wiring, max_travel_mm and seek_scaler, home again"
        }
        10 => "its spindle has failed; take the spindle out of its configuration, then home",
        11 => "an input of its control section is active at its start (door, emergency stop); release it, then home",
        12 => {
            "a limit switch that both ends share (limit_all_pin) is pressed, and it cannot tell which end it is; have the \
             axis leave it, then home"
        }
        13 => "it was stopped hard by an input; release it, stop (which resets the controller), then home",
        14 => "it has not been homed since its start; home it",
        15 => "it has just started; home it",
        16 => "an expander of its pins has restarted; take its power away and give it back, then home",
        17 => "a line of G-code was wrong; does another program command it? home it",
        18 => "its probe has met a hard limit; clear it, then home",
        _ => return None,
    })
}

/// What an `error:n` line means, as a firmware says it.
#[must_use]
pub fn error_meaning(line: &str, dialect: Dialect) -> &'static str {
    let number = line.strip_prefix("error:").and_then(|number| number.trim().parse::<u8>().ok());
    let own = match dialect {
        Dialect::Grbl => number.and_then(grbl_error),
        Dialect::GrblHal => number.and_then(grblhal_error),
        Dialect::FluidNc => number.and_then(fluidnc_error),
    };
    let elsewhere = match dialect {
        Dialect::Grbl => "see Grbl's table of errors",
        Dialect::GrblHal => "see grblHAL's table of errors ($EE lists them)",
        Dialect::FluidNc => "see FluidNC's table of errors ($E lists them)",
    };
    own.or_else(|| number.and_then(common_error)).unwrap_or(elsewhere)
}

/// What all of them mean by a number.
const fn common_error(number: u8) -> Option<&'static str> {
    Some(match number {
        1 => "a word without its letter",
        2 => "a number is missing or malformed",
        3 => "the command is not known to it",
        4 => "a negative value where a positive one is needed",
        6 => "the step pulse is too short",
        7 => "its settings memory could not be read and was reset",
        8 => "it is not idle",
        9 => "it is locked by an alarm; home it",
        11 => "the line is too long",
        12 => "the setting asks for more steps a second than it can make",
        13 => "the safety door is open",
        14 => "the text is too long for its memory",
        15 => "the target is beyond its travel",
        16 => "the jog command is malformed",
        20 => "a G-code word is not supported",
        22 => "no feed rate was given",
        33 => "the motion's target is invalid",
        _ => return None,
    })
}

const fn grbl_error(number: u8) -> Option<&'static str> {
    Some(match number {
        5 => "homing is not enabled in its settings ($22)",
        10 => "soft limits ($20) need homing ($22)",
        17 => "laser mode needs a variable spindle",
        _ => return None,
    })
}

const fn grblhal_error(number: u8) -> Option<&'static str> {
    Some(match number {
        18 => "it was reset",
        19 => "a value has to be greater than zero",
        39 => "a value is out of its range",
        40 => "it waits for a change of tool",
        45 => "a limit switch is pressed; have the axis leave it",
        46 => "it has to be homed first",
        49 => "its self-test at power-up has failed",
        50 => "its emergency stop is pressed; release it, then stop, which resets it",
        51 => "a motor driver reports a fault",
        52 => "a setting's value is out of its range",
        53 => "the setting's function is switched off",
        55 => "its settings for homing cannot be worked with",
        77 | 78 => "it wants a password for this",
        79 => "it takes nothing after a critical alarm; stop, which resets it, then home",
        _ => return grbl_error(number),
    })
}

const fn fluidnc_error(number: u8) -> Option<&'static str> {
    Some(match number {
        5 => "no axis of its configuration can be homed (the section homing)",
        10 => "the target is beyond its soft limits",
        18 => "no axis of its configuration has a homing cycle",
        19 => "its configuration does not let this axis be homed by itself (allow_single_axis)",
        40 => "an input of its control section is active; release it",
        80 => "a number is out of its range",
        81 => "a value is not valid",
        110 => "it wants a password for this",
        120 => "another of its interfaces is busy",
        130 => "the jog was cancelled",
        150 => "a pin of its configuration is not valid",
        152 => "its configuration is not valid: $SS lists what is wrong with it",
        162 => "it cannot be changed while it runs",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Dialect; 3] = [Dialect::Grbl, Dialect::GrblHal, Dialect::FluidNc];

    fn alarm(number: u8, dialect: Dialect) -> Alarm {
        Alarm { number, dialect }
    }

    #[test]
    fn a_number_means_what_its_firmware_means_by_it() {
        let words = |number| ALL.map(|dialect| alarm(number, dialect).to_string());
        for (number, contains) in [
            (1, ["limit switch", "limit switch", "limit switch"]),
            (8, ["$27", "$27", "pulloff_mm"]),
            (9, ["$130", "$130", "max_travel_mm"]),
            (10, ["second switch", "emergency stop", "spindle"]),
            (11, ["unknown", "homed", "control section"]),
            (12, ["unknown", "pressed", "limit_all_pin"]),
            (14, ["unknown", "spindle", "not been homed"]),
            (17, ["unknown", "motor driver", "G-code"]),
            (20, ["unknown", "expander", "unknown"]),
            (99, ["unknown", "unknown", "unknown"]),
        ] {
            for (words, contains) in words(number).iter().zip(contains) {
                assert!(words.starts_with(&format!("ALARM:{number}: ")) && words.contains(contains), "{words}");
            }
        }
    }

    #[test]
    fn each_firmware_has_its_own_alarms_that_only_a_reset_leaves() {
        let needing = |dialect| (0..=u8::MAX).filter(|&n| alarm(n, dialect).needs_reset()).collect::<Vec<_>>();
        assert_eq!(ALL.map(needing), [vec![1, 2], vec![1, 2, 10, 17, 20], vec![1, 2, 13, 16]]);
        // FluidNC reports all the same.
        assert!(!alarm(1, Dialect::FluidNc).is_mute() && alarm(1, Dialect::Grbl).is_mute());
        assert!(alarm(14, Dialect::FluidNc).is_unhomed() && !alarm(14, Dialect::GrblHal).is_unhomed());
    }

    #[test]
    fn errors_are_told_in_the_words_of_their_firmware() {
        let words = |line| ALL.map(|dialect| error_meaning(line, dialect));
        assert_eq!(words("error:15"), ["the target is beyond its travel"; 3]);
        for (line, contains) in [
            ("error:5", ["$22", "$22", "section homing"]),
            ("error:10", ["$20", "$20", "beyond"]),
            ("error:18", ["table", "reset", "homing cycle"]),
            ("error:45", ["Grbl's table", "limit switch", "$E lists"]),
            ("error:50", ["Grbl's table", "emergency stop", "FluidNC's table"]),
            ("error:152", ["Grbl's table", "grblHAL's table", "$SS"]),
            ("error:x", ["Grbl's table", "grblHAL's table", "FluidNC's table"]),
        ] {
            for (words, contains) in words(line).iter().zip(contains) {
                assert!(words.contains(contains), "{line}: {words}");
            }
        }
    }
}
