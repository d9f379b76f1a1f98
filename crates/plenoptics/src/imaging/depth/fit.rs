//! One pair of neighbours fitted by itself.
//!
//! The estimator is that of [`crate::imaging::spacing`]: the slope of the un-interpolated reference matches, the
//! neighbour's own slope makes the derivative, so that noise biases neither; gain and offset are free. Here every pair
//! stands for itself, and hundredths of a pixel are enough: what it needs is worked out within the two micro-images,
//! between pixels by cubic convolution.

use super::frame::DepthFrame;
use super::overlap::{Disc, Shift, WIDEST, between, lanes, load, splat};
use crate::imaging::view::keys;

/// Smoothed slope over two pixels to either side, and smoothing across it: a Gaussian of 1 px. The pixel itself has no
/// weight in its slope, so that its noise never meets itself.
const SLOPE: [f32; 2] = [0.2643, 0.1179];
const SMOOTH: [f32; 2] = [0.4519, 0.274_05];
/// Sum of squares of the two together: the slopes' noise variance in units of the pixels'.
const SLOPE_NOISE: f64 = 0.0593;
/// Slope of what is not smoothed, right to the fourth order: what a shift changes.
const CHANGE: [f32; 2] = [8.0 / 12.0, -1.0 / 12.0];
/// Pixels that a slope is wanted beyond the disc: neighbours are read between pixels.
const BEYOND: i32 = 2;
/// Pixels that a slope reaches.
const REACH: i32 = 2;
/// What interpolation and the pixels' own area leave of a content's energy where two micro-images do show the same.
const MODEL_SHARE: f64 = 0.004;
/// Fewer pixels than this are fewer than the unknowns of a pair can be told from.
const LEAST_PIXELS: f64 = 12.0;
const SUMS: usize = 13;

/// What a pair says about its spacing at a guess.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PairStep {
    /// From the guess to the best spacing, px.
    pub(super) step_px: f64,
    /// Standard uncertainty, px: noise, and how badly the two match.
    pub(super) sigma_px: f64,
}

/// Fits pairs one after the other, with buffers that are used again.
pub(super) struct PairFit {
    ends: [usize; 2],
    /// From the first centre to the second, of length 1.
    unit: [f64; 2],
    /// Columns of a tile that are in use, and from a row to the next.
    side: usize,
    stride: usize,
    /// Smoothed slopes along the pair over a square about each end's nearest pixel.
    slopes: [Vec<f32>; 2],
    /// The slopes there of what is not smoothed.
    changes: [Vec<f32>; 2],
    /// One row smoothed across, and its slope downwards.
    lines: [Vec<f32>; 2],
    /// The neighbour, read between columns.
    across: Vec<f32>,
}

impl PairFit {
    pub(super) fn new(disc: &Disc) -> Self {
        let side = 2 * (disc.reach() + BEYOND) as usize + 1;
        let stride = side.next_multiple_of(WIDEST) + WIDEST;
        let tile = || vec![0.0; stride * (side + 1)];
        Self {
            ends: [0; 2],
            unit: [0.0; 2],
            side,
            stride,
            slopes: [tile(), tile()],
            changes: [tile(), tile()],
            lines: [vec![0.0; stride + WIDEST], vec![0.0; stride + WIDEST]],
            across: vec![0.0; stride * (side + 4)],
        }
    }

    /// Turns to a pair.
    pub(super) fn begin(&mut self, frame: &DepthFrame, ends: [usize; 2]) {
        let [a, b] = ends.map(|end| frame.lenses[end].centre);
        let step = [b[0] - a[0], b[1] - a[1]];
        let length = step[0].hypot(step[1]);
        self.ends = ends;
        self.unit = step.map(|x| x / length);
        pulp::Arch::new().dispatch(Slopes { fit: self, frame });
    }

    /// One step of Newton's from a guess (px). `None` where the two hardly overlap, or nothing in them changes along the
    /// pair.
    pub(super) fn step(&mut self, frame: &DepthFrame, guess_px: f64) -> Option<PairStep> {
        let noise = f64::from(frame.noise);
        let (mut score, mut information, mut variance, mut misfit) = (0.0, 0.0, 0.0, 0.0);
        for backwards in [false, true] {
            let sums = pulp::Arch::new().dispatch(Comparison { fit: self, frame, guess_px, backwards });
            let order = Order::new(&sums, noise)?;
            score += if backwards { -order.score } else { order.score };
            information += order.information;
            // Both orders see the same noise: their scores add, not their variances.
            variance += 4.0 * noise * noise * order.energy;
            misfit += 0.5 * order.misfit;
        }
        (information > 0.0).then(|| PairStep {
            step_px: score / information,
            sigma_px: (variance * f64::max(misfit, 1.0)).sqrt() / information,
        })
    }
}

/// What one order of a pair says: the reference's smoothed slopes t against its values a, the neighbour's values b and
/// their changes d.
struct Order {
    score: f64,
    information: f64,
    energy: f64,
    misfit: f64,
}

impl Order {
    fn new(sums: &[f64; SUMS], noise: f64) -> Option<Self> {
        let &[pixels, a, b, t, d, aa, ab, bb, ta, tb, tt, td, ad] = sums;
        if pixels < LEAST_PIXELS {
            return None;
        }
        let about = |product: f64, one: f64, other: f64| product - one * other / pixels;
        let (aa, ab, bb) = (about(aa, a, a), about(ab, a, b), about(bb, b, b));
        let (ta, tb, tt) = (about(ta, t, a), about(tb, t, b), about(tt, t, t));
        let (td, ad) = (about(td, t, d), about(ad, a, d));
        let share = noise * noise * pixels;
        // Where a micro-image is flat, its moments are rounding errors: never less than the noise would make.
        let clean = |moment: f64| (moment - share).max(0.25 * moment).max(0.25 * share).max(1e-9);
        let (clean_aa, clean_bb) = (clean(aa), clean(bb));
        let gain = (clean_aa / clean_bb).sqrt().clamp(0.25, 4.0);
        let left = (aa - 2.0 * gain * ab + gain * gain * bb).max(0.0);
        // The slope made orthogonal to the reference, as the gain is free.
        let projection = ta / clean_aa;
        let trust = (1.0 - share * SLOPE_NOISE / tt.max(1e-12)).clamp(0.0, 1.0);
        Some(Self {
            score: trust * ((ta - projection * clean_aa) - gain * (tb - projection * ab)),
            information: trust * gain * (td - projection * ad),
            energy: trust * trust * (tt - projection * ta).max(0.0),
            misfit: left / (2.0 * share + MODEL_SHARE * (aa + gain * gain * bb)).max(1e-9),
        })
    }
}

/// The slopes of both ends, compiled for each instruction set.
struct Slopes<'a, 'f> {
    fit: &'a mut PairFit,
    frame: &'a DepthFrame<'f>,
}

impl pulp::WithSimd for Slopes<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) {
        let Self { fit, frame } = self;
        let [ux, uy] = [fit.unit[0] as f32, fit.unit[1] as f32];
        let (values, width) = (frame.values, frame.width);
        let (beyond, side) = (frame.disc.reach() + BEYOND, fit.side);
        // Two columns more on either side, for the slope along the row.
        let n = side + 2 * REACH as usize;
        let [smoothed, downwards] = &mut fit.lines;
        for (end, (slopes, changes)) in fit.slopes.iter_mut().zip(&mut fit.changes).enumerate() {
            let [x, y] = frame.nearest(fit.ends[end]);
            let left = (x - beyond - REACH) as usize;
            for row in 0..side {
                let at = ((y - beyond) as usize + row) * width + left;
                let line = |by: isize| -> &[f32] {
                    let from = at.wrapping_add_signed(by * width as isize);
                    &values[from..from + n]
                };
                let (up2, up, here, down, down2) = (line(-2), line(-1), line(0), line(1), line(2));
                let (smoothed, downwards) = (&mut smoothed[..n], &mut downwards[..n]);
                for k in 0..n {
                    smoothed[k] = SMOOTH[0] * here[k] + SMOOTH[1] * (up[k] + down[k]);
                    downwards[k] = SLOPE[0] * (down[k] - up[k]) + SLOPE[1] * (down2[k] - up2[k]);
                }
                let out = &mut slopes[row * fit.stride..][..side];
                for k in 0..side {
                    let along_x =
                        SLOPE[0] * (smoothed[k + 3] - smoothed[k + 1]) + SLOPE[1] * (smoothed[k + 4] - smoothed[k]);
                    let along_y = SMOOTH[0] * downwards[k + 2] + SMOOTH[1] * (downwards[k + 1] + downwards[k + 3]);
                    out[k] = ux * along_x + uy * along_y;
                }
                let out = &mut changes[row * fit.stride..][..side];
                for k in 0..side {
                    let along_x = CHANGE[0] * (here[k + 3] - here[k + 1]) + CHANGE[1] * (here[k + 4] - here[k]);
                    let along_y = CHANGE[0] * (down[k + 2] - up[k + 2]) + CHANGE[1] * (down2[k + 2] - up2[k + 2]);
                    out[k] = ux * along_x + uy * along_y;
                }
            }
        }
    }
}

/// One order of a pair at a guess, compiled for each instruction set.
struct Comparison<'a, 'f> {
    fit: &'a mut PairFit,
    frame: &'a DepthFrame<'f>,
    guess_px: f64,
    /// The second end is the reference.
    backwards: bool,
}

impl pulp::WithSimd for Comparison<'_, '_> {
    type Output = [f64; SUMS];

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> [f64; SUMS] {
        let Self { fit, frame, guess_px, backwards } = self;
        let (values, width, disc) = (frame.values, frame.width, &frame.disc);
        let (from, to) = if backwards { (1, 0) } else { (0, 1) };
        let by = if backwards { -guess_px } else { guess_px };
        let shift = Shift::new(frame.lenses[fit.ends[to]].centre, [by * fit.unit[0], by * fit.unit[1]]);
        let (first, second) = (frame.nearest(fit.ends[from]), frame.nearest(fit.ends[to]));
        let mut sums = [simd.splat_f32s(0.0); SUMS];
        let [top, bottom] = shift.rows(disc, first);
        let (mut left, mut right) = (i32::MAX, i32::MIN);
        for y in top..=bottom {
            let [l, r] = shift.columns(disc, first, y);
            if l <= r {
                left = left.min(l);
                right = right.max(r);
            }
        }
        if right < left {
            return [0.0; SUMS];
        }
        let columns = ((right - left) as usize + 1).next_multiple_of(S::F32_LANES);
        let wx = splat(simd, keys(shift.fraction[0]));
        let wy = splat(simd, keys(shift.fraction[1]));
        let stride = fit.stride;
        // The neighbour between its columns, from the row above the first to the second below the last.
        for row in 0..(bottom - top) as usize + 4 {
            let y = (top + shift.whole[1] - 1) as usize + row;
            let at = y * width + (left + shift.whole[0] - 1) as usize;
            let source = [
                &values[at..][..columns],
                &values[at + 1..][..columns],
                &values[at + 2..][..columns],
                &values[at + 3..][..columns],
            ];
            let out = &mut fit.across[row * stride..][..columns];
            let mut k = 0;
            while k < columns {
                S::as_mut_simd_f32s(&mut out[k..k + S::F32_LANES]).0[0] = between(simd, &wx, source, k);
                k += S::F32_LANES;
            }
        }
        let [fx, fy] = shift.fraction;
        let taps = splat(simd, [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy]);
        let beyond = disc.reach() + BEYOND;
        let own_level = simd.splat_f32s(values[first[1] as usize * width + first[0] as usize]);
        let other_level = simd.splat_f32s(values[second[1] as usize * width + second[0] as usize]);
        for y in top..=bottom {
            let [l, r] = shift.columns(disc, first, y);
            if r < l {
                continue;
            }
            let n = (r - l) as usize + 1;
            let whole = n.next_multiple_of(S::F32_LANES);
            let own = &values[y as usize * width + l as usize..][..whole];
            let from_across = (y - top) as usize * stride + (l - left) as usize;
            let lines = [
                &fit.across[from_across..][..whole],
                &fit.across[from_across + stride..][..whole],
                &fit.across[from_across + 2 * stride..][..whole],
                &fit.across[from_across + 3 * stride..][..whole],
            ];
            let place = |centre: [i32; 2], x: i32, y: i32| {
                (y - centre[1] + beyond) as usize * stride + (x - centre[0] + beyond) as usize
            };
            let slope = &fit.slopes[from][place(first, l, y)..][..whole];
            let corner = place(second, l + shift.whole[0], y + shift.whole[1]);
            let theirs = &fit.changes[to];
            let theirs = [
                &theirs[corner..][..whole],
                &theirs[corner + 1..][..whole],
                &theirs[corner + stride..][..whole],
                &theirs[corner + stride + 1..][..whole],
            ];
            let mut k = 0;
            while k < n {
                let mut m = lanes::<S>(n - k);
                if frame.mosaic.is_some() {
                    m = simd.mul_f32s(m, references::<S>(frame, l as usize + k, y as usize));
                }
                let a = simd.mul_f32s(m, simd.sub_f32s(load::<S>(own, k), own_level));
                let b = simd.mul_f32s(m, simd.sub_f32s(between(simd, &wy, lines, k), other_level));
                let t = simd.mul_f32s(m, load::<S>(slope, k));
                let d = simd.mul_f32s(m, between(simd, &taps, theirs, k));
                sums[0] = simd.add_f32s(sums[0], m);
                sums[1] = simd.add_f32s(sums[1], a);
                sums[2] = simd.add_f32s(sums[2], b);
                sums[3] = simd.add_f32s(sums[3], t);
                sums[4] = simd.add_f32s(sums[4], d);
                sums[5] = simd.mul_add_e_f32s(a, a, sums[5]);
                sums[6] = simd.mul_add_e_f32s(a, b, sums[6]);
                sums[7] = simd.mul_add_e_f32s(b, b, sums[7]);
                sums[8] = simd.mul_add_e_f32s(t, a, sums[8]);
                sums[9] = simd.mul_add_e_f32s(t, b, sums[9]);
                sums[10] = simd.mul_add_e_f32s(t, t, sums[10]);
                sums[11] = simd.mul_add_e_f32s(t, d, sums[11]);
                sums[12] = simd.mul_add_e_f32s(a, d, sums[12]);
                k += S::F32_LANES;
            }
        }
        let mut totals = [0.0f64; SUMS];
        for k in 0..SUMS {
            totals[k] = f64::from(simd.reduce_sum_f32s(sums[k]));
        }
        totals
    }
}

/// 1 where the sensor measured the colour that is compared, 0 elsewhere, from a pixel on along its row.
#[inline(always)]
fn references<S: pulp::Simd>(frame: &DepthFrame, x: usize, y: usize) -> S::f32s {
    // Green is every other pixel of a row, whatever the mosaic.
    load::<S>(&EVERY_OTHER, usize::from(!frame.is_reference(x, y)))
}

const EVERY_OTHER: [f32; WIDEST + 1] = {
    let mut mask = [0.0; WIDEST + 1];
    let mut k = 0;
    while k <= WIDEST {
        mask[k] = 1.0;
        k += 2;
    }
    mask
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::grid::Grid;
    use crate::optics::ArrayKind;

    /// What a surface shows, without anything finer than six pixels.
    fn surface(x: f64, y: f64) -> f64 {
        let wave = |k: [f64; 2], phase: f64| (k[0] * x + k[1] * y + phase).sin();
        let fine = wave([0.95, 0.2], 0.3) + wave([-0.4, 0.9], 1.1) + wave([0.7, -0.66], 2.0);
        120.0 + 25.0 * fine + 20.0 * (wave([0.31, 0.17], 0.7) + wave([-0.12, 0.36], 2.2))
    }

    #[test]
    fn two_steps_lead_from_the_searchs_step_to_hundredths_of_a_pixel() {
        let pitch_px = 29.4;
        let grid = Grid::affine(ArrayKind::Square, [150.3, 149.6], [[pitch_px, 0.2], [-0.2, pitch_px]], [300, 300]);
        for spacing_px in [18.6, 19.3, 21.45] {
            // From one micro-image to the next a point moves by the spacing, along the lattice.
            let share = spacing_px / pitch_px;
            let values: Vec<f32> = (0..300 * 300)
                .map(|k| {
                    let (x, y) = ((k % 300) as f64, (k / 300) as f64);
                    let [i, j] = grid.index_of(x, y);
                    let [cx, cy] = grid.position(i, j);
                    surface(x - share * cx, y - share * cy) as f32
                })
                .collect();
            let frame = DepthFrame::new(&values, None, &grid).unwrap();
            let mut fit = PairFit::new(&frame.disc);
            for start in [-0.3, 0.3] {
                let mut worst: f64 = 0.0;
                for &ends in &frame.pairs {
                    fit.begin(&frame, ends);
                    let mut found = spacing_px + start;
                    for _ in 0..2 {
                        found += fit.step(&frame, found).unwrap().step_px;
                    }
                    worst = worst.max((found - spacing_px).abs());
                }
                println!("{spacing_px} px from {start:+} px away: within {worst:.4} px");
                assert!(worst < 0.03, "{spacing_px} px from {start} px away: {worst}");
            }
        }
    }
}
