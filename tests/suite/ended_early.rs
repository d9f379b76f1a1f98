//! Reports of jobs that ended before what they were for: what was not measured is not told.

use std::sync::Arc;

use plenalign::api::export;
use plenalign::control::events::Event;
use plenalign::control::job::{JobKind, JobRequest, JobSnapshot, JobState, Stage};
use plenalign::control::{Refusal, Service, ServiceError};
use plenalign::device::AxisName;
use plenalign::device::faults::{AxisFaults, Faults};
use plenalign::units::Millimetres;
use tokio::sync::broadcast::error::RecvError;
use tokio::task::JoinHandle;

use super::bench::{align, permit, run, service, small_config};

/// Waits for a job to have come so far.
async fn once(service: &Arc<Service>, there: impl Fn(&JobSnapshot) -> bool) -> JobSnapshot {
    let mut events = service.subscribe();
    loop {
        match events.recv().await {
            Ok(Event::Job { job }) if there(&job) => return *job,
            Ok(_) | Err(RecvError::Lagged(_)) => {}
            Err(RecvError::Closed) => panic!("the service ended before its job"),
        }
    }
}

/// Has an axis stand still, whatever it is told, once a job has come so far.
fn stalled_once(
    service: &Arc<Service>,
    there: impl Fn(&JobSnapshot) -> bool + Send + 'static,
    axis: impl Fn(&mut Faults) -> &mut AxisFaults + Send + 'static,
) -> JoinHandle<()> {
    let service = Arc::clone(service);
    tokio::spawn(async move {
        once(&service, there).await;
        let mut faults = Faults::default();
        axis(&mut faults).stalled = true;
        service.set_faults(faults);
    })
}

#[tokio::test(start_paused = true)]
async fn a_stopped_shell_step_does_not_tell_what_was_before_its_last_move() {
    let service = service(small_config(1)).await;
    let stopping = tokio::spawn({
        let service = Arc::clone(&service);
        async move {
            let through_shell = |job: &JobSnapshot| job.iterations.iter().any(|it| it.stage == Stage::Shell);
            let job = once(&service, through_shell).await;
            let from = job.iterations.last().unwrap().e_mm.unwrap();
            let mut e = service.bench().e.state();
            e.wait_for(|e| e.moving && (e.position.value() - from).abs() > 0.2).await.unwrap();
            service.stop(tokio::time::Instant::now(), "a test").await;
            from
        }
    });
    let job = align(&service).await;
    let measured_at = stopping.await.unwrap();
    assert_eq!(job.state, JobState::Cancelled, "{:?}", job.reason);
    let report = job.report.as_ref().unwrap();
    assert!((report.e_readback_mm.unwrap() - measured_at).abs() > 0.1, "{report:?}");
    assert_eq!((report.e_mm, report.spacing_px, report.tilt_px, report.eog_after), (None, None, None, None));
    assert!(report.budget.is_none() && report.depth_of_field.is_none() && report.e_tolerance.is_none());
    assert_eq!((report.fov_water_deg, &job.progress.measure), (None, &None));
    // The focus axis has not moved since.
    assert!(report.delta_v_mm.is_some() && report.delta_v_air_mm.is_some());
    assert!(report.shell_step_done.starts_with("ended before"), "{}", report.shell_step_done);
    let note = report.notes.iter().find(|note| note.contains("before the last move")).unwrap();
    assert!(note.contains(&format!("the e axis at {measured_at:.4} mm")), "{note}");
    let page = export::html(&service.archive(job.id).await.unwrap());
    let row = |name: &str, value: &str| format!("<tr><th scope=\"row\">{name}</th><td>{value}");
    assert!(page.contains(&row("e", "not measured")) && page.contains(&row("spacing", "not measured")));
    assert!(page.contains(&row("depth of field in water", "not measured")));
    assert!(!page.contains("outside tolerance"), "{:?}", report.notes);
}

#[tokio::test(start_paused = true)]
async fn a_failed_air_step_tells_only_what_it_measured() {
    let service = service(small_config(1)).await;
    let stalling = stalled_once(&service, |job| !job.iterations.is_empty(), |faults| &mut faults.focus);
    let job = run(&service, JobRequest::of(JobKind::AirOnly)).await;
    stalling.await.unwrap();
    assert_eq!(job.state, JobState::Failed, "{:?}", job.reason);
    assert!(job.reason.as_deref().unwrap().contains("the focus axis does not move"), "{:?}", job.reason);
    let report = job.report.as_ref().unwrap();
    // No move was seen, no air step came to its end, and the board has levels.
    assert_eq!((report.focus_scale, report.e_scale), (None, None));
    assert_eq!((report.delta_v_air_mm, report.tilt_px, report.tilt_deg), (None, None, None));
    assert!(report.depth_of_field.is_none() && report.e_tolerance.is_none() && report.fov_water_deg.is_none());
    // The picture says where the camera is, whatever the axis reads.
    assert!(report.delta_v_mm.unwrap().abs() < 0.5, "{report:?}");
    let page = export::html(&service.archive(job.id).await.unwrap());
    assert!(!page.contains("as the picture has it</td>") && !page.contains("tilt x, y"), "{report:?}");
    // Where the axis stands is known to nobody, and it is moved by nothing before it is homed.
    let [focus, e] = AxisName::ALL.map(|axis| service.axis_view(axis));
    assert!(!focus.homed && focus.position_mm.is_none() && e.homed, "{focus:?} {e:?}");
    let moved = service.move_axis(&permit(&service), AxisName::Focus, Millimetres(0.1)).await;
    assert!(matches!(moved, Err(ServiceError::Refused(Refusal::NotHomed { axis: AxisName::Focus }))), "{moved:?}");
    assert!(page.contains("probes not counted") && page.contains("depth of field in water</th><td>not measured"));
}

#[tokio::test(start_paused = true)]
async fn a_failed_shell_step_tells_no_e_of_before() {
    let service = service(small_config(1)).await;
    let in_shell_step = |job: &JobSnapshot| job.iterations.iter().any(|one| one.stage == Stage::Shell);
    let stalling = stalled_once(&service, in_shell_step, |faults| &mut faults.e);
    let job = align(&service).await;
    stalling.await.unwrap();
    assert_eq!(job.state, JobState::Failed, "{:?}", job.reason);
    assert!(job.reason.as_deref().unwrap().contains("the e axis does not move"), "{:?}", job.reason);
    // The first, short move may be hidden by noise; nothing long is tried on the strength of it.
    let readings: Vec<f64> = job.iterations.iter().filter_map(|one| one.e_mm).collect();
    assert!(readings.iter().all(|&e_mm| e_mm > 20.0), "{readings:?}");
    let report = job.report.as_ref().unwrap();
    assert_eq!((report.e_mm, report.e_readback_mm, report.e_scale), (None, None, None), "{report:?}");
    assert_eq!(job.iterations.last().unwrap().e_estimate_mm, None);
    assert!(report.budget.is_none() && report.depth_of_field.is_none() && report.e_tolerance.is_none());
    // The picture is of where the camera stands, and Δv of the air step stands.
    assert!(report.spacing_px.is_some() && report.delta_v_mm.is_some() && report.focus_readback_mm.is_some());
}
