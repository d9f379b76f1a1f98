//! Whether the history can be written, and why not.

use std::path::Path;
use std::time::Duration;

use rusqlite::ErrorCode;

/// Whether the history can be written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Health {
    /// Not tried yet.
    Opening,
    /// It can.
    Writable {
        /// How often the file has been opened: another number than before means that it may be another file.
        opened: u64,
    },
    /// It cannot.
    Unwritable {
        /// Why, in words.
        why: String,
    },
}

impl Health {
    /// Why it cannot be written; `None` while it can, or has not been tried.
    #[must_use]
    pub fn fault(&self) -> Option<&str> {
        match self {
            Self::Unwritable { why } => Some(why),
            Self::Opening | Self::Writable { .. } => None,
        }
    }
}

/// Why a command was not carried out.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StoreError {
    /// The file cannot be written, or read.
    #[error("{0}")]
    Unusable(String),
    /// The disk was too slow.
    #[error("the history was not on the disk within {0:?}")]
    Late(Duration),
    /// A record does not fit the file: a mistake of the program's.
    #[error("the history refuses a record: {0}")]
    Refused(String),
    /// The history's thread has ended.
    #[error("the history has been closed")]
    Ended,
}

impl From<rusqlite::Error> for StoreError {
    fn from(error: rusqlite::Error) -> Self {
        match error.sqlite_error_code() {
            Some(
                ErrorCode::DiskFull
                | ErrorCode::ReadOnly
                | ErrorCode::SystemIoFailure
                | ErrorCode::CannotOpen
                | ErrorCode::PermissionDenied
                | ErrorCode::DatabaseCorrupt
                | ErrorCode::NotADatabase
                | ErrorCode::DatabaseBusy
                | ErrorCode::DatabaseLocked
                | ErrorCode::FileLockingProtocolFailed
                | ErrorCode::NoLargeFileSupport,
            ) => Self::Unusable(error.to_string()),
            _ => Self::Refused(error.to_string()),
        }
    }
}

impl StoreError {
    /// The same with the file's name, for whoever has to mend it.
    pub(super) fn of(self, file: &Path) -> Self {
        match self {
            Self::Unusable(why) => Self::Unusable(format!("{}: {why}", file.display())),
            other => other,
        }
    }
}
