//! Grbl 1.1's protocol, bytes in and bytes out: commands, status reports, settings, messages.
//!
//! Source: Grbl 1.1's interface and commands documents. Lengths are millimetres and rates millimetres a minute, as the
//! controller has them.

mod words;

use std::collections::BTreeMap;

pub use words::{Alarm, error_meaning};

use crate::device::port::{Kind, LineProtocol};

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

/// Tells Grbl's lines apart.
#[derive(Debug, Clone, Copy, Default)]
pub struct Grbl;

impl LineProtocol for Grbl {
    fn classify(&self, line: &str) -> Kind {
        let line = without_echo(line);
        if line == "ok" {
            Kind::Done
        } else if line.starts_with("error:") {
            Kind::Refused
        } else if line.starts_with("ALARM:") {
            Kind::Halted
        } else if banner(line).is_some() {
            Kind::Started
        } else if line.starts_with('<') || line.starts_with("[MSG:") {
            Kind::Notice
        } else if line.starts_with('$') || line.starts_with('[') {
            Kind::Data
        } else {
            Kind::Noise
        }
    }
}

/// A line without the real-time bytes that an echoing adapter sends back in front of it.
#[must_use]
pub fn without_echo(line: &str) -> &str {
    line.trim_start_matches(['?', '!', '~', '\u{18}', '\u{fffd}'])
}

/// The version in a start-up line, e.g. `Grbl 1.1h` or `GrblHAL 1.1f`. Noise before it on the line is passed over: a board that resets
/// when its port is opened spits some.
#[must_use]
pub fn banner(line: &str) -> Option<&str> {
    let start = line.find("Grbl ").or_else(|| line.find("GrblHAL "))?;
    let rest = &line[start..];
    let end = rest.find(" [")?;
    let version = &rest[..end];
    let (_, digits) = version.split_once(' ')?;
    (digits.starts_with(|c: char| c.is_ascii_digit()) && digits.len() <= 12).then_some(version)
}

/// The version in the answer to [`BUILD_INFO`], in the words of a start-up line.
#[must_use]
pub fn version(lines: &[String]) -> Option<String> {
    let told = lines.iter().find_map(|line| without_echo(line).strip_prefix("[VER:"))?;
    // Such as 1.1h.20190825: the version, the day it was built on, a name.
    let (number, rest) = told.split_once('.')?;
    let minor = rest.split(['.', ':', ']']).next().filter(|minor| !minor.is_empty())?;
    let hal = lines.iter().any(|line| line.to_ascii_lowercase().contains("grblhal"));
    Some(format!("{} {number}.{minor}", if hal { "GrblHAL" } else { "Grbl" }))
}

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
}

/// Reads a status report, `<Idle|MPos:0.000,0.000,0.000|FS:0,0>`; `None` for anything else or anything damaged.
#[must_use]
pub fn status(line: &str) -> Option<Status> {
    let body = without_echo(line).strip_prefix('<')?.strip_suffix('>')?;
    let mut fields = body.split('|');
    let mode = mode(fields.next()?)?;
    let mut status =
        Status { mode, machine: None, work: None, work_offset: None, limits: [false; 3], hold_pressed: false };
    for field in fields {
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
        "Alarm" => Mode::Alarm,
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

/// The controller's settings by number.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Settings(BTreeMap<u16, f64>);

impl Settings {
    /// Reads the answer to `$$`. Lines that are not settings are passed over.
    #[must_use]
    pub fn from_lines(lines: &[String]) -> Self {
        Self(lines.iter().filter_map(|line| setting(line)).collect())
    }

    /// Whether every setting that the other ones have is among these.
    #[must_use]
    pub fn covers(&self, other: &Self) -> bool {
        other.0.keys().all(|number| self.0.contains_key(number))
    }

    /// A setting's value.
    #[must_use]
    pub fn get(&self, number: u16) -> Option<f64> {
        self.0.get(&number).copied()
    }

    /// Whether a setting is there and not zero.
    #[must_use]
    pub fn is_on(&self, number: u16) -> bool {
        self.get(number).is_some_and(|value| value != 0.0)
    }

    /// The setting of an axis in one of the three-number groups: 100 steps/mm, 110 greatest rate (mm/min), 120
    /// acceleration (mm/s²), 130 travel (mm).
    #[must_use]
    pub fn of_axis(&self, group: u16, axis: Letter) -> Option<f64> {
        self.get(group + axis.index() as u16)
    }
}

/// Reads a settings line, `$100=400.000`.
#[must_use]
pub fn setting(line: &str) -> Option<(u16, f64)> {
    let (number, value) = line.strip_prefix('$')?.split_once('=')?;
    // Some builds add the setting's name in brackets.
    let value = value.split_whitespace().next()?;
    Some((number.parse().ok()?, value.parse().ok().filter(|value: &f64| value.is_finite())?))
}

/// Whether a letter is among the build options in the answer to `$I`.
fn built_with(lines: &[String], option: char) -> bool {
    lines
        .iter()
        .filter_map(|line| line.strip_prefix("[OPT:"))
        .filter_map(|options| options.split(',').next())
        .any(|letters| letters.contains(option))
}

/// Whether the answer to `$I` says that single axes can be homed (`H` among the build options).
#[must_use]
pub fn homes_single_axes(lines: &[String]) -> bool {
    built_with(lines, 'H')
}

/// Whether the answer to `$I` says that homing makes its end the machine's zero (`Z` among the build options).
#[must_use]
pub fn homes_to_zero(lines: &[String]) -> bool {
    built_with(lines, 'Z')
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
    fn commands_are_written_as_grbl_reads_them() {
        assert_eq!(jog(Letter::Y, -1.25, 300.0), b"$J=G90 G21 G53 Y-1.2500 F300.00\n");
        assert_eq!(jog_by(Letter::X, -0.2, 60.0), b"$J=G91 G21 X-0.2000 F60.00\n");
        assert_eq!(home(None), b"$H\n");
        assert_eq!(home(Some(Letter::X)), b"$HX\n");
    }

    #[test]
    fn lines_are_told_apart() {
        let kind = |line| Grbl.classify(line);
        assert_eq!(kind("ok"), Kind::Done);
        assert_eq!(kind("error:15"), Kind::Refused);
        assert_eq!(kind("ALARM:1"), Kind::Halted);
        assert_eq!(kind("Grbl 1.1h ['$' for help]"), Kind::Started);
        assert_eq!(kind("\u{fffd}xGrbl 1.1h ['$' for help]"), Kind::Started);
        assert_eq!(kind("GrblHAL 1.1f ['$' or '$HELP' for help]"), Kind::Started);
        assert_eq!(kind("Grbl something else"), Kind::Noise);
        assert_eq!(kind("?<Idle|MPos:0,0,0>"), Kind::Notice, "an echo of what was asked");
        assert_eq!(status("?<Idle|MPos:1.000,0.000,0.000>").unwrap().machine, Some([1.0, 0.0, 0.0]));
        assert_eq!(kind("<Idle|MPos:0,0,0>"), Kind::Notice);
        assert_eq!(kind("[MSG:Reset to continue]"), Kind::Notice);
        assert_eq!(kind("$100=400.000"), Kind::Data);
        assert_eq!(kind("[VER:1.1h.20190825:]"), Kind::Data);
        assert_eq!(kind("\u{fffd}"), Kind::Noise);
    }

    #[test]
    fn settings_and_options_are_read() {
        let lines: Vec<String> =
            ["$100=400.000", "$110=120.000 (x max rate)", "rubbish", "$x=1"].map(str::to_owned).to_vec();
        let settings = Settings::from_lines(&lines);
        assert_eq!(settings.of_axis(100, Letter::X), Some(400.0));
        assert_eq!(settings.of_axis(110, Letter::X), Some(120.0));
        assert_eq!(settings.of_axis(100, Letter::Y), None);
        let told = |lines: &[&str]| version(&lines.iter().map(|&line| line.to_owned()).collect::<Vec<_>>());
        assert_eq!(told(&["[VER:1.1h.20190825:]", "[OPT:V,15,128]"]).as_deref(), Some("Grbl 1.1h"));
        assert_eq!(told(&["[VER:1.1f.20230825:a bench]", "[FIRMWARE:grblHAL]"]).as_deref(), Some("GrblHAL 1.1f"));
        assert_eq!((told(&["[OPT:V]"]), told(&["[VER:1]"])), (None, None));
        assert!(homes_single_axes(&["[VER:1.1h.20190825:]".to_owned(), "[OPT:VH,15,128]".to_owned()]));
        assert!(!homes_single_axes(&["[VER:1.1H:]".to_owned(), "[OPT:V,15,128]".to_owned()]));
    }

    proptest! {
        #[test]
        fn no_bytes_break_the_readers(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            let line = String::from_utf8_lossy(&bytes).into_owned();
            let _ = (Grbl.classify(&line), status(&line), setting(&line), banner(&line), Alarm::from_line(&line));
            let _ = (error_meaning(&line), homes_single_axes(&[line]));
        }

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
