//! All pairs together: one weighted normal equation for the spacing of each region and the field terms they share.
//!
//! Matching is inverse-compositional: the slope comes from the un-interpolated reference, so the fixed point does not
//! depend on how interpolation treats noise. A pair's score is Σ w T (A − g B − h), T the reference's slope along the
//! pair made orthogonal to the pair's gain and offset; its derivative with respect to the spacing is taken against the
//! *neighbour's* slope, whose noise is independent of the reference's: gradient energy without the noise's share.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::frame::{MASK_FRACTION, Pair, SpacingFrame};
use super::patch::{PairSums, Patch};

/// Field terms: tilt along x and y, curvature.
pub(super) const FIELD_TERMS: usize = 3;
/// Field blocks along each side of a frame, for the scatter between regions.
const BLOCKS: usize = 6;

/// What interpolation, vignetting and the pixels' own area leave of a content's energy where two micro-images do show the
/// same: no sign of a mismatch.
const MODEL_SHARE: f64 = 0.002;
/// Standard deviation of a grey level's rounding: no frame has less noise.
const QUANTISATION: f64 = 0.288_675;

/// Unknowns: a spacing for each region, then (where they are free) tilt x, tilt y and curvature.
#[derive(Debug, Clone)]
pub(super) struct Model {
    /// How strongly the field terms act in each region; as many as there are regions.
    pub(super) scales: Vec<f64>,
    /// Spacing on the axis in each region, px.
    pub(super) spacings: Vec<f64>,
    /// Tilt x, tilt y, curvature, px per half frame width (squared).
    pub(super) field: [f64; FIELD_TERMS],
    /// Whether the field terms are unknowns.
    pub(super) field_free: bool,
    /// Radius of the masks, in units of half the micro-image pitch.
    pub(super) mask: f64,
    /// Noise in units of the frames' own estimates, which sharp texture makes too large.
    pub(super) noise_scale: f64,
}

impl Model {
    /// One spacing everywhere, and masks of full size.
    pub(super) fn flat(spacings: Vec<f64>) -> Self {
        let scales = vec![1.0; spacings.len()];
        Self { scales, spacings, field: [0.0; FIELD_TERMS], field_free: false, mask: MASK_FRACTION, noise_scale: 1.0 }
    }

    /// Radius of the masks in a frame, px.
    pub(super) fn radius(&self, frame: &SpacingFrame) -> f64 {
        self.mask * frame.pitch / 2.0
    }

    fn noise(&self, frame: &SpacingFrame) -> f64 {
        (frame.noise * self.noise_scale).max(QUANTISATION)
    }

    pub(super) fn unknowns(&self) -> usize {
        self.spacings.len() + if self.field_free { FIELD_TERMS } else { 0 }
    }

    /// The spacing of a region at a place of the field.
    pub(super) fn spacing(&self, region: usize, [x, y]: [f64; 2]) -> f64 {
        let [tx, ty, k] = self.field;
        self.spacings[region] + self.scales[region] * (tx * x + ty * y + k * (x * x + y * y))
    }

    /// Derivatives of that spacing with respect to the unknowns.
    fn derivatives(&self, region: usize, [x, y]: [f64; 2], into: &mut [f64]) {
        into.fill(0.0);
        into[region] = 1.0;
        if self.field_free {
            let (n, s) = (self.spacings.len(), self.scales[region]);
            into[n..].copy_from_slice(&[s * x, s * y, s * (x * x + y * y)]);
        }
    }

    fn advance(&mut self, step: &DVector<f64>) {
        let n = self.spacings.len();
        for (spacing, change) in self.spacings.iter_mut().zip(step.iter()) {
            *spacing += change;
        }
        if self.field_free {
            for (term, change) in self.field.iter_mut().zip(step.iter().skip(n)) {
                *term += change;
            }
        }
    }
}

/// What one pair says, both orders taken together.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PairScore {
    /// Sum of the two scores.
    score: f64,
    /// Sum of their derivatives: the information about the spacing.
    information: f64,
    /// Mean squared residual in units of the noise's.
    residual: f64,
    /// The same in units of what noise and the model's limits leave: 1 and less where the two match.
    misfit: f64,
    /// Noise-free covariance and variances of the contents, for the correlation.
    pub(super) covariance: f64,
    pub(super) variances: [f64; 2],
    /// The noise's share that was taken out of each.
    pub(super) noise: f64,
    /// Which region, and where in the field.
    region: usize,
    pub(super) midpoint: [f64; 2],
    block: usize,
    direction: usize,
}

/// The score of one order of a pair.
struct Order {
    score: f64,
    information: f64,
    residual: f64,
    misfit: f64,
    /// Gain of the slope's orthogonalisation and the factor that keeps pure noise from counting.
    projection: f64,
    trust: f64,
}

fn order(sums: &PairSums, noise: f64, slope_noise: f64) -> Order {
    let share = noise * noise * sums.pixels;
    let clean = |moment: f64| (moment - share).max(0.25 * moment).max(1e-9);
    let (aa, bb) = (clean(sums.aa), clean(sums.bb));
    let gain = (aa / bb).sqrt().clamp(0.25, 4.0);
    let projection = sums.ta / aa;
    let left = (sums.aa - 2.0 * gain * sums.ab + gain * gain * sums.bb).max(0.0);
    let trust = (1.0 - share * slope_noise / sums.tt.max(1e-12)).clamp(0.0, 1.0);
    Order {
        score: trust * ((sums.ta - projection * sums.aa) - gain * (sums.tb - projection * sums.ab)),
        information: trust * gain * (sums.td - projection * sums.ad),
        residual: left / (2.0 * share).max(1e-9),
        misfit: left / (2.0 * share + MODEL_SHARE * (sums.aa + gain * gain * sums.bb)).max(1e-9),
        projection,
        trust,
    }
}

/// Compares the given pairs of a frame at the spacings of the model.
pub(super) fn score_pairs(frame: &SpacingFrame, pairs: &[Pair], model: &Model) -> Vec<PairScore> {
    pairs
        .par_chunks(32)
        .flat_map_iter(|chunk| {
            let mut patch = Patch::default();
            chunk.iter().filter_map(move |&pair| score_pair(frame, pair, model, &mut patch)).collect::<Vec<_>>()
        })
        .collect()
}

/// The region that both micro-images of a pair belong to.
fn region(frame: &SpacingFrame, pair: Pair) -> Option<usize> {
    let (a, b) = (frame.micro_images[pair.first].region, frame.micro_images[pair.second].region);
    a.filter(|_| a == b)
}

fn score_pair(frame: &SpacingFrame, pair: Pair, model: &Model, patch: &mut Patch) -> Option<PairScore> {
    let region = region(frame, pair)?;
    let midpoint = frame.midpoint(pair);
    let spacing = model.spacing(region, midpoint);
    let mut result =
        PairScore { region, midpoint, block: block(midpoint), direction: pair.direction, ..Default::default() };
    for (a, b) in [(pair.first, pair.second), (pair.second, pair.first)] {
        let sums = patch.compare(frame, a, b, spacing, model.radius(frame))?;
        let noise = model.noise(frame);
        let order = order(&sums, noise, frame.slope_noise);
        let share = noise * noise * sums.pixels;
        result.score += order.score;
        result.information += order.information;
        result.residual += 0.5 * order.residual;
        result.misfit += 0.5 * order.misfit;
        result.covariance += sums.ab;
        result.variances[0] += sums.aa - share;
        result.variances[1] += sums.bb - share;
        result.noise += share;
    }
    Some(result)
}

fn block([x, y]: [f64; 2]) -> usize {
    let place = |v: f64| (((v + 1.0) / 2.0 * BLOCKS as f64).max(0.0) as usize).min(BLOCKS - 1);
    place(y) * BLOCKS + place(x)
}

/// Correlation of the contents over all pairs, the noise's share of the variances taken out.
pub(super) fn correlation<'a>(scores: impl IntoIterator<Item = &'a PairScore>) -> f64 {
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for score in scores {
        ab += score.covariance;
        aa += score.variances[0];
        bb += score.variances[1];
    }
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}

/// Weights of pairs by how well they match: pairs that see an edge in depth, a bubble or a reflection count little.
fn pair_weights(scores: &[PairScore]) -> Vec<f64> {
    let mut misfits: Vec<f64> = scores.iter().map(|s| s.misfit).collect();
    if misfits.is_empty() {
        return Vec::new();
    }
    let middle = misfits.len() / 2;
    let (_, median, _) = misfits.select_nth_unstable_by(middle, f64::total_cmp);
    // Four times what is usual is where doubt begins.
    let usual = 4.0 * median.max(1.0);
    scores.iter().map(|s| 1.0 / (1.0 + (s.misfit / usual).powi(2))).collect()
}

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
    pub(super) pairs: usize,
    pub(super) correlation: f64,
    /// Median residual of the pairs in units of what noise alone would leave.
    pub(super) residual: f64,
    /// Pairs in each region.
    pub(super) region_pairs: Vec<usize>,
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
            pairs: 0,
            correlation: 0.0,
            residual: 0.0,
            region_pairs: vec![0; model.spacings.len()],
        };
        let mut derivatives = vec![0.0; n];
        let mut all = Vec::new();
        for (k, frame) in frames.iter().enumerate() {
            let pairs = subsets.map_or(&frame.pairs, |s| &s[k]);
            let scores = score_pairs(frame, pairs, model);
            let weights = pair_weights(&scores);
            for (score, weight) in scores.iter().zip(weights) {
                // Frames of other noise or depth weigh by what their noise allows.
                let weight = weight / model.noise(frame).powi(2).max(1e-6);
                model.derivatives(score.region, score.midpoint, &mut derivatives);
                let block = k * BLOCKS * BLOCKS + score.block;
                for i in 0..n {
                    let part = weight * score.score * derivatives[i];
                    normal.gradient[i] += part;
                    normal.block_gradients[block][i] += part;
                    for j in 0..n {
                        normal.information[(i, j)] += weight * score.information * derivatives[i] * derivatives[j];
                    }
                }
                normal.block_information[block] += weight * score.information;
                normal.by_direction[score.direction.min(2)] += weight * score.information;
                normal.region_pairs[score.region] += 1;
            }
            normal.pairs += scores.len();
            all.extend(scores);
        }
        normal.correlation = correlation(&all);
        let mut residuals: Vec<f64> = all.iter().map(|s| s.residual).collect();
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

/// Iterates to the root of the gradient, at most `reach` px from the start, and leaves the normal equation there.
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
    for _ in 0..iterations {
        let Some(mut step) = normal.step() else { return (Outcome::Undetermined, normal) };
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
        normal = Normal::of(frames, subsets, model);
        if largest < tolerance {
            return (Outcome::Converged, normal);
        }
    }
    (Outcome::Lost, normal)
}

/// Variance of the first unknowns that pixel noise alone gives, one for each direction `along` in the space of unknowns
/// (a row of the inverse information).
///
/// The noise of a pixel enters every pair that its micro-image takes part in, as reference and as neighbour; with a
/// neighbour on either side most of it cancels. So its weights are gathered pixel by pixel before they are squared.
/// The neighbour's role mirrors the reference's: it counts as the same again.
pub(super) fn noise_variance(frames: &[SpacingFrame], model: &Model, along: &DVector<f64>) -> f64 {
    frames.iter().map(|frame| frame_noise_variance(frame, model, along)).sum()
}

fn frame_noise_variance(frame: &SpacingFrame, model: &Model, along: &DVector<f64>) -> f64 {
    let mut neighbours: Vec<Vec<(usize, f64)>> = vec![Vec::new(); frame.micro_images.len()];
    let mut derivatives = vec![0.0; model.unknowns()];
    let scores = score_pairs(frame, &frame.pairs, model);
    let usual = pair_weights(&scores);
    let mut scored = scores.iter().zip(usual).peekable();
    for &pair in &frame.pairs {
        let midpoint = frame.midpoint(pair);
        // Scores come in the order of the pairs, without those that could not be compared.
        let Some((score, weight)) = scored.next_if(|(s, _)| s.midpoint == midpoint && s.direction == pair.direction)
        else {
            continue;
        };
        model.derivatives(score.region, midpoint, &mut derivatives);
        let leverage: f64 = derivatives.iter().zip(along.iter()).map(|(d, a)| d * a).sum();
        let factor = leverage * weight / model.noise(frame).powi(2).max(1e-6);
        neighbours[pair.first].push((pair.second, factor));
        neighbours[pair.second].push((pair.first, factor));
    }
    neighbours
        .par_iter()
        .enumerate()
        .map_init(
            || (Patch::default(), Vec::new()),
            |(patch, weights), (a, others)| micro_image_noise(frame, model, a, others, patch, weights),
        )
        .sum()
}

fn micro_image_noise(
    frame: &SpacingFrame,
    model: &Model,
    a: usize,
    others: &[(usize, f64)],
    patch: &mut Patch,
    weights: &mut Vec<f64>,
) -> f64 {
    let reach = frame.radius.ceil() as usize + 2;
    let side = 2 * reach + 1;
    let centre = frame.micro_images[a].centre;
    let corner = [centre[0].round() as usize - reach, centre[1].round() as usize - reach];
    weights.clear();
    weights.resize(side * side, 0.0);
    for &(b, factor) in others {
        let place = |k: usize| frame.micro_images[k].centre;
        let midpoint = frame.field([f64::midpoint(place(a)[0], place(b)[0]), f64::midpoint(place(a)[1], place(b)[1])]);
        let region = frame.micro_images[a].region.unwrap_or(0);
        let spacing = model.spacing(region, midpoint);
        let Some(sums) = patch.compare(frame, a, b, spacing, model.radius(frame)) else { continue };
        let order = order(&sums, model.noise(frame), frame.slope_noise);
        for row in 0..patch.rows {
            let y = patch.origin[1] + row - corner[1];
            for column in 0..patch.columns {
                let k = row * patch.stride + column;
                let slope = f64::from(patch.slope[k])
                    - sums.slope_mean
                    - order.projection * (f64::from(patch.reference[k]) - sums.reference_mean);
                let x = patch.origin[0] + column - corner[0];
                weights[y * side + x] += 2.0 * factor * order.trust * f64::from(patch.weight[k]) * slope;
            }
        }
    }
    let noise = model.noise(frame);
    let mut variance = 0.0;
    for y in 0..side {
        let precision = &frame.precision[(corner[1] + y) * frame.width + corner[0]..][..side];
        for (weight, &precision) in weights[y * side..(y + 1) * side].iter().zip(precision) {
            if precision > 0.0 {
                variance += weight * weight * noise * noise / f64::from(precision);
            }
        }
    }
    variance
}
