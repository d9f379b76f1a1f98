//! The model against reference values computed by independent code, to 1e-9 relative.

use plenalign::optics::{ArrayKind, CameraDesign, MainLens, Mla, MlaMode, Shell, water};
use serde_json::Value;

const TOLERANCE: f64 = 1e-9;

fn vectors() -> Value {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/vectors.json");
    serde_json::from_str(&std::fs::read_to_string(path).expect(path)).expect(path)
}

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("no number {key} in {value}"))
}

fn list<'v>(value: &'v Value, key: &str) -> &'v [Value] {
    let list = value[key].as_array().unwrap_or_else(|| panic!("no list {key} in {value}"));
    assert!(!list.is_empty(), "{key} is empty");
    list
}

/// Asserts agreement to the tolerance, relative, with 1 µm as the least scale: an e of 0 has no relative error.
#[track_caller]
fn agree(what: &str, found: f64, expected: f64) {
    let error = (found - expected).abs() / expected.abs().max(1e-3);
    assert!(error <= TOLERANCE, "{what}: {found} instead of {expected}, off by {error:e}");
}

fn camera(input: &Value) -> CameraDesign {
    let mode = match input["mode"].as_str() {
        None => MlaMode::Galilean,
        Some("keplerian") => MlaMode::Keplerian,
        Some(other) => panic!("unknown mode {other}"),
    };
    let shell = &input["shell"];
    CameraDesign {
        main_lens: MainLens { focal_length: number(input, "f") },
        mla: Mla {
            array: ArrayKind::Square,
            pitch: number(input, "D_mla"),
            focal_length: number(input, "f_mla"),
            angular_resolution: number(input, "N"),
            mode,
        },
        shell: Shell {
            outer_radius: number(shell, "Ro"),
            inner_radius: number(shell, "Ri"),
            n_shell: number(shell, "ns"),
            n_water: number(shell, "nw"),
        },
        air_distance: number(input, "d_obj_air"),
        object_distance: number(input, "d_obj"),
    }
}

/// Every case with its camera, input and expectation.
fn cases() -> Vec<(CameraDesign, Value, Value)> {
    let vectors = vectors();
    let cases = list(&vectors, "cases");
    assert_eq!(cases.len(), 3);
    cases.iter().map(|case| (camera(&case["input"]), case["input"].clone(), case["expect"].clone())).collect()
}

#[test]
fn clarity_and_joint_solutions() {
    for (camera, input, expect) in cases() {
        let design = &expect["design"];
        for (name, solution) in [
            ("clarity", camera.clarity(number(&input, "e_initial"))),
            ("joint", camera.joint(number(&input, "l_bound"))),
        ] {
            let expected = &design[name];
            agree("e", solution.e, number(expected, "e"));
            agree("delta_v", solution.delta_v, number(expected, "delta_v"));
            agree("l_eq", solution.equivalent_distance, number(expected, "l_eq"));
            agree("v", solution.image_distance, number(expected, "v"));
            // The vectors give the aperture of the air design and its change.
            agree("D_aper", solution.aperture - solution.aperture_change, number(expected, "D_aper"));
            agree("delta_D_aper", solution.aperture_change, number(expected, "delta_D_aper"));
            agree("f_number_main", solution.main_lens_f_number, number(expected, "f_number_main"));
            agree("f_number_mla", camera.mla.f_number(), number(expected, "f_number_mla"));
        }
        agree("a", camera.mla.a().abs(), number(design, "a"));
        agree("b", camera.mla.b(), number(design, "b"));
        agree("v", camera.air_image_distance(), number(design, "v"));
        agree("l_target", camera.mla.target_spacing(), number(design, "l_target"));
    }
}

#[test]
fn equivalent_distances_and_back() {
    for (camera, _, expect) in cases() {
        for row in list(&expect, "equivalent_distance") {
            let (distance, e, expected) = (number(row, "d_obj"), number(row, "e"), number(row, "l_eq"));
            agree("l_eq", camera.shell.equivalent_distance(distance, e), expected);
            agree("d_obj", camera.shell.object_distance(expected, e), distance);
            agree("e", camera.shell.e_from_equivalent(expected, distance), e);
        }
    }
}

#[test]
fn fields_of_view_and_the_rim() {
    for (camera, input, expect) in cases() {
        let inner = number(&input, "fov_inner");
        for row in list(&expect, "fov_water_rad") {
            let fov = camera.shell.fov_in_water(inner, number(row, "e")).expect("the edge ray passes the shell");
            agree("fov", fov, number(row, "fov"));
        }
        agree("e_max", camera.shell.e_max(inner), number(&expect, "e_max"));
    }
}

#[test]
fn depths_of_field() {
    for (camera, input, expect) in cases() {
        let joint = camera.joint(number(&input, "l_bound"));
        let rows = expect["depth_of_field"].as_object().expect("depths of field by blur limit");
        assert_eq!(rows.len(), 3);
        for (limit, row) in rows {
            let depth =
                camera.depth_of_field(joint.delta_v, joint.e, limit.parse().unwrap()).expect("a sharp interval");
            agree("near", depth.near, number(row, "near"));
            agree("far", depth.far.expect("a finite far end"), number(row, "far"));
        }
    }
}

#[test]
fn spacings_against_e_and_back() {
    for (camera, input, expect) in cases() {
        let delta_v = camera.joint(number(&input, "l_bound")).delta_v;
        for row in list(&expect, "spacing_vs_e") {
            let (e, expected) = (number(row, "e"), number(row, "spacing"));
            let equivalent = camera.shell.equivalent_distance(camera.object_distance, e);
            agree("spacing", camera.spacing_at(equivalent, delta_v), expected);
            agree("e", camera.e_from_spacing(expected, delta_v), e);
            agree("delta_v", camera.delta_v_from_spacing(expected, equivalent), delta_v);
        }
    }
}

#[test]
fn the_least_e_from_a_spacing() {
    for (camera, _, expect) in cases() {
        let row = &expect["l_bound_from_spacing"];
        let found = camera.l_bound_from_spacing(number(row, "spacing"), number(row, "d"), number(row, "b"));
        agree("l_bound", found, number(row, "l_bound"));
    }
}

#[test]
fn the_index_of_water() {
    let vectors = vectors();
    for row in list(&vectors, "n_water") {
        let found = water::refractive_index(number(row, "t"), number(row, "s"), number(row, "nm")).unwrap();
        agree("n_water", found, number(row, "n"));
    }
}
