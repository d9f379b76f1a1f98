//! Drafts of a camera over the API: worked out, and refused where no camera can be like that.

use plenalign::config::Config;
use serde_json::{Value, json};

use super::daemon::{Daemon, problem};
use super::fakes::fakes;

async fn daemon() -> Daemon {
    Daemon::start(fakes().bench).await
}

async fn draft(daemon: &Daemon, body: Value) -> Value {
    let response = daemon.post("/api/v1/design", &body).await;
    assert_eq!(response.status(), 200);
    response.json().await.unwrap()
}

fn state<'d>(draft: &'d Value, name: &str) -> &'d Value {
    draft["states"].as_array().unwrap().iter().find(|state| state["state"] == name).unwrap()
}

#[track_caller]
fn close(found: &Value, expected: f64, tolerance: f64) {
    let number = found.as_f64().unwrap_or_else(|| panic!("{found} is no number"));
    assert!((number - expected).abs() <= tolerance, "{number} instead of {expected}");
}

#[tokio::test]
async fn nothing_said_is_the_camera_in_force() {
    let daemon = daemon().await;
    let draft = draft(&daemon, json!({})).await;
    let design: Value = daemon.get("/api/v1/design").await.json().await.unwrap();
    assert_eq!(draft["design"], design);
    assert_eq!(draft["obstacles"], json!([]));
    assert_eq!(draft["config"]["mla"]["pitch_mm"], 0.1);
    assert!(draft["config"].get("bench").is_none());
    close(&state(&draft, "joint")["delta_v_mm"], 2.205, 5e-4);
    close(&state(&draft, "joint")["e_mm"], 0.0, 0.0);
    close(&state(&draft, "joint")["blur_px"], 0.0, 1e-9);
    close(&state(&draft, "clarity")["delta_v_mm"], 1.745, 5e-4);
    close(&state(&draft, "clarity")["board_width_mm"], 188.5, 0.1);
    let reference = state(&draft, "reference");
    assert_eq!((&reference["e_mm"], &reference["e_tolerance"]), (&Value::Null, &Value::Null));
    close(&reference["board_width_mm"], 161.8, 0.05);
    // Nothing optimised: the object is far from sharp, and no distance is.
    let direct = state(&draft, "direct");
    assert!(direct["blur_px"].as_f64().unwrap() > 3.0, "{direct}");
    assert_eq!((&direct["depth_of_field"], &direct["reoptimise"]), (&Value::Null, &Value::Null));
}

#[tokio::test]
async fn what_is_beyond_the_depth_of_field_needs_another_delta_v() {
    let daemon = daemon().await;
    let draft = draft(&daemon, json!({})).await;
    let joint = state(&draft, "joint");
    let near = joint["depth_of_field"]["near_mm"].as_f64().unwrap();
    let there = self::draft(&daemon, json!({ "object": { "distance_mm": near } })).await;
    let needed = joint["reoptimise"]["near_delta_v_mm"].as_f64().unwrap();
    close(&state(&there, "joint")["delta_v_mm"], needed, 1e-9);
    assert!(needed > joint["delta_v_mm"].as_f64().unwrap());
}

#[tokio::test]
async fn the_curves_pass_through_the_solutions_and_the_rays_through_the_camera() {
    let daemon = daemon().await;
    let draft = draft(&daemon, json!({ "assembly": { "initial_e_mm": 25 } })).await;
    let e: Vec<f64> = serde_json::from_value(draft["over_e"]["e_mm"].clone()).unwrap();
    assert_eq!((e[0], e[e.len() - 1]), (-5.0, 30.0));
    for list in ["delta_v_mm", "fov_deg"] {
        assert_eq!(draft["over_e"][list].as_array().unwrap().len(), e.len());
    }
    let distances: Vec<f64> = serde_json::from_value(draft["over_distance"]["distance_mm"].clone()).unwrap();
    let middle = distances.len() / 2;
    close(&json!(distances[middle]), 800.0, 1e-9);
    close(&draft["over_distance"]["joint_px"][middle], 0.0, 1e-9);
    close(&draft["over_distance"]["direct_px"][middle], state(&draft, "direct")["blur_px"].as_f64().unwrap(), 1e-9);
    let joint = state(&draft, "joint");
    let rays = joint["rays"].as_array().unwrap();
    assert_eq!(rays.len(), 9);
    let d = joint["lens_to_mla_mm"].as_f64().unwrap();
    for ray in rays {
        let points = ray["points_mm"].as_array().unwrap();
        close(&points[1][0], -d, 1e-9);
        close(&points[5][0], 59.0 + 800.0, 1e-9);
    }
}

#[tokio::test]
async fn a_draft_changes_what_it_says_and_keeps_nothing() {
    let daemon = daemon().await;
    let thick = draft(
        &daemon,
        json!({ "shell": { "outer_radius_mm": 80 }, "water": { "temperature_c": 20,
        "salinity_permille": 35, "wavelength_nm": 550 } }),
    )
    .await;
    assert_eq!(thick["config"]["shell"]["outer_radius_mm"], 80.0);
    assert_eq!(thick["config"]["shell"]["inner_radius_mm"], 51.0);
    close(&thick["design"]["water_refractive_index"], 1.34, 5e-3);
    let config: Value = daemon.get("/api/v1/config").await.json().await.unwrap();
    assert_eq!(config["config"]["shell"]["outer_radius_mm"], 59.0);
}

#[tokio::test]
async fn the_preset_is_there_to_be_compared_with() {
    let mut config = Config::default();
    config.main_lens.focal_length_mm = 25.0;
    let daemon = Daemon::start_with(config, fakes().bench).await;
    let (own, preset) = (draft(&daemon, json!({})).await, draft(&daemon, json!({ "base": "preset" })).await);
    assert_eq!(own["config"]["main_lens"]["focal_length_mm"], 25.0);
    assert_eq!(preset["config"]["main_lens"]["focal_length_mm"], 20.0);
    assert_eq!(preset["design"]["origin"], "reference preset, inferred from Table 2");
}

#[tokio::test]
async fn what_is_connected_is_listed_by_names_to_be_configured() {
    let found: Value = daemon().await.get("/api/v1/devices").await.json().await.unwrap();
    let ports = found["serial_ports"].as_array().unwrap();
    for device in found["cameras"].as_array().unwrap().iter().chain(ports) {
        let names = device["names"].as_array().unwrap();
        assert_eq!(names.last(), Some(&device["path"]), "{device}");
    }
    assert_eq!(found["notes"], json!([]));
}

#[tokio::test]
async fn an_interface_on_which_no_camera_can_be_looked_for_is_said() {
    let mut config = Config::default();
    config.bench.camera.interfaces = vec!["no-such-interface".to_owned()];
    let daemon = Daemon::start_with(config, fakes().bench).await;
    let found: Value = daemon.get("/api/v1/devices").await.json().await.unwrap();
    let note = found["notes"][0].as_str().unwrap();
    assert!(note.contains("no network interface \"no-such-interface\""), "{note}");
}

#[tokio::test]
async fn what_the_bench_cannot_reach_is_worked_out_and_said() {
    let daemon = daemon().await;
    let draft = draft(&daemon, json!({ "assembly": { "initial_e_mm": 40 } })).await;
    close(&state(&draft, "clarity")["e_mm"], 40.0, 0.0);
    assert_eq!(draft["obstacles"][0]["key"], "assembly.initial_e_mm");
}

#[tokio::test]
async fn impossible_cameras_are_named_key_by_key() {
    let daemon = daemon().await;
    for (body, keys) in [
        (json!({ "shell": { "inner_radius_mm": 60 } }), vec!["shell.inner_radius_mm"]),
        (json!({ "mla": { "pitch_mm": -1 }, "sensor": { "pixel_um": 0 } }), vec!["mla.pitch_mm", "sensor.pixel_um"]),
        (json!({ "object": { "air_distance_mm": 20 } }), vec!["object.air_distance_mm"]),
        (json!({ "mla": { "angular_resolution": 100 } }), vec!["mla.angular_resolution"]),
        (json!({ "assembly": { "initial_e_mm": -52 } }), vec!["assembly.initial_e_mm"]),
        (json!({ "mla": { "pich_mm": 1 } }), vec!["mla.pich_mm"]),
        (json!({ "mla": { "pitch_mm": "wide" } }), vec!["mla.pitch_mm"]),
        (json!({ "water": { "temperature_c": 20 } }), vec!["water.salinity_permille", "water.wavelength_nm"]),
        (json!({ "sensor": { "pixel_um": 1e-320 } }), vec!["sensor.pixel_um"]),
        (json!({ "mla": { "pitch_mm": 1e308 } }), vec!["mla.pitch_mm"]),
    ] {
        let refused = problem(daemon.post("/api/v1/design", &body).await, 409, "design-impossible").await;
        let found: Vec<_> = refused["problems"].as_array().unwrap().iter().map(|one| one["key"].clone()).collect();
        assert_eq!(found, keys, "{body}: {refused}");
    }
    for body in [json!({ "bench": {} }), json!({ "mla": 7 }), json!({ "base": "mine" })] {
        problem(daemon.post("/api/v1/design", &body).await, 422, "invalid").await;
    }
}
