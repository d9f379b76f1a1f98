//! The program `plenalign serve` itself: how it ends on a signal, and what it refuses to start beside.

use std::net::TcpListener;
use std::time::Duration;

use futures_util::StreamExt as _;
use reqwest::{Method, Response};
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::Message;

use super::program::{Program, plenalign, serve};
use super::until::until;

async fn ask(program: &Program, method: Method, path: &str, body: Option<Value>) -> Response {
    let mut request = super::daemon::client().request(method, format!("{}{path}", program.url()));
    if let Some(body) = body {
        request = request.json(&body);
    }
    request.send().await.unwrap()
}

async fn bench(program: &Program) -> Value {
    ask(program, Method::GET, "/api/v1/bench", None).await.json().await.unwrap()
}

/// The place of a line in a log.
fn place(log: &str, text: &str) -> usize {
    log.find(text).unwrap_or_else(|| panic!("`{text}` is not in the log:\n{log}"))
}

#[tokio::test]
async fn sigterm_in_mid_run_stops_the_axes_before_the_streams() {
    let state = tempfile::tempdir().unwrap();
    let program = Program::start(serve(state.path(), &[]));
    let (mut stream, _) =
        tokio_tungstenite::connect_async(format!("ws://{}/api/v1/ws", program.address())).await.unwrap();
    let lease = ask(&program, Method::POST, "/api/v1/lease", Some(json!({ "owner": "a test" }))).await;
    let lease: Value = lease.json().await.unwrap();
    let client = super::daemon::client();
    let start = client.post(format!("{}/api/v1/jobs", program.url())).json(&json!({ "kind": "joint_alignment" }));
    let created = start.header("Plenalign-Lease", lease["key"].as_str().unwrap()).send().await.unwrap();
    assert_eq!(created.status(), 201);
    // Homing is what the job begins with, and it takes seconds.
    until("an axis moves", async || {
        bench(&program).await["axes"].as_array().unwrap().iter().any(|axis| axis["moving"] == true)
    })
    .await;
    program.terminate();

    let closed = tokio::time::timeout(Duration::from_secs(5), async {
        while let Some(message) = stream.next().await {
            if let Ok(Message::Close(Some(frame))) = message {
                return Some(u16::from(frame.code));
            }
        }
        None
    })
    .await;
    assert_eq!(closed, Ok(Some(1001)), "the viewer is told that the daemon goes away");
    let (status, took, log) = program.end(Duration::from_secs(5));
    assert_eq!(status.code(), Some(0), "{log}");
    assert!(took < Duration::from_secs(5));
    // The job that ends stops its axes, and so does the end of the program: whichever comes first, nothing is told before.
    let (stopped, ended) = (place(&log, "axes stopped"), place(&log, "cancelled: "));
    let confirmed = place(&log, "axes stopped focus=Confirmed e=Confirmed");
    let closed = place(&log, "streams closed");
    assert!(stopped < ended && ended < closed && confirmed < closed, "{log}");
    assert!(!log.contains("ERROR"), "{log}");
}

#[tokio::test]
async fn a_second_daemon_on_the_same_bench_names_the_first() {
    let state = tempfile::tempdir().unwrap();
    let first = Program::start(serve(state.path(), &[]));
    let refused = serve(state.path(), &[]).output().unwrap();
    let said = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(said.contains(&format!("pid {}", first.id())), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");

    // Idle, it ends as well as in mid-run, and the bench is free again.
    first.terminate();
    let (status, _, log) = first.end(Duration::from_secs(5));
    assert_eq!(status.code(), Some(0), "{log}");
}

#[test]
fn a_taken_port_gets_one_line_naming_it() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let refused = serve(tempfile::tempdir().unwrap().path(), &["--listen", &address]).output().unwrap();
    let said = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(said.contains(&address) && said.contains("taken"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
}

#[tokio::test]
async fn a_stop_on_the_command_line_is_not_kept_by_a_broken_configuration() {
    let state = tempfile::tempdir().unwrap();
    let program = Program::start(serve(state.path(), &[]));
    let broken = state.path().join("broken.toml");
    std::fs::write(&broken, "[bench\n").unwrap();
    let mut command = plenalign(state.path());
    command.arg("--config").arg(&broken).args(["stop", "--json", "--server", program.url()]);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&report["focus"], &report["e"]), (&json!("confirmed"), &json!("confirmed")));
    let stop = bench(&program).await["stop"].take();
    assert!(stop["by"].as_str().unwrap().contains('@'), "who stopped is not told: {stop}");
    // What needs it says what is wrong.
    let output = plenalign(state.path()).arg("--config").arg(&broken).arg("design").output().unwrap();
    assert!(!output.status.success() && String::from_utf8_lossy(&output.stderr).contains("broken.toml"));
}
