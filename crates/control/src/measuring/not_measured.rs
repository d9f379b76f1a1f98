//! Why there is no measurement.

use std::fmt;

use bench::device::DeviceError;

/// What is said of a frame that has the very picture of one before it.
pub(crate) const OLD_PICTURE: &str = "two frames are the same to the last pixel: the camera gives an old picture again \
                                      as if it were new; unplug it and plug it in again";

/// Why there is no measurement.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum NotMeasured {
    /// The frame cannot be measured.
    Unmeasurable {
        /// Why, in words.
        why: String,
    },
    /// The camera gives an old picture again.
    OldPicture,
    /// The frame shows two boards where one was asked for.
    TwoBoards {
        /// What it shows, and what to do, in words.
        why: String,
        /// The spacings of the two, px.
        spacings_px: [f64; 2],
    },
    /// A device gives no frame, or not one that was asked for.
    Device(DeviceError),
    /// No frame could be measured, whatever it shows.
    Failed {
        /// Why, in words.
        why: String,
    },
}

impl NotMeasured {
    pub(super) fn failed(why: impl Into<String>) -> Self {
        Self::Failed { why: why.into() }
    }
}

impl fmt::Display for NotMeasured {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unmeasurable { why } | Self::TwoBoards { why, .. } | Self::Failed { why } => f.write_str(why),
            Self::OldPicture => f.write_str(OLD_PICTURE),
            Self::Device(error) => error.fmt(f),
        }
    }
}

impl From<DeviceError> for NotMeasured {
    fn from(error: DeviceError) -> Self {
        Self::Device(error)
    }
}
