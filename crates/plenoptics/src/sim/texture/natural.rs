//! Random texture with the spectrum of natural scenes.

use super::noise::natural;

/// 1/f noise from a sixth of the period down, through a soft limiter that spreads the values over the whole range.
pub(super) fn generate(side: usize, seed: u64) -> Vec<f32> {
    natural(side, seed, 6.0, 1.0).iter().map(|v| 0.5 + 0.5 * (0.9 * v).tanh()).collect()
}
