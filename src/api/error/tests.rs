//! How a refusal is told.

use uuid::Uuid;

use super::*;
use crate::config::Side;
use crate::control::job::JobState;
use crate::device::AxisName;
use crate::units::Millimetres;

#[test]
fn a_refusal_names_its_kind_and_its_numbers() {
    let limit = Refusal::Limit {
        axis: AxisName::Focus,
        target: Millimetres(9.0),
        low: Millimetres(-2.0),
        high: Millimetres(5.0),
    };
    let problem = serde_json::to_value(Problem::from(limit)).unwrap();
    assert_eq!(problem["type"], "urn:plenalign:problem:limit");
    assert_eq!(problem["status"], 409);
    assert_eq!((&problem["axis"], &problem["high_mm"]), (&json!("focus"), &json!(5.0)));

    let job = Uuid::nil();
    let problem = Problem::from(Refusal::Busy { job });
    assert_eq!(problem.members["job"], json!(job));
    assert_eq!(problem.members["href"], json!(format!("/api/v1/jobs/{job}")));
}

#[test]
fn a_jobs_state_is_spelt_as_in_the_job() {
    let spelt = [
        (JobState::Pending, "pending"),
        (JobState::Running, "running"),
        (JobState::WaitingForOperator, "waiting_for_operator"),
        (JobState::Cancelling, "cancelling"),
        (JobState::Converged, "converged"),
        (JobState::Succeeded, "succeeded"),
        (JobState::NotConverged, "not_converged"),
        (JobState::Cancelled, "cancelled"),
        (JobState::Failed, "failed"),
        (JobState::Interrupted, "interrupted"),
    ];
    for (state, word) in spelt {
        let problem = serde_json::to_value(Problem::from(Refusal::JobState { state, why: "why".into() })).unwrap();
        assert_eq!(problem["state"], word);
        assert_eq!(problem["state"], json!(state), "in the job itself");
        assert_eq!(problem["detail"], format!("the job is {word}: why"));
    }
}

#[test]
fn refused_now_is_409_and_a_device_gone_is_503_with_a_time_to_try_again() {
    let axis = AxisName::E;
    for refusal in [
        Refusal::Stopped,
        Refusal::Wall { target: Millimetres(-1.0), wall: Millimetres(-0.1), untold: false },
        Refusal::Step { axis, distance: Millimetres(50.0), max: Millimetres(40.0) },
        Refusal::NotHomed { axis },
        Refusal::Moving { axis },
        Refusal::Contradiction { axis, contradictions: vec!["It homes to the other end ($23).".into()] },
        Refusal::HomingTowardsShell { axis, shell: "unknown" },
        Refusal::SwitchPressed { axis, why: "one of two".into() },
        Refusal::LeavingTowardsShell { pressed: Side::High, shell: "on" },
        Refusal::JobState { state: JobState::Running, why: "nothing waits".into() },
        Refusal::LeaseHeld { owner: "ada".into(), note: None, job: None },
    ] {
        assert_eq!(Problem::from(refusal).status, 409);
    }
    assert_eq!(Problem::from(Refusal::LeaseRequired).status, 428);
    assert_eq!(Problem::from(Refusal::LeaseLost { holder: None }).status, 412);
    let gone = DeviceError::Disconnected { device: "camera".into(), reason: "ENODEV".into() };
    let response = Problem::from(gone).into_response();
    assert_eq!(response.status(), 503);
    assert!(response.headers().contains_key(header::RETRY_AFTER));
    assert_eq!(response.headers()[header::CONTENT_TYPE], "application/problem+json");
}
