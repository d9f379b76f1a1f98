//! `plenalign jobs`: what is kept is listed, shown and exported, with and without a daemon.

use std::path::Path;
use std::process::Output;

use plenalign::store::{JobFilter, Store, read};
use serde_json::{Value, json};

use super::program::{Program, plenalign, serve};
use super::until::{until, when};

const NO_JOB: &str = "0199f0f2-5d2a-7c3e-9a53-5f0f6c1f6a11";

fn jobs(state: &Path, arguments: &[&str]) -> Output {
    plenalign(state).current_dir(state).arg("jobs").args(arguments).output().unwrap()
}

fn text(output: &Output) -> String {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn said(output: &Output) -> Value {
    serde_json::from_str(&text(output)).unwrap()
}

/// What a command that fails says of it, in one line.
fn refusal(output: &Output) -> String {
    assert_eq!(output.status.code(), Some(1));
    assert!(output.stdout.is_empty());
    let said = String::from_utf8(output.stderr.clone()).unwrap();
    assert_eq!(said.lines().filter(|line| line.starts_with("plenalign: ")).count(), 1, "{said}");
    said
}

/// A state folder in which one job has been done: the axes homed.
async fn homed(state: &Path) -> String {
    let program = Program::start(serve(state, &[]));
    let client = super::daemon::client();
    let post = |path: &str| client.post(format!("{}{path}", program.url()));
    let lease: Value =
        post("/api/v1/lease").json(&json!({ "owner": "a test" })).send().await.unwrap().json().await.unwrap();
    let job = post("/api/v1/jobs").header("Plenalign-Lease", lease["key"].as_str().unwrap());
    let job: Value = job.json(&json!({ "kind": "homing" })).send().await.unwrap().json().await.unwrap();
    let href = format!("{}{}", program.url(), job["href"].as_str().unwrap());
    let ended = async || {
        let job: Value = client.get(&href).send().await.unwrap().json().await.unwrap();
        when(job, |job| job["ended_at"].is_string())
    };
    let ended = until("the job ends", ended).await;
    assert_eq!(ended["state"], "succeeded", "{ended}");
    // The daemon says the same as the file.
    let id = job["id"].as_str().unwrap().to_owned();
    let asked = jobs(state, &["list", "--json", "--server", program.url()]);
    assert_eq!(said(&asked)["jobs"][0]["id"], id.as_str());
    let shown = jobs(state, &["show", &id, "--server", program.url()]);
    assert!(text(&shown).contains(&id));
    let unknown = refusal(&jobs(state, &["show", NO_JOB, "--server", program.url()]));
    assert!(unknown.contains(NO_JOB), "{unknown}");
    program.terminate();
    let (status, _, log) = program.end(std::time::Duration::from_secs(5));
    assert!(status.success(), "{log}");
    id
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_kept_is_listed_shown_and_exported_without_a_daemon() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path();
    let id = homed(state).await;

    let line = text(&jobs(state, &["list"]));
    assert_eq!(line.lines().count(), 1, "{line}");
    assert!(line.starts_with(&id) && line.contains("SIMULATED"), "{line}");
    let list = said(&jobs(state, &["list", "--json"]));
    let found = &list["jobs"][0];
    assert_eq!((&found["id"], &found["state"], &found["kind"]), (&json!(id), &json!("succeeded"), &json!("homing")));
    assert_eq!((&list["next"], list["jobs"].as_array().unwrap().len()), (&Value::Null, 1));
    assert_eq!(said(&jobs(state, &["list", "--json", "--state", "failed"]))["jobs"], json!([]));
    assert_eq!(text(&jobs(state, &["list", "--state", "failed"])).trim(), "no job");
    assert_eq!(said(&jobs(state, &["list", "--json", "--q", &id[..13]]))["jobs"][0]["id"], id.as_str());
    let none = jobs(state, &["list", "--state", "polished"]);
    assert_eq!(none.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&none.stderr).contains("not_converged"));

    let shown = text(&jobs(state, &["show", &id]));
    assert!(shown.starts_with(&format!("job {id}, ")) && shown.contains("SIMULATED bench"), "{shown}");
    let whole = said(&jobs(state, &["show", &id, "--json"]));
    assert_eq!(whole["job"]["id"], id.as_str());
    let moves = Store::to_read(state).read(|connection| read::newest_moves(connection, 10)).await.unwrap();
    assert_eq!(whole["moves"].as_array().unwrap().len(), moves.len());

    for (format, begins) in [("json", "{"), ("csv", "job,"), ("html", "<!")] {
        let file = format!("SIMULATED-plenalign-{id}.{format}");
        let written = text(&jobs(state, &["export", &id, "--format", format]));
        assert_eq!(written.trim(), file);
        let content = std::fs::read_to_string(state.join(&file)).unwrap();
        assert!(content.trim_start().to_lowercase().starts_with(begins), "{file}: {content}");
        assert!(content.contains("SIMULATED") || format == "csv" && content.starts_with("job,simulated,"), "{file}");
        // But for the time at which it is exported.
        let lasting = |content: &str| -> Vec<String> {
            content.lines().filter(|line| !line.contains("xported")).map(str::to_owned).collect()
        };
        let shown = text(&jobs(state, &["export", &id, "--format", format, "-o", "-"]));
        assert_eq!(lasting(shown.trim_end()), lasting(content.trim_end()));
        let named = said(&jobs(state, &["export", &id, "--format", format, "-o", "named", "--json"]));
        assert_eq!(named, json!({ "file": "named" }));
        assert_eq!(lasting(&std::fs::read_to_string(state.join("named")).unwrap()), lasting(&content));
    }

    for arguments in [&["show", NO_JOB][..], &["export", NO_JOB], &["show", NO_JOB, "--json"]] {
        let unknown = refusal(&jobs(state, arguments));
        assert!(unknown.contains(&format!("there is no job {NO_JOB}")), "{unknown}");
    }
    let away = refusal(&jobs(state, &["list", "--server", "http://127.0.0.1:1"]));
    assert!(away.contains("127.0.0.1:1"), "{away}");
    // It was only read.
    let kept = Store::to_read(state).read(|connection| read::jobs(connection, &JobFilter::default(), 10)).await;
    assert_eq!(kept.unwrap().items.len(), 1);
}

#[test]
fn without_a_history_it_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let none = refusal(&jobs(folder.path(), &["list"]));
    assert!(none.contains("no history") && none.contains(folder.path().to_str().unwrap()), "{none}");
    assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none(), "and makes none");
}
