//! The spacing micro-image by micro-image: what an overlay draws, and where the model does not hold.

use std::collections::BTreeMap;

use serde::Serialize;

use super::frame::SpacingFrame;
use super::solve::Solver;
use crate::imaging::matching::model::{Model, Place};
use crate::imaging::matching::pupil::Corrected;
use crate::imaging::matching::score::PairScore;

/// Pairs that count less than this by how badly they match do not match; a micro-image whose pairs do so on the whole does
/// not show what its neighbours show.
pub(super) const LEAST_WEIGHT: f64 = 0.2;
/// Standard uncertainty beyond which a micro-image's own spacing says nothing, px.
const SIGMA_MAX_PX: f64 = 1.0;

/// Whether a micro-image's own spacing can be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LensState {
    /// It matches its neighbours.
    Matched,
    /// It shows something else than its neighbours: a bubble, a reflection, an edge in depth, dirt, a dead microlens.
    Mismatched,
    /// It has no texture to be matched by, or could not be compared with any neighbour.
    Blank,
}

/// The spacing about one micro-image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LensSpacing {
    /// Lattice indices in the frame's grid.
    pub index: [i32; 2],
    /// Centre of the micro-image, px.
    pub centre_px: [f64; 2],
    /// Spacing between its image points and its neighbours', mean over its pairs, px; the model's where the micro-image
    /// is blank.
    pub spacing_px: f64,
    /// Standard uncertainty of that, px: noise, and how badly the pairs match. Infinite where blank.
    pub sigma_px: f64,
    /// Whether it can be used.
    pub state: LensState,
}

/// Two neighbours that were compared.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PairMatch {
    /// Centres of the two, px.
    pub centres_px: [[f64; 2]; 2],
    /// How much the pair counts by how well it matches: 1 is usual, near 0 where the two show different things.
    pub weight: f64,
}

/// The spacing over the field of a frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SpacingMap {
    /// Every micro-image wholly within the frame.
    pub lenses: Vec<LensSpacing>,
    /// Every pair that was compared, those of the first frame where there are several.
    pub pairs: Vec<PairMatch>,
}

/// What a micro-image's pairs add up to.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    score: f64,
    information: f64,
    variance: f64,
    weight: f64,
    pairs: f64,
}

impl Sums {
    fn add(&mut self, score: &PairScore, weight: f64, noise: f64) {
        self.score += weight * f64::from(score.score[0]);
        self.information += weight * f64::from(score.information[0][0]);
        // Both orders see the same noise: their scores add, not their variances. Pairs that match badly are as uncertain
        // as they match badly.
        let variance = 4.0 * noise * noise * f64::from(score.energy[0]);
        self.variance += weight * weight * variance * f64::from(score.misfit).max(1.0);
        self.weight += weight;
        self.pairs += 1.0;
    }
}

/// The map at a fitted model, from what the pairs said there last. Frames of one pose add up.
pub(super) fn map(solver: &Solver<'_>, model: &Model, free: &Corrected) -> SpacingMap {
    let mut sums: BTreeMap<[i32; 2], Sums> = BTreeMap::new();
    let mut pairs = Vec::new();
    for (k, (frame, jobs)) in solver.frames.iter().zip(&solver.jobs).enumerate() {
        let noise = frame.noise(solver.noise_scale);
        for (link, score) in jobs.iter().flat_map(|job| job.links().zip(&job.scores)).filter(|(_, s)| s.compared()) {
            let weight = solver.normal.weight(k, score);
            let ends = [link.pair.first, link.pair.second].map(|lens| &frame.micro_images[lens as usize]);
            for end in ends {
                sums.entry(end.index).or_default().add(score, weight, noise);
            }
            if k == 0 {
                pairs.push(PairMatch { centres_px: ends.map(|end| end.centre), weight });
            }
        }
    }
    let lens = |frame: &SpacingFrame, index: [i32; 2], centre: [f64; 2]| {
        let at = frame.plan.field.coordinates(centre);
        // What frees the spacing on the axis frees all of them.
        let apparent = model.spacing(0, &Place { at, ..Place::default() })[0] - model.spacings[0];
        let expected = free.spacing + free.slope * apparent;
        let blank = LensSpacing {
            index,
            centre_px: centre,
            spacing_px: expected,
            sigma_px: f64::INFINITY,
            state: LensState::Blank,
        };
        let Some(sums) = sums.get(&index).filter(|s| s.information > 0.0 && s.pairs > 0.0) else { return blank };
        let sigma_px = sums.variance.sqrt() / sums.information;
        if sums.weight < LEAST_WEIGHT * sums.pairs {
            return LensSpacing { sigma_px, state: LensState::Mismatched, ..blank };
        }
        if sigma_px > SIGMA_MAX_PX {
            return blank;
        }
        // The scores are linear over about a pixel: a longer step is only a direction.
        let departure = free.slope * (sums.score / sums.information).clamp(-1.0, 1.0);
        LensSpacing { spacing_px: expected + departure, sigma_px, state: LensState::Matched, ..blank }
    };
    let lenses = solver
        .frames
        .first()
        .map_or_else(Vec::new, |frame| frame.micro_images.iter().map(|m| lens(frame, m.index, m.centre)).collect());
    SpacingMap { lenses, pairs }
}
