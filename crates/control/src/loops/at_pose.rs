//! Measurements of one pose as the loops combine them: as the meter does its frames, one after another until a decision
//! can be made, however long that takes.

use plenoptics::imaging::combined::{Combined, Combining, Single};

/// Measurements of one pose.
#[derive(Debug, Clone)]
pub(crate) struct AtPose {
    combining: Combining,
    count: u32,
}

impl AtPose {
    /// None yet.
    pub(crate) const fn new() -> Self {
        Self { combining: Combining::over(f64::INFINITY), count: 0 }
    }

    /// How many there have been.
    pub(crate) const fn count(&self) -> u32 {
        self.count
    }

    /// What they come to with another one, whose standard uncertainty noise has a part in.
    pub(crate) fn take(&mut self, value: f64, sigma: f64, sigma_random: f64) -> Combined {
        // One after another: what their times are does not matter.
        let at_s = f64::from(self.count);
        self.count += 1;
        self.combining.take(Single { at_s, value, sigma_scatter: sigma, sigma_random, sigma_model: 0.0 })
    }
}
