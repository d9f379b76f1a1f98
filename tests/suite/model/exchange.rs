//! A request with its answer, and when it was.

use tokio::time::Instant;

use super::requests::{Answer, Ask, Who};

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
    pub(super) key: Option<String>,
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
    /// The job that it names was this one's, and that job's lease was this.
    pub(super) key_of_job: Option<String>,
}

/// An exchange in words.
pub(super) fn told(exchange: &Exchange) -> String {
    let Exchange { who, ask, key, answer, .. } = exchange;
    let text: String = answer.text.chars().take(200).collect();
    format!("{who:?} asked {ask:?} with key {key:?} and was answered {} {text}", answer.status)
}
