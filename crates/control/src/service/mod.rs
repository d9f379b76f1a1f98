//! What callers hold: the bench with its motion rules, the one job, and what happens.

mod by_hand;
pub(crate) mod confirm_key;
mod exposure;
mod health;
pub mod history;
pub(crate) mod jobs;
pub mod light;
pub mod look;
mod measuring;
pub mod pose;
mod press;
pub mod recent;
mod recording;
mod retention;
mod simulated;
mod stopping;
mod watchers;

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, broadcast, watch};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

use crate::events::{AxisView, BenchView, CameraView, Event, FieldMap, LeaseView, MeasurementView};
use crate::history::journal::Journal;
use crate::job::JobSnapshot;
use crate::measuring::eye::Eye;
use crate::measuring::meter::Readings;
use crate::motion::lease::{LeaseGrant, LeaseRequest, Leases};
use crate::motion::{Motion, Stops};
use crate::plan::Travel;
use crate::running::job::Job;
use crate::service::by_hand::{Failure, Jogging};
use crate::service::confirm_key::ConfirmKeys;
use crate::service::look::Looks;
use crate::service::press::Presses;
use crate::service::recent::Recent;
use crate::service::simulated::PlanInForce;
use crate::service::stopping::KEEP_ALLOWED;
use crate::{Refusal, ServiceError};
use bench::access::PROGRAM;
use bench::config::Config;
use bench::device::{AxisName, Bench};
use bench::store::{Store, StoreError};

/// Events kept for a subscriber that lags.
const EVENT_QUEUE: usize = 1024;
/// How long a job may take to stop the axes and to write its report.
const JOB_END_ALLOWED: Duration = Duration::from_secs(3);
/// How long the axes and the job together may take to come to rest when the program ends.
const REST_ALLOWED: Duration = Duration::from_millis(2_500);
/// How long the history may take to come to its end.
const FLUSH_ALLOWED: Duration = Duration::from_secs(1);

/// The bench with its motion rules, the one job, and what happens.
pub struct Service {
    config: Arc<Config>,
    design_origin: String,
    bench: Bench,
    motion: Arc<Motion>,
    leases: Arc<Leases>,
    pub(crate) eye: Arc<Eye>,
    journal: Arc<Journal>,
    /// One job at a time is being accepted.
    accepting: tokio::sync::Mutex<()>,
    /// One at a time takes up what an earlier run has left, or resets its stop: whoever comes second finds it done.
    recalling: tokio::sync::Mutex<()>,
    /// How often the bench had been stopped, or the stop reset, as its latch came to the disk last.
    kept_turns: AtomicU64,
    /// The lease is not on the disk as it is.
    lease_unkept: Notify,
    events: broadcast::Sender<Event>,
    /// One state of the bench at a time is being published.
    publishing: Mutex<()>,
    jobs: Mutex<Vec<Arc<Job>>>,
    measurement: Mutex<Option<MeasurementView>>,
    recent: Recent,
    /// One frame at a time is measured for who asks.
    measuring: tokio::sync::Mutex<()>,
    /// One frame at a time is made ready for pictures.
    looks: tokio::sync::Mutex<Looks>,
    /// Why the last command by hand of an axis did not end as commanded.
    failures: Mutex<HashMap<AxisName, Failure>>,
    jogs: Mutex<HashMap<AxisName, Jogging>>,
    presses: Presses,
    confirm_keys: ConfirmKeys,
    closing: AtomicBool,
    /// Asks the service's own watchers for a sign of life; each answers when it comes round.
    pulses: [watch::Sender<u64>; 2],
    /// Shared with everybody who watches the live picture's whole measurement.
    onlookers: Arc<()>,
    pub(crate) readings: Readings,
    /// Whether the camera's exposure is searched for.
    searching: AtomicBool,
    /// When the camera's exposure or gain was set last.
    light_set_at: Mutex<Option<Instant>>,
    /// What is to go wrong with a simulated bench, and when.
    fault_plan: Mutex<Option<PlanInForce>>,
    tasks: CancellationToken,
}

impl Service {
    /// Starts the service over a bench: its watchers run until [`Service::shut_down`]. `design_origin` says where the
    /// design's numbers come from; `store` is the history, without which nothing moves.
    #[must_use]
    pub fn start(config: Arc<Config>, design_origin: String, bench: Bench, store: Store) -> Arc<Self> {
        let (events, _) = broadcast::channel(EVENT_QUEUE);
        let journal = Arc::new(Journal::new(store, &config));
        let leases = Arc::<Leases>::default();
        let motion = Motion::new(Arc::clone(&config), bench.clone(), Arc::clone(&leases));
        let motion = Arc::new(motion.recorded(Arc::clone(&journal)));
        let eye = Arc::new(Eye::new(Arc::clone(&config), bench.clone(), Arc::clone(&motion), Arc::clone(&journal)));
        let service = Arc::new(Self {
            config,
            design_origin,
            bench,
            motion,
            leases,
            eye,
            journal,
            accepting: tokio::sync::Mutex::default(),
            recalling: tokio::sync::Mutex::default(),
            kept_turns: AtomicU64::default(),
            lease_unkept: Notify::default(),
            events,
            publishing: Mutex::default(),
            jobs: Mutex::new(Vec::new()),
            measurement: Mutex::new(None),
            recent: Recent::default(),
            measuring: tokio::sync::Mutex::default(),
            looks: tokio::sync::Mutex::default(),
            failures: Mutex::default(),
            jogs: Mutex::default(),
            presses: Presses::default(),
            confirm_keys: ConfirmKeys::default(),
            closing: AtomicBool::new(false),
            pulses: [watch::Sender::new(0), watch::Sender::new(0)],
            onlookers: Arc::default(),
            readings: Readings::default(),
            searching: AtomicBool::default(),
            light_set_at: Mutex::default(),
            fault_plan: Mutex::default(),
            tasks: CancellationToken::new(),
        });
        service.watch();
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

    /// Has the live picture measured in whole between jobs, now and then, for as long as what this returns is held: with
    /// the view's clarity and the spacing over the field. It costs a core a good part of its time: nobody watching, it
    /// rests.
    #[must_use]
    pub fn look_on(&self) -> Arc<()> {
        Arc::clone(&self.onlookers)
    }

    /// The spacing over the field in the newest measurement of a single board.
    #[must_use]
    pub fn field_map(&self) -> watch::Receiver<Option<Arc<FieldMap>>> {
        self.eye.map()
    }

    /// Since when what stands before the camera does, and the shell is on or off.
    #[must_use]
    pub fn set_up_at(&self) -> jiff::Timestamp {
        self.eye.set_up_at()
    }

    /// The state of the whole bench.
    #[must_use]
    pub fn bench_view(&self) -> BenchView {
        let job = self.current().map(|job| job.snapshot().id);
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
                unfit: camera.unfit,
                frames_lost: camera.frames_lost,
                frames_damaged: camera.frames_damaged,
                notes: camera.notes,
                replay: camera.replay,
                frame_seq: frame.as_ref().map(|frame| frame.seq),
                frame_age_ms: frame.map(|frame| frame.exposed_to.elapsed().as_secs_f64() * 1000.0),
            },
            shell: self.motion.shell(),
            in_view: self.eye.in_view(),
            set_up_at: self.eye.set_up_at(),
            air_step_holds: self.eye.air_step_holds(),
            contradicted: self.eye.contradicted(),
            stop: self.motion.stop_view(),
            lease: self.leases.view(),
            job,
            confirm_key_begins: job.and_then(|job| self.confirm_keys.begins(job)),
            e_wall_mm: self.motion.e_wall_reading_mm(),
            e_untold: self.motion.is_e_untold(),
            history_fault: self.journal.fault(),
        }
    }

    /// The state of one axis.
    #[must_use]
    pub fn axis_view(&self, axis: AxisName) -> AxisView {
        let stage = self.bench.stage(axis);
        let (info, state) = (stage.info(), stage.state().borrow().clone());
        let (low_limit_mm, high_limit_mm) = self.motion.range_mm(axis);
        // Between the pieces of its way, and before the first, a driver reads an axis at rest.
        let moving = state.moving || self.is_commanded(axis);
        // What keeps it from moving whatever else is done comes before what homing would clear.
        let contradicts = state.connected && !info.contradictions.is_empty();
        let fault = if contradicts { Some(info.contradictions.join(" ")) } else { state.fault };
        AxisView {
            axis,
            driver: info.driver,
            identity: info.identity,
            location: info.location,
            connected: state.connected,
            homed: state.homed,
            position_mm: state.homed.then_some(state.position.value()),
            moving,
            low_limit_mm,
            high_limit_mm,
            jog_speed_mm_per_s: self.motion.jog_speed_mm_per_s(axis),
            limit_switch: state.limit_switch,
            fault,
            failure: self.failures().get(&axis).map(|failure| failure.why.clone()),
            disagreements: info.disagreements,
        }
    }

    /// The newest measurement of the live picture or of a job.
    #[must_use]
    pub fn measurement(&self) -> Option<MeasurementView> {
        self.measurement.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn all_jobs(&self) -> MutexGuard<'_, Vec<Arc<Job>>> {
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

    /// The stops that have been given by now: what is asked for now may move until another one comes.
    #[must_use]
    pub fn stops(&self) -> Stops {
        self.motion.stops()
    }

    /// How far the axes may travel by a configuration, with the shell off: their controllers may let them less far.
    #[must_use]
    pub fn travel(&self, config: &Config) -> Travel {
        self.motion.travel(config)
    }

    /// The control lease.
    #[must_use]
    pub fn leases(&self) -> &Leases {
        &self.leases
    }

    /// Gives the control lease to another than who has it. The former key is dead first; then what moved under it is
    /// ended, and a job that held it cancelled.
    pub async fn take_over(&self, request: LeaseRequest) -> LeaseGrant {
        let why = format!("the control lease was taken over by {}", request.owner);
        let grant = self.leases.take_over(request);
        // Under the new lease nothing can have begun: its key is not handed out yet.
        let job = self.current();
        if let Some(job) = &job {
            job.cancel(why);
        }
        tokio::join!(biased; self.motion.end_uncontrolled(), self.lease_kept_soon());
        if let Some(job) = &job {
            ended(job).await;
        }
        grant
    }

    /// Gives the lease that `key` opens back, and ends what moves under it; where a job holds it, at that job's end.
    /// Returns what is given back: a key that is not the holder's has nothing to give.
    ///
    /// # Errors
    /// [`Refusal::LeaseRequired`] without a key.
    pub async fn release_lease(&self, key: Option<&str>) -> Result<Option<LeaseView>, Refusal> {
        let released = self.leases.release(key)?;
        tokio::join!(biased; self.motion.end_uncontrolled(), self.lease_kept_soon());
        Ok(released)
    }

    /// Has the history know who has the control before that is told, so that a key that is dead is so after a restart,
    /// too; a slow disk is waited for a moment at most.
    async fn lease_kept_soon(&self) {
        if !matches!(tokio::time::timeout(KEEP_ALLOWED, self.write_lease()).await, Ok(Ok(()))) {
            self.lease_unkept.notify_one();
        }
    }

    async fn write_lease(&self) -> Result<(), StoreError> {
        let leases = Arc::clone(&self.leases);
        self.journal.write_lease(move || leases.keep()).await
    }

    fn open_for_motion(&self) -> Result<(), ServiceError> {
        if self.closing.load(Ordering::SeqCst) { Err(Refusal::ShuttingDown.into()) } else { Ok(()) }
    }

    /// Ends the service: refuses new jobs, stops the axes, lets the job under way write its end, stops the watchers and
    /// writes the history to its end.
    pub async fn shut_down(&self) {
        self.come_to_rest().await;
        self.end().await;
    }

    /// The first half of the end: refuses new jobs, stops the axes, and lets the job under way write its end. Takes no
    /// longer than 2.5 s: what the controllers did not confirm by then, and the job, are left as they are.
    pub async fn come_to_rest(&self) {
        self.closing.store(true, Ordering::SeqCst);
        let orderly = async {
            let job = self.current();
            if let Some(job) = &job {
                job.cancel("the program ended".to_owned());
            }
            // Latched, so that a job between two moves cannot begin another one before it hears of its end.
            let stopped = self.motion.stop(Instant::now(), PROGRAM).await;
            tracing::info!(focus = ?stopped.focus, e = ?stopped.e, "axes stopped");
            if let Some(job) = job {
                ended(&job).await;
            }
        };
        if tokio::time::timeout(REST_ALLOWED, orderly).await.is_err() {
            tracing::error!("the axes were not confirmed stopped, or the job did not end, in time");
        }
    }

    /// The second half of the end: stops the watchers, lets the camera go and writes the history to its end.
    pub async fn end(&self) {
        self.tasks.cancel();
        let kept = async { !self.is_stop_unkept() || self.keep_stop().await };
        let (kept, (), ()) =
            tokio::join!(tokio::time::timeout(FLUSH_ALLOWED, kept), self.lease_kept_soon(), self.bench.camera.end());
        let kept = kept == Ok(true);
        if !kept && self.motion.stop_to_keep().latched {
            tracing::error!("the bench is stopped, and that is not on the disk: the next start does not know of it");
        }
        if tokio::time::timeout(FLUSH_ALLOWED, self.journal.end()).await.is_err() {
            tracing::error!("the history was not written to its end in time");
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
