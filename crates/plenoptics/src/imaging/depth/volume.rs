//! How alike neighbouring micro-images are at every spacing that they may have.

use rayon::prelude::*;

use super::frame::DepthFrame;
use super::overlap::{Shift, between, lanes, load, splat};

/// Constants of the structural similarity, as shares of the frame's range: what its authors give.
const K: [f32; 2] = [0.01, 0.03];
/// Fewer pixels than this say nothing about a pair.
const LEAST_PIXELS: f32 = 24.0;
/// Pixels that a similarity is worth: by chance alone it departs from its expectation by one over the root of their
/// number, and of many candidates the best is the luckiest.
const CHANCE: f32 = 1.0;
/// Neighbours that a micro-image has at most.
const NEIGHBOURS: usize = 6;
/// Pairs that are compared in one piece of work.
const PIECE: usize = 16;

/// The similarity of each micro-image with its neighbours for each spacing.
pub(super) struct Volume {
    spacings: usize,
    /// Micro-image by micro-image, −1 to 1.
    ssim: Vec<f32>,
}

impl Volume {
    /// Compares every pair of neighbours of a frame at each of these spacings (px).
    pub(super) fn new(frame: &DepthFrame, spacings: &[f64]) -> Self {
        let count = spacings.len();
        let terms = Terms::of(frame);
        let mut by_pair = vec![0.0f32; frame.pairs.len() * count];
        by_pair.par_chunks_mut(PIECE * count).zip(frame.pairs.par_chunks(PIECE)).for_each(|(similarities, pairs)| {
            pulp::Arch::new().dispatch(Scan { frame, pairs, spacings, terms, similarities });
        });
        let mut around: Vec<Around> = vec![Around::default(); frame.lenses.len()];
        for (k, pair) in frame.pairs.iter().enumerate() {
            pair.iter().for_each(|&lens| around[lens].add(k));
        }
        let mut ssim = vec![0.0f32; frame.lenses.len() * count];
        ssim.par_chunks_mut(count).zip(&around).with_min_len(PIECE).for_each(|(ssim, around)| {
            let mut values = [0.0f32; NEIGHBOURS];
            let best = &mut values[..around.count];
            let half = around.count.div_ceil(2).max(1);
            for (s, ssim) in ssim.iter_mut().enumerate() {
                for (value, &pair) in best.iter_mut().zip(&around.pairs) {
                    *value = by_pair[pair * count + s];
                }
                // Beside an edge in depth half of the neighbours show something else.
                best.sort_unstable_by(|a, b| b.total_cmp(a));
                *ssim = best.iter().take(half).sum::<f32>() / half as f32;
            }
        });
        Self { spacings: count, ssim }
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

/// The pairs of one micro-image.
#[derive(Clone, Copy, Default)]
struct Around {
    pairs: [usize; NEIGHBOURS],
    count: usize,
}

impl Around {
    fn add(&mut self, pair: usize) {
        if let Some(place) = self.pairs.get_mut(self.count) {
            *place = pair;
            self.count += 1;
        }
    }
}

/// What enters the similarity beside the moments.
#[derive(Clone, Copy)]
struct Terms {
    constants: [f32; 2],
}

impl Terms {
    fn of(frame: &DepthFrame) -> Self {
        // Noise that both have must not pass for a difference in structure.
        let noise = 2.0 * frame.noise.powi(2);
        Self { constants: [(K[0] * frame.range).powi(2), (K[1] * frame.range).powi(2).max(noise)] }
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

/// Some pairs at all spacings, compiled for each instruction set.
struct Scan<'a> {
    frame: &'a DepthFrame<'a>,
    pairs: &'a [[usize; 2]],
    spacings: &'a [f64],
    terms: Terms,
    similarities: &'a mut [f32],
}

impl pulp::WithSimd for Scan<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let Self { frame, pairs, spacings, terms, similarities } = self;
        let mut found = similarities.iter_mut();
        for &[first, second] in pairs {
            let [a, b] = [frame.lenses[first].centre, frame.lenses[second].centre];
            let step = [b[0] - a[0], b[1] - a[1]];
            let length = (step[0] * step[0] + step[1] * step[1]).sqrt();
            let nearest = frame.nearest(first);
            for &spacing in spacings {
                let scale = spacing / length;
                let sums = moments(simd, frame, nearest, &Shift::new(b, [step[0] * scale, step[1] * scale]));
                if let Some(similarity) = found.next() {
                    *similarity = terms.similarity(&sums);
                }
            }
        }
    }
}

/// Moments over what the two discs share, the second moved back and read between its pixels.
#[inline(always)]
fn moments<S: pulp::Simd>(simd: S, frame: &DepthFrame, first: [i32; 2], shift: &Shift) -> Sums {
    let (values, width) = (frame.values, frame.width);
    // About the pair's own level, so that single precision suffices.
    let level = values[first[1] as usize * width + first[0] as usize];
    let levels = simd.splat_f32s(level);
    let [fx, fy] = shift.fraction;
    let taps = splat(simd, [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy]);
    let offset = shift.whole[1] as isize * width as isize + shift.whole[0] as isize;
    let mut sums = [simd.splat_f32s(0.0); 5];
    let mut count = 0;
    let [top, bottom] = shift.rows(&frame.disc, first);
    for y in top..=bottom {
        let [left, right] = shift.columns(&frame.disc, first, y);
        if right < left {
            continue;
        }
        let n = (right - left) as usize + 1;
        count += n;
        let at = y as usize * width + left as usize;
        let moved = (at as isize + offset) as usize;
        // Whole vectors: what lies beyond the row's end is read and counts for nothing.
        let whole = n.next_multiple_of(S::F32_LANES);
        let own = &values[at..at + whole];
        let theirs = [moved, moved + 1, moved + width, moved + width + 1];
        let theirs = [
            &values[theirs[0]..][..whole],
            &values[theirs[1]..][..whole],
            &values[theirs[2]..][..whole],
            &values[theirs[3]..][..whole],
        ];
        let mut k = 0;
        while k < n {
            let mask = lanes::<S>(n - k);
            let a = simd.mul_f32s(mask, simd.sub_f32s(load::<S>(own, k), levels));
            let b = simd.mul_f32s(mask, simd.sub_f32s(between(simd, &taps, theirs, k), levels));
            sums[0] = simd.add_f32s(sums[0], a);
            sums[1] = simd.add_f32s(sums[1], b);
            sums[2] = simd.mul_add_e_f32s(a, a, sums[2]);
            sums[3] = simd.mul_add_e_f32s(a, b, sums[3]);
            sums[4] = simd.mul_add_e_f32s(b, b, sums[4]);
            k += S::F32_LANES;
        }
    }
    Sums {
        count: count as f32,
        level,
        a: simd.reduce_sum_f32s(sums[0]),
        b: simd.reduce_sum_f32s(sums[1]),
        aa: simd.reduce_sum_f32s(sums[2]),
        ab: simd.reduce_sum_f32s(sums[3]),
        bb: simd.reduce_sum_f32s(sums[4]),
    }
}
