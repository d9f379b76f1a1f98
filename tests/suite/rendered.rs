//! Frames of the exact-ray renderer with the grid that they truly have.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_3};
use std::sync::Arc;

use plenalign::config::{Config, Texture};
use plenalign::imaging::grid::Grid;
use plenalign::optics::ArrayKind;
use plenalign::raw::RawImage;
use plenalign::sim::exposure::{Noise, expose};
use plenalign::sim::flaws::Flaws;
use plenalign::sim::renderer::{CameraTruth, Medium, RenderOptions, Renderer};
use plenalign::sim::scene::{Board, Scene, texel_for};
use plenalign::sim::texture::TextureMap;

/// The preset's camera at its joint solution in air, its pixels as large as a micro-image pitch asks for.
pub(super) struct Rendered {
    pub array: ArrayKind,
    pub pitch_px: f64,
    pub rotation_deg: f64,
    /// Of the micro-image centres from the frame's, px.
    pub offset: [f64; 2],
    pub size: [usize; 2],
    pub noise: f64,
    pub rays: u32,
    pub seed: u64,
    pub flaws: Flaws,
    pub focal_factors: [f64; 3],
    /// Aperture in units of the solution's.
    pub aperture: f64,
}

impl Default for Rendered {
    fn default() -> Self {
        Self {
            array: ArrayKind::Square,
            pitch_px: 29.5,
            rotation_deg: 0.6,
            offset: [3.3, -7.7],
            size: [400, 400],
            noise: 2.0,
            rays: 8,
            seed: 1,
            flaws: Flaws::default(),
            focal_factors: [1.0; 3],
            aperture: 1.0,
        }
    }
}

impl Rendered {
    fn camera(&self) -> (CameraTruth, f64) {
        let mut config = Config::default();
        config.mla.array = self.array;
        let design = config.design();
        let joint = design.joint(0.0);
        let [w, h] = self.size;
        let mut camera = CameraTruth::from_design(&design, joint.delta_v, Medium::Air, 1.0, w, h);
        let ratio = (camera.lens_to_mla + camera.mla_to_sensor) / camera.lens_to_mla;
        camera.pixel = camera.mla_pitch * ratio / self.pitch_px;
        camera.rotation = self.rotation_deg.to_radians();
        camera.offset = self.offset.map(|x| x / ratio);
        camera.focal_factors = self.focal_factors;
        camera.aperture *= self.aperture;
        (camera, joint.equivalent_distance)
    }

    /// The MLA pitch, px of the frame.
    pub(super) fn mla_pitch_px(&self) -> f64 {
        let camera = self.camera().0;
        camera.mla_pitch / camera.pixel
    }

    /// The spacing of the board's image points, px: what holds near the axis.
    pub(super) fn spacing_px(&self) -> f64 {
        let mut config = Config::default();
        config.mla.array = self.array;
        let (design, (camera, distance)) = (config.design(), self.camera());
        design.exact_in_air(design.joint(0.0).delta_v, distance).paraxial_spacing() / camera.pixel
    }

    fn exposed(&self, camera: &CameraTruth, scene: &Scene) -> RawImage {
        let [w, h] = self.size;
        let noise = Noise { read_noise_levels: self.noise, ..Noise::default() };
        let options = RenderOptions { rays: self.rays, seed: self.seed };
        let irradiance = Renderer::new(options).render_flawed(camera, scene, &self.flaws, None);
        expose(&irradiance, w, h, &noise, 2 * self.seed)
    }

    /// A frame through the diffuser.
    pub(super) fn white(&self) -> RawImage {
        self.exposed(&self.camera().0, &Scene::Diffuser)
    }

    /// A frame of a board in focus.
    pub(super) fn textured(&self, texture: Texture) -> RawImage {
        let mut config = Config::default();
        config.mla.array = self.array;
        let (camera, distance) = self.camera();
        let texel = texel_for(&config.design(), Medium::Air, distance, camera.pixel);
        let map = Arc::new(TextureMap::generate(texture, texel, self.seed));
        self.exposed(&camera, &Scene::Board(Board::new(distance, map)))
    }

    /// The grid that the renderer was told.
    pub(super) fn grid(&self) -> Grid {
        let period = match self.array {
            ArrayKind::Square => FRAC_PI_2,
            ArrayKind::Hexagonal => FRAC_PI_3,
        };
        let along = |angle: f64| [self.pitch_px * angle.cos(), self.pitch_px * angle.sin()];
        let rotation = self.rotation_deg.to_radians();
        let centre = [0, 1].map(|k| (self.size[k] as f64 - 1.0) / 2.0 + self.offset[k]);
        Grid::affine(self.array, centre, [along(rotation), along(rotation + period)], self.size)
    }
}

/// Root mean square distance of the complete micro-images of two grids.
pub(super) fn centres_rms(a: &Grid, b: &Grid) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for m in a.micro_images_within(a.pitch_px() / 2.0) {
        let n = b.nearest(m.x, m.y);
        sum += (m.x - n.x).powi(2) + (m.y - n.y).powi(2);
        count += 1.0;
    }
    f64::sqrt(sum / count)
}

/// Uniform in [0, 1), the same on every run.
pub(super) fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 33) as f64 / (1u64 << 31) as f64
}
