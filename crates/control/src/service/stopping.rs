//! The stop beyond motion: kept over a restart, taken up again after it, and reset by a person who says why.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use tokio::time::Instant;

use super::Service;
use crate::events::StopReset;
use crate::field::words;
use crate::{Refusal, ServiceError, StopReport};

/// Longest that whoever stops, or gives control up, waits for the disk.
pub(super) const KEEP_ALLOWED: Duration = Duration::from_secs(1);

impl Service {
    /// Stops both axes at once, in every state, and latches. A job under way ends as cancelled. `by` is who stops; the
    /// latency reported counts from `asked`. The disk is waited for a moment at most.
    pub async fn stop(&self, asked: Instant, by: &str) -> StopReport {
        // The job of now: stopping takes a while, in which the stop may be reset and another job begin.
        let job = self.current();
        // Behind the latch and the orders, but not behind the axes' answers: the job could come to its end meanwhile, and
        // the program to its own.
        let cancelled = async { job.inspect(|job| job.cancel(format!("stopped by {by}"))) };
        let (report, _, kept) = tokio::join!(biased; self.motion.stop(asked, by), cancelled, self.kept_soon());
        self.publish_bench();
        StopReport { kept, ..report }
    }

    /// Allows motion again, once it is in the history who did so and why; nothing resumes by itself. Returns what was
    /// done; `None` where there was nothing to reset, or where somebody has stopped again meanwhile.
    ///
    /// # Errors
    /// [`ServiceError::Invalid`] names `owner` or `why` where they are not short and printable. [`Refusal::ResetNotKept`]
    /// where the history cannot be written: the stop stays latched.
    pub async fn reset_stop(&self, by: &str, why: &str) -> Result<Option<StopReset>, ServiceError> {
        words("owner", by)?;
        words("why", why)?;
        let recalled = self.recalling.lock().await;
        let Some(reset) = self.motion.reset_of(by, why) else { return Ok(None) };
        let made = reset.made.clone();
        // The disk may take its time, and what is stopped meanwhile is not to be found reset there.
        let (motion, turns, view) = (Arc::clone(&self.motion), reset.turns(), reset.view());
        let written = self.journal.write_stop(move || (motion.turns() == turns).then_some(view)).await;
        let done = written.is_ok() && self.motion.reset_stop(reset);
        if done {
            self.forget_stopped();
        }
        // Behind what was written, and behind what a stop had to write meanwhile: the latch as it is.
        self.kept_soon().await;
        drop(recalled);
        self.publish_bench();
        written.map_err(|error| Refusal::ResetNotKept { why: error.to_string() })?;
        Ok(done.then_some(made))
    }

    /// Has the history keep the latch as it is when its turn comes. Returns whether it is on the disk.
    pub(super) async fn keep_stop(&self) -> bool {
        if self.motion.is_stop_unread() {
            return false;
        }
        let (motion, turns) = (Arc::clone(&self.motion), self.motion.turns());
        let written = self.journal.write_stop(move || Some(motion.stop_to_keep())).await;
        match &written {
            Ok(()) => drop(self.kept_turns.fetch_max(turns, Ordering::SeqCst)),
            Err(error) => tracing::error!(%error, "the stop's latch is not on the disk yet"),
        }
        written.is_ok()
    }

    /// Keeps the latch, and waits for the disk a moment at most: where it takes longer, it goes on.
    async fn kept_soon(&self) -> bool {
        tokio::time::timeout(KEEP_ALLOWED, self.keep_stop()).await.unwrap_or(false)
    }

    /// Whether the latch as it is has yet to come to the disk.
    pub(super) fn is_stop_unkept(&self) -> bool {
        self.kept_turns.load(Ordering::SeqCst) < self.motion.turns()
    }

    /// Takes up the stop of an earlier run, where that has not been done. What cannot be read stays unknown, which
    /// counts as latched. The caller has `recalling` locked.
    pub(super) async fn recall_stop(&self) {
        if !self.motion.is_stop_unread() {
            return;
        }
        match self.journal.kept_stop().await {
            Ok(kept) => {
                if let Some(stop) = kept.as_ref().filter(|stop| stop.latched) {
                    tracing::warn!(since = ?stop.since, "the stop of an earlier run is still latched");
                }
                self.motion.recall_stop(kept);
            }
            Err(why) => {
                tracing::error!(
                    why,
                    "whether an earlier run left the stop latched cannot be read: it counts as latched"
                );
                self.motion.stop_unread(why);
            }
        }
        self.publish_bench();
    }
}
