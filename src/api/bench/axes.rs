//! Moving and homing one axis by hand.

use axum::extract::State;
use axum::http::StatusCode;
use axum::{Extension, Json};
use serde_json::json;

use crate::access::{AuditRecord, Principal};
use crate::api::App;
use crate::api::contract::Motion;
use crate::api::error::Result;
use crate::api::extract::{JsonBody, LeaseKey, PathParam};
use crate::api::types::{JogRequest, LeaveSwitchRequest, MoveRequest};
use crate::control::Acceptance;
use crate::control::events::BenchView;
use crate::device::AxisName;
use crate::units::Millimetres;

/// Starts a move of one axis.
///
/// Returns once the move is accepted; its end is seen in the bench's state. Refused while a job holds the bench, while
/// the stop is latched, outside the axis's travel, and beyond the e wall.
#[utoipa::path(
    post, path = "/api/v1/axes/{axis}/move", operation_id = "move_axis", tag = "axes", request_body = MoveRequest,
    params(("axis" = AxisName, Path, description = "Which axis"), LeaseKey),
    responses(
        (status = 202, description = "The move has begun", body = BenchView),
        Motion,
    )
)]
pub(in crate::api) async fn go(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    PathParam(axis): PathParam<AxisName>,
    key: LeaseKey,
    JsonBody(request): JsonBody<MoveRequest>,
) -> Result<(StatusCode, Json<BenchView>)> {
    let view = app.service.move_axis(&app.permit(&key)?, axis, Millimetres(request.position_mm)).await?;
    let detail = json!({ "axis": axis, "position_mm": request.position_mm });
    app.gate.audit(AuditRecord::of(&principal, "axis.move", detail));
    Ok((StatusCode::ACCEPTED, Json(view)))
}

/// Starts homing one axis.
///
/// Returns once it is accepted. With the shell on, or its state unknown, homing e towards the shell is refused.
#[utoipa::path(
    post, path = "/api/v1/axes/{axis}/home", operation_id = "home_axis", tag = "axes",
    params(("axis" = AxisName, Path, description = "Which axis"), LeaseKey),
    responses(
        (status = 202, description = "Homing has begun", body = BenchView),
        Motion,
    )
)]
pub(in crate::api) async fn home(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    PathParam(axis): PathParam<AxisName>,
    key: LeaseKey,
) -> Result<(StatusCode, Json<BenchView>)> {
    let view = app.service.home_axis(&app.permit(&key)?, axis).await?;
    app.gate.audit(AuditRecord::of(&principal, "axis.home", json!({ "axis": axis })));
    Ok((StatusCode::ACCEPTED, Json(view)))
}

/// Starts moving one axis off the limit switch that is pressed, by the operator's word for which it is.
///
/// For a controller that has one input for both switches of an axis (Grbl), and will not home from one of them. The axis
/// moves away from the switch until that lets go, in pieces of 0.2 mm, 3 mm in all at most. Returns once it is accepted.
/// With the shell on, or its state unknown, e is not moved towards the shell.
#[utoipa::path(
    post, path = "/api/v1/axes/{axis}/leave-switch", operation_id = "leave_switch", tag = "axes",
    request_body = LeaveSwitchRequest,
    params(("axis" = AxisName, Path, description = "Which axis"), LeaseKey),
    responses(
        (status = 202, description = "The axis moves", body = BenchView),
        Motion,
    )
)]
pub(in crate::api) async fn leave_switch(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    PathParam(axis): PathParam<AxisName>,
    key: LeaseKey,
    JsonBody(request): JsonBody<LeaveSwitchRequest>,
) -> Result<(StatusCode, Json<BenchView>)> {
    let view = app.service.leave_switch(&app.permit(&key)?, axis, request.pressed).await?;
    let detail = json!({ "axis": axis, "pressed": request.pressed });
    app.gate.audit(AuditRecord::of(&principal, "axis.leave_switch", detail));
    Ok((StatusCode::ACCEPTED, Json(view)))
}

/// Jogs one axis: it moves for 0.3 s from this request, and on for as long as the request is repeated in time.
///
/// It goes in short pieces, no further than the limit of travel, the e wall and the greatest step. A press that a stop
/// has ended is refused for good (`press-ended`).
#[utoipa::path(
    post, path = "/api/v1/axes/{axis}/jog", operation_id = "jog_axis", tag = "axes", request_body = JogRequest,
    params(("axis" = AxisName, Path, description = "Which axis"), LeaseKey),
    responses(
        (status = 202, description = "The axis moves", body = BenchView),
        Motion,
    )
)]
pub(in crate::api) async fn jog(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    PathParam(axis): PathParam<AxisName>,
    key: LeaseKey,
    JsonBody(request): JsonBody<JogRequest>,
) -> Result<(StatusCode, Json<BenchView>)> {
    let permit = app.permit(&key)?;
    let JogRequest { towards, speed_mm_per_s, press } = request;
    let (view, begins) = app.service.jog(&permit, axis, towards, speed_mm_per_s, press.as_deref()).await?;
    // Not every request that has it go on.
    if begins == Acceptance::Now {
        let detail = json!({ "axis": axis, "towards": towards });
        app.gate.audit(AuditRecord::of(&principal, "axis.jog", detail));
    }
    Ok((StatusCode::ACCEPTED, Json(view)))
}

/// Ends a jog at once. Needs no lease; may be repeated.
#[utoipa::path(
    delete, path = "/api/v1/axes/{axis}/jog", operation_id = "end_jog", tag = "axes",
    params(("axis" = AxisName, Path, description = "Which axis")),
    responses(
        (status = 200, body = BenchView),
    )
)]
pub(in crate::api) async fn end_jog(State(app): State<App>, PathParam(axis): PathParam<AxisName>) -> Json<BenchView> {
    Json(app.service.end_jog(axis))
}
