//! Jobs as lines of text and as one JSON object, the same whether a job runs in process or in a daemon.

use std::fmt::Write;

use serde_json::{Value, json};

use crate::api::export::figures::{BUDGET, budget, figures, value};
use crate::api::export::outcome::outcome_figures;
use crate::control::job::{Iteration, IterationKind, JobSnapshot, JobState, OperatorStep, Stage};

/// One iteration as a line: where the axes are, what was measured against what is wanted, what was decided.
pub(crate) fn iteration_line(iteration: &Iteration) -> String {
    let spacing = &iteration.spacing;
    let mut line = format!(
        "{:>3}  {:<5} {:<6}  Δv {}  e {}  spacing {:8.4} ± {:.4} px  target {:8.4}",
        iteration.number,
        stage_word(iteration.stage),
        kind_word(iteration.kind),
        value(iteration.delta_v_mm.or(iteration.focus_mm), iteration.delta_v_sigma_mm, 4),
        value(iteration.e_estimate_mm.or(iteration.e_mm), iteration.e_estimate_sigma_mm, 3),
        spacing.spacing_px,
        spacing.spacing_sigma_px,
        iteration.spacing_target_px,
    );
    if !iteration.decision.is_empty() {
        let _ = write!(line, "  {}", iteration.decision);
    }
    line
}

/// What the operator is asked to do, as a line.
pub(crate) fn operator_line(step: &OperatorStep) -> String {
    match &step.value {
        Some(value) => format!("operator step {}: {} [{value}]", step.number, step.instruction),
        None => format!("operator step {}: {}", step.number, step.instruction),
    }
}

/// A job's end as text: the outcome and why, then the figures of its report.
pub(crate) fn report_text(job: &JobSnapshot) -> String {
    let mut text = String::new();
    let outcome = job.report.as_ref().map_or(job.state, |report| report.outcome);
    let _ = writeln!(text, "{}{}", outcome_words(outcome), if job.simulated { "  (SIMULATED bench)" } else { "" });
    let reason = job.reason.as_deref().or(job.report.as_ref().map(|report| report.reason.as_str()));
    if let Some(reason) = reason.filter(|reason| !reason.is_empty()) {
        let _ = writeln!(text, "  {reason}");
    }
    if let Some(report) = &job.report {
        push_figures(&mut text, &figures(report));
        for note in &report.notes {
            let _ = writeln!(text, "  note: {note}");
        }
        let rows = budget(report);
        if !rows.is_empty() {
            let heads = BUDGET.map(str::to_owned);
            text.push('\n');
            for [name, delta_v, e, blur] in std::iter::once(&heads).chain(&rows) {
                let _ = writeln!(text, "  {name:<40} {delta_v:>12} {e:>12} {blur:>16}");
            }
        }
    }
    if let Some(outcome) = &job.outcome {
        push_figures(&mut text, &outcome_figures(outcome));
    }
    text
}

fn push_figures(text: &mut String, rows: &[(&str, String)]) {
    text.push('\n');
    for (name, value) in rows {
        let _ = writeln!(text, "  {name:<26} {value}");
    }
}

/// A job's end as one JSON object: the report's own keys, the iterations, and which job it was.
pub(crate) fn report_json(job: &JobSnapshot) -> Value {
    let mut object = match serde_json::to_value(&job.report) {
        Ok(Value::Object(object)) => object,
        _ => serde_json::Map::new(),
    };
    if !job.simulated {
        object.remove("truth");
    }
    let mut say = |name: &str, value: Value| {
        object.entry(name).or_insert(value);
    };
    say("outcome", json!(job.state));
    say("reason", json!(job.reason));
    say("job", json!(job.id));
    say("simulated", json!(job.simulated));
    say("iterations", json!(job.iterations));
    Value::Object(object)
}

/// What an ending is called.
pub(crate) fn outcome_words(state: JobState) -> &'static str {
    match state {
        JobState::Pending => "pending",
        JobState::Running => "running",
        JobState::WaitingForOperator => "waiting for the operator",
        JobState::Cancelling => "cancelling",
        JobState::Converged => "converged",
        JobState::Succeeded => "succeeded",
        JobState::NotConverged => "not converged",
        JobState::Cancelled => "cancelled",
        JobState::Failed => "failed",
        JobState::Interrupted => "interrupted by the end of the program",
    }
}

fn stage_word(stage: Stage) -> &'static str {
    match stage {
        Stage::Preparation => "prep",
        Stage::LBound => "bound",
        Stage::Air => "air",
        Stage::Shell => "shell",
        Stage::Survey => "survey",
        Stage::Report => "end",
    }
}

fn kind_word(kind: IterationKind) -> &'static str {
    match kind {
        IterationKind::Start => "start",
        IterationKind::Probe => "probe",
        IterationKind::Move => "move",
        IterationKind::Verify => "verify",
        IterationKind::Sample => "sample",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::job::{JobKind, JobRequest, Progress};
    use crate::control::spacing::SpacingReading;

    fn iteration() -> Iteration {
        Iteration {
            number: 3,
            stage: Stage::Air,
            kind: IterationKind::Move,
            axis: Some(crate::device::AxisName::Focus),
            focus_mm: Some(2.19),
            e_mm: Some(30.0),
            delta_v_mm: Some(2.2041),
            delta_v_sigma_mm: Some(0.0004),
            delta_v_target_mm: None,
            e_estimate_mm: None,
            e_estimate_sigma_mm: None,
            spacing: SpacingReading {
                spacing_px: 19.7312,
                spacing_sigma_px: 0.0021,
                tilt_x_px: 0.0,
                tilt_y_px: 0.0,
                curvature_px: 0.1,
                pairs: 2900,
                frames: 1,
            },
            spacing_predicted_px: Some(19.73),
            spacing_target_px: 19.7251,
            eog: None,
            decision: "within tolerance: verify".into(),
            discarded: false,
            at: jiff::Timestamp::UNIX_EPOCH,
        }
    }

    #[test]
    fn a_line_has_positions_spacing_target_and_decision() {
        let line = iteration_line(&iteration());
        for part in ["air", "2.2041 ± 0.0004 mm", "30.000 mm", "19.7312 ± 0.0021 px", "19.7251", "verify"] {
            assert!(line.contains(part), "{part:?} is not in {line:?}");
        }
    }

    #[test]
    fn a_job_without_a_report_still_says_how_it_ended() {
        let job = JobSnapshot {
            id: uuid::Uuid::nil(),
            kind: JobKind::JointAlignment,
            request: JobRequest::of(JobKind::JointAlignment),
            owner: "ada".to_owned(),
            state: JobState::Failed,
            stage: Stage::Air,
            simulated: true,
            generation: 9,
            created_at: jiff::Timestamp::UNIX_EPOCH,
            ended_at: None,
            progress: Progress { step: 1, of: 9, doing: "nothing".into(), measure: None, time_left_s: None },
            operator_step: None,
            steps: vec![],
            iterations: vec![iteration()],
            log: vec![],
            reason: Some("the focus axis did not move".into()),
            report: None,
            outcome: None,
            recording: None,
        };
        assert_eq!(report_text(&job), "failed  (SIMULATED bench)\n  the focus axis did not move\n");
        let json = report_json(&job);
        assert_eq!((&json["outcome"], &json["reason"]), (&json!("failed"), &json!("the focus axis did not move")));
        assert_eq!(json["iterations"].as_array().map(Vec::len), Some(1));
    }
}
