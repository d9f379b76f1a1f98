//! Whether the spacing changed while the shutter was open.
//!
//! A change of the spacing moves what a micro-image shows along the radius from its centre, in proportion to it. While
//! the shutter is open that smears texture, the more the further out. An object point that one micro-image of a pair
//! shows near its edge the other shows near its centre: the same texture, smeared differently. Defocus, and whatever the
//! texture itself is like, is the same in both.

use rayon::prelude::*;

use super::frame::{Pair, SpacingFrame, disc_rows};
use super::model::Model;
use super::score::{BLOCKS, block};
use crate::optics::ArrayKind;

/// Pairs that are added up by one thread at a time.
const PART: usize = 256;

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

/// The smear of a frame at a fitted model: the least that pairs along any direction of the lattice show, since a change
/// of the spacing smears along all of them. `None` where there is too little texture to tell.
pub(super) fn smear(frame: &SpacingFrame, model: &Model) -> Option<Smear> {
    let none = || [[Sums::default(); BLOCKS * BLOCKS]; 3];
    let part = |pairs: &[Pair]| {
        pairs.iter().fold(none(), |mut directions, &pair| {
            let place = frame.place_of(pair);
            if let Some(region) = frame.region_of(pair) {
                let spacing = model.spacing(region, &place)[0];
                let sums = &mut directions[pair.direction.min(2)][block(place.at)];
                *sums = sums.plus(of_pair(frame, pair, spacing, model.radius(frame)));
            }
            directions
        })
    };
    // The parts do not depend on the machine, nor on which thread is first, so that neither do the sums' last digits.
    let parts: Vec<_> = frame.pairs.par_chunks(PART).map(part).collect();
    let directions = parts.iter().fold(none(), |mut a, b| {
        a.iter_mut().flatten().zip(b.iter().flatten()).for_each(|(a, &b)| *a = a.plus(b));
        a
    });
    let used = if frame.array == ArrayKind::Square { 2 } else { 3 };
    let patch = (frame.pitch - model.spacings[0]).abs();
    let smears = directions[..used].iter().map(|blocks| along_direction(blocks, patch));
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

fn of_pair(frame: &SpacingFrame, pair: Pair, spacing: f64, radius: f64) -> Sums {
    let (a, b) = (frame.micro_images[pair.first].centre, frame.micro_images[pair.second].centre);
    let step = [b[0] - a[0], b[1] - a[1]];
    let length = step[0].hypot(step[1]);
    let unit = [step[0] / length, step[1] / length];
    let shift = [spacing * unit[0], spacing * unit[1]];
    let width = frame.width;
    let nearest = shift[1].round() as isize * width as isize + shift[0].round() as isize;
    let (ux, uy) = (unit[0] as f32, unit[1] as f32);
    let slope = |pixel: usize| f64::from(ux * frame.slopes[0][pixel] + uy * frame.slopes[1][pixel]);
    let bend = |pixel: usize| {
        let across = slope(pixel + 1) - slope(pixel - 1);
        let down = slope(pixel + width) - slope(pixel - width);
        0.5 * (unit[0] * across + unit[1] * down)
    };
    let mut sums = Sums::default();
    disc_rows(a, radius, width, |start, count| {
        for pixel in start..start + count {
            let (dx, dy) = ((pixel % width) as f64 - a[0], (pixel / width) as f64 - a[1]);
            let there = [dx + shift[0] - step[0], dy + shift[1] - step[1]];
            if there[0] * there[0] + there[1] * there[1] > radius * radius {
                continue;
            }
            let other = pixel.wrapping_add_signed(nearest);
            if frame.precision[pixel] <= 0.0 || frame.precision[other] <= 0.0 {
                continue;
            }
            let along = |r: [f64; 2]| (r[0] * unit[0] + r[1] * unit[1]).powi(2);
            let further = along([dx, dy]) - along(there);
            let (first, second) = (slope(pixel), slope(other));
            sums.excess += further * (first * first - second * second);
            sums.energy += further * further * first * second;
            sums.slopes += first * second;
            sums.bends += bend(pixel) * bend(other);
        }
    });
    sums
}
