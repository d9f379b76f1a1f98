//! Why a job ends before it has done what it is to do.

use crate::field::Invalid;
use crate::job::steps::Repeatable;
use crate::loops::axis_model::MoveFault;
use crate::measuring::not_measured::NotMeasured;
use crate::refusal::{Refusal, ServiceError};
use bench::device::DeviceError;

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
    /// There is no measurement.
    NotMeasured(NotMeasured),
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
            Self::Failed { why } | Self::Cancelled { why } | Self::NotConverged { why } => why,
            Self::NotMeasured(why) => why.to_string(),
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

impl From<NotMeasured> for JobEnd {
    fn from(error: NotMeasured) -> Self {
        match error {
            // A stop is none of the camera's.
            NotMeasured::Device(error) => error.into(),
            why => Self::NotMeasured(why),
        }
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
