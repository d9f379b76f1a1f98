//! The whole daemon on a port of its own, for a test to talk to.

use std::sync::Arc;

use plenalign::access::{Gate, GateSettings, TokenStore};
use plenalign::api::error::LEASE_HEADER;
use plenalign::api::server::{Connections, ServerSettings, use_ring};
use plenalign::api::{Api, IN_RESERVE};
use plenalign::config::{Config, ConfigOrigin};
use plenalign::control::Service;
use plenalign::control::service::history::HistoryAudit;
use plenalign::device::Bench;
use plenalign::store::{Hindrance, Store};
use reqwest::{Client, Method, RequestBuilder, Response, StatusCode};
use serde_json::{Value, json};
use tokio::sync::OnceCell;

use super::until::{until, when};

pub(crate) struct Daemon {
    pub(crate) address: std::net::SocketAddr,
    pub(crate) api: Api,
    pub(crate) service: Arc<Service>,
    pub(crate) client: Client,
    store: Store,
    /// Key of the control lease, once taken.
    lease: OnceCell<String>,
}

impl Daemon {
    pub(crate) async fn start(bench: Bench) -> Self {
        let mut config = Config::default();
        // What counts as stale, and so how long a request waits for a frame: short, for the test's sake.
        config.bench.camera.timeout_ms = 300;
        Self::start_with(config, bench).await
    }

    pub(crate) async fn start_with(config: Config, bench: Bench) -> Self {
        Self::start_keeping(config, bench, Store::in_memory()).await
    }

    /// A daemon behind a gate of the test's own.
    pub(crate) async fn start_behind(config: Config, bench: Bench, gate: Gate, settings: ServerSettings) -> Self {
        Self::start_whole(config, bench, |_| gate, settings, Store::in_memory()).await
    }

    /// A daemon with a history that the test has a hand on, and its audit log in it.
    pub(crate) async fn start_keeping(config: Config, bench: Bench, store: Store) -> Self {
        let gate = |service: &Arc<Service>| {
            let audit = HistoryAudit(Arc::clone(service));
            Gate::new(GateSettings::default(), TokenStore::in_memory(), Box::new(audit))
        };
        Self::start_whole(config, bench, gate, ServerSettings::default(), store).await
    }

    async fn start_whole(
        config: Config,
        bench: Bench,
        gate: impl FnOnce(&Arc<Service>) -> Gate,
        settings: ServerSettings,
        store: Store,
    ) -> Self {
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let service = Service::start(Arc::new(config), "a test's configuration".to_owned(), bench, store.clone());
        let gate = Arc::new(gate(&service));
        let api = Api::new(Arc::clone(&service), gate, address, ConfigOrigin::Preset);
        tokio::spawn(Connections::new(settings).serve(listener, api.router(), IN_RESERVE, api.closing()));
        Self { address, api, service, client: client(), store, lease: OnceCell::new() }
    }

    /// Waits until the history has what happened so far.
    pub(crate) async fn written(&self) {
        self.store.flush().await;
    }

    /// Leaves the history as a kill would: with what happened so far, and nothing of this daemon from here on. It runs
    /// on, and one that may still write does so again whenever it finds its file anew.
    pub(crate) async fn as_killed(&self) {
        self.written().await;
        self.store.hinder(Hindrance { full: true, ..Hindrance::default() });
    }

    pub(crate) fn request(&self, method: Method, path: &str) -> RequestBuilder {
        self.client.request(method, format!("http://{}{path}", self.address))
    }

    /// The control lease's key; the lease is taken at the first call.
    pub(crate) async fn lease(&self) -> &str {
        let take = async {
            let asked = json!({ "owner": "a test", "ttl_s": 3600 });
            let grant: Value = self.post("/api/v1/lease/takeover", &asked).await.json().await.unwrap();
            grant["key"].as_str().unwrap().to_owned()
        };
        self.lease.get_or_init(|| take).await
    }

    /// A request by the holder of the control lease.
    pub(crate) async fn command(&self, method: Method, path: &str, body: &Value) -> Response {
        self.request(method, path).header(LEASE_HEADER, self.lease().await).json(body).send().await.unwrap()
    }

    /// Resets the stop.
    pub(crate) async fn reset_stop(&self) -> Response {
        self.request(Method::DELETE, "/api/v1/stop").json(&json!({ "why": "a test goes on" })).send().await.unwrap()
    }

    pub(crate) async fn get(&self, path: &str) -> Response {
        self.request(Method::GET, path).send().await.unwrap()
    }

    /// Waits until what is at a path is as wanted, and returns it.
    pub(crate) async fn until(&self, path: &str, what: &str, is: impl Fn(&Value) -> bool) -> Value {
        let look = async || -> Result<Value, Value> {
            let answer = self.get(path).await;
            assert!(answer.status().is_success(), "{answer:?}");
            when(answer.json().await.unwrap(), &is)
        };
        until(what, look).await
    }

    pub(crate) async fn post(&self, path: &str, body: &Value) -> Response {
        self.request(Method::POST, path).json(body).send().await.unwrap()
    }
}

/// Reads an answer as a problem of this kind and status.
pub(crate) async fn problem(response: Response, status: u16, kind: &str) -> Value {
    let found = response.status();
    let content_type = response.headers()["content-type"].to_str().unwrap().to_owned();
    let text = response.text().await.unwrap();
    assert_eq!(found, StatusCode::from_u16(status).unwrap(), "{text}");
    assert_eq!(content_type, "application/problem+json", "{text}");
    let problem: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(problem["type"], format!("urn:plenalign:problem:{kind}"), "{text}");
    assert_eq!(problem["status"], status);
    assert!(problem["detail"].as_str().is_some_and(|detail| !detail.is_empty()), "{text}");
    problem
}

/// A client that keeps nothing and trusts nobody.
pub(crate) fn client() -> Client {
    use_ring();
    Client::builder().no_proxy().tls_certs_only([]).build().unwrap()
}
