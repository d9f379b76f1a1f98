//! Frames of a case, and the pictures made of them.

use super::case::Case;
use super::{Picture, StudyError};
use crate::imaging::measurement::{FrameOptions, WhiteModel};
use crate::imaging::pictures::{Pictures, Pose};
use crate::imaging::spacing::SpacingOptions;
use crate::imaging::view::View;
use crate::optics::{CameraDesign, ExactView};
use crate::raw::RawImage;
use crate::sim::exposure::{Noise, expose};
use crate::sim::renderer::{CameraTruth, RenderOptions, Renderer};
use crate::sim::scene::Scene;

/// A camera's sensor, light and noise, by which frames are taken of whatever stands before it.
#[derive(Debug, Clone)]
pub(super) struct Studio {
    pub(super) design: CameraDesign,
    /// Side of a pixel, mm.
    pub(super) pixel: f64,
    /// Columns and rows of a frame.
    pub(super) side: usize,
    /// Rays a pixel.
    pub(super) rays: u32,
    /// Read noise, grey levels of 255.
    pub(super) noise: f64,
    pub(super) seed: u64,
}

/// A raw frame and what was made of it.
pub(super) struct Shot {
    pub(super) raw: RawImage,
    pub(super) pictures: Pictures,
    /// The camera before a board at its design's distance.
    pub(super) view: ExactView,
    /// The camera that took it.
    pub(super) camera: CameraTruth,
}

impl Studio {
    /// D_MLA, px.
    pub(super) fn mla_pitch_px(&self) -> f64 {
        self.design.mla.pitch / self.pixel
    }

    /// How frames are measured whose white frame was taken at the same setting.
    pub(super) fn frame_options(&self) -> FrameOptions {
        let spacing = SpacingOptions { mode: Some(self.design.mla.mode), ..SpacingOptions::new(self.mla_pitch_px()) };
        FrameOptions { spacing, white_at_this_setting: true, ..FrameOptions::new(self.mla_pitch_px()) }
    }

    /// The camera at a case.
    pub(super) fn camera(&self, case: &Case) -> CameraTruth {
        let medium = case.medium(&self.design);
        CameraTruth::from_design(&self.design, case.delta_v, medium, self.pixel, self.side, self.side)
    }

    /// A raw frame; the noise follows from `seed` beside the studio's own.
    pub(super) fn expose(&self, camera: &CameraTruth, scene: &Scene, seed: u64) -> RawImage {
        let renderer = Renderer::new(RenderOptions { rays: self.rays, seed: self.seed });
        let noise = Noise { read_noise_levels: self.noise, ..Noise::default() };
        let seed = self.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(seed);
        expose(&renderer.render(camera, scene), camera.width, camera.height, &noise, seed)
    }

    /// What a white frame of a camera says.
    pub(super) fn white(&self, camera: &CameraTruth) -> Result<WhiteModel, StudyError> {
        WhiteModel::new(&self.expose(camera, &Scene::Diffuser, 1))
            .map_err(|error| StudyError::unseen("a white frame of the study's", error))
    }

    /// Takes a frame of a scene at a case, and makes it ready for pictures.
    pub(super) fn take(&self, case: &Case, scene: &Scene, seed: u64) -> Result<Shot, StudyError> {
        let camera = self.camera(case);
        let view = case.view(&self.design);
        let white = self.white(&camera)?;
        let raw = self.expose(&camera, scene, 2 + seed);
        let pose = Pose { view, pixel_mm: self.pixel };
        let pictures = Pictures::new(&raw, Some(&white), &self.frame_options(), self.design.mla.mode, Some(&pose))
            .map_err(|error| StudyError::unseen(format!("a frame at the case “{}”", case.name), error))?;
        Ok(Shot { raw, pictures, view, camera })
    }
}

/// A grey picture of 8 bits as PNG.
pub(super) fn grey_png(name: &str, caption: impl Into<String>, width: usize, height: usize, grey: &[u8]) -> Picture {
    picture(name, caption.into(), width, height, grey, image::ExtendedColorType::L8)
}

/// A picture in colours of 8 bits as PNG.
pub(super) fn colour_png(name: &str, caption: impl Into<String>, width: usize, height: usize, rgb: &[u8]) -> Picture {
    picture(name, caption.into(), width, height, rgb, image::ExtendedColorType::Rgb8)
}

/// A view as PNG.
pub(super) fn view_png(name: &str, caption: impl Into<String>, view: &View) -> Picture {
    let values = view.to_u8();
    match view.planes.len() {
        3 => colour_png(name, caption, view.width, view.height, &values),
        _ => grey_png(name, caption, view.width, view.height, &values),
    }
}

/// The middle of a raw frame, turned upright, as PNG: micro-images are seen only where they are not made smaller.
pub(super) fn raw_png(name: &str, caption: impl Into<String>, raw: &RawImage, side: usize) -> Picture {
    let (w, h) = (raw.width(), raw.height());
    let side = side.min(w).min(h);
    let (left, top) = ((w - side) / 2, (h - side) / 2);
    let levels = raw.to_view();
    let grey: Vec<u8> = (0..side)
        .rev()
        .flat_map(|y| (0..side).rev().map(move |x| (top + y) * w + left + x))
        .map(|k| levels[k])
        .collect();
    grey_png(name, caption, side, side, &grey)
}

fn picture(
    name: &str,
    caption: String,
    width: usize,
    height: usize,
    bytes: &[u8],
    kind: image::ExtendedColorType,
) -> Picture {
    use image::ImageEncoder as _;
    let (width, height) = (width as u32, height as u32);
    let mut png = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut png);
    // Into memory, of a size that belongs to the bytes: nothing can fail but a picture without pixels, which stays empty.
    if encoder.write_image(bytes, width, height, kind).is_err() {
        png.clear();
    }
    Picture { name: name.to_owned(), caption, width, height, png }
}
