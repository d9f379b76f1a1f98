//! From the simulated truth to a raw frame: what the renderer is given, and how the sensor exposes it.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::configured;
use super::exposure::{Bank, Noise, expose};
use super::reel::Reel;
use super::renderer::{CameraTruth, Medium, RenderOptions, Renderer};
use super::scene::{Board, Scene, TripleBoard, texel_for};
use super::shutter::Displacement;
use super::texture::TextureMap;
use super::truth::{Pose, Surroundings};
use crate::config::Config;
use crate::device::faults::{Faults, PictureFault, SceneFaults};
use plenoptics::optics::CameraDesign;
use plenoptics::raw::RawImage;

/// Makes the pictures of one simulated camera.
pub(super) struct Picture {
    config: Config,
    design: CameraDesign,
    noise: Mutex<Noise>,
    renderers: Mutex<HashMap<u32, Arc<Renderer>>>,
    /// Textures by the side of their texels, nm.
    textures: Mutex<HashMap<u64, Arc<TextureMap>>>,
    /// The newest light by its rays a pixel.
    light: Mutex<HashMap<u32, Light>>,
    /// Noise for previews.
    bank: OnceLock<Bank>,
    /// Light for previews of an axis in motion, where it is configured.
    reel: Option<Reel>,
}

/// What light depends on, beside its rays a pixel and the configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moment {
    from: Pose,
    to: Pose,
    scene: SceneFaults,
    picture: PictureFault,
}

impl Moment {
    pub(super) fn of(from: &Pose, to: &Pose, faults: &Faults) -> Self {
        Self { from: *from, to: *to, scene: faults.scene, picture: faults.camera.picture }
    }
}

/// Noise-free irradiance, kept for the frames of a bench at rest, which differ in their noise alone.
pub(super) struct Light {
    pub(super) moment: Moment,
    pub(super) irradiance: Arc<Vec<f32>>,
}

impl Picture {
    /// The camera of a configuration.
    pub(super) fn new(config: &Config) -> Self {
        let simulation = &config.bench.simulation;
        Self {
            design: config.design(),
            noise: Mutex::new(configured::noise(simulation)),
            config: config.clone(),
            renderers: Mutex::new(HashMap::new()),
            textures: Mutex::new(HashMap::new()),
            light: Mutex::new(HashMap::new()),
            bank: OnceLock::new(),
            reel: Reel::new(&simulation.reel),
        }
    }

    /// Has pictures be exposed so many times as long as one is without anybody's doing, and amplified so many times as much.
    pub(super) fn set_exposed(&self, longer: f64, gain: f64) {
        let plain = configured::noise(&self.config.bench.simulation);
        *self.noise.lock().unwrap_or_else(PoisonError::into_inner) = configured::exposed(plain, longer, gain);
    }

    fn noise(&self) -> Noise {
        *self.noise.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes a picture of the simulated world while it goes from one pose to another. `seq` makes its noise its own.
    ///
    /// Where the configuration samples an exposure at one moment only, that is the first.
    pub(super) fn take(&self, from: &Pose, to: &Pose, rays: u32, seq: u64, faults: &Faults) -> RawImage {
        let light = self.light(&Moment::of(from, to, faults), rays);
        let [width, height] = self.size();
        expose(&light, width, height, &self.noise(), self.seed(seq))
    }

    /// The same for viewers, whose pictures have to keep pace: noise comes from a bank, and the light is that of a measured
    /// frame where one was taken of the moment, or of the nearest pose on the reel.
    pub(super) fn preview(&self, from: &Pose, to: &Pose, rays: u32, seq: u64, faults: &Faults) -> RawImage {
        let light = if let Some(reel) = &self.reel {
            let pose = reel.nearest(from);
            let moment = Moment::of(&pose, &pose, faults);
            reel.light(&moment, || self.trace(&moment, rays))
        } else {
            let moment = Moment::of(from, to, faults);
            let measured = self.kept(&moment, self.config.bench.simulation.rays);
            measured.unwrap_or_else(|| self.light(&moment, rays))
        };
        let [width, height] = self.size();
        let bank = self.bank.get_or_init(|| Bank::new(self.config.bench.simulation.seed));
        bank.expose(&light, width, height, &self.noise(), self.seed(seq))
    }

    fn size(&self) -> [usize; 2] {
        let sensor = &self.config.sensor;
        [sensor.width_px as usize, sensor.height_px as usize]
    }

    fn seed(&self, seq: u64) -> u64 {
        self.config.bench.simulation.seed.rotate_left(32) ^ seq
    }

    /// The light of a moment: traced anew unless it is that of the frame before.
    fn light(&self, moment: &Moment, rays: u32) -> Arc<Vec<f32>> {
        if let Some(light) = self.kept(moment, rays) {
            return light;
        }
        let irradiance = Arc::new(self.trace(moment, rays));
        let light = Light { moment: *moment, irradiance: Arc::clone(&irradiance) };
        self.light.lock().unwrap_or_else(PoisonError::into_inner).insert(rays, light);
        irradiance
    }

    /// The light of a moment, where it has been traced.
    fn kept(&self, moment: &Moment, rays: u32) -> Option<Arc<Vec<f32>>> {
        let light = self.light.lock().unwrap_or_else(PoisonError::into_inner);
        light.get(&rays).filter(|light| light.moment == *moment).map(|light| Arc::clone(&light.irradiance))
    }

    fn trace(&self, moment: &Moment, rays: u32) -> Vec<f32> {
        let Moment { from, to, scene, picture } = moment;
        let camera = self.camera(from, scene);
        let seed = self.config.bench.simulation.seed;
        let travel = Displacement {
            delta_v: to.delta_v_mm - from.delta_v_mm,
            e: to.e_mm - from.e_mm,
            ..Displacement::default()
        };
        let shutter = configured::shutter(&self.config).with_travel(travel);
        let flaws = match scene.bubbles {
            0 => configured::flaws(&self.config, from.shell_on, seed),
            count => {
                let mut config = self.config.clone();
                config.bench.simulation.bubbles.count = count.into();
                configured::flaws(&config, from.shell_on, seed)
            }
        };
        let scene = self.scene(from, scene);
        let mut irradiance = shutter.collect(&self.renderer(rays, seed), &camera, &scene, &flaws);
        spoil(&mut irradiance, camera.width, *picture);
        irradiance
    }

    fn renderer(&self, rays: u32, seed: u64) -> Arc<Renderer> {
        let mut renderers = self.renderers.lock().unwrap_or_else(PoisonError::into_inner);
        let renderer = renderers.entry(rays).or_insert_with(|| Arc::new(Renderer::new(RenderOptions { rays, seed })));
        Arc::clone(renderer)
    }

    fn camera(&self, pose: &Pose, faults: &SceneFaults) -> CameraTruth {
        let simulation = &self.config.bench.simulation;
        let mut camera = self.design_camera(pose.shell_on.then_some(pose.e_mm));
        if let Medium::Water { shell, e, .. } = &mut camera.medium {
            let radius = if faults.no_shell { FLAT_MM } else { shell.outer_radius + faults.shell_radius_mm };
            // The vertex stays where it is: the centre moves with the radius.
            let larger = radius - shell.outer_radius;
            (shell.outer_radius, shell.inner_radius, *e) = (radius, shell.inner_radius + larger, *e - larger);
            if faults.tank_empty {
                shell.n_water = 1.0;
            }
        }
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

    fn scene(&self, pose: &Pose, faults: &SceneFaults) -> Scene {
        let (farther, tilt) = (faults.board_displaced_mm, self.board_tilt(faults));
        let side_by_side = |distances: &[f64], camera: &CameraTruth, texture: &Arc<TextureMap>| {
            let mut boards = TripleBoard::new(distances, camera.half_field_slope(), texture);
            for strip in &mut boards.strips {
                strip.board.tilt = tilt;
            }
            Scene::TripleBoard(boards)
        };
        let flat = |distance: f64, camera: &CameraTruth, texture: Arc<TextureMap>| {
            if faults.second_board_mm > 0.0 {
                return side_by_side(&[distance, distance - faults.second_board_mm], camera, &texture);
            }
            Scene::Board(Board { tilt, ..Board::new(distance, texture) })
        };
        match pose.surroundings {
            Surroundings::Diffuser => Scene::Diffuser,
            Surroundings::AirBoard { placed_at_e_mm } => {
                let distance = self.config.object.air_distance_mm;
                let texture = self.texture(Medium::Air, distance);
                flat(distance + farther + pose.e_mm - placed_at_e_mm, &self.design_camera(None), texture)
            }
            Surroundings::AirTripleBoard { distances_mm, placed_at_e_mm } => {
                // The boards stand still while e moves the camera.
                let distances = distances_mm.map(|distance| distance + farther + pose.e_mm - placed_at_e_mm);
                let texture = self.texture(Medium::Air, distances_mm[1]);
                // The edges are the board's own, whatever Δv does to the field.
                side_by_side(&distances, &self.design_camera(None), &texture)
            }
            Surroundings::WaterBoard { distance_mm } => {
                let joint = self.design.joint(self.config.assembly.l_bound_mm);
                let camera = self.design_camera(Some(joint.e));
                flat(distance_mm + farther, &camera, self.texture(camera.medium, distance_mm))
            }
        }
    }

    fn board_tilt(&self, faults: &SceneFaults) -> [f64; 2] {
        let [x, y] = self.config.bench.simulation.board_tilt_mrad;
        [x + faults.board_turned_mrad, y].map(|tilt| tilt / 1000.0)
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

/// Radius at which a window is as good as flat, mm.
const FLAT_MM: f64 = 1e5;
/// How much less light there is where it is dark, and more where there is too much.
const DARK: f32 = 0.01;
const GLARE: f32 = 12.0;
/// To how many pixels either side of its place a blurred picture's light is spread, each way.
const SPREAD_PX: usize = 6;
/// Where data of a torn picture are lost, and how much of them, as shares of its height and width.
const TORN_AT: f64 = 0.45;
const TORN_BY: f64 = 0.3;

/// Does to a picture what is wrong with the camera.
fn spoil(irradiance: &mut Vec<f32>, width: usize, fault: PictureFault) {
    match fault {
        PictureFault::None => {}
        PictureFault::Dark => irradiance.iter_mut().for_each(|light| *light *= DARK),
        PictureFault::Saturated => irradiance.iter_mut().for_each(|light| *light *= GLARE),
        PictureFault::Blurred => {
            for row in irradiance.chunks_mut(width) {
                row.copy_from_slice(&spread(row));
            }
            let height = irradiance.len() / width;
            for x in 0..width {
                let column: Vec<f32> = irradiance.iter().skip(x).step_by(width).copied().collect();
                for (y, light) in spread(&column).into_iter().enumerate().take(height) {
                    irradiance[y * width + x] = light;
                }
            }
        }
        PictureFault::Torn => {
            let lost = (TORN_BY * width as f64) as usize;
            let at = (TORN_AT * (irradiance.len() / width) as f64) as usize * width + lost;
            irradiance.drain(at..at + lost);
            irradiance.extend(std::iter::repeat_n(0.0, lost));
        }
    }
}

/// The mean over [`SPREAD_PX`] either side of each place, at the ends over as many as there are.
fn spread(line: &[f32]) -> Vec<f32> {
    let at = |index: usize| {
        let near = &line[index.saturating_sub(SPREAD_PX)..(index + SPREAD_PX + 1).min(line.len())];
        near.iter().sum::<f32>() / near.len() as f32
    };
    (0..line.len()).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::truth::Truth;

    #[test]
    fn a_frame_at_rest_has_new_noise_on_the_same_light() {
        let mut config = Config::default();
        (config.sensor.width_px, config.sensor.height_px) = (120, 90);
        let picture = Picture::new(&config);
        let pose = Truth::new(&Arc::new(config.clone())).pose();
        let none = Faults::default();
        let first = picture.take(&pose, &pose, 8, 1, &none);
        let second = picture.take(&pose, &pose, 8, 2, &none);
        assert_ne!(first, second);
        assert_eq!(second, Picture::new(&config).take(&pose, &pose, 8, 2, &none), "as if it were traced anew");
        let rest = Moment { from: pose, to: pose, scene: none.scene, picture: none.camera.picture };
        let light = |moment: &Moment, rays| picture.light(moment, rays);
        let kept = light(&rest, 8);
        assert!(Arc::ptr_eq(&kept, &light(&rest, 8)));
        // A preview between two frames makes neither be traced again; whatever changes does.
        let preview = light(&rest, 2);
        assert!(Arc::ptr_eq(&kept, &light(&rest, 8)) && Arc::ptr_eq(&preview, &light(&rest, 2)));
        let others = [
            Moment { from: Pose { e_mm: pose.e_mm + 1e-6, ..pose }, ..rest },
            Moment { to: Pose { delta_v_mm: pose.delta_v_mm + 1e-6, ..pose }, ..rest },
            Moment { scene: SceneFaults { bubbles: 3, ..none.scene }, ..rest },
            Moment { picture: PictureFault::Dark, ..rest },
        ];
        for other in others {
            let before = light(&rest, 8);
            assert!(!Arc::ptr_eq(&before, &light(&other, 8)), "{other:?}");
        }
    }

    #[test]
    fn exposure_scales_the_light_and_gain_the_noise_with_it() {
        let mut config = Config::default();
        (config.sensor.width_px, config.sensor.height_px) = (120, 90);
        let simulation = &mut config.bench.simulation;
        (simulation.read_noise_levels, simulation.electrons_per_level, simulation.bits) = (1.0, 20.0, 16);
        let pose = Truth::new(&Arc::new(config.clone())).pose();
        let picture = Picture::new(&config);
        // Two frames of one moment differ in their noise alone.
        let seen = |longer: f64, gain: f64| {
            picture.set_exposed(longer, gain);
            let [one, other] = [1, 2].map(|seq| picture.take(&pose, &pose, 8, seq, &Faults::default()).to_f32());
            let mean = |of: &dyn Fn(f64, f64) -> f64| {
                let each = one.iter().zip(&other).map(|(&one, &other)| of(f64::from(one), f64::from(other)));
                each.sum::<f64>() / one.len() as f64
            };
            (mean(&|one, _| one), (0.5 * mean(&|one, other| (one - other).powi(2))).sqrt())
        };
        let (plain, noise) = seen(0.4, 1.0);
        let (amplified, amplified_noise) = seen(0.4, 2.0);
        assert!((amplified / plain - 2.0).abs() < 0.02, "{plain} {amplified}");
        assert!((amplified_noise / noise - 2.0).abs() < 0.06, "{noise} {amplified_noise}");
        // Twice the photons have 1.4 times their noise; the read noise stays.
        let (longer, longer_noise) = seen(0.8, 1.0);
        assert!((longer / plain - 2.0).abs() < 0.02, "{plain} {longer}");
        assert!((1.2..1.45).contains(&(longer_noise / noise)), "{noise} {longer_noise}");
        let (most, _) = seen(500.0, 1.0);
        // Between the micro-images it is dark however long it is exposed.
        assert!(most > 0.6 * 65_535.0, "it saturates: {most}");
    }

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
        let take =
            |picture: &Picture, from: &Pose, to: &Pose| picture.take(from, to, 8, 1, &Faults::default()).to_f32();
        assert_eq!(take(&sharp, &from, &to), take(&sharp, &from, &from));
        config.bench.simulation.motion.steps = 2;
        let blurred = take(&Picture::new(&config), &from, &to);
        assert_ne!(blurred, take(&sharp, &from, &from));
        let (one, other) = (take(&sharp, &part(0.25), &from), take(&sharp, &part(0.75), &from));
        for ((blurred, one), other) in blurred.iter().zip(&one).zip(&other) {
            assert!((blurred - 0.5 * (one + other)).abs() <= 1.01, "{blurred} for {one} and {other}");
        }
    }
    #[test]
    fn what_is_wrong_with_pictures_is_seen_in_them() {
        let mut config = Config::default();
        (config.sensor.width_px, config.sensor.height_px) = (120, 90);
        let pose = Truth::new(&Arc::new(config.clone())).pose();
        let picture = Picture::new(&config);
        let take = |fault| {
            let mut faults = Faults::default();
            faults.camera.picture = fault;
            picture.take(&pose, &pose, 8, 1, &faults).to_f32()
        };
        let mean = |frame: &[f32]| frame.iter().sum::<f32>() / frame.len() as f32;
        let variation = |frame: &[f32]| frame.windows(2).map(|pair| (pair[1] - pair[0]).abs()).sum::<f32>();
        let (good, dark, glare) = (take(PictureFault::None), take(PictureFault::Dark), take(PictureFault::Saturated));
        assert!(mean(&dark) < 0.1 * mean(&good), "{} of {}", mean(&dark), mean(&good));
        let clipped = |frame: &[f32]| frame.iter().filter(|&&level| level > 254.5).count() as f32 / frame.len() as f32;
        assert!(clipped(&good) < 0.05 && clipped(&glare) > 0.5, "{} and {}", clipped(&good), clipped(&glare));
        assert!(variation(&take(PictureFault::Blurred)) < 0.6 * variation(&good));
        let torn = take(PictureFault::Torn);
        let above = 120 * 40;
        assert_eq!(torn[..above], good[..above]);
        assert!(torn[above + 120..120 * 89] != good[above + 120..120 * 89]);
        assert_eq!(torn.len(), good.len());
    }

    #[test]
    fn an_empty_tank_and_a_board_elsewhere_look_otherwise() {
        let mut config = Config::default();
        (config.sensor.width_px, config.sensor.height_px) = (120, 90);
        config.bench.simulation.read_noise_levels = 0.0;
        let truth = Truth::new(&Arc::new(config.clone()));
        truth.obey(&crate::device::Setup::WaterBoard { distance_mm: 800.0 });
        let (pose, picture) = (truth.pose(), Picture::new(&config));
        let take = |faults: Faults| picture.take(&pose, &pose, 8, 1, &faults).to_f32();
        let good = take(Faults::default());
        let (mut empty, mut elsewhere, mut bubbles) = (Faults::default(), Faults::default(), Faults::default());
        empty.scene.tank_empty = true;
        elsewhere.scene.board_displaced_mm = 200.0;
        bubbles.scene.bubbles = 80;
        for faults in [empty, elsewhere, bubbles] {
            assert_ne!(take(faults), good, "{faults:?}");
        }
    }
}
