//! One micro-image made ready for comparing: values, spline coefficients, slopes and weights of a few dozen pixels
//! square, small enough to stay in the cache until its neighbours have been compared with it.

use pulp::Simd;

use super::gains::{Light, Patch, Rows};
use super::plan::Lens;
use super::samples::{EdgeLines, Frame, Sample};
use super::shape::{ABOVE, FIR, LANES, LEFT, SPLINE, Shape};
use super::vector::{load, store, widened};

/// The pole of the cubic B-spline's prefilter, √3 − 2.
const POLE: f32 = -0.267_949_2;
/// Noise variance of the slopes in units of that of the values: the sum of squares of [−1 −2 0 2 1] / 8 by
/// [1 4 6 4 1] / 16.
pub(in crate::imaging) const SLOPE_NOISE: f64 = (10.0 / 64.0) * (70.0 / 256.0);

/// A micro-image made ready.
#[derive(Debug, Clone, Default)]
pub(in crate::imaging) struct Tile {
    /// Grey levels, vignetting divided out, less a constant of the micro-image's own.
    pub(in crate::imaging) values: Vec<f32>,
    /// Coefficients of the spline through the values.
    pub(in crate::imaging) coefficients: Vec<f32>,
    /// Slopes of slightly smoothed values along x and y, without any weight at the pixel itself.
    pub(in crate::imaging) slopes: [Vec<f32>; 2],
    /// Mask times share of light: the product of two is the weight of a difference. 0 for saturated pixels.
    pub(in crate::imaging) amplitudes: Vec<f32>,
    /// Those of the pixels that are a reference, where a mosaic leaves others out.
    counted: Option<Vec<f32>>,
    /// The centre less the pixel nearest it, px.
    pub(in crate::imaging) fraction: [f64; 2],
    /// The pixel nearest the centre.
    pub(in crate::imaging) nearest: [i32; 2],
    shape: Option<Shape>,
}

/// Planes and rows that preparing a tile needs.
#[derive(Debug, Clone, Default)]
pub(in crate::imaging) struct Workspace {
    edge: EdgeLines,
    planes: [Vec<f32>; 2],
    across: Vec<f32>,
    shares: Vec<f32>,
}

impl Tile {
    fn fit(&mut self, shape: &Shape) {
        if self.shape != Some(*shape) {
            self.shape = Some(*shape);
            let [x, y] = &mut self.slopes;
            // What lies beyond the masks must not count, and the last row's last vector reaches beyond the row.
            for plane in [&mut self.values, &mut self.coefficients, &mut self.amplitudes, x, y] {
                plane.clear();
                plane.resize(shape.size() + LANES, 0.0);
            }
        }
    }

    /// Cuts a micro-image out of a frame.
    #[inline(always)]
    pub(in crate::imaging) fn prepare<T: Sample, S: Simd>(
        &mut self,
        simd: S,
        frame: &Frame<'_, T>,
        (lens, light): (&Lens, Light<'_>),
        shape: &Shape,
        work: &mut Workspace,
    ) {
        const { assert!(S::F32_LANES <= LANES, "tiles are padded for shorter vectors") };
        self.fit(shape);
        work.fit(shape);
        self.fraction = lens.fraction;
        self.nearest = lens.nearest;
        let patch = light.patch(lens);
        match patch.gains(shape) {
            Some(rows) => self.cut::<T, S, false>(simd, frame, (&patch, Some(rows)), shape, work),
            None => self.cut::<T, S, true>(simd, frame, (&patch, None), shape, work),
        }
        if frame.mosaic.is_some() {
            self.count(frame, shape);
        }
        self.spline(simd, shape, work);
        self.slope(simd, shape, work);
    }

    /// The amplitudes of the pixels that are a reference.
    #[inline(always)]
    pub(in crate::imaging) fn counted(&self) -> &[f32] {
        self.counted.as_ref().unwrap_or(&self.amplitudes)
    }

    /// Leaves of a mosaic's amplitudes those of what was measured as a reference.
    fn count<T: Sample>(&mut self, frame: &Frame<'_, T>, shape: &Shape) {
        let [left, top] = self.corner(shape);
        let counted = self.counted.get_or_insert_default();
        counted.clone_from(&self.amplitudes);
        for (y, row) in counted.chunks_exact_mut(shape.stride).take(shape.rows).enumerate() {
            for (x, amplitude) in row.iter_mut().enumerate().filter(|(_, amplitude)| **amplitude > 0.0) {
                // Masks lie within the frame.
                if !frame.is_reference((left + x as i32) as usize, (top + y as i32) as usize) {
                    *amplitude = 0.0;
                }
            }
        }
    }

    /// Column and row of the frame at which the tile begins.
    pub(in crate::imaging) const fn corner(&self, shape: &Shape) -> [i32; 2] {
        let [column, row] = shape.middle();
        [self.nearest[0] - column as i32, self.nearest[1] - row as i32]
    }

    /// Calls `visit` with the place of each pixel within a disc about the centre, and where it lies from there, px. The
    /// tile has to be one for masks that large.
    pub(in crate::imaging) fn disc(&self, shape: &Shape, radius: f64, mut visit: impl FnMut(usize, [f64; 2])) {
        let [column, row] = shape.middle();
        let [cx, cy] = [column as f64 + self.fraction[0], row as f64 + self.fraction[1]];
        for y in row - shape.disc..=row + shape.disc {
            let dy = y as f64 - cy;
            let half = (radius * radius - dy * dy).max(0.0).sqrt();
            for x in (cx - half).ceil() as usize..(cx + half + 1.0).floor() as usize {
                let dx = x as f64 - cx;
                if dx * dx + dy * dy <= radius * radius {
                    visit(y * shape.stride + x, [dx, dy]);
                }
            }
        }
    }

    /// The share of light that reaches a pixel so far from the centre (px), where it is a reference and not saturated.
    pub(in crate::imaging) fn share(&self, shape: &Shape, at: usize, [dx, dy]: [f64; 2]) -> Option<f64> {
        let edge = f64::from(shape.edge);
        let mask = ((edge * edge - dx * dx - dy * dy) / (2.0 * edge - 1.0)).min(1.0);
        let amplitude = f64::from(self.counted()[at]);
        (amplitude > 0.0 && mask > 0.0).then(|| amplitude / mask)
    }

    /// Values and amplitudes, from gains or from shares of light.
    #[inline(always)]
    fn cut<T: Sample, S: Simd, const SHARES: bool>(
        &mut self,
        simd: S,
        frame: &Frame<'_, T>,
        (patch, rows): (&Patch<'_>, Option<Rows<'_>>),
        shape: &Shape,
        work: &mut Workspace,
    ) {
        let row = shape.middle()[1];
        let [left, top] = self.corner(shape).map(|n| n as isize);
        let columns = shape.columns();
        let within = left >= 0 && left as usize + columns <= frame.width;
        let line = |y: usize| (top + y as isize).clamp(0, frame.height as isize - 1) as usize * frame.width;
        // A constant near the mean keeps the sums over products of values small.
        let level = {
            let from = line(row) + (left + LEFT as isize).clamp(0, frame.width as isize - 1) as usize;
            let to = (from + 2 * shape.disc + 1).min(frame.samples.len());
            let samples = &frame.samples[from..to];
            samples.iter().map(|s| s.grey()).sum::<f32>() / samples.len().max(1) as f32
        };
        let [fx, fy] = self.fraction.map(|f| f as f32);
        let slope = 1.0 / (2.0 * shape.edge - 1.0);
        // Columns up to the mask's last; all loads are where stores were, or they would have to wait for them.
        let wide = (LEFT + 2 * shape.disc + 1).next_multiple_of(shape.lanes);
        let Workspace { edge, planes: [causal, _], across, shares } = work;
        let mut offset = -((LEFT + shape.disc) as f32) - fx;
        for square in &mut across[..wide] {
            *square = offset * offset * slope;
            offset += 1.0;
        }
        let (unit, level, white) =
            (simd.splat_f32s(Rows::UNIT), simd.splat_f32s(level), simd.splat_f32s(frame.white.grey()));
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let (pole, start) = (simd.splat_f32s(POLE), simd.splat_f32s(1.0 / (1.0 - POLE)));
        for y in 0..shape.rows {
            let from = line(y);
            let gains = rows.map_or(&[][..], |rows| rows.row(y, columns));
            if SHARES {
                patch.shares(simd, y, shape, columns, shares);
            }
            let samples = if within {
                &frame.samples[from + left as usize..][..columns]
            } else {
                let place = |x: usize| from + (left + x as isize).clamp(0, frame.width as isize - 1) as usize;
                let samples = T::line(edge);
                samples.clear();
                samples.extend((0..columns).map(|x| frame.samples[place(x)]));
                &samples[..]
            };
            let values = &mut self.values[y * shape.stride..][..columns];
            // The prefilter's way down; the values are continued as they begin.
            let (before, here) = causal.split_at_mut(y * shape.stride);
            let before = if y == 0 { None } else { Some(&before[(y - 1) * shape.stride..]) };
            for k in 0..columns / S::F32_LANES {
                let x = k * S::F32_LANES;
                let factor = if SHARES {
                    simd.div_f32s(one, load::<S>(shares, x))
                } else {
                    simd.mul_f32s(widened::<S, u16>(gains, x), unit)
                };
                let value = simd.sub_f32s(simd.mul_f32s(widened::<S, T>(samples, x), factor), level);
                store::<S>(values, x, value);
                let state = match before {
                    Some(before) => simd.mul_add_e_f32s(pole, load::<S>(before, x), value),
                    None => simd.mul_f32s(start, value),
                };
                store::<S>(here, x, state);
            }
            if y < ABOVE || y > ABOVE + 2 * shape.disc {
                continue;
            }
            let down = y as f32 - row as f32 - fy;
            let rest = simd.splat_f32s((shape.edge * shape.edge - down * down) * slope);
            let amplitudes = &mut self.amplitudes[y * shape.stride..][..wide];
            for k in 0..wide / S::F32_LANES {
                let x = k * S::F32_LANES;
                // Near the edge (edge² − r²) / (2 edge − 1) falls from 1 to 0 over one pixel.
                let mask = simd.sub_f32s(rest, load::<S>(across, x));
                let mask = simd.max_f32s(simd.min_f32s(mask, one), zero);
                let mask = if SHARES {
                    simd.mul_f32s(mask, load::<S>(shares, x))
                } else {
                    simd.div_f32s(mask, simd.mul_f32s(widened::<S, u16>(gains, x), unit))
                };
                let open = simd.less_than_f32s(widened::<S, T>(samples, x), white);
                store::<S>(amplitudes, x, simd.select_f32s(open, mask, zero));
            }
        }
    }

    /// Spline coefficients: up the columns by recursion, then along the rows by a short filter.
    #[inline(always)]
    fn spline<S: Simd>(&mut self, simd: S, shape: &Shape, work: &mut Workspace) {
        let (rows, stride) = (shape.rows, shape.stride);
        let plane = &mut work.planes[0][..rows * stride];
        let (pole, end) = (simd.splat_f32s(POLE), simd.splat_f32s(-POLE / (1.0 - POLE)));
        let vectors = shape.columns() / S::F32_LANES;
        for k in 0..vectors {
            let x = (rows - 1) * stride + k * S::F32_LANES;
            store::<S>(plane, x, simd.mul_f32s(load::<S>(plane, x), end));
        }
        for y in (ABOVE - SPLINE..rows - 1).rev() {
            let (here, below) = plane[y * stride..(y + 2) * stride].split_at_mut(stride);
            for k in 0..vectors {
                let x = k * S::F32_LANES;
                let next = simd.sub_f32s(load::<S>(below, x), load::<S>(here, x));
                store::<S>(here, x, simd.mul_f32s(pole, next));
            }
        }
        // No closures about vectors: they would not be compiled for the instruction set in use.
        let (taps_each, mut taps) = (prefilter(), [pole; FIR + 1]);
        for k in 0..=FIR {
            taps[k] = simd.splat_f32s(taps_each[k]);
        }
        let (first, wide) = (LEFT - SPLINE, (2 * (shape.disc + SPLINE) + 1).next_multiple_of(shape.lanes));
        // Rows that were written last come last: a load across two stores waits until both are through.
        for y in (ABOVE - SPLINE..=rows - 1 - (ABOVE - SPLINE)).rev() {
            let from = &plane[y * stride..];
            let out = &mut self.coefficients[y * stride + first..][..wide];
            for k in 0..wide / S::F32_LANES {
                let x = k * S::F32_LANES;
                let around = &from[x + first - FIR..][..2 * FIR + S::F32_LANES];
                let mut sum = simd.mul_f32s(taps[0], load::<S>(around, FIR));
                let mut far = 0;
                for &tap in &taps[1..] {
                    far += 1;
                    let both = simd.add_f32s(load::<S>(around, FIR - far), load::<S>(around, FIR + far));
                    sum = simd.mul_add_e_f32s(tap, both, sum);
                }
                store::<S>(out, x, sum);
            }
        }
    }

    /// Slopes by binomial filters: down the columns, then along the rows.
    #[inline(always)]
    fn slope<S: Simd>(&mut self, simd: S, shape: &Shape, work: &mut Workspace) {
        let stride = shape.stride;
        let (two, four, six) = (simd.splat_f32s(2.0), simd.splat_f32s(4.0), simd.splat_f32s(6.0));
        let unit = simd.splat_f32s(1.0 / 128.0);
        // The filter along the rows reaches two pixels beyond the mask on either side.
        let reach = (2 * shape.disc + 1 + 4).next_multiple_of(shape.lanes);
        let wide = (2 * shape.disc + 1).next_multiple_of(shape.lanes);
        let [smooth, steep] = &mut work.planes;
        for y in ABOVE..=ABOVE + 2 * shape.disc {
            let rows = &self.values[(y - 2) * stride..];
            let smooth = &mut smooth[y * stride..][..reach];
            let steep = &mut steep[y * stride..][..reach];
            for k in 0..reach / S::F32_LANES {
                let x = k * S::F32_LANES;
                let x0 = x + LEFT - 2;
                let v = [
                    load::<S>(rows, x0),
                    load::<S>(rows, x0 + stride),
                    load::<S>(rows, x0 + 2 * stride),
                    load::<S>(rows, x0 + 3 * stride),
                    load::<S>(rows, x0 + 4 * stride),
                ];
                let (outer, inner) = (simd.add_f32s(v[0], v[4]), simd.add_f32s(v[1], v[3]));
                let sum = simd.mul_add_e_f32s(six, v[2], simd.mul_add_e_f32s(four, inner, outer));
                store::<S>(smooth, x, simd.mul_f32s(sum, unit));
                let (outer, inner) = (simd.sub_f32s(v[4], v[0]), simd.sub_f32s(v[3], v[1]));
                store::<S>(steep, x, simd.mul_f32s(simd.mul_add_e_f32s(two, inner, outer), unit));
            }
        }
        let [along_x, along_y] = &mut self.slopes;
        for y in ABOVE..=ABOVE + 2 * shape.disc {
            let along_x = &mut along_x[y * stride + LEFT..][..wide];
            let along_y = &mut along_y[y * stride + LEFT..][..wide];
            let (smooth, steep) = (&smooth[y * stride..][..wide + LANES], &steep[y * stride..][..wide + LANES]);
            for k in 0..wide / S::F32_LANES {
                let x = k * S::F32_LANES;
                let (p, q) = (&smooth[x..][..4 + S::F32_LANES], &steep[x..][..4 + S::F32_LANES]);
                let (outer, inner) =
                    (simd.sub_f32s(load::<S>(p, 4), load::<S>(p, 0)), simd.sub_f32s(load::<S>(p, 3), load::<S>(p, 1)));
                store::<S>(along_x, x, simd.mul_add_e_f32s(two, inner, outer));
                let (outer, inner) =
                    (simd.add_f32s(load::<S>(q, 4), load::<S>(q, 0)), simd.add_f32s(load::<S>(q, 3), load::<S>(q, 1)));
                let sum = simd.mul_add_e_f32s(six, load::<S>(q, 2), simd.mul_add_e_f32s(four, inner, outer));
                store::<S>(along_y, x, sum);
            }
        }
    }
}

impl Workspace {
    fn fit(&mut self, shape: &Shape) {
        let wide = shape.stride + 2 * LANES;
        if self.planes[0].len() < shape.size() + LANES || self.across.len() < wide {
            self.across.resize(wide, 0.0);
            self.shares.resize(wide, 1.0);
            for plane in &mut self.planes {
                plane.resize(shape.size() + 2 * LANES, 0.0);
            }
        }
    }
}

/// Half of the horizontal prefilter, with the vertical recursion's gain of 6 in it.
fn prefilter() -> [f32; FIR + 1] {
    let taps: [f32; FIR + 1] = std::array::from_fn(|k| POLE.powi(k as i32));
    let sum = taps[0] + 2.0 * taps[1..].iter().sum::<f32>();
    taps.map(|tap| 6.0 * tap / sum)
}

#[cfg(test)]
mod tests;
