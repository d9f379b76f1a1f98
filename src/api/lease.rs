//! The control lease: who may move the axes.

use std::time::Duration;

use axum::extract::State;
use axum::http::StatusCode;
use axum::{Extension, Json};

use serde_json::json;

use super::App;
use super::contract::Leased;
use super::error::{Problem, Result};
use super::extract::{JsonBody, LeaseKey};
use super::types::{LeaseAsked, LeaseState};
use crate::access::{AuditRecord, Principal};
use crate::control::lease::{DEFAULT_TTL_S, LeaseGrant, LeaseRequest, LeaseView, MAX_TEXT, TTL_RANGE_S};

fn request(asked: LeaseAsked) -> Result<LeaseRequest> {
    let words = |field: &str, text: &str| {
        if text.trim().is_empty() || text.chars().count() > MAX_TEXT || text.chars().any(char::is_control) {
            let detail = format!("{field}: 1 to {MAX_TEXT} printable characters are needed");
            return Err(Problem::invalid(field, detail));
        }
        Ok(())
    };
    words("owner", &asked.owner)?;
    asked.note.as_deref().map_or(Ok(()), |note| words("note", note))?;
    let ttl_s = asked.ttl_s.unwrap_or(DEFAULT_TTL_S);
    let [low, high] = TTL_RANGE_S;
    if !(low..=high).contains(&ttl_s) {
        return Err(Problem::invalid("ttl_s", format!("ttl_s: {ttl_s} is not within {low} to {high}")));
    }
    Ok(LeaseRequest { owner: asked.owner, note: asked.note, ttl: Duration::from_secs_f64(ttl_s) })
}

/// Who has the control lease.
#[utoipa::path(
    get, path = "/api/v1/lease", operation_id = "get_lease", tag = "lease", responses((status = 200, body = LeaseState))
)]
pub(super) async fn get(State(app): State<App>) -> Json<LeaseState> {
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
pub(super) async fn take(
    State(app): State<App>,
    JsonBody(asked): JsonBody<LeaseAsked>,
) -> Result<(StatusCode, Json<LeaseGrant>)> {
    Ok((StatusCode::CREATED, Json(app.service.leases().acquire(request(asked)?)?)))
}

/// Takes the control lease from whoever has it.
///
/// A job under way is cancelled first, and an axis that moves is stopped.
#[utoipa::path(
    post, path = "/api/v1/lease/takeover", operation_id = "take_over_lease", tag = "lease", request_body = LeaseAsked,
    responses(
        (status = 201, body = LeaseGrant),
        (status = 409, description = "The job that holds it did not end in time", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn take_over(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    JsonBody(asked): JsonBody<LeaseAsked>,
) -> Result<(StatusCode, Json<LeaseGrant>)> {
    let request = request(asked)?;
    let former = app.service.leases().view();
    let detail = json!({ "owner": &request.owner, "note": &request.note, "former": former });
    app.gate.audit(AuditRecord::of(&principal, "lease.take_over", detail));
    let service = app.service.clone();
    // In a task of its own: a client that hangs up must not leave a job cancelled and the lease with nobody.
    let granted = tokio::spawn(async move { service.take_over(request).await }).await;
    let granted = granted.map_err(|_| Problem::internal())??;
    Ok((StatusCode::CREATED, Json(granted)))
}

/// Renews the control lease for its time to live.
#[utoipa::path(
    post, path = "/api/v1/lease/heartbeat", operation_id = "renew_lease", tag = "lease", params(LeaseKey),
    responses(
        (status = 200, body = LeaseView),
        Leased,
    )
)]
pub(super) async fn renew(State(app): State<App>, key: LeaseKey) -> Result<Json<LeaseView>> {
    Ok(Json(app.service.leases().renew(key.shown())?))
}

/// Gives the control lease back; where a job holds it, at that job's end. May be repeated.
#[utoipa::path(
    delete, path = "/api/v1/lease", operation_id = "release_lease", tag = "lease", params(LeaseKey),
    responses(
        (status = 204, description = "This key opens nothing any more"),
        (status = 428, description = "No key was shown", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn release(State(app): State<App>, key: LeaseKey) -> Result<StatusCode> {
    app.service.leases().release(key.shown())?;
    Ok(StatusCode::NO_CONTENT)
}
