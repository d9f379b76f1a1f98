//! Thorlabs' APT protocol, bytes in and bytes out: what its motor controllers (Kinesis) speak over their USB serial port.
//!
//! Source: Thorlabs' "Motion Controllers Host-Controller Communications Protocol". A message is a header of six bytes,
//! `id, id, first, second, destination, source`; where the destination's highest bit is set, `first, second` are the
//! length of the data that follow. Numbers are little-endian. There is no checksum and no number: an answer names the
//! question (its id is the next one), the unit and the channel.

pub mod model;
pub mod status;

use crate::device::port::{Kind, Protocol, Recovery};

/// Address of the host.
pub const HOST: u8 = 0x01;
/// Address of a unit of its own on USB: a K-Cube.
pub const USB_UNIT: u8 = 0x50;
/// Address of the main board of a controller with bays.
pub const MAIN_BOARD: u8 = 0x11;
/// Address of the first bay; the others follow.
pub const FIRST_BAY: u8 = 0x21;
/// The channel of a K-Cube, and of what is in a bay.
pub const CHANNEL: u8 = 1;

/// Bytes of a header.
const HEADER: usize = 6;
/// Marks a destination's message as one with data.
const WITH_DATA: u8 = 0x80;
/// No message has more data.
const MOST_DATA: usize = 255;

/// Numbers of messages.
pub mod id {
    /// The host leaves.
    pub const DISCONNECT: u16 = 0x0002;
    /// What a unit is.
    pub const REQ_INFO: u16 = 0x0005;
    /// Stop saying the state again and again.
    pub const STOP_UPDATES: u16 = 0x0012;
    /// No new firmware is coming: said once at the start.
    pub const NO_FLASH_PROGRAMMING: u16 = 0x0018;
    /// Whether a bay has something in it.
    pub const REQ_BAY_USED: u16 = 0x0060;
    /// An error without words.
    pub const RESPONSE: u16 = 0x0080;
    /// An error in words.
    pub const RICH_RESPONSE: u16 = 0x0081;
    /// Switch a motor on (1) or off (2).
    pub const SET_ENABLED: u16 = 0x0210;
    /// The position counter.
    pub const REQ_POSITION: u16 = 0x0411;
    /// Set acceleration and greatest speed.
    pub const SET_SPEED: u16 = 0x0413;
    /// Acceleration and greatest speed.
    pub const REQ_SPEED: u16 = 0x0414;
    /// Limit switches and limits in numbers.
    pub const REQ_LIMITS: u16 = 0x0424;
    /// Status bits.
    pub const REQ_BITS: u16 = 0x0429;
    /// How it homes.
    pub const REQ_HOMING: u16 = 0x0441;
    /// Home.
    pub const MOVE_HOME: u16 = 0x0443;
    /// It has homed.
    pub const HOMED: u16 = 0x0444;
    /// Move by a distance.
    pub const MOVE_RELATIVE: u16 = 0x0448;
    /// Move to a position.
    pub const MOVE_ABSOLUTE: u16 = 0x0453;
    /// Move at the set speed until it is stopped.
    pub const MOVE_VELOCITY: u16 = 0x0457;
    /// A move has come to its end.
    pub const COMPLETED: u16 = 0x0464;
    /// Stop: at once (1), or along the ramp (2).
    pub const STOP: u16 = 0x0465;
    /// A motion was stopped.
    pub const STOPPED: u16 = 0x0466;
    /// Move as the buttons do.
    pub const MOVE_JOG: u16 = 0x046A;
    /// Position and status bits of a stepper motor.
    pub const REQ_STEPPER: u16 = 0x0480;
    /// Position and status bits of a servo motor.
    pub const REQ_SERVO: u16 = 0x0490;
    /// The host is still there, and listens to the state of a servo motor.
    pub const STILL_THERE: u16 = 0x0492;
}

/// The number of the answer to a question.
#[must_use]
pub const fn answer_to(question: u16) -> u16 {
    question + 1
}

/// How a motion is stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Stop {
    /// At once: steps may be lost.
    AtOnce = 1,
    /// Along the ramp.
    Ramp = 2,
}

/// A message, whichever way it goes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// Its number.
    pub id: u16,
    /// To whom.
    pub dest: u8,
    /// From whom.
    pub source: u8,
    /// What it says.
    pub body: Body,
}

/// What a message says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Body {
    /// Two bytes of the header.
    Short(u8, u8),
    /// Data behind the header.
    Data(Vec<u8>),
}

impl Message {
    /// A message of the host's without data.
    #[must_use]
    pub const fn short(id: u16, dest: u8, first: u8, second: u8) -> Self {
        Self { id, dest, source: HOST, body: Body::Short(first, second) }
    }

    /// A message of the host's to a channel, with numbers behind the channel's.
    #[must_use]
    pub fn numbers(id: u16, dest: u8, numbers: &[i32]) -> Self {
        let mut data = u16::from(CHANNEL).to_le_bytes().to_vec();
        data.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
        Self { id, dest, source: HOST, body: Body::Data(data) }
    }

    /// As bytes.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes = self.id.to_le_bytes().to_vec();
        match &self.body {
            Body::Short(first, second) => bytes.extend([*first, *second, self.dest, self.source]),
            Body::Data(data) => {
                bytes.extend((data.len() as u16).to_le_bytes());
                bytes.extend([self.dest | WITH_DATA, self.source]);
                bytes.extend(data);
            }
        }
        bytes
    }

    /// The message that bytes begin with, and how many bytes it has; `None` while there are not enough.
    #[must_use]
    pub fn read(bytes: &[u8]) -> Option<(Self, usize)> {
        let header: [u8; HEADER] = bytes.get(..HEADER)?.try_into().ok()?;
        let [a, b, first, second, dest, source] = header;
        let size = HEADER + data_length(header);
        let body = if dest & WITH_DATA == 0 {
            Body::Short(first, second)
        } else {
            Body::Data(bytes.get(HEADER..size)?.to_vec())
        };
        Some((Self { id: u16::from_le_bytes([a, b]), dest: dest & !WITH_DATA, source, body }, size))
    }

    /// The messages that bytes are made of, as far as they are whole.
    pub fn all(mut bytes: &[u8]) -> impl Iterator<Item = Self> {
        std::iter::from_fn(move || {
            let (message, size) = Self::read(bytes)?;
            bytes = &bytes[size..];
            Some(message)
        })
    }

    /// Its data; none where it has only a header.
    #[must_use]
    pub fn data(&self) -> &[u8] {
        match &self.body {
            Body::Short(..) => &[],
            Body::Data(data) => data,
        }
    }

    /// The 16 bits at a place of its data.
    #[must_use]
    pub fn word(&self, at: usize) -> Option<u16> {
        Some(u16::from_le_bytes(self.data().get(at..at + 2)?.try_into().ok()?))
    }

    /// The 32 bits at a place of its data.
    #[must_use]
    pub fn long(&self, at: usize) -> Option<i32> {
        Some(i32::from_le_bytes(self.data().get(at..at + 4)?.try_into().ok()?))
    }

    /// The channel, or bay, that it is about.
    fn subject(&self) -> Option<u16> {
        match &self.body {
            Body::Short(first, _) => Some(u16::from(*first)),
            Body::Data(_) => self.word(0),
        }
    }
}

fn data_length(header: [u8; HEADER]) -> usize {
    if header[4] & WITH_DATA == 0 { 0 } else { usize::from(u16::from_le_bytes([header[2], header[3]])) }
}

/// How long the data of a controller's message are, where it is one that is known here.
const fn known_length(id: u16) -> Option<usize> {
    match id {
        0x0006 => Some(84),
        0x0061 | id::RESPONSE | id::HOMED => Some(0),
        id::RICH_RESPONSE => Some(68),
        0x0412 | 0x042A => Some(6),
        0x0415 | 0x0442 | 0x0481 | 0x0491 => Some(14),
        0x0425 => Some(16),
        _ => None,
    }
}

const fn is_unit(address: u8) -> bool {
    matches!(address, USB_UNIT | MAIN_BOARD | FIRST_BAY..=0x2A)
}

/// Whether a message is one that nobody asked for.
const fn is_told(id: u16) -> bool {
    matches!(id, id::RESPONSE | id::RICH_RESPONSE | id::HOMED | id::COMPLETED | id::STOPPED)
}

/// The size of the message that a header begins, where it can begin one.
fn size(header: [u8; HEADER]) -> Option<usize> {
    let [a, b, .., dest, source] = header;
    let (id, dest, length) = (u16::from_le_bytes([a, b]), dest & !WITH_DATA, data_length(header));
    // Some units tell the end of a move without saying who they are.
    let from_unit = (dest == HOST || dest == 0) && (is_unit(source) || source == 0 && is_told(id));
    let echo = is_unit(dest) && source == HOST;
    let fits = echo || known_length(id).is_none_or(|known| known == length);
    (id != 0 && (from_unit || echo) && fits && length <= MOST_DATA).then_some(HEADER + length)
}

/// Cuts the stream into messages. What cannot begin one is left out byte by byte; a lost byte costs its message.
#[derive(Debug, Default)]
pub struct Apt {
    bytes: Vec<u8>,
}

impl Protocol for Apt {
    type Message = Message;
    const RECOVERY: Recovery = Recovery::Required;
    // Data look like anything: a stop in their midst would be part of them.
    const URGENT_ANYWHERE: bool = false;

    fn frame(&mut self, bytes: &[u8]) -> Vec<Message> {
        self.bytes.extend(bytes);
        let (mut messages, mut at) = (Vec::new(), 0);
        while let Some(header) = self.bytes.get(at..at + HEADER).and_then(|header| header.try_into().ok()) {
            match size(header) {
                None => at += 1,
                Some(_) => match Message::read(&self.bytes[at..]) {
                    Some((message, size)) => {
                        messages.push(message);
                        at += size;
                    }
                    None => break,
                },
            }
        }
        self.bytes.drain(..at);
        messages
    }

    /// Messages are written without pauses: what is unfinished after one lost its rest.
    fn gap(&mut self) {
        self.bytes.clear();
    }

    fn classify(&self, message: &Message, request: Option<&[u8]>) -> Kind {
        if message.source == HOST {
            // An echo.
            return Kind::Notice;
        }
        let asked: Vec<Message> = Message::all(request.unwrap_or_default()).collect();
        let refuses = |asked: &Message| message.source == asked.dest && message.word(0) == Some(asked.id);
        if message.id == id::RICH_RESPONSE && asked.iter().any(refuses) {
            return Kind::Refused;
        }
        let Some(question) = asked.last().filter(|question| answer_to(question.id) == message.id) else {
            return if is_told(message.id) { Kind::Notice } else { Kind::Noise };
        };
        let right = match question.id {
            // Several may have been asked which of them is there.
            id::REQ_INFO => asked.iter().any(|asked| asked.id == question.id && asked.dest == message.source),
            _ => question.dest == message.source && question.subject() == message.subject(),
        };
        if right { Kind::Last } else { Kind::Noise }
    }

    fn text(&self, message: &Message) -> String {
        complaint(message).unwrap_or_else(|| format!("message {:#06x} of unit {:#04x}", message.id, message.source))
    }
}

/// What a unit complains about, in its own words, if it does.
#[must_use]
pub fn complaint(message: &Message) -> Option<String> {
    match message.id {
        id::RESPONSE => Some("an error without words".to_owned()),
        id::RICH_RESPONSE => {
            let notes = message.data().get(4..).unwrap_or_default();
            let notes = notes.split(|&byte| byte == 0).next().unwrap_or_default();
            let notes = String::from_utf8_lossy(notes).trim().to_owned();
            Some(format!("error {}: {notes}", message.word(2).unwrap_or_default()))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests;
