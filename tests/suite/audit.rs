//! The audit log: whatever is commanded is in it, with who commanded it and from where.

use plenalign::api::error::LEASE_HEADER;
use reqwest::{Method, Response};
use serde_json::{Value, json};

use super::daemon::Daemon;
use super::fakes::fakes;
use super::until::until;

/// Somebody with a token.
struct Person<'a> {
    daemon: &'a Daemon,
    token: String,
}

impl Person<'_> {
    async fn send(&self, method: Method, path: &str, key: Option<&str>, body: Option<Value>) -> Response {
        let mut request = self.daemon.request(method, path).bearer_auth(&self.token);
        if let Some(key) = key {
            request = request.header(LEASE_HEADER, key);
        }
        if let Some(body) = body {
            request = request.json(&body);
        }
        request.send().await.unwrap()
    }

    async fn ask(&self, method: Method, path: &str, key: Option<&str>, body: Option<Value>) -> Value {
        let response = self.send(method.clone(), path, key, body).await;
        let status = response.status();
        let text = response.text().await.unwrap();
        assert!(status.is_success(), "{method} {path}: {status} {text}");
        serde_json::from_str(&text).unwrap_or_default()
    }
}

async fn person<'a>(daemon: &'a Daemon, by: Option<&Person<'_>>, name: &str, scope: &str) -> Person<'a> {
    let body = json!({ "name": name, "scope": scope });
    let made = match by {
        Some(admin) => admin.ask(Method::POST, "/api/v1/tokens", None, Some(body)).await,
        None => daemon.post("/api/v1/tokens", &body).await.json().await.unwrap(),
    };
    Person { daemon, token: made["secret"].as_str().unwrap_or_else(|| panic!("{made}")).to_owned() }
}

/// A job of stand-ins, which waits for its operator.
async fn waiting(ada: &Person<'_>, key: &str) -> (String, u64) {
    let job = ada.ask(Method::POST, "/api/v1/jobs", Some(key), Some(json!({ "kind": "joint_alignment" }))).await;
    let href = job["href"].as_str().unwrap().to_owned();
    let asks = async || {
        let job = ada.ask(Method::GET, &href, None, None).await;
        job["operator_step"]["number"].as_u64().ok_or(job)
    };
    let step = until("the job waits for its operator", asks).await;
    (href, step)
}

#[tokio::test]
async fn whatever_is_commanded_is_in_the_audit_log_with_who_and_from_where() {
    let fakes = fakes();
    // So that the job still waits, for a frame, when it is cancelled.
    fakes.camera.hang();
    let daemon = Daemon::start(fakes.bench).await;
    let root = person(&daemon, None, "Root", "admin").await;
    let ada = person(&daemon, Some(&root), "Ada", "control").await;
    let vera = person(&daemon, Some(&root), "Vera", "view").await;
    let owner = |name: &str| Some(json!({ "owner": name, "note": "first light" }));

    let lease = ada.ask(Method::POST, "/api/v1/lease", None, owner("Ada at the bench")).await;
    let key = lease["key"].as_str().unwrap().to_owned();
    ada.ask(Method::PUT, "/api/v1/shell", Some(&key), Some(json!({ "state": "off" }))).await;
    ada.ask(Method::POST, "/api/v1/axes/e/move", Some(&key), Some(json!({ "position_mm": 29.0 }))).await;
    let bench = async || ada.ask(Method::GET, "/api/v1/bench", None, None).await;
    until("the move ends", async || bench().await["axes"][1]["moving"] != true).await;
    let (href, step) = waiting(&ada, &key).await;
    ada.ask(Method::POST, &format!("{href}/confirm"), Some(&key), Some(json!({ "step": step }))).await;
    for _ in 0..2 {
        // The second time there is nothing left to cancel.
        ada.ask(Method::DELETE, &href, None, None).await;
        let job = async || ada.ask(Method::GET, &href, None, None).await;
        until("the job ends", async || !job().await["ended_at"].is_null()).await;
    }
    ada.ask(Method::DELETE, "/api/v1/lease", Some(&key), None).await;
    // Refused, and so not done.
    let refused = vera.send(Method::DELETE, "/api/v1/stop", None, None).await;
    assert_eq!(refused.status(), 403);
    vera.ask(Method::POST, "/api/v1/stop", None, None).await;
    ada.ask(Method::DELETE, "/api/v1/stop", None, Some(json!({ "why": "seen to" }))).await;
    root.ask(Method::POST, "/api/v1/lease/takeover", None, owner("Root")).await;
    let tokens = root.ask(Method::GET, "/api/v1/tokens", None, None).await;
    let of_vera = tokens["tokens"].as_array().unwrap().iter().find(|token| token["name"] == "Vera").unwrap();
    let path = format!("/api/v1/tokens/{}", of_vera["id"].as_str().unwrap());
    root.ask(Method::DELETE, &path, None, None).await;

    let log = root.ask(Method::GET, "/api/v1/audit", None, None).await;
    let mut entries = log["entries"].as_array().unwrap().clone();
    entries.reverse();
    assert!(entries.iter().all(|entry| entry["from"] == "127.0.0.1"), "{entries:#?}");
    let name = |entry: &'_ Value, key: &str| entry[key].as_str().unwrap().to_owned();
    let found: Vec<_> = entries.iter().map(|entry| (name(entry, "what"), name(entry, "who"))).collect();
    let first = entries[0]["who"].as_str().unwrap();
    let expected = [
        ("token.create", first),
        ("token.create", "Root"),
        ("token.create", "Root"),
        ("lease.take", "Ada"),
        ("shell.set", "Ada"),
        ("axis.move", "Ada"),
        ("job.create", "Ada"),
        ("job.confirm", "Ada"),
        ("job.cancel", "Ada"),
        ("lease.release", "Ada"),
        ("stop", "Vera"),
        ("stop.reset", "Ada"),
        ("lease.take_over", "Root"),
        ("token.revoke", "Root"),
    ];
    assert_eq!(found, expected.map(|(what, who)| (what.to_owned(), who.to_owned())));
    let detail = |what: &str| &entries.iter().find(|entry| entry["what"] == what).unwrap()["detail"];
    assert_eq!(detail("lease.take")["owner"], "Ada at the bench");
    assert_eq!(detail("job.create")["request"]["kind"], "joint_alignment");
    for what in ["job.create", "job.confirm", "job.cancel"] {
        assert!(href.ends_with(detail(what)["job"].as_str().unwrap()), "{what}");
    }
    assert_eq!(detail("job.confirm")["step"], step);
    assert_eq!(detail("stop")["focus"], "confirmed");
    assert_eq!(
        (&detail("stop.reset")["why"], &detail("stop.reset")["stopped_by"]),
        (&json!("seen to"), &json!("Vera"))
    );
    // No key and no token is in it.
    let whole = log.to_string();
    for secret in [&key, &root.token, &ada.token, &vera.token] {
        assert!(!whole.contains(secret.as_str()));
    }
}

#[tokio::test]
async fn a_jog_is_in_the_audit_log_once_however_long_it_is_held() {
    let config = super::bench::small_config(1);
    let bench = plenalign::control::open_bench(&std::sync::Arc::new(config.clone())).await.unwrap();
    let daemon = Daemon::start_with(config, bench).await;
    let home = daemon.command(Method::POST, "/api/v1/axes/focus/home", &Value::Null).await;
    assert_eq!(home.status(), 202);
    let homed = |bench: &Value| bench["axes"][0]["homed"] == true && bench["axes"][0]["moving"] == false;
    daemon.until("/api/v1/bench", "homed", homed).await;
    let hold = json!({ "towards": "high", "speed_mm_per_s": 0.2 });
    let mut held = 0;
    until("held four times", async || {
        let answer = daemon.command(Method::POST, "/api/v1/axes/focus/jog", &hold).await;
        // Homing may not have let go of the axis yet.
        if answer.status() == 202 {
            held += 1;
        } else {
            assert!(held == 0, "{}", answer.text().await.unwrap());
        }
        held == 4
    })
    .await;
    daemon.request(Method::DELETE, "/api/v1/axes/focus/jog").send().await.unwrap();
    let log: Value = daemon.get("/api/v1/audit").await.json().await.unwrap();
    let jogs: Vec<&Value> =
        log["entries"].as_array().unwrap().iter().filter(|entry| entry["what"] == "axis.jog").collect();
    assert_eq!(jogs.len(), 1, "{log}");
    assert_eq!(jogs[0]["detail"], json!({ "axis": "focus", "towards": "high" }));
}

#[tokio::test]
async fn a_lease_that_runs_out_is_in_the_audit_log() {
    let daemon = Daemon::start(fakes().bench).await;
    let asked = json!({ "owner": "Ada", "note": "first light", "ttl_s": 2 });
    let granted = daemon.post("/api/v1/lease", &asked).await;
    assert_eq!(granted.status(), 201);
    let granted: Value = granted.json().await.unwrap();
    let expired =
        |log: &Value| log["entries"].as_array().unwrap().iter().find(|e| e["what"] == "lease.expire").cloned();
    let log = daemon.until("/api/v1/audit", "expired", |log| expired(log).is_some()).await;
    let entry = expired(&log).unwrap();
    assert_eq!((&entry["who"], &entry["from"]), (&json!("plenalign"), &Value::Null));
    let expected = json!({ "lease": granted["lease"]["id"], "owner": "Ada", "note": "first light" });
    assert_eq!(entry["detail"], expected);
}

#[tokio::test]
async fn tokens_made_and_revoked_on_the_command_line_are_in_the_audit_log() {
    let state = tempfile::tempdir().unwrap();
    let token = |arguments: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_plenalign"));
        let done = command.arg("token").args(arguments).env("PLENALIGN_STATE_DIR", state.path()).output().unwrap();
        let complaints = String::from_utf8(done.stderr).unwrap();
        assert!(done.status.success() && !complaints.contains("audit"), "{complaints}");
        String::from_utf8(done.stdout).unwrap()
    };
    let made: Value =
        serde_json::from_str(&token(&["create", "--name", "Ana", "--scope", "control", "--json"])).unwrap();
    token(&["revoke", "Ana"]);
    let history = plenalign::store::Store::to_read(state.path());
    let page = history.read(|connection| plenalign::store::read::audit(connection, None, 10)).await.unwrap();
    let found: Vec<_> = page.items.iter().rev().map(|(_, entry)| entry).collect();
    assert_eq!(found.iter().map(|entry| entry.what.as_str()).collect::<Vec<_>>(), ["token.create", "token.revoke"]);
    for entry in &found {
        assert_eq!((entry.who.as_str(), &entry.from), ("local", &None));
        assert_eq!((&entry.detail["id"], &entry.detail["name"]), (&made["id"], &json!("Ana")));
        assert!(entry.detail["user"].as_str().is_some_and(|user| !user.is_empty()), "{}", entry.detail);
    }
    assert_eq!(found[0].detail["scope"], "control");
    // Where it cannot be written down, the token is made all the same, and its maker is told.
    std::fs::remove_file(state.path().join("history.db")).unwrap();
    std::fs::create_dir(state.path().join("history.db")).unwrap();
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_plenalign"));
    command.args(["token", "create", "--name", "Bob", "--scope", "view"]).env("PLENALIGN_STATE_DIR", state.path());
    let done = command.output().unwrap();
    assert!(done.status.success() && done.stdout.starts_with(b"plenalign_"));
    assert!(String::from_utf8_lossy(&done.stderr).contains("not in the audit log"));
    assert!(!page.items.iter().any(|(_, entry)| entry.detail.to_string().contains(made["secret"].as_str().unwrap())));
}
