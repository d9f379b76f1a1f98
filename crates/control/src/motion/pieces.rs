//! Motion in pieces: whatever happens to the program, an axis ends within the piece that it has been told.
//!
//! A move is issued in pieces of at most [`MOVE`], one told when the one before has ended; and where the shell is on or may
//! be, a move towards it in pieces of at most [`NEAR_WALL_MM`] once it is within [`WALL_ZONE_MM`] of the wall.
//!
//! A jog is told more while it moves. What it has been told and has not done yet, braking included, takes at most [`JOG`],
//! and within that zone is at most [`NEAR_WALL_MM`]. So that it need not brake between, it goes no faster than that it
//! has its braking distance left when it hears of more, [`UNTOLD`] later.

use std::time::Duration;

use bench::device::Stage;
use bench::device::jog::{Next, Seen};
use bench::device::ramp::Ramp;
use plenoptics::units::Millimetres;

/// Longest piece of a move, by its predicted duration.
pub(super) const MOVE: Duration = Duration::from_secs(1);
/// All of a jog that is told and not yet done takes this long at most.
pub(super) const JOG: Duration = Duration::from_millis(300);
/// From a look at an axis that is jogged to the next order, at the latest, where its controller is heard in time.
pub(super) const UNTOLD: Duration = Duration::from_millis(100);
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
    /// Pieces that a stage makes within `time`.
    pub(super) fn within(time: Duration, stage: &dyn Stage, wall_mm: Option<f64>) -> Self {
        let from = stage.state().borrow().position;
        let makes = |mm: f64| stage.move_time(from, Millimetres(from.value() + mm)).predicted <= time;
        Self { longest_mm: longest(makes), wall_mm }
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

/// The speed (mm/s) at which an axis jogs that is asked to go at `asked` mm/s.
pub(super) fn jog_speed(ramp: Ramp, asked: f64) -> f64 {
    ramp.at_most(asked).steady(JOG.as_secs_f64(), UNTOLD.as_secs_f64())
}

/// How far ahead of where it is an axis that is jogged is told to go.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ahead {
    ramp: Ramp,
    wall_mm: Option<f64>,
}

impl Ahead {
    /// Of an axis that is asked to go at `asked` mm/s; `wall_mm` as of [`Pieces`].
    pub(super) fn new(ramp: Ramp, asked: f64, wall_mm: Option<f64>) -> Self {
        Self { ramp: ramp.at_most(jog_speed(ramp, asked)), wall_mm }
    }

    /// How far on its way to `end` it may be told to go.
    pub(super) fn next(&self, seen: Seen, end: Millimetres) -> Next {
        let (at, to) = (seen.at.value(), end.value());
        // Before the zone, and how far; within it, 0.
        let outside = self.wall_mm.filter(|_| to < at).map(|wall| (at - (wall + WALL_ZONE_MM)).max(0.0));
        let ramp = match outside {
            Some(0.0) => self.ramp.at_most(self.ramp.steady_within(NEAR_WALL_MM, UNTOLD.as_secs_f64())),
            _ => self.ramp,
        };
        let within = outside.map_or(f64::INFINITY, |outside| outside + NEAR_WALL_MM);
        let reach = ramp.reach(seen.speed_mm_per_s, JOG.as_secs_f64()).min(within);
        let ahead = at + (to - at).clamp(-reach, reach);
        let to = if (to - ahead).abs() < 1e-6 { end } else { Millimetres(ahead) };
        Next { to, speed_mm_per_s: ramp.speed_mm_per_s }
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
    fn a_jog_is_told_so_much_that_it_keeps_its_speed_and_ends_in_time() {
        let ramp = Ramp { speed_mm_per_s: 5.0, acceleration_mm_per_s2: 20.0 };
        assert!((jog_speed(ramp, 5.0) - 4.0).abs() < 1e-12 && jog_speed(ramp, 1.0) == 1.0);
        let ahead = Ahead::new(ramp, 5.0, Some(-0.1));
        let next = |at: f64, speed_mm_per_s: f64, end: f64| {
            let next = ahead.next(Seen { at: Millimetres(at), speed_mm_per_s }, Millimetres(end));
            (next.to.value() - at, next.speed_mm_per_s)
        };
        // From rest a triangle: 0.3 s of it. At speed 0.1 s of it are left over for the next order.
        let (rest, speed) = next(10.0, 0.0, 20.0);
        assert!((rest - 0.45).abs() < 1e-9 && (speed - 4.0).abs() < 1e-9, "{rest} at {speed}");
        assert!((next(10.0, 4.0, 20.0).0 - (0.1 * 4.0 + 0.4)).abs() < 1e-9);
        assert!((next(10.0, 4.0, 10.1).0 - 0.1).abs() < 1e-9, "no farther than its end");
        // Towards the wall: 0.2 mm into the zone, and 0.2 mm within it, at a speed that can be kept there.
        assert!((next(1.0, 4.0, -0.1).0 + 0.3).abs() < 1e-9, "{:?}", next(1.0, 4.0, -0.1));
        let (near, speed) = next(0.5, 1.0, -0.1);
        assert!((near + 0.2).abs() < 1e-9 && (1.4..1.5).contains(&speed), "{near} at {speed}");
        assert!((next(0.1, 1.0, -0.1).0 + 0.2).abs() < 1e-9);
        assert!(next(0.1, 4.0, 20.0).0 > 0.7, "away from the shell nothing is near");
    }

    #[test]
    fn the_longest_piece_is_what_can_be_made_in_time() {
        assert!((longest(|mm| mm <= 0.45) / 0.45 - 1.0).abs() < 0.011);
        assert!(longest(|_| true) >= 1e4);
        assert!(longest(|_| false) > 0.0);
    }
}
