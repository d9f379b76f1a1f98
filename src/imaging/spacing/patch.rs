//! One ordered pair of micro-images compared at one spacing: the part of the work that is done millions of times.

use super::frame::SpacingFrame;
use crate::imaging::interpolation::{slope_weights, weights};

/// Pixels that are handled together.
const LANES: usize = 8;
/// How many sums [`PairSums`] needs.
const SUMS: usize = 15;

/// Where the two masks of a pair overlap, pixel by pixel: reference, slope, warped neighbour, its slope, weight.
#[derive(Debug, Default)]
pub(super) struct Patch {
    /// First pixel of the patch in the frame.
    pub(super) origin: [usize; 2],
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// `columns` rounded up to whole lanes.
    pub(super) stride: usize,
    pub(super) reference: Vec<f32>,
    pub(super) slope: Vec<f32>,
    warped: Vec<f32>,
    warped_slope: Vec<f32>,
    pub(super) weight: Vec<f32>,
    mask: Vec<f32>,
    across: Vec<f32>,
    across_slope: Vec<f32>,
}

/// Weighted second moments over a patch, each about the weighted means.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PairSums {
    /// Sum of the masks: how many pixels overlap.
    pub(super) pixels: f64,
    /// Reference with itself, with the warped neighbour, and the latter with itself.
    pub(super) aa: f64,
    pub(super) ab: f64,
    pub(super) bb: f64,
    /// The reference's slope with reference, neighbour, itself, and the neighbour's slope.
    pub(super) ta: f64,
    pub(super) tb: f64,
    pub(super) tt: f64,
    pub(super) td: f64,
    /// Reference with the neighbour's slope.
    pub(super) ad: f64,
    /// Weighted mean of the slope, and of the reference about the micro-image's mean.
    pub(super) slope_mean: f64,
    pub(super) reference_mean: f64,
}

impl Patch {
    /// Compares micro-image `a` with its neighbour `b` at the spacing `spacing` (px). The pixel x of the reference is
    /// met by x + spacing · u in the neighbour, u the unit vector from a to b: the image points of one object point are
    /// a spacing apart. Masks have this `radius` (px); `None` where they hardly overlap.
    pub(super) fn compare(
        &mut self,
        frame: &SpacingFrame,
        a: usize,
        b: usize,
        spacing: f64,
        radius: f64,
    ) -> Option<PairSums> {
        let (a, b) = (&frame.micro_images[a], &frame.micro_images[b]);
        let step = [b.centre[0] - a.centre[0], b.centre[1] - a.centre[1]];
        let length = step[0].hypot(step[1]);
        let unit = [step[0] / length, step[1] / length];
        let shift = [spacing * unit[0], spacing * unit[1]];
        // The neighbour's centre as it appears in the reference's coordinates.
        let other = [b.centre[0] - shift[0], b.centre[1] - shift[1]];
        // Masks end over one pixel.
        let edge = radius + 0.5;
        let first = |axis: usize| (a.centre[axis].max(other[axis]) - edge).ceil();
        let last = |axis: usize| (a.centre[axis].min(other[axis]) + edge).floor();
        if last(0) < first(0) || last(1) < first(1) {
            return None;
        }
        let (whole, fraction) = split(shift);
        let (left, top) = (first(0), first(1));
        // Both masks lie within the frame by more than the spline's reach, so the box does too, here and shifted.
        self.origin = [left as usize, top as usize];
        self.columns = (last(0) - left) as usize + 1;
        self.rows = (last(1) - top) as usize + 1;
        self.stride = self.columns.next_multiple_of(LANES);
        let size = self.stride * self.rows;
        for buffer in [
            &mut self.reference,
            &mut self.slope,
            &mut self.warped,
            &mut self.warped_slope,
            &mut self.weight,
            &mut self.mask,
        ] {
            buffer.clear();
            buffer.resize(size, 0.0);
        }
        self.weigh(frame, a.centre, other, whole, edge as f32);
        self.warp(frame, whole, fraction, unit, b.mean);
        self.refer(frame, unit, a.mean);
        self.sums()
    }

    /// Masks and weights: the inverse of the variance that noise gives the difference of the two.
    fn weigh(&mut self, frame: &SpacingFrame, a: [f64; 2], b: [f64; 2], whole: [isize; 2], edge: f32) {
        let nearest = (self.origin[1] as isize + whole[1]) as usize * frame.width;
        let nearest = nearest + (self.origin[0] as isize + whole[0]) as usize;
        for row in 0..self.rows {
            let y = (self.origin[1] + row) as f64;
            let (ya, yb) = (((y - a[1]) as f32).powi(2), ((y - b[1]) as f32).powi(2));
            let (xa, xb) = ((self.origin[0] as f64 - a[0]) as f32, (self.origin[0] as f64 - b[0]) as f32);
            let here = (self.origin[1] + row) * frame.width + self.origin[0];
            let own = &frame.precision[here..here + self.columns];
            let theirs = &frame.precision[nearest + row * frame.width..][..self.columns];
            let masks = &mut self.mask[row * self.stride..][..self.columns];
            let weights = &mut self.weight[row * self.stride..][..self.columns];
            for k in 0..self.columns {
                let x = k as f32;
                // Masks end over one pixel, so that they change smoothly with the spacing.
                let in_a = (edge - ((x + xa).powi(2) + ya).sqrt()).clamp(0.0, 1.0);
                let in_b = (edge - ((x + xb).powi(2) + yb).sqrt()).clamp(0.0, 1.0);
                masks[k] = in_a * in_b;
                weights[k] = masks[k] * 2.0 * own[k] * theirs[k] / (own[k] + theirs[k] + 1e-9);
            }
        }
    }

    /// The neighbour and its slope along the pair, from the spline.
    fn warp(&mut self, frame: &SpacingFrame, whole: [isize; 2], fraction: [f32; 2], unit: [f64; 2], mean: f32) {
        let (wx, sx) = (weights(fraction[0]), slope_weights(fraction[0]));
        let (wy, sy) = (weights(fraction[1]), slope_weights(fraction[1]));
        let lines = self.rows + 3;
        self.across.clear();
        self.across.resize(lines * self.stride, 0.0);
        self.across_slope.clear();
        self.across_slope.resize(lines * self.stride, 0.0);
        let corner_x = (self.origin[0] as isize + whole[0] - 1) as usize;
        let corner_y = (self.origin[1] as isize + whole[1] - 1) as usize;
        let n = self.columns;
        for line in 0..lines {
            let source = &frame.coefficients[(corner_y + line) * frame.width + corner_x..][..n + 3];
            let value = &mut self.across[line * self.stride..][..n];
            let slope = &mut self.across_slope[line * self.stride..][..n];
            let (c0, c1, c2, c3) = (&source[..n], &source[1..=n], &source[2..n + 2], &source[3..n + 3]);
            for k in 0..n {
                value[k] = wx[0] * c0[k] + wx[1] * c1[k] + wx[2] * c2[k] + wx[3] * c3[k];
                slope[k] = sx[0] * c0[k] + sx[1] * c1[k] + sx[2] * c2[k] + sx[3] * c3[k];
            }
        }
        let (ux, uy) = (unit[0] as f32, unit[1] as f32);
        let stride = self.stride;
        for row in 0..self.rows {
            let line = |buffer: &'_ [f32], k: usize| -> std::ops::Range<usize> {
                debug_assert!(buffer.len() >= (row + k + 1) * stride);
                (row + k) * stride..(row + k + 1) * stride
            };
            let v: [&[f32]; 4] = std::array::from_fn(|k| &self.across[line(&self.across, k)]);
            let d: [&[f32]; 4] = std::array::from_fn(|k| &self.across_slope[line(&self.across_slope, k)]);
            let values = &mut self.warped[row * stride..(row + 1) * stride];
            let slopes = &mut self.warped_slope[row * stride..(row + 1) * stride];
            let (v0, v1, v2, v3) = (&v[0][..stride], &v[1][..stride], &v[2][..stride], &v[3][..stride]);
            let (d0, d1, d2, d3) = (&d[0][..stride], &d[1][..stride], &d[2][..stride], &d[3][..stride]);
            for k in 0..stride {
                values[k] = wy[0] * v0[k] + wy[1] * v1[k] + wy[2] * v2[k] + wy[3] * v3[k] - mean;
                let along_x = wy[0] * d0[k] + wy[1] * d1[k] + wy[2] * d2[k] + wy[3] * d3[k];
                let along_y = sy[0] * v0[k] + sy[1] * v1[k] + sy[2] * v2[k] + sy[3] * v3[k];
                slopes[k] = ux * along_x + uy * along_y;
            }
        }
    }

    /// The reference, not interpolated, and its slope along the pair.
    fn refer(&mut self, frame: &SpacingFrame, unit: [f64; 2], mean: f32) {
        let (ux, uy) = (unit[0] as f32, unit[1] as f32);
        let n = self.columns;
        for row in 0..self.rows {
            let here = (self.origin[1] + row) * frame.width + self.origin[0];
            let values = &frame.values[here..here + n];
            let (along_x, along_y) = (&frame.slopes[0][here..here + n], &frame.slopes[1][here..here + n]);
            let reference = &mut self.reference[row * self.stride..][..n];
            let slope = &mut self.slope[row * self.stride..][..n];
            for k in 0..n {
                reference[k] = values[k] - mean;
                slope[k] = ux * along_x[k] + uy * along_y[k];
            }
        }
    }

    fn sums(&self) -> Option<PairSums> {
        let mut lanes = [[0.0f32; LANES]; SUMS];
        let mut totals = [0.0f64; SUMS];
        for row in 0..self.rows {
            let range = row * self.stride..(row + 1) * self.stride;
            let chunks = self.reference[range.clone()]
                .as_chunks::<LANES>()
                .0
                .iter()
                .zip(self.slope[range.clone()].as_chunks::<LANES>().0)
                .zip(self.warped[range.clone()].as_chunks::<LANES>().0)
                .zip(self.warped_slope[range.clone()].as_chunks::<LANES>().0)
                .zip(self.weight[range.clone()].as_chunks::<LANES>().0)
                .zip(self.mask[range].as_chunks::<LANES>().0);
            for (((((a, t), b), d), w), m) in chunks {
                for k in 0..LANES {
                    let (a, t, b, d, w) = (a[k], t[k], b[k], d[k], w[k]);
                    let (wa, wb, wt) = (w * a, w * b, w * t);
                    lanes[0][k] += m[k];
                    lanes[1][k] += w;
                    lanes[2][k] += wa;
                    lanes[3][k] += wb;
                    lanes[4][k] += wt;
                    lanes[5][k] += w * d;
                    lanes[6][k] += wa * a;
                    lanes[7][k] += wa * b;
                    lanes[8][k] += wb * b;
                    lanes[9][k] += wt * a;
                    lanes[10][k] += wt * b;
                    lanes[11][k] += wt * t;
                    lanes[12][k] += wt * d;
                    lanes[13][k] += wa * d;
                }
            }
        }
        for (total, lane) in totals.iter_mut().zip(lanes) {
            *total = lane.iter().map(|&v| f64::from(v)).sum();
        }
        let [pixels, w, a, b, t, d, aa, ab, bb, ta, tb, tt, td, ad, _] = totals;
        // A dozen pixels are fewer than the unknowns of a pair can be told from.
        if pixels < 12.0 || w <= 1e-3 {
            return None;
        }
        Some(PairSums {
            pixels,
            aa: aa - a * a / w,
            ab: ab - a * b / w,
            bb: bb - b * b / w,
            ta: ta - t * a / w,
            tb: tb - t * b / w,
            tt: tt - t * t / w,
            td: td - t * d / w,
            ad: ad - a * d / w,
            slope_mean: t / w,
            reference_mean: a / w,
        })
    }
}

/// Whole pixels and the fraction of a shift.
fn split(shift: [f64; 2]) -> ([isize; 2], [f32; 2]) {
    let whole = [shift[0].floor(), shift[1].floor()];
    ([whole[0] as isize, whole[1] as isize], [(shift[0] - whole[0]) as f32, (shift[1] - whole[1]) as f32])
}
