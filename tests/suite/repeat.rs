//! An earlier step of an alignment asked for again, where it went wrong: without losing the job.

use std::sync::Arc;
use std::time::Duration;

use plenalign::config::ConfigOrigin;
use plenalign::control::events::{InView, ShellState};
use plenalign::control::history::read;
use plenalign::control::job::steps::{JobStep, StepState};
use plenalign::control::job::{JobKind, JobRequest, JobSnapshot, JobState};
use plenalign::control::plan::PlanView;
use plenalign::control::replay::replay;
use plenalign::control::{Refusal, Service, ServiceError, Shown, open_bench};
use plenalign::store::Store;
use uuid::Uuid;

use super::bench::{key_and_permit, quick_axes, small_config};
use super::until::{elapse, until, when};

/// How long the operator takes for everything that is asked.
const OPERATOR: Duration = Duration::from_secs(5);

/// The job once it asks for a step after `seen`, or has ended.
async fn asks(service: &Arc<Service>, id: Uuid, seen: u32) -> JobSnapshot {
    until("the job asks for more, or has ended", async || {
        let job = service.job(id).unwrap();
        let new = job.operator_step.as_ref().is_none_or(|step| step.number > seen);
        let here = |state: &JobState| state.is_final() || (*state == JobState::WaitingForOperator && new);
        when(job.state, here).map(|_| job).map_err(|state| state.to_string())
    })
    .await
}

/// What a refusal says of the job's state.
fn why(answer: Result<JobSnapshot, ServiceError>) -> String {
    match answer {
        Err(ServiceError::Refused(Refusal::JobState { why, .. })) => why,
        other => panic!("{other:?}"),
    }
}

#[tokio::test(start_paused = true)]
async fn a_white_frame_and_a_board_are_done_again_without_losing_the_job() {
    let mut config = small_config(7);
    config.bench.simulation.operator_confirms = false;
    config.bench.simulation.rays = 8;
    quick_axes(&mut config.bench);
    let (config, store) = (Arc::new(config), Store::in_memory());
    let bench = open_bench(&config).await.unwrap();
    let service = Service::start(config, "a test's configuration".to_owned(), bench, store.clone());
    let (key, permit) = key_and_permit(&service);
    let shown = Shown { lease: Some(&key), ..Shown::default() };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("repeated.mcap");
    let request = JobRequest::of(JobKind::JointAlignment);
    let id = service.create_job_recorded(&permit, request, file.clone()).await.unwrap().id;

    let first = asks(&service, id, 0).await;
    let planned: Vec<_> = first.steps.iter().map(|step| (step.name.as_str(), step.state)).collect();
    let (now, next) = (StepState::Now, StepState::Next);
    let rest = [("white_frame", now), ("triple_board_in_air", next), ("aperture", next), ("shell_and_water", next)];
    assert_eq!(planned, [&[("preparation", StepState::Done)][..], &rest].concat());
    assert!(first.operator_step.unwrap().repeatable.is_empty());
    assert_eq!(
        why(service.repeat(id, 1, shown)),
        "at step 1 (white_frame) no earlier step can be asked for again, not step 1"
    );

    // The white frame once more while the board is waited for; the board once more while the aperture is, and while the
    // shell is, when the image distance has been set.
    let (mut seen, mut at_aperture, mut at_shell, mut iterations) = (0, false, false, 0);
    let job = loop {
        let job = asks(&service, id, seen).await;
        let Some(step) = job.operator_step.clone() else { break job };
        elapse(OPERATOR).await;
        seen = step.number;
        match (step.number, step.name.as_str()) {
            (2, _) => {
                assert_eq!(step.repeatable, [1]);
                assert_eq!(service.bench_view().shell, ShellState::Off, "the white frame was taken without it");
                assert_eq!(
                    service.repeat(id, 1, Shown::default()).unwrap_err(),
                    ServiceError::Refused(Refusal::ConfirmKeyRequired)
                );
                service.repeat(id, 1, shown).unwrap();
            }
            (3, name) => {
                assert_eq!((name, step.repeats), ("white_frame", Some(1)));
                service.confirm(id, 3, shown).await.unwrap();
            }
            (_, "aperture") if !at_aperture => {
                (at_aperture, iterations) = (true, job.iterations.len());
                assert_eq!(step.repeatable, [3, 4]);
                let refused = why(service.repeat(id, 1, shown));
                assert_eq!(
                    refused,
                    format!("at step {} (aperture) step 3 and step 4 can be asked for again, not step 1", step.number)
                );
                service.repeat(id, 4, shown).unwrap();
            }
            (_, "shell_and_water") if !at_shell => {
                (at_shell, iterations) = (true, job.iterations.len());
                assert_eq!(step.repeatable, [3, 6]);
                let far = job.progress;
                service.repeat(id, 6, shown).unwrap();
                let again = asks(&service, id, seen).await;
                assert!(again.progress.step < far.step && again.progress.of == far.of, "{far:?}, {:?}", again.progress);
            }
            // It has come to where it was; the rest is as without.
            (_, "shell_and_water") => drop(service.cancel(id, None).unwrap()),
            _ => drop(service.confirm(id, step.number, shown).await.unwrap()),
        }
    };
    assert_eq!(job.state, JobState::Cancelled, "{:?}", job.reason);
    assert!(
        at_aperture && at_shell && iterations > 0 && job.iterations.len() >= iterations,
        "what was measured before is kept"
    );
    let left = service.bench_view();
    assert_eq!(left.shell, ShellState::Unknown, "nobody has said whether it was mounted");
    assert_eq!(left.in_view, InView::Other, "nor whether the board stands there");
    let report = job.report.as_ref().unwrap();
    // All but what was measured since the board was put up last.
    let last = job.steps.iter().find(|step| step.repeats == Some(6)).unwrap().began_at.unwrap();
    for it in &job.iterations {
        assert_eq!(it.discarded, it.at < last, "iteration {}", it.number);
    }
    assert!(job.iterations.iter().any(|it| it.at < last) && job.iterations.iter().any(|it| it.at >= last));

    let told: Vec<_> = job.steps.iter().map(|step| (step.name.as_str(), step.state, step.repeats)).collect();
    let (done, repeated) = (StepState::Done, StepState::Repeated);
    let expected = [
        ("preparation", done, None),
        ("white_frame", repeated, None),
        ("triple_board_in_air", repeated, None),
        ("white_frame", done, Some(1)),
        ("triple_board_in_air", repeated, None),
        ("aperture", repeated, None),
        ("triple_board_in_air", repeated, Some(4)),
        // The lens stays stopped down.
        ("aperture", done, None),
        ("shell_and_water", repeated, None),
        ("triple_board_in_air", done, Some(6)),
        ("shell_and_water", now, None),
    ];
    assert_eq!(told, expected);
    let spent = report.time_spent.unwrap();
    let sum =
        |of: fn(&plenalign::control::job::steps::JobStep) -> Option<f64>| job.steps.iter().filter_map(of).sum::<f64>();
    let (operator_s, bench_s) = (sum(|step| step.operator_s), sum(|step| step.bench_s));
    assert!((operator_s - spent.operator_s).abs() < 0.1, "{operator_s}: {spent:?}");
    assert!((bench_s - (spent.total_s - spent.operator_s)).abs() < 0.5, "{bench_s}: {spent:?}");
    store.flush().await;
    let written = read::job(&store, id).await.unwrap().unwrap();
    assert_eq!(written.iterations, job.iterations, "as the next run of the program finds them");
    let archive = service.archive(id).await.unwrap();
    let csv = plenalign::api::export::csv(&archive);
    let mut lines = csv.lines();
    let column = lines.next().unwrap().split(',').position(|name| name == "discarded").unwrap();
    for (line, it) in lines.zip(&job.iterations) {
        assert_eq!(line.split(',').nth(column), Some(if it.at < last { "true" } else { "false" }), "{line}");
    }
    let kept = |number: u32| archive.operator_steps.iter().find(|asked| asked.step.number == number).unwrap();
    assert_eq!((kept(2).confirmed_at, kept(3).step.repeats), (None, Some(1)));
    let printed = plenalign::api::export::html(&archive);
    assert_eq!(
        printed.matches("<tr class=\"discarded\">").count(),
        job.iterations.iter().filter(|it| it.at < last).count()
    );
    assert!(printed.contains("step 4 once more") && printed.contains("asked for again, counts no more"));
    assert!(job.log.iter().any(|line| line.message == "in place of step 2 the operator asks for step 1 again"));

    // Replayed, the same steps are asked for again, and the same comes of it.
    let replayed = replay(&file).await.unwrap();
    assert!(replayed.identical, "{:?} {:?}", replayed.differences, replayed.replayed_end);
}

/// A flat board is put up where levels were asked for, which are not told apart then.
#[tokio::test(start_paused = true)]
async fn levels_that_were_given_up_for_a_flat_board_are_asked_for_again_as_such() {
    let mut config = small_config(7);
    let plan = PlanView::of(&config, &ConfigOrigin::Preset);
    let [near, middle, far] = [0, 1, 2].map(|level| plan.boards[level].distance_mm);
    let simulation = &mut config.bench.simulation;
    (simulation.operator_confirms, simulation.rays) = (false, 8);
    simulation.level_errors_mm = [middle - near, 0.0, middle - far];
    quick_axes(&mut config.bench);
    let config = Arc::new(config);
    let bench = open_bench(&config).await.unwrap();
    let service = Service::start(config, "a test's configuration".to_owned(), bench, Store::in_memory());
    let (key, permit) = key_and_permit(&service);
    let shown = Shown { lease: Some(&key), ..Shown::default() };
    let id = service.create_job(&permit, JobRequest::of(JobKind::JointAlignment)).await.unwrap().id;
    let (mut seen, mut given_up, mut again) = (0, None, None);
    let job = loop {
        let job = asks(&service, id, seen).await;
        let Some(step) = job.operator_step.clone() else { break job };
        elapse(OPERATOR).await;
        seen = step.number;
        if again == Some(step.number - 1) {
            assert_eq!((step.name.as_str(), step.repeats), ("triple_board_in_air", given_up));
            again = None;
        }
        match step.name.as_str() {
            "board_in_air" if given_up.is_none() => {
                let next = |step: &&JobStep| step.state == StepState::Next;
                let to_come: Vec<&str> = job.steps.iter().filter(next).map(|step| step.name.as_str()).collect();
                assert_eq!(
                    to_come,
                    ["board_in_air", "board_in_air", "shell_and_water"],
                    "the other places are to come"
                );
                (given_up, again) = (step.repeatable.last().copied(), Some(step.number));
                service.repeat(id, given_up.unwrap(), shown).unwrap();
            }
            "shell_and_water" => drop(service.cancel(id, Some("Ada")).unwrap()),
            _ => drop(service.confirm(id, step.number, shown).await.unwrap()),
        }
    };
    assert_eq!(job.reason.as_deref(), Some("cancelled by Ada"), "{:?}", job.log);
    assert!(again.is_none() && given_up.is_some(), "{:?}", job.steps);
    let done = |step: &&JobStep| step.state == StepState::Done && step.name == "board_in_air";
    assert_eq!(job.steps.iter().filter(done).count(), 3, "levels that are none are given up again: {:?}", job.steps);
}
