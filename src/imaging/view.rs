//! A plain view of the scene from a raw frame: one patch of fixed size from every micro-image, side by side.
//!
//! From one micro-image to the next an image point moves by the spacing l, while the micro-image centre moves by the
//! micro-image pitch P. Patches of P − l therefore continue each other: as they are where l < P (Galilean), turned by
//! 180° where l > P (Keplerian). The view is drawn from its own pixels back: a view pixel at the frame's place q belongs
//! to the micro-image with centre c nearest to q, and shows the frame at `c + (q − c)(P − l)/P`. A square and a
//! hexagonal array need no different treatment. The view stands as the sensor sees the scene: turned by 180° against
//! it, never mirrored.

use rayon::prelude::*;

use super::grid::Grid;
use super::vignetting::Vignetting;
use crate::raw::RawImage;

/// Transmission below which a pixel is not divided by it but by this: a gap stays dark instead of becoming noise.
const TRANSMISSION_LEAST: f32 = 0.1;
/// A patch smaller than this makes no picture, px.
const PATCH_LEAST_PX: f64 = 0.5;

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
}

/// A grey picture.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Grey levels of the raw frame, vignetting removed, row by row.
    pub values: Vec<f32>,
}

impl View {
    /// The picture in 8 bits, darkest pixel 0, brightest 255, for looking at.
    #[must_use]
    pub fn to_u8(&self) -> Vec<u8> {
        let (least, greatest) =
            self.values.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, g), &v| (l.min(v), g.max(v)));
        let scale = if greatest > least { 255.0 / (greatest - least) } else { 0.0 };
        self.values.iter().map(|v| ((v - least) * scale).round() as u8).collect()
    }
}

/// The central view of a frame whose image points lie `spacing_px` apart under adjacent microlenses. One view pixel is
/// one raw pixel of a patch; with a profile the vignetting is divided out.
///
/// # Errors
/// [`ViewError`] where grid and frame do not belong together, or the spacing leaves no patch.
pub fn central_view(
    frame: &RawImage,
    grid: &Grid,
    vignetting: Option<&Vignetting>,
    spacing_px: f64,
) -> Result<View, ViewError> {
    let size = [frame.width(), frame.height()];
    if size != grid.frame_size {
        return Err(ViewError::OtherFrameSize { grid: grid.frame_size, frame: size });
    }
    let pitch_px = grid.pitch_px();
    let patch_px = pitch_px - spacing_px;
    if !(PATCH_LEAST_PX..=pitch_px).contains(&patch_px.abs()) {
        return Err(ViewError::Patch { spacing_px, pitch_px, patch_px });
    }
    let ratio = patch_px / pitch_px;
    let [width, height] = size.map(|n| ((n as f64 * ratio.abs()) as usize).max(1));
    let values = frame.to_f32();
    let mut view = vec![0.0; width * height];
    view.par_chunks_mut(width).enumerate().for_each(|(row, line)| {
        let qy = (row as f64 + 0.5) / ratio.abs() - 0.5;
        for (column, to) in line.iter_mut().enumerate() {
            let qx = (column as f64 + 0.5) / ratio.abs() - 0.5;
            let c = grid.nearest(qx, qy);
            let (x, y) = (c.x + (qx - c.x) * ratio, c.y + (qy - c.y) * ratio);
            let transmission = vignetting.map_or(1.0, |v| v.at(grid, x, y).max(TRANSMISSION_LEAST));
            *to = bilinear(&values, size, x, y) / transmission;
        }
    });
    Ok(View { width, height, values: view })
}

/// The frame between its pixels; outside, its edge.
fn bilinear(values: &[f32], [w, h]: [usize; 2], x: f64, y: f64) -> f32 {
    let (x, y) = (x.clamp(0.0, (w - 1) as f64), y.clamp(0.0, (h - 1) as f64));
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(w - 1), (y0 + 1).min(h - 1));
    let (s, t) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
    let at = |x: usize, y: usize| values[y * w + x];
    (at(x0, y0) * (1.0 - s) + at(x1, y0) * s) * (1.0 - t) + (at(x0, y1) * (1.0 - s) + at(x1, y1) * s) * t
}
