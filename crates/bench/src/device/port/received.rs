//! What comes in over a port, before anything is made of it: what is no message is no notice either, and yet it tells of the
//! line.

/// How many bytes are kept: enough to show, and to judge by.
const KEPT: usize = 256;

/// The bytes that have come in over a port: how many, and the latest of them.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Received {
    /// How many.
    pub count: u64,
    latest: Vec<u8>,
}

impl Received {
    pub(super) fn note(&mut self, bytes: &[u8]) {
        self.count += bytes.len() as u64;
        self.latest.extend(bytes);
        self.latest.drain(..self.latest.len().saturating_sub(KEPT));
    }

    /// The latest bytes.
    #[must_use]
    pub fn latest(&self) -> &[u8] {
        &self.latest
    }

    /// Whether they are text: some noise among it is one line's, and not that of a wrong baud rate.
    #[must_use]
    pub fn is_text(&self) -> bool {
        let readable = |byte: &&u8| matches!(byte, b'\t' | b'\r' | b'\n' | b' '..=b'~');
        self.latest.iter().filter(readable).count() * 5 >= self.latest.len() * 4
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_latest_bytes_are_kept_and_all_are_counted() {
        let mut received = Received::default();
        received.note(&[0xff; 300]);
        assert!((received.count, received.latest().len()) == (300, KEPT) && !received.is_text());
        received.note(&[b'a'; 240]);
        assert!((received.count, received.latest().len()) == (540, KEPT) && received.is_text());
    }
}
