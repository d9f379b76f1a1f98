//! Recordings of jobs: what a job sees, measures, decides and is answered, as it happens, for a file or for a comparison.
//!
//! A recording never disturbs its job: what is recorded is handed to a thread of its own through a bounded queue, and
//! where the disk is full or too slow the recording ends with what it has, and the job goes on and says so.

mod file;
pub mod words;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use uuid::Uuid;

use crate::events::{FieldMap, MeasurementView};
use crate::job::outcome::Outcome;
use crate::job::request::{JobKind, JobRequest};
use crate::job::{Iteration, JobState, LogLine, Report, word};
use bench::config::{Config, RecordJobs};
use bench::device::{AxisName, DeviceError, Frame, StageState};
use bench::record::messages::{JobStart, MeterReading};
use plenoptics::units::Millimetres;

pub(crate) use file::FileSink;

/// Folder of recordings within the state folder, where none is configured.
const FOLDER: &str = "recordings";

/// What is recorded of a job.
#[derive(Debug, Clone)]
pub(crate) enum Happening {
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
pub(crate) struct Answer {
    /// The axis; none for the camera.
    pub(crate) axis: Option<AxisName>,
    /// What it was asked.
    pub(crate) asked: &'static str,
    /// Where an axis was sent.
    pub(crate) target: Option<Millimetres>,
    /// Where it said that it stands after that.
    pub(crate) readback: Option<Millimetres>,
    /// An axis's state after that.
    pub(crate) state: Option<StageState>,
    /// Why it was not done.
    pub(crate) error: Option<DeviceError>,
}

impl Answer {
    /// A camera's that gave no frame.
    pub(crate) const fn no_frame(error: DeviceError) -> Self {
        Self { axis: None, asked: "frame", target: None, readback: None, state: None, error: Some(error) }
    }
}

/// How a job ended.
#[derive(Debug, Clone)]
pub(crate) struct End {
    pub(crate) state: JobState,
    pub(crate) reason: String,
    pub(crate) report: Option<Report>,
    pub(crate) outcome: Option<Outcome>,
}

/// Takes what is recorded. Never waits.
pub(crate) trait Sink: Send + Sync {
    /// Takes it in.
    fn take(&self, happening: Happening);
}

/// Where a job's recording is to be written.
#[derive(Debug, Clone)]
pub(crate) struct Place {
    /// The file.
    pub(crate) path: PathBuf,
    /// How the job's JSON names it.
    pub(crate) name: String,
}

/// The folder of recordings; none where neither the configuration nor the history has one.
pub(crate) fn folder(config: &Config, history: Option<&Path>) -> Option<PathBuf> {
    let configured = &config.record.folder;
    if configured.as_os_str().is_empty() {
        return history.and_then(Path::parent).map(|state| state.join(FOLDER));
    }
    Some(configured.clone())
}

/// The name of a job's recording: a simulated one says so.
pub(crate) fn file_name(id: Uuid, kind: JobKind, simulated: bool) -> String {
    let simulated = if simulated { "SIMULATED-" } else { "" };
    format!("{simulated}{}-{id}.{}", word(&kind), bench::record::ENDING)
}

/// Whether a job is to be recorded.
pub(crate) fn is_wanted(config: &Config, request: &JobRequest) -> bool {
    request.record.unwrap_or(config.record.jobs == RecordJobs::All)
}
