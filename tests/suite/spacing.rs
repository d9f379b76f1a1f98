//! The spacing estimator against frames of exact-ray renderers: the referee's and the simulated bench's own.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

use std::path::PathBuf;
use std::sync::Arc;

use plenalign::config::{Config, Texture};
use plenalign::imaging::grid::GridError;
use plenalign::imaging::measurement::{
    FrameMeasurement, FrameOptions, MeasurementError, WhiteModel, measure_frame, measure_frames,
};
use plenalign::imaging::spacing::SpacingError;
use plenalign::optics::MlaMode;
use plenalign::raw::{self, RawImage};
use plenalign::sim::exposure::{Noise, expose};
use plenalign::sim::renderer::{CameraTruth, Medium, RenderOptions, render};
use plenalign::sim::scene::{Board, Scene, texel_for};
use plenalign::sim::texture::TextureMap;
use serde_json::Value;

use super::rendered::{Rendered, centres_rms};

const PIXEL_MM: f64 = 0.00345;

fn referee(name: &str) -> RawImage {
    raw::read(&PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/referee/{name}.png"))).unwrap()
}

fn truth(name: &str) -> Value {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/data/referee/truth.json");
    let all: Value = serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
    all["frames"][name].clone()
}

fn options() -> FrameOptions {
    FrameOptions::new(0.1 / PIXEL_MM)
}

fn check_referee(name: &str, with_white: bool, bound: f64) {
    let white = with_white.then(|| WhiteModel::new(&referee(&format!("{name}_white"))).unwrap());
    let measured = measure_frame(&referee(name), white.as_ref(), &options()).unwrap();
    let error = measured.spacing.on_axis_px - truth(name)["spacing_on_axis_px"].as_f64().unwrap();
    assert!(error.abs() < bound, "{name}: off by {error:+.4} px, {:?}", measured.spacing);
    let sigma = measured.spacing.sigma_px;
    assert!(sigma > 1e-4 && sigma < 0.01, "{name}: {:?}", measured.spacing);
    assert!(measured.spacing.sigma_random_px <= sigma);
}

#[test]
fn referee_frames_in_air_measure_to_a_hundredth_of_a_pixel() {
    for name in ["air_square", "air_charuco"] {
        check_referee(name, true, 0.01);
    }
}

#[test]
fn referee_frames_in_water_measure_to_the_window_of_the_exact_spacing() {
    // Averaged over the masks the exact spacing exceeds the paraxial one by about 0.02 px at e = 3.
    check_referee("water_clarity_e30", true, 0.02);
    check_referee("water_hexagonal", true, 0.03);
}

#[test]
fn referee_frames_measure_without_a_white_frame() {
    check_referee("air_square", false, 0.02);
    check_referee("water_clarity_e30", false, 0.02);
}

/// Behind a short lens the aperture's picture is not much larger than a microlens, and with a small N masks lie where it
/// has begun to cut off: nowhere is its edge straight.
#[test]
fn large_microlenses_close_behind_a_short_lens_are_measured_as_well() {
    let (pixel_mm, size) = (0.0045, 600);
    for mode in [MlaMode::Galilean, MlaMode::Keplerian] {
        let mut config = Config::default();
        config.main_lens.focal_length_mm = 12.6;
        config.mla.mode = mode;
        config.mla.pitch_mm = 0.255;
        config.mla.angular_resolution = 2.25;
        let b = 5.13 * config.mla.pitch_mm;
        config.mla.focal_length_mm = match mode {
            MlaMode::Galilean => b / (1.0 - 1.0 / 2.25),
            MlaMode::Keplerian => b / (1.0 + 1.0 / 2.25),
        };
        config.object.air_distance_mm = 1000.0;
        let design = config.design();
        for distance in [1000.0, 700.0] {
            let camera = CameraTruth::from_design(&design, 0.0, Medium::Air, pixel_mm, size, size);
            let rays = RenderOptions { rays: 32, seed: 2 };
            let noise = Noise { read_noise_levels: 2.0, ..Noise::default() };
            let texel = texel_for(&design, Medium::Air, distance, pixel_mm);
            let map = Arc::new(TextureMap::generate(Texture::Natural, texel, 9));
            let white = expose(&render(&camera, &Scene::Diffuser, rays), size, size, &noise, 3);
            let raw = expose(&render(&camera, &Scene::Board(Board::new(distance, map)), rays), size, size, &noise, 4);
            let options = FrameOptions::of_design(&design, pixel_mm);
            let white = WhiteModel::of(&white, &options).unwrap();
            let seen = measure_frame(&raw, Some(&white), &options).unwrap().spacing;
            let error = seen.on_axis_px - design.spacing_at(distance, 0.0) / pixel_mm;
            assert!(
                error.abs() < 3.0 * seen.sigma_px && seen.sigma_px < 0.03,
                "{mode:?} at {distance}: {error:+.4} {seen:?}"
            );
        }
    }
}

/// A frame of the reference camera, and its white frame at another Δv.
fn rendered(delta_v: f64, e: Option<f64>, texture: Texture, size: usize, noise: f64) -> (RawImage, RawImage, f64) {
    let design = Config::default().design();
    let (medium, distance) = match e {
        Some(e) => (Medium::Water { shell: design.shell, e, decentre: [0.0; 2] }, 800.0),
        None => (Medium::Air, 167.174_586),
    };
    let mut camera = CameraTruth::from_design(&design, delta_v, medium, PIXEL_MM, size, size);
    camera.rotation = (-0.7f64).to_radians();
    camera.offset = [4.1, -8.3];
    let rays = RenderOptions { rays: 16, seed: 2 };
    let noise = Noise { read_noise_levels: noise, ..Noise::default() };
    let map = Arc::new(TextureMap::generate(texture, texel_for(&design, medium, distance, PIXEL_MM), 9));
    let white = expose(&render(&camera, &Scene::Diffuser, rays), size, size, &noise, 3);
    let raw = expose(&render(&camera, &Scene::Board(Board::new(distance, map)), rays), size, size, &noise, 4);
    let equivalent = e.map_or(distance, |e| design.shell.equivalent_distance(distance, e));
    (raw, white, design.spacing_at(equivalent, delta_v) / PIXEL_MM)
}

fn measured(raw: &RawImage, white: &RawImage) -> Result<FrameMeasurement, MeasurementError> {
    measure_frame(raw, Some(&WhiteModel::new(white).unwrap()), &options())
}

#[test]
fn the_search_captures_blurred_frames_where_the_loops_start() {
    // The air step's start (25.97 px, blurred by 6 px) and the shell step's (12.68 px, blurred by 7 px).
    for (delta_v, e, bound) in [(0.0, None, 0.05), (2.205, Some(30.0), 0.2)] {
        for texture in [Texture::Charuco, Texture::Natural] {
            let (raw, white, expected) = rendered(delta_v, e, texture, 600, 2.0);
            let error = measured(&raw, &white).unwrap().spacing.on_axis_px - expected;
            assert!(error.abs() < bound, "{texture:?} at Δv = {delta_v}: off by {error:+.4} of {expected:.3} px");
        }
    }
}

#[test]
fn small_and_noisy_frames_in_focus_measure() {
    for noise in [2.0, 8.0] {
        let (raw, white, expected) = rendered(2.205, None, Texture::Natural, 400, noise);
        let spacing = measured(&raw, &white).unwrap().spacing;
        let error = spacing.on_axis_px - expected;
        assert!(error.abs() < 0.02, "noise {noise}: off by {error:+.4} px, {spacing:?}");
    }
}

#[test]
fn distortion_bends_the_field_and_not_the_axis() {
    let design = Config::default().design();
    let (size, distance, delta_v) = (600, 167.174_586, 2.19);
    let mut camera = CameraTruth::from_design(&design, delta_v, Medium::Air, PIXEL_MM, size, size);
    (camera.distortion_k1, camera.rotation, camera.offset) = (-0.6, 0.3f64.to_radians(), [2.2, 7.9]);
    let rays = RenderOptions { rays: 16, seed: 5 };
    let map = Arc::new(TextureMap::generate(Texture::Guppy, texel_for(&design, Medium::Air, distance, PIXEL_MM), 6));
    let white = expose(&render(&camera, &Scene::Diffuser, rays), size, size, &Noise::default(), 7);
    let raw =
        expose(&render(&camera, &Scene::Board(Board::new(distance, map)), rays), size, size, &Noise::default(), 8);
    let found = measured(&raw, &white).unwrap().spacing;
    let truth = design.exact_in_air(delta_v, distance).paraxial_spacing() / PIXEL_MM;
    assert!((found.on_axis_px - truth).abs() < 2.5 * found.sigma_px.max(0.002), "{truth}: {found:?}");
    // By the lens's local scale along and across the radius (1 + 3 k₁ t² and 1 + k₁ t²) the spacing changes by −0.191 and
    // −0.063 px at 1.9 mm for k₁ = −0.3.
    let scale = 2.0 * (size as f64 * PIXEL_MM / 2.0 / 1.9).powi(2);
    assert!((found.curvature_px - scale * -0.127).abs() < 0.012, "{} for {found:?}", scale * -0.127);
    assert!((found.astigmatism_px - scale * -0.128).abs() < 0.02, "{} for {found:?}", scale * -0.128);
}

/// On a board that repeats itself within a micro-image several spacings match alike: no number comes of it.
#[test]
fn a_board_that_repeats_itself_is_refused() {
    let design = Config::default().design();
    let distance = 167.174_586;
    let texel = texel_for(&design, Medium::Air, distance, PIXEL_MM);
    // Squares of 8 texels, 4 pixels of a micro-image: the pattern comes again every 8 pixels.
    let values: Vec<f32> =
        (0..128 * 128).map(|k| if (k % 128 / 8 + k / 128 / 8) % 2 == 0 { 0.2 } else { 0.8 }).collect();
    let map = Arc::new(TextureMap::from_values(&values, texel));
    let camera = CameraTruth::from_design(&design, 2.205, Medium::Air, PIXEL_MM, 400, 400);
    let rays = RenderOptions { rays: 16, seed: 2 };
    let white = expose(&render(&camera, &Scene::Diffuser, rays), 400, 400, &Noise::default(), 3);
    let raw = expose(&render(&camera, &Scene::Board(Board::new(distance, map)), rays), 400, 400, &Noise::default(), 4);
    let refused = measured(&raw, &white).unwrap_err();
    assert!(matches!(refused, MeasurementError::Spacing(SpacingError::Ambiguous { .. })), "{refused}");
}

#[test]
fn small_micro_images_give_a_larger_sigma_or_a_refusal() {
    let (mut bad, mut measured) = (Vec::new(), 0);
    for pitch_px in [8.0, 10.5, 13.0, 16.0, 19.0] {
        for texture in [Texture::Natural, Texture::Charuco, Texture::Guppy] {
            let frame = Rendered { pitch_px, seed: 3, rays: 16, ..Rendered::default() };
            let white = WhiteModel::new(&frame.white()).unwrap();
            let options = FrameOptions::new(frame.mla_pitch_px());
            let spacing = match measure_frame(&frame.textured(texture), Some(&white), &options) {
                Ok(found) => found.spacing,
                Err(refusal) => {
                    println!("{pitch_px} px {texture:?}: {refusal}");
                    continue;
                }
            };
            let error = spacing.on_axis_px - frame.spacing_px();
            println!("{pitch_px} px {texture:?}: off by {error:+.4} ± {:.4} px", spacing.sigma_px);
            measured += 1;
            if error.abs() > 3.0 * spacing.sigma_px {
                bad.push(format!("{pitch_px} px {texture:?}: off by {error:+.4} ± {:.4}", spacing.sigma_px));
            }
        }
    }
    assert!(bad.is_empty(), "{}", bad.join("\n"));
    assert!(measured > 0, "all are refused");
}

#[test]
fn frames_without_an_answer_are_refused() {
    let (raw, white, _) = rendered(2.205, None, Texture::Natural, 400, 2.0);
    // A white frame has micro-images but nothing on them.
    let blank = measured(&white, &white).unwrap_err();
    assert!(
        matches!(&blank, MeasurementError::Spacing(SpacingError::NoTexture { .. } | SpacingError::NoMatch { .. })),
        "{blank}"
    );
    // Far too bright: clipped.
    let burnt: Vec<u8> = raw.to_view().iter().map(|v| v.saturating_mul(6)).collect();
    let burnt = measured(&RawImage::from_u8(400, 400, burnt), &white).unwrap_err();
    assert!(
        matches!(&burnt, MeasurementError::Grid(_) | MeasurementError::Spacing(SpacingError::Saturated { .. })),
        "{burnt}"
    );
    // Another size than the white frame's.
    let cropped = RawImage::from_u8(400, 300, raw.to_view()[..400 * 300].to_vec());
    assert!(measured(&cropped, &white).is_err());
    let mut other = options();
    other.array = Some(plenalign::optics::ArrayKind::Hexagonal);
    let wrong = measure_frame(&raw, Some(&WhiteModel::new(&white).unwrap()), &other).unwrap_err();
    assert!(matches!(wrong, MeasurementError::OtherArray { .. }), "{wrong}");
    let mut other = FrameOptions::new(1.2 * 0.1 / PIXEL_MM);
    other.array = Some(plenalign::optics::ArrayKind::Square);
    let wrong = measure_frame(&raw, Some(&WhiteModel::new(&white).unwrap()), &other).unwrap_err();
    assert!(matches!(wrong, MeasurementError::OtherPitch { .. }), "{wrong}");
}

#[test]
fn a_spacing_beyond_the_range_is_said_to_be() {
    let design = Config::default().design();
    let least = plenalign::imaging::spacing::GALILEAN_RANGE[0] * 0.1 / PIXEL_MM;
    // The image so near the array that neighbours share hardly anything: 5.2 px at 2.855 mm.
    let (raw, white, expected) = rendered(2.855, None, Texture::Charuco, 400, 2.0);
    assert!(expected < 0.6 * least, "{expected} px");
    let white_model = WhiteModel::new(&white).unwrap();
    let mut known = options();
    known.spacing.mode = Some(design.mla.mode);
    let refused = measure_frame(&raw, Some(&white_model), &known).unwrap_err();
    let MeasurementError::Spacing(SpacingError::BeyondRange { from_px, above: false, .. }) = refused else {
        panic!("{refused}")
    };
    assert!((from_px - least).abs() < 1e-9);
    let words = refused.to_string();
    assert!(words.contains("lies below the range; lower Δv or bring the board nearer"), "{words}");
}

#[test]
fn frames_of_changing_texture_share_the_grid_of_their_mean() {
    let frames: Vec<RawImage> =
        (1..=6).map(|seed| Rendered { seed, rays: 16, ..Rendered::default() }.textured(Texture::Natural)).collect();
    let truth = Rendered::default().grid();
    let measure = |frames: &[RawImage]| {
        measure_frames(frames, None, &FrameOptions::new(Rendered::default().mla_pitch_px())).unwrap()
    };
    let [one, all] = [measure(&frames[..1]), measure(&frames)];
    let [by_one, by_all] = [&one, &all].map(|m| centres_rms(&m.grid, &truth));
    println!(
        "centres {by_one:.4} px rms from one, {by_all:.4} from six; σ {:.4} and {:.4} px",
        one.spacing.sigma_px, all.spacing.sigma_px
    );
    assert!(by_all < 0.6 * by_one && by_all < 0.05, "{by_one} and {by_all} px rms");
    assert!(all.spacing.sigma_px < 0.7 * one.spacing.sigma_px);
    let other = RawImage::from_u8(300, 400, vec![9; 120_000]);
    let refused = measure_frames([&frames[0], &other], None, &FrameOptions::new(Rendered::default().mla_pitch_px()));
    assert!(matches!(refused, Err(MeasurementError::Grid(GridError::OtherFrameSize { .. }))), "{refused:?}");
}

#[test]
fn flat_micro_images_without_noise_do_no_harm() {
    // Most micro-images of a chequered board are black or white all over; in a noise-free frame their moments are
    // rounding errors.
    for seed in [4, 7, 10, 12] {
        let frame = Rendered { seed, noise: 0.0, rays: 32, rotation_deg: 0.3, ..Rendered::default() };
        let white = WhiteModel::new(&frame.white()).unwrap();
        let options = FrameOptions::new(frame.mla_pitch_px());
        let spacing = measure_frame(&frame.textured(Texture::Charuco), Some(&white), &options).unwrap().spacing;
        let error = spacing.on_axis_px - frame.spacing_px();
        println!("{seed}: error {error:+.5} ± {:.5} px", spacing.sigma_px);
        assert!(error.abs() < 0.01 && spacing.sigma_px < 0.01, "{seed}: {error:+} ± {} px", spacing.sigma_px);
    }
}
