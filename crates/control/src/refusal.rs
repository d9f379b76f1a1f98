//! Why a request is refused now, in the operator's words.

use uuid::Uuid;

use crate::field::Invalid;
use crate::job::JobState;
use bench::config::Side;
use bench::device::light::{ControlName, ControlUnit};
use bench::device::{AxisName, DeviceError};
use plenoptics::units::Millimetres;

/// What keeps the wall away from where it is configured.
const UNTOLD: &str = " (so far from where it is configured because no picture has told the e axis's zero and scale: an alignment's shell step tells them, or zero_uncertainty_mm and scale_uncertainty in [bench.e] say that they are known better)";

/// Why a well-formed request is refused now.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// The stop is latched.
    #[error("the stop is latched; reset it first")]
    Stopped,
    /// Motion was asked for without the control lease.
    #[error("motion needs the control lease; take it first")]
    LeaseRequired,
    /// The lease shown is not, or no longer, the one in force.
    #[error("this control lease has run out, was given back, or was taken over{}", now_held(holder.as_deref()))]
    LeaseLost {
        /// Who has one now.
        holder: Option<String>,
    },
    /// The lease ended while an axis moved under it.
    #[error("the {axis} axis {}, because control ended", if *homing { "is not homed" } else { "was stopped on its way" })]
    ControlEnded {
        /// Which axis.
        axis: AxisName,
        /// Whether it was being homed.
        homing: bool,
    },
    /// Another has the lease.
    #[error("{owner} has the control lease{}", for_what(note.as_deref(), *job))]
    LeaseHeld {
        /// Who.
        owner: String,
        /// What for.
        note: Option<String>,
        /// The job that holds it in the owner's name.
        job: Option<Uuid>,
    },
    /// A job holds the bench.
    #[error("job {job} holds the bench until it ends or is cancelled")]
    Busy {
        /// The holder.
        job: Uuid,
    },
    /// The camera's exposure is searched for.
    #[error("the camera's exposure is being searched for: wait for the end of that, a minute at most")]
    Searching,
    /// Outside the axis's travel.
    #[error("{target:.3} is outside the {axis} axis's travel of {low} to {high}")]
    Limit {
        /// Which axis.
        axis: AxisName,
        /// The position asked for.
        target: Millimetres,
        /// Least position.
        low: Millimetres,
        /// Greatest position.
        high: Millimetres,
    },
    /// Beyond the e wall.
    #[error("{target:.3} is beyond the e wall at {wall:.3}: the lens could touch the shell{}", if *untold { UNTOLD } else { "" })]
    Wall {
        /// The position asked for.
        target: Millimetres,
        /// The wall.
        wall: Millimetres,
        /// Whether it stands further from the shell than it has to, as no picture has told the axis's zero and scale.
        untold: bool,
    },
    /// Longer than a single move may be.
    #[error("a move of {distance:.3} is longer than the {axis} axis's greatest step of {max}")]
    Step {
        /// Which axis.
        axis: AxisName,
        /// Length asked for.
        distance: Millimetres,
        /// Greatest length.
        max: Millimetres,
    },
    /// Faster than the axis goes.
    #[error("{speed} mm/s is more than the {axis} axis's greatest speed of {max} mm/s")]
    Speed {
        /// Which axis.
        axis: AxisName,
        /// Speed asked for, mm/s.
        speed: f64,
        /// Greatest speed, mm/s.
        max: f64,
    },
    /// The axis's position is unknown.
    #[error("the {axis} axis is not homed; home it first")]
    NotHomed {
        /// Which axis.
        axis: AxisName,
    },
    /// The axis moves already.
    #[error("the {axis} axis is moving")]
    Moving {
        /// Which axis.
        axis: AxisName,
    },
    /// The axis's controller contradicts the configuration about where the axis would go.
    #[error(
        "nothing moves on the {axis} axis until its controller and the configuration agree: {}",
        contradictions.join(" ")
    )]
    Contradiction {
        /// Which axis.
        axis: AxisName,
        /// What contradicts what, one sentence each.
        contradictions: Vec<String>,
    },
    /// Homing would run towards the shell.
    #[error(
        "homing the {axis} axis would run the e axis towards the shell, which is {shell}; take the shell off and say so first"
    )]
    HomingTowardsShell {
        /// Which axis was to be homed.
        axis: AxisName,
        /// The shell's state, in a word.
        shell: &'static str,
    },
    /// A limit switch is pressed that homing might take for the home switch.
    #[error("the {axis} axis is not homed: {why}")]
    SwitchPressed {
        /// Which axis was to be homed.
        axis: AxisName,
        /// Which switch of which axis, and what to do.
        why: String,
    },
    /// Moving off a switch would run towards the shell.
    #[error(
        "moving the e axis off its {pressed} switch would run it towards the shell, which is {shell}; take the shell off and say so first"
    )]
    LeavingTowardsShell {
        /// The switch said to be pressed.
        pressed: Side,
        /// The shell's state, in a word.
        shell: &'static str,
    },
    /// The job is not in a state for this.
    #[error("the job is {state}: {why}")]
    JobState {
        /// The job's state.
        state: JobState,
        /// What would be right.
        why: String,
    },
    /// A frame exposed at rest was asked for, and an axis moves or has yet to settle.
    #[error(
        "{} moved or had yet to settle during the exposure: wait for the axes, or measure with settled = false",
        named(axes)
    )]
    SpansMotion {
        /// Which.
        axes: Vec<AxisName>,
    },
    /// There is nothing to be measured.
    #[error("nothing can be measured: {why}")]
    NotMeasurable {
        /// Why not.
        why: String,
    },
    /// No picture can be made of a frame.
    #[error("no picture can be made of this frame: {why}")]
    NotViewable {
        /// Why not.
        why: String,
    },
    /// The camera has no such control, or one that cannot be set.
    #[error("the camera's {control} cannot be set: {why}")]
    NoControl {
        /// Which.
        control: ControlName,
        /// Why not.
        why: String,
    },
    /// Outside the limits of a camera's control.
    #[error("{control}: {value}{unit} is not within {minimum} to {maximum}{unit}", unit = unit.suffix())]
    ControlRange {
        /// Which.
        control: ControlName,
        /// The value asked for.
        value: f64,
        /// Least value.
        minimum: f64,
        /// Greatest value.
        maximum: f64,
        /// What these numbers are.
        unit: ControlUnit,
    },
    /// No exposure was found.
    #[error("no exposure fits: {why}")]
    NotExposed {
        /// Why not.
        why: String,
    },
    /// Distances were asked for, and it is not known where the camera was.
    #[error("no distances without the camera's pose: {why}")]
    PoseUnknown {
        /// What is not known, and what would make it known.
        why: String,
    },
    /// The history cannot be written: a motion without a record must not be.
    #[error("nothing may move while the history cannot be written: {why}")]
    NoHistory {
        /// Why not.
        why: String,
    },
    /// The stop was not reset.
    #[error("the stop stays latched: its reset cannot be written to the history: {why}")]
    ResetNotKept {
        /// Why not.
        why: String,
    },
    /// A confirmation that shows nothing.
    #[error("this is confirmed with the key of the job's lease, or with the confirm key that its starter was given")]
    ConfirmKeyRequired,
    /// A confirmation that shows neither the job's lease nor its confirm key.
    #[error("what is shown is neither the key of the job's lease nor its confirm key; a lost one can be replaced")]
    ConfirmKeyWrong,
    /// A confirmation while the camera gives an old picture again: what follows would be measured in it.
    #[error(
        "the camera gives an old picture again as if it were new: unplug it and plug it in again, and confirm then; nothing \
         of the job is lost by that"
    )]
    OldPicture,
    /// No confirm key could be made.
    #[error("no confirm key can be made: {why}")]
    NoConfirmKey {
        /// Why not.
        why: String,
    },
    /// A jog's press that a stop has ended.
    #[error(
        "this press of the {axis} axis's jog is over, by a stop, another press or its end, and does not go on: let go and \
         press again"
    )]
    PressEnded {
        /// Which axis.
        axis: AxisName,
    },
    /// The caller's own name for a request stands for another request.
    #[error(
        "the Idempotency-Key {key:?} was used for another request, which became job {job}; use a new key for a new request"
    )]
    KeyReused {
        /// The name.
        key: String,
        /// What the other request became.
        job: Uuid,
    },
    /// The program is ending.
    #[error("the program is shutting down")]
    ShuttingDown,
}

fn named(axes: &[AxisName]) -> String {
    match axes {
        [] => "an axis".to_owned(),
        [axis] => format!("the {axis} axis"),
        _ => "both axes".to_owned(),
    }
}

fn now_held(holder: Option<&str>) -> String {
    holder.map(|owner| format!("; {owner} has it now")).unwrap_or_default()
}

fn for_what(note: Option<&str>, job: Option<Uuid>) -> String {
    let note = note.map(|note| format!(" ({note})")).unwrap_or_default();
    let job = job.map(|job| format!(" until the end of job {job}")).unwrap_or_default();
    format!("{note}{job}")
}

/// Why a request was not carried out.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ServiceError {
    /// Well-formed, but refused now.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// A device failed.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// There is no such job.
    #[error("there is no job {id}")]
    NoSuchJob {
        /// The id asked for.
        id: Uuid,
    },
    /// The history cannot be read.
    #[error("the history cannot be read: {why}")]
    Unreadable {
        /// Why not.
        why: String,
    },
    /// The request does not say what it must.
    #[error("{field}: {what}")]
    Invalid {
        /// Which field of it.
        field: &'static str,
        /// What is wrong, and what would be right.
        what: String,
    },
}

impl From<Invalid> for ServiceError {
    fn from(Invalid { field, what }: Invalid) -> Self {
        Self::Invalid { field, what }
    }
}
