//! Who did what.

use std::net::IpAddr;

use jiff::Timestamp;
use serde_json::Value;

use super::principal::Principal;

/// One thing that somebody did, for the audit log.
#[derive(Debug, Clone, PartialEq)]
pub struct AuditRecord {
    /// When.
    pub at: Timestamp,
    /// Name of whoever did it.
    pub who: String,
    /// What, in a word such as `token.create`.
    pub what: &'static str,
    /// The particulars. Never a secret.
    pub detail: Value,
    /// Where they did it from.
    pub from: Option<IpAddr>,
}

impl AuditRecord {
    /// What a principal has done just now.
    #[must_use]
    pub fn of(principal: &Principal, what: &'static str, detail: Value) -> Self {
        Self { at: Timestamp::now(), who: principal.name.clone(), what, detail, from: Some(principal.address) }
    }
}

/// Where records go.
pub trait AuditSink: Send + Sync {
    /// Takes a record. Must not block.
    fn record(&self, record: AuditRecord);
}

/// Into the program's log, under the target `plenalign::audit`.
#[derive(Debug, Clone, Copy, Default)]
pub struct LogAudit;

impl AuditSink for LogAudit {
    fn record(&self, record: AuditRecord) {
        let AuditRecord { who, what, detail, from, .. } = record;
        tracing::info!(target: "plenalign::audit", %who, what, %detail, from = from.map(tracing::field::display));
    }
}
