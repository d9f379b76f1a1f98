//! Where the lattice is in a frame, from its first harmonics about a sample of micro-images.
//!
//! About a micro-image the frame's logarithm is multiplied by a window and by exp(2πi g·r) for each first harmonic g:
//! the sum's phase says how far the micro-image lies from its place. In the logarithm the texture is a term
//! beside the micro-images' profile and averages out over the sample.

use fourier::Complex;
use nalgebra::{Matrix4, Vector4};
use rayon::prelude::*;

use crate::imaging::grid::harmonics::{Harmonics, Point};
use crate::imaging::grid::{Grid, MicroImage};
use crate::imaging::matching::motion::{Field, Motion, Sums};
use crate::imaging::matching::plan::spread;
use crate::imaging::matching::samples::{Frame, Sample};

/// Micro-images looked at, at most.
const WANTED: usize = 128;
/// Pixels by which the sample keeps from the frame's edge beyond its windows' reach.
const SPARE_PX: i32 = 3;
/// Rows of the window a pitch, at least: more say hardly more of the phases.
const ROWS_PER_PITCH: f64 = 12.0;
/// Samples that the grey levels are taken from.
const SAMPLES: usize = 1 << 14;
/// Most entries of the table of logarithms: deeper samples are rounded to as many levels.
const TABLE: usize = 1 << 12;
/// Floor under the logarithm, as a share of the spread of grey levels.
const FLOOR_SHARE: f64 = 0.2;
/// Contrast above the mean counts no more than this: a bright outlier is still one micro-image.
const CONTRAST_CAP: f64 = 1.5;
/// Rounds of reweighting.
const ROUNDS: usize = 4;

/// How the frame's micro-images lie about where they were looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LatticeFit {
    /// How they have moved from there.
    pub(super) motion: Motion,
    /// Greatest displacement within the frame, px.
    pub(super) shift_px: f64,
    /// Its standard uncertainty, px.
    pub(super) sigma_px: f64,
    /// How far the phases of the sample agree, from 0 to 1.
    pub(super) coherence: f64,
}

/// The sample and its windows.
#[derive(Debug, Clone)]
pub(super) struct Lattice {
    lenses: Vec<Lens>,
    harmonics: Vec<[f64; 2]>,
    /// Rows of the window: offset from the middle in y and x, first weight, and how many.
    rows: Vec<(i32, i32, usize, usize)>,
    /// Real and imaginary weights of each harmonic.
    weights: Vec<[Vec<f32>; 2]>,
    table: Vec<f32>,
    histogram: Vec<u32>,
    /// The last frame's dark level, grey levels.
    dark: f32,
    field: Field,
    /// Pixels from its middle one that a window reaches.
    reach: [i32; 2],
    medians: Vec<f64>,
}

/// A micro-image of the sample and its harmonics.
#[derive(Debug, Clone)]
struct Lens {
    /// Its centre in the known grid, px.
    base: [f64; 2],
    /// The same in field coordinates.
    place: [f64; 2],
    sums: [Complex<f64>; 3],
    /// Whether its window lay within the frame.
    seen: bool,
    line: Vec<f32>,
}

impl Lattice {
    pub(super) fn new(grid: &Grid) -> Self {
        let harmonics = Harmonics::new(grid);
        let reach = harmonics.reach.map(|n| n as i32);
        let (mut rows, mut points) = (Vec::new(), Vec::new());
        let step = ((grid.pitch_px() / ROWS_PER_PITCH) as i32).max(1);
        for dy in (-reach[1] / step..=reach[1] / step).map(|n| n * step) {
            let begin = points.len();
            let mut first = 0;
            for dx in -reach[0]..=reach[0] {
                let (x, y) = (f64::from(dx), f64::from(dy));
                let weight = harmonics.window(x, y);
                if weight > 0.0 {
                    if points.len() == begin {
                        first = dx;
                    }
                    points.push(Point { x, y, weight });
                }
            }
            if points.len() > begin {
                rows.push((dy, first, begin, points.len() - begin));
            }
        }
        let weights = harmonics.kernels(&points);
        let harmonics = harmonics.waves;
        let field = Field::new(grid.frame_size);
        let [width, height] = grid.frame_size.map(|n| n as i32);
        let [rx, ry] = reach.map(|reach| reach + SPARE_PX);
        let inside = |m: &MicroImage| {
            let (x, y) = (m.x.round() as i32, m.y.round() as i32);
            x >= rx && y >= ry && x + rx < width && y + ry < height
        };
        let all: Vec<MicroImage> = grid.micro_images_within(0.0).filter(inside).collect();
        let lenses = spread(all.len(), WANTED).map(|k| {
            let base = [all[k].x, all[k].y];
            let line = vec![0.0; 2 * reach[0] as usize + 1];
            Lens { base, place: field.coordinates(base), sums: [Complex::default(); 3], seen: false, line }
        });
        let lenses: Vec<Lens> = lenses.collect();
        let medians = Vec::with_capacity(lenses.len());
        Self {
            lenses,
            harmonics,
            rows,
            weights,
            table: vec![0.0; TABLE],
            histogram: vec![0; TABLE],
            dark: 0.0,
            reach,
            field,
            medians,
        }
    }

    /// Looks at a frame of so much noise (grey levels) about where a motion has the micro-images.
    pub(super) fn look<T: Sample>(&mut self, frame: &Frame<'_, T>, bits: u8, noise: f64, about: &Motion) -> LatticeFit {
        let shift = bits.saturating_sub(12);
        self.tabulate(frame, shift, noise);
        let (rows, weights, table) = (&self.rows, &self.weights, &self.table);
        let (field, harmonics, reach) = (&self.field, &self.harmonics, self.reach);
        let size = [frame.width as i32, frame.height as i32];
        let arch = pulp::Arch::new();
        self.lenses.par_iter_mut().with_min_len(8).for_each(|lens| {
            let centre = about.moved(field, lens.base);
            let middle = centre.map(|v| v.round() as i32);
            lens.sums = [Complex::default(); 3];
            lens.seen = (0..2).all(|k| middle[k] >= reach[k] && middle[k] + reach[k] < size[k]);
            if !lens.seen {
                return;
            }
            arch.dispatch(Demodulate { lens, middle, frame, rows, weights, table, shift });
            // From the middle pixel to the centre.
            let off = [centre[0] - f64::from(middle[0]), centre[1] - f64::from(middle[1])];
            for (sum, g) in lens.sums.iter_mut().zip(harmonics) {
                *sum *= Complex::from_polar(1.0, -std::f64::consts::TAU * (g[0] * off[0] + g[1] * off[1]));
            }
        });
        self.fit()
    }

    /// The dark level of the frame that was looked at last, grey levels.
    pub(super) const fn dark(&self) -> f32 {
        self.dark
    }

    /// The logarithm of each grey level above the frame's dark level.
    fn tabulate<T: Sample>(&mut self, frame: &Frame<'_, T>, shift: u8, noise: f64) {
        self.histogram.fill(0);
        let level = |sample: T| (sample.level() as usize >> shift).min(TABLE - 1);
        let step = (frame.samples.len() / SAMPLES).max(1) | 1;
        let mut count = 0u32;
        for &sample in frame.samples.iter().step_by(step) {
            self.histogram[level(sample)] += 1;
            count += 1;
        }
        let quantile = |share: f64| {
            let mut left = f64::from(count) * share;
            let passed = self.histogram.iter().take_while(|&&n| {
                left -= f64::from(n);
                left > 0.0
            });
            passed.count() as f64
        };
        let (dark, bright) = (quantile(0.01), quantile(0.99));
        self.dark = dark as f32 * f32::from(1u16 << shift);
        let floor = (FLOOR_SHARE * (bright - dark) + 2.0 * noise / f64::from(1u32 << shift)).max(1e-3);
        let levels = level(frame.white) + 1;
        for (k, entry) in self.table[..levels].iter_mut().enumerate() {
            *entry = ((k as f64 - dark).max(0.0) + floor).ln() as f32;
        }
        let top = self.table[levels - 1];
        self.table[levels..].fill(top);
    }

    /// Shift, scale and rotation through the phases.
    fn fit(&mut self) -> LatticeFit {
        let count = self.harmonics.len();
        let mut common = [Complex::new(0.0, 0.0); 3];
        let mut means = [0.0f64; 3];
        let mut coherence = 1.0f64;
        for (h, total) in common.iter_mut().enumerate().take(count) {
            *total = self.lenses.iter().map(|l| l.sums[h]).sum();
            let all: f64 = self.lenses.iter().map(|l| l.sums[h].norm()).sum();
            coherence = coherence.min(total.norm() / all.max(1e-12));
            means[h] = (all / self.lenses.len() as f64).max(1e-12);
        }
        // Phases about the common one, so that they need not be unwrapped.
        let normal: nalgebra::Matrix2<f64> = self
            .harmonics
            .iter()
            .map(|g| nalgebra::Matrix2::new(g[0] * g[0], g[0] * g[1], g[0] * g[1], g[1] * g[1]))
            .sum();
        let inverse = normal.try_inverse().unwrap_or_default();
        let displacement = |phases: [f64; 3]| {
            let sum = |axis: usize| self.harmonics.iter().zip(phases).map(|(g, p)| g[axis] * p).sum::<f64>();
            inverse * nalgebra::Vector2::new(sum(0), sum(1))
        };
        let cycles = |c: Complex<f64>| c.arg() / std::f64::consts::TAU;
        let first = displacement(common.map(cycles));
        let local = |lens: &Lens| displacement(std::array::from_fn(|h| cycles(lens.sums[h] * common[h].conj())));
        let mut step = Motion::NONE;
        let mut typical = f64::INFINITY;
        let mut covariance = Matrix4::zeros();
        for _ in 0..ROUNDS {
            let mut sums = Sums::default();
            self.medians.clear();
            for lens in self.lenses.iter().filter(|lens| lens.seen) {
                let u = local(lens);
                let [x, y] = step.displacement(lens.place);
                let left = [u[0] - x, u[1] - y];
                let distance = left[0].hypot(left[1]);
                self.medians.push(distance);
                // A faint lattice has a phase of little worth: a dark part of the board, a missing microlens.
                let contrast = (0..count).map(|h| lens.sums[h].norm() / means[h]).fold(CONTRAST_CAP, f64::min);
                // Beyond twice the median distance a micro-image counts less and less.
                let weight = contrast.powi(2) / (1.0 + (distance / (2.0 * typical)).powi(2));
                sums.add(lens.place, left, weight, weight);
            }
            let Some((more, inverse)) = sums.solved() else { break };
            step.0 += more;
            covariance = inverse * sums.variance();
            if self.medians.is_empty() {
                break;
            }
            let middle = self.medians.len() / 2;
            typical = self.medians.select_nth_unstable_by(middle, f64::total_cmp).1.max(1e-6);
        }
        let motion = Motion(step.0 + Vector4::new(first[0], first[1], 0.0, 0.0));
        let shift_px = motion.greatest(&self.field);
        LatticeFit { motion, shift_px, sigma_px: self.field.sigma(&covariance), coherence }
    }
}

struct Demodulate<'a, T> {
    lens: &'a mut Lens,
    /// The pixel that the window is laid on.
    middle: [i32; 2],
    frame: &'a Frame<'a, T>,
    rows: &'a [(i32, i32, usize, usize)],
    weights: &'a [[Vec<f32>; 2]],
    table: &'a [f32],
    shift: u8,
}

impl<T: Sample> pulp::WithSimd for Demodulate<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) {
        let Self { lens, middle, frame, rows, weights, table, shift } = self;
        let Some(table) = table.first_chunk::<TABLE>() else { return };
        let mut sums = [[0.0f32; 2]; 3];
        for &(dy, dx, begin, count) in rows {
            let from = (middle[1] + dy) as usize * frame.width + (middle[0] + dx) as usize;
            let line = &mut lens.line[..count];
            for (value, &sample) in line.iter_mut().zip(&frame.samples[from..from + count]) {
                *value = table[(sample.level() as usize >> shift).min(TABLE - 1)];
            }
            for (sum, [re, im]) in sums.iter_mut().zip(weights) {
                sum[0] += product(line, &re[begin..begin + count]);
                sum[1] += product(line, &im[begin..begin + count]);
            }
        }
        for (to, [re, im]) in lens.sums.iter_mut().zip(sums) {
            *to = Complex::new(f64::from(re), f64::from(im));
        }
    }
}

/// A dot product in eight lanes.
#[inline(always)]
fn product(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0f32; 8];
    let ((a8, a_rest), (b8, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a8.iter().zip(b8) {
        for k in 0..8 {
            lanes[k] += a[k] * b[k];
        }
    }
    lanes.iter().sum::<f32>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f32>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::ArrayKind;

    /// Round micro-images with a coarse texture, `moved` from the grid.
    fn samples(grid: &Grid, moved: [f64; 2], seed: u64) -> Vec<u8> {
        let [width, height] = grid.frame_size;
        (0..width * height)
            .map(|k| {
                let (x, y) = ((k % width) as f64 - moved[0], (k / width) as f64 - moved[1]);
                let m = grid.nearest(x, y);
                let share = 1.0 - ((f64::hypot(x - m.x, y - m.y) / grid.pitch_px() - 0.36) / 0.14).clamp(0.0, 0.9);
                let chance = (k as u64 + seed).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 60;
                let texture = 120.0 + 40.0 * (0.13 * x + 0.05 * y).sin() + 40.0 * (0.07 * x - 0.19 * y).cos();
                (texture * share + chance as f64 / 4.0) as u8
            })
            .collect()
    }

    #[test]
    fn shifts_are_found_and_no_lattice_is_seen_in_noise() {
        for (array, turn) in [(ArrayKind::Square, 90f64), (ArrayKind::Hexagonal, 60.0)] {
            let along = |a: f64| [21.3 * a.cos(), 21.3 * a.sin()];
            let basis = [along(0.02), along(0.02 + turn.to_radians())];
            let grid = Grid::affine(array, [250.3, 200.1], basis, [500, 400]);
            let mut lattice = Lattice::new(&grid);
            for moved in [[0.0, 0.0], [1.5, -0.8], [0.0, 4.0]] {
                let samples = samples(&grid, moved, 1);
                let frame = Frame { samples: &samples, width: 500, height: 400, white: 255, mosaic: None };
                let fit = lattice.look(&frame, 8, 1.0, &Motion::NONE);
                let expected = f64::hypot(moved[0], moved[1]);
                assert!((fit.shift_px - expected).abs() < 4.0 * fit.sigma_px + 0.05, "{array:?} {moved:?}: {fit:?}");
                assert!(fit.sigma_px < 0.3 && fit.coherence > 0.6, "{array:?}: {fit:?}");
            }
            let noise: Vec<u8> =
                (0..500u64 * 400).map(|k| (k.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 57) as u8).collect();
            let frame = Frame { samples: &noise, width: 500, height: 400, white: 255, mosaic: None };
            assert!(lattice.look(&frame, 8, 30.0, &Motion::NONE).coherence < 0.3);
        }
    }
}
