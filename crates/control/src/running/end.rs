//! Why a job ends before it has done what it is to do.

use crate::field::Invalid;
use crate::job::steps::Repeatable;
use crate::loops::axis_model::MoveFault;
use crate::refusal::{Refusal, ServiceError};
use bench::device::DeviceError;

/// What is said of a frame that has the very picture of one before it.
pub(crate) const OLD_PICTURE: &str = "two frames are the same to the last pixel: the camera gives an old picture again \
                                      as if it were new; unplug it and plug it in again";

/// Why a job ends before it has converged.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum JobEnd {
    /// Cancelled, or stopped.
    Cancelled {
        /// By what.
        why: String,
    },
    /// The criterion cannot be met.
    NotConverged {
        /// Why.
        why: String,
    },
    /// A frame cannot be measured.
    Unmeasurable {
        /// Why, in words.
        why: String,
    },
    /// The camera gives an old picture again.
    OldPicture,
    /// A frame shows two boards where one was asked for.
    TwoBoards {
        /// What it shows, and what to do, in words.
        why: String,
        /// The spacings of the two, px.
        spacings_px: [f64; 2],
    },
    /// It does not end: the operator has asked for an earlier step again, and whoever can begin there anew does.
    Repeat(Repeatable),
    /// The picture has shown that an axis does not stand where it reads.
    NotFollowed(MoveFault),
    /// Something failed.
    Failed {
        /// What.
        why: String,
    },
}

impl JobEnd {
    pub(crate) fn failed(why: impl Into<String>) -> Self {
        Self::Failed { why: why.into() }
    }

    /// Why, in words.
    pub(crate) fn why(self) -> String {
        match self {
            Self::Failed { why }
            | Self::TwoBoards { why, .. }
            | Self::Unmeasurable { why }
            | Self::Cancelled { why }
            | Self::NotConverged { why } => why,
            Self::OldPicture => OLD_PICTURE.to_owned(),
            Self::NotFollowed(fault) => fault.to_string(),
            Self::Repeat(_) => {
                "a step was asked for again where none can be; this is a defect of the program".to_owned()
            }
        }
    }
}

impl From<MoveFault> for JobEnd {
    fn from(fault: MoveFault) -> Self {
        Self::NotFollowed(fault)
    }
}

impl From<ServiceError> for JobEnd {
    fn from(error: ServiceError) -> Self {
        match error {
            ServiceError::Refused(Refusal::Stopped) | ServiceError::Device(DeviceError::Stopped { .. }) => {
                Self::Cancelled { why: "stopped".to_owned() }
            }
            ServiceError::Refused(error @ (Refusal::ControlEnded { .. } | Refusal::LeaseLost { .. })) => {
                Self::Cancelled { why: error.to_string() }
            }
            error => Self::failed(error.to_string()),
        }
    }
}

impl From<DeviceError> for JobEnd {
    fn from(error: DeviceError) -> Self {
        ServiceError::Device(error).into()
    }
}

impl From<Invalid> for JobEnd {
    fn from(invalid: Invalid) -> Self {
        ServiceError::from(invalid).into()
    }
}
