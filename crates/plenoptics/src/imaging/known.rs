//! What is known of a frame that cannot be measured: whatever fails, what comes before it holds.

use super::grid::{Grid, pixel_noise, refine_grid};
use super::measurement::{FrameOptions, WhiteModel, evened, expected_grid};
use super::spacing::noise_about;
use crate::raw::RawImage;

/// What is known of a frame without a spacing.
#[derive(Debug, Clone, PartialEq)]
pub struct Known {
    /// Its micro-images, by the white frame where that one's are found in it, or else by itself; `None` where it has none.
    pub grid: Option<Grid>,
    /// Standard deviation of its noise as far as one frame by itself shows it, grey levels: within the micro-images where
    /// they are known and lit, or else from what its flattest parts leave. `None` where too many pixels are clipped for that.
    pub noise_grey_levels: Option<f64>,
}

impl Known {
    /// Of a frame that was to be measured in this way.
    #[must_use]
    pub fn of(raw: &RawImage, white: Option<&WhiteModel>, options: &FrameOptions) -> Self {
        let even = &*evened(raw, options.mosaic);
        let carried = white.and_then(|white| refine_grid(even, &white.grid, Some(&white.vignetting)).ok());
        let grid = carried.or_else(|| expected_grid(even, options).ok());
        let within = grid.as_ref().and_then(|grid| noise_about(raw, options.mosaic, grid));
        let noise_grey_levels = within.or_else(|| pixel_noise(even));
        Self { grid, noise_grey_levels }
    }
}
