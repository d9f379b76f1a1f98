//! The control lease over HTTP: nothing moves without it, one has it at a time, a job keeps it, an admin takes it.

use std::sync::Arc;

use jiff::{SignedDuration, Timestamp};
use plenalign::api::error::LEASE_HEADER;
use plenalign::control::open_bench;
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};

use super::bench::small_config;
use super::daemon::{Daemon, problem};
use super::fakes::fakes;
use super::until::until;

async fn take(daemon: &Daemon, owner: &str) -> (String, Value) {
    let granted = daemon.post("/api/v1/lease", &json!({ "owner": owner, "note": "tests", "ttl_s": 60 })).await;
    assert_eq!(granted.status(), StatusCode::CREATED);
    let granted: Value = granted.json().await.unwrap();
    (granted["key"].as_str().unwrap().to_owned(), granted["lease"].clone())
}

async fn with_key(daemon: &Daemon, method: Method, path: &str, key: &str, body: &Value) -> reqwest::Response {
    daemon.request(method, path).header(LEASE_HEADER, key).json(body).send().await.unwrap()
}

#[tokio::test]
async fn motion_needs_the_lease_and_reading_and_stopping_do_not() {
    let daemon = Daemon::start(fakes().bench).await;
    let commands = [
        (Method::POST, "/api/v1/axes/focus/move", json!({ "position_mm": 1.0 })),
        (Method::POST, "/api/v1/axes/e/home", Value::Null),
        (Method::POST, "/api/v1/jobs", json!({ "kind": "joint_alignment" })),
        (Method::PUT, "/api/v1/shell", json!({ "state": "off" })),
        (Method::POST, "/api/v1/lease/heartbeat", Value::Null),
    ];
    for (method, path, body) in &commands {
        let none = daemon.request(method.clone(), path).json(body).send().await.unwrap();
        let found = problem(none, 428, "lease-required").await;
        assert!(found["detail"].as_str().unwrap().contains("/api/v1/lease"), "{found}");
        problem(with_key(&daemon, method.clone(), path, "guess", body).await, 412, "lease-lost").await;
    }
    assert_eq!(daemon.get("/api/v1/bench").await.status(), 200);
    assert_eq!(daemon.request(Method::POST, "/api/v1/stop").send().await.unwrap().status(), 200);
    assert_eq!(daemon.reset_stop().await.status(), 200);

    let (key, lease) = take(&daemon, "ada").await;
    let moved = with_key(&daemon, Method::POST, "/api/v1/axes/focus/move", &key, &commands[0].2).await;
    assert_eq!(moved.status(), 202);
    let seen: Value = daemon.get("/api/v1/lease").await.json().await.unwrap();
    assert_eq!((&seen["lease"]["id"], &seen["lease"]["owner"]), (&lease["id"], &json!("ada")));
    assert!(!seen.to_string().contains(&key), "the key is for the holder alone");
    let bench: Value = daemon.get("/api/v1/bench").await.json().await.unwrap();
    assert_eq!(bench["lease"]["owner"], "ada");

    let refused = daemon.post("/api/v1/lease", &json!({ "owner": "bob" })).await;
    let refused = problem(refused, 409, "lease-held").await;
    assert_eq!((&refused["owner"], &refused["note"]), (&json!("ada"), &json!("tests")));
    problem(
        with_key(&daemon, Method::POST, "/api/v1/axes/focus/move", "bob's", &commands[0].2).await,
        412,
        "lease-lost",
    )
    .await;

    for _ in 0..2 {
        let released = with_key(&daemon, Method::DELETE, "/api/v1/lease", &key, &Value::Null).await;
        assert_eq!(released.status(), StatusCode::NO_CONTENT);
    }
    take(&daemon, "bob").await;
}

#[tokio::test]
async fn a_lease_asked_for_badly_says_what_would_be_right() {
    let daemon = Daemon::start(fakes().bench).await;
    for (body, field) in [
        (json!({}), "owner"),
        (json!({ "owner": " " }), "owner"),
        (json!({ "owner": "a\u{7}" }), "owner"),
        (json!({ "owner": "ada", "note": "x".repeat(201) }), "note"),
        (json!({ "owner": "ada\u{202e}", "note": "x" }), "owner"),
        (json!({ "owner": "ada", "note": "to 1.5 mm\u{2066}" }), "note"),
        (json!({ "owner": "ada", "ttl_s": 1e9 }), "ttl_s"),
        (json!({ "owner": "ada", "ttl": 3 }), "ttl"),
    ] {
        let refused = problem(daemon.post("/api/v1/lease", &body).await, 422, "invalid").await;
        assert_eq!(refused["field"], field, "{body}");
    }
}

#[tokio::test]
async fn a_job_keeps_its_starters_lease_and_a_takeover_cancels_it_first() {
    let mut config = small_config(1);
    config.bench.simulation.operator_confirms = false;
    let bench = open_bench(&Arc::new(config.clone())).await.unwrap();
    let daemon = Daemon::start_with(config, bench).await;
    let (key, _) = take(&daemon, "ada").await;
    let job = with_key(&daemon, Method::POST, "/api/v1/jobs", &key, &json!({ "kind": "joint_alignment" })).await;
    let job: Value = job.json().await.unwrap();
    assert_eq!(job["owner"], "ada");
    with_key(&daemon, Method::DELETE, "/api/v1/lease", &key, &Value::Null).await;
    let refused = problem(daemon.post("/api/v1/lease", &json!({ "owner": "bob" })).await, 409, "lease-held").await;
    assert_eq!(refused["job"], job["id"], "given back, but the job goes on");

    let taken = daemon.post("/api/v1/lease/takeover", &json!({ "owner": "chief" })).await;
    assert_eq!(taken.status(), StatusCode::CREATED);
    let ended: Value = daemon.get(job["href"].as_str().unwrap()).await.json().await.unwrap();
    assert_eq!(ended["state"], "cancelled");
    assert_eq!(ended["reason"], "the control lease was taken over by chief");
    let seen: Value = daemon.get("/api/v1/lease").await.json().await.unwrap();
    assert_eq!(seen["lease"]["owner"], "chief");
}

#[tokio::test]
async fn a_lease_that_is_not_renewed_runs_out_and_everybody_is_told() {
    let daemon = Daemon::start(fakes().bench).await;
    let granted = daemon.post("/api/v1/lease", &json!({ "owner": "ada", "ttl_s": 2 })).await;
    let granted: Value = granted.json().await.unwrap();
    let key = granted["key"].as_str().unwrap();
    let ends = |lease: &Value| lease["expires_at"].as_str().unwrap().parse::<Timestamp>().unwrap();
    let first = ends(&granted["lease"]);
    until("its first term is over", async || {
        let renewed = with_key(&daemon, Method::POST, "/api/v1/lease/heartbeat", key, &Value::Null).await;
        assert_eq!(renewed.status(), 200);
        Timestamp::now() > first
    })
    .await;
    let bench: Value = daemon.get("/api/v1/bench").await.json().await.unwrap();
    assert_eq!(bench["lease"]["owner"], "ada", "renewed in time");
    let end = ends(&bench["lease"]) + SignedDuration::from_millis(200);
    until("its last term is over", async || Timestamp::now() > end).await;
    let bench: Value = daemon.get("/api/v1/bench").await.json().await.unwrap();
    assert_eq!(bench["lease"], Value::Null);
    problem(with_key(&daemon, Method::POST, "/api/v1/lease/heartbeat", key, &Value::Null).await, 412, "lease-lost")
        .await;
}
