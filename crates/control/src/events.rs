//! What happens on a bench, published as it happens.

use std::sync::Arc;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use crate::job::JobSnapshot;
use crate::spacing::SpacingReading;
use bench::device::{AxisName, StopDelivery};
use plenoptics::imaging::spacing::SpacingMap;

/// One axis as a caller sees it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct AxisView {
    /// Which axis.
    pub axis: AxisName,
    /// Driver's name.
    pub driver: String,
    /// What the controller says it is.
    pub identity: String,
    /// Where it is.
    pub location: String,
    /// Whether the controller answers.
    pub connected: bool,
    /// Whether the position is known.
    pub homed: bool,
    /// Position read back, mm; absent while unknown.
    pub position_mm: Option<f64>,
    /// Whether the axis moves.
    pub moving: bool,
    /// Least position allowed now, mm: the limit of travel, or the e wall.
    pub low_limit_mm: f64,
    /// Greatest position allowed, mm.
    pub high_limit_mm: f64,
    /// Greatest speed at which it jogs, mm/s: a jog that is asked to go faster goes at this.
    pub jog_speed_mm_per_s: f64,
    /// Whether a limit switch is pressed, where the controller cannot tell which of the two it is (Grbl): its operator looks,
    /// and has the axis moved off it (`leave-switch`).
    pub limit_switch: bool,
    /// Why it cannot move now.
    pub fault: Option<String>,
    /// Why the last move or homing by hand did not end as commanded; absent once another is commanded, and where a stop was
    /// why, once that is reset.
    pub failure: Option<String>,
    /// What differs between controller and configuration.
    pub disagreements: Vec<String>,
}

impl AxisView {
    /// Why its controller is not connected; `None` where it is.
    #[must_use]
    pub fn absence(&self) -> Option<&str> {
        (!self.connected).then(|| self.fault.as_deref().unwrap_or("its controller does not answer"))
    }
}

/// The camera as a caller sees it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CameraView {
    /// Driver's name.
    pub driver: String,
    /// What the device says it is.
    pub identity: String,
    /// Whether frames arrive.
    pub online: bool,
    /// Why not.
    pub fault: Option<String>,
    /// Why none of its frames is measured, however many arrive: no job but homing begins.
    pub unfit: Option<String>,
    /// Frames lost so far, damaged ones included.
    pub frames_lost: u64,
    /// Frames that came damaged so far: none of them is shown or measured.
    pub frames_damaged: u64,
    /// What is to be known about its frames, one sentence each: a clock that lies, pixels saturated.
    pub notes: Vec<String>,
    /// Whether recorded frames are played from files: nothing that is seen is happening now.
    pub replay: bool,
    /// Sequence number of the newest frame.
    pub frame_seq: Option<u64>,
    /// Age of the newest frame when this was said, ms.
    pub frame_age_ms: Option<f64>,
}

impl CameraView {
    /// Why no frames arrive; `None` where they do.
    #[must_use]
    pub fn absence(&self) -> Option<&str> {
        (!self.online).then(|| self.fault.as_deref().unwrap_or("no frame comes"))
    }
}

/// Whether the shell is on the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ShellState {
    /// Mounted.
    On,
    /// Taken off, by the operator's own statement since the start of the program.
    Off,
    /// Not known: counts as on.
    Unknown,
}

/// What stands before the lens, as far as the program knows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum InView {
    /// Nobody has said; or it is being changed.
    #[default]
    Unknown,
    /// A flat board, in air or in water.
    FlatBoard,
    /// A board of several levels: what its spacing does over the field says nothing of the camera.
    SteppedBoard,
    /// A flat board that stands elsewhere than where the camera is to be focused, as one does that is put to several places in
    /// turn: its spacing is not the one that is aimed at.
    BoardElsewhere,
    /// Anything else: a diffuser, nothing, or what a job that ended had asked for and nobody has confirmed.
    Other,
}

/// The stop's latch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StopView {
    /// Whether motion is refused until the stop is reset.
    pub latched: bool,
    /// Since when, RFC 3339.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub since: Option<Timestamp>,
    /// Who stopped; absent while nobody has.
    pub by: Option<String>,
    /// What became of the newest stop on each axis, while it is latched; absent where it was another run's.
    #[serde(default)]
    pub delivery: Option<StopDeliveries>,
    /// Why it is not known whether an earlier run left the stop latched: it counts as latched until it is read, or reset.
    pub unread: Option<String>,
    /// The newest reset; absent while there was none.
    pub reset: Option<StopReset>,
}

/// What became of a stop on each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct StopDeliveries {
    /// The focus axis.
    pub focus: StopDelivery,
    /// The e axis.
    pub e: StopDelivery,
}

/// A reset of the stop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StopReset {
    /// When, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub at: Timestamp,
    /// Who reset it.
    pub by: String,
    /// Why, in their words.
    pub why: String,
    /// Since when it had been stopped, RFC 3339; absent where that could not be read.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub stopped_at: Option<Timestamp>,
    /// Who had stopped; absent where that could not be read.
    pub stopped_by: Option<String>,
}

/// The newest measurement of the live picture or of a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct MeasurementView {
    /// Sequence number of the frame measured.
    pub frame_seq: u64,
    /// When the frame was taken, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub captured_at: Timestamp,
    /// Readback of the focus axis, mm.
    pub focus_mm: Option<f64>,
    /// Readback of the e axis, mm.
    pub e_mm: Option<f64>,
    /// Whether both axes were settled during the whole exposure.
    pub settled: bool,
    /// The spacing.
    pub spacing: SpacingReading,
    /// The spacing wanted, px.
    pub spacing_target_px: f64,
    /// What says so; a measurement of a version that did not tell has Eq. 16's.
    #[serde(default)]
    pub spacing_target_source: TargetSource,
    /// By how much the spacing may be off that where a job accepts it, px; null in measurements of versions that did not
    /// tell it.
    pub spacing_tolerance_px: Option<f64>,
    /// |spacing − target| within the blur limit, of one board.
    pub in_focus: bool,
    /// The two boards that the frame shows, where it does: the spacing then is neither's.
    pub two_boards: Option<TwoBoardsView>,
    /// Pitch of the micro-images found, px.
    pub micro_image_pitch_px: f64,
    /// Its standard uncertainty, px; null in measurements of versions that did not tell it.
    pub micro_image_pitch_sigma_px: Option<f64>,
    /// Energy of gradient of the central view, mean per pixel.
    pub eog: Option<f64>,
    /// Energy of gradient of the central view, sum over its pixels (Eq. 20): it grows with the picture.
    pub eog_sum: Option<f64>,
    /// Structural similarity of the micro-images' patches with the matching content of their neighbours, mean, −1 to 1.
    pub ssim: Option<f64>,
}

/// Two boards in one field.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TwoBoardsView {
    /// Spacing on the axis as each has it, px: first that of the board that fills more of the field.
    pub spacings_px: [f64; 2],
    /// Standard uncertainty of their difference, px.
    pub difference_sigma_px: f64,
    /// Share of the field that the second fills.
    pub share: f64,
}

/// What says which spacing is in focus.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum TargetSource {
    /// Eq. 16, which holds for rays near the axis, and in air.
    #[default]
    Paraxial,
    /// Exact rays through the shell in the camera as designed: an air step will say it better.
    Design,
    /// Exact rays through the shell in the camera as the air step calibrated it.
    Calibration,
}

/// The spacing over the field in the newest measurement of a single board.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldMap {
    /// Sequence number of the frame measured.
    pub frame_seq: u64,
    /// When it was taken.
    pub captured_at: Timestamp,
    /// Pitch of the micro-images, px.
    pub micro_image_pitch_px: f64,
    /// The spacing wanted, px.
    pub spacing_target_px: f64,
    /// Micro-image by micro-image.
    pub map: Arc<SpacingMap>,
}

/// The state of the whole bench.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct BenchView {
    /// Whether the bench is simulated.
    pub simulated: bool,
    /// Where the design's numbers come from.
    pub design_origin: String,
    /// Focus axis and e axis.
    pub axes: Vec<AxisView>,
    /// The camera.
    pub camera: CameraView,
    /// Whether the shell is on.
    pub shell: ShellState,
    /// What stands before the lens.
    #[serde(default)]
    pub in_view: InView,
    /// Since when shell and what stands before the lens are as they are, RFC 3339: a frame taken before shows another scene.
    #[schema(value_type = String, format = DateTime)]
    #[serde(default)]
    pub set_up_at: Timestamp,
    /// Whether a shell step can go on from the newest air step: the camera has kept its focus since, and
    /// there is a white frame of it as it is set.
    #[serde(default)]
    pub air_step_holds: bool,
    /// Why the picture through the shell is not what the configuration says, as a job has found: no move is to be made on
    /// the strength of it. Absent while none has, and once something else is set up.
    #[serde(default)]
    pub contradicted: Option<String>,
    /// The stop's latch.
    pub stop: StopView,
    /// Who may move the axes; absent while nobody has taken the control lease.
    pub lease: Option<LeaseView>,
    /// The job under way, by its id.
    #[schema(value_type = Option<String>, format = Uuid)]
    pub job: Option<uuid::Uuid>,
    /// How the newest confirm key of the job under way begins: one that begins otherwise confirms nothing any more. Absent
    /// while there is none.
    #[serde(default)]
    pub confirm_key_begins: Option<String>,
    /// The e wall, mm of the e axis's reading. With the shell on, or not known to be off, it is where three standard uncertainties
    /// of the axis's zero and scale are left between the lens and the shell: by the configuration, or as a shell step has told
    /// them.
    pub e_wall_mm: f64,
    /// Whether it is so far from where it is configured because no shell step has told the axis's zero and scale.
    pub e_untold: bool,
    /// Why the history cannot be written, which keeps every axis still; absent while it can.
    pub history_fault: Option<String>,
}

/// Something happened.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Event {
    /// The bench's state changed.
    Bench {
        /// The whole state.
        bench: Box<BenchView>,
    },
    /// A job changed.
    Job {
        /// The whole job.
        job: Box<JobSnapshot>,
    },
    /// Something was measured.
    Measurement {
        /// The measurement.
        measurement: Box<MeasurementView>,
    },
}

/// A lease as anybody may see it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LeaseView {
    /// Identity of this lease.
    #[schema(value_type = String, format = Uuid)]
    pub id: Uuid,
    /// Who holds it.
    pub owner: String,
    /// What for, in the owner's words.
    pub note: Option<String>,
    /// Since when, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub since: Timestamp,
    /// Time to live from a heartbeat, s.
    pub ttl_s: f64,
    /// When it runs out unless it is renewed, RFC 3339; absent while a job or a connection holds it.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub expires_at: Option<Timestamp>,
    /// The job that holds it until its end.
    #[schema(value_type = Option<String>, format = Uuid)]
    pub job: Option<Uuid>,
}

/// What was measured, and of which frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SingleMeasurement {
    /// The measurement.
    #[serde(flatten)]
    pub measurement: MeasurementView,
    /// Whether an axis moved, or had not settled, during the exposure: no loop uses such a measurement.
    pub spans_motion: bool,
    /// The axes that did.
    pub unsettled: Vec<AxisName>,
    /// Begin of the exposure, RFC 3339; `captured_at` is its end.
    #[schema(value_type = String, format = DateTime)]
    pub exposed_from: Timestamp,
    /// Whether the exposure's begin and end are assumed, not the driver's word.
    pub exposure_assumed: bool,
    /// Whether the frame was simulated.
    pub simulated: bool,
    /// Whether the frame was recorded earlier and is played from a file.
    pub replayed: bool,
}
