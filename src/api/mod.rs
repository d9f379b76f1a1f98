//! The HTTP API, version 1, with its WebSocket and the page.
//!
//! By what a client does:
//!
//! ```text
//!  pictures   what is shown of a frame: live, by viewports, as scenes
//!  live       the WebSocket, and what of it goes to everybody who watches
//!  jobs       jobs of this run and of earlier ones, their recordings and measurements
//!  bench      axes, camera, stop, simulation, configuration and design
//!  access     who asks, by token, session, ticket or lease, and what they may
//!  export     a job as HTML, CSV, JSON and plots
//!  foxglove   the bridge to Foxglove
//!  server     connections, their bounds, and TLS
//! ```
//!
//! One file per resource; [`error`] alone knows status codes. The contract is `proto/openapi.json`, written from this
//! code, `proto/asyncapi.yaml` for the WebSocket's text messages, and `proto/plenalign/v1` for its pictures.

pub mod access;
pub mod bench;
mod contract;
pub mod error;
pub mod export;
mod extract;
pub mod foxglove;
pub mod jobs;
mod live;
mod metrics;
mod page;
pub mod pictures;
/// Messages of `proto/plenalign/v1`, written by `prost-build`; a test compares.
#[allow(missing_docs, clippy::all)]
#[rustfmt::skip]
pub mod proto;
pub mod server;
pub mod types;

use std::net::SocketAddr;
use std::sync::{Arc, OnceLock};

use axum::body::Body;
use axum::extract::{DefaultBodyLimit, MatchedPath, Request};
use axum::http::{HeaderName, HeaderValue, header};
use axum::middleware;
use axum::response::{IntoResponse, Response};
use metrics_exporter_prometheus::PrometheusHandle;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tower::ServiceExt as _;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::set_header::SetResponseHeaderLayer;
use tower_http::trace::TraceLayer;
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

pub(crate) use access::client::{Client, Peer};
pub use access::scopes::IN_RESERVE;
use error::{Problem, UnauthorisedProblem};
use live::hub::Hub;
use pictures::picture::Pictures;
use pictures::viewport::Viewports;

use crate::access::Gate;
use crate::config::ConfigOrigin;
use crate::control::motion::lease::Permit;
use crate::control::{Service, ServiceError};
use crate::telemetry;

/// What every handler gets.
#[derive(Clone)]
struct App {
    service: Arc<Service>,
    hub: Arc<Hub>,
    pictures: Arc<Pictures>,
    viewports: Arc<Viewports>,
    lookout: Arc<bench::devices::Lookout>,
    origin: Arc<ConfigOrigin>,
    /// Writes what is counted as text, where it is kept.
    metrics: Option<PrometheusHandle>,
    config: Arc<bench::config::ConfigFile>,
    gate: Arc<Gate>,
    /// Name of the cookie that holds a browser's session. Browsers send a host's cookies to all of its ports, so that
    /// the daemons of two benches on one machine need names of their own.
    cookie: Arc<str>,
    loopback_only: bool,
    shutdown: CancellationToken,
    viewers: TaskTracker,
}

impl App {
    /// That the request comes from the holder of the control lease. What it asks for was asked for when its head came.
    fn permit(&self, key: &extract::LeaseKey) -> std::result::Result<Permit, ServiceError> {
        Ok(self.service.leases().permit(key.shown())?.asked_at(key.asked()))
    }
}

/// The API over a service, ready to be served.
#[derive(Clone)]
pub struct Api {
    app: App,
}

impl Api {
    /// The API over `service`. `gate` says who may ask; `address` is where it will listen; `origin` is where the
    /// configuration came from. Has to be called within a tokio runtime.
    #[must_use]
    pub fn new(service: Arc<Service>, gate: Arc<Gate>, address: SocketAddr, origin: ConfigOrigin) -> Self {
        let hub = Arc::new(Hub::new());
        let shutdown = CancellationToken::new();
        tokio::spawn(live::hub::pump(hub.clone(), service.clone(), shutdown.clone()));
        let (following, until) = (Arc::clone(&gate).follow(), shutdown.clone());
        tokio::spawn(async move { until.run_until_cancelled(following).await });
        let config = Arc::new(bench::config::ConfigFile::of(&origin, service.config()));
        let viewports = service.config().server.max_viewports as usize;
        let pictures = Pictures::new(viewports, service.config().sensor.mosaic.is_some());
        let app = App {
            service,
            config,
            hub,
            pictures: Arc::new(pictures),
            viewports: Viewports::new(viewports),
            lookout: Arc::default(),
            origin: Arc::new(origin),
            gate,
            cookie: format!("plenalign_session_{}", address.port()).into(),
            metrics: None,
            loopback_only: address.ip().is_loopback(),
            shutdown,
            viewers: TaskTracker::new(),
        };
        Self { app }
    }

    /// With what writes the program's metrics as text, where they are kept.
    #[must_use]
    pub fn with_metrics(mut self, metrics: Option<PrometheusHandle>) -> Self {
        self.app.metrics = metrics;
        self
    }

    /// Starts the configured bridge for Foxglove; `None` where none is configured. A picture that other viewers have, too,
    /// is made once for all.
    ///
    /// # Errors
    /// Why it cannot listen, in words.
    pub async fn bridge(
        &self,
        connections: &server::Connections,
    ) -> std::result::Result<Option<foxglove::Bridge>, String> {
        let App { service, gate, pictures, .. } = &self.app;
        foxglove::Bridge::start(Arc::clone(service), Arc::clone(gate), Arc::clone(pictures), connections).await
    }

    /// The router, for a server or a test.
    pub fn router(&self) -> axum::Router {
        let (router, _) = routes().split_for_parts();
        let header = |name, value| SetResponseHeaderLayer::if_not_present(name, HeaderValue::from_static(value));
        router
            .fallback(page_or_problem)
            .method_not_allowed_fallback(method_not_allowed)
            .route_layer(middleware::from_fn(metrics::name_route))
            .layer(DefaultBodyLimit::max(extract::BODY_LIMIT_BYTES))
            .layer(middleware::from_fn_with_state(self.app.clone(), access::guard::guard))
            .layer(CatchPanicLayer::custom(|_| Problem::internal().into_response()))
            .layer(header(header::X_CONTENT_TYPE_OPTIONS, "nosniff"))
            .layer(header(HeaderName::from_static("cross-origin-resource-policy"), "same-origin"))
            .layer(header(header::CACHE_CONTROL, "no-store"))
            .layer(header(header::REFERRER_POLICY, "no-referrer"))
            // The path alone: a query may hold a ticket or a key, and a log is read by many.
            .layer(TraceLayer::new_for_http().make_span_with(|request: &Request| {
                let (method, path) = (request.method(), request.uri().path());
                // By its route: paths hold names, and are as many as there are jobs.
                let route = request.extensions().get::<MatchedPath>().map_or(telemetry::NO_ROUTE, MatchedPath::as_str);
                let word = telemetry::method_word(method.as_str());
                tracing::debug_span!(
                    "request", otel.name = format!("{word} {route}"), otel.kind = "server", %method, path
                )
            }))
            .layer(middleware::from_fn(metrics::time))
            .with_state(self.app.clone())
    }

    /// Whether a request gets through the whole router to an answer.
    pub async fn answers(&self) -> bool {
        let Ok(mut request) = Request::get("/healthz").header(header::HOST, "localhost").body(Body::empty()) else {
            return false;
        };
        let address = SocketAddr::from((std::net::Ipv4Addr::LOCALHOST, 0));
        request.extensions_mut().insert(Peer { address, tls: false });
        self.router().oneshot(request).await.is_ok_and(|answer| answer.status().is_success())
    }

    /// Ends every stream and lets what still listens on the token end; returns when the viewers have been told.
    /// The caller bounds the wait.
    pub async fn close(&self) {
        self.app.shutdown.cancel();
        self.app.viewers.close();
        self.app.viewers.wait().await;
    }

    /// Identity of this run of the program, as every message of the WebSocket has it.
    #[must_use]
    pub fn boot_id(&self) -> uuid::Uuid {
        self.app.hub.boot_id()
    }

    /// Cancelled by [`Api::close`].
    #[must_use]
    pub fn closing(&self) -> CancellationToken {
        self.app.shutdown.clone()
    }
}

#[derive(OpenApi)]
#[openapi(
    info(
        title = "Plenalign",
        description = "Aligns underwater plenoptic cameras: state of the bench, jobs, axes, \
        stop, frames. Lengths carry their unit in the key. A client ignores fields that it does not know. \
        Every refusal is a problem (RFC 9457), a request's head of more than 64 headers or 16 KiB included (431); only \
        what is no HTTP at all (400) and a head beyond 256 headers or 64 KiB (431) are answered by their status alone, \
        and the connection is closed."
    ),
    components(schemas(types::ServerMessage, types::ViewerMessage, Problem, UnauthorisedProblem))
)]
struct Contract;

fn routes() -> OpenApiRouter<App> {
    OpenApiRouter::with_openapi(Contract::openapi())
        .routes(routes!(bench::get))
        .routes(routes!(bench::put_shell))
        .routes(routes!(bench::axes::go))
        .routes(routes!(bench::axes::home))
        .routes(routes!(bench::axes::leave_switch))
        .routes(routes!(bench::axes::jog, bench::axes::end_jog))
        .routes(routes!(access::lease::take, access::lease::get, access::lease::release))
        .routes(routes!(access::lease::renew))
        .routes(routes!(access::lease::take_over))
        .routes(routes!(jobs::create, jobs::history::jobs))
        .routes(routes!(jobs::get, jobs::cancel))
        .routes(routes!(jobs::confirm))
        .routes(routes!(jobs::repeat))
        .routes(routes!(jobs::renew_key))
        .routes(routes!(jobs::history::log))
        .routes(routes!(jobs::history::iterations))
        .routes(routes!(jobs::history::measurements))
        .routes(routes!(jobs::history::moves))
        .routes(routes!(jobs::history::audit))
        .routes(routes!(export::as_json))
        .routes(routes!(export::as_csv))
        .routes(routes!(export::as_html))
        .routes(routes!(jobs::recording::download))
        .routes(routes!(bench::stop::stop, bench::stop::get, bench::stop::reset))
        .routes(routes!(bench::camera::controls))
        .routes(routes!(bench::camera::set_control))
        .routes(routes!(bench::camera::auto_expose))
        .routes(routes!(bench::camera::histogram))
        .routes(routes!(pictures::frame::png))
        .routes(routes!(pictures::frame::snapshot))
        .routes(routes!(live::stream::mjpeg))
        .routes(routes!(pictures::view::report))
        .routes(routes!(pictures::view::jpeg))
        .routes(routes!(pictures::view::png))
        .routes(routes!(access::session::sign_in, access::session::get, access::session::sign_out))
        .routes(routes!(access::tickets::create))
        .routes(routes!(access::tokens::create, access::tokens::list))
        .routes(routes!(access::tokens::revoke))
        .routes(routes!(bench::info::measurement))
        .routes(routes!(bench::info::recent))
        .routes(routes!(jobs::measurements::measure, jobs::measurements::list))
        .routes(routes!(bench::config::get, bench::config::put))
        .routes(routes!(bench::config::schema))
        .routes(routes!(bench::config::validate))
        .routes(routes!(bench::info::design, bench::draft::work_out))
        .routes(routes!(bench::draft::plan))
        .routes(routes!(bench::devices::get))
        .routes(routes!(bench::simulation::faults, bench::simulation::put_faults))
        .routes(routes!(
            bench::simulation::fault_plan,
            bench::simulation::put_fault_plan,
            bench::simulation::delete_fault_plan
        ))
        .routes(routes!(bench::info::openapi))
        .routes(routes!(page::docs))
        .routes(routes!(metrics::health))
        .routes(routes!(metrics::ready))
        .routes(routes!(metrics::metrics))
        .routes(routes!(live::ws))
}

/// The contract as code has it.
#[must_use]
pub fn openapi() -> utoipa::openapi::OpenApi {
    contract::complete(routes().to_openapi())
}

/// The contract as a file: JSON with a line's end.
#[must_use]
pub fn openapi_json() -> &'static str {
    static TEXT: OnceLock<String> = OnceLock::new();
    TEXT.get_or_init(|| {
        let contract = serde_json::to_value(openapi()).map(contract::with_configuration);
        contract
            .and_then(|contract| serde_json::to_string_pretty(&contract))
            .map(|text| text + "\n")
            .unwrap_or_default()
    })
}

async fn page_or_problem(request: Request) -> Response {
    let path = request.uri().path();
    if path == "/api" || path.starts_with("/api/") {
        return Problem::not_found(format!("there is nothing at {path}; /api/v1/openapi.json has what there is"))
            .into_response();
    }
    if !matches!(request.method().as_str(), "GET" | "HEAD") {
        return method_not_allowed(request).await;
    }
    page::serve(request.uri(), request.headers())
}

async fn method_not_allowed(request: Request) -> Response {
    let (method, path) = (request.method(), request.uri().path());
    Problem::method_not_allowed(format!("{method} is not for {path}; the header Allow has what is")).into_response()
}
