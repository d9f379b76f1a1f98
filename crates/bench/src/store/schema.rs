//! The file's tables, and how an older file is brought up to them.

use rusqlite::Connection;

use super::health::StoreError;

/// One step each; never changed once released, only added to. `user_version` counts those that a file has had.
///
/// Times are nanoseconds since 1970-01-01T00:00:00Z; documents are JSON.
const STEPS: &[&str] = &[
    "
    CREATE TABLE configurations (
        hash TEXT PRIMARY KEY,
        text TEXT NOT NULL
    ) STRICT;
    CREATE TABLE runs (
        id TEXT PRIMARY KEY,
        bench TEXT NOT NULL,
        version TEXT NOT NULL,
        configuration TEXT NOT NULL REFERENCES configurations,
        started_at INTEGER NOT NULL,
        ended_at INTEGER
    ) STRICT;
    CREATE TABLE jobs (
        id TEXT PRIMARY KEY,
        run TEXT NOT NULL REFERENCES runs,
        kind TEXT NOT NULL,
        state TEXT NOT NULL,
        simulated INTEGER NOT NULL,
        generation INTEGER NOT NULL,
        created_at INTEGER NOT NULL,
        changed_at INTEGER NOT NULL,
        ended_at INTEGER,
        reason TEXT,
        request TEXT NOT NULL,
        idempotency_key TEXT,
        document TEXT NOT NULL
    ) STRICT;
    CREATE INDEX jobs_open ON jobs (run) WHERE ended_at IS NULL;
    CREATE INDEX jobs_idempotency ON jobs (idempotency_key) WHERE idempotency_key IS NOT NULL;
    CREATE TABLE iterations (
        job TEXT NOT NULL REFERENCES jobs,
        number INTEGER NOT NULL,
        at INTEGER NOT NULL,
        document TEXT NOT NULL,
        PRIMARY KEY (job, number)
    ) STRICT, WITHOUT ROWID;
    CREATE TABLE measurements (
        id INTEGER PRIMARY KEY,
        job TEXT REFERENCES jobs,
        at INTEGER NOT NULL,
        document TEXT NOT NULL
    ) STRICT;
    CREATE INDEX measurements_of_job ON measurements (job);
    CREATE TABLE moves (
        id TEXT PRIMARY KEY,
        run TEXT NOT NULL REFERENCES runs,
        job TEXT REFERENCES jobs,
        axis TEXT NOT NULL,
        what TEXT NOT NULL,
        from_mm REAL,
        to_mm REAL,
        started_at INTEGER NOT NULL,
        ended_at INTEGER,
        end_mm REAL,
        outcome TEXT
    ) STRICT;
    CREATE INDEX moves_of_job ON moves (job);
    CREATE INDEX moves_open ON moves (run) WHERE outcome IS NULL;
    CREATE TABLE operator_steps (
        job TEXT NOT NULL REFERENCES jobs,
        number INTEGER NOT NULL,
        document TEXT NOT NULL,
        asked_at INTEGER NOT NULL,
        confirmed_at INTEGER,
        PRIMARY KEY (job, number)
    ) STRICT, WITHOUT ROWID;
    CREATE TABLE log (
        job TEXT NOT NULL REFERENCES jobs,
        number INTEGER NOT NULL,
        at INTEGER NOT NULL,
        message TEXT NOT NULL,
        PRIMARY KEY (job, number)
    ) STRICT, WITHOUT ROWID;
    CREATE TABLE pictures (
        job TEXT NOT NULL REFERENCES jobs,
        name TEXT NOT NULL,
        at INTEGER NOT NULL,
        media_type TEXT NOT NULL,
        bytes BLOB NOT NULL,
        PRIMARY KEY (job, name)
    ) STRICT;
    CREATE TABLE audit (
        id INTEGER PRIMARY KEY,
        at INTEGER NOT NULL,
        who TEXT NOT NULL,
        what TEXT NOT NULL,
        detail TEXT NOT NULL,
        address TEXT
    ) STRICT;
    CREATE TABLE kept (
        bench TEXT NOT NULL,
        key TEXT NOT NULL,
        value TEXT NOT NULL,
        at INTEGER NOT NULL,
        PRIMARY KEY (bench, key)
    ) STRICT, WITHOUT ROWID;
",
    "
    CREATE INDEX jobs_by_kind ON jobs (kind, id);
    CREATE INDEX jobs_by_state ON jobs (state, id);
",
];

/// Brings a file up to date.
///
/// # Errors
/// When it was made by a newer program, is no such file, or cannot be written.
pub(super) fn bring_up_to_date(connection: &mut Connection) -> Result<(), StoreError> {
    // The writer's word from the beginning: two programs may open a new file at once.
    let transaction = connection.transaction_with_behavior(rusqlite::TransactionBehavior::Immediate)?;
    let had: i64 = transaction.query_row("PRAGMA user_version", [], |row| row.get(0))?;
    let had = usize::try_from(had).unwrap_or(usize::MAX);
    let Some(steps) = STEPS.get(had..) else { return Err(newer(had)) };
    if steps.is_empty() {
        return Ok(());
    }
    for step in steps {
        transaction.execute_batch(step)?;
    }
    transaction.pragma_update(None, "user_version", STEPS.len() as i64)?;
    Ok(transaction.commit()?)
}

/// How many steps this program knows: the version of an up-to-date file.
pub(super) const fn newest() -> usize {
    STEPS.len()
}

/// Whether a file can be read as it is.
///
/// # Errors
/// When it was made by another version of the program.
pub(super) fn check(connection: &Connection) -> Result<(), StoreError> {
    match version(connection)? {
        0 => Err(StoreError::Unusable("there is no history in it yet".to_owned())),
        had if had > STEPS.len() => Err(newer(had)),
        _ => Ok(()),
    }
}

/// How many steps a file has had.
pub(super) fn version(connection: &Connection) -> Result<usize, StoreError> {
    let had: i64 = connection.query_row("PRAGMA user_version", [], |row| row.get(0))?;
    Ok(usize::try_from(had).unwrap_or(usize::MAX))
}

fn newer(had: usize) -> StoreError {
    StoreError::Unusable(format!(
        "it was written by a newer version of plenalign (its tables are version {had}, this program knows {})",
        STEPS.len()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every table and index with the words that made it.
    fn made(connection: &Connection) -> Vec<(String, Option<String>)> {
        let mut statement = connection.prepare("SELECT name, sql FROM sqlite_schema ORDER BY name").unwrap();
        let rows = statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?))).unwrap();
        rows.map(Result::unwrap).collect()
    }

    #[test]
    fn older_files_come_to_the_tables_of_a_new_one() {
        let mut new = Connection::open_in_memory().unwrap();
        bring_up_to_date(&mut new).unwrap();
        assert!(made(&new).len() > 10);
        for had in 1..=newest() {
            let mut older = Connection::open_in_memory().unwrap();
            STEPS[..had].iter().for_each(|step| older.execute_batch(step).unwrap());
            older.pragma_update(None, "user_version", had as i64).unwrap();
            assert_eq!(made(&older) == made(&new), had == newest(), "after step {had}");
            bring_up_to_date(&mut older).unwrap();
            assert_eq!(made(&older), made(&new), "from step {had}");
            assert_eq!(version(&older).unwrap(), newest());
        }
    }

    #[test]
    fn jobs_of_a_kind_or_in_a_state_are_found_without_reading_all() {
        let mut connection = Connection::open_in_memory().unwrap();
        bring_up_to_date(&mut connection).unwrap();
        for (column, index) in [("kind", "jobs_by_kind"), ("state", "jobs_by_state")] {
            let sql = format!("EXPLAIN QUERY PLAN SELECT * FROM jobs WHERE {column} IN ('x') ORDER BY id DESC LIMIT 5");
            let plan: String = connection.query_row(&sql, [], |row| row.get(3)).unwrap();
            assert!(plan.contains(index), "{plan}");
        }
    }
}
