//! Confirming what a job asks of its operator: by the job's lease, or by the confirm key that its starter hands on.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::Stdio;

use plenalign::api::error::{CONFIRM_HEADER, LEASE_HEADER};
use plenalign::config::Config;
use plenalign::store::Store;
use reqwest::{Method, Response};
use serde_json::{Value, json};

use super::bench::QUICK_AXES;
use super::daemon::{Daemon, client, problem};
use super::fakes::fakes;
use super::program::{Program, plenalign, serve};
use super::until::until;

const JOBS: &str = "/api/v1/jobs";

/// A daemon whose jobs wait for their operator, and then for a frame, for ever.
async fn daemon(folder: &Path) -> Daemon {
    let fakes = fakes();
    fakes.camera.hang();
    Daemon::start_keeping(Config::default(), fakes.bench, Store::open(folder)).await
}

/// A job that waits for its operator: where it is, which step it waits for, and its confirm key.
struct Waiting {
    href: String,
    step: u64,
    key: String,
}

impl Waiting {
    async fn start(daemon: &Daemon, token: Option<&str>) -> Self {
        let mut request = daemon.request(Method::POST, JOBS).json(&json!({ "kind": "joint_alignment" }));
        request = request.header(LEASE_HEADER, daemon.lease().await);
        if let Some(token) = token {
            request = request.bearer_auth(token);
        }
        let created = request.send().await.unwrap();
        assert_eq!(created.status(), 201);
        let created: Value = created.json().await.unwrap();
        let href = created["href"].as_str().unwrap().to_owned();
        let key = created["confirm_key"].as_str().expect("whoever starts a job is given its confirm key").to_owned();
        assert!(key.starts_with("confirm_") && key.len() == 72, "{key}");
        let asks = async || {
            let mut request = daemon.request(Method::GET, &href);
            if let Some(token) = token {
                request = request.bearer_auth(token);
            }
            let job: Value = request.send().await.unwrap().json().await.unwrap();
            assert!(!job.to_string().contains(&key), "{job}");
            job["operator_step"]["number"].as_u64().ok_or(job)
        };
        let step = until("the job waits for its operator", asks).await;
        Self { href, step, key }
    }

    async fn confirm(&self, daemon: &Daemon, headers: &[(&str, &str)]) -> Response {
        let mut request = daemon.request(Method::POST, &format!("{}/confirm", self.href));
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        request.json(&json!({ "step": self.step })).send().await.unwrap()
    }

    async fn end(&self, daemon: &Daemon) {
        assert_eq!(daemon.request(Method::DELETE, &self.href).send().await.unwrap().status(), 200);
        daemon.until(&self.href, "the job ends", |job| !job["ended_at"].is_null()).await;
    }
}

#[tokio::test]
async fn a_prompt_is_confirmed_with_the_jobs_lease_or_its_confirm_key_and_with_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let daemon = daemon(folder.path()).await;
    let first = Waiting::start(&daemon, None).await;
    let none = problem(first.confirm(&daemon, &[]).await, 428, "confirm-key-required").await;
    assert!(none["detail"].as_str().unwrap().contains("Plenalign-Confirm"), "{none}");
    let twice = first.key.clone() + &first.key;
    for wrong in ["", "guess", &first.key[..71], &twice, &first.key.to_uppercase()] {
        problem(first.confirm(&daemon, &[(CONFIRM_HEADER, wrong)]).await, 403, "confirm-key-wrong").await;
    }
    problem(first.confirm(&daemon, &[(LEASE_HEADER, "guess")]).await, 403, "confirm-key-wrong").await;
    // A key is not what the other header takes.
    problem(first.confirm(&daemon, &[(LEASE_HEADER, &first.key)]).await, 403, "confirm-key-wrong").await;
    let job: Value = daemon.get(&first.href).await.json().await.unwrap();
    assert_eq!(job["state"], "waiting_for_operator", "nothing of that confirmed it");
    // It answers this job's prompts and does nothing else.
    let body = json!({ "position_mm": 1.0 });
    for header in [CONFIRM_HEADER, LEASE_HEADER] {
        let moved = daemon.request(Method::POST, "/api/v1/axes/e/move").header(header, &first.key).json(&body);
        assert!([412, 428].contains(&moved.send().await.unwrap().status().as_u16()), "{header}");
    }
    let confirmed = first.confirm(&daemon, &[(CONFIRM_HEADER, &first.key)]).await;
    assert_eq!(confirmed.status(), 200);
    assert!(!confirmed.text().await.unwrap().contains(&first.key));
    // Cancelling needs none, and the key ends with its job.
    first.end(&daemon).await;
    problem(first.confirm(&daemon, &[(CONFIRM_HEADER, &first.key)]).await, 409, "job-state").await;

    let second = Waiting::start(&daemon, None).await;
    problem(second.confirm(&daemon, &[(CONFIRM_HEADER, &first.key)]).await, 403, "confirm-key-wrong").await;
    let lease = daemon.lease().await;
    // The lease counts where a key beside it is wrong, and the other way round.
    let confirmed = second.confirm(&daemon, &[(LEASE_HEADER, lease), (CONFIRM_HEADER, &first.key)]).await;
    assert_eq!(confirmed.status(), 200);
}

#[tokio::test]
async fn a_confirm_key_is_told_once_and_kept_nowhere() {
    let folder = tempfile::tempdir().unwrap();
    let daemon = daemon(folder.path()).await;
    let ask = async || {
        let request = daemon.request(Method::POST, JOBS).header("Idempotency-Key", "once");
        let request = request.header(LEASE_HEADER, daemon.lease().await);
        request.json(&json!({ "kind": "joint_alignment", "record": true })).send().await.unwrap()
    };
    let created: Value = ask().await.json().await.unwrap();
    let key = created["confirm_key"].as_str().unwrap().to_owned();
    let again = ask().await;
    assert_eq!(again.status(), 200);
    let again: Value = again.json().await.unwrap();
    assert_eq!((&again["id"], &again["confirm_key"]), (&created["id"], &Value::Null), "it is not kept, so not told");
    let href = created["href"].as_str().unwrap();
    for path in ["", "/log", "/export.json", "/report.html", "/export.csv"] {
        assert!(!daemon.get(&format!("{href}{path}")).await.text().await.unwrap().contains(&key), "{path}");
    }
    for path in [JOBS, "/api/v1/bench", "/api/v1/audit", "/api/v1/lease"] {
        assert!(!daemon.get(path).await.text().await.unwrap().contains(&key), "{path}");
    }
    daemon.request(Method::DELETE, href).send().await.unwrap();
    daemon.written().await;
    let mut read = 0;
    for entry in walk(folder.path()) {
        let bytes = std::fs::read(&entry).unwrap();
        read += bytes.len();
        let found = bytes.windows(key.len()).any(|window| window == key.as_bytes());
        assert!(!found, "the key is in {}", entry.display());
    }
    assert!(read > 1000, "nothing was looked at");
}

/// Every file below a folder.
fn walk(folder: &Path) -> Vec<std::path::PathBuf> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { files.extend(walk(&path)) } else { files.push(path) }
    }
    files
}

#[tokio::test]
async fn a_lost_confirm_key_is_replaced_without_ending_the_job() {
    let folder = tempfile::tempdir().unwrap();
    let daemon = daemon(folder.path()).await;
    let lease = daemon.lease().await.to_owned();
    let make = async |name: &str, scope: &str, by: Option<&str>| {
        let mut request = daemon.request(Method::POST, "/api/v1/tokens").json(&json!({ "name": name, "scope": scope }));
        if let Some(by) = by {
            request = request.bearer_auth(by);
        }
        let made: Value = request.send().await.unwrap().json().await.unwrap();
        made["secret"].as_str().unwrap().to_owned()
    };
    let root = make("Root", "admin", None).await;
    let conny = make("Conny", "control", Some(&root)).await;
    let vera = make("Vera", "view", Some(&root)).await;
    let job = Waiting::start(&daemon, Some(&conny)).await;
    let renew = async |token: &str, lease: Option<&str>| {
        let mut request = daemon.request(Method::POST, &format!("{}/confirm-key", job.href)).bearer_auth(token);
        if let Some(lease) = lease {
            request = request.header(LEASE_HEADER, lease);
        }
        request.send().await.unwrap()
    };
    problem(renew(&vera, Some(&lease)).await, 403, "scope").await;
    let refused = problem(renew(&conny, None).await, 403, "scope").await;
    assert_eq!(refused["needed"], "admin");
    problem(renew(&conny, Some("guess")).await, 412, "lease-lost").await;
    let confirm = async |key: &str| {
        let request = daemon.request(Method::POST, &format!("{}/confirm", job.href)).bearer_auth(&conny);
        request.header(CONFIRM_HEADER, key).json(&json!({ "step": job.step })).send().await.unwrap()
    };
    let mut keys = vec![job.key.clone()];
    for (token, shown) in [(&root, None), (&conny, Some(lease.as_str()))] {
        let made = renew(token, shown).await;
        assert_eq!(made.status(), 200);
        let made: Value = made.json().await.unwrap();
        let key = made["confirm_key"].as_str().unwrap().to_owned();
        assert!(!keys.contains(&key) && job.href.ends_with(made["job"].as_str().unwrap()), "{made}");
        keys.push(key);
    }
    for old in &keys[..2] {
        problem(confirm(old).await, 403, "confirm-key-wrong").await;
    }
    let seen = daemon.request(Method::GET, &job.href).bearer_auth(&conny).send().await.unwrap();
    assert_eq!(seen.json::<Value>().await.unwrap()["state"], "waiting_for_operator", "the job goes on");
    assert_eq!(confirm(&keys[2]).await.status(), 200);

    daemon.written().await;
    let log = daemon.request(Method::GET, "/api/v1/audit").bearer_auth(&root).send().await.unwrap();
    let log: Value = log.json().await.unwrap();
    let entries = log["entries"].as_array().unwrap();
    let replaced: Vec<_> = entries.iter().filter(|entry| entry["what"] == "job.confirm_key").collect();
    let whos: Vec<_> = replaced.iter().map(|entry| entry["who"].as_str().unwrap()).collect();
    assert_eq!(whos, ["Conny", "Root"]);
    assert!(replaced.iter().all(|entry| job.href.ends_with(entry["detail"]["job"].as_str().unwrap())), "{replaced:?}");
    assert!(keys.iter().all(|key| !log.to_string().contains(key.as_str())));

    // Where there is no job any more there is nothing to be confirmed.
    daemon.request(Method::DELETE, &job.href).bearer_auth(&conny).send().await.unwrap();
    until("the job ends", async || {
        let job = daemon.request(Method::GET, &job.href).bearer_auth(&root).send().await.unwrap();
        job.json::<Value>().await.unwrap()["ended_at"].is_string()
    })
    .await;
    problem(renew(&root, None).await, 409, "job-state").await;
    let nobody = format!("{JOBS}/{}/confirm-key", uuid::Uuid::nil());
    problem(daemon.request(Method::POST, &nobody).bearer_auth(&root).send().await.unwrap(), 404, "not-found").await;
}

/// `plenalign align --server` gives its lease back at once, and prints the link by which its job is confirmed.
#[tokio::test]
async fn the_command_line_prints_the_link_that_confirms_its_job() {
    let folder = tempfile::tempdir().unwrap();
    let small = "[sensor]\nwidth_px = 400\nheight_px = 400\n[bench.simulation]\nrays = 4\noperator_confirms = false\n";
    std::fs::write(folder.path().join("bench.toml"), format!("{small}{QUICK_AXES}")).unwrap();
    let mut command = serve(folder.path(), &[]);
    command.env("TMPDIR", folder.path());
    let program = Program::start(command);
    let url = program.url().to_owned();
    let mut align = plenalign(folder.path());
    align.args(["align", "--server", &url]).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut align = align.spawn().unwrap();
    let mut lines = BufReader::new(align.stderr.take().unwrap()).lines();
    let said =
        lines.find_map(|line| line.unwrap().split_once(&format!("{url}/#/alignment/")).map(|(_, it)| it.to_owned()));
    let said = said.expect("it prints the link");
    let (job, key) = said.split_once('/').unwrap();
    let href = format!("{url}{JOBS}/{job}");
    let client = client();
    let asks = async || {
        let job: Value = client.get(&href).send().await.unwrap().json().await.unwrap();
        job["operator_step"]["number"].as_u64().ok_or(job)
    };
    let step = until("the job waits for its operator", asks).await;
    let confirm = client.post(format!("{href}/confirm")).json(&json!({ "step": step }));
    assert_eq!(confirm.try_clone().unwrap().send().await.unwrap().status(), 428);
    assert_eq!(confirm.header(CONFIRM_HEADER, key).send().await.unwrap().status(), 200);
    // The reset of the stop has its command, too.
    assert_eq!(client.post(format!("{url}/api/v1/stop")).send().await.unwrap().status(), 200);
    let _ = align.wait();
    let reset =
        plenalign(folder.path()).args(["stop", "--server", &url, "--reset", "a test goes on"]).output().unwrap();
    assert!(reset.status.success(), "{reset:?}");
    let stop: Value = client.get(format!("{url}/api/v1/stop")).send().await.unwrap().json().await.unwrap();
    assert_eq!((&stop["latched"], &stop["reset"]["why"]), (&json!(false), &json!("a test goes on")));
    assert!(stop["reset"]["by"].as_str().is_some_and(|by| by.contains('@')), "{stop}");
}

#[tokio::test]
async fn who_guesses_at_confirm_keys_has_to_wait_and_who_has_one_has_not() {
    let folder = tempfile::tempdir().unwrap();
    let daemon = daemon(folder.path()).await;
    let job = Waiting::start(&daemon, None).await;
    let mut answers = Vec::new();
    for n in 0..12 {
        let guess = format!("confirm_{n:064x}");
        answers.push(job.confirm(&daemon, &[(CONFIRM_HEADER, &guess)]).await);
    }
    let late = answers.pop().unwrap();
    assert_eq!(answers[0].status(), 403);
    assert!(late.headers().contains_key("retry-after"));
    problem(late, 429, "too-many-requests").await;
    assert_eq!(job.confirm(&daemon, &[(CONFIRM_HEADER, &job.key)]).await.status(), 200);
}
