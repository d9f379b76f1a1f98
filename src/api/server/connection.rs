//! One connection, from its first byte to its end.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::carried::Carrier;
use super::slots::{Place, Reservation, Slot};
use super::stall::Stall;
use super::{InReserve, ServerSettings, plain};
use crate::api::access::client::Peer;
use crate::api::error::Problem;

/// How long the first byte and the TLS handshake may take, each.
const HANDSHAKE: Duration = Duration::from_secs(10);
/// How long a connection in the reserve may last.
const RESERVED: Duration = Duration::from_secs(10);
/// Headers of a request, and bytes of its head: beyond them it is refused with a problem.
const MOST_HEADERS: usize = 64;
const LARGEST_HEAD: usize = 16 * 1024;
/// The same as hyper has them: beyond these it refuses a request by itself, with a status and nothing else.
const MOST_HEADERS_READ: usize = 256;
const LARGEST_HEAD_READ: usize = 64 * 1024;
/// What every TLS connection begins with: a handshake record.
const TLS_RECORD: u8 = 0x16;

/// A connection just accepted.
pub(super) struct Connection {
    pub(super) stream: TcpStream,
    pub(super) address: SocketAddr,
    pub(super) router: Router,
    pub(super) settings: Arc<ServerSettings>,
    pub(super) in_reserve: InReserve,
    pub(super) closing: CancellationToken,
    /// Of the connections of this listener, and of what they carry out.
    pub(super) tasks: TaskTracker,
}

/// What a connection may ask for.
#[derive(Clone)]
enum Allowed {
    Everything,
    Reserved(Reservation, InReserve),
}

impl Connection {
    /// Serves it to its end.
    pub(super) async fn serve(self, place: Place) {
        match place {
            Place::Ordinary(slot) => self.open(Allowed::Everything, slot).await,
            Place::Reserve(slot, reservation) => {
                let evicted = reservation.evicted().clone();
                let allowed = Allowed::Reserved(reservation, self.in_reserve);
                let served = self.open(allowed, slot);
                let _ = timeout(RESERVED, evicted.run_until_cancelled(served)).await;
            }
        }
    }

    async fn open(self, allowed: Allowed, slot: Slot) {
        let Self { stream, address, router, settings, closing, tasks, .. } = self;
        let slot = Arc::new(slot);
        let place = |stream: Box<dyn Stream>| Stall::new(stream, Some(Arc::clone(&slot)));
        let carrier = Carrier { router, slot: Arc::clone(&slot), tasks };
        let Some(tls) = settings.tls.clone() else {
            let peer = Peer { address, tls: false };
            return speak(place(Box::new(stream)), peer, carrier, &settings, closing, allowed).await;
        };
        let mut first = [0];
        match timeout(HANDSHAKE, stream.peek(&mut first)).await {
            Ok(Ok(1)) if first[0] == TLS_RECORD => {}
            Ok(Ok(1)) => return plain::answer(place(Box::new(stream))).await,
            // Nothing came, or the connection is gone.
            _ => return,
        }
        match timeout(HANDSHAKE, tokio_rustls::TlsAcceptor::from(tls).accept(stream)).await {
            Ok(Ok(stream)) => {
                if let Allowed::Reserved(reservation, _) = &allowed {
                    reservation.shook_hands();
                }
                let peer = Peer { address, tls: true };
                speak(place(Box::new(stream)), peer, carrier, &settings, closing, allowed).await;
            }
            Ok(Err(error)) => tracing::debug!(%address, %error, "the TLS handshake failed"),
            Err(_) => tracing::debug!(%address, "the TLS handshake took too long"),
        }
    }
}

/// What HTTP is spoken over.
pub(super) trait Stream: AsyncRead + AsyncWrite + Unpin + Send {}
impl<S: AsyncRead + AsyncWrite + Unpin + Send> Stream for S {}

/// Speaks HTTP until the connection ends.
async fn speak(
    stream: Stall<Box<dyn Stream>>,
    peer: Peer,
    carrier: Carrier,
    settings: &ServerSettings,
    closing: CancellationToken,
    allowed: Allowed,
) {
    let service = service_fn(move |request: hyper::Request<Incoming>| {
        let (carrier, allowed) = (carrier.clone(), allowed.clone());
        async move {
            if is_too_large(&request) {
                return Ok::<_, Infallible>(closed(
                    Problem::head_too_large(MOST_HEADERS, LARGEST_HEAD).into_response(),
                ));
            }
            let mut request = request.map(Body::new);
            request.extensions_mut().insert(peer);
            Ok(match allowed {
                Allowed::Everything => carrier.answer(request).await,
                Allowed::Reserved(reservation, rule) if (rule.is_served)(request.method(), request.uri().path()) => {
                    reservation.stops();
                    closed(carrier.answer(request).await)
                }
                Allowed::Reserved(_, rule) => closed(Problem::crowded(rule.words).into_response()),
            })
        }
    });
    let connection = http().header_read_timeout(settings.idle_timeout).serve_connection(TokioIo::new(stream), service);
    let mut connection = pin!(connection.with_upgrades());
    let ended = tokio::select! {
        ended = connection.as_mut() => ended,
        () = closing.cancelled() => {
            connection.as_mut().graceful_shutdown();
            connection.await
        }
    };
    if let Err(error) = ended {
        tracing::debug!(address = %peer.address, %error, "a connection ended");
    }
}

/// HTTP with bounds on a request's head.
pub(super) fn http() -> http1::Builder {
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).max_headers(MOST_HEADERS_READ).max_buf_size(LARGEST_HEAD_READ);
    http
}

/// Whether a request's head is larger than any client's has to be.
fn is_too_large<B>(request: &hyper::Request<B>) -> bool {
    // What HTTP/1.1 writes about them: a line's end, and between name and value a colon and a space.
    let line = |(name, value): (&HeaderName, &HeaderValue)| name.as_str().len() + value.len() + 4;
    let headers = request.headers();
    let target = request.uri().path_and_query().map_or(0, |target| target.as_str().len());
    let first = request.method().as_str().len() + target;
    headers.len() > MOST_HEADERS || first + headers.iter().map(line).sum::<usize>() > LARGEST_HEAD
}

/// An answer after which the connection is closed.
pub(super) fn closed(mut response: Response) -> Response {
    response.headers_mut().insert(header::CONNECTION, HeaderValue::from_static("close"));
    response
}
