//! Microlenses that are not as the others are: flagged where they are dead, missing or dirty, and no others.

use std::collections::BTreeMap;
use std::path::Path;

use plenalign::imaging::grid::{GridOptions, find_grid};
use plenalign::imaging::microlenses::{FlaggedMicrolens, MicrolensFlag, flagged_microlenses};
use plenalign::imaging::vignetting::Vignetting;
use plenalign::optics::ArrayKind;
use plenalign::raw::{self, RawImage};
use plenalign::sim::flaws::{Flaws, MicrolensFlaws, MicrolensState};

use super::rendered::{Rendered, centres_rms};

fn flagged(white: &RawImage) -> Vec<FlaggedMicrolens> {
    let grid = find_grid(white, &GridOptions::default()).unwrap();
    let vignetting = Vignetting::from_white(white, &grid).unwrap();
    flagged_microlenses(white, &grid, &vignetting)
}

#[test]
fn dead_and_dirty_microlenses_are_flagged_and_clean_ones_are_not() {
    for array in [ArrayKind::Square, ArrayKind::Hexagonal] {
        // About 400 micro-images; the renderer counts its microlenses from another place, so that they are compared by
        // number and by where they are seen to be dark.
        let microlenses =
            MicrolensFlaws { seed: 4, dead_share: 0.03, dirty_share: 0.05, dirty_transmission: [0.3, 0.85] };
        let flaws = Flaws { microlenses, ..Flaws::default() };
        let offset = [0.0, 0.0];
        let frame =
            Rendered { array, size: [600, 600], rotation_deg: 0.0, offset, rays: 16, flaws, ..Rendered::default() };
        let (white, truth) = (frame.white(), frame.grid());
        let found: BTreeMap<[i32; 2], MicrolensFlag> =
            flagged(&white).iter().map(|f| (truth.index_of(f.centre_px[0], f.centre_px[1]), f.flag)).collect();
        let mut count = [0; 2];
        for m in truth.micro_images_within(truth.pitch_px() / 2.0) {
            let wanted = match microlenses.state([m.i, m.j]) {
                MicrolensState::Clean => None,
                MicrolensState::Dead => Some(MicrolensFlag::Dead),
                MicrolensState::Dirty { mean, .. } if mean < 0.4 => continue,
                MicrolensState::Dirty { .. } => Some(MicrolensFlag::Dirty),
            };
            assert_eq!(found.get(&[m.i, m.j]).copied(), wanted, "{array:?} {m:?}");
            count[0] += usize::from(wanted == Some(MicrolensFlag::Dead));
            count[1] += usize::from(wanted == Some(MicrolensFlag::Dirty));
        }
        assert!(count[0] > 5 && count[1] > 8, "{array:?}: {count:?} to be found");
        let grid = find_grid(&white, &GridOptions::default()).unwrap();
        let rms = centres_rms(&grid, &truth);
        assert!(rms < 0.02, "{array:?}: their grid is off by {rms} px rms");
    }
}

#[test]
fn a_hole_in_the_array_is_a_missing_microlens() {
    let frame = Rendered { size: [500, 500], rays: 16, ..Rendered::default() };
    let (white, truth) = (frame.white(), frame.grid());
    let hole = truth.nearest(210.0, 300.0);
    let mut values = white.to_view();
    for y in 0..500 {
        for x in 0..500 {
            if (x as f64 - hole.x).hypot(y as f64 - hole.y) < 0.5 * truth.pitch_px() {
                values[y * 500 + x] = 140;
            }
        }
    }
    let found = flagged(&RawImage::from_u8(500, 500, values));
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(found[0].flag, MicrolensFlag::Missing);
    assert!((found[0].centre_px[0] - hole.x).hypot(found[0].centre_px[1] - hole.y) < 0.1);
}

#[test]
fn few_of_a_real_array_are_flagged() {
    for name in ["seaurchin", "guv"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/real/{name}_white.tif"));
        let white = raw::read(&path).unwrap();
        let found = flagged(&white);
        let all = find_grid(&white, &GridOptions::default()).unwrap().micro_images();
        println!("{name}: {} of {all} flagged: {:?}", found.len(), found.iter().take(8).collect::<Vec<_>>());
        assert!(found.len() * 20 < all, "{name}: {} of {all}", found.len());
    }
}

#[test]
fn alternating_microlenses_are_one_array() {
    for (array, focal_factors) in [(ArrayKind::Square, [0.85, 1.15, 1.0]), (ArrayKind::Hexagonal, [0.85, 1.0, 1.15])] {
        for rotation_deg in [0.6, 29.0] {
            let frame =
                Rendered { array, rotation_deg, focal_factors, size: [600, 600], rays: 16, ..Rendered::default() };
            let (white, truth) = (frame.white(), frame.grid());
            for (what, image) in [("white", white), ("textured", frame.textured(plenalign::config::Texture::Natural))] {
                let grid = find_grid(&image, &GridOptions::default()).unwrap();
                let rms = centres_rms(&grid, &truth);
                println!("{array:?} {rotation_deg}° {what}: pitch {:.3} px, {rms:.4} px rms", grid.pitch_px());
                assert_eq!(grid.array, array);
                assert!((grid.pitch_px() - 29.5).abs() < 0.1, "{array:?} {what}: {} px", grid.pitch_px());
            }
        }
    }
}
