//! A recorded job done again: the recorded frames are measured anew and the same controller is stepped, by the very code
//! that runs jobs, and what comes of it is compared with what was recorded, to the last bit.

mod compare;
mod recorded;

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use serde::Serialize;
use tokio::sync::broadcast::error::RecvError;
use uuid::Uuid;

use crate::events::Event;
use crate::job::{JobKind, JobSnapshot, JobState};
use crate::motion::lease::{DEFAULT_TTL_S, LeaseRequest};
use crate::recording::{Happening, Sink};
use crate::service::Service;
use bench::config::Config;
use bench::device::replayed::{self, EXHAUSTED, RecordedFrames};
use bench::record::ReadError;
use bench::store::Store;

pub use compare::{Difference, Step, What};
use compare::{Figure, compare};
use recorded::Recorded;

/// Why a recording cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The file cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// It holds no job of this program's, or not enough of one.
    #[error("{file} cannot be replayed: {why}")]
    Unusable {
        /// The file.
        file: String,
        /// Why not, in words.
        why: String,
    },
}

/// What came of a replay.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Replay {
    /// The file.
    pub file: String,
    /// The recorded job.
    pub job: Uuid,
    /// What it did.
    pub kind: JobKind,
    /// Whether its bench was simulated.
    pub simulated: bool,
    /// Version of the program that recorded it.
    pub recorded_by: String,
    /// Version of this program.
    pub replayed_by: String,
    /// Why the recording does not go to the job's end; `null` where it does.
    pub cut: Option<String>,
    /// Every measurement and decision, in order.
    pub steps: Vec<Step>,
    /// How the recorded job ended; `null` where the recording does not go so far.
    pub recorded_end: Option<Ended>,
    /// How the replayed one did.
    pub replayed_end: Ended,
    /// What differs, first things first.
    pub differences: Vec<Difference>,
    /// What is to be known about the comparison, one sentence each.
    pub notes: Vec<String>,
    /// Whether nothing differs.
    pub identical: bool,
}

/// How a job ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Ended {
    /// As what.
    pub state: JobState,
    /// Why, in words.
    pub reason: String,
}

/// Keeps what a replayed job measures and decides.
#[derive(Default)]
struct Kept(Mutex<Vec<Figure>>);

impl Sink for Kept {
    fn take(&self, happening: Happening) {
        let figure = match happening {
            Happening::Measured(view, _) => Figure::Measured(view),
            Happening::Decided(iteration) => Figure::Decided(iteration),
            _ => return,
        };
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(figure);
    }
}

/// Replays a recording. Nothing moves, and nothing is written.
///
/// # Errors
/// [`ReplayError`] where the file cannot be read, or holds nothing that can be done again.
pub async fn replay(path: &Path) -> Result<Replay, ReplayError> {
    let file = path.display().to_string();
    let unusable = |why: String| ReplayError::Unusable { file: file.clone(), why };
    let recorded = {
        let path = path.to_owned();
        tokio::task::spawn_blocking(move || Recorded::read(&path))
            .await
            .map_err(|error| unusable(error.to_string()))??
    };
    let start = &recorded.start;
    let config = Config::from_toml(&start.configuration_toml, "the recorded configuration")
        .map_err(|error| unusable(error.to_string()))?;
    let mut request = recorded.request()?;
    request.record = None;
    // Nothing is decided by it, and it may be of a version that took others.
    request.note = None;
    let mut frames = RecordedFrames::open(path, recorded.lasted)?;
    let white = match start.white_frame_before {
        true => {
            let frame = frames.next_frame().ok_or_else(|| unusable("it ends before its first frame".to_owned()))?;
            Some(frame.map_err(unusable)?)
        }
        false => None,
    };
    let bench = replayed::bench(start, path, frames, recorded.answers.clone());
    let service = Service::start(Arc::new(config), start.design_origin.clone(), bench, Store::in_memory());
    service.begin_as(start, white).await.map_err(unusable)?;
    let kept = Arc::new(Kept::default());
    let ended = run(&service, request, Arc::clone(&kept)).await;
    service.shut_down().await;
    let ended = ended.map_err(unusable)?;
    let figures = std::mem::take(&mut *kept.0.lock().unwrap_or_else(PoisonError::into_inner));
    Ok(compared(file, &recorded, &figures, &ended))
}

async fn run(service: &Arc<Service>, request: crate::job::JobRequest, sink: Arc<Kept>) -> Result<JobSnapshot, String> {
    let words = |error: &dyn std::fmt::Display| error.to_string();
    let mut events = service.subscribe();
    let ttl = Duration::from_secs_f64(DEFAULT_TTL_S);
    let lease = LeaseRequest { owner: "a replay".to_owned(), note: None, ttl };
    let grant = service.leases().acquire(lease).map_err(|error| words(&error))?;
    let permit = service.leases().permit(Some(&grant.key)).map_err(|error| words(&error))?;
    let created = service.create_job_watched(&permit, request, sink).await;
    let id = created.map_err(|error| words(&error))?.id;
    loop {
        match events.recv().await {
            Ok(Event::Job { job }) if job.id == id && job.state.is_final() => return Ok(*job),
            Ok(_) => {}
            Err(RecvError::Lagged(_)) => {
                let job = service.job(id).map_err(|error| words(&error))?;
                if job.state.is_final() {
                    return Ok(job);
                }
            }
            Err(RecvError::Closed) => return Err("the replay's own service ended before its job".to_owned()),
        }
    }
}

fn compared(file: String, recorded: &Recorded, figures: &[Figure], ended: &JobSnapshot) -> Replay {
    let (steps, mut differences) = compare(&recorded.figures, figures, recorded.is_whole_job());
    let replayed_end = Ended { state: ended.state, reason: ended.reason.clone().unwrap_or_default() };
    let mut notes = Vec::new();
    let recorded_end = recorded.end.clone();
    match (&recorded_end, &recorded.cut) {
        (Some(end), _) if end.state == JobState::Cancelled => {
            notes.push(format!("the recorded job was cancelled ({}): it is compared up to there", end.reason));
        }
        // By what no device answered: a bench that did not come to rest, a computation that ended unexpectedly.
        (Some(end), _) if end.state == JobState::Failed && replayed_end.reason.contains(EXHAUSTED) => {
            notes.push(format!("the recorded job failed from outside ({}): it is compared up to there", end.reason));
        }
        (Some(end), _) => differences.extend(compare::ends(end, &replayed_end)),
        (None, Some(why)) => notes.push(format!("the recording was cut ({why}): it is compared up to there")),
        (None, None) => {}
    }
    let (recorded_by, replayed_by) = (recorded.start.version.clone(), env!("CARGO_PKG_VERSION").to_owned());
    if recorded_by != replayed_by {
        notes.push(format!("version {recorded_by} recorded what version {replayed_by} replays"));
    }
    Replay {
        file,
        job: recorded.job,
        kind: ended.kind,
        simulated: recorded.start.simulated,
        recorded_by,
        replayed_by,
        cut: recorded.cut.clone(),
        steps,
        recorded_end,
        replayed_end,
        identical: differences.is_empty(),
        differences,
        notes,
    }
}
