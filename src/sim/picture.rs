//! From the simulated truth to a raw frame: what the renderer is given, and how the sensor exposes it.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::configured;
use super::exposure::{Noise, expose};
use super::renderer::{CameraTruth, Medium, RenderOptions, Renderer};
use super::scene::{Board, Scene, TripleBoard, texel_for};
use super::shutter::Displacement;
use super::texture::TextureMap;
use super::truth::{Pose, Surroundings};
use crate::config::Config;
use crate::optics::CameraDesign;
use crate::raw::RawImage;

/// Makes the pictures of one simulated camera.
pub(super) struct Picture {
    config: Config,
    design: CameraDesign,
    noise: Noise,
    renderers: Mutex<HashMap<u32, Arc<Renderer>>>,
    /// Textures by the side of their texels, nm.
    textures: Mutex<HashMap<u64, Arc<TextureMap>>>,
}

impl Picture {
    /// The camera of a configuration.
    pub(super) fn new(config: &Config) -> Self {
        let simulation = &config.bench.simulation;
        Self {
            design: config.design(),
            noise: configured::noise(simulation),
            config: config.clone(),
            renderers: Mutex::new(HashMap::new()),
            textures: Mutex::new(HashMap::new()),
        }
    }

    /// Takes a picture of the simulated world while it goes from one pose to another. `seq` makes its noise its own.
    ///
    /// Where the configuration samples an exposure at one moment only, that is the first.
    pub(super) fn take(&self, from: &Pose, to: &Pose, rays: u32, seq: u64) -> RawImage {
        let camera = self.camera(from);
        let simulation = &self.config.bench.simulation;
        let seed = simulation.seed;
        let travel = Displacement {
            delta_v: to.delta_v_mm - from.delta_v_mm,
            e: to.e_mm - from.e_mm,
            ..Displacement::default()
        };
        let shutter = configured::shutter(&self.config).with_travel(travel);
        let flaws = configured::flaws(&self.config, from.shell_on, seed);
        let irradiance = shutter.collect(&self.renderer(rays, seed), &camera, &self.scene(from), &flaws);
        expose(&irradiance, camera.width, camera.height, &self.noise, seed.rotate_left(32) ^ seq)
    }

    fn renderer(&self, rays: u32, seed: u64) -> Arc<Renderer> {
        let mut renderers = self.renderers.lock().unwrap_or_else(PoisonError::into_inner);
        let renderer = renderers.entry(rays).or_insert_with(|| Arc::new(Renderer::new(RenderOptions { rays, seed })));
        Arc::clone(renderer)
    }

    fn camera(&self, pose: &Pose) -> CameraTruth {
        let simulation = &self.config.bench.simulation;
        let camera = self.design_camera(pose.shell_on.then_some(pose.e_mm));
        let camera = configured::camera(camera, simulation, simulation.seed);
        CameraTruth {
            focal_length: self.design.main_lens.focal_length * (1.0 + simulation.focal_length_error),
            lens_to_mla: pose.lens_to_mla_mm,
            aperture: pose.aperture_mm,
            ..camera
        }
    }

    /// The camera as designed for the joint solution, behind the shell where an e (mm) is given.
    fn design_camera(&self, e: Option<f64>) -> CameraTruth {
        let sensor = &self.config.sensor;
        let (width, height) = (sensor.width_px as usize, sensor.height_px as usize);
        let medium = e.map_or(Medium::Air, |e| Medium::Water { shell: self.design.shell, e, decentre: [0.0, 0.0] });
        let joint = self.design.joint(self.config.assembly.l_bound_mm);
        CameraTruth::from_design(&self.design, joint.delta_v, medium, self.pixel_mm(), width, height)
    }

    fn pixel_mm(&self) -> f64 {
        self.config.pixel_pitch().millimetres()
    }

    fn scene(&self, pose: &Pose) -> Scene {
        match pose.surroundings {
            Surroundings::Diffuser => Scene::Diffuser,
            Surroundings::AirBoard { placed_at_e_mm } => {
                let distance = self.config.object.air_distance_mm;
                let texture = self.texture(Medium::Air, distance);
                let board = Board::new(distance + pose.e_mm - placed_at_e_mm, texture);
                Scene::Board(Board { tilt: self.board_tilt(), ..board })
            }
            Surroundings::AirTripleBoard { distances_mm, placed_at_e_mm } => {
                // The boards stand still while e moves the camera.
                let distances = distances_mm.map(|distance| distance + pose.e_mm - placed_at_e_mm);
                let texture = self.texture(Medium::Air, distances_mm[1]);
                // The edges are the board's own, whatever Δv does to the field.
                let slope = self.design_camera(None).half_field_slope();
                let mut boards = TripleBoard::new(&distances, slope, &texture);
                for strip in &mut boards.strips {
                    strip.board.tilt = self.board_tilt();
                }
                Scene::TripleBoard(boards)
            }
            Surroundings::WaterBoard { distance_mm } => {
                let joint = self.design.joint(self.config.assembly.l_bound_mm);
                let medium = self.design_camera(Some(joint.e)).medium;
                let board = Board::new(distance_mm, self.texture(medium, distance_mm));
                Scene::Board(Board { tilt: self.board_tilt(), ..board })
            }
        }
    }

    fn board_tilt(&self) -> [f64; 2] {
        self.config.bench.simulation.board_tilt_mrad.map(|tilt| tilt / 1000.0)
    }

    /// The boards' texture, its finest detail at the scale of a micro-image's pixels when in focus.
    fn texture(&self, medium: Medium, distance_mm: f64) -> Arc<TextureMap> {
        const NANOMETRES: f64 = 1e6;
        let simulation = &self.config.bench.simulation;
        let texel = texel_for(&self.design, medium, distance_mm, self.pixel_mm());
        let mut textures = self.textures.lock().unwrap_or_else(PoisonError::into_inner);
        let made = textures
            .entry((texel * NANOMETRES) as u64)
            .or_insert_with(|| Arc::new(configured::texture(&self.config, simulation.texture, texel, simulation.seed)));
        Arc::clone(made)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::truth::Truth;

    #[test]
    fn the_axes_travel_during_a_frame_blurs_it_where_configured() {
        let mut config = Config::default();
        (config.sensor.width_px, config.sensor.height_px) = (120, 90);
        let simulation = &mut config.bench.simulation;
        (simulation.read_noise_levels, simulation.bits) = (0.0, 12);
        let from = Truth::new(&Arc::new(config.clone())).pose();
        let to = Pose { delta_v_mm: from.delta_v_mm + 0.04, lens_to_mla_mm: from.lens_to_mla_mm + 0.04, ..from };
        let part = |share: f64| {
            let way = 0.04 * share;
            Pose { delta_v_mm: from.delta_v_mm + way, lens_to_mla_mm: from.lens_to_mla_mm + way, ..from }
        };
        let sharp = Picture::new(&config);
        let take = |picture: &Picture, from: &Pose, to: &Pose| picture.take(from, to, 8, 1).to_f32();
        assert_eq!(take(&sharp, &from, &to), take(&sharp, &from, &from));
        config.bench.simulation.motion.steps = 2;
        let blurred = take(&Picture::new(&config), &from, &to);
        assert_ne!(blurred, take(&sharp, &from, &from));
        let (one, other) = (take(&sharp, &part(0.25), &from), take(&sharp, &part(0.75), &from));
        for ((blurred, one), other) in blurred.iter().zip(&one).zip(&other) {
            assert!((blurred - 0.5 * (one + other)).abs() <= 1.01, "{blurred} for {one} and {other}");
        }
    }
}
