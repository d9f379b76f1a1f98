//! A camera under test, and the tests' own hand on the virtual ones.

use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

use plenalign::config::{CameraConfig, CameraDriver};
use plenalign::device::camera::genicam::GenicamCamera;
use plenalign::device::camera::poses::PoseSource;
use plenalign::device::camera::v4l2::V4l2Camera;
use plenalign::device::light::{ControlName, LightControl};
use plenalign::device::{AxisPose, CameraState, DeviceError, Frame, FrameSource};
use plenalign::raw::{RawImage, Samples};
use tokio::runtime::Runtime;

/// vivid as a webcam: sizes of a list, no cropping.
pub(crate) const WEBCAM: &str = "/dev/video10";
/// vivid as a grabber of 1280x720: crops and scales.
pub(crate) const GRABBER: &str = "/dev/video11";
/// A loopback that always says that it captures.
pub(crate) const LOOP: &str = "/dev/video20";
/// A loopback that captures only while somebody writes.
pub(crate) const LOOP_EXCLUSIVE: &str = "/dev/video21";
/// Size of all frames.
pub(crate) const SIZE: (usize, usize) = (640, 360);
/// How long a camera may take for anything.
pub(crate) const PATIENCE: Duration = Duration::from_secs(20);

/// A camera with the runtime that its callers wait in.
pub(crate) struct Camera {
    pub(crate) camera: Box<dyn FrameSource>,
    runtime: Runtime,
}

/// The configuration of a camera at a device file.
pub(crate) fn config(device: &str, format: &str) -> CameraConfig {
    CameraConfig { device: device.to_owned(), format: format.to_owned(), timeout_ms: 3000, ..CameraConfig::default() }
}

impl Camera {
    pub(crate) fn start(config: &CameraConfig) -> Self {
        Self::start_for(config, SIZE)
    }

    pub(crate) fn start_for(config: &CameraConfig, size: (usize, usize)) -> Self {
        let rest = AxisPose { position: None, settled: true };
        let poses: PoseSource = Arc::new(move |_, _| (rest, rest));
        let camera: Box<dyn FrameSource> = match config.driver {
            CameraDriver::Genicam => Box::new(GenicamCamera::start(config, size, poses).unwrap()),
            CameraDriver::V4l2 | CameraDriver::Files => Box::new(V4l2Camera::start(config, size, poses).unwrap()),
        };
        Self { camera, runtime: Runtime::new().unwrap() }
    }

    /// A camera that has sent its first frame.
    pub(crate) fn online(config: &CameraConfig) -> Self {
        let camera = Self::start(config);
        camera.until("be online", |state| state.online);
        camera
    }

    pub(crate) fn state(&self) -> CameraState {
        self.camera.state().borrow().clone()
    }

    /// Waits for a state.
    #[track_caller]
    pub(crate) fn until(&self, what: &str, holds: impl Fn(&CameraState) -> bool) -> CameraState {
        let mut states = self.camera.state();
        let waited = self.runtime.block_on(async {
            tokio::time::timeout(PATIENCE, states.wait_for(|state| holds(state)))
                .await
                .map(|state| state.unwrap().clone())
        });
        waited.unwrap_or_else(|_| panic!("it did not {what} within {PATIENCE:?}: {:?}", self.state()))
    }

    /// Waits for the camera to be offline for a reason that has these words.
    #[track_caller]
    pub(crate) fn until_fault(&self, words: &str) -> String {
        let what = format!("go offline with {words:?}");
        let state = self.until(&what, |state| state.fault.as_ref().is_some_and(|fault| fault.contains(words)));
        assert!(!state.online, "{state:?}");
        state.fault.unwrap()
    }

    /// A frame exposed from now on, tried for as long as anything may take.
    #[track_caller]
    pub(crate) fn frame(&self) -> Arc<Frame> {
        let until = Instant::now() + PATIENCE;
        loop {
            match self.measured() {
                Ok(frame) => return frame,
                Err(error) => assert!(Instant::now() < until, "no frame: {error}"),
            }
        }
    }

    /// What a measurement is given.
    pub(crate) fn measured(&self) -> Result<Arc<Frame>, DeviceError> {
        self.runtime.block_on(self.camera.frame(tokio::time::Instant::now()))
    }

    /// Its exposure and gain.
    #[track_caller]
    pub(crate) fn controls(&self) -> Vec<LightControl> {
        self.runtime.block_on(self.camera.controls()).unwrap()
    }

    pub(crate) fn set_control(&self, name: ControlName, value: f64) -> Result<(), DeviceError> {
        self.runtime.block_on(self.camera.set_control(name, value))
    }

    /// The frames that viewers see, so many of them.
    #[track_caller]
    pub(crate) fn watch(&self, count: usize) -> Vec<Arc<Frame>> {
        let mut live = self.camera.live();
        self.runtime.block_on(async {
            let mut frames = Vec::new();
            while frames.len() < count {
                let changed = tokio::time::timeout(PATIENCE, live.changed()).await;
                changed
                    .unwrap_or_else(|_| panic!("{} of {count} frames came: {:?}", frames.len(), self.state()))
                    .unwrap();
                frames.extend(live.borrow_and_update().clone());
            }
            frames
        })
    }
}

/// Has the kernel `unbind` the webcam, as if it were unplugged, or `bind` it again.
#[track_caller]
pub(crate) fn driver(what: &str) {
    std::fs::write(format!("/sys/bus/platform/drivers/vivid/{what}"), "vivid.0").unwrap();
}

/// Sets a control behind the driver's back.
#[track_caller]
pub(crate) fn set(device: &str, control: &str, value: i64) {
    v4l2_ctl(&["-d", device, "-c", &format!("{control}={value}")]);
}

/// Reads a control behind the driver's back.
#[track_caller]
pub(crate) fn get(device: &str, control: &str) -> i64 {
    let answer = v4l2_ctl(&["-d", device, "-C", control]);
    answer
        .rsplit(':')
        .next()
        .and_then(|value| value.trim().parse().ok())
        .unwrap_or_else(|| panic!("{control}: {answer}"))
}

#[track_caller]
pub(crate) fn v4l2_ctl(arguments: &[&str]) -> String {
    let done = Command::new("v4l2-ctl").args(arguments).output().unwrap();
    let said = String::from_utf8_lossy(&done.stdout).into_owned();
    assert!(done.status.success(), "v4l2-ctl {arguments:?}: {said}{}", String::from_utf8_lossy(&done.stderr));
    said
}

/// A pattern of vivid's without its text: one of `BLACK`, `WHITE`, `RED`.
#[track_caller]
pub(crate) fn show(device: &str, pattern: i64) {
    set(device, "osd_text_mode", 2);
    set(device, "test_pattern", pattern);
}

pub(crate) const BLACK: i64 = 5;
pub(crate) const WHITE: i64 = 6;
pub(crate) const RED: i64 = 7;

/// Mean of the samples at these places, over white.
pub(crate) fn mean_over_white(image: &RawImage, of: impl Fn(usize, usize) -> bool) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for y in 0..image.height() {
        for x in (0..image.width()).filter(|&x| of(x, y)) {
            sum += f64::from(sample(image, x, y));
            count += 1.0;
        }
    }
    assert!(count > 0.0);
    sum / count / f64::from(image.white_level())
}

pub(crate) fn sample(image: &RawImage, x: usize, y: usize) -> u16 {
    let index = y * image.width() + x;
    match image.samples() {
        Samples::U8(samples) => u16::from(samples[index]),
        Samples::U16(samples) => samples[index],
    }
}
