//! Whether the picture stands still from frame to frame, whatever its light does.
//!
//! A frame is compared with the first since the picture stood, and with the one before: at rest both differ from it by the
//! noise alone. Neither noise nor texture has to be known for that; what the frame differs from its predecessor by is the
//! measure of the other.

use super::matching::model::QUANTISATION;
use crate::raw::{RawImage, Samples};

/// Runs of pixels that are looked at, and pixels of a run.
const RUNS: usize = 64;
const RUN: usize = 64;
/// Differences that noise makes scatter by some per cent about one another: from here on it is more than noise.
const MOVED: f64 = 1.5;
/// So much the least difference is forgotten with each frame: with more light there is more noise.
const FORGOTTEN: f64 = 1.01;

/// Watches whether the picture moves.
#[derive(Debug, Clone, Default)]
pub struct Stillness {
    first: Vec<f32>,
    before: Vec<f32>,
    /// Least variance of the noise that two frames in a row differed by.
    least: Option<f64>,
}

impl Stillness {
    /// Whether the picture has moved since the frame that this said so of last, or the first of all.
    pub fn has_moved(&mut self, raw: &RawImage) -> bool {
        let now = sample(raw);
        let before = std::mem::replace(&mut self.before, now);
        if self.first.len() != self.before.len() {
            self.first.clone_from(&self.before);
            self.least = None;
            return !before.is_empty();
        }
        let near = difference(&before, &self.before).max(QUANTISATION * QUANTISATION);
        let least = self.least.map_or(near, |least| near.min(FORGOTTEN * least));
        self.least = Some(least);
        let moved = difference(&self.first, &self.before) > MOVED * least;
        if moved {
            self.first.clone_from(&self.before);
        }
        moved
    }
}

/// Runs of a frame's pixels, spread over it.
fn sample(raw: &RawImage) -> Vec<f32> {
    fn runs<T: Copy + Into<f32>>(samples: &[T], width: usize, height: usize) -> Vec<f32> {
        let length = RUN.min(width);
        let free = width - length + 1;
        (0..RUNS.min(height))
            .flat_map(|run| {
                let row = (2 * run + 1) * height / (2 * RUNS.min(height));
                // By the golden section: no two runs near one another begin at one column.
                let from = row * width + ((run as f64 * 0.618_033_988_75).fract() * free as f64) as usize;
                samples.get(from..from + length).unwrap_or_default().iter().map(|&sample| sample.into())
            })
            .collect()
    }
    match raw.samples() {
        Samples::U8(samples) => runs(samples, raw.width(), raw.height()),
        Samples::U16(samples) => runs(samples, raw.width(), raw.height()),
    }
}

/// Variance of the noise in each of two samples that would make them differ as they do, gain and offset apart.
fn difference(one: &[f32], other: &[f32]) -> f64 {
    let count = one.len().max(1) as f64;
    let (mut a, mut b, mut aa, mut ab, mut bb) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (&x, &y) in one.iter().zip(other) {
        let (x, y) = (f64::from(x), f64::from(y));
        a += x;
        b += y;
        aa += x * x;
        ab += x * y;
        bb += y * y;
    }
    let (aa, ab, bb) = (aa - a * a / count, ab - a * b / count, bb - b * b / count);
    let gain = if aa > 0.0 { ab / aa } else { 0.0 };
    ((bb - gain * ab) / (1.0 + gain * gain) / count).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_pcg::Pcg64;

    const SIDE: usize = 200;

    /// A texture moved by so many pixels, in a light of a strength, with noise of two grey levels and the pixels' own
    /// offsets.
    fn frame(random: &mut Pcg64, shift_px: f64, light: f64) -> RawImage {
        let pixel = |k: usize| {
            let (x, y) = ((k % SIDE) as f64 + shift_px, (k / SIDE) as f64);
            let texture = 100.0 + 40.0 * (x / 1.7).sin() + 30.0 * (x / 9.0 + y / 2.3).cos();
            let offset = f64::from((k * 7919 % 13) as u32) / 4.0;
            (light * texture + offset + 2.0 * random.sample::<f64, _>(StandardNormal)) as u8
        };
        RawImage::from_u8(SIDE, SIDE, (0..SIDE * SIDE).map(pixel).collect())
    }

    #[test]
    fn noise_and_light_do_not_move_a_picture_and_a_fifth_of_a_pixel_does() {
        let mut random = Pcg64::seed_from_u64(5);
        let mut stillness = Stillness::default();
        for k in 0..40 {
            let light = 1.0 + 0.2 * f64::from(k % 3);
            assert!(!stillness.has_moved(&frame(&mut random, 0.0, light)), "frame {k}");
        }
        assert!(stillness.has_moved(&frame(&mut random, 0.2, 1.0)));
        assert!(!stillness.has_moved(&frame(&mut random, 0.2, 1.0)));
        // So slowly that no two frames in a row differ.
        let moved = (0..40).any(|k| stillness.has_moved(&frame(&mut random, 0.2 + 0.01 * f64::from(k), 1.0)));
        assert!(moved);
    }

    #[test]
    fn a_frame_of_another_size_and_one_without_light_are_no_trouble() {
        let mut stillness = Stillness::default();
        let dark = |side: usize| RawImage::from_u8(side, side, vec![0; side * side]);
        assert!(!stillness.has_moved(&dark(5)));
        assert!(!stillness.has_moved(&dark(5)));
        assert!(stillness.has_moved(&dark(70)));
        assert!(!stillness.has_moved(&dark(70)));
    }
}
