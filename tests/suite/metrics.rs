//! The labels of the metrics: each takes its values from a closed set, whatever is sent to the daemon. A label that
//! anybody may write into is memory that anybody may fill.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;

use serde_json::Value;

use super::limits::exchange;
use super::program::{Program, serve};

const METHODS: [&str; 10] = ["GET", "HEAD", "POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT", "other"];

/// Every value that each label may have, of a daemon with the simulated bench and no broker.
fn closed_sets() -> BTreeMap<&'static str, BTreeSet<String>> {
    let contract: Value = serde_json::from_str(plenalign::api::openapi_json()).unwrap();
    let words = |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect::<BTreeSet<_>>();
    let paths = contract["paths"].as_object().unwrap();
    let mut routes: BTreeSet<String> = paths.keys().cloned().collect();
    routes.insert("none".to_owned());
    let operations = paths.values().flat_map(|item| item.as_object().unwrap().values());
    let answers = operations.flat_map(|operation| operation["responses"].as_object().unwrap().keys().cloned());
    let mut statuses: BTreeSet<String> = answers.collect();
    // What no operation has of its own: the page's files, a foreign Host or Origin, another method, a switch of protocols.
    statuses.extend(words(&["101", "200", "304", "400", "403", "404", "405", "421", "426", "503"]));
    BTreeMap::from([
        ("method", words(&METHODS)),
        ("route", routes),
        ("status", statuses),
        ("viewer", words(&["websocket", "mjpeg"])),
        ("axis", words(&["focus", "e"])),
        ("controller", words(&["the focus axis", "the e axis", "the bench"])),
        ("encoder", words(&["libjpeg-turbo", "jpeg-encoder"])),
        ("version", words(&[env!("CARGO_PKG_VERSION")])),
    ])
}

/// Name and value of every label in the text that Prometheus reads, but for the bounds of buckets.
fn labels(text: &str) -> BTreeSet<(String, String)> {
    let mut found = BTreeSet::new();
    for line in text.lines().filter(|line| !line.starts_with('#')) {
        let Some((_, rest)) = line.split_once('{') else { continue };
        let (inside, _) = rest.rsplit_once("} ").unwrap_or_else(|| panic!("{line} is no sample"));
        for label in inside.split("\",") {
            let (name, value) = label.split_once("=\"").unwrap_or_else(|| panic!("{label} in {line}"));
            if name != "le" {
                found.insert((name.to_owned(), value.trim_end_matches('"').to_owned()));
            }
        }
    }
    found
}

/// What comes of a request line and further headers.
async fn ask(address: SocketAddr, line: &str, headers: &str) -> String {
    exchange(address, &format!("{line} HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n{headers}\r\n")).await
}

#[tokio::test]
async fn every_label_comes_from_a_closed_set_whatever_is_asked() {
    let state = tempfile::tempdir().unwrap();
    let config = "[server]\nrequests_per_s = 100000.0\n[bench.simulation]\nrays = 4\n\
                  [alpaca]\nlisten = \"127.0.0.1:0\"\ndiscovery = false\n[foxglove]\nlisten = \"127.0.0.1:0\"\n";
    std::fs::write(state.path().join("bench.toml"), config).unwrap();
    let program = Program::start(serve(state.path(), &[]));
    let main: SocketAddr = program.address().parse().unwrap();
    let alpaca = program.said["alpaca"].as_str().unwrap().parse().unwrap();
    let foxglove = program.said["foxglove"].as_str().unwrap().trim_start_matches("ws://").parse().unwrap();

    let long = |length| "X".repeat(length);
    let made_up = ["BREW", "get", "PROPFIND", "QUERY", "!#$%&'*+-.^_`|~", &long(1000), &long(12_000), &long(30_000)];
    for method in METHODS.into_iter().chain(made_up) {
        for path in ["/healthz", "/api/v1/bench", "/api/v1/stop", "/api/v1/made-up", "/", "/made-up.js"] {
            ask(main, &format!("{method} {path}"), "").await;
        }
        ask(alpaca, &format!("{method} /api/v1/focuser/0/position"), "").await;
        ask(foxglove, &format!("{method} /"), "").await;
    }
    let paths = [
        "*",
        "//",
        "/%00",
        "/%ff%fe",
        "/..%2f..%2fetc/passwd",
        "/api",
        "/api/",
        "/api/v2/bench",
        "/metrics/made-up",
        "/api/v1/jobs/made-up",
        "/api/v1/jobs/0190a000-0000-7000-8000-000000000000/export.exe",
        "/api/v1/jobs/0190a000-0000-7000-8000-000000000000/report.html",
        "/api/v1/axes/made-up/move",
        "/api/v1/view.bmp",
        "/api/v1/snapshot.jpg?reduce=99&quality=made-up",
        "/api/v1/frame.png?format=made-up",
        "/api/v1/view.jpg?kind=made-up",
        "/api/v1/ws?after=made-up&boot_id=made-up",
        "http://127.0.0.1/healthz",
        "/healthz?{label=\"made-up\"}",
        "/api/v1/bench?ticket=made-up",
    ];
    for path in paths {
        for method in ["GET", "POST", "OPTIONS"] {
            ask(main, &format!("{method} {path}"), "").await;
        }
    }
    for n in 0..50 {
        ask(main, &format!("GET /api/v1/made-up-{n}"), "").await;
        ask(main, &format!("GET /made-up-{n}.html"), "").await;
    }
    for headers in [
        "accept: image/made-up\r\n",
        "content-type: made-up\r\ncontent-length: 2\r\n",
        "user-agent: made-up\r\norigin: http://made-up\r\n",
        "authorization: Bearer made-up\r\n",
        "cookie: made-up=1\r\n",
        "upgrade: websocket\r\nconnection: upgrade\r\nsec-websocket-version: 13\r\n\
         sec-websocket-key: dGhlIHNhbXBsZSBub25jZQ==\r\nsec-websocket-protocol: made-up\r\norigin: http://made-up\r\n",
        "x-forwarded-for: made-up\r\n",
    ] {
        for line in ["GET /api/v1/bench", "POST /api/v1/measurements", "GET /api/v1/ws", "GET /api/v1/snapshot.jpg"] {
            ask(main, line, headers).await;
        }
    }
    exchange(main, "GET /healthz HTTP/1.1\r\nhost: made-up.example\r\nconnection: close\r\n\r\n").await;
    exchange(main, "GET /healthz HTTP/1.0\r\n\r\n").await;
    exchange(main, "made-up\r\n\r\n").await;

    let text = ask(main, "GET /metrics", "").await;
    let (_, text) = text.split_once("\r\n\r\n").unwrap();
    let (sets, found) = (closed_sets(), labels(text));
    for (label, value) in &found {
        let set = sets.get(label.as_str()).unwrap_or_else(|| panic!("the label {label} is in no list: {value:.100}"));
        assert!(set.contains(value), "{label}={value:.100} comes from outside");
    }
    assert!(!text.to_lowercase().contains("made-up"), "{text}");
    // The barrage was seen: what the sets hold for it is there.
    for (label, value) in [("method", "other"), ("route", "none"), ("status", "405"), ("status", "401")] {
        assert!(found.contains(&(label.to_owned(), value.to_owned())), "{label}={value} is missing");
    }
}
