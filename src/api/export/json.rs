//! Everything that is kept of a job as one JSON document.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use crate::control::events::MeasurementView;
use crate::control::history::read::{AskedStep, JobArchive, RunView};
use crate::control::job::JobSnapshot;
use crate::store::records::Move;
use crate::text::data_uri;

/// Version of the document; grows when a reader of the one before would misread it.
const VERSION: u32 = 1;

/// A picture kept with a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PictureExport {
    /// Which one: `before` the first move with the shell, or `after` the last.
    pub name: String,
    /// When it was taken, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub at: jiff::Timestamp,
    /// The picture as a `data:` URI.
    pub data: String,
}

/// Everything that is kept of a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobExport {
    /// Always `plenalign-job`.
    pub format: String,
    /// Version of this document's layout.
    pub version: u32,
    /// Whether the bench was simulated: then nothing in here was measured on a real camera.
    pub simulated: bool,
    /// When this document was made, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub exported_at: jiff::Timestamp,
    /// The job.
    pub job: JobSnapshot,
    /// What was asked for.
    #[schema(value_type = Object)]
    pub request: Value,
    /// The run of the program that it belongs to, with its configuration.
    pub run: Option<RunView>,
    /// What was measured, in order.
    pub measurements: Vec<MeasurementView>,
    /// What was moved, in order.
    pub moves: Vec<Move>,
    /// What the operator was asked to do, in order.
    pub operator_steps: Vec<AskedStep>,
    /// The pictures kept with it.
    pub pictures: Vec<PictureExport>,
}

impl From<&JobArchive> for JobExport {
    fn from(archive: &JobArchive) -> Self {
        let pictures = archive.pictures.iter().map(|picture| PictureExport {
            name: picture.name.clone(),
            at: picture.at,
            data: data_uri(&picture.media_type, &picture.bytes),
        });
        Self {
            format: "plenalign-job".to_owned(),
            version: VERSION,
            simulated: archive.job.simulated,
            exported_at: jiff::Timestamp::now(),
            pictures: pictures.collect(),
            job: archive.job.clone(),
            request: archive.request.clone(),
            run: archive.run.clone(),
            measurements: archive.measurements.clone(),
            moves: archive.moves.clone(),
            operator_steps: archive.operator_steps.clone(),
        }
    }
}
/// The document as text.
#[must_use]
pub fn json(archive: &JobArchive) -> String {
    serde_json::to_string_pretty(&JobExport::from(archive)).unwrap_or_else(|error| {
        // No field can fail to be written.
        tracing::error!(%error, "an export cannot be written as JSON");
        "{}".to_owned()
    })
}
