//! The lattice's first harmonics, and the window that they are taken through.
//!
//! The window is a triangle along both lattice vectors, two cells wide: its transform has double zeros at every other
//! harmonic, so that neither the mean nor a slope of the frame nor another harmonic enters.

use fourier::Complex;
use nalgebra::{Matrix3, Vector3};

use super::{Grid, reciprocal};
use crate::optics::ArrayKind;

/// The first harmonics of a lattice.
pub(crate) struct Harmonics {
    /// Cycles per px: two for a square, three for a hexagonal array.
    pub(crate) waves: Vec<[f64; 2]>,
    /// How far the window reaches from its middle along x and y, px.
    pub(crate) reach: [isize; 2],
}

/// A sample of the window.
pub(crate) struct Point {
    /// Place from the window's middle, px.
    pub(crate) x: f64,
    pub(crate) y: f64,
    /// The window's value there.
    pub(crate) weight: f64,
}

impl Harmonics {
    pub(crate) fn new(grid: &Grid) -> Self {
        let [g0, g1] = reciprocal(grid.basis);
        let mut waves = vec![g0, g1];
        if grid.array == ArrayKind::Hexagonal {
            // Reciprocal vectors of a 60° basis are 120° apart: their sum is the third of the ring.
            waves.push([g0[0] + g1[0], g0[1] + g1[1]]);
        }
        let [a, b] = grid.basis;
        Self { waves, reach: [0, 1].map(|k| (a[k].abs() + b[k].abs()) as isize) }
    }

    /// The window at a place (px from its middle): 1 there, 0 outside.
    pub(crate) fn window(&self, x: f64, y: f64) -> f64 {
        let side = |g: [f64; 2]| (1.0 - (g[0] * x + g[1] * y).abs()).max(0.0);
        side(self.waves[0]) * side(self.waves[1])
    }

    /// Real and imaginary weights of each harmonic at the window's samples: window times harmonic with the sampled
    /// window's leak of mean and slope taken out, so that the sum of a cosine's samples is half its amplitude.
    pub(crate) fn kernels(&self, window: &[Point]) -> Vec<[Vec<f32>; 2]> {
        self.waves.iter().map(|g| kernel(window, *g)).collect()
    }
}

fn kernel(window: &[Point], g: [f64; 2]) -> [Vec<f32>; 2] {
    let area: f64 = window.iter().map(|p| p.weight).sum();
    let wave = |p: &Point| Complex::from_polar(p.weight / area, std::f64::consts::TAU * (g[0] * p.x + g[1] * p.y));
    let mut sums: Vec<Complex<f64>> = window.iter().map(wave).collect();
    let mut normal = Matrix3::<f64>::zeros();
    let mut leak = [Vector3::<f64>::zeros(); 2];
    for (p, s) in window.iter().zip(&sums) {
        let q = Vector3::new(1.0, p.x, p.y);
        normal += q * q.transpose() * p.weight;
        leak[0] += q * s.re;
        leak[1] += q * s.im;
    }
    if let Some(inverse) = normal.try_inverse() {
        let (re, im) = (inverse * leak[0], inverse * leak[1]);
        for (p, s) in window.iter().zip(&mut sums) {
            s.re -= p.weight * (re[0] + re[1] * p.x + re[2] * p.y);
            s.im -= p.weight * (im[0] + im[1] * p.x + im[2] * p.y);
        }
    }
    [sums.iter().map(|s| s.re as f32).collect(), sums.iter().map(|s| s.im as f32).collect()]
}
