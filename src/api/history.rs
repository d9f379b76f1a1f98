//! What is kept: the list of jobs, what each has measured, moved and logged, and the audit log.

use std::collections::BTreeMap;

use axum::Json;
use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::App;
use super::error::{Problem, Result};
use super::extract::{PathParam, QueryPairs};
use super::types::job_href;
use crate::control::events::MeasurementView;
use crate::control::history::{JobQuery, JobSummary};
use crate::control::job::{Iteration, LogLine};
use crate::store::records::{Audit, Move};

/// Entries on a page unless another number is asked for.
const LIMIT: usize = 50;
/// Entries on a page at most.
const LIMIT_MOST: usize = 500;

/// A job in a list, and where it is found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobItem {
    /// Path of this job.
    #[schema(example = "/api/v1/jobs/0199f0f2-5d2a-7c3e-9a53-5f0f6c1f6a11")]
    pub href: String,
    /// The job.
    #[serde(flatten)]
    pub job: JobSummary,
}

/// A page of the jobs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobList {
    /// The jobs, newest first.
    pub jobs: Vec<JobItem>,
    /// What to give as `cursor` for the next, older page; `null` on the last one.
    pub next: Option<String>,
    /// Why the jobs of earlier runs are missing; `null` where they are not.
    pub history_fault: Option<String>,
}

/// A job's log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobLog {
    /// What happened, in order.
    pub lines: Vec<LogLine>,
}

/// A job's iterations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobIterations {
    /// What was measured and decided, in order.
    pub iterations: Vec<Iteration>,
}

/// A job's measurements.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobMeasurements {
    /// What was measured, in order.
    pub measurements: Vec<MeasurementView>,
}

/// A job's moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobMoves {
    /// What was moved, in order.
    pub moves: Vec<Move>,
}

/// A page of the audit log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AuditList {
    /// Who did what, newest first.
    pub entries: Vec<Audit>,
    /// What to give as `cursor` for the next, older page; `null` on the last one.
    pub next: Option<String>,
}

/// The pairs of a query, each name one that is known.
pub(super) struct Query(BTreeMap<String, String>);

impl Query {
    pub(super) fn new(pairs: Vec<(String, String)>, known: &[&str]) -> Result<Self> {
        let mut query = BTreeMap::new();
        for (name, value) in pairs {
            if !known.contains(&name.as_str()) {
                let detail = format!("{name}: there is no such parameter; there are {}", known.join(", "));
                return Err(Problem::invalid(&name, detail));
            }
            if query.insert(name.clone(), value).is_some() {
                return Err(Problem::invalid(&name, format!("{name}: it is given twice")));
            }
        }
        Ok(Self(query))
    }

    pub(super) fn read<T>(&self, name: &str, what: &str, read: impl FnOnce(&str) -> Option<T>) -> Result<Option<T>> {
        let Some(text) = self.0.get(name) else { return Ok(None) };
        let wrong = || Problem::invalid(name, format!("{name}: {text:?} is not {what}"));
        read(text).map(Some).ok_or_else(wrong)
    }

    /// Words with commas between them.
    fn words<T: serde::de::DeserializeOwned>(&self, name: &str, what: &str) -> Result<Vec<T>> {
        let read = |text: &str| {
            let one = |word: &str| serde_json::from_value(serde_json::Value::from(word)).ok();
            text.split(',').map(str::trim).map(one).collect()
        };
        Ok(self.read(name, what, read)?.unwrap_or_default())
    }

    fn time(&self, name: &str) -> Result<Option<jiff::Timestamp>> {
        self.read(name, "a time such as 2026-11-22T14:00:00Z", |text| text.parse().ok())
    }

    pub(super) fn limit(&self) -> Result<usize> {
        let what = format!("a number from 1 to {LIMIT_MOST}");
        let read = |text: &str| text.parse().ok().filter(|limit| (1..=LIMIT_MOST).contains(limit));
        Ok(self.read("limit", &what, read)?.unwrap_or(LIMIT))
    }
}

/// The jobs of this run and of earlier ones, newest first, a page at a time.
#[utoipa::path(
    get, path = "/api/v1/jobs", operation_id = "list_jobs", tag = "jobs",
    params(
        ("limit" = Option<u32>, Query, description = "Jobs on the page, 1 to 500", minimum = 1, maximum = 500),
        ("cursor" = Option<String>, Query, description = "`next` of the page before"),
        ("state" = Option<String>, Query, description = "Only these states, with commas between them"),
        ("kind" = Option<String>, Query, description = "Only these kinds, with commas between them"),
        ("since" = Option<String>, Query, description = "Created at this time or later, RFC 3339"),
        ("until" = Option<String>, Query, description = "Created before this time, RFC 3339"),
        ("q" = Option<String>, Query, description = "Words in the id, the reason or a line of the log"),
    ),
    responses(
        (status = 200, body = JobList),
        (status = 422, description = "A parameter does not say what it must; `field` names it", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn jobs(State(app): State<App>, QueryPairs(pairs): QueryPairs) -> Result<Json<JobList>> {
    let query = Query::new(pairs, &["limit", "cursor", "state", "kind", "since", "until", "q"])?;
    let states = "a state, or several with commas between them, such as converged,failed";
    let wanted = JobQuery {
        states: query.words("state", states)?,
        kinds: query.words("kind", "a kind of job, such as joint_alignment, or several with commas between them")?,
        since: query.time("since")?,
        until: query.time("until")?,
        text: query.read("q", "text", |text| Some(text.to_owned()))?.filter(|text| !text.is_empty()),
        before: query.read("cursor", "what `next` of another page says", |text| text.parse().ok())?,
    };
    let (page, history_fault) = app.service.job_page(&wanted, query.limit()?).await;
    let next = page.items.last().filter(|_| page.more).map(|job| job.id.to_string());
    let jobs = page.items.into_iter().map(|job| JobItem { href: job_href(job.id), job }).collect();
    Ok(Json(JobList { jobs, next, history_fault }))
}

/// A job's log.
#[utoipa::path(
    get, path = "/api/v1/jobs/{id}/log", operation_id = "get_job_log", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id")),
    responses(
        (status = 200, body = JobLog),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "The history cannot be read", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn log(State(app): State<App>, PathParam(id): PathParam<Uuid>) -> Result<Json<JobLog>> {
    Ok(Json(JobLog { lines: app.service.find_job(id).await?.log }))
}

/// A job's iterations.
#[utoipa::path(
    get, path = "/api/v1/jobs/{id}/iterations", operation_id = "get_job_iterations", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id")),
    responses(
        (status = 200, body = JobIterations),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "The history cannot be read", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn iterations(State(app): State<App>, PathParam(id): PathParam<Uuid>) -> Result<Json<JobIterations>> {
    Ok(Json(JobIterations { iterations: app.service.find_job(id).await?.iterations }))
}

/// A job's measurements.
#[utoipa::path(
    get, path = "/api/v1/jobs/{id}/measurements", operation_id = "get_job_measurements", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id")),
    responses(
        (status = 200, body = JobMeasurements),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "The history cannot be read", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn measurements(
    State(app): State<App>,
    PathParam(id): PathParam<Uuid>,
) -> Result<Json<JobMeasurements>> {
    Ok(Json(JobMeasurements { measurements: app.service.measurements(id).await? }))
}

/// A job's moves, with their beginnings and ends.
#[utoipa::path(
    get, path = "/api/v1/jobs/{id}/moves", operation_id = "get_job_moves", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id")),
    responses(
        (status = 200, body = JobMoves),
        (status = 404, body = Problem, content_type = "application/problem+json"),
        (status = 503, description = "The history cannot be read", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn moves(State(app): State<App>, PathParam(id): PathParam<Uuid>) -> Result<Json<JobMoves>> {
    Ok(Json(JobMoves { moves: app.service.archive(id).await?.moves }))
}

/// The audit log: who did what, and from where, newest first, a page at a time.
#[utoipa::path(
    get, path = "/api/v1/audit", operation_id = "list_audit", tag = "daemon",
    params(
        ("limit" = Option<u32>, Query, description = "Entries on the page, 1 to 500", minimum = 1, maximum = 500),
        ("cursor" = Option<String>, Query, description = "`next` of the page before"),
    ),
    responses(
        (status = 200, body = AuditList),
        (status = 422, description = "A parameter does not say what it must; `field` names it", body = Problem,
         content_type = "application/problem+json"),
        (status = 503, description = "The history cannot be read", body = Problem,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn audit(State(app): State<App>, QueryPairs(pairs): QueryPairs) -> Result<Json<AuditList>> {
    let query = Query::new(pairs, &["limit", "cursor"])?;
    let before = query.read("cursor", "what `next` of another page says", |text| text.parse().ok())?;
    let page = app.service.audit_page(before, query.limit()?).await?;
    let next = page.items.last().filter(|_| page.more).map(|(number, _)| number.to_string());
    Ok(Json(AuditList { entries: page.items.into_iter().map(|(_, entry)| entry).collect(), next }))
}
