//! Pictures from a raw frame: subaperture views, refocused and all-in-focus ones.
//!
//! From one micro-image to the next an image point moves by the spacing l, while the micro-image centre moves by the
//! micro-image pitch P. Patches of P − l therefore continue each other: as they are where l < P (Galilean), turned by
//! 180° where l > P (Keplerian). A view is drawn from its own pixels back: to a view pixel at the frame's place q the
//! micro-image with centre c contributes what the frame has at `c + w + (q − c)(P − l)/P`, w being where within its
//! micro-image a patch is taken from: another place there is another part of the main lens's aperture, that is, another
//! direction to look from. A square and a hexagonal array need no different treatment.
//!
//! ```text
//!   frame.rs    the frame made ready: vignetting divided out, colours of a mosaic filled in
//!   render.rs   view pixels from the micro-images about them (cells.rs), read between pixels (taps.rs)
//! ```
//!
//! Views stand upright: the main lens turns the scene by 180°, and they turn it back.

mod cells;
mod frame;
mod render;
mod taps;

pub use frame::ViewFrame;
pub use render::{extent, render};
pub(super) use taps::keys;

use super::depth::DepthMap;
use super::grid::Grid;

/// A patch smaller than this makes no picture, px.
pub(super) const PATCH_LEAST_PX: f64 = 0.5;

/// Why there is no view.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ViewError {
    /// The grid is for another frame size.
    #[error("grid of a {}x{} frame cannot serve a frame of {}x{} px", grid[0], grid[1], frame[0], frame[1])]
    OtherFrameSize {
        /// Columns and rows of the grid's frame.
        grid: [usize; 2],
        /// Columns and rows of this frame.
        frame: [usize; 2],
    },
    /// The spacing leaves no patch, or one larger than a micro-image.
    #[error(
        "spacing of {spacing_px} px at a micro-image pitch of {pitch_px:.3} px makes patches of {patch_px:.3} px; they \
         must be between 0.5 px and the pitch"
    )]
    Patch {
        /// Spacing asked for, px.
        spacing_px: f64,
        /// Micro-image pitch of the grid, px.
        pitch_px: f64,
        /// Pitch less spacing, px.
        patch_px: f64,
    },
    /// The direction lies outside what the microlenses let through.
    #[error(
        "direction ({}, {}) lies outside the aperture: its length must be at most 1, the aperture's edge",
        direction[0],
        direction[1]
    )]
    Direction {
        /// The direction asked for.
        direction: [f64; 2],
    },
    /// No micro-image's spacing is known.
    #[error("no micro-image's spacing is known: the frame shows no texture that could be matched")]
    NoDepth,
}

/// How large the patches are that a view is made of.
#[derive(Debug, Clone, Copy)]
pub enum Patches<'a> {
    /// Those of one spacing (px): what is at its distance is continuous, what is elsewhere is not.
    Fixed(f64),
    /// Each micro-image's own, by its spacing: all is continuous.
    Own(&'a DepthMap),
}

/// How patches meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Blend {
    /// Side by side, as in the paper: seams show where a patch has the wrong size.
    Abutting,
    /// Each fades into its neighbours.
    Seamless,
    /// All micro-images that see a place contribute alike: the whole of the main lens's aperture, so that what is not at
    /// the patches' distance is blurred rather than doubled.
    WholeAperture,
}

/// What a view is to be.
#[derive(Debug, Clone, Copy)]
pub struct ViewOptions<'a> {
    /// Patch sizes.
    pub patches: Patches<'a>,
    /// How patches meet.
    pub blend: Blend,
    /// From where in the main lens's aperture one looks: x to the right and y down in the upright view, in units of the
    /// radius about a micro-image's centre that is used, at most 1 from the middle. (0, 0) is the central view.
    pub direction: [f64; 2],
}

impl ViewOptions<'_> {
    /// The central view with patches of one spacing (px), without seams.
    #[must_use]
    pub const fn central(spacing_px: f64) -> Self {
        Self { patches: Patches::Fixed(spacing_px), blend: Blend::Seamless, direction: [0.0; 2] }
    }
}

/// How a view lies over its frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// View pixels for each pixel of the frame.
    pub scale: f64,
}

impl Extent {
    /// The micro-image whose patch each pixel lies in, row by row: that whose centre is nearest.
    pub fn owners(self, grid: &Grid) -> impl Iterator<Item = [i32; 2]> + '_ {
        // Upright: the view's first pixel is the frame's last.
        let at = move |k: usize, count: usize| ((count - 1 - k) as f64 + 0.5) / self.scale - 0.5;
        (0..self.height)
            .flat_map(move |y| (0..self.width).map(move |x| grid.index_of(at(x, self.width), at(y, self.height))))
    }
}

/// A picture, grey or in colour.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Grey, or red, green and blue; each row by row, in grey levels of the raw frame with the vignetting removed.
    pub planes: Vec<Vec<f32>>,
    /// View pixels for each pixel of the frame.
    pub scale: f64,
}

impl View {
    /// A grey picture, one view pixel for one of its own.
    #[must_use]
    pub fn grey(width: usize, height: usize, values: Vec<f32>) -> Self {
        Self { width, height, planes: vec![values], scale: 1.0 }
    }

    /// How it lies over its frame.
    #[must_use]
    pub const fn extent(&self) -> Extent {
        Extent { width: self.width, height: self.height, scale: self.scale }
    }

    /// Luminance (ITU-R BT.601) of a picture in colour; the values themselves of a grey one.
    #[must_use]
    pub fn luminance(&self) -> std::borrow::Cow<'_, [f32]> {
        match self.planes.as_slice() {
            [red, green, blue] => red
                .iter()
                .zip(green)
                .zip(blue)
                .map(|((r, g), b)| 0.299 * r + 0.587 * g + 0.114 * b)
                .collect::<Vec<f32>>()
                .into(),
            planes => planes.first().map_or(&[][..], Vec::as_slice).into(),
        }
    }

    /// The picture in 8 bits, darkest value 0, brightest 255, for looking at: row by row, the colours of a pixel
    /// together.
    #[must_use]
    pub fn to_u8(&self) -> Vec<u8> {
        let values = || self.planes.iter().flatten();
        let (least, greatest) = values().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, g), &v| (l.min(v), g.max(v)));
        let scale = if greatest > least { 255.0 / (greatest - least) } else { 0.0 };
        (0..self.width * self.height)
            .flat_map(|k| self.planes.iter().map(move |plane| ((plane[k] - least) * scale).round() as u8))
            .collect()
    }
}
