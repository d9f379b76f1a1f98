//! Who or what answers at a port instead of the controller that is configured, and what to do about it: the words of the
//! daemon and of `plenalign doctor --identify` alike.

use std::time::Duration;

use crate::device::DeviceError;
use crate::device::port::Received;

/// Baud rates to try where the usual one is not it, the likelier ones first.
const OTHER_BAUDS: &str = "250000, 57600, 38400 or 9600";
/// Most characters of a line that are shown.
const SHOWN: usize = 60;

/// A firmware that is told by what it says.
struct Stranger {
    name: &'static str,
    /// What it says, in small letters; a line that is no more than this, where it ends in a line end.
    marks: &'static [&'static str],
}

/// The first whose mark is found is meant. Klipper's lines begin with slashes; `Unknown command` alone is no mark.
const STRANGERS: [Stranger; 4] = [
    Stranger { name: "Klipper, the firmware of 3D printers", marks: &["klipper", "// unknown command"] },
    Stranger { name: "Marlin, the firmware of 3D printers", marks: &["marlin", "echo:unknown command", "start\n"] },
    Stranger { name: "Smoothieware", marks: &["smoothie"] },
    Stranger { name: "RepRapFirmware, the firmware of Duet boards", marks: &["reprapfirmware", "duet"] },
];

/// What was heard at a port, and how it was asked.
pub struct Heard<'a> {
    /// The controller's name, for errors.
    pub device: &'a str,
    /// What it was to do: the words after "did not".
    pub what: &'a str,
    /// How long it was given.
    pub allowed: Duration,
    /// Lines that were no answer.
    pub lines: &'a [String],
    /// Every byte, readable or not.
    pub received: &'a Received,
    /// What was sent: bytes that an echo would bring back.
    pub sent: &'a [u8],
    /// What ought to be there.
    pub expected: &'a str,
    /// The baud rate that the port was opened with, and the usual one of such controllers.
    pub baud: (u32, u32),
}

impl Heard<'_> {
    /// What was heard in place of an answer, what would be right and what to do.
    #[must_use]
    pub fn error(&self) -> DeviceError {
        let (baud, usual) = self.baud;
        let device = self.device.to_owned();
        if self.received.count == 0 {
            let what = format!(
                "{}, and sent not a single byte (see to its power, its cable and `port`; then to `baud`, {baud} now)",
                self.what
            );
            return DeviceError::Timeout { device, what, allowed: self.allowed };
        }
        let wrong = |found| DeviceError::WrongDevice { device, expected: self.expected.to_owned(), found };
        if let Some(found) = named(self.lines) {
            return wrong(found);
        }
        let latest = self.received.latest();
        if latest.iter().all(|byte| self.sent.contains(byte)) {
            return wrong(
                "nothing but an echo of what was sent: the line's ends are joined, or its controller is off".to_owned(),
            );
        }
        if !self.received.is_text() {
            let shown: String = String::from_utf8_lossy(latest).chars().take(12).collect();
            let right = if baud == usual {
                format!("{usual} is the usual one, so try {OTHER_BAUDS}, e.g. baud = 250000")
            } else {
                format!("{usual} is the usual one: baud = {usual}")
            };
            return wrong(format!(
                "{} bytes and nothing readable among them (`{}`) at {baud} baud: the baud rate is wrong, as a rule; {right}, \
                 in the configuration of {}",
                self.received.count,
                shown.escape_debug(),
                self.device
            ));
        }
        let line = self.lines.iter().find(|line| !line.trim().is_empty());
        wrong(something(line.map_or_else(|| String::from_utf8_lossy(latest).into_owned(), Clone::clone).as_str()))
    }
}

/// A firmware that is known by its lines, in words that say what to do.
fn named(lines: &[String]) -> Option<String> {
    let small: Vec<String> = lines.iter().map(|line| format!("{}\n", line.trim().to_ascii_lowercase())).collect();
    let says = |mark: &str| match mark.ends_with('\n') {
        true => small.iter().position(|line| line == mark),
        false => small.iter().position(|line| line.contains(mark)),
    };
    let found = STRANGERS.iter().find_map(|stranger| {
        let line = stranger.marks.iter().find_map(|mark| says(mark))?;
        Some((stranger.name, &lines[line]))
    });
    found.map(|(name, line)| {
        format!(
            "{name}, which says `{}`: it cannot be driven, so put Grbl 1.1, grblHAL or FluidNC on the board, or name \
             another port",
            shown(line)
        )
    })
}

/// A line of somebody who is not known, or whose name it tells.
#[must_use]
pub fn something(line: &str) -> String {
    named(&[line.to_owned()]).unwrap_or_else(|| {
        let hint = if line.contains('\u{fffd}') { " (is the baud rate right?)" } else { "" };
        format!("something that says `{}`{hint}", shown(line))
    })
}

fn shown(line: &str) -> String {
    line.trim().chars().take(SHOWN).collect::<String>().escape_debug().to_string()
}
