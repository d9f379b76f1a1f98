//! What is kept, as plain data. Documents are JSON of the layers above, which this one does not look into.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;
use uuid::Uuid;

/// One run of the program on a bench.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Identity.
    pub id: Uuid,
    /// The bench's name: one run at a time has it.
    pub bench: String,
    /// The program's version.
    pub version: String,
    /// The configuration in force, as TOML.
    pub configuration: String,
    /// When it began.
    pub started_at: Timestamp,
}

/// A job, without what it has measured and logged.
#[derive(Debug, Clone, PartialEq)]
pub struct Job {
    /// Identity, a UUID of version 7: in the order of creation.
    pub id: Uuid,
    /// The run that it belongs to.
    pub run: Uuid,
    /// What it does, in a word.
    pub kind: String,
    /// Where it is in its life, in a word.
    pub state: String,
    /// Whether its bench is simulated.
    pub simulated: bool,
    /// Grows with every change.
    pub generation: u64,
    /// When it was accepted.
    pub created_at: Timestamp,
    /// When it ended; `None` until then.
    pub ended_at: Option<Timestamp>,
    /// Why it ended as it did.
    pub reason: Option<String>,
    /// What was asked for.
    pub request: Value,
    /// The caller's own name for the request.
    pub idempotency_key: Option<String>,
    /// Everything else.
    pub document: Value,
}

/// An iteration, a measurement or the like: when, and what.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Counted from 1 within the job.
    pub number: u64,
    /// When.
    pub at: Timestamp,
    /// What.
    pub document: Value,
}

/// A line of a job's log.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// Counted from 1 within the job.
    pub number: u64,
    /// When.
    pub at: Timestamp,
    /// What happened.
    pub message: String,
}

/// A motion of one axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Move {
    /// Identity.
    pub id: Uuid,
    /// The job that commanded it; `null` for a motion by hand.
    pub job: Option<Uuid>,
    /// Which axis.
    pub axis: String,
    /// `move`, `home`, `jog`, `release` or `leave switch`.
    pub what: String,
    /// Where it began, mm; `null` while unknown.
    pub from_mm: Option<f64>,
    /// Where it was to end, mm; `null` for a motion without a target.
    pub to_mm: Option<f64>,
    /// When it was commanded, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub started_at: Timestamp,
    /// When it was over, RFC 3339; `null` until then, and where the program ended first.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub ended_at: Option<Timestamp>,
    /// Readback at its end, mm; `null` where unknown.
    pub end_mm: Option<f64>,
    /// `done`, or why it did not end as commanded; `interrupted` where the program ended first; `null` until then.
    pub outcome: Option<String>,
}

/// What an operator was asked to do.
#[derive(Debug, Clone, PartialEq)]
pub struct OperatorStep {
    /// Number of the step within its job.
    pub number: u32,
    /// The step.
    pub document: Value,
    /// When it was asked for.
    pub asked_at: Timestamp,
    /// When it was confirmed; `None` until then.
    pub confirmed_at: Option<Timestamp>,
}

/// A picture kept with a job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Which one, e.g. `before`.
    pub name: String,
    /// When it was taken.
    pub at: Timestamp,
    /// Its media type, e.g. `image/jpeg`.
    pub media_type: String,
    /// The file.
    pub bytes: Vec<u8>,
}

/// Who did what, and from where.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Audit {
    /// When, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub at: Timestamp,
    /// Name of whoever did it.
    pub who: String,
    /// What was done, e.g. `job.create`.
    pub what: String,
    /// The particulars.
    #[schema(value_type = Object)]
    pub detail: Value,
    /// Address that it was asked from.
    pub from: Option<String>,
}

/// A value kept for a bench beyond a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Kept {
    /// The bench's name.
    pub bench: String,
    /// Its key.
    pub key: String,
    /// The value.
    pub value: Value,
}
