//! Jobs: start, read, confirm an operator step, cancel.

pub mod history;
pub mod measurements;
pub(in crate::api) mod recording;

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::IntoResponse;
use axum::{Extension, Json};
use serde_json::json;
use uuid::Uuid;

use super::App;
use super::contract::{FromHistory, Keyed, Motion};
use super::error::{Problem, Result};
use super::extract::{Asker, ConfirmKeys, JsonBody, LeaseKey, PathParam, Query};
use super::types::{ConfirmKeyGrant, ConfirmRequest, JobCreated, JobResource, RepeatRequest};
use crate::access::{AuditRecord, Principal, Scope};
use crate::control::job::{JobRequest, JobSnapshot};
use crate::control::{Acceptance, Refusal, ServiceError};

/// Starts a job.
///
/// A bench does one job at a time: while one is under way another is refused, and the refusal names it. The job holds
/// the control lease that was shown until its end, and needs no heartbeat for it. What it asks of the operator is
/// confirmed with that lease's key, or with the confirm key that this answers with.
#[utoipa::path(
    post, path = "/api/v1/jobs", operation_id = "create_job", tag = "jobs", request_body = JobRequest,
    params(LeaseKey, ("Idempotency-Key" = Option<String>, Header,
        min_length = 1, max_length = 255, pattern = "^[ -~]*[!-~][ -~]*$",
        description = "A name of the caller's own for this request, 1 to 255 printable ASCII characters: asked again \
                       with it and the same body within a day, it is the same job")),
    responses(
        (status = 200, description = "Asked before: the job of then", body = JobCreated,
         headers(("Location" = String, description = "Path of the job"))),
        (status = 201, body = JobCreated, headers(("Location" = String, description = "Path of the job"))),
        Motion,
    )
)]
pub(super) async fn create(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    lease: LeaseKey,
    headers: HeaderMap,
    JsonBody(request): JsonBody<JobRequest>,
) -> Result<impl IntoResponse> {
    let key = idempotency_key(&headers)?;
    let permit = app.permit(&lease);
    let (job, acceptance) = match key {
        // Asked again, it is answered whoever has the lease by now.
        Some(key) => app.service.create_job_once(permit, request, key).await?,
        None => (app.service.create_job(&permit?, request).await?, Acceptance::Now),
    };
    if acceptance == Acceptance::Now {
        let detail = json!({ "job": job.id, "request": job.request, "owner": job.owner });
        app.gate.audit(AuditRecord::of(&principal, "job.create", detail));
    }
    let (status, key) = match acceptance {
        // The job is begun: where it has ended already, or there is no key to be had, it is told without one.
        Acceptance::Now => (StatusCode::CREATED, app.service.make_confirm_key(job.id).ok()),
        Acceptance::Before => (StatusCode::OK, None),
    };
    let confirm_key = key.map(|key| key.reveal().to_owned());
    let job = JobCreated { job: job.into(), confirm_key };
    Ok((status, [(header::LOCATION, job.job.href.clone())], Json(job)))
}

/// The caller's own name for a request, where one is given.
fn idempotency_key(headers: &HeaderMap) -> Result<Option<String>> {
    let mut given = headers.get_all("idempotency-key").iter();
    let Some(value) = given.next() else { return Ok(None) };
    let key = value.to_str().ok().filter(|key| (1..=255).contains(&key.len()) && !key.trim().is_empty());
    match (key, given.next()) {
        (Some(key), None) => Ok(Some(key.to_owned())),
        _ => Err(Problem::invalid(
            "Idempotency-Key",
            "Idempotency-Key: it must be given once, with 1 to 255 printable ASCII characters",
        )),
    }
}

/// One job, of this run or an earlier one.
#[utoipa::path(
    get, path = "/api/v1/jobs/{id}", operation_id = "get_job", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id")),
    responses(
        (status = 200, body = JobResource),
        FromHistory,
    )
)]
pub(super) async fn get(State(app): State<App>, PathParam(id): PathParam<Uuid>) -> Result<Json<JobResource>> {
    Ok(Json(app.service.find_job(id).await?.into()))
}

/// Cancels a job.
///
/// Returns at once, the job goes to `cancelling`. Asked again, or of a job that has ended, nothing more happens.
#[utoipa::path(
    delete, path = "/api/v1/jobs/{id}", operation_id = "cancel_job", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id"), Asker),
    responses(
        (status = 200, body = JobResource),
        FromHistory,
    )
)]
pub(super) async fn cancel(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    PathParam(id): PathParam<Uuid>,
    asked: Result<Query<Asker>>,
) -> Result<Json<JobResource>> {
    if app.service.job(id).is_ok_and(|job| !job.state.is_final()) {
        app.gate.audit(AuditRecord::of(&principal, "job.cancel", json!({ "job": id })));
    }
    let cancelled = match app.service.cancel(id, Asker::name(asked, &principal).as_deref()) {
        // Of an earlier run, and so over.
        Err(ServiceError::NoSuchJob { .. }) => app.service.find_job(id).await?,
        cancelled => cancelled?,
    };
    Ok(Json(cancelled.into()))
}

/// Makes another confirm key for a job, where one is lost; the one before is dead, and the job goes on.
///
/// For administrators, and for whoever shows the key of the job's lease.
#[utoipa::path(
    post, path = "/api/v1/jobs/{id}/confirm-key", operation_id = "renew_confirm_key", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id"), LeaseKey),
    responses(
        (status = 200, body = ConfirmKeyGrant),
        FromHistory,
        (status = 403, description = "Neither an administrator nor the job's lease", body = Problem,
         content_type = "application/problem+json"),
        (status = 409, description = "The job has ended", body = Problem, content_type = "application/problem+json"),
        (status = 412, description = "The lease's key is of none in force", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn renew_key(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    PathParam(id): PathParam<Uuid>,
    lease: LeaseKey,
) -> Result<Json<ConfirmKeyGrant>> {
    if app.service.job(id).is_err() {
        return Err(of_earlier_run(&app, id).await);
    }
    let may = principal.scope >= Scope::Admin
        || lease.shown().map_or(Ok(false), |key| app.service.is_lease_of_job(id, key))?;
    if !may {
        return Err(Problem::scope(&principal, Scope::Admin));
    }
    let key = app.service.make_confirm_key(id)?;
    app.gate.audit(AuditRecord::of(&principal, "job.confirm_key", json!({ "job": id })));
    Ok(Json(ConfirmKeyGrant { job: id, confirm_key: key.reveal().to_owned() }))
}

/// Why nothing of a job can be confirmed that is none of this run.
async fn of_earlier_run(app: &App, id: Uuid) -> Problem {
    match app.service.find_job(id).await {
        Ok(job) => {
            let why = "it ended in an earlier run of the program".to_owned();
            Refusal::JobState { state: job.state, why }.into()
        }
        Err(error) => error.into(),
    }
}

/// Confirms that the operator has done what the job asks.
///
/// It has to show the key of the lease that the job has, or the job's confirm key. Wrong keys are counted like wrong
/// tokens.
#[utoipa::path(
    post, path = "/api/v1/jobs/{id}/confirm", operation_id = "confirm_step", tag = "jobs", request_body = ConfirmRequest,
    params(("id" = Uuid, Path, description = "The job's id"), ConfirmKeys),
    responses(
        (status = 200, body = JobResource),
        FromHistory,
        Keyed,
        (status = 409, description = "The job does not wait for this, or the camera gives an old picture again", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn confirm(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    PathParam(id): PathParam<Uuid>,
    keys: ConfirmKeys,
    JsonBody(request): JsonBody<ConfirmRequest>,
) -> Result<Json<JobResource>> {
    let confirmed = app.service.confirm(id, request.step, keys.shown()).await;
    answered(&app, &principal, id, confirmed, ("job.confirm", request.step)).await
}

/// Asks for an earlier operator step again, in place of confirming the one that the job waits for.
///
/// The steps that can be asked for are those that `operator_step` names in `repeatable`: the last white frame and the last
/// board in air of an alignment, until the shell is on. The job asks for it, measures anew what depends on it, and goes on;
/// nothing else of it is lost. It has to show what a confirmation shows.
#[utoipa::path(
    post, path = "/api/v1/jobs/{id}/repeat", operation_id = "repeat_step", tag = "jobs", request_body = RepeatRequest,
    params(("id" = Uuid, Path, description = "The job's id"), ConfirmKeys),
    responses(
        (status = 200, body = JobResource),
        FromHistory,
        Keyed,
        (status = 409, description = "The job does not wait where that step can be asked for again", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn repeat(
    State(app): State<App>,
    Extension(principal): Extension<Principal>,
    PathParam(id): PathParam<Uuid>,
    keys: ConfirmKeys,
    JsonBody(request): JsonBody<RepeatRequest>,
) -> Result<Json<JobResource>> {
    let repeated = app.service.repeat(id, request.step, keys.shown());
    answered(&app, &principal, id, repeated, ("job.repeat", request.step)).await
}

/// What became of an answer to an operator step, and of what is kept of it.
async fn answered(
    app: &App,
    principal: &Principal,
    id: Uuid,
    taken: std::result::Result<JobSnapshot, ServiceError>,
    (what, step): (&'static str, u32),
) -> Result<Json<JobResource>> {
    match taken {
        Err(ServiceError::NoSuchJob { .. }) => Err(of_earlier_run(app, id).await),
        Err(ServiceError::Refused(refusal @ Refusal::ConfirmKeyWrong)) => {
            app.gate.wrong_key(principal.address).map_err(Problem::too_many)?;
            Err(refusal.into())
        }
        taken => {
            let job = taken?;
            app.gate.audit(AuditRecord::of(principal, what, json!({ "job": id, "step": step })));
            Ok(Json(job.into()))
        }
    }
}
