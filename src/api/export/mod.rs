//! A job to take away: everything as JSON, its iterations as CSV, a report to print.

mod csv;
pub(crate) mod figures;
mod html;
mod json;
pub(crate) mod outcome;
mod plot;
mod steps;
mod through_focus;

use axum::extract::State;
use axum::http::{HeaderName, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use uuid::Uuid;

use super::App;
use super::contract::FromHistory;
use super::error::Result;
use super::extract::PathParam;
use crate::control::history::read::JobArchive;

pub use csv::csv;
pub use html::html;
pub use json::{JobExport, PictureExport, json};

/// Nothing but what the report brings along.
const REPORT_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// The name of a file of a job: a simulated one says so.
#[must_use]
pub fn file_name(archive: &JobArchive, extension: &str) -> String {
    let simulated = if archive.job.simulated { "SIMULATED-" } else { "" };
    format!("{simulated}plenalign-{}.{extension}", archive.job.id)
}

/// Everything that is kept of a job, as one JSON document.
#[utoipa::path(
    get, path = "/api/v1/jobs/{id}/export.json", operation_id = "export_job_json", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id")),
    responses(
        (status = 200, body = JobExport),
        FromHistory,
    )
)]
pub(super) async fn as_json(State(app): State<App>, PathParam(id): PathParam<Uuid>) -> Result<Response> {
    let archive = app.service.archive(id).await?;
    Ok(file(&archive, "json", "application/json", json(&archive)))
}

/// A job's iterations as CSV (RFC 4180), a line each, the unit in every column's name.
#[utoipa::path(
    get, path = "/api/v1/jobs/{id}/export.csv", operation_id = "export_job_csv", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id")),
    responses(
        (status = 200, body = String, content_type = "text/csv"),
        FromHistory,
    )
)]
pub(super) async fn as_csv(State(app): State<App>, PathParam(id): PathParam<Uuid>) -> Result<Response> {
    let archive = app.service.archive(id).await?;
    Ok(file(&archive, "csv", "text/csv; charset=utf-8", csv(&archive)))
}

/// A job's report, one page with everything in it, to be printed.
#[utoipa::path(
    get, path = "/api/v1/jobs/{id}/report.html", operation_id = "get_job_report", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id")),
    responses(
        (status = 200, body = String, content_type = "text/html"),
        FromHistory,
    )
)]
pub(super) async fn as_html(State(app): State<App>, PathParam(id): PathParam<Uuid>) -> Result<Response> {
    let archive = app.service.archive(id).await?;
    let page = html(&archive);
    let mut response = file(&archive, "html", "text/html; charset=utf-8", page);
    response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(REPORT_POLICY));
    Ok(response)
}

/// A file, under a name of its own.
fn file(archive: &JobArchive, extension: &str, media_type: &'static str, body: String) -> Response {
    let how = if extension == "html" { "inline" } else { "attachment" };
    let disposition = format!("{how}; filename=\"{}\"", file_name(archive, extension));
    let simulated = HeaderValue::from_static(if archive.job.simulated { "true" } else { "false" });
    let mut response = ([(header::CONTENT_TYPE, media_type)], body).into_response();
    let headers = response.headers_mut();
    headers.insert(HeaderName::from_static("plenalign-simulated"), simulated);
    if let Ok(disposition) = HeaderValue::try_from(disposition) {
        headers.insert(header::CONTENT_DISPOSITION, disposition);
    }
    response
}
