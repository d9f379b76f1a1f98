//! What the sensor collects while the shutter is open: light of several moments where something moves, through colour
//! filters where there are any.

use super::flaws::Flaws;
use super::renderer::{CameraTruth, Medium, Renderer};
use super::scene::Scene;
use super::texture::TextureMap;
use crate::config::{Config, Texture};
use crate::raw::{CfaPattern, Channel};

/// How far things have moved, mm.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Displacement {
    /// MLA and sensor, away from the main lens.
    pub delta_v: f64,
    /// The lens, away from the water; in air, from the board.
    pub e: f64,
    /// The board, along its own x and y.
    pub board: [f64; 2],
}

impl Displacement {
    fn plus(self, other: Self, share: f64) -> Self {
        let sum = |one: f64, other: f64| one + share * other;
        Self {
            delta_v: sum(self.delta_v, other.delta_v),
            e: sum(self.e, other.e),
            board: [sum(self.board[0], other.board[0]), sum(self.board[1], other.board[1])],
        }
    }

    /// Camera and scene so displaced.
    #[must_use]
    pub fn applied(&self, camera: &CameraTruth, scene: &Scene) -> (CameraTruth, Scene) {
        let mut camera = *camera;
        camera.lens_to_mla += self.delta_v;
        // In water e is between lens and shell, and the boards stand before the shell.
        let further = match &mut camera.medium {
            Medium::Air => self.e,
            Medium::Water { e, .. } => {
                *e += self.e;
                0.0
            }
        };
        (camera, scene.moved(self.board, further))
    }
}

/// Colour filters before the pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mosaic {
    /// Which pixel has which.
    pub pattern: CfaPattern,
    /// What a pixel behind each makes of white light, over what it makes without: red, green, blue.
    pub sensitivities: [f64; 3],
}

/// An exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shutter {
    /// Moments at which it is sampled, the middles of as many equal parts of it; at 1 nothing moves.
    pub steps: u32,
    /// Displacement from the given pose when it begins.
    pub from: Displacement,
    /// The same when it ends.
    pub to: Displacement,
    /// The sensor's colour filters.
    pub mosaic: Option<Mosaic>,
}

impl Shutter {
    /// The configured exposure, centred on the pose.
    #[must_use]
    pub fn configured(config: &Config) -> Self {
        const MICROMETRE: f64 = 1e-3;
        let simulation = &config.bench.simulation;
        let motion = &simulation.motion;
        let whole = Displacement {
            delta_v: motion.delta_v_um * MICROMETRE,
            e: motion.e_um * MICROMETRE,
            board: motion.board_um.map(|way| way * MICROMETRE),
        };
        let still = Displacement::default();
        let sensitivities = simulation.mosaic.sensitivities;
        let mosaic = config.sensor.mosaic.map(|pattern| Mosaic { pattern, sensitivities });
        Self { steps: motion.steps, from: still.plus(whole, -0.5), to: still.plus(whole, 0.5), mosaic }
    }

    /// The same with a travel that begins at the pose.
    #[must_use]
    pub fn with_travel(self, travel: Displacement) -> Self {
        Self { to: self.to.plus(travel, 1.0), ..self }
    }

    /// Noise-free irradiance over the exposure, as [`Renderer::render`] gives it for a moment.
    #[must_use]
    pub fn collect(&self, renderer: &Renderer, camera: &CameraTruth, scene: &Scene, flaws: &Flaws) -> Vec<f32> {
        if self.steps <= 1 {
            return self.moment(renderer, camera, scene, flaws);
        }
        let steps = if self.from == self.to { 1 } else { self.steps };
        let mut sum = vec![0.0f32; camera.width * camera.height];
        for step in 0..steps {
            let share = (f64::from(step) + 0.5) / f64::from(steps);
            let here = self.from.plus(self.from, -share).plus(self.to, share);
            let (camera, scene) = here.applied(camera, scene);
            for (sum, light) in sum.iter_mut().zip(self.moment(renderer, &camera, &scene, flaws)) {
                *sum += light;
            }
        }
        let share = 1.0 / steps as f32;
        sum.iter_mut().for_each(|sum| *sum *= share);
        sum
    }

    fn moment(&self, renderer: &Renderer, camera: &CameraTruth, scene: &Scene, flaws: &Flaws) -> Vec<f32> {
        let Some(mosaic) = &self.mosaic else { return renderer.render_flawed(camera, scene, flaws, None) };
        let channels: Vec<Vec<f32>> = match scene {
            // White in every channel.
            Scene::Diffuser | Scene::Dark => vec![renderer.render_flawed(camera, scene, flaws, None)],
            Scene::Board(_) | Scene::TripleBoard(_) | Scene::Cutouts(_) => Channel::ALL
                .into_iter()
                .map(|channel| renderer.render_flawed(camera, scene, flaws, Some(channel)))
                .collect(),
        };
        let pixel = |k: usize| {
            let channel = mosaic.pattern.channel(k % camera.width, k / camera.width).index();
            channels[channel.min(channels.len() - 1)][k] * mosaic.sensitivities[channel] as f32
        };
        (0..camera.width * camera.height).map(pixel).collect()
    }
}

/// A configured board's texture, with its colours where the sensor has filters to see them. `texel` in mm.
#[must_use]
pub fn configured_texture(config: &Config, texture: Texture, texel: f64, seed: u64) -> TextureMap {
    if config.sensor.mosaic.is_some() {
        TextureMap::generate_coloured(texture, texel, seed, config.bench.simulation.mosaic.colour)
    } else {
        TextureMap::generate(texture, texel, seed)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::config::Config;
    use crate::sim::renderer::{RenderOptions, Tracer};
    use crate::sim::scene::{Board, TripleBoard, texel_for};

    const PIXEL: f64 = 0.00345;

    fn camera(medium: Medium, width: usize, height: usize) -> CameraTruth {
        let design = Config::default().design();
        CameraTruth::from_design(&design, design.joint(0.0).delta_v, medium, PIXEL, width, height)
    }

    fn water() -> Medium {
        Medium::Water { shell: Config::default().design().shell, e: 2.0, decentre: [0.0; 2] }
    }

    fn textured(distance: f64, medium: Medium, colour: f64) -> Scene {
        let texel = texel_for(&Config::default().design(), medium, distance, PIXEL);
        Scene::Board(Board::new(distance, Arc::new(TextureMap::generate_coloured(Texture::Natural, texel, 1, colour))))
    }

    fn renderer(rays: u32) -> Renderer {
        Renderer::new(RenderOptions { rays, seed: 4 })
    }

    #[test]
    fn with_nothing_configured_a_frame_is_the_plain_one_to_the_bit() {
        let mut config = Config::default();
        let (camera, scene) = (camera(water(), 120, 60), textured(800.0, water(), 0.0));
        let plain = renderer(8).render(&camera, &scene);
        let flaws = Flaws::seeded(&config, true, 1);
        assert_eq!(plain, Shutter::configured(&config).collect(&renderer(8), &camera, &scene, &flaws));
        config.bench.simulation.motion.steps = 5;
        assert_eq!(plain, Shutter::configured(&config).collect(&renderer(8), &camera, &scene, &flaws));
        let mut seeded = camera;
        seeded.take_simulation(&config.bench.simulation, 1);
        let explicit = CameraTruth { distortion_k1: 0.0, pupil_walk: 0.0, focal_factors: [1.0; 3], ..seeded };
        assert_eq!(seeded, explicit);
    }

    /// A moving edge is smeared evenly over its way: the variance of its profile grows by the way's square over twelve.
    #[test]
    fn a_moving_board_smears_an_edge_over_its_way() {
        let mut camera = camera(water(), 31, 31);
        // Of the joint solution at e = 0, where the board is sharp.
        camera.medium = Medium::Water { shell: Config::default().design().shell, e: 0.0, decentre: [0.0; 2] };
        let values: Vec<f32> = (0..256 * 256).map(|k| if k % 256 < 128 { 1.0 } else { 0.0 }).collect();
        let board = Board {
            texture_origin: [128.0, 0.0],
            ..Board::new(800.0, Arc::new(TextureMap::from_values(&values, 1.0)))
        };
        let tracer = Tracer::new(&camera);
        let footprint = tracer.footprint(&board).unwrap();
        let scene = Scene::Board(board);
        let renderer = renderer(256);
        let white = renderer.render(&camera, &Scene::Diffuser);
        let spread = |way_px: f64, steps: u32| {
            let half = Displacement { board: [0.5 * way_px * footprint, 0.0], ..Displacement::default() };
            let from = Displacement { board: [-half.board[0], 0.0], ..half };
            let frame =
                Shutter { steps, from, to: half, mosaic: None }.collect(&renderer, &camera, &scene, &Flaws::default());
            let at = |x: usize| {
                let sum = |frame: &[f32]| (8..23).map(|y| f64::from(frame[y * 31 + x])).sum::<f64>();
                sum(&frame) / sum(&white)
            };
            let steps: Vec<(f64, f64)> = (7..23).map(|x| (x as f64 + 0.5, at(x + 1) - at(x))).collect();
            let total: f64 = steps.iter().map(|step| step.1).sum();
            let mean = steps.iter().map(|(x, step)| x * step).sum::<f64>() / total;
            (mean, steps.iter().map(|(x, step)| (x - mean).powi(2) * step).sum::<f64>() / total)
        };
        let (still, moving) = (spread(0.0, 2), spread(5.0, 16));
        println!(
            "edge at {:.3} px, variance {:.3} px²; moving {:.3} px, {:.3} px²",
            still.0, still.1, moving.0, moving.1
        );
        assert!((moving.0 - still.0).abs() < 0.03, "a movement centred on the pose moves nothing");
        let expected = 25.0 / 12.0 * (1.0 - 1.0 / 256.0);
        assert!(((moving.1 - still.1) / expected - 1.0).abs() < 0.03, "{} for {expected}", moving.1 - still.1);
    }

    #[test]
    fn axes_that_move_give_the_mean_of_the_frames_on_their_way() {
        let (delta_v, e) = (0.08, 0.6);
        for medium in [water(), Medium::Air] {
            let camera = camera(medium, 90, 60);
            let scene = textured(if medium == Medium::Air { 167.0 } else { 800.0 }, medium, 0.0);
            let travel = Displacement { delta_v, e, ..Displacement::default() };
            let still = Displacement::default();
            let shutter = Shutter { steps: 2, from: still, to: still, mosaic: None }.with_travel(travel);
            let found = shutter.collect(&renderer(8), &camera, &scene, &Flaws::default());
            let at = |share: f64| {
                let mut camera = CameraTruth { lens_to_mla: camera.lens_to_mla + share * delta_v, ..camera };
                let scene = match (&mut camera.medium, &scene) {
                    (Medium::Water { e: here, .. }, scene) => {
                        *here += share * e;
                        scene.clone()
                    }
                    (Medium::Air, Scene::Board(board)) => {
                        Scene::Board(Board { distance: board.distance + share * e, ..board.clone() })
                    }
                    _ => unreachable!("the scene is a board"),
                };
                renderer(8).render(&camera, &scene)
            };
            let (one, other) = (at(0.25), at(0.75));
            assert_ne!(one, other);
            for ((found, one), other) in found.iter().zip(&one).zip(&other) {
                assert!((found - 0.5 * (one + other)).abs() < 1e-6, "{found} for {one} and {other}");
            }
        }
    }

    #[test]
    fn strips_take_their_edges_with_them() {
        let camera = camera(Medium::Air, 300, 20);
        let texture = Arc::new(TextureMap::from_values(&[1.0], 1.0));
        let triple = TripleBoard::new(&[160.0, 167.0, 175.0], camera.half_field_slope(), &texture);
        let Scene::TripleBoard(moved) = Scene::TripleBoard(triple.clone()).moved([0.7, 0.2], 1.5) else { panic!() };
        for (moved, before) in moved.strips.iter().zip(&triple.strips) {
            assert_eq!(moved.board.distance, before.board.distance + 1.5);
            assert_eq!(moved.range, before.range.map(|edge| edge + 0.7));
            assert_eq!(moved.board.texture_origin[1], before.board.texture_origin[1] - 0.2);
        }
    }

    #[test]
    fn channels_differ_in_gain_and_in_content() {
        let camera = camera(Medium::Air, 160, 120);
        let sensitivities = [0.6, 1.0, 0.5];
        let still = Displacement::default();
        let collect = |pattern, scene: &Scene| {
            let mosaic = Some(Mosaic { pattern, sensitivities });
            Shutter { steps: 1, from: still, to: still, mosaic }.collect(
                &renderer(16),
                &camera,
                scene,
                &Flaws::default(),
            )
        };
        let white = renderer(16).render(&camera, &Scene::Diffuser);
        let (grey, coloured) = (textured(167.0, Medium::Air, 0.0), textured(167.0, Medium::Air, 0.6));
        let plain = renderer(16).render(&camera, &grey);
        for pattern in CfaPattern::ALL {
            let frames = [collect(pattern, &Scene::Diffuser), collect(pattern, &grey), collect(pattern, &coloured)];
            let mut sums = [[0.0f64; 3]; 2];
            for k in 0..white.len() {
                let channel = pattern.channel(k % 160, k / 160).index();
                let gain = sensitivities[channel] as f32;
                assert_eq!(frames[0][k], white[k] * gain);
                assert_eq!(frames[1][k], plain[k] * gain);
                sums[0][channel] += f64::from(frames[0][k]);
                sums[1][channel] += f64::from(frames[2][k] / gain);
                assert!(frames[2][k] <= frames[1][k] + 0.01 * gain);
            }
            // Red and blue have a quarter of the pixels each, spread alike over the micro-images.
            let [red, green, blue] = sums[0];
            assert!((red / (green / 2.0) / 0.6 - 1.0).abs() < 0.01, "{red} {green} {blue}");
            assert!((blue / (green / 2.0) / 0.5 - 1.0).abs() < 0.01, "{red} {green} {blue}");
            // Colours take light, of each channel another amount.
            let content = [sums[1][0], sums[1][1] / 2.0, sums[1][2]];
            let apart = |a: f64, b: f64| (a / b - 1.0).abs() > 0.005;
            assert!(apart(content[0], content[1]) || apart(content[1], content[2]), "{content:?}");
        }
    }
}
