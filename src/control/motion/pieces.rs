//! Motion in pieces: whatever happens to the program, an axis ends within the piece that it has been told.
//!
//! A move is issued in pieces of at most [`MOVE`], a jog in pieces of at most [`JOG`]; and where the shell is on or may
//! be, a move towards it in pieces of at most [`NEAR_WALL_MM`] once it is within [`WALL_ZONE_MM`] of the wall.

use std::time::Duration;

use crate::device::Stage;
use crate::units::Millimetres;

/// Longest piece of a move, by its predicted duration.
pub(super) const MOVE: Duration = Duration::from_secs(1);
/// Longest piece of a jog.
pub(super) const JOG: Duration = Duration::from_millis(300);
/// Longest piece towards the shell near the wall, mm.
pub(super) const NEAR_WALL_MM: f64 = 0.2;
/// What is near the wall, mm.
pub(super) const WALL_ZONE_MM: f64 = 1.0;

/// What a piece of motion is bounded by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pieces {
    longest_mm: f64,
    /// The e wall (mm) where it may not be approached but in short pieces.
    wall_mm: Option<f64>,
}

impl Pieces {
    /// Pieces that a stage makes within `time` at `speed_mm_per_s`, or at its greatest speed where that is less.
    pub(super) fn within(time: Duration, stage: &dyn Stage, speed_mm_per_s: f64, wall_mm: Option<f64>) -> Self {
        let from = stage.state().borrow().position;
        let makes = |mm: f64| stage.move_time(from, Millimetres(from.value() + mm)).predicted <= time;
        let longest_mm = longest(makes).min(speed_mm_per_s * time.as_secs_f64());
        Self { longest_mm, wall_mm }
    }

    /// Where the next piece on the way to `target` ends.
    pub(super) fn next(&self, from: Millimetres, target: Millimetres) -> Millimetres {
        let (from, to) = (from.value(), target.value());
        let longest = match self.wall_mm {
            // To the zone at once, within it in short pieces.
            Some(wall) if to < from => {
                let outside = from - (wall + WALL_ZONE_MM);
                self.longest_mm.min(if outside > 1e-9 { outside } else { NEAR_WALL_MM })
            }
            _ => self.longest_mm,
        };
        let end = from + (to - from).clamp(-longest, longest);
        // No remainder too small for a controller to carry out.
        if (to - end).abs() < 1e-6 { target } else { Millimetres(end) }
    }
}

/// The longest distance (mm) that can be made, to a hundredth; a ten-thousandth of a millimetre at least, so that a move
/// ends.
fn longest(makes: impl Fn(f64) -> bool) -> f64 {
    let (mut low, mut high) = (1e-4, 1e4);
    if makes(high) {
        return high;
    }
    while high / low > 1.01 {
        let middle = f64::sqrt(low * high);
        if makes(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    fn way(pieces: Pieces, from: f64, to: f64) -> Vec<f64> {
        let (mut at, mut ends) = (Millimetres(from), Vec::new());
        while at != Millimetres(to) {
            at = pieces.next(at, Millimetres(to));
            ends.push(at.value());
            assert!(ends.len() < 1000, "{ends:?}");
        }
        ends
    }

    fn close(found: &[f64], wanted: &[f64]) {
        assert_eq!(found.len(), wanted.len(), "{found:?}");
        assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}");
    }

    #[test]
    fn a_move_is_cut_into_pieces_and_ends_where_it_should() {
        let pieces = Pieces { longest_mm: 4.0, wall_mm: None };
        close(&way(pieces, 0.0, 10.0), &[4.0, 8.0, 10.0]);
        close(&way(pieces, 10.0, 9.5), &[9.5]);
    }

    #[test]
    fn near_the_wall_towards_the_shell_pieces_are_short() {
        let pieces = Pieces { longest_mm: 4.0, wall_mm: Some(-0.1) };
        close(&way(pieces, 6.0, 0.3), &[2.0, 0.9, 0.7, 0.5, 0.3]);
        close(&way(pieces, 0.95, 0.85), &[0.9, 0.85]);
        close(&way(pieces, 6.0, 1.5), &[2.0, 1.5]);
        // Away from the shell nothing is near.
        close(&way(pieces, 0.0, 5.0), &[4.0, 5.0]);
        // From beyond the wall, deeper still: short, too (it is refused elsewhere).
        close(&way(pieces, -0.5, -0.8), &[-0.7, -0.8]);
    }

    #[test]
    fn the_longest_piece_is_what_can_be_made_in_time() {
        assert!((longest(|mm| mm <= 0.45) / 0.45 - 1.0).abs() < 0.011);
        assert!(longest(|_| true) >= 1e4);
        assert!(longest(|_| false) > 0.0);
    }
}
