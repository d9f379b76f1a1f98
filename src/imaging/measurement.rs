//! One raw frame to one measurement: grid, vignetting and spacing together, as the loops and the command line use them.

use std::borrow::Cow;

use super::grid::{Grid, GridError, GridOptions, find_grid, refine_grid};
use super::mosaic::balanced;
use super::spacing::{
    SLOPE_SIGMA_PX, Spacing, SpacingError, SpacingFrame, SpacingMap, SpacingOptions, measure_spacing,
    measure_spacing_map,
};
use super::vignetting::{ProfileFit, Vignetting, VignettingError};
use crate::optics::ArrayKind;
use crate::raw::{CfaPattern, RawImage};

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
    /// The frame shows another pitch than the caller's array has.
    #[error(
        "the frame's micro-image pitch of {found_px:.2} px does not belong to an MLA pitch of {mla_pitch_px:.2} px, which it must exceed by 0 to 10 %: it shows another array, or mla.pitch_mm or sensor.pixel_um are others"
    )]
    OtherPitch {
        /// Micro-image pitch found, px.
        found_px: f64,
        /// D_MLA of the caller's array, px.
        mla_pitch_px: f64,
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
        Self::of(white, None)
    }

    /// Grid and profile of a white frame, of a sensor with a Bayer mosaic where one is given.
    ///
    /// # Errors
    /// As [`WhiteModel::new`].
    pub fn of(white: &RawImage, mosaic: Option<CfaPattern>) -> Result<Self, MeasurementError> {
        let white = &*evened(white, mosaic);
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
    /// The mosaic of the sensor; `None` where it is monochrome.
    pub mosaic: Option<CfaPattern>,
    /// What every single micro-image makes of the spacing is wanted too.
    pub map: bool,
}

impl FrameOptions {
    /// Nothing known but the MLA pitch, px.
    #[must_use]
    pub const fn new(mla_pitch_px: f64) -> Self {
        Self {
            spacing: SpacingOptions::new(mla_pitch_px),
            array: None,
            white_at_this_setting: false,
            mosaic: None,
            map: false,
        }
    }
}

/// Everything measured in a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameMeasurement {
    /// The micro-images at the frame's own setting.
    pub grid: Grid,
    /// The spacing.
    pub spacing: Spacing,
    /// What every micro-image makes of it, where that was asked for.
    pub map: Option<SpacingMap>,
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

/// Whether micro-images of this pitch can be those of an MLA of that pitch (both px): they exceed it by b/d, a few per
/// cent. Where they cannot, capture range and target mean nothing for the frame.
fn pitches_belong(micro_image_pitch_px: f64, mla_pitch_px: f64) -> bool {
    (0.98..1.1).contains(&(micro_image_pitch_px / mla_pitch_px))
}

/// The frame that grid and vignetting are found in, and views are made of: that of a mosaic evened out.
#[must_use]
pub fn evened(raw: &RawImage, mosaic: Option<CfaPattern>) -> Cow<'_, RawImage> {
    mosaic.map_or(Cow::Borrowed(raw), |pattern| Cow::Owned(balanced(raw, pattern)))
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
    let even = &*evened(raw, options.mosaic);
    let (grid, vignetting, vignetting_fit) = match white {
        Some(white) => {
            let grid = if options.white_at_this_setting {
                white.grid.clone()
            } else {
                refine_grid(even, &white.grid, Some(&white.vignetting))?
            };
            let fit = white.vignetting.fit(even, &grid)?;
            let map = white.vignetting.render(&grid);
            (grid, map, Some(fit))
        }
        None => {
            let grid = find_grid(even, &GridOptions::default())?;
            let map = Vignetting::from_textured(even, &grid)?.render(&grid);
            (grid, map, None)
        }
    };
    if let Some(wanted) = options.array.filter(|&wanted| wanted != grid.array) {
        return Err(MeasurementError::OtherArray { found: grid.array, wanted });
    }
    let mla_pitch_px = options.spacing.mla_pitch_px;
    if !pitches_belong(grid.pitch_px(), mla_pitch_px) {
        return Err(MeasurementError::OtherPitch { found_px: grid.pitch_px(), mla_pitch_px });
    }
    let frame = SpacingFrame::of(raw, options.mosaic, &vignetting, &grid, SLOPE_SIGMA_PX)?;
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
    let (spacing, map) = if options.map {
        let (spacing, map) = measure_spacing_map(&frames, &options.spacing)?;
        (spacing, Some(map))
    } else {
        (measure_spacing(&frames, &options.spacing)?, None)
    };
    Ok(FrameMeasurement { grid, spacing, map, vignetting_fit })
}
