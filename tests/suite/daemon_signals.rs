//! The program `plenalign serve` itself: how it ends on a signal, and what it refuses to start beside.

use std::io::{BufRead, BufReader, Read};
use std::net::TcpListener;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::{JoinHandle, sleep};
use std::time::{Duration, Instant};

use reqwest::{Client, Method, Response};
use serde_json::{Value, json};
use tempfile::TempDir;

/// A running program with a state folder of its own; killed when the test ends early.
struct Program {
    child: Child,
    address: String,
    state: TempDir,
    log: Option<JoinHandle<String>>,
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn serve(state: &TempDir, listen: &str) -> Command {
    let config = state.path().join("bench.toml");
    std::fs::write(&config, "[bench.simulation]\nrays = 4\n").unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_plenalign"));
    command
        .args(["serve", "--simulated", "--json", "--listen", listen, "--config"])
        .arg(config)
        .env("PLENALIGN_STATE_DIR", state.path())
        .env("RUST_LOG", "info")
        .env("NO_COLOR", "1")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

impl Program {
    fn start() -> Self {
        let state = tempfile::tempdir().unwrap();
        let mut child = serve(&state, "127.0.0.1:0").spawn().unwrap();
        let mut stderr = child.stderr.take().unwrap();
        let log = std::thread::spawn(move || {
            let mut text = String::new();
            stderr.read_to_string(&mut text).unwrap();
            text
        });
        let mut said = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut said).unwrap();
        let said: Value = serde_json::from_str(&said).unwrap_or_else(|_| panic!("{said}"));
        assert_eq!(said["simulated"], true);
        let address = said["address"].as_str().unwrap().trim_start_matches("http://").trim_end_matches('/');
        Self { address: address.to_owned(), child, state, log: Some(log) }
    }

    async fn ask(&self, method: Method, path: &str, body: Option<Value>) -> Response {
        let mut request =
            Client::builder().no_proxy().build().unwrap().request(method, format!("http://{}{path}", self.address));
        if let Some(body) = body {
            request = request.json(&body);
        }
        request.send().await.unwrap()
    }

    async fn bench(&self) -> Value {
        self.ask(Method::GET, "/api/v1/bench", None).await.json().await.unwrap()
    }

    fn terminate(&self) {
        nix::sys::signal::kill(
            nix::unistd::Pid::from_raw(i32::try_from(self.child.id()).unwrap()),
            nix::sys::signal::Signal::SIGTERM,
        )
        .unwrap();
    }

    /// Waits for the end and returns how it ended, after how long, and what was logged.
    fn end(mut self, allowed: Duration) -> (ExitStatus, Duration, String) {
        let from = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(from.elapsed() < allowed, "the program still runs after {allowed:?}");
            sleep(Duration::from_millis(10));
        };
        let took = from.elapsed();
        (status, took, self.log.take().unwrap().join().unwrap())
    }
}

/// The place of a line in a log.
fn place(log: &str, text: &str) -> usize {
    log.find(text).unwrap_or_else(|| panic!("`{text}` is not in the log:\n{log}"))
}

#[tokio::test]
async fn sigterm_in_mid_run_stops_the_axes_before_the_streams() {
    let program = Program::start();
    let (mut stream, _) =
        tokio_tungstenite::connect_async(format!("ws://{}/api/v1/ws", program.address)).await.unwrap();
    let lease = program.ask(Method::POST, "/api/v1/lease", Some(json!({ "owner": "a test" }))).await;
    let lease: Value = lease.json().await.unwrap();
    let client = Client::builder().no_proxy().build().unwrap();
    let start =
        client.post(format!("http://{}/api/v1/jobs", program.address)).json(&json!({ "kind": "joint_alignment" }));
    let created = start.header("Plenalign-Lease", lease["key"].as_str().unwrap()).send().await.unwrap();
    assert_eq!(created.status(), 201);
    // Homing is what the job begins with, and it takes seconds.
    let from = Instant::now();
    while !program.bench().await["axes"].as_array().unwrap().iter().any(|axis| axis["moving"] == true) {
        assert!(from.elapsed() < Duration::from_secs(6), "no axis moves");
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    program.terminate();

    let closed = tokio::time::timeout(Duration::from_secs(5), async {
        use futures_util::StreamExt as _;
        while let Some(message) = stream.next().await {
            if let Ok(tokio_tungstenite::tungstenite::Message::Close(Some(frame))) = message {
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
    let stopped = place(&log, "axes stopped focus=Confirmed e=Confirmed");
    let ended = place(&log, "cancelled: ");
    assert!(stopped < ended && ended < place(&log, "streams closed"), "{log}");
    assert!(!log.contains("ERROR"), "{log}");
}

#[tokio::test]
async fn a_second_daemon_on_the_same_bench_names_the_first() {
    let first = Program::start();
    let refused = serve(&first.state, "127.0.0.1:0").output().unwrap();
    let said = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(said.contains(&format!("pid {}", first.child.id())), "{said}");
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
    let refused = serve(&tempfile::tempdir().unwrap(), &address).output().unwrap();
    let said = String::from_utf8(refused.stderr).unwrap();
    assert_eq!(refused.status.code(), Some(1), "{said}");
    assert!(said.contains(&address) && said.contains("taken"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
}
