//! Semi-global matching over the lattice: to each micro-image the spacing that its own similarities and those along all
//! straight ways to it speak for.

use rayon::prelude::*;

use super::Places;
use super::frame::{DepthFrame, Lens};
use super::volume::Volume;
use crate::optics::ArrayKind;

/// What a change by one step from a micro-image to the next costs, in similarity.
const SLOPE: f32 = 0.015;
/// What a change by more costs: an edge in depth.
const EDGE: f32 = 0.1;

/// Ways through the lattice; each is walked in both directions.
const fn ways(array: ArrayKind) -> &'static [[i32; 2]] {
    match array {
        ArrayKind::Square => &[[1, 0], [0, 1], [1, 1], [-1, 1]],
        ArrayKind::Hexagonal => &[[1, 0], [0, 1], [-1, 1]],
    }
}

/// The chosen spacing of each micro-image, as its place among those of the volume.
pub(super) fn labels(frame: &DepthFrame, volume: &Volume) -> Vec<usize> {
    let count = volume.spacings();
    let directions: Vec<[i32; 2]> = ways(frame.grid.array).iter().flat_map(|&[i, j]| [[i, j], [-i, -j]]).collect();
    let total = directions
        .par_iter()
        .map(|&direction| walk(&frame.lenses, &frame.places, volume, direction))
        // Added up in one order, whichever direction was done first: the same frame has the same depths.
        .collect::<Vec<_>>()
        .into_iter()
        .reduce(|mut sum, costs| {
            sum.iter_mut().zip(&costs).for_each(|(sum, cost)| *sum += cost);
            sum
        })
        .unwrap_or_default();
    let cheapest =
        |costs: &[f32]| costs.iter().enumerate().min_by(|(_, a), (_, b)| a.total_cmp(b)).map_or(0, |(label, _)| label);
    total.chunks(count).map(cheapest).collect()
}

/// The least costs of every spacing of every micro-image when it is come to along one direction.
fn walk(lenses: &[Lens], places: &Places, volume: &Volume, direction: [i32; 2]) -> Vec<f32> {
    let count = volume.spacings();
    let mut costs = vec![0.0f32; lenses.len() * count];
    // Micro-images come row by row: those before are known when their successors are come to.
    let forwards = direction[1] > 0 || (direction[1] == 0 && direction[0] > 0);
    let mut visit = |k: usize| {
        let index = lenses[k].index;
        let before = places.of([index[0] - direction[0], index[1] - direction[1]]);
        let similarities = volume.ssim(k);
        match before {
            None => {
                for (cost, &ssim) in costs[k * count..][..count].iter_mut().zip(similarities) {
                    *cost = 1.0 - ssim;
                }
            }
            Some(before) => {
                // One of the two lies wholly before the other.
                let (former, own) = if before < k {
                    let (head, tail) = costs.split_at_mut(k * count);
                    (&head[before * count..][..count], &mut tail[..count])
                } else {
                    let (head, tail) = costs.split_at_mut(before * count);
                    (&tail[..count], &mut head[k * count..][..count])
                };
                let least = former.iter().copied().fold(f32::INFINITY, f32::min);
                for label in 0..count {
                    let same = former[label];
                    let below = if label > 0 { former[label - 1] + SLOPE } else { f32::INFINITY };
                    let above = if label + 1 < count { former[label + 1] + SLOPE } else { f32::INFINITY };
                    let way = same.min(below).min(above).min(least + EDGE) - least;
                    own[label] = 1.0 - similarities[label] + way;
                }
            }
        }
    };
    if forwards {
        (0..lenses.len()).for_each(&mut visit);
    } else {
        (0..lenses.len()).rev().for_each(&mut visit);
    }
    costs
}
