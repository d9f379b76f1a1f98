//! The spacing of each pair of neighbours to parts of a pixel.

use rayon::prelude::*;

use super::DepthOptions;
use super::fit::PairFit;
use super::frame::DepthFrame;

/// Two micro-images whose chosen spacings are farther apart than this (px) see different things.
pub(super) const EDGE_PX: f64 = 1.5;
/// Newton's steps at most, and the length of one that no other need follow, px: each takes away nine tenths of what is
/// left.
const STEPS: usize = 3;
const SHORT_PX: f64 = 0.005;
/// Longest step, px: the matching is linear over about a pixel.
const LONGEST_PX: f64 = 1.0;
/// Standard uncertainty beyond which a pair says nothing, px.
const SIGMA_MAX_PX: f64 = 0.5;
/// Pairs that are fitted in one piece of work.
const PIECE: usize = 32;

/// What one pair says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PairDepth {
    /// Its micro-images.
    pub(super) ends: [usize; 2],
    /// Spacing, px.
    pub(super) spacing_px: f64,
    /// Its standard uncertainty, px: noise, and how badly the two match.
    pub(super) sigma_px: f64,
}

/// The pairs that say something, from the spacings chosen for their micro-images.
pub(super) fn pairs(frame: &DepthFrame, chosen: &[f64], options: &DepthOptions) -> Vec<PairDepth> {
    let [least, greatest] = options.spacing_px;
    let fitted = |fit: &mut PairFit, ends: [usize; 2]| {
        let [a, b] = ends.map(|end| chosen[end]);
        if (a - b).abs() > EDGE_PX {
            return None;
        }
        let start = f64::midpoint(a, b);
        let mut spacing_px = start;
        let mut sigma_px = f64::INFINITY;
        fit.begin(frame, ends);
        for _ in 0..STEPS {
            let step = fit.step(frame, spacing_px)?;
            if step.sigma_px > SIGMA_MAX_PX {
                return None;
            }
            spacing_px += step.step_px.clamp(-LONGEST_PX, LONGEST_PX);
            sigma_px = step.sigma_px;
            if step.step_px.abs() < SHORT_PX {
                break;
            }
        }
        let within = (least..=greatest).contains(&spacing_px) && (spacing_px - start).abs() < EDGE_PX;
        within.then_some(PairDepth { ends, spacing_px, sigma_px })
    };
    frame
        .pairs
        .par_chunks(PIECE)
        .flat_map_iter(|pairs| {
            let mut fit = PairFit::new(&frame.disc);
            pairs.iter().filter_map(|&ends| fitted(&mut fit, ends)).collect::<Vec<_>>()
        })
        .collect()
}
