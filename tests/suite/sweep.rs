//! Sweeps: what a curve through focus is worth depends on the axis having been where it says.

use std::sync::Arc;

use plenalign::control::Service;
use plenalign::control::events::{Event, ShellState};
use plenalign::control::job::outcome::Outcome;
use plenalign::control::job::{JobKind, JobRequest, JobSnapshot, JobState};
use plenalign::device::AxisName;
use plenalign::device::faults::Faults;

use super::bench::{align, permit, quick_axes, run, service, small_config};

fn sweep(axis: AxisName, from_mm: f64, to_mm: f64, steps: u32) -> JobRequest {
    JobRequest {
        axis: Some(axis),
        from_mm: Some(from_mm),
        to_mm: Some(to_mm),
        steps: Some(steps),
        ..JobRequest::of(JobKind::FocusSweep)
    }
}

async fn homed(seed: u64) -> Arc<Service> {
    let mut config = small_config(seed);
    quick_axes(&mut config.bench);
    let service = service(config).await;
    let homed = run(&service, JobRequest::of(JobKind::Homing)).await;
    assert_eq!(homed.state, JobState::Succeeded, "{:?}", homed.reason);
    service
}

/// The same with the shell on.
async fn homed_with_the_shell(seed: u64) -> Arc<Service> {
    let service = homed(seed).await;
    service.set_shell(&permit(&service), ShellState::On).unwrap();
    service
}

#[tokio::test(start_paused = true)]
async fn a_sweep_of_e_with_the_shell_on_goes_no_nearer_than_the_axis_is_known() {
    let service = homed_with_the_shell(1).await;
    let from_mm = service.axis_view(AxisName::E).position_mm.unwrap();
    let refused = run(&service, sweep(AxisName::E, 8.0, 0.0, 3)).await;
    assert_eq!(refused.state, JobState::Failed, "{:?}", refused.reason);
    let why = refused.reason.as_deref().unwrap();
    assert!(why.contains("beyond the e wall") && why.contains("scale_uncertainty"), "{why}");
    let stands_mm = service.axis_view(AxisName::E).position_mm.unwrap();
    assert!((stands_mm - from_mm).abs() < 1e-6, "nothing moves: {from_mm} to {stands_mm}");
}

/// Has an axis's motor stand still from when a job has made so many measurements until it has made so many.
fn stall(service: &Service, axis: AxisName, from: usize, until: usize) -> tokio::task::JoinHandle<()> {
    let (mut events, bench) = (service.subscribe(), service.bench().clone());
    tokio::spawn(async move {
        while let Ok(event) = events.recv().await {
            let Event::Job { job } = event else { continue };
            if job.kind != JobKind::FocusSweep {
                continue;
            }
            let mut faults = Faults::default();
            let stalled = (from..until).contains(&job.iterations.len());
            match axis {
                AxisName::Focus => faults.focus.stalled = stalled,
                AxisName::E => faults.e.stalled = stalled,
            }
            bench.simulated.as_ref().unwrap().set_faults(faults);
            if job.state.is_final() {
                return;
            }
        }
    })
}

fn names(job: &JobSnapshot, axis: AxisName) {
    let reason = job.reason.as_deref().unwrap_or_default();
    assert_eq!(job.state, JobState::Failed, "{reason} {:?}\n{:#?}", job.outcome, job.log);
    assert!(reason.contains(&format!("the {axis} axis")) && reason.contains("the picture shows"), "{reason}");
    assert_eq!(job.outcome, None);
}

#[tokio::test(start_paused = true)]
async fn a_sweep_whose_axis_stalls_ends_with_its_name() {
    // For two steps of 21, then free again: best focus would be out by as much as was lost.
    let service = homed_with_the_shell(4).await;
    let lost = stall(&service, AxisName::Focus, 1, 3);
    let swept = run(&service, sweep(AxisName::Focus, 1.6, 2.6, 21)).await;
    lost.await.unwrap();
    names(&swept, AxisName::Focus);
    assert!(swept.iterations.len() < 6, "{}", swept.iterations.len());

    // For good, with steps that the play of an axis could hide one by one.
    let service = homed_with_the_shell(4).await;
    let lost = stall(&service, AxisName::Focus, 4, usize::MAX);
    let swept = run(&service, sweep(AxisName::Focus, 2.0, 2.4, 21)).await;
    lost.await.unwrap();
    names(&swept, AxisName::Focus);
    assert!(swept.iterations.len() < 8, "{}", swept.iterations.len());

    // On its way to the first place: each step after it is as long as it should be.
    let service = homed_with_the_shell(4).await;
    let near = run(&service, sweep(AxisName::Focus, 2.0, 2.2, 3)).await;
    assert_eq!(near.state, JobState::Succeeded, "{:?}", near.reason);
    let lost = stall(&service, AxisName::Focus, 0, 1);
    let swept = run(&service, sweep(AxisName::Focus, 2.0, 2.4, 9)).await;
    lost.await.unwrap();
    names(&swept, AxisName::Focus);
}

#[tokio::test(start_paused = true)]
async fn a_sweep_far_out_of_focus_or_through_the_shell_is_not_taken_for_a_fault() {
    for seed in [4, 5] {
        let service = homed_with_the_shell(seed).await;
        let measured = |swept: &JobSnapshot| {
            assert_eq!(swept.state, JobState::Succeeded, "seed {seed}: {:?}\n{:#?}", swept.reason, swept.log);
            swept.iterations.len()
        };
        // The whole travel, whose ends are beyond what can be measured; then finely, about focus.
        let wide = run(&service, sweep(AxisName::Focus, -1.9, 4.0, 21)).await;
        assert!((3..21).contains(&measured(&wide)), "seed {seed}: {}", measured(&wide));
        let asked: Vec<_> = wide.steps.iter().map(|step| step.name.as_str()).collect();
        assert_eq!(asked, ["white_frame", "board_in_water", "measuring"], "the shell is off for the white frame alone");
        assert_eq!(service.bench_view().shell, ShellState::On);
        let Some(Outcome::FocusSweep { best_focus: Some(best), .. }) = wide.outcome else { panic!("seed {seed}") };
        let fine = sweep(AxisName::Focus, best.position_mm - 0.1, best.position_mm + 0.1, 21);
        assert_eq!(measured(&run(&service, fine).await), 21, "seed {seed}");
        measured(&run(&service, sweep(AxisName::E, 30.0, 10.0, 9)).await);

        let aligned = align(&service).await;
        assert_eq!(aligned.state, JobState::Converged, "{:?}", aligned.reason);
        measured(&run(&service, sweep(AxisName::E, 16.0, 2.0, 8)).await);
        measured(&run(&service, sweep(AxisName::Focus, -1.9, 4.0, 21)).await);
        measured(&run(&service, sweep(AxisName::Focus, 2.1, 2.3, 9)).await);
    }
}

/// Where the image has passed the array, what a white frame from the middle of the travel leaves is no spacing.
#[tokio::test(start_paused = true)]
async fn a_sweep_in_air_reads_nothing_beyond_the_range_of_focus() {
    let service = homed(4).await;
    let swept = run(&service, sweep(AxisName::Focus, -1.9, 4.9, 18)).await;
    assert_eq!(swept.state, JobState::Succeeded, "{:?}\n{:#?}", swept.reason, swept.log);
    // On one side of the array the spacing falls on and on.
    let seen: Vec<_> = swept.iterations.iter().map(|seen| (seen.focus_mm.unwrap(), seen.spacing.spacing_px)).collect();
    println!("{seen:.3?}");
    assert!((8..18).contains(&seen.len()) && seen.is_sorted_by(|a, b| a.1 > b.1), "{seen:?}");
    assert!(seen.iter().all(|(focus_mm, _)| *focus_mm < 3.0), "{seen:?}");
}

#[tokio::test(start_paused = true)]
async fn a_stalled_e_axis_is_named_through_the_shell() {
    let service = homed_with_the_shell(4).await;
    let aligned = align(&service).await;
    assert_eq!(aligned.state, JobState::Converged, "{:?}", aligned.reason);
    let lost = stall(&service, AxisName::E, 2, 4);
    let swept = run(&service, sweep(AxisName::E, 14.0, 2.0, 9)).await;
    lost.await.unwrap();
    names(&swept, AxisName::E);
}

#[tokio::test(start_paused = true)]
async fn a_sweep_over_two_boards_says_so() {
    let service = homed_with_the_shell(4).await;
    let aligned = align(&service).await;
    assert_eq!(aligned.state, JobState::Converged, "{:?}", aligned.reason);
    let mut faults = Faults::default();
    faults.scene.second_board_mm = 150.0;
    service.bench().simulated.as_ref().unwrap().set_faults(faults);
    let swept = run(&service, sweep(AxisName::Focus, 1.9, 2.3, 5)).await;
    let reason = swept.reason.as_deref().unwrap_or_default();
    assert_eq!((swept.state, swept.outcome.as_ref()), (JobState::Failed, None), "{reason}");
    assert!(reason.contains("two boards where one flat board was asked for"), "{reason}");
}

#[tokio::test(start_paused = true)]
async fn where_nobody_has_said_that_the_shell_is_on_a_sweep_is_in_air() {
    let service = homed(4).await;
    assert_eq!(service.bench_view().shell, ShellState::Unknown);
    let swept = run(&service, sweep(AxisName::Focus, 2.0, 2.2, 3)).await;
    assert_eq!(swept.state, JobState::Succeeded, "{:?}", swept.reason);
    let asked: Vec<_> = swept.steps.iter().map(|step| step.name.as_str()).collect();
    assert_eq!(asked, ["white_frame", "board_in_air", "measuring"]);
    assert_eq!(service.bench_view().shell, ShellState::Off);
}
