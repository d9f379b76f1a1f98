//! One ordered pair of micro-images compared at one spacing: the part of the work that is done millions of times.

use super::frame::SpacingFrame;
use crate::imaging::interpolation::{slope_weights, weights};

/// Pixels that are handled together.
const LANES: usize = 8;
/// Sums of a pair: the masks', the weights', six first and fifteen second moments.
const SUMS: usize = 23;
/// Those of its contents alone: the masks', the weights', two first and three second moments.
const CONTENT_SUMS: usize = 7;
/// A dozen pixels are fewer than the unknowns of a pair can be told from.
const LEAST_PIXELS: f64 = 12.0;
const LEAST_WEIGHT: f64 = 1e-3;

/// Where the two masks of a pair overlap, pixel by pixel: reference, warped neighbour, the slopes of both along the pair
/// and across it (90° further from +x towards +y), weight.
#[derive(Debug, Default)]
pub(super) struct Patch {
    /// First pixel of the patch in the frame.
    pub(super) origin: [usize; 2],
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// `columns` rounded up to whole lanes.
    pub(super) stride: usize,
    pub(super) reference: Vec<f32>,
    pub(super) slope: [Vec<f32>; 2],
    warped: Vec<f32>,
    warped_slope: [Vec<f32>; 2],
    pub(super) weight: Vec<f32>,
    mask: Vec<f32>,
    across: Vec<f32>,
    across_slope: Vec<f32>,
}

/// Two micro-images of a frame at one spacing along and across the pair (px), within masks of this radius (px).
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed<'a> {
    pub(super) frame: &'a SpacingFrame,
    /// The reference and its neighbour.
    pub(super) a: usize,
    pub(super) b: usize,
    pub(super) spacing: [f64; 2],
    pub(super) radius: f64,
}

/// One comparison, compiled for each instruction set: closures would not be.
struct Comparison<'a>(&'a mut Patch, Placed<'a>);

impl pulp::WithSimd for Comparison<'_> {
    type Output = Option<PairSums>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) -> Self::Output {
        self.0.compare_inlined(self.1)
    }
}

/// The same of the contents alone.
struct ContentComparison<'a>(&'a mut Patch, Placed<'a>);

impl pulp::WithSimd for ContentComparison<'_> {
    type Output = Option<ContentSums>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) -> Self::Output {
        self.0.contents_inlined(self.1)
    }
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
    /// The reference's slopes along and across with the reference, with the neighbour, and each with itself.
    pub(super) ta: [f64; 2],
    pub(super) tb: [f64; 2],
    pub(super) tt: [f64; 2],
    /// Each of the reference's slopes with each of the neighbour's.
    pub(super) td: [[f64; 2]; 2],
    /// Reference with the neighbour's slopes.
    pub(super) ad: [f64; 2],
    /// Weighted mean of the slopes, and of the reference about the micro-image's mean.
    pub(super) slope_mean: [f64; 2],
    pub(super) reference_mean: f64,
}

/// Those of [`PairSums`] that the contents alone make: what a search needs, at a third of the work.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ContentSums {
    pub(super) pixels: f64,
    pub(super) aa: f64,
    pub(super) ab: f64,
    pub(super) bb: f64,
}

/// How a patch lies in its frame.
struct Layout {
    /// From a to b.
    unit: [f64; 2],
    /// The shift from a reference's pixel to the neighbour's, in whole pixels and the fraction of one.
    whole: [isize; 2],
    fraction: [f32; 2],
}

impl Patch {
    /// Compares micro-image `a` with its neighbour `b`. The pixel x of the reference is met by x + s u + t n in the
    /// neighbour, (s, t) the spacing along and across the pair, u the unit vector from a to b and n the one 90° further:
    /// the image points of one object point are that far apart. `None` where the masks hardly overlap.
    pub(super) fn compare(&mut self, placed: Placed<'_>) -> Option<PairSums> {
        pulp::Arch::new().dispatch(Comparison(self, placed))
    }

    /// Compares as [`Patch::compare`] does, without the slopes: the same numbers where it has them, and `None` where it
    /// says so.
    pub(super) fn contents(&mut self, placed: Placed<'_>) -> Option<ContentSums> {
        pulp::Arch::new().dispatch(ContentComparison(self, placed))
    }

    #[inline(always)]
    fn compare_inlined(&mut self, placed: Placed<'_>) -> Option<PairSums> {
        let layout = self.lay(placed)?;
        let Placed { frame, a, b, .. } = placed;
        let [along, across] = &mut self.slope;
        let [warped_along, warped_across] = &mut self.warped_slope;
        let size = self.stride * self.rows;
        for buffer in [along, across, warped_along, warped_across] {
            buffer.resize(size, 0.0);
        }
        self.across_slope.resize(size + 3 * self.stride, 0.0);
        self.warp(frame, &layout, frame.micro_images[b].mean);
        self.warp_slopes(frame, &layout);
        self.refer(frame, frame.micro_images[a].mean);
        self.refer_slopes(frame, layout.unit);
        self.sums()
    }

    #[inline(always)]
    fn contents_inlined(&mut self, placed: Placed<'_>) -> Option<ContentSums> {
        let layout = self.lay(placed)?;
        let Placed { frame, a, b, .. } = placed;
        self.warp(frame, &layout, frame.micro_images[b].mean);
        self.refer(frame, frame.micro_images[a].mean);
        self.content_sums()
    }

    /// Where the masks overlap, and how much each pixel there counts.
    #[inline(always)]
    fn lay(&mut self, Placed { frame, a, b, spacing, radius }: Placed<'_>) -> Option<Layout> {
        let (a, b) = (&frame.micro_images[a], &frame.micro_images[b]);
        let step = [b.centre[0] - a.centre[0], b.centre[1] - a.centre[1]];
        let length = step[0].hypot(step[1]);
        let unit = [step[0] / length, step[1] / length];
        let shift = [spacing[0] * unit[0] - spacing[1] * unit[1], spacing[0] * unit[1] + spacing[1] * unit[0]];
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
        // What an earlier patch left in the lanes beyond the columns has no weight.
        for buffer in [&mut self.reference, &mut self.warped, &mut self.weight, &mut self.mask] {
            buffer.resize(size, 0.0);
        }
        self.across.resize(size + 3 * self.stride, 0.0);
        self.weigh(frame, a.centre, other, whole, edge as f32);
        Some(Layout { unit, whole, fraction })
    }

    /// Masks and weights: the inverse of the variance that noise gives the difference of the two.
    #[inline(always)]
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
            let (masks, beyond) = self.mask[row * self.stride..][..self.stride].split_at_mut(self.columns);
            beyond.fill(0.0);
            let (weights, beyond) = self.weight[row * self.stride..][..self.stride].split_at_mut(self.columns);
            beyond.fill(0.0);
            for k in 0..self.columns {
                let x = k as f32;
                // Masks end over one pixel, so that they change smoothly with the spacing.
                let in_a = (edge - ((x + xa).powi(2) + ya).sqrt()).clamp(0.0, 1.0);
                let in_b = (edge - ((x + xb).powi(2) + yb).sqrt()).clamp(0.0, 1.0);
                masks[k] = in_a * in_b;
                weights[k] = masks[k] * 2.0 * own[k] * theirs[k] / (own[k] + theirs[k] + 1e-9);
            }
        }
        if frame.mosaic.is_some() {
            self.drop_interpolated(frame);
        }
    }

    /// Leaves of a mosaic only what was measured as a reference.
    fn drop_interpolated(&mut self, frame: &SpacingFrame) {
        for row in 0..self.rows {
            for k in 0..self.columns {
                if !frame.is_reference(self.origin[0] + k, self.origin[1] + row) {
                    self.mask[row * self.stride + k] = 0.0;
                    self.weight[row * self.stride + k] = 0.0;
                }
            }
        }
    }

    /// The neighbour, from the spline.
    #[inline(always)]
    fn warp(&mut self, frame: &SpacingFrame, layout: &Layout, mean: f32) {
        let (wx, wy) = (weights(layout.fraction[0]), weights(layout.fraction[1]));
        let (n, stride) = (self.columns, self.stride);
        for line in 0..self.rows + 3 {
            let source = coefficients(frame, self.origin, layout.whole, line, n);
            let value = &mut self.across[line * stride..][..n];
            let (c0, c1, c2, c3) = (&source[..n], &source[1..=n], &source[2..n + 2], &source[3..n + 3]);
            for k in 0..n {
                value[k] = wx[0] * c0[k] + wx[1] * c1[k] + wx[2] * c2[k] + wx[3] * c3[k];
            }
        }
        for row in 0..self.rows {
            let [v0, v1, v2, v3] = lines(&self.across, row, stride);
            let values = &mut self.warped[row * stride..][..stride];
            for k in 0..stride {
                values[k] = wy[0] * v0[k] + wy[1] * v1[k] + wy[2] * v2[k] + wy[3] * v3[k] - mean;
            }
        }
    }

    /// The neighbour's slopes along and across the pair, once [`Patch::warp`] has left its values.
    #[inline(always)]
    fn warp_slopes(&mut self, frame: &SpacingFrame, layout: &Layout) {
        let sx = slope_weights(layout.fraction[0]);
        let (wy, sy) = (weights(layout.fraction[1]), slope_weights(layout.fraction[1]));
        let (n, stride) = (self.columns, self.stride);
        for line in 0..self.rows + 3 {
            let source = coefficients(frame, self.origin, layout.whole, line, n);
            let slope = &mut self.across_slope[line * stride..][..n];
            let (c0, c1, c2, c3) = (&source[..n], &source[1..=n], &source[2..n + 2], &source[3..n + 3]);
            for k in 0..n {
                slope[k] = sx[0] * c0[k] + sx[1] * c1[k] + sx[2] * c2[k] + sx[3] * c3[k];
            }
        }
        let (ux, uy) = (layout.unit[0] as f32, layout.unit[1] as f32);
        for row in 0..self.rows {
            let [v0, v1, v2, v3] = lines(&self.across, row, stride);
            let [d0, d1, d2, d3] = lines(&self.across_slope, row, stride);
            let [along, across] = &mut self.warped_slope;
            let along = &mut along[row * stride..][..stride];
            let across = &mut across[row * stride..][..stride];
            for k in 0..stride {
                let along_x = wy[0] * d0[k] + wy[1] * d1[k] + wy[2] * d2[k] + wy[3] * d3[k];
                let along_y = sy[0] * v0[k] + sy[1] * v1[k] + sy[2] * v2[k] + sy[3] * v3[k];
                along[k] = ux * along_x + uy * along_y;
                across[k] = ux * along_y - uy * along_x;
            }
        }
    }

    /// The reference, not interpolated.
    #[inline(always)]
    fn refer(&mut self, frame: &SpacingFrame, mean: f32) {
        let n = self.columns;
        for row in 0..self.rows {
            let here = (self.origin[1] + row) * frame.width + self.origin[0];
            let values = &frame.values[here..here + n];
            let reference = &mut self.reference[row * self.stride..][..n];
            for k in 0..n {
                reference[k] = values[k] - mean;
            }
        }
    }

    /// Its slopes along and across the pair.
    #[inline(always)]
    fn refer_slopes(&mut self, frame: &SpacingFrame, unit: [f64; 2]) {
        let (ux, uy) = (unit[0] as f32, unit[1] as f32);
        let n = self.columns;
        for row in 0..self.rows {
            let here = (self.origin[1] + row) * frame.width + self.origin[0];
            let (along_x, along_y) = (&frame.slopes[0][here..here + n], &frame.slopes[1][here..here + n]);
            let [along, across] = &mut self.slope;
            let along = &mut along[row * self.stride..][..n];
            let across = &mut across[row * self.stride..][..n];
            for k in 0..n {
                along[k] = ux * along_x[k] + uy * along_y[k];
                across[k] = ux * along_y[k] - uy * along_x[k];
            }
        }
    }

    #[inline(always)]
    fn content_sums(&self) -> Option<ContentSums> {
        let lanes = self.stride * self.rows / LANES;
        let reference = &self.reference.as_chunks::<LANES>().0[..lanes];
        let warped = &self.warped.as_chunks::<LANES>().0[..lanes];
        let weight = &self.weight.as_chunks::<LANES>().0[..lanes];
        let mask = &self.mask.as_chunks::<LANES>().0[..lanes];
        let mut sums = [[0.0f32; LANES]; CONTENT_SUMS];
        for n in 0..lanes {
            for k in 0..LANES {
                let (a, b, w) = (reference[n][k], warped[n][k], weight[n][k]);
                let (wa, wb) = (w * a, w * b);
                sums[0][k] += mask[n][k];
                sums[1][k] += w;
                sums[2][k] += wa;
                sums[3][k] += wb;
                sums[4][k] += wa * a;
                sums[5][k] += wa * b;
                sums[6][k] += wb * b;
            }
        }
        let [pixels, w, a, b, aa, ab, bb] = totals(&sums);
        if pixels < LEAST_PIXELS || w <= LEAST_WEIGHT {
            return None;
        }
        Some(ContentSums { pixels, aa: aa - a * a / w, ab: ab - a * b / w, bb: bb - b * b / w })
    }

    #[inline(always)]
    fn sums(&self) -> Option<PairSums> {
        // Rows of whole lanes follow each other: the planes are one run of lanes.
        let lanes = self.stride * self.rows / LANES;
        let reference = &self.reference.as_chunks::<LANES>().0[..lanes];
        let warped = &self.warped.as_chunks::<LANES>().0[..lanes];
        let slopes = [&self.slope[0].as_chunks::<LANES>().0[..lanes], &self.slope[1].as_chunks::<LANES>().0[..lanes]];
        let others = [
            &self.warped_slope[0].as_chunks::<LANES>().0[..lanes],
            &self.warped_slope[1].as_chunks::<LANES>().0[..lanes],
        ];
        let weight = &self.weight.as_chunks::<LANES>().0[..lanes];
        let mask = &self.mask.as_chunks::<LANES>().0[..lanes];
        let mut sums = [[0.0f32; LANES]; SUMS];
        for n in 0..lanes {
            for k in 0..LANES {
                let (a, b, w) = (reference[n][k], warped[n][k], weight[n][k]);
                let (t0, t1, d0, d1) = (slopes[0][n][k], slopes[1][n][k], others[0][n][k], others[1][n][k]);
                let (wa, wb, w0, w1) = (w * a, w * b, w * t0, w * t1);
                sums[0][k] += mask[n][k];
                sums[1][k] += w;
                sums[2][k] += wa;
                sums[3][k] += wb;
                sums[4][k] += w0;
                sums[5][k] += w1;
                sums[6][k] += w * d0;
                sums[7][k] += w * d1;
                sums[8][k] += wa * a;
                sums[9][k] += wa * b;
                sums[10][k] += wb * b;
                sums[11][k] += w0 * a;
                sums[12][k] += w1 * a;
                sums[13][k] += w0 * b;
                sums[14][k] += w1 * b;
                sums[15][k] += w0 * t0;
                sums[16][k] += w1 * t1;
                sums[17][k] += w0 * d0;
                sums[18][k] += w0 * d1;
                sums[19][k] += w1 * d0;
                sums[20][k] += w1 * d1;
                sums[21][k] += wa * d0;
                sums[22][k] += wa * d1;
            }
        }
        let [pixels, w, a, b, t0, t1, d0, d1, moments @ ..] = totals(&sums);
        if pixels < LEAST_PIXELS || w <= LEAST_WEIGHT {
            return None;
        }
        let [aa, ab, bb, ta0, ta1, tb0, tb1, tt0, tt1, td00, td01, td10, td11, ad0, ad1] = moments;
        Some(PairSums {
            pixels,
            aa: aa - a * a / w,
            ab: ab - a * b / w,
            bb: bb - b * b / w,
            ta: [ta0 - t0 * a / w, ta1 - t1 * a / w],
            tb: [tb0 - t0 * b / w, tb1 - t1 * b / w],
            tt: [tt0 - t0 * t0 / w, tt1 - t1 * t1 / w],
            td: [[td00 - t0 * d0 / w, td01 - t0 * d1 / w], [td10 - t1 * d0 / w, td11 - t1 * d1 / w]],
            ad: [ad0 - a * d0 / w, ad1 - a * d1 / w],
            slope_mean: [t0 / w, t1 / w],
            reference_mean: a / w,
        })
    }
}

/// The spline's coefficients that a line of a patch's neighbour is made of: three more than its `columns`, from one to
/// the left of and above it.
#[inline(always)]
fn coefficients(frame: &SpacingFrame, origin: [usize; 2], whole: [isize; 2], line: usize, columns: usize) -> &[f32] {
    let corner = [0, 1].map(|axis| (origin[axis] as isize + whole[axis] - 1) as usize);
    &frame.coefficients[(corner[1] + line) * frame.width + corner[0]..][..columns + 3]
}

/// The four lines that a row is interpolated from.
#[inline(always)]
fn lines(buffer: &[f32], row: usize, stride: usize) -> [&[f32]; 4] {
    std::array::from_fn(|k| &buffer[(row + k) * stride..][..stride])
}

/// The lanes of each sum added up.
#[inline(always)]
fn totals<const N: usize>(sums: &[[f32; LANES]; N]) -> [f64; N] {
    sums.map(|lanes| lanes.iter().fold(0.0, |total, &lane| total + f64::from(lane)))
}

/// Whole pixels and the fraction of a shift.
#[inline(always)]
fn split(shift: [f64; 2]) -> ([isize; 2], [f32; 2]) {
    let whole = [shift[0].floor(), shift[1].floor()];
    ([whole[0] as isize, whole[1] as isize], [(shift[0] - whole[0]) as f32, (shift[1] - whole[1]) as f32])
}
