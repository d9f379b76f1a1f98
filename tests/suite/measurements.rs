//! Measuring on request: a frame exposed while an axis moved is refused, or says so.

use std::sync::Arc;

use plenalign::control::open_bench;
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};

use super::bench::{quick_axes, small_config};
use super::daemon::{Daemon, problem};
use super::fakes::fakes;

const PATH: &str = "/api/v1/measurements";

/// A daemon whose job has taken a white frame and measured a board, and was then cancelled.
pub(crate) async fn with_white() -> Daemon {
    let mut config = small_config(1);
    config.bench.simulation.rays = 4;
    quick_axes(&mut config.bench);
    // Whatever else the machine does, a long way of it takes longer than a frame and its measurement.
    config.bench.e.speed_mm_per_s = 1.0;
    let bench = open_bench(&Arc::new(config.clone())).await.unwrap();
    let daemon = Daemon::start_with(config, bench).await;
    let watch = json!({ "kind": "spacing_watch", "duration_s": 60.0, "interval_s": 30.0 });
    let job = daemon.command(Method::POST, "/api/v1/jobs", &watch).await;
    assert_eq!(job.status(), StatusCode::CREATED);
    let href = job.headers()["location"].to_str().unwrap().to_owned();
    let measured = |job: &Value| job["iterations"].as_array().is_some_and(|all| !all.is_empty());
    let job = daemon.until(&href, "measured", |job| measured(job) || job["ended_at"].is_string()).await;
    assert!(measured(&job), "{job}");
    daemon.request(Method::DELETE, &href).send().await.unwrap();
    daemon.until(&href, "over", |job| job["ended_at"].is_string()).await;
    daemon
}

async fn still(daemon: &Daemon) -> Value {
    let still = |bench: &Value| bench["axes"].as_array().unwrap().iter().all(|axis| axis["moving"] == false);
    daemon.until("/api/v1/bench", "still", still).await
}

#[tokio::test]
async fn a_measurement_that_spans_motion_is_refused_or_says_so() {
    let daemon = with_white().await;
    still(&daemon).await;
    let before: Value = daemon.get(PATH).await.json().await.unwrap();
    assert_eq!(before, json!({ "measurements": [], "next": null }), "a job's measurements are the job's");

    let at_rest = daemon.post(PATH, &json!({})).await;
    let status = at_rest.status();
    let at_rest: Value = at_rest.json().await.unwrap();
    assert_eq!(status, StatusCode::OK, "{at_rest}");
    assert_eq!((&at_rest["spans_motion"], &at_rest["settled"]), (&json!(false), &json!(true)), "{at_rest}");
    assert_eq!((&at_rest["unsettled"], &at_rest["simulated"]), (&json!([]), &json!(true)));
    assert!(at_rest["spacing"]["spacing_sigma_px"].as_f64().unwrap() > 0.0);
    assert!(at_rest["frame_seq"].as_u64().unwrap() > 0);
    let time = |key: &str| at_rest[key].as_str().unwrap().parse::<jiff::Timestamp>().unwrap();
    assert!(time("exposed_from") < time("captured_at"));

    // The e axis goes its way for 25 s. The job's end may have cost its position.
    let command = async |path: &str, body: &Value| {
        let response = daemon.command(Method::POST, path, body).await;
        assert_eq!(response.status(), StatusCode::ACCEPTED, "{}", response.text().await.unwrap());
    };
    command("/api/v1/axes/e/home", &Value::Null).await;
    let homed = |bench: &Value| bench["axes"][1]["homed"] == true && bench["axes"][1]["moving"] == false;
    daemon.until("/api/v1/bench", "homed", homed).await;
    let bench: Value = daemon.get("/api/v1/bench").await.json().await.unwrap();
    let home = bench["axes"][1]["position_mm"].as_f64().unwrap();
    command("/api/v1/axes/e/move", &json!({ "position_mm": 5.0 })).await;
    // It counts as moving from here on; a frame spans its motion once it has begun.
    let under_way = |bench: &Value| (bench["axes"][1]["position_mm"].as_f64().unwrap_or(home) - home).abs() > 0.1;
    daemon.until("/api/v1/bench", "under way", under_way).await;
    let refused = problem(daemon.post(PATH, &json!({ "settled": true })).await, 409, "spans-motion").await;
    // A controller that says of itself that it runs says so of both of its axes.
    let has_e = |axes: &Value| axes.as_array().is_some_and(|axes| axes.contains(&json!("e")));
    assert!(has_e(&refused["axes"]), "{refused}");
    let moving = daemon.post(PATH, &json!({ "settled": false })).await;
    let status = moving.status();
    let moving: Value = moving.json().await.unwrap();
    assert_eq!(status, StatusCode::OK, "{moving}");
    assert_eq!((&moving["spans_motion"], &moving["settled"]), (&json!(true), &json!(false)), "{moving}");
    assert!(has_e(&moving["unsettled"]), "{moving}");
    daemon.request(Method::POST, "/api/v1/stop").send().await.unwrap();
    still(&daemon).await;

    // What is young enough is not taken again; what spans motion is none of it where settled axes are demanded.
    let last: Value = daemon.post(PATH, &json!({ "settled": false, "max_age_ms": 60_000 })).await.json().await.unwrap();
    let settled = daemon.post(PATH, &json!({ "max_age_ms": 60_000 })).await;
    let settled: Value = settled.json().await.unwrap();
    assert_eq!(settled["spans_motion"], false, "{settled}");
    assert!(settled["frame_seq"].as_u64() >= last["frame_seq"].as_u64());
    let again: Value = daemon.post(PATH, &json!({ "max_age_ms": 60_000 })).await.json().await.unwrap();
    assert_eq!(again["frame_seq"], settled["frame_seq"]);

    // All of them are kept, and none of those refused.
    let first: Value = daemon.get(&format!("{PATH}?limit=2")).await.json().await.unwrap();
    let cursor = first["next"].as_str().unwrap();
    let rest: Value = daemon.get(&format!("{PATH}?limit=2&cursor={cursor}")).await.json().await.unwrap();
    let kept = |page: &Value| page["measurements"].as_array().unwrap().clone();
    assert_eq!(kept(&first), [again, settled]);
    assert_eq!(kept(&rest), [last, moving]);
    let rest: Value =
        daemon.get(&format!("{PATH}?cursor={}", rest["next"].as_str().unwrap())).await.json().await.unwrap();
    assert_eq!((kept(&rest), &rest["next"]), (vec![at_rest], &Value::Null));
}

#[tokio::test]
async fn what_cannot_be_measured_says_why() {
    let daemon = Daemon::start(fakes().bench).await;
    let why = problem(daemon.post(PATH, &json!({})).await, 409, "not-measurable").await;
    assert!(why["detail"].as_str().unwrap().contains("white frame"), "{why}");
    for (body, field) in [
        (json!({ "max_age_ms": 60_001 }), "max_age_ms"),
        (json!({ "settled": 1 }), "settled"),
        (json!({ "x": 1 }), "x"),
    ] {
        assert_eq!(problem(daemon.post(PATH, &body).await, 422, "invalid").await["field"], field);
    }
    let limit = daemon.get(&format!("{PATH}?limit=0")).await;
    assert_eq!(problem(limit, 422, "invalid").await["field"], "limit");
}
