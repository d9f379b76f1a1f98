//! When a frame was exposed, from what its driver says or, where that is not plausible, from when it arrived.

use std::time::Duration;

/// A driver's time for a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stamp {
    /// The time, s, on the system's monotonic clock; `None` where the driver says that it is of another clock.
    pub at_s: Option<f64>,
    /// What that clock says now, s.
    pub now_s: f64,
    /// Whether it marks the start of the exposure (else the end of the frame).
    pub at_start: bool,
}

/// What is impossible of a stamp whose age is between `least` and `most`, s: that it lies in the future or more than `longest`
/// back, or has not grown since the one before. `None` where nothing is.
pub(super) fn impossible([least, most]: [f64; 2], longest: Duration, grown: bool) -> Option<String> {
    if most < 0.0 {
        Some(format!("lie in the future, by {:.1} ms", -most * 1e3))
    } else if least > longest.as_secs_f64() {
        Some(format!("lie {least:.1} s back"))
    } else {
        (!grown).then(|| "do not grow from frame to frame".to_owned())
    }
}

/// That timestamps are not believed, and whose they are, as a sentence.
pub(super) fn stood_in_for(whose: &str, lie: &str) -> String {
    format!("the {whose}'s timestamps {lie}: the time of a frame's arrival stands in for them")
}

/// What one driver's clock is worth. A clock that has told one impossible time is not believed any more: its other
/// times are off by as much, and only look possible.
#[derive(Debug, Clone, Default)]
pub struct Clock {
    last_s: Option<f64>,
    lie: Option<String>,
}

impl Clock {
    /// The age of a frame's stamp and whether it is of the exposure's start; `None` where the frame's arrival must
    /// stand in for it. No stamp is believed that lies in the future (drivers that stamp the end of a frame have been
    /// seen most of an interval ahead), more than `longest_age` back, or not after the one before.
    pub fn judge(&mut self, stamp: Stamp, longest_age: Duration) -> Option<(Duration, bool)> {
        let lie = match (stamp.at_s, self.last_s) {
            (None, _) => Some("are not of the monotonic clock".to_owned()),
            (Some(at), _) if !at.is_finite() => Some("are no numbers".to_owned()),
            (Some(at), last) => {
                let age = stamp.now_s - at;
                impossible([age, age], longest_age, last.is_none_or(|last| at > last))
            }
        };
        self.last_s = stamp.at_s;
        if self.lie.is_none() {
            self.lie = lie;
        }
        match stamp.at_s {
            Some(at) if self.lie.is_none() => {
                Some((Duration::from_secs_f64((stamp.now_s - at).max(0.0)), stamp.at_start))
            }
            _ => None,
        }
    }

    /// Why the clock is not believed, as a sentence.
    #[must_use]
    pub fn complaint(&self) -> Option<String> {
        let lie = self.lie.as_ref()?;
        Some(stood_in_for("driver", lie))
    }
}

/// An exposure window, as ages before now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Age of the window's begin.
    pub from_age: Duration,
    /// Age of its end: no greater.
    pub to_age: Duration,
    /// Whether it is assumed from the arrival instead of told by the driver.
    pub assumed: bool,
}

/// The window in which a frame was exposed. Exposure and read-out are at most a frame interval each and not known
/// better, so the window is too long rather than too short.
///
/// `stamp` is what [`Clock::judge`] believes. Without it the frame is taken to have been exposed within the two
/// intervals before it arrived, at most `arrived_age` ago: since then it may have waited in the queue. `delay` is what
/// passes between exposure and stamp, or arrival, besides.
#[must_use]
pub fn window(stamp: Option<(Duration, bool)>, arrived_age: Duration, interval: Duration, delay: Duration) -> Window {
    match stamp {
        Some((age, true)) => {
            let from_age = age + delay;
            Window { from_age, to_age: from_age.saturating_sub(interval), assumed: false }
        }
        Some((age, false)) => {
            let to_age = age + delay;
            Window { from_age: to_age + 2 * interval, to_age, assumed: false }
        }
        None => Window { from_age: arrived_age + 2 * interval + delay, to_age: Duration::ZERO, assumed: true },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INTERVAL: Duration = Duration::from_millis(40);
    const LONGEST: Duration = Duration::from_secs(1);

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn at(at_s: f64) -> Stamp {
        Stamp { at_s: Some(at_s), now_s: 100.0, at_start: true }
    }

    fn ages(stamp: Option<(Duration, bool)>, arrived_age: u64, delay: u64) -> (u128, u128, bool) {
        let window = window(stamp, ms(arrived_age), INTERVAL, ms(delay));
        (window.from_age.as_millis(), window.to_age.as_millis(), window.assumed)
    }

    #[test]
    fn a_window_holds_exposure_and_read_out() {
        assert_eq!(ages(Some((ms(50), true)), 3, 0), (50, 10, false));
        assert_eq!(ages(Some((ms(10), false)), 3, 5), (95, 15, false));
        assert_eq!(ages(Some((ms(10), true)), 3, 0), (10, 0, false), "never ends in the future");
    }

    #[test]
    fn without_a_stamp_the_time_in_the_queue_counts() {
        assert_eq!(ages(None, 0, 10), (90, 0, true));
        assert_eq!(ages(None, 700, 0), (780, 0, true));
    }

    #[test]
    fn a_plausible_clock_is_believed() {
        let mut clock = Clock::default();
        let age = |judged: Option<(Duration, bool)>| judged.map(|(age, start)| (age.as_millis(), start));
        assert_eq!(age(clock.judge(at(99.75), LONGEST)), Some((250, true)));
        assert_eq!(age(clock.judge(Stamp { at_start: false, ..at(99.875) }, LONGEST)), Some((125, false)));
        assert_eq!(clock.complaint(), None);
    }

    #[test]
    fn a_clock_that_lied_once_is_not_believed_again() {
        for (lie, words) in [
            (at(100.028), "in the future, by 28.0 ms"),
            (at(90.0), "lie 10.0 s back"),
            (at(99.5), "do not grow"),
            (at(99.4), "do not grow"),
            (at(f64::NAN), "no numbers"),
            (Stamp { at_s: None, ..at(0.0) }, "not of the monotonic clock"),
        ] {
            let mut clock = Clock::default();
            assert!(clock.judge(at(99.5), LONGEST).is_some());
            assert_eq!(clock.judge(lie, LONGEST), None, "{words}");
            assert_eq!(clock.judge(at(99.9), LONGEST), None, "{words}");
            assert!(clock.complaint().unwrap().contains(words), "{:?}", clock.complaint());
        }
    }
}
