//! Views of the referee frames and of the exact-ray renderer's.

use std::path::Path;

use plenalign::imaging::clarity::{blockiness, eog};
use plenalign::imaging::grid::{Grid, GridOptions, find_grid};
use plenalign::imaging::view::{Blend, Patches, View, ViewError, ViewFrame, ViewOptions, render};
use plenalign::imaging::vignetting::Vignetting;
use plenalign::raw::{self, RawImage};

fn frame(name: &str) -> RawImage {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/referee/{name}.png"));
    raw::read(&path).expect("a referee frame")
}

fn of(frame: &ViewFrame, spacing_px: f64, blend: Blend) -> Result<View, ViewError> {
    render(frame, &ViewOptions { patches: Patches::Fixed(spacing_px), blend, direction: [0.0; 2] })
}

fn board() -> (ViewFrame, Grid) {
    let (white, board) = (frame("air_charuco_white"), frame("air_charuco"));
    let grid = find_grid(&white, &GridOptions::default()).unwrap();
    let profile = Vignetting::from_white(&white, &grid).unwrap();
    (ViewFrame::new(&board, None, &grid, Some(&profile.over(&grid))).unwrap(), grid)
}

const SPACING_PX: f64 = 19.612;

#[test]
fn the_board_is_continuous_at_its_spacing() {
    let (board, grid) = board();
    let view = of(&board, SPACING_PX, Blend::Abutting).unwrap();
    assert_eq!((view.width, view.height), (301, 301));
    // The same patches turned by 180° make a view of the same size, with a seam along every patch: steps that the
    // continuous view does not have. (The spacing mirrored at the pitch turns the patches.)
    let turned = of(&board, 2.0 * grid.pitch_px() - SPACING_PX, Blend::Abutting).unwrap();
    let (continuous, broken) = (eog(&view).mean_per_pixel, eog(&turned).mean_per_pixel);
    println!("gradient energy a pixel {continuous:.0} continuous, {broken:.0} with turned patches");
    assert!(broken > 1.5 * continuous, "{continuous} {broken}");
    // The board is black and white, and its squares are solid: most pixels are near either end.
    let picture = view.to_u8();
    let ends = picture.iter().filter(|&&v| !(60..=180).contains(&v)).count() as f64 / picture.len() as f64;
    assert!(ends > 0.85, "{ends}");
}

#[test]
fn seams_are_measured_and_blended_away() {
    let (board, grid) = board();
    let seams = |spacing_px: f64, blend: Blend| blockiness(&of(&board, spacing_px, blend).unwrap(), &grid).unwrap();
    let (right, small, large) = (
        seams(SPACING_PX, Blend::Abutting),
        seams(SPACING_PX + 3.0, Blend::Abutting),
        seams(SPACING_PX - 3.0, Blend::Abutting),
    );
    let blended = seams(SPACING_PX, Blend::Seamless);
    println!("steps across patch borders: {right:.3} right, {small:.3} small, {large:.3} large, {blended:.3} blended");
    assert!(right < 1.3 && small > 1.2 * right && large > 1.2 * right, "{right} {small} {large}");
    assert!((blended - 1.0).abs() < (right - 1.0).abs() + 0.05, "{blended}");
    // The aperture takes in the wrong distances and blurs them.
    let sharp = eog(&of(&board, SPACING_PX, Blend::WholeAperture).unwrap()).mean_per_pixel;
    let blurred = eog(&of(&board, SPACING_PX - 3.0, Blend::WholeAperture).unwrap()).mean_per_pixel;
    assert!(sharp > 1.5 * blurred, "{sharp} {blurred}");
}

#[test]
fn impossible_views_are_refused() {
    let white = frame("air_square_white");
    let grid = find_grid(&white, &GridOptions::default()).unwrap();
    let ready = ViewFrame::new(&white, None, &grid, None).unwrap();
    for spacing in [29.4926, -5.0, 80.0, f64::NAN] {
        let refused = of(&ready, spacing, Blend::Seamless);
        assert!(matches!(refused, Err(ViewError::Patch { .. })), "{spacing}");
    }
    for direction in [[1.0, 0.2], [f64::NAN, 0.0]] {
        let refused = render(&ready, &ViewOptions { direction, ..ViewOptions::central(20.0) });
        assert!(matches!(refused, Err(ViewError::Direction { .. })), "{direction:?}");
    }
    let cropped = RawImage::from_u8(40, 30, vec![9; 1200]);
    assert!(matches!(ViewFrame::new(&cropped, None, &grid, None), Err(ViewError::OtherFrameSize { .. })));
}
