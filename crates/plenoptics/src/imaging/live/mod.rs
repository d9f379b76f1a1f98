//! Live measuring: the spacing of frame after frame of one setting, as fast as a camera delivers them.
//!
//! The micro-image's profile is known and stays, the grid is known and followed as it drifts; what follows from them is
//! worked out once, or when the grid has moved by pixels. A frame then takes one pass, and nothing of a frame's size is
//! allocated for it:
//!
//! ```text
//!   a sample of micro-images  light and noise
//!            |
//!   follow.rs                 lattice.rs -> places.rs: how the grid has moved
//!            |
//!   engine.rs  clusters       some pairs spread over the frame, until the spacing there has settled
//!            |                                                                     otherwise: lost
//!   engine.rs  all pairs      one Newton step for spacing, field and directions; scatter between field blocks
//! ```
//!
//! Micro-images are matched as in whole measurements ([`super::spacing`]), but for this: pairs are compared along
//! themselves only, and of large frames not all of them.

mod engine;
mod follow;
mod lattice;
mod middle;
mod places;

use serde::Serialize;

use self::engine::{Engine, State};
use self::middle::Middle;
use super::combined::Single;
use super::grid::{Grid, GridError, refine_grid};
use super::matching::model::USUAL_TERMS;
use super::matching::samples::Frame;
use super::measurement::evened;
use super::misfit::WhiteMisfit;
use super::mosaic::green;
use super::spacing::{MODEL_SIGMA_PX, Spacing, SpacingError, SpacingFrame, SpacingOptions, find_spacing};
use super::vignetting::{ProfileFit, Vignetting, VignettingError};
use crate::optics::MlaMode;
use crate::raw::{CfaPattern, RawImage, Samples};

/// Share of their size by which micro-images may change before what is divided out of frames is chosen anew. In small frames
/// noise alone may be more: then it is chosen for nothing.
const GROWTH: f64 = 0.01;

/// What the caller knows and wants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LiveOptions {
    /// D_MLA, the made pitch of the microlenses, px.
    pub mla_pitch_px: f64,
    /// The mosaic of the sensor: the spacing is then that of green.
    pub mosaic: Option<CfaPattern>,
    /// Only this mode's range is searched when the spacing is acquired; both where `None`.
    pub mode: Option<MlaMode>,
    /// Expected spacing of the first frame, px: within a pixel or two, or the frame has to be acquired.
    pub start_px: Option<f64>,
    /// Tilt x, tilt y and curvature where they are known and not to be fitted, as in [`SpacingOptions`].
    pub field_held: Option<[f64; 3]>,
    /// Whether the difference between lattice directions is taken to be nil and not fitted.
    pub directions_alike: bool,
    /// About how many micro-images are measured at most: of larger frames whole lattice rows are left out, evenly. Beyond
    /// ten thousand, noise is far below what the model itself is uncertain by, and the time is better spent on the next
    /// frame.
    pub micro_images_most: usize,
}

impl LiveOptions {
    /// Nothing known but the MLA pitch (px).
    #[must_use]
    pub const fn new(mla_pitch_px: f64) -> Self {
        Self {
            mla_pitch_px,
            mosaic: None,
            mode: None,
            start_px: None,
            field_held: None,
            directions_alike: false,
            micro_images_most: 10_000,
        }
    }

    /// The same for a frame that is looked at as if nothing were known of it.
    const fn of_spacing(&self) -> SpacingOptions {
        SpacingOptions { mode: self.mode, field_held: self.field_held, ..SpacingOptions::new(self.mla_pitch_px) }
    }
}

/// Why a frame gave no spacing.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LiveError {
    /// The frame cannot be measured at all, live or not.
    #[error("{0}")]
    Spacing(#[from] SpacingError),
    /// The white frame is of another setting.
    #[error(transparent)]
    WhiteMisfit(#[from] WhiteMisfit),
    /// The whole picture is blurred.
    #[error(transparent)]
    Vignetting(#[from] VignettingError),
    /// The micro-images have jumped too far to say which is which.
    #[error(
        "the micro-images have jumped by up to {shift_px:.2} ± {sigma_px:.2} px since the last frame ({most_px:.2} px can be followed): acquire the frame, or find the grid anew from a white frame at this setting"
    )]
    GridMoved {
        /// Greatest displacement in the frame, px.
        shift_px: f64,
        /// Its standard uncertainty, px.
        sigma_px: f64,
        /// Greatest displacement that can be followed, px.
        most_px: f64,
    },
    /// The grid cannot be fitted to the whole frame.
    #[error("{0}")]
    Grid(#[from] GridError),
    /// The lattice of micro-images is not to be seen.
    #[error(
        "the known grid's lattice does not show in this frame (its phases agree to {coherence:.2}, at least {least:.2} are needed): no raw frame of this array, or another setting; find the grid anew"
    )]
    GridNotSeen {
        /// How far the lattice's phases agree, from 0 to 1.
        coherence: f64,
        /// Agreement needed.
        least: f64,
    },
    /// Nothing says where to start.
    #[error("no spacing is known to start from: acquire the frame, or give a spacing within a pixel or two")]
    NoStart,
    /// The spacing is no longer near the last one.
    #[error(
        "neighbouring micro-images no longer match near the last spacing of {from_px:.2} px (correlation {correlation:.2}): it changed too fast or the board went"
    )]
    Lost {
        /// The spacing started from, px.
        from_px: f64,
        /// Correlation of neighbours where it ended.
        correlation: f64,
    },
}

/// A spacing measured live.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LiveSpacing {
    /// l_0: the spacing on the axis, mean over the lattice directions, px.
    pub on_axis_px: f64,
    /// Its standard uncertainty, px: noise and what the model cannot explain, from the scatter between field blocks and
    /// from what is known of the model's own limits.
    pub sigma_px: f64,
    /// What the scatter between field blocks makes of it, px; where they are few, no less than pixel noise does.
    pub sigma_scatter_px: f64,
    /// Its standard uncertainty from pixel noise alone, px.
    pub sigma_random_px: f64,
    /// t_x: rise of the spacing along x, px per half frame width.
    pub tilt_x_px: f64,
    /// t_y: rise of the spacing along y (down), px per half frame width.
    pub tilt_y_px: f64,
    /// k: rise of the spacing with the squared distance from the axis, px per half frame width squared.
    pub curvature_px: f64,
    /// a: the curvature seen by pairs along the radius less that seen by pairs across it, px per half width squared.
    pub astigmatism_px: f64,
    /// s: spacing along the array's rows (its first lattice direction) less that along its columns, px.
    pub row_column_px: f64,
    /// h: the same for the directions 45° further, px; 0 for a square array, where it is not looked for.
    pub diagonal_px: f64,
    /// Covariance of l_0, t_x, t_y, k, a, s, h (px²), from the scatter between field blocks. Zero for terms not fitted.
    pub covariance: [[f64; 1 + USUAL_TERMS]; 1 + USUAL_TERMS],
    /// Radius of the masks about the micro-images' centres, px.
    pub window_px: f64,
    /// Pairs of neighbouring micro-images that were compared.
    pub pairs: usize,
    /// Correlation of neighbours at this spacing, noise taken out.
    pub correlation: f64,
    /// Median residual of the pairs in units of what noise alone would leave.
    pub residual_ratio: f64,
    /// By how much the spacing steps between two parts of the field: 1 and more where it does as between two boards, so that
    /// it may be neither's; 0 where that cannot be told from noise. Only a whole measurement says whether there are two.
    pub unevenness: f64,
    /// Noise of the frame as estimated from itself, grey levels.
    pub noise_grey_levels: f64,
    /// How the grid has moved from the one the meter was given: gains and centres are those of there.
    pub grid: GridMotion,
    /// Passes over all pairs that it took: one when the frame is like the last.
    pub passes: usize,
}

/// A part of what is done with a frame, in the order of the first of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LivePart {
    /// The grid fitted to the whole frame, and the spacing looked for as if nothing were known of it.
    Search,
    /// Light and noise, from a sample of micro-images.
    Exposure,
    /// The grid followed, and what is planned for it moved along.
    Grid,
    /// The spacing settled on some pairs spread over the frame.
    Clusters,
    /// All pairs compared.
    Pairs,
    /// The normal equations, and the scatter between field blocks.
    Equations,
    /// What pixel noise alone makes of it.
    Noise,
    /// Whether the spacing steps over the field.
    Boards,
}

impl LivePart {
    /// Every part.
    pub const ALL: [Self; 8] = [
        Self::Search,
        Self::Exposure,
        Self::Grid,
        Self::Clusters,
        Self::Pairs,
        Self::Equations,
        Self::Noise,
        Self::Boards,
    ];
}

impl LiveSpacing {
    /// The spacing on the axis as one of several that are combined, seen at a time, s.
    #[must_use]
    pub const fn single(&self, at_s: f64) -> Single {
        Single {
            at_s,
            value: self.on_axis_px,
            sigma_scatter: self.sigma_scatter_px,
            sigma_random: self.sigma_random_px,
            sigma_model: MODEL_SIGMA_PX,
        }
    }
}

/// How the micro-images have moved from where a grid has them: a similarity about the frame's middle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GridMotion {
    /// Displacement in the frame's middle: x and y, px.
    pub shift_px: [f64; 2],
    /// Relative change of the pitch.
    pub scale: f64,
    /// Rotation from +x towards +y, radians.
    pub rotation: f64,
    /// Greatest displacement in the frame, that of a corner, px.
    pub greatest_px: f64,
    /// Standard uncertainty of a corner's place, px.
    pub sigma_px: f64,
}

/// Measures frame after frame while the grid drifts, as it does when Δv is changed.
#[derive(Debug)]
pub struct LiveMeter {
    grid: Grid,
    vignetting: Vignetting,
    options: LiveOptions,
    engine: Engine,
    /// Pitch of the micro-images (px) where it was chosen what is divided out of frames.
    chosen_at_px: f64,
}

impl LiveMeter {
    /// Prepares for frames with this grid, and with this profile of their micro-images.
    ///
    /// # Errors
    /// [`SpacingError`] where there are too few micro-images, or where an option is impossible.
    pub fn new(grid: &Grid, vignetting: &Vignetting, options: LiveOptions) -> Result<Self, SpacingError> {
        for (what, value) in
            [("an MLA pitch (px)", options.mla_pitch_px), ("a starting spacing (px)", options.start_px.unwrap_or(1.0))]
        {
            if !(value.is_finite() && value > 0.0) {
                return Err(SpacingError::Impossible { what, value });
            }
        }
        let engine = Engine::new(grid, vignetting, &options)?;
        let chosen_at_px = grid.pitch_px();
        Ok(Self { grid: grid.clone(), vignetting: vignetting.clone(), options, engine, chosen_at_px })
    }

    /// Measures a frame, starting from the last one's spacing.
    ///
    /// # Errors
    /// [`LiveError`]. After [`LiveError::Lost`] there is no start any more: acquire the next frame.
    pub fn measure(&mut self, raw: &RawImage) -> Result<LiveSpacing, LiveError> {
        self.measure_by_parts(raw, &mut |_| {})
    }

    /// [`LiveMeter::measure`], and `ended` is told of each part when it has ended, of some several times: for who has a
    /// clock. Of a frame that gives no spacing the part that it failed in is not told of.
    ///
    /// # Errors
    /// Those of [`LiveMeter::measure`].
    pub fn measure_by_parts(
        &mut self,
        raw: &RawImage,
        ended: &mut dyn FnMut(LivePart),
    ) -> Result<LiveSpacing, LiveError> {
        self.check_size(raw)?;
        let (width, height, bits) = (raw.width(), raw.height(), raw.bits());
        let (white, mosaic) = (raw.white_level(), self.options.mosaic);
        if let Some(pattern) = mosaic {
            let frame = Frame { samples: &green(raw, pattern), width, height, white: f32::from(white), mosaic };
            return self.engine.measure(&frame, bits, ended);
        }
        match raw.samples() {
            Samples::U8(samples) => {
                self.engine.measure(&Frame { samples, width, height, white: u8::MAX, mosaic }, bits, ended)
            }
            Samples::U16(samples) => self.engine.measure(&Frame { samples, width, height, white, mosaic }, bits, ended),
        }
    }

    /// Fits the grid to the whole frame with [`refine_grid`], looks for the spacing as if nothing were known of it, of a
    /// large frame first in its middle, and measures and follows the frame from there. This is not live. As with
    /// every reading, nobody asks whether the frame is smeared.
    ///
    /// # Errors
    /// [`LiveError`].
    pub fn acquire(&mut self, raw: &RawImage) -> Result<LiveSpacing, LiveError> {
        self.acquire_by_parts(raw, &mut |_| {})
    }

    /// [`LiveMeter::acquire`], told by parts as [`LiveMeter::measure_by_parts`] is.
    ///
    /// # Errors
    /// [`LiveError`].
    pub fn acquire_by_parts(
        &mut self,
        raw: &RawImage,
        ended: &mut dyn FnMut(LivePart),
    ) -> Result<LiveSpacing, LiveError> {
        self.check_size(raw)?;
        let mosaic = self.options.mosaic;
        let even = &*evened(raw, mosaic);
        let grid = refine_grid(even, &self.grid, Some(&self.vignetting))?;
        self.engine.start_from(&grid)?;
        let (fit, profile) = self.choose_profile(even, &grid)?;
        let in_the_middle = Middle::of(&grid).and_then(|middle| middle.find(raw, &profile, &self.options));
        let anywhere = || {
            let frame = SpacingFrame::new(raw, mosaic, &profile.render(&grid), &grid)?;
            find_spacing(&frame, &self.options.of_spacing())
        };
        let with_white = |failed| WhiteMisfit::behind(&failed, fit).map_or_else(|| failed.into(), LiveError::from);
        let (spacing_px, field_px) = in_the_middle.map_or_else(anywhere, Ok).map_err(with_white)?;
        self.engine.state = Some(State::new(spacing_px, field_px));
        ended(LivePart::Search);
        self.measure_by_parts(raw, ended)
    }

    /// Chooses anew what is divided out of frames, where micro-images have grown or shrunk by too much since that was chosen. It
    /// takes as long as many readings do: for a frame at rest, before it is measured. A frame of another size is left to that.
    pub fn keep_profile(&mut self, raw: &RawImage) {
        let grid = self.engine.grid();
        if self.check_size(raw).is_ok()
            && self.outgrown(&grid)
            && self.choose_profile(&evened(raw, self.options.mosaic), &grid).is_err()
        {
            // Where it is searched for next, the search says why.
            self.engine.state = None;
        }
    }

    /// Whether micro-images have grown or shrunk since what is divided out of frames was chosen. They are as large as the
    /// aperture seen from its distance d, and their pitch exceeds the array's by b/d.
    fn outgrown(&self, grid: &Grid) -> bool {
        let pitch_px = grid.pitch_px();
        (pitch_px - self.chosen_at_px).abs() > GROWTH * (pitch_px - self.options.mla_pitch_px).abs()
    }

    /// Chooses for a frame with this grid what is divided out of it and those that follow: the white frame's profile where it
    /// fits, or else the frame's own where it has one. How the white frame's fits, and what was chosen; a frame that is blurred
    /// as a whole has none.
    fn choose_profile(
        &mut self,
        even: &RawImage,
        grid: &Grid,
    ) -> Result<(Option<ProfileFit>, Vignetting), VignettingError> {
        let fit = self.vignetting.fit(even, grid).ok();
        let profile = match fit.map(|fit| self.vignetting.fitting(&fit, even, grid)) {
            Some(Err(blurred @ VignettingError::Blurred { .. })) => return Err(blurred),
            Some(Ok(fitting)) => fitting.into_owned(),
            Some(Err(_)) | None => self.vignetting.clone(),
        };
        self.engine.divide_out(&profile);
        self.chosen_at_px = grid.pitch_px();
        Ok((fit, profile))
    }

    /// The grid where the newest frame has it. Its micro-images have the indices of the grid that the meter was given.
    #[must_use]
    pub fn grid(&self) -> Grid {
        self.engine.grid()
    }

    /// Lets the next frame start from a spacing measured elsewhere.
    pub fn start_from(&mut self, spacing: &Spacing) {
        let field = [spacing.tilt_x_px, spacing.tilt_y_px, spacing.curvature_px];
        self.engine.state = Some(State::new(spacing.on_axis_px, field));
    }

    fn check_size(&self, raw: &RawImage) -> Result<(), SpacingError> {
        let frame = [raw.width(), raw.height()];
        if frame == self.grid.frame_size {
            return Ok(());
        }
        Err(SpacingError::WrongSize { frame, grid: self.grid.frame_size })
    }
}
