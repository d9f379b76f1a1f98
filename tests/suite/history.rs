//! The history through the API: what outlives a program, pages, the same request twice, and a disk that cannot be
//! written.

use std::path::Path;

use plenalign::api::error::LEASE_HEADER;
use plenalign::config::Config;
use plenalign::store::Store;
use plenalign::store::records::Audit;
use reqwest::{Method, Response};
use serde_json::{Value, json};

use super::bench::permit;
use super::daemon::{Daemon, client, problem};
use super::fakes::{Fakes, fakes};
use super::program::{Program, serve};
use super::until::{until, when};

const JOBS: &str = "/api/v1/jobs";

/// A daemon over stand-ins with its history in a folder. A job there waits for its operator for ever.
async fn daemon(folder: &Path) -> (Daemon, Fakes) {
    let fakes = fakes();
    let mut config = Config::default();
    config.bench.camera.timeout_ms = 300;
    let daemon = Daemon::start_keeping(config, fakes.bench.clone(), Store::open(folder)).await;
    (daemon, fakes)
}

async fn create(daemon: &Daemon) -> Value {
    ask_for(daemon, &json!({ "kind": "joint_alignment", "note": "Camera 17" })).await
}

async fn ask_for(daemon: &Daemon, job: &Value) -> Value {
    let response = daemon.command(Method::POST, JOBS, job).await;
    assert_eq!(response.status(), 201);
    response.json().await.unwrap()
}

async fn json_of(response: Response) -> Value {
    assert!(response.status().is_success(), "{response:?}");
    response.json().await.unwrap()
}

async fn get(daemon: &Daemon, path: &str) -> Value {
    json_of(daemon.get(path).await).await
}

async fn waiting(daemon: &Daemon, job: &Value) -> Value {
    let href = job["href"].as_str().unwrap();
    daemon.until(href, "waiting", |job| job["state"] == "waiting_for_operator").await
}

/// A job from its begin to its end.
async fn cancelled(daemon: &Daemon) -> Value {
    let job = create(daemon).await;
    let href = job["href"].as_str().unwrap();
    json_of(daemon.request(Method::DELETE, href).send().await.unwrap()).await;
    daemon.until(href, "cancelled", |job| job["state"] == "cancelled").await
}

#[tokio::test]
async fn a_job_whose_program_ended_first_is_interrupted_and_keeps_its_records() {
    let folder = tempfile::tempdir().unwrap();
    let (first, _fakes) = daemon(folder.path()).await;
    let created = ask_for(&first, &json!({ "kind": "joint_alignment", "record": true })).await;
    let job = waiting(&first, &created).await;
    assert_eq!(job["recording"]["state"], "recording");
    let href = job["href"].as_str().unwrap().to_owned();
    // It is begun beside the job.
    let recording = folder.path().join("recordings").join(job["recording"]["file"].as_str().unwrap());
    until("the recording is begun", async || recording.exists()).await;
    first.as_killed().await;
    let (second, _fakes) = daemon(folder.path()).await;
    let found = second.until(&href, "interrupted", |job| job["state"] == "interrupted").await;
    assert!(found["reason"].as_str().unwrap().contains("before the job did"), "{found}");
    assert_eq!((&found["log"], &found["operator_step"]), (&job["log"], &Value::Null));
    assert!(found["log"].as_array().unwrap().len() >= 3);
    // Nor is it recorded any more, and what there is of the recording can be had.
    assert_eq!(found["recording"]["state"], "failed");
    assert!(found["recording"]["fault"].as_str().unwrap().contains("program ended"), "{found}");
    assert_eq!(second.get(&format!("{href}/recording")).await.status(), 200);
    assert!(found["ended_at"].is_string() && found["generation"].as_u64() > job["generation"].as_u64());
    let list = get(&second, "/api/v1/jobs?state=interrupted,failed").await;
    assert_eq!(list["jobs"][0]["id"], job["id"]);
    let log = get(&second, &format!("{href}/log")).await;
    assert_eq!(log["lines"], job["log"]);
    // It is over: cancelling changes nothing, and nothing can be confirmed.
    let again = json_of(second.request(Method::DELETE, &href).send().await.unwrap()).await;
    assert_eq!(again["state"], "interrupted");
    let late = second.command(Method::POST, &format!("{href}/confirm"), &json!({ "step": 1 })).await;
    problem(late, 409, "job-state").await;
    // The bench is free.
    waiting(&second, &create(&second).await).await;
}

#[tokio::test]
async fn the_stop_stays_latched_over_a_restart_until_it_is_reset() {
    let folder = tempfile::tempdir().unwrap();
    let (first, _fakes) = daemon(folder.path()).await;
    let stop = async || {
        when(json_of(first.request(Method::POST, "/api/v1/stop").send().await.unwrap()).await, |stop| {
            stop["kept"] == true
        })
    };
    until("kept", stop).await;
    let mut stopped = get(&first, "/api/v1/stop").await;
    first.as_killed().await;

    let (second, _fakes) = daemon(folder.path()).await;
    // What an earlier run's order came to says nothing of the axes now.
    stopped["delivery"] = Value::Null;
    let found = second.until("/api/v1/stop", "read", |stop| stop["since"].is_string()).await;
    assert_eq!(found, stopped, "since the same time");
    problem(
        second.command(Method::POST, "/api/v1/axes/focus/move", &json!({ "position_mm": 1.0 })).await,
        409,
        "stopped",
    )
    .await;
    problem(second.command(Method::POST, JOBS, &json!({ "kind": "joint_alignment" })).await, 409, "stopped").await;
    json_of(second.reset_stop().await).await;
    second.as_killed().await;

    let (third, _fakes) = daemon(folder.path()).await;
    third.until("/api/v1/stop", "reset", |stop| stop["latched"] == false).await;
    let moved = third.command(Method::POST, "/api/v1/axes/focus/move", &json!({ "position_mm": 1.0 })).await;
    assert_eq!(moved.status(), 202);
}

/// The end of the program latches the stop, too, and that is nobody's stop.
#[tokio::test]
async fn an_orderly_end_leaves_no_stop_behind() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path());
    let service = plenalign::control::Service::start(
        std::sync::Arc::new(Config::default()),
        "a test's configuration".to_owned(),
        fakes().bench,
        store,
    );
    let (focus, to) = (plenalign::device::AxisName::Focus, plenalign::units::Millimetres(1.0));
    service.move_axis(&permit(&service), focus, to).await.unwrap();
    service.shut_down().await;
    let (second, _fakes) = daemon(folder.path()).await;
    second.until("/api/v1/stop", "read", |stop| stop["latched"] == false).await;
    assert_eq!(
        second.command(Method::POST, "/api/v1/axes/focus/move", &json!({ "position_mm": 0.0 })).await.status(),
        202
    );
}

#[tokio::test]
async fn jobs_of_all_runs_are_listed_a_page_at_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let mut all = Vec::new();
    for _ in 0..2 {
        let (daemon, _fakes) = daemon(folder.path()).await;
        for _ in 0..3 {
            all.insert(0, cancelled(&daemon).await["id"].clone());
        }
        daemon.as_killed().await;
    }
    let (daemon, _fakes) = daemon(folder.path()).await;
    let running = waiting(&daemon, &create(&daemon).await).await;
    all.insert(0, running["id"].clone());

    let (mut seen, mut path) = (Vec::new(), "/api/v1/jobs?limit=3".to_owned());
    for page in 0.. {
        let list = get(&daemon, &path).await;
        let jobs = list["jobs"].as_array().unwrap();
        assert_eq!(jobs.len(), if page < 2 { 3 } else { 1 });
        seen.extend(jobs.iter().map(|job| job["id"].clone()));
        let Some(next) = list["next"].as_str() else { break };
        path = format!("/api/v1/jobs?limit=3&cursor={next}");
    }
    assert_eq!(seen, all, "newest first, each once");

    let ids = async |query: &str| -> Vec<Value> {
        let list = get(&daemon, &format!("/api/v1/jobs?{query}")).await;
        list["jobs"].as_array().unwrap().iter().map(|job| job["id"].clone()).collect()
    };
    assert_eq!(ids("state=waiting_for_operator").await, all[..1]);
    assert_eq!(ids("state=cancelled").await, all[1..]);
    assert_eq!(ids("kind=joint_alignment&limit=500").await, all);
    let third = get(&daemon, &format!("{JOBS}/{}", all[2].as_str().unwrap())).await;
    let since = third["created_at"].as_str().unwrap();
    assert_eq!(ids(&format!("since={since}")).await, all[..3]);
    assert_eq!(ids(&format!("until={since}")).await, all[3..]);
    assert_eq!(ids(&format!("q={}", all[5].as_str().unwrap().to_uppercase())).await, all[5..6]);
    // In the log, of memory and of the history alike.
    assert_eq!(ids("q=design:%20a%20TEST").await, all);
    assert_eq!(ids("q=100%25").await, Vec::<Value>::new());
    // By what it is for, and by who started it.
    assert_eq!((ids("q=camera%2017").await, ids("q=A%20test").await), (all.clone(), all));
    let list = get(&daemon, "/api/v1/jobs?limit=500").await;
    let told = |job: &Value| (&job["note"], &job["owner"]) == (&json!("Camera 17"), &json!("a test"));
    assert!(list["jobs"].as_array().unwrap().iter().all(told), "{list}");
}

#[tokio::test]
async fn a_query_that_says_nothing_names_its_parameter() {
    let (daemon, _fakes) = daemon(tempfile::tempdir().unwrap().path()).await;
    for (query, field) in [
        ("limit=0", "limit"),
        ("limit=501", "limit"),
        ("limit=many", "limit"),
        ("state=asleep", "state"),
        ("state=failed,", "state"),
        ("kind=polish", "kind"),
        ("since=yesterday", "since"),
        ("cursor=7", "cursor"),
        ("colour=red", "colour"),
        ("limit=1&limit=2", "limit"),
    ] {
        let found = problem(daemon.get(&format!("{JOBS}?{query}")).await, 422, "invalid").await;
        assert_eq!(found["field"], field, "{query}: {found}");
        assert!(found["detail"].as_str().unwrap().starts_with(field), "{found}");
    }
    let found = problem(daemon.get("/api/v1/audit?cursor=x").await, 422, "invalid").await;
    assert_eq!(found["field"], "cursor");
}

#[tokio::test]
async fn the_same_request_under_the_same_name_is_the_same_job() {
    let folder = tempfile::tempdir().unwrap();
    let (first, _fakes) = daemon(folder.path()).await;
    let send = async |daemon: &Daemon, key: &str, body: Value| {
        let request = daemon.request(Method::POST, JOBS).header("Idempotency-Key", key);
        request.header(LEASE_HEADER, daemon.lease().await).json(&body).send().await.unwrap()
    };
    let body = || json!({ "kind": "joint_alignment" });
    // At the same moment, as after a time-out of the client's.
    let (one, two) = tokio::join!(send(&first, "k 1", body()), send(&first, "k 1", body()));
    let mut statuses = [one.status().as_u16(), two.status().as_u16()];
    statuses.sort_unstable();
    assert_eq!(statuses, [200, 201]);
    assert_eq!(one.headers()["location"], two.headers()["location"]);
    let (one, two) = (json_of(one).await, json_of(two).await);
    assert_eq!(one["id"], two["id"]);
    // Without the name the bench is held.
    problem(first.command(Method::POST, JOBS, &body()).await, 409, "busy").await;
    problem(send(&first, "k 2", body()).await, 409, "busy").await;

    // Over a restart.
    first.as_killed().await;
    let (second, _fakes) = daemon(folder.path()).await;
    let again = send(&second, "k 1", body()).await;
    assert_eq!(again.status(), 200);
    let again = json_of(again).await;
    assert_eq!((&again["id"], &again["state"]), (&one["id"], &json!("interrupted")));
    assert_eq!(send(&second, "k 2", body()).await.status(), 201, "a refusal takes no name");

    for key in ["", "   ", &"x".repeat(256), "\u{e9}"] {
        let found = problem(send(&second, key, body()).await, 422, "invalid").await;
        assert_eq!(found["field"], "Idempotency-Key");
    }
}

/// The history's own record of the request is what another body is told from: there is one kind of job only.
#[tokio::test]
async fn a_name_that_stands_for_another_request_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (first, _fakes) = daemon(folder.path()).await;
    let body = json!({ "kind": "joint_alignment" });
    let send = async |daemon: &Daemon| {
        let request = daemon.request(Method::POST, JOBS).header("Idempotency-Key", "k");
        request.header(LEASE_HEADER, daemon.lease().await).json(&body).send().await.unwrap()
    };
    let job = json_of(send(&first).await).await;
    first.as_killed().await;
    let database = rusqlite::Connection::open(folder.path().join("history.db")).unwrap();
    database.execute("UPDATE jobs SET request = '{\"kind\":\"other\"}'", []).unwrap();
    let (second, _fakes) = daemon(folder.path()).await;
    let found = problem(send(&second).await, 422, "idempotency-key-reused").await;
    assert_eq!((&found["job"], &found["href"]), (&job["id"], &job["href"]));

    // A day later the name is free.
    let day_before = i64::try_from(jiff::Timestamp::now().as_nanosecond()).unwrap() - 25 * 3600 * 1_000_000_000;
    database.execute("UPDATE jobs SET created_at = ?", [day_before]).unwrap();
    assert_eq!(send(&second).await.status(), 201);
}

#[tokio::test]
async fn without_a_history_nothing_moves_and_everything_is_seen() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    // From the start.
    std::fs::write(&state, "in the way").unwrap();
    let (daemon, fakes) = daemon(&state).await;
    let go = async || daemon.command(Method::POST, "/api/v1/axes/focus/move", &json!({ "position_mm": 1.0 })).await;
    let refused = async || {
        let found = problem(
            daemon.command(Method::POST, JOBS, &json!({ "kind": "joint_alignment" })).await,
            503,
            "history-unwritable",
        );
        assert!(found.await["detail"].as_str().unwrap().contains("state"));
        problem(go().await, 503, "history-unwritable").await;
        let home = daemon.command(Method::POST, "/api/v1/axes/e/home", &json!({})).await;
        problem(home, 503, "history-unwritable").await;
        let bench = daemon.until("/api/v1/bench", "said", |bench| bench["history_fault"].is_string()).await;
        assert!(bench["history_fault"].as_str().unwrap().contains("state"), "{bench}");
        assert_eq!(bench["axes"][0]["position_mm"], 0.0, "nothing has moved");
        // Viewing and stopping go on.
        fakes.camera.take(9);
        assert_eq!(daemon.get("/api/v1/frame.png").await.status(), 200);
        let stopped = json_of(daemon.request(Method::POST, "/api/v1/stop").send().await.unwrap()).await;
        assert_eq!(stopped["focus"], "confirmed");
        problem(daemon.reset_stop().await, 503, "not-kept").await;
        let list = get(&daemon, JOBS).await;
        assert!(list["history_fault"].is_string(), "{list}");
    };
    refused().await;
    std::fs::remove_file(&state).unwrap();
    daemon.until("/api/v1/bench", "writable", |bench| bench["history_fault"].is_null()).await;
    json_of(daemon.reset_stop().await).await;
    let job = waiting(&daemon, &create(&daemon).await).await;
    let href = job["href"].as_str().unwrap();

    // Later, with a job under way: what it has done is written again once it can be.
    std::fs::remove_dir_all(&state).unwrap();
    std::fs::write(&state, "in the way").unwrap();
    json_of(daemon.request(Method::DELETE, href).send().await.unwrap()).await;
    let ended = daemon.until(href, "cancelled", |job| job["state"] == "cancelled").await;
    refused().await;
    std::fs::remove_file(&state).unwrap();
    daemon.until("/api/v1/bench", "writable", |bench| bench["history_fault"].is_null()).await;
    json_of(daemon.reset_stop().await).await;
    assert_eq!(go().await.status(), 202);
    daemon.as_killed().await;
    let (second, _fakes) = self::daemon(&state).await;
    let kept = second.until(href, "there", |_| true).await;
    assert_eq!((&kept["state"], &kept["log"]), (&json!("cancelled"), &ended["log"]));
}

#[tokio::test]
async fn the_audit_log_is_read_a_page_at_a_time() {
    let daemon = Daemon::start(fakes().bench).await;
    for n in 0..3 {
        daemon.service.audit(Audit {
            at: jiff::Timestamp::now(),
            who: "Ada".to_owned(),
            what: "job.create".to_owned(),
            detail: json!({ "n": n }),
            from: Some("127.0.0.1".to_owned()),
        });
    }
    let first = get(&daemon, "/api/v1/audit?limit=2").await;
    let of = |list: &Value| -> Vec<Value> {
        list["entries"].as_array().unwrap().iter().map(|entry| entry["detail"]["n"].clone()).collect()
    };
    assert_eq!(of(&first), [json!(2), json!(1)]);
    assert_eq!((&first["entries"][0]["who"], &first["entries"][0]["from"]), (&json!("Ada"), &json!("127.0.0.1")));
    let next = first["next"].as_str().unwrap();
    let rest = get(&daemon, &format!("/api/v1/audit?limit=2&cursor={next}")).await;
    assert_eq!((of(&rest), &rest["next"]), (vec![json!(0)], &Value::Null));
}

#[tokio::test]
async fn the_control_lease_outlives_a_restart() {
    let folder = tempfile::tempdir().unwrap();
    let (first, _fakes) = daemon(folder.path()).await;
    first.until("/api/v1/stop", "read", |stop| stop["latched"] == false).await;
    let key = first.lease().await.to_owned();
    first.as_killed().await;
    let (second, _fakes) = daemon(folder.path()).await;
    second.until("/api/v1/bench", "held", |bench| bench["lease"]["owner"] == "a test").await;
    let heartbeat = second.request(reqwest::Method::POST, "/api/v1/lease/heartbeat");
    assert_eq!(heartbeat.header("Plenalign-Lease", key).send().await.unwrap().status(), 200);
    let refused = second.post("/api/v1/lease", &json!({ "owner": "another" })).await;
    assert_eq!(refused.status(), 409);
}

/// The program itself, with a state folder that is none.
#[tokio::test]
async fn a_daemon_starts_without_a_history_and_shows_its_bench() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    std::fs::write(&state, "in the way").unwrap();
    // A bench of its own, so that its lock among the temporary files is nobody else's.
    let config = folder.path().join("bench.toml");
    std::fs::write(&config, "[bench.simulation]\nrays = 4\n[sensor]\nwidth_px = 400\nheight_px = 400\n").unwrap();
    let mut command = serve(folder.path(), &[]);
    command.env("PLENALIGN_STATE_DIR", &state).env("TMPDIR", folder.path());
    let program = Program::start(command);
    let url = program.url();
    let client = client();
    let lease = client.post(format!("{url}/api/v1/lease")).json(&json!({ "owner": "a test" })).send().await.unwrap();
    let key = lease.json::<Value>().await.unwrap()["key"].as_str().unwrap().to_owned();
    let request = client.post(format!("{url}/api/v1/jobs")).header(LEASE_HEADER, key);
    let refused = request.json(&json!({ "kind": "joint_alignment" })).send().await.unwrap();
    problem(refused, 503, "history-unwritable").await;
    let frame = client.get(format!("{url}/api/v1/snapshot.jpg")).send().await.unwrap();
    assert_eq!(frame.status(), 200);
}
