//! The live measurement against the full one, on the referee's frames and on the simulated bench's own.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

use std::path::PathBuf;
use std::sync::Arc;

use plenalign::config::{Config, Texture};
use plenalign::imaging::combined::{Combined, Combining, Single};
use plenalign::imaging::grid::Grid;
use plenalign::imaging::live::{LiveError, LiveMeter, LiveOptions, LivePart, LiveSpacing};
use plenalign::imaging::measurement::{FrameOptions, WhiteModel, prepare_frame};
use plenalign::imaging::spacing::{Spacing, SpacingError, SpacingOptions, measure_spacing};
use plenalign::imaging::stillness::Stillness;
use plenalign::imaging::vignetting::Vignetting;
use plenalign::optics::ArrayKind;
use plenalign::raw::{self, CfaPattern, RawImage, Samples};
use plenalign::sim::exposure::{Bank, Noise, expose};
use plenalign::sim::renderer::{CameraTruth, Medium, RenderOptions, render};
use plenalign::sim::scene::{Board, Scene, texel_for};
use plenalign::sim::texture::TextureMap;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;

const PIXEL_MM: f64 = 0.00345;
const MLA_PITCH_PX: f64 = 0.1 / PIXEL_MM;

fn referee(name: &str) -> RawImage {
    raw::read(&PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/referee/{name}.png"))).unwrap()
}

/// A frame with its grid and vignetting, and what the full measurement says of it.
struct Known {
    raw: RawImage,
    grid: Grid,
    vignetting: Vignetting,
    full: Spacing,
}

fn known(raw: RawImage, white: &RawImage) -> Known {
    let white = WhiteModel::new(white).unwrap();
    let options = FrameOptions::new(MLA_PITCH_PX);
    let prepared = prepare_frame(&raw, Some(&white), &options).unwrap();
    // All frames here are near focus: a start spares the search.
    let start = SpacingOptions { start_px: Some(19.6), ..options.spacing };
    let full = measure_spacing(&[prepared.frame], &start).unwrap();
    Known { raw, grid: prepared.grid, vignetting: white.vignetting, full }
}

impl Known {
    /// A meter that starts half a pixel off and takes directions to be alike.
    fn meter(&self) -> LiveMeter {
        let options = LiveOptions {
            start_px: Some(self.full.on_axis_px + 0.5),
            directions_alike: true,
            ..LiveOptions::new(MLA_PITCH_PX)
        };
        LiveMeter::new(&self.grid, &self.vignetting, options).unwrap()
    }
}

fn check_agreement(name: &str, live: &LiveSpacing, full: &Spacing) {
    let difference = live.on_axis_px - full.on_axis_px;
    println!("{name}: {difference:+.5} px, {live:?}");
    assert!(difference.abs() < 0.001, "{name}: {difference:+.5} px from {full:?}");
    assert!(difference.abs() < full.sigma_px / 3.0, "{name}: {difference:+.5} px, sigma {:.5} px", full.sigma_px);
    assert!((live.tilt_x_px - full.tilt_x_px).abs() < 0.002 && (live.tilt_y_px - full.tilt_y_px).abs() < 0.002);
    assert!((live.curvature_px - full.curvature_px).abs() < 0.004);
    for (what, live, full) in
        [("sigma", live.sigma_px, full.sigma_px), ("random sigma", live.sigma_random_px, full.sigma_random_px)]
    {
        assert!((live / full - 1.0).abs() < 0.25, "{name}: {what} {live:.5} for {full:.5} px");
    }
    assert!((live.correlation - full.correlation).abs() < 0.02);
    assert!((live.window_px - full.window_px).abs() < 1e-4);
}

#[test]
fn referee_frames_measure_live_as_they_do_in_full() {
    for name in ["air_square", "air_charuco", "water_hexagonal", "water_clarity_e30"] {
        let known = known(referee(name), &referee(&format!("{name}_white")));
        let mut meter = known.meter();
        let first = meter.measure(&known.raw).unwrap();
        check_agreement(name, &first, &known.full);
        // From its own result the same frame takes one pass, and says the same.
        let mut parts = Vec::new();
        let again = meter.measure_by_parts(&known.raw, &mut |part| parts.push(part)).unwrap();
        assert_eq!(again.passes, 1);
        let [_, in_order @ ..] = LivePart::ALL;
        assert_eq!(parts, [&in_order[..], &[LivePart::Equations]].concat(), "{name}");
        assert!((again.on_axis_px - first.on_axis_px).abs() < 1e-4, "{name}: {first:?}, {again:?}");
    }
}

#[test]
fn a_mosaic_measures_live_as_it_does_in_full() {
    let read = |name: &str| {
        raw::read(&PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/second/{name}.png"))).unwrap()
    };
    let (raw, mosaic) = (read("bayer"), Some(CfaPattern::Rggb));
    let options = FrameOptions { mosaic, ..FrameOptions::new(MLA_PITCH_PX) };
    let white = WhiteModel::of(&read("bayer_white"), &options).unwrap();
    let full =
        measure_spacing(&[prepare_frame(&raw, Some(&white), &options).unwrap().frame], &options.spacing).unwrap();
    let options = LiveOptions { mosaic, ..LiveOptions::new(MLA_PITCH_PX) };
    let mut meter = LiveMeter::new(&white.grid, &white.vignetting, options).unwrap();
    // Found as if nothing were known, then followed.
    for live in [meter.acquire(&raw).unwrap(), meter.measure(&raw).unwrap()] {
        // The traced truth is 19.65 px.
        assert!((live.on_axis_px - 19.65).abs() < 3.0 * live.sigma_px, "{live:?}");
        assert!((live.on_axis_px - full.on_axis_px).abs() < full.sigma_px / 3.0, "{live:?}, {full:?}");
        assert!((live.sigma_px / full.sigma_px - 1.0).abs() < 0.25, "{live:?}, {full:?}");
    }
    // A meter that takes it for a monochrome frame says nothing of the kind.
    let mut grey = LiveMeter::new(&white.grid, &white.vignetting, LiveOptions { mosaic: None, ..options }).unwrap();
    assert!(grey.acquire(&raw).is_err());
}

/// Of such a field the model is widened between two steps.
#[test]
fn a_field_that_is_not_of_the_usual_shape_is_read_as_it_is_measured() {
    let read = |name: &str| {
        raw::read(&PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/second/{name}.png"))).unwrap()
    };
    // Its pixels are of 6.9 µm.
    let pitch_px = MLA_PITCH_PX / 2.0;
    let (raw, options) = (read("wide_2048"), FrameOptions::new(pitch_px));
    let white = WhiteModel::of(&read("wide_2048_white"), &options).unwrap();
    let full =
        measure_spacing(&[prepare_frame(&raw, Some(&white), &options).unwrap().frame], &options.spacing).unwrap();
    let mut meter = LiveMeter::new(&white.grid, &white.vignetting, LiveOptions::new(pitch_px)).unwrap();
    for live in [meter.acquire(&raw).unwrap(), meter.measure(&raw).unwrap()] {
        println!("{live:?} for {full:?}");
        assert!((live.on_axis_px - full.on_axis_px).abs() < live.sigma_px.hypot(full.sigma_px), "{live:?}, {full:?}");
    }
}

#[test]
fn free_directions_change_nothing_where_they_are_alike() {
    for name in ["air_charuco", "water_hexagonal"] {
        let known = known(referee(name), &referee(&format!("{name}_white")));
        let options = LiveOptions { start_px: Some(known.full.on_axis_px), ..LiveOptions::new(MLA_PITCH_PX) };
        let live = LiveMeter::new(&known.grid, &known.vignetting, options).unwrap().measure(&known.raw).unwrap();
        let difference = live.on_axis_px - known.full.on_axis_px;
        assert!(difference.abs() < 0.001, "{name}: {difference:+.5} px");
        for (k, term) in [live.row_column_px, live.diagonal_px].into_iter().enumerate() {
            let sigma = live.covariance[5 + k][5 + k].sqrt();
            assert!(term.abs() < 4.0 * sigma + 1e-9, "{name}: {term} ± {sigma}");
        }
        assert_eq!(live.diagonal_px == 0.0, known.grid.array == ArrayKind::Square);
    }
}

/// A small frame of the simulated bench in focus, its white frame, and the same exposed to 12 bits.
fn rendered(array: ArrayKind, noise: f64, seed: u64) -> (RawImage, RawImage, RawImage) {
    const SIDE: usize = 420;
    let mut config = Config::default();
    config.mla.array = array;
    let design = config.design();
    let (medium, distance) = (Medium::Air, design.joint(0.0).equivalent_distance);
    let delta_v = design.joint(0.0).delta_v + 0.01 * seed as f64;
    let mut camera = CameraTruth::from_design(&design, delta_v, medium, PIXEL_MM, SIDE, SIDE);
    camera.rotation = (1.3 - seed as f64).to_radians();
    camera.offset = [3.7, 1.9 - seed as f64];
    let rays = RenderOptions { rays: 16, seed };
    let map = Arc::new(TextureMap::generate(Texture::Natural, texel_for(&design, medium, distance, PIXEL_MM), seed));
    let scene = Scene::Board(Board::new(distance, map));
    let eight = Noise { read_noise_levels: noise, ..Noise::default() };
    let white = expose(&render(&camera, &Scene::Diffuser, rays), SIDE, SIDE, &eight, seed);
    let raw = expose(&render(&camera, &scene, rays), SIDE, SIDE, &eight, seed + 1);
    // The same frame in sixteenths of a grey level, as a 12-bit camera would give it.
    let deep = raw.to_view().into_iter().enumerate().map(|(k, v)| u16::from(v) * 16 + (k * 7 % 16) as u16);
    let deep = RawImage::from_u16(SIDE, SIDE, 12, deep.collect());
    (raw, white, deep)
}

#[test]
fn small_rendered_frames_measure_live_as_they_do_in_full() {
    for (array, noise, seed) in
        [(ArrayKind::Square, 2.0, 1), (ArrayKind::Hexagonal, 2.0, 2), (ArrayKind::Square, 0.0, 3)]
    {
        let (raw, white, deep) = rendered(array, noise, seed);
        let known = known(raw, &white);
        let name = format!("{array:?}, noise {noise}");
        check_agreement(&name, &known.meter().measure(&known.raw).unwrap(), &known.full);
        // Twelve bits are another sample type, not another result.
        assert!(matches!(deep.samples(), Samples::U16(_)));
        let live = known.meter().measure(&deep).unwrap();
        let difference = live.on_axis_px - known.full.on_axis_px;
        assert!(difference.abs() < 0.001, "{name}, 12 bits: {difference:+.5} px");
    }
}

/// Greatest distance between the micro-images of two grids, nearest to nearest, in the frame's middle and corners, px.
fn apart(a: &Grid, b: &Grid) -> f64 {
    let [w, h] = a.frame_size.map(|n| n as f64 - 1.0);
    [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h], [w / 2.0, h / 2.0]]
        .map(|[x, y]| {
            let from = a.nearest(x, y);
            let to = b.nearest(from.x, from.y);
            (to.x - from.x).hypot(to.y - from.y)
        })
        .into_iter()
        .fold(0.0, f64::max)
}

/// The grid moved by so many px, scaled and turned (radians) about its centre.
fn moved(grid: &Grid, shift: [f64; 2], scale: f64, turn: f64) -> Grid {
    let (sin, cos) = turn.sin_cos();
    let mut moved = grid.clone();
    moved.centre = [grid.centre[0] + shift[0], grid.centre[1] + shift[1]];
    moved.basis = grid.basis.map(|[x, y]| [scale * (cos * x - sin * y), scale * (sin * x + cos * y)]);
    moved
}

#[test]
fn a_moved_grid_is_followed() {
    let known = known(referee("water_clarity_e30"), &referee("water_clarity_e30_white"));
    let options = LiveOptions { start_px: Some(known.full.on_axis_px), ..LiveOptions::new(MLA_PITCH_PX) };
    for (shift, scale, turn) in [
        ([0.0, 0.0], 1.0, 0.0),
        ([1.6, 0.0], 1.0, 0.0),
        ([0.0, -2.5], 1.0, 0.0),
        ([0.0, 0.0], 1.005, 0.0),
        ([0.0, 0.0], 1.0, 0.004),
        ([-0.7, 1.2], 0.997, -0.003),
    ] {
        let grid = moved(&known.grid, shift, scale, turn);
        let mut meter = LiveMeter::new(&grid, &known.vignetting, options).unwrap();
        let live = meter.measure(&known.raw).unwrap();
        let (off, difference) = (apart(&known.grid, &meter.grid()), live.on_axis_px - known.full.on_axis_px);
        println!("{shift:?} {scale} {turn}: {off:.3} px off, spacing {difference:+.5} px, {:?}", live.grid);
        assert!(off < 0.1, "{shift:?} {scale} {turn}: {off:.3} px off");
        assert!(difference.abs() < 0.001, "{shift:?} {scale} {turn}: {difference:+.5} px");
        let greatest = apart(&grid, &known.grid);
        assert!((live.grid.greatest_px - greatest).abs() < 0.1 + 0.02 * greatest, "{:?} for {greatest:.2}", live.grid);
    }
    // Half a pitch could as well be half a pitch the other way.
    let half = known.grid.basis[0].map(|x| 0.5 * x);
    let refused = LiveMeter::new(&moved(&known.grid, half, 1.0, 0.0), &known.vignetting, options)
        .unwrap()
        .measure(&known.raw)
        .unwrap_err();
    let LiveError::GridMoved { shift_px, sigma_px, .. } = refused else { panic!("{refused}") };
    assert!((shift_px - 0.5 * known.grid.pitch_px()).abs() < 3.0 * sigma_px + 0.1, "{refused}");
}

#[test]
fn the_grid_is_followed_while_the_image_distance_changes() {
    const SIDE: usize = 900;
    /// An assembler moves by 0.5 mm/s while a camera takes 30 frames a second.
    const STEP_MM: f64 = 0.5 / 30.0;
    const FRAMES: u32 = 20;
    let design = Config::default().design();
    let joint = design.joint(0.0);
    let distance = joint.equivalent_distance;
    let texel = texel_for(&design, Medium::Air, distance, PIXEL_MM);
    let scene = Scene::Board(Board::new(distance, Arc::new(TextureMap::generate(Texture::Natural, texel, 7))));
    let taken = |scene: &Scene, delta_v: f64, seed: u64| {
        let mut camera = CameraTruth::from_design(&design, delta_v, Medium::Air, PIXEL_MM, SIDE, SIDE);
        camera.rotation = 0.7f64.to_radians();
        camera.offset = [3.7, 1.9];
        expose(&render(&camera, scene, RenderOptions { rays: 8, seed }), SIDE, SIDE, &Noise::default(), seed)
    };
    // The white frame is of another setting: the grid has moved from the first frame on.
    let white = WhiteModel::new(&taken(&Scene::Diffuser, joint.delta_v - 1.5, 1)).unwrap();
    let mut meter = LiveMeter::new(&white.grid, &white.vignetting, LiveOptions::new(MLA_PITCH_PX)).unwrap();
    for frame in 0..FRAMES {
        let delta_v = joint.delta_v + STEP_MM * (f64::from(frame) - 0.5 * f64::from(FRAMES));
        let raw = taken(&scene, delta_v, 2 + u64::from(frame));
        let live = if frame == 0 { meter.acquire(&raw) } else { meter.measure(&raw) }.unwrap();
        let options = FrameOptions::new(MLA_PITCH_PX);
        let prepared = prepare_frame(&raw, Some(&white), &options).unwrap();
        let off = apart(&prepared.grid, &meter.grid());
        let start = SpacingOptions { start_px: Some(live.on_axis_px), ..options.spacing };
        let full = measure_spacing(&[prepared.frame], &start).unwrap();
        let sigmas = (live.on_axis_px - full.on_axis_px) / live.sigma_px;
        println!(
            "{frame}: {:.4} px, {sigmas:+.2} sigmas of {:.4} px, {off:.3} px off, {:?}",
            live.on_axis_px, live.sigma_px, live.grid
        );
        assert!(off < 0.1, "frame {frame}: {off:.3} px off");
        assert!(sigmas.abs() < 3.0, "frame {frame}: {sigmas:+.2} sigmas, {live:?}");
    }
}

/// Offsets of a sensor's pixels, as a share of white: the same in every frame.
fn fixed_pattern(pixels: usize, sigma: f32, seed: u64) -> Vec<f32> {
    let mut random = Pcg64::seed_from_u64(seed);
    (0..pixels).map(|_| sigma * random.sample::<f32, _>(StandardNormal)).collect()
}

/// The light of a square frame of a board near focus in air, and its frame without noise.
fn near_focus(side: usize, seed: u64) -> (Vec<f32>, Known) {
    let design = Config::default().design();
    let joint = design.joint(0.0);
    let distance = joint.equivalent_distance;
    let camera = CameraTruth::from_design(&design, joint.delta_v + 0.02, Medium::Air, PIXEL_MM, side, side);
    let rays = RenderOptions { rays: 16, seed };
    let texel = texel_for(&design, Medium::Air, distance, PIXEL_MM);
    let scene = Scene::Board(Board::new(distance, Arc::new(TextureMap::generate(Texture::Natural, texel, seed))));
    let [diffuse, light] = [&Scene::Diffuser, &scene].map(|scene| render(&camera, scene, rays));
    let quiet = Noise { read_noise_levels: 0.0, ..Noise::default() };
    let known = known(expose(&light, side, side, &quiet, 1), &expose(&diffuse, side, side, &quiet, 1));
    (light, known)
}

#[test]
fn frames_of_a_sensor_with_a_fixed_pattern_are_combined_to_what_it_leaves() {
    const SIDE: usize = 420;
    const FRAMES: u64 = 20;
    let (light, truth) = near_focus(SIDE, 8);
    let noisy = Noise { read_noise_levels: 2.0, ..Noise::default() };
    let truth_px = truth.meter().measure(&truth.raw).unwrap().on_axis_px;
    // What all frames share of the model's part is in the truth as well.
    let single = |live: &LiveSpacing, k: u64| Single { sigma_model: 0.0, ..live.single(k as f64 / 30.0) };
    for (levels, sensors, least_ratio) in [(0.0, 3, 0.0), (2.0, 12, 0.4)] {
        let (mut within, mut squares, mut averaged, mut ratios) = (0, 0.0, 0.0, 0.0);
        for sensor in 0..sensors {
            let pattern = fixed_pattern(SIDE * SIDE, levels / 220.0, sensor);
            let seen: Vec<f32> = light.iter().zip(&pattern).map(|(light, offset)| light + offset).collect();
            let (mut meter, mut combining) = (truth.meter(), Combining::over(5.0));
            let mut stillness = Stillness::default();
            let combined: Vec<Combined> = (0..FRAMES)
                .map(|k| {
                    let raw = expose(&seen, SIDE, SIDE, &noisy, 1000 * sensor + k);
                    assert!(!stillness.has_moved(&raw), "frame {k}");
                    combining.take(single(&meter.measure(&raw).unwrap(), k))
                })
                .collect();
            let [first, .., last] = combined[..] else { panic!("no frames") };
            assert_eq!((first.frames, last.frames), (1, FRAMES as u32));
            let off = last.value - truth_px;
            println!("sensor {sensor}: {off:+.5} px ± {:.5}, one frame's ± {:.5}", last.sigma, first.sigma);
            within += u64::from(off.abs() <= 2.0 * last.sigma);
            squares += (off / last.sigma).powi(2) / sensors as f64;
            averaged += off.powi(2) / (first.sigma.powi(2) / FRAMES as f64) / sensors as f64;
            ratios += last.sigma / first.sigma / sensors as f64;
        }
        println!("{levels} levels: {squares:.2} σ², {averaged:.2} if all were averaged away, σ × {ratios:.2}");
        assert!(within >= sensors - 2 && squares < 1.6, "{within} of {sensors} within 2 σ, {squares} σ²");
        assert!((least_ratio..0.75).contains(&ratios), "σ × {ratios}");
        // Averaged away with the noise, a pattern would leave far more than was promised.
        assert!(levels == 0.0 || averaged > 2.0, "{averaged}");
    }
}

/// Mean and standard deviation of a sample.
fn statistics(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    (mean, (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt())
}

#[test]
fn spacings_in_noise_from_a_bank_scatter_as_in_noise_drawn_anew() {
    const SIDE: usize = 300;
    const FRAMES: usize = 500;
    let (light, known) = near_focus(SIDE, 9);
    // Photon noise as well, of few enough electrons for it to be half of all.
    let noise = Noise { electrons_per_level: 25.0, ..Noise::default() };
    let bank = Bank::new(1);
    let spacings = |exposed: &dyn Fn(u64) -> RawImage| -> Vec<f64> {
        let mut meter = known.meter();
        (0..FRAMES as u64).map(|seed| meter.measure(&exposed(seed)).unwrap().on_axis_px).collect()
    };
    let (mean, sigma) = statistics(&spacings(&|seed| bank.expose(&light, SIDE, SIDE, &noise, seed)));
    let (drawn_mean, drawn_sigma) = statistics(&spacings(&|seed| expose(&light, SIDE, SIDE, &noise, seed)));
    let error = sigma.hypot(drawn_sigma) / (FRAMES as f64).sqrt();
    println!("{mean:.5} ± {sigma:.5} px, {drawn_mean:.5} ± {drawn_sigma:.5} px drawn anew, means to {error:.5} px");
    assert!((mean - drawn_mean).abs() < 3.0 * error, "{mean} px for {drawn_mean} ± {error}");
    // The standard error of a standard deviation's logarithm is 1/√(2 (n − 1)).
    let ratio_log = (sigma / drawn_sigma).ln();
    assert!(ratio_log.abs() < 3.0 / ((FRAMES - 1) as f64).sqrt(), "σ {sigma} px for {drawn_sigma}");
}

#[test]
fn frames_without_an_answer_are_refused() {
    let (raw, white, _) = rendered(ArrayKind::Square, 2.0, 4);
    let size = [raw.width(), raw.height()];
    let known = known(raw, &white);
    let mut meter = known.meter();
    meter.measure(&known.raw).unwrap();
    // A white frame has micro-images but nothing on them.
    let blank = meter.measure(&white).unwrap_err();
    assert!(matches!(&blank, LiveError::Spacing(SpacingError::NoTexture { .. }) | LiveError::Lost { .. }), "{blank}");
    let scaled = |factor: f64| {
        let values = known.raw.to_view().iter().map(|&v| (f64::from(v) * factor).min(255.0) as u8).collect();
        RawImage::from_u8(size[0], size[1], values)
    };
    let burnt = meter.measure(&scaled(8.0)).unwrap_err();
    assert!(matches!(burnt, LiveError::Spacing(SpacingError::Saturated { .. })), "{burnt}");
    let dark = meter.measure(&scaled(0.01)).unwrap_err();
    assert!(matches!(dark, LiveError::Spacing(SpacingError::Dark { .. })), "{dark}");
    let cropped = RawImage::from_u8(size[0], 300, known.raw.to_view()[..size[0] * 300].to_vec());
    let refused = meter.measure(&cropped).unwrap_err();
    assert!(matches!(refused, LiveError::Spacing(SpacingError::WrongSize { .. })), "{refused}");
}

#[test]
fn a_lost_spacing_is_acquired_anew() {
    let (raw, white, _) = rendered(ArrayKind::Square, 2.0, 5);
    let known = known(raw, &white);
    let mut meter = LiveMeter::new(&known.grid, &known.vignetting, LiveOptions::new(MLA_PITCH_PX)).unwrap();
    assert_eq!(meter.measure(&known.raw).unwrap_err(), LiveError::NoStart);
    // A start five pixels off matches nowhere near.
    meter.start_from(&Spacing { on_axis_px: known.full.on_axis_px - 5.0, ..known.full.clone() });
    let lost = meter.measure(&known.raw).unwrap_err();
    assert!(matches!(lost, LiveError::Lost { .. }), "{lost}");
    // Nothing is left to start from, until it is acquired.
    assert_eq!(meter.measure(&known.raw).unwrap_err(), LiveError::NoStart);
    let acquired = meter.acquire(&known.raw).unwrap();
    assert!((acquired.on_axis_px - known.full.on_axis_px).abs() < 0.002, "{acquired:?}");
    assert!(meter.measure(&known.raw).is_ok());
}

/// Of a large frame the middle is looked at first, by the field of the whole; what stands beside it is found all the same.
#[test]
fn a_large_frame_is_acquired_by_its_middle_or_else_by_all_of_it() {
    let (design, pixel_mm, [width, height]) = (Config::default().design(), 0.1 / 12.0, [960, 880]);
    let (solution, pitch_px) = (design.joint(0.0), 12.0);
    let mut camera = CameraTruth::from_design(&design, solution.delta_v, Medium::Air, pixel_mm, width, height);
    camera.lens_tilt = [0.02, -0.01];
    let distance = solution.equivalent_distance;
    let texel = texel_for(&design, Medium::Air, distance, pixel_mm);
    let map = Arc::new(TextureMap::generate(Texture::Natural, texel, 3));
    let taken = |scene: &Scene, seed: u64| {
        expose(&render(&camera, scene, RenderOptions { rays: 4, seed }), width, height, &Noise::default(), seed)
    };
    let (raw, white) = (taken(&Scene::Board(Board::new(distance, map)), 2), taken(&Scene::Diffuser, 1));
    let model = WhiteModel::new(&white).unwrap();
    let prepared = prepare_frame(&raw, Some(&model), &FrameOptions::new(pitch_px)).unwrap();
    let wanted = measure_spacing(&[prepared.frame], &SpacingOptions::new(pitch_px)).unwrap();
    assert!(wanted.tilt_x_px.hypot(wanted.tilt_y_px) > 0.1, "there is no field to be told: {wanted:?}");
    let meter = |options: LiveOptions| LiveMeter::new(&model.grid, &model.vignetting, options).unwrap();
    let agrees = |live: &LiveSpacing, what: &str| {
        let difference = live.on_axis_px - wanted.on_axis_px;
        println!("{what}: {difference:+.4} px, {live:?}");
        assert!(difference.abs() < 3.0 * live.sigma_px.hypot(wanted.sigma_px), "{what}: {live:?} for {wanted:?}");
    };
    let options = LiveOptions::new(pitch_px);
    agrees(&meter(options).acquire(&raw).unwrap(), "by its middle");
    let held = [wanted.tilt_x_px, wanted.tilt_y_px, wanted.curvature_px];
    agrees(&meter(LiveOptions { field_held: Some(held), ..options }).acquire(&raw).unwrap(), "by a known field");
    // The board has a bare patch that fills the middle.
    let bare = |k: usize| (150..810).contains(&(k % width)) && (110..770).contains(&(k / width));
    let (Samples::U8(textured), Samples::U8(plain)) = (raw.samples(), white.samples()) else { panic!("8 bits") };
    let patched = (0..width * height).map(|k| if bare(k) { plain[k] } else { textured[k] }).collect();
    let patched = RawImage::from_u8(width, height, patched);
    agrees(&meter(options).acquire(&patched).unwrap(), "beside its middle");
}

/// Far from focus micro-images share little, and noise makes the iteration's steps go to and fro.
#[test]
fn a_spacing_far_from_focus_is_read_from_noisy_frames_of_few_micro_images() {
    const SIDE: usize = 320;
    const FRAMES: u64 = 40;
    let design = Config::default().design();
    let medium = Medium::Water { shell: design.shell, e: 30.0, decentre: [0.0; 2] };
    let camera = CameraTruth::from_design(&design, design.joint(0.0).delta_v, medium, PIXEL_MM, SIDE, SIDE);
    let texel = texel_for(&design, medium, 800.0, PIXEL_MM);
    let scene = Scene::Board(Board::new(800.0, Arc::new(TextureMap::generate(Texture::Natural, texel, 5))));
    let [diffuse, light] =
        [&Scene::Diffuser, &scene].map(|scene| render(&camera, scene, RenderOptions { rays: 16, seed: 5 }));
    let exposed = |light: &[f32], read_noise_levels: f64, seed: u64| {
        expose(light, SIDE, SIDE, &Noise { read_noise_levels, ..Noise::default() }, seed)
    };
    let options = FrameOptions::new(MLA_PITCH_PX);
    let white = WhiteModel::of(&exposed(&diffuse, 2.0, 1), &options).unwrap();
    let meter = || LiveMeter::new(&white.grid, &white.vignetting, LiveOptions::new(MLA_PITCH_PX)).unwrap();
    let truth_px = meter().acquire(&exposed(&light, 0.0, 1)).unwrap().on_axis_px;
    let (mut followed, mut within) = (meter(), 0);
    for seed in 1..=FRAMES {
        let raw = exposed(&light, 6.0, seed);
        let read = if seed == 1 { followed.acquire(&raw) } else { followed.measure(&raw) }.unwrap();
        within += u64::from((read.on_axis_px - truth_px).abs() < 2.0 * read.sigma_px);
        // Of a whole measurement the same is asked.
        if seed % 5 == 0 {
            let frame = prepare_frame(&raw, Some(&white), &options).unwrap().frame;
            let full = measure_spacing(&[frame], &options.spacing).unwrap();
            assert!((full.on_axis_px - read.on_axis_px).abs() < full.sigma_px, "{full:?}, {read:?}");
        }
    }
    assert!(10 * within >= 9 * FRAMES, "{within} of {FRAMES} within 2σ");
}

#[test]
fn impossible_options_are_refused() {
    let grid = Grid::affine(ArrayKind::Square, [209.3, 210.1], [[29.4, 0.1], [-0.1, 29.4]], [420, 420]);
    let (_, white, _) = rendered(ArrayKind::Square, 2.0, 6);
    let vignetting = Vignetting::from_white(&white, &grid).unwrap();
    for options in [LiveOptions::new(f64::NAN), LiveOptions { start_px: Some(-1.0), ..LiveOptions::new(MLA_PITCH_PX) }]
    {
        let refused = LiveMeter::new(&grid, &vignetting, options).unwrap_err();
        assert!(matches!(refused, SpacingError::Impossible { .. }), "{refused}");
    }
    let few = Grid { frame_size: [100, 100], ..grid };
    let refused = LiveMeter::new(&few, &vignetting, LiveOptions::new(MLA_PITCH_PX)).unwrap_err();
    assert!(matches!(refused, SpacingError::TooFewMicroImages { .. }), "{refused}");
}
