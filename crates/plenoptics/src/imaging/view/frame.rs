//! A raw frame made ready for views.

use rayon::prelude::*;

use super::ViewError;
use crate::imaging::depth::{DepthFrame, DepthMap, DepthOptions};
use crate::imaging::grid::Grid;
use crate::imaging::measurement::evened;
use crate::imaging::mosaic::colours;
use crate::imaging::spacing::SpacingError;
use crate::imaging::vignetting::Light;
use crate::raw::{CfaPattern, RawImage, Samples};

/// Transmission below which a pixel is not divided by it but by this: a gap stays dark instead of becoming noise.
const TRANSMISSION_LEAST: f32 = 0.1;
/// Part of a micro-image's radius that is used where no profile says how far it is lit.
const USED_PART: f64 = 0.85;

/// A frame with its vignetting divided out and the colours of its mosaic filled in.
#[derive(Debug, Clone)]
pub struct ViewFrame {
    /// Where its micro-images are.
    pub grid: Grid,
    /// The mosaic whose colours were filled in.
    mosaic: Option<CfaPattern>,
    /// Grey, or red, green and blue.
    pub(super) planes: Vec<Vec<f32>>,
    /// Radius about a micro-image's centre that is used, px.
    pub(super) radius: f64,
}

impl ViewFrame {
    /// Makes a frame ready; where it is not known what light reaches its pixels it keeps its vignetting. A mosaic's
    /// colours are brought to one mean.
    ///
    /// # Errors
    /// [`ViewError::OtherFrameSize`] where grid and frame do not belong together.
    pub fn new(
        raw: &RawImage,
        mosaic: Option<CfaPattern>,
        grid: &Grid,
        light: Option<&Light>,
    ) -> Result<Self, ViewError> {
        let size = [raw.width(), raw.height()];
        if size != grid.frame_size {
            return Err(ViewError::OtherFrameSize { grid: grid.frame_size, frame: size });
        }
        if light.is_some_and(|light| light.shares.len() != size[0] * size[1]) {
            return Err(ViewError::OtherFrameSize { grid: grid.frame_size, frame: size });
        }
        Ok(Self::of(&evened(raw, mosaic), mosaic, grid, light))
    }

    /// From a frame whose mosaic is evened out, of the grid's size as the light is.
    pub(in crate::imaging) fn of(
        even: &RawImage,
        mosaic: Option<CfaPattern>,
        grid: &Grid,
        light: Option<&Light>,
    ) -> Self {
        let values = divided(even, light);
        let half = grid.pitch_px() / 2.0;
        let radius = light.map_or(USED_PART * half, |light| light.usable_radius_px.min(half));
        let planes = match mosaic {
            None => vec![values],
            Some(pattern) => colours(&values, pattern, grid).into(),
        };
        Self { grid: grid.clone(), mosaic, planes, radius }
    }

    /// The spacing of every micro-image; that of green where the sensor has a mosaic.
    ///
    /// # Errors
    /// [`SpacingError`] where there are too few micro-images.
    pub fn depth_map(&self, options: &DepthOptions) -> Result<DepthMap, SpacingError> {
        // Grey is the first of one plane, green the second of three.
        let plane = &self.planes[self.planes.len() / 2];
        Ok(DepthFrame::new(plane, self.mosaic, &self.grid)?.depth_map(options))
    }

    /// Radius about a micro-image's centre that is used, px: the unit of a view's direction.
    #[must_use]
    pub const fn used_radius_px(&self) -> f64 {
        self.radius
    }
}

/// A frame's samples, each divided by the share of light that reaches it.
fn divided(raw: &RawImage, light: Option<&Light>) -> Vec<f32> {
    let Some(Light { shares, .. }) = light else { return raw.to_f32() };
    match raw.samples() {
        Samples::U8(samples) => shared_out(samples, shares),
        Samples::U16(samples) => shared_out(samples, shares),
    }
}

fn shared_out<T: Copy + Into<f32> + Sync>(samples: &[T], transmission: &[f32]) -> Vec<f32> {
    samples
        .par_iter()
        .zip(transmission)
        .with_min_len(1 << 14)
        .map(|(&sample, &share)| sample.into() / share.max(TRANSMISSION_LEAST))
        .collect()
}
