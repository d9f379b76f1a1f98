//! Each kind of job from its start to its end on the simulated bench.

use plenalign::api::export;
use plenalign::control::events::InView;
use plenalign::control::job::outcome::Outcome;
use plenalign::control::job::{JobKind, JobRequest, JobSnapshot, JobState};
use plenalign::device::AxisName;
use plenalign::device::faults::Faults;
use plenalign::device::light::ControlName;

use super::bench::{permit, run, service, small_config};

fn ended_as(job: &JobSnapshot, state: JobState) {
    assert_eq!(job.state, state, "{:?}\n{:#?}", job.reason, job.log);
}

#[tokio::test(start_paused = true)]
async fn the_steps_of_an_alignment_can_be_run_one_by_one() {
    let service = service(small_config(2)).await;
    let early = run(&service, JobRequest::of(JobKind::ShellOnly)).await;
    ended_as(&early, JobState::Failed);
    assert!(early.reason.as_ref().unwrap().contains("air_only"), "{:?}", early.reason);
    let bench = service.bench_view();
    assert_eq!((bench.air_step_holds, bench.in_view), (false, InView::Unknown));

    let air = run(&service, JobRequest::of(JobKind::AirOnly)).await;
    ended_as(&air, JobState::Converged);
    let report = air.report.as_ref().unwrap();
    let error_mm = report.delta_v_air_mm.unwrap() - report.delta_v_air_target_mm;
    assert!(error_mm.abs() < 0.005, "{error_mm}");
    assert_eq!(report.moves_shell, 0);
    let measure = air.progress.measure.as_ref().unwrap();
    assert_eq!(measure.name, "delta_v_mm");
    assert!((measure.value - measure.target.unwrap()).abs() < 0.005, "{measure:?}");

    let (before, bench) = (bench, service.bench_view());
    assert_eq!((bench.air_step_holds, bench.in_view), (true, InView::SteppedBoard));
    assert!(bench.set_up_at > before.set_up_at, "{} is not after {}", bench.set_up_at, before.set_up_at);

    let shell = run(&service, JobRequest::of(JobKind::ShellOnly)).await;
    ended_as(&shell, JobState::Converged);
    let report = shell.report.as_ref().unwrap();
    // Whoever looks on goes by what the job went by.
    let measured = service.measurements(shell.id).await.unwrap().pop().unwrap();
    let off_px = measured.spacing.spacing_px - measured.spacing_target_px;
    assert_eq!(measured.spacing_target_px, report.spacing_target_px);
    assert!(off_px.abs() <= measured.spacing_tolerance_px.unwrap(), "{measured:?}");
    assert_eq!(service.bench_view().in_view, InView::FlatBoard);
    assert_eq!(report.moves_air, 0);
    assert!((report.spacing_px.unwrap() - report.spacing_target_px).abs() < 0.03, "{report:?}");

    // With the camera set otherwise there is no white frame: told before anybody mounts the shell.
    assert!(service.bench_view().air_step_holds);
    service.set_light(&permit(&service), ControlName::Gain, 2.0, |_| ()).await.unwrap();
    assert!(!service.bench_view().air_step_holds);
    let dark = run(&service, JobRequest::of(JobKind::ShellOnly)).await;
    ended_as(&dark, JobState::Failed);
    let why = dark.reason.as_ref().unwrap();
    assert!(why.contains("no white frame") && why.contains("run calibration"), "{why}");

    // Homed anew, Δv is no longer known to what the shell step needs.
    ended_as(&run(&service, JobRequest::of(JobKind::Homing)).await, JobState::Succeeded);
    let homed = run(&service, JobRequest::of(JobKind::ShellOnly)).await;
    assert!(homed.reason.as_ref().unwrap().contains("since the focus axis was homed"), "{:?}", homed.reason);
}

#[tokio::test(start_paused = true)]
async fn clarity_alone_holds_e_and_trims() {
    let service = service(small_config(3)).await;
    let job = run(&service, JobRequest { e_mm: Some(12.0), ..JobRequest::of(JobKind::ClarityOnly) }).await;
    ended_as(&job, JobState::Converged);
    let report = job.report.as_ref().unwrap();
    let wanted = small_config(3).design().clarity(12.0);
    assert!((report.delta_v_air_target_mm - wanted.delta_v).abs() < 1e-9);
    // As the picture has it: the axis's own scale and zero are wrong by what the bench declares.
    assert!((report.e_mm.unwrap() - 12.0).abs() < 0.3, "{:?}", report.e_mm);
    assert!((report.spacing_px.unwrap() - report.spacing_target_px).abs() < 0.03, "{report:?}");

    // One that ends before anything is measured was for the same.
    let mut faults = Faults::default();
    faults.camera.unplugged = true;
    service.bench().simulated.as_ref().unwrap().set_faults(faults);
    let cut = run(&service, JobRequest { e_mm: Some(12.0), ..JobRequest::of(JobKind::ClarityOnly) }).await;
    ended_as(&cut, JobState::Failed);
    let report = cut.report.as_ref().unwrap();
    assert_eq!((report.e_target_mm, report.delta_v_target_mm), (12.0, wanted.delta_v));
    assert_eq!(report.aperture_mm, wanted.aperture);
    service.bench().simulated.as_ref().unwrap().set_faults(Faults::default());

    let beyond = run(&service, JobRequest { e_mm: Some(-3.0), ..JobRequest::of(JobKind::ClarityOnly) }).await;
    ended_as(&beyond, JobState::Failed);
    assert!(beyond.reason.as_ref().unwrap().contains("-0.100"), "{:?}", beyond.reason);
    // Within the wall, and nearer to the shell than e is known.
    let near = run(&service, JobRequest { e_mm: Some(-0.05), ..JobRequest::of(JobKind::ClarityOnly) }).await;
    ended_as(&near, JobState::Failed);
    assert!(
        near.reason.as_ref().unwrap().contains("e_mm is -0.050, and would have to be at least "),
        "{:?}",
        near.reason
    );
    assert!(near.iterations.is_empty() && near.steps.iter().all(|step| step.number.is_none()), "{:?}", near.steps);
}

#[tokio::test(start_paused = true)]
async fn measuring_jobs_measure_and_put_back_what_they_moved() {
    let service = service(small_config(4)).await;
    let sweep = JobRequest {
        axis: Some(AxisName::Focus),
        from_mm: Some(1.9),
        to_mm: Some(2.5),
        steps: Some(5),
        ..JobRequest::of(JobKind::FocusSweep)
    };
    let unhomed = run(&service, sweep.clone()).await;
    ended_as(&unhomed, JobState::Failed);
    assert!(unhomed.reason.as_ref().unwrap().contains("not homed"), "{:?}", unhomed.reason);

    let homed = run(&service, JobRequest::of(JobKind::Homing)).await;
    ended_as(&homed, JobState::Succeeded);
    let Some(Outcome::Homing { focus_mm: Some(start), e_mm: Some(_) }) = homed.outcome else {
        panic!("{:?}", homed.outcome);
    };

    // Through the diffuser there is nothing to calibrate: the job asks for a white frame, then for the board.
    let calibrated = run(&service, JobRequest::of(JobKind::Calibration)).await;
    ended_as(&calibrated, JobState::Succeeded);
    let Some(Outcome::Calibration { delta_v_mm, image_distance_sigma_mm, .. }) = calibrated.outcome else {
        panic!("{:?}", calibrated.outcome);
    };
    // The axis's zero is known to 0.2 mm.
    let allowed = 0.2 + 3.0 * image_distance_sigma_mm;
    assert!((delta_v_mm - start).abs() < allowed && image_distance_sigma_mm < 0.5, "{delta_v_mm} at {start}");
    assert_eq!(calibrated.iterations.len(), 0);
    let reached = calibrated.progress.measure.as_ref().unwrap();
    let told = (reached.name.as_str(), reached.value, reached.sigma, reached.target);
    assert_eq!(told, ("delta_v_mm", delta_v_mm, image_distance_sigma_mm, None));

    let swept = run(&service, sweep).await;
    ended_as(&swept, JobState::Succeeded);
    let back = format!("the focus axis stands at {start:.3} mm, and comes back there at the end");
    assert!(swept.log.iter().any(|line| line.message == back), "{:?}", swept.log);
    let Some(Outcome::FocusSweep { positions: 5, measured, crossing_mm, slope_px_per_mm, best_focus, .. }) =
        &swept.outcome
    else {
        panic!("{:?}", swept.outcome);
    };
    let measured = *measured;
    assert_eq!(swept.iterations.len(), measured as usize);
    assert!(measured >= 4, "{measured}");
    assert!((crossing_mm.unwrap() - 2.2).abs() < 0.3 && slope_px_per_mm.unwrap() < 0.0, "{crossing_mm:?}");
    // Between two of five places the spacing is no straight line; the curve knows.
    let best = best_focus.as_ref().unwrap();
    assert!((best.position_mm - crossing_mm.unwrap()).abs() < 0.05 && best.sigma_mm < 0.05, "{best:?}");
    // Where it ended is nothing that it reached.
    let reached = swept.progress.measure.as_ref().unwrap();
    assert_eq!((reached.name.as_str(), reached.value, reached.target), ("best_focus_mm", best.position_mm, None));
    let page = export::html(&service.archive(swept.id).await.unwrap());
    let told = format!("best focus</th><td>{:.4} ± {:.4} mm", best.position_mm, best.sigma_mm);
    assert!(page.contains("<h2>Figures</h2>") && page.contains(&told), "{told}");
    assert!(swept.iterations.iter().all(|it| it.eog.is_some_and(|eog| eog > 0.0)));
    let focus = service.bench_view().axes[0].position_mm.unwrap();
    assert!((focus - start).abs() < 0.01, "{focus}, not back at {start}");

    let watch = JobRequest { duration_s: Some(8.0), interval_s: Some(2.0), ..JobRequest::of(JobKind::SpacingWatch) };
    let watched = run(&service, watch).await;
    ended_as(&watched, JobState::Succeeded);
    let Some(Outcome::SpacingWatch { measured, mean_px, scatter_px, least_px, greatest_px, .. }) = watched.outcome
    else {
        panic!("{:?}", watched.outcome);
    };
    assert!((3..=5).contains(&measured), "{measured}");
    assert!(scatter_px < 0.02 && greatest_px >= least_px, "{scatter_px}");
    // All of them are what it reached, not the last one, and no more certain than that.
    let (reached, last) = (watched.progress.measure.as_ref().unwrap(), watched.iterations.last().unwrap());
    assert_eq!((reached.name.as_str(), reached.value), ("spacing_px", mean_px));
    assert_eq!(reached.sigma, last.spacing.spacing_sigma_px);
}

#[tokio::test(start_paused = true)]
async fn l_bound_alone_is_measured_and_holds_from_then_on() {
    let service = service(small_config(5)).await;
    let job = run(&service, JobRequest::of(JobKind::LBoundMeasurement)).await;
    ended_as(&job, JobState::Succeeded);
    let Some(Outcome::LBound { l_bound_mm, sigma_mm, e_wall_mm }) = job.outcome else {
        panic!("{:?}", job.outcome);
    };
    assert!(sigma_mm > 0.0 && e_wall_mm < l_bound_mm);
    assert!((service.bench_view().e_wall_mm - e_wall_mm).abs() < 1e-12);
    assert!(job.report.is_none());
    // Δv was on the way only.
    let reached = job.progress.measure.as_ref().unwrap();
    assert_eq!((reached.name.as_str(), reached.value, reached.sigma), ("l_bound_mm", l_bound_mm, sigma_mm));
    let page = export::html(&service.archive(job.id).await.unwrap());
    assert!(page.contains("<h1>l_bound measurement</h1>"));
    assert!(page.contains(&format!("l_bound</th><td>{l_bound_mm:.3} ± {sigma_mm:.3} mm")));
    assert!(page.contains(&format!("e wall</th><td>{e_wall_mm:.3} mm")));
}
