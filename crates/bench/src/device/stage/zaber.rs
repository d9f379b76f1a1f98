//! Zaber's ASCII protocol, bytes in and bytes out: commands with checksum and number, replies, alerts, flags.
//!
//! Source: Zaber's ASCII Protocol Manual. Positions are microsteps; speeds microsteps a second times
//! [`SPEED_UNIT`], accelerations microsteps a second squared times [`ACCELERATION_UNIT`].

use crate::device::port::{Kind, LineBuffer, Protocol, Recovery};

/// A speed in the protocol's unit, for one microstep a second.
pub const SPEED_UNIT: f64 = 1.6384;
/// An acceleration in the protocol's unit, for one microstep a second squared.
pub const ACCELERATION_UNIT: f64 = 1.6384e-4;
/// Most of a message's data kept over all of its packets.
const LONGEST_DATA: usize = 4096;

/// Two hexadecimal digits that make the sum of a message's bytes, from after its first character, a multiple of 256.
#[must_use]
pub fn checksum(body: &str) -> u8 {
    body.bytes().fold(0u8, u8::wrapping_add).wrapping_neg()
}

/// A command to an axis of a device (0 for every axis), numbered 0 to 99 so that its reply can be told from others.
#[must_use]
pub fn command(device: u8, axis: u8, id: u8, words: &str) -> Vec<u8> {
    let body = format!("{device:02} {axis} {id:02} {words}");
    format!("/{body}:{:02X}\n", checksum(&body)).into_bytes()
}

/// A command without a number: its reply answers no question.
#[must_use]
pub fn unnumbered(device: u8, axis: u8, words: &str) -> Vec<u8> {
    let body = format!("{device:02} {axis} {words}");
    format!("/{body}:{:02X}\n", checksum(&body)).into_bytes()
}

/// What kind of message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Type {
    /// `@`: the answer to a command.
    Reply,
    /// `#`: something to read, or the continuation of a message.
    Info,
    /// `!`: said by the device itself.
    Alert,
}

/// A message from a device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// Its kind.
    pub kind: Type,
    /// Device address.
    pub device: u8,
    /// Axis, 0 for the device.
    pub axis: u8,
    /// Number of the command that it answers.
    pub id: Option<u8>,
    /// Whether a command was accepted.
    pub accepted: bool,
    /// Whether the axis moves.
    pub busy: bool,
    /// The highest of its warning flags, `--` for none.
    pub flag: String,
    /// The rest.
    pub data: String,
}

/// A line as it came: a message, or what cannot be read as one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Item {
    /// A whole message, all its packets put together.
    Message(Message),
    /// Anything else: noise, a damaged message, an echo.
    Other(String),
}

/// One packet, and whether another follows.
fn packet(line: &str) -> Option<(Message, bool)> {
    let kind = match line.as_bytes().first()? {
        b'@' => Type::Reply,
        b'#' => Type::Info,
        b'!' => Type::Alert,
        _ => return None,
    };
    let body = match line[1..].rsplit_once(':') {
        Some((body, digits)) if digits.len() == 2 => {
            if u8::from_str_radix(digits, 16).ok()? != checksum(body) {
                return None;
            }
            body
        }
        _ => &line[1..],
    };
    let (body, more) = match body.strip_suffix('\\') {
        Some(body) => (body, true),
        None => (body, false),
    };
    let mut words = body.split(' ').filter(|word| !word.is_empty()).peekable();
    let device = number(words.next()?, 2)?;
    let axis = number(words.next()?, 1)?;
    // A number is two digits; a reply's next word is letters, an info's may be anything.
    let id = match words.peek().copied() {
        Some(word) if word.len() == 2 && kind != Type::Alert => number(word, 2),
        _ => None,
    };
    if id.is_some() {
        words.next();
    }
    let accepted = match kind {
        Type::Reply => match words.next()? {
            "OK" => true,
            "RJ" => false,
            _ => return None,
        },
        _ => true,
    };
    let (busy, flag) = match kind {
        Type::Info => (false, "--"),
        _ => {
            let busy = match words.next()? {
                "BUSY" => true,
                "IDLE" => false,
                _ => return None,
            };
            (busy, words.next().filter(|flag| flag.len() == 2)?)
        }
    };
    let data = words.collect::<Vec<_>>().join(" ");
    Some((Message { kind, device, axis, id, accepted, busy, flag: flag.to_owned(), data }, more))
}

fn number(word: &str, digits: usize) -> Option<u8> {
    (word.len() <= digits && word.bytes().all(|byte| byte.is_ascii_digit())).then(|| word.parse().ok())?
}

/// Cuts the stream into messages and tells them apart.
#[derive(Debug, Default)]
pub struct Zaber {
    lines: LineBuffer,
    unfinished: Option<Message>,
}

impl Zaber {
    fn take(&mut self, line: &str) -> Option<Item> {
        // Noise may stand before a message on its line.
        let start = line.find(['@', '#', '!']).unwrap_or(0);
        let Some((message, more)) = packet(&line[start..]) else { return Some(Item::Other(line.to_owned())) };
        let message = match (message.kind, self.unfinished.take()) {
            (Type::Info, Some(mut whole)) if message.data.starts_with("cont ") => {
                let rest = message.data["cont ".len()..].split_once(' ').map_or("", |(_, rest)| rest);
                if whole.data.len() + rest.len() > LONGEST_DATA {
                    return Some(Item::Other(line.to_owned()));
                }
                whole.data = format!("{} {rest}", whole.data).trim().to_owned();
                whole
            }
            _ => message,
        };
        if more {
            self.unfinished = Some(message);
            return None;
        }
        Some(Item::Message(message))
    }
}

impl Protocol for Zaber {
    type Message = Item;
    const RECOVERY: Recovery = Recovery::None;
    const URGENT_ANYWHERE: bool = false;

    fn frame(&mut self, bytes: &[u8]) -> Vec<Item> {
        let lines = self.lines.push(bytes);
        lines.iter().filter_map(|line| self.take(line)).collect()
    }

    fn gap(&mut self) {
        self.unfinished = None;
    }

    fn classify(&self, item: &Item, request: Option<&[u8]>) -> Kind {
        let Item::Message(message) = item else {
            // An echo is no answer and no noise.
            let echo = matches!((item, request), (Item::Other(line), Some(bytes))
                if line.as_bytes() == bytes.trim_ascii_end());
            return if echo { Kind::Notice } else { Kind::Noise };
        };
        match message.kind {
            Type::Reply if request.and_then(addressed).is_some_and(|wanted| wanted == key(message)) => {
                if message.accepted { Kind::Last } else { Kind::Refused }
            }
            // Late, doubled, or a stop's.
            Type::Reply | Type::Info | Type::Alert => Kind::Notice,
        }
    }

    fn text(&self, item: &Item) -> String {
        match item {
            Item::Message(message) => message.data.clone(),
            Item::Other(line) => line.clone(),
        }
    }
}

fn key(message: &Message) -> (u8, u8, Option<u8>) {
    (message.device, message.axis, message.id)
}

/// Device, axis and number of a command.
fn addressed(request: &[u8]) -> Option<(u8, u8, Option<u8>)> {
    let text = std::str::from_utf8(request).ok()?.strip_prefix('/')?;
    let mut words = text.split(' ');
    Some((number(words.next()?, 2)?, number(words.next()?, 1)?, number(words.next()?, 2)))
}

/// What a rejection's word means.
#[must_use]
pub fn rejection(word: &str) -> String {
    let meaning = match word.split(' ').next().unwrap_or_default() {
        "BADDATA" => "a number in the command is out of range, or the target beyond its limits",
        "BADCOMMAND" => "it does not know the command, or not in its present state",
        "BADAXIS" => "it has no such axis",
        "STATUSBUSY" => "it is moving",
        "DRIVERDISABLED" => "its motor is switched off; home the axis",
        "FULL" => "it cannot take more commands",
        "LOCKSTEP" => "the axis is part of a lockstep group",
        "NOACCESS" => "the setting needs a higher access level",
        "PARKED" => "the axis is parked; home it",
        _ => "see Zaber's table of rejection reasons",
    };
    format!("{word}: {meaning}")
}

/// Why a flag keeps an axis from moving on, where it does.
#[must_use]
pub fn fault(flag: &str) -> Option<String> {
    let words = match flag {
        "FF" => "critical system error; switch it off and on",
        "FN" => "its peripheral is not supported",
        "FZ" => "its peripheral is not activated",
        "FH" => "its hardware emergency stop is active; release it, then home",
        "FV" => "its supply voltage is too high; correct it, then home",
        "FO" => "its motor is switched off; home the axis",
        "FC" => "its current is too high; find out why, then home",
        "FM" => "its motor is too hot; let it cool, then home",
        "FD" => "its motor driver is disabled; home the axis",
        "FQ" => "its encoder fails",
        "FS" => "it stalled and stopped; find out why, then home",
        "FB" => "it stopped because its target could not be reached; home it",
        "FP" => "its stored settings could not be applied",
        "FE" => "a limit sensor was hit; home the axis",
        "WL" => "a limit sensor was hit unexpectedly; home the axis",
        "WS" => "it stalled; find out why, then home",
        _ if flag.starts_with('F') => "a fault unknown to this driver; home the axis",
        _ => return None,
    };
    Some(format!("{flag}: {words}"))
}

/// What a flag says of a motion that did not end as commanded, although nothing is wrong with the axis.
#[must_use]
pub fn interruption(flag: &str) -> Option<String> {
    let by = match flag {
        "NI" => "another program's command",
        "NC" => "its knob",
        _ => return None,
    };
    Some(format!("{flag}: its motion was interrupted by {by}"))
}

/// Whether a flag lets an axis's position be believed: it has a reference, and from its own homing. `None` for a flag
/// that may hide one of less weight.
#[must_use]
pub fn referenced(flag: &str) -> Option<bool> {
    match flag {
        "WR" | "WH" | "FO" | "FD" | "FF" => Some(false),
        _ if flag == "--" || flag.starts_with('N') => Some(true),
        _ => None,
    }
}

/// The same for the answer to `warnings`, which has every flag: `02 WT WR`.
#[must_use]
pub fn all_referenced(flags: &str) -> bool {
    flags.split(' ').skip(1).all(|flag| referenced(flag) != Some(false))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn read(line: &str) -> Message {
        packet(line).unwrap().0
    }

    #[test]
    fn checksums_are_the_manuals() {
        // The manual's example: "/01 tools echo" has 8F.
        assert_eq!(checksum("01 tools echo"), 0x8F);
        assert_eq!(command(1, 2, 7, "move abs 100"), b"/01 2 07 move abs 100:E8\n");
        let body = "01 2 07 move abs 100";
        assert_eq!(body.bytes().fold(checksum(body), u8::wrapping_add), 0);
    }

    #[test]
    fn replies_are_read_with_and_without_number_and_checksum() {
        let reply = read("@01 1 07 OK BUSY WR 12345");
        assert_eq!((reply.device, reply.axis, reply.id), (1, 1, Some(7)));
        assert!(reply.accepted && reply.busy && reply.flag == "WR" && reply.data == "12345");
        let reply = read("@01 0 RJ IDLE -- BADCOMMAND");
        assert!(!reply.accepted && reply.id.is_none() && reply.data == "BADCOMMAND");
        let body = "01 1 07 OK IDLE -- 5";
        assert_eq!(read(&format!("@{body}:{:02X}", checksum(body))).data, "5");
        assert_eq!(packet(&format!("@{body}:{:02X}", checksum(body) ^ 1)), None, "a wrong checksum");
        assert_eq!(packet("@01 1 07 OK BUS"), None);
        assert_eq!(read("!01 1 IDLE --").kind, Type::Alert);
        assert_eq!([referenced("--"), referenced("NI"), referenced("WR")], [Some(true), Some(true), Some(false)]);
        // Too hot, and behind that perhaps without a reference: every flag has to be asked for.
        assert_eq!(referenced("WT"), None);
        assert!(!all_referenced("02 WT WR") && all_referenced("01 WT") && all_referenced("00"));
    }

    #[test]
    fn packets_of_one_message_are_put_together() {
        let mut zaber = Zaber::default();
        assert_eq!(zaber.frame(b"@01 0 05 OK IDLE -- 1 2 3\\\r\n"), []);
        let whole = zaber.frame(b"#01 0 05 cont 1 4 5 6\r\n");
        let [Item::Message(message)] = whole.as_slice() else { panic!("{whole:?}") };
        assert_eq!((message.data.as_str(), message.kind), ("1 2 3 4 5 6", Type::Reply));
    }

    #[test]
    fn a_message_that_never_ends_is_not_kept() {
        let mut zaber = Zaber::default();
        zaber.frame(b"@01 0 05 OK IDLE -- 1\\\r\n");
        let part = format!("#01 0 cont 1 {}\\\r\n", "7".repeat(200));
        for _ in 0..100_000 {
            zaber.frame(part.as_bytes());
            let kept = zaber.unfinished.as_ref().map_or(0, |message| message.data.capacity());
            assert!(kept <= 2 * LONGEST_DATA, "{kept} bytes are kept");
        }
        zaber.gap();
        let read = zaber.frame(b"@01 1 07 OK IDLE -- 5\r\n");
        assert!(matches!(read.as_slice(), [Item::Message(m)] if m.data == "5"), "{read:?}");
    }

    #[test]
    fn a_reply_answers_only_the_command_of_its_number() {
        let mut zaber = Zaber::default();
        let request = command(1, 1, 7, "get pos");
        let mut kind = |line: &[u8]| {
            let items = zaber.frame(line);
            zaber.classify(&items[0], Some(&request))
        };
        assert_eq!(kind(b"@01 1 07 OK IDLE -- 5\r\n"), Kind::Last);
        assert_eq!(kind(b"\xff\xfe@01 1 07 OK IDLE -- 5\r\n"), Kind::Last, "noise before it");
        assert_eq!(kind(b"@01 1 07 RJ IDLE -- BADDATA\r\n"), Kind::Refused);
        assert_eq!(kind(b"@01 1 06 OK IDLE -- 4\r\n"), Kind::Notice, "a late one");
        assert_eq!(kind(b"@01 0 OK IDLE -- 0\r\n"), Kind::Notice, "a stop's");
        assert_eq!(kind(&command(1, 1, 7, "get pos")), Kind::Notice, "an echo");
        assert_eq!(kind(b"Grbl 1.1h ['$' for help]\r\n"), Kind::Noise);
    }

    proptest! {
        #[test]
        fn no_bytes_break_the_reader_and_it_is_back_in_step_after_a_line(
            noise in proptest::collection::vec(any::<u8>(), 0..2000), cut in 1usize..50,
        ) {
            let mut zaber = Zaber::default();
            for piece in noise.chunks(cut) {
                zaber.frame(piece);
            }
            zaber.frame(b"\r\n");
            let read = zaber.frame(b"@01 1 07 OK IDLE -- 5\r\n");
            prop_assert!(matches!(read.as_slice(), [Item::Message(m)] if m.data == "5"));
        }

        #[test]
        fn a_damaged_reply_with_a_checksum_is_not_taken_for_another(at in 0usize..40, byte in any::<u8>()) {
            let body = "01 1 07 OK IDLE -- 12345";
            let line = format!("@{body}:{:02X}", checksum(body));
            let mut bytes = line.clone().into_bytes();
            let index = 1 + at % body.len();
            bytes[index] = byte;
            if bytes != line.as_bytes() {
                prop_assert_eq!(packet(&String::from_utf8_lossy(&bytes)), None);
            }
        }
    }
}
