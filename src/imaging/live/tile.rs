//! One micro-image made ready for comparing: values, spline coefficients, slopes and weights of a few dozen pixels
//! square, small enough to stay in the cache until its neighbours have been compared with it.

use pulp::Simd;

use super::plan::Lens;

/// Pixels that are handled together at most: tiles are padded for vectors of this length.
pub(super) const LANES: usize = 8;
/// Reach of the horizontal half of the spline's prefilter, px: its tail is below 0.2 %.
const FIR: usize = 5;
/// Pixels from the mask's edge that a warped neighbour's spline reaches.
const SPLINE: usize = 2;
/// Rows that the vertical half of the prefilter needs to settle.
const SETTLE: usize = 3;
/// Columns before the mask.
const LEFT: usize = SPLINE + FIR;
/// Rows above the mask.
const ABOVE: usize = SPLINE + SETTLE;
/// The pole of the cubic B-spline's prefilter, √3 − 2.
const POLE: f32 = -0.267_949_2;
/// Samples that lie in one cache line at least.
const TOUCH_STEP: usize = 32;
/// Below this share of light vignetting is not divided out any further: it would only blow up noise.
const LEAST_SHARE: f32 = 0.2;
/// Unit of the gains.
pub(super) const GAIN_UNIT: f32 = 1.0 / 8192.0;
/// Noise variance of the slopes in units of that of the values: the sum of squares of [−1 −2 0 2 1] / 8 by
/// [1 4 6 4 1] / 16.
pub(super) const SLOPE_NOISE: f64 = (10.0 / 64.0) * (70.0 / 256.0);

/// A sample of a raw frame.
pub(super) trait Sample: Copy + Default + Ord + Send + Sync {
    /// Its grey level.
    fn grey(self) -> f32;

    /// The line of its own kind.
    fn line(lines: &mut EdgeLines) -> &mut Vec<Self>;
}

/// One line of samples of either kind: where a tile reaches over the frame's edge, the edge is continued.
#[derive(Debug, Clone, Default)]
pub(super) struct EdgeLines {
    bytes: Vec<u8>,
    words: Vec<u16>,
}

impl Sample for u8 {
    #[inline(always)]
    fn grey(self) -> f32 {
        f32::from(self)
    }

    fn line(lines: &mut EdgeLines) -> &mut Vec<Self> {
        &mut lines.bytes
    }
}

impl Sample for u16 {
    #[inline(always)]
    fn grey(self) -> f32 {
        f32::from(self)
    }

    fn line(lines: &mut EdgeLines) -> &mut Vec<Self> {
        &mut lines.words
    }
}

/// A raw frame as tiles are cut from it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame<'a, T> {
    pub(super) samples: &'a [T],
    pub(super) gains: &'a Gains,
    pub(super) width: usize,
    pub(super) height: usize,
    /// Samples from here on are saturated.
    pub(super) white: T,
}

impl<T: Sample> Frame<'_, T> {
    /// Reads a little of every cache line that a tile will be cut from. Nothing waits for these reads, so that the
    /// memory works on many at a time; the cut itself would wait for one row after another.
    #[inline(always)]
    pub(super) fn touch(&self, lens: &Lens, shape: &Shape) -> u32 {
        let [column, row] = shape.middle();
        let left = (lens.nearest[0] as isize - column as isize).max(0) as usize;
        let top = (lens.nearest[1] as isize - row as isize).max(0) as usize;
        let last = (left + shape.stride).min(self.width).saturating_sub(1);
        let mut read = 0u32;
        for y in top..(top + shape.rows).min(self.height) {
            let Some(line) = self.samples.get(y * self.width..(y + 1) * self.width) else { continue };
            let mut x = left;
            while x < last {
                read = read.wrapping_add(u32::from(line[x] >= self.white));
                x += TOUCH_STEP;
            }
            read = read.wrapping_add(u32::from(line[last] >= self.white));
        }
        read
    }
}

/// What every pixel of every tile is multiplied by to take the vignetting out: one micro-image after another, in the
/// order of the plan, so that the memory is read from one end to the other.
#[derive(Debug, Clone)]
pub(super) struct Gains {
    gains: Vec<u16>,
    /// The largest tiles there are.
    largest: Shape,
    columns: usize,
}

impl Gains {
    /// For tiles up to `largest`; `vignetting` has the share of light of every pixel.
    pub(super) fn new(vignetting: &[f32], size: [usize; 2], lenses: &[Lens], largest: Shape) -> Self {
        let [column, row] = largest.middle();
        let columns = largest.columns();
        let one = |lens: &Lens| {
            let within = |at: isize, axis: usize| at.clamp(0, size[axis] as isize - 1) as usize;
            let (left, top) = (lens.nearest[0] as isize - column as isize, lens.nearest[1] as isize - row as isize);
            (0..largest.rows * columns).map(move |k| {
                let (x, y) = (within(left + (k % columns) as isize, 0), within(top + (k / columns) as isize, 1));
                gain(vignetting[y * size[0] + x])
            })
        };
        let mut gains: Vec<u16> = lenses.iter().flat_map(one).collect();
        // A row of a smaller tile may reach beyond the last.
        gains.resize(gains.len() + 2 * LANES, 0);
        Self { gains, largest, columns }
    }

    /// So many of the gains of a row of a tile.
    #[inline(always)]
    pub(super) fn row(&self, lens: u32, y: usize, shape: &Shape, columns: usize) -> &[u16] {
        let inset = self.largest.disc - shape.disc;
        let from = (lens as usize * self.largest.rows + y + inset) * self.columns + inset;
        &self.gains[from..from + columns]
    }
}

/// A share of light as a gain.
pub(super) fn gain(share: f32) -> u16 {
    (1.0 / (share.max(LEAST_SHARE) * GAIN_UNIT)).round() as u16
}

/// How large tiles are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shape {
    /// Radius at which masks have fallen to nothing, px: they end over one pixel.
    pub(super) edge: f32,
    /// Pixels from the one nearest the centre to the mask's last.
    pub(super) disc: usize,
    pub(super) rows: usize,
    /// From one row to the next, with room for the last vector of a row to reach beyond the mask.
    pub(super) stride: usize,
}

impl Shape {
    /// For masks of this radius, px.
    pub(super) fn new(radius: f64) -> Self {
        let disc = (radius + 1.0).floor().max(1.0) as usize;
        let stride = (2 * (LEFT + disc) + 1 + 3).next_multiple_of(LANES);
        Self { edge: (radius + 0.5) as f32, disc, rows: 2 * (ABOVE + disc) + 1, stride }
    }

    /// Column and row of the pixel nearest the centre.
    pub(super) const fn middle(&self) -> [usize; 2] {
        [LEFT + self.disc, ABOVE + self.disc]
    }

    /// Columns that are cut, in whole vectors.
    pub(super) const fn columns(&self) -> usize {
        (2 * (LEFT + self.disc) + 1).next_multiple_of(LANES)
    }

    pub(super) const fn size(&self) -> usize {
        self.rows * self.stride
    }
}

/// A micro-image made ready.
#[derive(Debug, Clone, Default)]
pub(super) struct Tile {
    /// Grey levels, vignetting divided out, less a constant of the micro-image's own.
    pub(super) values: Vec<f32>,
    /// Coefficients of the spline through the values.
    pub(super) coefficients: Vec<f32>,
    /// Slopes of slightly smoothed values along x and y, without any weight at the pixel itself.
    pub(super) slopes: [Vec<f32>; 2],
    /// Mask times share of light: the product of two is the weight of a difference. 0 for saturated pixels.
    pub(super) amplitudes: Vec<f32>,
    /// The centre less the pixel nearest it, px.
    pub(super) fraction: [f64; 2],
    /// The pixel nearest the centre.
    pub(super) nearest: [i32; 2],
    shape: Option<Shape>,
}

/// Planes and rows that preparing a tile needs.
#[derive(Debug, Clone, Default)]
pub(super) struct Workspace {
    edge: EdgeLines,
    planes: [Vec<f32>; 2],
    lines: [Vec<f32>; 2],
    across: Vec<f32>,
}

impl Tile {
    fn fit(&mut self, shape: &Shape) {
        if self.shape != Some(*shape) {
            self.shape = Some(*shape);
            let [x, y] = &mut self.slopes;
            // What lies beyond the masks is never written: it must not count.
            for plane in [&mut self.values, &mut self.coefficients, &mut self.amplitudes, x, y] {
                plane.clear();
                plane.resize(shape.size(), 0.0);
            }
        }
    }

    /// Cuts a micro-image out of a frame.
    #[inline(always)]
    pub(super) fn prepare<T: Sample, S: Simd>(
        &mut self,
        simd: S,
        frame: &Frame<'_, T>,
        (lens, plan): (u32, &[Lens]),
        shape: &Shape,
        work: &mut Workspace,
    ) {
        const { assert!(S::F32_LANES <= LANES, "tiles are padded for shorter vectors") };
        self.fit(shape);
        work.fit(shape);
        self.fraction = plan[lens as usize].fraction;
        self.nearest = plan[lens as usize].nearest;
        self.cut(simd, frame, lens, shape, work);
        self.spline(simd, shape, work);
        self.slope(simd, shape, work);
    }

    /// Values and amplitudes.
    #[inline(always)]
    fn cut<T: Sample, S: Simd>(&mut self, simd: S, frame: &Frame<'_, T>, lens: u32, shape: &Shape, work: &mut Workspace) {
        let [column, row] = shape.middle();
        let left = self.nearest[0] as isize - column as isize;
        let top = self.nearest[1] as isize - row as isize;
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
        let wide = (LEFT + 2 * shape.disc + 1).next_multiple_of(LANES);
        let Workspace { edge, planes: [causal, _], lines: [greys, factors], across } = work;
        let mut offset = -((LEFT + shape.disc) as f32) - fx;
        for square in &mut across[..wide] {
            *square = offset * offset * slope;
            offset += 1.0;
        }
        let (unit, level, white) =
            (simd.splat_f32s(GAIN_UNIT), simd.splat_f32s(level), simd.splat_f32s(frame.white.grey()));
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        let (pole, start) = (simd.splat_f32s(POLE), simd.splat_f32s(1.0 / (1.0 - POLE)));
        for y in 0..shape.rows {
            let from = line(y);
            let gains = frame.gains.row(lens, y, shape, columns);
            let samples = if within {
                &frame.samples[from + left as usize..][..columns]
            } else {
                let place = |x: usize| from + (left + x as isize).clamp(0, frame.width as isize - 1) as usize;
                let samples = T::line(edge);
                samples.clear();
                samples.extend((0..columns).map(|x| frame.samples[place(x)]));
                &samples[..]
            };
            for (line, sample) in greys[..columns].iter_mut().zip(samples) {
                *line = sample.grey();
            }
            for (line, &gain) in factors[..columns].iter_mut().zip(gains) {
                *line = f32::from(gain);
            }
            let values = &mut self.values[y * shape.stride..][..columns];
            // The prefilter's way down; the values are continued as they begin.
            let (before, here) = causal.split_at_mut(y * shape.stride);
            let before = if y == 0 { None } else { Some(&before[(y - 1) * shape.stride..]) };
            for k in 0..columns / S::F32_LANES {
                let x = k * S::F32_LANES;
                let factor = simd.mul_f32s(load::<S>(factors, x), unit);
                let value = simd.sub_f32s(simd.mul_f32s(load::<S>(greys, x), factor), level);
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
                let mask = simd.div_f32s(mask, simd.mul_f32s(load::<S>(factors, x), unit));
                let open = simd.less_than_f32s(load::<S>(greys, x), white);
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
        let (first, wide) = (LEFT - SPLINE, (2 * (shape.disc + SPLINE) + 1).next_multiple_of(LANES));
        // Rows that were written last come last: a load across two stores waits until both are through.
        for y in (ABOVE - SPLINE..=rows - 1 - (ABOVE - SPLINE)).rev() {
            let from = &plane[y * stride..];
            let out = &mut self.coefficients[y * stride + first..][..wide];
            for k in 0..wide / S::F32_LANES {
                let x = k * S::F32_LANES;
                let around = &from[x + first - FIR..][..2 * FIR + S::F32_LANES];
                let mut sum = simd.mul_f32s(taps[0], load::<S>(around, FIR));
                for k in 1..=FIR {
                    let both = simd.add_f32s(load::<S>(around, FIR - k), load::<S>(around, FIR + k));
                    sum = simd.mul_add_e_f32s(taps[k], both, sum);
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
        let wide = (2 * shape.disc + 1).next_multiple_of(LANES);
        let [smooth, steep] = &mut work.planes;
        for y in ABOVE..=ABOVE + 2 * shape.disc {
            let rows = &self.values[(y - 2) * stride..(y + 3) * stride];
            let smooth = &mut smooth[y * stride..][..wide + LANES];
            let steep = &mut steep[y * stride..][..wide + LANES];
            for k in 0..(wide + LANES) / S::F32_LANES {
                let x = k * S::F32_LANES;
                let mut v = [two; 5];
                for k in 0..5 {
                    v[k] = load::<S>(rows, k * stride + LEFT - 2 + x);
                }
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
                let (outer, inner) = (
                    simd.sub_f32s(load::<S>(p, 4), load::<S>(p, 0)),
                    simd.sub_f32s(load::<S>(p, 3), load::<S>(p, 1)),
                );
                store::<S>(along_x, x, simd.mul_add_e_f32s(two, inner, outer));
                let (outer, inner) = (
                    simd.add_f32s(load::<S>(q, 4), load::<S>(q, 0)),
                    simd.add_f32s(load::<S>(q, 3), load::<S>(q, 1)),
                );
                let sum = simd.mul_add_e_f32s(six, load::<S>(q, 2), simd.mul_add_e_f32s(four, inner, outer));
                store::<S>(along_y, x, sum);
            }
        }
    }
}

impl Workspace {
    fn fit(&mut self, shape: &Shape) {
        let wide = shape.stride + 2 * LANES;
        if self.planes[0].len() < shape.size() + LANES || self.lines[0].len() < wide {
            self.across.resize(wide, 0.0);
            for plane in &mut self.planes {
                plane.resize(shape.size() + 2 * LANES, 0.0);
            }
            for line in &mut self.lines {
                line.resize(wide, 0.0);
            }
        }
    }
}

/// The vector that begins at a place of a row.
#[inline(always)]
pub(super) fn load<S: Simd>(row: &[f32], at: usize) -> S::f32s {
    S::as_simd_f32s(&row[at..at + S::F32_LANES]).0[0]
}

/// So many vectors from a place of a row on.
#[inline(always)]
pub(super) fn vectors<S: Simd>(row: &[f32], at: usize, count: usize) -> &[S::f32s] {
    &S::as_simd_f32s(&row[at..at + count * S::F32_LANES]).0[..count]
}

/// Puts a vector at a place of a row.
#[inline(always)]
pub(super) fn store<S: Simd>(row: &mut [f32], at: usize, value: S::f32s) {
    S::as_mut_simd_f32s(&mut row[at..at + S::F32_LANES]).0[0] = value;
}

/// Half of the horizontal prefilter, with the vertical recursion's gain of 6 in it.
fn prefilter() -> [f32; FIR + 1] {
    let taps: [f32; FIR + 1] = std::array::from_fn(|k| POLE.powi(k as i32));
    let sum = taps[0] + 2.0 * taps[1..].iter().sum::<f32>();
    taps.map(|tap| 6.0 * tap / sum)
}
