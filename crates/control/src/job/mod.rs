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
pub mod report;
pub(crate) mod request;
pub mod steps;

use std::fmt;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use uuid::Uuid;

use crate::job::outcome::Outcome;
use crate::job::steps::JobStep;
use crate::spacing::SpacingReading;
use bench::device::AxisName;

pub use crate::job::request::{JobKind, JobRequest};
pub use recording::{Recording, RecordingState};
pub use report::{Interval, Report, SpacingTargets, TimeSpent};

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
    /// Why the job itself asks for that step again, in words: what came of it could not be used.
    #[serde(default)]
    pub because: Option<String>,
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

    /// Whether it waits for the confirmation of an operator's step.
    pub(crate) fn waits_for(&self, step: u32) -> bool {
        self.operator_step.as_ref().is_some_and(|asked| asked.number == step)
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
