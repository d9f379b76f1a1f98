//! Jobs: accepted one at a time, run and cancelled.

use std::panic::AssertUnwindSafe;
use std::path::PathBuf;
use std::sync::Arc;

use futures_util::FutureExt as _;
use tracing::Instrument as _;
use uuid::Uuid;

use super::Service;
use super::by_hand::broken;
use crate::alignment::runner;
use crate::job::{JobKind, JobRequest, JobSnapshot, JobState, Recording, RecordingState, word};
use crate::motion::Admission;
use crate::motion::lease::Permit;
use crate::recording::{FileSink, Happening, Sink};
use crate::running::context::JobContext;
use crate::running::job::Job;
use crate::{Refusal, ServiceError};
use bench::device::AxisName;

/// Jobs kept in memory.
const MAX_JOBS: usize = 100;

/// What takes the recording of a job, beside what the configuration and its request say.
#[derive(Default)]
struct Recorded {
    /// A file of the caller's choice.
    file: Option<PathBuf>,
    /// A comparison.
    sink: Option<Arc<dyn Sink>>,
}

/// Whether something begins with this request, or had begun before: a job under the same name, a jog that goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Acceptance {
    /// Now.
    Now,
    /// Before: nothing has begun anew.
    Before,
}

impl Service {
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
        let admission = self.motion.admit(permit);
        let _accepting = self.accepting.lock().await;
        self.accept_job(permit, admission, request, None, Recorded::default()).await
    }

    /// Starts a job that is recorded to a file of the caller's choice, whatever the configuration says.
    ///
    /// # Errors
    /// As [`Service::create_job`]. A file that cannot be written is none: the job says so.
    pub async fn create_job_recorded(
        self: &Arc<Self>,
        permit: &Permit,
        request: JobRequest,
        file: PathBuf,
    ) -> Result<JobSnapshot, ServiceError> {
        let admission = self.motion.admit(permit);
        let _accepting = self.accepting.lock().await;
        self.accept_job(permit, admission, request, None, Recorded { file: Some(file), sink: None }).await
    }

    /// Starts a job and hands what is recorded of it to `sink`.
    pub(crate) async fn create_job_watched(
        self: &Arc<Self>,
        permit: &Permit,
        request: JobRequest,
        sink: Arc<dyn Sink>,
    ) -> Result<JobSnapshot, ServiceError> {
        let admission = self.motion.admit(permit);
        let _accepting = self.accepting.lock().await;
        self.accept_job(permit, admission, request, None, Recorded { file: None, sink: Some(sink) }).await
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
        let admitted = permit.map(|permit| (self.motion.admit(&permit), permit));
        let _accepting = self.accepting.lock().await;
        if let Some(job) = self.job_of_key(&request, &key).await? {
            return Ok((job, Acceptance::Before));
        }
        let (admission, permit) = admitted?;
        let job = self.accept_job(&permit, admission, request, Some(key), Recorded::default()).await?;
        Ok((job, Acceptance::Now))
    }

    async fn accept_job(
        self: &Arc<Self>,
        permit: &Permit,
        admission: Admission,
        request: JobRequest,
        key: Option<String>,
        recorded: Recorded,
    ) -> Result<JobSnapshot, ServiceError> {
        request.check(&self.config)?;
        // A replay meets again what the job met.
        if recorded.sink.is_none() && request.kind != JobKind::Homing {
            self.eye.check_camera().map_err(|why| Refusal::NotMeasurable { why: why.to_string() })?;
        }
        self.history_ready().await?;
        let (job, context) = self.reserve(permit, &admission, &request, key)?;
        let written = self.journal.begin_job(job.chronicle()).await.map_err(ServiceError::from);
        // The disk took its time, in which a stop or another's lease may have come.
        let admitted = written
            .and_then(|()| AxisName::ALL.into_iter().try_for_each(|axis| self.motion.in_force(&admission, axis)));
        if let Err(error) = admitted {
            let id = job.snapshot().id;
            self.all_jobs().retain(|other| !Arc::ptr_eq(other, &job));
            job.forget();
            self.journal.end_job();
            self.leases.unbind(id);
            self.journal.forget_job(id);
            return Err(error);
        }
        self.failures().clear();
        self.begin_recording(&job, recorded);
        // Beside it: the history's file is waited for by nobody.
        let (asking, asked) = (Arc::clone(self), Arc::clone(&job));
        tokio::spawn(async move {
            if let Some(usual_s) = asking.usual_time_s(&request).await {
                asked.expect(usual_s);
            }
        });
        let service = Arc::clone(self);
        tokio::spawn(async move { service.run(context, admission).await });
        Ok(job.snapshot())
    }

    /// Has a job that has been accepted recorded where that is wanted, beginning with all that it begins with.
    fn begin_recording(&self, job: &Arc<Job>, recorded: Recorded) {
        if let Some(sink) = recorded.sink {
            self.journal.record_to(sink);
        }
        match self.place_of(job, recorded.file) {
            None => {}
            Some(Err(why)) => {
                let file = String::new();
                job.recording(Recording { file, state: RecordingState::Recording, bytes: None, fault: None });
                job.recording_failed(why);
            }
            Some(Ok(place)) => {
                let (file, state) = (place.name, RecordingState::Recording);
                job.recording(Recording { file, state, bytes: None, fault: None });
                let told = Arc::downgrade(job);
                let tell = move |why| {
                    if let Some(job) = told.upgrade() {
                        job.recording_failed(why);
                    }
                };
                let sink = Arc::new(FileSink::start(place.path, &self.config, Box::new(tell)));
                job.record_to(Arc::clone(&sink));
                self.journal.record_to(sink);
            }
        }
        self.journal.happened(|| Happening::Start(Box::new(self.start_of(&job.snapshot()))));
        if let Some(white) = self.eye.white_frame() {
            self.journal.happened(|| Happening::Frame(white));
        }
    }

    /// Gives the bench to a new job.
    fn reserve(
        &self,
        permit: &Permit,
        admission: &Admission,
        request: &JobRequest,
        key: Option<String>,
    ) -> Result<(Arc<Job>, JobContext), ServiceError> {
        self.open_for_motion()?;
        AxisName::ALL.into_iter().try_for_each(|axis| self.motion.in_force(admission, axis))?;
        let mut jobs = self.all_jobs();
        if let Some(holder) = jobs.iter().find(|job| !job.snapshot().state.is_final()) {
            return Err(Refusal::Busy { job: holder.snapshot().id }.into());
        }
        for axis in AxisName::ALL {
            // Taken for a moment: a command by hand that comes meanwhile sees the job, or is seen here.
            self.motion.claim(admission, axis)?;
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

    async fn run(&self, context: JobContext, admission: Admission) {
        let (id, kind) = (context.snapshot().id, context.snapshot().kind);
        // A recording has what the meter reads, too.
        let _readings = context.is_recorded().then(|| self.readings());
        let span = tracing::info_span!("job", otel.name = format!("job {}", word(&kind)), %id);
        let running = runner::run(&context, &self.motion, &admission, &self.eye, &self.config, &self.design_origin);
        let running = context.clock().run(running);
        if let Err(panic) = AssertUnwindSafe(running).catch_unwind().instrument(span).await {
            let breaking_off = runner::break_off(&context, &self.motion, broken(&*panic));
            if AssertUnwindSafe(breaking_off).catch_unwind().await.is_err() {
                context.close(JobState::Failed, broken(&*panic), None);
            }
        }
        self.journal.end_job();
        self.leases.unbind(id);
        self.publish_bench();
    }

    /// Asks a job to end, and keeps who did where that is known; may be repeated, also after its end.
    ///
    /// # Errors
    /// [`ServiceError::NoSuchJob`].
    pub fn cancel(&self, id: Uuid, by: Option<&str>) -> Result<JobSnapshot, ServiceError> {
        let job = self.find(id)?;
        job.cancel(by.map_or_else(|| "cancelled".to_owned(), |by| format!("cancelled by {by}")));
        Ok(job.snapshot())
    }
}
