//! The HTTP side: from a request to the member that answers it.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use axum::Router;
use axum::body::to_bytes;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, StatusCode, header};
use axum::response::{IntoResponse, Response};
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::set_header::SetResponseHeaderLayer;
use tower_http::trace::TraceLayer;

use super::answer::{Answer, Transaction, done, fault, refused};
use super::camera::Viewers;
use super::common::Device;
use super::exposure::Shutter;
use super::fault::Refused;
use super::ids::UniqueIds;
use super::image::{IMAGE_BYTES, Picture, Window, respond};
use super::request::{Call, Caller, Params, Verb};
use super::seat::Seat;
use crate::access::Gate;
use crate::api::error::Problem;
use crate::api::server::InReserve;
use crate::api::{Client, Peer};
use crate::control::Service;

/// Longest form of a request, bytes, and how long it may take to come.
const LONGEST_FORM: usize = 16 * 1024;
const FORM_ALLOWED: Duration = Duration::from_secs(10);
/// What there is at the addresses of the set-up pages.
const SET_UP: &str = "Plenalign is set up by its configuration file, and has a page of its own at the address where its \
                      REST API is served.\n";

/// The facade over a service, ready to be served.
#[derive(Clone)]
pub struct Alpaca {
    facade: Arc<Facade>,
}

/// What the members of the devices work with.
pub(super) struct Facade {
    pub(super) service: Arc<Service>,
    pub(super) gate: Arc<Gate>,
    pub(super) ids: UniqueIds,
    pub(super) seat: Seat,
    pub(super) viewers: Viewers,
    pub(super) shutter: Shutter,
    /// The part of the sensor that the next image is to be of.
    pub(super) window: Mutex<Window>,
    /// One image is written at a time: each takes many times its frame's memory.
    writing: tokio::sync::Mutex<()>,
    transactions: AtomicU32,
    loopback_only: bool,
}

impl Alpaca {
    /// The facade over `service`. `gate` has the audit log, the names by which the daemon may be addressed, and how often
    /// one may ask; `address` is where it will listen.
    #[must_use]
    pub fn new(service: Arc<Service>, gate: Arc<Gate>, address: SocketAddr, ids: UniqueIds) -> Self {
        let config = service.config();
        let ttl = Duration::from_secs_f64(config.alpaca.lease_ttl_s);
        let window = Window::whole(config.sensor.width_px, config.sensor.height_px);
        let facade = Facade {
            seat: Seat::new(Arc::clone(&service), ttl),
            service,
            gate,
            ids,
            viewers: Viewers::default(),
            shutter: Shutter::default(),
            window: Mutex::new(window),
            writing: tokio::sync::Mutex::new(()),
            transactions: AtomicU32::new(0),
            loopback_only: address.ip().is_loopback(),
        };
        Self { facade: Arc::new(facade) }
    }

    /// The router, for a server or a test.
    pub fn router(&self) -> Router {
        let header = |name, value| SetResponseHeaderLayer::if_not_present(name, HeaderValue::from_static(value));
        Router::new()
            .fallback(answer)
            .layer(CatchPanicLayer::custom(|_| {
                refused(StatusCode::INTERNAL_SERVER_ERROR, "this request failed inside the daemon; its log says why")
            }))
            .layer(header(header::X_CONTENT_TYPE_OPTIONS, "nosniff"))
            .layer(header(HeaderName::from_static("cross-origin-resource-policy"), "same-origin"))
            .layer(header(header::CACHE_CONTROL, "no-store"))
            .layer(TraceLayer::new_for_http().make_span_with(|request: &Request| {
                tracing::debug_span!("alpaca", method = %request.method(), path = request.uri().path())
            }))
            .with_state(Arc::clone(&self.facade))
    }
}

/// A request that gets no answer of a device.
enum Away {
    Refused(Refused),
    Status(StatusCode, String),
    /// Asked for by another method than there is.
    Method(&'static str),
}

impl From<Refused> for Away {
    fn from(refused: Refused) -> Self {
        Self::Refused(refused)
    }
}

impl From<Problem> for Away {
    fn from(problem: Problem) -> Self {
        let status = StatusCode::from_u16(problem.status).unwrap_or(StatusCode::BAD_REQUEST);
        Self::Status(status, problem.detail)
    }
}

async fn answer(State(facade): State<Arc<Facade>>, request: Request) -> Response {
    let server = facade.transactions.fetch_add(1, Ordering::Relaxed).wrapping_add(1);
    let mut transaction = Transaction { client: 0, server };
    match facade.respond(request, &mut transaction).await {
        Ok(response) => response,
        Err(Away::Refused(Refused::Fault(found))) => fault(transaction, &found),
        Err(Away::Refused(Refused::Malformed(words))) => refused(StatusCode::BAD_REQUEST, &words),
        Err(Away::Status(status, words)) => refused(status, &words),
        Err(Away::Method(allowed)) => {
            let words = format!("this is asked for by {allowed}");
            let response = refused(StatusCode::METHOD_NOT_ALLOWED, &words);
            ([(header::ALLOW, HeaderValue::from_static(allowed))], response).into_response()
        }
    }
}

impl Facade {
    async fn respond(&self, request: Request, transaction: &mut Transaction) -> Result<Response, Away> {
        let asked = self.service.stops();
        let client = self.admit(&request)?;
        let path = request.uri().path().trim_start_matches('/').to_owned();
        let path: Vec<&str> = path.split('/').collect();
        match path.as_slice() {
            ["management", rest @ ..] => {
                if request.method() != Method::GET {
                    return Err(Away::Method("GET"));
                }
                let value = self.management(rest).ok_or_else(|| nothing_at(&request))?;
                let params = Params::of_query(request.uri().query().unwrap_or_default());
                params.id("ClientID")?;
                transaction.client = params.id("ClientTransactionID")?;
                Ok(done(*transaction, Some(value)))
            }
            ["setup", ..] => Ok(refused(StatusCode::OK, SET_UP)),
            ["api", "v1", kind, number, member] => {
                let device = Device::find(kind, number)?;
                let (member, verbs) = device.member(member)?;
                let verb = match *request.method() {
                    Method::GET => Verb::Get,
                    Method::PUT => Verb::Put,
                    _ => return Err(Away::Method(verbs.names())),
                };
                if !verbs.allow(verb) {
                    return Err(Away::Method(verbs.names()));
                }
                let as_bytes = accepts_bytes(request.headers());
                let params = match verb {
                    Verb::Get => Params::of_query(request.uri().query().unwrap_or_default()),
                    Verb::Put => form(request).await?,
                };
                let caller = Caller { id: params.id("ClientID")?, address: client.address };
                transaction.client = params.id("ClientTransactionID")?;
                self.seat.renew(caller);
                match self.answer(device, &Call { verb, member, params, caller, asked }).await? {
                    Answer::Done => Ok(done(*transaction, None)),
                    Answer::Value(value) => Ok(done(*transaction, Some(value))),
                    Answer::Picture(picture) => self.write(picture, *transaction, as_bytes).await,
                }
            }
            _ => Err(nothing_at(&request)),
        }
    }

    /// That a request may be answered: not a foreign page's, nor one too many.
    fn admit(&self, request: &Request) -> Result<Client, Away> {
        let peer = *request.extensions().get::<Peer>().ok_or_else(|| {
            tracing::error!("a request without its connection's far end");
            Problem::internal()
        })?;
        let client = Client::vetted(peer, request.headers(), &self.gate, self.loopback_only)?;
        // Also of what only reads: it renews a lease.
        client.check_origin(request.headers())?;
        if !is_halt(request.method(), request.uri().path()) {
            self.gate.count(client.address, None).map_err(Problem::too_many)?;
        }
        Ok(client)
    }

    async fn write(&self, picture: Picture, transaction: Transaction, as_bytes: bool) -> Result<Response, Away> {
        let _turn = self.writing.lock().await;
        let written = tokio::task::spawn_blocking(move || {
            if as_bytes { Ok(picture.bytes(transaction)) } else { picture.json(transaction) }
        });
        match written.await {
            Ok(Ok(body)) => Ok(respond(body, as_bytes)),
            Ok(Err(error)) => Err(unwritten(&error)),
            Err(error) => Err(unwritten(&error)),
        }
    }
}

/// Whether a request halts an axis: that is counted against no limit, and served where there is room for nothing else.
fn is_halt(method: &Method, path: &str) -> bool {
    let number = path.strip_prefix("/api/v1/focuser/").and_then(|rest| rest.strip_suffix("/halt"));
    *method == Method::PUT && number.is_some_and(|number| !number.contains('/'))
}

/// What Alpaca still serves where there is room for nothing else.
pub const IN_RESERVE: InReserve =
    InReserve { is_served: is_halt, words: "a halt still gets through here: PUT /api/v1/focuser/NUMBER/halt" };

fn unwritten(error: &dyn std::error::Error) -> Away {
    tracing::error!(%error, "an image could not be written");
    Away::Status(
        StatusCode::INTERNAL_SERVER_ERROR,
        "the image could not be written; the daemon's log says why".to_owned(),
    )
}

fn nothing_at(request: &Request) -> Away {
    let path = request.uri().path();
    Away::Refused(Refused::Malformed(format!(
        "there is nothing at {path:?}; there are /management/apiversions, /management/v1/... and /api/v1/TYPE/NUMBER/MEMBER, \
         in lower case"
    )))
}

/// Whether a client takes an image as bytes.
fn accepts_bytes(headers: &HeaderMap) -> bool {
    let accepted = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    let mut kinds = accepted.flat_map(|value| value.split(','));
    kinds.any(|kind| kind.split(';').next().unwrap_or_default().trim().eq_ignore_ascii_case(IMAGE_BYTES))
}

/// Reads the form of a PUT.
async fn form(request: Request) -> Result<Params, Away> {
    let kind = request.headers().get(header::CONTENT_TYPE).map(|kind| kind.to_str().unwrap_or("?").to_owned());
    let body = tokio::time::timeout(FORM_ALLOWED, to_bytes(request.into_body(), LONGEST_FORM)).await;
    let body = match body {
        Ok(Ok(body)) => body,
        Ok(Err(_)) => {
            let words = format!("the form cannot be read, or is longer than {LONGEST_FORM} bytes");
            return Err(Refused::Malformed(words).into());
        }
        Err(_) => {
            let words = format!("the form did not come within {FORM_ALLOWED:?}");
            return Err(Away::Status(StatusCode::REQUEST_TIMEOUT, words));
        }
    };
    let essence = kind.as_deref().map(|kind| kind.split(';').next().unwrap_or_default().trim());
    match essence {
        Some(essence) if !essence.eq_ignore_ascii_case("application/x-www-form-urlencoded") => {
            let words = format!("parameters come as application/x-www-form-urlencoded, not as {essence}");
            Err(Refused::Malformed(words).into())
        }
        _ => Ok(Params::of_form(&body)),
    }
}
