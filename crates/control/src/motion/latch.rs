//! The stop's latch: who stopped, who reset it and why, and what is not known of an earlier run's.

use std::sync::atomic::Ordering;

use jiff::Timestamp;

use super::Motion;
use crate::events::{StopDeliveries, StopReset, StopView};
use bench::access::PROGRAM;

/// What is known of the latch beside whether it is set.
#[derive(Debug, Default)]
pub(super) struct Latch {
    since: Option<Timestamp>,
    by: Option<String>,
    delivery: Option<StopDeliveries>,
    unread: Option<String>,
    reset: Option<StopReset>,
    /// Counts stops and resets: what was asked for before one of them does not begin after it, and a reset is of the
    /// stops before it.
    turns: u64,
}

impl Latch {
    /// Of a bench whose history has not been read yet.
    pub(super) fn unread() -> Self {
        Self { unread: Some("the history has not been read yet".to_owned()), ..Self::default() }
    }
}

/// A reset that is asked for and not yet in force.
#[derive(Debug)]
pub(crate) struct Reset {
    /// What is to be said of it.
    pub(crate) made: StopReset,
    turns: u64,
}

impl Reset {
    /// How often the bench had been stopped, or a stop reset, when it was asked for.
    pub(crate) const fn turns(&self) -> u64 {
        self.turns
    }

    /// The latch as it is once the reset is in force.
    pub(crate) fn view(&self) -> StopView {
        StopView { latched: false, since: None, by: None, delivery: None, unread: None, reset: Some(self.made.clone()) }
    }
}

impl Motion {
    /// The stop's latch.
    #[must_use]
    pub fn stop_view(&self) -> StopView {
        let state = self.state();
        let Latch { since, by, delivery, unread, reset, .. } = &state.latch;
        StopView {
            latched: self.stopped.load(Ordering::SeqCst),
            since: *since,
            by: by.clone(),
            delivery: *delivery,
            unread: unread.clone(),
            reset: reset.clone(),
        }
    }

    /// How often the bench has been stopped or a stop was reset: what was asked for before is not to begin, or to go on,
    /// after it.
    #[must_use]
    pub fn turns(&self) -> u64 {
        self.state().latch.turns
    }

    /// The latch as it is to be kept beyond this run. The program's own end latches, too, and that is nobody's stop.
    pub(crate) fn stop_to_keep(&self) -> StopView {
        // What became of it says nothing of the axes in another run.
        let view = StopView { delivery: None, ..self.stop_view() };
        if view.by.as_deref() == Some(PROGRAM) {
            return StopView { latched: false, since: None, by: None, ..view };
        }
        view
    }

    /// Latches for somebody who stops; whoever did so first is kept, but for the program that ends.
    pub(super) fn latch(&self, by: &str) {
        let mut state = self.state();
        let latch = &mut state.latch;
        latch.turns += 1;
        if latch.since.is_none() || latch.by.as_deref() == Some(PROGRAM) {
            latch.since = Some(Timestamp::now());
            latch.by = Some(by.to_owned());
            latch.unread = None;
        }
        self.stopped.store(true, Ordering::SeqCst);
    }

    /// Notes what became of a stop, unless it has been reset meanwhile.
    pub(super) fn delivered(&self, delivery: StopDeliveries) {
        let mut state = self.state();
        if state.latch.since.is_some() {
            state.latch.delivery = Some(delivery);
        }
    }

    /// Says why it is not known how an earlier run left it, where it is not known.
    pub(crate) fn stop_unread(&self, why: String) {
        let mut state = self.state();
        if state.latch.unread.is_some() {
            state.latch.unread = Some(why);
        }
    }

    /// Whether it is not known how an earlier run left it.
    pub(crate) fn is_stop_unread(&self) -> bool {
        self.state().latch.unread.is_some()
    }

    /// Takes up what an earlier run has left, unless the bench was stopped or the stop reset meanwhile.
    pub(crate) fn recall_stop(&self, kept: Option<StopView>) {
        let mut state = self.state();
        let latch = &mut state.latch;
        if latch.unread.take().is_none() {
            return;
        }
        if let Some(StopView { since, by, reset, .. }) = &kept {
            (latch.since, latch.by, latch.reset) = (*since, by.clone(), reset.clone());
        }
        self.stopped.store(kept.is_some_and(|stop| stop.latched), Ordering::SeqCst);
    }

    /// What a reset would be of; `None` where there is nothing to reset.
    pub(crate) fn reset_of(&self, by: &str, why: &str) -> Option<Reset> {
        let state = self.state();
        let Latch { since, by: stopped_by, turns, .. } = &state.latch;
        self.stopped.load(Ordering::SeqCst).then(|| Reset {
            made: StopReset {
                at: Timestamp::now(),
                by: by.to_owned(),
                why: why.to_owned(),
                stopped_at: *since,
                stopped_by: stopped_by.clone(),
            },
            turns: *turns,
        })
    }

    /// Allows motion again, unless the bench was stopped once more since the reset was asked for. Nothing resumes by
    /// itself. Returns whether it is allowed.
    pub(crate) fn reset_stop(&self, reset: Reset) -> bool {
        let mut state = self.state();
        let latch = &mut state.latch;
        if latch.turns != reset.turns {
            return false;
        }
        latch.turns += 1;
        (latch.since, latch.by, latch.delivery, latch.unread, latch.reset) = (None, None, None, None, Some(reset.made));
        self.stopped.store(false, Ordering::SeqCst);
        true
    }
}
