//! Status reports.

use super::{Letter, without_echo};

/// What the controller is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// At rest.
    Idle,
    /// Executing G-code.
    Run,
    /// Feed hold, complete or (`false`) decelerating still.
    Hold(bool),
    /// Jogging.
    Jog,
    /// Locked.
    Alarm,
    /// Safety door.
    Door,
    /// Checking G-code without motion.
    Check,
    /// Homing.
    Home,
    /// Asleep.
    Sleep,
}

impl Mode {
    /// Whether the axes stand still.
    #[must_use]
    pub const fn at_rest(self) -> bool {
        matches!(self, Self::Idle | Self::Hold(true) | Self::Alarm | Self::Check | Self::Sleep)
    }
}

/// A status report.
#[derive(Debug, Clone, PartialEq)]
pub struct Status {
    /// What the controller is doing.
    pub mode: Mode,
    /// Machine position, mm, where the report has it.
    pub machine: Option<[f64; 3]>,
    /// Work position, mm, where the report has it instead.
    pub work: Option<[f64; 3]>,
    /// Offset of work from machine coordinates, mm, where the report has it: machine = work + offset.
    pub work_offset: Option<[f64; 3]>,
    /// Whether each axis's limit pin is pressed.
    pub limits: [bool; 3],
    /// Whether the feed-hold input is pressed.
    pub hold_pressed: bool,
    /// Whether a pendant has the controller, where the report has it (grblHAL: as that changes).
    pub pendant: Option<bool>,
}

/// Reads a status report, `<Idle|MPos:0.000,0.000,0.000|FS:0,0>`; `None` for anything else or anything damaged.
#[must_use]
pub fn status(line: &str) -> Option<Status> {
    let body = without_echo(line).strip_prefix('<')?.strip_suffix('>')?;
    let mut fields = body.split('|');
    let mode = mode(fields.next()?)?;
    let mut status = Status {
        mode,
        machine: None,
        work: None,
        work_offset: None,
        limits: [false; 3],
        hold_pressed: false,
        pendant: None,
    };
    // FluidNC leaves a field empty where a file is about to be run.
    for field in fields.filter(|field| !field.is_empty()) {
        let (name, value) = field.split_once(':')?;
        match name {
            "MPos" => status.machine = Some(position(value)?),
            "WPos" => status.work = Some(position(value)?),
            "WCO" => status.work_offset = Some(position(value)?),
            // Told only while one is pressed.
            "Pn" => {
                status.limits = Letter::ALL.map(|letter| value.contains(letter.name()));
                status.hold_pressed = value.contains('H');
            }
            "MPG" => status.pendant = Some(value == "1"),
            // What is left of a name that has lost a letter: the `Pn` of a pressed switch, perhaps.
            "P" | "n" | "" => return None,
            // Tool, buffers, overrides and what else the heirs add.
            _ => {}
        }
    }
    (status.machine.is_some() || status.work.is_some()).then_some(status)
}

fn mode(word: &str) -> Option<Mode> {
    let (name, sub) = match word.split_once(':') {
        Some((name, sub)) => (name, Some(sub)),
        None => (word, None),
    };
    Some(match name {
        "Idle" => Mode::Idle,
        "Run" => Mode::Run,
        "Hold" => Mode::Hold(sub == Some("0")),
        "Jog" => Mode::Jog,
        // grblHAL adds the alarm's number. FluidNC is starting for a moment, and takes nothing meanwhile.
        "Alarm" | "Starting" => Mode::Alarm,
        "Door" => Mode::Door,
        "Check" => Mode::Check,
        "Home" => Mode::Home,
        "Sleep" => Mode::Sleep,
        _ => return None,
    })
}

fn position(value: &str) -> Option<[f64; 3]> {
    let mut position = [0.0; 3];
    let mut count = 0;
    for part in value.split(',') {
        let number: f64 = part.parse().ok().filter(|number: &f64| number.is_finite())?;
        // Builds for more axes report more; the first three are those that this driver knows.
        if let Some(slot) = position.get_mut(count) {
            *slot = number;
        }
        count += 1;
    }
    (count >= 2).then_some(position)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn reports_are_read_as_grbl_writes_them() {
        let read = status("<Idle|MPos:-199.000,-199.000,-1.000|FS:0,0|WCO:0.000,0.000,0.000>").unwrap();
        assert_eq!(read.mode, Mode::Idle);
        assert_eq!(read.machine, Some([-199.0, -199.0, -1.0]));
        assert_eq!(read.work_offset, Some([0.0; 3]));
        assert_eq!(status("<Hold:1|WPos:1.000,2.000,3.000|Bf:15,128>").unwrap().mode, Mode::Hold(false));
        assert!(status("<Hold:0|WPos:1.000,2.000,3.000>").unwrap().mode.at_rest());
        assert_eq!(status("<Idle|MPos:0.000,0.000,0."), None, "a fragment is no report");
        assert_eq!(status("<Idle|MPos:0.000,nan,0.000>"), None);
        assert_eq!((read.limits, read.hold_pressed), ([false; 3], false));
        let pressed = status("<Alarm|MPos:0.000,0.000,0.000|FS:0,0|Pn:PYH|Ov:100,100,100>").unwrap();
        assert_eq!((pressed.limits, pressed.hold_pressed), ([false, true, false], true));
        assert_eq!(status("<Idle>"), None, "without a position there is nothing to read");
    }

    #[test]
    fn the_heirs_reports_are_read_too() {
        let hal = status("<Alarm:1|MPos:1.000,2.000,0.000|FS:0,0|Pn:PEY|WCS:G54|MPG:1|T:3|FW:grblHAL>").unwrap();
        assert_eq!((hal.mode, hal.limits, hal.pendant), (Mode::Alarm, [false, true, false], Some(true)));
        let hal = status("<Hold:1|MPos:1.000,2.000,0.000,4.000|Bf:100,1024|FS:0,0|Sc:XY|MPG:0>").unwrap();
        assert_eq!((hal.mode, hal.machine, hal.pendant), (Mode::Hold(false), Some([1.0, 2.0, 0.0]), Some(false)));
        let fluid = status("<Home|MPos:1.500,2.000|FS:300,0|Pn:XH|Ov:100,100,100|SD:12.50,/sd/a.nc>").unwrap();
        assert_eq!((fluid.mode, fluid.machine), (Mode::Home, Some([1.5, 2.0, 0.0])));
        assert!(fluid.hold_pressed && fluid.limits[0] && fluid.pendant.is_none());
        assert!(status("<Idle|MPos:1.500,2.000|FS:0,0|>").is_some());
        assert_eq!(status("<Idle|MPos:1.500,2.000|FS:0,0|PnX>"), None, "a field without its colon is damage");
    }

    proptest! {
        #[test]
        fn damaged_reports_are_read_right_or_not_at_all(at in 0usize..60, byte in any::<u8>()) {
            let report = "<Jog|MPos:-10.000,-20.000,0.000|FS:120,0>";
            let mut bytes = report.as_bytes().to_vec();
            let index = at % bytes.len();
            bytes[index] = byte;
            if let Some(read) = status(&String::from_utf8_lossy(&bytes)) {
                prop_assert!(read.machine.is_some_and(|p| p.iter().all(|x| x.is_finite())) || read.work.is_some());
            }
        }
    }
}
