//! A recording's own thread: from entries to a file. Whoever hands entries over never waits for the disk.

use std::collections::BTreeMap;
use std::fs::DirBuilder;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, OnceLock};

use jiff::Timestamp;
use tokio::time::Instant;

use super::{Happening, Sink, words};
use bench::config::{Config, RecordConfig};
use bench::device::Frame;
use bench::record::foxglove::CompressedImage;
use bench::record::messages::{JobStart, MeterReading};
use bench::record::{Limits, Topic, WriteError, Writer, raw_message, stamp};
use bench::telemetry::{self, ReaderKind};
use plenoptics::raw::Samples;

/// Entries that may wait for the disk.
const QUEUE: usize = 4096;
/// Of these, readings of the meter: they are left out, and counted, before the recording of the job suffers.
const READINGS: u64 = QUEUE as u64 / 4;
/// A folder made for recordings: their owner and their group may look into it.
const FOLDER_MODE: u32 = 0o750;
/// Bytes of frames that may wait for the disk; one frame may always.
const MOST_WAITING_BYTES: u64 = 256 << 20;

/// What is called once, on the recording's thread or its caller's, when it ends before its job.
type OnFailure = Box<dyn Fn(String) + Send + Sync>;

/// What the thread is told: an entry and when it was made, or to end the file and say how long it is.
enum Command {
    Happening(Happening, Timestamp),
    Finish(SyncSender<u64>),
}

/// A recording that is written to a file.
pub(crate) struct FileSink {
    queue: SyncSender<Command>,
    waiting: Arc<Waiting>,
    failed: Arc<Failed>,
}

/// What has been handed over and is not written yet.
#[derive(Default)]
struct Waiting {
    frame_bytes: AtomicU64,
    readings: AtomicU64,
    /// Readings left out since the begin.
    readings_left_out: AtomicU64,
}

impl Waiting {
    /// Whether there is room for another reading, which then says how many had to be left out before it.
    fn has_room_for(&self, reading: &mut MeterReading) -> bool {
        if self.readings.load(Ordering::SeqCst) >= READINGS {
            self.readings_left_out.fetch_add(1, Ordering::SeqCst);
            telemetry::reading_left_out(ReaderKind::Recording, 1);
            return false;
        }
        reading.readings_left_out = self.readings_left_out.load(Ordering::SeqCst);
        self.readings.fetch_add(1, Ordering::SeqCst);
        true
    }

    fn written(&self, happening: &Happening) {
        match happening {
            Happening::Frame(frame) => drop(self.frame_bytes.fetch_sub(frame_bytes(frame), Ordering::SeqCst)),
            Happening::Read(_) => drop(self.readings.fetch_sub(1, Ordering::SeqCst)),
            _ => {}
        }
    }
}

struct Failed {
    why: OnceLock<String>,
    tell: OnFailure,
}

impl Failed {
    /// The first reason counts.
    fn with(&self, why: String) {
        if self.why.set(why.clone()).is_ok() {
            tracing::warn!(%why, "a recording ended before its job");
            (self.tell)(why);
        }
    }
}

impl FileSink {
    /// Begins a recording. `tell` is called once if it ends before its job, with why.
    pub(crate) fn start(path: PathBuf, config: &Arc<Config>, tell: OnFailure) -> Self {
        let (queue, commands) = sync_channel(QUEUE);
        let waiting = Arc::<Waiting>::default();
        let failed = Arc::new(Failed { why: OnceLock::new(), tell });
        let (done, told, config) = (Arc::clone(&waiting), Arc::clone(&failed), Arc::clone(config));
        let begun = Instant::now();
        let work = move || {
            let mut scribe = Scribe { path, config, begun, writer: None, sequences: BTreeMap::new(), frames: 0 };
            if let Err(why) = scribe.run(&commands, &done) {
                told.with(why);
            }
        };
        if let Err(error) = std::thread::Builder::new().name("recording".to_owned()).spawn(work) {
            failed.with(format!("its thread does not start: {error}"));
        }
        Self { queue, waiting, failed }
    }

    fn send(&self, command: Command) {
        if self.failed.why.get().is_some() {
            return;
        }
        match self.queue.try_send(command) {
            Ok(()) | Err(TrySendError::Disconnected(_)) => {}
            Err(TrySendError::Full(_)) => self.failed.with(too_slow()),
        }
    }

    /// Ends the file after everything taken so far. The answer is how long it is; it never comes where the recording
    /// has failed.
    pub(crate) fn finish(&self) -> Receiver<u64> {
        let (answer, answered) = sync_channel(1);
        self.send(Command::Finish(answer));
        answered
    }
}

fn too_slow() -> String {
    format!("the disk is too slow: {} MB of frames waited for it", MOST_WAITING_BYTES >> 20)
}

impl Sink for FileSink {
    fn take(&self, mut happening: Happening) {
        if let Happening::Read(reading) = &mut happening
            && !self.waiting.has_room_for(reading)
        {
            return;
        }
        if let Happening::Frame(frame) = &happening {
            let (before, bytes) = (self.waiting.frame_bytes.load(Ordering::SeqCst), frame_bytes(frame));
            if before > 0 && before + bytes > MOST_WAITING_BYTES {
                return self.failed.with(too_slow());
            }
            self.waiting.frame_bytes.fetch_add(bytes, Ordering::SeqCst);
        }
        self.send(Command::Happening(happening, Timestamp::now()));
    }
}

fn frame_bytes(frame: &Frame) -> u64 {
    let bytes = match frame.image.samples() {
        Samples::U8(samples) => samples.len(),
        Samples::U16(samples) => 2 * samples.len(),
    };
    bytes as u64
}

/// The thread's side.
struct Scribe {
    path: PathBuf,
    config: Arc<Config>,
    begun: Instant,
    writer: Option<Writer>,
    /// Messages so far of each topic.
    sequences: BTreeMap<&'static str, u32>,
    frames: u32,
}

impl Scribe {
    fn run(&mut self, commands: &Receiver<Command>, waiting: &Waiting) -> Result<(), String> {
        for command in commands {
            match command {
                Command::Happening(happening, at) => {
                    let done = self.put(&happening, at).map_err(|error| error.to_string());
                    waiting.written(&happening);
                    if let Err(why) = done {
                        // What it has can be read with an index where there is still room for one.
                        let _ = self.writer.take().map(Writer::finish);
                        return Err(why);
                    }
                }
                Command::Finish(answer) => {
                    let Some(writer) = self.writer.take() else { return Ok(()) };
                    let bytes = writer.finish().map_err(|error| error.to_string())?;
                    // The job may have ended without waiting.
                    let _ = answer.send(bytes);
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    fn put(&mut self, happening: &Happening, at: Timestamp) -> Result<(), WriteError> {
        match happening {
            Happening::Start(start) => {
                self.writer = Some(self.create(start)?);
                self.message(Topic::START, at, &**start)?;
                self.flush()
            }
            Happening::Frame(frame) => {
                self.frames += 1;
                let info = words::frame(frame, self.begun);
                self.numbered(Topic::FRAME, self.frames, at, &info)?;
                let image = raw_message(&frame.image, frame.captured_at, self.config.sensor.mosaic);
                self.numbered(Topic::RAW, self.frames, at, &image)?;
                for transform in words::transforms(frame.captured_at, info.focus_mm, info.e_mm) {
                    self.message(Topic::TRANSFORM, at, &transform)?;
                }
                words::pose(frame.captured_at, info.e_mm).map_or(Ok(()), |pose| self.message(Topic::POSE, at, &pose))
            }
            Happening::Answer(answer) => self.message(Topic::ANSWER, at, &words::answer(answer, at)),
            Happening::Again { step, again } => self.message(Topic::ANSWER, at, &words::again(*step, *again, at)),
            Happening::Measured(view, map) => {
                self.message(Topic::MEASUREMENT, at, &words::measurement(view))?;
                self.message(Topic::ANNOTATIONS, at, &words::annotations(view, map.as_deref()))
            }
            Happening::Read(reading) => self.message(Topic::READING, at, &**reading),
            Happening::Decided(iteration) => {
                self.message(Topic::DECISION, at, &words::decision(iteration))?;
                self.flush()
            }
            Happening::Logged(line) => self.message(Topic::LOG, at, &words::line(line)),
            Happening::Picture(jpeg) => {
                let picture = CompressedImage {
                    timestamp: Some(stamp(at)),
                    frame_id: "camera".to_owned(),
                    data: jpeg.to_vec().into(),
                    format: "jpeg".to_owned(),
                };
                self.message(Topic::VIEW, at, &picture)
            }
            Happening::End(end) => self.message(Topic::END, at, &words::end(end, at)),
        }
    }

    fn create(&self, start: &JobStart) -> Result<Writer, WriteError> {
        let RecordConfig { max_file_mb, keep_free_mb, .. } = self.config.record;
        let limits = Limits { max_bytes: u64::from(max_file_mb) << 20, keep_free_bytes: u64::from(keep_free_mb) << 20 };
        if let Some(folder) = self.path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            DirBuilder::new()
                .recursive(true)
                .mode(FOLDER_MODE)
                .create(folder)
                .map_err(|source| WriteError::Disk { path: folder.to_owned(), source })?;
        }
        let seed = self.config.bench.simulation.seed.to_string();
        let metadata = [
            ("version", start.version.as_str()),
            ("job", start.job_id.as_str()),
            ("simulated", if start.simulated { "true" } else { "false" }),
            ("bench", if start.simulated { "SIMULATED" } else { "hardware" }),
            ("seed", if start.simulated { seed.as_str() } else { "" }),
            ("design_origin", start.design_origin.as_str()),
            ("configuration", start.configuration_toml.as_str()),
            ("request", start.request_json.as_str()),
        ];
        let metadata = metadata.map(|(name, value)| (name.to_owned(), value.to_owned())).into();
        Writer::create(&self.path, limits, metadata)
    }

    fn message(&mut self, topic: Topic, at: Timestamp, message: &impl prost::Message) -> Result<(), WriteError> {
        let number = self.sequences.entry(topic.name).or_default();
        *number += 1;
        let number = *number;
        self.numbered(topic, number, at, message)
    }

    fn numbered(
        &mut self,
        topic: Topic,
        number: u32,
        at: Timestamp,
        message: &impl prost::Message,
    ) -> Result<(), WriteError> {
        // Nothing is taken before the start.
        self.writer.as_mut().map_or(Ok(()), |writer| writer.write(topic, number, at, message))
    }

    fn flush(&mut self) -> Result<(), WriteError> {
        self.writer.as_mut().map_or(Ok(()), Writer::flush)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::time::Duration;

    use nix::sys::stat::Mode;
    use nix::unistd::mkfifo;

    use super::*;
    use crate::job::LogLine;
    use bench::device::AxisPose;
    use plenoptics::raw::RawImage;

    /// A recording on a disk that takes nothing (a pipe that nobody reads), and what is said of its failure.
    fn hanging(folder: &tempfile::TempDir) -> (FileSink, Arc<Mutex<Vec<String>>>) {
        let pipe = folder.path().join("pipe.mcap");
        mkfifo(&pipe, Mode::S_IRWXU).unwrap();
        let told = Arc::new(Mutex::new(Vec::new()));
        let hear = Arc::clone(&told);
        let tell = move |why| hear.lock().unwrap().push(why);
        let sink = FileSink::start(pipe, &Arc::new(Config::default()), Box::new(tell));
        sink.take(Happening::Start(Box::default()));
        (sink, told)
    }

    #[test]
    fn a_disk_that_hangs_ends_the_recording_and_holds_nobody_up() {
        let folder = tempfile::tempdir().unwrap();
        let (sink, told) = hanging(&folder);
        let (now, unknown) = (Instant::now(), AxisPose { position: None, settled: false });
        let frame = Arc::new(Frame {
            image: Arc::new(RawImage::from_u8(8192, 8192, vec![0; 8192 * 8192])),
            seq: 1,
            exposed_from: now,
            exposed_to: now,
            exposure_assumed: true,
            captured_at: Timestamp::now(),
            focus: unknown,
            e: unknown,
            preview: false,
            simulated: true,
            replayed: false,
        });
        let begun = std::time::Instant::now();
        for taken in 0..8 {
            assert_eq!(told.lock().unwrap().len(), usize::from(taken > 4), "{taken} frames of 64 MB");
            sink.take(Happening::Frame(Arc::clone(&frame)));
        }
        assert!(begun.elapsed() < Duration::from_secs(2), "{:?}", begun.elapsed());
        let told = told.lock().unwrap().clone();
        assert!(told.len() == 1 && told[0].contains("too slow"), "{told:?}");
        assert!(sink.finish().recv().is_err(), "it has failed already");
    }

    #[test]
    fn readings_that_a_slow_disk_has_no_room_for_are_left_out_and_counted() {
        const TOO_MANY: u64 = 7;
        let folder = tempfile::tempdir().unwrap();
        let (sink, told) = hanging(&folder);
        let reading = || Box::new(MeterReading::default());
        (0..READINGS + TOO_MANY).for_each(|_| sink.take(Happening::Read(reading())));
        assert_eq!(sink.waiting.readings.load(Ordering::SeqCst), READINGS);
        // What the job itself does still finds room.
        for _ in 0..QUEUE as u64 / 2 {
            sink.take(Happening::Logged(LogLine { at: Timestamp::now(), message: "it goes on".to_owned() }));
        }
        assert_eq!(*told.lock().unwrap(), Vec::<String>::new());
        // The next one that there is room for says how many there were before it.
        let mut next = reading();
        assert!(!sink.waiting.has_room_for(&mut next));
        sink.waiting.written(&Happening::Read(reading()));
        assert!(sink.waiting.has_room_for(&mut next));
        assert_eq!(next.readings_left_out, TOO_MANY + 1);
    }
}
