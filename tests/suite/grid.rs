//! The grid of referee and real frames.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_3};
use std::path::Path;

use plenalign::imaging::grid::{Grid, GridError, GridOptions, find_grid, lens_residuals, refine_grid};
use plenalign::imaging::vignetting::Vignetting;
use plenalign::optics::ArrayKind;
use plenalign::raw::{self, RawImage};

use super::rendered::{centres_rms, random};

const REFEREE: [&str; 5] = ["air_square", "air_charuco", "water_hexagonal", "water_clarity_e30", "triple_air"];

fn frame(path: &str) -> RawImage {
    raw::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(path)).expect("a fixture")
}

/// The referee's own grid, from what its renderer was told.
fn truth(name: &str) -> Grid {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/referee/truth.json");
    let all: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(path).expect("truth.json")).expect("JSON");
    let t = &all["frames"][name];
    let number = |v: &serde_json::Value| v.as_f64().expect("a number");
    let (pitch, rotation) = (number(&t["micro_image_pitch_px"]), number(&t["rotation_deg"]).to_radians());
    let (array, period) = match t["array"].as_str().expect("a name") {
        "square" => (ArrayKind::Square, FRAC_PI_2),
        "hexagonal" => (ArrayKind::Hexagonal, FRAC_PI_3),
        other => panic!("{other}"),
    };
    let along = |angle: f64| [pitch * angle.cos(), pitch * angle.sin()];
    let centre = [number(&t["a_micro_image_centre_px"][0]), number(&t["a_micro_image_centre_px"][1])];
    Grid::affine(array, centre, [along(rotation), along(rotation + period)], [900, 900])
}

#[test]
fn white_referee_frames_are_found_to_hundredths_of_a_pixel() {
    for name in REFEREE {
        let (grid, truth) =
            (find_grid(&frame(&format!("referee/{name}_white.png")), &GridOptions::default()), truth(name));
        let grid = grid.unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(grid.array, truth.array, "{name}");
        assert_eq!(grid.distortion, None, "{name}: an exact lattice needs no bending");
        let pitch = grid.pitch_px() - truth.pitch_px();
        assert!(pitch.abs() < 0.002, "{name}: pitch off by {pitch} px");
        let rotation = (grid.rotation() - truth.rotation()).to_degrees();
        assert!(rotation.abs() < 0.005, "{name}: rotation off by {rotation}°");
        let rms = centres_rms(&grid, &truth);
        assert!(rms < 0.02, "{name}: centres off by {rms} px rms");
        assert!(grid.coherence > 0.99, "{name}: coherence {}", grid.coherence);
    }
}

#[test]
fn turned_frames_turn_the_grid() {
    let white = frame("referee/water_hexagonal_white.png");
    let upright = find_grid(&white, &GridOptions::default()).unwrap();
    // Transposed: rows become columns, and a rotation of +0.9° one of 30° − 0.9° by the array's symmetry.
    let (w, h) = (white.width(), white.height());
    let values = white.to_view();
    let turned: Vec<u8> = (0..w * h).map(|k| values[(k % h) * w + k / h]).collect();
    let grid = find_grid(&RawImage::from_u8(h, w, turned), &GridOptions::default()).unwrap();
    assert_eq!(grid.array, ArrayKind::Hexagonal);
    assert!((grid.pitch_px() - upright.pitch_px()).abs() < 1e-3);
    let expected = 30f64.to_radians() - upright.rotation();
    assert!((grid.rotation() - expected).abs().to_degrees() < 0.003, "{}", grid.rotation().to_degrees());
}

#[test]
fn real_white_frames_need_a_bent_grid() {
    // Affine figures from an independent fit; see the licence beside the frames for where they come from. Its rotation is
    // that of the rows; the columns of guv lean the other way by 0.016°, and a grid's rotation is the mean of both.
    let affine = GridOptions { degree_max: 1, ..GridOptions::default() };
    let cases = [
        ("seaurchin", [17.1973, 17.1976], 0.178, 0.177, [0.23, 0.05]),
        ("guv", [15.390, 15.412], -0.105, -0.116, [0.024, 0.005]),
    ];
    for (name, pitches, rows, rotation, [straight_px, bent_px]) in cases {
        let white = frame(&format!("real/{name}_white.tif"));
        let straight = find_grid(&white, &affine).unwrap();
        assert_eq!(straight.array, ArrayKind::Square);
        for (basis, expected) in straight.basis.iter().zip(pitches) {
            let pitch = basis[0].hypot(basis[1]);
            assert!((pitch - expected).abs() < 0.003, "{name}: {pitch} px");
        }
        let first = straight.basis[0][1].atan2(straight.basis[0][0]).to_degrees();
        assert!((first - rows).abs() < 0.005, "{name}: rows at {first}°");
        let mean = straight.rotation().to_degrees();
        assert!((mean - rotation).abs() < 0.005, "{name}: {mean}°");
        assert!(straight.residual_px < straight_px, "{name}: {} px", straight.residual_px);
        let bent = find_grid(&white, &GridOptions::default()).unwrap();
        println!("{name}: residual {:.4} px, scatter {:.4} px", bent.residual_px, bent.scatter_px);
        assert_eq!(bent.distortion.as_ref().map(|d| d.degree), Some(5), "{name}");
        assert!(bent.residual_px < bent_px, "{name}: {} px", bent.residual_px);
        // Single microlenses of seaurchin are off by 0.08 px; pixel noise alone would be 0.005.
        assert!(bent.scatter_px < 0.09, "{name}: {} px", bent.scatter_px);
    }
}

#[test]
fn a_known_grid_follows_the_image_distance() {
    for name in REFEREE {
        let truth = truth(name);
        let mut before = find_grid(&frame(&format!("referee/{name}_white.png")), &GridOptions::default()).unwrap();
        before.centre = [before.centre[0] + 1.6, before.centre[1] - 1.2];
        before.basis = before.basis.map(|b| b.map(|x| x * 1.003));
        let after = refine_grid(&frame(&format!("referee/{name}_white.png")), &before, None).unwrap();
        let rms = centres_rms(&after, &truth);
        assert!(rms < 0.02, "{name}: {rms} px rms");
    }
}

#[test]
fn textured_frames_place_a_known_grid() {
    // By the frame's own profile and by the white frame's, px rms: the board of black squares leaves half of the
    // micro-images dark.
    let cases = [
        ("air_square", 0.012, 0.012),
        ("water_hexagonal", 0.04, 0.01),
        ("water_clarity_e30", 0.01, 0.01),
        ("triple_air", 0.01, 0.01),
        ("air_charuco", 0.08, 0.04),
    ];
    for (name, by_its_own, by_the_white_one) in cases {
        let white = frame(&format!("referee/{name}_white.png"));
        let mut before = find_grid(&white, &GridOptions::default()).unwrap();
        let profile = Vignetting::from_white(&white, &before).unwrap();
        before.centre = [before.centre[0] + 1.6, before.centre[1] - 1.2];
        before.basis = before.basis.map(|b| b.map(|x| x * 0.997));
        let textured = frame(&format!("referee/{name}.png"));
        let own = centres_rms(&refine_grid(&textured, &before, None).unwrap(), &truth(name));
        let with = centres_rms(&refine_grid(&textured, &before, Some(&profile)).unwrap(), &truth(name));
        println!("{name} refined: {own:.4} and {with:.4} px rms");
        assert!(own < by_its_own && with < by_the_white_one, "{name}: {own} and {with} px rms");
    }
}

#[test]
fn textured_frames_have_their_array_found() {
    for name in REFEREE {
        let (grid, truth) = (find_grid(&frame(&format!("referee/{name}.png")), &GridOptions::default()), truth(name));
        let grid = grid.unwrap_or_else(|e| panic!("{name}: {e}"));
        let rms = centres_rms(&grid, &truth);
        println!(
            "{name} found: {rms:.4} px rms, pitch {:+.5}, coherence {:.3}",
            grid.pitch_px() - truth.pitch_px(),
            grid.coherence
        );
        assert_eq!(grid.array, truth.array, "{name}");
        assert!((grid.pitch_px() - truth.pitch_px()).abs() < 0.02, "{name}: {} px", grid.pitch_px());
        assert!((grid.rotation() - truth.rotation()).to_degrees().abs() < 0.02, "{name}: {}", grid.rotation());
        assert!(rms < 0.1, "{name}: {rms} px rms");
    }
}

fn picture(size: usize, level: impl Fn(f64, f64) -> f64, noise: f64) -> RawImage {
    let mut state = 7;
    let values = (0..size * size)
        .map(|k| {
            (level((k % size) as f64, (k / size) as f64) + noise * (random(&mut state) - 0.5)).clamp(0.0, 255.0) as u8
        })
        .collect();
    RawImage::from_u8(size, size, values)
}

#[test]
fn what_is_no_plenoptic_frame_is_refused() {
    let mut state = 3;
    let blobs: Vec<[f64; 4]> = (0..150)
        .map(|_| {
            [
                600.0 * random(&mut state),
                600.0 * random(&mut state),
                4.0 + 60.0 * random(&mut state).powi(3),
                40.0 * (random(&mut state) - 0.4),
            ]
        })
        .collect();
    let boxes: Vec<[f64; 5]> = (0..60)
        .map(|_| {
            [0, 1, 2, 3, 4].map(|k| {
                random(&mut state)
                    * if k < 2 {
                        600.0
                    } else if k < 4 {
                        120.0
                    } else {
                        220.0
                    }
            })
        })
        .collect();
    let clouds = |x: f64, y: f64| {
        blobs
            .iter()
            .fold(90.0, |s, b| s + b[3] * (-((x - b[0]).powi(2) + (y - b[1]).powi(2)) / (2.0 * b[2] * b[2])).exp())
    };
    let town = |x: f64, y: f64| {
        let on = |b: &&[f64; 5]| x > b[0] && x < b[0] + b[2] && y > b[1] && y < b[1] + b[3];
        boxes.iter().rev().find(on).map_or(30.0, |b| b[4])
    };
    let lattice = [
        ("noise", picture(600, |_, _| 128.0, 250.0)),
        ("slope", picture(600, |x, y| 0.2 * x + 0.1 * y, 4.0)),
        ("photograph of clouds", picture(600, clouds, 6.0)),
        ("photograph of a town", picture(600, town, 6.0)),
        ("stripes", picture(600, |x, _| 120.0 + 80.0 * (x * 0.3).sin(), 6.0)),
    ];
    for (name, image) in &lattice {
        let refused = find_grid(image, &GridOptions::default());
        println!("{name}: {refused:?}");
        assert!(matches!(refused, Err(GridError::NoLattice { .. } | GridError::Blank { .. })), "{name}: {refused:?}");
    }
    let dark = picture(600, |_, _| 2.0, 3.0);
    assert!(matches!(find_grid(&dark, &GridOptions::default()), Err(GridError::Blank { .. })));
    let bright = picture(600, |_, _| 300.0, 3.0);
    assert!(matches!(find_grid(&bright, &GridOptions::default()), Err(GridError::Saturated { .. })));
}

/// Narrow gaps have harmonics as strong as their fundamental, which a scene of large details drowns.
#[test]
fn no_harmonic_is_taken_for_the_pitch() {
    for pitch in [74.68, 41.3] {
        let mut state = 11;
        let waves: Vec<[f64; 4]> = (0..40)
            .map(|k| {
                let length = pitch * (0.5 + 0.06 * f64::from(k));
                let angle = std::f64::consts::TAU * random(&mut state);
                let wave = std::f64::consts::TAU / length;
                [wave * angle.cos(), wave * angle.sin(), std::f64::consts::TAU * random(&mut state), 0.06]
            })
            .collect();
        // Micro-images with square edges, each of which shows a part of the scene from beside its own place.
        let frame = picture(
            600,
            |x, y| {
                let cell = [x, y].map(|u| (u / pitch - 0.3).floor());
                let within = [0, 1].map(|k| [x, y][k] / pitch - 0.3 - cell[k]);
                if within.iter().any(|u| (u - 0.5).abs() > 0.475) {
                    return 3.0;
                }
                let at = [0, 1].map(|k| pitch * (0.3 + 0.7 * cell[k] + within[k]));
                110.0 * waves.iter().fold(1.0, |s, w| s + w[3] * (w[0] * at[0] + w[1] * at[1] + w[2]).sin() * 1.6)
            },
            5.0,
        );
        let grid = find_grid(&frame, &GridOptions::default()).unwrap();
        println!("{pitch} px: {:.3} px, coherence {:.3}", grid.pitch_px(), grid.coherence);
        assert!((grid.pitch_px() - pitch).abs() < 0.3, "{} for {pitch} px", grid.pitch_px());
    }
}

#[test]
fn frames_of_any_size_are_answered() {
    let white = frame("referee/air_square_white.png");
    let values = white.to_view();
    for (w, h) in
        [(1, 1), (1, 900), (900, 1), (2, 3), (31, 31), (32, 33), (40, 200), (97, 89), (130, 130), (211, 157), (900, 64)]
    {
        let part: Vec<u8> = (0..w * h).map(|k| values[(k / w) * 900 + k % w]).collect();
        let image = RawImage::from_u8(w, h, part);
        match find_grid(&image, &GridOptions::default()) {
            Ok(grid) => {
                assert!((grid.pitch_px() - truth("air_square").pitch_px()).abs() < 0.3, "{w}x{h}: {}", grid.pitch_px());
                assert!(grid.micro_images() >= 16, "{w}x{h}");
            }
            // Below five micro-images across, a refusal is the right answer.
            Err(e) => assert!(w.min(h) < 150, "{w}x{h}: {e}"),
        }
    }
}

#[test]
fn another_array_does_not_fit() {
    let square = find_grid(&frame("referee/air_square_white.png"), &GridOptions::default()).unwrap();
    let refused = refine_grid(&frame("referee/water_hexagonal_white.png"), &square, None);
    assert!(matches!(refused, Err(GridError::DoesNotFit { .. })), "{refused:?}");
    let refused = refine_grid(&frame("real/guv_white.tif"), &square, None);
    assert!(matches!(refused, Err(GridError::OtherFrameSize { .. })), "{refused:?}");
}

#[test]
fn a_covered_microlens_is_flagged() {
    let white = frame("referee/air_square_white.png");
    let grid = find_grid(&white, &GridOptions::default()).unwrap();
    let covered = grid.nearest(300.0, 400.0);
    let mut values = white.to_view();
    for y in 0..900 {
        for x in 0..900 {
            if (x as f64 - covered.x).hypot(y as f64 - covered.y) < 15.0 {
                values[y * 900 + x] = 12;
            }
        }
    }
    let dusty = RawImage::from_u8(900, 900, values);
    let grid = find_grid(&dusty, &GridOptions::default()).unwrap();
    let flagged: Vec<_> = lens_residuals(&dusty, &grid).unwrap().into_iter().filter(|r| r.contrast < 0.4).collect();
    assert_eq!(flagged.len(), 1, "{flagged:?}");
    let found = flagged[0].micro_image;
    assert!((found.x - covered.x).hypot(found.y - covered.y) < 0.1);
}
