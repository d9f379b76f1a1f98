//! One raw frame to one measurement: grid, vignetting and spacing together, as the loops and the command line use them.

use std::borrow::Cow;
use std::sync::Arc;

use super::grid::{Grid, GridError, GridOptions, find_grid, refine_grid};
use super::misfit::WhiteMisfit;
use super::mosaic::balanced;
use super::spacing::{
    Spacing, SpacingError, SpacingFrame, SpacingMap, SpacingOptions, measure_spacing, measure_spacing_map,
};
use super::vignetting::{Light, ProfileFit, Vignetting, VignettingError};
use crate::optics::{ArrayKind, CameraDesign};
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
        "the frame's micro-image pitch of {found_px:.2} px does not belong to an MLA pitch of {mla_pitch_px:.2} px, which it must exceed by 0 to {:.0} %: it shows another array, or mla.pitch_mm or sensor.pixel_um are others",
        (most - 1.0) * 100.0
    )]
    OtherPitch {
        /// Micro-image pitch found, px.
        found_px: f64,
        /// D_MLA of the caller's array, px.
        mla_pitch_px: f64,
        /// Greatest that it may be, in MLA pitches.
        most: f64,
    },
    /// The white frame is of another setting.
    #[error(transparent)]
    WhiteMisfit(#[from] WhiteMisfit),
    /// No frame was given.
    #[error("no frame to measure")]
    NoFrame,
}

impl MeasurementError {
    /// What a failure comes to with a white frame whose profile fits a frame so.
    pub(super) fn with_white(failed: SpacingError, fit: Option<ProfileFit>) -> Self {
        WhiteMisfit::behind(&failed, fit).map_or_else(|| failed.into(), Self::from)
    }
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
        Self::with(white, find_grid(white, &GridOptions::default())?)
    }

    /// Grid and profile of a white frame of a camera whose frames are measured in this way: its mosaic and its pitch are
    /// known. A frame of another pitch is taken as it is; it is for [`measure_frame`] to refuse it.
    ///
    /// # Errors
    /// As [`WhiteModel::new`].
    pub fn of(white: &RawImage, options: &FrameOptions) -> Result<Self, MeasurementError> {
        let white = &*evened(white, options.mosaic);
        Self::with(white, expected_grid(white, options)?)
    }

    fn with(white: &RawImage, grid: Grid) -> Result<Self, MeasurementError> {
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
    /// Greatest pitch of micro-images that the array can have, in MLA pitches: they exceed its own by b/d.
    pub most_pitch: f64,
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
            most_pitch: MOST_PITCH,
        }
    }

    /// What a design says of a camera's frames. `pixel_mm` is the side of a pixel.
    #[must_use]
    pub fn of_design(design: &CameraDesign, pixel_mm: f64) -> Self {
        let pitch_px = design.mla.pitch / pixel_mm;
        let exceeds = design.mla.b() / design.air_lens_to_mla();
        Self {
            spacing: SpacingOptions { mode: Some(design.mla.mode), ..SpacingOptions::new(pitch_px) },
            array: Some(design.mla.array),
            most_pitch: MOST_PITCH.max(1.0 + MOST_EXCESS * exceeds),
            ..Self::new(pitch_px)
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
    /// What was divided out of the frame.
    pub light: Arc<Light>,
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
    /// What was divided out of the frame.
    pub light: Arc<Light>,
}

/// Least pitch of micro-images, in MLA pitches, that can be that of an MLA; and the greatest where no design says more.
const LEAST_PITCH: f64 = 0.98;
const MOST_PITCH: f64 = 1.1;
/// How many times b/d micro-images may exceed the MLA's pitch: d and b are not yet set.
const MOST_EXCESS: f64 = 1.3;

/// The grid of a frame whose micro-images' pitch the options know: what is there at a pitch that it can have goes before
/// anything else, and whatever else there is comes before nothing.
///
/// # Errors
/// [`GridError`] where there is no lattice of any pitch.
pub fn expected_grid(image: &RawImage, options: &FrameOptions) -> Result<Grid, GridError> {
    let any = GridOptions::default();
    let [least, most] = [LEAST_PITCH, options.most_pitch]
        .map(|share| (share * options.spacing.mla_pitch_px).clamp(any.pitch_px[0], any.pitch_px[1]));
    let expected = (least < most).then(|| find_grid(image, &GridOptions { pitch_px: [least, most], ..any }));
    expected.and_then(Result::ok).map_or_else(|| find_grid(image, &any), Ok)
}

/// That a grid is one of the array that is wanted.
pub(super) fn check_array(grid: &Grid, options: &FrameOptions) -> Result<(), MeasurementError> {
    if let Some(wanted) = options.array.filter(|&wanted| wanted != grid.array) {
        return Err(MeasurementError::OtherArray { found: grid.array, wanted });
    }
    let (found_px, mla_pitch_px, most) = (grid.pitch_px(), options.spacing.mla_pitch_px, options.most_pitch);
    // Where they cannot be the array's, capture range and target mean nothing for the frame.
    if !(LEAST_PITCH..most).contains(&(found_px / mla_pitch_px)) {
        return Err(MeasurementError::OtherPitch { found_px, mla_pitch_px, most });
    }
    Ok(())
}

/// The frame that grid and vignetting are found in, and views are made of: that of a mosaic evened out.
#[must_use]
pub fn evened(raw: &RawImage, mosaic: Option<CfaPattern>) -> Cow<'_, RawImage> {
    mosaic.map_or(Cow::Borrowed(raw), |pattern| Cow::Owned(balanced(raw, pattern)))
}

/// The micro-images at a frame's own setting, and what is divided out of it.
struct Setting {
    grid: Grid,
    light: Arc<Light>,
    fit: Option<ProfileFit>,
}

impl Setting {
    /// From a white frame, carried to this one.
    fn carried(raw: &RawImage, white: &WhiteModel, options: &FrameOptions) -> Result<Self, MeasurementError> {
        let even = &*evened(raw, options.mosaic);
        let grid = if options.white_at_this_setting {
            white.grid.clone()
        } else {
            refine_grid(even, &white.grid, Some(&white.vignetting))?
        };
        let fit = white.vignetting.fit(even, &grid)?;
        let light = Arc::new(white.vignetting.fitting(&fit, even, &grid)?.over(&grid));
        Ok(Self { light, grid, fit: Some(fit) })
    }

    /// From frames of one pose themselves: from their mean, in which texture that differs between them averages out.
    fn own(raws: &[&RawImage], options: &FrameOptions) -> Result<Self, MeasurementError> {
        let mean = match raws {
            [] => return Err(MeasurementError::NoFrame),
            [only] => Cow::Borrowed(*only),
            several => Cow::Owned(mean(several)?),
        };
        let even = &*evened(&mean, options.mosaic);
        let grid = expected_grid(even, options)?;
        let light = Arc::new(Vignetting::from_textured(even, &grid)?.over(&grid));
        Ok(Self { light, grid, fit: None })
    }

    /// Divides the vignetting out of a frame.
    fn prepared(&self, raw: &RawImage, options: &FrameOptions) -> Result<PreparedFrame, MeasurementError> {
        check_array(&self.grid, options)?;
        let frame = SpacingFrame::new(raw, options.mosaic, &self.light.shares, &self.grid)?;
        Ok(PreparedFrame { frame, grid: self.grid.clone(), vignetting_fit: self.fit, light: Arc::clone(&self.light) })
    }
}

/// The mean of frames of one size, 16 bits deep. A pixel that is saturated in every frame stays so.
fn mean(raws: &[&RawImage]) -> Result<RawImage, MeasurementError> {
    let (width, height) = (raws[0].width(), raws[0].height());
    let mut sums = vec![0.0f32; width * height];
    for raw in raws {
        let frame = [raw.width(), raw.height()];
        if frame != [width, height] {
            return Err(GridError::OtherFrameSize { grid: [width, height], frame }.into());
        }
        let scale = f32::from(u16::MAX) / f32::from(raw.white_level()) / raws.len() as f32;
        sums.iter_mut().zip(raw.to_f32()).for_each(|(sum, sample)| *sum += scale * sample);
    }
    Ok(RawImage::from_u16(width, height, 16, sums.iter().map(|&sum| sum.round() as u16).collect()))
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
    let setting = match white {
        Some(white) => Setting::carried(raw, white, options)?,
        None => Setting::own(&[raw], options)?,
    };
    setting.prepared(raw, options)
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

/// Measures several frames of one pose together; grid and fit of the vignetting are those of the first, or without a
/// white frame those of their mean.
///
/// # Errors
/// [`MeasurementError`] says which part failed and why.
pub fn measure_frames<'a>(
    raws: impl IntoIterator<Item = &'a RawImage>,
    white: Option<&WhiteModel>,
    options: &FrameOptions,
) -> Result<FrameMeasurement, MeasurementError> {
    let raws: Vec<&RawImage> = raws.into_iter().collect();
    let prepared: Vec<PreparedFrame> = match white {
        Some(_) => raws.iter().map(|raw| prepare_frame(raw, white, options)).collect::<Result<_, _>>()?,
        None => {
            let setting = Setting::own(&raws, options)?;
            raws.iter().map(|raw| setting.prepared(raw, options)).collect::<Result<_, _>>()?
        }
    };
    let Some(first) = prepared.first() else { return Err(MeasurementError::NoFrame) };
    let (grid, vignetting_fit, light) = (first.grid.clone(), first.vignetting_fit, Arc::clone(&first.light));
    let frames: Vec<SpacingFrame> = prepared.into_iter().map(|p| p.frame).collect();
    let measured = if options.map {
        measure_spacing_map(&frames, &options.spacing).map(|(spacing, map)| (spacing, Some(map)))
    } else {
        measure_spacing(&frames, &options.spacing).map(|spacing| (spacing, None))
    };
    let (spacing, map) = measured.map_err(|failed| MeasurementError::with_white(failed, vignetting_fit))?;
    Ok(FrameMeasurement { grid, spacing, map, vignetting_fit, light })
}
