//! The frames of a recording, read as they are asked for: no more of them are in memory than one.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use async_trait::async_trait;
use prost::Message as _;
use tokio::sync::watch;
use tokio::time::Instant;

use crate::device::{AxisPose, CameraState, DeviceError, Frame, FrameSource};
use crate::record::foxglove::RawImage;
use crate::record::messages::{Answer, FrameInfo, JobStart};
use crate::record::{Ending, Item, ReadError, Reader, Topic, raw_image, time};
use plenoptics::units::Millimetres;

/// Why a recording gives no frame where the recorded job went on without one.
pub const EXHAUSTED: &str = "it has no further frame";
/// What the camera is called in recorded answers.
pub(super) const CAMERA: &str = "camera";

/// The frames of a recording, one after another: of one of this program with time and pose, of another's without.
pub struct RecordedFrames {
    reader: Reader,
    /// When the recording began, on this machine's clock: so long ago that all of it is past.
    begun: Instant,
    info: Option<(u32, FrameInfo)>,
    count: u64,
}

impl RecordedFrames {
    /// Opens a recording, which lasted no longer than `lasted`.
    ///
    /// # Errors
    /// [`ReadError`].
    pub fn open(path: &Path, lasted: Duration) -> Result<Self, ReadError> {
        let now = Instant::now();
        let begun = now.checked_sub(lasted).unwrap_or(now);
        Ok(Self { reader: Reader::open(path)?, begun, info: None, count: 0 })
    }

    /// Why no more came, where the file was cut.
    #[must_use]
    pub fn cut(&self) -> Option<&str> {
        match self.reader.ending() {
            Some(Ending::Cut(why)) => Some(why),
            _ => None,
        }
    }

    /// The next frame; the error says in words why a frame cannot be read.
    pub fn next_frame(&mut self) -> Option<Result<Frame, String>> {
        loop {
            match self.next_shot()? {
                Shot::Frame(frame) => return Some(frame),
                Shot::None(_) => {}
            }
        }
    }

    /// The next that came of asking the camera for a frame.
    fn next_shot(&mut self) -> Option<Shot> {
        loop {
            let Item::Message { topic, schema, sequence, data } = self.reader.next()? else { continue };
            if topic == Topic::ANSWER.name && schema == Topic::ANSWER.schema {
                let answer = Answer::decode(&*data).ok().filter(|answer| answer.device == CAMERA);
                if let Some(error) = answer.as_ref().and_then(super::error_of) {
                    return Some(Shot::None(error));
                }
            }
            if topic == Topic::FRAME.name && schema == Topic::FRAME.schema {
                match FrameInfo::decode(&*data) {
                    Ok(info) => self.info = Some((sequence, info)),
                    Err(error) => return Some(Shot::Frame(Err(format!("frame {sequence} cannot be read: {error}")))),
                }
            } else if schema == Topic::RAW.schema {
                return Some(Shot::Frame(self.frame(sequence, &data)));
            }
        }
    }

    fn frame(&mut self, sequence: u32, data: &[u8]) -> Result<Frame, String> {
        self.count += 1;
        let info = self.info.take().filter(|(number, _)| *number == sequence).map(|(_, info)| info);
        let told = |why: String| format!("frame {} cannot be read: {why}", self.count);
        let message = RawImage::decode(data).map_err(|error| told(error.to_string()))?;
        let image = raw_image(&message, info.as_ref().map(|info| info.bits)).map_err(told)?;
        let known = info.unwrap_or_default();
        let at = |ns: i64| {
            let offset = Duration::from_nanos(ns.unsigned_abs());
            if ns < 0 { self.begun.checked_sub(offset).unwrap_or(self.begun) } else { self.begun + offset }
        };
        let pose = |position: Option<f64>, settled| AxisPose { position: position.map(Millimetres), settled };
        Ok(Frame {
            image: Arc::new(image),
            seq: info.as_ref().map_or(self.count, |info| info.seq),
            exposed_from: at(known.exposed_from_ns),
            exposed_to: at(known.exposed_to_ns),
            exposure_assumed: info.is_none() || known.exposure_assumed,
            captured_at: time(message.timestamp.as_ref()),
            focus: pose(known.focus_mm, known.focus_settled),
            e: pose(known.e_mm, known.e_settled),
            preview: false,
            simulated: known.simulated,
            replayed: true,
        })
    }
}

/// What came of asking a camera for a frame.
enum Shot {
    /// A frame; the error says in words why it cannot be read.
    Frame(Result<Frame, String>),
    /// None.
    None(DeviceError),
}

/// A camera that gives a recording's frames to whoever measures.
pub(super) struct ReplayedCamera {
    state: watch::Receiver<CameraState>,
    live: watch::Receiver<Option<Arc<Frame>>>,
    frames: Arc<Mutex<RecordedFrames>>,
}

impl ReplayedCamera {
    pub(super) fn new(start: &JobStart, frames: RecordedFrames) -> Self {
        let state = CameraState {
            identity: "REPLAY".to_owned(),
            online: true,
            fault: None,
            replay: true,
            unfit: start.camera_unfit.clone(),
            ..CameraState::not_yet("replayed", "")
        };
        Self { state: watch::channel(state).1, live: watch::channel(None).1, frames: Arc::new(Mutex::new(frames)) }
    }
}

#[async_trait]
impl FrameSource for ReplayedCamera {
    fn state(&self) -> watch::Receiver<CameraState> {
        self.state.clone()
    }

    fn live(&self) -> watch::Receiver<Option<Arc<Frame>>> {
        self.live.clone()
    }

    fn newest(&self) -> Option<Arc<Frame>> {
        None
    }

    async fn frame(&self, _: Instant) -> Result<Arc<Frame>, DeviceError> {
        let frames = Arc::clone(&self.frames);
        let next =
            tokio::task::spawn_blocking(move || frames.lock().unwrap_or_else(PoisonError::into_inner).next_shot());
        let protocol = |detail| DeviceError::Protocol { device: super::NAME.to_owned(), detail };
        match next.await.map_err(|error| protocol(error.to_string()))? {
            Some(Shot::Frame(frame)) => frame.map(Arc::new).map_err(protocol),
            Some(Shot::None(error)) => Err(error),
            None => Err(DeviceError::Disconnected { device: super::NAME.to_owned(), reason: EXHAUSTED.to_owned() }),
        }
    }
}
