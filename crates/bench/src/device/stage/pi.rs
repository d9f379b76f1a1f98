//! PI's General Command Set 2, bytes in and bytes out: questions, commands and the error that follows them, lines.
//!
//! Source: PI's GCS 2 command references (C-863, E-870). Commands are answered by nothing: whether one was taken is asked
//! with `ERR?`, which clears what it tells. One-byte commands are written without a line end.

use crate::device::port::{Kind, Protocol, Recovery};

/// One-byte command: which axes move, as a hexadecimal mask.
pub const MOTION: u8 = 5;
/// One-byte command: stop every axis at once.
pub const STOP: u8 = 24;
/// Asks what the controller is.
pub const IDENTITY: &[u8] = b"*IDN?\n";
/// Asks for the error that the last command made, and clears it.
pub const ERROR: &[u8] = b"ERR?\n";
/// Error after a stop.
pub const STOPPED: i32 = 10;
/// Error of a command for an axis that is not referenced or whose servo is off.
pub const UNREFERENCED: i32 = 5;
/// Longest line taken; anything longer is noise.
const LONGEST_LINE: usize = 512;

/// A line of an answer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Line {
    /// The line without its end.
    pub text: String,
    /// Whether another line of the same answer follows.
    pub more: bool,
}

/// A question about an axis, e.g. `POS? 1`.
#[must_use]
pub fn question(word: &str, axis: &str) -> Vec<u8> {
    format!("{word} {axis}\n").into_bytes()
}

/// Commands, and the question whether the last was taken.
#[must_use]
pub fn checked(commands: &[String]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for command in commands {
        bytes.extend_from_slice(command.as_bytes());
        bytes.push(b'\n');
    }
    bytes.extend_from_slice(ERROR);
    bytes
}

/// The value of an answer `1=0.25` about an axis.
#[must_use]
pub fn value<'a>(line: &'a str, axis: &str) -> Option<&'a str> {
    let (name, value) = line.split_once('=')?;
    (name.trim() == axis).then(|| value.trim())
}

/// The same as a number.
#[must_use]
pub fn number(line: &str, axis: &str) -> Option<f64> {
    value(line, axis)?.parse().ok().filter(|number: &f64| number.is_finite())
}

/// What an error number means, in words.
#[must_use]
pub fn error_meaning(error: i32) -> &'static str {
    match error {
        1 => "a parameter of the command is wrong",
        2 => "it does not know the command",
        3 => "the command is too long",
        5 => "the axis is not referenced, or its servo is off; home it",
        7 => "the position is beyond its limits",
        8 => "the speed is beyond its limits",
        10 => "it was stopped",
        15 => "it has no such axis",
        17 => "a parameter is out of range",
        23 => "it has no such axis",
        34 => "the command is not allowed while a reference move is under way",
        53 => "the axis cannot move now: another motion is under way",
        63 => "homing without a reference switch is not possible",
        -1024 => "motion error: the axis fell too far behind and its servo was switched off; home it",
        _ => "see PI's table of errors",
    }
}

/// Cuts the stream into lines and tells which answers a question.
#[derive(Debug, Default)]
pub struct Pi {
    line: Vec<u8>,
    overlong: bool,
}

impl Protocol for Pi {
    type Message = Line;
    const RECOVERY: Recovery = Recovery::Required;
    const URGENT_ANYWHERE: bool = false;

    fn frame(&mut self, bytes: &[u8]) -> Vec<Line> {
        let mut lines = Vec::new();
        for &byte in bytes {
            match byte {
                b'\n' => {
                    let more = self.line.last() == Some(&b' ');
                    let text = String::from_utf8_lossy(&self.line).trim().to_owned();
                    if !self.overlong && !text.is_empty() {
                        lines.push(Line { text, more });
                    }
                    self.gap();
                }
                // Echoed one-byte commands are no part of a line.
                0..=0x1F => {}
                _ if self.line.len() < LONGEST_LINE => self.line.push(byte),
                _ => self.overlong = true,
            }
        }
        lines
    }

    fn gap(&mut self) {
        self.line.clear();
        self.overlong = false;
    }

    /// An answer does not say which question it belongs to, but its form does: a late or doubled one that has not the
    /// form of the question under way is none. Questions are asked in an order in which no two neighbours share a form.
    fn classify(&self, line: &Line, request: Option<&[u8]>) -> Kind {
        let Some(request) = request else { return Kind::Noise };
        if fits(request, &line.text) { if line.more { Kind::Data } else { Kind::Last } } else { Kind::Noise }
    }

    fn text(&self, line: &Line) -> String {
        line.text.clone()
    }
}

/// Whether a line has the form of an answer to a request, whose last line is the question.
fn fits(request: &[u8], line: &str) -> bool {
    if request == [MOTION] {
        return u64::from_str_radix(line.trim_start_matches("0x"), 16).is_ok();
    }
    let text = String::from_utf8_lossy(request);
    let question = text.trim_end().rsplit('\n').next().unwrap_or_default();
    let mut words = question.split(' ');
    let word = words.next().unwrap_or_default();
    match (word, words.next()) {
        ("*IDN?", _) => line.matches(',').count() >= 3,
        ("ERR?", _) => line.parse::<i32>().is_ok(),
        // Names of axes, one a line.
        ("SAI?", _) => !line.is_empty() && line.bytes().all(|byte| byte.is_ascii_alphanumeric()),
        ("PUN?", Some(axis)) => value(line, axis).is_some_and(|unit| unit.bytes().any(|b| b.is_ascii_alphabetic())),
        ("FRF?" | "SVO?", Some(axis)) => matches!(value(line, axis), Some("0" | "1")),
        // A whole number would be a yes or no: positions are told with decimals.
        ("POS?", Some(axis)) => number(line, axis).is_some() && line.contains(['.', 'e', 'E']),
        (_, Some(axis)) => number(line, axis).is_some(),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn read(bytes: &[u8]) -> Vec<Line> {
        Pi::default().frame(bytes)
    }

    #[test]
    fn lines_say_whether_another_follows() {
        let lines = read(b"1=0.5 \n2=-3.25\n");
        assert_eq!(lines[0], Line { text: "1=0.5".to_owned(), more: true });
        assert_eq!(lines[1], Line { text: "2=-3.25".to_owned(), more: false });
        // The answer to #7 is no text.
        assert_eq!(read(b"\xb1\n")[0].text, "\u{fffd}");
        assert_eq!(number("1=-3.25", "1"), Some(-3.25));
        assert_eq!(number("2=-3.25", "1"), None);
        assert_eq!(number("1=nan", "1"), None);
    }

    #[test]
    fn an_answer_has_the_form_of_its_question() {
        let kind = |request: &[u8], line: &str| {
            Pi::default().classify(&Line { text: line.to_owned(), more: false }, Some(request))
        };
        assert_eq!(kind(&[MOTION], "1"), Kind::Last);
        assert_eq!(kind(&[MOTION], "1=0.5000"), Kind::Noise, "a late position");
        assert_eq!(kind(b"POS? 1\n", "1=0.5000"), Kind::Last);
        assert_eq!(kind(b"POS? 1\n", "1=1"), Kind::Noise, "a doubled yes");
        assert_eq!(kind(b"POS? 1\n", "2=0.5000"), Kind::Noise, "another axis's");
        assert_eq!(kind(b"FRF? 1\n", "1=1"), Kind::Last);
        assert_eq!(kind(b"FRF? 1\n", "1=1.0000"), Kind::Noise);
        assert_eq!(kind(&checked(&["MOV 1 5".to_owned()]), "0"), Kind::Last);
        assert_eq!(kind(ERROR, "1=0.5000"), Kind::Noise);
        assert_eq!(kind(IDENTITY, "0"), Kind::Noise, "nothing else looks like an identity");
        assert_eq!(kind(IDENTITY, "(c)2013 Physik Instrumente (PI) GmbH, C-863.12, 0115, 1.2"), Kind::Last);
    }

    proptest! {
        #[test]
        fn no_bytes_break_the_reader_and_it_is_back_in_step_after_a_line(
            noise in proptest::collection::vec(any::<u8>(), 0..2000), cut in 1usize..50,
        ) {
            let mut pi = Pi::default();
            for piece in noise.chunks(cut) {
                for line in pi.frame(piece) {
                    prop_assert!(line.text.chars().count() <= LONGEST_LINE);
                    let _ = (pi.classify(&line, Some(b"POS? 1\n")), pi.classify(&line, Some(&[MOTION])));
                }
            }
            pi.frame(b"\n");
            prop_assert_eq!(pi.frame(b"1=2.5\n"), vec![Line { text: "1=2.5".to_owned(), more: false }]);
        }
    }
}
