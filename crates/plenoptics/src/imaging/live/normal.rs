//! All pairs together: the field's model and its weighted normal equation, in fixed size.

use nalgebra::{SMatrix, SVector};

use super::plan::{Job, Pair, Plan};
use super::score::PairScore;
use crate::imaging::spacing::{self, ASYMMETRY_PX, BLOCKS, Directions, FIELD_TERMS};

/// Unknowns: spacing on the axis, then those by which it departs from that.
pub(super) const TERMS: usize = 1 + spacing::TERMS;
/// Field blocks.
const ALL_BLOCKS: usize = BLOCKS * BLOCKS;

pub(super) type Terms = SVector<f64, TERMS>;
pub(super) type Matrix = SMatrix<f64, TERMS, TERMS>;

/// The spacing over the field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Model {
    pub(super) terms: Terms,
    /// Which terms are unknowns.
    pub(super) free: [bool; TERMS],
}

/// Derivatives of a pair's spacing, along it and across it, with respect to the terms.
#[inline(always)]
fn both(pair: &Pair, directions: &Directions) -> [Terms; 2] {
    let [along, across] = directions.place(pair.midpoint, usize::from(pair.direction)).terms();
    let with = |first: f64, [x, y, square, astigmatism, row_column, diagonal]: [f64; spacing::TERMS]| {
        Terms::from([first, x, y, square, astigmatism, row_column, diagonal])
    };
    [with(1.0, along), with(0.0, across)]
}

/// Derivatives of a pair's spacing along it with respect to the terms.
#[inline(always)]
pub(super) fn derivatives(pair: &Pair, directions: &Directions) -> Terms {
    both(pair, directions)[0]
}

impl Model {
    /// The spacing of a pair along it and across it (90° from +x towards +y), px.
    #[inline(always)]
    pub(super) fn spacing(&self, pair: &Pair, directions: &Directions) -> [f64; 2] {
        let [along, across] = both(pair, directions);
        [self.terms.dot(&along), self.terms.dot(&across)]
    }

    /// The same with the spacing on the axis alone unknown.
    pub(super) fn axis_only(&self) -> Self {
        Self { free: std::array::from_fn(|k| k == 0), ..*self }
    }

    pub(super) fn unknowns(&self) -> usize {
        self.free.iter().filter(|&&free| free).count()
    }
}

/// The normal equation at one state of the model.
#[derive(Debug, Clone)]
pub(super) struct Normal {
    pub(super) information: Matrix,
    gradient: Terms,
    /// Information and gradient of each field block.
    blocks: Vec<(Matrix, Terms)>,
    /// Information about the spacing by lattice direction.
    pub(super) by_direction: [f64; 3],
    /// About what the noise of one grey level makes of the gradient's covariance.
    pub(super) random: Matrix,
    /// Pairs that could be compared.
    pub(super) pairs: usize,
    /// Correlation of the contents, the noise's share of the variances taken out.
    pub(super) correlation: f64,
    /// Variance of the contents beyond the noise's, in units of the noise's.
    pub(super) contrast: f64,
    /// Medians of the pairs' residuals and misfits.
    pub(super) residual: f64,
    pub(super) misfit: f64,
    sorted: Vec<f32>,
}

impl Normal {
    /// Room for so many pairs.
    pub(super) fn new(pairs: usize) -> Self {
        Self {
            information: Matrix::zeros(),
            gradient: Terms::zeros(),
            blocks: vec![(Matrix::zeros(), Terms::zeros()); ALL_BLOCKS],
            by_direction: [0.0; 3],
            random: Matrix::zeros(),
            pairs: 0,
            correlation: 0.0,
            contrast: 0.0,
            residual: 0.0,
            misfit: 0.0,
            sorted: Vec::with_capacity(pairs),
        }
    }

    /// Weight of a pair by how well it matches: pairs that see an edge in depth, a bubble or a reflection count little.
    pub(super) fn weight(&self, score: &PairScore) -> f64 {
        // Four times what is usual is where doubt begins.
        let usual = 4.0 * self.misfit.max(1.0);
        1.0 / (1.0 + (f64::from(score.misfit) / usual).powi(2))
    }

    /// Gathers what the pairs of the jobs said, at a noise of so many grey levels.
    pub(super) fn gather(&mut self, jobs: &[Job], directions: &Directions, model: &Model, noise: f64) {
        self.misfit = self.median(jobs, |score| score.misfit);
        self.residual = self.median(jobs, |score| score.residual);
        self.pairs = self.sorted.len();
        self.by_direction = [0.0; 3];
        self.random = Matrix::zeros();
        self.blocks.fill((Matrix::zeros(), Terms::zeros()));
        let (mut ab, mut aa, mut bb, mut share) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
        let unit = 1.0 / (noise * noise).max(1e-6);
        for (link, score) in jobs.iter().flat_map(|job| job.links().zip(&job.scores)) {
            if !score.compared() {
                continue;
            }
            let pair = &link.pair;
            let weight = self.weight(score) * unit;
            let d = derivatives(pair, directions);
            let information = weight * f64::from(score.information);
            let random = weight * weight * f64::from(score.random);
            let (block, gradient) = &mut self.blocks[usize::from(pair.block)];
            *gradient += d * (weight * f64::from(score.score));
            for i in 0..TERMS {
                for j in 0..=i {
                    let product = d[i] * d[j];
                    block[(i, j)] += information * product;
                    self.random[(i, j)] += random * product;
                }
            }
            self.by_direction[usize::from(pair.direction)] += information;
            ab += f64::from(score.covariance);
            aa += f64::from(score.variances[0]);
            bb += f64::from(score.variances[1]);
            share += f64::from(score.noise);
        }
        (self.information, self.gradient) = (Matrix::zeros(), Terms::zeros());
        self.random.fill_upper_triangle_with_lower_triangle();
        for (block, gradient) in &mut self.blocks {
            block.fill_upper_triangle_with_lower_triangle();
            self.information += &*block;
            self.gradient += &*gradient;
        }
        // Rows and columns of no real array differ by more: where texture tells nothing about it, that is believed.
        for k in (1 + FIELD_TERMS..TERMS).filter(|&k| model.free[k]) {
            let information = ASYMMETRY_PX.powi(-2);
            self.information[(k, k)] += information;
            self.gradient[k] -= information * model.terms[k];
        }
        self.correlation = if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 };
        self.contrast = (aa + bb) / (2.0 * share).max(1e-9);
    }

    fn median(&mut self, jobs: &[Job], value: impl Fn(&PairScore) -> f32) -> f64 {
        self.sorted.clear();
        self.sorted.extend(jobs.iter().flat_map(|job| &job.scores).filter(|s| s.compared()).map(value));
        if self.sorted.is_empty() {
            return 0.0;
        }
        let middle = self.sorted.len() / 2;
        f64::from(*self.sorted.select_nth_unstable_by(middle, f32::total_cmp).1)
    }

    /// The inverse of the information about the free terms, zero for the others; `None` where the pairs do not
    /// determine every one.
    pub(super) fn inverse(&self, free: &[bool; TERMS]) -> Option<Matrix> {
        let mut information = self.information;
        for k in (0..TERMS).filter(|&k| !free[k]) {
            information.row_mut(k).fill(0.0);
            information.column_mut(k).fill(0.0);
            information[(k, k)] = 1.0;
        }
        let mut inverse = information.cholesky()?.inverse();
        for k in (0..TERMS).filter(|&k| !free[k]) {
            inverse[(k, k)] = 0.0;
        }
        inverse.iter().all(|v| v.is_finite()).then_some(inverse)
    }

    /// The step to the root of the gradient.
    pub(super) fn step(&self, inverse: &Matrix) -> Terms {
        inverse * self.gradient
    }

    /// Covariance of the terms after `step` from the scatter of the gradient between field blocks: noise, and what the
    /// model cannot explain.
    pub(super) fn scatter(&self, inverse: &Matrix, step: &Terms, unknowns: usize) -> Matrix {
        let mut middle = Matrix::zeros();
        let mut blocks = 0usize;
        for (information, gradient) in self.blocks.iter().filter(|(_, g)| g.iter().any(|v| *v != 0.0)) {
            let left = gradient - information * step;
            middle += left * left.transpose();
            blocks += 1;
        }
        let spare = blocks.saturating_sub(unknowns).max(1) as f64;
        inverse * middle * inverse * (blocks as f64 / spare)
    }

    /// The information about the spacing over its standard error, from the scatter between field blocks: how sure it is
    /// that there is texture at all.
    pub(super) fn texture_significance(&self) -> f64 {
        let (sum, squares) =
            self.blocks.iter().map(|(i, _)| i[(0, 0)]).fold((0.0, 0.0), |(s, q), v| (s + v, q + v * v));
        if squares > 0.0 { sum / squares.sqrt() } else { 0.0 }
    }
}

/// Which terms are unknowns. Directions of a plan are told apart by the cosine's term, three directions also by the sine's:
/// pairs are compared along themselves only.
pub(super) fn free_terms(plan: &Plan, field_held: bool, difference_held: bool) -> [bool; TERMS] {
    let field = !field_held;
    [true, field, field, field, true, !difference_held, !difference_held && plan.direction_count == 3]
}

#[cfg(test)]
mod tests {
    use super::super::plan::{Link, Row};
    use super::*;
    use crate::imaging::grid::Grid;
    use crate::optics::ArrayKind;

    fn directions() -> Directions {
        let basis = [[20.0, 1.0], [10.0 - 0.866_025_4, 17.320_508 + 0.5]];
        Directions::new(&Grid::affine(ArrayKind::Hexagonal, [200.0, 200.0], basis, [400, 400]))
    }

    fn pair(x: f64, y: f64, direction: u8, block: u8) -> Pair {
        Pair { first: 0, second: 1, unit: [1.0, 0.0], midpoint: [x, y], direction, block }
    }

    #[test]
    fn the_step_leads_to_the_terms_that_made_the_scores() {
        let truth = Terms::from([0.02, -0.01, 0.005, 0.03, 0.008, 0.004, -0.006]);
        let (mut links, mut scores) = (Vec::new(), Vec::new());
        for k in 0..360u32 {
            let (x, y) = (f64::from(k % 20) / 10.0 - 0.95, f64::from(k / 20) / 9.0 - 0.95);
            let pair = pair(x, y, (k % 3) as u8, (k % 36) as u8);
            let information = 50.0 + f64::from(k % 7);
            let score = information * truth.dot(&derivatives(&pair, &directions()));
            links.push(Link { pair, slots: [0, 1] });
            scores.push(PairScore {
                score: score as f32,
                information: information as f32,
                misfit: 0.9,
                covariance: 90.0,
                variances: [100.0, 100.0],
                noise: 10.0,
                ..PairScore::default()
            });
        }
        scores[7] = PairScore::NONE;
        let job = Job { rows: vec![Row { tiles: Vec::new(), links }], slots: 2, scores };
        let mut normal = Normal::new(360);
        // As if the terms were known beforehand: what arrays are like pulls at nothing.
        let model = Model { terms: Terms::zeros(), free: [false; TERMS] };
        normal.gather(&[job], &directions(), &model, 2.0);
        assert_eq!(normal.pairs, 359);
        assert!((normal.correlation - 0.9).abs() < 1e-9 && (normal.contrast - 10.0).abs() < 1e-6);
        let inverse = normal.inverse(&[true; TERMS]).unwrap();
        let step = normal.step(&inverse);
        assert!((step - truth).abs().max() < 1e-6, "{step}");
        // Nothing is left to scatter once the step is made.
        assert!(normal.scatter(&inverse, &step, TERMS).abs().max() < 1e-12);
        // A term that is held does not move, and has no variance.
        let held = normal.inverse(&[true, true, true, false, true, true, true]).unwrap();
        assert_eq!(normal.step(&held)[3], 0.0);
        assert_eq!(held[(3, 3)], 0.0);
    }

    #[test]
    fn pairs_that_match_badly_count_little() {
        let mut normal = Normal::new(1);
        normal.misfit = 0.5;
        let weight = |misfit| normal.weight(&PairScore { misfit, ..PairScore::default() });
        assert!(weight(0.5) > 0.98 && weight(4.0) == 0.5 && weight(40.0) < 0.01);
    }
}
