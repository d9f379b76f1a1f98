//! The HTTP API: routes, refusals and headers.

use std::sync::Arc;
use std::time::Duration;

use plenalign::control::open_bench;
use plenalign::device::StopDelivery;
use reqwest::Method;
use serde_json::{Value, json};

use super::bench::small_config;
use super::daemon::{Daemon, problem};
use super::fakes::fakes;
use super::until::{until, when};

const NO_JOB: &str = "/api/v1/jobs/0199f0f2-5d2a-7c3e-9a53-5f0f6c1f6a11";

#[tokio::test]
async fn what_is_not_there_is_a_problem() {
    let daemon = Daemon::start(fakes().bench).await;
    for path in ["/api/v1/nothing", "/api", "/api/v2/bench", "/nothing.html", "/api/v1/jobs/7", NO_JOB] {
        problem(daemon.get(path).await, 404, "not-found").await;
    }
    let found = problem(daemon.post("/api/v1/axes/z/move", &json!({ "position_mm": 1 })).await, 404, "not-found").await;
    assert!(found["detail"].as_str().unwrap().contains("focus and e"), "{found}");
    for method in [Method::DELETE, Method::PUT, Method::PATCH] {
        let response = daemon.request(method, "/api/v1/bench").send().await.unwrap();
        assert_eq!(response.headers()["allow"], "GET,HEAD");
        problem(response, 405, "method-not-allowed").await;
    }
    problem(daemon.post("/", &json!({})).await, 405, "method-not-allowed").await;
}

#[tokio::test]
async fn what_cannot_be_read_is_told_from_what_does_not_fit() {
    let daemon = Daemon::start(fakes().bench).await;
    for path in ["/api/v1/jobs".to_owned(), "/api/v1/axes/e/move".to_owned(), format!("{NO_JOB}/confirm")] {
        let send = |body: &'static str| {
            daemon.request(Method::POST, &path).header("content-type", "application/json").body(body).send()
        };
        for body in ["", "{", "nonsense", "{}}"] {
            problem(send(body).await.unwrap(), 400, "malformed").await;
        }
        for body in ["{}", "[]", "null", "7"] {
            problem(send(body).await.unwrap(), 422, "invalid").await;
        }
        let response = daemon.request(Method::POST, &path).body("{}").send().await.unwrap();
        problem(response, 415, "unsupported-media-type").await;
        let large = daemon.post(&path, &json!({ "kind": "x".repeat(20_000) })).await;
        problem(large, 413, "too-large").await;
    }
    let named = [
        ("/api/v1/jobs", json!({ "kind": "polish" }), "kind"),
        ("/api/v1/jobs", json!({ "kind": "joint_alignment", "speed": 3 }), "speed"),
        ("/api/v1/axes/e/move", json!({}), "position_mm"),
        ("/api/v1/axes/focus/move", json!({ "position_mm": "far" }), "position_mm"),
    ];
    for (path, body, field) in named {
        let problem = problem(daemon.post(path, &body).await, 422, "invalid").await;
        assert_eq!(problem["field"], field, "{problem}");
    }
}

#[tokio::test]
async fn other_hosts_and_other_origins_are_turned_away() {
    let daemon = Daemon::start(fakes().bench).await;
    let with = |method, path: &str, name: &str, value: &str| daemon.request(method, path).header(name, value).send();
    problem(with(Method::GET, "/healthz", "host", "evil.example").await.unwrap(), 421, "wrong-host").await;
    assert!(with(Method::GET, "/healthz", "host", "localhost:1").await.unwrap().status().is_success());

    for origin in ["http://evil.example", "null", "http://127.0.0.1:1"] {
        problem(with(Method::POST, "/api/v1/axes/e/home", "origin", origin).await.unwrap(), 403, "cross-origin").await;
    }
    let own = format!("http://{}", daemon.address);
    let response = with(Method::POST, "/api/v1/stop", "origin", &own).await.unwrap();
    assert!(response.status().is_success());
    // Reading does no harm, and the browser keeps the answer from the page that asked.
    let response = with(Method::GET, "/healthz", "origin", "http://evil.example").await.unwrap();
    assert!(response.status().is_success());
    assert_eq!(response.headers()["cross-origin-resource-policy"], "same-origin");
    assert!(!response.headers().contains_key("access-control-allow-origin"));
}

#[tokio::test]
async fn health_contract_configuration_and_jobs_can_be_read() {
    let daemon = Daemon::start(fakes().bench).await;
    let health: Value = daemon.get("/healthz").await.json().await.unwrap();
    assert_eq!((&health["status"], &health["simulated"]), (&json!("ok"), &json!(false)));
    let response = daemon.get("/api/v1/openapi.json").await;
    assert_eq!(response.text().await.unwrap(), plenalign::api::openapi_json());
    let config: Value = daemon.get("/api/v1/config").await.json().await.unwrap();
    assert_eq!(config["origin"], "reference preset, inferred from Table 2");
    assert_eq!(config["config"]["main_lens"]["focal_length_mm"], 20.0);
    let design: Value = daemon.get("/api/v1/design").await.json().await.unwrap();
    assert!((design["joint"]["delta_v_mm"].as_f64().unwrap() - 2.20504).abs() < 1e-5, "{design}");
    let jobs: Value = daemon.get("/api/v1/jobs").await.json().await.unwrap();
    assert_eq!(jobs, json!({ "jobs": [], "next": null, "history_fault": null }));
    problem(daemon.get("/api/v1/measurement").await, 404, "no-measurement").await;
}

#[tokio::test]
async fn the_newest_frame_comes_as_png_and_jpeg_and_says_what_it_is() {
    let fakes = fakes();
    let daemon = Daemon::start(fakes.bench).await;
    let none = problem(daemon.get("/api/v1/frame.png").await, 503, "no-frame").await;
    assert_eq!(none["frame_age_ms"], Value::Null);

    fakes.camera.take(9);
    for (path, kind) in [("/api/v1/frame.png", "image/png"), ("/api/v1/snapshot.jpg", "image/jpeg")] {
        // A snapshot is of a frame taken after it was asked for.
        let response = tokio::select! {
            response = daemon.get(path) => response,
            () = fakes.camera.film(std::iter::repeat(9), [64, 48], Duration::from_millis(20)) => unreachable!(),
        };
        assert_eq!(response.status(), 200);
        let headers = response.headers().clone();
        let header = |name| headers[name].to_str().unwrap();
        assert_eq!((header("content-type"), header("cache-control")), (kind, "no-store"));
        assert_eq!((header("plenalign-frame-seq"), header("plenalign-simulated")), ("9", "false"));
        assert_eq!((header("plenalign-focus-mm"), header("plenalign-preview")), ("0.25", "true"));
        assert!(!headers.contains_key("plenalign-e-mm"));
        let number = |name| header(name).parse::<f64>().unwrap();
        assert!(number("plenalign-frame-age-ms") < 300.0);
        let now = nix::time::clock_gettime(nix::time::ClockId::CLOCK_MONOTONIC).unwrap();
        let now_ms = std::time::Duration::from(now).as_secs_f64() * 1000.0;
        let taken_ms = number("plenalign-captured-monotonic-ms");
        assert!((now_ms - 2000.0..=now_ms).contains(&taken_ms), "{taken_ms} is not shortly before {now_ms}");
        let picture = image::load_from_memory(&response.bytes().await.unwrap()).unwrap().into_luma8();
        assert_eq!((picture.dimensions(), picture.get_pixel(5, 5).0), ((64, 48), [9]));
        if kind == "image/png" {
            let again = daemon.request(Method::GET, path).header("if-none-match", header("etag")).send().await.unwrap();
            assert_eq!(again.status(), 304);
        }
    }
    for (query, field) in
        [("reduce=3", "reduce"), ("quality=5", "quality"), ("quality=x", "quality"), ("size=1", "size")]
    {
        let refused = daemon.get(&format!("/api/v1/snapshot.jpg?{query}")).await;
        assert_eq!(problem(refused, 422, "invalid").await["field"], field, "{query}");
    }

    let stale = async || when(daemon.get("/api/v1/frame.png").await, |answer| answer.status() == 503).ok();
    until("the frame is stale", stale).await;
    let stale = problem(daemon.get("/api/v1/snapshot.jpg").await, 503, "no-frame").await;
    assert!(stale["frame_age_ms"].as_f64().unwrap() > 300.0, "{stale}");
}

#[tokio::test]
async fn a_stop_answers_for_each_axis_and_holds_until_it_is_reset() {
    let fakes = fakes();
    *fakes.e.delivery.lock().unwrap() = StopDelivery::Sent;
    let daemon = Daemon::start(fakes.bench).await;
    for _ in 0..2 {
        let response = daemon.request(Method::POST, "/api/v1/stop").send().await.unwrap();
        assert_eq!(response.status(), 200);
        let report: Value = response.json().await.unwrap();
        assert_eq!((&report["focus"], &report["e"]), (&json!("confirmed"), &json!("sent")));
    }
    let go = json!({ "position_mm": 1.0 });
    problem(daemon.command(Method::POST, "/api/v1/axes/focus/move", &go).await, 409, "stopped").await;
    let job = json!({ "kind": "joint_alignment" });
    problem(daemon.command(Method::POST, "/api/v1/jobs", &job).await, 409, "stopped").await;
    for _ in 0..2 {
        let reset = daemon.reset_stop().await;
        assert_eq!(reset.json::<Value>().await.unwrap()["latched"], false);
    }
    let moved = daemon.command(Method::POST, "/api/v1/axes/focus/move", &go).await;
    assert_eq!(moved.status(), 202);
}

#[tokio::test]
async fn a_move_that_must_not_be_made_is_refused_with_its_numbers() {
    let daemon = Daemon::start(fakes().bench).await;
    let go = |axis: &str, mm: f64| {
        let path = format!("/api/v1/axes/{axis}/move");
        let daemon = &daemon;
        async move { daemon.command(Method::POST, &path, &json!({ "position_mm": mm })).await }
    };
    let limit = problem(go("focus", 99.0).await, 409, "limit").await;
    assert_eq!((&limit["axis"], &limit["high_mm"]), (&json!("focus"), &json!(5.0)));
    let untold = problem(go("e", 3.0).await, 409, "wall").await;
    assert_eq!(untold["wall_mm"], 3.52);
    daemon.command(Method::PUT, "/api/v1/shell", &json!({ "state": "off" })).await;
    let wall = problem(go("e", -0.2).await, 409, "wall").await;
    assert_eq!(wall["wall_mm"], -0.1);
    let shell = daemon.command(Method::PUT, "/api/v1/shell", &json!({ "state": "on" })).await;
    assert_eq!(shell.json::<Value>().await.unwrap()["shell"], "on");
    let shell = daemon.command(Method::PUT, "/api/v1/shell", &json!({ "state": "away" })).await;
    assert_eq!(problem(shell, 422, "invalid").await["field"], "state");
}

#[tokio::test]
async fn the_page_or_a_notice_is_at_the_root() {
    let daemon = Daemon::start(fakes().bench).await;
    let response = daemon.get("/").await;
    assert_eq!(response.status(), 200);
    assert!(response.headers()["content-security-policy"].to_str().unwrap().contains("default-src 'self'"));
    assert!(response.text().await.unwrap().contains("Plenalign"));
}

/// The still stages answer at once, so the axes are those of the simulated bench, which take their time.
#[tokio::test]
async fn one_command_at_a_time_on_an_axis() {
    let config = small_config(1);
    let bench = open_bench(&Arc::new(config.clone())).await.unwrap();
    let daemon = Daemon::start_with(config, bench).await;
    let home = || daemon.command(Method::POST, "/api/v1/axes/e/home", &Value::Null);
    assert_eq!(home().await.status(), 202);
    // Refused in the answer, also before the first command has reached the controller.
    assert_eq!(problem(home().await, 409, "moving").await["axis"], "e");
    let go = json!({ "position_mm": 29.0 });
    problem(daemon.command(Method::POST, "/api/v1/axes/e/move", &go).await, 409, "moving").await;
    let job = json!({ "kind": "joint_alignment" });
    problem(daemon.command(Method::POST, "/api/v1/jobs", &job).await, 409, "moving").await;
    daemon.request(Method::POST, "/api/v1/stop").send().await.unwrap();
}
