//! Watches: hours of measuring are not lost by a frame that cannot be measured.

use std::sync::Arc;

use plenalign::control::Service;
use plenalign::control::events::Event;
use plenalign::control::job::outcome::Outcome;
use plenalign::control::job::{JobKind, JobRequest, JobSnapshot, JobState};
use plenalign::control::replay::replay;
use plenalign::device::faults::{Faults, PictureFault};

use super::bench::{permit, service, small_config};
use super::until::until;

/// Short: of the time between two measurements every frame is rendered, too.
const INTERVAL_S: f64 = 2.0;

fn watch(duration_s: f64) -> JobRequest {
    JobRequest { duration_s: Some(duration_s), interval_s: Some(INTERVAL_S), ..JobRequest::of(JobKind::SpacingWatch) }
}

/// How often a job could measure nothing.
fn gaps(job: &JobSnapshot) -> usize {
    job.log.iter().filter(|line| line.message.contains("nothing measured after")).count()
}

/// Has something go wrong with the camera as a watch goes on.
fn fail(service: &Arc<Service>, change: impl Fn(&JobSnapshot, &mut Faults) + Send + 'static) {
    let (mut events, service) = (service.subscribe(), Arc::clone(service));
    tokio::spawn(async move {
        while let Ok(event) = events.recv().await {
            let Event::Job { job } = event else { continue };
            let mut faults = Faults::default();
            change(&job, &mut faults);
            service.bench().simulated.as_ref().unwrap().set_faults(faults);
        }
    });
}

/// Has the camera's light go out while this holds of a watch.
fn darken(service: &Arc<Service>, dark: impl Fn(&JobSnapshot) -> bool + Send + 'static) {
    fail(service, move |job, faults| {
        if dark(job) {
            faults.camera.picture = PictureFault::Dark;
        }
    });
}

#[tokio::test(start_paused = true)]
async fn a_watch_goes_on_where_a_frame_cannot_be_measured_and_is_replayed_so() {
    let service = service(small_config(9)).await;
    darken(&service, |job| job.iterations.len() == 2 && gaps(job) < 2);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("watch.mcap");
    let id = service.create_job_recorded(&permit(&service), watch(10.0 * INTERVAL_S), file.clone()).await.unwrap().id;
    until("the watch ends", async || service.job(id).unwrap().state.is_final()).await;
    let watched = service.job(id).unwrap();
    assert_eq!(watched.state, JobState::Succeeded, "{:?}\n{:#?}", watched.reason, watched.log);
    let Some(Outcome::SpacingWatch { measured, unmeasured, scatter_px, .. }) = watched.outcome else {
        panic!("{:?}", watched.outcome);
    };
    assert_eq!((measured as usize, unmeasured as usize), (watched.iterations.len(), gaps(&watched)));
    assert_eq!(unmeasured, 2);
    assert!((7..=8).contains(&measured) && scatter_px < 0.02, "{measured}, {scatter_px}");
    // They took their turns.
    for after in ["after 4 s", "after 6 s"] {
        assert!(watched.log.iter().any(|line| line.message.contains(after)), "{after}: {:#?}", watched.log);
    }
    let replayed = replay(&file).await.unwrap();
    assert!(replayed.identical, "{:?} {:?}", replayed.differences, replayed.replayed_end);
}

#[tokio::test(start_paused = true)]
async fn a_watch_goes_on_where_the_camera_gives_an_old_picture_again() {
    let service = service(small_config(9)).await;
    fail(&service, |job, faults| faults.camera.frozen = job.iterations.len() == 2 && gaps(job) < 1);
    let id = service.create_job(&permit(&service), watch(6.0 * INTERVAL_S)).await.unwrap().id;
    until("the watch ends", async || service.job(id).unwrap().state.is_final()).await;
    let watched = service.job(id).unwrap();
    assert_eq!(watched.state, JobState::Succeeded, "{:?}\n{:#?}", watched.reason, watched.log);
    assert!(gaps(&watched) == 1 && watched.iterations.len() > 3, "{:#?}", watched.log);
    assert!(watched.log.iter().any(|line| line.message.contains("old picture")), "{:#?}", watched.log);
}

#[tokio::test(start_paused = true)]
async fn a_watch_that_could_measure_nothing_says_so() {
    let service = service(small_config(9)).await;
    darken(&service, |job| job.steps.iter().any(|step| step.name == "measuring"));
    let id = service.create_job(&permit(&service), watch(3.0 * INTERVAL_S)).await.unwrap().id;
    until("the watch ends", async || service.job(id).unwrap().state.is_final()).await;
    let watched = service.job(id).unwrap();
    assert_eq!(watched.state, JobState::NotConverged, "{:?}\n{:#?}", watched.reason, watched.log);
    let reason = watched.reason.as_deref().unwrap();
    assert!(reason.contains("over all of the watch") && gaps(&watched) == 3, "{reason}\n{:#?}", watched.log);
    assert_eq!((watched.iterations.len(), watched.outcome), (0, None));
}
