//! Whether a frame is exposed well enough to be measured, and how noisy it is, from its micro-images or a sample of them.

use rayon::prelude::*;

use super::plan::{Plan, spread};
use super::samples::{Frame, Sample};
use crate::imaging::spacing::SpacingError;

/// Share of saturated pixels within the masks above which a frame is refused.
const SATURATED_SHARE: f64 = 0.4;
/// Part of the masks' radius within which noise is looked for.
const NOISE_RADIUS: f64 = 0.85;
/// Side of the blocks that noise is told from, samples of one colour.
const BLOCK: i32 = 5;
/// Fewest blocks that it is told from: with fewer whole micro-images take their place.
const BLOCKS_LEAST: usize = 64;
/// Variance of a block's mean square over that mean's square, times its samples: what the filter leaves of neighbours is
/// not independent. Twice the square of 1 + 2 (2/3)² + 2 (1/6)².
const SPREAD: f64 = 7.56;
/// Standard deviations above the mean beyond which a block has texture, and what the mean of those below comes to.
const CLEAN_BELOW: f64 = 2.0;
const CLEAN_MEAN: f64 = 0.955;
/// Rounds of leaving out what is above; they settle within five.
const ROUNDS: usize = 10;

/// A sample of a frame's micro-images.
#[derive(Debug, Clone)]
pub(in crate::imaging) struct Exposure {
    lenses: Vec<usize>,
    /// Half widths of a disc's rows, from its middle row on: for light and saturation, and for noise.
    discs: [Vec<i32>; 2],
    counts: Vec<Count>,
    /// Variances of the pieces of each that the noise is told from: infinite where a piece tells nothing.
    variances: Vec<f32>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Count {
    pixels: u32,
    saturated: u32,
    sum: f32,
}

impl Exposure {
    /// For masks of this radius (px), of so many micro-images at most.
    pub(in crate::imaging) fn new(plan: &Plan, radius: f64, most: usize) -> Self {
        let lenses: Vec<usize> = spread(plan.lenses.len(), most).collect();
        let disc = |radius: f64| {
            (0..=radius as i32).map(|y| (radius * radius - f64::from(y * y)).max(0.0).sqrt() as i32).collect()
        };
        let counts = vec![Count::default(); lenses.len()];
        Self { lenses, discs: [disc(radius), disc(NOISE_RADIUS * radius)], counts, variances: Vec::new() }
    }

    /// Standard deviation of the frame's noise, grey levels, from what a filter blind to planes and saddles leaves: the
    /// lesser of its lower quartile over micro-images, which belongs to those without sharp texture, and of the mean over
    /// those small blocks of them that no texture lifts above what noise alone makes of a block.
    pub(in crate::imaging) fn check<T: Sample>(
        &mut self,
        frame: &Frame<'_, T>,
        plan: &Plan,
    ) -> Result<f64, SpacingError> {
        // In a mosaic the filter is spread, so that it meets pixels of one colour.
        let apart = if frame.mosaic.is_some() { 2 } else { 1 };
        let mut pieces = squares(&self.discs[1], BLOCK * apart);
        let mut by_blocks = pieces.len() * self.lenses.len() >= BLOCKS_LEAST;
        if by_blocks {
            self.look(frame, plan, apart, &pieces);
            by_blocks = self.variances.iter().filter(|variance| variance.is_finite()).count() >= BLOCKS_LEAST;
        }
        if !by_blocks {
            pieces = vec![rows(&self.discs[1])];
            self.look(frame, plan, apart, &pieces);
        }
        let each = pieces.len();
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
        let mean = |variances: &[f32]| {
            let told = || variances.iter().filter(|variance| variance.is_finite());
            if told().count() == 0 { f32::INFINITY } else { told().sum::<f32>() / told().count() as f32 }
        };
        let mut means: Vec<f32> = self.variances.chunks_exact(each).map(mean).collect();
        let quartile = means.len() / 4;
        let (_, quartile, _) = means.select_nth_unstable_by(quartile, f32::total_cmp);
        let mut variance = f64::from(*quartile);
        if by_blocks {
            let green = if apart > 1 { 2 } else { 1 };
            // Texture makes either too large: where there is some everywhere, that of blocks; where edges are in all
            // micro-images, that of micro-images.
            self.variances.retain(|variance| variance.is_finite());
            variance = variance.min(clean(&mut self.variances, f64::from(BLOCK * BLOCK * green)));
        }
        Ok(variance.sqrt())
    }

    /// Counts light, and fills the variances of these pieces of each micro-image.
    fn look<T: Sample>(&mut self, frame: &Frame<'_, T>, plan: &Plan, apart: i32, pieces: &[Vec<Run>]) {
        let each = pieces.len();
        self.variances.clear();
        self.variances.resize(each * self.lenses.len(), 0.0);
        let whole = &self.discs[0];
        let arch = pulp::Arch::new();
        self.counts
            .par_iter_mut()
            .zip(self.variances.par_chunks_mut(each))
            .zip(&self.lenses)
            .with_min_len(16)
            .for_each(|((count, variances), &k)| {
                *count = arch.dispatch(Look { frame, centre: plan.lenses[k].nearest, whole, pieces, apart, variances });
            });
    }
}

/// The rows of a disc.
fn rows(disc: &[i32]) -> Vec<Run> {
    let reach = disc.len() as i32 - 1;
    let row = |y: i32| {
        let half = disc[y.unsigned_abs() as usize];
        Run { x: -half, y, count: 2 * half + 1 }
    };
    (-reach..=reach).map(row).collect()
}

/// The blocks of this side (px) within a disc, as rows, side by side from its middle on.
fn squares(disc: &[i32], side: i32) -> Vec<Vec<Run>> {
    let reach = disc.len() as i32 - 1;
    let half = |dy: i32| disc.get(dy.unsigned_abs() as usize).copied().unwrap_or(-1);
    let first = -(reach / side + 1) * side - side / 2;
    let places = || (0..).map(|k| first + k * side).take_while(|&at| at <= reach);
    let within = |x: i32, y: i32| [y, y + side - 1].iter().all(|&dy| x.abs().max((x + side - 1).abs()) <= half(dy));
    places()
        .flat_map(|y| places().map(move |x| (x, y)))
        .filter(|&(x, y)| within(x, y))
        .map(|(x, y)| (y..y + side).map(|y| Run { x, y, count: side }).collect())
        .collect()
}

/// Variance of the noise from the variances of blocks of so many samples: the mean of those that it alone explains, brought
/// together with what it explains.
fn clean(variances: &mut [f32], samples: f64) -> f64 {
    variances.sort_unstable_by(f32::total_cmp);
    let relative = (SPREAD / samples).sqrt();
    let cut_at = 1.0 + CLEAN_BELOW * relative;
    // The least twentieth lie about as far below the mean.
    let mut variance = f64::from(variances[variances.len() / 20]) / (1.0 - 1.3 * relative).max(0.3);
    for _ in 0..ROUNDS {
        let cut = (variance * cut_at) as f32;
        let below = variances.partition_point(|&v| v <= cut).max(1);
        let mean = variances[..below].iter().map(|&v| f64::from(v)).sum::<f64>() / below as f64;
        variance = mean / CLEAN_MEAN;
    }
    variance
}

/// A piece of a row, from the middle of a micro-image: its first pixel and how many there are.
#[derive(Debug, Clone, Copy)]
struct Run {
    x: i32,
    y: i32,
    count: i32,
}

struct Look<'a, T> {
    frame: &'a Frame<'a, T>,
    centre: [i32; 2],
    /// Half widths of the rows that light and saturation are counted in, from the middle one on.
    whole: &'a [i32],
    /// What the noise is told from, piece by piece.
    pieces: &'a [Vec<Run>],
    /// Pixels from one of the filter's to the next.
    apart: i32,
    variances: &'a mut [f32],
}

impl<T: Sample> pulp::WithSimd for Look<'_, T> {
    type Output = Count;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) -> Count {
        let Self { frame, centre: [x, y], whole, pieces, apart, variances } = self;
        let row = |from: i32, dy: i32, count: i32| -> &[T] {
            // Micro-images lie within the frame by more than their masks.
            let start = ((y + dy).max(0) as usize) * frame.width + (x + from).max(0) as usize;
            frame.samples.get(start..start + count as usize).unwrap_or_default()
        };
        let mut count = Count::default();
        let reach = whole.len() as i32 - 1;
        for dy in -reach..=reach {
            let half = whole[dy.unsigned_abs() as usize];
            for &sample in row(-half, dy, 2 * half + 1) {
                count.pixels += 1;
                count.saturated += u32::from(sample >= frame.white);
                count.sum += sample.grey();
            }
        }
        // What a filter blind to planes and saddles leaves; 36 is the sum of squares of (1 −2 1) × (1 −2 1).
        // Where a block is clipped its noise is, too: it tells nothing, as long as there are others.
        let step = apart as usize;
        let in_blocks = pieces.len() > 1;
        for (variance, runs) in variances.iter_mut().zip(pieces) {
            let (mut squares, mut pixels, mut clipped) = (0.0f32, 0u32, false);
            for run in runs {
                let wide = run.count + 2 * apart;
                let lines = [-apart, 0, apart].map(|dy| row(run.x - apart, run.y + dy, wide));
                if lines.iter().any(|line| line.len() < wide as usize) {
                    continue;
                }
                let [above, here, below] = lines;
                clipped |= here.iter().any(|&sample| sample.level() == 0 || sample >= frame.white);
                for k in 0..run.count as usize {
                    if !frame.is_reference((x + run.x) as usize + k, (y + run.y) as usize) {
                        continue;
                    }
                    let line = |v: &[T]| v[k].grey() - 2.0 * v[k + step].grey() + v[k + 2 * step].grey();
                    let response = line(above) - 2.0 * line(here) + line(below);
                    squares += response * response;
                    pixels += 1;
                }
            }
            let told = !(in_blocks && (clipped || pixels == 0));
            *variance = if told { squares / 36.0 / pixels.max(1) as f32 } else { f32::INFINITY };
        }
        count
    }
}
