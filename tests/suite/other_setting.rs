//! What is read with a white frame of another setting, as it is while the focus axis goes through its travel and the aperture
//! stays: the profile that it left is not the frame's.

use std::sync::Arc;

use plenalign::config::{Config, Texture};
use plenalign::imaging::live::{LiveError, LiveMeter, LiveOptions};
use plenalign::imaging::measurement::{FrameOptions, MeasurementError, WhiteModel, expected_grid, measure_frame};
use plenalign::imaging::spacing::{Spacing, SpacingError};
use plenalign::imaging::vignetting::VignettingError;
use plenalign::optics::{CameraDesign, MlaMode};
use plenalign::raw::RawImage;
use plenalign::sim::exposure::{Noise, expose};
use plenalign::sim::renderer::{CameraTruth, Medium, RenderOptions, render};
use plenalign::sim::scene::{Board, Scene, texel_for};
use plenalign::sim::texture::TextureMap;

const PIXEL_MM: f64 = 0.00345;

/// The reference camera as the bench is found: its aperture is that of Δv = 0.
struct Camera {
    design: CameraDesign,
    /// e behind the shell, mm; `None` in air.
    e: Option<f64>,
    seed: u64,
    size: usize,
    /// The aperture, in those of Δv = 0.
    opened: f64,
    /// To how many pixels either side of its place the light that falls on the sensor is spread, each way.
    spread_px: usize,
}

impl Camera {
    fn new(e: Option<f64>, seed: u64, size: usize) -> Self {
        Self { design: Config::default().design(), e, seed, size, opened: 1.0, spread_px: 0 }
    }

    fn options(&self) -> FrameOptions {
        FrameOptions::of_design(&self.design, PIXEL_MM)
    }

    fn taken(&self, delta_v: f64, scene: &Scene, seed: u64) -> RawImage {
        let medium = self.e.map_or(Medium::Air, |e| Medium::Water { shell: self.design.shell, e, decentre: [0.0; 2] });
        let medium = if matches!(scene, Scene::Diffuser) { Medium::Air } else { medium };
        let mut camera = CameraTruth::from_design(&self.design, delta_v, medium, PIXEL_MM, self.size, self.size);
        camera.aperture = self.opened * self.design.aperture(0.0);
        camera.rotation = (0.37 * self.seed as f64).sin() * 0.017;
        camera.offset = [1.7, 2.9].map(|turns| (turns * self.seed as f64).sin() * 14.0);
        let rays = RenderOptions { rays: 16, seed: self.seed };
        let light =
            spread(&spread(&render(&camera, scene, rays), self.size, self.spread_px), self.size, self.spread_px);
        expose(&light, self.size, self.size, &Noise::default(), seed)
    }

    /// What a white frame at a Δv (mm) teaches.
    fn white(&self, delta_v: f64) -> WhiteModel {
        WhiteModel::of(&self.taken(delta_v, &Scene::Diffuser, 3), &self.options()).unwrap()
    }

    /// A flat board at a Δv (mm), and the spacing that it has, px.
    fn board(&self, delta_v: f64) -> (RawImage, f64) {
        let joint = self.design.joint(0.0);
        let (distance, equivalent, medium) = match self.e {
            Some(e) => {
                let medium = Medium::Water { shell: self.design.shell, e: joint.e, decentre: [0.0; 2] };
                (
                    self.design.object_distance,
                    self.design.shell.equivalent_distance(self.design.object_distance, e),
                    medium,
                )
            }
            None => (joint.equivalent_distance, joint.equivalent_distance, Medium::Air),
        };
        let map =
            TextureMap::generate(Texture::Natural, texel_for(&self.design, medium, distance, PIXEL_MM), self.seed);
        let raw = self.taken(delta_v, &Scene::Board(Board::new(distance, Arc::new(map))), 2 * self.seed + 1000);
        (raw, self.design.spacing_at(equivalent, delta_v) / PIXEL_MM)
    }

    fn measured(&self, raw: &RawImage, white: &WhiteModel) -> Result<Spacing, MeasurementError> {
        measure_frame(raw, Some(white), &self.options()).map(|seen| seen.spacing)
    }
}

/// Light with each row's spread evenly to so many pixels either side, and columns made rows.
fn spread(light: &[f32], size: usize, by: usize) -> Vec<f32> {
    let at = |x: usize, y: usize| {
        let near = &light[y * size..][x.saturating_sub(by)..(x + by + 1).min(size)];
        near.iter().sum::<f32>() / near.len() as f32
    };
    (0..size * size).map(|k| at(k / size, k % size)).collect()
}

/// What is spread within its micro-image, after the microlens has cut it out, moves outwards there: by hundredths of a pixel where
/// that is told, by tenths beyond.
#[test]
fn a_picture_that_is_blurred_as_a_whole_is_not_measured() {
    let sharp = Camera::new(None, 1, 560);
    let white = sharp.white(1.5);
    let (options, grid) = (LiveOptions::new(0.1 / PIXEL_MM), &white.grid);
    for (spread_px, told) in [(0, false), (1, false), (2, false), (4, true), (6, true)] {
        let (raw, truly) = Camera { spread_px, ..Camera::new(None, 1, 560) }.board(1.5);
        let found = sharp.measured(&raw, &white);
        let live = LiveMeter::new(grid, &white.vignetting, options).unwrap().acquire(&raw);
        println!("spread by {spread_px} px: {:?}", found.as_ref().map(|seen| [seen.on_axis_px - truly, seen.sigma_px]));
        if told {
            let why = found.unwrap_err();
            assert!(
                matches!(why, MeasurementError::Vignetting(VignettingError::Blurred { .. })),
                "{spread_px} px: {why}"
            );
            assert!(
                matches!(live, Err(LiveError::Vignetting(VignettingError::Blurred { .. }))),
                "{spread_px} px: {live:?}"
            );
        } else {
            let spacing = found.unwrap();
            let error = spacing.on_axis_px - truly;
            assert!(error.abs() < 3.0 * spacing.sigma_px, "{spread_px} px: {error:+.4} px, {spacing:?}");
            live.unwrap();
        }
    }
}

/// An aperture fills the gaps and widens the micro-images at once, and so does Δv.
#[test]
fn another_aperture_is_not_taken_for_blur() {
    let opened = |opened: f64| Camera { opened, ..Camera::new(None, 1, 400) };
    for (was, is) in [(0.8, 1.0), (0.8, 1.4), (1.0, 0.8), (1.0, 1.2), (1.0, 1.4), (1.4, 0.8), (1.4, 1.0)] {
        let white = opened(was).white(0.0);
        for delta_v in [0.0, 2.2] {
            let (raw, _) = opened(is).board(delta_v);
            let grid = expected_grid(&raw, &opened(is).options()).unwrap();
            let fit = white.vignetting.fit(&raw, &grid).unwrap();
            assert!(fit.blurred.is_none(), "{was} to {is} at {delta_v} mm: {fit:?}");
        }
    }
}

/// From where neighbours share nothing to where the image lies on the other side of the array.
#[test]
fn nothing_is_read_beyond_the_range_of_focus() {
    for seed in [1, 2] {
        let camera = Camera::new(None, seed, 560);
        let white = camera.white(1.5);
        for delta_v in [3.3, 4.3, 4.9] {
            let (raw, truly) = camera.board(delta_v);
            let why = camera.measured(&raw, &white).unwrap_err();
            println!("{truly:.1} px at Δv = {delta_v} mm: {why}");
            // The white frame is to blame as long as it does not fit.
            assert!(matches!(why, MeasurementError::WhiteMisfit(_)), "{truly:.1} px at {delta_v} mm: {why}");
        }
    }
    // With a white frame that fits, too: a fit that begins within the range ends beyond it.
    let camera = Camera::new(None, 2, 560);
    let (raw, truly) = camera.board(2.85);
    let why = camera.measured(&raw, &camera.white(2.85)).unwrap_err();
    let beyond = matches!(why, MeasurementError::Spacing(SpacingError::BeyondRange { above: false, .. }));
    assert!(beyond, "{truly:.1} px: {why}");
}

#[test]
fn a_spacing_is_as_sure_as_it_says() {
    for seed in [1, 2] {
        let camera = Camera::new(None, seed, 560);
        let white = camera.white(1.5);
        for delta_v in [2.5, 2.6, 2.7] {
            let (raw, truly) = camera.board(delta_v);
            let spacing = camera.measured(&raw, &white).unwrap();
            let error = spacing.on_axis_px - truly;
            println!("{truly:.3} px at Δv = {delta_v} mm: off by {error:+.4} ± {:.4} px", spacing.sigma_px);
            assert!(error.abs() < 4.0 * spacing.sigma_px && spacing.sigma_px < 0.15, "{truly:.3} px: {spacing:?}");
        }
    }
}

/// In whole and live: where there is less texture, less of it stands beside what the profile leaves, and that is no second board.
#[test]
fn one_board_through_the_shell_is_one() {
    for seed in [2, 3] {
        let camera = Camera::new(Some(30.0), seed, 800);
        let white = camera.white(0.0);
        let (raw, truly) = camera.board(2.25);
        let whole = camera.measured(&raw, &white).unwrap();
        let error = whole.on_axis_px - truly;
        println!("{truly:.3} px: off by {error:+.4} ± {:.4} px", whole.sigma_px);
        assert_eq!(whole.two_boards, None, "{whole:?}");
        assert!(error.abs() < 4.0 * whole.sigma_px, "{truly:.3} px: {whole:?}");
        let options = LiveOptions { mode: Some(MlaMode::Galilean), ..LiveOptions::new(0.1 / PIXEL_MM) };
        let mut meter = LiveMeter::new(&white.grid, &white.vignetting, options).unwrap();
        // Found, then followed.
        for live in [meter.acquire(&raw).unwrap(), meter.measure(&raw).unwrap()] {
            let apart = live.on_axis_px - whole.on_axis_px;
            assert!(live.unevenness < 0.5 && apart.abs() < whole.sigma_px, "{apart:+.4} px: {live:?}");
        }
    }
}

/// At rest after each of many steps of Δv, with the spacing followed: as whole measurements of the frames have it.
#[test]
fn the_meter_reads_as_a_whole_measurement_does_all_along_the_travel() {
    let camera = Camera::new(None, 2, 400);
    let white = camera.white(1.2);
    let options = LiveOptions { mode: Some(MlaMode::Galilean), ..LiveOptions::new(0.1 / PIXEL_MM) };
    let mut meter = LiveMeter::new(&white.grid, &white.vignetting, options).unwrap();
    meter.acquire(&camera.board(1.2).0).unwrap();
    for step in 1..=14 {
        let delta_v = 1.2 + 0.1 * f64::from(step);
        let (raw, truly) = camera.board(delta_v);
        // What the newest frame's grid shows is there before the one that is to be read.
        meter.measure(&raw).unwrap();
        meter.keep_profile(&raw);
        let live = meter.measure(&raw).unwrap();
        let whole = camera.measured(&raw, &white).unwrap();
        let apart = live.on_axis_px - whole.on_axis_px;
        println!("{truly:.3} px: {apart:+.4} px from {:.4} ± {:.4} px", whole.on_axis_px, whole.sigma_px);
        assert!(apart.abs() < 3.0 * whole.sigma_px, "{truly:.3} px: {live:?}, in whole {whole:?}");
        assert!((live.on_axis_px - truly).abs() < 4.0 * live.sigma_px, "{truly:.3} px: {live:?}");
    }
}
