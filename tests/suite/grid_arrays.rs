//! Arrays of every kind, pitch and rotation, found without being told.

use plenalign::imaging::grid::{GridOptions, find_grid};
use plenalign::optics::ArrayKind;

use super::rendered::{Rendered, centres_rms};

#[test]
fn white_frames_of_any_array_are_found() {
    use ArrayKind::{Hexagonal, Square};
    // Array, pitch in px, rotation in degrees (hexagonal at 30°: columns in place of rows), side of the frame in px.
    let cases = [
        (Square, 8.0, 0.3, 320),
        (Square, 11.3, 44.0, 256),
        (Square, 29.5, -31.0, 400),
        (Square, 64.7, 12.0, 640),
        (Square, 100.0, 0.0, 700),
        (Hexagonal, 8.0, 29.9, 320),
        (Hexagonal, 14.2, 3.0, 256),
        (Hexagonal, 29.5, 29.8, 400),
        (Hexagonal, 64.7, -17.0, 640),
        (Hexagonal, 100.0, 29.0, 700),
    ];
    let mut bad = Vec::new();
    for (array, pitch_px, rotation_deg, side) in cases {
        let frame =
            Rendered { array, pitch_px, rotation_deg, size: [side, side - 30], rays: 64, ..Rendered::default() };
        let truth = frame.grid();
        let grid = match find_grid(&frame.white(), &GridOptions::default()) {
            Ok(grid) => grid,
            Err(e) => {
                bad.push(format!("{array:?} {pitch_px} px at {rotation_deg}°: {e}"));
                continue;
            }
        };
        let (pitch, rotation) = (grid.pitch_px() - pitch_px, (grid.rotation() - truth.rotation()).to_degrees());
        let rms = centres_rms(&grid, &truth);
        println!(
            "{array:?} {pitch_px} px at {rotation_deg}°: pitch {pitch:+.5} px, rotation {rotation:+.5}°, centres {rms:.4} px, coherence {:.4}",
            grid.coherence
        );
        if grid.array != array || pitch.abs() > 0.002 || rotation.abs() > 0.005 || rms > 0.02 {
            bad.push(format!("{array:?} {pitch_px} px at {rotation_deg}°: {:?} {pitch} {rotation} {rms}", grid.array));
        }
    }
    assert!(bad.is_empty(), "{}", bad.join("\n"));
}
