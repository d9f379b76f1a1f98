//! GVCP's datagrams: what a client asks for, and what it is answered.

use std::fmt;

/// The first byte of whatever a client sends.
const KEY: u8 = 0x42;
/// Bytes before a datagram's contents.
const HEADER: usize = 8;
/// The flag of a client that wants an answer.
const WANTS_ANSWER: u8 = 0x01;
/// Most bytes of memory in one datagram.
pub(super) const MOST_MEMORY: usize = 536;

/// Why the camera does not do what it is asked to. A code of the standard's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Refusal(pub(super) u16);

impl Refusal {
    pub(super) const NOT_IMPLEMENTED: Self = Self(0x8001);
    pub(super) const INVALID_PARAMETER: Self = Self(0x8002);
    pub(super) const INVALID_ADDRESS: Self = Self(0x8003);
    pub(super) const WRITE_PROTECTED: Self = Self(0x8004);
    pub(super) const BAD_ALIGNMENT: Self = Self(0x8005);
    pub(super) const ACCESS_DENIED: Self = Self(0x8006);
    pub(super) const BUSY: Self = Self(0x8007);
}

impl fmt::Display for Refusal {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(to, "status {:#06x}", self.0)
    }
}

/// What a client asks for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Command {
    /// Who is there?
    Discovery,
    /// To send packets of a frame again, the first and the last of them.
    Resend { block: u16, first: u32, last: u32 },
    /// The values of these registers.
    ReadRegisters(Vec<u32>),
    /// These registers to be set, in order.
    WriteRegisters(Vec<(u32, u32)>),
    /// So many bytes of memory.
    ReadMemory { at: u32, count: usize },
    /// Memory to be overwritten.
    WriteMemory { at: u32, bytes: Vec<u8> },
    /// Something else.
    Other,
}

/// A datagram of a client's.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Request {
    pub(super) command: Command,
    /// The command's own number: an answer's is one more.
    code: u16,
    /// The client's number of the request.
    id: u16,
    /// Whether it wants to be answered.
    pub(super) wants_answer: bool,
}

impl Request {
    /// Reads a datagram; `None` for what is no request. One that cannot be understood is told so.
    pub(super) fn read(datagram: &[u8]) -> Option<Result<Self, Vec<u8>>> {
        let (header, contents) = datagram.split_at_checked(HEADER)?;
        let [code, length, id] = [2, 4, 6].map(|at| u16::from_be_bytes([header[at], header[at + 1]]));
        if header[0] != KEY {
            return None;
        }
        let wants_answer = header[1] & WANTS_ANSWER != 0;
        let command = contents.get(..usize::from(length)).and_then(|contents| command(code, contents));
        let request = Self { command: command.clone().unwrap_or(Command::Other), code, id, wants_answer };
        Some(if command.is_some() { Ok(request) } else { Err(request.refuse(Refusal::INVALID_PARAMETER, &[])) })
    }

    /// The answer of a camera that did it.
    pub(super) fn answer(&self, contents: &[u8]) -> Vec<u8> {
        self.answered(0, contents)
    }

    /// The answer of one that did not, or not all of it.
    pub(super) fn refuse(&self, why: Refusal, contents: &[u8]) -> Vec<u8> {
        self.answered(why.0, contents)
    }

    fn answered(&self, status: u16, contents: &[u8]) -> Vec<u8> {
        let length = u16::try_from(contents.len()).unwrap_or(u16::MAX);
        let header = [status, self.code.wrapping_add(1), length, self.id];
        let mut answer: Vec<u8> = header.iter().flat_map(|word| word.to_be_bytes()).collect();
        answer.extend_from_slice(contents);
        answer
    }
}

/// What a code and its contents ask for; `None` where they do not fit together.
fn command(code: u16, contents: &[u8]) -> Option<Command> {
    let words: Vec<u32> = contents.as_chunks().0.iter().map(|bytes| u32::from_be_bytes(*bytes)).collect();
    let whole = contents.len().is_multiple_of(4);
    Some(match code {
        0x0002 => Command::Discovery,
        0x0040 => {
            let &[channel_and_block, first, last] = words.get(..3)?.as_array()?;
            // Packets are counted in 24 bits, blocks in the low half.
            let [first, last] = [first, last].map(|packet| packet & 0x00ff_ffff);
            Command::Resend { block: (channel_and_block & 0xffff) as u16, first, last }
        }
        0x0080 if whole && !words.is_empty() => Command::ReadRegisters(words),
        0x0082 if whole && words.len().is_multiple_of(2) && !words.is_empty() => {
            Command::WriteRegisters(words.as_chunks().0.iter().map(|&[at, value]| (at, value)).collect())
        }
        0x0084 => {
            let &[at, count] = words.get(..2)?.as_array()?;
            let count = (count & 0xffff) as usize;
            (1..=MOST_MEMORY).contains(&count).then_some(Command::ReadMemory { at, count })?
        }
        0x0086 if contents.len() > 4 => Command::WriteMemory { at: *words.first()?, bytes: contents[4..].to_vec() },
        0x0080 | 0x0082 | 0x0086 => return None,
        _ => Command::Other,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(code: u16, contents: &[u8]) -> Vec<u8> {
        let mut datagram = vec![KEY, WANTS_ANSWER];
        datagram.extend([code, contents.len() as u16, 7].iter().flat_map(|word| word.to_be_bytes()));
        datagram.extend_from_slice(contents);
        datagram
    }

    #[test]
    fn requests_are_read_and_answered_with_their_number() {
        let read = Request::read(&request(0x80, &[0, 0, 0x0a, 0])).unwrap().unwrap();
        assert_eq!(read.command, Command::ReadRegisters(vec![0x0a00]));
        assert_eq!(read.answer(&[1, 2, 3, 4]), [0, 0, 0, 0x81, 0, 4, 0, 7, 1, 2, 3, 4]);
        assert_eq!(read.refuse(Refusal::ACCESS_DENIED, &[]), [0x80, 6, 0, 0x81, 0, 0, 0, 7]);
        let resend = Request::read(&request(0x40, &[0, 0, 0x12, 0x34, 0, 0, 0, 2, 0, 0, 0, 9])).unwrap().unwrap();
        assert_eq!(resend.command, Command::Resend { block: 0x1234, first: 2, last: 9 });
        let memory = Request::read(&request(0x84, &[0, 1, 0, 0, 0, 0, 2, 0])).unwrap().unwrap();
        assert_eq!(memory.command, Command::ReadMemory { at: 0x1_0000, count: 512 });
    }

    #[test]
    fn what_does_not_fit_together_is_told_so_and_what_is_no_request_is_not_answered() {
        let refused = [0x80, 2, 0, 0x83, 0, 0, 0, 7];
        assert_eq!(Request::read(&request(0x82, &[0, 0, 0x0a, 0])), Some(Err(refused.to_vec())));
        // It says that more follows than does.
        let mut short = request(0x80, &[0, 0, 0x0a, 0]);
        short.truncate(10);
        assert!(matches!(Request::read(&short), Some(Err(_))));
        assert_eq!(Request::read(&[0x42, 1, 0]), None);
        assert_eq!(Request::read(&[0; 16]), None);
        assert!(matches!(Request::read(&request(0x84, &[0, 1, 0, 0, 0, 0, 0xff, 0])), Some(Err(_))));
    }
}
