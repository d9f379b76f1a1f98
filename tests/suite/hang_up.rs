//! Clients that hang up: what they asked for is carried to its end, audited once, and keeps their place until then.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use plenalign::access::{AuditRecord, AuditSink, Gate, GateSettings, Scope, TokenStore};
use plenalign::alpaca::{self, Alpaca, UniqueIds};
use plenalign::api::error::LEASE_HEADER;
use plenalign::api::server::{Connections, ServerSettings};
use plenalign::api::{Api, IN_RESERVE};
use plenalign::config::Config;
use plenalign::control::Service;
use plenalign::store::Store;
use reqwest::{Client, Method, RequestBuilder};
use serde_json::{Value, json};
use tempfile::TempDir;
use tokio::io::AsyncWriteExt as _;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinHandle;
use tokio::time::timeout;

use super::daemon::client;
use super::fakes::{Fakes, fakes};
use super::limits::{STOP, exchange};
use super::until::until;

const HEALTH: &str = "GET /healthz HTTP/1.1\r\nhost: 127.0.0.1\r\nconnection: close\r\n\r\n";

/// What was done, in its order.
#[derive(Clone, Default)]
struct Written(Arc<Mutex<Vec<&'static str>>>);

impl AuditSink for Written {
    fn record(&self, record: AuditRecord) {
        self.0.lock().unwrap().push(record.what);
    }
}

impl Written {
    fn all(&self) -> Vec<&'static str> {
        self.0.lock().unwrap().clone()
    }
}

/// A daemon with a configuration file, tokens, and Alpaca beside it.
struct Daemon {
    address: SocketAddr,
    alpaca: SocketAddr,
    api: Api,
    gate: Arc<Gate>,
    client: Client,
    /// An administrator's token.
    token: String,
    audit: Written,
    file: PathBuf,
    _folder: TempDir,
    fakes: Fakes,
    serving: JoinHandle<()>,
}

impl Daemon {
    async fn start(connections: usize) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("bench.toml");
        std::fs::write(&file, "[assembly]\ninitial_e_mm = 30.0\n").unwrap();
        let (config, origin) = Config::open(Some(&file), &[]).unwrap();
        let (fakes, audit, tokens) = (fakes(), Written::default(), TokenStore::in_memory());
        let (secret, _) = tokens.create("Root", Scope::Admin, None).unwrap();
        let settings = GateSettings { requests_per_s: 1e5, ..GateSettings::default() };
        let gate = Arc::new(Gate::new(settings, tokens, Box::new(audit.clone())));
        let bench = fakes.bench.clone();
        let service = Service::start(Arc::new(config), "a test's".to_owned(), bench, Store::in_memory());
        let (listener, beside) =
            (TcpListener::bind("127.0.0.1:0").await.unwrap(), TcpListener::bind("127.0.0.1:0").await.unwrap());
        let (address, alpaca) = (listener.local_addr().unwrap(), beside.local_addr().unwrap());
        let facade = Alpaca::new(Arc::clone(&service), Arc::clone(&gate), alpaca, UniqueIds::new());
        let api = Api::new(service, Arc::clone(&gate), address, origin);
        let settings =
            ServerSettings { connections, connections_per_address: connections, ..ServerSettings::default() };
        let places = Connections::new(settings);
        tokio::spawn(places.clone().serve(beside, facade.router(), alpaca::IN_RESERVE, api.closing()));
        let serving = tokio::spawn(places.serve(listener, api.router(), IN_RESERVE, api.closing()));
        let token = secret.reveal().to_owned();
        Self { address, alpaca, api, gate, client: client(), token, audit, file, _folder: folder, fakes, serving }
    }

    fn request(&self, method: Method, path: &str) -> RequestBuilder {
        self.client.request(method, format!("http://{}{path}", self.address)).bearer_auth(&self.token)
    }

    fn text(&self, first: &str, headers: &str, body: &str) -> String {
        let (token, length) = (&self.token, body.len());
        format!(
            "{first} HTTP/1.1\r\nhost: 127.0.0.1\r\nauthorization: Bearer {token}\r\n{headers}\
             content-length: {length}\r\n\r\n{body}"
        )
    }

    /// A JSON request as it goes over the wire.
    fn json(&self, first: &str, headers: &str, body: &Value) -> String {
        self.text(first, &format!("content-type: application/json\r\n{headers}"), &body.to_string())
    }

    /// Returns once the server has dealt with all that has reached its sockets: on one thread it goes on with that
    /// before it has answered as often as this.
    async fn settle(&self) {
        for _ in 0..3 {
            assert!(exchange(self.address, HEALTH).await.starts_with("HTTP/1.1 "));
        }
    }

    /// Sends a request, and resets its connection once the request is in work.
    async fn hang_up(&self, address: SocketAddr, request: &str) {
        let mut stream = TcpStream::connect(address).await.unwrap();
        stream.write_all(request.as_bytes()).await.unwrap();
        self.settle().await;
        stream.set_zero_linger().unwrap();
        drop(stream);
        self.settle().await;
    }

    /// Has a request that waits for the disk hung up on before the disk answers.
    async fn hang_up_before_the_disk(&self, request: &str) {
        let disk = SlowDisk::new();
        self.hang_up(self.address, request).await;
        drop(disk);
    }

    /// Waits until this, and nothing else, has been done.
    async fn done(&self, expected: &[&str]) {
        until(&format!("{expected:?} was done"), async || self.audit.all().len() >= expected.len()).await;
        assert_eq!(self.audit.all(), expected);
    }
}

/// Nothing that waits for a disk goes on until this is dropped: it has the one thread there is for that.
struct SlowDisk(#[expect(dead_code, reason = "dropped, it lets the thread go")] Sender<()>);

impl SlowDisk {
    fn new() -> Self {
        let (held, released) = channel();
        tokio::task::spawn_blocking(move || released.recv());
        Self(held)
    }
}

/// Runs a test on one thread, with one more for what blocks.
fn on_one_thread(test: impl Future<Output = ()>) {
    let mut runtime = tokio::runtime::Builder::new_current_thread();
    runtime.enable_all().max_blocking_threads(1).build().unwrap().block_on(test);
}

#[test]
fn what_waits_for_the_disk_is_audited_though_the_client_hung_up() {
    on_one_thread(async {
        let daemon = Daemon::start(16).await;
        let mut expected = vec![];

        let bob = json!({ "name": "Bob", "scope": "view" });
        daemon.hang_up_before_the_disk(&daemon.json("POST /api/v1/tokens", "", &bob)).await;
        let names = || daemon.gate.tokens().list().into_iter().map(|token| token.name).collect::<Vec<_>>();
        until("Bob has a token", async || names() == ["Root", "Bob"]).await;
        expected.push("token.create");
        daemon.done(&expected).await;

        let id = daemon.gate.tokens().list()[1].id;
        daemon.hang_up_before_the_disk(&daemon.text(&format!("DELETE /api/v1/tokens/{id}"), "", "")).await;
        until("Bob has none", async || names() == ["Root"]).await;
        expected.push("token.revoke");
        daemon.done(&expected).await;

        let key = json!({ "key": daemon.token });
        daemon.hang_up_before_the_disk(&daemon.json("POST /api/v1/session", "", &key)).await;
        expected.push("session.open");
        daemon.done(&expected).await;

        let signed_in = daemon.request(Method::POST, "/api/v1/session").json(&key).send().await.unwrap();
        let cookie = signed_in.headers()["set-cookie"].to_str().unwrap().split(';').next().unwrap().to_owned();
        expected.push("session.open");
        let session = async || {
            let asked = daemon.client.get(format!("http://{}/api/v1/session", daemon.address));
            asked.header("cookie", &cookie).send().await.unwrap().status()
        };
        assert_eq!(session().await, 200);
        let sign_out = format!(
            "DELETE /api/v1/session HTTP/1.1\r\nhost: 127.0.0.1\r\ncookie: {cookie}\r\ncontent-length: 0\r\n\r\n"
        );
        daemon.hang_up_before_the_disk(&sign_out).await;
        until("the session is over", async || session().await == 401).await;
        expected.push("session.close");
        daemon.done(&expected).await;

        let found = daemon.request(Method::GET, "/api/v1/config").send().await.unwrap();
        let tag = found.headers()["etag"].to_str().unwrap().to_owned();
        let changed = json!({ "config": { "assembly": { "initial_e_mm": 29.0 } } });
        let put = daemon.json("PUT /api/v1/config", &format!("if-match: {tag}\r\n"), &changed);
        daemon.hang_up_before_the_disk(&put).await;
        until("the file is written", async || std::fs::read_to_string(&daemon.file).unwrap().contains("29")).await;
        expected.push("config.write");
        daemon.done(&expected).await;
    });
}

/// Takes the lease and begins a move that does not end by itself, by REST.
async fn moving(daemon: &Daemon) -> String {
    let asked = json!({ "owner": "Ada", "ttl_s": 3600 });
    let lease = daemon.request(Method::POST, "/api/v1/lease").json(&asked).send().await.unwrap();
    let key = lease.json::<Value>().await.unwrap()["key"].as_str().unwrap().to_owned();
    daemon.fakes.e.held.send_replace(true);
    let go = daemon.request(Method::POST, "/api/v1/axes/e/move").header(LEASE_HEADER, &key);
    let begun = go.json(&json!({ "position_mm": 29.0 })).send().await.unwrap();
    assert_eq!(begun.status(), 202, "{}", begun.text().await.unwrap());
    until("the axis is told to go", async || !daemon.fakes.e.told.lock().unwrap().is_empty()).await;
    key
}

#[test]
fn what_stops_an_axis_is_audited_though_the_client_hung_up() {
    on_one_thread(async {
        for (what, path) in [("lease.release", "DELETE /api/v1/lease"), ("stop", "POST /api/v1/stop")] {
            let daemon = Daemon::start(16).await;
            let key = moving(&daemon).await;
            let request = daemon.text(path, &format!("{LEASE_HEADER}: {key}\r\n"), "");
            daemon.hang_up(daemon.address, &request).await;
            daemon.fakes.e.held.send_replace(false);
            daemon.done(&["lease.take", "axis.move", what]).await;
        }
        let daemon = Daemon::start(16).await;
        moving(&daemon).await;
        let halt = "PUT /api/v1/focuser/1/halt HTTP/1.1\r\nhost: 127.0.0.1\r\n\
                    content-type: application/x-www-form-urlencoded\r\ncontent-length: 11\r\n\r\nClientID=77";
        daemon.hang_up(daemon.alpaca, halt).await;
        daemon.fakes.e.held.send_replace(false);
        daemon.done(&["lease.take", "axis.move", "axis.halt"]).await;
    });
}

#[test]
fn who_hangs_up_keeps_the_place_until_the_work_is_done_and_a_stop_gets_through() {
    on_one_thread(async {
        let daemon = Daemon::start(1).await;
        let bob = json!({ "name": "Bob", "scope": "view" });
        let disk = SlowDisk::new();
        daemon.hang_up(daemon.address, &daemon.json("POST /api/v1/tokens", "", &bob)).await;
        let crowded = exchange(daemon.address, HEALTH).await;
        assert!(crowded.starts_with("HTTP/1.1 503 "), "{crowded}");
        let stop = STOP.replace("content-length", &format!("authorization: Bearer {}\r\ncontent-length", daemon.token));
        let stopped = exchange(daemon.address, &stop).await;
        assert!(stopped.starts_with("HTTP/1.1 200 "), "{stopped}");
        drop(disk);
        daemon.done(&["stop", "token.create"]).await;
        until("the place is free", async || exchange(daemon.address, HEALTH).await.starts_with("HTTP/1.1 200 ")).await;
    });
}

#[test]
fn a_request_whose_body_does_not_come_ends_with_its_client() {
    on_one_thread(async {
        let daemon = Daemon::start(1).await;
        let whole = daemon.json("POST /api/v1/tokens", "", &json!({ "name": "Bob", "scope": "view" }));
        daemon.hang_up(daemon.address, &whole[..whole.len() - 1]).await;
        // Long before the time that a body may take is over.
        let free = async || exchange(daemon.address, HEALTH).await.starts_with("HTTP/1.1 200 ");
        timeout(Duration::from_secs(5), until("the place is free", free)).await.unwrap();
        assert!(daemon.audit.all().is_empty());
    });
}

#[test]
fn the_servers_end_does_not_wait_for_what_does_not_end() {
    on_one_thread(async {
        let daemon = Daemon::start(16).await;
        let disk = SlowDisk::new();
        let bob = json!({ "name": "Bob", "scope": "view" });
        daemon.hang_up(daemon.address, &daemon.json("POST /api/v1/tokens", "", &bob)).await;
        daemon.api.close().await;
        timeout(Duration::from_secs(10), daemon.serving).await.unwrap().unwrap();
        drop(disk);
    });
}
