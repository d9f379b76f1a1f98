//! The history as callers see it: jobs of this run and of earlier ones as one, and everything kept of a job.

pub(crate) mod journal;

use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use utoipa::ToSchema;
use uuid::Uuid;

use super::events::MeasurementView;
use super::job::{Iteration, JobKind, JobRequest, JobSnapshot, JobState, LogLine, OperatorStep, Progress, Stage};
use super::plan::PlanView;
use super::recording::{Recording, RecordingState};
use super::refusal::{Refusal, ServiceError};
use super::service::Service;
use crate::history::journal::word;
use crate::job::steps;
use crate::measuring::measurement::SingleMeasurement;
use bench::access::{AuditRecord, AuditSink, LogAudit};
use bench::store::records::{self, Audit, Move, Picture};
use bench::store::{JobFilter, Page, Store, StoreError, read};

/// How long a caller's own name for a request stands for it.
const KEY_HOLDS: Duration = Duration::from_hours(24);

/// Jobs of a kind that are looked at for how long one takes, and how many of the same request count.
const TIMES_LOOKED_AT: usize = 50;
const TIMES_COUNTED: usize = 5;

/// A job in a list.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobSummary {
    /// Identity, a UUID of version 7.
    pub id: Uuid,
    /// What it does.
    pub kind: JobKind,
    /// Where it is in its life.
    pub state: JobState,
    /// Part of the alignment it is in.
    pub stage: Stage,
    /// Whether the bench is simulated.
    pub simulated: bool,
    /// Grows with every change of the job.
    pub generation: u64,
    /// When it was accepted, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub created_at: Timestamp,
    /// When it ended, RFC 3339.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub ended_at: Option<Timestamp>,
    /// How far it is.
    pub progress: Progress,
    /// How many iterations it has.
    pub iterations: u64,
    /// Why it ended as it did, in words, once it has.
    pub reason: Option<String>,
    /// Its recording; `null` where it is not recorded.
    #[serde(default)]
    pub recording: Option<Recording>,
}

impl JobSummary {
    fn of(job: &JobSnapshot, iterations: u64) -> Self {
        Self {
            id: job.id,
            kind: job.kind,
            state: job.state,
            stage: job.stage,
            simulated: job.simulated,
            generation: job.generation,
            created_at: job.created_at,
            ended_at: job.ended_at,
            progress: job.progress.clone(),
            iterations,
            reason: job.reason.clone(),
            recording: job.recording.clone(),
        }
    }
}

/// Which jobs are wanted: every one that fits all that is given.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct JobQuery {
    /// States; any where empty.
    pub states: Vec<JobState>,
    /// Kinds; any where empty.
    pub kinds: Vec<JobKind>,
    /// Created at this time or later.
    pub since: Option<Timestamp>,
    /// Created before this time.
    pub until: Option<Timestamp>,
    /// In the id, the reason or a line of the log, whatever the case of its letters.
    pub text: Option<String>,
    /// Older than this job: where the page before has ended.
    pub before: Option<Uuid>,
}

impl JobQuery {
    fn filter(&self, without: Vec<Uuid>) -> JobFilter {
        JobFilter {
            states: self.states.iter().map(JobState::to_string).collect(),
            kinds: self.kinds.iter().map(word).collect(),
            since: self.since,
            until: self.until,
            text: self.text.clone(),
            before: self.before,
            without,
        }
    }

    /// Whether a job in memory fits: the same as the history's own query.
    fn fits(&self, job: &JobSnapshot) -> bool {
        let has = |text: &str, words: &str| text.to_ascii_lowercase().contains(words);
        let text = self.text.as_ref().map(|text| text.to_ascii_lowercase());
        (self.states.is_empty() || self.states.contains(&job.state))
            && (self.kinds.is_empty() || self.kinds.contains(&job.kind))
            && self.since.is_none_or(|since| job.created_at >= since)
            && self.until.is_none_or(|until| job.created_at < until)
            && self.before.is_none_or(|before| job.id < before)
            && text.is_none_or(|words| {
                has(&job.id.to_string(), &words)
                    || job.reason.as_ref().is_some_and(|reason| has(reason, &words))
                    || job.log.iter().any(|line| has(&line.message, &words))
            })
    }
}

/// What an operator was asked to do, and when.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AskedStep {
    /// The step.
    #[serde(flatten)]
    pub step: OperatorStep,
    /// When it was asked for, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub asked_at: Timestamp,
    /// When it was confirmed, RFC 3339; `null` until then.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub confirmed_at: Option<Timestamp>,
}

/// The run of the program that a job belongs to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RunView {
    /// Identity.
    pub id: Uuid,
    /// The program's version.
    pub version: String,
    /// The bench's name.
    pub bench: String,
    /// When it began, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub started_at: Timestamp,
    /// The configuration in force, as TOML.
    pub configuration: String,
}

/// Everything that is kept of a job.
#[derive(Debug, Clone, PartialEq)]
pub struct JobArchive {
    /// The job.
    pub job: JobSnapshot,
    /// What was asked for.
    pub request: Value,
    /// The run of the program that it belongs to.
    pub run: Option<RunView>,
    /// What was measured, in order.
    pub measurements: Vec<MeasurementView>,
    /// What was moved, in order.
    pub moves: Vec<Move>,
    /// What the operator was asked to do, in order.
    pub operator_steps: Vec<AskedStep>,
    /// The pictures kept with it.
    pub pictures: Vec<Picture>,
}

/// A job as the history has it, as a job is.
fn snapshot(job: records::Job, iterations: Vec<Value>, log: Vec<LogLine>) -> Result<JobSnapshot, StoreError> {
    let id = job.id;
    let mut document = job.document;
    let mut say = |key: &str, value: Value| {
        if let Some(object) = document.as_object_mut() {
            object.insert(key.to_owned(), value);
        }
    };
    // The columns are what an interruption has changed.
    if job.ended_at.is_some() {
        say("operator_step", Value::Null);
    }
    say("request", job.request);
    say("state", json!(job.state));
    say("generation", json!(job.generation));
    say("ended_at", json!(job.ended_at));
    say("reason", json!(job.reason));
    say("iterations", json!(iterations));
    say("log", json!(log));
    let mut job: JobSnapshot = serde_json::from_value(document).map_err(|error| {
        StoreError::Unusable(format!("job {id} was written by another version of plenalign: {error}"))
    })?;
    // An iteration is written when it is measured, and not again.
    steps::discard(&mut job.iterations, &job.steps);
    // Nobody was left to close the file.
    if let (JobState::Interrupted, Some(recording)) = (job.state, &mut job.recording)
        && recording.state == RecordingState::Recording
    {
        recording.state = RecordingState::Failed;
        recording.fault = Some("the program ended before the recording did; what it has can be read".to_owned());
    }
    Ok(job)
}

fn lines(log: Vec<records::Line>) -> Vec<LogLine> {
    log.into_iter().map(|line| LogLine { at: line.at, message: line.message }).collect()
}

fn decode<T: serde::de::DeserializeOwned>(documents: impl Iterator<Item = Value>) -> Result<Vec<T>, StoreError> {
    let decoded: Result<Vec<T>, _> = documents.map(serde_json::from_value).collect();
    decoded.map_err(|error| StoreError::Unusable(format!("a record of another version of plenalign: {error}")))
}

/// A page of the jobs in a history, newest first.
///
/// # Errors
/// When the history cannot be read.
pub async fn jobs(store: &Store, query: &JobQuery, limit: usize) -> Result<Page<JobSummary>, StoreError> {
    page(store, query.filter(Vec::new()), limit).await
}

async fn page(store: &Store, filter: JobFilter, limit: usize) -> Result<Page<JobSummary>, StoreError> {
    let found = store.read(move |connection| read::jobs(connection, &filter, limit)).await?;
    let mut items = Vec::with_capacity(found.items.len());
    for (job, iterations) in found.items {
        match snapshot(job, Vec::new(), Vec::new()) {
            Ok(job) => items.push(JobSummary::of(&job, iterations)),
            // One that this version does not know must not hide the others.
            Err(error) => tracing::warn!(%error, "a job is left out of the list"),
        }
    }
    Ok(Page { items, more: found.more })
}

/// A job in a history; `None` where there is none of this id.
///
/// # Errors
/// When the history cannot be read.
pub async fn job(store: &Store, id: Uuid) -> Result<Option<JobSnapshot>, StoreError> {
    let found = store
        .read(move |connection| {
            let Some(job) = read::find_job(connection, id)? else { return Ok(None) };
            Ok(Some((job, read::iterations(connection, id)?, read::log(connection, id)?)))
        })
        .await?;
    let whole = |(job, iterations, log): (_, Vec<records::Entry>, _)| {
        snapshot(job, iterations.into_iter().map(|entry| entry.document).collect(), lines(log))
    };
    found.map(whole).transpose()
}

/// A job's measurements in a history, in order.
///
/// # Errors
/// When the history cannot be read.
pub async fn measurements(store: &Store, id: Uuid) -> Result<Vec<MeasurementView>, StoreError> {
    let found = store.read(move |connection| read::measurements(connection, id)).await?;
    decode(found.into_iter().map(|entry| entry.document))
}

/// Everything that a history keeps of a job; `None` where there is none of this id.
///
/// # Errors
/// When the history cannot be read.
pub async fn archive(store: &Store, id: Uuid) -> Result<Option<JobArchive>, StoreError> {
    let Some(job) = job(store, id).await? else { return Ok(None) };
    let found = store.read(move |connection| {
        let Some(record) = read::find_job(connection, id)? else { return Ok(None) };
        let run = read::find_run(connection, record.run)?;
        let (moves, steps) = (read::moves(connection, id)?, read::operator_steps(connection, id)?);
        Ok(Some((record.request, run, moves, steps, read::pictures(connection, id)?)))
    });
    let Some((request, run, moves, steps, pictures)) = found.await? else { return Ok(None) };
    let operator_steps = steps
        .into_iter()
        .map(|step| {
            let asked = serde_json::from_value(step.document)
                .map_err(|error| StoreError::Unusable(format!("an operator step of another version: {error}")))?;
            Ok(AskedStep { step: asked, asked_at: step.asked_at, confirmed_at: step.confirmed_at })
        })
        .collect::<Result<_, StoreError>>()?;
    let run = run.map(|run| RunView {
        id: run.id,
        version: run.version,
        bench: run.bench,
        started_at: run.started_at,
        configuration: run.configuration,
    });
    let measurements = measurements(store, id).await?;
    Ok(Some(JobArchive { job, request, run, measurements, moves, operator_steps, pictures }))
}

fn unreadable(error: StoreError) -> ServiceError {
    ServiceError::Unreadable { why: error.to_string() }
}

impl Service {
    /// A page of all jobs, newest first: those in memory as they are now, the others as the history has them. Where the
    /// history cannot be read, those in memory, and why.
    pub async fn job_page(&self, query: &JobQuery, limit: usize) -> (Page<JobSummary>, Option<String>) {
        let memory = self.jobs();
        let ids = memory.iter().map(|job| job.id).collect();
        let (kept, fault) = match page(self.journal.store(), query.filter(ids), limit).await {
            Ok(page) => (page, None),
            Err(error) => (Page { items: Vec::new(), more: false }, Some(error.to_string())),
        };
        let fitting = memory.iter().filter(|job| query.fits(job));
        let mut items: Vec<JobSummary> =
            fitting.map(|job| JobSummary::of(job, job.iterations.len() as u64)).chain(kept.items).collect();
        items.sort_by_key(|job| std::cmp::Reverse(job.id));
        let more = kept.more || items.len() > limit;
        items.truncate(limit);
        (Page { items, more }, fault)
    }

    /// A job of this run or an earlier one.
    ///
    /// # Errors
    /// [`ServiceError::NoSuchJob`], or when the history cannot be read.
    pub async fn find_job(&self, id: Uuid) -> Result<JobSnapshot, ServiceError> {
        match self.job(id) {
            Ok(job) => Ok(job),
            Err(_) => job(self.journal.store(), id).await.map_err(unreadable)?.ok_or(ServiceError::NoSuchJob { id }),
        }
    }

    /// A job's iterations, in order.
    ///
    /// # Errors
    /// As [`Service::find_job`].
    pub async fn iterations(&self, id: Uuid) -> Result<Vec<Iteration>, ServiceError> {
        Ok(self.find_job(id).await?.iterations)
    }

    /// A job's measurements, in order.
    ///
    /// # Errors
    /// As [`Service::find_job`].
    pub async fn measurements(&self, id: Uuid) -> Result<Vec<MeasurementView>, ServiceError> {
        self.find_job(id).await?;
        measurements(self.journal.store(), id).await.map_err(unreadable)
    }

    /// A page of the measurements that belong to no job, newest first, each with its number; `before` is where the page
    /// before has ended. Those that a version of other documents has written are left out.
    ///
    /// # Errors
    /// When the history cannot be read.
    pub async fn measurements_alone(
        &self,
        before: Option<u64>,
        limit: usize,
    ) -> Result<Page<(u64, SingleMeasurement)>, ServiceError> {
        let read = move |connection: &_| read::measurements_alone(connection, before, limit);
        let found = self.journal.store().read(read).await.map_err(unreadable)?;
        let known = |entry: records::Entry| match serde_json::from_value(entry.document) {
            Ok(measured) => Some((entry.number, measured)),
            Err(error) => {
                tracing::warn!(%error, number = entry.number, "a measurement is left out of the list");
                None
            }
        };
        Ok(Page { items: found.items.into_iter().filter_map(known).collect(), more: found.more })
    }

    /// Everything that is kept of a job.
    ///
    /// # Errors
    /// As [`Service::find_job`].
    pub async fn archive(&self, id: Uuid) -> Result<JobArchive, ServiceError> {
        let found = archive(self.journal.store(), id).await.map_err(unreadable)?;
        let mut archive = found.ok_or(ServiceError::NoSuchJob { id })?;
        // What is in memory is newer.
        if let Ok(job) = self.job(id) {
            archive.job = job;
        }
        Ok(archive)
    }

    /// How long this bench takes by itself for what is asked for, s: the median of the newest such jobs that came to their
    /// end. `None` where there is none.
    pub(super) async fn usual_time_s(&self, request: &JobRequest) -> Option<f64> {
        let (bench, kind) = (self.journal.bench().clone(), word(&request.kind));
        let find = move |connection: &_| read::own_times(connection, &bench, &kind, TIMES_LOOKED_AT);
        let found = self.journal.store().read(find).await;
        let found = found.inspect_err(|error| tracing::warn!(%error, "how long a job takes is not known")).ok()?;
        // What it is for, and whether it is recorded, takes no time.
        let essence = |request: JobRequest| JobRequest { note: None, record: None, ..request };
        let wanted = essence(request.clone());
        let same = |of: Value| serde_json::from_value(of).is_ok_and(|of| essence(of) == wanted);
        let mut times: Vec<f64> =
            found.into_iter().filter_map(|(of, time_s)| same(of).then_some(time_s)).take(TIMES_COUNTED).collect();
        times.sort_unstable_by(f64::total_cmp);
        times.get(times.len() / 2).copied()
    }

    /// A plan for the configuration in force, each of its jobs as long as this bench has usually taken for it.
    pub async fn as_it_usually_took(&self, mut plan: PlanView) -> PlanView {
        let usual = async |kind, worked_out_s| self.usual_time_s(&JobRequest::of(kind)).await.unwrap_or(worked_out_s);
        plan.duration_s = usual(JobKind::JointAlignment, plan.duration_s).await;
        for part in &mut plan.parts {
            part.duration_s = usual(part.kind, part.duration_s).await;
        }
        plan
    }

    /// The job that the caller's own name for a request stands for.
    pub(super) async fn job_of_key(
        &self,
        request: &JobRequest,
        key: &str,
    ) -> Result<Option<JobSnapshot>, ServiceError> {
        let since = Timestamp::now() - KEY_HOLDS;
        let same = |job: Uuid, before: &JobRequest| {
            if before == request { Ok(()) } else { Err(Refusal::KeyReused { key: key.to_owned(), job }) }
        };
        let memory = self.all_jobs().iter().rev().find(|job| job.key() == Some(key)).cloned();
        if let Some(job) = memory {
            let found = job.snapshot();
            if found.created_at >= since {
                same(found.id, &found.request)?;
                return Ok(Some(found));
            }
        }
        self.history_ready().await?;
        let (bench, key_asked) = (self.journal.bench().clone(), key.to_owned());
        let find = move |connection: &_| read::find_key(connection, &bench, &key_asked, since);
        let kept = self.journal.store().read(find).await;
        // Nothing is begun twice because the history could not be asked.
        let Some(found) = kept.map_err(unreadable)? else { return Ok(None) };
        // What another version asked for is another request.
        match serde_json::from_value(found.request) {
            Ok(before) => same(found.id, &before)?,
            Err(_) => return Err(Refusal::KeyReused { key: key.to_owned(), job: found.id }.into()),
        }
        self.find_job(found.id).await.map(Some)
    }

    /// A page of the audit log, newest first, each entry with its number; `before` is where the page before has ended.
    ///
    /// # Errors
    /// When the history cannot be read.
    pub async fn audit_page(&self, before: Option<i64>, limit: usize) -> Result<Page<(i64, Audit)>, ServiceError> {
        let found = self.journal.store().read(move |connection| read::audit(connection, before, limit)).await;
        found.map_err(unreadable)
    }

    /// Adds to the audit log, without waiting.
    pub fn audit(&self, audit: Audit) {
        self.journal.audit(audit);
    }
}

/// The audit log of a service's history, beside the program's own log.
pub struct HistoryAudit(pub Arc<Service>);

impl AuditSink for HistoryAudit {
    fn record(&self, record: AuditRecord) {
        LogAudit.record(record.clone());
        let AuditRecord { at, who, what, detail, from } = record;
        let from = from.map(|address| address.to_string());
        self.0.audit(Audit { at, who, what: what.to_owned(), detail, from });
    }
}

#[cfg(test)]
mod tests;
