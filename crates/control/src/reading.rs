//! What the meter reads in one frame.

use std::sync::Arc;

use bench::device::Frame;
use plenoptics::imaging::combined::Combined;
use plenoptics::imaging::grid::GridError;
use plenoptics::imaging::live::{LiveError, LiveSpacing};
use plenoptics::imaging::spacing::SpacingError;

/// What is said of frames that come between two searches.
pub(crate) const SEARCHING: &str = "the spacing is searched for";

/// What the meter reads in one frame.
#[derive(Debug, Clone)]
pub struct Reading {
    /// The frame.
    pub frame: Arc<Frame>,
    /// Its spacing, or why there is none.
    pub spacing: Result<LiveSpacing, NoReading>,
    /// What it comes to with those before it while nothing has moved, px: there where the frame has a spacing.
    pub combined: Option<Combined>,
    /// The spacing wanted, px.
    pub spacing_target_px: f64,
    /// By how much it may be off that where a job accepts it, px.
    pub spacing_tolerance_px: f64,
    /// Whether there is a spacing, of one board as far as is known, and what is combined within the blur limit of that.
    pub in_focus: bool,
    /// Whether the spacing steps over the field as between two boards, and nothing measured in whole has said yet whether there
    /// are: it may be neither's. Or no frame can be measured in whole, though nothing moves: it may be none's.
    pub doubted: bool,
    /// Of one in doubt, why no frame could be measured in whole to end that, in words.
    pub unresolved: Option<String>,
    /// Frames that the camera took since somebody began to read, and that were not measured.
    pub frames_left_out: u64,
}

/// Why a frame gave no reading, in words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NoReading {
    /// The spacing could not be followed to this frame, and is searched for.
    Lost(String),
    /// The frame cannot be measured.
    Refused(String),
}

impl From<LiveError> for NoReading {
    fn from(error: LiveError) -> Self {
        let why = error.to_string();
        match error {
            // It shows something, and there is no telling at which spacing: the next may.
            LiveError::Spacing(
                SpacingError::NoMatch { .. }
                | SpacingError::BeyondRange { .. }
                | SpacingError::OtherMode { .. }
                | SpacingError::Unsettled { .. }
                | SpacingError::Ambiguous { .. },
            )
            | LiveError::Grid(GridError::DoesNotFit { .. } | GridError::NoLattice { .. })
            | LiveError::GridMoved { .. }
            | LiveError::GridNotSeen { .. }
            | LiveError::WhiteMisfit(_)
            | LiveError::Lost { .. } => Self::Lost(why),
            LiveError::NoStart => Self::Lost(SEARCHING.to_owned()),
            LiveError::Spacing(_) | LiveError::Grid(_) | LiveError::Vignetting(_) => Self::Refused(why),
        }
    }
}
