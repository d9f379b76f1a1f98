//! What earlier versions have written into the history is read by this one: rows with the documents of the first version
//! that kept any.

use jiff::Timestamp;
use plenalign::config::Config;
use plenalign::store::Store;
use plenalign::store::records::{Entry, Job, Line, OperatorStep, Run};
use serde_json::{Value, json};
use uuid::Uuid;

use super::daemon::Daemon;
use super::fakes::fakes;

const AT: &str = "2025-03-01T10:00:00Z";

/// A job's document of then: it knew no owner and no outcome, and what was asked for was in the row alone.
fn document(id: Uuid) -> Value {
    json!({
        "id": id, "kind": "joint_alignment", "state": "converged", "stage": "shell", "simulated": true,
        "generation": 41, "created_at": AT, "ended_at": AT,
        "progress": { "step": 9, "of": 9, "doing": "done" },
        "operator_step": null, "iterations": [], "log": [], "reason": "the spacing meets its target, verified",
        "report": null,
    })
}

fn spacing() -> Value {
    json!({
        "spacing_px": 30.51, "spacing_sigma_px": 0.01, "tilt_x_px": 0.0, "tilt_y_px": 0.0, "curvature_px": 0.0,
        "pairs": 900, "frames": 4,
    })
}

/// An iteration's document of then.
fn iteration() -> Value {
    json!({
        "number": 1, "stage": "air", "kind": "move", "axis": "focus", "focus_mm": 2.2, "e_mm": 30.0,
        "delta_v_mm": 2.2, "delta_v_sigma_mm": 0.001, "e_estimate_mm": null, "e_estimate_sigma_mm": null,
        "spacing": spacing(), "spacing_predicted_px": null, "spacing_target_px": 30.5,
        "decision": "within tolerance, verified", "at": AT,
    })
}

/// A measurement's document of then.
fn measurement() -> Value {
    json!({
        "frame_seq": 7, "captured_at": AT, "focus_mm": 2.2, "e_mm": 30.0, "settled": true, "spacing": spacing(),
        "spacing_target_px": 30.5, "in_focus": true, "micro_image_pitch_px": 30.1, "eog": null,
    })
}

async fn written(store: &Store) -> Uuid {
    let at: Timestamp = AT.parse().unwrap();
    let run = Run {
        id: Uuid::now_v7(),
        bench: "another".to_owned(),
        version: "0.0.1".to_owned(),
        configuration: String::new(),
        started_at: at,
    };
    let id = Uuid::now_v7();
    let job = Job {
        id,
        run: run.id,
        kind: "joint_alignment".to_owned(),
        state: "converged".to_owned(),
        simulated: true,
        generation: 41,
        created_at: at,
        ended_at: Some(at),
        reason: Some("the spacing meets its target, verified".to_owned()),
        request: json!({ "kind": "joint_alignment" }),
        idempotency_key: None,
        document: document(id),
    };
    let step = json!({ "number": 1, "name": "white_frame", "instruction": "Put the diffuser on.", "value": null });
    let step = OperatorStep { number: 1, document: step, asked_at: at, confirmed_at: Some(at) };
    store
        .write(move |writer| {
            writer.begin_run(&run)?;
            writer.put_job(&job)?;
            writer.put_line(id, &Line { number: 1, at, message: "begun".to_owned() })?;
            writer.put_iteration(id, &Entry { number: 1, at, document: iteration() })?;
            writer.add_measurement(Some(id), at, &measurement())?;
            writer.put_operator_step(id, &step)
        })
        .await
        .unwrap();
    id
}

#[tokio::test]
async fn a_job_of_the_first_version_is_listed_shown_and_exported() {
    let store = Store::in_memory();
    let id = written(&store).await;
    let daemon = Daemon::start_keeping(Config::default(), fakes().bench, store).await;
    let get = async |path: &str| {
        let response = daemon.get(path).await;
        let status = response.status();
        let text = response.text().await.unwrap();
        assert_eq!(status, 200, "{path}: {text}");
        text
    };
    let read = async |path: &str| serde_json::from_str::<Value>(&get(path).await).unwrap();
    let href = format!("/api/v1/jobs/{id}");
    let list = read("/api/v1/jobs").await;
    assert_eq!((&list["jobs"][0]["id"], &list["jobs"][0]["iterations"]), (&json!(id), &json!(1)));
    assert_eq!(list["history_fault"], Value::Null);
    let job = read(&href).await;
    assert_eq!((&job["owner"], &job["outcome"]), (&json!(""), &Value::Null));
    assert_eq!(job["request"], json!({ "kind": "joint_alignment" }));
    assert_eq!(job["progress"]["time_left_s"], Value::Null);
    assert_eq!(job["iterations"][0]["delta_v_target_mm"], Value::Null);
    assert_eq!(job["iterations"][0]["spacing"], spacing());
    assert_eq!(job["log"][0]["message"], "begun");
    assert_eq!(read(&format!("{href}/iterations")).await["iterations"], job["iterations"]);
    // What that version did not know is null.
    let mut measured = measurement();
    for unknown_then in ["eog_sum", "ssim", "micro_image_pitch_sigma_px", "spacing_tolerance_px", "two_boards"] {
        measured[unknown_then] = Value::Null;
    }
    measured["spacing_target_source"] = json!("paraxial");
    assert_eq!(read(&format!("{href}/measurements")).await["measurements"], json!([measured]));
    let export = read(&format!("{href}/export.json")).await;
    assert_eq!(export["operator_steps"][0]["name"], "white_frame");
    assert!(get(&format!("{href}/export.csv")).await.contains("30.51"));
    assert!(get(&format!("{href}/report.html")).await.contains(&id.to_string()));
}
