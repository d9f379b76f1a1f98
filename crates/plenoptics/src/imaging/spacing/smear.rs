//! Whether the spacing changed while the shutter was open.
//!
//! A change of the spacing moves what a micro-image shows along the radius from its centre, in proportion to it. While
//! the shutter is open that smears texture, the more the further out. An object point that one micro-image of a pair
//! shows near its edge the other shows near its centre: the same texture, smeared differently. Defocus, and whatever the
//! texture itself is like, is the same in both.
//!
//! A smear of length s along x adds s²/24 of a picture's second derivative by x to it. With s = c x/p, c the change and
//! p the micro-image pitch less the spacing, two micro-images that show the same at x_A and x_B from their centres differ
//! by (c²/24 p²) (x_A² − x_B²) times the texture's second derivative: the factor is a linear fit to their difference.
//! A shift or a stretch of one against the other is the first derivative's, which textures do not confuse with it.

use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg32;

use super::SMEAR_SIGMA;
use super::frame::SpacingFrame;
use crate::imaging::matching::model::{BLOCKS, Model};
use crate::imaging::matching::plan::Pair;
use crate::imaging::matching::run::each;
use crate::imaging::matching::smeared::{Smeared, of_pair};

/// Pixels about the masks that slopes of slopes reach.
const BENDS_PX: f64 = 2.0;
/// Pixels about one that its second derivative is made of: beyond the micro-image's edge they show something else.
const REACH_PX: f64 = 3.0;
/// Pairs that are looked at before it is asked whether they tell enough.
const PAIRS: usize = 600;
/// Standard uncertainty (px²) from which on more pairs add nothing that the estimator's own limit leaves room for.
const SURE: f64 = 0.5 * SMEAR_SIGMA;
/// Blocks of the field that have to be there for that: the scatter of few comes out low by chance.
const SURE_BLOCKS: usize = BLOCKS * BLOCKS / 2;

/// By how much the spacing changed during the exposure, as far as the frame shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Smear {
    /// The change, squared, px²: 0 where nothing is smeared, and below where the outer parts are sharper.
    pub(super) square: f64,
    /// Its standard uncertainty, px².
    pub(super) sigma: f64,
}

/// The smear of a frame at a fitted model within masks of this radius (px). `None` where there is too little to tell.
///
/// Left out is what is not smeared alone: where the main lens's aperture cuts into a microlens's light, out of focus, the
/// blur is another than in the micro-image's middle; and at its edge filters reach what a neighbour shows.
pub(super) fn smear(frame: &SpacingFrame, model: &Model, radius: f64) -> Option<Smear> {
    let radius = radius.min(frame.whole_radius()).min(0.5 * frame.pitch - REACH_PX);
    let mut pairs = frame.pairs();
    // Neighbours show much the same: those that are looked at lie anywhere.
    pairs.shuffle(&mut Pcg32::seed_from_u64(1));
    let square = 24.0 * (frame.pitch - model.spacings[0]).powi(2);
    let mut blocks = [Smeared::default(); BLOCKS * BLOCKS];
    let mut smear = None;
    for pairs in pairs.chunks(PAIRS) {
        add(&mut blocks, frame, model, radius, pairs);
        smear = solved(&blocks).map(|[loss, sigma]| Smear { square: square * loss, sigma: square * sigma });
        let filled = blocks.iter().filter(|block| block.energy != 0.0).count();
        if filled >= SURE_BLOCKS && smear.is_some_and(|smear| smear.sigma <= SURE) {
            break;
        }
    }
    smear
}

/// Adds what pairs say to the blocks of the field that they lie in.
fn add(blocks: &mut [Smeared], frame: &SpacingFrame, model: &Model, radius: f64, pairs: &[Pair]) {
    let ends: Vec<[u32; 2]> = pairs.iter().map(|pair| [pair.first, pair.second]).collect();
    let found = frame.at(model, radius.max(1.0) + BENDS_PX, 1.0, |pass| {
        each(pass, &ends, |k, tiles| {
            let pair = &pairs[k];
            let spacing = model.spacing(usize::from(pair.region), &pair.place);
            let [there, back] = [[0, 1], [1, 0]].map(|[own, other]| {
                let unit = if own == 0 { pair.unit } else { pair.unit.map(|u| -u) };
                of_pair([&tiles[own], &tiles[other]], pass.shape, (unit, spacing), radius)
            });
            [there, back]
        })
    });
    for (pair, sums) in pairs.iter().zip(&found) {
        let block = &mut blocks[usize::from(pair.block)];
        for sums in sums {
            block.excess += sums.excess;
            block.energy += sums.energy;
        }
    }
}

/// The factor that fits all blocks best, and its standard uncertainty from the scatter between them.
fn solved(blocks: &[Smeared]) -> Option<[f64; 2]> {
    let filled = blocks.iter().filter(|block| block.energy != 0.0).count();
    let energy: f64 = blocks.iter().map(|block| block.energy).sum();
    if energy <= 0.0 || filled < 2 {
        return None;
    }
    let factor = blocks.iter().map(|block| block.excess).sum::<f64>() / energy;
    let scatter: f64 = blocks.iter().map(|block| (block.excess - factor * block.energy).powi(2)).sum();
    Some([factor, (scatter * filled as f64 / (filled - 1) as f64).sqrt() / energy])
}
