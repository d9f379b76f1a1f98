//! Jobs: start, list, read, confirm an operator step, cancel.

use axum::Json;
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::IntoResponse;
use uuid::Uuid;

use super::App;
use super::error::{Problem, Result};
use super::extract::{JsonBody, LeaseKey, PathParam};
use super::types::{ConfirmRequest, JobList, JobResource};
use crate::control::job::JobRequest;

/// Starts a job.
///
/// A bench does one job at a time: while one is under way another is refused, and the refusal names it. The job holds
/// the control lease that was shown until its end, and needs no heartbeat for it.
#[utoipa::path(
    post, path = "/api/v1/jobs", operation_id = "create_job", tag = "jobs", request_body = JobRequest,
    params(LeaseKey),
    responses(
        (status = 201, body = JobResource, headers(("Location" = String, description = "Path of the job"))),
        (status = 409, description = "Refused now", body = Problem, content_type = "application/problem+json"),
        (status = 412, description = "The lease's key is not the holder's", body = Problem,
         content_type = "application/problem+json"),
        (status = 428, description = "No lease was shown", body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "Shutting down", body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn create(
    State(app): State<App>,
    key: LeaseKey,
    JsonBody(request): JsonBody<JobRequest>,
) -> Result<impl IntoResponse> {
    let job = JobResource::from(app.service.create_job(&app.permit(&key)?, request)?);
    Ok((StatusCode::CREATED, [(header::LOCATION, job.href.clone())], Json(job)))
}

/// Every job since the program started.
#[utoipa::path(get, path = "/api/v1/jobs", operation_id = "list_jobs", tag = "jobs", responses((status = 200, body = JobList)))]
pub(super) async fn list(State(app): State<App>) -> Json<JobList> {
    Json(JobList { jobs: app.jobs() })
}

/// One job.
#[utoipa::path(
    get, path = "/api/v1/jobs/{id}", operation_id = "get_job", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id")),
    responses(
        (status = 200, body = JobResource),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn get(State(app): State<App>, PathParam(id): PathParam<Uuid>) -> Result<Json<JobResource>> {
    Ok(Json(app.service.job(id)?.into()))
}

/// Cancels a job.
///
/// Returns at once, the job goes to `cancelling`. Asked again, or of a job that has ended, nothing more happens.
#[utoipa::path(
    delete, path = "/api/v1/jobs/{id}", operation_id = "cancel_job", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id")),
    responses(
        (status = 200, body = JobResource),
        (status = 404, body = Problem, content_type = "application/problem+json"),
    )
)]
pub(super) async fn cancel(State(app): State<App>, PathParam(id): PathParam<Uuid>) -> Result<Json<JobResource>> {
    Ok(Json(app.service.cancel(id)?.into()))
}

/// Confirms that the operator has done what the job asks.
#[utoipa::path(
    post, path = "/api/v1/jobs/{id}/confirm", operation_id = "confirm_step", tag = "jobs", request_body = ConfirmRequest,
    params(("id" = Uuid, Path, description = "The job's id")),
    responses(
        (status = 200, body = JobResource),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 409, description = "The job does not wait for this", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn confirm(
    State(app): State<App>,
    PathParam(id): PathParam<Uuid>,
    JsonBody(request): JsonBody<ConfirmRequest>,
) -> Result<Json<JobResource>> {
    Ok(Json(app.service.confirm(id, request.step)?.into()))
}
