//! Wire shapes that the layers below do not have: requests, links, and the messages of the WebSocket.

use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;
use uuid::Uuid;

use super::error::Problem;
use crate::config::Side;
use crate::control::events::{BenchView, LeaseView, MeasurementView, ShellState};
use crate::control::job::JobSnapshot;
use crate::whole::whole;

/// Where a job is found.
#[must_use]
pub fn job_href(id: Uuid) -> String {
    format!("/api/v1/jobs/{id}")
}

/// A job and where it is found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobResource {
    /// Path of this job.
    #[schema(example = "/api/v1/jobs/0199f0f2-5d2a-7c3e-9a53-5f0f6c1f6a11")]
    pub href: String,
    /// The job.
    #[serde(flatten)]
    pub job: JobSnapshot,
}

impl From<JobSnapshot> for JobResource {
    fn from(job: JobSnapshot) -> Self {
        Self { href: job_href(job.id), job }
    }
}

/// A job that has been asked for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobCreated {
    /// The job and where it is found.
    #[serde(flatten)]
    pub job: JobResource,
    /// The job's confirm key, to be handed on to whoever is to confirm what it asks. It does nothing else, and ends with
    /// the job. Told here once; `null` where the job had been asked for before, and then
    /// `POST /api/v1/jobs/{id}/confirm-key` makes another.
    pub confirm_key: Option<String>,
}

/// A job's confirm key, just made. Told here once.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct ConfirmKeyGrant {
    /// The job's id.
    pub job: Uuid,
    /// The key.
    #[schema(pattern = "^confirm_[0-9a-f]{64}$")]
    pub confirm_key: String,
}

/// Who asks for the control lease.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LeaseAsked {
    /// Who: shown to everybody who asks for it meanwhile.
    #[schema(
        min_length = 1,
        max_length = 200,
        pattern = "^[^\\x00-\\x1f\\x7f-\\x9f\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069]*[^\\s\\x00-\\x1f\\x7f-\\x9f\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069][^\\x00-\\x1f\\x7f-\\x9f\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069]*$"
    )]
    pub owner: String,
    /// What for.
    #[schema(
        min_length = 1,
        max_length = 200,
        pattern = "^[^\\x00-\\x1f\\x7f-\\x9f\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069]*[^\\s\\x00-\\x1f\\x7f-\\x9f\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069][^\\x00-\\x1f\\x7f-\\x9f\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069]*$"
    )]
    pub note: Option<String>,
    /// Time to live from a heartbeat, s; 30 where it is not given.
    #[schema(minimum = 2, maximum = 3600)]
    pub ttl_s: Option<f64>,
}

/// Who has the control lease.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LeaseState {
    /// The lease; `null` while nobody has it.
    pub lease: Option<LeaseView>,
}

/// A confirmation of an operator step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ConfirmRequest {
    /// Number of the step that has been carried out: a late confirmation of an earlier step is refused.
    #[schema(maximum = 4294967295.0)]
    #[serde(deserialize_with = "whole")]
    pub step: u32,
}

/// A wish for an earlier operator step to be asked for again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct RepeatRequest {
    /// Number of the earlier step, one of `repeatable` of the step that the job waits for.
    #[schema(maximum = 4294967295.0)]
    #[serde(deserialize_with = "whole")]
    pub step: u32,
}

/// A move of one axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct MoveRequest {
    /// Where to, in the axis's own coordinate, mm.
    pub position_mm: f64,
}

/// A jog of one axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct JogRequest {
    /// Which way: towards smaller or larger positions.
    pub towards: Side,
    /// How fast, mm/s; the axis's greatest speed where it is not given.
    #[schema(exclusive_minimum = 0)]
    pub speed_mm_per_s: Option<f64>,
    /// A name of the caller's own for this press of the button, another one for each: one that a stop, another press or
    /// its own end has ended is refused from then on, so that no word that comes late, and no button held down all the
    /// while, moves the axis again.
    #[schema(min_length = 1, max_length = 64)]
    pub press: Option<String>,
}

/// Which limit switch of an axis is pressed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LeaveSwitchRequest {
    /// The end of travel whose switch is pressed, as seen on the bench: the axis moves away from it.
    pub pressed: Side,
}

/// Why the stop is reset.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ResetRequest {
    /// Why motion is to be possible again: shown to everybody, and kept.
    #[schema(
        min_length = 1,
        max_length = 200,
        pattern = "^[^\\x00-\\x1f\\x7f-\\x9f\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069]*[^\\s\\x00-\\x1f\\x7f-\\x9f\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069][^\\x00-\\x1f\\x7f-\\x9f\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069]*$"
    )]
    pub why: String,
    /// Who resets it, where no token says so.
    #[schema(
        min_length = 1,
        max_length = 200,
        pattern = "^[^\\x00-\\x1f\\x7f-\\x9f\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069]*[^\\s\\x00-\\x1f\\x7f-\\x9f\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069][^\\x00-\\x1f\\x7f-\\x9f\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069]*$"
    )]
    pub owner: Option<String>,
}

/// The operator's statement about the shell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ShellRequest {
    /// Whether the shell is on the camera.
    pub state: ShellState,
}

/// Whether the daemon answers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Health {
    /// Always `ok`: what does not answer says nothing.
    #[schema(example = "ok")]
    pub status: String,
    /// Version of the program.
    pub version: String,
    /// Identity of this run of the program.
    pub boot_id: Uuid,
    /// Whether the bench is simulated.
    pub simulated: bool,
}

/// That the bench can be worked with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Readiness {
    /// Always true: what is not ready answers 503.
    pub ready: bool,
}

/// What the daemon sends over the WebSocket as text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum ServerMessage {
    /// Everything as it is now: the first message, and again for a viewer that could not follow.
    Snapshot {
        /// Number of the newest change contained.
        seq: u64,
        /// Identity of this run of the program.
        boot_id: Uuid,
        /// Version of the program.
        version: String,
        /// State of the bench.
        bench: Box<BenchView>,
        /// Jobs since the start, newest last.
        jobs: Vec<JobResource>,
        /// The newest measurement.
        measurement: Option<MeasurementView>,
    },
    /// The changes that this viewer asked to follow on from are not kept, or are of another run: a snapshot follows.
    Gap {
        /// Number of the newest change.
        seq: u64,
        /// Identity of this run of the program.
        boot_id: Uuid,
        /// The change that was to be followed on from.
        after: u64,
        /// The run that it was of.
        after_boot_id: Uuid,
    },
    /// The bench changed.
    Bench {
        /// Number of this change.
        seq: u64,
        /// Identity of this run of the program.
        boot_id: Uuid,
        /// State of the bench.
        bench: Box<BenchView>,
    },
    /// A job changed.
    Job {
        /// Number of this change.
        seq: u64,
        /// Identity of this run of the program.
        boot_id: Uuid,
        /// The whole job.
        job: Box<JobResource>,
    },
    /// Something was measured.
    Measurement {
        /// Number of this change.
        seq: u64,
        /// Identity of this run of the program.
        boot_id: Uuid,
        /// The measurement.
        measurement: Box<MeasurementView>,
    },
    /// Nothing need have changed: a sign of life, every second.
    Tick {
        /// Number of the newest change.
        seq: u64,
        /// Identity of this run of the program.
        boot_id: Uuid,
        /// The daemon's clock, RFC 3339.
        #[schema(value_type = String, format = DateTime)]
        now: jiff::Timestamp,
        /// The same moment on the daemon's machine's CLOCK_MONOTONIC, microseconds: no setting of the clock disturbs it.
        monotonic_us: u64,
        /// Age of the newest frame of a viewer that watches pictures, ms.
        frame_age_ms: Option<f64>,
    },
    /// What a viewer asked the daemon's clock for is answered with.
    Clock {
        /// Number of the newest change.
        seq: u64,
        /// Identity of this run of the program.
        boot_id: Uuid,
        /// What the viewer had said of when it asked.
        asked_ms: f64,
        /// The daemon's clock when it heard that, RFC 3339.
        #[schema(value_type = String, format = DateTime)]
        now: jiff::Timestamp,
        /// The same moment on the daemon's machine's CLOCK_MONOTONIC, microseconds.
        monotonic_us: u64,
    },
    /// A message from this viewer could not be used.
    Problem {
        /// Number of the newest change.
        seq: u64,
        /// Identity of this run of the program.
        boot_id: Uuid,
        /// What was wrong with it.
        problem: Problem,
    },
}

/// What a viewer sends over the WebSocket, as text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum ViewerMessage {
    /// Asks for pictures, or for none.
    Pictures {
        /// Whether to send pictures.
        on: bool,
        /// At most so many pictures a second, 0.1 to 60.
        #[serde(default = "default_rate")]
        #[schema(minimum = 0.1, maximum = 60, default = 15)]
        max_rate_hz: f64,
        /// Raw pixels to a picture pixel, each way: 1, 2 or 4.
        #[serde(default = "default_reduce", deserialize_with = "whole")]
        #[schema(default = 1)]
        reduce: u32,
        /// What part of the raw frame to show, and at how many pixels, in place of `reduce`.
        // Read by itself, so that a problem can name what of it does not fit.
        #[serde(default)]
        #[schema(value_type = Option<Viewport>)]
        viewport: Option<Value>,
        /// Quality of the JPEG, 10 to 100.
        #[serde(default = "default_quality", deserialize_with = "whole")]
        #[schema(minimum = 10, maximum = 100, default = 80)]
        quality: u8,
        /// What the pictures show. All but the raw frame are as large as a view is: `reduce` and `viewport` are not for them.
        #[serde(default)]
        show: Show,
        /// Whether to send the spacing over the field, too, at each new measurement.
        #[serde(default)]
        overlay: bool,
        /// At most so many pictures on the way that the viewer has not said it has seen; 0 for no such bound.
        #[serde(default, deserialize_with = "whole")]
        #[schema(maximum = 16, default = 0)]
        window: u32,
    },
    /// Asks for what the meter reads, or for no more of it.
    Readings {
        /// Whether to send readings.
        on: bool,
        /// At most so many a second, 0.1 to 120.
        #[serde(default = "default_reading_rate")]
        #[schema(minimum = 0.1, maximum = 120, default = 120)]
        max_rate_hz: f64,
        /// Whether to have a frame measured in whole, too, now and then while no job measures, as for who watches pictures:
        /// it comes as `measurement`, and what is followed from frame to frame is checked by it.
        #[serde(default)]
        whole: bool,
    },
    /// Holds the control lease for as long as this connection lives, and 10 s longer.
    Hold {
        /// The lease's key.
        lease: String,
    },
    /// Asks for the daemon's clock: by it and by when it asked, a viewer knows how old at most is what comes, however long
    /// that waits on its way.
    Clock {
        /// When it asks, by its own clock, ms: given back as it is.
        asked_ms: f64,
    },
    /// Says that a picture has been shown, where `window` bounds how many are on the way.
    Seen {
        /// The picture's sequence number.
        #[serde(deserialize_with = "whole")]
        seq: u64,
    },
}

/// A rectangle of the raw frame, and as how many pixels it is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Viewport {
    /// First column, px of the raw frame.
    #[serde(deserialize_with = "whole")]
    pub x_px: u32,
    /// First row, px of the raw frame.
    #[serde(deserialize_with = "whole")]
    pub y_px: u32,
    /// Columns of the raw frame.
    #[serde(deserialize_with = "whole")]
    #[schema(minimum = 1)]
    pub width_px: u32,
    /// Rows of the raw frame.
    #[serde(deserialize_with = "whole")]
    #[schema(minimum = 1)]
    pub height_px: u32,
    /// Columns of the picture: what there is room for on a screen. It is never sent more than `width_px`.
    #[serde(deserialize_with = "whole")]
    #[schema(minimum = 1, maximum = 16384)]
    pub picture_width_px: u32,
    /// Rows of the picture, likewise.
    #[serde(deserialize_with = "whole")]
    #[schema(minimum = 1, maximum = 16384)]
    pub picture_height_px: u32,
    /// Whether to send the samples as they are, as a PNG: only where there is room for every pixel of the rectangle.
    #[serde(default)]
    #[schema(default = false)]
    pub lossless: bool,
}

/// What the pictures of a viewer show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Show {
    /// The raw frame.
    #[default]
    Raw,
    /// The central view.
    Central,
    /// Everything sharp.
    AllInFocus,
    /// How far away everything is, coloured.
    Depth,
}

fn default_rate() -> f64 {
    15.0
}

fn default_reading_rate() -> f64 {
    120.0
}

fn default_quality() -> u8 {
    super::pictures::picture::DEFAULT_QUALITY
}

fn default_reduce() -> u32 {
    1
}
