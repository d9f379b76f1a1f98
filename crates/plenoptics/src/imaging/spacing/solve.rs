//! All pairs together: one weighted normal equation for the spacing of each region and the terms they share.

use nalgebra::{DMatrix, DVector};

use super::frame::{Pair, SpacingFrame};
use super::model::Model;
use super::score::{BLOCKS, PairScore, correlation, score_pairs};

/// The normal equation of all pairs of all frames, at one state of the model.
#[derive(Debug)]
pub(super) struct Normal {
    pub(super) information: DMatrix<f64>,
    gradient: DVector<f64>,
    /// Gradients by field block, each frame apart.
    block_gradients: Vec<DVector<f64>>,
    /// Information about the spacing by field block.
    block_information: Vec<f64>,
    /// Information about the spacing by lattice direction.
    pub(super) by_direction: [f64; 3],
    pub(super) correlation: f64,
    /// Median residual of the pairs in units of what noise alone would leave.
    pub(super) residual: f64,
    /// Pairs in each region.
    pub(super) region_pairs: Vec<usize>,
    /// What each pair of each frame says.
    pub(super) scores: Vec<Vec<PairScore>>,
}

impl Normal {
    pub(super) fn of(frames: &[SpacingFrame], subsets: Option<&[Vec<Pair>]>, model: &Model) -> Self {
        let n = model.unknowns();
        let mut normal = Self {
            information: DMatrix::zeros(n, n),
            gradient: DVector::zeros(n),
            block_gradients: vec![DVector::zeros(n); BLOCKS * BLOCKS * frames.len()],
            block_information: vec![0.0; BLOCKS * BLOCKS * frames.len()],
            by_direction: [0.0; 3],
            correlation: 0.0,
            residual: 0.0,
            region_pairs: vec![0; model.spacings.len()],
            scores: Vec::with_capacity(frames.len()),
        };
        let mut derivatives = [vec![0.0; n], vec![0.0; n]];
        for (k, frame) in frames.iter().enumerate() {
            let pairs = subsets.map_or(&frame.pairs, |s| &s[k]);
            let scores = score_pairs(frame, pairs, model);
            for score in &scores {
                // Frames of other noise or depth weigh by what their noise allows.
                let weight = score.weight / model.noise(frame).powi(2).max(1e-6);
                model.derivatives(score.region, &score.place, &mut derivatives);
                let block = k * BLOCKS * BLOCKS + score.block;
                let [along, across] = &derivatives;
                let rows = [along, across];
                for i in 0..n {
                    let part = weight * (score.score[0] * along[i] + score.score[1] * across[i]);
                    normal.gradient[i] += part;
                    normal.block_gradients[block][i] += part;
                    for j in 0..n {
                        for (row, information) in rows.iter().zip(score.information) {
                            normal.information[(i, j)] +=
                                weight * row[i] * (information[0] * along[j] + information[1] * across[j]);
                        }
                    }
                }
                normal.block_information[block] += weight * score.information[0][0];
                normal.by_direction[score.pair.direction.min(2)] += weight * score.information[0][0];
                normal.region_pairs[score.region] += 1;
            }
            normal.scores.push(scores);
        }
        for (unknown, information) in model.prior() {
            normal.information[(unknown, unknown)] += information;
            normal.gradient[unknown] -= information * model.value(unknown);
        }
        let all = || normal.scores.iter().flatten();
        normal.correlation = correlation(all().map(|score| &score.content));
        let mut residuals: Vec<f64> = all().map(|score| score.residual).collect();
        if !residuals.is_empty() {
            let middle = residuals.len() / 2;
            normal.residual = *residuals.select_nth_unstable_by(middle, f64::total_cmp).1;
        }
        normal
    }

    /// The step to the root of the gradient; `None` where the data do not determine it.
    pub(super) fn step(&self) -> Option<DVector<f64>> {
        self.inverse().map(|inverse| inverse * &self.gradient)
    }

    /// The inverse of the information, which is positive definite where the data determine every unknown.
    pub(super) fn inverse(&self) -> Option<DMatrix<f64>> {
        let symmetric = (&self.information + self.information.transpose()) * 0.5;
        symmetric.cholesky().map(|c| c.inverse())
    }

    /// Covariance of the unknowns from the scatter of the gradient between field blocks: noise, and what the model
    /// cannot explain.
    pub(super) fn scatter(&self, inverse: &DMatrix<f64>) -> DMatrix<f64> {
        let n = self.gradient.len();
        let mut middle = DMatrix::zeros(n, n);
        let mut blocks = 0usize;
        for gradient in self.block_gradients.iter().filter(|g| g.iter().any(|v| *v != 0.0)) {
            middle += gradient * gradient.transpose();
            blocks += 1;
        }
        let spare = blocks.saturating_sub(n).max(1) as f64;
        inverse * middle * inverse * (blocks as f64 / spare)
    }

    /// The information about the spacing over its standard error, from the scatter between field blocks: how sure it is
    /// that there is texture at all.
    pub(super) fn texture_significance(&self) -> f64 {
        let (sum, squares) = self.block_information.iter().fold((0.0, 0.0), |(s, q), &v| (s + v, q + v * v));
        if squares > 0.0 { sum / squares.sqrt() } else { 0.0 }
    }
}

/// How an iteration ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// The last step was far below any noise.
    Converged,
    /// The data do not determine the unknowns.
    Undetermined,
    /// It ran away from its start, or did not settle.
    Lost,
}

/// Shortens steps that go to and fro.
///
/// Pairs are weighed by how well they match: where one of them is in doubt, steps may lead for ever from a state with it
/// to one without and back. From half of the iterations on every step back has all that follow taken half as long.
#[derive(Debug)]
struct Damping {
    iterations: usize,
    done: usize,
    factor: f64,
    before: Option<DVector<f64>>,
}

impl Damping {
    const fn new(iterations: usize) -> Self {
        Self { iterations, done: 0, factor: 1.0, before: None }
    }

    /// The next step, as long as it is to be.
    fn damped(&mut self, step: DVector<f64>) -> DVector<f64> {
        let back = self.before.as_ref().is_some_and(|before| before.dot(&step) < 0.0);
        if back && 2 * self.done >= self.iterations {
            self.factor *= 0.5;
        }
        self.done += 1;
        let damped = &step * self.factor;
        self.before = Some(step);
        damped
    }
}

/// Iterates to the root of the gradient, at most `reach` px from the start. The normal equation that it leaves is the one
/// before the last step, which is shorter than `tolerance` (px).
pub(super) fn iterate(
    frames: &[SpacingFrame],
    subsets: Option<&[Vec<Pair>]>,
    model: &mut Model,
    reach: f64,
    tolerance: f64,
    iterations: usize,
) -> (Outcome, Normal) {
    let start = model.spacings.clone();
    let mut normal = Normal::of(frames, subsets, model);
    let mut damping = Damping::new(iterations);
    for _ in 0..iterations {
        let Some(step) = normal.step() else { return (Outcome::Undetermined, normal) };
        let mut step = damping.damped(step);
        let largest = step.amax();
        if !largest.is_finite() {
            return (Outcome::Undetermined, normal);
        }
        // Matching is linear over about a pixel: a longer step is only a direction.
        if largest > 1.0 {
            step /= largest;
        }
        model.advance(&step);
        if model.spacings.iter().zip(&start).any(|(now, then)| (now - then).abs() > reach) {
            return (Outcome::Lost, normal);
        }
        if largest < tolerance {
            return (Outcome::Converged, normal);
        }
        normal = Normal::of(frames, subsets, model);
    }
    (Outcome::Lost, normal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_to_and_fro_are_shortened_and_others_are_not() {
        let step = |x: f64| DVector::from_vec(vec![x, 0.1 * x]);
        let mut damping = Damping::new(20);
        for k in 0..10 {
            let there = if k % 2 == 0 { 1.0 } else { -1.0 };
            assert_eq!(damping.damped(step(there)), step(there), "the first half of the iterations is free");
        }
        let lengths: Vec<f64> =
            (0..8).map(|k| damping.damped(step(if k % 2 == 0 { 1.0 } else { -1.0 })).amax()).collect();
        assert_eq!(lengths[..3], [0.5, 0.25, 0.125]);
        assert!(lengths[7] < 0.005, "{lengths:?}");
        let mut damping = Damping::new(4);
        for _ in 0..4 {
            assert_eq!(damping.damped(step(0.3)), step(0.3));
        }
    }
}
