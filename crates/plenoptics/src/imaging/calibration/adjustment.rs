//! Least squares for d and b, with the boards' common shift and f as further unknowns where they are not held.
//!
//! Every board is one equation, f L/(L − f) = d + N b with L its given distance plus the shift; the micro-image pitch is
//! one in b/d, and what is known beforehand of b, shift and f one each. With shift and f held the boards are points on a
//! straight line of v against N, and the first step ends the search. Otherwise it is Levenberg's and Marquardt's, and
//! what the boards leave counts in N: boards further away have their images nearer together, and counted in v a fit would
//! please by moving them there. The boards' weights depend on the unknowns, hence the rounds.
//!
//! Columns are brought to unit length before anything is inverted: an unknown's unit does not decide what is singular.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::unknowns::{Known, Unknown};
use crate::optics::MainLens;

/// Rounds of reweighting; the weights settle within three or four.
const ROUNDS: usize = 12;
/// Most steps of one round, refused ones included.
const STEPS: usize = 200;
/// A step below this, in units of what the data tell of each unknown alone, ends a round; and the search for a start.
const SMALL_STEP: f64 = 1e-9;
const SMALL_STEP_OF_START: f64 = 1e-2;
/// Below this rounding decides whether a step helps.
const ROUNDING_STEP: f64 = 1e-6;
/// Damping at which no step helps any more.
const DAMPING_MAX: f64 = 1e6;
/// Places on the axis where the search for an unknown distance begins.
const SCAN: usize = 60;
/// Floor of a held quantity's uncertainty, mm, and of a board's N: neither may weigh infinitely.
const HELD_SIGMA_MM: f64 = 1e-9;
const RESOLUTION_SIGMA: f64 = 1e-8;

/// The equations of a calibration.
pub(super) struct Problem<'a> {
    /// The main lens as configured.
    pub lens: MainLens,
    /// Boards by rising distance, mm, as given.
    pub distances_mm: &'a [f64],
    /// N of each board, signed.
    pub resolutions: Vec<f64>,
    /// dN/dl of each, 1/px.
    pub leverage: Vec<f64>,
    /// Covariance of the spacings, px².
    pub covariance_px: &'a DMatrix<f64>,
    /// Standard uncertainty of each board's own distance, mm.
    pub each_sigma_mm: f64,
    /// b/d and its standard uncertainty, from the micro-image pitch.
    pub ratio: Option<(f64, f64)>,
    /// b and its standard uncertainty, mm.
    pub held_b: Option<(f64, f64)>,
    /// What is known of the boards' common shift, about 0.
    pub shift: Known,
    /// What is known of f, about the configured value.
    pub focal_length: Known,
}

/// Values of the unknowns, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct State {
    pub d: f64,
    pub b: f64,
    pub shift: f64,
    pub f: f64,
}

impl State {
    pub(super) fn value(&self, unknown: Unknown) -> f64 {
        match unknown {
            Unknown::D => self.d,
            Unknown::B => self.b,
            Unknown::Distance => self.shift,
            Unknown::FocalLength => self.f,
        }
    }

    fn moved(mut self, free: &[Unknown], step: &DVector<f64>) -> Self {
        for (unknown, by) in free.iter().zip(step.iter()) {
            match unknown {
                Unknown::D => self.d += by,
                Unknown::B => self.b += by,
                Unknown::Distance => self.shift += by,
                Unknown::FocalLength => self.f += by,
            }
        }
        self
    }
}

/// How the boards are weighted for one round.
struct Weights {
    /// Covariance of their N, decomposed.
    noise: Cholesky<f64, Dyn>,
    /// b that it was made with, mm.
    b: f64,
}

/// Residuals and derivatives in units of their uncertainty: boards, pitch, held b, shift, f.
struct Rows {
    residuals: DVector<f64>,
    jacobian: DMatrix<f64>,
    /// Rows of what the picture shows: boards and pitch.
    seen: usize,
    /// Those, and the held b's.
    widened: usize,
}

impl Rows {
    fn cost(&self) -> f64 {
        self.residuals.norm_squared()
    }
}

/// The fitted unknowns.
#[derive(Debug, Clone)]
pub(super) struct Solution {
    pub state: State,
    /// The unknowns, in the order of `told` and `covariance`.
    pub free: Vec<Unknown>,
    /// What the equations tell of the unknowns if each has the uncertainty it claims.
    pub told: Information,
    /// Covariance, mm², after widening by residuals that the uncertainties do not explain.
    pub covariance: DMatrix<f64>,
    /// Squared residuals of boards and pitch in units of their uncertainty.
    pub chi_squared: f64,
    /// Equations beyond the unknowns.
    pub degrees_of_freedom: usize,
}

/// Singular values of the derivatives with their columns brought to unit length.
#[derive(Debug, Clone)]
pub(super) struct Information {
    norms: DVector<f64>,
    singular: DVector<f64>,
    /// Right singular vectors, as columns.
    directions: DMatrix<f64>,
    /// The residuals along the left ones.
    projected: DVector<f64>,
}

impl Information {
    fn new(jacobian: &DMatrix<f64>, residuals: &DVector<f64>) -> Option<Self> {
        // Rows of zeros change nothing, and give a direction to every unknown even where equations are too few.
        let rows = jacobian.nrows().max(jacobian.ncols());
        let mut scaled = jacobian.clone().resize_vertically(rows, 0.0);
        let norms = DVector::from_iterator(jacobian.ncols(), jacobian.column_iter().map(|c| c.norm()));
        if !norms.iter().all(|n| n.is_finite() && *n > 0.0) || !residuals.iter().all(|r| r.is_finite()) {
            return None;
        }
        for (mut column, norm) in scaled.column_iter_mut().zip(norms.iter()) {
            column /= *norm;
        }
        let svd = scaled.try_svd(true, true, f64::EPSILON, 500)?;
        let (u, v_t) = (svd.u?, svd.v_t?);
        let projected = u.transpose() * residuals.clone().resize_vertically(rows, 0.0);
        Some(Self { norms, singular: svd.singular_values, directions: v_t.transpose(), projected })
    }

    /// The damped step towards the least squares, in the unknowns' units, and its length in scaled ones.
    fn step(&self, damping: f64) -> (DVector<f64>, f64) {
        let amounts = DVector::from_fn(self.singular.len(), |k, _| {
            let s = self.singular[k];
            let denominator = s * s + damping;
            if denominator > 1e-30 { s * self.projected[k] / denominator } else { 0.0 }
        });
        let scaled = &self.directions * amounts;
        let length = scaled.norm();
        (scaled.component_div(&self.norms), length)
    }

    /// Greatest over least singular value: 1 where every unknown has equations of its own, infinite where some
    /// combination has none.
    pub(super) fn condition(&self) -> f64 {
        let least = self.singular.min();
        if least > 0.0 { self.singular.max() / least } else { f64::INFINITY }
    }

    /// Covariance of the unknowns, mm². What nothing determines counts as determined to rounding.
    pub(super) fn covariance(&self) -> DMatrix<f64> {
        let count = self.norms.len();
        let least = f64::EPSILON * self.singular.max();
        DMatrix::from_fn(count, count, |i, j| {
            let sum: f64 = (0..count)
                .map(|k| self.directions[(i, k)] * self.directions[(j, k)] / self.singular[k].max(least).powi(2))
                .sum();
            sum / (self.norms[i] * self.norms[j])
        })
    }
}

impl Problem<'_> {
    /// The unknowns that the fit may change.
    pub(super) fn free(&self) -> Vec<Unknown> {
        let mut free = vec![Unknown::D, Unknown::B];
        free.extend(self.shift.free().then_some(Unknown::Distance));
        free.extend(self.focal_length.free().then_some(Unknown::FocalLength));
        free
    }

    /// Solves the equations; `None` where no real boards fulfil them.
    pub(super) fn solve(&self) -> Option<Solution> {
        let free = self.free();
        let mut state = self.start()?;
        for _ in 0..ROUNDS {
            let before = state;
            let weights = self.weights(&state)?;
            state = self.descend(state, &weights, &free, SMALL_STEP)?;
            let settled = |u: Unknown| (state.value(u) - before.value(u)).abs() <= 1e-10 * state.b.abs();
            if free.iter().all(|&u| settled(u)) {
                break;
            }
        }
        let mut rows = self.rows(&state, &self.weights(&state)?, &free)?;
        let told = Information::new(&rows.jacobian, &rows.residuals)?;
        let chi_squared = rows.residuals.rows(0, rows.seen).norm_squared();
        let degrees_of_freedom = rows.residuals.len().saturating_sub(free.len());
        // Residuals larger than the uncertainties explain widen the result, but not what is known from elsewhere.
        let widening = if degrees_of_freedom > 0 { (chi_squared / degrees_of_freedom as f64).max(1.0) } else { 1.0 };
        rows.jacobian.rows_mut(0, rows.widened).unscale_mut(widening.sqrt());
        let covariance = Information::new(&rows.jacobian, &rows.residuals)?.covariance();
        Some(Solution { state, free, told, covariance, chi_squared, degrees_of_freedom })
    }

    /// What the unknowns' values leave of each board's image distance, mm; NaN where it has no image.
    pub(super) fn residuals_mm(&self, state: &State) -> Vec<f64> {
        let images = self.image_distances(state.shift, state.f);
        let images = images.unwrap_or_else(|| vec![f64::NAN; self.resolutions.len()]);
        images.iter().zip(&self.resolutions).map(|(v, n)| v - state.d - n * state.b).collect()
    }

    /// Where to begin: at what is given, or where on the axis the boards' spacings are met best.
    fn start(&self) -> Option<State> {
        if self.shift != Known::NotAtAll {
            return self.rough(0.0);
        }
        let f = self.lens.focal_length;
        let candidates = (0..=SCAN).filter_map(|k| {
            // From a hundredth of f beyond f to ten thousand times f.
            let beyond = f * 10f64.powf(-2.0 + 6.0 * k as f64 / SCAN as f64);
            let mut state = self.rough(f + beyond - self.distances_mm[0])?;
            let weights = self.weights(&state)?;
            let free = [Unknown::D, Unknown::B];
            state = self.descend(state, &weights, &free, SMALL_STEP_OF_START)?;
            let cost = self.rows(&state, &weights, &free)?.cost();
            let possible = state.d > 0.0 && state.b > 0.0 && cost.is_finite();
            possible.then_some((cost, state))
        });
        candidates.min_by(|one, other| one.0.total_cmp(&other.0)).map(|(_, state)| state)
    }

    /// d and b to begin with, for boards shifted by so much (mm).
    fn rough(&self, shift: f64) -> Option<State> {
        let f = self.lens.focal_length;
        let images = self.image_distances(shift, f)?;
        let (n, last) = (&self.resolutions, images.len() - 1);
        let b = match (self.held_b, self.ratio) {
            (Some((b, _)), _) => b,
            // v = d + N b and b = ratio d.
            (None, Some((ratio, _))) => ratio * images[last / 2] / (1.0 + n[last / 2] * ratio),
            (None, None) => (images[last] - images[0]) / (n[last] - n[0]),
        };
        let mean = images.iter().zip(n).map(|(v, n)| v - n * b).sum::<f64>() / images.len() as f64;
        (b.is_finite() && mean.is_finite()).then_some(State { d: mean, b, shift, f })
    }

    /// v of each board, mm; `None` where one has no real image.
    fn image_distances(&self, shift: f64, f: f64) -> Option<Vec<f64>> {
        let lens = MainLens { focal_length: f };
        let real = f > 0.0 && self.distances_mm.iter().all(|l| l + shift > f);
        real.then(|| self.distances_mm.iter().map(|l| lens.image_distance(l + shift)).collect())
    }

    fn weights(&self, state: &State) -> Option<Weights> {
        let images = self.image_distances(state.shift, state.f)?;
        let count = images.len();
        let noise = DMatrix::from_fn(count, count, |i, j| {
            let spacings = self.leverage[i] * self.leverage[j] * self.covariance_px[(i, j)];
            // dv/dL = −(v/L)².
            let slope = (images[i] / (self.distances_mm[i] + state.shift)).powi(2);
            let own = RESOLUTION_SIGMA.powi(2) + (slope * self.each_sigma_mm / state.b).powi(2);
            spacings + if i == j { own } else { 0.0 }
        });
        Some(Weights { noise: noise.cholesky()?, b: state.b })
    }

    fn rows(&self, state: &State, weights: &Weights, free: &[Unknown]) -> Option<Rows> {
        let images = self.image_distances(state.shift, state.f)?;
        let count = images.len();
        let State { d, b, shift, f } = *state;
        let lower = weights.noise.l_dirty();
        // Of d and b alone the equations are a straight line.
        let curved = free.len() > 2;
        let unit = if curved { b } else { weights.b };
        let residuals = DVector::from_vec(self.residuals_mm(state)) / unit;
        let derivatives = DMatrix::from_fn(count, free.len(), |k, j| {
            let derivative = match free[j] {
                Unknown::D => 1.0,
                Unknown::B if curved => (images[k] - d) / b,
                Unknown::B => self.resolutions[k],
                // A board further away has its image nearer, as if d were smaller.
                Unknown::Distance => (images[k] / (self.distances_mm[k] + shift)).powi(2),
                Unknown::FocalLength => -(images[k] / f).powi(2),
            };
            derivative / unit
        });
        let mut residuals: Vec<f64> = lower.solve_lower_triangular(&residuals)?.iter().copied().collect();
        let mut jacobian = lower.solve_lower_triangular(&derivatives)?;
        let mut add = |residual: f64, derivative: &dyn Fn(Unknown) -> f64| {
            let row = jacobian.nrows();
            jacobian.resize_vertically_mut(row + 1, 0.0);
            free.iter().enumerate().for_each(|(j, &unknown)| jacobian[(row, j)] = derivative(unknown));
            residuals.push(residual);
        };
        if let Some((ratio, sigma)) = self.ratio {
            add((ratio - b / d) / sigma, &|unknown| match unknown {
                Unknown::D => -b / (d * d) / sigma,
                Unknown::B => 1.0 / (d * sigma),
                Unknown::Distance | Unknown::FocalLength => 0.0,
            });
        }
        let seen = count + usize::from(self.ratio.is_some());
        let priors = [
            (Unknown::B, self.held_b.map(|(b, sigma)| (b, sigma.max(HELD_SIGMA_MM)))),
            (Unknown::Distance, self.shift.prior_mm().map(|sigma| (0.0, sigma))),
            (Unknown::FocalLength, self.focal_length.prior_mm().map(|sigma| (self.lens.focal_length, sigma))),
        ];
        for (which, prior) in priors {
            let Some((expected, sigma)) = prior else { continue };
            add((expected - state.value(which)) / sigma, &|unknown| if unknown == which { 1.0 / sigma } else { 0.0 });
        }
        let widened = seen + usize::from(self.held_b.is_some());
        Some(Rows { residuals: DVector::from_vec(residuals), jacobian, seen, widened })
    }

    /// The least squares over some of the unknowns, with the boards weighted as they are, to within a step this small.
    fn descend(&self, start: State, weights: &Weights, free: &[Unknown], small: f64) -> Option<State> {
        let mut state = start;
        let mut rows = self.rows(&state, weights, free)?;
        let mut information = Information::new(&rows.jacobian, &rows.residuals)?;
        let mut damping = 0.0;
        for _ in 0..STEPS {
            let (step, length) = information.step(damping);
            let next = state.moved(free, &step);
            match self.rows(&next, weights, free).filter(|next| next.cost() <= rows.cost()) {
                Some(better) => {
                    (state, rows) = (next, better);
                    if length < small {
                        break;
                    }
                    information = Information::new(&rows.jacobian, &rows.residuals)?;
                    damping = if damping < 1e-12 { 0.0 } else { damping / 10.0 };
                }
                None if length < small.max(ROUNDING_STEP) || damping > DAMPING_MAX => break,
                None => damping = (10.0 * damping).max(1e-12),
            }
        }
        Some(state)
    }
}
