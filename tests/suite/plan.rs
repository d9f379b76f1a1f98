//! What an alignment will do, and what stands in its way: said before anything moves.

use std::process::Command;

use plenalign::config::{BoardTexture, BoardsInAir, Config, ConfigOrigin, LBoundSource, Side};
use plenalign::control::job::{JobKind, JobRequest, JobState};
use plenalign::control::plan::{PlanView, PlannedBoards};
use plenalign::optics::{ArrayKind, MlaMode};
use reqwest::Method;
use serde_json::{Value, json};

use super::bench::{run, service, small_config};
use super::daemon::Daemon;
use super::fakes::fakes;

fn plan(config: &Config) -> PlanView {
    PlanView::of(config, &ConfigOrigin::Preset)
}

#[track_caller]
fn close(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} instead of {expected}");
}

#[test]
fn the_preset_is_aligned_as_it_always_was() {
    let plan = plan(&Config::default());
    assert!(plan.possible, "{:?}", plan.obstacles);
    assert_eq!(plan.boards_in_air, PlannedBoards::TripleLevel);
    let places: Vec<f64> = plan.boards.iter().map(|board| board.distance_mm).collect();
    close(places[1], 167.17, 0.01);
    assert_eq!([places[1] - places[0], places[2] - places[1]].map(|step| (step * 1e6).round() / 1e6), [8.0, 8.0]);
    close(plan.boards[1].spacing_px, plan.spacing_target_px, 1e-9);
    close(plan.first_board_mm.unwrap(), places[1], 1e-9);
    assert_eq!((plan.mount_e_mm, plan.delta_v_tolerance_mm, plan.e_tolerance_mm), (30.0, 0.005, 0.1));
    close(plan.mount_spacing_px, 12.68, 0.01);
    close(plan.focus_probe_mm, 0.5, 0.01);
    close(plan.e_probe_mm, 0.5, 0.02);
    // The wall is 0.1 mm below what is aimed at; the axis may stand 0.2 mm and twice 5 % of its way from home beside its reading.
    close(plan.e_above_mm, 0.2 + 0.1 * 30.1 - 0.1, 1e-9);
    // A step changes the spacing by a tenth of the pitch, which is at 8.7 px a millimetre.
    close(plan.search_step_mm, 0.1 * 28.985 / 8.7, 0.005);
    // Near what the estimator says of such frames.
    assert!((0.002..0.003).contains(&plan.spacing_sigma_px), "{}", plan.spacing_sigma_px);
    close(plan.delta_v_sigma_mm, plan.spacing_sigma_px / 8.7, 1e-5);
    // Three of what e is good to lie between the lens and where it touches, half a millimetre beyond l_bound.
    let budget = plan.by_budget.unwrap();
    assert!((0.15..0.25).contains(&budget.e_sigma_mm) && (0.02..0.08).contains(&budget.delta_v_sigma_mm), "{budget:?}");
    // So do they where the axis's zero is known five times worse, or shell and board in the water are.
    let sigma_mm = |keys: &[(&str, &str)]| {
        let mut config = Config::default();
        config.set_all(keys.iter().copied()).unwrap();
        PlanView::of(&config, &ConfigOrigin::Preset).by_budget.unwrap().e_sigma_mm
    };
    let by_picture_mm = sigma_mm(&[("bench.e.zero_uncertainty_mm", "1")]);
    let by_axis_mm = sigma_mm(&[("uncertainty.shell_radii_mm", "0.25"), ("uncertainty.board_in_water_mm", "5")]);
    assert!(budget.e_sigma_mm < by_picture_mm.min(by_axis_mm), "{by_picture_mm} {by_axis_mm}");
    close(budget.e_held_off_mm, 3.0 * by_picture_mm.max(by_axis_mm) - 0.5, 0.02);
    let asked: Vec<&str> = plan.operator_steps.iter().map(|step| step.name.as_str()).collect();
    assert_eq!(asked, ["white_frame", "triple_board_in_air", "aperture", "shell_and_water"]);
}

/// Each kind that goes by a plan has its own steps in it, and is as long as what it does.
#[test]
fn the_parts_of_an_alignment_are_planned_too() {
    let mut config = Config::default();
    config.assembly.initial_e_mm = 25.0;
    let plan = plan(&config);
    let asked = |kind| -> Vec<&str> {
        let part = plan.parts.iter().find(|part| part.kind == kind).unwrap();
        assert!(part.obstacles.is_empty() && part.duration_s < plan.duration_s + 1.0, "{part:?}");
        part.operator_steps.iter().map(|step| step.name.as_str()).collect()
    };
    assert_eq!(asked(JobKind::AirOnly), ["white_frame", "triple_board_in_air", "aperture"]);
    assert_eq!(asked(JobKind::ShellOnly), ["shell_and_water"]);
    assert_eq!(asked(JobKind::LBoundMeasurement)[3..], ["least_e_by_hand", "shell_off"]);
    // Another Δv, another place of the boards, and e where the shell is mounted.
    let clarity = plan.parts.iter().find(|part| part.kind == JobKind::ClarityOnly).unwrap();
    assert_eq!(clarity.e_mm, Some(25.0));
    assert!(clarity.delta_v_mm < plan.delta_v_mm - 0.2, "{}", clarity.delta_v_mm);
    assert_ne!(clarity.operator_steps[1].value, plan.operator_steps[1].value);
    // What stands in the way of one kind need not in another's.
    config.bench.focus.high_limit_mm = plan_limit(&config);
    let plan = PlanView::of(&config, &ConfigOrigin::Preset);
    let in_the_way = |kind| !plan.parts.iter().find(|part| part.kind == kind).unwrap().obstacles.is_empty();
    assert!(!plan.possible && in_the_way(JobKind::AirOnly) && !in_the_way(JobKind::ClarityOnly), "{plan:?}");
}

/// A focus axis that goes far enough for e as it is mounted, and not for the joint solution.
fn plan_limit(config: &Config) -> f64 {
    let [clarity, joint] = [config.design().clarity(config.assembly.initial_e_mm), config.design().joint(0.0)];
    0.5 * (clarity.delta_v + joint.delta_v) + config.bench.focus.zero_uncertainty_mm + 0.2
}

/// The levels follow the camera: what lies between their spacings is the same share of its pitch.
#[test]
fn levels_lie_apart_by_what_the_camera_sees() {
    for (focal_length, resolution) in [(20.0, 3.13), (12.0, 3.13), (35.0, 3.13), (20.0, 5.0)] {
        let mut config = Config::default();
        config.main_lens.focal_length_mm = focal_length;
        config.mla.angular_resolution = resolution;
        config.bench.focus.high_limit_mm = 40.0;
        let plan = plan(&config);
        let pitch_px = 1000.0 * config.mla.pitch_mm / config.sensor.pixel_um;
        for pair in plan.boards.windows(2) {
            let apart = (pair[0].spacing_px - pair[1].spacing_px) / pitch_px;
            assert!((0.03..0.13).contains(&apart), "f {focal_length} N {resolution}: {apart} of the pitch, {plan:?}");
            // More than ten of the uncertainties that are expected.
            assert!(apart * pitch_px > 10.0 * plan.spacing_sigma_px);
        }
    }
}

#[test]
fn a_shell_is_mounted_where_the_picture_through_it_can_be_measured() {
    let mut config = Config::default();
    config.main_lens.focal_length_mm = 35.0;
    config.mla.angular_resolution = 2.4;
    config.bench.focus.high_limit_mm = 60.0;
    let plan = plan(&config);
    assert!(plan.possible, "{:?}", plan.obstacles);
    assert!(plan.mount_e_mm < 30.0 && plan.mount_e_mm > 0.3, "{}", plan.mount_e_mm);
    let pitch_px = 1000.0 * config.mla.pitch_mm / config.sensor.pixel_um;
    assert!(plan.mount_spacing_px > 0.35 * pitch_px, "{}", plan.mount_spacing_px);
    assert_eq!(plan.boards_in_air, PlannedBoards::FlatInTurn, "levels would not stay in range while e is moved");
}

/// What a configuration is refused for.
fn refused(change: impl FnOnce(&mut Config)) -> (String, String) {
    let mut config = Config::default();
    change(&mut config);
    config.validate().unwrap();
    let plan = plan(&config);
    assert!(!plan.possible);
    let first = &plan.obstacles[0];
    (first.key.clone(), first.needed.clone())
}

#[test]
fn what_stands_in_the_way_is_named_with_what_it_would_have_to_be() {
    let (key, needed) = refused(|config| config.bench.focus.high_limit_mm = 2.0);
    assert_eq!((key.as_str(), needed.as_str()), ("bench.focus.high_limit_mm", "at least 2.7"));
    let (key, _) = refused(|config| config.bench.focus.low_limit_mm = -0.5);
    assert_eq!(key, "bench.focus.low_limit_mm");
    let (key, needed) = refused(|config| config.boards.farthest_mm = 150.0);
    assert_eq!((key.as_str(), needed.as_str()), ("boards.farthest_mm", "at least 168"));
    let (key, _) = refused(|config| config.sensor.width_px = 200);
    assert_eq!(key, "sensor.width_px");
    let (key, _) = refused(|config| config.mla.angular_resolution = 1.5);
    assert_eq!(key, "mla.angular_resolution");
    let (key, _) = refused(|config| config.assembly.delta_v_tolerance_mm = Some(1e-4));
    assert_eq!(key, "assembly.delta_v_tolerance_mm");
    let (key, _) = refused(|config| {
        config.boards.in_air = BoardsInAir::TripleLevel;
        config.boards.level_step_mm = Some(0.05);
    });
    assert_eq!(key, "boards.in_air");
    let (key, needed) = refused(|config| config.boards.tank_mm = Some(700.0));
    assert_eq!((key.as_str(), needed.as_str()), ("boards.tank_mm", "at least 800, or object.distance_mm 700 at most"));
    let (key, needed) = refused(|config| config.boards.side_mm = Some(80.0));
    assert_eq!(key, "boards.side_mm");
    let side_mm: f64 = needed.trim_start_matches("at least ").parse().unwrap();
    let mut wide = Config::default();
    (wide.boards.side_mm, wide.boards.tank_mm) = (Some(side_mm), Some(800.0));
    assert!(plan(&wide).possible);
    let (key, needed) = refused(|config| config.bench.e.steps_per_mm = 10.0);
    assert_eq!((key.as_str(), needed.as_str()), ("bench.e.steps_per_mm", "at least 50"));
    let (key, needed) = refused(|config| config.bench.focus.max_step_mm = 0.4);
    assert_eq!((key.as_str(), needed.as_str()), ("bench.focus.max_step_mm", "at least 1.11"));
    // No tolerance is finer than a step of the axis.
    let (key, needed) = refused(|config| config.assembly.delta_v_tolerance_mm = Some(0.001));
    assert_eq!((key.as_str(), needed.as_str()), ("assembly.delta_v_tolerance_mm", "at least 0.0019"));
    for (step_mm, depth_mm) in [(2.0, 60.0), (8.0, 10.0)] {
        let (key, needed) = refused(|config| {
            config.boards.in_air = BoardsInAir::TripleLevel;
            (config.boards.level_step_mm, config.boards.greatest_depth_mm) = (Some(step_mm), depth_mm);
        });
        assert_eq!(key, "boards.in_air");
        // The step that is named serves.
        let other = needed.split_once("boards.level_step_mm ").map(|(_, other)| other.parse().unwrap());
        let mut config = Config::default();
        config.boards.in_air = BoardsInAir::TripleLevel;
        (config.boards.level_step_mm, config.boards.greatest_depth_mm) = (other, depth_mm);
        assert_eq!(plan(&config).possible, other.is_some(), "{needed}");
    }
    // What is asked for is enough.
    let mut enough = Config::default();
    enough.bench.focus.high_limit_mm = 2.7;
    assert!(plan(&enough).possible);
}

#[test]
fn what_is_on_the_boards_tells_what_a_spacing_is_expected_to_be_good_to() {
    let expected = |texture: BoardTexture, side_px: u32, noise_levels: f64| {
        let mut config = Config::default();
        config.boards.texture = texture;
        (config.sensor.width_px, config.sensor.height_px) = (side_px, side_px);
        config.bench.simulation.read_noise_levels = noise_levels;
        plan(&config)
    };
    let [natural, charuco, print] =
        [BoardTexture::Natural, BoardTexture::Charuco, BoardTexture::Print].map(|texture| expected(texture, 600, 8.0));
    for (plan, named) in [(&natural, "natural texture"), (&charuco, "ChArUco"), (&print, "print")] {
        assert!(plan.assumed.contains(&format!("boards with {named} (boards.texture)")), "{}", plan.assumed);
    }
    // ChArUco's edges are read through more noise; print's own bias is the most of what it is good to.
    let [natural, charuco, print] = [natural, charuco, print].map(|plan| plan.spacing_sigma_px);
    assert!(charuco < 0.6 * natural && natural < print, "{natural} {charuco} {print}");
    let bright = [BoardTexture::Natural, BoardTexture::Print].map(|texture| expected(texture, 2000, 1.0));
    assert!(bright[1].spacing_sigma_px > 2.5 * bright[0].spacing_sigma_px);
    assert!(bright[1].e_sigma_mm > bright[0].e_sigma_mm && bright[1].delta_v_sigma_mm > bright[0].delta_v_sigma_mm);
}

/// A job that cannot come to its end is not begun: nothing is homed and nobody is asked.
#[tokio::test(start_paused = true)]
async fn nothing_moves_for_what_is_refused() {
    for kind in [JobKind::JointAlignment, JobKind::AirOnly, JobKind::ClarityOnly, JobKind::LBoundMeasurement] {
        let mut config = small_config(1);
        config.bench.focus.high_limit_mm = 1.5;
        let service = service(config).await;
        let job = run(&service, JobRequest::of(kind)).await;
        let reason = job.reason.unwrap();
        assert_eq!(job.state, JobState::Failed, "{reason}");
        assert!(reason.contains("bench.focus.high_limit_mm is 1.5, and would have to be at least"), "{reason}");
        assert!(service.bench_view().axes.iter().all(|axis| !axis.homed), "{kind:?} homed an axis");
        assert!(!job.log.iter().any(|line| line.message.contains("operator step")), "{:?}", job.log);
    }
}

/// What a controller lets an axis travel less than is configured is missed before anybody is asked for anything.
#[tokio::test]
async fn a_travel_that_a_controller_cuts_short_is_told_beforehand() {
    for (key, focus, e) in [
        ("bench.focus.high_limit_mm", Some((-20.0, 1.5)), None),
        ("bench.focus.low_limit_mm", Some((-0.3, 60.0)), None),
        ("bench.e.high_limit_mm", None, Some((-20.0, 25.0))),
    ] {
        let fakes = fakes();
        *fakes.focus.limits_mm.lock().unwrap() = focus;
        *fakes.e.limits_mm.lock().unwrap() = e;
        let daemon = Daemon::start(fakes.bench).await;
        let view: Value = daemon.post("/api/v1/plan", &json!({})).await.json().await.unwrap();
        let found = &view["obstacles"][0];
        assert_eq!(found["key"], key, "{view}");
        assert!(found["value"].as_str().unwrap().contains("of which the axis's controller leaves"), "{found}");
        let begun: Value =
            daemon.command(Method::POST, "/api/v1/jobs", &json!({ "kind": "air_only" })).await.json().await.unwrap();
        let href = begun["href"].as_str().unwrap();
        let job = daemon.until(href, "failed", |job| job["state"] == "failed").await;
        assert!(job["reason"].as_str().unwrap().contains(key), "{job}");
        assert!(job["steps"].as_array().unwrap().is_empty(), "{job}");
        assert!(fakes.focus.told.lock().unwrap().is_empty() && fakes.e.told.lock().unwrap().is_empty());
    }
}

/// Where homing would run towards a shell that may be on, no other axis is homed before that is said.
#[tokio::test(start_paused = true)]
async fn nothing_is_homed_where_e_homes_towards_the_shell() {
    let mut config = small_config(1);
    (config.bench.e.home_side, config.bench.e.home_position_mm) = (Side::Low, -4.9);
    let service = service(config).await;
    let job = run(&service, JobRequest::of(JobKind::JointAlignment)).await;
    let reason = job.reason.unwrap();
    assert!(reason.contains("bench.e.home_side is \"low\", and would have to be \"high\""), "{reason}");
    assert!(service.bench_view().axes.iter().all(|axis| !axis.homed), "an axis was homed");
    assert!(!job.log.iter().any(|line| line.message.starts_with("homing")), "{:?}", job.log);
}

/// Cameras whose range of focus is short: that of N = 2.2 is left by 0.3 mm of Δv to one side, that of a Keplerian one of
/// N = 2.15 begins just beside focus.
fn of_short_range(mode: MlaMode) -> Config {
    let mut config = small_config(5);
    let (mla, shell) = (&mut config.mla, &mut config.shell);
    mla.mode = mode;
    match mode {
        MlaMode::Galilean => {
            config.main_lens.focal_length_mm = 28.0;
            (mla.pitch_mm, mla.focal_length_mm, mla.angular_resolution) = (0.13, 0.5, 2.2);
            (shell.outer_radius_mm, shell.inner_radius_mm) = (80.0, 72.0);
            (config.object.distance_mm, config.object.air_distance_mm) = (700.0, 900.0);
            config.sensor.pixel_um = 4.0;
            config.bench.simulation.lens_to_mla_error_mm = 0.2;
        }
        MlaMode::Keplerian => {
            config.main_lens.focal_length_mm = 40.0;
            mla.array = ArrayKind::Hexagonal;
            (mla.pitch_mm, mla.focal_length_mm, mla.angular_resolution) = (0.16, 0.6, 2.15);
            (shell.outer_radius_mm, shell.inner_radius_mm, shell.refractive_index) = (100.0, 92.0, 1.52);
            (config.object.distance_mm, config.object.air_distance_mm) = (1000.0, 1000.0);
            config.sensor.pixel_um = 5.0;
            config.bench.focus.high_limit_mm = 12.0;
        }
    }
    config
}

/// The job does what the plan said: as many steps of the operator, by the same names and values.
#[tokio::test(start_paused = true)]
async fn a_job_asks_for_what_its_plan_said() {
    let mut flat = small_config(2);
    flat.boards.in_air = BoardsInAir::FlatInTurn;
    let mut keplerian = small_config(3);
    keplerian.mla.mode = MlaMode::Keplerian;
    let mut measured = small_config(4);
    measured.assembly.l_bound = LBoundSource::Measure;
    let short = [MlaMode::Galilean, MlaMode::Keplerian].map(of_short_range);
    for config in [flat, keplerian, measured].into_iter().chain(short) {
        let planned = plan(&config);
        let job = run(&service(config).await, JobRequest::of(JobKind::JointAlignment)).await;
        assert_eq!(job.state, JobState::Converged, "{:?}", job.reason);
        let asked: Vec<&str> =
            job.log.iter().map(|line| &*line.message).filter(|line| line.contains("confirmed")).collect();
        assert_eq!(asked.len(), planned.operator_steps.len(), "{asked:?} {planned:?}");
        let said = job.log.iter().map(|line| &*line.message).filter(|line| line.starts_with("operator step"));
        let said: Vec<&str> = said.filter(|line| !line.contains("confirmed")).collect();
        for (step, said) in planned.operator_steps.iter().zip(said) {
            let named = step.name.replace('_', " ");
            let value = step.value.as_deref().map_or(&*named, |value| value.split([' ', ',']).next().unwrap());
            assert!(said.contains(value), "{step:?}: {said}");
        }
        assert!(job.log.iter().any(|line| line.message.starts_with("plan: Δv = ")), "{:?}", job.log);
    }
}

#[test]
fn the_command_says_it_and_ends_by_it() {
    let plenalign = |arguments: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_plenalign")).arg("plan").args(arguments).output().expect("the program starts")
    };
    let output = plenalign(&[]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && text.contains("Nothing stands in the way."), "{text}");
    assert!(text.contains("three levels side by side") && text.contains("at 159.2 mm: spacing "), "{text}");
    let output = plenalign(&["--json", "--set", "bench.focus.high_limit_mm=2"]);
    let view: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(view["obstacles"][0]["key"], "bench.focus.high_limit_mm");
}

#[tokio::test]
async fn it_is_served_for_the_camera_in_force_and_for_drafts() {
    let daemon = Daemon::start(fakes().bench).await;
    let ask = async |body: Value| -> Value {
        let response = daemon.post("/api/v1/plan", &body).await;
        assert_eq!(response.status(), 200);
        response.json().await.unwrap()
    };
    let in_force = ask(json!({})).await;
    assert_eq!(in_force["boards_in_air"], "triple_level");
    let flat = ask(json!({ "boards": { "in_air": "flat_in_turn" } })).await;
    assert_eq!(flat["boards_in_air"], "flat_in_turn");
    let places: Vec<&Value> = flat["boards"].as_array().unwrap().iter().map(|board| &board["distance_mm"]).collect();
    assert_eq!(places.len(), 3);
    let refused = daemon.post("/api/v1/plan", &json!({ "boards": { "in_air": "none" } })).await;
    assert_eq!(refused.status(), 409);
}

/// More clearance, or a bench of which more is known, lets the lens go as near as it is wanted; less keeps it away.
#[test]
fn the_lens_stays_clear_by_what_e_is_expected_to_be_good_to() {
    let held_off = |keys: &[(&str, &str)]| {
        let mut config = Config::default();
        config.set_all(keys.iter().copied()).unwrap();
        plan(&config).by_budget.unwrap().e_held_off_mm
    };
    let none = held_off(&[("assembly.clearance_mm", "0")]);
    close(none - held_off(&[]), 0.5, 0.02);
    assert_eq!(held_off(&[("assembly.clearance_mm", "1")]), 0.0);
    let known = [("uncertainty.water_index", "1e-4"), ("uncertainty.board_in_water_mm", "0.1")];
    assert!(held_off(&known) < held_off(&[]));
    // A contact that is measured is uncertain itself.
    assert!(held_off(&[("assembly.l_bound", "\"measure\"")]) > held_off(&[]));
}
