//! A known grid checked at a glance, and followed in textured frames.

use plenalign::config::Texture;
use plenalign::imaging::grid::{Grid, GridError, GridOptions, GridState, check_grid, find_grid, refine_grid};
use plenalign::imaging::vignetting::Vignetting;
use plenalign::optics::ArrayKind;
use plenalign::raw::RawImage;

use super::rendered::{Rendered, centres_rms, random};

/// The grid as it was before the array moved by so much.
fn before(grid: &Grid, moved: [f64; 2], scale: f64) -> Grid {
    let mut old = grid.clone();
    old.centre = [grid.centre[0] - moved[0], grid.centre[1] - moved[1]];
    old.basis = grid.basis.map(|b| b.map(|x| x / scale));
    old
}

#[test]
fn a_moved_white_frame_is_seen_to_hundredths_of_a_pixel() {
    for array in [ArrayKind::Square, ArrayKind::Hexagonal] {
        let frame = Rendered { array, size: [500, 460], rays: 32, ..Rendered::default() };
        let (white, grid) = (frame.white(), frame.grid());
        for (moved, scale) in [([0.0, 0.0], 1.0), ([0.15, -0.05], 1.0), ([2.0, 1.0], 1.0), ([0.0, 0.0], 1.002)] {
            let check = check_grid(&white, &before(&grid, moved, scale), None).unwrap();
            for k in 0..2 {
                // About the frame's centre: the scale moves the offset of a centre that is not there.
                let expected = moved[k] + (scale - 1.0) * ([249.5, 229.5][k] - grid.centre[k]);
                let error = check.shift_px[k] - expected;
                assert!(error.abs() < 0.03, "{array:?} {moved:?} {scale}: {check:?}");
            }
            assert!((check.scale_change - (scale - 1.0)).abs() < 1e-4, "{array:?} {moved:?} {scale}: {check:?}");
            let expected = if moved == [0.0, 0.0] && scale == 1.0 { GridState::Fits } else { GridState::Moved };
            assert_eq!(check.state(), expected, "{array:?} {moved:?} {scale}: {check:?}");
            assert!(check.coherence > 0.99);
        }
    }
}

#[test]
fn texture_is_no_movement_and_a_movement_is_seen_through_texture() {
    for array in [ArrayKind::Square, ArrayKind::Hexagonal] {
        for texture in [Texture::Natural, Texture::Charuco] {
            let frame = Rendered { array, size: [640, 640], seed: 5, ..Rendered::default() };
            let (white, textured, grid) = (frame.white(), frame.textured(texture), frame.grid());
            let profile = Vignetting::from_white(&white, &grid).unwrap();
            for profile in [None, Some(&profile)] {
                let still = check_grid(&textured, &grid, profile).unwrap();
                assert_eq!(still.state(), GridState::Fits, "{array:?} {texture:?}: {still:?}");
            }
            let moved = check_grid(&textured, &before(&grid, [3.0, -2.0], 1.0), Some(&profile)).unwrap();
            println!("{array:?} {texture:?}: {:?} ± {:.3}", moved.shift_px, moved.shift_sigma_px);
            // A chequered board that hides every other micro-image hides such a movement from a glance, and says so.
            let seen = moved.displacement_px > 3.0 * moved.displacement_sigma_px;
            assert!(seen || texture == Texture::Charuco, "{array:?} {texture:?}: {moved:?}");
            assert_eq!(moved.state() == GridState::Moved, seen, "{array:?} {texture:?}: {moved:?}");
            let error = (moved.shift_px[0] - 3.0).hypot(moved.shift_px[1] + 2.0);
            assert!(error < 4.0 * moved.shift_sigma_px, "{array:?} {texture:?}: {moved:?}");
        }
    }
}

#[test]
fn a_frame_without_the_array_is_told() {
    let frame = Rendered { size: [600, 600], ..Rendered::default() };
    let grid = frame.grid();
    let other = Rendered { array: ArrayKind::Hexagonal, size: [600, 600], ..Rendered::default() }.white();
    let check = check_grid(&other, &grid, None).unwrap();
    assert_eq!(check.state(), GridState::Lost, "{check:?}");
    let mut state = 5;
    let noise = RawImage::from_u8(600, 600, (0..360_000).map(|_| (255.0 * random(&mut state)) as u8).collect());
    match check_grid(&noise, &grid, None) {
        Ok(check) => assert_eq!(check.state(), GridState::Lost, "{check:?}"),
        Err(error) => assert!(matches!(error, GridError::Blank { .. }), "{error}"),
    }
    let dark = RawImage::from_u8(600, 600, vec![3; 360_000]);
    assert!(matches!(check_grid(&dark, &grid, None), Err(GridError::Blank { .. })));
    let small = RawImage::from_u8(300, 300, vec![3; 90_000]);
    assert!(matches!(check_grid(&small, &grid, None), Err(GridError::OtherFrameSize { .. })));
}

#[test]
fn few_strongly_textured_micro_images_keep_their_grid() {
    // 190 micro-images, many of which say nothing of their place: among 200 such frames these are the hardest.
    for seed in [88, 134, 171] {
        let frame = Rendered { array: ArrayKind::Hexagonal, rotation_deg: -0.4, rays: 16, seed, ..Rendered::default() };
        let (white, textured) = (frame.white(), frame.textured(Texture::Natural));
        let known = find_grid(&white, &GridOptions::default()).unwrap();
        let profile = Vignetting::from_white(&white, &known).unwrap();
        let grids =
            [refine_grid(&textured, &known, None).unwrap(), refine_grid(&textured, &known, Some(&profile)).unwrap()];
        for grid in grids {
            let rms = centres_rms(&grid, &frame.grid());
            println!("{seed}: {rms:.3} px rms, pitch {:+.4} px", grid.pitch_px() - 29.5);
            assert!(rms < 0.25, "{seed}: {rms} px rms");
        }
    }
}
