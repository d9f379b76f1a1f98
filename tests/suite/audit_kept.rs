//! The audit log while the history cannot be written: what is done is kept, and written when it can be.

use std::path::Path;
use std::time::Duration;

use jiff::Timestamp;
use plenalign::config::Config;
use plenalign::control::Service;
use plenalign::store::records::Audit;
use plenalign::store::{Health, Hindrance, Page, Store, read};
use reqwest::Method;
use serde_json::{Value, json};

use super::daemon::{Daemon, client};
use super::fakes::fakes;
use super::program::{Program, plenalign};
use super::store::until_health;

fn entry(n: u64) -> Audit {
    let (who, what) = ("Ada".to_owned(), "job.create".to_owned());
    Audit { at: Timestamp::now(), who, what, detail: json!({ "n": n }), from: Some("127.0.0.1".to_owned()) }
}

/// The whole log, oldest first.
async fn entries(store: &Store) -> Vec<Audit> {
    let (mut all, mut before) = (Vec::new(), None);
    loop {
        let Page { items, more } = store.read(move |c| read::audit(c, before, 1000)).await.unwrap();
        before = items.last().map(|(id, _)| *id);
        all.extend(items.into_iter().map(|(_, entry)| entry));
        if !more {
            all.reverse();
            return all;
        }
    }
}

/// What somebody at the page does: each is answered, and each has to be in the log.
async fn work(daemon: &Daemon) -> Vec<&'static str> {
    let ask = async |method: Method, path: &str, key: Option<&str>, body: Value| {
        let mut request = daemon.request(method, path).json(&body);
        if let Some(key) = key {
            request = request.header(plenalign::api::error::LEASE_HEADER, key);
        }
        let answer = request.send().await.unwrap();
        assert!(answer.status().is_success(), "{path}: {}", answer.text().await.unwrap());
        answer
    };
    let lease: Value = ask(Method::POST, "/api/v1/lease", None, json!({ "owner": "Ada" })).await.json().await.unwrap();
    let key = lease["key"].as_str();
    ask(Method::PUT, "/api/v1/shell", key, json!({ "state": "off" })).await;
    ask(Method::POST, "/api/v1/stop", None, Value::Null).await;
    ask(Method::DELETE, "/api/v1/lease", key, Value::Null).await;
    ask(Method::POST, "/api/v1/stop", None, Value::Null).await;
    vec!["lease.take", "shell.set", "stop", "lease.release", "stop"]
}

async fn daemon_over(folder: &Path) -> (Daemon, Store) {
    let store = Store::open(folder);
    store.write(|_| Ok(())).await.unwrap();
    (Daemon::start_keeping(Config::default(), fakes().bench, store.clone()).await, store)
}

#[tokio::test]
async fn what_is_done_while_the_disk_is_full_is_in_the_audit_log_afterwards() {
    let folder = tempfile::tempdir().unwrap();
    let (daemon, store) = daemon_over(folder.path()).await;
    store.hinder(Hindrance { full: true, ..Hindrance::default() });
    until_health(&store, "full", |health| health.fault().is_some()).await;
    let done = work(&daemon).await;
    assert_eq!(entries(&store).await, []);
    store.hinder(Hindrance::default());
    until_health(&store, "writable again", |health| matches!(health, Health::Writable { .. })).await;
    daemon.written().await;
    let found = entries(&store).await;
    assert_eq!(found.iter().map(|entry| entry.what.as_str()).collect::<Vec<_>>(), done);
    assert!(found.is_sorted_by_key(|entry| entry.at) && found.iter().all(|entry| entry.from.is_some()), "{found:#?}");
}

#[tokio::test]
async fn what_is_done_while_the_history_cannot_be_opened_is_in_the_audit_log_afterwards() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let (daemon, store) = daemon_over(&state).await;
    std::fs::remove_dir_all(&state).unwrap();
    std::fs::write(&state, "in the way").unwrap();
    until_health(&store, "unwritable", |health| health.fault().is_some()).await;
    let done = work(&daemon).await;
    std::fs::remove_file(&state).unwrap();
    until_health(&store, "writable again", |health| matches!(health, Health::Writable { .. })).await;
    daemon.written().await;
    let found = entries(&store).await;
    assert_eq!(found.iter().map(|entry| entry.what.as_str()).collect::<Vec<_>>(), done);
}

#[tokio::test]
async fn an_entry_is_kept_when_the_queue_to_the_disk_is_full() {
    let folder = tempfile::tempdir().unwrap();
    let (daemon, store) = daemon_over(folder.path()).await;
    store.hinder(Hindrance { full: false, delay: Duration::from_millis(300) });
    for _ in 0..6000 {
        store.queue(|_| Ok(()));
    }
    for n in 0..3 {
        daemon.service.audit(entry(n));
    }
    store.hinder(Hindrance::default());
    daemon.written().await;
    let found = entries(&store).await;
    assert_eq!(found.iter().map(|entry| entry.detail["n"].clone()).collect::<Vec<_>>(), [json!(0), json!(1), json!(2)]);
}

#[tokio::test]
async fn entries_that_had_to_be_dropped_are_counted_in_one_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let (daemon, store) = daemon_over(folder.path()).await;
    store.hinder(Hindrance { full: true, ..Hindrance::default() });
    until_health(&store, "full", |health| health.fault().is_some()).await;
    let given = 30_000;
    for n in 0..given {
        daemon.service.audit(entry(n));
    }
    store.hinder(Hindrance::default());
    until_health(&store, "writable again", |health| matches!(health, Health::Writable { .. })).await;
    daemon.written().await;
    daemon.service.audit(entry(given));
    daemon.written().await;
    let found = entries(&store).await;
    let kept = found.iter().take_while(|entry| entry.what == "job.create").count();
    assert!(kept >= 1000 && (kept as u64) < given, "{kept} are kept");
    for (n, entry) in found[..kept].iter().enumerate() {
        assert_eq!(entry.detail["n"], n, "the first ones, in order");
    }
    let [dropped, last] = &found[kept..] else { panic!("{:?}", &found[kept..]) };
    assert_eq!((dropped.who.as_str(), dropped.what.as_str()), ("plenalign", "audit.dropped"));
    assert_eq!(dropped.detail["count"], given - kept as u64);
    let time = |key: &str| dropped.detail[key].as_str().unwrap().parse::<Timestamp>().unwrap();
    assert!(found[kept - 1].at <= time("from") && time("from") <= time("until") && time("until") <= last.at);
    assert_eq!(last.detail["n"], given, "what comes after the gap is after the gap");
}

#[tokio::test]
async fn the_end_of_the_program_writes_what_is_still_kept() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path());
    let service = Service::start(Config::default().into(), "a test's".to_owned(), fakes().bench, store.clone());
    service.open_history().await;
    store.hinder(Hindrance { full: true, ..Hindrance::default() });
    until_health(&store, "full", |health| health.fault().is_some()).await;
    (0..600).for_each(|n| service.audit(entry(n)));
    store.hinder(Hindrance::default());
    service.shut_down().await;
    let found = entries(&Store::to_read(folder.path())).await;
    assert_eq!(found.len(), 600);
}

/// Nothing can be written any more: the program's own log is the last place.
#[tokio::test]
async fn what_cannot_be_written_by_the_end_of_the_program_is_in_its_log() {
    let folder = tempfile::tempdir().unwrap();
    let (state, config) = (folder.path().join("state"), folder.path().join("bench.toml"));
    std::fs::write(&state, "in the way").unwrap();
    std::fs::write(&config, "[bench.simulation]\nrays = 4\n").unwrap();
    let mut command = plenalign(&state);
    command.args(["serve", "--simulated", "--json", "--listen", "127.0.0.1:0", "--config"]).arg(&config);
    // What a daemon logs unless it is told otherwise.
    command.env_remove("RUST_LOG").env("TMPDIR", folder.path()).env_remove("XDG_RUNTIME_DIR");
    let program = Program::start(command);
    let asked = json!({ "owner": "Ada, whom the log names" });
    let lease = client().post(format!("{}/api/v1/lease", program.url())).json(&asked).send().await.unwrap();
    assert_eq!(lease.status(), 201);
    program.terminate();
    let (_, _, log) = program.end(Duration::from_secs(10));
    let line = log.lines().find(|line| line.contains("lease.take")).unwrap_or_else(|| panic!("{log}"));
    assert!(line.contains("ERROR") && line.contains("Ada, whom the log names") && line.contains("127.0.0.1"), "{line}");
}
