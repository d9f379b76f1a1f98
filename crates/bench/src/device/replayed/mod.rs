//! The bench of a recording: a camera that gives the recorded frames in their order, and stages that answer what the real
//! ones answered. Nothing moves, and no time passes: what took an hour is over in the time that measuring takes.

mod camera;
mod operator;
mod stage;

use std::path::{Path, PathBuf};
use std::sync::Arc;

pub use camera::{EXHAUSTED, RecordedFrames};

use self::camera::{CAMERA, ReplayedCamera};
pub use self::operator::OPERATOR;
use self::operator::ReplayedOperator;
use self::stage::{ReplayedStage, Tape};
use super::{AxisName, Bench, DeviceError};
use crate::record::messages::{Answer, JobStart};

/// What the devices of a recording are called in errors.
const NAME: &str = "the recording";

/// A bench that answers as the recorded one did. `frames` gives the frames, from the first that the job itself took;
/// `answers` are those of all devices, in order.
#[must_use]
pub fn bench(start: &JobStart, path: &Path, frames: RecordedFrames, answers: Vec<Answer>) -> Bench {
    let path: PathBuf = path.to_owned();
    let operator = ReplayedOperator::new(&answers);
    let answers = answers.into_iter().filter(|answer| ![CAMERA, OPERATOR].contains(&answer.device.as_str())).collect();
    let tape = Arc::new(Tape::new(start, answers));
    let stage = |axis| Arc::new(ReplayedStage::new(axis, Arc::clone(&tape), &path));
    Bench {
        focus: stage(AxisName::Focus),
        e: stage(AxisName::E),
        camera: Arc::new(ReplayedCamera::new(start, frames)),
        simulated: Some(Arc::new(operator)),
    }
}

/// The error that an answer has, as its device gave it.
fn error_of(answer: &Answer) -> Option<DeviceError> {
    let text = answer.error_json.as_ref()?;
    Some(serde_json::from_str(text).unwrap_or_else(|_| DeviceError::Protocol {
        device: NAME.to_owned(),
        detail: format!("a recorded error is not known to this version of the program: {text}"),
    }))
}
