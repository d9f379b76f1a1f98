//! `plenalign measure` and `plenalign calibrate` as a user runs them.

// Helpers of tests may panic as tests do.
#![allow(clippy::unwrap_used)]

use std::process::{Command, Output};

use serde_json::Value;

/// The program's output, run where the referee's frames are.
pub(super) fn plenalign(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_plenalign"))
        .args(arguments)
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/referee"))
        .output()
        .unwrap()
}

/// The object that it prints.
pub(super) fn json(arguments: &[&str]) -> Value {
    let output = plenalign(arguments);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn measure_prints_one_object() {
    let arguments = ["measure", "air_charuco.png", "--white", "air_charuco_white.png", "--json"];
    let report = json(&arguments);
    let number = |path: &str| report.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("{path}"));
    assert_eq!(report["grid"]["array"], "square");
    assert!((number("/grid/pitch_px") - 29.4926).abs() < 0.002);
    assert!((number("/grid/rotation_deg") - 0.25).abs() < 0.005);
    assert!(number("/grid/micro_images") > 800.0 && number("/grid/residual_px") >= 0.0);
    assert!(number("/white/micro_images") > 800.0 && report["white"]["flagged"].as_array().is_some_and(Vec::is_empty));
    assert!(report["grid"]["centre_px"].as_array().is_some_and(|c| c.len() == 2));
    assert!((number("/spacing/on_axis_px") - 19.6121).abs() < 0.01);
    for key in ["tilt_x_px", "tilt_y_px", "curvature_px", "row_column_px", "diagonal_px", "pairs", "covariance_px2/6/6"]
    {
        number(&format!("/spacing/{key}"));
    }
    let sigma = |kind: &str| number(&format!("/spacing/on_axis_sigma{kind}_px"));
    assert!(sigma("") >= sigma("_random") && sigma("_random") < 2.0 * sigma("_bound") && sigma("_bound") > 1e-5);
    assert_eq!(report["spacing"]["mode"], "galilean");
    assert!(report["spacing"].get("lenses").is_none());
    assert!((number("/targets/paraxial_px") - 19.725).abs() < 0.001 && report["targets"]["window_px"].is_null());
    assert!((number("/target_px") - 19.725).abs() < 0.001);
    assert_eq!(report["in_focus"], true);
    assert!(report["object_distance_mm"].is_null() && report["object_distance_reason"].is_string());
    // 900 px, not the configured 1160: reported, not refused.
    assert!(report["warnings"].to_string().contains("900x900"));
    let air = json(&[&arguments[..], &["--delta-v", "0", "--air"]].concat());
    let distance = air["object_distance_mm"].as_f64().unwrap();
    assert!((distance - 820.0).abs() < 2.0, "{distance}");
    assert!(air["object_distance_reason"].is_null());
}

#[test]
fn measure_draws_what_it_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("found.png");
    let overlay = path.to_str().unwrap();
    let frame = ["measure", "air_square.png", "air_square.png", "--white", "air_square_white.png"];
    let report = json(&[&frame[..], &["--overlay", overlay, "--json", "--lenses"]].concat());
    let lenses = report["spacing"]["lenses"].as_array().unwrap();
    let matched: Vec<&Value> = lenses.iter().filter(|lens| lens["state"] == "matched").collect();
    assert!(matched.len() > 600 && matched.len() as u64 == report["spacing"]["micro_images"]["matched"]);
    let spacing = report["spacing"]["on_axis_px"].as_f64().unwrap();
    for lens in matched {
        let own = lens["spacing_px"].as_f64().unwrap();
        assert!((own - spacing).abs() < 0.1 + 5.0 * lens["sigma_px"].as_f64().unwrap(), "{lens}");
    }
    assert_eq!(report["frames"], 2);
    let picture = image::open(&path).unwrap().into_rgb8();
    assert_eq!(picture.dimensions(), (900, 900));
    let coloured = picture.pixels().filter(|p| p.0[0].abs_diff(p.0[2]) > 20).count();
    assert!(coloured > 20_000, "{coloured}");
    let refused = plenalign(&[&frame[..], &["--overlay", "found.jpg"]].concat());
    assert!(!refused.status.success() && String::from_utf8_lossy(&refused.stderr).contains("ends in .png"));
}

#[test]
fn measure_refuses_a_mode_that_is_configured_otherwise() {
    let frame = ["measure", "air_charuco.png", "--white", "air_charuco_white.png"];
    let output = plenalign(&[&frame[..], &["--set", "mla.mode=keplerian"]].concat());
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success(), "{error}");
    assert!(
        error.contains("match at 19.6") && error.contains("no spacing of the configured Keplerian mode"),
        "{error}"
    );
}

#[test]
fn a_refused_frame_has_its_grid_printed() {
    let frame = ["measure", "air_square_white.png", "--white", "air_square_white.png"];
    let refused = plenalign(&frame);
    let (text, error) = [&refused.stdout, &refused.stderr].map(|b| String::from_utf8_lossy(b).into_owned()).into();
    assert!(!refused.status.success() && text.contains("pitch            29.49") && text.contains("noise"), "{text}");
    assert!(error.trim_end().lines().count() == 1 && error.contains("air_square_white.png: spacing: "), "{error}");
    let refused = plenalign(&[&frame[..], &["--json"]].concat());
    let known: Value = serde_json::from_slice(&refused.stdout).unwrap();
    assert!((known["grid"]["pitch_px"].as_f64().unwrap() - 29.4926).abs() < 0.002, "{known}");
    assert!((known["noise_grey_levels"].as_f64().unwrap() / 2.0 - 1.0).abs() < 0.15, "{known}");
    assert!(!refused.status.success() && known["refused"].as_str().unwrap().starts_with("spacing: "), "{known}");
}

/// Whatever a frame is refused for, what comes before that is printed.
#[test]
fn what_is_known_of_a_refused_frame_is_printed_whatever_it_is_refused_for() {
    let folder = tempfile::tempdir().unwrap();
    let blank = folder.path().join("blank.png");
    image::GrayImage::from_pixel(900, 900, image::Luma([40])).save(&blank).unwrap();
    let blank = blank.to_str().unwrap();
    let known = |arguments: &[&str]| -> Value {
        let refused = plenalign(&[&["measure", "air_square.png", "--json"], arguments].concat());
        assert!(!refused.status.success(), "{arguments:?}");
        serde_json::from_slice(&refused.stdout).unwrap()
    };
    for (arguments, said) in [
        // Another pitch, a white frame that is none, and one of another array.
        (&["--white", "air_square_white.png", "--set", "sensor.pixel_um=2.4"][..], "does not belong to an MLA pitch"),
        (&["--white", blank], "blank"),
        (&["--white", "water_hexagonal_white.png"], "the known grid no longer fits"),
    ] {
        let known = known(arguments);
        assert!(known["refused"].as_str().unwrap().contains(said), "{arguments:?}: {known}");
        assert!((known["grid"]["pitch_px"].as_f64().unwrap() - 29.4926).abs() < 0.01, "{arguments:?}: {known}");
        assert!(known["noise_grey_levels"].as_f64().is_some_and(|noise| noise > 1.0), "{arguments:?}: {known}");
    }
}

#[test]
fn grid_finds_micro_images_alone() {
    let report = json(&["grid", "air_square_white.png", "water_hexagonal.png", "--json"]);
    for (frame, (array, pitch)) in [("square", 29.4926), ("hexagonal", 29.441)].iter().enumerate() {
        let grid = &report["frames"][frame]["grid"];
        assert_eq!(grid["array"], *array, "{report}");
        assert!((grid["pitch_px"].as_f64().unwrap() - pitch).abs() < 0.01, "{report}");
    }
    let nothing = plenalign(&["grid", "air_square_white.png", "--pitch", "20"]);
    let text = String::from_utf8_lossy(&nothing.stdout).into_owned();
    assert!(!nothing.status.success() && text.contains("between 18 and 22 px pitch"), "{text}");
    assert!(text.contains("noise            "), "{text}");
    let text = plenalign(&["grid", "air_charuco.png"]);
    assert!(text.status.success() && String::from_utf8_lossy(&text.stdout).contains("square, 8"), "{text:?}");
}

#[test]
fn measure_gives_the_distance_in_water() {
    let report = json(&[
        "measure",
        "water_clarity_e30.png",
        "--white",
        "water_clarity_e30_white.png",
        "--delta-v",
        "1.744839625",
        "--e",
        "30",
        "--json",
    ]);
    let distance = report["object_distance_mm"].as_f64().unwrap();
    assert!((distance - 800.0).abs() < 3.0, "{distance}");
}

#[test]
fn calibrate_doubts_distances_that_the_boards_did_not_have() {
    let arguments = ["calibrate", "triple_air.png", "--white", "triple_air_white.png", "--json", "--levels"];
    let warnings = |levels: &str| -> String {
        let report = json(&[&arguments[..], &[levels]].concat());
        report["warnings"].as_array().unwrap().iter().map(Value::to_string).collect()
    };
    let wrong = warnings("700,800,900");
    assert!(wrong.contains("do not lie on one line") && wrong.contains("b = 0.15"), "{wrong}");
    let right = warnings("159.174586,167.174586,175.174586");
    assert!(!right.contains("--levels"), "{right}");
}

#[test]
fn a_set_key_is_checked_as_in_a_file_and_an_error_is_said_once() {
    for (arguments, said) in [
        (&["design", "--set", "mla.pitch_m=1"][..], "mla.pitch_m: unknown key"),
        (&["design", "--set", "mla.pitch_mm"], "expected KEY=VALUE"),
        (&["--config", "none.toml", "design"], "No such file or directory"),
        (&["measure", "none.png"], "No such file or directory"),
    ] {
        let output = plenalign(arguments);
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && error.matches(said).count() == 1, "{arguments:?}: {error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
    let report = json(&["design", "--json", "--set", "object.distance_mm=900", "--set", "mla.mode=keplerian"]);
    assert_eq!(report["origin"], "reference preset, inferred from Table 2, with overrides");
}

#[test]
fn calibrate_prints_one_object() {
    let report = json(&[
        "calibrate",
        "triple_air.png",
        "--white",
        "triple_air_white.png",
        "--levels",
        "159.174586,167.174586,175.174586",
        "--json",
    ]);
    for key in ["d_mm", "d_sigma_mm", "b_mm", "b_sigma_mm"] {
        assert!(report[key].as_f64().is_some_and(|v| v > 0.0), "{key}");
    }
    let v = report["image_distance_mm"].as_f64().unwrap();
    assert!((v - 22.722_820_5).abs() < 0.003, "{v}");
    let levels = report["levels"].as_array().unwrap();
    assert_eq!(levels.len(), 3);
    assert!((levels[0]["spacing_px"].as_f64().unwrap() - 20.8767).abs() < 0.05);
    assert!(levels[0]["sigma_px"].is_number() && levels[0]["distance_mm"].is_number());
}

#[test]
fn calibrate_finds_the_distance_that_the_boards_have_in_common() {
    let boards = ["calibrate", "triple_air.png", "--white", "triple_air_white.png", "--levels", "-8,0,8"];
    let further = ["--unknown-distance", "--micro-image-pitch=white", "--json"];
    let report = json(&[&boards[..], &further].concat());
    let number = |path: &str| report.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("{path}"));
    let (shift, sigma) = (number("/distance_shift_mm"), number("/distance_shift_sigma_mm"));
    assert!((shift - 167.174_586).abs() < 3.0 * sigma && sigma < 3.0, "{shift} ± {sigma}");
    assert!((number("/levels/0/distance_mm") - shift + 8.0).abs() < 1e-9);
    let v = number("/image_distance_mm");
    assert!((v - 22.722_820_5).abs() < 3.0 * number("/image_distance_sigma_mm"), "{v}");
    assert!(
        (number("/micro_image_pitch/measured_px") - 29.440_885).abs() < 3.0 * number("/micro_image_pitch/sigma_px")
    );
    assert!((number("/micro_image_pitch/fitted_px") - 29.440_885).abs() < 0.001);
    assert!((number("/covariance_mm2/0/0") / number("/d_sigma_mm").powi(2) - 1.0).abs() < 1e-9);
    for path in ["/covariance_mm2/1/1", "/chi_squared", "/degrees_of_freedom", "/field_px/2", "/levels/0/residual_mm"] {
        number(path);
    }
    assert!(number("/condition") >= 1.0 && report["focal_length_mm"].is_null());
}

#[test]
fn text_is_for_people() {
    let output = plenalign(&["measure", "air_charuco.png", "--white", "air_charuco_white.png"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && text.contains("spacing") && text.contains("in focus"), "{text}");
}

#[test]
fn mistakes_get_one_line_on_standard_error() {
    for (arguments, part) in [
        (&["measure", "missing.png"][..], "missing.png"),
        (&["measure", "truth.json"], "truth.json"),
        (&["measure", "air_square.png", "--delta-v", "NaN"], "--delta-v"),
        (&["calibrate", "triple_air.png", "--levels", "700"], "at least 2"),
        (&["calibrate", "triple_air.png", "--levels", "700,700,800"], "700"),
        (&["calibrate", "triple_air.png", "--levels", "15,700,800"], "15 mm"),
        (&["calibrate", "triple_air.png", "--levels", "-8,0", "--unknown-distance"], "at least 3"),
        (
            &[
                "calibrate",
                "triple_air.png",
                "--white",
                "triple_air_white.png",
                "--levels",
                "-8,0,8",
                "--unknown-distance",
            ],
            "the boards' distance, b and d cannot be told apart",
        ),
        (
            &["calibrate", "triple_air.png", "--white", "triple_air_white.png", "--levels", "159,167,175", "--fit-f"],
            "f, b and d cannot be told apart from spacings against distance alone",
        ),
        (&["calibrate", "triple_air.png", "--levels", "159,167,175", "--sigma-f", "-1"], "uncertainty of f of -1"),
        (&["calibrate", "triple_air.png", "--levels", "159,167,175", "--micro-image-pitch=white"], "needs --white"),
    ] {
        let output = plenalign(arguments);
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success() && output.stdout.is_empty(), "{arguments:?}");
        assert!(error.trim_end().lines().count() == 1 && error.contains(part), "{arguments:?}: {error}");
    }
}
