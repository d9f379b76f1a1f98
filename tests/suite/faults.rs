//! What is made to go wrong with the simulated bench, and what the program then says.

use std::sync::Arc;
use std::time::Duration;

use plenalign::config::Config;
use plenalign::control::events::{Event, ShellState};
use plenalign::control::job::steps::StepState;
use plenalign::control::job::{JobKind, JobRequest, JobSnapshot, JobState, OperatorStep};
use plenalign::control::{Refusal, Service, ServiceError, Shown, open_bench};
use plenalign::device::faults::{Faults, PictureFault};
use plenalign::device::{AxisName, StageState};
use plenalign::units::Millimetres;
use reqwest::Method;
use serde_json::{Value, json};
use tokio::task::JoinHandle;

use super::bench::{align, key_and_permit, permit, run, service, small_config};
use super::daemon::{Daemon, problem};
use super::fakes::fakes;

const FAULTS: &str = "/api/v1/simulation/faults";
const PLAN: &str = "/api/v1/simulation/fault-plan";

/// A joint alignment on a bench with which something is wrong from the beginning.
async fn aligned_with(change: impl FnOnce(&mut Faults)) -> JobSnapshot {
    let service = service(small_config(9)).await;
    let mut faults = Faults::default();
    change(&mut faults);
    service.bench().simulated.as_ref().unwrap().set_faults(faults);
    align(&service).await
}

/// Whether the job failed, and says one of these words of why.
fn failed_naming(job: &JobSnapshot, words: &[&str]) {
    let reason = job.reason.as_deref().unwrap_or_default();
    assert_eq!(job.state, JobState::Failed, "{reason}\n{:#?}", job.log);
    assert!(words.iter().any(|word| reason.contains(word)), "{words:?} is not in: {reason}");
    assert_eq!(job.report.as_ref().unwrap().truth.as_ref().unwrap()["touched_shell"], false);
}

#[tokio::test(start_paused = true)]
async fn pictures_that_cannot_be_measured_are_named() {
    let with = |picture| aligned_with(move |faults| faults.camera.picture = picture);
    failed_naming(&with(PictureFault::Dark).await, &["blank", "dark"]);
    failed_naming(&with(PictureFault::Saturated).await, &["saturated", "overexposed"]);
    let blurred = with(PictureFault::Blurred).await;
    assert_ne!(blurred.state, JobState::Converged, "{:?}", blurred.reason);
}

#[tokio::test(start_paused = true)]
async fn a_camera_that_is_gone_or_hangs_is_named() {
    failed_naming(&aligned_with(|faults| faults.camera.unplugged = true).await, &["camera is not connected"]);
    failed_naming(&aligned_with(|faults| faults.camera.frozen = true).await, &["same to the last pixel"]);
}

/// What hangs while the diffuser is put on would be taken for the white frame.
#[tokio::test(start_paused = true)]
async fn a_white_frame_is_asked_for_again_where_the_camera_gave_an_old_picture() {
    let service = service(small_config(9)).await;
    let bench = service.bench().clone();
    // Somebody looks, so that there is a picture of before.
    let mut readings = service.bench().camera.live();
    readings.changed().await.unwrap();
    let freeze = move |frozen| {
        let mut faults = Faults::default();
        faults.camera.frozen = frozen;
        bench.simulated.as_ref().unwrap().set_faults(faults);
    };
    let thaw = freeze.clone();
    let frozen = at_step("Put the diffuser", &service, move || freeze(true));
    let thawed = at_step("The camera gave an old picture again", &service, move || thaw(false));
    let job = align(&service).await;
    assert_eq!(job.state, JobState::Converged, "{:?}\n{:#?}", job.reason, job.log);
    frozen.await.unwrap();
    thawed.await.unwrap();
    assert_eq!(job.steps.iter().filter(|step| step.name == "white_frame").count(), 2);
}

#[tokio::test(start_paused = true)]
async fn a_stage_that_does_not_do_as_it_is_told_is_named() {
    failed_naming(&aligned_with(|faults| faults.serial.unplugged = true).await, &["controller"]);
    failed_naming(&aligned_with(|faults| faults.focus.limit_switch = true).await, &["alarm", "limit"]);
    failed_naming(&aligned_with(|faults| faults.focus.stalled = true).await, &["hom"]);
}

/// A switch that changes while nothing moves: nobody knows whose way it ends, and once the stop that the alarm asks for has been
/// made and reset, only homing is left.
#[tokio::test(start_paused = true)]
async fn a_limit_switch_that_changes_at_rest_is_put_down_to_no_motion() {
    let service = service(small_config(9)).await;
    let homed = async || {
        let job = run(&service, JobRequest::of(JobKind::Homing)).await;
        assert_eq!(job.state, JobState::Succeeded, "{:?}", job.reason);
    };
    homed().await;
    let (hand, mut focus) = (service.bench().simulated.clone().unwrap(), service.bench().focus.state());
    service.move_axis(&permit(&service), AxisName::Focus, Millimetres(1.0)).await.unwrap();
    focus.wait_for(|state| state.moving).await.unwrap();
    focus.wait_for(|state| !state.moving && state.at_rest_since.is_some()).await.unwrap();
    let mut faults = Faults::default();
    faults.e.limit_switch = true;
    hand.set_faults(faults);
    let alarmed = focus.wait_for(|state| state.fault.is_some()).await.unwrap().fault.clone().unwrap();
    assert!(alarmed.contains("limit switch") && !alarmed.contains("on its way"), "{alarmed}");
    service.stop(tokio::time::Instant::now(), "a test").await;
    service.reset_stop("a test", "tried").await.unwrap();
    hand.set_faults(Faults::default());
    let locked = |state: &StageState| state.fault.as_deref() == Some("the controller is locked until it is homed");
    for axis in [&service.bench().focus, &service.bench().e] {
        axis.state().wait_for(locked).await.unwrap();
    }
    homed().await;
}

/// A stage's adapter pulled out of a running job and put back: the job ends with the reason, nothing goes on by itself,
/// and the axes' places are unknown.
#[tokio::test(start_paused = true)]
async fn an_adapter_unplugged_in_a_job_ends_it() {
    let service = service(small_config(9)).await;
    let bench = service.bench().clone();
    let hand = bench.simulated.clone().unwrap();
    let mut faults = Faults::default();
    faults.serial.unplugged = true;
    let pull = tokio::spawn(async move {
        let mut e = bench.e.state();
        e.wait_for(|state| state.homed).await.unwrap();
        e.wait_for(|state| state.moving).await.unwrap();
        hand.set_faults(faults);
    });
    let job = align(&service).await;
    pull.await.unwrap();
    failed_naming(&job, &["controller", "connect"]);
    service.bench().simulated.as_ref().unwrap().set_faults(Faults::default());
    let mut state = service.bench().e.state();
    let back = tokio::time::timeout(Duration::from_secs(60), state.wait_for(|state| state.connected)).await;
    assert!(!back.expect("it connects again").unwrap().homed);
}

/// The line out and back while the operator has the diffuser in hand: the controller has lost where both axes stand.
#[tokio::test(start_paused = true)]
async fn axes_lost_while_the_white_frame_is_waited_for_are_homed_both() {
    let service = service(small_config(9)).await;
    let bench = service.bench().clone();
    let mut events = service.subscribe();
    let homed_last = tokio::spawn(async move {
        let mut doing = Vec::new();
        loop {
            let Ok(Event::Job { job }) = events.recv().await else { continue };
            if job.log.iter().any(|line| line.message.contains("is not known: it is homed")) {
                doing.push(job.progress.doing);
            }
            if job.state.is_final() {
                return doing;
            }
        }
    });
    let lost = at_step("Put the diffuser on", &service, move || {
        bench.focus.forget_position();
        bench.e.forget_position();
    });
    let job = align(&service).await;
    lost.await.unwrap();
    assert_eq!(job.state, JobState::Converged, "{:?}\n{:#?}", job.reason, job.log);
    for axis in ["focus", "e"] {
        let homed = format!("where the {axis} axis stands is not known: it is homed");
        assert!(job.log.iter().any(|line| line.message == homed), "{:#?}", job.log);
    }
    let doing = homed_last.await.unwrap();
    for axis in ["focus", "e"] {
        assert!(doing.contains(&format!("homing the {axis} axis")), "{doing:?}");
    }
}

/// An alignment whose operator is the test: `at` is called at each of its events, with the prompt where that is a new one and
/// what it is answered with, and says whether it is confirmed then.
async fn prompted(
    service: &Arc<Service>,
    mut at: impl AsyncFnMut(&JobSnapshot, Option<&OperatorStep>, Shown<'_>) -> bool,
) -> JobSnapshot {
    let mut events = service.subscribe();
    let (key, permit) = key_and_permit(service);
    let shown = Shown { lease: Some(&key), ..Shown::default() };
    let id = service.create_job(&permit, JobRequest::of(JobKind::JointAlignment)).await.unwrap().id;
    let mut answered = 0;
    loop {
        let Event::Job { job } = events.recv().await.unwrap() else { continue };
        if job.id == id && job.state.is_final() {
            return service.job(id).unwrap();
        }
        let step = job.operator_step.as_ref().filter(|step| step.number > answered);
        let confirms = at(&job, step, shown).await;
        if let Some(step) = step {
            answered = step.number;
            if confirms {
                service.confirm(id, answered, shown).await.unwrap();
            }
        }
    }
}

/// A small bench without an operator of its own.
async fn unattended() -> Arc<Service> {
    let mut config = small_config(9);
    config.bench.simulation.operator_confirms = false;
    service(config).await
}

/// Has the camera show something else.
fn show(service: &Service, picture: PictureFault) {
    let mut faults = Faults::default();
    faults.camera.picture = picture;
    service.bench().simulated.as_ref().unwrap().set_faults(faults);
}

/// Once something has been measured in air, nobody mounts the shell for a job that has lost where it stands.
#[tokio::test(start_paused = true)]
async fn a_job_that_loses_an_axis_at_a_prompt_ends_there() {
    let service = unattended().await;
    let job = prompted(&service, async |_, step, _| {
        let mounts = step.is_some_and(|step| step.name == "shell_and_water");
        if mounts {
            service.bench().e.forget_position();
        }
        !mounts
    })
    .await;
    failed_naming(&job, &["where the e axis stands was lost while the operator was at work"]);
    assert_eq!(job.operator_step, None);
    assert_ne!(service.bench_view().shell, ShellState::On);
}

/// What was measured before the light went out counts, and the board that was put up again is measured by itself.
#[tokio::test(start_paused = true)]
async fn a_light_that_goes_out_amid_the_air_step_costs_nothing_but_a_prompt_once_more() {
    let (service, mut dark) = (unattended().await, Vec::new());
    let job = prompted(&service, async |job, step, _| {
        if step.is_some_and(|step| step.because.is_some()) {
            dark.push(job.iterations.len());
            show(&service, PictureFault::None);
        } else if dark.is_empty() && job.iterations.len() == 2 {
            show(&service, PictureFault::Dark);
        }
        true
    })
    .await;
    assert_eq!(job.state, JobState::Converged, "{:?}\n{:#?}", job.reason, job.log);
    assert_eq!(dark.len(), 1, "{dark:?}");
    assert!(!job.iterations.iter().any(|iteration| iteration.discarded), "{:#?}", job.iterations);
    assert!(!job.log.iter().any(|line| line.message.contains("sharpness")), "{:#?}", job.log);
}

/// Noise is sharp as well: no axis is led by it, and nobody is told to change what is right.
#[tokio::test(start_paused = true)]
async fn what_is_asked_for_in_the_dark_is_asked_for_again() {
    let (service, mut dark) = (unattended().await, Vec::new());
    let job = prompted(&service, async |_, step, _| {
        let Some(step) = step else { return false };
        let first = step.because.is_none();
        if first {
            dark.push(step.number);
        } else if let Some(because) = &step.because {
            assert!(because.contains("rame is blank") && step.instruction.starts_with(because), "{step:?}");
            assert_eq!(step.repeats, dark.last().copied(), "{step:?}");
        }
        show(&service, if first { PictureFault::Dark } else { PictureFault::None });
        true
    })
    .await;
    assert_eq!(job.state, JobState::Converged, "{:?}\n{:#?}", job.reason, job.log);
    assert!(dark.len() >= 4, "{dark:?}");
    for step in job.steps.iter().filter(|step| step.number.is_some_and(|number| dark.contains(&number))) {
        assert_eq!(step.state, StepState::Repeated, "{step:?}");
    }
    assert!(!job.log.iter().any(|line| line.message.contains("sharpness")), "{:#?}", job.log);
}

#[tokio::test(start_paused = true)]
async fn where_it_stays_dark_nothing_is_blamed_but_that() {
    for place in ["board_in_air", "aperture", "shell_and_water"] {
        let service = unattended().await;
        let job = prompted(&service, async |_, step, _| {
            let Some(step) = step else { return false };
            show(&service, if step.name.ends_with(place) { PictureFault::Dark } else { PictureFault::None });
            true
        })
        .await;
        failed_naming(&job, &["frame is blank"]);
        assert!(!job.reason.as_ref().unwrap().contains("initial_e_mm"), "{:?}", job.reason);
        let ways = job.log.iter().filter(|line| line.message.contains("on to"));
        assert_eq!(ways.count(), 0, "an axis was led by noise: {:#?}", job.log);
        let asked = job.steps.iter().filter(|step| step.name.ends_with(place) && step.number.is_some());
        assert_eq!(asked.count(), 3, "{:#?}", job.steps);
    }
}

/// What comes next would be measured in the old picture, and the job would end at it.
#[tokio::test(start_paused = true)]
async fn no_prompt_is_confirmed_while_the_camera_gives_an_old_picture_again() {
    let (service, mut prompts) = (unattended().await, 0);
    let job = prompted(&service, async |job, step, shown| {
        let Some(&OperatorStep { number, .. }) = step else { return false };
        let mut frozen = Faults::default();
        frozen.camera.frozen = true;
        service.bench().simulated.as_ref().unwrap().set_faults(frozen);
        for _ in 0..2 {
            let refused = service.confirm(job.id, number, shown).await.unwrap_err();
            assert!(matches!(refused, ServiceError::Refused(Refusal::OldPicture)), "{refused:?}");
            assert_eq!(service.job(job.id).unwrap().operator_step.unwrap().number, number, "it waits for it still");
        }
        show(&service, PictureFault::None);
        prompts += 1;
        true
    })
    .await;
    assert_eq!(job.state, JobState::Converged, "{:?}\n{:#?}", job.reason, job.log);
    assert!(prompts >= 4, "{prompts} prompts");
}

#[tokio::test]
async fn faults_are_set_and_read_over_the_api() {
    let config = Arc::new(small_config(1));
    let daemon = Daemon::start(open_bench(&config).await.unwrap()).await;
    let read = || async { daemon.get(FAULTS).await.json::<Value>().await.unwrap() };
    assert_eq!(read().await, json!(Faults::default()));
    let put = |body: Value| daemon.request(Method::PUT, FAULTS).json(&body).send();
    let set = put(json!({ "camera": { "unplugged": true }, "e": { "slip_share": 0.1 } })).await.unwrap();
    assert_eq!(set.status(), 200);
    let now = read().await;
    assert_eq!((&now["camera"]["unplugged"], &now["e"]["slip_share"]), (&json!(true), &json!(0.1)));
    let seen = daemon.until("/api/v1/bench", "offline", |bench| bench["camera"]["online"] == false).await;
    assert!(seen["camera"]["fault"].as_str().unwrap().contains("unplugged"), "{seen}");
    let refused = problem(put(json!({ "e": { "slip_share": 1.5 } })).await.unwrap(), 422, "invalid").await;
    assert_eq!(refused["field"], "e.slip_share");
    assert_eq!(read().await, now, "a refused request changes nothing");
    problem(put(json!({ "lens": "off" })).await.unwrap(), 422, "invalid").await;
    // What is not named goes right again.
    assert_eq!(put(json!({})).await.unwrap().status(), 200);
    assert_eq!(read().await, json!(Faults::default()));
}

/// Whoever looks, and not only who stopped.
#[tokio::test]
async fn what_became_of_a_stop_is_told_until_it_is_reset() {
    let daemon = Daemon::start(open_bench(&Arc::new(small_config(1))).await.unwrap()).await;
    let stop = async || -> Value { daemon.get("/api/v1/stop").await.json().await.unwrap() };
    let on_both = |fate: &str| json!({ "focus": fate, "e": fate });
    assert_eq!(daemon.post("/api/v1/stop", &json!({})).await.status(), 200);
    assert_eq!(stop().await["delivery"], on_both("confirmed"));
    daemon.request(Method::PUT, FAULTS).json(&json!({ "serial": { "unplugged": true } })).send().await.unwrap();
    let gone = |bench: &Value| bench["axes"].as_array().unwrap().iter().all(|axis| axis["connected"] == false);
    daemon.until("/api/v1/bench", "disconnected", gone).await;
    assert_eq!(daemon.post("/api/v1/stop", &json!({})).await.status(), 200);
    let bench: Value = daemon.get("/api/v1/bench").await.json().await.unwrap();
    assert_eq!(bench["stop"]["delivery"], on_both("undeliverable"));
    let reset = daemon.request(Method::DELETE, "/api/v1/stop").json(&json!({ "owner": "Ana", "why": "a test" }));
    assert_eq!(reset.send().await.unwrap().status(), 200);
    assert_eq!(stop().await["delivery"], Value::Null);
}

/// Where the picture can only be measured with the focus axis elsewhere, too.
#[tokio::test(start_paused = true)]
async fn a_mistake_is_named_by_a_picture_that_the_focus_axis_was_led_to() {
    for (no_shell, named) in
        [(false, "it fits a tank with no water in it."), (true, "it fits water without the shell.")]
    {
        let mut config = Config::default();
        (config.sensor.width_px, config.sensor.height_px) = (560, 560);
        config.bench.simulation.rays = 4;
        let service = service(config).await;
        let mut faults = Faults::default();
        (faults.scene.no_shell, faults.scene.tank_empty) = (no_shell, !no_shell);
        service.bench().simulated.as_ref().unwrap().set_faults(faults);
        let job = align(&service).await;
        let reason = job.reason.unwrap();
        assert!(reason.contains(named) && reason.contains("from where the air step left it"), "{reason}");
        assert!(reason.contains("no e that the axis can have"), "{reason}");
        assert_eq!(service.bench_view().contradicted, Some(reason), "no move is to be made by that picture");
        service.set_shell(&permit(&service), ShellState::Off).unwrap();
        assert_eq!(service.bench_view().contradicted, None, "another picture is seen");
    }
}

#[tokio::test(start_paused = true)]
async fn an_assemblers_mistakes_are_named() {
    failed_naming(&aligned_with(|faults| faults.scene.tank_empty = true).await, &["no water", "Is the tank filled"]);
    failed_naming(
        &aligned_with(|faults| faults.scene.no_shell = true).await,
        &["without the shell", "is the shell mounted"],
    );
    failed_naming(&aligned_with(|faults| faults.scene.shell_radius_mm = 6.0).await, &["a shell of 6"]);
}

/// Does something once a job asks for what is said so.
fn at_step(said: &'static str, service: &Arc<Service>, act: impl FnOnce() + Send + 'static) -> JoinHandle<()> {
    let mut events = service.subscribe();
    tokio::spawn(async move {
        loop {
            if let Ok(Event::Job { job }) = events.recv().await
                && job.log.iter().any(|line| line.message.contains(said))
            {
                return act();
            }
        }
    })
}

/// The board stands right in air, and is put up wrong in the water.
async fn with_the_board_in_water(change: impl FnOnce(&mut Faults) + Send + 'static) -> JobSnapshot {
    let service = service(small_config(9)).await;
    let bench = service.bench().clone();
    let put_up = at_step("Mount the shell", &service, move || {
        let mut faults = Faults::default();
        change(&mut faults);
        bench.simulated.as_ref().unwrap().set_faults(faults);
    });
    let job = align(&service).await;
    put_up.await.unwrap();
    job
}

#[tokio::test(start_paused = true)]
async fn a_board_in_the_wrong_place_is_named_and_a_turned_one_noted() {
    let displaced = with_the_board_in_water(|faults| faults.scene.board_displaced_mm = 500.0).await;
    failed_naming(&displaced, &["a board 12", "a board 13"]);
    let turned = with_the_board_in_water(|faults| faults.scene.board_turned_mrad = 250.0).await;
    let notes = turned.report.unwrap().notes;
    let noted = notes.iter().find(|note| note.contains("a board is turned")).unwrap_or_else(|| panic!("{notes:?}"));
    // 250 mrad are 14.3°.
    assert!([" 12.", " 13.", " 14.", " 15.", " 16."].iter().any(|degrees| noted.contains(degrees)), "{noted}");
}

#[tokio::test(start_paused = true)]
async fn a_second_board_in_the_field_ends_the_job_before_anything_moves_by_it() {
    let two = with_the_board_in_water(|faults| faults.scene.second_board_mm = 150.0).await;
    failed_naming(&two, &["two boards where one flat board was asked for", "let one fill the picture"]);
}

/// A controller that says "stopped" while the carriage creeps on: what is decided near the shell waits for the picture.
#[tokio::test(start_paused = true)]
async fn a_carriage_that_creeps_on_is_not_driven_into_the_shell() {
    for late in [400, 1000] {
        // Homing would fail with it.
        let job = with_the_board_in_water(move |faults| faults.e.stops_late_ms = late).await;
        let truth = job.report.as_ref().unwrap().truth.clone().unwrap();
        assert_eq!(truth["touched_shell"], false, "{late} ms: {:?}", job.reason);
        if job.state == JobState::Converged {
            assert!(truth["focus_error_mm"].as_f64().unwrap().abs() < 0.01, "{late} ms: {truth}");
        }
        assert!(
            late < 700 || job.log.iter().any(|line| line.message.contains("creeps on")),
            "{late} ms: {:#?}",
            job.log
        );
    }
}

/// What an alignment leaves at the shell is no obstacle to the next.
#[tokio::test(start_paused = true)]
async fn an_aligned_camera_can_be_aligned_again() {
    let service = service(small_config(9)).await;
    for _ in 0..2 {
        let job = align(&service).await;
        assert_eq!(job.state, JobState::Converged, "{:?}\n{:#?}", job.reason, job.log);
    }
}

#[tokio::test]
async fn a_plan_of_faults_comes_and_goes_over_the_api() {
    let config = Arc::new(small_config(1));
    let daemon = Daemon::start(open_bench(&config).await.unwrap()).await;
    let read = |path: &'static str| {
        let daemon = &daemon;
        async move { daemon.get(path).await.json::<Value>().await.unwrap() }
    };
    let put = |body: Value| daemon.request(Method::PUT, PLAN).json(&body).send();
    assert_eq!(read(PLAN).await, json!({ "plan": null, "elapsed_s": null }));
    let plan = json!({ "events": [
        { "at_s": 0.0, "lasts_s": 0.3, "faults": { "camera": { "picture": "dark" } } },
        { "at_s": 0.2, "faults": { "e": { "slip_share": 0.5 } } },
    ]});
    assert_eq!(put(plan).await.unwrap().status(), 200);
    let first = read(FAULTS).await;
    assert_eq!((&first["camera"]["picture"], &first["e"]["slip_share"]), (&json!("dark"), &json!(0.0)));
    daemon.until(PLAN, "beyond both", |plan| plan["elapsed_s"].as_f64().unwrap() >= 0.6).await;
    let second = read(FAULTS).await;
    assert_eq!((&second["camera"]["picture"], &second["e"]["slip_share"]), (&json!("none"), &json!(0.5)));
    let in_force = read(PLAN).await;
    assert!(in_force["elapsed_s"].as_f64().unwrap() >= 0.6 && in_force["plan"]["events"][1]["at_s"] == 0.2);
    let wrong = json!({ "events": [{ "at_s": 1, "faults": { "e": { "slip_share": 2 } } }] });
    let refused = problem(put(wrong).await.unwrap(), 422, "invalid").await;
    assert_eq!(refused["field"], "events[0].faults.e.slip_share");
    assert_eq!(read(PLAN).await["plan"], in_force["plan"], "a refused plan changes nothing");
    // A thousand events are longer than other requests may be.
    let event = json!({ "at_s": 1e5, "faults": {} });
    assert_eq!(put(json!({ "events": vec![event; 1000] })).await.unwrap().status(), 200);
    assert_eq!(daemon.request(Method::DELETE, PLAN).send().await.unwrap().status(), 204);
    assert_eq!(read(FAULTS).await, json!(Faults::default()));
    assert_eq!(read(PLAN).await["plan"], Value::Null);
}

/// The disk is full for a while: nothing moves meanwhile, and all is well afterwards.
#[tokio::test]
async fn a_full_disk_keeps_everything_still() {
    let service = service(small_config(9)).await;
    service.set_faults(serde_json::from_value(json!({ "disk": { "full": true } })).unwrap());
    let refused = service.create_job(&permit(&service), JobRequest::of(JobKind::JointAlignment)).await.unwrap_err();
    assert!(refused.to_string().contains("the disk is full"), "{refused}");
    service.set_faults(Faults::default());
    let id = service.create_job(&permit(&service), JobRequest::of(JobKind::JointAlignment)).await.unwrap().id;
    service.cancel(id, None).unwrap();
}

#[tokio::test]
async fn a_bench_of_hardware_takes_no_faults() {
    let daemon = Daemon::start(fakes().bench).await;
    problem(daemon.get(FAULTS).await, 409, "not-simulated").await;
    problem(daemon.request(Method::PUT, FAULTS).json(&json!({})).send().await.unwrap(), 409, "not-simulated").await;
}
