//! A request with its answer, and when it was.

use tokio::time::Instant;

use super::requests::{Answer, Ask, Shown, Who};

/// A moment: how much had been seen below the daemon, and when it was.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mark {
    pub(super) index: usize,
    pub(super) at: Instant,
}

/// A request with its answer.
#[derive(Debug, Clone)]
pub(super) struct Exchange {
    pub(super) who: Who,
    pub(super) ask: Ask,
    pub(super) shown: Shown,
    pub(super) sent: Mark,
    pub(super) answered: Mark,
    pub(super) answer: Answer,
    /// Whether nothing else was asked at the same time.
    pub(super) alone: bool,
    /// Whether the stop was latched for certain when it was sent.
    pub(super) while_latched: bool,
    /// Whether the history could not be written when it was sent.
    pub(super) while_unwritable: bool,
    /// Whether a jog of its axis was or may have been under way.
    pub(super) while_jogging: bool,
    /// What is shown of the job that it names.
    pub(super) of_job: OfJob,
    /// Whether the press that it names was over for certain.
    pub(super) press_over: bool,
}

/// What a request shows of the job that it names, as it was known when it was sent.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct OfJob {
    /// The key of the lease that the job was started with.
    pub(super) lease: bool,
    /// The job's confirm key: the newest, of a job that had not been seen to have ended.
    pub(super) confirm: bool,
    /// A confirm key of the job's that another has replaced.
    pub(super) replaced: bool,
    /// The job had been seen to have ended.
    pub(super) ended: bool,
}

/// An exchange in words.
pub(super) fn told(exchange: &Exchange) -> String {
    let Exchange { who, ask, shown, answer, .. } = exchange;
    let text: String = answer.text.chars().take(200).collect();
    format!("{who:?} asked {ask:?} with {shown:?} and was answered {} {text}", answer.status)
}
