//! Lines out of a stream of bytes.

/// Longest line taken; anything longer is noise and dropped up to the next line end.
const LONGEST_LINE: usize = 512;

/// Cuts a stream of bytes into lines, whatever the fragments it comes in.
#[derive(Debug, Default)]
pub struct LineBuffer {
    line: Vec<u8>,
    overlong: bool,
}

impl LineBuffer {
    /// Takes bytes and returns the lines they complete, without line ends and blank lines. A line longer than the
    /// bound is dropped whole; bytes that are not text become U+FFFD.
    pub fn push(&mut self, bytes: &[u8]) -> Vec<String> {
        let mut lines = Vec::new();
        for &byte in bytes {
            if byte == b'\n' || byte == b'\r' {
                if !self.overlong && !self.line.is_empty() {
                    lines.push(String::from_utf8_lossy(&self.line).into_owned());
                }
                self.line.clear();
                self.overlong = false;
            } else if self.line.len() < LONGEST_LINE {
                self.line.push(byte);
            } else {
                self.overlong = true;
            }
        }
        lines
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn lines_do_not_depend_on_fragments(bytes in proptest::collection::vec(any::<u8>(), 0..2000), cut in 1usize..50) {
            let whole = LineBuffer::default().push(&bytes);
            let mut buffer = LineBuffer::default();
            let pieces: Vec<String> = bytes.chunks(cut).flat_map(|piece| buffer.push(piece)).collect();
            prop_assert_eq!(&whole, &pieces);
            prop_assert!(whole.iter().all(|line| !line.is_empty() && line.chars().count() <= LONGEST_LINE));
        }

        #[test]
        fn noise_costs_at_most_the_line_it_is_in(noise in proptest::collection::vec(any::<u8>(), 0..2000)) {
            let mut buffer = LineBuffer::default();
            buffer.push(&noise);
            buffer.push(b"\r\n");
            prop_assert_eq!(buffer.push(b"ok\r\n"), vec!["ok".to_owned()]);
        }
    }
}
