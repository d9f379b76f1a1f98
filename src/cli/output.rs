//! Standard output and standard error, where somebody may have closed them, or the disk may be full.

use std::fmt::Arguments;
use std::io::{self, ErrorKind, Write as _};
use std::sync::OnceLock;

/// Why something was not written that somebody may have waited for.
static LOST: OnceLock<String> = OnceLock::new();

// The standard library's end the thread where a text cannot be written. Here the program goes on, and says so at its end.
macro_rules! print {
    ($($text:tt)*) => { $crate::cli::output::said(format_args!($($text)*)) };
}
macro_rules! println {
    () => { $crate::cli::output::said(format_args!("\n")) };
    ($($text:tt)*) => { $crate::cli::output::said(format_args!("{}\n", format_args!($($text)*))) };
}
macro_rules! eprintln {
    ($($text:tt)*) => { $crate::cli::output::told(format_args!("{}\n", format_args!($($text)*))) };
}

/// Writes to standard output; why it could not be done is kept for [`lost`].
pub(super) fn said(text: Arguments<'_>) {
    if let Err(error) = put_if_read(&text.to_string()) {
        let _ = LOST.set(error.to_string());
    }
}

/// Writes to standard error, as far as that can be done.
pub(super) fn told(text: Arguments<'_>) {
    if cfg!(test) {
        // Where a test's own output goes.
        return std::eprint!("{text}");
    }
    let _ = io::stderr().write_all(text.to_string().as_bytes());
}

/// Why something could not be written to standard output though nobody had closed it.
pub(super) fn lost() -> Option<&'static str> {
    LOST.get().map(String::as_str)
}

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
