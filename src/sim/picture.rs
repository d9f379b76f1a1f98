//! From the simulated truth to a raw frame: what the renderer is given, and how the sensor exposes it.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::exposure::{Noise, expose};
use super::renderer::{CameraTruth, Medium, RenderOptions, Renderer};
use super::scene::{Board, Scene, TripleBoard, texel_for};
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
            noise: Noise {
                read_noise_levels: simulation.read_noise_levels,
                electrons_per_level: simulation.electrons_per_level,
                ..Noise::default()
            },
            config: config.clone(),
            renderers: Mutex::new(HashMap::new()),
            textures: Mutex::new(HashMap::new()),
        }
    }

    /// Takes a picture of a moment of the simulated world. `seq` makes its noise its own.
    pub(super) fn take(&self, pose: &Pose, rays: u32, seq: u64) -> RawImage {
        let camera = self.camera(pose);
        let seed = self.config.bench.simulation.seed;
        let irradiance = self.renderer(rays, seed).render(&camera, &self.scene(pose));
        expose(&irradiance, camera.width, camera.height, &self.noise, seed.rotate_left(32) ^ seq)
    }

    fn renderer(&self, rays: u32, seed: u64) -> Arc<Renderer> {
        let mut renderers = self.renderers.lock().unwrap_or_else(PoisonError::into_inner);
        let renderer = renderers.entry(rays).or_insert_with(|| Arc::new(Renderer::new(RenderOptions { rays, seed })));
        Arc::clone(renderer)
    }

    fn camera(&self, pose: &Pose) -> CameraTruth {
        let simulation = &self.config.bench.simulation;
        let mut camera = self.design_camera(pose.shell_on.then_some(pose.e_mm));
        camera.take_simulation(simulation, simulation.seed);
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
            .or_insert_with(|| Arc::new(TextureMap::generate(simulation.texture, texel, simulation.seed)));
        Arc::clone(made)
    }
}
