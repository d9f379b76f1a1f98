//! From irradiance to a raw frame: gain, photon and read noise, quantisation.

use std::sync::LazyLock;

use rand::{RngExt, SeedableRng};
use rand_distr::Poisson;
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use crate::raw::RawImage;

/// Grey level, of the 255 of an 8-bit frame, of an irradiance of 1 at a gain of 1.
pub const WHITE_LEVELS: f32 = 220.0;

/// How a frame is exposed. Levels are those of an 8-bit frame, whatever the depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Standard deviation of the read noise, levels.
    pub read_noise_levels: f64,
    /// Electrons that make a level, for the photon noise; 0 for none.
    pub electrons_per_level: f64,
    /// Depth of the frame, 8 to 16 bits.
    pub bits: u8,
    /// Factor on [`WHITE_LEVELS`].
    pub exposure_gain: f64,
}

impl Default for Noise {
    fn default() -> Self {
        Self { read_noise_levels: 2.0, electrons_per_level: 0.0, bits: 8, exposure_gain: 1.0 }
    }
}

/// Exposes an irradiance. The noise follows from the seed alone. A depth outside 8 to 16 is taken as the nearest of
/// these.
///
/// # Panics
/// If the irradiance does not fill the frame or the frame is empty: a mistake of the caller's.
#[must_use]
pub fn expose(irradiance: &[f32], width: usize, height: usize, noise: &Noise, seed: u64) -> RawImage {
    let bits = noise.bits.clamp(8, 16);
    let white = ((1u32 << bits) - 1) as f32;
    let deeper = white / 255.0;
    let mut samples = vec![0u16; irradiance.len()];
    samples.par_chunks_mut(width.max(1)).zip(irradiance.par_chunks(width.max(1))).enumerate().for_each(
        |(y, (row, irradiance))| {
            // A generator for each row: the frame is the same whichever thread takes the row.
            let row_seed = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(y as u64);
            let mut chance = Chance::new(row_seed);
            for (sample, &irradiance) in row.iter_mut().zip(irradiance) {
                let clean = irradiance * WHITE_LEVELS * noise.exposure_gain as f32;
                let mut level = photons(clean, noise.electrons_per_level as f32, &mut chance);
                if noise.read_noise_levels > 0.0 {
                    level += chance.deviate() * noise.read_noise_levels as f32;
                }
                // A float becomes an integer by clamping, as the converter does.
                *sample = (level * deeper + 0.5).clamp(0.0, white) as u16;
            }
        },
    );
    if bits == 8 {
        RawImage::from_u8(width, height, samples.into_iter().map(|s| s as u8).collect())
    } else {
        RawImage::from_u16(width, height, bits, samples)
    }
}

/// Deviates of a [`Bank`].
const BANKED: usize = 1 << 20;
/// Neighbourhood within which noise from a bank has no deviate twice, px: three of the largest micro-images there are.
const APART: usize = 300;
/// Draws of a row's place in the bank, before one that is too near a neighbour's is taken after all.
const DRAWS: usize = 64;

/// Normal deviates drawn beforehand, for a camera that has to keep pace: every row of a frame takes a stretch of them
/// from a place of its own, so that no pattern shows twice within 300 px.
#[derive(Debug)]
pub struct Bank(Vec<f32>);

impl Bank {
    /// The deviates that follow from a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut chance = Chance::new(seed);
        Self((0..BANKED).map(|_| chance.deviate()).collect())
    }

    /// Exposes an irradiance as [`expose`] does, but for two things: photon noise is normal however few the photons, and
    /// the deviates are the bank's.
    ///
    /// # Panics
    /// As [`expose`].
    #[must_use]
    pub fn expose(&self, irradiance: &[f32], width: usize, height: usize, noise: &Noise, seed: u64) -> RawImage {
        if width > BANKED / 2 {
            return expose(irradiance, width, height, noise, seed);
        }
        let bits = noise.bits.clamp(8, 16);
        if bits == 8 {
            RawImage::from_u8(width, height, self.samples(irradiance, width, noise, 255.0, seed, |level| level as u8))
        } else {
            let white = ((1u32 << bits) - 1) as f32;
            let samples = self.samples(irradiance, width, noise, white, seed, |level| level as u16);
            RawImage::from_u16(width, height, bits, samples)
        }
    }

    fn samples<T: Copy + Default + Send + Sync>(
        &self,
        irradiance: &[f32],
        width: usize,
        noise: &Noise,
        white: f32,
        seed: u64,
        sample: impl Fn(f32) -> T + Sync,
    ) -> Vec<T> {
        let width = width.max(1);
        let deeper = white / 255.0;
        let gain = WHITE_LEVELS * noise.exposure_gain as f32 * deeper;
        let read = (noise.read_noise_levels as f32 * deeper).powi(2);
        // Photons make a variance that rises with the level.
        let photons = if noise.electrons_per_level > 0.0 { deeper / noise.electrons_per_level as f32 } else { 0.0 };
        let places = places(irradiance.len().div_ceil(width), BANKED - width, seed);
        let mut samples = vec![T::default(); irradiance.len()];
        let rows = samples.par_chunks_mut(width).zip(irradiance.par_chunks(width)).zip(places);
        rows.with_min_len(32).for_each(|((row, irradiance), place)| {
            let deviates = &self.0[place..place + row.len()];
            for ((to, &irradiance), deviate) in row.iter_mut().zip(irradiance).zip(deviates) {
                let clean = irradiance * gain;
                let level = clean + deviate * (read + photons * clean).max(0.0).sqrt();
                *to = sample((level + 0.5).clamp(0.0, white));
            }
        });
        samples
    }
}

/// Where each row's stretch of a bank begins.
fn places(rows: usize, last: usize, seed: u64) -> Vec<usize> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut places: Vec<usize> = Vec::with_capacity(rows);
    for row in 0..rows {
        let near = row.saturating_sub(APART);
        let mut place = random.random_range(0..=last);
        for _ in 0..DRAWS {
            if places[near..].iter().all(|other| other.abs_diff(place) > APART) {
                break;
            }
            place = random.random_range(0..=last);
        }
        places.push(place);
    }
    places
}

/// Photon noise: Poisson in electrons, and its normal limit where that is as good.
fn photons(levels: f32, electrons_per_level: f32, chance: &mut Chance) -> f32 {
    let mean = levels * electrons_per_level;
    if mean <= 0.0 || mean.is_nan() {
        return levels;
    }
    let counted = if mean < 50.0 {
        Poisson::new(f64::from(mean)).map_or(mean, |poisson| chance.random.sample::<f64, _>(poisson) as f32)
    } else {
        mean + chance.deviate() * mean.sqrt()
    };
    counted / electrons_per_level
}

/// How many deviates there are to draw from: as many as 16 random bits can choose.
const DEVIATES: usize = 1 << 16;

/// The standard normal distribution as equally likely deviates: the medians of as many equal shares of it, from below
/// upwards, scaled to a variance of 1. They reach ±4.3; out there neighbours lie up to 0.2 apart. A draw costs a look
/// into a table.
static NORMAL: LazyLock<Box<[f32; DEVIATES]>> = LazyLock::new(|| {
    const HALF: usize = DEVIATES / 2;
    const STEPS: u32 = 4;
    // x of the cumulative probability p solves dx/dp = √(2π) exp(x²/2), x(1/2) = 0: Runge and Kutta's fourth order.
    let slope = |x: f64| (2.0 * std::f64::consts::PI).sqrt() * (0.5 * x * x).exp();
    let mut upper = vec![0.0f64; HALF];
    let mut x = 0.0;
    for (k, deviate) in upper.iter_mut().enumerate() {
        let share = if k == 0 { 0.5 } else { 1.0 };
        let h = share / (DEVIATES as f64 * f64::from(STEPS));
        for _ in 0..STEPS {
            let a = slope(x);
            let b = slope(x + 0.5 * h * a);
            let c = slope(x + 0.5 * h * b);
            let d = slope(x + h * c);
            x += h / 6.0 * (a + 2.0 * b + 2.0 * c + d);
        }
        *deviate = x;
    }
    let scale = (HALF as f64 / upper.iter().map(|x| x * x).sum::<f64>()).sqrt();
    let mut table = Box::new([0.0f32; DEVIATES]);
    for (k, x) in upper.iter().enumerate() {
        table[HALF + k] = (x * scale) as f32;
        table[HALF - 1 - k] = -(x * scale) as f32;
    }
    table
});

/// A row's random numbers.
struct Chance {
    random: Pcg64Mcg,
    normal: &'static [f32; DEVIATES],
    bits: u64,
    left: u32,
}

impl Chance {
    fn new(seed: u64) -> Self {
        Self { random: Pcg64Mcg::seed_from_u64(seed), normal: &NORMAL, bits: 0, left: 0 }
    }

    /// A standard normal deviate; four of them share a random number.
    #[inline]
    fn deviate(&mut self) -> f32 {
        if self.left == 0 {
            self.bits = self.random.random();
            self.left = 4;
        }
        let index = usize::from(self.bits as u16);
        self.bits >>= 16;
        self.left -= 1;
        self.normal[index]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raw::Samples;

    fn statistics(raw: &RawImage) -> (f64, f64) {
        let values = raw.to_f32();
        let mean = values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum::<f64>() / values.len() as f64;
        (mean, variance)
    }

    #[test]
    fn read_noise_has_its_variance_and_rounding_adds_a_twelfth() {
        let noise = Noise { read_noise_levels: 2.0, ..Noise::default() };
        let raw = expose(&vec![0.5; 400 * 300], 400, 300, &noise, 9);
        let (mean, variance) = statistics(&raw);
        // 120 000 samples: standard errors 0.006 and 0.017.
        assert!((mean - 110.0).abs() < 0.025, "{mean}");
        assert!((variance - (4.0 + 1.0 / 12.0)).abs() < 0.07, "{variance}");
    }

    #[test]
    fn deviates_are_those_of_the_normal_distribution() {
        // Quantiles from tables of the distribution.
        for (share, quantile) in [(0.5, 0.0), (0.841_344_746, 1.0), (0.975, 1.959_964), (0.999, 3.090_232)] {
            let found = f64::from(NORMAL[(share * DEVIATES as f64) as usize]);
            assert!((found - quantile).abs() < 5e-3, "{found} for {quantile}");
        }
        let moment = |power: i32| NORMAL.iter().map(|&x| f64::from(x).powi(power)).sum::<f64>() / DEVIATES as f64;
        assert!(moment(1).abs() < 1e-6 && (moment(2) - 1.0).abs() < 1e-6, "{} {}", moment(1), moment(2));
        assert!((moment(4) - 3.0).abs() < 0.01, "{}", moment(4));
    }

    #[test]
    fn noise_of_neighbours_rows_and_frames_is_independent() {
        let noise = Noise { bits: 16, ..Noise::default() };
        let frame = |seed| {
            let raw = expose(&vec![0.5; 400 * 300], 400, 300, &noise, seed).to_f32();
            raw.iter().map(|&v| (f64::from(v) - 110.0 * 257.0) / (2.0 * 257.0)).collect::<Vec<f64>>()
        };
        let (one, other) = (frame(3), frame(4));
        let product =
            |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>() / a.len().min(b.len()) as f64;
        for lag in [1, 2, 3, 4, 5, 399, 400, 401, 800] {
            // The standard error is 0.0029.
            let found = product(&one[lag..], &one);
            assert!(found.abs() < 0.012, "{found} at a lag of {lag}");
        }
        assert!(product(&one, &other).abs() < 0.012);
    }

    #[test]
    fn noise_from_a_bank_is_as_that_drawn_anew() {
        let bank = Bank::new(7);
        let photon = Noise { read_noise_levels: 1.0, electrons_per_level: 20.0, bits: 12, ..Noise::default() };
        for (noise, irradiance) in [(Noise::default(), 0.5), (photon, 0.9), (photon, 0.1)] {
            let light = vec![irradiance; 400 * 300];
            let (banked, drawn) = (bank.expose(&light, 400, 300, &noise, 9), expose(&light, 400, 300, &noise, 9));
            let ((mean, variance), (drawn_mean, drawn_variance)) = (statistics(&banked), statistics(&drawn));
            let error = (variance / 120_000.0).sqrt();
            assert!((mean - drawn_mean).abs() < 6.0 * error, "{mean} for {drawn_mean}");
            assert!((variance / drawn_variance - 1.0).abs() < 0.025, "{variance} for {drawn_variance}");
        }
        let noise = Noise { read_noise_levels: 0.0, ..Noise::default() };
        let light = [0.0, 0.5, 1.0, 2.0];
        assert_eq!(bank.expose(&light, 2, 2, &noise, 3), expose(&light, 2, 2, &noise, 3));
    }

    #[test]
    fn noise_from_a_bank_repeats_nowhere_near() {
        for (seed, width) in [(1, 1160), (2, 4096)] {
            let places = places(3072, BANKED - width, seed);
            for (row, place) in places.iter().enumerate() {
                let near = &places[row.saturating_sub(APART)..row];
                assert!(near.iter().all(|other| other.abs_diff(*place) > APART), "row {row}");
            }
        }
        // From frame to frame it is another.
        assert_ne!(places(100, BANKED - 400, 1), places(100, BANKED - 400, 2));
    }

    #[test]
    fn photon_noise_grows_with_the_light() {
        for (irradiance, electrons) in [(0.5f32, 20.0), (0.9, 20.0), (0.05, 2.0)] {
            let noise = Noise { read_noise_levels: 0.0, electrons_per_level: electrons, bits: 12, ..Noise::default() };
            let raw = expose(&vec![irradiance; 400 * 300], 400, 300, &noise, 4);
            let (mean, variance) = statistics(&raw);
            let deeper = 4095.0 / 255.0;
            let expected = f64::from(irradiance) * 220.0 * deeper;
            assert!((mean / expected - 1.0).abs() < 0.004, "{mean} for {expected}");
            let spread = expected * deeper / electrons + 1.0 / 12.0;
            assert!((variance / spread - 1.0).abs() < 0.03, "{variance} for {spread}");
        }
    }

    #[test]
    fn deeper_frames_have_their_own_white_level() {
        let noise = Noise { read_noise_levels: 0.0, ..Noise::default() };
        for (bits, white) in [(10, 1023u16), (12, 4095)] {
            let raw = expose(&[0.0, 0.5, 1.0, 2.0], 2, 2, &Noise { bits, ..noise }, 0);
            assert_eq!((raw.bits(), raw.white_level()), (bits, white));
            let level = |irradiance: f64| (irradiance * 220.0 / 255.0 * f64::from(white)).round() as u16;
            assert_eq!(raw.samples(), &Samples::U16(vec![0, level(0.5), level(1.0), white]));
        }
    }

    #[test]
    fn without_noise_levels_are_exact_and_clamped() {
        let noise = Noise { read_noise_levels: 0.0, ..Noise::default() };
        let raw = expose(&[0.0, 0.5, 1.0, 2.0], 2, 2, &noise, 0);
        assert_eq!(raw.samples(), &Samples::U8(vec![0, 110, 220, 255]));
    }
}
