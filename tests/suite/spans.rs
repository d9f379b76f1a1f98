//! The spans that the program exports, as a collector gets them.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};

use axum::Router;
use axum::body::Bytes;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::routing::post;
use opentelemetry_proto::tonic::collector::trace::v1::ExportTraceServiceRequest;
use opentelemetry_proto::tonic::common::v1::any_value::Value as Any;
use prost::Message as _;
use serde_json::Value;

use super::daemon::client;
use super::until::until;

type Exports = Arc<Mutex<Vec<ExportTraceServiceRequest>>>;

struct Killed(Child);

impl Drop for Killed {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

async fn collect(State(exports): State<Exports>, headers: HeaderMap, body: Bytes) -> StatusCode {
    assert_eq!(headers["content-type"], "application/x-protobuf");
    exports.lock().unwrap().push(ExportTraceServiceRequest::decode(body).unwrap());
    StatusCode::OK
}

/// Name, and attributes that are text, of every span got so far.
fn spans(exports: &Exports) -> Vec<(String, Vec<(String, String)>)> {
    let exports = exports.lock().unwrap();
    let spans = exports.iter().flat_map(|export| &export.resource_spans).flat_map(|resource| {
        let service = resource.resource.as_ref().unwrap().attributes.iter();
        let named = |name: &str| service.clone().any(|one| one.key == "service.name" && said(&one.value) == name);
        assert!(named("plenalign"));
        resource.scope_spans.iter().flat_map(|scope| &scope.spans)
    });
    spans
        .map(|span| {
            let attributes = span.attributes.iter().map(|one| (one.key.clone(), said(&one.value))).collect();
            (span.name.clone(), attributes)
        })
        .collect()
}

fn said(value: &Option<opentelemetry_proto::tonic::common::v1::AnyValue>) -> String {
    match value.as_ref().and_then(|value| value.value.clone()) {
        Some(Any::StringValue(text)) => text,
        _ => String::new(),
    }
}

#[tokio::test]
async fn a_request_and_a_job_are_spans_that_a_collector_gets() {
    let exports = Exports::default();
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let collector = format!("http://{}", listener.local_addr().unwrap());
    let router = Router::new().route("/v1/traces", post(collect)).with_state(exports.clone());
    tokio::spawn(async move { axum::serve(listener, router).await });

    let state = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_plenalign"));
    command
        .args(["serve", "--simulated", "--json", "--listen", "127.0.0.1:0", "--set", "bench.simulation.rays=4"])
        .env("PLENALIGN_STATE_DIR", state.path())
        .env("OTEL_EXPORTER_OTLP_ENDPOINT", collector)
        .env("OTEL_BSP_SCHEDULE_DELAY", "100")
        .stdout(Stdio::piped())
        .stderr(Stdio::null());
    let mut child = Killed(command.spawn().unwrap());
    let mut line = String::new();
    BufReader::new(child.0.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let said: Value = serde_json::from_str(&line).unwrap();
    let address = said["address"].as_str().unwrap().trim_end_matches('/').to_owned();

    let path = "/api/v1/jobs/0199f0f2-5d2a-7c3e-9a53-5f0f6c1f6a11";
    let answer = client().get(format!("{address}{path}?ticket=plenalign_secret")).send().await.unwrap();
    assert_eq!(answer.status(), 401);
    let asked = serde_json::json!({ "owner": "a test" });
    let grant: Value =
        client().post(format!("{address}/api/v1/lease")).json(&asked).send().await.unwrap().json().await.unwrap();
    let job = client()
        .post(format!("{address}/api/v1/jobs"))
        .header("Plenalign-Lease", grant["key"].as_str().unwrap())
        .json(&serde_json::json!({ "kind": "homing", "axes": ["focus"] }));
    assert_eq!(job.send().await.unwrap().status(), 201);

    let wanted = ["GET /api/v1/jobs/{id}", "POST /api/v1/jobs", "job homing"];
    let spans = until("all three are exported", async || {
        let spans = spans(&exports);
        let all = wanted.iter().all(|name| spans.iter().any(|(found, _)| found == name));
        if all { Ok(spans) } else { Err(format!("{spans:?}")) }
    })
    .await;
    let (_, attributes) = spans.iter().find(|(name, _)| name == wanted[0]).unwrap();
    assert!(attributes.contains(&("path".to_owned(), path.to_owned())), "{attributes:?}");
    // What opens a door leaves with no span.
    assert!(!format!("{spans:?}").contains("plenalign_secret"));
}
