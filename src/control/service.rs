//! What callers hold: the bench with its motion rules, the one job, and what happens.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::{broadcast, watch};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tracing::Instrument as _;
use uuid::Uuid;

use super::context::{Job, JobContext};
use super::events::{AxisView, BenchView, CameraView, Event, FieldMap, MeasurementView, ShellState};
use super::eye::Eye;
use super::job::{JobRequest, JobSnapshot, JobState};
use super::journal::{Journal, word};
use super::lease::{LeaseGrant, LeaseRequest, Leases, Permit};
use super::motion::{Claim, Motion};
use super::{Refusal, ServiceError, StopReport, runner};
use crate::config::{Config, Side};
use crate::device::jog::{Grip, deadman};
use crate::device::{AxisName, Bench};
use crate::store::Store;
use crate::telemetry::BenchGauges;
use crate::units::Millimetres;

/// Events kept for a subscriber that lags.
const EVENT_QUEUE: usize = 1024;
/// Jobs kept in memory.
const MAX_JOBS: usize = 100;
/// Rest between two looks at the bench's state for the events, at least.
const VIEW_INTERVAL: Duration = Duration::from_millis(100);
/// Between two signs of life of a watcher, at most.
const PULSE: Duration = Duration::from_millis(500);
/// Rest between two measurements of the live picture.
const LIVE_INTERVAL: Duration = Duration::from_millis(500);
/// How long a job may take to stop the axes and to write its report when the program ends.
const JOB_END_ALLOWED: Duration = Duration::from_secs(3);

/// How long the history may take to come to its end.
const FLUSH_ALLOWED: Duration = Duration::from_secs(1);

/// Whether a job was accepted now, or had been before under the same name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acceptance {
    /// Now.
    Now,
    /// Before: nothing has begun anew.
    Before,
}

/// How long a jog goes on from a request.
const JOG_HOLD: Duration = Duration::from_millis(300);

/// A jog under way.
struct Jogging {
    towards: Side,
    speed: f64,
    grip: Grip,
}

/// The bench with its motion rules, the one job, and what happens.
pub struct Service {
    config: Arc<Config>,
    design_origin: String,
    bench: Bench,
    motion: Arc<Motion>,
    leases: Leases,
    eye: Arc<Eye>,
    pub(super) journal: Arc<Journal>,
    /// One job at a time is being accepted.
    accepting: tokio::sync::Mutex<()>,
    /// Whether the stop was set or reset in this run: then what an earlier run left of it no longer counts.
    stop_touched: AtomicBool,
    events: broadcast::Sender<Event>,
    jobs: Mutex<Vec<Arc<Job>>>,
    measurement: Mutex<Option<MeasurementView>>,
    /// Why the last command by hand of an axis did not end as commanded.
    failures: Mutex<HashMap<AxisName, String>>,
    jogs: Mutex<HashMap<AxisName, Jogging>>,
    closing: AtomicBool,
    /// Asks the service's own watchers for a sign of life; each answers when it comes round.
    pulses: [watch::Sender<u64>; 2],
    /// Shared with everybody who watches the live picture's spacing.
    onlookers: Arc<()>,
    tasks: CancellationToken,
}

impl Service {
    /// Starts the service over a bench: its watchers run until [`Service::shut_down`]. `design_origin` says where the
    /// design's numbers come from; `store` is the history, without which nothing moves.
    #[must_use]
    pub fn start(config: Arc<Config>, design_origin: String, bench: Bench, store: Store) -> Arc<Self> {
        let (events, _) = broadcast::channel(EVENT_QUEUE);
        let journal = Arc::new(Journal::new(store, &config));
        let motion = Arc::new(Motion::new(Arc::clone(&config), bench.clone()).recorded(Arc::clone(&journal)));
        let eye = Arc::new(Eye::new(Arc::clone(&config), bench.clone(), Arc::clone(&motion), Arc::clone(&journal)));
        let service = Arc::new(Self {
            config,
            design_origin,
            bench,
            motion,
            leases: Leases::default(),
            eye,
            journal,
            accepting: tokio::sync::Mutex::default(),
            stop_touched: AtomicBool::new(false),
            events,
            jobs: Mutex::new(Vec::new()),
            measurement: Mutex::new(None),
            failures: Mutex::default(),
            jogs: Mutex::default(),
            closing: AtomicBool::new(false),
            pulses: [watch::Sender::new(0), watch::Sender::new(0)],
            onlookers: Arc::default(),
            tasks: CancellationToken::new(),
        });
        let (watched, measured, leased) = (Arc::clone(&service), Arc::clone(&service), Arc::clone(&service));
        let kept = Arc::clone(&service);
        tokio::spawn(async move { kept.tasks.clone().run_until_cancelled(kept.watch_history()).await });
        tokio::spawn(async move { leased.tasks.clone().run_until_cancelled(leased.watch_lease()).await });
        tokio::spawn(async move { watched.tasks.clone().run_until_cancelled(watched.watch_bench()).await });
        tokio::spawn(async move { measured.tasks.clone().run_until_cancelled(measured.watch_focus()).await });
        service
    }

    /// The configuration in force.
    #[must_use]
    pub fn config(&self) -> &Arc<Config> {
        &self.config
    }

    /// Where the design's numbers come from.
    #[must_use]
    pub fn design_origin(&self) -> &str {
        &self.design_origin
    }

    /// The bench, for its frames.
    #[must_use]
    pub fn bench(&self) -> &Bench {
        &self.bench
    }

    /// What happens from now on. Subscribe first, then take the snapshots: nothing is missed between.
    #[must_use]
    pub fn subscribe(&self) -> broadcast::Receiver<Event> {
        self.events.subscribe()
    }

    /// Has the live picture's spacing measured between jobs for as long as what this returns is held. Measuring costs
    /// a core a good part of its time: nobody watching, it rests.
    #[must_use]
    pub fn look_on(&self) -> Arc<()> {
        Arc::clone(&self.onlookers)
    }

    /// The spacing over the field in the newest measurement of a single board.
    #[must_use]
    pub fn field_map(&self) -> watch::Receiver<Option<Arc<FieldMap>>> {
        self.eye.map()
    }

    /// The state of the whole bench.
    #[must_use]
    pub fn bench_view(&self) -> BenchView {
        let axes = AxisName::ALL.into_iter().map(|axis| self.axis_view(axis)).collect();
        let camera = self.bench.camera.state().borrow().clone();
        let frame = self.bench.camera.newest();
        BenchView {
            simulated: self.bench.is_simulated(),
            design_origin: self.design_origin.clone(),
            axes,
            camera: CameraView {
                driver: camera.driver,
                identity: camera.identity,
                online: camera.online,
                fault: camera.fault,
                frames_lost: camera.frames_lost,
                frames_damaged: camera.frames_damaged,
                notes: camera.notes,
                replay: camera.replay,
                frame_seq: frame.as_ref().map(|frame| frame.seq),
                frame_age_ms: frame.map(|frame| frame.exposed_to.elapsed().as_secs_f64() * 1000.0),
            },
            shell: self.motion.shell(),
            stop: self.motion.stop_view(),
            lease: self.leases.view(),
            job: self.current().map(|job| job.snapshot().id),
            e_wall_mm: self.motion.e_wall_mm(),
            history_fault: self.journal.fault(),
        }
    }

    fn axis_view(&self, axis: AxisName) -> AxisView {
        let stage = self.bench.stage(axis);
        let (info, state) = (stage.info(), stage.state().borrow().clone());
        let (low_limit_mm, high_limit_mm) = self.motion.range_mm(axis);
        AxisView {
            axis,
            driver: info.driver,
            identity: info.identity,
            location: info.location,
            connected: state.connected,
            homed: state.homed,
            position_mm: state.homed.then_some(state.position.value()),
            moving: state.moving,
            low_limit_mm,
            high_limit_mm,
            fault: state.fault,
            failure: self.failures().get(&axis).cloned(),
            disagreements: info.disagreements,
        }
    }

    fn failures(&self) -> MutexGuard<'_, HashMap<AxisName, String>> {
        self.failures.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Keeps how a command by hand ended.
    fn ended_by_hand(&self, axis: AxisName, ended: Result<(), ServiceError>) {
        if let Err(error) = ended {
            tracing::warn!(%axis, %error, "a command by hand did not end as commanded");
            self.failures().insert(axis, error.to_string());
        }
        self.publish_bench();
    }

    /// The newest measurement of the live picture or of a job.
    #[must_use]
    pub fn measurement(&self) -> Option<MeasurementView> {
        self.measurement.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(super) fn all_jobs(&self) -> MutexGuard<'_, Vec<Arc<Job>>> {
        self.jobs.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The newest jobs of this run, newest last.
    #[must_use]
    pub fn jobs(&self) -> Vec<JobSnapshot> {
        self.all_jobs().iter().map(|job| job.snapshot()).collect()
    }

    /// A job of this run; [`Service::find_job`] knows those of earlier ones, too.
    ///
    /// # Errors
    /// [`ServiceError::NoSuchJob`].
    pub fn job(&self, id: Uuid) -> Result<JobSnapshot, ServiceError> {
        Ok(self.find(id)?.snapshot())
    }

    fn find(&self, id: Uuid) -> Result<Arc<Job>, ServiceError> {
        let jobs = self.all_jobs();
        jobs.iter().find(|job| job.snapshot().id == id).cloned().ok_or(ServiceError::NoSuchJob { id })
    }

    fn current(&self) -> Option<Arc<Job>> {
        self.all_jobs().iter().rev().find(|job| !job.snapshot().state.is_final()).cloned()
    }

    /// The control lease.
    #[must_use]
    pub fn leases(&self) -> &Leases {
        &self.leases
    }

    /// Gives the control lease to another than who has it: a job under way is cancelled first, an axis moved by hand
    /// is stopped.
    ///
    /// # Errors
    /// [`Refusal::LeaseHeld`] where the job does not end in time.
    pub async fn take_over(&self, request: LeaseRequest) -> Result<LeaseGrant, ServiceError> {
        if let Some(job) = self.current() {
            job.cancel(format!("the control lease was taken over by {}", request.owner));
            ended(&job).await;
        }
        if AxisName::ALL.into_iter().any(|axis| self.motion.claim(axis).is_err()) {
            self.motion.halt().await;
        }
        Ok(self.leases.take_over(request)?)
    }

    /// Starts a job, which is in the history before this returns. It holds the permit's lease until its end.
    ///
    /// # Errors
    /// A refusal while another job holds the bench, an axis still moves by hand, the stop is latched, the history cannot
    /// be written, or the program ends.
    pub async fn create_job(
        self: &Arc<Self>,
        permit: &Permit,
        request: JobRequest,
    ) -> Result<JobSnapshot, ServiceError> {
        let _accepting = self.accepting.lock().await;
        self.accept_job(permit, request, None).await
    }

    /// Starts a job under the caller's own name for it: asked again within a day, it is the same job, whoever has the
    /// lease by then.
    ///
    /// # Errors
    /// As [`Service::create_job`], and a refusal where that name stands for another request.
    pub async fn create_job_once(
        self: &Arc<Self>,
        permit: Result<Permit, ServiceError>,
        request: JobRequest,
        key: String,
    ) -> Result<(JobSnapshot, Acceptance), ServiceError> {
        let _accepting = self.accepting.lock().await;
        if let Some(job) = self.job_of_key(&request, &key).await? {
            return Ok((job, Acceptance::Before));
        }
        Ok((self.accept_job(&permit?, request, Some(key)).await?, Acceptance::Now))
    }

    async fn accept_job(
        self: &Arc<Self>,
        permit: &Permit,
        request: JobRequest,
        key: Option<String>,
    ) -> Result<JobSnapshot, ServiceError> {
        request.check()?;
        self.history_ready().await?;
        let (job, context) = self.reserve(permit, &request, key)?;
        if let Err(error) = self.journal.begin_job(job.chronicle()).await {
            let id = job.snapshot().id;
            self.all_jobs().retain(|other| !Arc::ptr_eq(other, &job));
            self.leases.unbind(id);
            self.journal.forget_job(id);
            return Err(error.into());
        }
        self.failures().clear();
        let service = Arc::clone(self);
        tokio::spawn(async move { service.run(context).await });
        Ok(job.snapshot())
    }

    /// Gives the bench to a new job.
    fn reserve(
        &self,
        permit: &Permit,
        request: &JobRequest,
        key: Option<String>,
    ) -> Result<(Arc<Job>, JobContext), ServiceError> {
        self.open_for_motion()?;
        if self.motion.stop_view().latched {
            return Err(Refusal::Stopped.into());
        }
        let mut jobs = self.all_jobs();
        if let Some(holder) = jobs.iter().find(|job| !job.snapshot().state.is_final()) {
            return Err(Refusal::Busy { job: holder.snapshot().id }.into());
        }
        for axis in AxisName::ALL {
            self.motion.claim(axis)?;
        }
        let (journal, operator) = (Arc::clone(&self.journal), self.bench.simulated.clone());
        let (job, context) = Job::new(request, key, permit.owner(), journal, self.events.clone(), operator);
        self.leases.bind(permit, job.snapshot().id)?;
        if jobs.len() >= MAX_JOBS {
            jobs.remove(0);
        }
        jobs.push(Arc::clone(&job));
        Ok((job, context))
    }

    async fn run(&self, context: JobContext) {
        let (id, kind) = (context.snapshot().id, context.snapshot().kind);
        let span = tracing::info_span!("job", otel.name = format!("job {}", word(&kind)), %id);
        let running = runner::run(&context, &self.motion, &self.eye, &self.config, &self.design_origin);
        running.instrument(span).await;
        self.journal.end_job();
        self.leases.unbind(context.snapshot().id);
        self.publish_bench();
    }

    fn open_for_motion(&self) -> Result<(), ServiceError> {
        if self.closing.load(Ordering::SeqCst) { Err(Refusal::ShuttingDown.into()) } else { Ok(()) }
    }

    /// Confirms the operator step that a job waits for.
    ///
    /// # Errors
    /// When there is no such job, or it does not wait for that step.
    pub fn confirm(&self, id: Uuid, step: u32) -> Result<JobSnapshot, ServiceError> {
        let job = self.find(id)?;
        job.confirm(step)?;
        Ok(job.snapshot())
    }

    /// Asks a job to end; may be repeated, also after its end.
    ///
    /// # Errors
    /// [`ServiceError::NoSuchJob`].
    pub fn cancel(&self, id: Uuid) -> Result<JobSnapshot, ServiceError> {
        let job = self.find(id)?;
        job.cancel("cancelled".to_owned());
        Ok(job.snapshot())
    }

    /// No job may hold the bench, and the program must not be ending.
    fn free_for_hand(&self) -> Result<(), ServiceError> {
        self.open_for_motion()?;
        match self.current() {
            Some(job) => Err(Refusal::Busy { job: job.snapshot().id }.into()),
            None => Ok(()),
        }
    }

    /// Takes an axis for a command by hand. A job is looked for again once the axis is taken: one that began meanwhile
    /// either found the axis taken or is seen here.
    fn claim_for_hand(&self, axis: AxisName) -> Result<Claim, ServiceError> {
        self.free_for_hand()?;
        let claim = self.motion.claim(axis)?;
        self.free_for_hand()?;
        Ok(claim)
    }

    /// Starts a move by hand; its end is seen in the events.
    ///
    /// # Errors
    /// Every motion rule, before anything moves.
    pub async fn move_axis(
        self: &Arc<Self>,
        _permit: &Permit,
        axis: AxisName,
        target: Millimetres,
    ) -> Result<BenchView, ServiceError> {
        let claim = self.claim_for_hand(axis)?;
        self.motion.check(axis, target)?;
        self.history_ready().await?;
        self.failures().remove(&axis);
        let service = Arc::clone(self);
        tokio::spawn(async move {
            let ended = service.motion.go_claimed(claim, target).await;
            service.ended_by_hand(axis, ended.map(drop));
        });
        Ok(self.bench_view())
    }

    /// Starts homing an axis; its end is seen in the events.
    ///
    /// # Errors
    /// A refusal before anything moves.
    pub async fn home_axis(self: &Arc<Self>, _permit: &Permit, axis: AxisName) -> Result<BenchView, ServiceError> {
        let claim = self.claim_for_hand(axis)?;
        self.motion.check_home(axis)?;
        self.history_ready().await?;
        self.failures().remove(&axis);
        let service = Arc::clone(self);
        tokio::spawn(async move {
            let ended = service.motion.home_claimed(claim).await;
            service.ended_by_hand(axis, ended);
        });
        Ok(self.bench_view())
    }

    fn jogs(&self) -> MutexGuard<'_, HashMap<AxisName, Jogging>> {
        self.jogs.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Moves an axis towards a side for 0.3 s from now on: asked again in time, it goes on. At the axis's
    /// greatest speed where none is given.
    ///
    /// # Errors
    /// Every motion rule, before anything moves; a jog another way while one is under way.
    pub async fn jog(
        self: &Arc<Self>,
        _permit: &Permit,
        axis: AxisName,
        towards: Side,
        speed_mm_per_s: Option<f64>,
    ) -> Result<BenchView, ServiceError> {
        let greatest = self.motion.axis(axis).speed_mm_per_s;
        let speed = speed_mm_per_s.unwrap_or(greatest);
        if speed.is_nan() || speed <= 0.0 {
            let what = format!("{speed} is not above 0");
            return Err(ServiceError::Invalid { field: "speed_mm_per_s", what });
        }
        if speed > greatest {
            return Err(Refusal::Speed { axis, speed, max: greatest }.into());
        }
        if self.renew_jog(axis, towards, speed) {
            return Ok(self.bench_view());
        }
        self.history_ready().await?;
        let mut jogs = self.jogs();
        let claim = self.claim_for_hand(axis)?;
        self.motion.jog_end(axis, towards)?;
        self.failures().remove(&axis);
        let (grip, deadman) = deadman(JOG_HOLD);
        jogs.insert(axis, Jogging { towards, speed, grip });
        drop(jogs);
        let service = Arc::clone(self);
        tokio::spawn(async move {
            let ended = service.motion.jog_claimed(&claim, towards, speed, deadman).await;
            service.jogs().remove(&axis);
            drop(claim);
            service.ended_by_hand(axis, ended.map(drop));
        });
        Ok(self.bench_view())
    }

    /// Has a jog that is under way go on; the disk is not waited for. Returns whether there is one this way.
    fn renew_jog(&self, axis: AxisName, towards: Side, speed: f64) -> bool {
        let jogs = self.jogs();
        let same = jogs.get(&axis).filter(|jog| (jog.towards, jog.speed) == (towards, speed));
        same.inspect(|jog| jog.grip.renew(JOG_HOLD)).is_some()
    }

    /// Lets a jog go: the axis is stopped. Nothing happens where there is none.
    pub fn end_jog(&self, axis: AxisName) -> BenchView {
        if let Some(jog) = self.jogs().get(&axis) {
            jog.grip.renew(Duration::ZERO);
        }
        self.bench_view()
    }

    /// Takes the operator's statement about the shell.
    ///
    /// # Errors
    /// A refusal while a job holds the bench.
    pub fn set_shell(&self, _permit: &Permit, shell: ShellState) -> Result<BenchView, ServiceError> {
        self.free_for_hand()?;
        self.motion.set_shell(shell);
        self.publish_bench();
        Ok(self.bench_view())
    }

    /// Stops both axes at once, in every state, and latches. A job under way ends as cancelled. The latency reported
    /// counts from `asked`.
    pub async fn stop(&self, asked: Instant) -> StopReport {
        // The job of now: stopping takes a while, in which the stop may be reset and another job begin.
        let job = self.current();
        self.stop_touched.store(true, Ordering::SeqCst);
        let report = self.motion.stop_asked(asked).await;
        // After the axes: the disk may be slow, and is not waited for.
        self.journal.put_stop(&self.motion.stop_view());
        if let Some(job) = job {
            job.cancel("stopped".to_owned());
        }
        self.publish_bench();
        report
    }

    /// Allows motion again; nothing resumes by itself.
    pub fn reset_stop(&self) -> BenchView {
        self.stop_touched.store(true, Ordering::SeqCst);
        self.motion.reset_stop();
        self.journal.put_stop(&self.motion.stop_view());
        self.publish_bench();
        self.bench_view()
    }

    /// Ends the service: refuses new jobs, stops the axes, lets the job under way write its end, stops the watchers.
    pub async fn shut_down(&self) {
        self.closing.store(true, Ordering::SeqCst);
        // Latched, so that a job between two moves cannot begin another one before it hears of its end.
        let stopped = self.motion.stop().await;
        tracing::info!(focus = ?stopped.focus, e = ?stopped.e, "axes stopped");
        if let Some(job) = self.current() {
            job.cancel("the program ended".to_owned());
            ended(&job).await;
        }
        self.tasks.cancel();
        if tokio::time::timeout(FLUSH_ALLOWED, self.journal.end()).await.is_err() {
            tracing::error!("the history was not written to its end in time");
        }
    }

    /// Returns once it is known what an earlier run has left, or that the history cannot be read now.
    pub async fn open_history(&self) {
        if let Err(error) = self.history_ready().await {
            tracing::error!(%error, "the history is not open");
        }
    }

    /// Makes sure that the history can be written; in a file that does not know this run yet, it does so from here on,
    /// and a stop that an earlier run left latched is latched again.
    pub(super) async fn history_ready(&self) -> Result<(), ServiceError> {
        let jobs = || self.all_jobs().iter().map(|job| job.chronicle()).collect();
        if !self.journal.ready(jobs).await? {
            return Ok(());
        }
        if self.stop_touched.swap(true, Ordering::SeqCst) {
            // Stopped or reset while it could not be written.
            self.journal.put_stop(&self.motion.stop_view());
        } else {
            match self.journal.kept_stop().await {
                Ok(Some(stop)) if stop.latched => {
                    tracing::warn!(since = ?stop.since, "the stop of an earlier run is still latched");
                    self.motion.latch(stop.since);
                }
                Ok(_) => {}
                Err(error) => {
                    self.stop_touched.store(false, Ordering::SeqCst);
                    return Err(error.into());
                }
            }
        }
        if self.leases.view().is_none()
            && let Some(lease) = self.journal.kept_lease().await?
        {
            self.leases.restore(lease);
        }
        self.publish_bench();
        Ok(())
    }

    /// Keeps the history going: knows when it can be written and when not, and tells.
    async fn watch_history(&self) {
        let mut health = self.journal.store().health();
        loop {
            if let Err(error) = self.history_ready().await {
                tracing::warn!(%error, "nothing moves for now");
            }
            self.publish_bench();
            if health.changed().await.is_err() {
                return;
            }
        }
    }

    /// Publishes the bench's state whenever the lease's changes, and when it runs out.
    async fn watch_lease(&self) {
        let mut changes = self.leases.changes();
        loop {
            let runs_out = self.leases.runs_out();
            tokio::select! {
                changed = changes.changed() => if changed.is_err() { return },
                () = tokio::time::sleep(PULSE) => {
                    beat(&self.pulses[1]);
                    continue;
                }
                () = async {
                    match runs_out {
                        Some(until) => tokio::time::sleep_until(until).await,
                        None => std::future::pending().await,
                    }
                } => {}
            }
            beat(&self.pulses[1]);
            changes.mark_unchanged();
            self.journal.put_lease(self.leases.keep().as_ref());
            self.publish_bench();
        }
    }

    /// The bench as it is, for whoever keeps watch from outside.
    #[must_use]
    pub fn gauges(&self) -> BenchGauges {
        let view = self.bench_view();
        let camera = view.camera;
        BenchGauges {
            frame_age: self.bench.camera.newest().map(|frame| frame.exposed_to.elapsed()),
            camera_online: camera.online,
            frames_lost: camera.frames_lost,
            frames_damaged: camera.frames_damaged,
            axes: view
                .axes
                .iter()
                .map(|axis| (axis.axis.name(), axis.connected, axis.homed, axis.position_mm))
                .collect(),
            stop_latched: view.stop.latched,
            lease_held: view.lease.is_some(),
            job_running: view.job.is_some(),
            simulated: view.simulated,
        }
    }

    /// Returns once each of the service's watchers has come round: whoever bounds the wait learns whether they are stuck.
    pub async fn shows_life(&self) -> bool {
        for pulse in &self.pulses {
            let mut beats = pulse.subscribe();
            if beats.changed().await.is_err() {
                return false;
            }
        }
        true
    }

    /// What keeps the bench from working now, one sentence each; nothing where all is well.
    #[must_use]
    pub fn hindrances(&self) -> Vec<String> {
        let view = self.bench_view();
        let mut hindrances = Vec::new();
        if self.closing.load(Ordering::SeqCst) {
            hindrances.push("the program is shutting down".to_owned());
        }
        for axis in view.axes.iter().filter(|axis| !axis.connected) {
            let why = axis.fault.as_deref().unwrap_or("its controller does not answer");
            hindrances.push(format!("the {} axis is not connected: {why}", axis.axis));
        }
        if !view.camera.online {
            let why = view.camera.fault.as_deref().unwrap_or("no frame comes");
            hindrances.push(format!("the camera is not online: {why}"));
        }
        hindrances
    }

    fn publish_bench(&self) {
        // Nobody listening is no error.
        let _ = self.events.send(Event::Bench { bench: Box::new(self.bench_view()) });
    }

    fn publish_measurement(&self, measurement: MeasurementView) {
        *self.measurement.lock().unwrap_or_else(PoisonError::into_inner) = Some(measurement.clone());
        let _ = self.events.send(Event::Measurement { measurement });
    }

    /// Publishes the bench's state whenever a device's changes.
    async fn watch_bench(&self) {
        let mut focus = self.bench.focus.state();
        let mut e = self.bench.e.state();
        let mut camera = self.bench.camera.state();
        loop {
            let changed = tokio::select! {
                changed = focus.changed() => changed.is_ok(),
                changed = e.changed() => changed.is_ok(),
                changed = camera.changed() => changed.is_ok(),
                () = tokio::time::sleep(PULSE) => {
                    beat(&self.pulses[0]);
                    continue;
                }
            };
            if !changed {
                return;
            }
            beat(&self.pulses[0]);
            if !focus.borrow_and_update().homed {
                self.eye.forget_air_step();
            }
            e.mark_unchanged();
            camera.mark_unchanged();
            self.publish_bench();
            tokio::time::sleep(VIEW_INTERVAL).await;
        }
    }

    /// Publishes what the jobs measure and, while somebody watches and no job measures, the live picture's spacing.
    async fn watch_focus(&self) {
        let mut measured = self.eye.measured();
        loop {
            tokio::select! {
                changed = measured.changed() => {
                    if changed.is_err() {
                        return;
                    }
                    let newest = measured.borrow_and_update().clone();
                    if let Some(measurement) = newest {
                        self.publish_measurement(measurement);
                    }
                }
                () = tokio::time::sleep(LIVE_INTERVAL) => {
                    if Arc::strong_count(&self.onlookers) > 1
                        && self.current().is_none_or(|job| job.snapshot().state == JobState::WaitingForOperator)
                        && let Some(measurement) = self.eye.measure_live().await
                    {
                        self.publish_measurement(measurement);
                    }
                }
            }
        }
    }
}

/// Waits for a job's end, for as long as a job may take to stop the axes and to write its report.
async fn ended(job: &Job) {
    let ended = async {
        while !job.snapshot().state.is_final() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    if tokio::time::timeout(JOB_END_ALLOWED, ended).await.is_err() {
        tracing::error!("the job did not end in time; the axes have been stopped");
    }
}

fn beat(pulse: &watch::Sender<u64>) {
    pulse.send_modify(|beats| *beats += 1);
}
