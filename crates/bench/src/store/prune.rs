//! Deleting what is not to be kept any longer, a little at a time: nothing that is about to move waits for it for long.

use jiff::Timestamp;
use rusqlite::{Connection, Result, params};
use uuid::Uuid;

use super::write::{Writer, ticks, uuid};

/// Jobs that are deleted in one transaction.
const JOBS: i64 = 4;
/// Other rows that are deleted in one transaction.
const ROWS: i64 = 500;
/// Free pages that are given back to the disk in one transaction.
const PAGES: i64 = 512;
/// Tables whose rows belong to a job.
pub(super) const OF_JOB: [&str; 6] = ["iterations", "measurements", "log", "operator_steps", "pictures", "moves"];

/// What is not to be kept any longer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Jobs that ended before this, and moves and measurements by hand before it.
    pub before: Option<Timestamp>,
    /// The oldest of these, while the file holds more than so many bytes.
    pub most_bytes: Option<u64>,
    /// But by the size none that is not older than this.
    pub young: Timestamp,
    /// Entries of the audit log before this.
    pub audit_before: Option<Timestamp>,
    /// The run under way, which stays though it has done nothing yet.
    pub run: Uuid,
}

/// What was deleted in one transaction.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Deleted {
    /// Jobs.
    pub jobs: Vec<Uuid>,
    /// Moves and measurements by hand.
    pub by_hand: usize,
    /// Entries of the audit log.
    pub audit: usize,
    /// Whether there may be more to do.
    pub more: bool,
}

impl Writer<'_> {
    /// Deletes some of what is not to be kept any longer, the oldest first. A job without an end stays.
    pub fn prune(&self, limits: &Limits) -> Result<Deleted> {
        let mut deleted = Deleted::default();
        if let Some(before) = limits.audit_before {
            let sql = "DELETE FROM audit WHERE id IN (SELECT id FROM audit WHERE at < ? ORDER BY id LIMIT ?)";
            deleted.audit = self.connection().execute(sql, params![ticks(before), ROWS])?;
        }
        if let Some(before) = limits.before {
            self.prune_before(before, &mut deleted)?;
        }
        if let Some(most) = limits.most_bytes
            && held_bytes(self.connection())? > most
        {
            // A job at a time with what was done by hand before its end, so that no more goes than has to.
            let sql = "SELECT min(ended_at) FROM jobs WHERE ended_at < ?";
            let young = ticks(limits.young);
            let oldest: Option<i64> = self.connection().query_row(sql, [young], |row| row.get(0))?;
            let by_hand = "SELECT min(at) FROM (SELECT min(at) AS at FROM measurements WHERE job IS NULL
                           UNION ALL SELECT min(started_at) FROM moves WHERE job IS NULL AND outcome IS NOT NULL)";
            let first: Option<i64> = self.connection().query_row(by_hand, [], |row| row.get(0))?;
            let until = match (oldest, first) {
                (Some(ended), _) => Some(ended.saturating_add(1)),
                (None, Some(first)) if first < young => Some(young),
                _ => None,
            };
            let until = until.and_then(|until| Timestamp::from_nanosecond(until.into()).ok());
            if let Some(until) = until {
                self.prune_before(until, &mut deleted)?;
            }
        }
        deleted.more = !deleted.jobs.is_empty() || deleted.by_hand > 0 || deleted.audit > 0;
        if !deleted.more {
            self.prune_runs(limits)?;
            deleted.more = give_back(self.connection())?;
        }
        Ok(deleted)
    }

    fn prune_before(&self, before: Timestamp, deleted: &mut Deleted) -> Result<()> {
        let sql = "SELECT id FROM jobs WHERE ended_at < ? ORDER BY ended_at LIMIT ?";
        let mut statement = self.connection().prepare_cached(sql)?;
        let jobs =
            statement.query_map(params![ticks(before), JOBS], |row| uuid(row, 0))?.collect::<Result<Vec<_>>>()?;
        for job in jobs {
            self.forget_job(job)?;
            deleted.jobs.push(job);
        }
        for (table, at, ended) in [("measurements", "at", "1"), ("moves", "started_at", "outcome IS NOT NULL")] {
            let sql = format!(
                "DELETE FROM {table} WHERE id IN
                 (SELECT id FROM {table} WHERE job IS NULL AND {at} < ? AND {ended} ORDER BY id LIMIT ?)"
            );
            deleted.by_hand += self.connection().execute(&sql, params![ticks(before), ROWS])?;
        }
        Ok(())
    }

    /// Deletes the runs of which nothing is left, and the configurations that only they had.
    fn prune_runs(&self, limits: &Limits) -> Result<()> {
        let Some(before) = limits.before.or(limits.most_bytes.map(|_| limits.young)) else { return Ok(()) };
        let run = super::write::text(limits.run);
        let sql = "DELETE FROM runs WHERE id <> ? AND started_at < ?
                   AND id NOT IN (SELECT run FROM jobs) AND id NOT IN (SELECT run FROM moves)";
        self.connection().execute(sql, params![run, ticks(before)])?;
        let sql = "DELETE FROM configurations WHERE hash NOT IN (SELECT configuration FROM runs)";
        self.connection().execute(sql, [])?;
        Ok(())
    }
}

/// What the file's records take, bytes: without the room that deleted ones have left.
fn held_bytes(connection: &Connection) -> Result<u64> {
    let number = |name: &str| connection.pragma_query_value(None, name, |row| row.get::<_, i64>(0));
    let pages = number("page_count")?.saturating_sub(number("freelist_count")?);
    Ok(pages.saturating_mul(number("page_size")?).unsigned_abs())
}

/// Gives some of the room that deleted records have left back to the disk; whether there is more.
fn give_back(connection: &Connection) -> Result<bool> {
    let number = |name: &str| connection.pragma_query_value(None, name, |row| row.get::<_, i64>(0));
    // A file that was never made able to shrink keeps its room for what is to come.
    if number("auto_vacuum")? == 0 || number("freelist_count")? == 0 {
        return Ok(false);
    }
    // A row a page: it is done only when all have been asked for.
    let mut statement = connection.prepare(&format!("PRAGMA incremental_vacuum({PAGES})"))?;
    let mut rows = statement.query([])?;
    while rows.next()?.is_some() {}
    Ok(number("freelist_count")? > 0)
}
