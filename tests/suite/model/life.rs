//! One life of the daemon on the bench: from its start to its end, orderly or not.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use futures_util::{SinkExt as _, StreamExt as _};
use plenalign::access::{Gate, GateSettings, TokenStore};
use plenalign::api::server::{Connections, ServerSettings};
use plenalign::api::{Api, IN_RESERVE};
use plenalign::config::ConfigOrigin;
use plenalign::control::Service;
use plenalign::control::service::history::HistoryAudit;
use plenalign::store::{Hindrance, Store};
use serde_json::{Value, json};
use tokio_tungstenite::connect_async;
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_util::sync::CancellationToken;

use super::super::daemon::client;
use super::super::until::elapse;
use super::requests::{Answer, Ask, Shown, Who, send};
use super::rig::Rig;

/// So much simulated time passes at a time while an answer is waited for.
const GRAIN: Duration = Duration::from_millis(1);

/// One life of the daemon.
pub(super) struct Life {
    service: Arc<Service>,
    api: Api,
    store: Store,
    cut: CancellationToken,
    client: reqwest::Client,
    base: String,
    pub(super) tokens: BTreeMap<Who, String>,
    sockets: Vec<tokio::task::JoinHandle<()>>,
}

/// Carries something out while the paused clock goes on in small grains, rather than by leaps to the next timer.
async fn in_grains<T>(act: impl Future<Output = T>) -> T {
    tokio::pin!(act);
    loop {
        tokio::select! {
            biased;
            done = &mut act => return done,
            () = elapse(GRAIN) => {}
        }
    }
}

impl Life {
    /// Starts the daemon on the bench, with its history in a folder.
    pub(super) async fn start(rig: &Rig, folder: &Path) -> Self {
        let cut = CancellationToken::new();
        let (bench, store) = (rig.open(&cut).await, Store::open(folder));
        let service = Service::start(Arc::clone(&rig.config), "a model's".to_owned(), bench, store.clone());
        service.open_history().await;
        let tokens = TokenStore::in_memory();
        let secret = |who: &Who| {
            let (secret, _) = tokens.create(&who.name(), who.scope().unwrap(), None).unwrap();
            (*who, secret.reveal().to_owned())
        };
        let mut secrets: BTreeMap<Who, String> = Who::KNOWN.iter().map(secret).collect();
        secrets.insert(Who::Guesser, "plenalign_0000000000000000000000000000000000000000000".to_owned());
        // Nobody is kept from asking often: how often one may is not what is tried here.
        let settings = GateSettings { requests_per_s: 1e6, ..GateSettings::default() };
        let gate = Arc::new(Gate::new(settings, tokens, Box::new(HistoryAudit(Arc::clone(&service)))));
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let api = Api::new(Arc::clone(&service), gate, address, ConfigOrigin::Preset);
        let settings = ServerSettings { idle_timeout: Duration::from_hours(24), ..ServerSettings::default() };
        tokio::spawn(Connections::new(settings).serve(listener, api.router(), IN_RESERVE, api.closing()));
        let base = format!("http://{address}");
        Self { service, api, store, cut, client: client(), base, tokens: secrets, sockets: Vec::new() }
    }

    /// Asks and waits for the answer.
    pub(super) async fn ask(&self, who: Who, shown: &Shown, ask: &Ask) -> Answer {
        let token = self.tokens.get(&who).map(String::as_str);
        in_grains(send(&self.client, &self.base, token, shown, ask.on_the_wire(who))).await
    }

    /// Reads something as an administrator.
    pub(super) async fn read(&self, path: &str) -> Answer {
        let token = self.tokens.get(&Who::Root).map(String::as_str);
        let what = (reqwest::Method::GET, path.to_owned(), Value::Null);
        in_grains(send(&self.client, &self.base, token, &Shown::default(), what)).await
    }

    /// The audit log, oldest first, once all that happened so far is in it.
    pub(super) async fn audit(&self) -> Option<Vec<Value>> {
        self.store.flush().await;
        let mut entries = Vec::new();
        let mut path = "/api/v1/audit?limit=500".to_owned();
        loop {
            let page = self.read(&path).await;
            if !page.accepted() {
                return None;
            }
            entries.extend(page.body["entries"].as_array()?.iter().cloned());
            match &page.body["next"] {
                Value::Null => break,
                next => path = format!("/api/v1/audit?limit=500&cursor={}", next.as_str()?),
            }
        }
        entries.reverse();
        Some(entries)
    }

    /// Holds a lease with a connection; whether it is held then.
    pub(super) async fn hold(&mut self, who: Who, key: &str) -> bool {
        let url = self.base.replace("http", "ws") + "/api/v1/ws";
        let mut request = url.into_client_request().unwrap();
        let Some(token) = self.tokens.get(&who) else { return false };
        request.headers_mut().insert("authorization", format!("Bearer {token}").parse().unwrap());
        let Ok((mut socket, _)) = in_grains(connect_async(request)).await else { return false };
        socket.send(Message::text(json!({ "type": "hold", "lease": key }).to_string())).await.unwrap();
        let heard = in_grains(async {
            while let Some(Ok(message)) = socket.next().await {
                let Message::Text(text) = message else { continue };
                let said: Value = serde_json::from_str(&text).unwrap();
                if said["type"] == "problem" {
                    return false;
                }
                if said["type"] == "bench" && said["bench"]["lease"]["expires_at"].is_null() {
                    return true;
                }
            }
            false
        });
        let held = tokio::time::timeout(Duration::from_secs(3), heard).await.unwrap_or(false);
        if held {
            self.sockets.push(tokio::spawn(async move { while let Some(Ok(_)) = socket.next().await {} }));
        }
        held
    }

    /// Every connection that holds a lease is gone; how many there were.
    pub(super) async fn hang_up(&mut self) -> usize {
        let gone = self.sockets.len();
        for socket in self.sockets.drain(..) {
            socket.abort();
            let _ = socket.await;
        }
        gone
    }

    /// Lets the disk of the history be full, or not.
    pub(super) fn fill_disk(&self, full: bool) {
        self.store.hinder(Hindrance { full, ..Hindrance::default() });
    }

    /// Waits until the history can be written, and the service knows.
    pub(super) async fn writable(&self) {
        let health = self.store.health();
        self.service.open_history().await;
        // Told by the disk's own thread, for which the simulated clock is held.
        let told = move || {
            while health.borrow().fault().is_some() {
                std::thread::yield_now();
            }
        };
        tokio::task::spawn_blocking(told).await.unwrap();
        // What was kept back meanwhile is written now.
        for _ in 0..15 {
            elapse(Duration::from_millis(100)).await;
            self.store.flush().await;
        }
    }

    /// The orderly end.
    pub(super) async fn end(mut self) {
        self.hang_up().await;
        in_grains(self.service.shut_down()).await;
        self.cut.cancel();
        self.api.close().await;
    }

    /// The end without a word: from now on nothing of it reaches the controller, the history or a client. What had been
    /// answered before is on the disk where it could be written: a disk takes milliseconds, and a record in flight is
    /// tried elsewhere.
    pub(super) async fn kill(self, written: bool) {
        if written {
            self.store.flush().await;
        }
        self.fill_disk(true);
        self.cut.cancel();
        for socket in &self.sockets {
            socket.abort();
        }
        // What is left of it is only tidied up: nobody hears it any more.
        self.service.end().await;
        self.api.close().await;
    }
}
