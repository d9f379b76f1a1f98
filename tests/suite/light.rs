//! The camera's exposure and gain over the API, and what of it is where the newest frame is dark or clipped.

use std::sync::Arc;

use plenalign::control::open_bench;
use plenalign::device::light::{ControlName, ControlUnit, LightControl};
use reqwest::{Method, StatusCode};
use serde_json::{Value, json};

use super::bench::small_config;
use super::daemon::{Daemon, problem};
use super::fakes::fakes;
use super::measurements::with_white;

const CONTROLS: &str = "/api/v1/camera/controls";
const EXPOSURE: &str = "/api/v1/camera/controls/exposure";
const GAIN: &str = "/api/v1/camera/controls/gain";
const AUTO: &str = "/api/v1/camera/auto-exposure";
const HISTOGRAM: &str = "/api/v1/camera/histogram";

async fn simulated() -> Daemon {
    let mut config = small_config(1);
    (config.sensor.width_px, config.sensor.height_px) = (320, 320);
    config.bench.simulation.rays = 2;
    config.bench.camera.timeout_ms = 20_000;
    let bench = open_bench(&Arc::new(config.clone())).await.unwrap();
    Daemon::start_with(config, bench).await
}

async fn set(daemon: &Daemon, path: &str, value: f64) -> Value {
    let answer = daemon.command(Method::PUT, path, &json!({ "value": value })).await;
    let (status, text) = (answer.status(), answer.text().await.unwrap());
    assert_eq!(status, StatusCode::OK, "{text}");
    serde_json::from_str(&text).unwrap()
}

async fn value_of(daemon: &Daemon, name: &str) -> Value {
    let view: Value = daemon.get(CONTROLS).await.json().await.unwrap();
    let controls = view["controls"].as_array().unwrap();
    controls.iter().find(|control| control["name"] == name).unwrap()["value"].clone()
}

async fn counted(daemon: &Daemon, query: &str) -> Value {
    let answer = daemon.get(&format!("{HISTOGRAM}{query}")).await;
    let (status, text) = (answer.status(), answer.text().await.unwrap());
    assert_eq!(status, StatusCode::OK, "{text}");
    serde_json::from_str(&text).unwrap()
}

#[tokio::test]
async fn exposure_and_gain_are_set_within_their_limits_by_whoever_has_the_lease() {
    let daemon = simulated().await;
    let view: Value = daemon.get(CONTROLS).await.json().await.unwrap();
    let exposure = &view["controls"][0];
    assert_eq!(
        (&exposure["name"], &exposure["unit"], &exposure["locked"]),
        (&json!("exposure"), &json!("ms"), &Value::Null)
    );
    let numbers = ["value", "minimum", "maximum", "step", "default"].map(|key| exposure[key].as_f64().unwrap());
    assert_eq!(numbers, [10.0, 0.1, 100.0, 0.1, 10.0]);
    assert_eq!((&view["controls"][1]["name"], &view["controls"][1]["unit"]), (&json!("gain"), &json!("factor")));

    let body = json!({ "value": 12.34 });
    let without = daemon.request(Method::PUT, EXPOSURE).json(&body).send().await.unwrap();
    problem(without, 428, "lease-required").await;
    problem(daemon.post(AUTO, &Value::Null).await, 428, "lease-required").await;
    let strange =
        daemon.request(Method::PUT, EXPOSURE).header("plenalign-lease", "x").json(&body).send().await.unwrap();
    problem(strange, 412, "lease-lost").await;
    assert_eq!(value_of(&daemon, "exposure").await, 10.0, "refused, and set all the same");

    assert_eq!(set(&daemon, EXPOSURE, 12.34).await["controls"][0]["value"], 12.3);
    assert_eq!(set(&daemon, GAIN, 2.0).await["controls"][1]["value"], 2.0);
    for (path, value, words) in [
        (EXPOSURE, 100.1, "exposure: 100.1 ms is not within 0.1 to 100 ms"),
        (EXPOSURE, 0.0, "exposure: 0 ms is not within 0.1 to 100 ms"),
        (GAIN, -3.0, "gain: -3 is not within 1 to 16"),
    ] {
        let refused = daemon.command(Method::PUT, path, &json!({ "value": value })).await;
        let refused = problem(refused, 409, "control-range").await;
        assert_eq!(refused["detail"], words);
        assert!(refused["minimum"].is_number() && refused["maximum"].is_number() && refused["control"].is_string());
    }
    for (body, field) in
        [(json!({}), "value"), (json!({ "value": "long" }), "value"), (json!({ "value": 1, "x": 1 }), "x")]
    {
        let refused = daemon.command(Method::PUT, EXPOSURE, &body).await;
        assert_eq!(problem(refused, 422, "invalid").await["field"], field);
    }
    let unknown = daemon.command(Method::PUT, "/api/v1/camera/controls/focus", &json!({ "value": 1 })).await;
    problem(unknown, 404, "not-found").await;

    // Who did it is in the audit log, and nothing that was refused.
    let log: Value = daemon.get("/api/v1/audit").await.json().await.unwrap();
    let entries = log["entries"].as_array().unwrap().iter().filter(|entry| entry["what"] == "camera.set");
    let details: Vec<&Value> = entries.map(|entry| &entry["detail"]).collect();
    let gain = json!({ "control": "gain", "wanted": 2.0, "value": 2.0 });
    assert_eq!(details, [&gain, &json!({ "control": "exposure", "wanted": 12.34, "value": 12.3 })]);

    // A camera that is away says so.
    let unplugged = json!({ "camera": { "unplugged": true } });
    daemon.command(Method::PUT, "/api/v1/simulation/faults", &unplugged).await;
    daemon.until("/api/v1/bench", "unplugged", |bench| bench["camera"]["online"] == false).await;
    let away = problem(daemon.get(CONTROLS).await, 503, "device-disconnected").await;
    assert!(away["detail"].as_str().unwrap().contains("unplugged"), "{away}");
    let away = daemon.command(Method::PUT, EXPOSURE, &json!({ "value": 10.0 })).await;
    problem(away, 503, "device-disconnected").await;
}

#[tokio::test]
async fn the_histogram_has_every_pixel_and_exposure_is_found_by_it() {
    let daemon = simulated().await;
    daemon.lease().await;
    let plain = counted(&daemon, "").await;
    let counts = plain["counts"].as_array().unwrap();
    assert_eq!((counts.len(), &plain["bits"], &plain["levels_per_range"]), (256, &json!(8), &json!(1)));
    assert_eq!(plain["clipped_from"], 250);
    let pixels =
        |view: &Value| view["counts"].as_array().unwrap().iter().map(|count| count.as_u64().unwrap()).sum::<u64>();
    assert_eq!(pixels(&plain), 320 * 320);
    let share = |view: &Value, key: &str| view[key].as_f64().unwrap();

    // At once: what was exposed before is not counted any more.
    set(&daemon, EXPOSURE, 100.0).await;
    let bright = counted(&daemon, "?ranges=16").await;
    assert_eq!((bright["counts"].as_array().unwrap().len(), pixels(&bright)), (16, 320 * 320));
    assert_eq!(bright["overexposed"], true);
    assert!(share(&bright, "clipped_share") > 0.1 && share(&plain, "clipped_share") < 0.01, "{bright} {plain}");
    set(&daemon, EXPOSURE, 0.1).await;
    let dark = counted(&daemon, "").await;
    assert!(share(&dark, "black_share") > share(&plain, "black_share") + 0.1, "{dark} {plain}");
    for (query, field) in [("?ranges=1", "ranges"), ("?ranges=65537", "ranges"), ("?ranges=x", "ranges"), ("?x=1", "x")]
    {
        let refused = daemon.get(&format!("{HISTOGRAM}{query}")).await;
        assert_eq!(problem(refused, 422, "invalid").await["field"], field, "{query}");
    }

    // From far too dark at a great gain to right, at the least gain.
    set(&daemon, GAIN, 8.0).await;
    let found = daemon.command(Method::POST, AUTO, &Value::Null).await;
    let (status, text) = (found.status(), found.text().await.unwrap());
    assert_eq!(status, StatusCode::OK, "{text}");
    let found: Value = serde_json::from_str(&text).unwrap();
    assert!((0.7..=0.9).contains(&share(&found, "bright_level")) && share(&found, "clipped_share") < 0.002, "{found}");
    assert_eq!((&found["changed"], &found["controls"][1]["value"]), (&json!(true), &json!(1.0)), "{found}");
    let again: Value = daemon.command(Method::POST, AUTO, &Value::Null).await.json().await.unwrap();
    assert_eq!((&again["changed"], &again["frames"]), (&json!(false), &json!(1)), "{again}");
    let log: Value = daemon.get("/api/v1/audit").await.json().await.unwrap();
    assert_eq!(log["entries"][0]["what"], "camera.auto_exposure");

    // A cap on the lens: it says so, and leaves the camera as it was.
    let exposure = value_of(&daemon, "exposure").await;
    let dark = json!({ "camera": { "picture": "dark" } });
    daemon.command(Method::PUT, "/api/v1/simulation/faults", &dark).await;
    let refused = problem(daemon.command(Method::POST, AUTO, &Value::Null).await, 409, "not-exposed").await;
    assert!(refused["detail"].as_str().unwrap().contains("too dark"), "{refused}");
    assert_eq!((value_of(&daemon, "exposure").await, value_of(&daemon, "gain").await), (exposure, json!(1.0)));
}

#[tokio::test]
async fn a_change_drops_the_white_frame_and_none_is_made_in_a_job() {
    let daemon = with_white().await;
    let measure = async || daemon.post("/api/v1/measurements", &json!({ "settled": false })).await;
    let set_up_at = async || {
        let bench: Value = daemon.get("/api/v1/bench").await.json().await.unwrap();
        bench["set_up_at"].as_str().unwrap().parse::<jiff::Timestamp>().unwrap()
    };
    let view: Value = daemon.get(CONTROLS).await.json().await.unwrap();
    assert_eq!((&view["white_frame"], &view["job"]), (&json!(true), &Value::Null));
    assert_eq!(measure().await.status(), StatusCode::OK);

    // What it is already changes nothing.
    let before = set_up_at().await;
    assert_eq!(set(&daemon, EXPOSURE, 10.0).await["white_frame"], true);
    assert_eq!(set_up_at().await, before);
    let set_to = set(&daemon, EXPOSURE, 8.0).await;
    assert_eq!((&set_to["white_frame"], &set_to["controls"][0]["value"]), (&json!(false), &json!(8.0)));
    assert!(set_up_at().await > before, "what was read before counts as read of this");
    let refused = problem(measure().await, 409, "not-measurable").await;
    assert!(refused["detail"].as_str().unwrap().contains("white frame"), "{refused}");

    // Set back as it was for it, the white frame fits again, and no other.
    assert_eq!(set(&daemon, EXPOSURE, 9.0).await["white_frame"], false);
    assert_eq!(set(&daemon, EXPOSURE, 10.0).await["white_frame"], true);
    assert_eq!(measure().await.status(), StatusCode::OK);
    assert_eq!(set(&daemon, EXPOSURE, 8.0).await["white_frame"], false);

    let watch = json!({ "kind": "spacing_watch", "duration_s": 60.0, "interval_s": 30.0 });
    let job: Value = daemon.command(Method::POST, "/api/v1/jobs", &watch).await.json().await.unwrap();
    let busy = daemon.command(Method::PUT, EXPOSURE, &json!({ "value": 20.0 })).await;
    assert_eq!(problem(busy, 409, "busy").await["job"], job["id"]);
    problem(daemon.command(Method::POST, AUTO, &Value::Null).await, 409, "busy").await;
    let view: Value = daemon.get(CONTROLS).await.json().await.unwrap();
    assert_eq!((&view["job"], &view["controls"][0]["value"]), (&job["id"], &json!(8.0)), "the job keeps what was set");
    // It takes a white frame anew, with the camera as it was set.
    let href = job["href"].as_str().unwrap();
    let said = |job: &Value| job["log"].to_string().contains("the camera is set to exposure 8 ms, gain 1");
    let job = daemon.until(href, "a white frame", |job| said(job) || job["ended_at"].is_string()).await;
    assert!(said(&job), "{job}");
    daemon.request(Method::DELETE, href).send().await.unwrap();
}

#[tokio::test]
async fn a_camera_without_exposure_and_gain_says_so() {
    let daemon = Daemon::start(fakes().bench).await;
    let view: Value = daemon.get(CONTROLS).await.json().await.unwrap();
    assert_eq!(view, json!({ "controls": [], "white_frame": false, "job": null }));
    let refused = daemon.command(Method::PUT, GAIN, &json!({ "value": 1.0 })).await;
    let refused = problem(refused, 409, "no-control").await;
    assert_eq!(refused["control"], "gain");
    problem(daemon.command(Method::POST, AUTO, &Value::Null).await, 409, "no-control").await;
    problem(daemon.get(HISTOGRAM).await, 503, "no-frame").await;
}

#[tokio::test]
async fn what_comes_of_it_is_in_the_audit_log_whoever_waits_for_it() {
    let fakes = fakes();
    *fakes.camera.controls.lock().unwrap() = vec![LightControl {
        name: ControlName::Gain,
        key: "gain".to_owned(),
        unit: ControlUnit::Factor,
        value: Some(1.0),
        minimum: 1.0,
        maximum: 16.0,
        step: 1.0,
        default: 1.0,
        automatic: false,
        locked: None,
    }];
    let camera = Arc::clone(&fakes.camera);
    let daemon = Daemon::start(fakes.bench).await;
    let bench: Value = daemon.get("/api/v1/bench").await.json().await.unwrap();
    let set = async || daemon.command(Method::PUT, GAIN, &json!({ "value": 2.0 })).await;
    problem(set().await, 503, "device-disconnected").await;
    // It may be set all the same: what was read before is of another set-up.
    let time = |bench: &Value| bench["set_up_at"].as_str().unwrap().parse::<jiff::Timestamp>().unwrap();
    daemon.until("/api/v1/bench", "set up anew", |now| time(now) > time(&bench)).await;
    let entries = |log: &Value, what: &str| -> Vec<Value> {
        let entries = log["entries"].as_array().unwrap().iter();
        entries.filter(|entry| entry["what"] == what).map(|entry| entry["detail"].clone()).collect()
    };
    let failed = |detail: &Value| detail["error"].as_str().is_some_and(|error| error.contains("camera"));
    let log: Value = daemon.get("/api/v1/audit").await.json().await.unwrap();
    let told = entries(&log, "camera.set");
    assert!(told.len() == 1 && failed(&told[0]) && told[0]["wanted"] == 2.0, "{log}");

    // A search that waits for a frame: nobody sets anything meanwhile, and whoever began it goes away.
    camera.hang();
    let key = daemon.lease().await.to_owned();
    let search = tokio::spawn(daemon.request(Method::POST, AUTO).header("plenalign-lease", key).send());
    let busy = loop {
        let answer = set().await;
        if answer.status() == StatusCode::CONFLICT {
            break problem(answer, 409, "busy").await;
        }
    };
    assert!(busy["detail"].as_str().unwrap().contains("searched for"), "{busy}");
    problem(daemon.command(Method::POST, AUTO, &Value::Null).await, 409, "busy").await;
    search.abort();
    assert!(search.await.unwrap_err().is_cancelled());
    camera.give_up();
    let is = |log: &Value| !entries(log, "camera.auto_exposure").is_empty();
    let log = daemon.until("/api/v1/audit", "the search in the log", is).await;
    assert!(failed(&entries(&log, "camera.auto_exposure")[0]), "{log}");
}
