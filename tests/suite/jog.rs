//! Jogging over HTTP: an axis moves for as long as somebody asks.

use std::sync::Arc;

use plenalign::control::open_bench;
use reqwest::Method;
use serde_json::{Value, json};

use super::bench::{frames, small_config};
use super::daemon::{Daemon, problem};
use super::until::{until, when};

async fn axis(daemon: &Daemon, name: &str) -> Value {
    let bench: Value = daemon.get("/api/v1/bench").await.json().await.unwrap();
    bench["axes"].as_array().unwrap().iter().find(|axis| axis["axis"] == name).unwrap().clone()
}

async fn at_rest(daemon: &Daemon) -> f64 {
    until("the focus axis is at rest", async || {
        let focus = axis(daemon, "focus").await;
        assert_eq!(focus["failure"], Value::Null);
        if focus["moving"] != false || focus["homed"] != true {
            return Err(focus);
        }
        frames(daemon.service.bench(), 5).await;
        let again = axis(daemon, "focus").await;
        let stands = again["moving"] == false && again["position_mm"] == focus["position_mm"];
        if stands { Ok(again["position_mm"].as_f64().unwrap()) } else { Err(again) }
    })
    .await
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_jog_goes_on_while_it_is_asked_for_and_ends_when_nobody_asks() {
    let config = small_config(1);
    let bench = open_bench(&Arc::new(config.clone())).await.unwrap();
    let daemon = Daemon::start_with(config, bench).await;
    let path = "/api/v1/axes/focus/jog";
    let up = json!({ "towards": "high", "speed_mm_per_s": 1.0 });
    problem(daemon.post(path, &up).await, 428, "lease-required").await;
    problem(daemon.command(Method::POST, path, &up).await, 409, "not-homed").await;
    for (body, field) in
        [(json!({ "towards": "up" }), "towards"), (json!({ "towards": "high", "speed_mm_per_s": 0 }), "speed_mm_per_s")]
    {
        assert_eq!(problem(daemon.command(Method::POST, path, &body).await, 422, "invalid").await["field"], field);
    }
    let fast = json!({ "towards": "high", "speed_mm_per_s": 1e3 });
    let refused = problem(daemon.command(Method::POST, path, &fast).await, 409, "speed").await;
    assert_eq!((&refused["axis"], &refused["speed_mm_per_s"]), (&json!("focus"), &json!(1e3)));
    assert_eq!(daemon.command(Method::POST, "/api/v1/axes/focus/home", &Value::Null).await.status(), 202);
    let start = at_rest(&daemon).await;

    // One request: 0.3 s of it.
    assert_eq!(daemon.command(Method::POST, path, &up).await.status(), 202);
    let once = at_rest(&daemon).await - start;
    assert!(once > 0.05 && once < 0.5, "{once}");

    // Asked for in time: it goes on; another way meanwhile is refused; let go, it ends at once.
    until("it has gone on", async || {
        let answer = daemon.command(Method::POST, path, &up).await;
        assert!(answer.status() == 202 || answer.status() == 409, "{}", answer.status());
        axis(&daemon, "focus").await["position_mm"].as_f64().unwrap() > start + once + 1.0
    })
    .await;
    let down = json!({ "towards": "low" });
    problem(daemon.command(Method::POST, path, &down).await, 409, "moving").await;
    let let_go = daemon.request(Method::DELETE, path).send().await.unwrap();
    assert_eq!(let_go.status(), 200);
    let held = at_rest(&daemon).await - start - once;
    assert!(held > 2.0 * once.min(0.3) && held < 2.0, "{held} after {once}");
    let again = daemon.request(Method::DELETE, path).send().await.unwrap();
    assert_eq!(again.status(), 200, "may be repeated");
}

/// The controller is told a long way in pieces, and stands for a moment between two of them.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_axis_counts_as_moving_until_the_whole_of_its_way_is_done() {
    let config = small_config(1);
    let bench = open_bench(&Arc::new(config.clone())).await.unwrap();
    let daemon = Daemon::start_with(config, bench).await;
    let command = async |path: &str, body: &Value| {
        let answer = daemon.command(Method::POST, path, body).await;
        assert_eq!(answer.status(), 202, "{path}");
        let bench: Value = answer.json().await.unwrap();
        assert_eq!(bench["axes"][0]["moving"], true, "{path}: {bench}");
        until("the focus axis is at rest", async || {
            when(axis(&daemon, "focus").await, |focus| focus["moving"] == false)
        })
        .await
    };
    // Each is accepted as soon as the one before is done with, without a pause.
    let homed = command("/api/v1/axes/focus/home", &Value::Null).await;
    assert_eq!((&homed["homed"], &homed["failure"]), (&json!(true), &Value::Null), "{homed}");
    for target in [4.5, 0.0] {
        let there = command("/api/v1/axes/focus/move", &json!({ "position_mm": target })).await;
        assert!((there["position_mm"].as_f64().unwrap() - target).abs() < 0.011, "{there}");
    }
    let before = command("/api/v1/axes/focus/jog", &json!({ "towards": "high", "speed_mm_per_s": 1.0 })).await;
    frames(daemon.service.bench(), 6).await;
    assert_eq!(axis(&daemon, "focus").await["position_mm"], before["position_mm"]);
}
