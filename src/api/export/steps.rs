//! A job's steps in its report.

use std::fmt::Write as _;

use super::html;
use crate::control::job::steps::{JobStep, StepState};
use crate::text::escape;

/// The steps, and how long each took.
pub(super) fn steps(page: &mut String, steps: &[JobStep]) {
    if steps.is_empty() {
        return;
    }
    page.push_str(
        "<h2>Steps</h2>\n<table>\n<tr><th>#</th><th>step</th><th>operator, s</th><th>bench, s</th><th></th></tr>\n",
    );
    for step in steps {
        let number = step.number.map_or_else(|| "–".to_owned(), |number| number.to_string());
        let value = step.value.as_ref().map_or_else(String::new, |value| format!(": {value}"));
        let repeats = step.repeats.map(|earlier| format!("step {earlier} once more"));
        let state = match step.state {
            StepState::Done => None,
            StepState::Now => Some("not finished".to_owned()),
            StepState::Next => Some("not reached".to_owned()),
            StepState::Repeated => Some("asked for again, counts no more".to_owned()),
        };
        let marks: Vec<String> = repeats.into_iter().chain(state).collect();
        let _ = writeln!(
            page,
            "<tr><td>{number}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td>{}</td></tr>",
            escape(&format!("{}{value}", step.name.replace('_', " "))),
            html::number(step.operator_s, None, 1),
            html::number(step.bench_s, None, 1),
            escape(&marks.join("; "))
        );
    }
    page.push_str("</table>\n");
}
