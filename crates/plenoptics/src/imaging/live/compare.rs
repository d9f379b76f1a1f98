//! One ordered pair of tiles compared at one spacing: the part of the work that is done most often.

use pulp::Simd;

use super::shape::Shape;
use super::tile::Tile;
use super::vector::{load, store, vectors};
use crate::imaging::interpolation::{slope_weights, weights};

/// Sums over a comparison's pixels.
const SUMS: usize = 13;
/// Effective pixels below which a comparison says nothing: a dozen are fewer than a pair's unknowns can be told from.
const LEAST_PIXELS: f64 = 12.0;

/// Weighted second moments over the overlap of two masks, each about the weighted means.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Moments {
    /// Sum of the weights: how many pixels overlap.
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
    /// Weighted means of slope and reference.
    pub(super) slope_mean: f64,
    pub(super) reference_mean: f64,
}

/// Where the masks of two tiles overlap at a spacing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Overlap {
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// The first pixel in the reference's tile, and the pixel of the neighbour's nearest to where it is met.
    pub(super) own: usize,
    pub(super) nearest: usize,
    /// The first of the sixteen coefficients about the place where it is met.
    corner: usize,
    fraction: [f32; 2],
    pub(super) unit: [f32; 2],
}

impl Overlap {
    /// Of a reference `a` and its neighbour `b` in the direction `unit`, at a spacing along it and across it (px): the
    /// pixel x of the reference is met by x + along · unit + across · n in the neighbour, n being 90° further than `unit`
    /// from +x towards +y. `None` where the masks do not overlap.
    #[inline(always)]
    pub(super) fn new(a: &Tile, b: &Tile, shape: &Shape, unit: [f64; 2], [along, across]: [f64; 2]) -> Option<Self> {
        let middle = shape.middle();
        let edge = f64::from(shape.edge);
        let shifts = [along * unit[0] - across * unit[1], along * unit[1] + across * unit[0]];
        let (mut first, mut last, mut floors, mut nearest) = ([0usize; 2], [0usize; 2], [0usize; 2], [0usize; 2]);
        let mut fraction = [0.0f32; 2];
        for axis in 0..2 {
            let shift = shifts[axis];
            // From the reference's tile to the neighbour's: both begin at the same distance from their middle pixel.
            let apart = a.nearest[axis] - b.nearest[axis];
            let own = middle[axis] as f64 + a.fraction[axis];
            let other = middle[axis] as f64 + b.fraction[axis] - f64::from(apart) - shift;
            // The neighbour's mask is taken at the nearest pixel: half a pixel more.
            let from = (own - edge).max(other - edge - 0.5).ceil();
            let to = (own + edge).min(other + edge + 0.5).floor();
            if !(to >= from && from >= 0.0) {
                return None;
            }
            let whole = shift.floor();
            fraction[axis] = (shift - whole) as f32;
            (first[axis], last[axis]) = (from as usize, to as usize);
            let floor = first[axis] as i32 + whole as i32 + apart;
            floors[axis] = usize::try_from(floor - 1).ok()?;
            nearest[axis] = floors[axis] + 1 + usize::from(fraction[axis] >= 0.5);
        }
        let place = |at: [usize; 2]| at[1] * shape.stride + at[0];
        Some(Self {
            columns: last[0] - first[0] + 1,
            rows: last[1] - first[1] + 1,
            own: place(first),
            nearest: place(nearest),
            corner: place(floors),
            fraction,
            unit: unit.map(|u| u as f32),
        })
    }

    /// Compares the two tiles.
    #[inline(always)]
    pub(super) fn compare<S: Simd>(
        &self,
        simd: S,
        a: &Tile,
        b: &Tile,
        shape: &Shape,
        warp: &mut Warp,
    ) -> Option<Moments> {
        warp.fit(self.rows * self.columns.next_multiple_of(shape.lanes));
        let stride = shape.stride;
        let [ux, uy] = self.unit;
        let (wx, wy) = (splat(simd, weights(self.fraction[0]), 1.0), splat(simd, weights(self.fraction[1]), 1.0));
        let sx = splat(simd, slope_weights(self.fraction[0]), ux);
        let sy = splat(simd, slope_weights(self.fraction[1]), uy);
        let (ux, uy) = (simd.splat_f32s(ux), simd.splat_f32s(uy));
        let zero = simd.splat_f32s(0.0);
        let mut sums = [zero; SUMS];
        let strips = self.columns.div_ceil(S::F32_LANES);
        let wide = strips * S::F32_LANES;
        for strip in 0..strips {
            // The neighbour and its slope along the pair, down a strip one vector wide.
            let x = strip * S::F32_LANES;
            let (mut v, mut d) = ([zero; 4], [zero; 4]);
            for line in 0..self.rows + 3 {
                let c = &b.coefficients[self.corner + line * stride + x..][..3 + S::F32_LANES];
                let c = [load::<S>(c, 0), load::<S>(c, 1), load::<S>(c, 2), load::<S>(c, 3)];
                v = [v[1], v[2], v[3], dot(simd, &wx, &c)];
                d = [d[1], d[2], d[3], dot(simd, &sx, &c)];
                if line >= 3 {
                    let at = (line - 3) * wide + x;
                    store::<S>(&mut warp.values, at, dot(simd, &wy, &v));
                    store::<S>(&mut warp.slopes, at, simd.add_f32s(dot(simd, &wy, &d), dot(simd, &sy, &v)));
                }
            }
        }
        for row in 0..self.rows {
            let (own, nearest) = (self.own + row * stride, self.nearest + row * stride);
            let own_amplitudes = vectors::<S>(&a.amplitudes, own, strips);
            let amplitudes = vectors::<S>(&b.amplitudes, nearest, strips);
            let values = vectors::<S>(&a.values, own, strips);
            let along_x = vectors::<S>(&a.slopes[0], own, strips);
            let along_y = vectors::<S>(&a.slopes[1], own, strips);
            let warped = vectors::<S>(&warp.values, row * wide, strips);
            let warped_slopes = vectors::<S>(&warp.slopes, row * wide, strips);
            for k in 0..strips {
                let w = simd.mul_f32s(own_amplitudes[k], amplitudes[k]);
                let (a, b, d) = (values[k], warped[k], warped_slopes[k]);
                let t = simd.mul_add_e_f32s(ux, along_x[k], simd.mul_f32s(uy, along_y[k]));
                let (wa, wb, wt) = (simd.mul_f32s(w, a), simd.mul_f32s(w, b), simd.mul_f32s(w, t));
                sums[0] = simd.add_f32s(sums[0], w);
                sums[1] = simd.add_f32s(sums[1], wa);
                sums[2] = simd.add_f32s(sums[2], wb);
                sums[3] = simd.add_f32s(sums[3], wt);
                sums[4] = simd.mul_add_e_f32s(w, d, sums[4]);
                sums[5] = simd.mul_add_e_f32s(wa, a, sums[5]);
                sums[6] = simd.mul_add_e_f32s(wa, b, sums[6]);
                sums[7] = simd.mul_add_e_f32s(wb, b, sums[7]);
                sums[8] = simd.mul_add_e_f32s(wt, a, sums[8]);
                sums[9] = simd.mul_add_e_f32s(wt, b, sums[9]);
                sums[10] = simd.mul_add_e_f32s(wt, t, sums[10]);
                sums[11] = simd.mul_add_e_f32s(wt, d, sums[11]);
                sums[12] = simd.mul_add_e_f32s(wa, d, sums[12]);
            }
        }
        let mut totals = [0.0f64; SUMS];
        for k in 0..SUMS {
            totals[k] = f64::from(simd.reduce_sum_f32s(sums[k]));
        }
        moments(totals)
    }
}

// No closures from here down to the instructions: they would not be compiled for the instruction set in use.

#[inline(always)]
fn splat<S: Simd>(simd: S, w: [f32; 4], by: f32) -> [S::f32s; 4] {
    [simd.splat_f32s(by * w[0]), simd.splat_f32s(by * w[1]), simd.splat_f32s(by * w[2]), simd.splat_f32s(by * w[3])]
}

#[inline(always)]
fn dot<S: Simd>(simd: S, weights: &[S::f32s; 4], values: &[S::f32s; 4]) -> S::f32s {
    let (even, odd) = (simd.mul_f32s(weights[0], values[0]), simd.mul_f32s(weights[1], values[1]));
    let even = simd.mul_add_e_f32s(weights[2], values[2], even);
    simd.add_f32s(even, simd.mul_add_e_f32s(weights[3], values[3], odd))
}

#[inline(always)]
fn moments([w, a, b, t, d, aa, ab, bb, ta, tb, tt, td, ad]: [f64; SUMS]) -> Option<Moments> {
    if w < LEAST_PIXELS {
        return None;
    }
    let (a, b, t) = (a / w, b / w, t / w);
    Some(Moments {
        pixels: w,
        aa: aa - a * a * w,
        ab: ab - a * b * w,
        bb: bb - b * b * w,
        ta: ta - t * a * w,
        tb: tb - t * b * w,
        tt: tt - t * t * w,
        td: td - t * d,
        ad: ad - a * d,
        slope_mean: t,
        reference_mean: a,
    })
}

/// The warped neighbour and of its slope.
#[derive(Debug, Clone, Default)]
pub(super) struct Warp {
    values: Vec<f32>,
    slopes: Vec<f32>,
}

impl Warp {
    #[inline(always)]
    fn fit(&mut self, size: usize) {
        if self.values.len() < size {
            self.values.resize(size, 0.0);
            self.slopes.resize(size, 0.0);
        }
    }
}
