//! What only has to be read: newest measurement, design, health, the contract itself.

use axum::Json;
use axum::extract::State;
use axum::http::header;
use axum::response::IntoResponse;

use crate::api::App;
use crate::api::error::{Problem, Result};
use crate::control::design::DesignView;
use crate::control::events::MeasurementView;
use crate::control::service::recent::RecentView;

/// The newest measurement.
#[utoipa::path(
    get, path = "/api/v1/measurement", operation_id = "get_measurement", tag = "bench",
    responses(
        (status = 200, body = MeasurementView),
        (status = 404, description = "Nothing has been measured", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn measurement(State(app): State<App>) -> Result<Json<MeasurementView>> {
    app.service.measurement().map(Json).ok_or_else(Problem::no_measurement)
}

/// The last two minutes, for charts that begin full.
///
/// What nobody watches is not measured: it is there as far as somebody looked.
#[utoipa::path(
    get, path = "/api/v1/recent", operation_id = "get_recent", tag = "bench",
    responses((status = 200, body = RecentView))
)]
pub(in crate::api) async fn recent(State(app): State<App>) -> Json<RecentView> {
    Json(app.service.recent())
}

/// The design of the configured camera: clarity and joint optimisation, and what follows from them.
#[utoipa::path(
    get, path = "/api/v1/design", operation_id = "get_design", tag = "bench",
    responses((status = 200, body = DesignView))
)]
pub(in crate::api) async fn design(State(app): State<App>) -> Json<DesignView> {
    Json(DesignView::of(app.service.config(), &app.origin))
}

/// This contract, OpenAPI 3.1.
#[utoipa::path(
    get, path = "/api/v1/openapi.json", operation_id = "get_openapi", tag = "daemon",
    responses((status = 200, body = Object, content_type = "application/json"))
)]
pub(in crate::api) async fn openapi() -> impl IntoResponse {
    ([(header::CONTENT_TYPE, "application/json")], crate::api::openapi_json())
}
