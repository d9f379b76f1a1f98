//! The history as callers see it: jobs of this run and of earlier ones as one, and everything kept of a job.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use utoipa::ToSchema;
use uuid::Uuid;

use crate::events::MeasurementView;
use crate::job::{
    JobKind, JobSnapshot, JobState, LogLine, OperatorStep, Progress, Recording, RecordingState, Stage, steps, word,
};
use bench::store::records::{self, Move, Picture};
use bench::store::{JobFilter, Page, Store, StoreError, read};

/// A job in a list.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobSummary {
    /// Identity, a UUID of version 7.
    pub id: Uuid,
    /// What it does.
    pub kind: JobKind,
    /// What it is for, in its caller's words; `null` where nothing was said.
    #[serde(default)]
    pub note: Option<String>,
    /// Who started it; empty where the version that ran it knew no owners.
    #[serde(default)]
    pub owner: String,
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
    pub(crate) fn of(job: &JobSnapshot, iterations: u64) -> Self {
        Self {
            id: job.id,
            kind: job.kind,
            note: job.request.note.clone(),
            owner: job.owner.clone(),
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
    /// In the id, the note, the owner, the reason or a line of the log, whatever the case of its letters.
    pub text: Option<String>,
    /// Older than this job: where the page before has ended.
    pub before: Option<Uuid>,
}

impl JobQuery {
    pub(crate) fn filter(&self, without: Vec<Uuid>) -> JobFilter {
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
    pub(crate) fn fits(&self, job: &JobSnapshot) -> bool {
        let has = |text: &str, words: &str| text.to_ascii_lowercase().contains(words);
        let text = self.text.as_ref().map(|text| text.to_ascii_lowercase());
        (self.states.is_empty() || self.states.contains(&job.state))
            && (self.kinds.is_empty() || self.kinds.contains(&job.kind))
            && self.since.is_none_or(|since| job.created_at >= since)
            && self.until.is_none_or(|until| job.created_at < until)
            && self.before.is_none_or(|before| job.id < before)
            && text.is_none_or(|words| {
                has(&job.id.to_string(), &words)
                    || has(&job.owner, &words)
                    || job.request.note.as_ref().is_some_and(|note| has(note, &words))
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

pub(crate) async fn page(store: &Store, filter: JobFilter, limit: usize) -> Result<Page<JobSummary>, StoreError> {
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
