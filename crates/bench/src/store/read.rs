//! Queries.

use std::path::Path;
use std::time::Duration;

use jiff::Timestamp;
use rusqlite::types::ToSql;
use rusqlite::{Connection, OpenFlags, OptionalExtension as _, Result, Row, named_params, params};
use serde_json::Value;
use uuid::Uuid;

use super::bench::BenchName;
use super::disk::Identity;
use super::health::StoreError;
use super::records::{Audit, Entry, Job, Line, Move, OperatorStep, Picture, Run};
use super::schema;
use super::write::{text, ticks, unreadable, uuid};

/// How long another program may hold the file.
const BUSY_ALLOWED: Duration = Duration::from_secs(2);

/// A connection that reads.
pub(super) struct Reader {
    connection: Connection,
    identity: Option<Identity>,
}

impl Reader {
    fn open(file: &Path) -> Result<Self, StoreError> {
        let connection = Connection::open_with_flags(file, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
        connection.busy_timeout(BUSY_ALLOWED)?;
        schema::check(&connection)?;
        Ok(Self { connection, identity: Identity::of(file) })
    }
}

/// Reads with the connection there is, or with a new one where there is none or the file is another one.
pub(super) fn with_reader<T>(
    reader: &mut Option<Reader>,
    file: &Path,
    query: impl FnOnce(&Connection) -> Result<T>,
) -> Result<T, StoreError> {
    if reader.as_ref().is_some_and(|reader| reader.identity != Identity::of(file)) {
        *reader = None;
    }
    let opened = match reader.take() {
        Some(open) => open,
        None => Reader::open(file).map_err(|error| error.of(file))?,
    };
    let found = query(&reader.insert(opened).connection).map_err(|error| StoreError::from(error).of(file));
    if found.is_err() {
        *reader = None;
    }
    found
}

/// Which jobs are wanted: every one that fits all that is given.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct JobFilter {
    /// States, in words; any where empty.
    pub states: Vec<String>,
    /// Kinds, in words; any where empty.
    pub kinds: Vec<String>,
    /// Created at this time or later.
    pub since: Option<Timestamp>,
    /// Created before this time.
    pub until: Option<Timestamp>,
    /// In the id, the reason or a line of the log, whatever the case of its letters.
    pub text: Option<String>,
    /// Older than this job: where the page before has ended.
    pub before: Option<Uuid>,
    /// None of these.
    pub without: Vec<Uuid>,
}

/// A page of a list, newest first.
#[derive(Debug, Clone, PartialEq)]
pub struct Page<T> {
    /// What is on it.
    pub items: Vec<T>,
    /// Whether there are older ones.
    pub more: bool,
}

const JOB: &str = "id, run, kind, state, simulated, generation, created_at, ended_at, reason, request, \
                   idempotency_key, document";

fn job(row: &Row<'_>) -> Result<Job> {
    Ok(Job {
        id: uuid(row, 0)?,
        run: uuid(row, 1)?,
        kind: row.get(2)?,
        state: row.get(3)?,
        simulated: row.get(4)?,
        generation: row.get::<_, i64>(5)?.unsigned_abs(),
        created_at: time(row, 6)?,
        ended_at: optional_time(row, 7)?,
        reason: row.get(8)?,
        request: json(row, 9)?,
        idempotency_key: row.get(10)?,
        document: json(row, 11)?,
    })
}

/// The jobs that a filter lets through, newest first, and how many iterations each has.
pub fn jobs(connection: &Connection, filter: &JobFilter, limit: usize) -> Result<Page<(Job, u64)>> {
    let mut wanted: Vec<String> = Vec::new();
    let mut values: Vec<Box<dyn ToSql>> = Vec::new();
    let mut among = |column: &str, not: &str, names: Vec<String>| {
        if !names.is_empty() {
            wanted.push(format!("{column} {not} IN ({})", vec!["?"; names.len()].join(", ")));
            values.extend(names.into_iter().map(|name| Box::new(name) as Box<dyn ToSql>));
        }
    };
    among("state", "", filter.states.clone());
    among("kind", "", filter.kinds.clone());
    among("id", "NOT", filter.without.iter().map(|id| text(*id)).collect());
    let mut compare = |condition: &str, value: Box<dyn ToSql>| {
        wanted.push(condition.to_owned());
        values.push(value);
    };
    if let Some(since) = filter.since {
        compare("created_at >= ?", Box::new(ticks(since)));
    }
    if let Some(until) = filter.until {
        compare("created_at < ?", Box::new(ticks(until)));
    }
    if let Some(before) = filter.before {
        compare("id < ?", Box::new(text(before)));
    }
    if let Some(words) = &filter.text {
        // instr knows no wildcards; lower knows ASCII only, as every word of a log that matters is.
        let words = words.to_ascii_lowercase();
        compare(
            "(instr(id, ?) OR instr(lower(ifnull(reason, '')), ?) OR EXISTS
            (SELECT 1 FROM log WHERE job = jobs.id AND instr(lower(message), ?))
            OR instr(lower(ifnull(json_extract(request, '$.note'), '')), ?)
            OR instr(lower(ifnull(json_extract(document, '$.owner'), '')), ?))",
            Box::new(words.clone()),
        );
        values.extend([(); 4].map(|()| Box::new(words.clone()) as Box<dyn ToSql>));
    }
    let condition = if wanted.is_empty() { String::new() } else { format!("WHERE {}", wanted.join(" AND ")) };
    let sql = format!(
        "SELECT {JOB}, (SELECT count(*) FROM iterations WHERE job = jobs.id) FROM jobs {condition}
         ORDER BY id DESC LIMIT {}",
        limit + 1
    );
    let mut statement = connection.prepare(&sql)?;
    let mut items = statement
        .query_map(rusqlite::params_from_iter(values), |row| Ok((job(row)?, row.get::<_, i64>(12)?.unsigned_abs())))?
        .collect::<Result<Vec<_>>>()?;
    let more = items.len() > limit;
    items.truncate(limit);
    Ok(Page { items, more })
}

/// A job.
pub fn find_job(connection: &Connection, id: Uuid) -> Result<Option<Job>> {
    connection.query_row(&format!("SELECT {JOB} FROM jobs WHERE id = ?"), [text(id)], job).optional()
}

/// The newest job on a bench with this idempotency key, created at `since` or later.
pub fn find_key(connection: &Connection, name: &BenchName, key: &str, since: Timestamp) -> Result<Option<Job>> {
    let benches = Value::from_iter(name.all(connection)?).to_string();
    let sql = format!(
        "SELECT {JOB} FROM jobs WHERE idempotency_key = :key AND created_at >= :since
            AND run IN (SELECT id FROM runs WHERE bench IN (SELECT value FROM json_each(:benches))) ORDER BY id DESC LIMIT 1"
    );
    let parameters = named_params! { ":key": key, ":since": ticks(since), ":benches": benches };
    connection.query_row(&sql, parameters, job).optional()
}

/// What was asked for with the newest jobs of a kind that came to their end on a bench, and how long each took without its
/// operator's time, s; newest first.
pub fn own_times(connection: &Connection, name: &BenchName, kind: &str, limit: usize) -> Result<Vec<(Value, f64)>> {
    let benches = Value::from_iter(name.all(connection)?).to_string();
    // What was done again belongs to that job alone.
    let sql = "SELECT request, (SELECT sum(json_extract(value, '$.bench_s')) FROM json_each(document, '$.steps')
            WHERE json_extract(value, '$.state') <> 'repeated') AS own FROM jobs
        WHERE kind = :kind AND state IN ('converged', 'succeeded') AND own IS NOT NULL
            AND run IN (SELECT id FROM runs WHERE bench IN (SELECT value FROM json_each(:benches)))
        ORDER BY id DESC LIMIT :limit";
    let parameters = named_params! { ":kind": kind, ":benches": benches, ":limit": limit as i64 };
    let time = |row: &Row<'_>| Ok((json(row, 0)?, row.get(1)?));
    connection.prepare_cached(sql)?.query_map(parameters, time)?.collect()
}

/// The run of an id.
pub fn find_run(connection: &Connection, id: Uuid) -> Result<Option<Run>> {
    let sql = "SELECT runs.id, bench, version, text, started_at FROM runs
               JOIN configurations ON configurations.hash = runs.configuration WHERE runs.id = ?";
    let run = |row: &Row<'_>| {
        Ok(Run {
            id: uuid(row, 0)?,
            bench: row.get(1)?,
            version: row.get(2)?,
            configuration: row.get(3)?,
            started_at: time(row, 4)?,
        })
    };
    connection.query_row(sql, [text(id)], run).optional()
}

/// A job's iterations, in order.
pub fn iterations(connection: &Connection, job: Uuid) -> Result<Vec<Entry>> {
    entries(connection, "SELECT number, at, document FROM iterations WHERE job = ? ORDER BY number", job)
}

/// A job's measurements, in order.
pub fn measurements(connection: &Connection, job: Uuid) -> Result<Vec<Entry>> {
    let sql = "SELECT row_number() OVER (ORDER BY id), at, document FROM measurements WHERE job = ? ORDER BY id";
    entries(connection, sql, job)
}

/// A page of the measurements that belong to no job, newest first; each entry's number is the file's own. `before` is
/// the number of the last one of the page before.
pub fn measurements_alone(connection: &Connection, before: Option<u64>, limit: usize) -> Result<Page<Entry>> {
    let sql = "SELECT id, at, document FROM measurements WHERE job IS NULL AND id < ? ORDER BY id DESC LIMIT ?";
    let before = before.map_or(i64::MAX, |before| i64::try_from(before).unwrap_or(i64::MAX));
    let entry = |row: &Row<'_>| {
        Ok(Entry { number: row.get::<_, i64>(0)?.unsigned_abs(), at: time(row, 1)?, document: json(row, 2)? })
    };
    let mut items = connection
        .prepare_cached(sql)?
        .query_map(params![before, limit as i64 + 1], entry)?
        .collect::<Result<Vec<_>>>()?;
    let more = items.len() > limit;
    items.truncate(limit);
    Ok(Page { items, more })
}

fn entries(connection: &Connection, sql: &str, job: Uuid) -> Result<Vec<Entry>> {
    let entry = |row: &Row<'_>| {
        Ok(Entry { number: row.get::<_, i64>(0)?.unsigned_abs(), at: time(row, 1)?, document: json(row, 2)? })
    };
    connection.prepare_cached(sql)?.query_map([text(job)], entry)?.collect()
}

/// A job's log, in order.
pub fn log(connection: &Connection, job: Uuid) -> Result<Vec<Line>> {
    let line = |row: &Row<'_>| {
        Ok(Line { number: row.get::<_, i64>(0)?.unsigned_abs(), at: time(row, 1)?, message: row.get(2)? })
    };
    let mut statement =
        connection.prepare_cached("SELECT number, at, message FROM log WHERE job = ? ORDER BY number")?;
    statement.query_map([text(job)], line)?.collect()
}

const MOVE: &str = "id, job, axis, what, from_mm, to_mm, started_at, ended_at, end_mm, outcome";

fn motion(row: &Row<'_>) -> Result<Move> {
    let job: Option<String> = row.get(1)?;
    Ok(Move {
        id: uuid(row, 0)?,
        job: job.map(|job| job.parse().map_err(|error| unreadable(1, error))).transpose()?,
        axis: row.get(2)?,
        what: row.get(3)?,
        from_mm: row.get(4)?,
        to_mm: row.get(5)?,
        started_at: time(row, 6)?,
        ended_at: optional_time(row, 7)?,
        end_mm: row.get(8)?,
        outcome: row.get(9)?,
    })
}

/// A job's moves, in order.
pub fn moves(connection: &Connection, job: Uuid) -> Result<Vec<Move>> {
    let mut statement = connection.prepare_cached(&format!("SELECT {MOVE} FROM moves WHERE job = ? ORDER BY id"))?;
    statement.query_map([text(job)], motion)?.collect()
}

/// The newest moves of all, newest first.
pub fn newest_moves(connection: &Connection, limit: usize) -> Result<Vec<Move>> {
    let mut statement = connection.prepare_cached(&format!("SELECT {MOVE} FROM moves ORDER BY id DESC LIMIT ?"))?;
    statement.query_map([limit as i64], motion)?.collect()
}

/// What an operator was asked to do for a job, in order.
pub fn operator_steps(connection: &Connection, job: Uuid) -> Result<Vec<OperatorStep>> {
    let sql = "SELECT number, document, asked_at, confirmed_at FROM operator_steps WHERE job = ? ORDER BY number";
    let step = |row: &Row<'_>| {
        Ok(OperatorStep {
            number: row.get(0)?,
            document: json(row, 1)?,
            asked_at: time(row, 2)?,
            confirmed_at: optional_time(row, 3)?,
        })
    };
    connection.prepare_cached(sql)?.query_map([text(job)], step)?.collect()
}

/// The pictures kept with a job, in the order they were taken.
pub fn pictures(connection: &Connection, job: Uuid) -> Result<Vec<Picture>> {
    let sql = "SELECT name, at, media_type, bytes FROM pictures WHERE job = ? ORDER BY at";
    let picture = |row: &Row<'_>| {
        Ok(Picture { name: row.get(0)?, at: time(row, 1)?, media_type: row.get(2)?, bytes: row.get(3)? })
    };
    connection.prepare_cached(sql)?.query_map([text(job)], picture)?.collect()
}

/// The audit log, newest first, each entry with its number; `before` is where the page before has ended.
pub fn audit(connection: &Connection, before: Option<i64>, limit: usize) -> Result<Page<(i64, Audit)>> {
    let sql = "SELECT id, at, who, what, detail, address FROM audit WHERE id < ? ORDER BY id DESC LIMIT ?";
    let entry = |row: &Row<'_>| {
        let audit =
            Audit { at: time(row, 1)?, who: row.get(2)?, what: row.get(3)?, detail: json(row, 4)?, from: row.get(5)? };
        Ok((row.get(0)?, audit))
    };
    let mut items = connection
        .prepare_cached(sql)?
        .query_map(params![before.unwrap_or(i64::MAX), limit as i64 + 1], entry)?
        .collect::<Result<Vec<_>>>()?;
    let more = items.len() > limit;
    items.truncate(limit);
    Ok(Page { items, more })
}

/// A value kept beyond a run.
pub fn kept(connection: &Connection, bench: &str, key: &str) -> Result<Option<Value>> {
    let sql = "SELECT value FROM kept WHERE bench = ? AND key = ?";
    connection.query_row(sql, [bench, key], |row| json(row, 0)).optional()
}

fn time(row: &Row<'_>, column: usize) -> Result<Timestamp> {
    Timestamp::from_nanosecond(row.get::<_, i64>(column)?.into()).map_err(|error| unreadable(column, error))
}

fn optional_time(row: &Row<'_>, column: usize) -> Result<Option<Timestamp>> {
    let time: Option<i64> = row.get(column)?;
    time.map(|time| Timestamp::from_nanosecond(time.into()).map_err(|error| unreadable(column, error))).transpose()
}

fn json(row: &Row<'_>, column: usize) -> Result<Value> {
    let text: String = row.get(column)?;
    serde_json::from_str(&text).map_err(|error| unreadable(column, error))
}
