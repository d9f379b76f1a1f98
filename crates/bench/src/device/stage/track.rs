//! A motion along a course, as its driver follows it: what has been told of it, and what is certain of the axis.

use std::time::Duration;

use tokio::time::Instant;

use crate::device::jog::{Next, Seen};
use plenoptics::units::Millimetres;

/// Least time between two looks at an axis that follows a course.
pub const CYCLE: Duration = Duration::from_millis(40);
/// Time after an order within which an axis need not be seen to move.
pub const BEGIN: Duration = Duration::from_millis(300);
/// Time after the last order in which every motion along a course is at its end: far more than it is told of at once.
pub const END: Duration = Duration::from_secs(3);
/// An axis this near to where it was told to go is there, mm: which side of it it is on says nothing.
const AT_END_MM: f64 = 0.01;
/// So much of a second's way is worth an order.
const WORTH_S: f64 = 0.02;
/// What a ramp, or a reading's age, may add to the way between two readings in motion, mm.
const SLACK_MM: f64 = 0.05;

/// The longest way, mm, that an axis of this greatest speed, mm/s, can have come between two readings in motion: what is
/// farther is a leap, which a digit lost on the line makes.
#[must_use]
pub fn reach_mm(speed_mm_per_s: f64, between: Duration) -> f64 {
    2.0 * speed_mm_per_s * between.as_secs_f64() + SLACK_MM
}

/// A motion along a course.
#[derive(Debug)]
pub struct Track {
    acceleration: f64,
    /// Where it was, and when that was asked.
    before: Option<(f64, Instant)>,
    told: Option<Next>,
    told_at: Instant,
    /// What the course said last.
    said: Option<Next>,
}

impl Track {
    /// One that nothing has been told of yet, of an axis with this acceleration, mm/s².
    #[must_use]
    pub fn new(acceleration: f64) -> Self {
        Self { acceleration, before: None, told: None, told_at: Instant::now(), said: None }
    }

    /// What is certain of the axis by a position that was asked for and heard at these times. Its speed is its mean since
    /// the one before, but for an axis that has begun to brake before the end of what it was told, and brakes on while the
    /// answer is on its way.
    pub fn see(&mut self, at: Millimetres, asked: Instant, heard: Instant) -> Seen {
        let mean = self
            .before
            .map_or(0.0, |(before, asked)| (at.value() - before).abs() / (heard - asked).as_secs_f64().max(1e-3));
        self.before = Some((at.value(), asked));
        let braking = self.told.map_or(0.0, |told| (2.0 * self.acceleration * (told.to - at).abs().value()).sqrt());
        let braking = braking - self.acceleration * (heard - asked).as_secs_f64();
        Seen { at, speed_mm_per_s: mean.min(braking).max(0.0) }
    }

    /// Whether what the course says is worth an order, given where the axis is: it leads on from what was told before.
    pub fn is_worth_an_order(&mut self, next: Next, at: Millimetres) -> bool {
        let Some(told) = self.told else { return true };
        let farther = (next.to - told.to).value() * (told.to - at).value().signum();
        // At the end of the course every bit is.
        let again = self.said.replace(next).is_some_and(|said| said.to == next.to);
        let enough = if again { 1e-6 } else { WORTH_S * next.speed_mm_per_s };
        farther > enough || (farther.abs() > enough && (told.to - at).abs().value() < AT_END_MM)
    }

    /// Whether a speed is another one than was told before.
    #[must_use]
    pub fn changes_speed(&self, next: Next) -> bool {
        self.told.is_none_or(|told| told.speed_mm_per_s != next.speed_mm_per_s)
    }

    /// Notes an order.
    pub fn tell(&mut self, next: Next) {
        (self.told, self.told_at) = (Some(next), Instant::now());
    }

    /// Where what was told ends.
    #[must_use]
    pub fn told(&self) -> Option<Millimetres> {
        self.told.map(|told| told.to)
    }

    /// How long ago the last order was.
    #[must_use]
    pub fn since_told(&self) -> Duration {
        self.told_at.elapsed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_certain_is_never_faster_than_the_axis() {
        let mut track = Track::new(20.0);
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        assert_eq!(track.see(Millimetres(1.0), at(0), at(10)).speed_mm_per_s, 0.0, "nothing is known yet");
        track.tell(Next { to: Millimetres(2.0), speed_mm_per_s: 5.0 });
        // Speeding up it is faster than its mean since the look before, from when that was asked to when this was heard.
        let seen = track.see(Millimetres(1.22), at(100), at(110));
        assert!((seen.speed_mm_per_s - 2.0).abs() < 1e-9, "{seen:?}");
        // So near the end of what it was told it brakes, v² = 2as, and has done so for as long as the answer took.
        let seen = track.see(Millimetres(1.9), at(250), at(260));
        assert!((seen.speed_mm_per_s - 1.8).abs() < 1e-9, "{seen:?}");
        // Told more, it does no longer.
        track.tell(Next { to: Millimetres(3.0), speed_mm_per_s: 5.0 });
        let seen = track.see(Millimetres(2.05), at(290), at(310));
        assert!((seen.speed_mm_per_s - 2.5).abs() < 1e-9, "{seen:?}");
        // By the time that this is heard it stands.
        let seen = track.see(Millimetres(2.99), at(490), at(590));
        assert_eq!(seen.speed_mm_per_s, 0.0, "{seen:?}");
    }

    #[test]
    fn only_what_leads_on_is_ordered() {
        let mut track = Track::new(20.0);
        let next = |to| Next { to: Millimetres(to), speed_mm_per_s: 5.0 };
        let at = Millimetres(9.5);
        assert!(track.is_worth_an_order(next(9.0), at));
        track.tell(next(9.0));
        assert!(!track.is_worth_an_order(next(9.2), at), "what was told is not taken back");
        assert!(!track.is_worth_an_order(next(8.95), at) && track.is_worth_an_order(next(8.8), at));
        assert!(!track.is_worth_an_order(next(8.99), at) && track.is_worth_an_order(next(8.99), at), "the end");
    }
}
