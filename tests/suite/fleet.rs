//! `plenalign fleet status` over real daemons: one that works, one that demands a token, one that is gone.

use std::path::Path;
use std::process::Output;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;

use super::config::CAMERA;
use super::program::{Program, plenalign, serve};

fn fleet(state: &Path, arguments: &[&str]) -> Output {
    plenalign(state).env("RUST_LOG", "warn").args(["fleet", "status"]).args(arguments).output().unwrap()
}

fn text(output: &Output, code: i32) -> String {
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert_eq!(output.status.code(), Some(code), "{text}\n{}", String::from_utf8_lossy(&output.stderr));
    text
}

fn status(output: &Output, code: i32) -> Value {
    let text = text(output, code);
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

fn daemon(arguments: &[&str]) -> (TempDir, Program) {
    let state = tempfile::tempdir().unwrap();
    let program = Program::start(serve(state.path(), arguments));
    (state, program)
}

/// An address at which nobody listens.
fn nobody() -> String {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    format!("http://{}", listener.local_addr().unwrap())
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_daemon_is_a_row_and_the_dead_and_the_closed_say_why() {
    let folder = tempfile::tempdir().unwrap();
    let (_open_state, open) = daemon(&[]);
    let closed_state = tempfile::tempdir().unwrap();
    let token = ["token", "create", "--name", "fleet", "--scope", "view", "--json"];
    let made = plenalign(closed_state.path()).args(token).output().unwrap();
    let made: Value = serde_json::from_slice(&made.stdout).unwrap();
    let closed = Program::start(serve(closed_state.path(), &[]));
    std::fs::write(folder.path().join("closed.token"), made["secret"].as_str().unwrap()).unwrap();
    let dead = nobody();
    let entry = |name: &str, url: &str, more: &str| format!("[[daemon]]\nname = {name:?}\nurl = {url:?}\n{more}\n");
    let list = |entries: &[String]| {
        let file = folder.path().join("fleet.toml");
        std::fs::write(&file, entries.concat()).unwrap();
        file.display().to_string()
    };
    let (left, right) = (entry("left", open.url(), ""), entry("right", closed.url(), "token_file = \"closed.token\""));

    // Somebody works with one of them.
    let client = super::daemon::client();
    let post = |path: &str| client.post(format!("{}{path}", open.url()));
    let lease = post("/api/v1/lease").json(&json!({ "owner": "ada" })).send().await.unwrap();
    let lease: Value = lease.json().await.unwrap();
    let start = post("/api/v1/jobs").header("Plenalign-Lease", lease["key"].as_str().unwrap());
    let job = start.json(&json!({ "kind": "joint_alignment" })).send().await.unwrap();
    let job: Value = job.json().await.unwrap();
    let (from, both) = (Instant::now(), list(&[left.clone(), right]));
    let found = loop {
        let output = fleet(folder.path(), &["--file", &both, "--json"]);
        let seen: Value = serde_json::from_slice(&output.stdout).unwrap();
        let bench = &seen["daemons"][0]["bench"];
        // Until it has measured something, and works on.
        if seen["ready"] == 2 && bench["job"].is_object() && bench["spacing"].is_object() {
            break status(&output, 0);
        }
        assert!(from.elapsed() < Duration::from_secs(60), "{seen}");
    };
    let row = &found["daemons"][0];
    assert_eq!((&found["ready"], found["daemons"].as_array().unwrap().len()), (&json!(2), 2));
    assert_eq!((&row["name"], &row["url"], &row["state"]), (&json!("left"), &json!(open.url()), &json!("ready")));
    assert_eq!((&row["simulated"], &row["version"]), (&json!(true), &json!(env!("CARGO_PKG_VERSION"))));
    let bench = &row["bench"];
    assert_eq!((&bench["lease"], &bench["stop_latched"]), (&json!("ada"), &json!(false)));
    assert_eq!((&bench["job"]["id"], &bench["job"]["kind"]), (&job["id"], &json!("joint_alignment")));
    assert!(bench["job"]["doing"].as_str().is_some_and(|doing| !doing.is_empty()), "{row}");
    assert_eq!(bench["camera"]["online"], true);
    let axes = bench["axes"].as_array().unwrap().iter();
    let axes: Vec<_> = axes.map(|axis| (&axis["axis"], &axis["connected"], &axis["homed"])).collect();
    let (yes, focus, e) = (json!(true), json!("focus"), json!("e"));
    assert_eq!(axes, [(&focus, &yes, &yes), (&e, &yes, &yes)]);
    let spacing = &bench["spacing"];
    assert!(
        spacing["spacing_px"].as_f64().zip(spacing["target_px"].as_f64()).is_some_and(|(is, to)| is > 0.0 && to > 0.0)
    );
    assert!(["running", "waiting_for_operator"].iter().any(|state| bench["job"]["state"] == *state), "{row}");
    let row = &found["daemons"][1];
    assert_eq!(
        (&row["state"], &row["bench"]["lease"], &row["bench"]["job"]),
        (&json!("ready"), &Value::Null, &Value::Null)
    );

    // One is stopped, one demands a token that is not given, one is gone.
    assert!(post("/api/v1/stop").send().await.unwrap().status().is_success());
    let file = list(&[left, entry("right", closed.url(), ""), entry("gone", &dead, "")]);
    let table = text(&fleet(folder.path(), &["--file", &file]), 1);
    let lines: Vec<&str> = table.lines().collect();
    assert!(lines[0].starts_with("NAME ") && lines[0].ends_with(" VERSION"), "{table}");
    let cells = |line: &str, words: &[&str]| words.iter().all(|word| line.contains(word));
    assert!(cells(lines[1], &["left ", open.url(), "SIMULATED", " ready ", "STOPPED", "focus ", " px"]), "{table}");
    assert!(cells(lines[2], &["right ", "SIMULATED", "NO ACCESS", env!("CARGO_PKG_VERSION")]), "{table}");
    assert!(cells(lines[3], &["gone ", &dead, "UNREACHABLE"]), "{table}");
    assert!(table.contains("right: ") && table.contains("gone: no daemon answers at"), "{table}");
    assert!(lines.last().unwrap().starts_with("1 of 3 ready, "), "{table}");
    let found = status(&fleet(folder.path(), &["--file", &file, "--json"]), 1);
    let states: Vec<&Value> = found["daemons"].as_array().unwrap().iter().map(|row| &row["state"]).collect();
    assert_eq!(states, ["ready", "no_access", "unreachable"]);
    assert_eq!(found["daemons"][0]["bench"]["stop_latched"], true);
    assert!(!found["daemons"][2]["reasons"][0].as_str().unwrap().is_empty());

    // By their addresses, with the token in the environment.
    let mut command = plenalign(folder.path());
    command.env("PLENALIGN_TOKEN", made["secret"].as_str().unwrap());
    command.args(["fleet", "status", "--json", "--server", closed.url()]);
    let found = status(&command.output().unwrap(), 0);
    assert_eq!(found["daemons"][0]["name"], closed.address());
}

#[test]
fn a_daemon_that_never_answers_holds_up_nobody() {
    let folder = tempfile::tempdir().unwrap();
    let (_state, open) = daemon(&[]);
    // It takes connections and says nothing.
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let silent = format!("http://{}", listener.local_addr().unwrap());
    let from = Instant::now();
    let asked = ["--json", "--timeout", "1", "--server", &silent, "--server", open.url(), "--server", &silent];
    let found = status(&fleet(folder.path(), &asked), 1);
    assert!(from.elapsed() < Duration::from_secs(4), "{:?}", from.elapsed());
    let states: Vec<&Value> = found["daemons"].as_array().unwrap().iter().map(|row| &row["state"]).collect();
    assert_eq!(states, ["unreachable", "ready", "unreachable"]);
    assert_eq!(found["daemons"][0]["reasons"][0], "no answer within 1s");
}

#[test]
fn a_bench_without_its_devices_is_not_ready_and_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bench.toml");
    let text = format!(
        "{CAMERA}[bench]\ndriver = \"hardware\"\n[bench.controllers.main]\ndriver = \"grbl\"\n\
         port = \"/dev/no-such-port\"\n"
    );
    std::fs::write(&file, text).unwrap();
    let mut command = plenalign(folder.path());
    command.args(["--config"]).arg(&file).args(["serve", "--json", "--listen", "127.0.0.1:0"]);
    let program = Program::start(command);
    let found = status(&fleet(folder.path(), &["--json", "--server", program.url()]), 1);
    let row = &found["daemons"][0];
    assert_eq!((&row["state"], &row["simulated"]), (&json!("not_ready"), &json!(false)));
    let reasons = row["reasons"].to_string();
    assert!(reasons.contains("/dev/no-such-port") && reasons.contains("the camera is not online"), "{reasons}");
    assert_eq!(row["bench"]["axes"][0]["connected"], false);
}

#[test]
fn watching_looks_again_until_it_is_interrupted() {
    use std::io::{BufRead as _, BufReader};

    let folder = tempfile::tempdir().unwrap();
    let dead = nobody();
    let mut command = plenalign(folder.path());
    command.args(["fleet", "status", "--watch", "--json", "--every", "1", "--server", &dead]);
    let mut child = command.stdout(std::process::Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
    for _ in 0..2 {
        let line: Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
        assert_eq!((&line["ready"], &line["daemons"][0]["state"]), (&json!(0), &json!("unreachable")));
    }
    let pid = nix::unistd::Pid::from_raw(child.id().try_into().unwrap());
    nix::sys::signal::kill(pid, nix::sys::signal::Signal::SIGINT).unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(1));
}

#[test]
fn what_cannot_be_asked_is_refused_with_what_would_be_right() {
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(fleet(folder.path(), &[]).status.code(), Some(2), "no daemon is named");
    for (arguments, said) in [
        (&["--server", "bench.lab:8443"][..], "is not an address such as https://bench.lab:8443"),
        (&["--file", "/no/such/fleet.toml"], "/no/such/fleet.toml"),
        (&["--server", "https://127.0.0.1:1", "--ca", "/no/such/ca.pem"], "/no/such/ca.pem"),
    ] {
        let output = fleet(folder.path(), arguments);
        let all = [output.stdout.clone(), output.stderr.clone()].concat();
        let all = String::from_utf8_lossy(&all).into_owned();
        assert!(output.status.code() == Some(1) && all.contains(said), "{said}: {all}");
    }
    let set = ["--set", "bench.simulation.seed=9", "fleet", "status", "--server", "http://127.0.0.1:1"];
    let given = plenalign(folder.path()).args(set).output().unwrap();
    assert!(given.status.code() == Some(1) && String::from_utf8_lossy(&given.stderr).contains("leave --config"));
}
