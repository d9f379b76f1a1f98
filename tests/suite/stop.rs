//! The stop against jobs that come and go around it.

use std::sync::Arc;
use std::time::Duration;

use plenalign::control::job::{JobKind, JobRequest, JobState};
use plenalign::device::StopDelivery;

use super::bench::{permit, service, small_config};
use super::until::{elapse, until};

#[tokio::test(start_paused = true)]
async fn a_stop_ends_the_job_of_its_moment_and_no_later_one() {
    let mut config = small_config(1);
    config.bench.simulation.operator_confirms = false;
    let service = service(config).await;
    let begin =
        async || service.create_job(&permit(&service), JobRequest::of(JobKind::JointAlignment)).await.unwrap().id;
    let stop = || {
        let service = Arc::clone(&service);
        tokio::spawn(async move { service.stop(tokio::time::Instant::now(), "a test").await })
    };

    let first = begin().await;
    elapse(Duration::from_millis(500)).await;
    let stopped = stop().await.unwrap();
    assert_eq!((stopped.focus, stopped.e), (StopDelivery::Confirmed, StopDelivery::Confirmed));
    until("the job ends", async || service.job(first).unwrap().state.is_final()).await;
    assert_eq!(service.job(first).unwrap().state, JobState::Cancelled);
    service.reset_stop("a test", "it goes on").await.unwrap().unwrap();

    // Stopping takes a while; here the stop is reset, and a job begun, before it is over.
    let stopping = stop();
    until("the stop is latched", async || service.bench_view().stop.latched).await;
    service.reset_stop("a test", "it goes on").await.unwrap().unwrap();
    let second = begin().await;
    assert!(!stopping.is_finished());
    stopping.await.unwrap();
    let begins = || matches!(service.job(second).unwrap().state, JobState::Pending | JobState::Running);
    until("the job asks", async || !begins()).await;
    let job = service.job(second).unwrap();
    assert_eq!(job.state, JobState::WaitingForOperator, "{:?}", job.reason);
    service.shut_down().await;
}
