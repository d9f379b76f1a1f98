//! Places of micro-images in a textured frame, from their mean profile.
//!
//! A slope of the scene's brightness continues within each micro-image and jumps back at its edge: a sawtooth in step
//! with the lattice, which shifts the phase of its harmonics. Here each micro-image is compared, within its own cell,
//! with the frame's mean profile V (in logarithm), and what a parabola across the cell explains is taken out first:
//! `log I(c + r) = a V(r − u) + polynomial(r)`, linear in the shift u. V is made even about the centre, so that it
//! defines the centre whatever the grid it was averaged with.

use nalgebra::DMatrix;
use rayon::prelude::*;
use rustfft::num_complex::Complex;

use super::demodulate::Lens;
use super::{Grid, LogFrame, MicroImage, reciprocal};
use crate::optics::ArrayKind;

/// Bins of the mean profile per px.
const BINS_PER_PX: f64 = 1.0;
/// Polynomial terms taken out of each cell: 1, x, y, x², xy, y².
const TERMS: usize = 6;
/// Contrast below which a micro-image says nothing of its place.
const CONTRAST_LEAST: f64 = 0.3;

/// Compares micro-images with the frame's mean profile.
pub(super) struct Matcher {
    /// Pixels of a cell about its centre.
    cell: Vec<(isize, isize)>,
    /// For each pixel of the cell, what it adds to contrast and to the shift in x and in y.
    kernels: Vec<[f32; 3]>,
    reach: [isize; 2],
}

impl Matcher {
    /// From the frame's own mean profile; `None` where it has too few complete micro-images or no contrast.
    pub(super) fn new(frame: &LogFrame, grid: &Grid) -> Option<Self> {
        let reciprocal = reciprocal(grid.basis);
        let [a, b] = grid.basis;
        let reach = [(a[0].abs() + b[0].abs()).ceil() as isize, (a[1].abs() + b[1].abs()).ceil() as isize];
        let mut cell = Vec::new();
        for dy in -reach[1]..=reach[1] {
            for dx in -reach[0]..=reach[0] {
                if in_cell(grid, dx as f64, dy as f64) {
                    cell.push((dx, dy));
                }
            }
        }
        let reach = cell.iter().fold([0, 0], |r, c| [r[0].max(c.0.abs()), r[1].max(c.1.abs())]);
        let mut matcher = Self { cell, kernels: Vec::new(), reach };
        let profile = matcher.mean_profile(frame, grid)?;
        let count = matcher.cell.len();
        if count < 3 * TERMS {
            return None;
        }
        let value = |x: f64, y: f64| {
            profile.at(reciprocal[0][0] * x + reciprocal[0][1] * y, reciprocal[1][0] * x + reciprocal[1][1] * y)
        };
        let scale = grid.pitch_px() / 2.0;
        let mut polynomials = DMatrix::<f64>::zeros(count, TERMS);
        let mut shapes = DMatrix::<f64>::zeros(count, 3);
        for (n, &(dx, dy)) in matcher.cell.iter().enumerate() {
            let (x, y) = (dx as f64, dy as f64);
            let (s, t) = (x / scale, y / scale);
            for (k, term) in [1.0, s, t, s * s, s * t, t * t].into_iter().enumerate() {
                polynomials[(n, k)] = term;
            }
            shapes[(n, 0)] = value(x, y);
            // V(r − u) = V(r) − u·∇V.
            shapes[(n, 1)] = value(x - 0.5, y) - value(x + 0.5, y);
            shapes[(n, 2)] = value(x, y - 0.5) - value(x, y + 0.5);
        }
        let inverse = (polynomials.transpose() * &polynomials).try_inverse()?;
        let explained = &polynomials * (inverse * (polynomials.transpose() * &shapes));
        let shapes = shapes - explained;
        let inverse = (shapes.transpose() * &shapes).try_inverse()?;
        let kernels = &shapes * inverse;
        matcher.kernels =
            (0..count).map(|n| [kernels[(n, 0)] as f32, kernels[(n, 1)] as f32, kernels[(n, 2)] as f32]).collect();
        Some(matcher)
    }

    fn complete(&self, frame: &LogFrame, m: &MicroImage) -> Option<(usize, usize)> {
        let (cx, cy) = (m.x.round() as isize, m.y.round() as isize);
        let inside = cx >= self.reach[0]
            && cy >= self.reach[1]
            && cx + self.reach[0] < frame.width as isize
            && cy + self.reach[1] < frame.height as isize;
        inside.then_some((cx as usize, cy as usize))
    }

    fn mean_profile(&self, frame: &LogFrame, grid: &Grid) -> Option<Profile> {
        let r = reciprocal(grid.basis);
        let side = ((grid.pitch_px() * BINS_PER_PX).round() as usize).clamp(8, 100);
        let mut sums = vec![(0.0f64, 0.0f64); side * side];
        let mut lenses = 0usize;
        for m in grid.micro_images_within(0.0) {
            let Some((cx, cy)) = self.complete(frame, &m) else { continue };
            lenses += 1;
            let pixel = |dx: isize, dy: isize| {
                let at = (cy as isize + dy) as usize * frame.width + (cx as isize + dx) as usize;
                f64::from(frame.values[at])
            };
            let mean = self.cell.iter().map(|&(dx, dy)| pixel(dx, dy)).sum::<f64>() / self.cell.len() as f64;
            for &(dx, dy) in &self.cell {
                let (x, y) = (cx as f64 + dx as f64 - m.x, cy as f64 + dy as f64 - m.y);
                let value = pixel(dx, dy) - mean;
                let (u, v) = (r[0][0] * x + r[0][1] * y, r[1][0] * x + r[1][1] * y);
                // At its place and at the opposite one: the profile is even.
                for (u, v) in [(u, v), (-u, -v)] {
                    let bin = |u: f64| (((u - u.floor()) * side as f64).round() as usize) % side;
                    let to = &mut sums[bin(v) * side + bin(u)];
                    to.0 += value;
                    to.1 += 1.0;
                }
            }
        }
        if lenses < 9 {
            return None;
        }
        // Bins that no pixel fell into take the mean of those about them.
        let about = |n: usize| {
            let (q, p) = (n / side, n % side);
            let mut sum = (0.0, 0.0);
            for dq in [side - 1, 0, 1] {
                for dp in [side - 1, 0, 1] {
                    let s = sums[(q + dq) % side * side + (p + dp) % side];
                    sum = (sum.0 + s.0, sum.1 + s.1);
                }
            }
            sum.0 / sum.1.max(1.0)
        };
        let values = (0..side * side).map(|n| if sums[n].1 > 0.0 { sums[n].0 / sums[n].1 } else { about(n) }).collect();
        Some(Profile { side, values })
    }

    /// Every complete micro-image, its shift written as phases of the lattice's `harmonics`.
    pub(super) fn run(&self, frame: &LogFrame, grid: &Grid, harmonics: &[[f64; 2]]) -> Vec<Lens> {
        let all: Vec<MicroImage> = grid.micro_images_within(0.0).collect();
        all.into_par_iter()
            .with_min_len(32)
            .filter_map(|at| {
                let (cx, cy) = self.complete(frame, &at)?;
                let mut sums = [0.0f32; 3];
                for (&(dx, dy), kernel) in self.cell.iter().zip(&self.kernels) {
                    let value = frame.values[(cy as isize + dy) as usize * frame.width + (cx as isize + dx) as usize];
                    for (sum, k) in sums.iter_mut().zip(kernel) {
                        *sum += value * k;
                    }
                }
                let contrast = f64::from(sums[0]);
                let weight = if contrast > CONTRAST_LEAST { contrast.min(1.5) } else { 0.0 };
                let shift = [
                    f64::from(sums[1]) / contrast.max(CONTRAST_LEAST) - (at.x - cx as f64),
                    f64::from(sums[2]) / contrast.max(CONTRAST_LEAST) - (at.y - cy as f64),
                ];
                let mut sums = [Complex::new(0.0, 0.0); 3];
                for (sum, g) in sums.iter_mut().zip(harmonics) {
                    let cycles = (g[0] * shift[0] + g[1] * shift[1]).clamp(-0.49, 0.49);
                    *sum = Complex::from_polar(weight, std::f64::consts::TAU * cycles);
                }
                Some(Lens { at, sums })
            })
            .collect()
    }
}

/// A periodic profile over the lattice's cell.
struct Profile {
    side: usize,
    values: Vec<f64>,
}

impl Profile {
    /// Bilinear between the bins.
    fn at(&self, u: f64, v: f64) -> f64 {
        let split = |u: f64| {
            let at = (u - u.floor()) * self.side as f64;
            let base = at as usize;
            (base % self.side, (base + 1) % self.side, at - base as f64)
        };
        let ((p0, p1, s), (q0, q1, t)) = (split(u), split(v));
        let value = |q: usize, p: usize| self.values[q * self.side + p];
        (value(q0, p0) * (1.0 - s) + value(q0, p1) * s) * (1.0 - t)
            + (value(q1, p0) * (1.0 - s) + value(q1, p1) * s) * t
    }
}

/// Whether a displacement (px) from a micro-image centre lies nearer to it than to any neighbour.
fn in_cell(grid: &Grid, x: f64, y: f64) -> bool {
    let [a, b] = grid.basis;
    let mut neighbours = vec![a, b];
    if grid.array == ArrayKind::Hexagonal {
        neighbours.push([b[0] - a[0], b[1] - a[1]]);
    }
    neighbours.iter().all(|n| (x * n[0] + y * n[1]).abs() <= 0.5 * (n[0] * n[0] + n[1] * n[1]))
}
