//! Commands that write, each within a transaction.

use jiff::Timestamp;
use rusqlite::{Connection, Result, named_params, params};
use serde_json::Value;
use sha2::{Digest as _, Sha256};
use uuid::Uuid;

use super::bench::BenchName;
use super::prune::OF_JOB;
use super::records::{Audit, Entry, Job, Kept, Line, Move, OperatorStep, Picture, Run};

/// The connection that writes, within a transaction.
pub struct Writer<'a> {
    connection: &'a Connection,
    opened: u64,
}

/// What earlier runs had left open.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Interrupted {
    /// The jobs.
    pub jobs: Vec<Uuid>,
    /// How many moves.
    pub moves: usize,
}

impl<'a> Writer<'a> {
    pub(super) const fn new(connection: &'a Connection, opened: u64) -> Self {
        Self { connection, opened }
    }

    /// How often the file has been opened: another number than before means that it may be another file.
    #[must_use]
    pub const fn opened(&self) -> u64 {
        self.opened
    }

    pub(super) const fn connection(&self) -> &Connection {
        self.connection
    }

    fn run(&self, sql: &str, parameters: impl rusqlite::Params) -> Result<usize> {
        self.connection.prepare_cached(sql)?.execute(parameters)
    }

    /// Begins a run, or has it again in a file made anew.
    pub fn begin_run(&self, run: &Run) -> Result<()> {
        let hash = hash(&run.configuration);
        self.run("INSERT OR IGNORE INTO configurations VALUES (?, ?)", params![hash, run.configuration])?;
        self.run(
            "INSERT OR IGNORE INTO runs (id, bench, version, configuration, started_at) VALUES (?, ?, ?, ?, ?)",
            params![text(run.id), run.bench, run.version, hash, ticks(run.started_at)],
        )?;
        Ok(())
    }

    /// Ends a run in good order.
    pub fn end_run(&self, run: Uuid, at: Timestamp) -> Result<()> {
        self.run("UPDATE runs SET ended_at = ? WHERE id = ?", params![ticks(at), text(run)])?;
        Ok(())
    }

    /// Ends what earlier runs on the same bench have left open: they can have it no more. `state` is the word for a job
    /// that its program's end cut short, and the outcome of a motion that it did.
    pub fn interrupt(&self, run: &Run, name: &BenchName, state: &str, reason: &str) -> Result<Interrupted> {
        let benches = Value::from_iter(name.all(self.connection)?).to_string();
        let others = "run IN (SELECT id FROM runs WHERE bench IN (SELECT value FROM json_each(?1)) AND id <> ?2)";
        // The last sign of life is when it ended, as far as can be told.
        let sql = format!(
            "UPDATE jobs SET state = ?4, generation = generation + 1, ended_at = max(changed_at,
                ifnull((SELECT max(at) FROM log WHERE job = jobs.id), 0),
                ifnull((SELECT max(at) FROM iterations WHERE job = jobs.id), 0)),
                reason = ?3 WHERE {others} AND ended_at IS NULL RETURNING id"
        );
        let mut statement = self.connection.prepare_cached(&sql)?;
        let jobs = statement
            .query_map(params![benches, text(run.id), reason, state], |row| uuid(row, 0))?
            .collect::<Result<Vec<_>>>()?;
        // When the motion came to rest nobody knows.
        let sql = format!("UPDATE moves SET outcome = ?3 WHERE {others} AND outcome IS NULL");
        let moves = self.run(&sql, params![benches, text(run.id), state])?;
        Ok(Interrupted { jobs, moves })
    }

    /// Writes a job, or what is newer of it.
    pub fn put_job(&self, job: &Job) -> Result<()> {
        self.run(
            "INSERT INTO jobs (id, run, kind, state, simulated, generation, created_at, changed_at, ended_at, reason,
                request, idempotency_key, document)
             VALUES (:id, :run, :kind, :state, :simulated, :generation, :created_at, :changed_at, :ended_at, :reason,
                :request, :key, :document)
             ON CONFLICT (id) DO UPDATE SET state = excluded.state, generation = excluded.generation,
                changed_at = excluded.changed_at, ended_at = excluded.ended_at, reason = excluded.reason,
                document = excluded.document
             WHERE excluded.generation >= jobs.generation",
            named_params! {
                ":id": text(job.id),
                ":run": text(job.run),
                ":kind": job.kind,
                ":state": job.state,
                ":simulated": job.simulated,
                ":generation": job.generation as i64,
                ":created_at": ticks(job.created_at),
                ":changed_at": ticks(Timestamp::now()),
                ":ended_at": job.ended_at.map(ticks),
                ":reason": job.reason,
                ":request": job.request.to_string(),
                ":key": job.idempotency_key,
                ":document": job.document.to_string(),
            },
        )?;
        Ok(())
    }

    /// Deletes a job with all that belongs to it.
    pub fn forget_job(&self, job: Uuid) -> Result<()> {
        for table in OF_JOB {
            self.run(&format!("DELETE FROM {table} WHERE job = ?"), [text(job)])?;
        }
        self.run("DELETE FROM jobs WHERE id = ?", [text(job)])?;
        Ok(())
    }

    /// Writes an iteration.
    pub fn put_iteration(&self, job: Uuid, iteration: &Entry) -> Result<()> {
        self.run(
            "INSERT OR REPLACE INTO iterations VALUES (?, ?, ?, ?)",
            params![text(job), iteration.number as i64, ticks(iteration.at), iteration.document.to_string()],
        )?;
        Ok(())
    }

    /// Adds a measurement.
    pub fn add_measurement(&self, job: Option<Uuid>, at: Timestamp, document: &Value) -> Result<()> {
        self.run(
            "INSERT INTO measurements (job, at, document) VALUES (?, ?, ?)",
            params![job.map(text), ticks(at), document.to_string()],
        )?;
        Ok(())
    }

    /// Writes a line of a job's log.
    pub fn put_line(&self, job: Uuid, line: &Line) -> Result<()> {
        self.run(
            "INSERT OR REPLACE INTO log VALUES (?, ?, ?, ?)",
            params![text(job), line.number as i64, ticks(line.at), line.message],
        )?;
        Ok(())
    }

    /// Writes a motion that is about to begin.
    pub fn begin_move(&self, run: Uuid, motion: &Move) -> Result<()> {
        self.run(
            "INSERT INTO moves (id, run, job, axis, what, from_mm, to_mm, started_at) VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            params![
                text(motion.id),
                text(run),
                motion.job.map(text),
                motion.axis,
                motion.what,
                motion.from_mm,
                motion.to_mm,
                ticks(motion.started_at)
            ],
        )?;
        Ok(())
    }

    /// Writes how a motion ended.
    pub fn end_move(&self, id: Uuid, at: Timestamp, end_mm: Option<f64>, outcome: &str) -> Result<()> {
        self.run(
            "UPDATE moves SET ended_at = ?, end_mm = ?, outcome = ? WHERE id = ?",
            params![ticks(at), end_mm, outcome, text(id)],
        )?;
        Ok(())
    }

    /// Writes what an operator is asked to do, or that it is done.
    pub fn put_operator_step(&self, job: Uuid, step: &OperatorStep) -> Result<()> {
        self.run(
            "INSERT OR REPLACE INTO operator_steps VALUES (?, ?, ?, ?, ?)",
            params![
                text(job),
                step.number,
                step.document.to_string(),
                ticks(step.asked_at),
                step.confirmed_at.map(ticks)
            ],
        )?;
        Ok(())
    }

    /// Keeps a picture with a job, in the place of one of the same name.
    pub fn put_picture(&self, job: Uuid, picture: &Picture) -> Result<()> {
        self.run(
            "INSERT OR REPLACE INTO pictures VALUES (?, ?, ?, ?, ?)",
            params![text(job), picture.name, ticks(picture.at), picture.media_type, picture.bytes],
        )?;
        Ok(())
    }

    /// Adds to the audit log.
    pub fn add_audit(&self, audit: &Audit) -> Result<()> {
        self.run(
            "INSERT INTO audit (at, who, what, detail, address) VALUES (?, ?, ?, ?, ?)",
            params![ticks(audit.at), audit.who, audit.what, audit.detail.to_string(), audit.from],
        )?;
        Ok(())
    }

    /// Keeps a value beyond the run, in the place of one with the same key.
    pub fn keep(&self, kept: &Kept) -> Result<()> {
        self.run(
            "INSERT OR REPLACE INTO kept VALUES (?, ?, ?, ?)",
            params![kept.bench, kept.key, kept.value.to_string(), ticks(Timestamp::now())],
        )?;
        Ok(())
    }
}

/// An id as it is in the file: in the order of creation where it is of version 7.
pub(super) fn text(id: Uuid) -> String {
    id.hyphenated().to_string()
}

/// An id from a row.
pub(super) fn uuid(row: &rusqlite::Row<'_>, column: usize) -> Result<Uuid> {
    let text: String = row.get(column)?;
    text.parse().map_err(|error| unreadable(column, error))
}

/// A time as it is in the file: nanoseconds since 1970-01-01T00:00:00Z, which last until 2262.
pub(super) fn ticks(at: Timestamp) -> i64 {
    i64::try_from(at.as_nanosecond()).unwrap_or(if at.as_second() > 0 { i64::MAX } else { i64::MIN })
}

/// A value in the file that nobody can have written there by this program.
pub(super) fn unreadable(column: usize, error: impl std::error::Error + Send + Sync + 'static) -> rusqlite::Error {
    rusqlite::Error::FromSqlConversionFailure(column, rusqlite::types::Type::Text, Box::new(error))
}

/// What a configuration is found by.
fn hash(text: &str) -> String {
    Sha256::digest(text.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect()
}
