//! Resetting the stop: who did it and why is said, kept and shown, and nothing that was held goes on by it.

use std::sync::Arc;

use plenalign::control::open_bench;
use reqwest::{Method, Response};
use serde_json::{Value, json};

use super::bench::small_config;
use super::daemon::{Daemon, problem};
use super::fakes::fakes;
use super::until::until;

const STOP: &str = "/api/v1/stop";

async fn bench(daemon: &Daemon) -> Value {
    daemon.get("/api/v1/bench").await.json().await.unwrap()
}

async fn reset(daemon: &Daemon, body: &Value) -> Response {
    daemon.request(Method::DELETE, STOP).json(body).send().await.unwrap()
}

async fn audited(daemon: &Daemon, token: Option<&str>) -> Vec<Value> {
    let mut request = daemon.request(Method::GET, "/api/v1/audit");
    if let Some(token) = token {
        request = request.bearer_auth(token);
    }
    let log: Value = request.send().await.unwrap().json().await.unwrap();
    let entries = log["entries"].as_array().unwrap().iter();
    entries.filter(|entry| entry["what"] == "stop.reset").cloned().collect()
}

#[tokio::test]
async fn a_reset_without_a_reason_is_refused_and_releases_nothing() {
    let daemon = Daemon::start(fakes().bench).await;
    daemon.request(Method::POST, STOP).send().await.unwrap();
    let bare = problem(daemon.request(Method::DELETE, STOP).send().await.unwrap(), 422, "invalid").await;
    assert_eq!(bare["field"], "why");
    assert!(bare["detail"].as_str().unwrap().contains("{\"why\": "), "it says what would be right: {bare}");
    for (body, field) in [
        (json!({}), "why"),
        (json!({ "why": " " }), "why"),
        (json!({ "why": "a\u{7}" }), "why"),
        (json!({ "why": "x".repeat(201) }), "why"),
        (json!({ "why": 7 }), "why"),
        (json!({ "why": "clear", "owner": "" }), "owner"),
        (json!({ "why": "clear", "who": "Ada" }), "who"),
    ] {
        assert_eq!(problem(reset(&daemon, &body).await, 422, "invalid").await["field"], field, "{body}");
    }
    assert_eq!(bench(&daemon).await["stop"]["latched"], true);
    assert_eq!(audited(&daemon, None).await, [] as [Value; 0]);
}

#[tokio::test]
async fn who_stops_without_a_token_may_say_who_and_is_never_refused() {
    let daemon = Daemon::start(fakes().bench).await;
    let (long, twice) = ("x".repeat(201), "?owner=Ada&owner=Ben".to_owned());
    for (query, by) in [
        ("?owner=Ada%20am%20M%C3%BCnster".to_owned(), "Ada am Münster"),
        ("?owner=%20".to_owned(), "local"),
        (format!("?owner={long}"), "local"),
        (twice, "local"),
        ("?who=Ada".to_owned(), "local"),
    ] {
        let answer = daemon.request(Method::POST, &format!("{STOP}{query}")).send().await.unwrap();
        assert_eq!(answer.status(), 200, "{query}");
        let stop = bench(&daemon).await["stop"].clone();
        assert_eq!((&stop["latched"], &stop["by"]), (&json!(true), &json!(by)), "{query}");
        assert_eq!(reset(&daemon, &json!({ "why": "a test" })).await.status(), 200);
    }
}

#[tokio::test]
async fn who_stopped_who_reset_and_why_are_seen_and_audited() {
    let daemon = Daemon::start(fakes().bench).await;
    daemon.request(Method::POST, STOP).send().await.unwrap();
    let stopped = bench(&daemon).await["stop"].clone();
    assert_eq!((&stopped["latched"], &stopped["by"]), (&json!(true), &json!("local")), "{stopped}");
    let why = "the cable is free again";
    let answer = reset(&daemon, &json!({ "why": why, "owner": "Ada at the bench" })).await;
    assert_eq!(answer.status(), 200);
    let answer: Value = answer.json().await.unwrap();
    assert_eq!(answer, bench(&daemon).await["stop"]);
    assert_eq!((&answer["latched"], &answer["since"], &answer["by"]), (&json!(false), &Value::Null, &Value::Null));
    let said = &answer["reset"];
    assert_eq!((&said["by"], &said["why"]), (&json!("Ada at the bench"), &json!(why)));
    assert_eq!((&said["stopped_by"], &said["stopped_at"]), (&json!("local"), &stopped["since"]));
    assert!(said["at"].as_str() > stopped["since"].as_str(), "{answer}");
    // Asked again, nothing more happens.
    let again: Value = reset(&daemon, &json!({ "why": "twice" })).await.json().await.unwrap();
    assert_eq!(again, answer);
    let entries = audited(&daemon, None).await;
    assert_eq!(entries.len(), 1, "{entries:?}");
    assert_eq!((&entries[0]["detail"]["why"], &entries[0]["detail"]["by"]), (&json!(why), &json!("Ada at the bench")));

    // Who has a token is known by it, and by nothing else.
    let mut tokens = Vec::new();
    for (name, scope) in [("Root", "admin"), ("Vera", "view"), ("Conny", "control")] {
        let mut request = daemon.request(Method::POST, "/api/v1/tokens").json(&json!({ "name": name, "scope": scope }));
        if let Some(root) = tokens.first() {
            request = request.bearer_auth(root);
        }
        let made: Value = request.send().await.unwrap().json().await.unwrap();
        tokens.push(made["secret"].as_str().unwrap().to_owned());
    }
    daemon.request(Method::POST, STOP).bearer_auth(&tokens[1]).send().await.unwrap();
    let request = daemon.request(Method::DELETE, STOP).bearer_auth(&tokens[2]);
    let answer = request.json(&json!({ "why": "seen to", "owner": "Vera" })).send().await.unwrap();
    let answer: Value = answer.json().await.unwrap();
    assert_eq!((&answer["reset"]["by"], &answer["reset"]["stopped_by"]), (&json!("Conny"), &json!("Vera")), "{answer}");
    let entries = audited(&daemon, Some(&tokens[0])).await;
    assert_eq!((&entries[0]["who"], &entries[0]["detail"]["why"]), (&json!("Conny"), &json!("seen to")));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nothing_that_was_held_goes_on_by_a_reset() {
    let mut config = small_config(1);
    config.bench.simulation.operator_confirms = false;
    let opened = open_bench(&Arc::new(config.clone())).await.unwrap();
    let daemon = Daemon::start_with(config, opened).await;
    let focus = async || bench(&daemon).await["axes"][0].clone();
    daemon.command(Method::POST, "/api/v1/axes/focus/home", &Value::Null).await;
    until("homed", async || focus().await["homed"] == true && focus().await["moving"] == false).await;
    let word = async |press: &str| {
        let body = json!({ "towards": "high", "speed_mm_per_s": 0.2, "press": press });
        daemon.command(Method::POST, "/api/v1/axes/focus/jog", &body).await
    };
    // A button that is held, and repeats its word; between two of these the bench is stopped, and the stop reset.
    until("jogging", async || word("first").await.status() == 202 && focus().await["moving"] == true).await;
    let lease = bench(&daemon).await["lease"]["id"].clone();
    daemon.request(Method::POST, STOP).send().await.unwrap();
    assert_eq!(daemon.reset_stop().await.status(), 200);
    until("at rest", async || focus().await["moving"] == false).await;
    let there = focus().await["position_mm"].clone();
    for _ in 0..5 {
        let refused = problem(word("first").await, 409, "press-ended").await;
        assert_eq!(refused["axis"], "focus");
    }
    assert_eq!((&focus().await["position_mm"], &focus().await["moving"]), (&there, &json!(false)));
    assert_eq!(bench(&daemon).await["lease"]["id"], lease, "who has control has it still");
    // Let go of and pressed again, it moves.
    until("jogging again", async || word("second").await.status() == 202 && focus().await["moving"] == true).await;
    daemon.request(Method::DELETE, "/api/v1/axes/focus/jog").send().await.unwrap();
    until("at rest", async || focus().await["moving"] == false).await;

    let href = until("accepted", async || {
        let job = daemon.command(Method::POST, "/api/v1/jobs", &json!({ "kind": "joint_alignment" })).await;
        if job.status() != 201 {
            return None;
        }
        job.json::<Value>().await.unwrap()["href"].as_str().map(str::to_owned)
    })
    .await;
    let state = async || daemon.get(&href).await.json::<Value>().await.unwrap()["state"].clone();
    daemon.request(Method::POST, STOP).send().await.unwrap();
    until("cancelled", async || state().await == "cancelled").await;
    assert_eq!(daemon.reset_stop().await.status(), 200);
    assert_eq!((state().await, &bench(&daemon).await["job"]), (json!("cancelled"), &Value::Null));
    assert_eq!(focus().await["moving"], false);
}
