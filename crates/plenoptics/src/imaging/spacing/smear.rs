//! Whether the spacing changed while the shutter was open.
//!
//! A change of the spacing moves what a micro-image shows along the radius from its centre, in proportion to it. While
//! the shutter is open that smears texture, the more the further out. An object point that one micro-image of a pair
//! shows near its edge the other shows near its centre: the same texture, smeared differently. Defocus, and whatever the
//! texture itself is like, is the same in both.

use super::frame::SpacingFrame;
use crate::imaging::matching::model::{BLOCKS, Model};
use crate::imaging::matching::run::each;
use crate::imaging::matching::shape::Shape;
use crate::imaging::matching::tile::Tile;

/// Pixels about the masks that slopes of slopes reach.
const BENDS_PX: f64 = 2.0;

/// By how much the spacing changed during the exposure, as far as the frame shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Smear {
    /// The change, px; 0 where nothing is smeared.
    pub(super) change_px: f64,
    /// How many standard errors the smear stands above none.
    pub(super) significance: f64,
}

/// Sums over the pixels of one field block.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    /// Squared slope of the one less that of the other, by how much further out the one shows it (squared).
    excess: f64,
    /// Product of the slopes by the square of that.
    energy: f64,
    /// Products of the slopes, and of their slopes: both free of the noise's own energy.
    slopes: f64,
    bends: f64,
}

impl Sums {
    fn plus(self, other: Self) -> Self {
        Self {
            excess: self.excess + other.excess,
            energy: self.energy + other.energy,
            slopes: self.slopes + other.slopes,
            bends: self.bends + other.bends,
        }
    }
}

/// The smear of a frame at a fitted model within masks of this radius (px): the least that pairs along any direction of
/// the lattice show, since a change of the spacing smears along all of them. `None` where there is too little texture to
/// tell.
pub(super) fn smear(frame: &SpacingFrame, model: &Model, radius: f64) -> Option<Smear> {
    let pairs = frame.pairs();
    let ends: Vec<[u32; 2]> = pairs.iter().map(|pair| [pair.first, pair.second]).collect();
    let found = frame.at(model, radius + BENDS_PX, 1.0, |pass| {
        each(pass, &ends, |k, tiles| {
            let pair = &pairs[k];
            let spacing = model.spacing(usize::from(pair.region), &pair.place)[0];
            of_pair([&tiles[0], &tiles[1]], pass.shape, pair.unit, spacing, radius)
        })
    });
    let mut directions = [[Sums::default(); BLOCKS * BLOCKS]; 3];
    for (pair, &sums) in pairs.iter().zip(&found) {
        let all = &mut directions[usize::from(pair.direction)][usize::from(pair.block)];
        *all = all.plus(sums);
    }
    let patch = (frame.pitch - model.spacings[0]).abs();
    let smears = directions[..frame.plan.direction_count].iter().map(|blocks| along_direction(blocks, patch));
    let smears = smears.collect::<Option<Vec<Smear>>>()?;
    Some(Smear {
        change_px: smears.iter().map(|s| s.change_px).fold(f64::INFINITY, f64::min),
        significance: smears.iter().map(|s| s.significance).fold(f64::INFINITY, f64::min),
    })
}

/// What the field blocks of one direction say; `patch` is the micro-image pitch less the spacing, px.
fn along_direction(blocks: &[Sums], patch: f64) -> Option<Smear> {
    let total = blocks.iter().copied().fold(Sums::default(), Sums::plus);
    if total.energy <= 0.0 || total.slopes <= 0.0 || total.bends <= 0.0 {
        return None;
    }
    // The share of squared slope that is lost, per squared px of radius.
    let loss = -total.excess / total.energy;
    let scatter = blocks.iter().map(|b| (b.excess + loss * b.energy).powi(2)).sum::<f64>().sqrt() / total.energy;
    // A smear of length s takes s² κ / 12 of it, κ the texture's mean squared wave number.
    let length_per_radius = (12.0 * loss.max(0.0) * total.slopes / total.bends).sqrt();
    Some(Smear { change_px: length_per_radius * patch, significance: loss / scatter.max(1e-12) })
}

/// What the slopes of two micro-images say that are `unit` apart in direction, at a spacing along it (px).
fn of_pair([a, b]: [&Tile; 2], shape: &Shape, unit: [f64; 2], spacing: f64, radius: f64) -> Sums {
    let shift = unit.map(|u| spacing * u);
    let corners = [a.corner(shape), b.corner(shape)];
    // From a pixel of the one's tile to that of the other's which shows the same, the nearest.
    let whole = [0, 1].map(|k| shift[k].round() as isize + (corners[0][k] - corners[1][k]) as isize);
    let nearest = whole[1] * shape.stride as isize + whole[0];
    // From the one's centre to the other's.
    let step = [0, 1].map(|k| f64::from(b.nearest[k] - a.nearest[k]) + b.fraction[k] - a.fraction[k]);
    let (ux, uy) = (unit[0] as f32, unit[1] as f32);
    let slope = |tile: &Tile, at: usize| f64::from(ux * tile.slopes[0][at] + uy * tile.slopes[1][at]);
    let bend = |tile: &Tile, at: usize| {
        let across = slope(tile, at + 1) - slope(tile, at - 1);
        let down = slope(tile, at + shape.stride) - slope(tile, at - shape.stride);
        0.5 * (unit[0] * across + unit[1] * down)
    };
    let mut sums = Sums::default();
    a.disc(shape, radius, |at, [dx, dy]| {
        let there = [dx + shift[0] - step[0], dy + shift[1] - step[1]];
        if there[0] * there[0] + there[1] * there[1] > radius * radius {
            return;
        }
        let other = at.wrapping_add_signed(nearest);
        if a.amplitudes[at] <= 0.0 || b.amplitudes[other] <= 0.0 {
            return;
        }
        let along = |r: [f64; 2]| (r[0] * unit[0] + r[1] * unit[1]).powi(2);
        let further = along([dx, dy]) - along(there);
        let (first, second) = (slope(a, at), slope(b, other));
        sums.excess += further * (first * first - second * second);
        sums.energy += further * further * first * second;
        sums.slopes += first * second;
        sums.bends += bend(a, at) * bend(b, other);
    });
    sums
}
