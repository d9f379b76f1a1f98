//! What stands before the lens: a frame of before it was set up shows another scene.

use jiff::Timestamp;
use tokio::time::Instant;

use crate::events::InView;
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

/// How far from the distance of focus a board may be asked for and stand there, mm: places are told to a tenth.
const PLACED_WITHIN_MM: f64 = 0.1;

impl InView {
    /// What stands there once that has been set up, where a board at this distance (mm from the principal point) is to be in
    /// focus in air; `None` where it stays what it is.
    pub(super) fn after(setup: &Setup, focused_mm: f64) -> Option<Self> {
        match setup {
            Setup::WaterBoard { .. } | Setup::LeastE { .. } => Some(Self::FlatBoard),
            Setup::AirTripleBoard { distances_mm: [near, middle, far] } if near == middle && middle == far => {
                let there = (near - focused_mm).abs() <= PLACED_WITHIN_MM;
                Some(if there { Self::FlatBoard } else { Self::BoardElsewhere })
            }
            Setup::AirTripleBoard { .. } => Some(Self::SteppedBoard),
            Setup::Diffuser | Setup::ShellOff => Some(Self::Other),
            Setup::Aperture { .. } => None,
        }
    }

    /// Whether the spacing of the whole field is the one that is aimed at, as far as is known. Where no board was, what can be
    /// read is of one that somebody has put up since.
    pub(super) const fn is_aimed_at(self) -> bool {
        !matches!(self, Self::SteppedBoard | Self::BoardElsewhere)
    }

    /// Whether it is known to be no flat board.
    pub(super) const fn lacks_flat_board(self) -> bool {
        matches!(self, Self::SteppedBoard | Self::Other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flat_board_is_where_it_is_to_be_in_focus_or_elsewhere() {
        let flat = |mm: f64| Setup::AirTripleBoard { distances_mm: [mm; 3] };
        assert_eq!(InView::after(&flat(167.2), 167.16), Some(InView::FlatBoard));
        assert_eq!(InView::after(&flat(179.7), 167.16), Some(InView::BoardElsewhere));
        let levels = Setup::AirTripleBoard { distances_mm: [150.0, 167.2, 180.0] };
        assert_eq!(InView::after(&levels, 167.16), Some(InView::SteppedBoard));
        assert!(!InView::BoardElsewhere.is_aimed_at() && InView::FlatBoard.is_aimed_at());
    }
}
