//! The bench's state, and the operator's statement about the shell.

pub(in crate::api) mod axes;
pub mod camera;
pub(in crate::api) mod config;
pub(in crate::api) mod devices;
pub(in crate::api) mod draft;
pub(in crate::api) mod info;
pub(in crate::api) mod simulation;
pub(in crate::api) mod stop;

use axum::extract::State;
use axum::{Extension, Json};
use serde_json::json;

use super::App;
use super::contract::Motion;
use super::error::Result;
use super::extract::{JsonBody, LeaseKey};
use super::types::ShellRequest;
use crate::access::{AuditRecord, Principal};
use crate::control::events::BenchView;

/// State of the whole bench.
#[utoipa::path(get, path = "/api/v1/bench", operation_id = "get_bench", tag = "bench", responses((status = 200, body = BenchView)))]
pub(super) async fn get(State(app): State<App>) -> Json<BenchView> {
    Json(app.service.bench_view())
}

/// The operator states whether the shell is on the camera.
///
/// Unknown counts as on. `off` is taken on the operator's word, and is forgotten when the program ends.
#[utoipa::path(
    put, path = "/api/v1/shell", operation_id = "put_shell", tag = "bench", request_body = ShellRequest,
    params(LeaseKey),
    responses(
        (status = 200, body = BenchView),
        Motion,
    )
)]
pub(super) async fn put_shell(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    key: LeaseKey,
    JsonBody(request): JsonBody<ShellRequest>,
) -> Result<Json<BenchView>> {
    let view = app.service.set_shell(&app.permit(&key)?, request.state)?;
    app.gate.audit(AuditRecord::of(&principal, "shell.set", json!({ "state": request.state })));
    Ok(Json(view))
}
