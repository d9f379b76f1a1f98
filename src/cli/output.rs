//! Standard output, where somebody may have closed it.

use std::io::{self, ErrorKind, Write as _};

/// Writes a text as it is.
///
/// # Errors
/// When it cannot be written, [`ErrorKind::BrokenPipe`] where nobody reads it any more.
pub(super) fn put(text: &str) -> io::Result<()> {
    let mut out = io::stdout();
    out.write_all(text.as_bytes())?;
    out.flush()
}

/// The same, and no error where nobody reads it any more: whoever has closed it has seen enough.
///
/// # Errors
/// When it cannot be written.
pub(super) fn put_if_read(text: &str) -> io::Result<()> {
    match put(text) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        written => written,
    }
}
