//! All pairs together: one weighted normal equation for the spacing of each region and the terms they share.

use std::slice;

use nalgebra::{DMatrix, DVector, SMatrix};

use super::model::{BLOCKS, LOCAL, Local, Model, WIDE_TERMS};
use super::plan::Job;
use super::score::{Contents, PairScore};
use crate::imaging::spacing::SpacingError;

/// Fewer pairs than this leave nothing to tell scatter from.
pub const LEAST_PAIRS: usize = 24;
/// Correlation of neighbours below which they do not show the same thing.
pub(in crate::imaging) const LEAST_CORRELATION: f64 = 0.6;
/// Median residual, in units of what a right noise estimate would leave, of pairs that match.
const USUAL_RESIDUAL: f64 = 0.8;
/// Squared standard uncertainties, on the mean, that terms of a wide field have to stand above none: four.
const LEAST_DEMAND: f64 = 16.0;
/// Texture that is surer than this is there.
const LEAST_SIGNIFICANCE: f64 = 4.0;
/// Share of an unknown's standard uncertainty below which a step is none: in quadrature it adds a thousandth.
const NOTHING: f64 = 0.05;
/// Standard uncertainty (px) of a spacing up to which it can be settled that way: far from focus, in noise, single frames of
/// few micro-images have up to 0.15, frames that show no board at all 0.3.
const SETTLED_SIGMA_PX: f64 = 0.2;
/// Pairs that leave so many times what they may, or what the lower quartile leaves, are odd ones; and the share of them from
/// which on all are weighed strictly as well. Clean frames have up to 0.005; with 12 bubbles they have 0.09, with 20 in strong
/// noise 0.04 and more.
const ODD: f64 = 4.0;
const LEAST_ODD: f64 = 0.02;
/// Misfit at which a pair strictly weighed counts half, in units of the lower quartile's. Sharp edges leave so many times as
/// much as other contents.
const STRICT: f64 = 1.5;
const STRICT_LIMITS: f32 = 3.5;
/// Share of the information that strict weights have to leave.
const LEAST_LEFT: f64 = 0.2;
/// Share of what strict weights change that stays uncertain.
const PULL_LEFT: f64 = 0.2;
/// Field blocks of a frame.
const FRAME_BLOCKS: usize = BLOCKS * BLOCKS;

pub(in crate::imaging) type LocalMatrix = SMatrix<f64, LOCAL, LOCAL>;

/// What the pairs of one region in one field block of one frame say.
#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    information: LocalMatrix,
    gradient: Local,
    /// About what the noise of one grey level makes of the gradient's covariance.
    random: LocalMatrix,
}

/// How pairs are weighed by how well they match.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Weighing {
    /// Those that do not match at all count little: the way from afar is found by this, and a frame judged.
    #[default]
    Lenient,
    /// Those that match less than most count next to nothing.
    Strict,
}

/// What strict weights change of a fit.
#[derive(Debug, Clone)]
pub(in crate::imaging) struct Refined {
    /// By what the unknowns change.
    pub(in crate::imaging) change: DVector<f64>,
    /// Their covariance, from the scatter between field blocks and from the change.
    pub(in crate::imaging) covariance: DMatrix<f64>,
    /// By what the first unknown's standard uncertainty from noise is multiplied.
    pub(in crate::imaging) noise: f64,
}

/// The normal equation at one state of the model.
#[derive(Debug, Clone, Default)]
pub(in crate::imaging) struct Normal {
    information: DMatrix<f64>,
    gradient: DVector<f64>,
    /// By frame, region and field block.
    cells: Vec<Cell>,
    regions: usize,
    /// Information about the spacing by lattice direction.
    by_direction: [f64; 3],
    /// Pairs of each region that could be compared.
    pub(in crate::imaging) region_pairs: Vec<usize>,
    /// Sums of the pairs' information about the spacing, and of its squares.
    texture: [f64; 2],
    /// What the pairs' contents have in common.
    pub(in crate::imaging) contents: Contents,
    /// Median of the pairs' residuals.
    pub(in crate::imaging) residual: f64,
    weighing: Weighing,
    /// The misfit at which a pair counts half, by frame.
    halves: Vec<f64>,
    sorted: Vec<f32>,
}

/// The pairs of one frame, compared.
#[derive(Debug, Clone, Copy)]
pub(in crate::imaging) struct Compared<'a> {
    pub(in crate::imaging) jobs: &'a [Job],
    /// Noise that they were compared at, grey levels.
    pub(in crate::imaging) noise: f64,
}

impl Normal {
    /// Weight of a pair of a frame by how well it matches: pairs that see an edge in depth, a bubble or a reflection
    /// count little.
    pub(in crate::imaging) fn weight(&self, frame: usize, score: &PairScore) -> f64 {
        let (misfit, power) = match self.weighing {
            Weighing::Lenient => (score.misfit, 2),
            Weighing::Strict => (score.misfit_with_limits(STRICT_LIMITS), 8),
        };
        1.0 / (1.0 + (f64::from(misfit) / self.halves[frame]).powi(power))
    }

    /// What changes where the pairs of frames that were gathered at a state of the model, and accepted by that, are weighed
    /// strictly. `None` where hardly any is odd, or where too little would be left.
    ///
    /// A bubble that covers a part of a micro-image, or blurs its edge over it, has pairs match a little worse and pulls them
    /// all to one side. Whether there is a spacing at all is no question for strict weights: of pairs that match by chance
    /// they leave the best.
    pub(in crate::imaging) fn refined(&self, frames: &[Compared<'_>], model: &Model) -> Option<Refined> {
        let mut strict = Self { weighing: Weighing::Strict, ..Self::default() };
        let (mut odd, mut pairs) = (0, 0);
        for frame in frames {
            let usual = strict.usual(frame).max(1.0);
            odd += strict.sorted.iter().filter(|&&misfit| f64::from(misfit) > ODD * usual).count();
            pairs += strict.sorted.len();
        }
        if (odd as f64) < LEAST_ODD * pairs as f64 {
            return None;
        }
        strict.gather(frames, model);
        if strict.texture[0] < LEAST_LEFT * self.texture[0] {
            return None;
        }
        let [before, inverse] = [self.inverse()?, strict.inverse()?];
        let step = strict.step(&inverse);
        let change = &step - self.step(&before);
        let mut covariance = strict.scatter(model, &inverse, &step);
        covariance.ger(PULL_LEFT * PULL_LEFT, &change, &change, 1.0);
        let noise = |normal: &Self, inverse: &DMatrix<f64>| -> f64 {
            let along = model.local(&inverse.column(0).into_owned(), 0);
            let of = |(k, frame): (usize, &Compared<'_>)| normal.random(k, 0, &along) * frame.noise.powi(2);
            frames.iter().enumerate().map(of).sum()
        };
        let noise = (noise(&strict, &inverse) / noise(self, &before)).sqrt();
        Some(Refined { change, covariance, noise })
    }

    /// Gathers what the pairs of all frames said at a state of the model.
    pub(in crate::imaging) fn gather(&mut self, frames: &[Compared<'_>], model: &Model) {
        self.regions = model.spacings.len();
        self.cells.clear();
        self.cells.resize(frames.len() * self.regions * FRAME_BLOCKS, Cell::default());
        (self.by_direction, self.texture) = ([0.0; 3], [0.0; 2]);
        self.region_pairs.clear();
        self.region_pairs.resize(self.regions, 0);
        self.contents = Contents::default();
        self.halves.clear();
        for frame in frames {
            let usual = self.usual(frame);
            self.halves.push(match self.weighing {
                // Four times what is usual is where doubt begins.
                Weighing::Lenient => 4.0 * usual.max(1.0),
                Weighing::Strict => STRICT * usual,
            });
        }
        self.residual = self.quantile(frames, 0.5, |score| score.residual);
        for (k, frame) in frames.iter().enumerate() {
            self.add(k, frame, model);
        }
        for cell in &mut self.cells {
            cell.information.fill_upper_triangle_with_lower_triangle();
            cell.random.fill_upper_triangle_with_lower_triangle();
        }
        (self.information, self.gradient) = self.assembled(model);
    }

    fn add(&mut self, k: usize, frame: &Compared<'_>, model: &Model) {
        // Frames of other noise or depth weigh by what their noise allows.
        let unit = 1.0 / (frame.noise * frame.noise).max(1e-6);
        for (link, score) in frame.jobs.iter().flat_map(|job| job.links().zip(&job.scores)) {
            if !score.compared() {
                continue;
            }
            let pair = &link.pair;
            let region = usize::from(pair.region);
            let weight = self.weight(k, score) * unit;
            let [along, across] = model.derivatives(region, &pair.place);
            let [[ii, ij], [ji, jj]] = score.information.map(|row| row.map(f64::from));
            let [si, sj] = score.score.map(|score| weight * f64::from(score));
            let [ei, ej] = score.energy.map(|energy| weight * weight * f64::from(energy));
            let cell = &mut self.cells[(k * self.regions + region) * FRAME_BLOCKS + usize::from(pair.block)];
            cell.gradient += along * si + across * sj;
            // Only the symmetric part of the information is any.
            let mixed = 0.5 * (ij + ji);
            for i in 0..LOCAL {
                let by_along = weight * (ii * along[i] + mixed * across[i]);
                let by_across = weight * (mixed * along[i] + jj * across[i]);
                for j in 0..=i {
                    cell.information[(i, j)] += by_along * along[j] + by_across * across[j];
                    cell.random[(i, j)] += ei * along[i] * along[j] + ej * across[i] * across[j];
                }
            }
            self.by_direction[usize::from(pair.direction)] += weight * ii;
            self.texture[0] += weight * ii;
            self.texture[1] += (weight * ii).powi(2);
            self.region_pairs[region] += 1;
            self.contents.add(&score.content);
        }
    }

    /// Information and gradient of all cells for the unknowns of a model.
    fn assembled(&self, model: &Model) -> (DMatrix<f64>, DVector<f64>) {
        let n = model.unknowns();
        let (mut information, mut gradient) = (DMatrix::zeros(n, n), DVector::zeros(n));
        for (k, cell) in self.cells.iter().enumerate() {
            let region = k / FRAME_BLOCKS % self.regions;
            for (i, at) in (0..LOCAL).filter_map(|i| Some((i, model.unknown(region, i)?))) {
                gradient[at] += cell.gradient[i];
                for (j, to) in (0..LOCAL).filter_map(|j| Some((j, model.unknown(region, j)?))) {
                    information[(at, to)] += cell.information[(i, j)];
                }
            }
        }
        for (unknown, prior) in model.prior() {
            information[(unknown, unknown)] += prior;
            gradient[unknown] -= prior * model.value(unknown);
        }
        (information, gradient)
    }

    /// The unknowns that the field demands beside those of a model: where a wide field is not of the usual shape, the
    /// first of [`WIDE_TERMS`] that are not free yet.
    pub(in crate::imaging) fn demanded(&self, model: &Model) -> Option<Vec<usize>> {
        let more = WIDE_TERMS.iter().find(|more| !more.iter().all(|term| model.free.contains(term)))?;
        let wider = Model { free: [&model.free[..], more].concat(), ..model.clone() };
        let (information, gradient) = self.assembled(&wider);
        let inverse = information.cholesky()?.inverse();
        let step = &inverse * gradient;
        let first = model.unknowns();
        let covariance = self.scatter(&wider, &inverse, &step);
        let covariance = covariance.view((first, first), (more.len(), more.len())).into_owned();
        let step = step.rows(first, more.len()).into_owned();
        let significance = step.dot(&(covariance.cholesky()?.inverse() * &step));
        (significance > LEAST_DEMAND * more.len() as f64).then_some(wider.free)
    }

    /// What most pairs of a frame leave at most; strictly, what the best leave.
    fn usual(&mut self, frame: &Compared<'_>) -> f64 {
        match self.weighing {
            Weighing::Lenient => self.quantile(slice::from_ref(frame), 0.5, |score| score.misfit),
            Weighing::Strict => {
                self.quantile(slice::from_ref(frame), 0.25, |score| score.misfit_with_limits(STRICT_LIMITS))
            }
        }
    }

    fn quantile(&mut self, frames: &[Compared<'_>], share: f64, value: impl Fn(&PairScore) -> f32) -> f64 {
        let scores = frames.iter().flat_map(|frame| frame.jobs).flat_map(|job| &job.scores);
        self.sorted.clear();
        self.sorted.extend(scores.filter(|score| score.compared()).map(value));
        if self.sorted.is_empty() {
            return 0.0;
        }
        let place = (share * self.sorted.len() as f64) as usize;
        f64::from(*self.sorted.select_nth_unstable_by(place, f32::total_cmp).1)
    }

    /// The inverse of the information, which is positive definite where the pairs determine every unknown.
    pub(in crate::imaging) fn inverse(&self) -> Option<DMatrix<f64>> {
        let inverse = self.information.clone().cholesky()?.inverse();
        inverse.iter().all(|v| v.is_finite()).then_some(inverse)
    }

    /// The step to the root of the gradient.
    pub(in crate::imaging) fn step(&self, inverse: &DMatrix<f64>) -> DVector<f64> {
        inverse * &self.gradient
    }

    /// Whether an iteration has come as near to its end as there is any, though its steps do not vanish: this one is nothing to
    /// what its unknowns are uncertain by. Of one that was shortened, what it stands for (`whole`) is within that. Where little
    /// matches, what the unknowns are uncertain by is so much that any step is, and nothing is settled.
    pub(in crate::imaging) fn is_settled(
        &self,
        model: &Model,
        inverse: &DMatrix<f64>,
        step: &DVector<f64>,
        whole: &DVector<f64>,
    ) -> bool {
        let covariance = self.scatter(model, inverse, step);
        let within = |share: f64, step: &DVector<f64>| {
            step.iter().zip(covariance.diagonal().iter()).all(|(step, variance)| step.abs() <= share * variance.sqrt())
        };
        covariance[(0, 0)].sqrt() <= SETTLED_SIGMA_PX && within(NOTHING, step) && (step == whole || within(1.0, whole))
    }

    /// Covariance of the unknowns after `step` from the scatter of the gradient between field blocks: noise, and what the
    /// model cannot explain.
    pub(in crate::imaging) fn scatter(
        &self,
        model: &Model,
        inverse: &DMatrix<f64>,
        step: &DVector<f64>,
    ) -> DMatrix<f64> {
        let n = model.unknowns();
        let mut middle = DMatrix::zeros(n, n);
        for frame in self.cells.chunks_exact(self.regions * FRAME_BLOCKS) {
            for block in 0..FRAME_BLOCKS {
                let mut left = DVector::zeros(n);
                for (region, cell) in frame.iter().skip(block).step_by(FRAME_BLOCKS).enumerate() {
                    let rest = cell.gradient - cell.information * model.local(step, region);
                    for (i, at) in (0..LOCAL).filter_map(|i| Some((i, model.unknown(region, i)?))) {
                        left[at] += rest[i];
                    }
                }
                middle.ger(1.0, &left, &left, 1.0);
            }
        }
        inverse * middle * inverse * (self.filled() as f64 / self.spare(n).max(1) as f64)
    }

    /// Field blocks that pairs are in, over all frames.
    fn filled(&self) -> usize {
        let filled = |frame: &[Cell], block: usize| {
            frame.iter().skip(block).step_by(FRAME_BLOCKS).any(|cell| cell.gradient.iter().any(|v| *v != 0.0))
        };
        let frames = self.cells.chunks_exact(self.regions * FRAME_BLOCKS);
        frames.map(|frame| (0..FRAME_BLOCKS).filter(|&block| filled(frame, block)).count()).sum()
    }

    /// How many more of them there are than unknowns.
    pub(in crate::imaging) fn spare(&self, unknowns: usize) -> usize {
        self.filled().saturating_sub(unknowns)
    }

    /// About what the noise of one grey level makes of the variance of a combination of the unknowns of a region in a
    /// frame.
    pub(in crate::imaging) fn random(&self, frame: usize, region: usize, along: &Local) -> f64 {
        let cells = &self.cells[(frame * self.regions + region) * FRAME_BLOCKS..][..FRAME_BLOCKS];
        cells.iter().map(|cell| along.dot(&(cell.random * along))).sum()
    }

    /// Refuses pairs that tell nothing, or on a lattice of so many directions the spacing along one of them only, at a
    /// noise of so many grey levels.
    pub(in crate::imaging) fn check_texture(&self, noise: f64, directions: usize) -> Result<(), SpacingError> {
        if self.texture_significance() < LEAST_SIGNIFICANCE {
            return Err(SpacingError::NoTexture { noise });
        }
        let total: f64 = self.by_direction.iter().sum();
        // Three directions of a hexagonal array never go blind to one texture together; two of a square array do.
        if directions == 2 {
            for (direction, along_rows) in [(1, true), (0, false)] {
                if self.by_direction[direction] < 0.01 * total {
                    return Err(SpacingError::OneDirection { along_rows });
                }
            }
        }
        Ok(())
    }

    /// The information about the spacing over what pairs without texture would scatter about none: noise makes as much of
    /// it negative as positive.
    fn texture_significance(&self) -> f64 {
        let [sum, squares] = self.texture;
        if squares > 0.0 { sum / squares.sqrt() } else { 0.0 }
    }
}

/// Noise in units of the frames' own estimate, at which the pairs' residuals are what they usually are: those here are at
/// a noise in the unit `scale`.
pub(in crate::imaging) fn noise_scale(scale: f64, residual: f64) -> f64 {
    (scale * scale * residual / USUAL_RESIDUAL).clamp(0.01, 1.0).sqrt()
}

#[cfg(test)]
mod tests;
