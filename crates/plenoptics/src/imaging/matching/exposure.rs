//! Whether a frame is exposed well enough to be measured, and how noisy it is, from its micro-images or a sample of them.

use rayon::prelude::*;

use super::plan::{Plan, spread};
use super::samples::{Frame, Sample};
use crate::imaging::spacing::SpacingError;

/// Share of saturated pixels within the masks above which a frame is refused.
const SATURATED_SHARE: f64 = 0.4;
/// Part of the masks' radius within which noise is looked for.
const NOISE_RADIUS: f64 = 0.85;

/// A sample of a frame's micro-images.
#[derive(Debug, Clone)]
pub(in crate::imaging) struct Exposure {
    lenses: Vec<usize>,
    /// Half widths of a disc's rows, from its middle row on: for light and saturation, and for noise.
    discs: [Vec<i32>; 2],
    counts: Vec<Count>,
    variances: Vec<f32>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Count {
    pixels: u32,
    saturated: u32,
    sum: f32,
    variance: f32,
}

impl Exposure {
    /// For masks of this radius (px), of so many micro-images at most.
    pub(in crate::imaging) fn new(plan: &Plan, radius: f64, most: usize) -> Self {
        let lenses: Vec<usize> = spread(plan.lenses.len(), most).collect();
        let disc = |radius: f64| {
            (0..=radius as i32).map(|y| (radius * radius - f64::from(y * y)).max(0.0).sqrt() as i32).collect()
        };
        let counts = vec![Count::default(); lenses.len()];
        let variances = Vec::with_capacity(lenses.len());
        Self { lenses, discs: [disc(radius), disc(NOISE_RADIUS * radius)], counts, variances }
    }

    /// Standard deviation of the frame's noise, grey levels: from the lower quartile over micro-images of what a filter
    /// blind to planes and saddles leaves, which belongs to those without sharp texture.
    pub(in crate::imaging) fn check<T: Sample>(
        &mut self,
        frame: &Frame<'_, T>,
        plan: &Plan,
    ) -> Result<f64, SpacingError> {
        let discs = &self.discs;
        let arch = pulp::Arch::new();
        self.counts
            .par_iter_mut()
            .zip(&self.lenses)
            .with_min_len(16)
            .for_each(|(count, &k)| *count = arch.dispatch(Look { frame, centre: plan.lenses[k].nearest, discs }));
        let total = |f: fn(&Count) -> f64| self.counts.iter().map(f).sum::<f64>();
        let pixels = total(|c| f64::from(c.pixels)).max(1.0);
        let share = total(|c| f64::from(c.saturated)) / pixels;
        if share > SATURATED_SHARE {
            return Err(SpacingError::Saturated { share });
        }
        let mean = total(|c| f64::from(c.sum)) / pixels;
        // An 8-bit frame whose micro-images average three grey levels holds no texture above its own quantisation.
        let least = (f64::from(frame.white.grey()) * 0.012).min(3.0);
        if mean < least {
            return Err(SpacingError::Dark { mean, least });
        }
        self.variances.clear();
        self.variances.extend(self.counts.iter().map(|c| c.variance));
        let quartile = self.variances.len() / 4;
        let (_, variance, _) = self.variances.select_nth_unstable_by(quartile, f32::total_cmp);
        Ok(f64::from(*variance).sqrt())
    }
}

struct Look<'a, T> {
    frame: &'a Frame<'a, T>,
    centre: [i32; 2],
    discs: &'a [Vec<i32>; 2],
}

impl<T: Sample> pulp::WithSimd for Look<'_, T> {
    type Output = Count;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) -> Count {
        let Self { frame, centre: [x, y], discs: [whole, inner] } = self;
        let row = |dy: i32, half: i32| -> &[T] {
            // Micro-images lie within the frame by more than their masks.
            let start = ((y + dy).max(0) as usize) * frame.width + (x - half).max(0) as usize;
            frame.samples.get(start..start + 2 * half as usize + 1).unwrap_or_default()
        };
        let mut count = Count::default();
        let reach = whole.len() as i32 - 1;
        for dy in -reach..=reach {
            for &sample in row(dy, whole[dy.unsigned_abs() as usize]) {
                count.pixels += 1;
                count.saturated += u32::from(sample >= frame.white);
                count.sum += sample.grey();
            }
        }
        // What a filter blind to planes and saddles leaves; 36 is the sum of squares of (1 −2 1) × (1 −2 1). In a mosaic it
        // is spread, so that it meets pixels of one colour.
        let apart = if frame.mosaic.is_some() { 2 } else { 1 };
        let (mut squares, mut pixels) = (0.0f32, 0u32);
        let reach = inner.len() as i32 - 1;
        for dy in -reach..=reach {
            let half = inner[dy.unsigned_abs() as usize];
            let wide = half + apart;
            let [above, here, below] = [row(dy - apart, wide), row(dy, wide), row(dy + apart, wide)];
            let count = (2 * half + 1) as usize;
            let step = apart as usize;
            if [above, here, below].iter().any(|line| line.len() < count + 2 * step) {
                continue;
            }
            for k in 0..count {
                if !frame.is_reference((x - half) as usize + k, (y + dy) as usize) {
                    continue;
                }
                let line = |v: &[T]| v[k].grey() - 2.0 * v[k + step].grey() + v[k + 2 * step].grey();
                let response = line(above) - 2.0 * line(here) + line(below);
                squares += response * response;
                pixels += 1;
            }
        }
        count.variance = squares / 36.0 / pixels.max(1) as f32;
        count
    }
}
