//! What control keeps of what it does: every record goes to the history as it happens, and what has to be there before
//! anything moves is waited for.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use jiff::Timestamp;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use uuid::Uuid;

use crate::bench_name::bench_name;
use crate::events::{MeasurementView, SingleMeasurement, StopView};
use crate::job::{JobSnapshot, JobState, OperatorStep, word};
use crate::recording::{Happening, Sink};
use crate::refusal::{Refusal, ServiceError};
use bench::config::{BenchConfig, Config};
use bench::device::AxisName;
use bench::store::records::{self, Entry, Line, Move, Picture, Run};
use bench::store::{BenchName, Store, StoreError, Writer};
use plenoptics::units::Millimetres;

/// Where the stop's latch is kept beyond a run.
const STOP_KEY: &str = "stop";
/// Where the control lease is kept beyond a run.
const LEASE_KEY: &str = "lease";
/// What is said of a job that its program left without an end.
const INTERRUPTED_REASON: &str =
    "the program ended before the job did; its records up to then are kept, and the axes have to be homed again";

/// The history as control writes it.
pub(crate) struct Journal {
    store: Store,
    run: Run,
    bench: BenchName,
    /// The job that holds the bench: motion belongs to it.
    job: Mutex<Option<Uuid>>,
    /// What takes the recording of that job.
    recorded: Mutex<Vec<Arc<dyn Sink>>>,
    /// For which opening of the file this run has been begun in it.
    begun: tokio::sync::Mutex<Option<u64>>,
}

impl From<StoreError> for Refusal {
    fn from(error: StoreError) -> Self {
        Self::NoHistory { why: error.to_string() }
    }
}

impl From<StoreError> for ServiceError {
    fn from(error: StoreError) -> Self {
        Refusal::from(error).into()
    }
}

impl Journal {
    pub(crate) fn new(store: Store, config: &Config) -> Self {
        let configuration = toml::to_string(config).unwrap_or_else(|error| {
            tracing::error!(%error, "the configuration cannot be written as TOML");
            String::new()
        });
        let bench = bench_name(&config.bench);
        let run = Run {
            id: Uuid::now_v7(),
            bench: bench.now().to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            configuration,
            started_at: Timestamp::now(),
        };
        Self {
            store,
            run,
            bench,
            job: Mutex::new(None),
            recorded: Mutex::default(),
            begun: tokio::sync::Mutex::new(None),
        }
    }

    pub(crate) const fn store(&self) -> &Store {
        &self.store
    }

    /// The bench's names in the history.
    pub(crate) const fn bench(&self) -> &BenchName {
        &self.bench
    }

    /// The run of the program.
    pub(crate) const fn run(&self) -> Uuid {
        self.run.id
    }

    /// Why the history cannot be written, which keeps every axis still; `None` while it can.
    pub(crate) fn fault(&self) -> Option<String> {
        self.store.health().borrow().fault().map(str::to_owned)
    }

    /// Makes sure that the history can be written and knows this run. In a file that does not, what earlier runs on the
    /// bench left open is closed first, and `jobs` are written whole. Returns whether that was so.
    pub(crate) async fn ready(&self, jobs: impl FnOnce() -> Vec<Chronicle>) -> Result<bool, StoreError> {
        let mut begun = self.begun.lock().await;
        let opened = self.store.write(|writer| Ok(writer.opened())).await?;
        if *begun == Some(opened) {
            return Ok(false);
        }
        let (run, bench, jobs) = (self.run.clone(), self.bench.clone(), jobs());
        let interrupted = self
            .store
            .write(move |writer| {
                writer.begin_run(&run)?;
                let interrupted =
                    writer.interrupt(&run, &bench, &JobState::Interrupted.to_string(), INTERRUPTED_REASON)?;
                for job in jobs {
                    job.write(writer)?;
                }
                Ok(interrupted)
            })
            .await?;
        for job in interrupted.jobs {
            tracing::warn!(%job, "an earlier run of the program ended before this job did");
        }
        *begun = Some(opened);
        Ok(true)
    }

    fn current(&self) -> MutexGuard<'_, Option<Uuid>> {
        self.job.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes a job that has just been accepted, and returns once it is on the disk. Motion belongs to it from now on.
    pub(crate) async fn begin_job(&self, job: Chronicle) -> Result<(), StoreError> {
        let id = job.id;
        self.store.write(move |writer| job.write(writer)).await?;
        *self.current() = Some(id);
        Ok(())
    }

    /// Motion belongs to a job no longer.
    pub(crate) fn end_job(&self) {
        *self.current() = None;
        self.sinks().clear();
    }

    fn sinks(&self) -> MutexGuard<'_, Vec<Arc<dyn Sink>>> {
        self.recorded.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Has the job that holds the bench recorded from now on.
    pub(crate) fn record_to(&self, sink: Arc<dyn Sink>) {
        self.sinks().push(sink);
    }

    /// Hands what a job does to its recording, where it has one.
    pub(crate) fn happened(&self, happening: impl FnOnce() -> Happening) {
        let sinks = self.sinks();
        if let Some((last, others)) = sinks.split_last() {
            let happening = happening();
            others.iter().for_each(|sink| sink.take(happening.clone()));
            last.take(happening);
        }
    }

    /// Takes back a job that was not written in time: it may have come to the disk late.
    pub(crate) fn forget_job(&self, id: Uuid) {
        self.store.queue(move |writer| writer.forget_job(id));
    }

    /// Writes what is new of a job, without waiting.
    pub(crate) fn note(&self, job: Chronicle) {
        self.store.queue(move |writer| job.write(writer));
    }

    /// What of a job is to be written: everything after so many lines and iterations, and the job itself if `whole`.
    pub(crate) fn chronicle(
        &self,
        snapshot: &JobSnapshot,
        key: Option<&str>,
        written: Written,
        whole: bool,
    ) -> Chronicle {
        let number = |index: usize| index as u64 + 1;
        let iterations = snapshot
            .iterations
            .iter()
            .enumerate()
            .skip(written.iterations)
            .map(|(index, iteration)| Entry { number: number(index), at: iteration.at, document: document(iteration) });
        let lines = snapshot.log.iter().enumerate().skip(written.lines).map(|(index, line)| Line {
            number: number(index),
            at: line.at,
            message: line.message.clone(),
        });
        let (iterations, lines) = (iterations.collect(), lines.collect());
        Chronicle { id: snapshot.id, job: whole.then(|| self.record(snapshot, key)), iterations, lines }
    }

    fn record(&self, snapshot: &JobSnapshot, key: Option<&str>) -> records::Job {
        records::Job {
            id: snapshot.id,
            run: self.run.id,
            kind: word(&snapshot.kind),
            state: snapshot.state.to_string(),
            simulated: snapshot.simulated,
            generation: snapshot.generation,
            created_at: snapshot.created_at,
            ended_at: snapshot.ended_at,
            reason: snapshot.reason.clone(),
            request: document(&snapshot.request),
            idempotency_key: key.map(str::to_owned),
            document: document(&snapshot.bare()),
        }
    }

    /// Adds a job's measurement.
    pub(crate) fn measured(&self, measurement: &MeasurementView) {
        let (job, at, document) = (*self.current(), measurement.captured_at, document(measurement));
        self.store.queue(move |writer| writer.add_measurement(job, at, &document));
    }

    /// Adds a measurement that belongs to no job.
    pub(crate) fn measured_alone(&self, measured: &SingleMeasurement) {
        let (at, document) = (measured.measurement.captured_at, document(measured));
        self.store.queue(move |writer| writer.add_measurement(None, at, &document));
    }

    /// Writes what the operator is asked to do, or, with `confirmed_at`, that it is done.
    pub(crate) fn operator_step(
        &self,
        job: Uuid,
        step: &OperatorStep,
        asked_at: Timestamp,
        confirmed_at: Option<Timestamp>,
    ) {
        let step = records::OperatorStep { number: step.number, document: document(step), asked_at, confirmed_at };
        self.store.queue(move |writer| writer.put_operator_step(job, &step));
    }

    /// Keeps a picture with a job.
    pub(crate) fn picture(&self, job: Uuid, picture: Picture) {
        self.store.queue(move |writer| writer.put_picture(job, &picture));
    }

    /// Writes a motion that is about to begin, and returns once it is on the disk, with everything before it.
    pub(crate) async fn begin_motion(
        self: &Arc<Self>,
        axis: AxisName,
        what: &'static str,
        from: Option<Millimetres>,
        to: Option<Millimetres>,
    ) -> Result<Underway, Refusal> {
        let (run, id) = (self.run.id, Uuid::now_v7());
        let motion = Move {
            id,
            job: *self.current(),
            axis: axis.name().to_owned(),
            what: what.to_owned(),
            from_mm: from.map(Millimetres::value),
            to_mm: to.map(Millimetres::value),
            started_at: Timestamp::now(),
            ended_at: None,
            end_mm: None,
            outcome: None,
        };
        self.store.write(move |writer| writer.begin_move(run, &motion)).await?;
        Ok(Underway { journal: Arc::clone(self), id, open: true })
    }

    /// Keeps a value for this bench beyond the run, as `value` makes it when its turn comes to be written; nothing where
    /// that makes none. Returns once it is on the disk.
    async fn put(
        &self,
        key: &'static str,
        value: impl FnOnce() -> Option<Value> + Send + 'static,
    ) -> Result<(), StoreError> {
        let bench = self.bench.clone();
        let write = move |writer: &Writer<'_>| value().map_or(Ok(()), |value| writer.keep_for(&bench, key, value));
        self.store.write_reserved(write).await
    }

    /// The values kept for this bench, that of its devices first: [`BenchName::kept`].
    async fn get(&self, key: &str) -> Result<Vec<Value>, StoreError> {
        let (bench, key) = (self.bench.clone(), key.to_owned());
        self.store.read(move |connection| bench.kept(connection, &key)).await
    }

    /// The values kept for other benches than this one, where nothing tells it from them: its devices are away, or have
    /// never been seen.
    async fn get_elsewhere(&self, key: &str) -> Result<Vec<Value>, StoreError> {
        if self.bench.spelled == BenchConfig::SIMULATED {
            return Ok(Vec::new());
        }
        let (bench, key) = (self.bench.clone(), key.to_owned());
        let found = self.store.read(move |connection| bench.kept_elsewhere(connection, &key)).await?;
        Ok(found.into_iter().filter(|(bench, _)| bench != BenchConfig::SIMULATED).map(|(_, value)| value).collect())
    }

    /// Writes the stop's latch as it is when its turn comes, where it is to be written then, and returns once it is on the
    /// disk.
    pub(crate) async fn write_stop(
        &self,
        stop: impl FnOnce() -> Option<StopView> + Send + 'static,
    ) -> Result<(), StoreError> {
        self.put(STOP_KEY, move || stop().map(|stop| document(&stop))).await
    }

    /// The stop's latch as an earlier run left it, or why it cannot be read. Where it may be one of several, one that is
    /// latched.
    pub(crate) async fn kept_stop(&self) -> Result<Option<StopView>, String> {
        let unread = |error: StoreError| format!("the history cannot be read: {error}");
        let mut kept = self.get(STOP_KEY).await.map_err(unread)?;
        if kept.is_empty() {
            kept = self.get_elsewhere(STOP_KEY).await.map_err(unread)?;
        }
        let read = |value| {
            serde_json::from_value(value).map_err(|error| format!("what the history keeps makes no sense: {error}"))
        };
        let stops = kept.into_iter().map(read).collect::<Result<Vec<StopView>, _>>()?;
        let latched = stops.iter().position(|stop| stop.latched);
        Ok(stops.into_iter().nth(latched.unwrap_or(0)))
    }

    /// Writes the control lease as it is when its turn comes, and returns once it is on the disk.
    pub(crate) async fn write_lease<L: Serialize>(
        &self,
        lease: impl FnOnce() -> Option<L> + Send + 'static,
    ) -> Result<(), StoreError> {
        self.put(LEASE_KEY, move || Some(document(&lease()))).await
    }

    /// The control lease as an earlier run left it. One that cannot be read is none: it would only keep others out.
    pub(crate) async fn kept_lease<L: DeserializeOwned>(&self) -> Result<Option<L>, StoreError> {
        Ok(self.get(LEASE_KEY).await?.into_iter().find_map(|value| serde_json::from_value(value).ok()))
    }

    /// Adds to the audit log.
    pub(crate) fn audit(&self, audit: records::Audit) {
        self.store.audit(audit);
    }

    /// Ends the run in good order; returns when everything is written, or cannot be.
    pub(crate) async fn end(&self) {
        let run = self.run.id;
        self.store.queue(move |writer| writer.end_run(run, Timestamp::now()));
        self.store.flush().await;
        // The last place where they can be told.
        for records::Audit { at, who, what, detail, from } in self.store.unwritten_audit() {
            tracing::error!(%at, who, what, %detail, from, "an entry of the audit log is not in the history");
        }
    }
}

/// How much of a job has been given to the history.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Written {
    /// Iterations.
    pub(crate) iterations: usize,
    /// Lines of the log.
    pub(crate) lines: usize,
}

/// What is to be written of a job.
pub(crate) struct Chronicle {
    id: Uuid,
    job: Option<records::Job>,
    iterations: Vec<Entry>,
    lines: Vec<Line>,
}

impl Chronicle {
    fn write(&self, writer: &Writer<'_>) -> rusqlite::Result<()> {
        if let Some(job) = &self.job {
            writer.put_job(job)?;
        }
        for line in &self.lines {
            writer.put_line(self.id, line)?;
        }
        self.iterations.iter().try_for_each(|iteration| writer.put_iteration(self.id, iteration))
    }
}

/// A motion that the history knows to be under way. Dropped, it was given up: by a stop, a cancellation or a fault.
pub(crate) struct Underway {
    journal: Arc<Journal>,
    id: Uuid,
    open: bool,
}

impl Underway {
    /// The motion is over.
    pub(crate) fn ended(mut self, end: Result<Option<Millimetres>, &ServiceError>) {
        match end {
            Ok(position) => self.close(position, "done"),
            Err(error) => self.close(None, &error.to_string()),
        }
    }

    fn close(&mut self, position: Option<Millimetres>, outcome: &str) {
        self.open = false;
        let (id, end_mm, outcome) = (self.id, position.map(Millimetres::value), outcome.to_owned());
        self.journal.store.queue(move |writer| writer.end_move(id, Timestamp::now(), end_mm, &outcome));
    }
}

impl Drop for Underway {
    fn drop(&mut self) {
        if self.open {
            self.close(None, "given up");
        }
    }
}

/// A value as JSON.
fn document(value: &impl Serialize) -> Value {
    serde_json::to_value(value).unwrap_or_else(|error| {
        tracing::error!(%error, "a record cannot be written as JSON");
        json!(null)
    })
}
