//! What one pair of micro-images says, both orders taken together.
//!
//! Matching is inverse-compositional: the slope comes from the un-interpolated reference, so the fixed point does not
//! depend on how interpolation treats noise. A pair's score is Σ w T (A − g B − h), T the reference's slope along the
//! pair made orthogonal to the pair's gain and offset; its derivative with respect to the spacing is taken against the
//! *neighbour's* slope, whose noise is independent of the reference's: gradient energy without the noise's share.

use rayon::prelude::*;

use super::frame::{Pair, SpacingFrame};
use super::model::{Model, Place};
use super::patch::{PairSums, Patch, Placed};

/// Field blocks along each side of a frame, for the scatter between regions.
pub(in crate::imaging) const BLOCKS: usize = 6;

/// What interpolation, vignetting and the pixels' own area leave of a content's energy where two micro-images do show
/// the same: no sign of a mismatch.
pub(in crate::imaging) const MODEL_SHARE: f64 = 0.002;

/// What one pair says, both orders taken together.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PairScore {
    /// Sums of the two orders' scores, along the pair and across it.
    pub(super) score: [f64; 2],
    /// Sums of their derivatives by a shift along and across: the information about the spacing.
    pub(super) information: [[f64; 2]; 2],
    /// Variance that pixel noise alone gives the score along the pair.
    pub(super) score_variance: f64,
    /// Mean squared residual in units of the noise's.
    pub(super) residual: f64,
    /// The same in units of what noise and the model's limits leave: 1 and less where the two match.
    pub(super) misfit: f64,
    /// How much it counts beside the frame's other pairs, by how well it matches.
    pub(super) weight: f64,
    /// What the contents have in common.
    pub(super) content: Content,
    /// Which of the frame's pairs.
    pub(super) pair: Pair,
    /// Which region, where in the field, and along which direction.
    pub(super) region: usize,
    pub(super) place: Place,
    pub(super) block: usize,
}

/// What the contents of a pair have in common, both orders taken together.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Content {
    /// Noise-free covariance and variances, for the correlation.
    pub(super) covariance: f64,
    pub(super) variances: [f64; 2],
    /// The noise's share that was taken out of each.
    pub(super) noise: f64,
}

impl Content {
    fn add(&mut self, covariance: f64, variances: [f64; 2], noise_share: f64) {
        self.covariance += covariance;
        self.variances[0] += variances[0] - noise_share;
        self.variances[1] += variances[1] - noise_share;
        self.noise += noise_share;
    }
}

/// The score of one order of a pair.
pub(super) struct Order {
    pub(super) score: [f64; 2],
    pub(super) information: [[f64; 2]; 2],
    /// Sum of the weighted, squared slopes that the score along the pair is made of.
    pub(super) energy: f64,
    residual: f64,
    pub(super) misfit: f64,
    /// Gains of the slopes' orthogonalisation and the factors that keep pure noise from counting.
    pub(super) projection: [f64; 2],
    pub(super) trust: [f64; 2],
}

pub(super) fn order(sums: &PairSums, noise: f64, slope_noise: f64) -> Order {
    let share = noise * noise * sums.pixels;
    // Where a micro-image is flat, its moments are rounding errors: never less than the noise would make.
    let clean = |moment: f64| (moment - share).max(0.25 * moment).max(0.25 * share).max(1e-9);
    let (aa, bb) = (clean(sums.aa), clean(sums.bb));
    let gain = (aa / bb).sqrt().clamp(0.25, 4.0);
    let left = (sums.aa - 2.0 * gain * sums.ab + gain * gain * sums.bb).max(0.0);
    let projection = sums.ta.map(|ta| ta / aa);
    let trust = sums.tt.map(|tt| (1.0 - share * slope_noise / tt.max(1e-12)).clamp(0.0, 1.0));
    let score =
        |k: usize| trust[k] * ((sums.ta[k] - projection[k] * sums.aa) - gain * (sums.tb[k] - projection[k] * sums.ab));
    let information = |k: usize, l: usize| trust[k] * gain * (sums.td[k][l] - projection[k] * sums.ad[l]);
    Order {
        score: [score(0), score(1)],
        information: [[information(0, 0), information(0, 1)], [information(1, 0), information(1, 1)]],
        energy: trust[0] * trust[0] * (sums.tt[0] - projection[0] * sums.ta[0]).max(0.0),
        residual: left / (2.0 * share).max(1e-9),
        misfit: left / (2.0 * share + MODEL_SHARE * (sums.aa + gain * gain * sums.bb)).max(1e-9),
        projection,
        trust,
    }
}

/// Compares the given pairs of a frame at the spacings of the model.
pub(super) fn score_pairs(frame: &SpacingFrame, pairs: &[Pair], model: &Model) -> Vec<PairScore> {
    let mut scores: Vec<PairScore> = pairs
        .par_chunks(32)
        .flat_map_iter(|chunk| {
            let mut patch = Patch::default();
            chunk.iter().filter_map(move |&pair| score_pair(frame, pair, model, &mut patch)).collect::<Vec<_>>()
        })
        .collect();
    weigh(&mut scores);
    scores
}

fn score_pair(frame: &SpacingFrame, pair: Pair, model: &Model, patch: &mut Patch) -> Option<PairScore> {
    let region = frame.region_of(pair)?;
    let place = frame.place_of(pair);
    let spacing = model.spacing(region, &place);
    let mut result = PairScore { pair, region, place, block: block(place.at), ..Default::default() };
    for (a, b) in [(pair.first, pair.second), (pair.second, pair.first)] {
        let sums = patch.compare(Placed { frame, a, b, spacing, radius: model.radius(frame) })?;
        let noise = model.noise(frame);
        let order = order(&sums, noise, frame.slope_noise);
        let share = noise * noise * sums.pixels;
        for k in 0..2 {
            result.score[k] += order.score[k];
            for l in 0..2 {
                result.information[k][l] += order.information[k][l];
            }
        }
        // Both orders see the same noise: their scores add, not their variances.
        result.score_variance += 4.0 * noise * noise * order.energy;
        result.residual += 0.5 * order.residual;
        result.misfit += 0.5 * order.misfit;
        result.content.add(sums.ab, [sums.aa, sums.bb], share);
    }
    Some(result)
}

/// Compares the contents alone of the given pairs of a frame at one spacing (px) all over it: `None` for a pair that
/// [`score_pairs`] leaves out.
pub(super) fn content_of_pairs(frame: &SpacingFrame, pairs: &[Pair], spacing: f64) -> Vec<Option<Content>> {
    let model = Model::flat(vec![spacing]);
    let (radius, noise) = (model.radius(frame), model.noise(frame));
    let content = |pair: Pair, patch: &mut Patch| {
        frame.region_of(pair)?;
        let mut content = Content::default();
        for (a, b) in [(pair.first, pair.second), (pair.second, pair.first)] {
            let sums = patch.contents(Placed { frame, a, b, spacing: [spacing, 0.0], radius })?;
            content.add(sums.ab, [sums.aa, sums.bb], noise * noise * sums.pixels);
        }
        Some(content)
    };
    pairs
        .par_chunks(32)
        .flat_map_iter(|chunk| {
            let mut patch = Patch::default();
            chunk.iter().map(move |&pair| content(pair, &mut patch)).collect::<Vec<_>>()
        })
        .collect()
}

/// The field block of a place of the field.
pub(in crate::imaging) fn block([x, y]: [f64; 2]) -> usize {
    let place = |v: f64| (((v + 1.0) / 2.0 * BLOCKS as f64).max(0.0) as usize).min(BLOCKS - 1);
    place(y) * BLOCKS + place(x)
}

/// Correlation of the contents over all pairs, the noise's share of the variances taken out.
pub(super) fn correlation<'a>(contents: impl IntoIterator<Item = &'a Content>) -> f64 {
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for content in contents {
        ab += content.covariance;
        aa += content.variances[0];
        bb += content.variances[1];
    }
    if aa > 0.0 && bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}

/// Weighs pairs by how well they match: those that see an edge in depth, a bubble or a reflection count little.
fn weigh(scores: &mut [PairScore]) {
    let mut misfits: Vec<f64> = scores.iter().map(|s| s.misfit).collect();
    if misfits.is_empty() {
        return;
    }
    let middle = misfits.len() / 2;
    let (_, median, _) = misfits.select_nth_unstable_by(middle, f64::total_cmp);
    // Four times what is usual is where doubt begins.
    let usual = 4.0 * median.max(1.0);
    for score in scores {
        score.weight = 1.0 / (1.0 + (score.misfit / usual).powi(2));
    }
}
