//! Stopping everything, and taking the stop back.

use axum::extract::State;
use axum::http::header::CONTENT_TYPE;
use axum::http::{HeaderMap, StatusCode};
use axum::{Extension, Json};
use serde_json::json;

use crate::access::{AuditRecord, LOCAL, Principal};
use crate::api::App;
use crate::api::error::{Problem, Result};
use crate::api::extract::{Asker, JsonBody, Query};
use crate::api::metrics::Arrived;
use crate::api::types::ResetRequest;
use crate::control::events::StopView;
use crate::control::field::words;
use crate::control::{ServiceError, StopReport};

/// Stops every axis at once and latches: motion is refused until the stop is reset.
///
/// Answers in every state of the bench, and says for each axis how far the stop got.
#[utoipa::path(
    post, path = "/api/v1/stop", operation_id = "stop", tag = "stop", params(Asker),
    responses((status = 200, body = StopReport))
)]
pub(in crate::api) async fn stop(
    State(app): State<App>,
    Extension(Arrived(at)): Extension<Arrived>,
    Extension(principal): Extension<Principal>,
    asked: Result<Query<Asker>>,
) -> Json<StopReport> {
    let by = Asker::name(asked, &principal);
    let report = app.service.stop(at, by.as_ref().unwrap_or(&principal.name)).await;
    // After the axes: nothing comes before them.
    let detail = json!({ "focus": report.focus, "e": report.e, "kept": report.kept });
    app.gate.audit(AuditRecord::of(&principal, "stop", detail));
    Json(report)
}

/// Whether the stop is latched, who stopped, and who reset it last.
#[utoipa::path(get, path = "/api/v1/stop", operation_id = "get_stop", tag = "stop", responses((status = 200, body = StopView)))]
pub(in crate::api) async fn get(State(app): State<App>) -> Json<StopView> {
    Json(app.service.bench_view().stop)
}

/// Resets the stop, by somebody who says why.
///
/// Nothing moves by it, and nothing goes on that was held while the bench was stopped. It is in force once the history
/// has it. Asked again, nothing more happens; stopped again meanwhile, the stop stays latched.
#[utoipa::path(
    delete, path = "/api/v1/stop", operation_id = "reset_stop", tag = "stop", request_body = ResetRequest,
    responses(
        (status = 200, description = "The stop as it is now", body = StopView),
        (status = 503, description = "The history cannot be written: the stop stays latched", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn reset(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    headers: HeaderMap,
    body: Result<JsonBody<ResetRequest>>,
) -> Result<Json<StopView>> {
    let JsonBody(request) = body.map_err(|problem| {
        let nothing = problem.status == StatusCode::UNSUPPORTED_MEDIA_TYPE && !headers.contains_key(CONTENT_TYPE);
        if nothing {
            Problem::invalid("why", "why: say why the stop is reset, as JSON: {\"why\": \"…\"}")
        } else {
            problem
        }
    })?;
    if let Some(owner) = &request.owner {
        words("owner", owner).map_err(ServiceError::from)?;
    }
    // Who has a token is known by it.
    let by = request.owner.filter(|_| principal.name == LOCAL).unwrap_or_else(|| principal.name.clone());
    if let Some(reset) = app.service.reset_stop(&by, &request.why).await? {
        app.gate.audit(AuditRecord::of(&principal, "stop.reset", json!(reset)));
    }
    Ok(Json(app.service.bench_view().stop))
}
