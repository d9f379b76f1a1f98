//! What pixels say about a profile, added up over the bins of a cell.

use nalgebra::{SMatrix, SVector};

use super::place::Place;
use super::{TERMS, Vignetting, factors};

/// Share of the mean weight of a bin below which one has too little.
const LEAST_WEIGHT: f64 = 0.02;

/// Sums over the bins of a cell, of a profile's first `N` terms.
pub(super) struct Bins<const N: usize> {
    side: usize,
    sums: Vec<Sums<N>>,
    /// Of all residuals, and of all brightness, squared.
    pub(super) squares: f64,
    pub(super) weight: f64,
}

/// Normal matrix and right-hand side of one bin.
#[derive(Clone, Copy)]
struct Sums<const N: usize> {
    normal: [[f64; N]; N],
    right: [f64; N],
}

impl<const N: usize> Bins<N> {
    pub(super) fn new(side: usize) -> Self {
        let none = Sums { normal: [[0.0; N]; N], right: [0.0; N] };
        Self { side, sums: vec![none; side * side], squares: 0.0, weight: 0.0 }
    }

    /// Adds a pixel: what is left of its grey level, where the frame is so bright.
    #[inline]
    pub(super) fn add(&mut self, place: &Place, at: [f64; 2], brightness: f32, residual: f32) {
        let (b, r) = (f64::from(brightness), f64::from(residual));
        self.squares += r * r;
        self.weight += b * b;
        let by = factors(at).map(|factor| b * factor);
        let side = self.side;
        let [columns, rows] =
            place.bins(side).map(|(base, t)| [(base, 1.0 - t), (if base + 1 == side { 0 } else { base + 1 }, t)]);
        for (q, wy) in rows {
            for (p, wx) in columns {
                let weight = wx * wy;
                let to = &mut self.sums[q * side + p];
                for (term, (normal, right)) in by.iter().zip(to.normal.iter_mut().zip(&mut to.right)) {
                    let weighted = weight * term;
                    *right += weighted * r;
                    normal.iter_mut().zip(by).for_each(|(sum, other)| *sum += weighted * other);
                }
            }
        }
    }

    pub(super) fn merged(mut self, other: &Self) -> Self {
        for (to, from) in self.sums.iter_mut().zip(&other.sums) {
            to.normal.as_flattened_mut().iter_mut().zip(from.normal.as_flattened()).for_each(|(a, b)| *a += b);
            to.right.iter_mut().zip(from.right).for_each(|(a, b)| *a += b);
        }
        self.squares += other.squares;
        self.weight += other.weight;
        self
    }

    /// Solves every bin and adds what it finds to the profile. Bins that no pixel fell into (a lattice in step with
    /// the pixels leaves some) take the mean of their neighbours.
    pub(super) fn add_to(&self, profile: &mut Vignetting) {
        let side = self.side;
        let enough = LEAST_WEIGHT * self.weight / (side * side) as f64;
        let mut steps: Vec<Option<[f64; TERMS]>> = self.sums.iter().map(|sums| sums.solved(enough)).collect();
        for _ in 0..side {
            let known = steps.clone();
            let mut missing = false;
            for q in 0..side {
                for p in 0..side {
                    if known[q * side + p].is_some() {
                        continue;
                    }
                    missing = true;
                    let about = [
                        known[q * side + (p + 1) % side],
                        known[q * side + (p + side - 1) % side],
                        known[(q + 1) % side * side + p],
                        known[(q + side - 1) % side * side + p],
                    ];
                    let n = about.iter().flatten().count();
                    if n > 0 {
                        let mean = |k: usize| about.iter().flatten().map(|a| a[k]).sum::<f64>() / n as f64;
                        steps[q * side + p] = Some(std::array::from_fn(mean));
                    }
                }
            }
            if !missing {
                break;
            }
        }
        for (terms, step) in profile.terms.iter_mut().zip(steps) {
            for (term, s) in terms.iter_mut().zip(step.unwrap_or_default()) {
                *term += s as f32;
            }
        }
    }
}

impl<const N: usize> Sums<N> {
    /// The step of the terms, those beyond `N` 0; `None` where there is less than `enough` light, or too little to tell.
    fn solved(&self, enough: f64) -> Option<[f64; TERMS]> {
        if self.normal[0][0] <= enough {
            return None;
        }
        let normal = SMatrix::<f64, N, N>::from_fn(|row, column| self.normal[row][column]);
        let step = normal.cholesky()?.solve(&SVector::<f64, N>::from(self.right));
        let mut terms = [0.0; TERMS];
        terms[..N].copy_from_slice(step.as_slice());
        Some(terms)
    }
}
