//! The micro-image's profile on the referee frames.

use std::path::Path;

use plenalign::imaging::grid::{GridOptions, find_grid, refine_grid};
use plenalign::imaging::vignetting::Vignetting;
use plenalign::raw::{self, RawImage};

fn frame(name: &str) -> RawImage {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/referee/{name}.png"));
    raw::read(&path).expect("a referee frame")
}

#[test]
fn a_white_frame_leaves_nothing_but_its_noise() {
    let white = frame("water_hexagonal_white");
    let grid = find_grid(&white, &GridOptions::default()).unwrap();
    let profile = Vignetting::from_white(&white, &grid).unwrap();
    let drawn = profile.render(&grid);
    let values = white.to_f32();
    let plateau: Vec<(f64, f64)> = values.iter().zip(&drawn).map(|(&v, &t)| (f64::from(v), f64::from(t))).collect();
    let gain = plateau.iter().map(|(v, t)| v * t).sum::<f64>() / plateau.iter().map(|(_, t)| t * t).sum::<f64>();
    let rms = (plateau.iter().map(|(v, t)| (v - gain * t).powi(2)).sum::<f64>() / plateau.len() as f64).sqrt();
    let flat: Vec<f64> = plateau.iter().filter(|p| p.1 > 0.97).map(|(v, t)| v - gain * t).collect();
    let flat_rms = (flat.iter().map(|d| d * d).sum::<f64>() / flat.len() as f64).sqrt();
    println!("gain {gain:.2}, rms {rms:.3}, on the plateau {flat_rms:.3}");
    assert!(rms < 3.1, "{rms} grey levels");
    assert!(drawn.iter().all(|t| (-0.02..1.05).contains(t)));
    // At the centre of a micro-image 1, half way between two of them much less.
    let m = grid.nearest(450.0, 450.0);
    assert!((profile.at(&grid, m.x, m.y) - 1.0).abs() < 0.02);
    let [x, y] = grid.position_at(f64::from(m.i) + 0.5, f64::from(m.j));
    assert!(profile.at(&grid, x, y) < 0.7);
    let radius = profile.usable_radius_px(&grid);
    assert!((10.0..13.5).contains(&radius), "{radius} px");
}

#[test]
fn a_profile_is_carried_to_another_image_distance() {
    let white = frame("air_square_white");
    let grid = find_grid(&white, &GridOptions::default()).unwrap();
    let profile = Vignetting::from_white(&white, &grid).unwrap();
    for other in ["triple_air", "water_clarity_e30"] {
        let white = frame(&format!("{other}_white"));
        let moved = find_grid(&white, &GridOptions::default()).unwrap();
        let fit = profile.fit(&white, &moved).unwrap();
        assert!(fit.misfit < 0.01 && fit.fits(), "{other}: {fit:?}");
        let textured = frame(other);
        let fit = profile.fit(&textured, &refine_grid(&textured, &moved, None).unwrap()).unwrap();
        assert!(fit.fits() && fit.misfit < 0.02, "{other}: {fit:?}");
        // A grid that is off by a tenth of the pitch is no place for the profile.
        let mut off = moved.clone();
        off.centre[0] += 3.0;
        let fit = profile.fit(&white, &off).unwrap();
        assert!(!fit.fits(), "{other}: {fit:?}");
    }
}

#[test]
fn without_a_white_frame_the_texture_averages_out() {
    let (white, textured) = (frame("air_square_white"), frame("air_square"));
    let grid = find_grid(&white, &GridOptions::default()).unwrap();
    let estimated = Vignetting::from_textured(&textured, &grid).unwrap();
    let fit = estimated.fit(&white, &grid).unwrap();
    assert!(fit.misfit < 0.01, "{fit:?}");
}
