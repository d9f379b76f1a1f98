//! Status bits: what a controller says of a motor.

/// The status bits of a motor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bits(pub u32);

/// A limit switch closed. Which bit is which end's, document and clients do not agree on.
const SWITCHES: u32 = 0b11;
/// Stopped by its limit in numbers, either way.
const SOFT_LIMITS: u32 = 0b11 << 2;
/// Moves or jogs, either way.
const MOVING: u32 = 0b1111 << 4;
/// A motor is connected.
const CONNECTED: u32 = 1 << 8;
const HOMING: u32 = 1 << 9;
const HOMED: u32 = 1 << 10;
/// It is too far from where it should be.
const MOTION_ERROR: u32 = 1 << 14;
/// What counts its position is not to be believed.
const ENCODER_FAULT: u32 = 1 << 25;
const ENABLED: u32 = 1 << 31;

/// What may keep a motor from arriving.
const TROUBLES: &[(u32, &str)] = &[
    (MOTION_ERROR, "it fell too far behind (motion error)"),
    (1 << 17, "it is too hot"),
    (1 << 18, "its supply voltage is too low"),
    (1 << 24, "its motor current reached the limit"),
    (ENCODER_FAULT, "its encoder has a fault"),
    (1 << 26, "its motor current was too great"),
    (1 << 27, "its supply current is too great"),
    (SWITCHES, "a limit switch was hit"),
    (SOFT_LIMITS, "it came to the controller's own soft limit"),
];

impl Bits {
    /// Whether it moves, homing included.
    #[must_use]
    pub const fn moves(self) -> bool {
        self.0 & (MOVING | HOMING) != 0
    }

    /// Whether it has homed since it was switched on.
    #[must_use]
    pub const fn homed(self) -> bool {
        self.0 & HOMED != 0
    }

    /// Whether its position is one to be believed: homed, and neither turned by hand since nor counted wrongly.
    #[must_use]
    pub const fn knows_its_place(self) -> bool {
        self.homed() && self.enabled() && self.0 & ENCODER_FAULT == 0
    }

    /// Whether the motor is on.
    #[must_use]
    pub const fn enabled(self) -> bool {
        self.0 & ENABLED != 0
    }

    /// Whether it says that a motor is connected.
    #[must_use]
    pub const fn connected(self) -> bool {
        self.0 & CONNECTED != 0
    }

    /// Whether it stands at a limit, of either kind and either end.
    #[must_use]
    pub const fn at_limit(self) -> bool {
        self.0 & (SWITCHES | SOFT_LIMITS) != 0
    }

    /// What stays as it is from one moment to the next, as a rule.
    #[must_use]
    pub const fn steady(self) -> u32 {
        self.0 & (HOMED | ENABLED | ENCODER_FAULT)
    }

    /// Why the axis cannot move.
    #[must_use]
    pub fn fault(self) -> Option<String> {
        if self.0 & MOTION_ERROR != 0 {
            return Some("motion error: it fell too far behind; find out why, then home the axis".to_owned());
        }
        if self.0 & ENCODER_FAULT != 0 {
            return Some(
                "its encoder has a fault, and where it stands is not known; see to it, then home the axis".to_owned(),
            );
        }
        (!self.enabled()).then(|| "its motor is switched off; home the axis".to_owned())
    }

    /// Why a motion ended short of its target.
    #[must_use]
    pub fn trouble(self) -> Option<String> {
        let (_, words) = TROUBLES.iter().find(|(bits, _)| self.0 & bits != 0)?;
        Some(format!("{words}; find out why, then home the axis"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_mean_what_the_document_says() {
        let rest = Bits(0x8000_0400);
        assert!(rest.homed() && rest.enabled() && !rest.moves() && rest.fault().is_none() && rest.trouble().is_none());
        for moving in [0x10, 0x20, 0x40, 0x80, 0x200] {
            assert!(Bits(rest.0 | moving).moves(), "{moving:#x}");
        }
        assert!(Bits(0x8000_4400).fault().is_some_and(|words| words.contains("motion error")));
        assert!(Bits(0x8200_0400).fault().is_some_and(|words| words.contains("encoder")));
        assert!(rest.knows_its_place());
        for unknown in [0x8000_0000, 0x0000_0400, 0x8200_0400] {
            assert!(!Bits(unknown).knows_its_place(), "{unknown:#x}");
        }
        assert!(Bits(0x0000_0400).fault().is_some_and(|words| words.contains("switched off")));
        assert!(Bits(0x8000_0401).trouble().is_some_and(|words| words.contains("a limit switch")));
        assert!(Bits(0x8000_0408).trouble().is_some_and(|words| words.contains("soft limit")));
        assert!(Bits(0x8100_0400).trouble().is_some_and(|words| words.contains("current")));
        assert!(Bits(0x102).connected() && Bits(0x102).at_limit() && !Bits(0x100).at_limit());
    }
}
