//! How alike neighbouring micro-images are at every spacing that they may have.

use rayon::prelude::*;

use crate::imaging::spacing::{Pair, SpacingFrame};

/// Pixels that are handled together.
const LANES: usize = 8;
/// Constants of the structural similarity, as shares of the frame's range: what its authors give.
const K: [f32; 2] = [0.01, 0.03];
/// Fewer pixels than this say nothing about a pair.
const LEAST_PIXELS: f32 = 24.0;
/// Pixels that a similarity is worth: by chance alone it departs from its expectation by one over the root of their
/// number, and of many candidates the best is the luckiest.
const CHANCE: f32 = 1.0;

/// The similarity of each micro-image with its neighbours for each spacing.
pub(super) struct Volume {
    spacings: usize,
    /// Micro-image by micro-image, −1 to 1.
    ssim: Vec<f32>,
}

impl Volume {
    /// Compares every pair of neighbours of a frame at each of these spacings (px).
    pub(super) fn new(frame: &SpacingFrame, spacings: &[f64]) -> Self {
        let terms = Terms::of(frame);
        let by_pair: Vec<Vec<f32>> = frame
            .pairs()
            .par_iter()
            .map(|&pair| pulp::Arch::new().dispatch(Scan { frame, pair, spacings, terms }))
            .collect();
        let mut around: Vec<Vec<usize>> = vec![Vec::new(); frame.micro_images().len()];
        for (k, pair) in frame.pairs().iter().enumerate() {
            around[pair.first].push(k);
            around[pair.second].push(k);
        }
        let ssim = around
            .par_iter()
            .flat_map_iter(|pairs| {
                let mut values = [0.0f32; 6];
                let by_pair = &by_pair;
                (0..spacings.len()).map(move |s| {
                    let count = pairs.len().min(values.len());
                    for (value, &pair) in values.iter_mut().zip(pairs) {
                        *value = by_pair[pair][s];
                    }
                    // Beside an edge in depth half of the neighbours show something else.
                    let best = &mut values[..count];
                    best.sort_unstable_by(|a, b| b.total_cmp(a));
                    let half = count.div_ceil(2).max(1);
                    best.iter().take(half).sum::<f32>() / half as f32
                })
            })
            .collect();
        Self { spacings: spacings.len(), ssim }
    }

    /// The similarities of one micro-image, spacing by spacing.
    pub(super) fn ssim(&self, lens: usize) -> &[f32] {
        &self.ssim[lens * self.spacings..][..self.spacings]
    }

    /// How many spacings.
    pub(super) fn spacings(&self) -> usize {
        self.spacings
    }
}

/// What enters the similarity beside the moments.
#[derive(Clone, Copy)]
struct Terms {
    constants: [f32; 2],
}

impl Terms {
    fn of(frame: &SpacingFrame) -> Self {
        let range = frame.range();
        // Noise that both have must not pass for a difference in structure.
        let noise = 2.0 * (frame.noise_grey_levels() as f32).powi(2);
        Self { constants: [(K[0] * range).powi(2), (K[1] * range).powi(2).max(noise)] }
    }

    #[inline(always)]
    fn similarity(&self, sums: &Sums) -> f32 {
        if sums.count < LEAST_PIXELS {
            return 0.0;
        }
        let n = sums.count;
        let (a, b) = (sums.a / n, sums.b / n);
        let (aa, bb, ab) = (sums.aa / n - a * a, sums.bb / n - b * b, sums.ab / n - a * b);
        let [c1, c2] = self.constants;
        let (a, b) = (a + sums.level, b + sums.level);
        let luminance = (2.0 * a * b + c1) / (a * a + b * b + c1);
        let structure = (2.0 * ab + c2) / (aa + bb + c2);
        luminance * structure - CHANCE / n.sqrt()
    }
}

/// Moments about a level.
#[derive(Clone, Copy)]
struct Sums {
    count: f32,
    level: f32,
    a: f32,
    b: f32,
    aa: f32,
    ab: f32,
    bb: f32,
}

/// One pair at all spacings, compiled for each instruction set.
struct Scan<'a> {
    frame: &'a SpacingFrame,
    pair: Pair,
    spacings: &'a [f64],
    terms: Terms,
}

impl pulp::WithSimd for Scan<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) -> Vec<f32> {
        let mut similarities = Vec::with_capacity(self.spacings.len());
        for &spacing in self.spacings {
            similarities.push(self.terms.similarity(&self.sums(spacing)));
        }
        similarities
    }
}

impl Scan<'_> {
    /// Moments over the overlap of the two discs, the second moved back by the spacing and read between its pixels.
    #[inline(always)]
    fn sums(&self, spacing: f64) -> Sums {
        let frame = self.frame;
        let (values, width) = frame.values();
        let [a, b] = [self.pair.first, self.pair.second].map(|k| frame.micro_images()[k].centre);
        let step = [b[0] - a[0], b[1] - a[1]];
        let scale = spacing / (step[0] * step[0] + step[1] * step[1]).sqrt();
        let shift = [step[0] * scale, step[1] * scale];
        let other = [b[0] - shift[0], b[1] - shift[1]];
        let radius = frame.mask_radius_px();
        let whole = [shift[0].floor(), shift[1].floor()];
        let (fx, fy) = ((shift[0] - whole[0]) as f32, (shift[1] - whole[1]) as f32);
        let taps = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        let offset = whole[1] as isize * width as isize + whole[0] as isize;
        // About the pair's own level, so that single precision suffices.
        let level = values[a[1].round() as usize * width + a[0].round() as usize];
        let top = (a[1].max(other[1]) - radius).ceil();
        let bottom = (a[1].min(other[1]) + radius).floor();
        let mut lanes = [[0.0f32; LANES]; 5];
        let mut count = 0;
        let mut y = top;
        while y <= bottom {
            let half = |centre: [f64; 2]| (radius * radius - (y - centre[1]) * (y - centre[1])).max(0.0).sqrt();
            let (ha, hb) = (half(a), half(other));
            let left = (a[0] - ha).max(other[0] - hb).ceil();
            let right = (a[0] + ha).min(other[0] + hb).floor();
            if right >= left {
                let n = (right - left) as usize + 1;
                count += n;
                let at = y as usize * width + left as usize;
                let moved = (at as isize + offset) as usize;
                let own = &values[at..at + n];
                let above = &values[moved..moved + n + 1];
                let below = &values[moved + width..moved + width + n + 1];
                accumulate(&mut lanes, own, above, below, taps, level);
            }
            y += 1.0;
        }
        let [sa, sb, saa, sab, sbb] = lanes.map(|lane| lane.iter().sum::<f32>());
        Sums { count: count as f32, level, a: sa, b: sb, aa: saa, ab: sab, bb: sbb }
    }
}

#[inline(always)]
fn accumulate(lanes: &mut [[f32; LANES]; 5], own: &[f32], above: &[f32], below: &[f32], taps: [f32; 4], level: f32) {
    let n = own.len();
    let mut k = 0;
    while k + LANES <= n {
        let own: &[f32; LANES] = own[k..k + LANES].try_into().unwrap_or(&[0.0; LANES]);
        let (above, below) = (&above[k..=k + LANES], &below[k..=k + LANES]);
        for lane in 0..LANES {
            let a = own[lane] - level;
            let b =
                taps[0] * above[lane] + taps[1] * above[lane + 1] + taps[2] * below[lane] + taps[3] * below[lane + 1]
                    - level;
            lanes[0][lane] += a;
            lanes[1][lane] += b;
            lanes[2][lane] += a * a;
            lanes[3][lane] += a * b;
            lanes[4][lane] += b * b;
        }
        k += LANES;
    }
    while k < n {
        let a = own[k] - level;
        let b = taps[0] * above[k] + taps[1] * above[k + 1] + taps[2] * below[k] + taps[3] * below[k + 1] - level;
        for (lane, term) in lanes.iter_mut().zip([a, b, a * a, a * b, b * b]) {
            lane[0] += term;
        }
        k += 1;
    }
}
