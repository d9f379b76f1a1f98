//! A job's story: what its snapshots say, told as events, each once and in order.

use std::collections::BTreeMap;

use jiff::Timestamp;
use serde::Serialize;
use uuid::Uuid;

use crate::control::job::outcome::Outcome;
use crate::control::job::{
    Iteration, JobKind, JobRequest, JobSnapshot, JobState, LogLine, OperatorStep, Progress, Report, Stage,
};

/// Jobs remembered: a late snapshot of an earlier one is not taken for a new job.
const REMEMBERED: usize = 64;

/// Every event's name.
pub const EVENTS: [&str; 6] = ["started", "state", "log", "iteration", "operator_step", "ended"];

/// An event of a job.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct JobEvent {
    /// The job.
    pub(super) job: Uuid,
    pub(super) kind: JobKind,
    /// Number of the event within the job, from 1: a number that comes twice is the same event again, and one that is
    /// missing was given up.
    pub(super) number: u64,
    #[serde(skip)]
    pub(super) at: Timestamp,
    #[serde(flatten)]
    pub(super) what: What,
}

/// What happened.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub(super) enum What {
    Started {
        owner: String,
        simulated: bool,
        request: Box<JobRequest>,
    },
    State {
        state: JobState,
        stage: Stage,
        progress: Progress,
    },
    Log {
        message: String,
    },
    Iteration {
        iteration: Box<Iteration>,
    },
    OperatorStep {
        operator_step: OperatorStep,
    },
    Ended {
        state: JobState,
        reason: Option<String>,
        iterations: u64,
        report: Option<Box<Report>>,
        outcome: Option<Outcome>,
    },
}

/// What has been told of a job.
#[derive(Default)]
struct Told {
    /// Of the newest snapshot told of.
    generation: Option<u64>,
    number: u64,
    state: Option<(JobState, Stage)>,
    lines: usize,
    iterations: usize,
    step: u32,
    ended: bool,
}

/// The stories of this run's jobs.
#[derive(Default)]
pub(super) struct Stories(BTreeMap<Uuid, Told>);

impl Stories {
    /// What has happened to a job since its snapshot before.
    pub(super) fn tell(&mut self, job: &JobSnapshot) -> Vec<JobEvent> {
        let told = self.0.entry(job.id).or_default();
        if told.ended || told.generation.is_some_and(|generation| generation >= job.generation) {
            return Vec::new();
        }
        let news = told.news(job);
        // Identities grow with time: the first is the oldest.
        while self.0.len() > REMEMBERED {
            self.0.pop_first();
        }
        news
    }
}

impl Told {
    fn news(&mut self, job: &JobSnapshot) -> Vec<JobEvent> {
        let mut news: Vec<(Timestamp, What)> = Vec::new();
        if self.generation.is_none() {
            let request = Box::new(job.request.clone());
            let started = What::Started { owner: job.owner.clone(), simulated: job.simulated, request };
            news.push((job.created_at, started));
        }
        let now = job.ended_at.unwrap_or_else(Timestamp::now);
        if self.state != Some((job.state, job.stage)) && !job.state.is_final() {
            let (state, stage, progress) = (job.state, job.stage, job.progress.clone());
            news.push((now, What::State { state, stage, progress }));
        }
        let mut done: Vec<(Timestamp, What)> = Vec::new();
        for LogLine { at, message } in job.log.iter().skip(self.lines) {
            done.push((*at, What::Log { message: message.clone() }));
        }
        for iteration in job.iterations.iter().skip(self.iterations) {
            done.push((iteration.at, What::Iteration { iteration: Box::new(iteration.clone()) }));
        }
        done.sort_by_key(|(at, _)| *at);
        news.extend(done);
        if let Some(step) = job.operator_step.as_ref().filter(|step| step.number > self.step) {
            self.step = step.number;
            news.push((now, What::OperatorStep { operator_step: step.clone() }));
        }
        if job.state.is_final() {
            self.ended = true;
            let ended = What::Ended {
                state: job.state,
                reason: job.reason.clone(),
                iterations: job.iterations.len() as u64,
                report: job.report.clone().map(Box::new),
                outcome: job.outcome.clone(),
            };
            news.push((now, ended));
        }
        self.generation = Some(job.generation);
        self.state = Some((job.state, job.stage));
        (self.lines, self.iterations) = (job.log.len(), job.iterations.len());
        let event = |(at, what)| {
            self.number += 1;
            JobEvent { job: job.id, kind: job.kind, number: self.number, at, what }
        };
        news.into_iter().map(event).collect()
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    fn snapshot() -> JobSnapshot {
        serde_json::from_value(json!({
            "id": "0199f0f2-5d2a-7c3e-9a53-5f0f6c1f6a11", "kind": "homing", "request": { "kind": "homing" },
            "owner": "ada", "state": "pending", "stage": "preparation", "simulated": true, "generation": 0,
            "created_at": "2026-11-22T14:00:00Z", "ended_at": null,
            "progress": { "step": 0, "of": 1, "doing": "accepted", "measure": null, "time_left_s": null },
            "operator_step": null, "iterations": [], "log": [], "reason": null, "report": null, "outcome": null
        }))
        .unwrap()
    }

    fn words(events: &[JobEvent]) -> Vec<String> {
        let word = |event: &JobEvent| {
            let json = serde_json::to_value(event).unwrap();
            let name = json["event"].as_str().unwrap().to_owned();
            assert!(EVENTS.contains(&name.as_str()), "{name}");
            match json.get("state").or(json.get("message")) {
                Some(Value::String(detail)) => format!("{} {name} {detail}", event.number),
                _ => format!("{} {name}", event.number),
            }
        };
        events.iter().map(word).collect()
    }

    #[test]
    fn every_change_is_told_once_and_in_order() {
        let (mut stories, mut job) = (Stories::default(), snapshot());
        let line =
            |s: i64, message: &str| LogLine { at: Timestamp::from_second(s).unwrap(), message: message.to_owned() };
        assert_eq!(words(&stories.tell(&job)), ["1 started", "2 state pending"]);
        assert_eq!(stories.tell(&job), []);
        let late = job.clone();
        job.generation = 3;
        job.state = JobState::Running;
        job.log = vec![line(1, "homing e"), line(2, "homing focus")];
        assert_eq!(words(&stories.tell(&job)), ["3 state running", "4 log homing e", "5 log homing focus"]);
        assert_eq!(stories.tell(&late), []);
        job.generation = 4;
        job.log.push(line(3, "done"));
        job.state = JobState::Succeeded;
        job.reason = Some("both axes are homed".to_owned());
        assert_eq!(words(&stories.tell(&job)), ["6 log done", "7 ended succeeded"]);
        job.generation = 5;
        assert_eq!(stories.tell(&job), []);
    }

    #[test]
    fn many_jobs_are_not_remembered_for_ever() {
        let (mut stories, mut job) = (Stories::default(), snapshot());
        for _ in 0..200 {
            job.id = Uuid::now_v7();
            assert_eq!(stories.tell(&job).len(), 2);
        }
        assert_eq!(stories.0.len(), REMEMBERED);
        assert_eq!(stories.tell(&job), []);
    }
}
