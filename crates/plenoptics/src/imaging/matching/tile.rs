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
mod tests {
    use super::super::compare::{Moments, Overlap, Warp};
    use super::*;
    use crate::imaging::grid::Grid;
    use crate::imaging::matching::compare::BOTH;
    use crate::imaging::matching::gains::Gains;
    use crate::imaging::vignetting::Vignetting;
    use crate::optics::ArrayKind;

    const SIDE: usize = 260;

    /// What both micro-images show, a spacing of `L` px apart.
    fn content(x: f64, y: f64) -> f64 {
        110.0 + 40.0 * (0.55 * x + 0.3 * y).sin() + 30.0 * (0.2 * x - 0.5 * y).cos()
    }

    /// The tiles of a pair, and the moments of both orders.
    type Compared = ([Tile; 2], [Option<Moments>; 2]);

    /// Two tiles of a pair, and both orders of their comparison.
    struct Two<'a> {
        frame: &'a Frame<'a, u16>,
        lenses: &'a [Lens; 2],
        light: Light<'a>,
        shape: Shape,
        unit: [f64; 2],
        spacing: f64,
    }

    impl pulp::WithSimd for Two<'_> {
        type Output = Compared;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
            let (mut tiles, mut work) = ([Tile::default(), Tile::default()], Workspace::default());
            tiles[0].prepare(simd, self.frame, (&self.lenses[0], self.light), &self.shape, &mut work);
            tiles[1].prepare(simd, self.frame, (&self.lenses[1], self.light), &self.shape, &mut work);
            let (mut moments, mut warp) = ([None; 2], Warp::default());
            for k in 0..2 {
                let (a, b) = (&tiles[k], &tiles[1 - k]);
                let unit = if k == 0 { self.unit } else { [-self.unit[0], -self.unit[1]] };
                if let Some(overlap) = Overlap::new(a, b, &self.shape, unit, [self.spacing, 0.0]) {
                    moments[k] = overlap.compare::<S, BOTH>(simd, a, b, &self.shape, &mut warp);
                }
            }
            (tiles, moments)
        }
    }

    fn lens(x: f64, y: f64) -> Lens {
        Lens { nearest: [x.round() as i32, y.round() as i32], fraction: [x - x.round(), y - y.round()] }
    }

    /// Micro-images about two centres, `unit` apart in direction; the second shows what the first shows a spacing on.
    fn two(radius: f64, unit: [f64; 2], bends: bool) -> (Compared, Compared, Shape) {
        let pitch = 2.6 * radius;
        let spacing = 0.7 * pitch;
        let a = [128.3 - pitch * unit[0] / 2.0, 127.6 - pitch * unit[1] / 2.0];
        let b = [a[0] + pitch * unit[0], a[1] + pitch * unit[1]];
        let samples: Vec<u16> = (0..SIDE * SIDE)
            .map(|k| {
                let (x, y) = ((k % SIDE) as f64, (k / SIDE) as f64);
                let second = (x - b[0]).hypot(y - b[1]) < (x - a[0]).hypot(y - a[1]);
                let shift = if second { spacing } else { 0.0 };
                (16.0 * content(x - shift * unit[0], y - shift * unit[1])).round() as u16
            })
            .collect();
        let lenses = [lens(a[0], a[1]), lens(b[0], b[1])];
        let shape = Shape::new(radius);
        // Tiles smaller than the largest, as masks change with the spacing.
        let grid = Grid::affine(ArrayKind::Square, a, [[pitch, 0.0], [0.0, pitch]], [SIDE, SIDE]);
        let even = Vignetting::from_terms(4, vec![[1.0, 0.0, 0.0, 0.0]; 16], bends);
        let gains = Gains::new(&even, &grid, radius + 2.5);
        let frame = Frame { samples: &samples, width: SIDE, height: SIDE, white: 4095, mosaic: None };
        let task = || Two { frame: &frame, lenses: &lenses, light: Light::Drawn(&gains), shape, unit, spacing };
        let fast = pulp::Arch::new().dispatch(task());
        let plain = pulp::WithSimd::with_simd(task(), pulp::Scalar::new());
        (fast, plain, shape)
    }

    #[test]
    fn tiles_of_any_size_hold_their_spline_and_slopes() {
        for k in 0..60 {
            let radius = 3.0 + 0.6 * f64::from(k);
            let ((tiles, moments), (plain, plain_moments), shape) = two(radius, [0.8, 0.6], k % 2 == 1);
            let tile = &tiles[0];
            let [column, row] = shape.middle();
            let at = |plane: &[f32], dx: isize, dy: isize| {
                f64::from(plane[((row as isize + dy) as usize) * shape.stride + (column as isize + dx) as usize])
            };
            let reach = shape.disc as isize;
            for (dx, dy) in [(0, 0), (1 - reach, 0), (reach - 1, 1), (0, reach - 1), (-reach / 2, 1 - reach / 2)] {
                // The spline's value at a pixel: [1 4 6] weights along both axes.
                let mut value = 0.0;
                for (y, wy) in [(-1, 1.0), (0, 4.0), (1, 1.0)] {
                    for (x, wx) in [(-1, 1.0), (0, 4.0), (1, 1.0)] {
                        value += wx * wy / 36.0 * at(&tile.coefficients, dx + x, dy + y);
                    }
                }
                let own = at(&tile.values, dx, dy);
                assert!((value - own).abs() < 6.0, "radius {radius}: {value} for {own} at {dx}, {dy}");
                // The binomial filters, written out.
                let (mut along_x, mut along_y) = (0.0, 0.0);
                let (steep, smooth) = ([-1.0, -2.0, 0.0, 2.0, 1.0], [1.0, 4.0, 6.0, 4.0, 1.0]);
                for (j, y) in (-2..=2).enumerate() {
                    for (i, x) in (-2..=2).enumerate() {
                        let value = at(&tile.values, dx + x, dy + y) / 128.0;
                        along_x += steep[i] * smooth[j] * value;
                        along_y += smooth[i] * steep[j] * value;
                    }
                }
                let found = [at(&tile.slopes[0], dx, dy), at(&tile.slopes[1], dx, dy)];
                assert!((found[0] - along_x).abs() < 1e-2 && (found[1] - along_y).abs() < 1e-2, "radius {radius}");
            }
            assert_eq!(at(&tile.amplitudes, 0, 0), 1.0);
            assert!(tile.amplitudes.iter().all(|a| (0.0..=1.0).contains(a)));
            // The disc's area, to the pixels of its edge.
            let area: f32 = tile.amplitudes.iter().sum();
            assert!(
                (f64::from(area) / (std::f64::consts::PI * radius * radius) - 1.0).abs() < 0.2 / radius + 0.02,
                "{area}"
            );
            // Every instruction set says the same, and the two micro-images match.
            for (a, b) in moments.iter().zip(&plain_moments) {
                let (Some(a), Some(b)) = (a, b) else {
                    assert!(a.is_none() && b.is_none() && radius < 6.0, "radius {radius}");
                    continue;
                };
                assert!((a.ab / b.ab - 1.0).abs() < 1e-3 && (a.pixels - b.pixels).abs() < 1e-2);
                assert!(a.ab / (a.aa * a.bb).sqrt() > 0.99, "radius {radius}: {a:?}");
            }
            assert!((plain[1].values[0] - tiles[1].values[0]).abs() < 1e-2);
        }
    }

    #[test]
    fn the_score_vanishes_at_the_true_spacing() {
        for unit in [[1.0, 0.0], [0.0, 1.0], [0.8, -0.6], [-0.6, 0.8]] {
            let ((_, moments), _, _) = two(11.3, unit, false);
            let [Some(there), Some(back)] = moments else { panic!("no overlap") };
            let step = ((there.ta[0] - there.tb[0]) + (back.ta[0] - back.tb[0])) / (there.td[0][0] + back.td[0][0]);
            assert!(step.abs() < 2e-3, "{unit:?}: {step} px");
            assert!(there.td[0][0] > 0.0 && back.td[0][0] > 0.0);
        }
    }
}
