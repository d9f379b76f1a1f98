//! What is made to go wrong with the simulated bench.

use axum::extract::State;
use axum::http::StatusCode;
use axum::{Extension, Json};
use serde::Serialize;
use serde_json::json;
use utoipa::ToSchema;

use crate::access::{AuditRecord, Principal};
use crate::api::App;
use crate::api::error::{Problem, Result};
use crate::api::extract::JsonBody;
use crate::device::faults::{FaultPlan, Faults, Plannable as _};

/// Longest plan of faults, bytes: a thousand events, each naming everything.
const PLAN_LIMIT_BYTES: usize = 2 * 1024 * 1024;

/// The plan of faults in force.
#[derive(Debug, Serialize, ToSchema)]
pub(in crate::api) struct PlanInForce {
    /// The plan; `null` where none is.
    #[schema(required = true)]
    plan: Option<FaultPlan>,
    /// For how long it has been in force, s.
    #[schema(required = true)]
    elapsed_s: Option<f64>,
}

impl PlanInForce {
    fn of(app: &App) -> Json<Self> {
        let (plan, elapsed) = app.service.fault_plan().unzip();
        Json(Self { plan: plan.map(|plan| (*plan).clone()), elapsed_s: elapsed.map(|elapsed| elapsed.as_secs_f64()) })
    }
}

fn faults_of(app: &App) -> Result<Faults> {
    app.service.faults().ok_or_else(Problem::not_simulated)
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
pub(in crate::api) async fn faults(State(app): State<App>) -> Result<Json<Faults>> {
    Ok(Json(faults_of(&app)?))
}

/// Makes things go wrong with the simulated bench: what is named does from now on, everything else goes right.
///
/// Whether a program or a person deals with them as they should can so be tried without breaking anything. A plan of
/// faults in force ends.
#[utoipa::path(
    put, path = "/api/v1/simulation/faults", operation_id = "put_faults", tag = "bench", request_body = Faults,
    responses(
        (status = 200, body = Faults),
        (status = 409, description = "The bench is not simulated", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn put_faults(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    JsonBody(faults): JsonBody<Faults>,
) -> Result<Json<Faults>> {
    faults_of(&app)?;
    faults.check().map_err(|fault| Problem::invalid(fault.field, fault.to_string()))?;
    app.service.set_faults(faults);
    app.gate.audit(AuditRecord::of(&principal, "simulation.faults", json!(faults)));
    Ok(Json(faults_of(&app)?))
}

/// The plan of faults in force, and for how long it has been.
#[utoipa::path(
    get, path = "/api/v1/simulation/fault-plan", operation_id = "get_fault_plan", tag = "bench",
    responses(
        (status = 200, body = PlanInForce),
        (status = 409, description = "The bench is not simulated", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn fault_plan(State(app): State<App>) -> Result<Json<PlanInForce>> {
    faults_of(&app)?;
    Ok(PlanInForce::of(&app))
}

/// Puts a plan of faults in force: things go wrong with the simulated bench by themselves, when it says so and for as
/// long. It counts from now, in the place of another plan and of what was set by hand.
#[utoipa::path(
    put, path = "/api/v1/simulation/fault-plan", operation_id = "put_fault_plan", tag = "bench",
    request_body = FaultPlan,
    responses(
        (status = 200, body = PlanInForce),
        (status = 409, description = "The bench is not simulated", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn put_fault_plan(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    JsonBody(plan): JsonBody<FaultPlan, PLAN_LIMIT_BYTES>,
) -> Result<Json<PlanInForce>> {
    faults_of(&app)?;
    plan.check().map_err(|error| Problem::invalid(&error.field(), error.to_string()))?;
    let events = plan.events.len();
    app.service.run_fault_plan(plan);
    app.gate.audit(AuditRecord::of(&principal, "simulation.fault-plan", json!({ "events": events })));
    Ok(PlanInForce::of(&app))
}

/// Ends the plan of faults: everything goes right from now on.
#[utoipa::path(
    delete, path = "/api/v1/simulation/fault-plan", operation_id = "delete_fault_plan", tag = "bench",
    responses(
        (status = 204, description = "Everything goes right"),
        (status = 409, description = "The bench is not simulated", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(in crate::api) async fn delete_fault_plan(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
) -> Result<StatusCode> {
    faults_of(&app)?;
    app.service.set_faults(Faults::default());
    app.gate.audit(AuditRecord::of(&principal, "simulation.fault-plan", json!({ "events": 0 })));
    Ok(StatusCode::NO_CONTENT)
}
