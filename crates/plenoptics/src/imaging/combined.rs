//! Combining single measurements of one thing at rest: their mean, and what remains uncertain of it.
//!
//! What differs from one frame to the next is averaged away, and nothing else. How much that is the single values
//! themselves say, by the differences of consecutive ones: a sensor's fixed pattern, which looks like noise within a frame,
//! is the same in each and in none of them. With `n` values, T their variance by the differences, S what scatters between
//! a frame's blocks, M what is known of the model's own limits:
//!
//! ```text
//!   σ² = T/n + (S − T) + M² + d²
//! ```
//!
//! T is taken low while there are few differences, as if one more had been none: too large a T would promise too much. Of S
//! it takes away no more than a frame's noise explains: what vibrates scatters in no frame. S is low by chance as well: it
//! is not less than that noise, of which sharp texture makes too much, until the differences have shown how much it is.
//!
//! The value is to hold for the newest frame, while the mean is that of the window's middle: d is how far the line through
//! the values rises from there on, whether or not it is significant. Where it is, or where the values wander more than
//! their differences explain (von Neumann's ratio), or the newest is far off the others, the combination ends, and the
//! newest begins the next.
//!
//! The window slides: tumbling, the uncertainty would leap back to that of one frame every few seconds for no reason that
//! a reader could see.

use std::collections::VecDeque;

/// What a frame says of its own noise counts as so many differences.
const PRIOR: f64 = 4.0;
/// Values from which a trend can be told, and from which wandering can.
const LEAST_FOR_TREND: usize = 4;
const LEAST_FOR_WANDER: usize = 8;
/// Standard errors from which a trend or a wandering shows, and from which a single value is of something else.
const SHOWS: f64 = 4.0;
const LEAP: f64 = 5.0;

/// A measurement in one frame. Value and uncertainties are in one unit, whatever it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Single {
    /// When, s: only differences count.
    pub at_s: f64,
    /// What was measured.
    pub value: f64,
    /// Standard uncertainty from what scatters within the frame, noise included.
    pub sigma_scatter: f64,
    /// What noise explains of that at most, as the frame itself has it: with the sensor's fixed pattern, and some texture.
    pub sigma_random: f64,
    /// Standard uncertainty beyond both, which no frame mends.
    pub sigma_model: f64,
}

impl Single {
    fn is_finite(&self) -> bool {
        let Self { at_s, value, sigma_scatter, sigma_random, sigma_model } = *self;
        [at_s, value, sigma_scatter, sigma_random, sigma_model].iter().all(|number| number.is_finite())
    }
}

/// What a combination began with, where the one before ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Since {
    /// The first value of all.
    Start,
    /// An axis moved.
    Axis,
    /// The picture moved, or was taken otherwise.
    Picture,
    /// The values leapt, or showed a trend.
    Trend,
    /// There was no value for a while.
    Lost,
}

/// Single measurements combined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Combined {
    /// Their mean.
    pub value: f64,
    /// Its standard uncertainty, as what there is at the newest.
    pub sigma: f64,
    /// How many they are.
    pub frames: u32,
    /// From the first to the newest, s.
    pub span_s: f64,
    /// What ended the combination before.
    pub since: Since,
}

/// Combines one measurement after another.
#[derive(Debug, Clone)]
pub struct Combining {
    window_s: f64,
    singles: VecDeque<Single>,
    since: Since,
}

impl Combining {
    /// Of measurements that span so many seconds at most.
    #[must_use]
    pub const fn over(window_s: f64) -> Self {
        Self { window_s, singles: VecDeque::new(), since: Since::Start }
    }

    /// Ends what has been combined: the next measurement begins anew.
    pub fn begin_anew(&mut self, since: Since) {
        if !self.singles.is_empty() {
            self.singles.clear();
            self.since = since;
        }
    }

    /// What there is with another measurement, which is later than those before. One with a number that is none stands
    /// alone, and is left out of the next.
    pub fn take(&mut self, single: Single) -> Combined {
        if !single.is_finite() {
            return Combined { value: single.value, sigma: f64::NAN, frames: 1, span_s: 0.0, since: self.since };
        }
        if self.leaps(&single) {
            self.begin_anew(Since::Trend);
        }
        self.singles.push_back(single);
        while self.singles.front().is_some_and(|first| single.at_s - first.at_s > self.window_s) {
            self.singles.pop_front();
        }
        let sums = self.sums();
        let sums = if sums.has_trend() {
            self.begin_anew(Since::Trend);
            self.singles.push_back(single);
            self.sums()
        } else {
            sums
        };
        let span_s = self.singles.front().map_or(0.0, |first| single.at_s - first.at_s);
        let frames = self.singles.len() as u32;
        Combined { value: sums.mean, sigma: sums.variance().sqrt(), frames, span_s, since: self.since }
    }

    /// Whether a value is of something else than those before.
    fn leaps(&self, single: &Single) -> bool {
        if self.singles.is_empty() {
            return false;
        }
        let sums = self.sums();
        let sigma = (sums.trusted * (1.0 + 1.0 / sums.count)).sqrt();
        (single.value - sums.mean).abs() > LEAP * sigma
    }

    fn sums(&self) -> Sums {
        let singles = &self.singles;
        let count = singles.len().max(1) as f64;
        let mean = |of: &dyn Fn(&Single) -> f64| singles.iter().map(of).sum::<f64>() / count;
        let (value, at) = (mean(&|single| single.value), mean(&|single| single.at_s));
        let random = mean(&|single| single.sigma_random.powi(2));
        let steps = singles.iter().zip(singles.iter().skip(1));
        let steps = steps.map(|(one, other)| (other.value - one.value).powi(2)).sum::<f64>() / 2.0;
        let later = |single: &Single| single.at_s - at;
        let along = singles.iter().map(|single| later(single) * (single.value - value)).sum::<f64>();
        let trusted = (steps + PRIOR * random) / (count - 1.0 + PRIOR);
        let temporal = steps / count;
        let scatter = mean(&|single| single.sigma_scatter.powi(2)).max(trusted.min(random));
        Sums {
            count,
            mean: value,
            temporal,
            trusted,
            shared: scatter - temporal.min(random) + mean(&|single| single.sigma_model.powi(2)),
            spread: singles.iter().map(|single| (single.value - value).powi(2)).sum(),
            times: singles.iter().map(|single| later(single).powi(2)).sum(),
            along,
            ahead: singles.back().map_or(0.0, later),
        }
    }
}

/// What the values come to.
struct Sums {
    count: f64,
    mean: f64,
    /// T as what is promised follows from it, and as the tests do.
    temporal: f64,
    trusted: f64,
    /// What all of them share: (S − T) + M².
    shared: f64,
    /// Sums of squares of the values and of their times about their means, of their products, and the newest's time.
    spread: f64,
    times: f64,
    along: f64,
    ahead: f64,
}

impl Sums {
    /// How far the line through the values rises from their middle on, and its standard error.
    fn rise(&self) -> Option<(f64, f64)> {
        (self.count >= LEAST_FOR_TREND as f64 && self.times > 0.0)
            .then(|| (self.along / self.times * self.ahead, (self.trusted / self.times).sqrt() * self.ahead))
    }

    fn has_trend(&self) -> bool {
        let rises = self.rise().is_some_and(|(rise, sigma)| rise.abs() > SHOWS * sigma);
        let wanders = self.count >= LEAST_FOR_WANDER as f64
            && self.spread / (self.count - 1.0) > self.trusted * (1.0 + SHOWS / self.count.sqrt());
        rises || wanders
    }

    fn variance(&self) -> f64 {
        let rise = self.rise().map_or(0.0, |(rise, _)| rise);
        self.temporal / self.count + self.shared + rise * rise
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_pcg::Pcg64;

    const RATE_HZ: f64 = 30.0;
    /// Blocks of a frame whose scatter is not taken up by the terms fitted.
    const BLOCKS: u32 = 30;

    /// Standard deviations of what makes single values differ from the truth.
    #[derive(Debug, Clone, Copy)]
    struct Mix {
        /// Drawn anew in each frame.
        temporal: f64,
        /// Of the sensor's pixels and of the board, the same in each.
        fixed: f64,
        /// The same in each, and no scatter shows it.
        model: f64,
    }

    const MIXES: [Mix; 5] = [
        Mix { temporal: 1.0, fixed: 0.0, model: 0.0 },
        Mix { temporal: 1.0, fixed: 0.0, model: 0.4 },
        Mix { temporal: 0.8, fixed: 0.6, model: 0.2 },
        Mix { temporal: 0.3, fixed: 1.0, model: 0.2 },
        Mix { temporal: 0.02, fixed: 1.0, model: 0.1 },
    ];

    /// A camera at rest, or drifting.
    struct Camera {
        random: Pcg64,
        mix: Mix,
        offset: f64,
        /// Of the fixed part, what the blocks scatter by.
        blocks: Vec<f64>,
        /// Noise as a frame has it, in units of what it is.
        texture: f64,
        frame: u32,
    }

    impl Camera {
        fn new(mix: Mix, seed: u64) -> Self {
            let mut random = Pcg64::seed_from_u64(seed);
            let mut normal = || random.sample::<f64, _>(StandardNormal);
            let offset = mix.fixed * normal() + mix.model * normal();
            let blocks = (0..BLOCKS).map(|_| mix.fixed * normal()).collect();
            Self { random, mix, offset, blocks, texture: 1.0, frame: 0 }
        }

        fn single(&mut self, truth: f64) -> Single {
            let Mix { temporal, fixed, model } = self.mix;
            let mut noise = || temporal * self.random.sample::<f64, _>(StandardNormal);
            let value = truth + self.offset + noise();
            let scatter = self.blocks.iter().map(|block| (block + noise()).powi(2)).sum::<f64>() / f64::from(BLOCKS);
            self.frame += 1;
            Single {
                at_s: f64::from(self.frame) / RATE_HZ,
                value,
                sigma_scatter: scatter.sqrt(),
                // Within a frame, a pattern of the pixels is noise as well, and so is some texture.
                sigma_random: self.texture * temporal.hypot(fixed),
                sigma_model: model,
            }
        }
    }

    /// Share of values within two standard uncertainties of the truth.
    fn coverage(off: &[(f64, f64)]) -> f64 {
        off.iter().filter(|(off, sigma)| off.abs() <= 2.0 * sigma).count() as f64 / off.len() as f64
    }

    #[test]
    fn a_thousand_combined_values_are_where_they_are_said_to_be() {
        let mut all = Vec::new();
        for (kind, mix) in MIXES.into_iter().enumerate() {
            let off: Vec<(f64, f64)> = (0..250)
                .map(|k| {
                    let mut camera = Camera::new(mix, 1000 * kind as u64 + k);
                    camera.texture = [1.0, 1.5, 2.5][k as usize % 3];
                    let mut combining = Combining::over(5.0);
                    let frames = 2 + k % 49;
                    let last = (0..frames).map(|_| combining.take(camera.single(7.0))).last().unwrap();
                    (last.value - 7.0, last.sigma)
                })
                .collect();
            let covered = coverage(&off);
            assert!(covered >= 0.92, "{mix:?}: {covered}");
            all.extend(off);
        }
        let covered = coverage(&all);
        assert!(all.len() >= 1000 && covered >= 0.935, "{covered}");
    }

    #[test]
    fn noise_is_averaged_away_and_a_pattern_is_not() {
        let sigma_after_5_s = |mix: Mix| {
            let mut sum = 0.0;
            for seed in 0..8 {
                let (mut camera, mut combining) = (Camera::new(mix, 70 + seed), Combining::over(5.0));
                let first = combining.take(camera.single(7.0));
                let last = (0..150).map(|_| combining.take(camera.single(7.0))).last().unwrap();
                assert_eq!((first.frames, last.frames, last.since), (1, 151, Since::Start));
                sum += last.sigma / 8.0;
            }
            sum
        };
        let [noise, with_model, _, pattern, _] = MIXES.map(sigma_after_5_s);
        assert!(noise < 0.45, "{noise}");
        assert!((0.4..0.65).contains(&with_model), "{with_model}");
        assert!((0.9..1.2).contains(&pattern), "{pattern}");
    }

    #[test]
    fn a_drift_is_covered_until_it_shows_and_then_ends_the_combination() {
        // Per second, in single uncertainties: from what 5 s do not show to what single frames do.
        for drift in [0.05, 0.2, 0.5, 2.0, 10.0] {
            for mix in [MIXES[0], MIXES[3]] {
                let (mut off, mut ended) = (Vec::new(), 0);
                for seed in 0..4 {
                    let (mut camera, mut combining) = (Camera::new(mix, 90 + seed), Combining::over(5.0));
                    for k in 0..210 {
                        let truth = drift * f64::from(k) / RATE_HZ;
                        let combined = combining.take(camera.single(truth));
                        ended += u32::from(combined.frames == 1 && combined.since == Since::Trend);
                        off.push((combined.value - truth - camera.offset, combined.sigma));
                    }
                }
                // Whatever is the same in all frames lies beside: what is left is noise and drift.
                assert!(coverage(&off) >= 0.93, "{mix:?}, {drift}: {}", coverage(&off));
                assert!(drift < 0.5 || ended >= 4, "{mix:?}, {drift}: {ended} times");
            }
        }
    }

    #[test]
    fn at_rest_a_trend_is_seldom_seen() {
        let (mut frames, mut ended) = (0, 0);
        for mix in MIXES {
            for seed in 0..6 {
                let (mut camera, mut combining) = (Camera::new(mix, 500 + seed), Combining::over(5.0));
                for _ in 0..200 {
                    let combined = combining.take(camera.single(7.0));
                    ended += u32::from(combined.frames == 1 && combined.since == Since::Trend);
                    frames += 1;
                }
            }
        }
        assert!(frames == 6000 && ended <= 4, "{ended} times in {frames}");
    }

    #[test]
    fn a_leap_a_swing_and_what_is_told_end_it() {
        let mix = MIXES[0];
        let (mut camera, mut combining) = (Camera::new(mix, 3), Combining::over(5.0));
        for _ in 0..30 {
            combining.take(camera.single(7.0));
        }
        let leapt = combining.take(camera.single(20.0));
        assert_eq!((leapt.frames, leapt.since), (1, Since::Trend));
        assert_eq!(combining.take(camera.single(20.0)).frames, 2);
        combining.begin_anew(Since::Axis);
        // Two reasons at once: the first is what ended it.
        combining.begin_anew(Since::Lost);
        let moved = combining.take(camera.single(20.0));
        assert_eq!((moved.frames, moved.span_s, moved.since), (1, 0.0, Since::Axis));
        // Up and down again within the window has no slope.
        let swing = |k: u32| (f64::from(k) / 120.0 * std::f64::consts::TAU).cos();
        let ended = (0..240).any(|k| combining.take(camera.single(20.0 + 2.0 * swing(k))).since == Since::Trend);
        assert!(ended);
    }

    #[test]
    fn the_window_slides_and_a_number_that_is_none_stays_outside() {
        let (mut camera, mut combining) = (Camera::new(MIXES[2], 4), Combining::over(1.0));
        for k in 0..100u32 {
            let combined = combining.take(Single { at_s: f64::from(k) / 16.0, ..camera.single(7.0) });
            assert!(combined.span_s <= 1.0 && combined.frames == (k + 1).min(17), "{combined:?}");
        }
        let bad = Single { value: f64::NAN, ..camera.single(7.0) };
        assert_eq!(combining.take(bad).frames, 1);
        assert!(combining.take(camera.single(7.0)).sigma.is_finite());
    }
}
