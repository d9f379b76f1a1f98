//! What is kept: the list of jobs, what each has measured, moved and logged, and the audit log.

use axum::Json;
use axum::extract::State;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

use crate::api::App;
use crate::api::contract::FromHistory;
use crate::api::error::Result;
use crate::api::extract::{PathParam, Query};
use crate::api::types::job_href;
use crate::control::events::MeasurementView;
use crate::control::history::read::{JobQuery, JobSummary};
use crate::control::job::{Iteration, JobKind, JobState, LogLine};
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

/// Which jobs are wanted.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(in crate::api) struct JobsAsked {
    /// Jobs on the page, 1 to 500.
    #[param(value_type = Option<u32>, minimum = 1, maximum = 500, default = 50)]
    #[serde(default)]
    limit: Limit,
    /// `next` of the page before.
    cursor: Option<Uuid>,
    /// Only these states, with commas between them.
    #[param(value_type = Option<Vec<JobState>>, style = Form, explode = false)]
    #[serde(default)]
    state: Words<JobState>,
    /// Only these kinds, with commas between them.
    #[param(value_type = Option<Vec<JobKind>>, style = Form, explode = false)]
    #[serde(default)]
    kind: Words<JobKind>,
    /// Created at this time or later, RFC 3339.
    #[param(value_type = Option<String>, format = DateTime)]
    since: Option<jiff::Timestamp>,
    /// Created before this time, RFC 3339.
    #[param(value_type = Option<String>, format = DateTime)]
    until: Option<jiff::Timestamp>,
    /// Words in the id, the note, the owner, the reason or a line of the log.
    q: Option<String>,
}

/// Which page of a numbered list is wanted.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub(in crate::api) struct PageAsked {
    /// Entries on the page, 1 to 500.
    #[param(value_type = Option<u32>, minimum = 1, maximum = 500, default = 50)]
    #[serde(default)]
    pub(in crate::api) limit: Limit,
    /// `next` of the page before.
    #[param(value_type = Option<String>, pattern = "^[0-9]{1,18}$")]
    pub(in crate::api) cursor: Option<Number>,
}

/// A whole number in digits.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(try_from = "String")]
pub(in crate::api) struct Number(pub(in crate::api) i64);

impl TryFrom<String> for Number {
    type Error = String;

    fn try_from(text: String) -> std::result::Result<Self, String> {
        let digits = text.len() <= 18 && text.bytes().all(|byte| byte.is_ascii_digit());
        text.parse().ok().filter(|_| digits).map(Self).ok_or_else(|| format!("{text:?} is not what `next` says"))
    }
}

/// Entries on a page.
#[derive(Debug, Deserialize)]
#[serde(try_from = "usize")]
pub(in crate::api) struct Limit(pub(in crate::api) usize);

impl Default for Limit {
    fn default() -> Self {
        Self(LIMIT)
    }
}

impl TryFrom<usize> for Limit {
    type Error = String;

    fn try_from(limit: usize) -> std::result::Result<Self, String> {
        let allowed = (1..=LIMIT_MOST).contains(&limit);
        allowed.then_some(Self(limit)).ok_or_else(|| format!("{limit} is not a number from 1 to {LIMIT_MOST}"))
    }
}

/// Words with commas between them; none where there is nothing.
#[derive(Debug, Deserialize)]
#[serde(try_from = "String", bound = "T: DeserializeOwned")]
struct Words<T>(Vec<T>);

impl<T> Default for Words<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: DeserializeOwned> TryFrom<String> for Words<T> {
    type Error = String;

    fn try_from(text: String) -> std::result::Result<Self, String> {
        let one = |word: &str| serde_json::from_value(word.trim().into()).map_err(|error| error.to_string());
        text.split(',').filter(|_| !text.is_empty()).map(one).collect::<std::result::Result<_, _>>().map(Self)
    }
}

/// The jobs of this run and of earlier ones, newest first, a page at a time.
#[utoipa::path(
    get, path = "/api/v1/jobs", operation_id = "list_jobs", tag = "jobs",
    params(JobsAsked), responses((status = 200, body = JobList))
)]
pub(in crate::api) async fn jobs(State(app): State<App>, Query(asked): Query<JobsAsked>) -> Result<Json<JobList>> {
    let JobsAsked { limit, cursor, state, kind, since, until, q } = asked;
    let text = q.filter(|text| !text.is_empty());
    let wanted = JobQuery { states: state.0, kinds: kind.0, since, until, text, before: cursor };
    let (page, history_fault) = app.service.job_page(&wanted, limit.0).await;
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
        FromHistory,
    )
)]
pub(in crate::api) async fn log(State(app): State<App>, PathParam(id): PathParam<Uuid>) -> Result<Json<JobLog>> {
    Ok(Json(JobLog { lines: app.service.find_job(id).await?.log }))
}

/// A job's iterations.
#[utoipa::path(
    get, path = "/api/v1/jobs/{id}/iterations", operation_id = "get_job_iterations", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id")),
    responses(
        (status = 200, body = JobIterations),
        FromHistory,
    )
)]
pub(in crate::api) async fn iterations(
    State(app): State<App>,
    PathParam(id): PathParam<Uuid>,
) -> Result<Json<JobIterations>> {
    Ok(Json(JobIterations { iterations: app.service.find_job(id).await?.iterations }))
}

/// A job's measurements.
#[utoipa::path(
    get, path = "/api/v1/jobs/{id}/measurements", operation_id = "get_job_measurements", tag = "jobs",
    params(("id" = Uuid, Path, description = "The job's id")),
    responses(
        (status = 200, body = JobMeasurements),
        FromHistory,
    )
)]
pub(in crate::api) async fn measurements(
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
        FromHistory,
    )
)]
pub(in crate::api) async fn moves(State(app): State<App>, PathParam(id): PathParam<Uuid>) -> Result<Json<JobMoves>> {
    Ok(Json(JobMoves { moves: app.service.archive(id).await?.moves }))
}

/// The audit log: who did what, and from where, newest first, a page at a time.
#[utoipa::path(
    get, path = "/api/v1/audit", operation_id = "list_audit", tag = "daemon",
    params(PageAsked), responses((status = 200, body = AuditList), FromHistory)
)]
pub(in crate::api) async fn audit(State(app): State<App>, Query(asked): Query<PageAsked>) -> Result<Json<AuditList>> {
    let page = app.service.audit_page(asked.cursor.map(|Number(number)| number), asked.limit.0).await?;
    let next = page.items.last().filter(|_| page.more).map(|(number, _)| number.to_string());
    Ok(Json(AuditList { entries: page.items.into_iter().map(|(_, entry)| entry).collect(), next }))
}
