//! Stopping everything, and taking the stop back.

use axum::extract::State;
use axum::{Extension, Json};
use serde_json::json;

use super::App;
use super::metrics::Arrived;
use crate::access::{AuditRecord, Principal};
use crate::control::StopReport;
use crate::control::events::StopView;

/// Stops every axis at once and latches: motion is refused until the stop is reset.
///
/// Answers in every state of the bench, and says for each axis how far the stop got.
#[utoipa::path(post, path = "/api/v1/stop", operation_id = "stop", tag = "stop", responses((status = 200, body = StopReport)))]
pub(super) async fn stop(
    State(app): State<App>,
    Extension(Arrived(at)): Extension<Arrived>,
    Extension(principal): Extension<Principal>,
) -> Json<StopReport> {
    // In a task of its own: a client that hangs up must not call the stop back.
    let stopped = tokio::spawn(async move {
        let report = app.service.stop(at).await;
        // After the axes: nothing comes before them.
        let detail = json!({ "focus": report.focus, "e": report.e });
        app.gate.audit(AuditRecord::of(&principal, "stop", detail));
        report
    });
    let undeliverable = crate::device::StopDelivery::Undeliverable;
    Json(stopped.await.unwrap_or(StopReport { focus: undeliverable, e: undeliverable, latency_ms: None }))
}

/// Whether the stop is latched.
#[utoipa::path(get, path = "/api/v1/stop", operation_id = "get_stop", tag = "stop", responses((status = 200, body = StopView)))]
pub(super) async fn get(State(app): State<App>) -> Json<StopView> {
    Json(app.service.bench_view().stop)
}

/// Resets the stop; nothing moves by it. Asked again, nothing more happens.
#[utoipa::path(delete, path = "/api/v1/stop", operation_id = "reset_stop", tag = "stop", responses((status = 200, body = StopView)))]
pub(super) async fn reset(State(app): State<App>, Extension(principal): Extension<Principal>) -> Json<StopView> {
    let was_latched = app.service.bench_view().stop.latched;
    let view = app.service.reset_stop().stop;
    if was_latched {
        app.gate.audit(AuditRecord::of(&principal, "stop.reset", json!({})));
    }
    Json(view)
}
