//! `[history]`: how long what is kept.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::Faults;

/// Most days that can be asked for, a hundred years.
const MOST_DAYS: u32 = 36_500;

/// `[history]`
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct HistoryConfig {
    /// Days that jobs are kept after their end, and moves and measurements by hand; without it, for ever.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keep_days: Option<u32>,
    /// What the file may grow to before the oldest jobs, moves and measurements are deleted, MB; without it, to any size.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keep_mb: Option<u32>,
    /// Days that entries of the audit log are kept; without it, for ever.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub keep_audit_days: Option<u32>,
}

impl HistoryConfig {
    /// Whether anything is ever deleted.
    #[must_use]
    pub const fn deletes(&self) -> bool {
        self.keep_days.is_some() || self.keep_mb.is_some() || self.keep_audit_days.is_some()
    }

    pub(super) fn check(&self, faults: &mut Faults) {
        for (key, days) in [("history.keep_days", self.keep_days), ("history.keep_audit_days", self.keep_audit_days)] {
            faults.require(days.is_none_or(|days| (1..=MOST_DAYS).contains(&days)), key, || {
                format!("must be 1 to {MOST_DAYS}; leave it out to keep everything")
            });
        }
        faults.require(self.keep_mb != Some(0), "history.keep_mb", || {
            "must be 1 or more; leave it out to keep everything".to_owned()
        });
    }
}
