//! A raw frame made ready for views.

use rayon::prelude::*;

use super::ViewError;
use crate::imaging::grid::Grid;
use crate::imaging::measurement::evened;
use crate::imaging::mosaic::colours;
use crate::imaging::vignetting::Light;
use crate::raw::{CfaPattern, RawImage};

/// Transmission below which a pixel is not divided by it but by this: a gap stays dark instead of becoming noise.
const TRANSMISSION_LEAST: f32 = 0.1;
/// Part of a micro-image's radius that is used where no profile says how far it is lit.
const USED_PART: f64 = 0.85;

/// A frame with its vignetting divided out and the colours of its mosaic filled in.
#[derive(Debug, Clone)]
pub struct ViewFrame {
    /// Where its micro-images are.
    pub grid: Grid,
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
        let mut values = evened(raw, mosaic).to_f32();
        let half = grid.pitch_px() / 2.0;
        let mut radius = USED_PART * half;
        if let Some(light) = light {
            if light.shares.len() != values.len() {
                return Err(ViewError::OtherFrameSize { grid: grid.frame_size, frame: size });
            }
            values
                .par_iter_mut()
                .zip(&light.shares)
                .with_min_len(1 << 14)
                .for_each(|(value, &share)| *value /= share.max(TRANSMISSION_LEAST));
            radius = light.usable_radius_px.min(half);
        }
        let planes = match mosaic {
            None => vec![values],
            Some(pattern) => colours(&values, pattern, grid).into(),
        };
        Ok(Self { grid: grid.clone(), planes, radius })
    }

    /// Radius about a micro-image's centre that is used, px: the unit of a view's direction.
    #[must_use]
    pub const fn used_radius_px(&self) -> f64 {
        self.radius
    }
}
