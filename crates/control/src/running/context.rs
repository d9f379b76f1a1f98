//! What a running job uses to say where it is, to ask the operator, and to notice that it is to end.

use std::collections::HashMap;
use std::future::Future;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::RecvTimeoutError;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::mpsc;

use super::end::JobEnd;
use super::job::{Answer, Job};
use crate::clock::{JobClock, Part, enter};
use crate::job::outcome::Outcome;
use crate::job::steps::{self, JobStep, PlannedStep, Repeatable};
use crate::job::{
    Iteration, JobSnapshot, JobState, LogLine, Measure, OperatorStep, RecordingState, Report, Stage, TimeSpent,
};
use crate::recording::{End, Happening};
use bench::device::{Setup, SimulatedOperator};
use bench::store::records::Picture;

/// How long a job's end waits for its recording's.
const RECORDING_END_ALLOWED: Duration = Duration::from_secs(1);
/// Lines of log kept for a job; more would only repeat.
const MAX_LOG_LINES: usize = 2000;

/// The job's own side: what its task holds.
pub(crate) struct JobContext {
    job: Arc<Job>,
    answered: tokio::sync::Mutex<mpsc::Receiver<Answer>>,
    operator: Option<Arc<dyn SimulatedOperator>>,
    steps_asked: AtomicU32,
    clock: Arc<JobClock>,
    asking: Mutex<Asking>,
}

/// What is kept between two steps.
#[derive(Debug, Default)]
struct Asking {
    /// What had been spent when the step under way began.
    before: Option<TimeSpent>,
    /// The first of the operator's steps that can be asked for again; none where none can.
    repeat_from: Option<u32>,
    /// The step that is asked for again next.
    again: Option<u32>,
    /// Why the next step is the one before once more, in words.
    because: Option<String>,
    /// How far the job was when each of the operator's steps began.
    far: HashMap<u32, u32>,
}

impl JobContext {
    /// Of a job, which is answered by way of `answered`.
    pub(super) fn new(
        job: Arc<Job>,
        answered: mpsc::Receiver<Answer>,
        operator: Option<Arc<dyn SimulatedOperator>>,
    ) -> Self {
        Self {
            job,
            answered: tokio::sync::Mutex::new(answered),
            operator,
            steps_asked: AtomicU32::new(0),
            clock: JobClock::start(),
            asking: Mutex::default(),
        }
    }

    /// The job's state as it is now.
    pub(crate) fn snapshot(&self) -> JobSnapshot {
        self.job.snapshot()
    }

    /// Whether it is recorded to a file.
    pub(crate) fn is_recorded(&self) -> bool {
        self.job.file.get().is_some()
    }

    /// Adds a line to the job's log.
    pub(crate) fn log(&self, message: impl Into<String>) {
        let message = message.into();
        tracing::info!(message = %message, "job");
        let line = LogLine { at: jiff::Timestamp::now(), message };
        self.job.journal.happened(|| Happening::Logged(line.clone()));
        self.job.change(|job| {
            if job.log.len() < MAX_LOG_LINES {
                job.log.push(line);
            }
        });
    }

    /// Takes what the operator will be asked, where nothing was expected before.
    pub(crate) fn expect(&self, planned: Vec<PlannedStep>) {
        self.job.change(|job| {
            if job.steps.is_empty() {
                steps::expect(&mut job.steps, planned);
            }
        });
    }

    /// Takes what the operator will be asked in air, where other boards than was planned are put up.
    pub(crate) fn change_boards(&self, in_air: Vec<PlannedStep>, aperture_set: bool) {
        self.job.change(|job| steps::change_boards(&mut job.steps, in_air, aperture_set));
    }

    /// Whether the operator may have steps done again from now on: those so far, too, or only what is asked from now on.
    pub(crate) fn let_repeat(&self, those_so_far: bool) {
        let next = self.steps_asked.load(Ordering::SeqCst) + 1;
        self.asking().repeat_from = Some(if those_so_far { 1 } else { next });
    }

    /// Another step begins that the bench does by itself.
    pub(crate) fn step_of_bench(&self, name: &str) {
        let spent = self.spent_on_step();
        self.job.change(|job| steps::begin(&mut job.steps, JobStep::of_bench(name), &spent));
    }

    fn asking(&self) -> MutexGuard<'_, Asking> {
        self.asking.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What the step under way has taken, which ends here.
    fn spent_on_step(&self) -> TimeSpent {
        let now = self.clock.time_spent();
        let before = self.asking().before.replace(now);
        before.map_or(now, |before| now.since(&before))
    }

    /// The job is at work.
    pub(crate) fn begin(&self, steps: u32) {
        self.job.change(|job| {
            job.state = JobState::Running;
            job.progress.of = steps;
        });
    }

    /// Another part of the alignment begins.
    pub(crate) fn stage(&self, stage: Stage) {
        self.job.change(|job| job.stage = stage);
    }

    /// Another step begins.
    pub(crate) fn doing(&self, doing: impl Into<String>) {
        let doing = doing.into();
        let spent = self.clock.time_spent();
        let left = self.job.usual_s.get().map(|usual_s| spent.time_left_s(*usual_s));
        self.job.change(|job| {
            let progress = &mut job.progress;
            progress.step += 1;
            progress.of = progress.of.max(progress.step + 1);
            progress.doing = doing;
            progress.time_left_s = left.flatten();
        });
    }

    /// What tells where its time goes.
    pub(crate) const fn clock(&self) -> &Arc<JobClock> {
        &self.clock
    }

    /// Records an iteration; its number is given here.
    pub(crate) fn record(&self, mut iteration: Iteration) {
        let measure = measure(&iteration);
        iteration.number = self.job.snapshot().iterations.len() as u32 + 1;
        self.job.journal.happened(|| Happening::Decided(Box::new(iteration.clone())));
        self.job.change(|job| {
            job.iterations.push(iteration);
            job.progress.measure = Some(measure);
        });
    }

    /// What a job that is no alignment came to.
    pub(crate) fn outcome(&self, outcome: Outcome) {
        self.job.change(|job| {
            // What was measured on the way is not what such a job was for.
            job.progress.measure = outcome.measure(job.progress.measure.take());
            job.outcome = Some(outcome);
        });
    }

    /// Ends the job, its recording first. The axes have been stopped.
    pub(crate) async fn end(&self, state: JobState, reason: String, report: Option<Report>) {
        let outcome = self.job.snapshot().outcome;
        let end = End { state, reason: reason.clone(), report: report.clone(), outcome };
        self.job.journal.happened(|| Happening::End(Box::new(end)));
        self.end_recording().await;
        self.close(state, reason, report);
    }

    /// The job has ended: the last that is said of it.
    pub(crate) fn close(&self, state: JobState, reason: String, report: Option<Report>) {
        let spent = self.spent_on_step();
        self.job.change(|job| {
            steps::close(&mut job.steps, matches!(state, JobState::Converged | JobState::Succeeded), &spent);
            job.state = state;
            job.stage = Stage::Report;
            job.ended_at = Some(jiff::Timestamp::now());
            job.operator_step = None;
            job.progress.step = job.progress.of;
            job.progress.doing = "ended".to_owned();
            job.progress.time_left_s = None;
            job.reason = Some(reason);
            // What the report does not tell was not reached.
            if let Some(report) = &report {
                job.progress.measure = job.progress.measure.take().filter(|measure| report.tells(measure));
            }
            job.report = report;
        });
    }

    /// Has the recording come to its end. A slow disk is waited for a moment only, by the real clock, which is the
    /// disk's; the job's JSON says so later then.
    async fn end_recording(&self) {
        let Some(file) = self.job.file.get() else { return };
        let (ended, job) = (file.finish(), Arc::clone(&self.job));
        let complete = move |bytes: u64| {
            job.change(|job| {
                if let Some(recording) = &mut job.recording {
                    (recording.state, recording.bytes) = (RecordingState::Complete, Some(bytes));
                }
            });
        };
        let waited = tokio::task::spawn_blocking(move || (ended.recv_timeout(RECORDING_END_ALLOWED), ended)).await;
        match waited {
            Ok((Ok(bytes), _)) => complete(bytes),
            // On a thread of its own: it may take as long as the disk does.
            Ok((Err(RecvTimeoutError::Timeout), ended)) => {
                let waiting = std::thread::Builder::new().spawn(move || ended.recv().map(complete));
                if let Err(error) = waiting {
                    tracing::error!(%error, "the recording's end is not waited for");
                }
            }
            // It has failed, and said so.
            Ok((Err(RecvTimeoutError::Disconnected), _)) => {}
            Err(error) => tracing::error!(%error, "the recording's end was not waited for"),
        }
    }

    /// Why the job was asked to end, if it was.
    pub(crate) fn cancelled_why(&self) -> Option<String> {
        self.job.cancelled_why.get().cloned()
    }

    /// Runs a step unless the job is cancelled first; the step is dropped then.
    pub(crate) async fn unless_cancelled<T, E: Into<JobEnd>>(
        &self,
        step: impl Future<Output = Result<T, E>>,
    ) -> Result<T, JobEnd> {
        tokio::select! {
            biased;
            () = self.job.cancel.cancelled() => {
                let why = self.cancelled_why().unwrap_or_else(|| "cancelled".to_owned());
                Err(JobEnd::Cancelled { why })
            }
            result = step => result.map_err(Into::into),
        }
    }

    /// Tells the operator what to set up and waits for the confirmation. On a simulated bench the twin obeys, and
    /// confirms by itself where it is configured to.
    pub(crate) async fn ask(
        &self,
        name: &str,
        instruction: String,
        value: Option<String>,
        setup: Setup,
    ) -> Result<(), JobEnd> {
        let number = self.steps_asked.fetch_add(1, Ordering::SeqCst) + 1;
        let step = self.begin_to_ask(number, name, instruction, value, &setup);
        self.doing(format!("waiting for the operator: {}", name.replace('_', " ")));
        self.log(format!("operator step {number}: {}", step.instruction));
        let asked_at = jiff::Timestamp::now();
        let id = self.job.snapshot().id;
        self.job.journal.operator_step(id, &step, asked_at, None);
        let confirms = self.operator.as_ref().is_some_and(|operator| operator.confirms());
        if !confirms {
            self.job.change(|job| {
                job.state = JobState::WaitingForOperator;
                job.operator_step = Some(step.clone());
            });
            let waiting = enter(Part::Operator);
            let mut answered = self.answered.lock().await;
            let again = self
                .unless_cancelled(async {
                    while let Some(answer) = answered.recv().await {
                        if answer.to == number {
                            return Ok(answer.again);
                        }
                    }
                    Err(JobEnd::failed("the program is ending"))
                })
                .await?;
            drop(waiting);
            self.job.change(|job| {
                job.state = JobState::Running;
                job.operator_step = None;
            });
            if let Some(again) = again {
                return Err(self.repeat(number, again));
            }
        } else if let Some(again) = self.operator.as_ref().and_then(|operator| operator.asks_again(number)) {
            return Err(self.repeat(number, again));
        }
        if let Some(operator) = &self.operator {
            operator.obey(&setup);
        }
        self.job.journal.operator_step(id, &step, asked_at, Some(jiff::Timestamp::now()));
        self.log(format!(
            "operator step {number} confirmed{}",
            if confirms { " by the simulated operator" } else { "" }
        ));
        Ok(())
    }

    /// The step that the operator is asked for now, which begins one of the job's.
    fn begin_to_ask(
        &self,
        number: u32,
        name: &str,
        instruction: String,
        value: Option<String>,
        setup: &Setup,
    ) -> OperatorStep {
        let spent = self.spent_on_step();
        let (from, again, because) = {
            let mut asking = self.asking();
            (asking.repeat_from, asking.again.take(), asking.because.take())
        };
        let again = again.or_else(|| {
            let snapshot = self.job.snapshot();
            let before = snapshot.steps.iter().rfind(|step| step.name == name && step.number.is_some());
            before.filter(|_| because.is_some()).and_then(|step| step.number)
        });
        let mut step = OperatorStep {
            number,
            name: name.to_owned(),
            instruction: match &because {
                Some(because) => format!("{because} {instruction}"),
                None => instruction,
            },
            value: value.clone(),
            repeats: again,
            because: because.clone(),
            repeatable: Vec::new(),
        };
        self.job.change(|job| {
            let begun =
                JobStep { repeats: again, because: because.clone(), ..JobStep::asked(number, name, value, setup) };
            steps::begin(&mut job.steps, begun, &spent);
            steps::discard(&mut job.iterations, &job.steps);
            if again.is_some() {
                job.progress.measure = job.iterations.iter().rfind(|it| !it.discarded).map(measure);
            }
            self.asking().far.insert(number, job.progress.step);
            step.repeatable = from.map_or_else(Vec::new, |from| steps::repeatable(&job.steps, from, name));
        });
        step
    }

    /// What came of the step before could not be used: the next one is the same once more, and says why, as a sentence.
    pub(crate) fn once_more(&self, why: &str) {
        let mut letters = why.chars();
        let first = letters.next().map(|first| first.to_uppercase());
        self.asking().because = first.map(|first| format!("{first}{}.", letters.as_str().trim_end_matches('.')));
    }

    /// In place of step `number` an earlier one is asked for again: how the work so far ends.
    fn repeat(&self, number: u32, again: u32) -> JobEnd {
        let spent = self.spent_on_step();
        let far = {
            let mut asking = self.asking();
            asking.again = Some(again);
            asking.far.get(&again).copied()
        };
        self.job.journal.happened(|| Happening::Again { step: number, again });
        let mut what = None;
        self.job.change(|job| {
            let step = job.steps.iter().find(|step| step.number == Some(again));
            what = step.and_then(|step| Repeatable::of(&step.name));
            steps::repeat(&mut job.steps, again, &spent);
            // All since then is to be done again.
            job.progress.step = far.unwrap_or(job.progress.step);
        });
        self.log(format!("in place of step {number} the operator asks for step {again} again"));
        what.map_or_else(|| JobEnd::failed(format!("step {again} cannot be done again")), JobEnd::Repeat)
    }

    /// Keeps a picture with the job, in the place of one of the same name.
    pub(crate) fn keep_picture(&self, name: &str, picture: &[u8]) {
        self.job.journal.happened(|| Happening::Picture(Arc::new(picture.to_vec())));
        let picture = Picture {
            name: name.to_owned(),
            at: jiff::Timestamp::now(),
            media_type: "image/jpeg".to_owned(),
            bytes: picture.to_vec(),
        };
        self.job.journal.picture(self.job.snapshot().id, picture);
    }

    /// The simulated truth, on a simulated bench.
    pub(crate) fn truth(&self) -> Option<serde_json::Value> {
        self.operator.as_ref().map(|operator| operator.truth())
    }
}

/// The figure that an iteration is about: Δv in the air step, the spacing elsewhere.
fn measure(iteration: &Iteration) -> Measure {
    match (iteration.stage, iteration.delta_v_mm, iteration.delta_v_sigma_mm) {
        (Stage::Air | Stage::LBound, Some(value), Some(sigma)) => {
            Measure { name: "delta_v_mm".to_owned(), value, sigma, target: iteration.delta_v_target_mm }
        }
        _ => Measure {
            name: "spacing_px".to_owned(),
            value: iteration.spacing.spacing_px,
            sigma: iteration.spacing.spacing_sigma_px,
            target: Some(iteration.spacing_target_px),
        },
    }
}
