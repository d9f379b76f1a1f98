//! Recordings of jobs: what a job sees, measures, decides and is answered, as it happens, for a file or for a comparison.
//!
//! A recording never disturbs its job: what is recorded is handed to a thread of its own through a bounded queue, and
//! where the disk is full or too slow the recording ends with what it has, and the job goes on and says so.

mod file;
mod start;
pub mod words;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use super::events::{FieldMap, MeasurementView};
use super::job::{Iteration, JobState, LogLine, Report};
use super::service::Service;
use crate::history::journal::word;
use crate::job::context::Job;
use crate::job::outcome::Outcome;
use crate::job::request::{JobKind, JobRequest};
use bench::config::{Config, RecordJobs};
use bench::device::{AxisName, DeviceError, Frame, StageState};
use bench::record::messages::{JobStart, MeterReading};
use plenoptics::units::Millimetres;

pub(super) use file::FileSink;

/// Folder of recordings within the state folder, where none is configured.
const FOLDER: &str = "recordings";

/// How a recording fares.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RecordingState {
    /// It is being written.
    Recording,
    /// It is whole.
    Complete,
    /// It ended before its job did, or with the program; what it has can be read.
    Failed,
}

/// A job's recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Recording {
    /// The file's name in the folder of recordings; its path where it was asked for elsewhere.
    pub file: String,
    /// How it fares.
    pub state: RecordingState,
    /// How long the file is, bytes; `null` until it is whole.
    #[serde(default)]
    pub bytes: Option<u64>,
    /// Why it is not whole, in words.
    #[serde(default)]
    pub fault: Option<String>,
}

/// What is recorded of a job.
#[derive(Debug, Clone)]
pub(super) enum Happening {
    /// What it begins with: the first.
    Start(Box<JobStart>),
    /// A frame that is measured.
    Frame(Arc<Frame>),
    /// What a device answered.
    Answer(Answer),
    /// In place of confirming `step` the operator asked for an earlier one again.
    Again {
        /// Number of the step that waited.
        step: u32,
        /// Number of the earlier one.
        again: u32,
    },
    /// What was measured.
    Measured(Box<MeasurementView>, Option<Arc<FieldMap>>),
    /// What the meter read.
    Read(Box<MeterReading>),
    /// What was decided.
    Decided(Box<Iteration>),
    /// What was said.
    Logged(LogLine),
    /// A JPEG kept with the job.
    Picture(Arc<Vec<u8>>),
    /// How it ended: the last.
    End(Box<End>),
}

/// What a device answered to a job.
#[derive(Debug, Clone)]
pub(super) struct Answer {
    /// The axis; none for the camera.
    pub(super) axis: Option<AxisName>,
    /// What it was asked.
    pub(super) asked: &'static str,
    /// Where an axis was sent.
    pub(super) target: Option<Millimetres>,
    /// Where it said that it stands after that.
    pub(super) readback: Option<Millimetres>,
    /// An axis's state after that.
    pub(super) state: Option<StageState>,
    /// Why it was not done.
    pub(super) error: Option<DeviceError>,
}

impl Answer {
    /// A camera's that gave no frame.
    pub(super) const fn no_frame(error: DeviceError) -> Self {
        Self { axis: None, asked: "frame", target: None, readback: None, state: None, error: Some(error) }
    }
}

/// How a job ended.
#[derive(Debug, Clone)]
pub(super) struct End {
    pub(super) state: JobState,
    pub(super) reason: String,
    pub(super) report: Option<Report>,
    pub(super) outcome: Option<Outcome>,
}

/// Takes what is recorded. Never waits.
pub(super) trait Sink: Send + Sync {
    /// Takes it in.
    fn take(&self, happening: Happening);
}

/// Where a job's recording is to be written.
#[derive(Debug, Clone)]
pub(super) struct Place {
    /// The file.
    pub(super) path: PathBuf,
    /// How the job's JSON names it.
    pub(super) name: String,
}

/// The folder of recordings; none where neither the configuration nor the history has one.
fn folder(config: &Config, history: Option<&Path>) -> Option<PathBuf> {
    let configured = &config.record.folder;
    if configured.as_os_str().is_empty() {
        return history.and_then(Path::parent).map(|state| state.join(FOLDER));
    }
    Some(configured.clone())
}

/// The name of a job's recording: a simulated one says so.
fn file_name(id: Uuid, kind: JobKind, simulated: bool) -> String {
    let simulated = if simulated { "SIMULATED-" } else { "" };
    format!("{simulated}{}-{id}.{}", word(&kind), bench::record::ENDING)
}

/// Whether a job is to be recorded.
fn is_wanted(config: &Config, request: &JobRequest) -> bool {
    request.record.unwrap_or(config.record.jobs == RecordJobs::All)
}

impl Service {
    /// Where a job that has been accepted is recorded; `None` where it is not. `path` is where its caller wants it.
    pub(super) fn place_of(&self, job: &Job, path: Option<PathBuf>) -> Option<Result<Place, String>> {
        let snapshot = job.snapshot();
        if let Some(path) = path {
            return Some(Ok(Place { name: path.display().to_string(), path }));
        }
        if !is_wanted(&self.config, &snapshot.request) {
            return None;
        }
        let name = file_name(snapshot.id, snapshot.kind, snapshot.simulated);
        let folder = folder(&self.config, self.journal.store().path().map(PathBuf::as_path));
        Some(match folder {
            Some(folder) => Ok(Place { path: folder.join(&name), name }),
            None => Err("there is no folder for recordings: set record.folder".to_owned()),
        })
    }

    /// The file of a job's recording in the folder of recordings.
    ///
    /// # Errors
    /// Why there is none, in words.
    pub fn recording_file(&self, recording: &Recording) -> Result<PathBuf, String> {
        if recording.file.contains('/') {
            return Err(format!("it was asked for elsewhere, at {}", recording.file));
        }
        folder(&self.config, self.journal.store().path().map(PathBuf::as_path))
            .map(|folder| folder.join(&recording.file))
            .ok_or_else(|| "there is no folder for recordings".to_owned())
    }
}
