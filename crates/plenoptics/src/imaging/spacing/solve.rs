//! Frames and pairs, compared at state after state of a model until it fits.

use nalgebra::{DMatrix, DVector};

use super::frame::SpacingFrame;
use crate::imaging::matching::compare::BOTH;
use crate::imaging::matching::damping::Damping;
use crate::imaging::matching::model::Model;
use crate::imaging::matching::normal::{Compared, Normal};
use crate::imaging::matching::plan::Job;
use crate::imaging::matching::random::{Random, Setting};
use crate::imaging::matching::run::{Pool, run};

/// Micro-images of a frame that the uncertainty by noise is told from.
const SAMPLED: usize = 256;

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

/// Pairs of frames, and how they are compared.
pub(super) struct Solver<'a> {
    pub(super) frames: &'a [SpacingFrame],
    /// The pairs of each frame, with what they said last.
    pub(super) jobs: Vec<Vec<Job>>,
    /// Radius of the masks in each frame, px.
    pub(super) radii: Vec<f64>,
    /// Noise in units of the frames' own estimates, which sharp texture makes too large.
    pub(super) noise_scale: f64,
    pub(super) normal: Normal,
    pool: Pool,
}

impl<'a> Solver<'a> {
    /// With masks of full size.
    pub(super) fn new(frames: &'a [SpacingFrame], jobs: Vec<Vec<Job>>) -> Self {
        let radii = frames.iter().map(SpacingFrame::largest_radius).collect();
        Self { frames, jobs, radii, noise_scale: 1.0, normal: Normal::default(), pool: Pool::default() }
    }

    /// Takes masks for the spacings of a model.
    pub(super) fn mask(&mut self, model: &Model) {
        self.radii = self.frames.iter().map(|frame| frame.radius_for(&model.spacings)).collect();
    }

    /// Compares once more at a noise in this unit of the frames' own estimates.
    pub(super) fn at_noise(&mut self, scale: f64, model: &Model) {
        self.noise_scale = scale;
        self.compare(model);
    }

    fn compare(&mut self, model: &Model) {
        for ((frame, jobs), &radius) in self.frames.iter().zip(&mut self.jobs).zip(&self.radii) {
            frame.at(model, radius, self.noise_scale, |pass| run::<_, BOTH>(pass, jobs, &self.pool));
        }
        let mut normal = std::mem::take(&mut self.normal);
        normal.gather(&self.compared().collect::<Vec<_>>(), model);
        self.normal = normal;
    }

    /// The pairs of each frame, with what they said last.
    pub(super) fn compared(&self) -> impl Iterator<Item = Compared<'_>> {
        let noise = |frame: &SpacingFrame| frame.noise(self.noise_scale);
        self.frames.iter().zip(&self.jobs).map(move |(frame, jobs)| Compared { jobs, noise: noise(frame) })
    }

    /// Iterates to the root of the gradient, at most `reach` px from the start. The normal equation that it leaves is the
    /// one before the last step, which is shorter than `tolerance` (px), or nothing to what the unknowns are uncertain by.
    pub(super) fn iterate(&mut self, model: &mut Model, reach: f64, tolerance: f64, iterations: usize) -> Outcome {
        let start = model.spacings.clone();
        self.compare(model);
        let mut damping = Damping::new(iterations);
        for _ in 0..iterations {
            let Some(inverse) = self.normal.inverse() else { return Outcome::Undetermined };
            let whole = self.normal.step(&inverse);
            let mut step = damping.damped(&whole);
            let largest = step.amax();
            if !largest.is_finite() {
                return Outcome::Undetermined;
            }
            // Matching is linear over about a pixel: a longer step is only a direction.
            if largest > 1.0 {
                step /= largest;
            }
            let before = model.clone();
            model.advance(&step);
            if model.spacings.iter().zip(&start).any(|(now, then)| (now - then).abs() > reach) {
                return Outcome::Lost;
            }
            if largest < tolerance || self.normal.is_settled(&before, &inverse, &step, &whole) {
                return Outcome::Converged;
            }
            self.compare(model);
        }
        Outcome::Lost
    }

    /// Variance that pixel noise alone gives an unknown, px², `inverse` being that of the information.
    pub(super) fn noise_variance(&self, model: &Model, inverse: &DMatrix<f64>, unknown: usize) -> f64 {
        let along: DVector<f64> = inverse.column(unknown).into_owned();
        let of = |k: usize, frame: &SpacingFrame| {
            frame.at(model, self.radii[k], self.noise_scale, |pass| {
                let jobs = &self.jobs[k];
                let setting = Setting { pass, jobs, normal: &self.normal, frame: k };
                Random::new(&frame.plan, jobs, SAMPLED).variance::<_, BOTH>(&setting, &along, true)
            })
        };
        self.frames.iter().enumerate().map(|(k, frame)| of(k, frame)).sum()
    }
}
