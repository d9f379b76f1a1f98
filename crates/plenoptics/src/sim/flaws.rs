//! What lies in the light's way and does not belong there: dust before the sensor, dead and dirty microlenses, bubbles
//! before the camera. Drawn from a seed, or put together by hand.

use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// A round speck between sensor and array.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Speck {
    /// Its centre, x and y on the sensor from the axis, mm.
    pub place: [f64; 2],
    /// mm.
    pub radius: f64,
    /// Share of the light that it takes, 0 to 1.
    pub opacity: f64,
    /// How far before the sensor it lies, mm: 0 on it, less than b.
    pub height: f64,
}

/// A sphere of air in the water, or of water in air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bubble {
    /// Its centre's x and y from the axis, mm.
    pub place: [f64; 2],
    /// Distance of its centre, mm: as a board's, in air from M, in water from the shell's outer vertex.
    pub distance: f64,
    /// mm.
    pub radius: f64,
    /// Radiance of the lamp that it mirrors; a white board has 1.
    pub highlight: f64,
}

/// How a microlens is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MicrolensState {
    /// It lets all light through.
    Clean,
    /// It lets none through.
    Dead,
    /// It lets some through.
    Dirty {
        /// Transmission at its centre.
        mean: f32,
        /// How fast the transmission grows along +x and +y, for each radius of its aperture.
        slope: [f32; 2],
    },
}

/// Which microlenses are dead or dirty: each by itself, from the seed and its place in the lattice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MicrolensFlaws {
    /// Seed of which.
    pub seed: u64,
    /// Share that is dead, 0 to 1.
    pub dead_share: f64,
    /// Share that is dirty, 0 to 1.
    pub dirty_share: f64,
    /// Least and greatest transmission of a dirty one, 0 to 1: two are drawn, for opposite edges of its aperture.
    pub dirty_transmission: [f64; 2],
}

impl MicrolensFlaws {
    /// All clean.
    pub const NONE: Self = Self { seed: 0, dead_share: 0.0, dirty_share: 0.0, dirty_transmission: [1.0, 1.0] };

    /// Whether every microlens is clean.
    #[must_use]
    pub fn none(&self) -> bool {
        self.dead_share == 0.0 && self.dirty_share == 0.0
    }

    /// How the microlens with these lattice indices is.
    #[must_use]
    pub fn state(&self, index: [i32; 2]) -> MicrolensState {
        if self.none() {
            return MicrolensState::Clean;
        }
        let place = u64::from(index[0] as u32) << 32 | u64::from(index[1] as u32);
        let mut random = Pcg64::seed_from_u64(self.seed ^ place.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let lot: f64 = random.random();
        if lot < self.dead_share {
            return MicrolensState::Dead;
        }
        if lot >= self.dead_share + self.dirty_share {
            return MicrolensState::Clean;
        }
        let [one, other] = [(); 2].map(|()| between(&mut random, self.dirty_transmission));
        let (sin, cos) = random.random_range(0.0..std::f64::consts::TAU).sin_cos();
        let slope = (other - one) / 2.0;
        MicrolensState::Dirty {
            mean: ((one + other) / 2.0) as f32,
            slope: [(slope * cos) as f32, (slope * sin) as f32],
        }
    }
}

/// Everything in the light's way.
#[derive(Debug, Clone, PartialEq)]
pub struct Flaws {
    /// Dust, in any order.
    pub dust: Vec<Speck>,
    /// Bubbles, in any order and none within another.
    pub bubbles: Vec<Bubble>,
    /// The microlenses.
    pub microlenses: MicrolensFlaws,
}

impl Default for Flaws {
    fn default() -> Self {
        Self { dust: Vec::new(), bubbles: Vec::new(), microlenses: MicrolensFlaws::NONE }
    }
}

/// A value drawn evenly from a range.
fn between(random: &mut impl Rng, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * random.random::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_of_dead_and_dirty_microlenses_are_those_asked_for() {
        let flaws = MicrolensFlaws { seed: 3, dead_share: 0.02, dirty_share: 0.3, dirty_transmission: [0.4, 0.8] };
        let (mut dead, mut dirty, mut sum) = (0, 0, 0.0);
        for i in -100..100 {
            for j in -100..100 {
                match flaws.state([i, j]) {
                    MicrolensState::Clean => {}
                    MicrolensState::Dead => dead += 1,
                    MicrolensState::Dirty { mean, slope } => {
                        dirty += 1;
                        sum += f64::from(mean);
                        let edge = slope[0].hypot(slope[1]);
                        assert!(mean - edge >= 0.399 && mean + edge <= 0.801, "{mean} ± {edge}");
                    }
                }
            }
        }
        // Standard errors 28, 92 and 0.0007.
        assert!((dead - 800i32).abs() < 110 && (dirty - 12_000i32).abs() < 370, "{dead} dead, {dirty} dirty");
        assert!((sum / f64::from(dirty) - 0.6).abs() < 0.004, "{sum}");
        assert_eq!(MicrolensFlaws::NONE.state([5, -7]), MicrolensState::Clean);
    }
}
