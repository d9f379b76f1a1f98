//! Why a configuration is refused: every fault with its key and place.

use std::fmt;
use std::path::PathBuf;

use super::overrides::SET;

/// A place in a configuration file, counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Position {
    /// Line.
    pub line: usize,
    /// Column, in characters.
    pub column: usize,
}

impl Position {
    /// The place of a byte in a text.
    pub(super) fn of(text: &str, byte: usize) -> Self {
        let before = text.get(..byte).unwrap_or(text);
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        Self { line: before.matches('\n').count() + 1, column: before[line_start..].chars().count() + 1 }
    }
}

impl fmt::Display for Position {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}, column {}", self.line, self.column)
    }
}

/// One thing that is wrong with a configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct Violation {
    /// The key, dotted from the root: `shell.inner_radius_mm`.
    pub key: String,
    /// Where it stands in the file; absent for a default or an override.
    pub position: Option<Position>,
    /// What is wrong, and what would be right.
    pub message: String,
}

/// Ends the message of a fault of a value that `--set` gave.
pub(super) const FROM_SET: &str = " (from --set)";

impl Violation {
    /// Whether it is a value that `--set` gave, over a file, that is wrong.
    #[must_use]
    pub fn is_of_set(&self) -> bool {
        self.message.ends_with(FROM_SET)
    }
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(position) = self.position {
            write!(f, "{position}: ")?;
        }
        write!(f, "{}: {}", self.key, self.message)
    }
}

/// Why there is no configuration. Shown on one line.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("cannot read the configuration {path}", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is not TOML.
    #[error("{origin}: {position}: not valid TOML: {message}")]
    Syntax {
        /// Where the text came from.
        origin: String,
        /// Where in it.
        position: Position,
        /// What the parser said.
        message: String,
    },
    /// Keys that are unknown, values of the wrong type or physically impossible ones: all that were found.
    #[error("{origin}: {}", join(violations))]
    Invalid {
        /// Where the configuration came from.
        origin: String,
        /// What is wrong, in the order of the file; never empty.
        violations: Vec<Violation>,
    },
}

impl ConfigError {
    /// Whether it is the assignments of `--set` that are wrong, and no file.
    #[must_use]
    pub fn is_of_set(&self) -> bool {
        matches!(self, Self::Invalid { origin, .. } if origin == SET)
    }

    /// What is wrong key by key; empty for a file that cannot be read or parsed.
    #[must_use]
    pub fn violations(&self) -> &[Violation] {
        match self {
            Self::Invalid { violations, .. } => violations,
            Self::Read { .. } | Self::Syntax { .. } => &[],
        }
    }
}

fn join(violations: &[Violation]) -> String {
    violations.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_count_characters_from_one() {
        let text = "a = 1\nµ = 2\n";
        assert_eq!(Position::of(text, 0), Position { line: 1, column: 1 });
        assert_eq!(Position::of(text, text.find('2').unwrap()), Position { line: 2, column: 5 });
        assert_eq!(Position::of(text, text.len()), Position { line: 3, column: 1 });
    }
}
