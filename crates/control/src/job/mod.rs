//! A job as data: its states, what it has done, what it asks of the operator, its report.
//!
//! ```text
//!  pending -> running <-> waiting_for_operator
//!                |  \            |
//!                |   `-> cancelling -> cancelled
//!                v
//!     converged | succeeded | not_converged | failed      (interrupted: the program ended first)
//! ```

pub mod outcome;
pub(crate) mod recording;
pub(crate) mod request;
pub mod steps;

use std::fmt;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use crate::budget::Budget;
use crate::job::outcome::Outcome;
use crate::job::steps::JobStep;
use crate::spacing::SpacingReading;
use bench::device::AxisName;

pub use crate::job::request::{JobKind, JobRequest};
pub use recording::{Recording, RecordingState};

/// Where a job is in its life.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    /// Accepted, not begun.
    Pending,
    /// At work.
    Running,
    /// Waits for a confirmation of [`JobSnapshot::operator_step`].
    WaitingForOperator,
    /// A cancellation is being carried out.
    Cancelling,
    /// Ended: the criterion is met.
    Converged,
    /// Ended: done, where there is no criterion to meet.
    Succeeded,
    /// Ended: the criterion cannot be met; the report has the best point and why.
    NotConverged,
    /// Ended: cancelled or stopped.
    Cancelled,
    /// Ended: something failed; `reason` says what.
    Failed,
    /// Ended with the program, which said nothing more of it: found when it was started again.
    Interrupted,
}

/// The word for it, as on every wire.
impl fmt::Display for JobState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&word(self))
    }
}

impl JobState {
    /// Every state, in the order of a job's life.
    pub const ALL: [Self; 10] = [
        Self::Pending,
        Self::Running,
        Self::WaitingForOperator,
        Self::Cancelling,
        Self::Converged,
        Self::Succeeded,
        Self::NotConverged,
        Self::Cancelled,
        Self::Failed,
        Self::Interrupted,
    ];

    /// Whether the job is over.
    #[must_use]
    pub const fn is_final(self) -> bool {
        matches!(
            self,
            Self::Converged | Self::Succeeded | Self::NotConverged | Self::Cancelled | Self::Failed | Self::Interrupted
        )
    }
}

/// What part of an alignment a job is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Devices, homing, white frame.
    Preparation,
    /// l_bound measured with the shell on.
    LBound,
    /// Δv in air.
    Air,
    /// e with the shell on.
    Shell,
    /// Measuring only: a sweep, a watch, a calibration.
    Survey,
    /// Final readings.
    Report,
}

/// Why an iteration moved, or did not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum IterationKind {
    /// Measured before any move.
    Start,
    /// After a probe of at most 0.5 mm.
    Probe,
    /// After a move that the model asked for.
    Move,
    /// Measured again without a move.
    Verify,
    /// Measured for its own sake.
    Sample,
}

impl IterationKind {
    /// The word for it, as on the wire.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Probe => "probe",
            Self::Move => "move",
            Self::Verify => "verify",
            Self::Sample => "sample",
        }
    }
}

/// One iteration: where the axes were, what was measured, what was decided.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Iteration {
    /// Counted from 1 over the job.
    pub number: u32,
    /// Part of the alignment.
    pub stage: Stage,
    /// Why it moved, or did not.
    pub kind: IterationKind,
    /// Axis moved, if any.
    pub axis: Option<AxisName>,
    /// Readback of the focus axis, mm; `null` while unknown.
    pub focus_mm: Option<f64>,
    /// Readback of the e axis, mm; `null` while unknown.
    pub e_mm: Option<f64>,
    /// Δv (air step: measured as v_ADJ − v; shell step: as the air step left it and trims changed it), mm.
    pub delta_v_mm: Option<f64>,
    /// Its standard uncertainty, mm.
    pub delta_v_sigma_mm: Option<f64>,
    /// Δv wanted, mm (air step).
    pub delta_v_target_mm: Option<f64>,
    /// e as the picture has it (shell step), mm.
    pub e_estimate_mm: Option<f64>,
    /// Its standard uncertainty, mm.
    pub e_estimate_sigma_mm: Option<f64>,
    /// The spacing measured: on the flat board, or on the middle level of the triple-level board.
    pub spacing: SpacingReading,
    /// The spacing predicted for this pose before the move, px.
    pub spacing_predicted_px: Option<f64>,
    /// The spacing wanted, px.
    pub spacing_target_px: f64,
    /// EOG of the central view (Eq. 20), mean per pixel; `null` where no view was made.
    #[serde(default)]
    pub eog: Option<f64>,
    /// What was decided, in a sentence.
    pub decision: String,
    /// Whether it counts no more: a step that had begun before was asked for again after it.
    #[serde(default)]
    pub discarded: bool,
    /// When, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub at: jiff::Timestamp,
}

/// What the operator is asked to do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct OperatorStep {
    /// Number of the step within its job, to be named when confirming.
    pub number: u32,
    /// Short name, e.g. `white_frame`.
    pub name: String,
    /// What to do, in full sentences with the number that matters.
    pub instruction: String,
    /// The number that matters, with its unit, large on the page; e.g. `159.2, 167.2, 175.2 mm`.
    pub value: Option<String>,
    /// Number of the earlier step that it takes the place of, where that was asked for again.
    #[serde(default)]
    pub repeats: Option<u32>,
    /// Numbers of the earlier steps that can be asked for again in place of confirming this one.
    #[serde(default)]
    pub repeatable: Vec<u32>,
}

/// The figure that a job brings to its target.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Measure {
    /// `delta_v_mm` or `spacing_px`; at the end of a calibration `delta_v_mm`, of a sweep `best_focus_mm` (a reading of the focus
    /// axis) or `best_focus_e_mm` (one of the e axis), and of a measurement of l_bound `l_bound_mm`.
    pub name: String,
    /// Its newest value.
    pub value: f64,
    /// The standard uncertainty of that.
    pub sigma: f64,
    /// What it is to be; `null` where nothing is aimed for.
    pub target: Option<f64>,
}

/// How far a job is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Progress {
    /// Steps done.
    pub step: u32,
    /// Steps there will be, as far as can be told.
    pub of: u32,
    /// What is being done, in words.
    pub doing: String,
    /// The figure that is brought to its target; `null` before the first measurement.
    pub measure: Option<Measure>,
    /// Time left when the step began, the operator's not counted, s: by how long this bench has taken for what was asked for.
    /// `null` where it has never done that, or has taken longer by now.
    pub time_left_s: Option<f64>,
}

/// A line of a job's log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LogLine {
    /// When, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub at: jiff::Timestamp,
    /// What happened.
    pub message: String,
}

/// Everything about a job at one moment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct JobSnapshot {
    /// Identity, a UUID of version 7.
    pub id: Uuid,
    /// What it does.
    pub kind: JobKind,
    /// As it was asked for.
    pub request: JobRequest,
    /// Who started it: the owner of the control lease that it holds until its end. Empty where the version that ran it
    /// knew no owners.
    #[serde(default)]
    pub owner: String,
    /// Where it is in its life.
    pub state: JobState,
    /// Part of the alignment it is in.
    pub stage: Stage,
    /// Whether the bench is simulated.
    pub simulated: bool,
    /// Grows with every change of this snapshot.
    pub generation: u64,
    /// When it was accepted, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub created_at: jiff::Timestamp,
    /// When it ended, RFC 3339.
    #[schema(value_type = Option<String>, format = DateTime)]
    pub ended_at: Option<jiff::Timestamp>,
    /// How far it is.
    pub progress: Progress,
    /// What the operator is asked to do now.
    pub operator_step: Option<OperatorStep>,
    /// Its steps: done, under way, and still to come where that can be told.
    #[serde(default)]
    pub steps: Vec<JobStep>,
    /// What was measured, in order.
    pub iterations: Vec<Iteration>,
    /// What happened, in order.
    pub log: Vec<LogLine>,
    /// Why it ended as it did, in words, once it has.
    pub reason: Option<String>,
    /// The report of an alignment, once it has ended.
    pub report: Option<Report>,
    /// What a job that is no alignment came to, once it has.
    pub outcome: Option<Outcome>,
    /// Its recording; `null` where it is not recorded.
    #[serde(default)]
    pub recording: Option<Recording>,
}

impl JobSnapshot {
    /// The job without its iterations and its log, which the history keeps one by one.
    pub(super) fn bare(&self) -> Self {
        Self { iterations: Vec::new(), log: Vec::new(), ..self.clone() }
    }
}

/// Near and far end of an interval; `null` for infinity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Interval {
    /// Lower end, mm.
    pub low_mm: Option<f64>,
    /// Upper end, mm.
    pub high_mm: Option<f64>,
}

/// The spacing of the board in focus behind the shell, at the e aimed for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SpacingTargets {
    /// Eq. 16, which holds for rays near the axis, px.
    pub paraxial_px: f64,
    /// The one pair of chief rays astride the axis, exactly traced, px.
    pub chief_ray_px: Option<f64>,
    /// Exact rays averaged over the estimator's window, px; `null` before the first measurement.
    pub window_px: Option<f64>,
}

/// Where a job's time went, from when it was accepted to its report, s. The parts add up to the whole.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TimeSpent {
    /// The whole.
    pub total_s: f64,
    /// A person had been asked to do something, and had not confirmed it.
    pub operator_s: f64,
    /// Axes were on their way.
    pub motion_s: f64,
    /// Axes stood, and what they carry had not settled.
    pub settling_s: f64,
    /// The camera had yet to give a frame that was exposed at rest.
    pub frames_s: f64,
    /// Frames were measured.
    pub measuring_s: f64,
    /// Whatever else.
    pub other_s: f64,
}

impl TimeSpent {
    /// What has been spent since an earlier moment of the same job.
    #[must_use]
    pub(super) fn since(&self, before: &Self) -> Self {
        Self {
            total_s: self.total_s - before.total_s,
            operator_s: self.operator_s - before.operator_s,
            motion_s: self.motion_s - before.motion_s,
            settling_s: self.settling_s - before.settling_s,
            frames_s: self.frames_s - before.frames_s,
            measuring_s: self.measuring_s - before.measuring_s,
            other_s: self.other_s - before.other_s,
        }
    }

    /// What is left of the time that such a job usually takes by itself (s), the operator's not counted, s; `None` where it
    /// has taken longer: when it ends is not known then.
    #[must_use]
    pub fn time_left_s(&self, usual_s: f64) -> Option<f64> {
        let left_s = usual_s - (self.total_s - self.operator_s);
        (left_s > 0.0).then_some(left_s)
    }

    /// The parts in the order in which they are told: what each is, and how long it took, s.
    #[must_use]
    pub const fn parts(&self) -> [(&'static str, f64); 6] {
        [
            ("operator", self.operator_s),
            ("motion", self.motion_s),
            ("settling", self.settling_s),
            ("waiting for frames", self.frames_s),
            ("measuring", self.measuring_s),
            ("other", self.other_s),
        ]
    }
}

/// What an alignment came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Report {
    /// `converged`, `not_converged`, `cancelled` or `failed`.
    pub outcome: JobState,
    /// Why, in words.
    pub reason: String,
    /// What the shell step changed to meet the criterion, in words.
    pub shell_step_done: String,
    /// Where the design's numbers come from.
    pub design_origin: String,
    /// Δv as measured, mm; `null` where the focus axis has been moved since it was.
    pub delta_v_mm: Option<f64>,
    /// Its standard uncertainty, mm.
    pub delta_v_sigma_mm: Option<f64>,
    /// Δv wanted for the e reached, mm.
    pub delta_v_target_mm: f64,
    /// Δv at the end of the air step, mm; `null` where it came to none.
    pub delta_v_air_mm: Option<f64>,
    /// Δv wanted in the air step, mm.
    pub delta_v_air_target_mm: f64,
    /// e as the picture has it, mm; `null` where the axis has been moved since it was measured.
    pub e_mm: Option<f64>,
    /// Its standard uncertainty, mm.
    pub e_sigma_mm: Option<f64>,
    /// e wanted, mm.
    pub e_target_mm: f64,
    /// The e wall, mm.
    pub e_wall_mm: f64,
    /// Readback of the focus axis, mm.
    pub focus_readback_mm: Option<f64>,
    /// Readback of the e axis, mm.
    pub e_readback_mm: Option<f64>,
    /// v + Δv, mm.
    pub image_distance_mm: Option<f64>,
    /// Spacing at the end, px; `null` where an axis has been moved since it was measured.
    pub spacing_px: Option<f64>,
    /// Its standard uncertainty, px.
    pub spacing_sigma_px: Option<f64>,
    /// Spacing wanted, px: one of `spacing_targets`.
    pub spacing_target_px: f64,
    /// What "in focus" is called by rays near the axis and by exact ones.
    pub spacing_targets: SpacingTargets,
    /// Moves in the air step, its probe not counted.
    pub moves_air: u32,
    /// Moves in the shell step, its probe not counted.
    pub moves_shell: u32,
    /// Field of view in water over the sensor's width, degrees; `null` where the edge sees past the shell, or Δv
    /// or e was not measured.
    pub fov_water_deg: Option<f64>,
    /// Aperture diameter to set, mm.
    pub aperture_mm: f64,
    /// The number on the lens's ring for it.
    pub aperture_ring_f_number: f64,
    /// Depth of field in water, from the shell's outer vertex; `null` where nothing is that sharp, or Δv or e was
    /// not measured.
    pub depth_of_field: Option<Interval>,
    /// e values between which the blur stays within the limit, Δv held; `null` where there are none, or Δv or e was not
    /// measured.
    pub e_tolerance: Option<Interval>,
    /// Tilt along x and y at the end, px per half frame width; `null` over a board of several levels.
    pub tilt_px: Option<[f64; 2]>,
    /// The same as an angle between lens and MLA if nothing else were tilted, degrees.
    pub tilt_deg: Option<[f64; 2]>,
    /// The standard uncertainty of either angle, degrees.
    #[serde(default)]
    pub tilt_sigma_deg: Option<f64>,
    /// Energy of gradient of the central view before the first move with the shell, mean per pixel.
    pub eog_before: Option<f64>,
    /// The same at the end.
    pub eog_after: Option<f64>,
    /// True travel over commanded travel as the picture has it, focus axis; `null` where it was not seen to move.
    pub focus_scale: Option<f64>,
    /// True travel over commanded travel as the picture has it, e axis; `null` where it was not seen to move.
    pub e_scale: Option<f64>,
    /// l_bound used, mm.
    pub l_bound_mm: f64,
    /// Standard uncertainty of a measured l_bound with all that is taken for granted, mm.
    pub l_bound_sigma_mm: Option<f64>,
    /// What Δv, e and focus are good to; `null` where the camera was not looked at through the shell, and in a report of a
    /// version that did not tell.
    #[serde(default)]
    pub budget: Option<Budget>,
    /// Where the time went; `null` in a report of a version that did not tell.
    #[serde(default)]
    pub time_spent: Option<TimeSpent>,
    /// What a reader should know before trusting the figures, one sentence each.
    pub notes: Vec<String>,
    /// The simulated truth, on a simulated bench.
    #[schema(value_type = Option<Object>)]
    pub truth: Option<serde_json::Value>,
}

impl Report {
    /// Whether it tells the figure that a job was at last measured to have.
    pub(super) fn tells(&self, measure: &Measure) -> bool {
        match measure.name.as_str() {
            "delta_v_mm" => self.delta_v_mm.is_some(),
            _ => self.spacing_px.is_some(),
        }
    }
}

/// The word for a state or a kind, as on the wire.
pub(crate) fn word(value: &impl Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|word| word.as_str().map(str::to_owned)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_state_is_spelt_in_one_way_wherever_it_is_written() {
        for state in JobState::ALL {
            assert_eq!(json!(state), json!(state.to_string()), "on the wire");
            assert_eq!(serde_json::from_value::<JobState>(json!(state.to_string())).unwrap(), state, "read back");
            assert_eq!(JobState::ALL.into_iter().filter(|other| other.to_string() == state.to_string()).count(), 1);
        }
    }
}
