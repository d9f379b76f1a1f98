//! `plenalign design` as a user meets it.

use std::process::{Command, Output};

use serde_json::Value;

fn plenalign(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_plenalign")).args(arguments).output().expect("the program starts")
}

fn design(config: Option<&str>) -> Value {
    let folder = tempfile::tempdir().expect("a scratch folder with a plain name");
    let file = folder.path().join("bench.toml");
    let mut arguments = vec!["design", "--json"];
    if let Some(text) = config {
        std::fs::write(&file, text).expect("a scratch folder with a plain name");
        arguments.extend(["--config", file.to_str().expect("a scratch folder with a plain name")]);
    }
    let output = plenalign(&arguments);
    assert!(output.status.success() && output.stderr.is_empty(), "{output:?}");
    serde_json::from_slice(&output.stdout).expect("one JSON object and nothing else")
}

#[track_caller]
fn close(found: &Value, expected: f64, tolerance: f64) {
    let number = found.as_f64().unwrap_or_else(|| panic!("{found} is no number"));
    assert!((number - expected).abs() <= tolerance, "{number} instead of {expected}");
}

#[test]
fn json_has_every_figure_of_the_preset() {
    let design = design(None);
    assert_eq!(design["origin"], "reference preset, inferred from Table 2");
    let (clarity, joint) = (&design["clarity"], &design["joint"]);
    close(&clarity["delta_v_mm"], 1.744_839_625_027, 1e-9);
    close(&clarity["e_mm"], 30.0, 0.0);
    close(&joint["delta_v_mm"], 2.205_040_030_733, 1e-9);
    close(&joint["e_mm"], 0.0, 0.0);
    close(&joint["equivalent_distance_mm"], 167.174_585_888, 1e-8);
    close(&joint["image_distance_mm"], 22.717_860_543_6, 1e-9);
    close(&joint["aperture_mm"], 6.364, 5e-4);
    close(&joint["aperture_change_mm"], 0.648_054_018_4, 1e-9);
    close(&joint["main_lens_f_number"], 3.569_911_260, 1e-8);
    close(&joint["aperture_ring_f_number"], 3.143, 5e-4);
    close(&design["air"]["half_width_mm"], 80.9, 0.06);
    close(&design["direct"]["half_width_mm"], 102.6, 0.06);
    close(&design["direct"]["fov_water_deg"], 13.32, 6e-3);
    close(&clarity["half_width_mm"], 94.2, 0.06);
    close(&joint["half_width_mm"], 78.2, 0.06);
    close(&clarity["fov_inner_deg"], 10.62, 6e-3);
    close(&clarity["fov_water_deg"], 12.25, 6e-3);
    close(&joint["fov_inner_deg"], 10.40, 6e-3);
    close(&joint["fov_water_deg"], 10.40, 6e-3);
    close(&design["mla"]["a_mm"], 1.065, 1e-9);
    close(&design["mla"]["b_mm"], 0.340_255_591, 1e-8);
    close(&design["mla"]["f_number"], 3.402_555_911, 1e-8);
    close(&design["spacing_target_px"], 19.725, 5e-4);
    close(&design["depth_resolution_mm"][0], 87.5, 0.06);
    close(&design["depth_resolution_mm"][1], 29.2, 0.06);
    close(&design["depth_resolution_water_mm"][0], 109.6, 0.06);
    // 51 mm over the tangent of half the field of the sensor's diagonal: 4.002 mm × √2 / 2 at d + b = 21.993 mm.
    close(&design["e_max_mm"], 51.0 * 21.993_116 / (2.001 * std::f64::consts::SQRT_2), 1e-3);
    close(&design["water_refractive_index"], 1.333, 0.0);
    // Both ends have a blur of one pixel; the vectors hold 1.5 and 3 µm, and 6 µm.
    let depth = &design["depth_of_field"];
    let (near, far) = (depth["near_mm"].as_f64().unwrap(), depth["far_mm"].as_f64().unwrap());
    assert!((498.6..631.7).contains(&near) && (1019.7..1318.5).contains(&far), "{depth}");
    let tolerance = &design["e_tolerance"];
    assert!(tolerance["low_mm"].as_f64().unwrap() < 0.0 && tolerance["high_mm"].as_f64().unwrap() > 0.0, "{tolerance}");
}

#[test]
fn infinity_is_null() {
    let design = design(Some("[assembly]\nblur_limit_px = 7\n"));
    assert_eq!(design["depth_of_field"]["far_mm"], Value::Null);
    assert!(design["depth_of_field"]["near_mm"].is_number());
}

#[test]
fn l_bound_and_water_are_the_configurations() {
    let design = design(Some(
        "[assembly]\nl_bound_mm = 4.5\n[water]\ntemperature_c = 20\nsalinity_permille = 35\nwavelength_nm = 589.3\n",
    ));
    close(&design["joint"]["e_mm"], 4.5, 0.0);
    close(&design["water_refractive_index"], 1.339_405_917_647, 1e-11);
    assert!(!design["origin"].as_str().unwrap().contains("Table 2"), "{design}");
}

#[test]
fn text_has_a_table_with_units_and_names_the_preset() {
    let output = plenalign(&["design"]);
    assert!(output.status.success());
    let text = String::from_utf8(output.stdout).unwrap();
    for words in [
        "reference preset, inferred from Table 2",
        "2.2050",
        "1.7448",
        "19.725 px",
        "12.25",
        "f/3.40",
        "joint (half widths: air 80.9",
    ] {
        assert!(text.contains(words), "{words:?} is not in\n{text}");
    }
}

#[test]
fn a_bad_configuration_is_one_line_on_standard_error() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bad.toml");
    std::fs::write(&file, "[shell]\ninner_radius_mm = 70\n").unwrap();
    let output = plenalign(&["design", "--json", "--config", file.to_str().unwrap()]);
    assert!(!output.status.success() && output.stdout.is_empty(), "{output:?}");
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(text.lines().count(), 1, "{text}");
    assert!(text.contains("line 2, column 19: shell.inner_radius_mm: 70 mm is not less than"), "{text}");
    let missing = plenalign(&["design", "--config", "/nonexistent.toml"]);
    assert!(!missing.status.success() && String::from_utf8(missing.stderr).unwrap().contains("/nonexistent.toml"));
}
