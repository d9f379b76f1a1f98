//! Everything that a person can be shown of one raw frame: views, refocused and all-in-focus pictures, and how far away
//! things are.
//!
//! ```text
//!   live.rs   frame after frame: setting.rs (grid and vignetting, kept while they fit) -> view, depth -> Pictures
//!   paint.rs, figures.rs   what can be made of one: coloured depth, numbers
//! ```

mod figures;
mod live;
mod paint;
mod setting;

use std::sync::Arc;

pub use figures::{DepthFigures, LensFigures, Spread};
pub use live::LivePictures;
pub use paint::{Painted, Scale};

use self::setting::Setting;
use super::depth::{DepthMap, DepthOptions, DepthState};
use super::grid::Grid;
use super::measurement::{FrameOptions, MeasurementError, WhiteModel};
use super::spacing::SpacingError;
use super::view::{Blend, Extent, Patches, View, ViewError, ViewFrame, ViewOptions, extent, render};
use crate::optics::{DistanceTable, ExactView, MlaMode};
use crate::raw::RawImage;

/// Why there is no picture.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PictureError {
    /// The frame could not be made ready.
    #[error(transparent)]
    Measurement(#[from] MeasurementError),
    /// The micro-images could not be compared.
    #[error("depth: {0}")]
    Depth(#[from] SpacingError),
    /// The view could not be drawn.
    #[error(transparent)]
    View(#[from] ViewError),
    /// Distances need the camera's pose.
    #[error("no distance without the camera's pose: Δv, and e or that it was in air, are not known")]
    NoPose,
    /// Nothing at this distance makes image points that the camera could match.
    #[error("nothing at {distance_mm} mm could be matched by this camera at this pose")]
    OutOfSight {
        /// The distance asked for, mm.
        distance_mm: f64,
    },
}

/// Where the camera was, and how large its pixels are: what turns spacings into distances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// The camera at its pose.
    pub view: ExactView,
    /// Pitch of the pixels, mm.
    pub pixel_mm: f64,
}

/// Distances by spacing and place in the field, for one pose.
#[derive(Debug, Clone, PartialEq)]
struct Table {
    distances: DistanceTable,
    pose: Pose,
    /// How far from the axis it reaches, mm on the MLA.
    radius_mm: f64,
}

impl Table {
    fn new(grid: &Grid, pose: &Pose, mode: MlaMode) -> Self {
        let radius_mm = radius_mm(grid, pose);
        Self { distances: DistanceTable::new(&pose.view, mode, radius_mm), pose: *pose, radius_mm }
    }

    /// Whether it reaches as far as a grid's frame.
    fn serves(&self, grid: &Grid) -> bool {
        radius_mm(grid, &self.pose) == self.radius_mm
    }
}

/// One raw frame made ready for pictures.
#[derive(Debug, Clone)]
pub struct Pictures {
    frame: ViewFrame,
    /// The spacing of every micro-image.
    pub depth: DepthMap,
    /// The distance of what every micro-image of `depth` sees, along the axis (mm: in water from O, in air from M), where
    /// it is known.
    pub distances_mm: Vec<Option<f64>>,
    table: Option<Arc<Table>>,
}

impl Pictures {
    /// Makes a frame ready. Without a pose there are no distances, and no refocusing at one.
    ///
    /// # Errors
    /// [`PictureError`] says what is wrong with the frame.
    pub fn new(
        raw: &RawImage,
        white: Option<&WhiteModel>,
        options: &FrameOptions,
        mode: MlaMode,
        pose: Option<&Pose>,
    ) -> Result<Self, PictureError> {
        LivePictures::new(white.cloned(), *options, mode).next(raw, pose)
    }

    /// From a frame with its mosaic evened out.
    fn of(
        even: &RawImage,
        setting: &Setting,
        options: &FrameOptions,
        mode: MlaMode,
        table: Option<Arc<Table>>,
    ) -> Result<Self, PictureError> {
        let grid = &setting.grid;
        let frame = ViewFrame::of(even, options.mosaic, grid, Some(&setting.light));
        let depth = frame.depth_map(&DepthOptions::new(mode, options.spacing.mla_pitch_px))?;
        let distances_mm = depth
            .lenses
            .iter()
            .map(|lens| {
                let Table { distances, pose, .. } = table.as_deref()?;
                let known = lens.state != DepthState::Unknown;
                let place = field_mm(grid, lens.centre_px, pose);
                known.then(|| distances.distance(lens.spacing_px * pose.pixel_mm, place)).flatten()
            })
            .collect();
        Ok(Self { frame, depth, distances_mm, table })
    }

    /// The view from a place in the aperture (as in [`ViewOptions::direction`]), each patch as large as its micro-image's
    /// content asks for.
    ///
    /// # Errors
    /// [`ViewError`] where the direction lies outside the aperture or no spacing is known.
    pub fn view(&self, direction: [f64; 2]) -> Result<View, PictureError> {
        let options = ViewOptions { patches: Patches::Own(&self.depth), blend: Blend::Seamless, direction };
        Ok(render(&self.frame, &options)?)
    }

    /// A view with patches of one size, of a spacing in px, and how they are to meet.
    ///
    /// # Errors
    /// [`ViewError`] where the spacing leaves no patch.
    pub fn fixed(&self, spacing_px: f64, blend: Blend) -> Result<View, PictureError> {
        let options = ViewOptions { patches: Patches::Fixed(spacing_px), blend, direction: [0.0; 2] };
        Ok(render(&self.frame, &options)?)
    }

    /// Everything sharp, each place averaged over all micro-images that see it.
    ///
    /// # Errors
    /// [`ViewError::NoDepth`] where no spacing is known.
    pub fn all_in_focus(&self) -> Result<View, PictureError> {
        let options =
            ViewOptions { patches: Patches::Own(&self.depth), blend: Blend::WholeAperture, direction: [0.0; 2] };
        Ok(render(&self.frame, &options)?)
    }

    /// Sharp at one distance (mm: in water from O, in air from M), blurred before and behind it.
    ///
    /// # Errors
    /// [`PictureError::NoPose`], or [`PictureError::OutOfSight`] where nothing there could be seen.
    pub fn refocused(&self, distance_mm: f64) -> Result<View, PictureError> {
        let Table { distances, pose, .. } = self.table.as_deref().ok_or(PictureError::NoPose)?;
        let spacing = distances.spacing(distance_mm, [0.0; 2]).ok_or(PictureError::OutOfSight { distance_mm })?;
        self.fixed(spacing / pose.pixel_mm, Blend::WholeAperture)
    }

    /// The distance (mm) of what each pixel of [`Pictures::view`] shows, by its nearest micro-image: row by row, NaN where
    /// unknown.
    ///
    /// # Errors
    /// [`ViewError`] where no spacing is known.
    pub fn distances(&self) -> Result<(Extent, Vec<f32>), PictureError> {
        let extent = extent(&self.frame.grid, Patches::Own(&self.depth))?;
        let of = |index: [i32; 2]| self.depth.place(index).and_then(|place| self.distances_mm[place]);
        let distances = extent.owners(&self.frame.grid).map(|index| of(index).map_or(f32::NAN, |mm| mm as f32));
        Ok((extent, distances.collect()))
    }

    /// The micro-images' grid.
    #[must_use]
    pub const fn grid(&self) -> &Grid {
        &self.frame.grid
    }
}

/// A place of the frame (px) on the MLA, mm from the axis, taken to pass the frame's centre.
fn field_mm(grid: &Grid, [x, y]: [f64; 2], pose: &Pose) -> [f64; 2] {
    let ratio = pose.view.lens_to_mla / (pose.view.lens_to_mla + pose.view.b);
    let [w, h] = grid.frame_size.map(|n| n as f64 - 1.0);
    [(x - w / 2.0) * pose.pixel_mm * ratio, (y - h / 2.0) * pose.pixel_mm * ratio]
}

fn radius_mm(grid: &Grid, pose: &Pose) -> f64 {
    let [x, y] = field_mm(grid, [0.0, 0.0], pose);
    x.hypot(y)
}
