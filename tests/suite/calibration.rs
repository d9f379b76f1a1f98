//! Calibration from the referee's triple-level board.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

use std::path::PathBuf;

use plenalign::config::Config;
use plenalign::imaging::calibration::{CalibrationError, CalibrationOptions, calibrate};
use plenalign::imaging::measurement::{FrameOptions, WhiteModel};
use plenalign::raw::{self, RawImage};

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
    CalibrationOptions { frame, pixel_mm: 0.00345, main_lens: design.main_lens, distance_sigma_mm: 0.0, hold_b }
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
