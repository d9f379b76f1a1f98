//! Recordings: a job recorded, read back, replayed, changed, cut, and the disk that takes none.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use plenalign::config::{CameraConfig, Config};
use plenalign::control::job::{JobKind, JobRequest, JobSnapshot, JobState, RecordingState};
use plenalign::control::replay::{Replay, What, replay};
use plenalign::control::{Service, open_bench};
use plenalign::device::camera::files::FilesCamera;
use plenalign::device::{CameraState, FrameSource as _};
use plenalign::record::foxglove::RawImage;
use plenalign::record::messages::{Decision, FrameInfo, JobStart, MeterReading};
use plenalign::record::{Ending, Item, Limits, Reader, Topic, Writer, raw_image};
use plenalign::store::Store;
use prost::Message as _;
use serde_json::{Value, json};

use super::bench::{QUICK_AXES, permit, quick_axes, run, small_config};
use super::program::{Program, plenalign, serve};
use super::until::until;

/// A service whose state, and with it its recordings, is in a folder. What the meter reads of each live picture is
/// recorded, too: on a clock that runs ahead there are no more of them than are of use.
async fn service(mut config: Config, state: &Path) -> Arc<Service> {
    config.bench.simulation.preview_rate_hz = 0.01;
    let config = Arc::new(config);
    let bench = open_bench(&config).await.unwrap();
    Service::start(config, "a test's configuration".to_owned(), bench, Store::open(state))
}

fn recorded(kind: JobKind) -> JobRequest {
    JobRequest { record: Some(true), ..JobRequest::of(kind) }
}

fn file_of(service: &Service, job: &JobSnapshot) -> PathBuf {
    let recording = job.recording.as_ref().expect("it was to be recorded");
    assert_eq!((recording.state, &recording.fault), (RecordingState::Complete, &None), "{:#?}", job.log);
    let file = service.recording_file(recording).unwrap();
    assert_eq!(file.metadata().unwrap().len(), recording.bytes.unwrap());
    file
}

fn messages<T: prost::Message + Default>(file: &Path, topic: Topic) -> Vec<T> {
    let of_topic = |item| match item {
        Item::Message { topic: name, schema, data, .. } if name == topic.name => {
            assert_eq!(schema, topic.schema);
            Some(T::decode(&*data).unwrap())
        }
        _ => None,
    };
    Reader::open(file).unwrap().filter_map(of_topic).collect()
}

/// Writes a recording anew with some of its frames changed.
fn changed(file: &Path, to: &Path, change: impl Fn(u32, &mut RawImage)) {
    let mut reader = Reader::open(file).unwrap();
    let mut writer: Option<Writer> = None;
    let limits = Limits { max_bytes: u64::MAX, keep_free_bytes: 0 };
    for item in reader.by_ref() {
        match item {
            Item::Metadata { values, .. } => writer = Some(Writer::create(to, limits, values).unwrap()),
            Item::Message { topic, sequence, data, .. } => {
                let topic = plenalign::record::topic(&topic).unwrap();
                let writer = writer.as_mut().expect("the metadata comes first");
                let at = jiff::Timestamp::now();
                if topic == Topic::RAW {
                    let mut frame = RawImage::decode(&*data).unwrap();
                    change(sequence, &mut frame);
                    writer.write(topic, sequence, at, &frame).unwrap();
                } else {
                    writer.write(topic, sequence, at, &Raw(data)).unwrap();
                }
            }
        }
    }
    assert_eq!(reader.ending(), Some(&Ending::Whole));
    writer.unwrap().finish().unwrap();
}

/// A message that is encoded already.
#[derive(Debug, Default)]
struct Raw(Vec<u8>);

impl prost::Message for Raw {
    fn encode_raw(&self, buffer: &mut impl prost::bytes::BufMut) {
        buffer.put_slice(&self.0);
    }
    fn merge_field(
        &mut self,
        _: u32,
        _: prost::encoding::WireType,
        _: &mut impl prost::bytes::Buf,
        _: prost::encoding::DecodeContext,
    ) -> Result<(), prost::DecodeError> {
        Ok(())
    }
    fn encoded_len(&self) -> usize {
        self.0.len()
    }
    fn clear(&mut self) {
        self.0.clear();
    }
}

fn identical(replayed: &Replay) {
    assert!(replayed.identical, "{:#?}\n{:#?}", replayed.differences, replayed.replayed_end);
    assert!(replayed.steps.iter().all(|step| step.same && step.recorded_px == step.replayed_px));
}

#[tokio::test(start_paused = true)]
async fn an_alignment_is_recorded_and_replayed_to_the_last_bit() {
    let state = tempfile::tempdir().unwrap();
    let mut config = small_config(41);
    quick_axes(&mut config.bench);
    config.server.names = vec!["secret.example".to_owned()];
    let service = service(config, state.path()).await;
    let job = run(&service, recorded(JobKind::JointAlignment)).await;
    assert_eq!(job.state, JobState::Converged, "{:?}", job.reason);
    let file = file_of(&service, &job);
    let name = file.file_name().unwrap().to_str().unwrap();
    assert!(name.starts_with("SIMULATED-") && name.ends_with(".mcap") && name.contains(&job.id.to_string()), "{name}");
    service.shut_down().await;

    let start = &messages::<JobStart>(&file, Topic::START)[0];
    assert!(start.simulated && start.job_id == job.id.to_string());
    assert!(!start.configuration_toml.contains("secret.example") && start.configuration_toml.contains("seed = 41"));
    let decisions: Vec<Decision> = messages(&file, Topic::DECISION);
    assert_eq!(decisions.len(), job.iterations.len());
    let last = decisions.last().unwrap().spacing.unwrap();
    assert_eq!(last.spacing_px, job.iterations.last().unwrap().spacing.spacing_px);
    let (infos, frames): (Vec<FrameInfo>, Vec<RawImage>) = (messages(&file, Topic::FRAME), messages(&file, Topic::RAW));
    assert!(infos.len() == frames.len() && frames.len() >= decisions.len(), "{} frames", frames.len());
    assert!(frames.iter().all(|frame| (frame.width, frame.height) == (560, 560)));

    // The meter's readings, in the order of their frames, some of which the job measured in whole.
    let readings: Vec<MeterReading> = messages(&file, Topic::READING);
    assert!(readings.is_sorted_by(|one, next| one.frame_seq < next.frame_seq), "{readings:#?}");
    let info_of = |seq| infos.iter().find(move |info: &&FrameInfo| info.seq == seq);
    let both: Vec<_> = readings.iter().filter_map(|read| Some((read, info_of(read.frame_seq)?))).collect();
    assert!(both.iter().any(|(reading, _)| reading.state == "measured"), "{readings:#?}");
    for (reading, info) in both {
        let took_ns = info.exposed_to_ns - info.exposed_from_ns;
        assert_eq!((&reading.timestamp, reading.exposure_us as i64), (&info.timestamp, took_ns / 1000));
        assert_eq!((reading.focus_mm, reading.e_mm), (info.focus_mm, info.e_mm));
        assert_eq!(reading.state == "measured", reading.spacing.is_some());
    }

    let replayed = replay(&file).await.unwrap();
    identical(&replayed);
    assert_eq!((replayed.job, replayed.kind, &replayed.cut), (job.id, JobKind::JointAlignment, &None));
    let count = |what| replayed.steps.iter().filter(|step| step.what == what).count();
    assert_eq!(count(What::Decision), job.iterations.len());
    assert!(count(What::Measurement) >= job.iterations.len());
    assert_eq!(replayed.replayed_end.reason, job.reason.unwrap());

    // One pixel in fifty of one frame half as bright: the difference is found where that frame was measured.
    let other = state.path().join("changed.mcap");
    let index = frames.len() as u32 / 2;
    changed(&file, &other, |number, frame| {
        if number == index {
            let mut data = frame.data.to_vec();
            data.iter_mut().step_by(50).for_each(|sample| *sample /= 2);
            frame.data = data.into();
        }
    });
    let differing = replay(&other).await.unwrap();
    assert!(!differing.identical && differing.steps[0].same, "{:#?}", differing.steps);
    let first = &differing.differences[0];
    assert!(first.at.starts_with("measurement"), "{first:?}");

    // The `files` camera plays it, and says that it is a replay.
    plays(&file, &frames).await;

    // Cut in the middle, as by a power cut: up to there all is the same, and it is said that it was cut.
    let bytes = std::fs::read(&file).unwrap();
    std::fs::write(&other, &bytes[..bytes.len() * 6 / 10]).unwrap();
    let cut = replay(&other).await.unwrap();
    identical(&cut);
    assert!(cut.cut.is_some() && cut.recorded_end.is_none() && cut.notes[0].contains("cut"), "{:?}", cut.notes);
    assert!(!cut.steps.is_empty() && cut.steps.len() < replayed.steps.len());
}

/// The frames of a recording in a folder, played one after another.
async fn plays(file: &Path, frames: &[RawImage]) {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(file, folder.path().join("run.mcap")).unwrap();
    let files = folder.path().display().to_string();
    let config = CameraConfig { files, repeat: false, frame_rate_hz: 1.0, ..CameraConfig::default() };
    let camera = FilesCamera::start(&config, (560, 560));
    let mut live = camera.live();
    for recorded in frames {
        live.changed().await.unwrap();
        let frame = live.borrow_and_update().clone().expect("a frame");
        assert_eq!(&*frame.image, &raw_image(recorded, Some(8)).unwrap());
        assert!(frame.replayed && !frame.focus.settled && frame.focus.position.is_none());
    }
    let mut state = camera.state();
    let ended = state.wait_for(|state| !state.online).await.unwrap().clone();
    assert!(ended.fault.unwrap().contains("have been played"));

    let other = FilesCamera::start(&CameraConfig { repeat: true, ..config }, (400, 400));
    let mut state = other.state();
    let has =
        |word: &'static str| move |state: &CameraState| state.fault.as_ref().is_some_and(|why| why.contains(word));
    state.wait_for(has("run.mcap has 560x560 pixels")).await.unwrap();
    std::fs::write(folder.path().join("run.mcap"), b"nothing").unwrap();
    state.wait_for(has("run.mcap is no MCAP file")).await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn what_an_earlier_job_left_is_recorded_with_the_job_that_goes_on_from_it() {
    let state = tempfile::tempdir().unwrap();
    let mut config = small_config(42);
    quick_axes(&mut config.bench);
    config.bench.simulation.bits = 12;
    let service = service(config, state.path()).await;
    let air = run(&service, JobRequest::of(JobKind::AirOnly)).await;
    assert_eq!((air.state, &air.recording), (JobState::Converged, &None), "{:?}", air.reason);
    let shell = run(&service, recorded(JobKind::ShellOnly)).await;
    assert_eq!(shell.state, JobState::Converged, "{:?}", shell.reason);
    let watch = JobRequest { duration_s: Some(600.0), interval_s: Some(120.0), ..recorded(JobKind::SpacingWatch) };
    let watch = run(&service, watch).await;
    assert_eq!(watch.state, JobState::Succeeded, "{:?}", watch.reason);
    let sweep = JobRequest {
        axis: Some(plenalign::device::AxisName::Focus),
        from_mm: Some(1.9),
        to_mm: Some(2.5),
        steps: Some(3),
        ..recorded(JobKind::FocusSweep)
    };
    let sweep = run(&service, sweep).await;
    assert_eq!(sweep.state, JobState::Succeeded, "{:?}", sweep.reason);
    let l_bound = run(&service, recorded(JobKind::LBoundMeasurement)).await;
    assert_eq!(l_bound.state, JobState::Succeeded, "{:?}", l_bound.reason);
    for job in [&shell, &watch, &sweep, &l_bound] {
        let replayed = replay(&file_of(&service, job)).await.unwrap();
        identical(&replayed);
        let decisions = replayed.steps.iter().filter(|step| step.what == What::Decision).count();
        assert_eq!((replayed.kind, decisions), (job.kind, job.iterations.len()));
    }
    service.shut_down().await;
}

#[tokio::test(start_paused = true)]
async fn a_failed_and_a_cancelled_job_are_replayed_as_far_as_they_came() {
    let state = tempfile::tempdir().unwrap();
    let mut config = small_config(43);
    quick_axes(&mut config.bench);
    config.bench.simulation.operator_confirms = false;
    let service = service(config, state.path()).await;
    let early = run(&service, recorded(JobKind::ShellOnly)).await;
    assert_eq!(early.state, JobState::Failed);
    identical(&replay(&file_of(&service, &early)).await.unwrap());

    let id = service.create_job(&permit(&service), recorded(JobKind::AirOnly)).await.unwrap().id;
    let state = || service.job(id).unwrap().state;
    until("the job asks", async || state() == JobState::WaitingForOperator).await;
    service.cancel(id, None).unwrap();
    until("the job ends", async || state().is_final()).await;
    let replayed = replay(&file_of(&service, &service.job(id).unwrap())).await.unwrap();
    identical(&replayed);
    assert!(replayed.notes[0].contains("cancelled"), "{:?}", replayed.notes);
    service.shut_down().await;
}

#[tokio::test(start_paused = true)]
async fn a_disk_without_room_ends_the_recording_and_not_the_job() {
    let state = tempfile::tempdir().unwrap();
    let kind = JobRequest { duration_s: Some(6.0), ..recorded(JobKind::SpacingWatch) };
    for (change, word) in [
        (
            Box::new(|config: &mut Config| config.record.keep_free_mb = u32::MAX) as Box<dyn Fn(&mut Config)>,
            "keep_free_mb",
        ),
        (Box::new(|config: &mut Config| config.record.max_file_mb = 1), "max_file_mb"),
        (Box::new(|config: &mut Config| config.record.folder = PathBuf::from("/proc/nowhere")), "/proc/nowhere"),
    ] {
        let mut config = small_config(44);
        quick_axes(&mut config.bench);
        change(&mut config);
        let service = service(config, state.path()).await;
        let job = run(&service, kind.clone()).await;
        assert_eq!(job.state, JobState::Succeeded, "{:?}", job.reason);
        let recording = job.recording.unwrap();
        assert_eq!(recording.state, RecordingState::Failed, "{word}");
        assert!(recording.fault.unwrap().contains(word), "{word}");
        assert!(job.log.iter().any(|line| line.message.contains("not recorded any further")), "{:#?}", job.log);
        service.shut_down().await;
    }
    // A device that is always full.
    let limits = Limits { max_bytes: u64::MAX, keep_free_bytes: 0 };
    let full = Writer::create(Path::new("/dev/full"), limits, [].into()).err().expect("nothing fits");
    assert!(full.to_string().contains("/dev/full") && full.to_string().contains("No space"), "{full}");
}

#[test]
fn what_is_no_recording_is_refused_with_the_reason() {
    let state = tempfile::tempdir().unwrap();
    let replayed = |file: &Path| plenalign(state.path()).arg("replay").arg(file).output().unwrap();
    let there = state.path().join("some.mcap");
    for (content, word) in
        [(None, "No such file"), (Some(&b"no recording"[..]), "no MCAP file"), (Some(b""), "no MCAP")]
    {
        if let Some(content) = content {
            std::fs::write(&there, content).unwrap();
        }
        let refused = replayed(&there);
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{said}");
        assert!(said.contains(word) && said.lines().count() == 1, "{said}");
    }
    // An MCAP file of somebody else's.
    std::fs::remove_file(&there).unwrap();
    let limits = Limits { max_bytes: u64::MAX, keep_free_bytes: 0 };
    Writer::create(&there, limits, [].into()).unwrap().finish().unwrap();
    let refused = replayed(&there);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("holds no job of plenalign's"));
    // What is there is not overwritten.
    let taken = Writer::create(&there, limits, [].into()).err().expect("it is there");
    assert!(taken.to_string().contains("there already"), "{taken}");
}

/// The program itself: recorded by a daemon, downloaded, replayed; and recorded in process.
#[test]
fn the_program_records_gives_away_and_replays() {
    let state = tempfile::tempdir().unwrap();
    std::fs::write(
        state.path().join("bench.toml"),
        format!("[sensor]\nwidth_px = 560\nheight_px = 560\n[bench.simulation]\nrays = 16\n{QUICK_AXES}"),
    )
    .unwrap();
    let daemon = Program::start(serve(state.path(), &[]));
    let file = state.path().join("alignment.mcap");
    let aligned = |arguments: &[&str]| {
        let output = plenalign(state.path()).arg("align").args(arguments).arg("--json").output().unwrap();
        let said = [output.stderr, output.stdout].concat();
        (output.status.success(), String::from_utf8_lossy(&said).into_owned())
    };
    let (ended, said) = aligned(&["--server", daemon.url(), "--record", file.to_str().unwrap()]);
    assert!(ended, "{said}");
    let (again, said) = aligned(&["--server", daemon.url(), "--record", file.to_str().unwrap()]);
    assert!(!again && said.contains("there already"), "{said}");
    let run = || plenalign(state.path()).args(["replay", "--json"]).arg(&file).output().unwrap();
    let replayed = run();
    let said: Value = serde_json::from_slice(&replayed.stdout)
        .unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&replayed.stderr)));
    assert_eq!((replayed.status.code(), &said["identical"]), (Some(0), &json!(true)), "{said}");
    let text = plenalign(state.path()).arg("replay").arg(&file).output().unwrap();
    let text = String::from_utf8_lossy(&text.stdout).into_owned();
    assert!(text.contains("SIMULATED") && text.ends_with("identical\n"), "{text}");
    daemon.kill();
}
