//! The plain view on the referee frames.

use std::path::Path;

use plenalign::imaging::clarity::eog;
use plenalign::imaging::grid::{GridOptions, find_grid};
use plenalign::imaging::view::{ViewError, central_view};
use plenalign::imaging::vignetting::Vignetting;
use plenalign::raw::{self, RawImage};

fn frame(name: &str) -> RawImage {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/referee/{name}.png"));
    raw::read(&path).expect("a referee frame")
}

#[test]
fn the_board_is_continuous_at_its_spacing() {
    const SPACING_PX: f64 = 19.612;
    let (white, board) = (frame("air_charuco_white"), frame("air_charuco"));
    let grid = find_grid(&white, &GridOptions::default()).unwrap();
    let profile = Vignetting::from_white(&white, &grid).unwrap();
    let view = central_view(&board, &grid, Some(&profile), SPACING_PX).unwrap();
    assert_eq!((view.width, view.height), (301, 301));
    // The same patches turned by 180° make a view of the same size, with a seam along every patch: steps that the
    // continuous view does not have. (The spacing mirrored at the pitch turns the patches.)
    let turned = central_view(&board, &grid, Some(&profile), 2.0 * grid.pitch_px() - SPACING_PX).unwrap();
    let (continuous, broken) = (eog(&view).mean_per_pixel, eog(&turned).mean_per_pixel);
    println!("gradient energy a pixel {continuous:.0} continuous, {broken:.0} with turned patches");
    assert!(broken > 1.5 * continuous, "{continuous} {broken}");
    // The board is black and white, and its squares are solid: most pixels are near either end.
    let picture = view.to_u8();
    let ends = picture.iter().filter(|&&v| !(60..=180).contains(&v)).count() as f64 / picture.len() as f64;
    assert!(ends > 0.85, "{ends}");
}

#[test]
fn impossible_patches_are_refused() {
    let white = frame("air_square_white");
    let grid = find_grid(&white, &GridOptions::default()).unwrap();
    for spacing in [29.4926, -5.0, 80.0, f64::NAN] {
        let refused = central_view(&white, &grid, None, spacing);
        assert!(matches!(refused, Err(ViewError::Patch { .. })), "{spacing}");
    }
}
