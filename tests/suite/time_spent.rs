//! Where a job's time goes: what its report says, by the test's own clock.

use std::time::Duration;

use plenalign::control::Shown;
use plenalign::control::job::{JobKind, JobRequest, JobState};
use tokio::time::Instant;

use super::bench::{key_and_permit, service, small_config};
use super::until::{elapse, until, when};

/// How long the operator takes for everything that is asked.
const OPERATOR: Duration = Duration::from_secs(300);
/// Exposure of a simulated frame, which takes no other time by a clock that stands while something is computed.
const EXPOSURE_S: f64 = 0.010;

#[tokio::test(start_paused = true)]
async fn a_report_says_where_all_of_the_time_went() {
    let mut config = small_config(6);
    config.bench.simulation.operator_confirms = false;
    let service = service(config.clone()).await;
    let (key, permit) = key_and_permit(&service);
    let began = Instant::now();
    let id = service.create_job(&permit, JobRequest::of(JobKind::AirOnly)).await.unwrap().id;
    let (mut asked, mut seen) = (0, 0);
    let job = loop {
        let waits_or_ended = |state: JobState| state.is_final() || state == JobState::WaitingForOperator;
        let job = until("the job asks for more, or has ended", async || {
            let job = service.job(id).unwrap();
            let new = job.operator_step.as_ref().is_none_or(|step| step.number > seen);
            when(job.state, |state| waits_or_ended(*state) && new).map(|_| job).map_err(|state| state.to_string())
        })
        .await;
        let Some(step) = &job.operator_step else { break job };
        elapse(OPERATOR).await;
        service.confirm(id, step.number, Shown { lease: Some(&key), ..Shown::default() }).await.unwrap();
        (asked, seen) = (asked + 1, step.number);
    };
    let whole_s = began.elapsed().as_secs_f64();
    assert_eq!((job.state, asked > 1), (JobState::Converged, true), "{:?}", job.reason);
    let spent = job.report.unwrap().time_spent.unwrap();

    let sum: f64 = spent.parts().iter().map(|(_, seconds)| seconds).sum();
    assert!((sum - spent.total_s).abs() < 1e-6, "{spent:?}");
    assert!((whole_s - spent.total_s).abs() < 0.1, "{whole_s} s: {spent:?}");
    // Whoever waits for the job to ask looks again and again.
    let asked_s = f64::from(asked) * OPERATOR.as_secs_f64();
    assert!((asked_s..asked_s + 0.1).contains(&spent.operator_s), "asked {asked} times: {spent:?}");
    let frames: u32 = job.iterations.iter().map(|iteration| iteration.spacing.frames).sum();
    let frames_s = f64::from(frames) * EXPOSURE_S;
    assert!((frames_s..frames_s + 0.2).contains(&spent.frames_s), "{frames} frames and a white one: {spent:?}");
    // At most so long after each move: what has settled by the time that a controller is sure to stand counts as motion.
    let moves = job.iterations.iter().filter(|iteration| iteration.axis.is_some()).count();
    let settling_s = moves as f64 * config.bench.focus.settle_ms as f64 / 1000.0;
    assert!(spent.settling_s > 0.05 && spent.settling_s < settling_s + 0.05, "{settling_s} s: {spent:?}");
    assert!(spent.measuring_s < 0.01 && spent.other_s < 0.1 && spent.motion_s > 1.0, "{spent:?}");
}
