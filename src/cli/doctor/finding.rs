//! One thing that was looked at: how it is, and what to type where it is not as it should be.

use serde::Serialize;

/// How bad a finding is, the harmless first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Level {
    /// As it should be.
    Ok,
    /// Worth knowing; nothing need be done.
    Note,
    /// The bench works, and something is going to be in the way.
    Warning,
    /// The bench does not work, or would not start.
    Problem,
}

impl Level {
    /// The word for it, as in the JSON object.
    pub(super) const fn word(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Note => "note",
            Self::Warning => "warning",
            Self::Problem => "problem",
        }
    }
}

/// One finding.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(super) struct Finding {
    /// What was looked at: stable from version to version. Several things of one kind share it.
    pub(super) id: &'static str,
    /// How bad it is.
    pub(super) level: Level,
    /// The thing itself, such as a port or a key of the configuration.
    pub(super) what: String,
    /// How it is.
    pub(super) detail: String,
    /// What to type, or to write, to mend it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) mend: Option<String>,
}

impl Finding {
    /// Something that is as it should be.
    pub(super) fn ok(id: &'static str, what: impl Into<String>, detail: impl Into<String>) -> Self {
        Self::new(id, Level::Ok, what, detail)
    }

    /// Something worth knowing.
    pub(super) fn note(id: &'static str, what: impl Into<String>, detail: impl Into<String>) -> Self {
        Self::new(id, Level::Note, what, detail)
    }

    /// Something that is going to be in the way; `mend` says what to type.
    pub(super) fn warning(
        id: &'static str,
        what: impl Into<String>,
        detail: impl Into<String>,
        mend: impl Into<String>,
    ) -> Self {
        Self::new(id, Level::Warning, what, detail).mend(mend)
    }

    /// Something that keeps the bench from working; `mend` says what to type.
    pub(super) fn problem(
        id: &'static str,
        what: impl Into<String>,
        detail: impl Into<String>,
        mend: impl Into<String>,
    ) -> Self {
        Self::new(id, Level::Problem, what, detail).mend(mend)
    }

    fn new(id: &'static str, level: Level, what: impl Into<String>, detail: impl Into<String>) -> Self {
        Self { id, level, what: what.into(), detail: detail.into(), mend: None }
    }

    /// The same with what to type.
    pub(super) fn mend(self, mend: impl Into<String>) -> Self {
        Self { mend: Some(mend.into()), ..self }
    }
}
