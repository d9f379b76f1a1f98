//! One ordered pair of tiles compared at one spacing: the part of the work that is done most often.

use pulp::Simd;

use super::tile::{LANES, Shape, Tile, load, store};
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
    /// Of a reference `a` and its neighbour `b` in the direction `unit` at `spacing` (px): the pixel x of the reference
    /// is met by x + spacing · unit in the neighbour. `None` where the masks do not overlap.
    #[inline(always)]
    pub(super) fn new(a: &Tile, b: &Tile, shape: &Shape, unit: [f64; 2], spacing: f64) -> Option<Self> {
        let middle = shape.middle();
        let edge = f64::from(shape.edge);
        let (mut first, mut last, mut floors, mut nearest) = ([0usize; 2], [0usize; 2], [0usize; 2], [0usize; 2]);
        let mut fraction = [0.0f32; 2];
        for axis in 0..2 {
            let shift = spacing * unit[axis];
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
    pub(super) fn compare<S: Simd>(&self, simd: S, a: &Tile, b: &Tile, shape: &Shape, warp: &mut Warp) -> Option<Moments> {
        warp.fit(self.rows);
        let stride = shape.stride;
        let [ux, uy] = self.unit;
        let splat = |w: [f32; 4]| w.map(|w| simd.splat_f32s(w));
        let (wx, wy) = (splat(weights(self.fraction[0])), splat(weights(self.fraction[1])));
        let sx = splat(slope_weights(self.fraction[0]).map(|w| ux * w));
        let sy = splat(slope_weights(self.fraction[1]).map(|w| uy * w));
        let (ux, uy) = (simd.splat_f32s(ux), simd.splat_f32s(uy));
        let zero = simd.splat_f32s(0.0);
        let mut sums = [zero; SUMS];
        for x in (0..self.columns).step_by(S::F32_LANES) {
            // The neighbour and its slope along the pair, down a strip one vector wide.
            let (mut v, mut d) = ([zero; 4], [zero; 4]);
            for line in 0..self.rows + 3 {
                let c = &b.coefficients[self.corner + line * stride + x..][..3 + S::F32_LANES];
                let c: [S::f32s; 4] = std::array::from_fn(|k| load::<S>(c, k));
                v = [v[1], v[2], v[3], dot(simd, &wx, &c)];
                d = [d[1], d[2], d[3], dot(simd, &sx, &c)];
                if line >= 3 {
                    let at = (line - 3) * S::F32_LANES;
                    store::<S>(&mut warp.values, at, dot(simd, &wy, &v));
                    store::<S>(&mut warp.slopes, at, simd.add_f32s(dot(simd, &wy, &d), dot(simd, &sy, &v)));
                }
            }
            for row in 0..self.rows {
                let (own, nearest) = (self.own + row * stride + x, self.nearest + row * stride + x);
                let w = simd.mul_f32s(load::<S>(&a.amplitudes, own), load::<S>(&b.amplitudes, nearest));
                let a_ = load::<S>(&a.values, own);
                let t = simd.mul_f32s(uy, load::<S>(&a.slopes[1], own));
                let t = simd.mul_add_e_f32s(ux, load::<S>(&a.slopes[0], own), t);
                let b_ = load::<S>(&warp.values, row * S::F32_LANES);
                let d = load::<S>(&warp.slopes, row * S::F32_LANES);
                let (wa, wb, wt) = (simd.mul_f32s(w, a_), simd.mul_f32s(w, b_), simd.mul_f32s(w, t));
                sums[0] = simd.add_f32s(sums[0], w);
                sums[1] = simd.add_f32s(sums[1], wa);
                sums[2] = simd.add_f32s(sums[2], wb);
                sums[3] = simd.add_f32s(sums[3], wt);
                sums[4] = simd.mul_add_e_f32s(w, d, sums[4]);
                sums[5] = simd.mul_add_e_f32s(wa, a_, sums[5]);
                sums[6] = simd.mul_add_e_f32s(wa, b_, sums[6]);
                sums[7] = simd.mul_add_e_f32s(wb, b_, sums[7]);
                sums[8] = simd.mul_add_e_f32s(wt, a_, sums[8]);
                sums[9] = simd.mul_add_e_f32s(wt, b_, sums[9]);
                sums[10] = simd.mul_add_e_f32s(wt, t, sums[10]);
                sums[11] = simd.mul_add_e_f32s(wt, d, sums[11]);
                sums[12] = simd.mul_add_e_f32s(wa, d, sums[12]);
            }
        }
        moments(sums.map(|sum| f64::from(simd.reduce_sum_f32s(sum))))
    }
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

/// A strip of the warped neighbour and of its slope.
#[derive(Debug, Clone, Default)]
pub(super) struct Warp {
    values: Vec<f32>,
    slopes: Vec<f32>,
}

impl Warp {
    #[inline(always)]
    fn fit(&mut self, rows: usize) {
        if self.values.len() < rows * LANES {
            self.values.resize(rows * LANES, 0.0);
            self.slopes.resize(rows * LANES, 0.0);
        }
    }
}
