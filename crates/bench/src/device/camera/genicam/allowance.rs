//! How many cameras may be asked what they are and what they offer, and how long that may take.

use std::time::{Duration, Instant};

/// No more cameras are asked after so long.
const LOOK_WITHIN: Duration = Duration::from_secs(20);
/// One camera is asked for so long, so that one that is slow leaves time for others.
const ONE_WITHIN: Duration = Duration::from_secs(10);

/// How many cameras may still be read, and until when.
pub(super) struct Allowance {
    cameras: usize,
    until: Instant,
    /// How many were not read, because they would have been too many.
    unread: usize,
    /// Where those are that there was no time for.
    unasked: Vec<String>,
}

impl Allowance {
    /// From now on, the descriptions of so many.
    pub(super) fn of(cameras: usize) -> Self {
        Self { cameras, until: Instant::now() + LOOK_WITHIN, unread: 0, unasked: Vec::new() }
    }

    /// Until when the camera at this place may be asked; `None`, which is noted, where there is no time for it.
    pub(super) fn time_for(&mut self, place: &str) -> Option<Instant> {
        if self.is_over() {
            self.miss(place);
            return None;
        }
        Some(self.until.min(Instant::now() + ONE_WITHIN))
    }

    /// Whether no more time is left.
    pub(super) fn is_over(&self) -> bool {
        Instant::now() >= self.until
    }

    /// The time did not suffice for the camera at this place.
    pub(super) fn miss(&mut self, place: &str) {
        self.unasked.push(place.to_owned());
    }

    /// Whether another camera may be read.
    pub(super) fn take(&mut self) -> bool {
        let granted = self.cameras > 0;
        self.cameras = self.cameras.saturating_sub(1);
        self.unread += usize::from(!granted);
        granted
    }

    /// What was not done, one sentence each.
    pub(super) fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.unread > 0 {
            notes.push(format!("what {} more of the cameras offer has not been read yet: look again", self.unread));
        }
        if !self.unasked.is_empty() {
            let (within, which) = (LOOK_WITHIN.as_secs(), self.unasked.join(", "));
            notes.push(format!("within {within} s there was no time to ask {which}: look again"));
        }
        notes
    }
}

/// How long it is until then.
pub(super) fn left(until: Instant) -> Duration {
    until.saturating_duration_since(Instant::now())
}

#[cfg(test)]
impl Allowance {
    /// One whose time is over.
    pub(super) fn over() -> Self {
        Self { until: Instant::now(), ..Self::of(1) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_more_cameras_are_read_than_allowed_nor_longer() {
        let mut few = Allowance::of(1);
        assert!(few.take() && !few.take() && !few.take());
        let until = few.time_for("there").unwrap();
        assert!(left(until) <= ONE_WITHIN && left(until) > Duration::ZERO, "{:?}", left(until));
        assert_eq!(few.notes(), ["what 2 more of the cameras offer has not been read yet: look again"]);
        // What is left, where that is less.
        let mut short = Allowance { until: Instant::now() + ONE_WITHIN / 2, ..Allowance::of(1) };
        assert_eq!(short.time_for("there"), Some(short.until));
        let mut late = Allowance::over();
        assert_eq!((late.time_for("/dev/one"), late.time_for("10.0.0.2")), (None, None));
        assert_eq!(late.notes(), ["within 20 s there was no time to ask /dev/one, 10.0.0.2: look again"]);
        assert_eq!(Allowance::of(1).notes(), Vec::<String>::new());
    }
}
