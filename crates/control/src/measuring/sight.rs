//! Imaging as the loops need it: what a white frame teaches, and what is read from frames with it. Plain functions,
//! called away from the runtime's threads.

mod boards;

use std::sync::Arc;

use crate::budget::BoardSeen;
use crate::events::TwoBoardsView;
use crate::measuring::not_measured::NotMeasured;
use crate::spacing::SpacingReading;
use bench::config::Config;
use plenoptics::imaging::clarity::Eog;
use plenoptics::imaging::depth::DepthOptions;
use plenoptics::imaging::grid::{Grid, GridError};
use plenoptics::imaging::live::{LiveMeter, LiveOptions};
use plenoptics::imaging::measurement::{
    FrameMeasurement, FrameOptions, MeasurementError, WhiteModel, measure_frames, prepare_frame,
};
use plenoptics::imaging::spacing::{Spacing, SpacingError, SpacingMap, SpacingOptions};
use plenoptics::imaging::view::{View, ViewFrame, ViewOptions};
use plenoptics::imaging::{clarity, view};
use plenoptics::optics::CameraDesign;
use plenoptics::optics::mla::micro_image_pitch;
use plenoptics::raw::RawImage;

/// JPEG quality of the pictures kept with a job.
const JPEG_QUALITY: u8 = 85;

/// What boards in air say about the camera.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CameraSeen {
    /// d, mm.
    pub(crate) lens_to_mla_mm: f64,
    /// b, mm.
    pub(crate) mla_to_sensor_mm: f64,
    /// d + N b at the design N: v_ADJ, mm.
    pub(crate) image_distance_mm: f64,
    /// Its standard uncertainty, mm.
    pub(crate) image_distance_sigma_mm: f64,
    /// Where most of that is an error shared by neighbouring poses, what they scatter by without it, mm.
    pub(crate) repeatability_mm: Option<f64>,
    /// The boards one by one, where they could be told apart.
    pub(crate) boards: Option<[BoardSeen; 3]>,
}

/// How b is held while Δv is far from where it is wanted: the boards then cannot tell it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct HoldB {
    /// Standard uncertainty of the configured b, mm.
    pub(crate) sigma_mm: f64,
    /// Nearer to the wanted d + N b than this, b is told from the boards after all, mm.
    pub(crate) beyond_mm: f64,
    /// The d + N b wanted, mm.
    pub(crate) image_distance_mm: f64,
}

/// What was read from frames of one pose.
#[derive(Debug, Clone)]
pub(crate) struct Measured {
    /// The spacing.
    pub(crate) spacing: SpacingReading,
    /// Pitch of the micro-images, px.
    pub(crate) micro_image_pitch_px: f64,
    /// Its standard uncertainty, px.
    pub(crate) micro_image_pitch_sigma_px: f64,
    /// The part of the spacing's standard uncertainty that is from pixel noise, px.
    pub(crate) sigma_random_px: f64,
    /// Standard uncertainty of either tilt, px per half frame width.
    pub(crate) tilt_sigma_px: f64,
    /// Radius of the masks that pairs were compared with, px.
    pub(crate) window_px: f64,
    /// Energy of gradient of the central view of the last frame, of a single board.
    pub(crate) eog: Option<Eog>,
    /// Structural similarity of its micro-images with their neighbours, mean.
    pub(crate) ssim: Option<f64>,
    /// The central view of the last frame, a JPEG, of a single board.
    pub(crate) picture: Option<Arc<Vec<u8>>>,
    /// The spacing micro-image by micro-image, of a single board.
    pub(crate) map: Option<Arc<SpacingMap>>,
    /// Two boards that are in view, where a single one was looked for.
    pub(crate) two_boards: Option<TwoBoardsView>,
}

impl Measured {
    /// A spacing with the part of its standard uncertainty that is from pixel noise (px), and without a picture. The tilts'
    /// standard uncertainties (px) are what the field's blocks scatter by.
    fn new(
        spacing: SpacingReading,
        sigma_random_px: f64,
        tilt_sigmas_px: [f64; 2],
        grid: &Grid,
        window_px: f64,
    ) -> Self {
        Self {
            tilt_sigma_px: tilt_sigmas_px.into_iter().fold(spacing.least_tilt_sigma_px(), f64::max),
            spacing,
            micro_image_pitch_px: grid.pitch_px(),
            micro_image_pitch_sigma_px: grid.sigma.pitch_px,
            sigma_random_px,
            window_px,
            eog: None,
            ssim: None,
            picture: None,
            map: None,
            two_boards: None,
        }
    }

    /// What was read, where it is of one board. Where it is of two nothing is looked for elsewhere: a person has to take one
    /// away.
    ///
    /// # Errors
    /// That there are two.
    pub(crate) fn of_one_board(self) -> Result<Self, NotMeasured> {
        let Some(TwoBoardsView { spacings_px, share, .. }) = self.two_boards else {
            return Ok(self);
        };
        let [larger, smaller] = spacings_px;
        let why = format!(
            "the picture shows two boards where one flat board was asked for: a spacing of {larger:.2} px over {:.0} % of \
             it and of {smaller:.2} px over {:.0} %; take one of them away, or let one fill the picture",
            100.0 * (1.0 - share),
            100.0 * share
        );
        Err(NotMeasured::TwoBoards { why, spacings_px })
    }
}

/// Grid and vignetting learnt from a white frame, and what is known of the camera.
#[derive(Clone)]
pub(crate) struct Sight {
    white: WhiteModel,
    design: CameraDesign,
    pixel_mm: f64,
    options: FrameOptions,
    /// What the configuration and the white frame disagree on, in words.
    disagreement: Option<String>,
}

/// Why frames say nothing, in words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Unseen {
    /// They are smeared as by a change of the spacing: others may not be.
    Smeared(String),
    /// Whatever else.
    Other(String),
}

impl From<MeasurementError> for Unseen {
    fn from(error: MeasurementError) -> Self {
        match error {
            MeasurementError::Spacing(SpacingError::Moved { .. }) => Self::Smeared(error.to_string()),
            _ => Self::Other(error.to_string()),
        }
    }
}

impl From<String> for Unseen {
    fn from(why: String) -> Self {
        Self::Other(why)
    }
}

impl From<Unseen> for String {
    fn from(unseen: Unseen) -> Self {
        match unseen {
            Unseen::Smeared(why) | Unseen::Other(why) => why,
        }
    }
}

impl Sight {
    /// Learns from a white frame.
    ///
    /// # Errors
    /// Why the frame is no white frame of a microlens array, in words.
    pub(crate) fn from_white(white: &RawImage, config: &Config) -> Result<Self, String> {
        let (design, pixel_mm) = (config.design(), config.pixel_pitch().millimetres());
        let options = frame_options(config);
        let white =
            WhiteModel::of(white, &options).map_err(|error| format!("the white frame cannot be used: {error}"))?;
        let disagreement = disagreement(&white.grid, &design, pixel_mm);
        Ok(Self { white, design, pixel_mm, options, disagreement })
    }

    /// The same for frames of which it is known that nothing moved while they were taken.
    pub(crate) fn at_rest(&self) -> Self {
        let mut still = self.clone();
        still.options.spacing.at_rest = true;
        still
    }

    /// What was found, in words.
    pub(crate) fn describe(&self) -> String {
        let grid = &self.white.grid;
        let found = format!(
            "white frame: {} array, pitch {:.5} ± {:.5} px, rotation {:.4} ± {:.4}°, {} micro-images, residual {:.3} px",
            grid.array.name(),
            grid.pitch_px(),
            grid.sigma.pitch_px,
            grid.rotation().to_degrees(),
            grid.sigma.rotation_rad.to_degrees(),
            grid.micro_images(),
            grid.residual_px
        );
        match &self.disagreement {
            Some(disagreement) => format!("{found}; {disagreement}"),
            None => found,
        }
    }

    /// The white frame.
    pub(crate) const fn white(&self) -> &WhiteModel {
        &self.white
    }

    /// How its camera's frames are measured.
    pub(crate) const fn options(&self) -> FrameOptions {
        self.options
    }

    /// What follows the spacing from frame to frame.
    ///
    /// # Errors
    /// Why nothing can, in words.
    pub(crate) fn meter(&self) -> Result<LiveMeter, String> {
        let SpacingOptions { mla_pitch_px, mode, .. } = self.options().spacing;
        let options = LiveOptions { mode, mosaic: self.options.mosaic, ..LiveOptions::new(mla_pitch_px) };
        LiveMeter::new(&self.white.grid, &self.white.vignetting, options).map_err(|error| error.to_string())
    }

    /// Why the white frame no longer fits a frame, in words; `None` while it does.
    ///
    /// # Errors
    /// Why that cannot be told, in words.
    pub(crate) fn misfit(&self, image: &RawImage) -> Result<Option<String>, String> {
        let misfit = match prepare_frame(image, Some(&self.white), &self.options()) {
            Ok(prepared) => prepared.vignetting_fit.filter(|fit| !fit.fits()).map(|fit| fit.to_string()),
            // Its micro-images are not even found again.
            Err(MeasurementError::Grid(error @ GridError::DoesNotFit { .. })) => Some(error.to_string()),
            Err(error) => return Err(error.to_string()),
        };
        Ok(misfit.map(|misfit| format!("the white frame no longer fits: {misfit}")))
    }

    /// Measures the spacing of a flat board over several frames of one pose, with what the frames besides show; `near_px` is
    /// what it was last seen to be (px).
    ///
    /// # Errors
    /// Why there is no number to be had, in words.
    pub(crate) fn spacing(&self, images: &[&RawImage], near_px: Option<f64>) -> Result<Measured, Unseen> {
        let (seen, measured) = self.measured(images, near_px, true)?;
        let seen_last = images.last().and_then(|image| {
            let frame = ViewFrame::new(image, self.options.mosaic, &seen.grid, Some(&seen.light)).ok()?;
            let view = view::render(&frame, &ViewOptions::central(seen.spacing.on_axis_px)).ok()?;
            let options = DepthOptions::new(self.design.mla.mode, self.options().spacing.mla_pitch_px);
            let ssim = frame.depth_map(&options).ok().map(|depth| depth.ssim_mean());
            Some((view, ssim))
        });
        let (view, ssim) = seen_last.map_or((None, None), |(view, ssim)| (Some(view), ssim));
        let eog = view.as_ref().map(clarity::eog);
        Ok(Measured { eog, ssim, picture: view.as_ref().and_then(jpeg), map: seen.map.map(Arc::new), ..measured })
    }

    /// The same, and nothing besides.
    ///
    /// # Errors
    /// Why there is no number to be had, in words.
    pub(crate) fn spacing_alone(&self, images: &[&RawImage]) -> Result<Measured, Unseen> {
        Ok(self.measured(images, None, false)?.1)
    }

    /// The same, with what every micro-image makes of it where that is asked for, and without a picture.
    fn measured(
        &self,
        images: &[&RawImage],
        near_px: Option<f64>,
        map: bool,
    ) -> Result<(FrameMeasurement, Measured), Unseen> {
        let usual = self.options();
        let options = FrameOptions { map, spacing: SpacingOptions { start_px: near_px, ..usual.spacing }, ..usual };
        let seen = measure_frames(images.iter().copied(), Some(&self.white), &options)?;
        let spacing = SpacingReading {
            spacing_px: seen.spacing.on_axis_px,
            spacing_sigma_px: seen.spacing.sigma_px,
            tilt_x_px: seen.spacing.tilt_x_px,
            tilt_y_px: seen.spacing.tilt_y_px,
            curvature_px: seen.spacing.curvature_px,
            pairs: seen.spacing.pairs as u32,
            frames: images.len() as u32,
        };
        let two_boards = seen.spacing.two_boards.map(|two| TwoBoardsView {
            spacings_px: two.spacings_px,
            difference_sigma_px: two.difference_sigma_px,
            share: two.share,
        });
        let tilt_sigmas_px = [1, 2].map(|tilt| seen.spacing.covariance[tilt][tilt].max(0.0).sqrt());
        let Spacing { sigma_random_px, window_px, .. } = seen.spacing;
        let measured = Measured::new(spacing, sigma_random_px, tilt_sigmas_px, &seen.grid, window_px);
        Ok((seen, Measured { two_boards, ..measured }))
    }
}

/// A view as a picture; `None` for one that no encoder takes.
fn jpeg(view: &View) -> Option<Arc<Vec<u8>>> {
    let (width, height) = (u16::try_from(view.width).ok()?, u16::try_from(view.height).ok()?);
    let mut bytes = Vec::new();
    let encoder = jpeg_encoder::Encoder::new(&mut bytes, JPEG_QUALITY);
    let colours = match view.planes.len() {
        3 => jpeg_encoder::ColorType::Rgb,
        _ => jpeg_encoder::ColorType::Luma,
    };
    encoder.encode(&view.to_u8(), width, height, colours).ok()?;
    Some(Arc::new(bytes))
}

/// How the frames of the configured camera are measured.
pub(crate) fn frame_options(config: &Config) -> FrameOptions {
    let pixel_mm = config.pixel_pitch().millimetres();
    FrameOptions { mosaic: config.sensor.mosaic, ..FrameOptions::of_design(&config.design(), pixel_mm) }
}

/// What a white frame's grid and the configuration disagree on.
fn disagreement(grid: &Grid, design: &CameraDesign, pixel_mm: f64) -> Option<String> {
    if grid.array != design.mla.array {
        let configured = design.mla.array.name();
        return Some(format!("the configuration says a {configured} array"));
    }
    let expected = micro_image_pitch(design.mla.pitch, design.air_lens_to_mla(), design.mla.b());
    let expected_px = expected / pixel_mm;
    // The pitch shows d to some ten per cent only; a wrong MLA or pixel pitch shows at once.
    let off = grid.pitch_px() / expected_px - 1.0;
    (off.abs() > 0.01)
        .then(|| format!("the configuration makes it {expected_px:.3} px: check mla.pitch_mm and sensor.pixel_um"))
}

#[cfg(test)]
mod tests;
