//! The stop's latency, from the request to the last byte on the serial line: a safety property, under the worst load that
//! is promised. Sixteen viewers stream a part of the frame each of their own, a job is stuck in a camera that gives nothing, and half of the stops come upon a
//! motion. What control takes under the same load is told beside it.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use futures_util::{SinkExt as _, StreamExt as _};
use plenalign::control::open_bench;
use plenalign::device::Bench;
use reqwest::Method;
use serde_json::{Value, json};
use tokio::time::Instant;
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::Message;

use super::bench::small_config;
use super::daemon::Daemon;
use super::fakes::fakes;

const VIEWERS: usize = 16;
/// 99 of 100 stops.
const ALLOWED_MS: f64 = 50.0;

/// The stages of the simulated bench, over real drivers and a serial line each, with a camera that the test feeds.
async fn bench_with_fed_camera() -> (Bench, Arc<super::fakes::FedCamera>) {
    let fakes = fakes();
    let simulated = open_bench(&Arc::new(small_config(1))).await.unwrap();
    fakes.camera.hang();
    (Bench { camera: fakes.camera.clone(), ..simulated }, fakes.camera)
}

async fn watch(address: std::net::SocketAddr, nth: usize, seen: Arc<AtomicU64>) {
    let (mut socket, _) = connect_async(format!("ws://{address}/api/v1/ws")).await.unwrap();
    let viewport = json!({ "x_px": nth, "y_px": 0, "width_px": 540, "height_px": 560,
                           "picture_width_px": 500, "picture_height_px": 510 });
    let asked = json!({ "type": "pictures", "on": true, "max_rate_hz": 30, "viewport": viewport });
    socket.send(Message::text(asked.to_string())).await.unwrap();
    while let Some(Ok(message)) = socket.next().await {
        if message.is_binary() {
            seen.fetch_add(1, Ordering::Relaxed);
        }
    }
}

fn percentile(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() as f64 * share).ceil() as usize).clamp(1, sorted.len()) - 1]
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stop_reaches_the_serial_line_within_50_ms_whatever_else_goes_on() {
    stops_under_load(100).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "takes four minutes: make test-long"]
async fn many_stops_reach_the_serial_line_within_50_ms() {
    stops_under_load(500).await;
}

async fn stops_under_load(stops: usize) {
    let (bench, camera) = bench_with_fed_camera().await;
    let daemon = Daemon::start_with(small_config(1), bench).await;
    let seen = Arc::new(AtomicU64::new(0));
    for nth in 0..VIEWERS {
        tokio::spawn(watch(daemon.address, nth, Arc::clone(&seen)));
    }
    let feeder = tokio::spawn(async move { camera.film(0.., [560, 560], Duration::from_millis(33)).await });
    let (mut latencies, mut answers) = (Vec::new(), Vec::new());
    let (mut commands, mut states) = (Vec::new(), Vec::new());
    let milliseconds = |since: Instant| since.elapsed().as_secs_f64() * 1000.0;
    for round in 0..stops {
        let asked = Instant::now();
        assert_eq!(daemon.get("/api/v1/bench").await.status(), 200);
        states.push(milliseconds(asked));
        if round % 2 == 0 {
            let asked = Instant::now();
            let begun = daemon.command(Method::POST, "/api/v1/axes/focus/home", &Value::Null).await;
            // A job may hold the bench still.
            if begun.status() == 202 {
                commands.push(milliseconds(asked));
            }
        } else if round % 10 == 1 {
            daemon.command(Method::POST, "/api/v1/jobs", &json!({ "kind": "joint_alignment" })).await;
        }
        let asked = Instant::now();
        let report = daemon.request(Method::POST, "/api/v1/stop").send().await.unwrap();
        assert_eq!(report.status(), 200);
        let report: Value = report.json().await.unwrap();
        answers.push(milliseconds(asked));
        assert!(report["focus"] != "undeliverable" && report["e"] != "undeliverable", "{report}");
        latencies.push(report["latency_ms"].as_f64().unwrap_or_else(|| panic!("no byte was sent: {report}")));
        daemon.reset_stop().await;
    }
    feeder.abort();
    for times in [&mut latencies, &mut answers, &mut commands, &mut states] {
        times.sort_by(f64::total_cmp);
    }
    let pictures = seen.load(Ordering::Relaxed);
    println!(
        "{stops} stops: to the last serial byte p50 {:.2} ms, p99 {:.2} ms, worst {:.2} ms; to the answer p50 {:.0} ms, \
         p99 {:.0} ms; {pictures} pictures sent meanwhile",
        percentile(&latencies, 0.5),
        percentile(&latencies, 0.99),
        percentile(&latencies, 1.0),
        percentile(&answers, 0.5),
        percentile(&answers, 0.99),
    );
    println!(
        "control under the same load, from request to answer: {} commands of motion p50 {:.1} ms, p99 {:.1} ms; {} states \
         of the bench p50 {:.1} ms, p99 {:.1} ms",
        commands.len(),
        percentile(&commands, 0.5),
        percentile(&commands, 0.99),
        states.len(),
        percentile(&states, 0.5),
        percentile(&states, 0.99),
    );
    assert!(commands.len() > stops / 3, "only {} commands were accepted", commands.len());
    assert!(pictures > stops as u64, "only {pictures} pictures: there was no load");
    assert!(percentile(&latencies, 0.99) <= ALLOWED_MS, "p99 {:.1} ms", percentile(&latencies, 0.99));
}
