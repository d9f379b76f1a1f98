//! Robust maps from lattice indices to the frame, through the phases of many micro-images.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::demodulate::Lens;
use super::phases::{Phases, median};
use super::{Distortion, Grid};

/// Greatest degree of the polynomial map.
pub(super) const DEGREE_MAX: usize = 5;
/// Rounds of reweighting; the weights settle within three or four.
const ROUNDS: usize = 6;
/// Parameters of a shift, scale and rotation.
const RIGID: usize = 4;
/// Micro-images whose sums are made together.
const PART: usize = 1024;

/// What of the grid is fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Model {
    /// Shift and scale: what a change of the image distance does to a known grid.
    ScaleShift,
    /// Shift, scale and rotation: a lattice as made, seen square on.
    Similarity,
    /// Polynomials of this degree in x and y; 1 is the affine lattice.
    Polynomial(usize),
}

/// The monomials of s and t up to a degree: 1; s, t; s², st, t²; ...
///
/// # Panics
/// For a degree above [`DEGREE_MAX`].
pub(super) fn monomials(s: f64, t: f64, degree: usize) -> impl Iterator<Item = f64> {
    let powers = |of: f64| {
        let mut powers = [1.0; DEGREE_MAX + 1];
        (1..=DEGREE_MAX).for_each(|k| powers[k] = powers[k - 1] * of);
        powers
    };
    let (s, t) = (powers(s), powers(t));
    (0..=degree).flat_map(move |d| (0..=d).map(move |k| s[d - k] * t[k]))
}

/// Number of monomials up to a degree.
pub(super) const fn monomial_count(degree: usize) -> usize {
    (degree + 1) * (degree + 2) / 2
}

/// A fitted grid.
pub(super) struct Fit {
    pub grid: Grid,
    /// Sum of the squared, weighted phases left, cycles squared, over the weights: what the models are compared by.
    pub variance: f64,
    /// Standard errors of the shift in x and in y (px) and of the relative scale; zeros for other models.
    pub sigma: [f64; 3],
    /// What it leaves of each phase, cycles, and its weight, micro-image by micro-image.
    pub left: Vec<[f64; 2]>,
    /// Numbers that were fitted.
    pub unknowns: usize,
}

impl Phases<'_> {
    /// Fits a model; `None` where the micro-images do not determine it.
    pub(super) fn fit(&self, model: Model) -> Option<Fit> {
        let scale = self.scale();
        let per_axis = match model {
            Model::Polynomial(degree) => monomial_count(degree),
            Model::ScaleShift | Model::Similarity => 0,
        };
        // The terms of every micro-image, one after the other.
        let size = if per_axis > 0 { per_axis } else { 2 };
        let terms: Vec<f64> = self
            .lenses
            .par_iter()
            .with_min_len(PART)
            .flat_map_iter(|l| {
                let mut terms = [0.0; monomial_count(DEGREE_MAX)];
                if let Model::Polynomial(degree) = model {
                    let (i, j) = (f64::from(l.at.i) / scale, f64::from(l.at.j) / scale);
                    terms.iter_mut().zip(monomials(i, j, degree)).for_each(|(to, term)| *to = term);
                } else {
                    let c = self.grid.centre;
                    let length = scale * self.grid.pitch_px();
                    terms[..2].copy_from_slice(&[(l.at.x - c[0]) / length, (l.at.y - c[1]) / length]);
                }
                terms.into_iter().take(size)
            })
            .collect();
        // Derivatives of a displacement along g by the parameters of a shift, scale and rotation.
        let rigid = |g: [f64; 2], p: &[f64]| [g[0], g[1], g[0] * p[0] + g[1] * p[1], g[1] * p[0] - g[0] * p[1]];
        let unknowns = match model {
            Model::ScaleShift => 3,
            Model::Similarity => 4,
            Model::Polynomial(_) => 2 * per_axis,
        };
        let count = self.harmonics.len();
        if self.lenses.len() * 2 < unknowns * 2 {
            return None;
        }
        let observations = self.observations.iter().enumerate();
        let (weights, observed): (Vec<f64>, Vec<f64>) = observations
            .map(|(k, [modulus, cycles])| ((modulus / self.medians[k % count]).min(self.cap).powi(2), cycles))
            .unzip();
        let surest = if self.moduli_are_certainty { surest_weight(&weights) } else { 0.0 };
        let mut robust = vec![1.0; weights.len()];
        let mut parameters = DVector::<f64>::zeros(unknowns);
        let mut variance = 0.0;
        let mut sigma = [0.0; 3];
        let mut kept = Vec::new();
        for round in 0..ROUNDS {
            let mut normal = DMatrix::<f64>::zeros(unknowns, unknowns);
            let mut right = DVector::<f64>::zeros(unknowns);
            let blocks =
                if per_axis > 0 { accumulate(&terms, per_axis, count, (&weights, &robust, &observed)) } else { vec![] };
            for (h, g) in self.harmonics.iter().enumerate() {
                if per_axis > 0 {
                    let (block, vector) = &blocks[h];
                    for p in 0..2 {
                        for r in 0..per_axis {
                            right[p * per_axis + r] += g[p] * vector[r];
                            for q in 0..2 {
                                for c in 0..per_axis {
                                    normal[(p * per_axis + r, q * per_axis + c)] += g[p] * g[q] * block[(r, c)];
                                }
                            }
                        }
                    }
                } else {
                    // The parts do not depend on the machine, so that neither do the sums' last digits.
                    let parts: Vec<[[f64; RIGID]; RIGID + 1]> = terms
                        .par_chunks(PART * size)
                        .enumerate()
                        .map(|(part, terms)| {
                            let mut sums = [[0.0; RIGID]; RIGID + 1];
                            for (n, place) in terms.chunks_exact(size).enumerate() {
                                let k = (part * PART + n) * count + h;
                                let w = weights[k] * robust[k];
                                let row = rigid(*g, place);
                                for r in 0..RIGID {
                                    sums[RIGID][r] += w * row[r] * observed[k];
                                    for c in 0..RIGID {
                                        sums[c][r] += w * row[r] * row[c];
                                    }
                                }
                            }
                            sums
                        })
                        .collect();
                    let mut sums = [[0.0; RIGID]; RIGID + 1];
                    for part in &parts {
                        sums.as_flattened_mut().iter_mut().zip(part.as_flattened()).for_each(|(s, p)| *s += p);
                    }
                    for r in 0..unknowns {
                        right[r] += sums[RIGID][r];
                        for c in 0..unknowns {
                            normal[(r, c)] += sums[c][r];
                        }
                    }
                }
            }
            let normal = normal.cholesky()?;
            parameters = normal.solve(&right);
            // What is left, and new weights: Huber's first (one minimum), then Tukey's, which lets go of outliers.
            let solution = parameters.as_slice();
            let left: Vec<f64> = terms
                .par_chunks_exact(size)
                .with_min_len(PART)
                .enumerate()
                .flat_map_iter(|(n, place)| {
                    let mut moved = [0.0; 2];
                    if per_axis > 0 {
                        for (t, (x, y)) in place.iter().zip(solution.iter().zip(&solution[per_axis..])) {
                            moved[0] += t * x;
                            moved[1] += t * y;
                        }
                    }
                    let (weights, observed) = (&weights, &observed);
                    self.harmonics.iter().enumerate().map(move |(h, g)| {
                        let predicted: f64 = if per_axis > 0 {
                            g[0] * moved[0] + g[1] * moved[1]
                        } else {
                            rigid(*g, place).iter().zip(solution).map(|(t, c)| t * c).sum()
                        };
                        let k = n * count + h;
                        (observed[k] - predicted) * weights[k].sqrt()
                    })
                })
                .collect();
            let sure = left.iter().zip(&weights).filter(|(_, w)| **w >= surest);
            let spread = 1.4826 * median(&mut sure.map(|(r, _)| r.abs()).collect::<Vec<_>>()).max(1e-7);
            for (w, r) in robust.iter_mut().zip(&left) {
                let z = r.abs() / spread;
                *w = if round < 2 {
                    if z < 1.345 { 1.0 } else { 1.345 / z }
                } else if z < 4.685 {
                    (1.0 - (z / 4.685).powi(2)).powi(2)
                } else {
                    0.0
                };
            }
            variance = left.iter().zip(&robust).map(|(r, w)| w * r * r).sum::<f64>()
                / weights.iter().zip(&robust).map(|(a, b)| a * b).sum::<f64>().max(1e-12);
            if per_axis == 0 && round + 1 == ROUNDS {
                let covariance = normal.inverse() * variance;
                let length = scale * self.grid.pitch_px();
                sigma = [0, 1, 2].map(|k| covariance[(k, k)].sqrt());
                sigma[2] /= length;
            }
            if round + 1 == ROUNDS {
                kept = left
                    .iter()
                    .zip(weights.iter().zip(&robust))
                    .map(|(r, (w, robust))| [r / w.sqrt().max(1e-12), w * robust])
                    .collect();
            }
        }
        Some(Fit { grid: self.moved(model, &parameters, scale), variance, sigma, left: kept, unknowns })
    }

    /// Lattice indices and places are divided by this, about half the frame.
    fn scale(&self) -> f64 {
        let [w, h] = self.grid.frame_size;
        (w.max(h) as f64 / 2.0 / self.grid.pitch_px()).max(1.0)
    }

    fn moved(&self, model: Model, p: &DVector<f64>, scale: f64) -> Grid {
        let mut grid = self.grid.clone();
        match model {
            Model::ScaleShift | Model::Similarity => {
                let length = scale * self.grid.pitch_px();
                let a = 1.0 + p[2] / length;
                let b = if model == Model::Similarity { p[3] / length } else { 0.0 };
                let turn = |v: [f64; 2]| [a * v[0] - b * v[1], a * v[1] + b * v[0]];
                grid.centre = [grid.centre[0] + p[0], grid.centre[1] + p[1]];
                grid.basis = grid.basis.map(turn);
                if let Some(d) = &mut grid.distortion {
                    d.coefficients.iter_mut().for_each(|c| *c = turn(*c));
                }
            }
            Model::Polynomial(degree) => {
                let count = monomial_count(degree);
                let term = |k: usize| [p[k], p[count + k]];
                let add = |v: &mut [f64; 2], by: [f64; 2], f: f64| {
                    v[0] += by[0] * f;
                    v[1] += by[1] * f;
                };
                if degree == 1 && grid.distortion.is_none() {
                    add(&mut grid.centre, term(0), 1.0);
                    add(&mut grid.basis[0], term(1), 1.0 / scale);
                    add(&mut grid.basis[1], term(2), 1.0 / scale);
                } else {
                    let mut coefficients: Vec<[f64; 2]> = (0..count).map(term).collect();
                    let mut degree = degree;
                    if let Some(old) = &self.grid.distortion {
                        degree = degree.max(old.degree);
                        coefficients.resize(monomial_count(degree), [0.0; 2]);
                        let degrees = (0..=old.degree).flat_map(|d| std::iter::repeat_n(d, d + 1));
                        for ((c, o), d) in coefficients.iter_mut().zip(&old.coefficients).zip(degrees) {
                            add(c, *o, (scale / old.scale).powi(d as i32));
                        }
                    }
                    grid.distortion = Some(Distortion { degree, scale, coefficients });
                    grid = balanced(grid, self.lenses);
                }
            }
        }
        grid
    }
}

/// The same grid with the departure's affine part (over these micro-images) moved into the lattice.
fn balanced(mut grid: Grid, lenses: &[Lens]) -> Grid {
    let Some(distortion) = grid.distortion.as_mut() else { return grid };
    let scale = distortion.scale;
    let mut normal = nalgebra::Matrix3::<f64>::zeros();
    let mut right = [nalgebra::Vector3::<f64>::zeros(); 2];
    for lens in lenses {
        let (i, j) = (f64::from(lens.at.i), f64::from(lens.at.j));
        let f = nalgebra::Vector3::new(1.0, i / scale, j / scale);
        let d = distortion.at(i, j);
        normal += f * f.transpose();
        right[0] += f * d[0];
        right[1] += f * d[1];
    }
    let Some(inverse) = normal.try_inverse() else { return grid };
    for axis in 0..2 {
        let p = inverse * right[axis];
        for (k, c) in distortion.coefficients.iter_mut().take(3).enumerate() {
            c[axis] -= p[k];
        }
        grid.centre[axis] += p[0];
        grid.basis[0][axis] += p[1] / scale;
        grid.basis[1][axis] += p[2] / scale;
    }
    grid
}

/// Least weight of the surest tenth.
fn surest_weight(weights: &[f64]) -> f64 {
    const SUREST: f64 = 0.1;
    let mut sorted = weights.to_vec();
    let rank = ((sorted.len() as f64 * (1.0 - SUREST)) as usize).min(sorted.len() - 1);
    *sorted.select_nth_unstable_by(rank, f64::total_cmp).1
}

/// Sums of w f fᵀ and w f y for each of `count` harmonics, from weights, what is left of them and observations in the
/// order of micro-images, then harmonics.
fn accumulate(
    terms: &[f64],
    size: usize,
    count: usize,
    (weights, robust, observed): (&[f64], &[f64], &[f64]),
) -> Vec<(DMatrix<f64>, DVector<f64>)> {
    let arch = pulp::Arch::new();
    // The parts do not depend on the machine, so that neither do the sums' last digits.
    let parts: Vec<Vec<Sums>> = terms
        .par_chunks(PART * size)
        .enumerate()
        .map(|(part, terms)| {
            let first = part * PART;
            let one = |h| Sum { terms, size, count, first, h, weights, robust, observed };
            (0..count).map(|h| arch.dispatch(one(h))).collect()
        })
        .collect();
    (0..count)
        .map(|h| {
            let mut block = DMatrix::<f64>::zeros(size, size);
            let mut vector = DVector::<f64>::zeros(size);
            for part in &parts {
                block.as_mut_slice().iter_mut().zip(&part[h].block).for_each(|(b, p)| *b += p);
                vector.as_mut_slice().iter_mut().zip(&part[h].vector).for_each(|(v, p)| *v += p);
            }
            block.fill_upper_triangle_with_lower_triangle();
            (block, vector)
        })
        .collect()
}

/// The sums over some micro-images: the block's lower triangle column by column, and the vector.
struct Sums {
    block: Vec<f64>,
    vector: Vec<f64>,
}

/// The work of [`Sums`] for one harmonic.
struct Sum<'a> {
    terms: &'a [f64],
    size: usize,
    count: usize,
    /// The first micro-image, counted from the first of all.
    first: usize,
    h: usize,
    weights: &'a [f64],
    robust: &'a [f64],
    observed: &'a [f64],
}

impl pulp::WithSimd for Sum<'_> {
    type Output = Sums;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) -> Sums {
        let Self { terms, size, count, first, h, weights, robust, observed } = self;
        let mut sums = Sums { block: vec![0.0; size * size], vector: vec![0.0; size] };
        for (n, f) in terms.chunks_exact(size).enumerate() {
            let k = (first + n) * count + h;
            let w = weights[k] * robust[k];
            if w == 0.0 {
                continue;
            }
            for c in 0..size {
                let by = w * f[c];
                sums.vector[c] += by * observed[k];
                let column = &mut sums.block[c * size..(c + 1) * size];
                for (b, t) in column[c..].iter_mut().zip(&f[c..]) {
                    *b += by * t;
                }
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_in_parts_are_the_sums_over_all() {
        let (size, count, lenses) = (6, 3, 2 * PART + 77);
        let wave = |k: usize, by: f64| (k as f64 * by).sin();
        let terms: Vec<f64> = (0..lenses * size).map(|k| wave(k, 0.7)).collect();
        let weights: Vec<f64> = (0..lenses * count).map(|k| 1.5 + wave(k, 0.3)).collect();
        // Some are left out altogether.
        let robust: Vec<f64> = (0..lenses * count).map(|k| wave(k, 1.1).max(0.0)).collect();
        let observed: Vec<f64> = (0..lenses * count).map(|k| wave(k, 0.9)).collect();
        let sums = accumulate(&terms, size, count, (&weights, &robust, &observed));
        for (h, (block, vector)) in sums.iter().enumerate() {
            let over = |value: &dyn Fn(&[f64], f64) -> f64| -> f64 {
                let places = terms.chunks_exact(size).enumerate();
                places
                    .map(|(n, f)| weights[n * count + h] * robust[n * count + h] * value(f, observed[n * count + h]))
                    .sum()
            };
            for r in 0..size {
                assert!((vector[r] - over(&|f, y| f[r] * y)).abs() < 1e-9);
                for c in 0..size {
                    assert!((block[(r, c)] - over(&|f, _| f[r] * f[c])).abs() < 1e-9, "{h}: {r}, {c}");
                }
            }
        }
        assert_eq!(sums.len(), count);
    }
}
