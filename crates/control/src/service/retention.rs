//! How long the history keeps what: looked after once an hour, a little at a time.

use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use serde_json::json;

use super::Service;
use bench::store::records::Audit;
use bench::store::{Deleted, Limits};

/// Between two looks.
const LOOK: Duration = Duration::from_hours(1);
/// Between two transactions, so that what is about to move comes first.
const REST: Duration = Duration::from_millis(20);
/// What is not older stays whatever the file's size: for so long a request's own name stands for its job.
const YOUNG: SignedDuration = SignedDuration::from_hours(24);

impl Service {
    /// Deletes what is not to be kept any longer, now and once an hour; ends at once where everything is kept.
    pub(super) async fn watch_retention(&self) {
        if !self.config.history.deletes() {
            return;
        }
        loop {
            match self.prune().await {
                Ok(deleted) => self.tell_deleted(&deleted),
                Err(why) => tracing::warn!(why, "what is not to be kept any longer stays in the history for now"),
            }
            tokio::time::sleep(LOOK).await;
        }
    }

    async fn prune(&self) -> Result<Deleted, String> {
        let mut all = Deleted::default();
        // First the run, without which nothing is known to be another's.
        self.history_ready().await.map_err(|error| error.to_string())?;
        loop {
            let limits = self.limits();
            let deleted = self.journal.store().write(move |writer| writer.prune(&limits)).await;
            let deleted = deleted.map_err(|error| error.to_string())?;
            // Those of this run are in memory, too.
            self.all_jobs().retain(|job| !deleted.jobs.contains(&job.snapshot().id));
            all.jobs.extend(deleted.jobs);
            all.by_hand += deleted.by_hand;
            all.audit += deleted.audit;
            if !deleted.more {
                return Ok(all);
            }
            tokio::time::sleep(REST).await;
        }
    }

    fn limits(&self) -> Limits {
        let now = Timestamp::now();
        let ago =
            |days: u32| now.saturating_sub(SignedDuration::from_hours(24 * i64::from(days))).unwrap_or(Timestamp::MIN);
        let keep = &self.config.history;
        Limits {
            before: keep.keep_days.map(ago),
            most_bytes: keep.keep_mb.map(|megabytes| u64::from(megabytes) << 20),
            young: now.saturating_sub(YOUNG).unwrap_or(Timestamp::MIN),
            audit_before: keep.keep_audit_days.map(ago),
            run: self.journal.run(),
        }
    }

    fn tell_deleted(&self, deleted: &Deleted) {
        let Deleted { jobs, by_hand, audit, .. } = deleted;
        if jobs.is_empty() && *by_hand == 0 && *audit == 0 {
            return;
        }
        tracing::info!(jobs = jobs.len(), by_hand, audit, "deleted from the history as [history] has it");
        self.journal.audit(Audit {
            at: Timestamp::now(),
            who: bench::access::PROGRAM.to_owned(),
            what: "retention.delete".to_owned(),
            detail: json!({ "jobs": jobs.len(), "by_hand": by_hand, "audit": audit }),
            from: None,
        });
    }
}
