//! What keeps watch from outside asks: health, readiness, metrics; and the timing of every request.

use axum::Json;
use axum::extract::{MatchedPath, Request, State};
use axum::http::{StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use tokio::time::Instant;

use super::App;
use super::access::scopes::known_route;
use super::error::{Problem, Result};
use super::types::{Health, Readiness};
use crate::telemetry;

/// When a request came in.
#[derive(Debug, Clone, Copy)]
pub(super) struct Arrived(pub(super) Instant);

/// Notes when a request came, and times its answer. A stream is answered when it begins.
pub(super) async fn time(mut request: Request, next: Next) -> Response {
    let arrived = Instant::now();
    request.extensions_mut().insert(Arrived(arrived));
    let method = request.method().clone();
    let response = next.run(request).await;
    // Paths that match nothing are anybody's invention: one name for them all.
    let route = response.extensions().get::<Route>().map_or(telemetry::NO_ROUTE, |route| route.0);
    telemetry::answered(method.as_str(), route, response.status().as_u16(), arrived.elapsed());
    response
}

/// The route that answered.
#[derive(Debug, Clone, Copy)]
struct Route(&'static str);

/// Says in the response which route it was.
pub(super) async fn name_route(request: Request, next: Next) -> Response {
    let route = request.extensions().get::<MatchedPath>().and_then(|path| known_route(path.as_str()));
    let mut response = next.run(request).await;
    if let Some(route) = route {
        response.extensions_mut().insert(Route(route));
    }
    response
}

/// Whether the daemon answers.
#[utoipa::path(get, path = "/healthz", operation_id = "get_health", tag = "daemon", responses((status = 200, body = Health)))]
pub(super) async fn health(State(app): State<App>) -> Json<Health> {
    Json(Health {
        status: "ok".to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        boot_id: app.hub.boot_id(),
        simulated: app.service.bench().is_simulated(),
    })
}

/// Whether the bench can be worked with: axes connected, camera online.
#[utoipa::path(
    get, path = "/readyz", operation_id = "get_readiness", tag = "daemon",
    responses(
        (status = 200, body = Readiness),
        (status = 503, description = "Something is missing; `hindrances` says what", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn ready(State(app): State<App>) -> Result<Json<Readiness>> {
    let hindrances = app.service.hindrances();
    if hindrances.is_empty() { Ok(Json(Readiness { ready: true })) } else { Err(Problem::not_ready(&hindrances)) }
}

/// What the program counts and times about itself, in Prometheus' text format.
#[utoipa::path(
    get, path = "/metrics", operation_id = "get_metrics", tag = "daemon",
    responses(
        (status = 200, body = String, content_type = "text/plain; version=0.0.4"),
        (status = 404, description = "Nothing is kept", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn metrics(State(app): State<App>) -> Result<Response> {
    let Some(kept) = &app.metrics else {
        return Err(Problem::not_found("this run of the program keeps no metrics"));
    };
    telemetry::bench(&app.service.gauges());
    Ok((StatusCode::OK, [(header::CONTENT_TYPE, "text/plain; version=0.0.4")], kept.render()).into_response())
}
