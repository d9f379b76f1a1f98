//! The stop's latch over restarts: what cannot be read of it counts as latched, nobody gets past its first reading, and
//! neither a stop nor a reset is taken for kept before it is.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use plenalign::api::error::LEASE_HEADER;
use plenalign::config::Config;
use plenalign::control::motion::lease::LeaseRequest;
use plenalign::control::{Refusal, Service, ServiceError};
use plenalign::device::AxisName;
use plenalign::store::{Hindrance, Store};
use plenalign::units::Millimetres;
use reqwest::{Method, Response};
use serde_json::{Value, json};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

use super::bench::permit;
use super::daemon::{Daemon, client, problem};
use super::fakes::{Fakes, fakes};
use super::program::{Program, plenalign};
use super::until::{until, when};

const STOP: &str = "/api/v1/stop";
const MOVE: &str = "/api/v1/axes/e/move";

/// A daemon over stand-ins with its history in a folder.
async fn daemon(folder: &Path) -> (Daemon, Fakes, Store) {
    let (fakes, store) = (fakes(), Store::open(folder));
    let daemon = Daemon::start_keeping(Config::default(), fakes.bench.clone(), store.clone()).await;
    (daemon, fakes, store)
}

/// Waits until the bench is as wanted, and returns its stop.
async fn stop_once(daemon: &Daemon, what: &str, is: impl Fn(&Value) -> bool) -> Value {
    daemon.until("/api/v1/bench", what, is).await["stop"].take()
}

/// Waits until the latch is kept as given.
async fn until_latched(folder: &Path) {
    until("the latch is kept", async || when(kept(folder), |kept| kept.contains("\"latched\":true"))).await;
}

async fn writable(daemon: &Daemon) -> Value {
    stop_once(daemon, "writable", |bench| bench["history_fault"].is_null()).await
}

async fn stop(daemon: &Daemon) {
    assert_eq!(daemon.request(Method::POST, STOP).send().await.unwrap().status(), 200);
}

async fn go(daemon: &Daemon) -> Response {
    daemon.command(Method::POST, MOVE, &json!({ "position_mm": 29.0 })).await
}

/// A folder in which a run has left its stop latched.
async fn left_latched() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let (first, _fakes, _store) = daemon(folder.path()).await;
    stop(&first).await;
    first.written().await;
    // It writes nothing more.
    first.service.shut_down().await;
    folder
}

/// Does something to the history's file that no program of ours does.
fn spoil(folder: &Path, sql: &str) {
    let database = rusqlite::Connection::open(folder.join("history.db")).unwrap();
    database.execute_batch(sql).unwrap();
}

/// That nothing moves, however often it is asked for.
async fn refused(daemon: &Daemon, fakes: &Fakes) {
    for _ in 0..3 {
        problem(go(daemon).await, 409, "stopped").await;
        problem(daemon.command(Method::POST, "/api/v1/axes/e/home", &Value::Null).await, 409, "stopped").await;
        problem(daemon.command(Method::POST, "/api/v1/jobs", &json!({ "kind": "homing" })).await, 409, "stopped").await;
    }
    assert!(fakes.e.told.lock().unwrap().is_empty(), "the axis was told to move");
}

#[tokio::test]
async fn a_kept_stop_that_makes_no_sense_counts_as_latched_until_it_is_reset() {
    for value in ["{", "{\"latched\": \"perhaps\"}", "7"] {
        let folder = left_latched().await;
        spoil(folder.path(), &format!("UPDATE kept SET value = '{value}' WHERE key = 'stop'"));
        let (second, fakes, _store) = daemon(folder.path()).await;
        refused(&second, &fakes).await;
        let found = writable(&second).await;
        assert_eq!(found["latched"], true, "{value}: {found}");
        assert!(found["unread"].as_str().is_some_and(|why| !why.is_empty()), "{value}: {found}");
        assert_eq!((&found["since"], &found["by"]), (&Value::Null, &Value::Null), "{value}");

        // A person's reset overwrites it.
        assert_eq!(second.reset_stop().await.status(), 200);
        assert_eq!(go(&second).await.status(), 202);
        second.as_killed().await;
        let (third, _fakes, _store) = daemon(folder.path()).await;
        assert_eq!(go(&third).await.status(), 202);
    }
}

#[tokio::test]
async fn a_stop_that_cannot_be_read_counts_as_latched_until_it_is_read() {
    for (left, latched) in [(left_latched().await, true), (tempfile::tempdir().unwrap(), false)] {
        if !latched {
            let (first, _fakes, _store) = daemon(left.path()).await;
            assert_eq!(go(&first).await.status(), 202);
            first.service.shut_down().await;
        }
        spoil(
            left.path(),
            "CREATE TABLE away AS SELECT * FROM kept; UPDATE kept SET value = CAST(x'ff' AS TEXT) WHERE key = 'stop'",
        );
        let (second, fakes, _store) = daemon(left.path()).await;
        refused(&second, &fakes).await;
        let found = writable(&second).await;
        assert!(
            found["latched"] == true && found["unread"].as_str().is_some_and(|why| why.contains("cannot be read")),
            "{found}"
        );
        let value = "SELECT value FROM away WHERE away.bench = kept.bench AND away.key = kept.key";
        spoil(left.path(), &format!("UPDATE kept SET value = ({value}) WHERE key = 'stop'"));
        // Nobody has to ask for it.
        let found = stop_once(&second, "read", |bench| bench["stop"]["unread"].is_null()).await;
        assert_eq!((&found["latched"], found["since"].is_string()), (&json!(latched), latched));
        assert_eq!(go(&second).await.status().as_u16(), if latched { 409 } else { 202 });
    }
}

/// Who asks first reads it, and everybody else waits for that: on real threads, with nothing between the start and the
/// first commands.
#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn nobody_gets_past_the_first_reading_of_the_stop() {
    let folder = left_latched().await;
    for round in 0..10 {
        let fakes = fakes();
        let config = Arc::new(Config::default());
        let store = Store::open(folder.path());
        let service = Service::start(config, "a test's configuration".to_owned(), fakes.bench.clone(), store);
        let permit = permit(&service);
        let mut asked = tokio::task::JoinSet::new();
        for n in 0..16 {
            let (service, permit) = (Arc::clone(&service), permit.clone());
            let axis = AxisName::ALL[n % 2];
            asked.spawn(async move { service.move_axis(&permit, axis, Millimetres(1.0)).await });
        }
        while let Some(answer) = asked.join_next().await {
            let refused = answer.unwrap().unwrap_err();
            let known = matches!(&refused, ServiceError::Refused(Refusal::Stopped | Refusal::Moving { .. }));
            assert!(known, "round {round}: {refused}");
        }
        assert!(fakes.e.told.lock().unwrap().is_empty(), "round {round}");
        service.shut_down().await;
    }
}

#[tokio::test]
async fn a_reset_that_cannot_be_written_releases_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (first, fakes, store) = daemon(folder.path()).await;
    first.written().await;
    stop(&first).await;
    store.hinder(Hindrance { full: true, ..Hindrance::default() });
    let found = problem(first.reset_stop().await, 503, "not-kept").await;
    assert!(found["detail"].as_str().unwrap().contains("the disk is full"), "{found}");
    store.hinder(Hindrance::default());
    let seen = writable(&first).await;
    assert_eq!((&seen["latched"], &seen["reset"]), (&json!(true), &Value::Null));
    refused(&first, &fakes).await;
    first.as_killed().await;
    let (second, fakes, _store) = daemon(folder.path()).await;
    writable(&second).await;
    refused(&second, &fakes).await;
    assert_eq!(second.reset_stop().await.status(), 200);
    assert_eq!(go(&second).await.status(), 202);
}

#[tokio::test]
async fn a_stop_that_could_not_be_written_is_written_when_it_can_be() {
    let folder = tempfile::tempdir().unwrap();
    let (first, _fakes, store) = daemon(folder.path()).await;
    assert_eq!(go(&first).await.status(), 202);
    store.hinder(Hindrance { full: true, ..Hindrance::default() });
    stop_once(&first, "full", |bench| bench["history_fault"].is_string()).await;
    stop(&first).await;
    // It has been tried, and failed.
    first.written().await;
    store.hinder(Hindrance::default());
    let mut stopped = writable(&first).await;
    until_latched(folder.path()).await;
    first.service.shut_down().await;
    let (second, fakes, _store) = daemon(folder.path()).await;
    // What an earlier run's order came to says nothing of the axes now.
    stopped["delivery"] = Value::Null;
    let found = stop_once(&second, "read", |bench| bench["stop"]["since"].is_string()).await;
    assert_eq!(found, stopped);
    refused(&second, &fakes).await;
}

/// What is kept of the stop.
fn kept(folder: &Path) -> String {
    kept_under(folder, "stop")
}

fn kept_under(folder: &Path, key: &str) -> String {
    let database = rusqlite::Connection::open(folder.join("history.db")).unwrap();
    database.query_row("SELECT value FROM kept WHERE key = ?", [key], |row| row.get(0)).unwrap()
}

/// A power failure right behind the answer loses nothing that the answer has told.
#[tokio::test]
async fn what_is_answered_of_a_stop_and_of_the_lease_is_on_the_disk() {
    let folder = tempfile::tempdir().unwrap();
    let (daemon, _fakes, store) = daemon(folder.path()).await;
    writable(&daemon).await;
    for _ in 0..20 {
        let answer: Value = daemon.request(Method::POST, STOP).send().await.unwrap().json().await.unwrap();
        assert_eq!((&answer["kept"], kept(folder.path()).contains("\"latched\":true")), (&json!(true), true));
        assert_eq!(daemon.reset_stop().await.status(), 200);
        assert!(kept(folder.path()).contains("\"latched\":false"));

        let request = || LeaseRequest { owner: "somebody else".to_owned(), note: None, ttl: Duration::from_secs(30) };
        let grant = daemon.service.take_over(request()).await;
        assert!(kept_under(folder.path(), "lease").contains("somebody else"));
        daemon.service.release_lease(Some(&grant.key)).await.unwrap();
        assert_eq!(kept_under(folder.path(), "lease"), "null");
    }
    store.hinder(Hindrance { full: true, ..Hindrance::default() });
    let answer: Value = daemon.request(Method::POST, STOP).send().await.unwrap().json().await.unwrap();
    assert_eq!(answer["kept"], false);
    assert!(kept(folder.path()).contains("\"latched\":false"));
    store.hinder(Hindrance::default());
    until_latched(folder.path()).await;
}

/// A stop given while the program ends is somebody's, too.
#[tokio::test]
async fn a_stop_while_the_program_ends_is_kept_and_its_own_end_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let (first, _fakes, _store) = daemon(folder.path()).await;
    writable(&first).await;
    first.service.come_to_rest().await;
    assert!(first.service.bench_view().stop.latched);
    first.service.stop(tokio::time::Instant::now(), "ada").await;
    first.service.end().await;
    assert!(kept(folder.path()).contains("\"by\":\"ada\""), "{}", kept(folder.path()));
}

#[tokio::test]
async fn the_end_of_the_program_says_that_a_stop_is_not_on_the_disk() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    std::fs::write(&state, "in the way").unwrap();
    let mut command = plenalign(&state);
    command.args(["serve", "--simulated", "--json", "--listen", "127.0.0.1:0"]);
    command.env_remove("RUST_LOG").env("TMPDIR", folder.path()).env_remove("XDG_RUNTIME_DIR");
    let program = Program::start(command);
    let answer = client().post(format!("{}{STOP}", program.url())).send().await.unwrap();
    assert_eq!(answer.json::<Value>().await.unwrap()["kept"], false);
    program.terminate();
    let (_, _, log) = program.end(Duration::from_secs(10));
    assert!(log.contains("the bench is stopped, and that is not on the disk"), "{log}");
}

#[tokio::test]
async fn a_reset_that_was_given_up_does_not_come_to_the_disk_later() {
    let folder = tempfile::tempdir().unwrap();
    let (first, _fakes, store) = daemon(folder.path()).await;
    writable(&first).await;
    stop(&first).await;
    first.written().await;
    // Slower than anybody waits; what comes after this one finds the disk full, as if the power had failed.
    store.hinder(Hindrance { delay: Duration::from_secs(6), ..Hindrance::default() });
    let late = problem(first.reset_stop().await, 503, "not-kept").await;
    assert!(late["detail"].as_str().unwrap().contains("within 5s"), "{late}");
    store.hinder(Hindrance { full: true, ..Hindrance::default() });
    stop_once(&first, "full", |bench| bench["history_fault"].is_string()).await;
    assert!(kept(folder.path()).contains("\"latched\":true"), "{}", kept(folder.path()));
    first.service.end().await;
    let (second, fakes, _store) = daemon(folder.path()).await;
    writable(&second).await;
    refused(&second, &fakes).await;
}

#[tokio::test]
async fn a_stop_that_the_full_queue_did_not_take_is_written_when_it_does() {
    let folder = tempfile::tempdir().unwrap();
    let (first, _fakes, store) = daemon(folder.path()).await;
    writable(&first).await;
    assert_eq!(go(&first).await.status(), 202);
    first.written().await;
    let (held, let_go) = std::sync::mpsc::channel::<()>();
    let (begun, has_begun) = tokio::sync::oneshot::channel();
    store.queue(move |_| {
        let _ = begun.send(());
        // Until the test lets it go.
        let _ = let_go.recv();
        Ok(())
    });
    // Taken from the queue after it is full, it would leave room for one more.
    has_begun.await.unwrap();
    while store.queue(|_| Ok(())) {}
    stop(&first).await;
    assert!(!kept(folder.path()).contains("\"latched\":true"), "there was no room for it");
    drop(held);
    until_latched(folder.path()).await;
}

/// What comes back for a request whose body comes to its end after a stop and its reset.
async fn overtaken_by_a_stop(daemon: &Daemon, path: &str, body: &Value) -> String {
    let (key, body) = (daemon.lease().await.to_owned(), body.to_string());
    let head = format!(
        "POST {path} HTTP/1.1\r\nhost: 127.0.0.1\r\n{LEASE_HEADER}: {key}\r\ncontent-type: application/json\r\n\
         expect: 100-continue\r\nconnection: close\r\ncontent-length: {}\r\n\r\n",
        body.len()
    );
    let mut stream = tokio::net::TcpStream::connect(daemon.address).await.unwrap();
    stream.write_all(head.as_bytes()).await.unwrap();
    // It is said that the body may come once its reading has begun.
    let mut go_on = [0; 25];
    stream.read_exact(&mut go_on).await.unwrap();
    assert_eq!(&go_on, b"HTTP/1.1 100 Continue\r\n\r\n");
    stream.write_all(&body.as_bytes()[..5]).await.unwrap();
    stop(daemon).await;
    assert_eq!(daemon.reset_stop().await.status(), 200);
    stream.write_all(&body.as_bytes()[5..]).await.unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await.unwrap();
    answer
}

#[tokio::test]
async fn what_was_asked_for_before_a_stop_does_not_begin_after_its_reset_however_late_its_body_comes() {
    let fakes = fakes();
    let daemon = Daemon::start(fakes.bench.clone()).await;
    let jog = json!({ "towards": "low", "press": "a" });
    for (path, body, kind) in [
        (MOVE, json!({ "position_mm": 29.0 }), "stopped"),
        ("/api/v1/axes/e/jog", json!({ "towards": "low" }), "stopped"),
        ("/api/v1/axes/e/jog", jog.clone(), "press-ended"),
        ("/api/v1/jobs", json!({ "kind": "homing" }), "stopped"),
    ] {
        let answer = overtaken_by_a_stop(&daemon, path, &body).await;
        assert!(answer.starts_with("HTTP/1.1 409 "), "{path} {body}: {answer}");
        assert!(answer.contains(&format!("urn:plenalign:problem:{kind}\"")), "{path} {body}: {answer}");
    }
    let again = daemon.command(Method::POST, "/api/v1/axes/e/jog", &jog).await;
    problem(again, 409, "press-ended").await;
    assert!(fakes.e.told.lock().unwrap().is_empty());
    assert_eq!(go(&daemon).await.status(), 202, "what is asked for now moves");
}
