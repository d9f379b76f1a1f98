//! Moving an axis off its switch over HTTP, on a Grbl twin that was powered up there.

use std::sync::Arc;

use plenalign::config::Config;
use plenalign::device::Bench;
use plenalign::sim::stage::Protocol;
use reqwest::Method;
use serde_json::{Value, json};

use super::super::daemon::{Daemon, problem};
use super::super::fakes::fakes;
use super::super::until::until;
use super::kit::{Kit, START, bench};

async fn e_axis(daemon: &Daemon) -> Value {
    let bench: Value = daemon.get("/api/v1/bench").await.json().await.unwrap();
    bench["axes"].as_array().unwrap().iter().find(|axis| axis["axis"] == "e").unwrap().clone()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_axis_leaves_its_switch_by_its_operators_word_and_only_then_is_homed() {
    let kit = Kit::standing(Protocol::Grbl, bench(Protocol::Grbl), [START[0], -6.3]);
    // Counting from zero where it was powered up, its soft limits would not let it off.
    kit.twin.receive(b"$20=0\n");
    let rig = kit.connect().await.unwrap();
    let bench = Bench { focus: Arc::new(rig.focus), e: Arc::new(rig.e), ..fakes().bench };
    let daemon = Daemon::start_with(Config { bench: kit.bench.clone(), ..Config::default() }, bench).await;
    let path = "/api/v1/axes/e/leave-switch";
    let low = json!({ "pressed": "low" });
    problem(daemon.post(path, &low).await, 428, "lease-required").await;
    for (body, field) in [(json!({ "pressed": "far" }), "pressed"), (json!({}), "pressed")] {
        assert_eq!(problem(daemon.command(Method::POST, path, &body).await, 422, "invalid").await["field"], field);
    }
    let refused =
        problem(daemon.command(Method::POST, "/api/v1/axes/e/home", &Value::Null).await, 409, "switch-pressed");
    assert_eq!(refused.await["axis"], "e");
    // Nobody has said that the shell is off.
    let high = json!({ "pressed": "high" });
    problem(daemon.command(Method::POST, path, &high).await, 409, "leaving-towards-shell").await;
    daemon.post("/api/v1/stop", &Value::Null).await;
    problem(daemon.command(Method::POST, path, &low).await, 409, "stopped").await;
    assert_eq!(daemon.reset_stop().await.status(), 200);
    assert_eq!(kit.slides.at(1), -6.3, "nothing has moved");

    assert_eq!(daemon.command(Method::POST, path, &low).await.status(), 202);
    until("the axis is at rest", async || e_axis(&daemon).await["moving"] != true).await;
    let e = e_axis(&daemon).await;
    assert_eq!(e["failure"], Value::Null, "{e}");
    let stands = kit.slides.at(1);
    assert!((-6.0..-5.8).contains(&stands), "off the switch and no further: {stands}");
    assert_eq!(daemon.command(Method::POST, "/api/v1/axes/e/home", &Value::Null).await.status(), 202);
}
