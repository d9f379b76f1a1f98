//! The configuration over the API: read, checked, written into its file.

use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;
use std::sync::Arc;

use plenalign::access::{Gate, GateSettings, LogAudit, TokenStore};
use plenalign::api::server::{Connections, ServerSettings};
use plenalign::api::{Api, IN_RESERVE};
use plenalign::config::Config;
use plenalign::control::Service;
use plenalign::store::Store;
use reqwest::{Client, Method, Response};
use serde_json::{Value, json};
use tempfile::TempDir;

use super::daemon::{Daemon, client, problem};
use super::fakes::fakes;

const TEXT: &str = "# The bench in the cellar.\n[assembly]\ninitial_e_mm = 30.0 # measured by Ana\n\n[bench.e]\nhigh_limit_mm = 32.0\n";

/// A daemon with a configuration file.
struct Filed {
    client: Client,
    base: String,
    file: PathBuf,
    _folder: TempDir,
    _api: Api,
}

impl Filed {
    async fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("bench.toml");
        std::fs::write(&file, TEXT).unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o640)).unwrap();
        let (config, origin) = Config::open(Some(&file), &[]).unwrap();
        let gate = Gate::new(GateSettings::default(), TokenStore::in_memory(), Box::new(LogAudit));
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let service = Service::start(Arc::new(config), "a test's".to_owned(), fakes().bench, Store::in_memory());
        let api = Api::new(service, Arc::new(gate), address, origin);
        let connections = Connections::new(ServerSettings::default());
        tokio::spawn(connections.serve(listener, api.router(), IN_RESERVE, api.closing()));
        Self { client: client(), base: format!("http://{address}"), file, _folder: folder, _api: api }
    }

    async fn get(&self) -> (Value, String) {
        let response = self.client.get(format!("{}/api/v1/config", self.base)).send().await.unwrap();
        let tag = response.headers()["etag"].to_str().unwrap().to_owned();
        (response.json().await.unwrap(), tag)
    }

    async fn put(&self, config: &Value, tag: Option<&str>) -> Response {
        let mut request = self.client.put(format!("{}/api/v1/config", self.base)).json(&json!({ "config": config }));
        if let Some(tag) = tag {
            request = request.header("if-match", tag);
        }
        request.send().await.unwrap()
    }

    async fn validate(&self, config: &Value) -> Value {
        let request = self.client.post(format!("{}/api/v1/config/validate", self.base));
        request.json(&json!({ "config": config })).send().await.unwrap().json().await.unwrap()
    }

    fn text(&self) -> String {
        std::fs::read_to_string(&self.file).unwrap()
    }
}

#[tokio::test]
async fn a_change_is_written_with_its_comments_and_says_what_needs_a_restart() {
    let filed = Filed::start().await;
    let (view, tag) = filed.get().await;
    assert_eq!((&view["stored"], &view["restart_required"]), (&view["config"], &json!([])));
    let mut config = view["stored"].clone();
    config["assembly"]["initial_e_mm"] = json!(29.5);
    config["bench"]["e"]["steps_per_mm"] = json!(800);
    let written = filed.put(&config, Some(&tag)).await;
    assert_eq!(written.status(), 200);
    let new_tag = written.headers()["etag"].to_str().unwrap().to_owned();
    assert_ne!(new_tag, tag);
    let written: Value = written.json().await.unwrap();
    let keys = json!(["assembly.initial_e_mm", "bench.e.steps_per_mm"]);
    assert_eq!((&written["changed"], &written["restart_required"]), (&keys, &keys));
    assert_eq!(filed.text(), TEXT.replace("30.0 # measured", "29.5 # measured") + "steps_per_mm = 800.0\n");
    assert_eq!(std::fs::metadata(&filed.file).unwrap().permissions().mode() & 0o777, 0o640);
    assert_eq!(std::fs::read_dir(filed.file.parent().unwrap()).unwrap().count(), 1);

    let (view, tag) = filed.get().await;
    assert_eq!(tag, new_tag);
    assert_eq!(view["config"]["assembly"]["initial_e_mm"], 30.0, "nothing takes effect before a restart");
    assert_eq!((&view["stored"]["assembly"]["initial_e_mm"], &view["restart_required"]), (&json!(29.5), &keys));
    // The same again changes nothing, and back again nothing needs a restart.
    let same: Value = filed.put(&config, Some(&tag)).await.json().await.unwrap();
    assert_eq!(same["changed"], json!([]));
    let back: Value = filed.put(&view["config"], Some(&tag)).await.json().await.unwrap();
    assert_eq!((&back["changed"], &back["restart_required"]), (&keys, &json!([])));
}

#[tokio::test]
async fn nobodys_change_is_lost() {
    let filed = Filed::start().await;
    let (view, tag) = filed.get().await;
    let mut config = view["stored"].clone();
    config["assembly"]["initial_e_mm"] = json!(29.5);
    problem(filed.put(&config, None).await, 428, "if-match-missing").await;
    // Any state is no state.
    problem(filed.put(&config, Some("*")).await, 428, "if-match-missing").await;
    std::fs::write(&filed.file, TEXT.replace("cellar", "attic")).unwrap();
    let refused = problem(filed.put(&config, Some(&tag)).await, 412, "config-changed").await;
    assert!(filed.text().contains("attic") && filed.text().contains("30.0"));
    let now = refused["etag"].as_str().unwrap();
    assert_eq!(filed.put(&config, Some(now)).await.status(), 200);
    assert!(filed.text().contains("attic") && filed.text().contains("29.5"));
}

#[tokio::test]
async fn what_makes_no_sense_is_named_key_by_key_and_not_written() {
    let filed = Filed::start().await;
    let (view, tag) = filed.get().await;
    let mut config = view["stored"].clone();
    assert_eq!(filed.validate(&config).await["valid"], true);
    config["mla"]["pitch_mm"] = json!(-1);
    config["bench"]["e"]["speed_mm_per_s"] = json!(0);
    let check = filed.validate(&config).await;
    let keys: Vec<_> = check["problems"].as_array().unwrap().iter().map(|fault| fault["key"].clone()).collect();
    assert_eq!((&check["valid"], keys), (&json!(false), vec![json!("bench.e.speed_mm_per_s"), json!("mla.pitch_mm")]));
    let refused = problem(filed.put(&config, Some(&tag)).await, 422, "config-invalid").await;
    assert_eq!(refused["problems"], check["problems"]);
    let unknown = filed.validate(&json!({ "bench": { "e": { "speed": 1 } } })).await;
    assert_eq!(unknown["problems"][0]["key"], "bench.e.speed");
    assert_eq!(filed.text(), TEXT);
}

#[tokio::test]
async fn what_is_run_read_or_opened_cannot_be_chosen_over_the_api() {
    let filed = Filed::start().await;
    let (view, tag) = filed.get().await;
    assert_eq!(
        view["locked"],
        json!(["server", "alpaca", "foxglove", "mqtt", "history", "record.folder", "bench.camera.files"])
    );
    let changes: [fn(&mut Value); 10] = [
        |config| config["history"]["keep_audit_days"] = json!(1),
        |config| config["server"]["auth"] = json!("required"),
        |config| config["alpaca"]["listen"] = json!("127.0.0.1:11111"),
        |config| config["server"]["tls"] = json!({ "certificate": "/etc/shadow", "key": "/etc/shadow" }),
        |config| config["server"]["trusted_proxies"] = json!(["0.0.0.0/0"]),
        |config| config["bench"]["camera"]["files"] = json!("/etc/*"),
        |config| config["record"]["folder"] = json!("/etc"),
        |config| config["foxglove"]["listen"] = json!("127.0.0.1:8765"),
        |config| config["mqtt"]["broker"] = json!("mqtt://evil.example"),
        |config| config["mqtt"]["tls"]["ca"] = json!("/etc/shadow"),
    ];
    for change in changes {
        let mut config = view["stored"].clone();
        change(&mut config);
        let refused = problem(filed.put(&config, Some(&tag)).await, 403, "config-locked").await;
        assert!(!refused["problems"].as_array().unwrap().is_empty());
        assert_eq!(filed.validate(&config).await["valid"], false);
    }
    for device in ["/etc/passwd", "/dev/../etc/passwd", "http://evil.example/"] {
        let mut config = view["stored"].clone();
        config["bench"]["camera"]["device"] = json!(device);
        problem(filed.put(&config, Some(&tag)).await, 422, "config-invalid").await;
    }
    let mut config = view["stored"].clone();
    config["bench"]["camera"]["device"] = json!("/dev/v4l/by-id/usb-x");
    assert_eq!(filed.put(&config, Some(&tag)).await.status(), 200);
}

#[tokio::test]
async fn a_file_that_cannot_be_used_or_kept_is_said_to_be() {
    let filed = Filed::start().await;
    let (view, tag) = filed.get().await;
    std::fs::write(&filed.file, "[assembly").unwrap();
    let refused = problem(filed.put(&view["config"], Some(&tag)).await, 409, "config-unreadable").await;
    assert!(refused["detail"].as_str().unwrap().contains("bench.toml"), "{refused}");
    let (view, _) = {
        let response = filed.client.get(format!("{}/api/v1/config", filed.base)).send().await.unwrap();
        assert!(!response.headers().contains_key("etag"));
        (response.json::<Value>().await.unwrap(), ())
    };
    assert!(view["stored"].is_null() && view["config"].is_object());
}

#[tokio::test]
async fn without_a_file_there_is_a_clear_word_of_where_one_would_be() {
    let daemon = Daemon::start(fakes().bench).await;
    let view: Value = daemon.get("/api/v1/config").await.json().await.unwrap();
    assert_eq!((&view["file"], &view["stored"]), (&Value::Null, &Value::Null));
    let body = json!({ "config": view["config"] });
    let request = daemon.request(Method::PUT, "/api/v1/config").header("if-match", "\"1\"").json(&body);
    let refused = problem(request.send().await.unwrap(), 409, "no-config-file").await;
    assert!(refused["detail"].as_str().unwrap().contains("--config /etc/plenalign/plenalign.toml"), "{refused}");
}

#[tokio::test]
async fn the_schema_is_a_json_schema_of_every_key() {
    let daemon = Daemon::start(fakes().bench).await;
    let response = daemon.get("/api/v1/config/schema").await;
    assert_eq!(response.headers()["content-type"], "application/schema+json");
    let schema: Value = response.json().await.unwrap();
    assert_eq!(schema["$schema"], "https://json-schema.org/draft/2020-12/schema");
    assert_eq!(schema["properties"]["bench"]["$ref"], "#/$defs/BenchConfig");
    assert_eq!(schema["$defs"]["AxisConfig"]["properties"]["speed_mm_per_s"]["default"], json!(2.0));
}
