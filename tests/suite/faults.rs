//! What is made to go wrong with the simulated bench, and what the program then says.

use std::time::Duration;

use plenalign::control::job::{JobSnapshot, JobState};
use plenalign::control::open_bench;
use plenalign::device::faults::{Faults, PictureFault};
use reqwest::Method;
use serde_json::{Value, json};

use super::bench::{align, service, small_config};
use super::daemon::{Daemon, problem};
use super::fakes::fakes;

const FAULTS: &str = "/api/v1/simulation/faults";

/// A joint alignment on a bench with which something is wrong from the beginning.
async fn aligned_with(change: impl FnOnce(&mut Faults)) -> JobSnapshot {
    let service = service(small_config(9)).await;
    let mut faults = Faults::default();
    change(&mut faults);
    service.bench().simulated.as_ref().unwrap().set_faults(faults);
    align(&service).await
}

/// Whether the job failed, and says one of these words of why.
fn failed_naming(job: &JobSnapshot, words: &[&str]) {
    let reason = job.reason.as_deref().unwrap_or_default();
    assert_eq!(job.state, JobState::Failed, "{reason}\n{:#?}", job.log);
    assert!(words.iter().any(|word| reason.contains(word)), "{words:?} is not in: {reason}");
    assert_eq!(job.report.as_ref().unwrap().truth.as_ref().unwrap()["touched_shell"], false);
}

#[tokio::test(start_paused = true)]
async fn pictures_that_cannot_be_measured_are_named() {
    let with = |picture| aligned_with(move |faults| faults.camera.picture = picture);
    failed_naming(&with(PictureFault::Dark).await, &["blank", "dark"]);
    failed_naming(&with(PictureFault::Saturated).await, &["saturated", "overexposed"]);
    let blurred = with(PictureFault::Blurred).await;
    assert_ne!(blurred.state, JobState::Converged, "{:?}", blurred.reason);
}

#[tokio::test(start_paused = true)]
async fn a_camera_that_is_gone_or_hangs_is_named() {
    failed_naming(&aligned_with(|faults| faults.camera.unplugged = true).await, &["camera is not connected"]);
    failed_naming(&aligned_with(|faults| faults.camera.frozen = true).await, &["same to the last pixel"]);
}

#[tokio::test(start_paused = true)]
async fn a_stage_that_does_not_do_as_it_is_told_is_named() {
    failed_naming(&aligned_with(|faults| faults.serial.unplugged = true).await, &["controller"]);
    failed_naming(&aligned_with(|faults| faults.focus.limit_switch = true).await, &["alarm", "limit"]);
    failed_naming(&aligned_with(|faults| faults.focus.stalled = true).await, &["hom"]);
}

/// A stage's adapter pulled out of a running job and put back: the job ends with the reason, nothing goes on by itself,
/// and the axes' places are unknown.
#[tokio::test(start_paused = true)]
async fn an_adapter_unplugged_in_a_job_ends_it() {
    let service = service(small_config(9)).await;
    let bench = service.bench().clone();
    let hand = bench.simulated.clone().unwrap();
    let mut faults = Faults::default();
    faults.serial.unplugged = true;
    let pull = tokio::spawn(async move {
        let mut e = bench.e.state();
        e.wait_for(|state| state.homed).await.unwrap();
        e.wait_for(|state| state.moving).await.unwrap();
        hand.set_faults(faults);
    });
    let job = align(&service).await;
    pull.await.unwrap();
    failed_naming(&job, &["controller", "connect"]);
    service.bench().simulated.as_ref().unwrap().set_faults(Faults::default());
    let mut state = service.bench().e.state();
    let back = tokio::time::timeout(Duration::from_secs(60), state.wait_for(|state| state.connected)).await;
    assert!(!back.expect("it connects again").unwrap().homed);
}

#[tokio::test]
async fn faults_are_set_and_read_over_the_api() {
    let config = std::sync::Arc::new(small_config(1));
    let daemon = Daemon::start(open_bench(&config).await.unwrap()).await;
    let read = || async { daemon.get(FAULTS).await.json::<Value>().await.unwrap() };
    assert_eq!(read().await, json!(Faults::default()));
    let put = |body: Value| daemon.request(Method::PUT, FAULTS).json(&body).send();
    let set = put(json!({ "camera": { "unplugged": true }, "e": { "slip_share": 0.1 } })).await.unwrap();
    assert_eq!(set.status(), 200);
    let now = read().await;
    assert_eq!((&now["camera"]["unplugged"], &now["e"]["slip_share"]), (&json!(true), &json!(0.1)));
    let mut seen = Value::Null;
    for _ in 0..50 {
        seen = daemon.get("/api/v1/bench").await.json::<Value>().await.unwrap()["camera"].take();
        if seen["online"] == json!(false) {
            break;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    assert_eq!(seen["online"], json!(false), "{seen}");
    assert!(seen["fault"].as_str().unwrap().contains("unplugged"), "{seen}");
    let refused = problem(put(json!({ "e": { "slip_share": 1.5 } })).await.unwrap(), 422, "invalid").await;
    assert_eq!(refused["field"], "e.slip_share");
    assert_eq!(read().await, now, "a refused request changes nothing");
    problem(put(json!({ "lens": "off" })).await.unwrap(), 422, "invalid").await;
    // What is not named goes right again.
    assert_eq!(put(json!({})).await.unwrap().status(), 200);
    assert_eq!(read().await, json!(Faults::default()));
}

#[tokio::test]
async fn a_bench_of_hardware_takes_no_faults() {
    let daemon = Daemon::start(fakes().bench).await;
    problem(daemon.get(FAULTS).await, 409, "not-simulated").await;
    problem(daemon.request(Method::PUT, FAULTS).json(&json!({})).send().await.unwrap(), 409, "not-simulated").await;
}
