//! Micro-images from their pairs, and those without texture from those with it.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::frame::DepthFrame;
use super::refine::{EDGE_PX, PairDepth};
use super::{DepthOptions, DepthState};

/// Scatter of the pairs about one micro-image that no noise explains, px: each sees another part of it.
const PAIR_SCATTER_PX: f64 = 0.05;
/// Departure from the others at which a pair counts half, px.
const DOUBT_PX: f64 = 0.25;
/// Standard uncertainty up to which a micro-image has its spacing from its own texture, px.
const MEASURED_PX: f64 = 0.25;
/// How much the spacing of a surface changes from a micro-image to the next, as a standard deviation, px.
const DRIFT_PX: f64 = 0.15;
/// Rounds of relaxation.
const ROUNDS: usize = 24;

/// What becomes of a micro-image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Settled {
    pub(super) spacing_px: f64,
    pub(super) sigma_px: f64,
    pub(super) state: DepthState,
}

/// The spacings of all micro-images; `chosen` are the search's.
pub(super) fn settle(frame: &DepthFrame, chosen: &[f64], pairs: &[PairDepth], options: &DepthOptions) -> Vec<Settled> {
    let own = measured(chosen.len(), pairs);
    let neighbours: Vec<Vec<usize>> = frame
        .lenses
        .iter()
        .enumerate()
        .map(|(k, m)| {
            let steps = frame.grid.neighbour_steps().iter().flat_map(|&[i, j]| [[i, j], [-i, -j]]);
            steps
                .filter_map(|[i, j]| frame.places.of([m.index[0] + i, m.index[1] + j]))
                .filter(|&n| (chosen[n] - chosen[k]).abs() <= EDGE_PX)
                .collect()
        })
        .collect();
    let sigmas = reached(&own, &neighbours);
    let spacings = relaxed(&own, &neighbours, chosen);
    (0..chosen.len())
        .map(|k| match own[k] {
            Some(_) => Settled { spacing_px: spacings[k], sigma_px: sigmas[k], state: DepthState::Measured },
            None if sigmas[k] <= options.sigma_max_px => {
                Settled { spacing_px: spacings[k], sigma_px: sigmas[k], state: DepthState::Inferred }
            }
            None => Settled { spacing_px: chosen[k], sigma_px: f64::INFINITY, state: DepthState::Unknown },
        })
        .collect()
}

/// Spacing and variance of the micro-images whose pairs say enough.
fn measured(count: usize, pairs: &[PairDepth]) -> Vec<Option<(f64, f64)>> {
    let mut around: Vec<Vec<(f64, f64)>> = vec![Vec::new(); count];
    for pair in pairs {
        let variance = pair.sigma_px.powi(2) + PAIR_SCATTER_PX.powi(2);
        for end in pair.ends {
            around[end].push((pair.spacing_px, variance));
        }
    }
    around
        .iter()
        .map(|pairs| {
            let (mut mean, mut variance) = weighted(pairs.iter().copied())?;
            // Pairs that disagree count less and less: across an edge in depth half of them see something else.
            for _ in 0..4 {
                let doubted = pairs.iter().map(|&(s, v)| (s, v * (1.0 + ((s - mean) / DOUBT_PX).powi(2))));
                (mean, variance) = weighted(doubted)?;
            }
            (variance.sqrt() <= MEASURED_PX).then_some((mean, variance))
        })
        .collect()
}

/// Mean by inverse variances, and the greater of its variance by theirs and by their scatter.
fn weighted(values: impl Iterator<Item = (f64, f64)> + Clone) -> Option<(f64, f64)> {
    let (mut weights, mut sum, mut count) = (0.0, 0.0, 0.0);
    for (value, variance) in values.clone() {
        weights += 1.0 / variance;
        sum += value / variance;
        count += 1.0;
    }
    if weights <= 0.0 {
        return None;
    }
    let mean = sum / weights;
    let scatter: f64 = values.map(|(value, variance)| (value - mean).powi(2) / variance).sum();
    Some((mean, f64::max(1.0, scatter / f64::max(count - 1.0, 1.0)) / weights))
}

/// The most likely spacings when a surface drifts as it does and each micro-image's own pairs are as uncertain as they
/// are.
fn relaxed(own: &[Option<(f64, f64)>], neighbours: &[Vec<usize>], chosen: &[f64]) -> Vec<f64> {
    let mut spacings: Vec<f64> =
        own.iter().zip(chosen).map(|(own, &chosen)| own.map_or(chosen, |(mean, _)| mean)).collect();
    let coupling = 1.0 / DRIFT_PX.powi(2);
    let mut sweep = |k: usize| {
        let (mut sum, mut weights) = own[k].map_or((0.0, 0.0), |(mean, variance)| (mean / variance, 1.0 / variance));
        for &n in &neighbours[k] {
            // A step between two that are sure of themselves is an edge too fine for the search.
            let step = (spacings[n] - spacings[k]) / (3.0 * DRIFT_PX);
            let weight = coupling / (1.0 + step * step);
            sum += weight * spacings[n];
            weights += weight;
        }
        if weights > 0.0 {
            spacings[k] = sum / weights;
        }
    };
    for _ in 0..ROUNDS {
        (0..own.len()).for_each(&mut sweep);
        (0..own.len()).rev().for_each(&mut sweep);
    }
    spacings
}

/// Standard uncertainty of each micro-image: its own, or that of the one it has its spacing from and of the way from
/// there; infinite where no way leads.
fn reached(own: &[Option<(f64, f64)>], neighbours: &[Vec<usize>]) -> Vec<f64> {
    #[derive(PartialEq)]
    struct Reached(f64, usize);
    impl Eq for Reached {}
    impl PartialOrd for Reached {
        fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
            Some(self.cmp(other))
        }
    }
    impl Ord for Reached {
        // The least variance first.
        fn cmp(&self, other: &Self) -> Ordering {
            other.0.total_cmp(&self.0).then_with(|| other.1.cmp(&self.1))
        }
    }
    let mut variances = vec![f64::INFINITY; own.len()];
    let mut queue = BinaryHeap::new();
    for (k, own) in own.iter().enumerate() {
        if let Some((_, variance)) = own {
            variances[k] = *variance;
            queue.push(Reached(*variance, k));
        }
    }
    while let Some(Reached(variance, k)) = queue.pop() {
        if variance > variances[k] {
            continue;
        }
        for &n in &neighbours[k] {
            let farther = variance + DRIFT_PX.powi(2);
            if own[n].is_none() && farther < variances[n] {
                variances[n] = farther;
                queue.push(Reached(farther, n));
            }
        }
    }
    variances.into_iter().map(f64::sqrt).collect()
}
