//! What stands before the lens: a frame of before it was set up shows another scene.

use jiff::Timestamp;
use tokio::time::Instant;

use super::events::InView;
use bench::device::Setup;

/// What stands before the lens, and since when.
#[derive(Debug, Clone, Copy)]
pub(super) struct SetUp {
    pub(super) in_view: InView,
    pub(super) since: Moment,
}

/// A moment, on the wall clock and on the one that nobody sets.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moment {
    pub(super) wall: Timestamp,
    pub(super) unset: Instant,
}

impl Moment {
    pub(super) fn now() -> Self {
        Self { wall: Timestamp::now(), unset: Instant::now() }
    }
}

impl InView {
    /// What stands there once that has been set up; `None` where it stays what it is.
    pub(super) fn after(setup: &Setup) -> Option<Self> {
        match setup {
            Setup::WaterBoard { .. } | Setup::LeastE { .. } => Some(Self::FlatBoard),
            Setup::AirTripleBoard { distances_mm: [near, middle, far] } if near == middle && middle == far => {
                Some(Self::FlatBoard)
            }
            Setup::AirTripleBoard { .. } => Some(Self::SteppedBoard),
            Setup::Diffuser | Setup::ShellOff => Some(Self::Other),
            Setup::Aperture { .. } => None,
        }
    }

    /// Whether it is known to be no flat board.
    pub(super) const fn lacks_flat_board(self) -> bool {
        matches!(self, Self::SteppedBoard | Self::Other)
    }
}
