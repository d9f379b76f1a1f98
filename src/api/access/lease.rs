//! The control lease: who may move the axes.

use axum::extract::State;
use axum::http::StatusCode;
use axum::{Extension, Json};
use serde_json::json;

use crate::access::{AuditRecord, Principal};
use crate::api::App;
use crate::api::contract::Leased;
use crate::api::error::{Problem, Result};
use crate::api::extract::{JsonBody, LeaseKey};
use crate::api::types::{LeaseAsked, LeaseState};
use crate::control::events::LeaseView;
use crate::control::motion::lease::{LeaseGrant, LeaseRequest};

fn request(asked: LeaseAsked) -> Result<LeaseRequest> {
    Ok(LeaseRequest::new(asked.owner, asked.note, asked.ttl_s)?)
}

/// Who has the control lease.
#[utoipa::path(
    get, path = "/api/v1/lease", operation_id = "get_lease", tag = "lease", responses((status = 200, body = LeaseState))
)]
pub(in crate::api) async fn get(State(app): State<App>) -> Json<LeaseState> {
    Json(LeaseState { lease: app.service.leases().view() })
}

/// Takes the control lease where nobody has it.
///
/// Every command of motion has to show the key that this gives. It has to be renewed within its time to live; a job
/// started with it keeps it until the job's end.
#[utoipa::path(
    post, path = "/api/v1/lease", operation_id = "take_lease", tag = "lease", request_body = LeaseAsked,
    responses(
        (status = 201, body = LeaseGrant),
        (status = 409, description = "Another has it: who, and what for", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn take(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    JsonBody(asked): JsonBody<LeaseAsked>,
) -> Result<(StatusCode, Json<LeaseGrant>)> {
    let granted = app.service.leases().acquire(request(asked)?)?;
    let LeaseView { id, owner, note, .. } = &granted.lease;
    let detail = json!({ "lease": id, "owner": owner, "note": note });
    app.gate.audit(AuditRecord::of(&principal, "lease.take", detail));
    Ok((StatusCode::CREATED, Json(granted)))
}

/// Takes the control lease from whoever has it.
///
/// The former key opens nothing from here on; a job under way is cancelled, and an axis that moves is stopped.
#[utoipa::path(
    post, path = "/api/v1/lease/takeover", operation_id = "take_over_lease", tag = "lease", request_body = LeaseAsked,
    responses(
        (status = 201, body = LeaseGrant),
    )
)]
pub(in crate::api) async fn take_over(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    JsonBody(asked): JsonBody<LeaseAsked>,
) -> Result<(StatusCode, Json<LeaseGrant>)> {
    let request = request(asked)?;
    let former = app.service.leases().view();
    let detail = json!({ "owner": &request.owner, "note": &request.note, "former": former });
    // Before it is done: it takes a while where a job has to end.
    app.gate.audit(AuditRecord::of(&principal, "lease.take_over", detail));
    Ok((StatusCode::CREATED, Json(app.service.take_over(request).await)))
}

/// Renews the control lease for its time to live.
#[utoipa::path(
    post, path = "/api/v1/lease/heartbeat", operation_id = "renew_lease", tag = "lease", params(LeaseKey),
    responses(
        (status = 200, body = LeaseView),
        Leased,
    )
)]
pub(in crate::api) async fn renew(State(app): State<App>, key: LeaseKey) -> Result<Json<LeaseView>> {
    Ok(Json(app.service.leases().renew(key.shown())?))
}

/// Gives the control lease back; where a job holds it, at that job's end. May be repeated.
///
/// What moves under it by hand is stopped.
#[utoipa::path(
    delete, path = "/api/v1/lease", operation_id = "release_lease", tag = "lease", params(LeaseKey),
    responses(
        (status = 204, description = "This key opens nothing any more"),
        (status = 428, description = "No key was shown", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn release(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    key: LeaseKey,
) -> Result<StatusCode> {
    if let Some(released) = app.service.release_lease(key.shown()).await? {
        let detail = json!({ "lease": released.id, "owner": released.owner });
        app.gate.audit(AuditRecord::of(&principal, "lease.release", detail));
    }
    Ok(StatusCode::NO_CONTENT)
}
