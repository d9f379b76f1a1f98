//! One pair of neighbours fitted by itself.

use super::frame::{Pair, SpacingFrame};
use super::model::QUANTISATION;
use super::patch::{Patch, Placed};
use super::score::order;

/// What a pair says about its spacing at a guess.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairStep {
    /// From the guess to the best spacing, px; right to hundredths within half a pixel or so.
    pub step_px: f64,
    /// Standard uncertainty, px: noise, and how badly the two match.
    pub sigma_px: f64,
}

/// Fits single pairs, with buffers that are used again.
#[derive(Debug, Default)]
pub struct PairFit(Patch);

impl PairFit {
    /// One step of Newton's from a guess (px). `None` where the two hardly overlap, or nothing in them changes along the
    /// pair.
    pub fn step(&mut self, frame: &SpacingFrame, pair: Pair, guess_px: f64) -> Option<PairStep> {
        let noise = frame.noise.max(QUANTISATION);
        let (mut score, mut information, mut variance, mut misfit) = (0.0, 0.0, 0.0, 0.0);
        for (a, b) in [(pair.first, pair.second), (pair.second, pair.first)] {
            let sums = self.0.compare(Placed { frame, a, b, spacing: [guess_px, 0.0], radius: frame.radius })?;
            let order = order(&sums, noise, frame.slope_noise);
            score += order.score[0];
            information += order.information[0][0];
            // Both orders see the same noise: their scores add, not their variances.
            variance += 4.0 * noise * noise * order.energy;
            misfit += 0.5 * order.misfit;
        }
        if information <= 0.0 {
            return None;
        }
        Some(PairStep {
            step_px: score / information,
            sigma_px: (variance * f64::max(misfit, 1.0)).sqrt() / information,
        })
    }
}
