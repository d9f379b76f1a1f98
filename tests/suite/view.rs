//! Views of the referee frames and of the exact-ray renderer's.

use std::path::Path;

use plenalign::imaging::clarity::{blockiness, eog};
use plenalign::imaging::grid::{Grid, GridOptions, find_grid};
use plenalign::imaging::view::{Blend, Patches, View, ViewError, ViewFrame, ViewOptions, render};
use plenalign::imaging::vignetting::Vignetting;
use plenalign::raw::{self, CfaPattern, RawImage};

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

/// Share of the light that the scene sends back in red, green and blue, by its place across the frame from 0 to 1.
fn tint(place: f64) -> [f64; 3] {
    [0.25 + 0.6 * place, 0.6, 0.8 - 0.55 * place]
}

/// What a sensor of so many bits behind a mosaic makes of a grey frame whose scene is tinted: `place` is where in the
/// scene a pixel looks, from 0 to 1.
fn behind_filters(grey: &RawImage, bits: u8, pattern: CfaPattern, place: impl Fn(usize, usize) -> f64) -> RawImage {
    let (width, height) = (grey.width(), grey.height());
    let white = f64::from((1u32 << bits) - 1);
    let level = |k: usize, value: f32| {
        let (x, y) = (k % width, k / width);
        (f64::from(value) / 255.0 * tint(place(x, y))[pattern.channel(x, y).index()] * white).round() as u16
    };
    let levels: Vec<u16> = grey.to_f32().into_iter().enumerate().map(|(k, value)| level(k, value)).collect();
    match bits {
        8 => RawImage::from_u8(width, height, levels.into_iter().map(|level| level as u8).collect()),
        _ => RawImage::from_u16(width, height, bits, levels),
    }
}

#[test]
fn a_mosaic_keeps_the_scenes_colours_up_to_every_border() {
    let (white, board) = (frame("air_charuco_white"), frame("air_charuco"));
    let grid = find_grid(&white, &GridOptions::default()).unwrap();
    let profile = Vignetting::from_white(&white, &grid).unwrap();
    let (pitch, width) = (grid.pitch_px(), grid.frame_size[0] as f64);
    let ratio = (pitch - SPACING_PX) / pitch;
    // Where in the scene a pixel looks: the patch about its micro-image's centre, laid out.
    let place = |x: usize, y: usize| {
        let m = grid.nearest(x as f64, y as f64);
        ((m.x + (x as f64 - m.x) / ratio) / width).clamp(0.0, 1.0)
    };
    for (bits, pattern) in
        [(8, CfaPattern::Rggb), (10, CfaPattern::Grbg), (12, CfaPattern::Bggr), (16, CfaPattern::Gbrg)]
    {
        let mosaic = behind_filters(&board, bits, pattern, place);
        let ready = ViewFrame::new(&mosaic, Some(pattern), &grid, Some(&profile.over(&grid))).unwrap();
        let view = of(&ready, SPACING_PX, Blend::Seamless).unwrap();
        let [red, green, blue] = view.planes.as_slice() else { panic!("{} planes", view.planes.len()) };
        let bright = green.iter().copied().fold(0.0, f32::max) / 3.0;
        let owners: Vec<[i32; 2]> = view.extent().owners(&grid).collect();
        for (name, plane, of_scene) in [("red", red, 0), ("blue", blue, 2)] {
            // The mean of each colour is brought to that of green: the colours are right but for one factor.
            let mut shares = Vec::new();
            for (k, (&colour, &green)) in plane.iter().zip(green).enumerate() {
                let (x, y) = (k % view.width, k / view.width);
                let inside = (4..view.width - 4).contains(&x) && (4..view.height - 4).contains(&y);
                if inside && green > bright {
                    let across = (((view.width - 1 - x) as f64 + 0.5) / view.scale - 0.5) / width;
                    let wanted = tint(across)[of_scene] / tint(across)[1];
                    let border = owners[k] != owners[k + 1] || owners[k] != owners[k + view.width];
                    shares.push((f64::from(colour / green) / wanted, border));
                }
            }
            let mut all: Vec<f64> = shares.iter().map(|(share, _)| *share).collect();
            let middle = all.len() / 2;
            let factor = *all.select_nth_unstable_by(middle, f64::total_cmp).1;
            let error = |border: bool| {
                let errors =
                    shares.iter().filter(|share| share.1 == border).map(|(share, _)| (share / factor - 1.0).abs());
                let (sum, count) = errors.fold((0.0, 0.0), |(sum, count), error| (sum + error, count + 1.0));
                sum / count
            };
            let (within, across) = (error(false), error(true));
            println!(
                "{bits} bits, {pattern:?}: {name} off by {:.2} % within patches, {:.2} % at borders",
                100.0 * within,
                100.0 * across
            );
            assert!(within < 0.03 && across < 1.2 * within + 0.003, "{bits} bits: {within} {across}");
        }
    }
}
