//! Control leases as far as they are known from outside.

use std::time::Duration;

use tokio::time::Instant;

use super::exchange::Mark;
use super::requests::Who;

/// Within which a lease that runs out is noticed.
pub(super) const NOTICED: Duration = Duration::from_millis(100);

/// How a lease, or a command, ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Why {
    Stopped,
    Expired,
    Released,
    TakenOver,
    LetGo,
    Ended,
    Killed,
}

/// A control lease that was granted.
#[derive(Debug, Clone)]
pub(super) struct Lease {
    pub(super) id: String,
    pub(super) key: String,
    pub(super) owner: Who,
    pub(super) ttl: Duration,
    /// When it runs out, at the earliest and at the latest, unless something holds it.
    pub(super) until: (Instant, Instant),
    pub(super) job: Option<String>,
    pub(super) connections: usize,
    pub(super) given_back: bool,
    pub(super) over: Option<(Mark, Why)>,
    /// Whether it has been there over a restart: its end may have come meanwhile.
    pub(super) restored: bool,
}

impl Lease {
    /// Whether something holds it that needs no heartbeat.
    pub(super) const fn is_held(&self) -> bool {
        self.job.is_some() || self.connections > 0
    }

    /// Whether it is in force for certain.
    pub(super) fn surely_at(&self, at: Instant) -> bool {
        self.over.is_none() && !self.given_back && (self.is_held() || at < self.until.0)
    }

    /// Whether it may have been in force at some time from a moment on.
    pub(super) fn maybe_at(&self, from: Mark) -> bool {
        match self.over {
            Some((end, Why::Expired)) => from.at <= end.at + NOTICED,
            Some((end, _)) => from.index < end.index || from.at <= end.at,
            None => self.is_held() || from.at <= self.until.1,
        }
    }
}
