//! One raw frame to one measurement: grid, vignetting and spacing together, as the loops and the command line use them.

use super::grid::{Grid, GridError, GridOptions, find_grid, refine_grid};
use super::spacing::{SLOPE_SIGMA_PX, Spacing, SpacingError, SpacingFrame, SpacingOptions, measure_spacing};
use super::vignetting::{ProfileFit, Vignetting, VignettingError};
use crate::optics::ArrayKind;
use crate::raw::RawImage;

/// Why a frame could not be measured.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeasurementError {
    /// The micro-images were not found.
    #[error("grid: {0}")]
    Grid(#[from] GridError),
    /// The vignetting could not be modelled.
    #[error("vignetting: {0}")]
    Vignetting(#[from] VignettingError),
    /// The spacing could not be measured.
    #[error("spacing: {0}")]
    Spacing(#[from] SpacingError),
    /// The frame shows another array than the caller demands.
    #[error("the frame shows a {} array, the configuration says {}", found.name(), wanted.name())]
    OtherArray {
        /// What the frame shows.
        found: ArrayKind,
        /// What the caller demands.
        wanted: ArrayKind,
    },
    /// No frame was given.
    #[error("no frame to measure")]
    NoFrame,
}

/// What a white frame says, to be carried to the frames that are measured.
#[derive(Debug, Clone, PartialEq)]
pub struct WhiteModel {
    /// The micro-images of the white frame.
    pub grid: Grid,
    /// The noise-free profile of a micro-image.
    pub vignetting: Vignetting,
}

impl WhiteModel {
    /// Grid and profile of a white frame.
    ///
    /// # Errors
    /// [`MeasurementError`] where the frame has no grid or no light.
    pub fn new(white: &RawImage) -> Result<Self, MeasurementError> {
        let grid = find_grid(white, &GridOptions::default())?;
        let vignetting = Vignetting::from_white(white, &grid)?;
        Ok(Self { grid, vignetting })
    }
}

/// How a frame is to be measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameOptions {
    /// What is known about the spacing.
    pub spacing: SpacingOptions,
    /// The array the frame must show; any where `None`.
    pub array: Option<ArrayKind>,
    /// The white frame was taken at this very setting: its grid holds as it is, and is better than one fitted to a
    /// textured frame.
    pub white_at_this_setting: bool,
}

impl FrameOptions {
    /// Nothing known but the MLA pitch, px.
    #[must_use]
    pub const fn new(mla_pitch_px: f64) -> Self {
        Self { spacing: SpacingOptions::new(mla_pitch_px), array: None, white_at_this_setting: false }
    }
}

/// Everything measured in a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameMeasurement {
    /// The micro-images at the frame's own setting.
    pub grid: Grid,
    /// The spacing.
    pub spacing: Spacing,
    /// How well the white frame's profile fits the frame; `None` where there was no white frame.
    pub vignetting_fit: Option<ProfileFit>,
}

/// A frame ready for [`measure_spacing`], with what was found on the way.
#[derive(Debug, Clone)]
pub struct PreparedFrame {
    /// The frame itself.
    pub frame: SpacingFrame,
    /// The micro-images at the frame's own setting.
    pub grid: Grid,
    /// How well the white frame's profile fits the frame; `None` where there was no white frame.
    pub vignetting_fit: Option<ProfileFit>,
}

/// Finds a frame's micro-images and divides its vignetting out. Without a white frame both come from the frame itself.
///
/// # Errors
/// [`MeasurementError`] says which part failed and why.
pub fn prepare_frame(
    raw: &RawImage,
    white: Option<&WhiteModel>,
    options: &FrameOptions,
) -> Result<PreparedFrame, MeasurementError> {
    let (grid, vignetting, vignetting_fit) = match white {
        Some(white) => {
            let grid = if options.white_at_this_setting {
                white.grid.clone()
            } else {
                refine_grid(raw, &white.grid, Some(&white.vignetting))?
            };
            let fit = white.vignetting.fit(raw, &grid)?;
            let map = white.vignetting.render(&grid);
            (grid, map, Some(fit))
        }
        None => {
            let grid = find_grid(raw, &GridOptions::default())?;
            let map = Vignetting::from_textured(raw, &grid)?.render(&grid);
            (grid, map, None)
        }
    };
    if let Some(wanted) = options.array.filter(|&wanted| wanted != grid.array) {
        return Err(MeasurementError::OtherArray { found: grid.array, wanted });
    }
    let frame = SpacingFrame::new(raw, &vignetting, &grid, SLOPE_SIGMA_PX)?;
    Ok(PreparedFrame { frame, grid, vignetting_fit })
}

/// Measures one frame.
///
/// # Errors
/// [`MeasurementError`] says which part failed and why.
pub fn measure_frame(
    raw: &RawImage,
    white: Option<&WhiteModel>,
    options: &FrameOptions,
) -> Result<FrameMeasurement, MeasurementError> {
    measure_frames([raw], white, options)
}

/// Measures several frames of one pose together; grid and fit of the vignetting are those of the first.
///
/// # Errors
/// [`MeasurementError`] says which part failed and why.
pub fn measure_frames<'a>(
    raws: impl IntoIterator<Item = &'a RawImage>,
    white: Option<&WhiteModel>,
    options: &FrameOptions,
) -> Result<FrameMeasurement, MeasurementError> {
    let prepared = raws.into_iter().map(|raw| prepare_frame(raw, white, options)).collect::<Result<Vec<_>, _>>()?;
    let Some(first) = prepared.first() else { return Err(MeasurementError::NoFrame) };
    let (grid, vignetting_fit) = (first.grid.clone(), first.vignetting_fit);
    let frames: Vec<SpacingFrame> = prepared.into_iter().map(|p| p.frame).collect();
    let spacing = measure_spacing(&frames, &options.spacing)?;
    Ok(FrameMeasurement { grid, spacing, vignetting_fit })
}
