//! What is typed into a request's fields.

/// A field of a request that cannot be as it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Invalid {
    /// Its name.
    pub field: &'static str,
    /// What is wrong with it, and what would be right.
    pub what: String,
}

/// Most characters of an owner's name, of a note, and of why the stop is reset.
pub const MAX_TEXT: usize = 200;

/// Text that a person gives with a request: 1 to [`MAX_TEXT`] printable characters, none of which turns the direction of text.
///
/// # Errors
/// [`Invalid`] names the field.
pub fn words(field: &'static str, text: &str) -> Result<(), Invalid> {
    let unprintable = |c: char| c.is_control() || turns_text(c);
    if text.trim().is_empty() || text.chars().count() > MAX_TEXT || text.chars().any(unprintable) {
        let what =
            format!("1 to {MAX_TEXT} printable characters are needed, and no marks that turn the direction of text");
        return Err(Invalid { field, what });
    }
    Ok(())
}

/// Whether a character is not seen and has what stands around it, also figures of ours, run the other way or on another line.
pub const fn turns_text(c: char) -> bool {
    matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}
