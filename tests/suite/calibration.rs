//! Calibration from the referee's triple-level board, and from rendered boards at an unknown distance.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

use std::path::PathBuf;
use std::sync::Arc;

use plenalign::config::{Config, Texture};
use plenalign::imaging::calibration::{
    CalibrationError, CalibrationOptions, ConjugateLine, Known, MicroImagePitch, PitchSource, calibrate,
};
use plenalign::imaging::measurement::{FrameOptions, WhiteModel};
use plenalign::raw::{self, RawImage};
use plenalign::sim::exposure::{Noise, expose};
use plenalign::sim::renderer::{CameraTruth, Medium, RenderOptions, render};
use plenalign::sim::scene::{Scene, TripleBoard, texel_for};
use plenalign::sim::texture::TextureMap;

const D_MM: f64 = 21.657_820_512_820_51;
const B_MM: f64 = 0.340_255_591_054_313_1;
const LEVELS_MM: [f64; 3] = [175.174_585_888_449_83, 159.174_585_888_449_83, 167.174_585_888_449_83];
const SPACINGS_PX: [f64; 3] = [20.876_697_774_786_42, 19.681_631_341_512_986, 18.264_500_822_603_427];

fn referee(name: &str) -> RawImage {
    raw::read(&PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/referee/{name}.png"))).unwrap()
}

fn options(hold_b: Option<(f64, f64)>) -> CalibrationOptions {
    let design = Config::default().design();
    let frame = FrameOptions::new(0.1 / 0.00345);
    CalibrationOptions { hold_b, ..CalibrationOptions::new(frame, 0.00345, design.main_lens) }
}

#[test]
fn the_boards_are_found_and_give_the_image_distance() {
    let white = WhiteModel::new(&referee("triple_air_white")).unwrap();
    for hold_b in [None, Some((B_MM, 0.0))] {
        let c = calibrate(&referee("triple_air"), Some(&white), &LEVELS_MM, &options(hold_b)).unwrap();
        for (level, expected) in c.line.levels.iter().zip(SPACINGS_PX) {
            let error = level.spacing_px - expected;
            assert!(error.abs() < 3.0 * level.sigma_px && error.abs() < 0.05, "{error:+.4} px: {level:?}");
        }
        let (v, sigma) = c.line.image_distance(3.13);
        let error = v - D_MM - 3.13 * B_MM;
        assert!(error.abs() < 0.003 && error.abs() < 3.0 * sigma && sigma < 0.002, "{error:+.6} ± {sigma:.6} mm");
        assert!((c.line.d_mm - D_MM).abs() < 3.0 * c.line.d_sigma_mm(), "{:?}", c.line);
        assert!((c.line.b_mm - B_MM).abs() <= 3.0 * c.line.b_sigma_mm() + 1e-9, "{:?}", c.line);
    }
}

#[test]
fn one_board_is_not_three() {
    let white = WhiteModel::new(&referee("air_square_white")).unwrap();
    let refused = calibrate(&referee("air_square"), Some(&white), &[700.0, 780.0, 900.0], &options(None)).unwrap_err();
    assert!(
        matches!(refused, CalibrationError::BoardsNotFound { .. } | CalibrationError::Degenerate { .. }),
        "{refused}"
    );
}

/// The micro-image pitch of a white frame.
fn of_white(white: &RawImage) -> PitchSource {
    PitchSource::Given(MicroImagePitch::of(&WhiteModel::new(white).unwrap().grid))
}

/// The camera that the referee's boards show, with the micro-image pitch of a frame.
fn referee_line(source: PitchSource, options: &CalibrationOptions, levels: &[f64]) -> ConjugateLine {
    let white = WhiteModel::new(&referee("triple_air_white")).unwrap();
    let options = CalibrationOptions { micro_image_pitch: Some(source), ..options.clone() };
    calibrate(&referee("triple_air"), Some(&white), levels, &options).unwrap().line
}

#[test]
fn the_micro_image_pitch_is_the_referees() {
    for (source, sigma_max) in [(PitchSource::Frame, 0.01), (of_white(&referee("triple_air_white")), 2e-4)] {
        let line = referee_line(source, &options(None), &LEVELS_MM);
        let MicroImagePitch { pitch_px, sigma_px } = line.micro_image_pitch.unwrap().measured;
        let error = pitch_px - 0.1 / 0.00345 * (1.0 + B_MM / D_MM);
        println!("{source:?}: {error:+.6} ± {sigma_px:.6} px, b {:.6} ± {:.6} mm", line.b_mm, line.b_sigma_mm());
        assert!(error.abs() < 3.0 * sigma_px && sigma_px < sigma_max, "{source:?}: {error:+.6} ± {sigma_px:.6} px");
        assert!((line.b_mm - B_MM).abs() < 3.0 * line.b_sigma_mm(), "{line:?}");
        let (v, sigma) = line.image_distance(3.13);
        assert!((v - D_MM - 3.13 * B_MM).abs() < 0.003_f64.min(3.0 * sigma), "{v} ± {sigma}");
    }
}

#[test]
fn the_referees_boards_give_their_own_distance() {
    let unknown = CalibrationOptions { distances: Known::NotAtAll, ..options(None) };
    let steps = LEVELS_MM.map(|l| l - LEVELS_MM[1]);
    let white = WhiteModel::new(&referee("triple_air_white")).unwrap();
    // ±8 mm are too little to tell it from spacings of this frame alone, which are good to some 0.02 px.
    let alone = calibrate(&referee("triple_air"), Some(&white), &steps, &unknown).unwrap_err();
    assert!(alone.to_string().starts_with("the boards' distance, b and d cannot be told apart"), "{alone}");
    let line = referee_line(of_white(&referee("triple_air_white")), &unknown, &steps);
    let shift = line.shift.unwrap();
    let (v, sigma) = line.image_distance(3.13);
    println!("board {:.2} ± {:.2} mm, d + N b {v:.5} ± {sigma:.5} mm", shift.value_mm, shift.sigma_mm);
    let error = shift.value_mm - LEVELS_MM[1];
    assert!(error.abs() < 3.0 * shift.sigma_mm && shift.sigma_mm < 3.0, "{error:+.3} mm: {shift:?}");
    assert!((v - D_MM - 3.13 * B_MM).abs() < 3.0 * sigma && sigma < 0.06, "{v} ± {sigma}");
}

/// A frame of the preset's camera at its joint solution, 8 bits with the usual noise.
fn rendered(scene: &Scene, camera: &CameraTruth, rays: u32, seed: u64) -> RawImage {
    let irradiance = render(camera, scene, RenderOptions { rays, seed });
    expose(&irradiance, camera.width, camera.height, &Noise::default(), seed)
}

#[test]
fn rendered_boards_at_an_unknown_distance_calibrate_the_camera() {
    let config = Config::default();
    let design = config.design();
    let joint = design.joint(0.0);
    let mut camera = CameraTruth::from_design(&design, joint.delta_v, Medium::Air, 0.00345, 900, 720);
    camera.rotation = 0.006;
    camera.offset = [3.3, -7.1];
    let stood = [-25.0, 0.0, 25.0].map(|step| joint.equivalent_distance + step);
    let texel = texel_for(&design, Medium::Air, stood[1], 0.00345);
    let texture = Arc::new(TextureMap::generate(Texture::Natural, texel, 5));
    let boards = Scene::TripleBoard(TripleBoard::new(&stood, camera.half_field_slope(), &texture));
    let (frame, white) = (rendered(&boards, &camera, 16, 5), rendered(&Scene::Diffuser, &camera, 64, 6));
    let pitch = of_white(&white);
    let white = WhiteModel::new(&white).unwrap();
    // The boards' steps are given from the middle one.
    let steps = [-25.0, 0.0, 25.0];
    let truth = camera.lens_to_mla + 3.13 * camera.mla_to_sensor;
    let mut sigmas = Vec::new();
    for micro_image_pitch in [None, Some(PitchSource::Frame), Some(pitch)] {
        let unknown = CalibrationOptions { distances: Known::NotAtAll, micro_image_pitch, ..options(None) };
        let line = calibrate(&frame, Some(&white), &steps, &unknown).unwrap().line;
        let shift = line.shift.unwrap();
        let (v, sigma) = line.image_distance(3.13);
        println!(
            "{micro_image_pitch:?}: d + N b {:+.5} ± {sigma:.5}, b {:+.5} ± {:.5}, boards {:+.3} ± {:.3} mm, condition {:.0}",
            v - truth,
            line.b_mm - camera.mla_to_sensor,
            line.b_sigma_mm(),
            shift.value_mm - stood[1],
            shift.sigma_mm,
            line.condition
        );
        assert!((v - truth).abs() < 3.0 * sigma, "{v} ± {sigma}, not {truth}");
        assert!((line.b_mm - camera.mla_to_sensor).abs() < 3.0 * line.b_sigma_mm(), "{line:?}");
        assert!((shift.value_mm - stood[1]).abs() < 3.0 * shift.sigma_mm, "{shift:?}, not {}", stood[1]);
        sigmas.push(sigma);
    }
    // The pitch pays, the white frame's the most.
    assert!(sigmas[1] < sigmas[0] && sigmas[2] < sigmas[1] / 3.0 && sigmas[2] < 0.005, "{sigmas:?}");
}
