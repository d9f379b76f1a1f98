//! A frame made ready to a picture's bytes.

use std::io::Cursor;

use axum::body::Bytes;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use super::picture::{coloured_jpeg, grey_jpeg};
use crate::control::service::look::Look;
use crate::imaging::pictures::PictureError;
use crate::imaging::view::View;

/// Steps of a direction in a key: finer ones cannot be told apart in any picture.
const ANGLE_STEPS: f64 = 1000.0;
/// Steps of a distance in a key, and grey levels of a depth map, for each millimetre.
const STEPS_PER_MM: f64 = 10.0;

/// What is seen of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(in crate::api) enum Scene {
    /// The view from a place in the aperture, thousandths.
    View { angle: [i16; 2] },
    /// Everything sharp.
    AllInFocus,
    /// One distance sharp, tenths of a millimetre.
    Refocused { distance: u32 },
    /// How far away everything is.
    Depth,
}

/// As what file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(in crate::api) enum Format {
    /// For looking at.
    Jpeg { quality: u8 },
    /// Exact, 16 bits.
    Png,
}

impl Scene {
    /// The view from a place in the aperture, at most 1 from its middle.
    pub(in crate::api) fn central(direction: [f64; 2]) -> Self {
        // Towards the middle, so that rounding leads nowhere outside the aperture.
        Self::View { angle: direction.map(|x| (x * ANGLE_STEPS).trunc() as i16) }
    }

    /// One distance (mm) sharp.
    pub(in crate::api) fn refocused(distance_mm: f64) -> Self {
        Self::Refocused { distance: (distance_mm * STEPS_PER_MM).round() as u32 }
    }

    /// Whether it means nothing without the camera's pose. Colours stand for spacings, and can be had without.
    pub(in crate::api) fn needs_pose(self, format: Format) -> bool {
        matches!(self, Self::Refocused { .. }) || (self == Self::Depth && format == Format::Png)
    }
}

/// Draws a picture. The error is that of the picture, or none where no encoder takes it.
pub(in crate::api) fn draw(look: &Look, scene: Scene, format: Format) -> Result<Bytes, Option<PictureError>> {
    let pictures = &look.pictures;
    let drawn;
    let view = match scene {
        Scene::View { angle: [0, 0] } | Scene::Depth => &look.central,
        Scene::View { angle } => {
            drawn = pictures.view(angle.map(|x| f64::from(x) / ANGLE_STEPS))?;
            &drawn
        }
        Scene::AllInFocus => {
            drawn = pictures.all_in_focus()?;
            &drawn
        }
        Scene::Refocused { distance } => {
            drawn = pictures.refocused(f64::from(distance) / STEPS_PER_MM)?;
            &drawn
        }
    };
    let encoded = match (scene, format) {
        (Scene::Depth, Format::Jpeg { quality }) => {
            let painted = pictures.painted_depth(view.extent());
            coloured_jpeg(&painted.rgb, painted.width, painted.height, quality)
        }
        (Scene::Depth, Format::Png) => {
            let (extent, distances) = pictures.distances()?;
            let levels = distances.into_iter().map(|mm| {
                let level = (f64::from(mm) * STEPS_PER_MM).round().clamp(0.0, f64::from(u16::MAX));
                // What is unknown becomes 0.
                if level.is_nan() { 0 } else { level as u16 }
            });
            png(levels, extent.width, extent.height, ExtendedColorType::L16)
        }
        (_, Format::Jpeg { quality }) => match view.planes.len() {
            3 => coloured_jpeg(&view.to_u8(), view.width, view.height, quality),
            _ => grey_jpeg(&view.to_u8(), view.width, view.height, quality),
        },
        (_, Format::Png) => exact_png(view, look.white_level),
    };
    encoded.map_err(|error| {
        tracing::error!(%error, seq = look.frame.seq, "a view could not be encoded");
        None
    })
}

/// A view's grey levels as a PNG of 16 bits, the white level of the frame as its own.
fn exact_png(view: &View, white_level: u16) -> Result<Bytes, String> {
    let scale = f32::from(u16::MAX) / f32::from(white_level);
    let level = |value: f32| (value * scale).round().clamp(0.0, f32::from(u16::MAX)) as u16;
    let levels = (0..view.width * view.height).flat_map(|k| view.planes.iter().map(move |plane| level(plane[k])));
    let colour = if view.planes.len() == 3 { ExtendedColorType::Rgb16 } else { ExtendedColorType::L16 };
    png(levels, view.width, view.height, colour)
}

fn png(
    levels: impl Iterator<Item = u16>,
    width: usize,
    height: usize,
    colour: ExtendedColorType,
) -> Result<Bytes, String> {
    // The encoder takes samples in the machine's own byte order.
    let native: Vec<u8> = levels.flat_map(u16::to_ne_bytes).collect();
    let mut bytes = Vec::new();
    PngEncoder::new_with_quality(Cursor::new(&mut bytes), CompressionType::Fast, FilterType::Up)
        .write_image(&native, width as u32, height as u32, colour)
        .map_err(|error| error.to_string())?;
    Ok(bytes.into())
}
