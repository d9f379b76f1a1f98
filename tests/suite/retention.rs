//! How long the history keeps what: by age, by size, and what is never deleted.

use std::path::Path;
use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use plenalign::store::records::{Audit, Entry, Job, Line, Move, Picture, Run};
use plenalign::store::{FILE_NAME, Store};
use rusqlite::Connection;
use serde_json::json;
use uuid::Uuid;

use super::program::{Program, plenalign};
use super::until::until_blocking;

const TABLES: [&str; 5] = ["iterations", "measurements", "log", "operator_steps", "pictures"];

fn ago(days: i64) -> Timestamp {
    Timestamp::now() - SignedDuration::from_hours(24 * days)
}

fn run(began: Timestamp) -> Run {
    let (bench, version) = ("simulated".to_owned(), "1".to_owned());
    Run { id: Uuid::now_v7(), bench, version, configuration: format!("began = {began}"), started_at: began }
}

fn motion(job: Option<Uuid>, at: Timestamp) -> Move {
    Move {
        id: Uuid::now_v7(),
        job,
        axis: "e".to_owned(),
        what: "move".to_owned(),
        from_mm: Some(30.0),
        to_mm: Some(20.0),
        started_at: at,
        ended_at: Some(at),
        end_mm: Some(20.0),
        outcome: Some("done".to_owned()),
    }
}

/// A run of some days ago with a job, with everything that belongs to one, and a move and a measurement by hand, and an
/// entry of the audit log. Where `ended` is not, the job has no end.
async fn past(store: &Store, days: i64, bench: &str, ended: bool, picture_bytes: usize) -> Uuid {
    let at = ago(days);
    let run = Run { bench: bench.to_owned(), ..run(at) };
    let id = Uuid::now_v7();
    let job = Job {
        id,
        run: run.id,
        kind: "joint_alignment".to_owned(),
        state: if ended { "converged" } else { "running" }.to_owned(),
        simulated: true,
        generation: 3,
        created_at: at,
        ended_at: ended.then_some(at),
        reason: None,
        request: json!({ "kind": "joint_alignment" }),
        idempotency_key: None,
        document: json!({}),
    };
    let (who, what) = ("Ada".to_owned(), format!("{days} days ago"));
    let audit = Audit { at, who, what, detail: json!({}), from: None };
    store
        .write(move |writer| {
            writer.begin_run(&run)?;
            writer.put_job(&job)?;
            writer.put_iteration(id, &Entry { number: 1, at, document: json!({}) })?;
            writer.put_line(id, &Line { number: 1, at, message: "a line".to_owned() })?;
            let (name, media_type) = ("before".to_owned(), "image/jpeg".to_owned());
            writer.put_picture(id, &Picture { name, at, media_type, bytes: vec![7; picture_bytes] })?;
            writer.add_measurement(Some(id), at, &json!({}))?;
            writer.begin_move(run.id, &motion(Some(id), at))?;
            writer.add_measurement(None, at, &json!({}))?;
            let by_hand = motion(None, at);
            writer.begin_move(run.id, &by_hand)?;
            writer.end_move(by_hand.id, at, Some(20.0), "done")?;
            writer.add_audit(&audit)
        })
        .await
        .unwrap();
    id
}

fn serve(state: &Path, history: &str) -> Program {
    let config = state.with_file_name("bench.toml");
    std::fs::write(&config, format!("[bench.simulation]\nrays = 4\n[history]\n{history}\n")).unwrap();
    let mut command = plenalign(state);
    command.args(["serve", "--simulated", "--json", "--listen", "127.0.0.1:0", "--config"]).arg(config);
    Program::start(command)
}

fn count(state: &Path, table: &str, condition: &str) -> i64 {
    let file = Connection::open(state.join(FILE_NAME)).unwrap();
    file.busy_timeout(Duration::from_secs(5)).unwrap();
    file.query_row(&format!("SELECT count(*) FROM {table} WHERE {condition}"), [], |row| row.get(0)).unwrap()
}

fn jobs(state: &Path) -> Vec<Uuid> {
    let file = Connection::open(state.join(FILE_NAME)).unwrap();
    file.busy_timeout(Duration::from_secs(5)).unwrap();
    let mut statement = file.prepare("SELECT id FROM jobs ORDER BY created_at").unwrap();
    let ids = statement.query_map([], |row| row.get::<_, String>(0)).unwrap();
    ids.map(|id| id.unwrap().parse().unwrap()).collect()
}

#[tokio::test]
async fn what_is_older_than_it_is_to_be_kept_is_deleted_with_all_that_belongs_to_it() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let store = Store::open(&state);
    let old = past(&store, 90, "simulated", true, 100).await;
    // Of another bench, whose program was killed and has not been started since: nobody has said how it ended.
    let open = past(&store, 80, "another", false, 100).await;
    let young = past(&store, 20, "simulated", true, 100).await;
    store.flush().await;
    drop(store);
    let program = serve(&state, "keep_days = 30");
    until_blocking("deleted", || jobs(&state) == [open, young]);
    until_blocking("as many by hand", || count(&state, "moves", "job IS NULL") == 1);
    for table in TABLES.iter().filter(|table| **table != "operator_steps") {
        assert_eq!(count(&state, table, &format!("job = '{old}'")), 0, "{table}");
        assert_eq!(count(&state, table, &format!("job = '{young}'")), 1, "{table}");
    }
    assert_eq!(count(&state, "moves", &format!("job = '{old}'")), 0);
    assert_eq!(count(&state, "moves", &format!("job = '{open}'")), 1);
    until_blocking("measured by hand", || count(&state, "measurements", "job IS NULL") == 1);
    // The run of what is gone is gone, with its configuration.
    until_blocking("runs", || count(&state, "runs", "bench = 'simulated'") == 2);
    assert_eq!(count(&state, "configurations", "1"), count(&state, "runs", "1"));
    // The audit log has a key of its own, and says what was deleted.
    assert_eq!(count(&state, "audit", "what LIKE '%days ago'"), 3);
    until_blocking("said", || count(&state, "audit", "what = 'retention.delete' AND who = 'plenalign'") == 1);
    program.kill();
}

#[tokio::test]
async fn the_audit_log_is_shortened_by_a_key_of_its_own_alone() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let store = Store::open(&state);
    for days in [900, 400, 100, 1] {
        past(&store, days, "simulated", true, 100).await;
    }
    store.flush().await;
    drop(store);
    let program = serve(&state, "keep_audit_days = 365");
    until_blocking("shortened", || count(&state, "audit", "what LIKE '%days ago'") == 2);
    assert_eq!(jobs(&state).len(), 4);
    program.kill();
}

#[tokio::test]
async fn a_file_larger_than_it_may_be_loses_the_oldest_and_shrinks() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let store = Store::open(&state);
    let mut all = Vec::new();
    for days in (1..=8).rev() {
        all.push(past(&store, 2 * days, "simulated", true, 1 << 20).await);
    }
    // What ended within a day stays however large it is.
    all.push(past(&store, 0, "simulated", true, 6 << 20).await);
    store.flush().await;
    drop(store);
    let bytes = || std::fs::metadata(state.join(FILE_NAME)).unwrap().len();
    // A file as older versions have made it gives nothing back by itself.
    let file = Connection::open(state.join(FILE_NAME)).unwrap();
    file.execute_batch("PRAGMA auto_vacuum = 0; VACUUM").unwrap();
    drop(file);
    assert!(bytes() > 14 << 20);
    let program = serve(&state, "keep_mb = 10");
    until_blocking("smaller", || bytes() <= 10 << 20);
    let left = jobs(&state);
    assert!(left.len() >= 3 && left == all[all.len() - left.len()..], "the newest are left: {}", left.len());
    assert_eq!(count(&state, "audit", "what LIKE '%days ago'"), 9, "nobody pushes out the audit log");
    program.kill();
    // Even where that is not enough.
    let program = serve(&state, "keep_mb = 1");
    until_blocking("the last one", || jobs(&state) == all[8..]);
    program.kill();
}

#[tokio::test]
async fn nothing_is_deleted_unless_it_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let store = Store::open(&state);
    let old = past(&store, 4000, "simulated", true, 100).await;
    store.flush().await;
    drop(store);
    let config = folder.path().join("bench.toml");
    std::fs::write(&config, "[bench.simulation]\nrays = 4\n").unwrap();
    let mut command = plenalign(&state);
    command.args(["serve", "--simulated", "--json", "--listen", "127.0.0.1:0", "--config"]).arg(config);
    let program = Program::start(command);
    until_blocking("begun", || count(&state, "runs", "ended_at IS NULL") == 2);
    program.terminate();
    let (status, _, log) = program.end(Duration::from_secs(10));
    assert!(status.success(), "{log}");
    assert_eq!((jobs(&state), count(&state, "audit", "1")), (vec![old], 1));
}
