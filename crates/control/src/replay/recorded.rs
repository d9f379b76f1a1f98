//! A recording as a replay needs it: all but the frames, which are read as they are measured.

use std::path::Path;
use std::time::Duration;

use prost::Message;
use uuid::Uuid;

use super::compare::Figure;
use super::{Ended, ReplayError};
use crate::job::{JobRequest, JobState};
use crate::recording::words;
use bench::record::messages::{Answer, Decision, FrameInfo, JobEnd, JobStart, Measurement};
use bench::record::{Ending, Item, Reader, Topic};

/// What was recorded of a job.
pub(super) struct Recorded {
    file: String,
    pub(super) job: Uuid,
    pub(super) start: JobStart,
    pub(super) answers: Vec<Answer>,
    pub(super) figures: Vec<Figure>,
    pub(super) end: Option<Ended>,
    /// Why the recording does not go to the job's end.
    pub(super) cut: Option<String>,
    /// From its begin to its last frame, at least.
    pub(super) lasted: Duration,
}

impl Recorded {
    /// Reads a recording.
    pub(super) fn read(path: &Path) -> Result<Self, ReplayError> {
        let file = path.display().to_string();
        let unusable = |why: String| ReplayError::Unusable { file: file.clone(), why };
        let mut reader = Reader::open(path)?;
        let (mut start, mut end) = (None, None);
        let (mut answers, mut figures, mut lasted) = (Vec::new(), Vec::new(), 0);
        for item in reader.by_ref() {
            let Item::Message { topic, schema, data, .. } = item else { continue };
            let Some(known) = bench::record::topic(&topic).filter(|known| known.schema == schema) else { continue };
            match known {
                Topic::START => start = Some(decoded::<JobStart>(known, &data).map_err(unusable)?),
                Topic::FRAME => {
                    lasted = lasted.max(decoded::<FrameInfo>(known, &data).map_err(unusable)?.exposed_to_ns);
                }
                Topic::ANSWER => answers.push(decoded::<Answer>(known, &data).map_err(unusable)?),
                Topic::MEASUREMENT => {
                    let message = decoded::<Measurement>(known, &data).map_err(unusable)?;
                    figures.push(Figure::Measured(Box::new(words::measured(&message))));
                }
                Topic::DECISION => {
                    let message = decoded::<Decision>(known, &data).map_err(unusable)?;
                    figures.push(Figure::Decided(Box::new(words::decided(&message).map_err(unusable)?)));
                }
                Topic::END => end = Some(decoded::<JobEnd>(known, &data).map_err(unusable)?),
                _ => {}
            }
        }
        let start =
            start.ok_or_else(|| unusable("it holds no job of plenalign's, or was cut before it began".to_owned()))?;
        let job = start.job_id.parse().map_err(|_| unusable(format!("{:?} is no job's id", start.job_id)))?;
        let cut = match (&end, reader.ending()) {
            (None, Some(Ending::Cut(why))) => Some(why.clone()),
            (None, _) => Some("the recording ended before the job did".to_owned()),
            (Some(_), _) => None,
        };
        let end = end.map(|end| {
            let state: JobState = words::known(&end.state)?;
            Ok(Ended { state, reason: end.reason })
        });
        let end = end.transpose().map_err(unusable)?;
        let lasted = Duration::from_nanos(u64::try_from(lasted).unwrap_or(0));
        Ok(Self { file, job, start, answers, figures, end, cut, lasted })
    }

    /// What was asked for.
    pub(super) fn request(&self) -> Result<JobRequest, ReplayError> {
        serde_json::from_str(&self.start.request_json)
            .map_err(|error| ReplayError::Unusable { file: self.file.clone(), why: format!("its request: {error}") })
    }

    /// Whether it goes to an end that the job came to by itself.
    pub(super) fn is_whole_job(&self) -> bool {
        self.end.as_ref().is_some_and(|end| end.state != JobState::Cancelled)
    }
}

fn decoded<T: Message + Default>(topic: Topic, data: &[u8]) -> Result<T, String> {
    T::decode(data).map_err(|error| format!("a message on {} cannot be read: {error}", topic.name))
}
