//! The micro-image pitch of a frame with its uncertainty: D (d + b)/d, one more equation for d and b.

use crate::imaging::grid::{Grid, GridError, lens_residuals};
use crate::raw::RawImage;

/// Blocks across the frame whose disagreement gives the uncertainty: what neighbours have in common (texture, shading)
/// does not average out over them as noise does.
const BLOCKS: usize = 8;
/// Micro-images with less contrast than this share of the median say nothing.
const LEAST_CONTRAST: f64 = 0.3;

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
    /// The pitch of the grid fitted to a frame, with the scatter between blocks of the frame as uncertainty.
    ///
    /// # Errors
    /// [`GridError`] where the frame does not have this grid.
    pub fn of(image: &RawImage, grid: &Grid) -> Result<Self, GridError> {
        let lenses = lens_residuals(image, grid)?;
        let size = grid.frame_size.map(|s| s as f64);
        let mut blocks = [[0.0; BLOCKS]; BLOCKS];
        let mut square = 0.0;
        for lens in lenses.iter().filter(|lens| lens.contrast > LEAST_CONTRAST) {
            let at = [lens.micro_image.x, lens.micro_image.y];
            let from = [0, 1].map(|k| at[k] - grid.centre[k]);
            let block = [0, 1].map(|k| ((at[k] / size[k] * BLOCKS as f64) as usize).min(BLOCKS - 1));
            blocks[block[0]][block[1]] += from[0] * lens.offset_px[0] + from[1] * lens.offset_px[1];
            square += from[0] * from[0] + from[1] * from[1];
        }
        let scatter: f64 = blocks.iter().flatten().map(|sum| sum * sum).sum();
        let pitch_px = grid.pitch_px();
        Ok(Self { pitch_px, sigma_px: pitch_px * scatter.sqrt() / square })
    }
}
