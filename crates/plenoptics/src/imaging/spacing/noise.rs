//! What pixel noise alone does to the unknowns.

use nalgebra::DVector;
use rayon::prelude::*;

use super::frame::SpacingFrame;
use super::model::Model;
use super::patch::{Patch, Placed};
use super::score::{PairScore, order};

/// Variance that pixel noise alone gives an unknown: `along` is its row of the inverse information, `scores` what each
/// frame's pairs say at the model.
///
/// The noise of a pixel enters every pair that its micro-image takes part in, as reference and as neighbour; with a
/// neighbour on either side most of it cancels. So its weights are gathered pixel by pixel before they are squared.
/// The neighbour's role mirrors the reference's: it counts as the same again.
pub(super) fn noise_variance(
    frames: &[SpacingFrame],
    model: &Model,
    scores: &[Vec<PairScore>],
    along: &DVector<f64>,
) -> f64 {
    frames.iter().zip(scores).map(|(frame, scores)| frame_noise_variance(frame, model, scores, along)).sum()
}

/// A micro-image's partner in a pair, their spacing along and across it (px), and what the pair's two scores do to the
/// unknown.
#[derive(Clone, Copy)]
struct Neighbour {
    other: usize,
    spacing: [f64; 2],
    factor: [f64; 2],
}

fn frame_noise_variance(frame: &SpacingFrame, model: &Model, scores: &[PairScore], along: &DVector<f64>) -> f64 {
    let mut neighbours: Vec<Vec<Neighbour>> = vec![Vec::new(); frame.micro_images.len()];
    let mut derivatives = [Vec::new(), Vec::new()];
    for score in scores {
        let pair = score.pair;
        model.derivatives(score.region, &score.place, &mut derivatives);
        let scale = score.weight / model.noise(frame).powi(2).max(1e-6);
        let leverage = |row: &Vec<f64>| row.iter().zip(along.iter()).map(|(d, a)| d * a).sum::<f64>() * scale;
        let factor = [leverage(&derivatives[0]), leverage(&derivatives[1])];
        let spacing = model.spacing(score.region, &score.place);
        neighbours[pair.first].push(Neighbour { other: pair.second, spacing, factor });
        neighbours[pair.second].push(Neighbour { other: pair.first, spacing, factor });
    }
    neighbours
        .par_iter()
        .enumerate()
        .map_init(
            || (Patch::default(), Vec::new()),
            |(patch, weights), (a, others)| micro_image_noise(frame, model, a, others, patch, weights),
        )
        // Added up in one order, whichever thread was first: the same frame has the same noise to the last digit.
        .collect::<Vec<f64>>()
        .into_iter()
        .sum()
}

fn micro_image_noise(
    frame: &SpacingFrame,
    model: &Model,
    a: usize,
    others: &[Neighbour],
    patch: &mut Patch,
    weights: &mut Vec<f64>,
) -> f64 {
    let reach = frame.radius.ceil() as usize + 2;
    let side = 2 * reach + 1;
    let centre = frame.micro_images[a].centre;
    let corner = [centre[0].round() as usize - reach, centre[1].round() as usize - reach];
    weights.clear();
    weights.resize(side * side, 0.0);
    for &Neighbour { other, spacing, factor } in others {
        let placed = Placed { frame, a, b: other, spacing, radius: model.radius(frame) };
        let Some(sums) = patch.compare(placed) else { continue };
        let order = order(&sums, model.noise(frame), frame.slope_noise);
        for row in 0..patch.rows {
            let y = patch.origin[1] + row - corner[1];
            for column in 0..patch.columns {
                let k = row * patch.stride + column;
                let value = f64::from(patch.reference[k]) - sums.reference_mean;
                let part = |c: usize| {
                    let slope = f64::from(patch.slope[c][k]) - sums.slope_mean[c];
                    factor[c] * order.trust[c] * (slope - order.projection[c] * value)
                };
                let x = patch.origin[0] + column - corner[0];
                weights[y * side + x] += 2.0 * f64::from(patch.weight[k]) * (part(0) + part(1));
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
