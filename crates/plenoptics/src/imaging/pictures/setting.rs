//! Where the micro-images of one setting are, and what is divided out of its frames.

use crate::imaging::grid::{Grid, GridState, check_grid, refine_grid};
use crate::imaging::measurement::{FrameOptions, MeasurementError, WhiteModel, check_array, expected_grid};
use crate::imaging::spacing::{MASK_FRACTION, SpacingError};
use crate::imaging::vignetting::{Light, Vignetting};
use crate::raw::{RawImage, Samples};

/// Share of saturated pixels within the micro-images above which a frame is refused.
const SATURATED_SHARE: f64 = 0.4;
/// Mean grey level below which a frame is too dark: a part of the white level, and so many grey levels at most.
const DARK: (f64, f64) = (0.012, 3.0);
/// About so many micro-images tell how a frame is exposed.
const SAMPLE: usize = 400;

/// That a frame is neither saturated nor dark.
pub(super) fn check_exposure(raw: &RawImage, grid: &Grid) -> Result<(), SpacingError> {
    let white = f64::from(raw.white_level());
    let (share, mean) = match raw.samples() {
        Samples::U8(samples) => exposure(samples, white, grid),
        Samples::U16(samples) => exposure(samples, white, grid),
    };
    let least = (white * DARK.0).min(DARK.1);
    if share > SATURATED_SHARE {
        return Err(SpacingError::Saturated { share });
    }
    if mean < least { Err(SpacingError::Dark { mean, least }) } else { Ok(()) }
}

/// Share of saturated pixels and mean grey level, over the squares within a sample of the micro-images.
fn exposure<T: Copy + Into<f64>>(samples: &[T], white: f64, grid: &Grid) -> (f64, f64) {
    let [width, height] = grid.frame_size;
    let half = 0.5 * grid.pitch_px() * MASK_FRACTION * std::f64::consts::FRAC_1_SQRT_2;
    let step = (width * height / (SAMPLE * (grid.pitch_px().powi(2) as usize).max(1))).max(1) | 1;
    let (mut saturated, mut sum, mut count) = (0.0, 0.0, 0.0);
    for m in grid.micro_images_within(half + 1.0).step_by(step) {
        for y in (m.y - half).ceil() as usize..=(m.y + half) as usize {
            for &sample in &samples[y * width + (m.x - half).ceil() as usize..=y * width + (m.x + half) as usize] {
                let sample: f64 = sample.into();
                saturated += f64::from(sample >= white);
                sum += sample;
                count += 1.0;
            }
        }
    }
    (saturated / f64::max(count, 1.0), sum / f64::max(count, 1.0))
}

/// One setting of the camera. It stays from frame to frame for as long as the grid fits.
#[derive(Debug, Clone)]
pub(super) struct Setting {
    pub(super) grid: Grid,
    profile: Vignetting,
    /// What is divided out.
    pub(super) light: Light,
}

impl Setting {
    /// From a frame with its mosaic evened out, and a white frame of this or another setting where there is one.
    pub(super) fn of(
        even: &RawImage,
        white: Option<&WhiteModel>,
        options: &FrameOptions,
    ) -> Result<Self, MeasurementError> {
        let (grid, profile) = match white {
            Some(white) if options.white_at_this_setting => (white.grid.clone(), white.vignetting.clone()),
            Some(white) => (refine_grid(even, &white.grid, Some(&white.vignetting))?, white.vignetting.clone()),
            None => {
                let grid = expected_grid(even, options)?;
                let profile = Vignetting::from_textured(even, &grid)?;
                (grid, profile)
            }
        };
        check_array(&grid, options)?;
        Ok(Self::with(grid, profile))
    }

    fn with(grid: Grid, profile: Vignetting) -> Self {
        Self { light: profile.over(&grid), grid, profile }
    }

    /// Follows the array to another frame: this very setting while its grid fits, one with the grid moved where the array
    /// has moved, and none where nothing of it is to be seen.
    pub(super) fn followed(self, even: &RawImage) -> Option<Self> {
        match check_grid(even, &self.grid, Some(&self.profile)).map(|check| check.state()) {
            Ok(GridState::Fits) => Some(self),
            Ok(GridState::Moved) => {
                let grid = refine_grid(even, &self.grid, Some(&self.profile)).ok()?;
                Some(Self::with(grid, self.profile))
            }
            Ok(GridState::Lost) | Err(_) => None,
        }
    }
}
