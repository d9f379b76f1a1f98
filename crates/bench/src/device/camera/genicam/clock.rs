//! A camera's clock against the host's: how long ago, by the host's, a frame was stamped, and how surely.

use std::time::{Duration, Instant};

use crate::config::TimestampMeans;
use crate::device::camera::exposure::{self, Window};

/// How far two clocks drift apart at most, relative: 100 ppm of the camera's crystal, 500 ppm by which a host's clock is
/// slewed.
const DRIFT: f64 = 600e-6;

/// One reading of the camera's clock.
#[derive(Debug, Clone, Copy)]
pub(super) struct Latch {
    /// What it read.
    pub(super) ticks: u64,
    /// Before the camera was asked.
    pub(super) before: Instant,
    /// Once it had answered: the reading is of a moment in between.
    pub(super) after: Instant,
}

/// Bounds of how long ago a frame was stamped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ages {
    /// It cannot be longer ago.
    pub(super) most: Duration,
    /// It cannot be less long ago.
    pub(super) least: Duration,
}

/// What a camera's clock is worth. One that has told one impossible time is not believed any more until the camera is
/// opened again.
#[derive(Debug)]
pub(super) struct DeviceClock {
    /// Ticks a second.
    hz: f64,
    latch: Latch,
    last_ticks: Option<u64>,
    lie: Option<String>,
}

impl DeviceClock {
    /// A clock of so many ticks a second, and a reading of it.
    pub(super) const fn new(hz: f64, latch: Latch) -> Self {
        Self { hz, latch, last_ticks: None, lie: None }
    }

    fn doubt(&mut self, lie: Option<String>) {
        if self.lie.is_none() {
            self.lie = lie;
        }
    }

    /// Seconds from one reading to another, by the camera.
    pub(super) fn seconds(&self, from: u64, to: u64) -> f64 {
        (i128::from(to) - i128::from(from)) as f64 / self.hz
    }

    /// How unsure times near `at` are by a reading, s.
    fn unsure(latch: &Latch, at: Instant) -> f64 {
        (latch.after - latch.before).as_secs_f64() + DRIFT * (at - latch.after).as_secs_f64()
    }

    /// Takes a later reading.
    pub(super) fn renew(&mut self, latch: Latch) {
        let passed = self.seconds(self.latch.ticks, latch.ticks);
        let least = latch.before.saturating_duration_since(self.latch.after).as_secs_f64();
        let most = latch.after.saturating_duration_since(self.latch.before).as_secs_f64();
        self.doubt(if passed <= 0.0 {
            Some("do not go on".to_owned())
        } else if passed < least * (1.0 - DRIFT) || passed > most * (1.0 + DRIFT) {
            Some(format!("run at another rate than it says: {passed:.4} s in {least:.4} s to {most:.4} s"))
        } else {
            None
        });
        // A reading that was long under way says less than an older one.
        if self.lie.is_some() || Self::unsure(&latch, latch.after) <= Self::unsure(&self.latch, latch.after) {
            self.latch = latch;
        }
    }

    /// How long ago, as of `now`, a frame was stamped with `ticks`; `None` where its arrival must stand in for that. No stamp
    /// is believed that lies in the future, more than `longest` back, or not after the one before.
    pub(super) fn judge(&mut self, ticks: u64, now: Instant, longest: Duration) -> Option<Ages> {
        let since = self.seconds(self.latch.ticks, ticks);
        let drift = DRIFT * since.abs();
        let most = now.saturating_duration_since(self.latch.before).as_secs_f64() - since + drift;
        let least = now.saturating_duration_since(self.latch.after).as_secs_f64() - since - drift;
        let grown = self.last_ticks.is_none_or(|last| ticks > last);
        self.doubt(exposure::impossible([least, most], longest, grown));
        self.last_ticks = Some(ticks);
        self.lie.is_none().then(|| Ages {
            most: Duration::from_secs_f64(most.max(0.0)),
            least: Duration::from_secs_f64(least.max(0.0)),
        })
    }

    /// A frame came without a stamp.
    pub(super) fn miss(&mut self) {
        self.doubt(Some("are missing".to_owned()));
    }

    /// Why the clock is not believed, as a sentence.
    pub(super) fn complaint(&self) -> Option<String> {
        let lie = self.lie.as_ref()?;
        Some(exposure::stood_in_for("camera", lie))
    }
}

/// The window in which a frame was exposed, too long rather than too short: exposure and read-out are at most an
/// `interval` each.
///
/// `stamped` is what [`DeviceClock::judge`] believes; without it the arrival counts, at most `arrived_age` ago, before which
/// the frame may have been on its way for an interval, too. `delay` is what passes between exposure and stamp, or arrival,
/// besides.
pub(super) fn window(
    means: TimestampMeans,
    stamped: Option<Ages>,
    arrived_age: Duration,
    interval: Duration,
    delay: Duration,
) -> Window {
    let (most, least) = match stamped.filter(|_| means != TimestampMeans::Arrival) {
        Some(ages) => (ages.most + delay, ages.least + delay),
        None => return exposure::window(None, arrived_age + interval, interval, delay),
    };
    // A rolling shutter's last row is exposed, and read out, later than the first.
    let (from_age, to_age) = match means {
        TimestampMeans::ExposureStart => (most, least.saturating_sub(2 * interval)),
        TimestampMeans::ExposureEnd => (most + 2 * interval, least.saturating_sub(interval)),
        TimestampMeans::Readout | TimestampMeans::Arrival => (most + 2 * interval, Duration::ZERO),
    };
    Window { from_age, to_age, assumed: false }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const LONGEST: Duration = Duration::from_secs(5);

    fn s(seconds: f64) -> Duration {
        Duration::from_secs_f64(seconds)
    }

    /// A clock of 1 MHz that read 5 s at `origin` + 10 s, the answer 2 ms under way.
    fn clock(origin: Instant) -> DeviceClock {
        DeviceClock::new(1e6, Latch { ticks: 5_000_000, before: origin + s(10.0), after: origin + s(10.002) })
    }

    #[test]
    fn an_age_is_as_sure_as_the_reading_was_quick() {
        let origin = Instant::now();
        let ages = clock(origin).judge(5_500_000, origin + s(10.6), LONGEST).unwrap();
        // Half a second after the reading, of which 600 ppm are 0.3 ms.
        assert!((ages.most.as_secs_f64() - 0.1003).abs() < 1e-6, "{ages:?}");
        assert!((ages.least.as_secs_f64() - 0.0977).abs() < 1e-6, "{ages:?}");
    }

    #[test]
    fn a_slow_reading_does_not_replace_a_quick_one() {
        let origin = Instant::now();
        let mut clock = clock(origin);
        clock.renew(Latch { ticks: 6_040_000, before: origin + s(11.0), after: origin + s(11.08) });
        assert_eq!(clock.latch.ticks, 5_000_000);
        clock.renew(Latch { ticks: 7_001_000, before: origin + s(12.0), after: origin + s(12.001) });
        assert_eq!(clock.latch.ticks, 7_001_000);
        assert_eq!(clock.complaint(), None);
    }

    #[test]
    fn a_clock_that_lied_once_is_not_believed_again() {
        let origin = Instant::now();
        type Lie = fn(&mut DeviceClock, Instant);
        let lies: [(&str, Lie); 5] = [
            ("in the future", |clock, origin| {
                clock.judge(6_000_000, origin + s(10.5), LONGEST);
            }),
            ("s back", |clock, origin| {
                clock.judge(100, origin + s(10.5), s(2.0));
            }),
            ("do not grow", |clock, origin| {
                clock.judge(5_200_000, origin + s(10.5), LONGEST).unwrap();
                clock.judge(5_200_000, origin + s(10.6), LONGEST);
            }),
            ("do not go on", |clock, origin| {
                clock.renew(Latch { ticks: 5_000_000, before: origin + s(11.0), after: origin + s(11.1) });
            }),
            ("another rate", |clock, origin| {
                clock.renew(Latch { ticks: 5_900_000, before: origin + s(11.0), after: origin + s(11.01) });
            }),
        ];
        for (words, lie) in lies {
            let mut clock = clock(origin);
            lie(&mut clock, origin);
            assert_eq!(clock.judge(6_500_000, origin + s(11.6), LONGEST), None, "{words}");
            let complaint = clock.complaint().unwrap();
            assert!(complaint.contains(words), "{complaint}");
        }
    }

    #[test]
    fn without_a_stamp_or_trust_in_it_the_arrival_counts() {
        // Exposure, read-out and transmission.
        let assumed = Window { from_age: s(0.13), to_age: Duration::ZERO, assumed: true };
        let of = |means, stamped| window(means, stamped, s(0.01), s(0.04), Duration::ZERO);
        assert_eq!(of(TimestampMeans::Readout, None), assumed);
        let ages = Ages { most: s(0.2), least: s(0.2) };
        assert_eq!(of(TimestampMeans::Arrival, Some(ages)), assumed);
    }

    proptest! {
        /// Whatever a camera's stamps are of, told so or left as the default, no frame counts as exposed later than it was:
        /// one that is admitted because its exposure seems to begin after the axes came to rest did begin after that.
        #[test]
        fn no_meaning_admits_a_frame_of_motion(
            truth in 0..3usize,
            told in any::<bool>(),
            exposed_at in 20.0..40.0f64,
            exposure_share in 0.0..=1.0f64,
            read_out_share in 0.0..=1.0f64,
            under_way in 0.0..0.2f64,
            skew_ppm in -100.0..100.0f64,
            latched_share in 0.0..=1.0f64,
            round_trip in 1e-4..0.05f64,
            relatched in any::<bool>(),
        ) {
            let (origin, interval) = (Instant::now(), 0.04);
            let (exposure, read_out) = (exposure_share * interval, read_out_share * interval);
            // The camera's clock, in ticks of 8 ns, began 1000 s before and runs off by the skew.
            let ticks = |at: f64| ((at + 1000.0) * (1.0 + skew_ppm * 1e-6) * 125e6) as u64;
            let latch = |at: f64| Latch {
                ticks: ticks(at + latched_share * round_trip),
                before: origin + s(at),
                after: origin + s(at + round_trip),
            };
            let mut clock = DeviceClock::new(125e6, latch(19.0));
            if relatched {
                clock.renew(latch(19.8));
            }
            let ended_at = exposed_at + exposure + read_out;
            let (stamped_at, means) = [
                (exposed_at, TimestampMeans::ExposureStart),
                (exposed_at + exposure, TimestampMeans::ExposureEnd),
                (ended_at, TimestampMeans::Readout),
            ][truth];
            let means = if told { means } else { crate::config::CameraConfig::default().timestamp_means };
            let now = ended_at + under_way;
            let ages = clock.judge(ticks(stamped_at), origin + s(now), LONGEST);
            prop_assert!(ages.is_some(), "{:?}", clock.complaint());
            let window = window(means, ages, s(under_way), s(interval), Duration::ZERO);
            let (from, to) = (now - window.from_age.as_secs_f64(), now - window.to_age.as_secs_f64());
            // A tick and a nanosecond are cut off.
            prop_assert!(from <= exposed_at + 1e-7, "{from} {exposed_at}");
            prop_assert!(to >= exposed_at + exposure - 1e-7, "{to} {exposed_at} {exposure}");
            prop_assert!(!window.assumed);
        }
    }
}
