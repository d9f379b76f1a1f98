//! The server: connections accepted, counted, encrypted where that is wanted, and ended in bounded time.
//!
//! Every connection is bounded in what it may take: a slow head, a slow reader and an idle connection are cut off, and
//! so many are served at once, overall and for each address, whichever listeners they come by. Beyond that one is still
//! accepted, to be served nothing but the stop: see `slots`.

mod carried;
mod connection;
mod plain;
mod slots;
mod stall;
mod tls;

use std::io;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::http::Method;
use tokio::net::{TcpListener, TcpStream};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use connection::Connection;
pub use slots::RESERVE;
use slots::Slots;
pub use tls::{TlsError, read_certificate, use_ring};

/// Rest after the system gave no connection though one is there: out of file descriptors, as a rule.
const AFTER_FAILURE: Duration = Duration::from_millis(100);
/// From the end of the service to that of the last connection, and of the last request that changes something.
const GRACE: Duration = Duration::from_secs(1);

/// What is still served where there is room for nothing else.
#[derive(Debug, Clone, Copy)]
pub struct InReserve {
    /// Whether a request, by its method and path, is that.
    pub is_served: fn(&Method, &str) -> bool,
    /// Says it to whom anything else is refused.
    pub words: &'static str,
}

/// What a server is told.
#[derive(Debug, Clone)]
pub struct ServerSettings {
    /// Connections served at once, at all listeners.
    pub connections: usize,
    /// Of these, at most so many from one address.
    pub connections_per_address: usize,
    /// A connection on which no request's head has come for so long is closed.
    pub idle_timeout: Duration,
    /// Certificate and key, where TLS is spoken.
    pub tls: Option<Arc<rustls::ServerConfig>>,
}

impl Default for ServerSettings {
    fn default() -> Self {
        Self { connections: 256, connections_per_address: 64, idle_timeout: Duration::from_secs(30), tls: None }
    }
}

/// Serves the connections of every listener there is: they share the places, and what a connection may take.
#[derive(Clone)]
pub struct Connections {
    settings: Arc<ServerSettings>,
    slots: Arc<Slots>,
}

impl Connections {
    /// No connections yet.
    #[must_use]
    pub fn new(settings: ServerSettings) -> Self {
        let slots = Arc::new(Slots::new(settings.connections, settings.connections_per_address));
        Self { settings: Arc::new(settings), slots }
    }

    /// The same places, at a listener where no TLS is spoken.
    #[must_use]
    pub fn without_tls(&self) -> Self {
        let settings = ServerSettings { tls: None, ..(*self.settings).clone() };
        Self { settings: Arc::new(settings), slots: Arc::clone(&self.slots) }
    }

    /// Serves a listener until `closing`, and then until its connections have ended or their time is up.
    pub async fn serve(self, listener: TcpListener, router: Router, in_reserve: InReserve, closing: CancellationToken) {
        let (tasks, gone) = (TaskTracker::new(), CancellationToken::new());
        loop {
            let accepted = tokio::select! {
                accepted = async { self.slots.few_leaving().await; listener.accept().await } => accepted,
                () = closing.cancelled() => break,
            };
            match accepted {
                Ok((stream, address)) => {
                    // Answers are small and wanted at once.
                    if let Err(error) = TcpStream::set_nodelay(&stream, true) {
                        tracing::debug!(%error, "a connection without TCP_NODELAY");
                    }
                    let connection = Connection {
                        stream,
                        address,
                        router: router.clone(),
                        settings: Arc::clone(&self.settings),
                        in_reserve,
                        closing: closing.clone(),
                        tasks: tasks.clone(),
                    };
                    let (place, gone) = (self.slots.take(address.ip()), gone.clone());
                    tasks.spawn(async move { gone.run_until_cancelled(connection.serve(place)).await });
                }
                Err(error) if is_the_clients(&error) => {}
                Err(error) => {
                    tracing::error!(%error, "no connection can be accepted");
                    tokio::time::sleep(AFTER_FAILURE).await;
                }
            }
        }
        drop(listener);
        tasks.close();
        if tokio::time::timeout(GRACE, tasks.wait()).await.is_err() {
            tracing::warn!(open = tasks.len(), "connections and requests were still open when the time was up");
            gone.cancel();
        }
    }
}

/// Whether a connection broke before it could be accepted.
fn is_the_clients(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(error.kind(), ConnectionAborted | ConnectionRefused | ConnectionReset)
}
