//! Recorded frames, played from files, or from recordings: for whoever has frames and no camera. Never taken for live: every frame and the
//! state say that it is a replay, no frame has a pose, and none is given to a measurement that drives axes.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use async_trait::async_trait;
use tokio::sync::watch;
use tokio::time::{Instant, Interval, MissedTickBehavior};
use tokio_util::sync::{CancellationToken, DropGuard};

use crate::config::CameraConfig;
use crate::device::replayed::RecordedFrames;
use crate::device::{AxisPose, CameraState, DeviceError, Frame, FrameSource};
use crate::record;
use plenoptics::raw::{self, RawImage};

/// Names of files that hold raw frames end like this.
const ENDINGS: [&str; 6] = ["png", "tif", "tiff", "pgm", "pnm", record::ENDING];
/// So many refused files are named; the others are counted.
const NAMED: usize = 3;
/// Why no job is given a frame.
const UNFIT: &str = "recorded frames say nothing of where the axes are now: they can be viewed, and measured one by one with \
                     `plenalign measure`, but no axis is driven by them";
/// Without a file that can be played, the folder is looked at again this often.
const LOOK_AGAIN: Duration = Duration::from_secs(2);

/// Frames played from files.
pub struct FilesCamera {
    state: watch::Receiver<CameraState>,
    live: watch::Receiver<Option<Arc<Frame>>>,
    files: String,
    /// Ends the player with the camera.
    _player: DropGuard,
}

struct Player {
    config: CameraConfig,
    size: (usize, usize),
    state: watch::Sender<CameraState>,
    live: watch::Sender<Option<Arc<Frame>>>,
    seq: u64,
}

impl FilesCamera {
    /// Plays the configured files, frames of `size` (columns and rows). Must be called within a tokio runtime. Files
    /// that are missing or of another size are no error here: the state names them.
    #[must_use]
    pub fn start(config: &CameraConfig, size: (usize, usize)) -> Self {
        let (state, state_out) = watch::channel(CameraState {
            identity: format!("REPLAY of {}", config.files),
            replay: true,
            unfit: Some(UNFIT.to_owned()),
            ..CameraState::not_yet("files", "no file has been played yet")
        });
        let (live, live_out) = watch::channel(None);
        let player = Player { config: config.clone(), size, state, live, seq: 0 };
        let end = CancellationToken::new();
        tokio::spawn(end.clone().run_until_cancelled_owned(player.play()));
        Self { state: state_out, live: live_out, files: config.files.clone(), _player: end.drop_guard() }
    }
}

fn is_recording(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(record::ENDING))
}

/// The files that `files` means, a folder or a pattern, in the order of their names.
///
/// # Errors
/// Why there are none, in words.
pub fn matching(files: &str) -> Result<Vec<PathBuf>, String> {
    let is_raw = |path: &PathBuf| {
        let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase);
        ending.is_some_and(|ending| ENDINGS.contains(&ending.as_str()))
    };
    let mut found: Vec<PathBuf> = if Path::new(files).is_dir() {
        let entries =
            std::fs::read_dir(files).map_err(|error| format!("the folder {files} cannot be read: {error}"))?;
        entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_raw).collect()
    } else {
        let paths = glob::glob(files).map_err(|error| format!("{files:?} is no pattern of file names: {error}"))?;
        paths.filter_map(Result::ok).filter(|path| path.is_file()).collect()
    };
    found.sort();
    if found.is_empty() {
        return Err(format!(
            "there is no frame at {files}: a folder with .png, .tif, .pgm or .mcap files, or a pattern of names"
        ));
    }
    Ok(found)
}

impl Player {
    async fn play(mut self) {
        loop {
            let pattern = self.config.files.clone();
            let listed = tokio::task::spawn_blocking(move || matching(&pattern)).await;
            match listed.unwrap_or_else(|error| Err(error.to_string())) {
                Ok(paths) => {
                    let played = self.play_once(&paths).await;
                    if played > 0 && !self.config.repeat {
                        self.go_offline(format!(
                            "all {played} frames have been played; repeat = true plays them again"
                        ));
                        return std::future::pending().await;
                    }
                    if played > 0 {
                        continue;
                    }
                }
                Err(why) => self.go_offline(why),
            }
            tokio::time::sleep(LOOK_AGAIN).await;
        }
    }

    /// Plays every file once and returns how many could be.
    async fn play_once(&mut self, paths: &[PathBuf]) -> usize {
        let rate = self.config.frame_rate_hz.clamp(0.01, 1000.0);
        let mut beat = tokio::time::interval(Duration::from_secs_f64(1.0 / rate));
        beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut refused: Vec<String> = Vec::new();
        let mut played = 0;
        for path in paths {
            if is_recording(path) {
                match self.play_recording(path, &mut beat, paths.len(), &refused).await {
                    Ok(frames) => played += frames,
                    Err(why) => refused.push(why),
                }
                continue;
            }
            beat.tick().await;
            match self.read(path.clone()).await {
                Ok(image) => {
                    played += 1;
                    self.show(image);
                    self.tell(paths.len(), &refused);
                }
                Err(why) => {
                    refused.push(why);
                    if played > 0 {
                        self.tell(paths.len(), &refused);
                    }
                }
            }
        }
        if played > 0 {
            // The last frame has its time, too.
            beat.tick().await;
            self.tell(paths.len(), &refused);
        } else {
            self.go_offline(format!("no file can be played: {}", listed(&refused)));
        }
        played
    }

    /// Plays the frames of a recording and returns how many; the error says why not all of it could be.
    async fn play_recording(
        &mut self,
        path: &Path,
        beat: &mut Interval,
        files: usize,
        refused: &[String],
    ) -> Result<usize, String> {
        let shown = path.display().to_string();
        let mut frames = RecordedFrames::open(path, Duration::ZERO).map_err(|error| error.to_string())?;
        let mut played = 0;
        loop {
            let (next, back) = tokio::task::spawn_blocking(move || (frames.next_frame(), frames))
                .await
                .map_err(|error| error.to_string())?;
            frames = back;
            let Some(frame) = next else { break };
            let image = frame.map_err(|why| format!("{shown}: {why}"))?.image;
            self.check_size(&shown, &image)?;
            beat.tick().await;
            self.show(image);
            self.tell(files, refused);
            played += 1;
        }
        match (played, frames.cut()) {
            (0, Some(why)) => Err(format!("{shown} was cut before its first frame: {why}")),
            (0, None) => Err(format!("{shown} holds no raw frame")),
            _ => Ok(played),
        }
    }

    fn check_size(&self, shown: &str, image: &RawImage) -> Result<(), String> {
        let (width, height) = self.size;
        if (image.width(), image.height()) == (width, height) {
            return Ok(());
        }
        Err(format!(
            "{shown} has {}x{} pixels, and sensor.width_px and height_px say {width}x{height}",
            image.width(),
            image.height()
        ))
    }

    async fn read(&self, path: PathBuf) -> Result<Arc<RawImage>, String> {
        let shown = path.display().to_string();
        let image = tokio::task::spawn_blocking(move || {
            raw::read(&path).map_err(|error| match std::error::Error::source(&error) {
                Some(cause) => format!("{error}: {cause}"),
                None => error.to_string(),
            })
        })
        .await
        .map_err(|error| error.to_string())??;
        self.check_size(&shown, &image)?;
        Ok(Arc::new(image))
    }

    fn show(&mut self, image: Arc<RawImage>) {
        self.seq += 1;
        let now = Instant::now();
        let unknown = AxisPose { position: None, settled: false };
        self.live.send_replace(Some(Arc::new(Frame {
            image,
            seq: self.seq,
            exposed_from: now,
            exposed_to: now,
            exposure_assumed: true,
            captured_at: jiff::Timestamp::now(),
            focus: unknown,
            e: unknown,
            preview: false,
            simulated: false,
            replayed: true,
        })));
    }

    fn tell(&self, files: usize, refused: &[String]) {
        let mut notes = vec![format!(
            "a replay of {files} file{}: recorded frames, whose time and pose are not known",
            if files == 1 { "" } else { "s" }
        )];
        if !refused.is_empty() {
            notes.push(format!("not played: {}", listed(refused)));
        }
        self.state.send_if_modified(|state| {
            let changed = !state.online || state.notes != notes;
            (state.online, state.fault, state.size) = (true, None, Some(self.size));
            state.notes = notes;
            changed
        });
    }

    fn go_offline(&self, fault: String) {
        self.live.send_replace(None);
        self.state.send_if_modified(|state| {
            let news = state.fault.as_ref() != Some(&fault);
            if news {
                tracing::warn!(files = %self.config.files, %fault, "no frames are played");
            }
            (state.online, state.fault) = (false, Some(fault));
            news
        });
    }
}

/// The first few of what was refused.
fn listed(refused: &[String]) -> String {
    let mut words = refused[..refused.len().min(NAMED)].join("; ");
    if refused.len() > NAMED {
        words.push_str(&format!("; and {} more", refused.len() - NAMED));
    }
    words
}

#[async_trait]
impl FrameSource for FilesCamera {
    fn state(&self) -> watch::Receiver<CameraState> {
        self.state.clone()
    }

    fn live(&self) -> watch::Receiver<Option<Arc<Frame>>> {
        self.live.clone()
    }

    fn newest(&self) -> Option<Arc<Frame>> {
        self.live.borrow().clone()
    }

    async fn frame(&self, _: Instant) -> Result<Arc<Frame>, DeviceError> {
        Err(DeviceError::Refused { device: format!("the replay of {}", self.files), reason: UNFIT.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PATIENCE: Duration = Duration::from_secs(20);

    fn write(folder: &Path, name: &str, level: u8, width: usize) {
        raw::write(&folder.join(name), &RawImage::from_u8(width, 3, vec![level; width * 3])).unwrap();
    }

    fn config(files: &str, repeat: bool) -> CameraConfig {
        CameraConfig { files: files.to_owned(), repeat, frame_rate_hz: 10.0, ..CameraConfig::default() }
    }

    async fn levels(camera: &FilesCamera, count: usize) -> Vec<u16> {
        let mut live = camera.live();
        let mut levels = Vec::new();
        while levels.len() < count {
            tokio::time::timeout(PATIENCE, live.changed()).await.unwrap().unwrap();
            let frame = live.borrow_and_update().clone();
            levels.extend(frame.map(|frame| frame.image.to_f32()[0] as u16));
        }
        levels
    }

    async fn until(camera: &FilesCamera, holds: impl Fn(&CameraState) -> bool) -> CameraState {
        let mut state = camera.state();
        let waited = tokio::time::timeout(PATIENCE, state.wait_for(holds)).await;
        waited.unwrap_or_else(|_| panic!("{:?}", camera.state().borrow())).unwrap().clone()
    }

    #[tokio::test(start_paused = true)]
    async fn files_are_played_in_order_again_and_again() {
        let folder = tempfile::tempdir().unwrap();
        for (name, level) in [("b.tiff", 20), ("a.png", 10), ("c.pgm", 30)] {
            write(folder.path(), name, level, 4);
        }
        std::fs::write(folder.path().join("notes.txt"), "no frame").unwrap();
        let begun = Instant::now();
        let camera = FilesCamera::start(&config(folder.path().to_str().unwrap(), true), (4, 3));
        assert_eq!(levels(&camera, 5).await, [10, 20, 30, 10, 20]);
        let took = begun.elapsed();
        assert!((Duration::from_millis(390)..Duration::from_millis(900)).contains(&took), "{took:?}");
        let frame = camera.newest().unwrap();
        assert!(frame.replayed && frame.exposure_assumed && !frame.simulated && !frame.focus.settled);
        assert_eq!((frame.focus.position, frame.seq), (None, 5));
        let state = camera.state().borrow().clone();
        assert!(state.replay && state.online && state.identity.starts_with("REPLAY"), "{state:?}");
        assert!(state.notes[0].contains("a replay of 3 files"), "{state:?}");
    }

    #[tokio::test(start_paused = true)]
    async fn played_once_they_end_and_leave_no_picture() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), "a.png", 10, 4);
        write(folder.path(), "b.png", 20, 4);
        write(folder.path(), "other.pgm", 90, 4);
        let pattern = folder.path().join("*.png");
        let camera = FilesCamera::start(&config(pattern.to_str().unwrap(), false), (4, 3));
        assert_eq!(levels(&camera, 2).await, [10, 20]);
        let state = until(&camera, |state| !state.online).await;
        assert!(state.fault.unwrap().contains("all 2 frames have been played"));
        assert!(camera.newest().is_none() && state.replay);
    }

    #[tokio::test(start_paused = true)]
    async fn a_file_of_another_size_is_refused_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), "a.png", 10, 4);
        write(folder.path(), "b.png", 20, 5);
        std::fs::write(folder.path().join("c.png"), "no picture").unwrap();
        let camera = FilesCamera::start(&config(folder.path().to_str().unwrap(), true), (4, 3));
        let state = until(&camera, |state| state.notes.len() == 2 && state.notes[1].contains("c.png")).await;
        assert!(state.online && state.notes[1].contains("b.png has 5x3 pixels"), "{state:?}");
        assert!(state.notes[1].contains("sensor.width_px and height_px say 4x3"), "{state:?}");
        drop(camera);
        let camera = FilesCamera::start(&config(folder.path().to_str().unwrap(), true), (8, 8));
        let state = until(&camera, |state| state.fault.as_ref().is_some_and(|fault| fault.contains("a.png"))).await;
        assert!(!state.online && state.fault.unwrap().contains("no file can be played"));
    }

    #[tokio::test(start_paused = true)]
    async fn nothing_there_says_so_until_something_is() {
        let folder = tempfile::tempdir().unwrap();
        let camera = FilesCamera::start(&config(folder.path().to_str().unwrap(), true), (4, 3));
        let state =
            until(&camera, |state| state.fault.as_ref().is_some_and(|fault| fault.contains("there is no"))).await;
        assert!(!state.online, "{state:?}");
        write(folder.path(), "a.png", 10, 4);
        until(&camera, |state| state.online).await;
        assert!(matching("/nonexistent/[").unwrap_err().contains("no pattern"));
    }

    #[tokio::test(start_paused = true)]
    async fn no_axis_is_driven_by_a_replay() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), "a.png", 10, 4);
        let camera = FilesCamera::start(&config(folder.path().to_str().unwrap(), true), (4, 3));
        until(&camera, |state| state.online).await;
        let refused = camera.frame(Instant::now()).await.unwrap_err();
        assert!(matches!(refused, DeviceError::Refused { .. }) && refused.to_string().contains("no axis is driven"));
    }
}
