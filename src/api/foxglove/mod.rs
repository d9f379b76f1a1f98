//! A live bridge for Foxglove and Lichtblick: their WebSocket protocol on a port of its own on loopback, off by default.
//!
//! Whoever connects sees the picture, poses, spacing, decisions and the log of jobs, and commands nothing. Nobody is
//! asked who they are, which is why the bridge never leaves loopback; a page of another origin is refused. Its connections
//! take their places, and its requests their turns, among those of the daemon's other listeners.

mod session;

use std::net::SocketAddr;
use std::sync::Arc;

use axum::extract::State;
use axum::extract::ws::WebSocketUpgrade;
use axum::extract::ws::rejection::WebSocketUpgradeRejection;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::any;
use axum::{Extension, Router};
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::access::client::Peer;
use super::access::origin::{is_own_host, is_same_origin};
use super::error::Problem;
use super::pictures::picture::Pictures;
use super::server::{Connections, InReserve};
use crate::access::Gate;
use crate::config::FoxgloveConfig;
use crate::control::Service;
use crate::record::Topic;

/// The subprotocols spoken: the newer name and the older for the same messages.
const PROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Viewers at once.
const MOST_VIEWERS: usize = 8;
/// Longest message of a viewer, bytes.
const MESSAGE_LIMIT: usize = 64 << 10;

/// Nothing stops the bench here.
const IN_RESERVE: InReserve = InReserve {
    is_served: |_, _| false,
    words: "close others, or try again later; the daemon's own port takes a stop",
};

/// The topics that the bridge offers, in the order of their channels.
pub const TOPICS: [Topic; 8] = [
    Topic::PICTURE,
    Topic::ANNOTATIONS,
    Topic::TRANSFORM,
    Topic::POSE,
    Topic::MEASUREMENT,
    Topic::DECISION,
    Topic::LOG,
    Topic::READING,
];

/// What every session gets.
#[derive(Clone)]
struct Shared {
    service: Arc<Service>,
    gate: Arc<Gate>,
    pictures: Arc<Pictures>,
    config: Arc<FoxgloveConfig>,
    viewers: Arc<Semaphore>,
    tasks: TaskTracker,
    end: CancellationToken,
}

/// A bridge that listens.
pub struct Bridge {
    address: SocketAddr,
    tasks: TaskTracker,
    end: CancellationToken,
}

impl Bridge {
    /// Starts the configured bridge; `None` where none is configured. `gate` says how often one may ask, `pictures` are
    /// those of other viewers, `connections` serves the bridge's beside those of other listeners. Must be called within a
    /// tokio runtime.
    ///
    /// # Errors
    /// Why it cannot listen, in words.
    pub(super) async fn start(
        service: Arc<Service>,
        gate: Arc<Gate>,
        pictures: Arc<Pictures>,
        connections: &Connections,
    ) -> Result<Option<Self>, String> {
        let config = service.config().foxglove.clone();
        let Some(address) = config.address()? else { return Ok(None) };
        let failed = |error: std::io::Error| format!("foxglove.listen = {address}: {error}");
        let listener = TcpListener::bind(address).await.map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        let (tasks, end) = (TaskTracker::new(), CancellationToken::new());
        let shared = Shared {
            service,
            gate,
            pictures,
            config: Arc::new(config),
            viewers: Arc::new(Semaphore::new(MOST_VIEWERS)),
            tasks: tasks.clone(),
            end: end.clone(),
        };
        let router = Router::new().fallback(any(open)).with_state(shared);
        tasks.spawn(connections.without_tls().serve(listener, router, IN_RESERVE, end.clone()));
        Ok(Some(Self { address, tasks, end }))
    }

    /// Where it listens.
    #[must_use]
    pub const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Sends every viewer away and returns when they are gone. The caller bounds the wait.
    pub async fn close(&self) {
        self.end.cancel();
        self.tasks.close();
        self.tasks.wait().await;
    }
}

/// Why a connection is refused, in words.
fn refusal(headers: &HeaderMap, config: &FoxgloveConfig) -> Option<(StatusCode, String)> {
    let text = |name| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
    let host = text(header::HOST);
    if !host.is_some_and(|host| is_own_host(host, &[], true)) {
        let host = host.unwrap_or_default();
        return Some((StatusCode::MISDIRECTED_REQUEST, format!("this is not {host:?}; use 127.0.0.1 or localhost")));
    }
    // Programs send none; browsers always do.
    let origin = text(header::ORIGIN)?;
    let named = config.origins.iter().any(|own| own.eq_ignore_ascii_case(origin));
    if named || is_same_origin(origin, host, false) {
        return None;
    }
    Some((StatusCode::FORBIDDEN, format!("pages of {origin:?} may not look on; foxglove.origins names those that may")))
}

async fn open(
    State(shared): State<Shared>,
    Extension(Peer { address: from, .. }): Extension<Peer>,
    headers: HeaderMap,
    upgrade: Result<WebSocketUpgrade, WebSocketUpgradeRejection>,
) -> Response {
    if let Err(too_many) = shared.gate.count(from.ip(), None) {
        return Problem::too_many(too_many).into_response();
    }
    if let Some(refused) = refusal(&headers, &shared.config) {
        tracing::warn!(%from, why = %refused.1, "a viewer of the bridge for Foxglove was refused");
        return refused.into_response();
    }
    let upgrade = match upgrade {
        Ok(upgrade) => upgrade.protocols(PROTOCOLS),
        Err(rejection) => {
            let what = "connect here with Foxglove or Lichtblick, as \"Foxglove WebSocket\"";
            return (StatusCode::UPGRADE_REQUIRED, format!("{what}: {}", rejection.body_text())).into_response();
        }
    };
    if upgrade.selected_protocol().is_none() {
        let spoken = PROTOCOLS.join(" and ");
        return (StatusCode::BAD_REQUEST, format!("the subprotocols spoken are {spoken}")).into_response();
    }
    let Ok(place) = Arc::clone(&shared.viewers).try_acquire_owned() else {
        return (StatusCode::SERVICE_UNAVAILABLE, format!("{MOST_VIEWERS} viewers look on already")).into_response();
    };
    upgrade.max_message_size(MESSAGE_LIMIT).max_frame_size(MESSAGE_LIMIT).on_upgrade(move |socket| {
        let (tasks, end) = (shared.tasks.clone(), shared.end.clone());
        tasks.track_future(async move {
            let _place = place;
            end.run_until_cancelled_owned(session::run(shared, socket)).await;
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_foreign_page_is_refused_and_a_program_is_not() {
        let config = FoxgloveConfig { origins: vec!["https://app.foxglove.dev".to_owned()], ..Default::default() };
        let status = |host: &str, origin: Option<&str>| {
            let mut headers = HeaderMap::new();
            headers.insert(header::HOST, host.parse().unwrap());
            if let Some(origin) = origin {
                headers.insert(header::ORIGIN, origin.parse().unwrap());
            }
            refusal(&headers, &config).map(|(status, _)| status.as_u16())
        };
        assert_eq!(status("127.0.0.1:8765", None), None);
        assert_eq!(status("localhost:8765", Some("https://app.foxglove.dev")), None);
        assert_eq!(status("localhost:8765", Some("http://localhost:8765")), None);
        assert_eq!(status("localhost:8765", Some("https://evil.example")), Some(403));
        assert_eq!(status("localhost:8765", Some("null")), Some(403));
        assert_eq!(status("evil.example:8765", None), Some(421));
    }
}
