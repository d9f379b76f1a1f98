//! The micro-image pitch of a frame with its uncertainty: D (d + b)/d, one more equation for d and b.

use crate::imaging::grid::Grid;

/// Where the micro-image pitch of a calibration is taken from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PitchSource {
    /// The frame of the boards.
    Frame,
    /// Measured elsewhere at the same Δv: in a white frame it is many times as sharp.
    Given(MicroImagePitch),
}

/// A measured micro-image pitch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MicroImagePitch {
    /// Distance of neighbouring micro-images, px.
    pub pitch_px: f64,
    /// Its standard uncertainty, px.
    pub sigma_px: f64,
}

impl MicroImagePitch {
    /// The pitch of a grid found in a frame.
    #[must_use]
    pub fn of(grid: &Grid) -> Self {
        Self { pitch_px: grid.pitch_px(), sigma_px: grid.sigma.pitch_px }
    }
}
