//! The bench: what a stage and a frame source are, their drivers, and every device of one rig.
//!
//! Positions are in an axis's own coordinate, which the configuration ties to the controller's: Δv for the focus axis,
//! e for the e axis. A device refuses what it cannot do; what must not be done (limits of travel, the e wall, a latched
//! stop) is decided by `control`, which alone commands motion.

pub mod camera;
pub mod connected;
pub mod error;
pub mod faults;
pub mod jog;
pub mod light;
pub mod open;
pub mod port;
pub mod position;
pub mod ramp;
pub mod replayed;
pub mod serial;
pub mod setup;
pub mod stage;

pub use error::DeviceError;
pub use setup::{Setup, SimulatedOperator};

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use async_trait::async_trait;
use serde::{Deserialize, Serialize};
use tokio::sync::watch;
use tokio::time::Instant;

use crate::config::Side;
use jog::{Course, Seen};
use light::{ControlName, LightControl};
use plenoptics::raw::RawImage;
use plenoptics::units::Millimetres;
use ramp::Ramp;

/// Which of the bench's two axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum AxisName {
    /// The focus axis: Δv.
    Focus,
    /// The e axis.
    E,
}

impl AxisName {
    /// Both, focus first.
    pub const ALL: [Self; 2] = [Self::Focus, Self::E];

    /// The word used in configuration, paths and messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Focus => "focus",
            Self::E => "e",
        }
    }
}

impl std::fmt::Display for AxisName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// What one axis is doing.
#[derive(Debug, Clone, PartialEq)]
pub struct StageState {
    /// Whether the controller answers.
    pub connected: bool,
    /// Whether the position is known: homed since power-up and nothing has happened since that could have moved it.
    pub homed: bool,
    /// Last position read back, in the axis's coordinate. Meaningless until `homed`.
    pub position: Millimetres,
    /// Whether the axis moves.
    pub moving: bool,
    /// Since when it has been at rest, by the driver's own readings; `None` while moving or unknown.
    pub at_rest_since: Option<Instant>,
    /// Whether a limit switch of the axis is pressed, where its controller cannot tell which of the two it is.
    pub limit_switch: bool,
    /// Alarm or other reason why the axis cannot move now, in words.
    pub fault: Option<String>,
}

/// What a stage is.
#[derive(Debug, Clone, PartialEq)]
pub struct StageInfo {
    /// Which axis.
    pub axis: AxisName,
    /// Driver's name, e.g. `grbl`.
    pub driver: String,
    /// What the controller says it is, e.g. `Grbl 1.1h`; empty until connected.
    pub identity: String,
    /// Where it is: a port's path, or `simulated`.
    pub location: String,
    /// What differs between the controller's settings and the configuration and does no harm, one sentence each.
    pub disagreements: Vec<String>,
    /// What of the controller's settings contradicts the configuration, one sentence each: nothing moves until one of
    /// the two is changed.
    pub contradictions: Vec<String>,
    /// The controller's own limits of travel, least and greatest, in the axis's coordinate, where it has some.
    pub firmware_limits: Option<(Millimetres, Millimetres)>,
}

/// How long a motion takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MoveTime {
    /// By speed and acceleration.
    pub predicted: Duration,
    /// Past this it has failed.
    pub maximum: Duration,
}

/// How sure it is that an axis was told to stop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum StopDelivery {
    /// The controller has said that the axis stands still.
    Confirmed,
    /// The stop was sent; no confirmation came in time.
    Sent,
    /// The stop could not be sent.
    Undeliverable,
}

impl fmt::Display for StopDelivery {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Confirmed => "stopped",
            Self::Sent => "stop sent, not confirmed",
            Self::Undeliverable => "STOP NOT DELIVERABLE",
        })
    }
}

/// One motorised axis. Every method may be called from any task; commands are carried out one after another by the
/// controller's owner task, but for [`Stage::stop`], which passes them all.
///
/// A command carries the [generation](Stage::generation) that it was admitted under, which may be long before it is
/// given: after a stop in between it no longer begins.
#[async_trait]
pub trait Stage: Send + Sync {
    /// What the stage is.
    fn info(&self) -> StageInfo;

    /// The axis's state, renewed at every reading: at least 5 times a second while it moves.
    fn state(&self) -> watch::Receiver<StageState>;

    /// Asks the controller now and returns the state read.
    ///
    /// # Errors
    /// When the controller does not answer.
    async fn read_state(&self) -> Result<StageState, DeviceError>;

    /// The other axis, where this one's controller can home only both at once: [`Stage::home`] then moves it, too.
    fn homes_also(&self) -> Option<AxisName> {
        None
    }

    /// The other axis, where this one's controller moves one of the two at a time, and a stop of either ends what moves.
    fn takes_turns_with(&self) -> Option<AxisName> {
        None
    }

    /// What a command that is admitted now carries. Every stop makes another one, and what carries an older one ends, or
    /// does not begin: [`DeviceError::Stopped`].
    fn generation(&self) -> u64;

    /// What a move between two positions takes, at the speed and acceleration that the axis really has.
    fn move_time(&self, from: Millimetres, to: Millimetres) -> MoveTime;

    /// Speed and acceleration that the axis really has.
    fn ramp(&self) -> Ramp {
        Ramp::RIGID
    }

    /// Runs the controller's homing on this axis and returns at its end.
    ///
    /// # Errors
    /// When the controller refuses, fails to find its switch, or is stopped.
    async fn home(&self, generation: u64) -> Result<(), DeviceError>;

    /// Why homing must not begin now, where it must not: a limit switch is pressed, and homing might take it for another.
    fn homing_barred(&self) -> Option<String> {
        None
    }

    /// Moves off a limit switch, by `distance_mm` towards a side, without knowing where the axis stands. Returns whether
    /// the switch has let go.
    ///
    /// # Errors
    /// When the controller refuses, or cannot tell; [`DeviceError::Stopped`].
    async fn step_off(&self, _towards: Side, _distance_mm: f64, _generation: u64) -> Result<bool, DeviceError> {
        let info = self.info();
        let reason = "it has no switch to move off".to_owned();
        Err(DeviceError::Refused { device: format!("the {} stage", info.axis), reason })
    }

    /// Says that the axis stands at `position` now, where it cannot be homed: the position counts as known from then on.
    /// Moves nothing, and writes nothing into the controller.
    ///
    /// # Errors
    /// When the controller does not answer, is in alarm, or the axis moves.
    async fn set_position(&self, position: Millimetres, generation: u64) -> Result<(), DeviceError>;

    /// Counts the position as unknown from now on: it was seen that the axis does not stand where it reads. Moves
    /// nothing, and writes nothing into the controller.
    fn forget_position(&self);

    /// Moves straight to `target` at `speed_mm_per_s`, or at the axis's greatest speed where that is less, and returns
    /// when the axis has been reported at rest twice, with the readback. Does not check limits beyond the controller's
    /// own, compensates no backlash.
    ///
    /// # Errors
    /// [`DeviceError::NotHomed`], [`DeviceError::Stopped`], [`DeviceError::Timeout`] past the move's maximum duration,
    /// or what the controller reports.
    async fn move_at(
        &self,
        target: Millimetres,
        speed_mm_per_s: f64,
        generation: u64,
    ) -> Result<Millimetres, DeviceError>;

    /// [`Stage::move_at`] the axis's greatest speed.
    ///
    /// # Errors
    /// As there.
    async fn move_to(&self, target: Millimetres, generation: u64) -> Result<Millimetres, DeviceError> {
        self.move_at(target, f64::INFINITY, generation).await
    }

    /// Moves along a course, which is asked while the axis moves how much farther it may be told to go: it does not come to
    /// rest between one piece of its way and the next where its controller can be told of more in motion. Returns at rest
    /// at the end of it, with the readback. Checks what [`Stage::move_at`] does.
    ///
    /// # Errors
    /// As [`Stage::move_at`].
    async fn follow(&self, mut course: Course, generation: u64) -> Result<Millimetres, DeviceError> {
        let mut at = self.state().borrow().position;
        while let Some(next) = course(Seen { at, speed_mm_per_s: 0.0 }) {
            self.move_at(next.to, next.speed_mm_per_s, generation).await?;
            at = next.to;
        }
        Ok(self.read_state().await?.position)
    }

    /// Switches the motor off so that the axis can be moved by hand. The position is unknown until homed again.
    ///
    /// # Errors
    /// When the controller refuses, or cannot.
    async fn release(&self, generation: u64) -> Result<(), DeviceError>;

    /// When the last byte of the newest stop order was handed to the operating system, if any ever was.
    fn stop_sent(&self) -> Option<Instant> {
        None
    }

    /// Stops the axis (and whatever else its controller moves) at once, passing every queue. Never fails: says how far
    /// the stop got.
    async fn stop(&self) -> StopDelivery;
}

/// Pose of one axis when a frame was exposed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisPose {
    /// Position read back, or `None` while unknown.
    pub position: Option<Millimetres>,
    /// Whether the axis had settled before the exposure began and stayed so.
    pub settled: bool,
}

/// A raw frame and when and where it was taken.
#[derive(Debug, Clone)]
pub struct Frame {
    /// The pixels.
    pub image: Arc<RawImage>,
    /// Sequence number from the source, growing; gaps are frames lost.
    pub seq: u64,
    /// Begin of the exposure, on the daemon's monotonic clock.
    pub exposed_from: Instant,
    /// End of the exposure, on the daemon's monotonic clock.
    pub exposed_to: Instant,
    /// Whether the exposure window is the driver's own or assumed from arrival time and frame interval.
    pub exposure_assumed: bool,
    /// Wall-clock time of the end of the exposure.
    pub captured_at: jiff::Timestamp,
    /// Pose of the focus axis.
    pub focus: AxisPose,
    /// Pose of the e axis.
    pub e: AxisPose,
    /// Whether this is a coarse picture for viewing only (the simulated bench's preview).
    pub preview: bool,
    /// Whether this frame was simulated.
    pub simulated: bool,
    /// Whether this frame was recorded earlier and is played from a file.
    pub replayed: bool,
}

impl Frame {
    /// Whether both axes had settled before the exposure began and stayed so.
    #[must_use]
    pub const fn is_settled(&self) -> bool {
        self.focus.settled && self.e.settled
    }
}

/// What a frame source is and how it fares.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraState {
    /// Driver's name, e.g. `v4l2`.
    pub driver: String,
    /// What the device says it is.
    pub identity: String,
    /// Whether frames arrive.
    pub online: bool,
    /// Why not, in words.
    pub fault: Option<String>,
    /// Frames lost so far, by gaps in the sequence; damaged ones included.
    pub frames_lost: u64,
    /// Frames that came damaged so far, by their driver's word or their bytes: none of them was shown or measured.
    pub frames_damaged: u64,
    /// Columns and rows of a frame, once known.
    pub size: Option<(usize, usize)>,
    /// The level at which its frames' scale ends, where that is not their greatest: 235 of video levels.
    pub white: Option<u16>,
    /// What is to be known about its frames, one sentence each: a clock that lies, pixels saturated.
    pub notes: Vec<String>,
    /// Whether recorded frames are played from files: nothing that is seen is happening now.
    pub replay: bool,
    /// Why [`FrameSource::frame`] gives none of its frames, however many come: they are not fit to be measured.
    pub unfit: Option<String>,
}

impl CameraState {
    /// A source that has sent nothing yet, and why.
    #[must_use]
    pub fn not_yet(driver: &str, why: &str) -> Self {
        Self {
            driver: driver.to_owned(),
            identity: String::new(),
            online: false,
            fault: Some(why.to_owned()),
            frames_lost: 0,
            frames_damaged: 0,
            size: None,
            white: None,
            notes: Vec::new(),
            replay: false,
            unfit: None,
        }
    }
}

/// A source of raw frames.
#[async_trait]
pub trait FrameSource: Send + Sync {
    /// What the source is and how it fares, renewed at every change.
    fn state(&self) -> watch::Receiver<CameraState>;

    /// The newest frame, for viewers. The source may lower its effort while nobody holds a receiver.
    fn live(&self) -> watch::Receiver<Option<Arc<Frame>>>;

    /// The newest frame there is, without asking for more.
    fn newest(&self) -> Option<Arc<Frame>>;

    /// A frame of full quality whose exposure began at or after `not_before`: what a measurement uses.
    ///
    /// # Errors
    /// When the camera is lost or sends nothing within its time-out, or its frames are not fit to be measured.
    async fn frame(&self, not_before: Instant) -> Result<Arc<Frame>, DeviceError>;

    /// What makes its pictures brighter or darker, exposure first; empty where it has nothing of the kind.
    ///
    /// # Errors
    /// When it is away, or does not answer.
    async fn controls(&self) -> Result<Vec<LightControl>, DeviceError> {
        Ok(Vec::new())
    }

    /// Sets one of its [controls](Self::controls) to a [value that it takes](LightControl::nearest). What is exposed after
    /// this has returned is exposed so, also once the camera was lost and came back.
    ///
    /// # Errors
    /// When it is away, does not answer, or refuses.
    async fn set_control(&self, name: ControlName, _value: f64) -> Result<(), DeviceError> {
        let reason = format!("it has no control of its {name}");
        Err(DeviceError::Refused { device: "the camera".to_owned(), reason })
    }

    /// Lets the camera go, so that whoever comes next has it at once; no frame comes after that. Takes a second at most.
    async fn end(&self) {}
}

/// Every device of one rig.
#[derive(Clone)]
pub struct Bench {
    /// The focus axis.
    pub focus: Arc<dyn Stage>,
    /// The e axis.
    pub e: Arc<dyn Stage>,
    /// The camera.
    pub camera: Arc<dyn FrameSource>,
    /// The simulated operator: present exactly when the bench is simulated.
    pub simulated: Option<Arc<dyn SimulatedOperator>>,
}

impl Bench {
    /// The stage of an axis.
    #[must_use]
    pub fn stage(&self, axis: AxisName) -> &Arc<dyn Stage> {
        match axis {
            AxisName::Focus => &self.focus,
            AxisName::E => &self.e,
        }
    }

    /// Whether this bench is simulated.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        self.simulated.is_some()
    }
}
