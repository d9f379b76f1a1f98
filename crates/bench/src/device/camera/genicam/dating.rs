//! When frames were exposed, by their stamps or their arrival and by what is known of the stream that they came in.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use super::super::exposure::Window;
use super::clock::{self, DeviceClock, Latch};
use crate::config::TimestampMeans;

/// How long the library holds a frame back at most, while an earlier one may still be completed.
pub(super) const HELD: Duration = Duration::from_millis(100);
/// By how much longer it may be, by the library's own pace.
const HELD_ON: Duration = Duration::from_millis(20);
/// So many of the newest intervals between frames are kept in mind.
const INTERVALS_SEEN: usize = 16;

/// What is known of a stream.
pub(super) struct Dating {
    means: TimestampMeans,
    clock: Option<DeviceClock>,
    /// The time between frames as the camera grants it; an exposure is no longer.
    interval: Duration,
    /// The newest intervals that were seen: a camera may well be slower than it says, and its exposures longer.
    seen: VecDeque<Duration>,
    /// The frame before: when it was taken over, its stamp, and its number.
    last: Option<(Instant, Option<u64>, u64)>,
    /// When it was last seen that no frame waits: what is taken over has arrived since.
    empty_at: Instant,
    /// Whether a frame was lost since the last that was dated, which may have been held back for it.
    held: bool,
    /// Intervals' worth of frames that the kernel's buffer holds.
    buffered: u32,
    /// What passes between exposure and stamp, or arrival, besides.
    delay: Duration,
    /// What no frame is older than, besides some intervals.
    timeout: Duration,
}

impl Dating {
    /// Of a stream that begins `now`, whose frames are `interval` apart and which the kernel's buffer holds `buffered` of.
    pub(super) fn new(
        (means, clock): (TimestampMeans, Option<DeviceClock>),
        interval: Duration,
        buffered: u32,
        (delay, timeout): (Duration, Duration),
        now: Instant,
    ) -> Self {
        let seen = VecDeque::new();
        Self { means, clock, interval, seen, last: None, empty_at: now, held: false, buffered, delay, timeout }
    }

    /// The time between frames, and no shorter than an exposure.
    pub(super) fn interval(&self) -> Duration {
        self.seen.iter().copied().fold(self.interval, Duration::max)
    }

    /// Frames may be exposed for so long from now on. A shorter exposure may not be in force yet.
    pub(super) fn exposes(&mut self, exposure: Duration) {
        self.interval = self.interval.max(exposure);
    }

    /// A frame was lost: the next may have been held back for it.
    pub(super) const fn lost(&mut self) {
        self.held = true;
    }

    /// No frame waited at this moment.
    pub(super) const fn nothing_waited(&mut self, at: Instant) {
        self.empty_at = at;
    }

    /// Whether any frame has come.
    pub(super) const fn has_begun(&self) -> bool {
        self.last.is_some()
    }

    /// Whether there is a clock to be read now and then.
    pub(super) const fn has_clock(&self) -> bool {
        self.clock.is_some()
    }

    /// Takes a later reading of the camera's clock.
    ///
    /// # Errors
    /// Why the clock is not believed, as a sentence.
    pub(super) fn renew(&mut self, latch: Latch) -> Result<(), String> {
        let Some(clock) = &mut self.clock else { return Ok(()) };
        clock.renew(latch);
        clock.complaint().map_or(Ok(()), Err)
    }

    /// When the frame number `seq` with a stamp, taken over `now`, was exposed; `None` for the first, before which nothing is
    /// known of how long frames are exposed.
    ///
    /// # Errors
    /// Why the camera's clock is not believed, as a sentence.
    pub(super) fn date(&mut self, ticks: Option<u64>, seq: u64, now: Instant) -> Result<Option<Window>, String> {
        let ticks = ticks.filter(|_| self.clock.is_some());
        if let Some(clock) = &mut self.clock
            && ticks.is_none()
        {
            clock.miss();
        }
        let before = self.last.replace((now, ticks, seq));
        if let Some((at, last_ticks, last_seq)) = before {
            let frames = u32::try_from(seq.saturating_sub(last_seq)).unwrap_or(u32::MAX).max(1);
            // By the camera's own clock where there is one: when this program came to a frame says less.
            let passed = match (&self.clock, last_ticks, ticks) {
                (Some(clock), Some(from), Some(to)) => {
                    Duration::try_from_secs_f64(clock.seconds(from, to)).unwrap_or_default()
                }
                _ => now.saturating_duration_since(at),
            };
            self.seen.push_back((passed / frames).min(self.timeout));
            if self.seen.len() > INTERVALS_SEEN {
                self.seen.pop_front();
            }
        }
        let interval = self.interval();
        let longest = self.timeout + 4 * interval;
        let stamped = match (&mut self.clock, ticks) {
            (Some(clock), Some(ticks)) => clock.judge(ticks, now, longest),
            _ => None,
        };
        if let Some(why) = self.clock.as_ref().and_then(DeviceClock::complaint) {
            return Err(why);
        }
        let waited = if std::mem::take(&mut self.held) { HELD + HELD_ON } else { Duration::ZERO };
        let arrived_age = now.saturating_duration_since(self.empty_at) + waited + self.buffered * interval;
        let window = clock::window(self.means, stamped, arrived_age, interval, self.delay);
        Ok(before.map(|_| window))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(milliseconds: u64) -> Duration {
        Duration::from_millis(milliseconds)
    }

    fn by_arrival(interval: Duration, begin: Instant) -> Dating {
        Dating::new((TimestampMeans::Arrival, None), interval, 2, (Duration::ZERO, ms(2000)), begin)
    }

    /// By a clock of 1 MHz that read 0 at `begin`.
    fn stamped(begin: Instant) -> Dating {
        let clock = DeviceClock::new(1e6, Latch { ticks: 0, before: begin, after: begin });
        Dating::new((TimestampMeans::Readout, Some(clock)), ms(30), 0, (Duration::ZERO, ms(2000)), begin)
    }

    #[test]
    fn the_first_frame_is_not_dated() {
        let begin = Instant::now();
        assert_eq!(by_arrival(ms(30), begin).date(None, 1, begin + ms(30)), Ok(None));
        assert_eq!(stamped(begin).date(Some(20_000), 1, begin + ms(30)), Ok(None));
    }

    /// Exposure, read-out, and a transmission that is paced to fill its interval, then the kernel's buffer, then the time
    /// since nothing waited.
    #[test]
    fn by_arrival_everything_that_may_have_passed_is_counted() {
        let begin = Instant::now();
        let mut dating = by_arrival(ms(100), begin);
        dating.date(None, 1, begin + ms(100)).unwrap();
        dating.nothing_waited(begin + ms(190));
        let window = dating.date(None, 2, begin + ms(200)).unwrap().unwrap();
        assert!(window.assumed && window.from_age >= ms(10 + 3 * 100 + 2 * 100), "{window:?}");
    }

    #[test]
    fn a_frame_after_a_lost_one_may_have_been_held_back_for_it_whenever_the_loss_was_told() {
        let begin = Instant::now();
        let dated = |lost: bool| {
            let mut dating = by_arrival(ms(100), begin);
            dating.date(None, 1, begin + ms(100)).unwrap();
            if lost {
                dating.lost();
            }
            // Some turns without a frame between.
            dating.nothing_waited(begin + ms(180));
            dating.nothing_waited(begin + ms(190));
            let first = dating.date(None, 2, begin + ms(200)).unwrap().unwrap().from_age;
            dating.nothing_waited(begin + ms(290));
            (first, dating.date(None, 3, begin + ms(300)).unwrap().unwrap().from_age)
        };
        let (held, after) = dated(true);
        let (plain, same) = dated(false);
        assert!(held >= plain + HELD, "{held:?} {plain:?}");
        assert_eq!(after, same);
    }

    #[test]
    fn a_camera_slower_than_it_says_is_given_the_intervals_that_it_has() {
        let begin = Instant::now();
        // It says 30 ms and has 125 ms; that this program is late for one of them makes no interval shorter.
        let mut dating = stamped(begin);
        for (seq, taken_ms) in [(1, 140), (2, 330), (3, 380)] {
            let _ = dating.date(Some(seq * 125_000), seq, begin + ms(taken_ms));
        }
        assert!(dating.interval() >= ms(125), "{:?}", dating.interval());
        let mut dating = by_arrival(ms(30), begin);
        for (seq, taken_ms) in [(1, 140), (2, 330), (3, 380)] {
            let _ = dating.date(None, seq, begin + ms(taken_ms));
        }
        assert!(dating.interval() >= ms(125), "{:?}", dating.interval());
        // A frame that was lost on the way makes two of one.
        let _ = dating.date(None, 5, begin + ms(620));
        assert!(dating.interval() < ms(200), "{:?}", dating.interval());
        dating.exposes(ms(400));
        assert_eq!(dating.interval(), ms(400));
    }

    #[test]
    fn a_clock_that_is_not_believed_and_a_stamp_that_is_missing_are_errors() {
        let begin = Instant::now();
        let mut dating = stamped(begin);
        dating.date(Some(20_000), 1, begin + ms(30)).unwrap();
        let why = dating.date(Some(900_000), 2, begin + ms(60)).unwrap_err();
        assert!(why.contains("lie in the future"), "{why}");
        let mut dating = stamped(begin);
        dating.date(Some(20_000), 1, begin + ms(30)).unwrap();
        let why = dating.date(None, 2, begin + ms(60)).unwrap_err();
        assert!(why.contains("are missing"), "{why}");
        let mut dating = stamped(begin);
        let why = dating.renew(Latch { ticks: 10, before: begin + ms(900), after: begin + ms(901) }).unwrap_err();
        assert!(why.contains("another rate"), "{why}");
    }
}
