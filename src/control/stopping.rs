//! The stop beyond motion: kept over a restart, taken up again after it, and reset by a person who says why.

use std::sync::{Arc, PoisonError};

use tokio::time::Instant;

use super::events::StopReset;
use super::lease::words;
use super::service::Service;
use super::{Refusal, ServiceError, StopReport};

impl Service {
    /// Stops both axes at once, in every state, and latches. A job under way ends as cancelled. `by` is who stops; the
    /// latency reported counts from `asked`.
    pub async fn stop(&self, asked: Instant, by: &str) -> StopReport {
        // The job of now: stopping takes a while, in which the stop may be reset and another job begin.
        let job = self.current();
        // The job behind the latch and the orders, but not behind the axes' answers: it could come to its end meanwhile.
        let cancelled = async { job.inspect(|job| job.cancel("stopped".to_owned())) };
        let (report, _) = tokio::join!(biased; self.motion.stop(asked, by), cancelled);
        // After the axes: the disk may be slow, and is not waited for.
        self.keep_stop();
        self.publish_bench();
        report
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
        let (motion, turns) = (Arc::clone(&self.motion), reset.turns());
        let written = self.journal.write_stop(reset.view(), move || motion.turns() == turns).await;
        let done = written.is_ok() && self.motion.reset_stop(reset);
        // Behind what was written: the latch as it is.
        self.keep_stop();
        drop(recalled);
        self.publish_bench();
        written.map_err(|error| Refusal::ResetNotKept { why: error.to_string() })?;
        Ok(done.then_some(made))
    }

    /// Has the history keep the latch as it is, without waiting. Where it takes nothing now, that is tried again.
    pub(super) fn keep_stop(&self) {
        // One at a time, so that the last to be written is the newest.
        let mut untaken = self.untaken.lock().unwrap_or_else(PoisonError::into_inner);
        if !self.motion.is_stop_unread() {
            *untaken = !self.journal.put_stop(&self.motion.stop_view());
        }
    }

    /// Whether the history has yet to take the latch as it is.
    pub(super) fn is_stop_untaken(&self) -> bool {
        *self.untaken.lock().unwrap_or_else(PoisonError::into_inner)
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
