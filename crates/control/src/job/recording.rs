//! What a job says of its recording.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

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
