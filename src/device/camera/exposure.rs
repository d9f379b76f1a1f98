//! When a frame was exposed, from what its driver says or, where that is not plausible, from when it arrived.

use std::time::Duration;

/// A driver's time for a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stamp {
    /// How long before the frame's arrival the timestamp lies, s; negative for a time in the future.
    pub age_s: f64,
    /// Whether it marks the start of the exposure (else the end of the frame).
    pub at_start: bool,
}

/// An exposure window, as ages before the frame's arrival.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Age of the window's begin.
    pub from_age: Duration,
    /// Age of its end: no greater.
    pub to_age: Duration,
    /// Whether it is assumed from the arrival instead of told by the driver.
    pub assumed: bool,
}

/// The window in which a frame that has just arrived was exposed. The exposure time is at most a frame interval and
/// not known better, so the window is an interval long: too long rather than too short.
///
/// A timestamp is believed when it lies neither in the future (drivers that stamp the end of a frame have been seen
/// most of an interval ahead) nor more than `longest_age` back. Otherwise the frame is taken to have been exposed
/// within the two intervals before it arrived: one of exposure and one of read-out.
#[must_use]
pub fn window(stamp: Option<Stamp>, interval: Duration, delay: Duration, longest_age: Duration) -> Window {
    let believed = stamp.filter(|stamp| stamp.age_s >= 0.0 && stamp.age_s <= longest_age.as_secs_f64());
    match believed {
        Some(stamp) => {
            let age = Duration::from_secs_f64(stamp.age_s) + delay;
            let (from_age, to_age) =
                if stamp.at_start { (age, age.saturating_sub(interval)) } else { (age + interval, age) };
            Window { from_age, to_age, assumed: false }
        }
        None => Window { from_age: 2 * interval + delay, to_age: Duration::ZERO, assumed: true },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INTERVAL: Duration = Duration::from_millis(40);
    const LONGEST: Duration = Duration::from_secs(1);

    fn ages(stamp: Option<Stamp>, delay_ms: u64) -> (u128, u128, bool) {
        let window = window(stamp, INTERVAL, Duration::from_millis(delay_ms), LONGEST);
        (window.from_age.as_millis(), window.to_age.as_millis(), window.assumed)
    }

    #[test]
    fn a_plausible_time_is_believed() {
        assert_eq!(ages(Some(Stamp { age_s: 0.05, at_start: true }), 0), (50, 10, false));
        assert_eq!(ages(Some(Stamp { age_s: 0.01, at_start: false }), 5), (55, 15, false));
        assert_eq!(ages(Some(Stamp { age_s: 0.01, at_start: true }), 0), (10, 0, false), "never ends in the future");
    }

    #[test]
    fn any_other_is_replaced_by_a_window_that_holds_the_exposure() {
        for age_s in [-0.028, 2.0, f64::NAN, f64::INFINITY] {
            assert_eq!(ages(Some(Stamp { age_s, at_start: false }), 0), (80, 0, true));
        }
        assert_eq!(ages(None, 10), (90, 0, true));
    }
}
