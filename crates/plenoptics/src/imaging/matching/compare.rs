//! One ordered pair of tiles compared at one spacing: the part of the work that is done most often.

use pulp::Simd;

use super::shape::Shape;
use super::tile::Tile;
use super::vector::{load, store, vectors};
use crate::imaging::interpolation::{slope_weights, weights};

/// What of two tiles is compared: contents alone, their slopes along the pair besides, or those across it, too.
pub(in crate::imaging) const CONTENTS: usize = 0;
pub(in crate::imaging) const ALONG: usize = 1;
pub(in crate::imaging) const BOTH: usize = 2;
/// Sums over a comparison's pixels: of contents, of slopes along the pair, and of those across it.
const CONTENT_SUMS: usize = 6;
const ALONG_SUMS: usize = 7;
const ACROSS_SUMS: usize = 9;
/// Sum of the weights below which a comparison says nothing. Overlaps so small lie at the masks' edges, where about half
/// the light is left: a dozen pixels there are fewer than a pair's unknowns can be told from.
const LEAST_PIXELS: f64 = 6.0;

/// Weighted second moments over the overlap of two masks, each about the weighted means.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::imaging) struct Moments {
    /// Sum of the weights: how many pixels overlap.
    pub(in crate::imaging) pixels: f64,
    /// Reference with itself, with the warped neighbour, and the latter with itself.
    pub(in crate::imaging) aa: f64,
    pub(in crate::imaging) ab: f64,
    pub(in crate::imaging) bb: f64,
    /// The reference's slopes along the pair and across it (90° further from +x towards +y) with reference, neighbour,
    /// each with itself, and with each of the neighbour's slopes. 0 where they were not compared.
    pub(in crate::imaging) ta: [f64; 2],
    pub(in crate::imaging) tb: [f64; 2],
    pub(in crate::imaging) tt: [f64; 2],
    pub(in crate::imaging) td: [[f64; 2]; 2],
    /// Reference with the neighbour's slopes.
    pub(in crate::imaging) ad: [f64; 2],
    /// Weighted means of slopes and reference.
    pub(in crate::imaging) slope_mean: [f64; 2],
    pub(in crate::imaging) reference_mean: f64,
}

/// Where the masks of two tiles overlap at a spacing.
#[derive(Debug, Clone, Copy)]
pub(in crate::imaging) struct Overlap {
    pub(in crate::imaging) columns: usize,
    pub(in crate::imaging) rows: usize,
    /// The first pixel in the reference's tile, and the pixel of the neighbour's nearest to where it is met.
    pub(in crate::imaging) own: usize,
    pub(in crate::imaging) nearest: usize,
    /// The first of the sixteen coefficients about the place where it is met.
    corner: usize,
    fraction: [f32; 2],
    pub(in crate::imaging) unit: [f32; 2],
}

impl Overlap {
    /// Of a reference `a` and its neighbour `b` in the direction `unit`, at a spacing along it and across it (px): the
    /// pixel x of the reference is met by x + along · unit + across · n in the neighbour, n being 90° further than `unit`
    /// from +x towards +y. `None` where the masks do not overlap.
    #[inline(always)]
    pub(in crate::imaging) fn new(
        a: &Tile,
        b: &Tile,
        shape: &Shape,
        unit: [f64; 2],
        [along, across]: [f64; 2],
    ) -> Option<Self> {
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

    /// Compares the two tiles: `WHAT` of them is one of [`CONTENTS`], [`ALONG`] and [`BOTH`]. `None` where their masks
    /// hardly overlap.
    #[inline(always)]
    pub(in crate::imaging) fn compare<S: Simd, const WHAT: usize>(
        &self,
        simd: S,
        a: &Tile,
        b: &Tile,
        shape: &Shape,
        warp: &mut Warp,
    ) -> Option<Moments> {
        warp.fit(self.rows * self.columns.next_multiple_of(shape.lanes));
        let stride = shape.stride;
        let [ux, uy] = self.unit.map(|u| simd.splat_f32s(u));
        let (wx, wy) = (splat(simd, weights(self.fraction[0]), 1.0), splat(simd, weights(self.fraction[1]), 1.0));
        let sx = splat(simd, slope_weights(self.fraction[0]), 1.0);
        let [along_y, across_y] = [
            splat(simd, slope_weights(self.fraction[1]), self.unit[1]),
            splat(simd, slope_weights(self.fraction[1]), self.unit[0]),
        ];
        let zero = simd.splat_f32s(0.0);
        let strips = self.columns.div_ceil(S::F32_LANES);
        let wide = strips * S::F32_LANES;
        for strip in 0..strips {
            // The neighbour and its slopes along the pair and across it, down a strip one vector wide.
            let x = strip * S::F32_LANES;
            let (mut v, mut d) = ([zero; 4], [zero; 4]);
            for line in 0..self.rows + 3 {
                let c = &b.coefficients[self.corner + line * stride + x..][..3 + S::F32_LANES];
                let c = [load::<S>(c, 0), load::<S>(c, 1), load::<S>(c, 2), load::<S>(c, 3)];
                v = [v[1], v[2], v[3], dot(simd, &wx, &c)];
                if WHAT >= ALONG {
                    d = [d[1], d[2], d[3], dot(simd, &sx, &c)];
                }
                if line < 3 {
                    continue;
                }
                let at = (line - 3) * wide + x;
                store::<S>(&mut warp.values, at, dot(simd, &wy, &v));
                if WHAT >= ALONG {
                    let by_x = dot(simd, &wy, &d);
                    store::<S>(&mut warp.along, at, simd.mul_add_e_f32s(ux, by_x, dot(simd, &along_y, &v)));
                    if WHAT == BOTH {
                        let across = simd.sub_f32s(dot(simd, &across_y, &v), simd.mul_f32s(uy, by_x));
                        store::<S>(&mut warp.across, at, across);
                    }
                }
            }
        }
        let (mut contents, mut along, mut across) = ([zero; CONTENT_SUMS], [zero; ALONG_SUMS], [zero; ACROSS_SUMS]);
        let counted = a.counted();
        for row in 0..self.rows {
            let (own, nearest) = (self.own + row * stride, self.nearest + row * stride);
            let own_amplitudes = vectors::<S>(counted, own, strips);
            let amplitudes = vectors::<S>(&b.amplitudes, nearest, strips);
            let values = vectors::<S>(&a.values, own, strips);
            let by_x = vectors::<S>(&a.slopes[0], own, strips);
            let by_y = vectors::<S>(&a.slopes[1], own, strips);
            let warped = vectors::<S>(&warp.values, row * wide, strips);
            let warped_along = vectors::<S>(&warp.along, row * wide, strips);
            let warped_across = vectors::<S>(&warp.across, row * wide, strips);
            for k in 0..strips {
                let w = simd.mul_f32s(own_amplitudes[k], amplitudes[k]);
                let (a, b) = (values[k], warped[k]);
                let (wa, wb) = (simd.mul_f32s(w, a), simd.mul_f32s(w, b));
                contents[0] = simd.add_f32s(contents[0], w);
                contents[1] = simd.add_f32s(contents[1], wa);
                contents[2] = simd.add_f32s(contents[2], wb);
                contents[3] = simd.mul_add_e_f32s(wa, a, contents[3]);
                contents[4] = simd.mul_add_e_f32s(wa, b, contents[4]);
                contents[5] = simd.mul_add_e_f32s(wb, b, contents[5]);
                if WHAT < ALONG {
                    continue;
                }
                let d = warped_along[k];
                let t = simd.mul_add_e_f32s(ux, by_x[k], simd.mul_f32s(uy, by_y[k]));
                let wt = simd.mul_f32s(w, t);
                along[0] = simd.add_f32s(along[0], wt);
                along[1] = simd.mul_add_e_f32s(w, d, along[1]);
                along[2] = simd.mul_add_e_f32s(wt, a, along[2]);
                along[3] = simd.mul_add_e_f32s(wt, b, along[3]);
                along[4] = simd.mul_add_e_f32s(wt, t, along[4]);
                along[5] = simd.mul_add_e_f32s(wt, d, along[5]);
                along[6] = simd.mul_add_e_f32s(wa, d, along[6]);
                if WHAT < BOTH {
                    continue;
                }
                let e = warped_across[k];
                let n = simd.sub_f32s(simd.mul_f32s(ux, by_y[k]), simd.mul_f32s(uy, by_x[k]));
                let wn = simd.mul_f32s(w, n);
                across[0] = simd.add_f32s(across[0], wn);
                across[1] = simd.mul_add_e_f32s(w, e, across[1]);
                across[2] = simd.mul_add_e_f32s(wn, a, across[2]);
                across[3] = simd.mul_add_e_f32s(wn, b, across[3]);
                across[4] = simd.mul_add_e_f32s(wn, n, across[4]);
                across[5] = simd.mul_add_e_f32s(wn, e, across[5]);
                across[6] = simd.mul_add_e_f32s(wa, e, across[6]);
                across[7] = simd.mul_add_e_f32s(wt, e, across[7]);
                across[8] = simd.mul_add_e_f32s(wn, d, across[8]);
            }
        }
        moments(totals(simd, contents), totals(simd, along), totals(simd, across))
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
fn totals<S: Simd, const N: usize>(simd: S, sums: [S::f32s; N]) -> [f64; N] {
    let mut totals = [0.0f64; N];
    for k in 0..N {
        totals[k] = f64::from(simd.reduce_sum_f32s(sums[k]));
    }
    totals
}

#[inline(always)]
fn moments(
    [w, a, b, aa, ab, bb]: [f64; CONTENT_SUMS],
    [t, d, ta, tb, tt, td, ad]: [f64; ALONG_SUMS],
    [n, e, na, nb, nn, ne, ae, te, nd]: [f64; ACROSS_SUMS],
) -> Option<Moments> {
    if w < LEAST_PIXELS {
        return None;
    }
    let (a, b, t, n) = (a / w, b / w, t / w, n / w);
    Some(Moments {
        pixels: w,
        aa: aa - a * a * w,
        ab: ab - a * b * w,
        bb: bb - b * b * w,
        ta: [ta - t * a * w, na - n * a * w],
        tb: [tb - t * b * w, nb - n * b * w],
        tt: [tt - t * t * w, nn - n * n * w],
        td: [[td - t * d, te - t * e], [nd - n * d, ne - n * e]],
        ad: [ad - a * d, ae - a * e],
        slope_mean: [t, n],
        reference_mean: a,
    })
}

/// The warped neighbour and its slopes along the pair and across it.
#[derive(Debug, Clone, Default)]
pub(in crate::imaging) struct Warp {
    values: Vec<f32>,
    along: Vec<f32>,
    across: Vec<f32>,
}

impl Warp {
    #[inline(always)]
    fn fit(&mut self, size: usize) {
        for plane in [&mut self.values, &mut self.along, &mut self.across] {
            if plane.len() < size {
                plane.resize(size, 0.0);
            }
        }
    }
}
