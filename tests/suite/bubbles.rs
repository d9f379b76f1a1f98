//! Bubbles of air in the water, by exact rays: what they cover does not pull the spacing of the rest.

use std::sync::Arc;

use plenalign::config::{Config, Texture};
use plenalign::imaging::live::{LiveMeter, LiveOptions};
use plenalign::imaging::measurement::{FrameOptions, MeasurementError, WhiteModel, measure_frame};
use plenalign::imaging::spacing::SpacingError;
use plenalign::raw::RawImage;
use plenalign::sim::configured;
use plenalign::sim::exposure::expose;
use plenalign::sim::renderer::{CameraTruth, Medium, RenderOptions, Renderer};
use plenalign::sim::scene::{Board, Scene, texel_for};

const PIXEL_MM: f64 = 0.00345;
const SIDE: usize = 480;
const BOARD_MM: f64 = 800.0;

/// A camera behind the shell, with its white frame.
struct Field {
    config: Config,
    camera: CameraTruth,
    delta_v: f64,
    rays: u32,
    options: FrameOptions,
    white: WhiteModel,
}

impl Field {
    /// Of a camera whose Δv is by so much (mm) another than that of the solution, at an e (mm), in so dense a medium.
    fn new(off_mm: f64, e: f64, n_water: Option<f64>, rays: u32, seed: u64) -> Self {
        let mut config = Config::default();
        (config.sensor.width_px, config.sensor.height_px) = (SIDE as u32, SIDE as u32);
        let design = config.design();
        let mut shell = design.shell;
        shell.n_water = n_water.unwrap_or(shell.n_water);
        let medium = Medium::Water { shell, e, decentre: [0.0; 2] };
        let delta_v = design.joint(0.0).delta_v + off_mm;
        let camera = CameraTruth::from_design(&design, delta_v, medium, PIXEL_MM, SIDE, SIDE);
        let camera = configured::camera(camera, &config.bench.simulation, seed);
        let options = FrameOptions::of_design(&design, PIXEL_MM);
        let white = WhiteModel::of(&taken(&config, &camera, &Scene::Diffuser, rays, seed), &options).unwrap();
        Self { config, camera, delta_v, rays, options, white }
    }

    /// A frame of the board behind so many bubbles.
    fn frame(&self, bubbles: u32, seed: u64) -> RawImage {
        let mut config = self.config.clone();
        config.bench.simulation.bubbles.count = bubbles;
        let texel = texel_for(&config.design(), self.camera.medium, BOARD_MM, PIXEL_MM);
        let map = Arc::new(configured::texture(&config, Texture::Natural, texel, seed));
        taken(&config, &self.camera, &Scene::Board(Board::new(BOARD_MM, map)), self.rays, seed)
    }

    /// The spacing averaged over the estimator's window, px.
    fn truth_px(&self, window_px: f64) -> f64 {
        let view = self.config.design().exact_in_water(self.delta_v, 0.0);
        (view.paraxial_spacing() + view.excess(window_px * PIXEL_MM).unwrap()) / PIXEL_MM
    }
}

fn taken(config: &Config, camera: &CameraTruth, scene: &Scene, rays: u32, seed: u64) -> RawImage {
    let renderer = Renderer::new(RenderOptions { rays, seed });
    let irradiance = renderer.render_flawed(camera, scene, &configured::flaws(config, true, seed), None);
    expose(&irradiance, SIDE, SIDE, &configured::noise(&config.bench.simulation), seed)
}

#[test]
fn a_field_with_bubbles_is_measured_as_well_as_it_says() {
    let bubbles = [0, 20, 30];
    // By how much both readings are off, in their standard uncertainties, and the whole measurement in px.
    let mut off = [const { [Vec::new(), Vec::new(), Vec::new()] }; 3];
    // Between whole pixels, and near one.
    for (off_mm, seeds) in [(0.01, 1..=4), (-0.04, 5..=8)] {
        let field = Field::new(off_mm, 0.0, None, 4, 100);
        let options = LiveOptions::new(field.options.spacing.mla_pitch_px);
        let mut meter = LiveMeter::new(&field.white.grid, &field.white.vignetting, options).unwrap();
        for seed in seeds {
            for (bubbles, off) in bubbles.into_iter().zip(&mut off) {
                let raw = field.frame(bubbles, seed);
                let whole = measure_frame(&raw, Some(&field.white), &field.options).unwrap().spacing;
                meter.start_from(&whole);
                let live = meter.measure(&raw).unwrap();
                let error = whole.on_axis_px - field.truth_px(whole.window_px);
                let live = (live.on_axis_px - field.truth_px(live.window_px)) / live.sigma_px;
                for (off, by) in off.iter_mut().zip([error / whole.sigma_px, live, error]) {
                    off.push(by);
                }
            }
        }
    }
    for (bubbles, [whole, live, px]) in bubbles.into_iter().zip(off) {
        let rms = |off: &[f64]| (off.iter().map(|by| by * by).sum::<f64>() / off.len() as f64).sqrt();
        println!("{bubbles} bubbles: {:.2} σ, {:.4} px; live {:.2} σ", rms(&whole), rms(&px), rms(&live));
        for off in [whole, live] {
            assert!(rms(&off) <= 1.3 && off.iter().all(|by| by.abs() <= 3.0), "{bubbles} bubbles: {off:.2?}");
        }
        assert!(rms(&px) < 0.04, "{bubbles} bubbles: {px:.4?}");
    }
}

/// In an empty tank the board's image lies behind the array, also where the search for a picture leads from there.
#[test]
fn an_empty_tank_has_no_spacing_by_any_weights() {
    for off_mm in [0.0, 0.66] {
        let field = Field::new(off_mm, 30.0, Some(1.0), 16, 4);
        let found = measure_frame(&field.frame(0, 4), Some(&field.white), &field.options);
        let refused = found.map(|seen| seen.spacing).unwrap_err();
        println!("{off_mm}: {refused}");
        assert!(matches!(refused, MeasurementError::Spacing(SpacingError::OtherMode { .. })), "{off_mm}: {refused}");
    }
}
