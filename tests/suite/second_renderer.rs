//! The spacing estimator against the second renderer, which shares nothing with this program: `tests/second-renderer` has
//! its rays, what proves it, and what each frame tries.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use plenalign::imaging::measurement::{FrameMeasurement, FrameOptions, MeasurementError, WhiteModel, measure_frame};
use plenalign::imaging::spacing::{SpacingError, SpacingOptions};
use plenalign::optics::MlaMode;
use plenalign::raw::{self, CfaPattern, RawImage};
use serde_json::Value;

/// Frames that ought to be measured or refused otherwise than they are, and how they fail. One that is measured right has
/// to leave the list.
const NOT_YET: &[(&str, &str)] = &[("blur_far_12", "refused: the grid is said to have changed")];

/// Frames of which no number may come, each for its own reason.
const NO_NUMBER: &[&str] =
    &["texture_bars", "texture_sine", "texture_flat", "texture_step", "range_2", "range_38", "range_small_1"];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/second")
}

fn picture(name: &Value) -> RawImage {
    raw::read(&folder().join(name.as_str().unwrap())).unwrap()
}

/// The exact spacing on the axis, averaged over a window of this radius, px.
fn exact(board: &Value, window_px: f64) -> f64 {
    let by_radius = board["spacing_exact_by_radius_px"].as_object().unwrap();
    let mut table: Vec<(f64, f64)> =
        by_radius.iter().filter_map(|(radius, spacing)| Some((radius.parse().unwrap(), spacing.as_f64()?))).collect();
    table.sort_by(|a, b| a.0.total_cmp(&b.0));
    let after = table.iter().position(|(radius, _)| *radius > window_px).unwrap_or(table.len() - 1).max(1);
    let [(r0, s0), (r1, s1)] = [table[after - 1], table[after]];
    s0 + (s1 - s0) * ((window_px - r0) / (r1 - r0)).min(1.0)
}

/// The measurement of a camera of which the mode is known, or of any.
fn measured(truth: &Value, mode: Option<MlaMode>) -> Result<FrameMeasurement, MeasurementError> {
    let pitch = truth["mla_pitch_mm"].as_f64().unwrap() / (truth["pixel_um"].as_f64().unwrap() / 1000.0);
    let mosaic = (truth["sensor"]["bayer"] == "RGGB").then_some(CfaPattern::Rggb);
    let spacing = SpacingOptions { mode, ..SpacingOptions::new(pitch) };
    let options = FrameOptions { spacing, mosaic, ..FrameOptions::new(pitch) };
    let white = WhiteModel::of(&picture(&truth["white"]), &options)?;
    measure_frame(&picture(&truth["frame"]), Some(&white), &options)
}

fn frames() -> BTreeMap<String, Value> {
    let text = std::fs::read_to_string(folder().join("truth.json")).unwrap();
    let all: Value = serde_json::from_str(&text).unwrap();
    serde_json::from_value(all["frames"].clone()).unwrap()
}

#[test]
fn frames_of_another_renderer_measure_within_three_sigma_or_are_known() {
    let frames = frames();
    let (mut right, mut squares, mut wrong) = (0, 0.0, Vec::new());
    // A board in the whole field: what several come to has a spacing each.
    for (name, truth) in frames.iter().filter(|(_, truth)| truth["boards"].as_array().unwrap().len() == 1) {
        let outcome = measured(truth, None).map(|measured| {
            let spacing = measured.spacing;
            assert_eq!(spacing.two_boards, None, "{name} shows one board");
            (spacing.on_axis_px - exact(&truth["boards"][0], spacing.window_px)) / spacing.sigma_px
        });
        let excused = NOT_YET.iter().any(|(known, _)| known == name);
        match outcome {
            Ok(sigmas) if NO_NUMBER.contains(&name.as_str()) => {
                wrong.push(format!("{name}: a number, {sigmas:+.1} sigma"));
            }
            Err(_) if NO_NUMBER.contains(&name.as_str()) => {}
            Ok(sigmas) if sigmas.abs() < 3.0 && excused => {
                wrong.push(format!("{name} is right now: take it off the list"));
            }
            Ok(sigmas) if sigmas.abs() < 3.0 => {
                right += 1;
                squares += sigmas * sigmas;
            }
            Ok(sigmas) if !excused => wrong.push(format!("{name}: {sigmas:+.1} sigma")),
            Err(why) if !excused => wrong.push(format!("{name}: {why}")),
            Ok(_) | Err(_) => {}
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(right >= 50, "{right} frames were measured");
    // Neither too sure nor too modest.
    let rms = (squares / f64::from(right)).sqrt();
    assert!((0.6..1.3).contains(&rms), "rms error over sigma: {rms:.2} of {right}");
}

#[test]
fn boards_side_by_side_are_told_from_one() {
    let frames = frames();
    for name in ["two_boards", "step_tenth", "step_tenth_left"] {
        let spacing = measured(&frames[name], None).unwrap().spacing;
        let two = spacing.two_boards.unwrap();
        let mut truths = [0, 1].map(|k| exact(&frames[name]["boards"][k], spacing.window_px));
        let mut found = two.spacings_px;
        truths.sort_by(f64::total_cmp);
        found.sort_by(f64::total_cmp);
        println!("{name}: {found:.4?} px for {truths:.4?}");
        assert!((0..2).all(|k| (found[k] - truths[k]).abs() < 0.035), "{name}: {found:?} for {truths:?}");
    }
}

/// What repeats within a micro-image matches at several spacings, of which a mode may have one only.
#[test]
fn a_known_mode_tells_the_spacing_from_rivals_of_the_other() {
    let frames = frames();
    let galilean = |name: &str| measured(&frames[name], Some(MlaMode::Galilean));
    let ambiguous = measured(&frames["texture_sine"], None);
    assert!(
        matches!(ambiguous, Err(MeasurementError::Spacing(SpacingError::Ambiguous { second_px, .. })) if second_px > 29.0),
        "{ambiguous:?}"
    );
    for name in ["texture_sine", "texture_checkerboard"] {
        let spacing = galilean(name).unwrap().spacing;
        let error = spacing.on_axis_px - exact(&frames[name]["boards"][0], spacing.window_px);
        assert!(error.abs() < 3.0 * spacing.sigma_px && spacing.sigma_px < 0.01, "{name}: {error:+.4} px, {spacing:?}");
    }
    let bars = galilean("texture_bars");
    assert!(
        matches!(bars, Err(MeasurementError::Spacing(SpacingError::OneDirection { along_rows: true }))),
        "{bars:?}"
    );
    let other = measured(&frames["texture_charuco"], Some(MlaMode::Keplerian));
    let Err(MeasurementError::Spacing(SpacingError::OtherMode { spacing_px, mode: MlaMode::Keplerian, .. })) = other
    else {
        panic!("{other:?}")
    };
    assert!((spacing_px - 19.6).abs() < 0.1, "{spacing_px} px");
}
