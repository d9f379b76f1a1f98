//! A job's progress on standard error: a line per iteration, and a bar below them on a terminal.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::report;
use crate::control::job::{JobSnapshot, JobState};

/// What has been shown of a job, and the bar.
pub(super) struct Progress {
    bar: ProgressBar,
    iterations: usize,
    operator_step: Option<u32>,
    /// How an operator step is confirmed, in words.
    how_to_confirm: String,
    /// What is typed before the number of an earlier step to ask for it again; none where nothing is typed.
    how_to_repeat: Option<&'static str>,
}

impl Progress {
    /// Nothing shown yet.
    pub(super) fn new(how_to_confirm: String, how_to_repeat: Option<&'static str>) -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{elapsed:>4} [{bar:30}] {pos}/{len} {msg}") {
            bar.set_style(style.progress_chars("=> "));
        }
        Self { bar, iterations: 0, operator_step: None, how_to_confirm, how_to_repeat }
    }

    /// A line of its own.
    pub(super) fn say(&self, line: &str) {
        self.bar.suspend(|| eprintln!("{line}"));
    }

    /// What is new of the job.
    pub(super) fn show(&mut self, job: &JobSnapshot) {
        for iteration in job.iterations.iter().skip(self.iterations) {
            self.say(&report::iteration_line(iteration));
        }
        self.iterations = job.iterations.len();
        if let Some(step) = &job.operator_step
            && job.state == JobState::WaitingForOperator
            && self.operator_step != Some(step.number)
        {
            self.operator_step = Some(step.number);
            self.say(&report::operator_line(step));
            self.say(&format!("  {}", self.how_to_confirm));
            if let (Some(how), false) = (self.how_to_repeat, step.repeatable.is_empty()) {
                let steps: Vec<_> = step.repeatable.iter().map(|earlier| format!("{how} {earlier}")).collect();
                self.say(&format!("  to do an earlier step again: {}", steps.join(", ")));
            }
        }
        self.bar.set_length(job.progress.of.into());
        self.bar.set_position(job.progress.step.into());
        self.bar.set_message(job.progress.doing.clone());
    }

    /// Takes the bar away.
    pub(super) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
