//! What is made to go wrong with the simulated bench.

use axum::extract::State;
use axum::{Extension, Json};
use serde_json::json;

use super::App;
use super::error::{Problem, Result};
use super::extract::JsonBody;
use crate::access::{AuditRecord, Principal};
use crate::device::SimulatedOperator;
use crate::device::faults::Faults;

fn simulated(app: &App) -> Result<&dyn SimulatedOperator> {
    app.service.bench().simulated.as_deref().ok_or_else(Problem::not_simulated)
}

/// What is made to go wrong with the simulated bench.
#[utoipa::path(
    get, path = "/api/v1/simulation/faults", operation_id = "get_faults", tag = "bench",
    responses(
        (status = 200, body = Faults),
        (status = 409, description = "The bench is not simulated", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn faults(State(app): State<App>) -> Result<Json<Faults>> {
    Ok(Json(simulated(&app)?.faults()))
}

/// Makes things go wrong with the simulated bench: what is named does from now on, everything else goes right.
///
/// Whether a program or a person deals with them as they should can so be tried without breaking anything.
#[utoipa::path(
    put, path = "/api/v1/simulation/faults", operation_id = "put_faults", tag = "bench", request_body = Faults,
    responses(
        (status = 200, body = Faults),
        (status = 409, description = "The bench is not simulated", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn put_faults(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    JsonBody(faults): JsonBody<Faults>,
) -> Result<Json<Faults>> {
    let bench = simulated(&app)?;
    faults.check().map_err(|fault| Problem::invalid(fault.field, fault.to_string()))?;
    bench.set_faults(faults);
    app.gate.audit(AuditRecord::of(&principal, "simulation.faults", json!(faults)));
    Ok(Json(bench.faults()))
}
