//! A running job as the service holds it: what it has come to, and how it is answered and cancelled.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use tokio::sync::{broadcast, mpsc};
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

use super::context::JobContext;
use crate::events::Event;
use crate::history::journal::{Chronicle, Journal, Written};
use crate::job::{JobRequest, JobSnapshot, JobState, LogLine, Progress, Recording, RecordingState, Stage};
use crate::recording::FileSink;
use crate::refusal::{Refusal, ServiceError};
use bench::device::SimulatedOperator;

/// One job as the service and its own task share it.
pub(crate) struct Job {
    pub(super) snapshot: Mutex<JobSnapshot>,
    pub(super) events: broadcast::Sender<Event>,
    pub(super) cancel: CancellationToken,
    /// Why it was asked to end; the first asker's word counts.
    pub(super) cancelled_why: OnceLock<String>,
    pub(super) answers: mpsc::Sender<Answer>,
    pub(super) last_answer: Mutex<Option<Answer>>,
    pub(super) journal: Arc<Journal>,
    pub(super) idempotency_key: Option<String>,
    pub(super) kept: Mutex<Kept>,
    /// The file that it is recorded to.
    pub(super) file: OnceLock<Arc<FileSink>>,
    /// How long this bench takes for such a job by itself, s, where its history tells.
    pub(super) usual_s: OnceLock<f64>,
}

/// What the operator answers to a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Answer {
    /// The step that it answers.
    pub(super) to: u32,
    /// Which earlier one is asked for again; none where it has been carried out.
    pub(super) again: Option<u32>,
}

/// What the history has been given of a job.
#[derive(Default)]
pub(super) struct Kept {
    pub(super) written: Written,
    /// The job without its iterations and its log, as it was written last.
    pub(super) newest: Option<JobSnapshot>,
}

impl Job {
    /// A job just accepted, and the side of it that its task holds.
    pub(crate) fn new(
        request: &JobRequest,
        idempotency_key: Option<String>,
        owner: &str,
        journal: Arc<Journal>,
        events: broadcast::Sender<Event>,
        operator: Option<Arc<dyn SimulatedOperator>>,
    ) -> (Arc<Self>, JobContext) {
        let (answers, answered) = mpsc::channel(4);
        let snapshot = JobSnapshot {
            id: Uuid::now_v7(),
            kind: request.kind,
            request: request.clone(),
            owner: owner.to_owned(),
            state: JobState::Pending,
            stage: Stage::Preparation,
            simulated: operator.is_some(),
            generation: 0,
            created_at: jiff::Timestamp::now(),
            ended_at: None,
            progress: Progress { step: 0, of: 1, doing: "accepted".to_owned(), measure: None, time_left_s: None },
            operator_step: None,
            steps: Vec::new(),
            iterations: Vec::new(),
            log: Vec::new(),
            reason: None,
            report: None,
            outcome: None,
            recording: None,
        };
        let job = Arc::new(Self {
            snapshot: Mutex::new(snapshot),
            events,
            cancel: CancellationToken::new(),
            cancelled_why: OnceLock::new(),
            answers,
            last_answer: Mutex::new(None),
            journal,
            idempotency_key,
            kept: Mutex::default(),
            file: OnceLock::new(),
            usual_s: OnceLock::new(),
        });
        let context = JobContext::new(Arc::clone(&job), answered, operator);
        (job, context)
    }

    /// The job as it is now.
    pub(crate) fn snapshot(&self) -> JobSnapshot {
        self.snapshot.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(super) fn change(&self, change: impl FnOnce(&mut JobSnapshot)) {
        let snapshot = {
            let mut snapshot = self.snapshot.lock().unwrap_or_else(PoisonError::into_inner);
            change(&mut snapshot);
            snapshot.generation += 1;
            snapshot.clone()
        };
        self.keep(&snapshot);
        // Nobody listening is no error.
        let _ = self.events.send(Event::Job { job: Box::new(snapshot) });
    }

    /// Says how its recording fares.
    pub(crate) fn recording(&self, recording: Recording) {
        self.change(|job| job.recording = Some(recording));
    }

    /// Takes how long this bench usually takes for such a job by itself, s.
    pub(crate) fn expect(&self, usual_s: f64) {
        if self.usual_s.set(usual_s).is_ok() && !self.snapshot().state.is_final() {
            // It has hardly begun: what the first step has taken by now is less than the guess is good to.
            self.change(|job| {
                job.progress.time_left_s.get_or_insert(usual_s);
            });
        }
    }

    /// Has it recorded to a file from now on.
    pub(crate) fn record_to(&self, file: Arc<FileSink>) {
        let _ = self.file.set(file);
    }

    /// Says that its recording has ended before it, and why: the job goes on.
    pub(crate) fn recording_failed(&self, why: String) {
        let line = LogLine { at: jiff::Timestamp::now(), message: format!("not recorded any further: {why}") };
        self.change(|job| {
            if let Some(recording) = &mut job.recording {
                (recording.state, recording.fault) = (RecordingState::Failed, Some(why));
            }
            job.log.push(line);
        });
    }

    /// Gives the history what is new.
    pub(super) fn keep(&self, snapshot: &JobSnapshot) {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let bare = JobSnapshot { generation: 0, ..snapshot.bare() };
        let whole = kept.newest.as_ref() != Some(&bare);
        let chronicle = self.journal.chronicle(snapshot, self.idempotency_key.as_deref(), kept.written, whole);
        // A snapshot of before another one that came first has less than is written.
        kept.written.iterations = kept.written.iterations.max(snapshot.iterations.len());
        kept.written.lines = kept.written.lines.max(snapshot.log.len());
        kept.newest = Some(bare);
        self.journal.note(chronicle);
    }

    /// The whole job for the history.
    pub(crate) fn chronicle(&self) -> Chronicle {
        let (snapshot, key) = (self.snapshot(), self.idempotency_key.as_deref());
        self.journal.chronicle(&snapshot, key, Written::default(), true)
    }

    /// The caller's own name for the request.
    pub(crate) fn key(&self) -> Option<&str> {
        self.idempotency_key.as_deref()
    }

    /// Asks the job to end, and says why. May be repeated.
    pub(crate) fn cancel(&self, why: String) {
        if self.snapshot().state.is_final() || self.cancel.is_cancelled() {
            return;
        }
        let _ = self.cancelled_why.set(why);
        self.change(|job| {
            // It may have ended since that was looked at, and stays so.
            if !job.state.is_final() {
                job.state = JobState::Cancelling;
                job.operator_step = None;
            }
        });
        self.cancel.cancel();
    }

    /// It was refused after all: there is no such job, and nothing more is written of it.
    pub(crate) fn forget(&self) {
        self.snapshot.lock().unwrap_or_else(PoisonError::into_inner).state = JobState::Cancelled;
    }

    /// Takes the operator's confirmation of a step.
    ///
    /// # Errors
    /// When the job does not wait for that step.
    pub(crate) fn confirm(&self, step: u32) -> Result<(), ServiceError> {
        let snapshot = self.snapshot();
        match &snapshot.operator_step {
            Some(asked) if asked.number == step => self.answer(snapshot.state, Answer { to: step, again: None }),
            Some(asked) => {
                let why = format!("it waits for step {} ({}), not for step {step}", asked.number, asked.name);
                Err(Refusal::JobState { state: snapshot.state, why }.into())
            }
            None => Err(Self::waits_for_nothing(snapshot.state)),
        }
    }

    /// Takes it that the operator asks for an earlier step again, in place of confirming the one that waits.
    ///
    /// # Errors
    /// When the job waits for no step, or for one in whose place that one cannot be asked for.
    pub(crate) fn repeat(&self, step: u32) -> Result<(), ServiceError> {
        let snapshot = self.snapshot();
        match &snapshot.operator_step {
            Some(asked) if asked.repeatable.contains(&step) => {
                self.answer(snapshot.state, Answer { to: asked.number, again: Some(step) })
            }
            Some(asked) => {
                let which = asked.repeatable.iter().map(|step| format!("step {step}")).collect::<Vec<_>>();
                let which = if which.is_empty() { "no earlier step".to_owned() } else { which.join(" and ") };
                let why = format!(
                    "at step {} ({}) {which} can be asked for again, not step {step}",
                    asked.number, asked.name
                );
                Err(Refusal::JobState { state: snapshot.state, why }.into())
            }
            None => Err(Self::waits_for_nothing(snapshot.state)),
        }
    }

    /// The first answer to a step counts; the same once more changes nothing.
    pub(super) fn answer(&self, state: JobState, answer: Answer) -> Result<(), ServiceError> {
        let mut last = self.last_answer.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(before) = last.filter(|before| before.to == answer.to) {
            return if before.again == answer.again {
                Ok(())
            } else {
                let why = match before.again {
                    Some(earlier) => format!("step {earlier} has been asked for again in its place already"),
                    None => "this step has been confirmed already".to_owned(),
                };
                Err(Refusal::JobState { state, why }.into())
            };
        }
        *last = Some(answer);
        let over = || Refusal::JobState { state, why: "it has ended".to_owned() };
        self.answers.try_send(answer).map_err(|_| over().into())
    }

    pub(super) fn waits_for_nothing(state: JobState) -> ServiceError {
        Refusal::JobState { state, why: "it waits for no confirmation".to_owned() }.into()
    }
}
