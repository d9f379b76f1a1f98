//! Capture over Video4Linux2: the frame source in front of the capture thread.

use std::sync::Arc;

use async_trait::async_trait;

use super::capture::Capturer;
use super::controls::KeptControls;
use super::feed::{self, CONTROLS_ALLOWED, Driven, Feed};
use super::poses::PoseSource;
use super::{controls, find};
use crate::config::CameraConfig;
use crate::device::light::{ControlName, LightControl};
use crate::device::{CameraState, DeviceError};
use plenoptics::raw::PixelFormat;

/// A V4L2 capture device.
pub struct V4l2Camera {
    feed: Feed,
    set_by_hand: Arc<KeptControls>,
}

impl V4l2Camera {
    /// Starts capturing frames of `size` (columns and rows) from the configured device. A device that is missing or
    /// unsuitable is not an error here: the state says so, and it is tried again.
    ///
    /// # Errors
    /// [`DeviceError::Refused`] for a pixel format that this program does not read, [`DeviceError::Disconnected`] when
    /// no thread can be started.
    pub fn start(config: &CameraConfig, size: (usize, usize), poses: PoseSource) -> Result<Self, DeviceError> {
        let name = config.device.clone();
        let format = PixelFormat::from_name(&config.format).ok_or_else(|| DeviceError::Refused {
            device: name.clone(),
            reason: format!("frames in `{}` are not read; `plenalign camera list` shows what is", config.format),
        })?;
        let unfit = format.is_recompressed().then(|| {
            format!(
                "its frames are for viewing only: {} has been through a lossy code; set bench.camera.format to one of its \
                 raw formats",
                format.name()
            )
        });
        let state = CameraState { unfit, ..CameraState::not_yet("v4l2", "not opened yet") };
        let (feed, outlet) = feed::feed(config, size, poses, state);
        let set_by_hand = Arc::<KeptControls>::default();
        feed::spawn(Capturer { config: config.clone(), set_by_hand: Arc::clone(&set_by_hand), format, outlet })?;
        Ok(Self { feed, set_by_hand })
    }

    /// Does something with the device, by a handle of its own: frames are taken meanwhile.
    async fn at_device<T: Send + 'static>(
        &self,
        what: &str,
        work: impl FnOnce(&v4l::Device) -> Result<T, String> + Send + 'static,
    ) -> Result<T, DeviceError> {
        self.feed.require_there()?;
        let device = || self.feed.name.clone();
        let name = device();
        let opened = move || {
            let gone = |reason| DeviceError::Disconnected { device: name.clone(), reason };
            let opened = find::resolve(&name).and_then(|path| find::open(&path)).map_err(gone)?;
            work(&opened).map_err(|reason| DeviceError::Refused { device: name, reason })
        };
        let late = || DeviceError::Timeout { device: device(), what: what.to_owned(), allowed: CONTROLS_ALLOWED };
        let done = tokio::time::timeout(CONTROLS_ALLOWED, tokio::task::spawn_blocking(opened)).await;
        let ended = |error: tokio::task::JoinError| {
            let detail = error.to_string();
            DeviceError::Protocol { device: device(), detail }
        };
        done.map_err(|_| late())?.map_err(ended)?
    }
}

#[async_trait]
impl Driven for V4l2Camera {
    fn feed(&self) -> &Feed {
        &self.feed
    }

    async fn tell_controls(&self) -> Result<Vec<LightControl>, DeviceError> {
        self.at_device("tell its controls", |device| Ok(controls::light(device))).await
    }

    async fn change_control(&self, name: ControlName, value: f64) -> Result<(), DeviceError> {
        let kept = Arc::clone(&self.set_by_hand);
        self.at_device("set its controls", move |device| controls::set_light(device, name, value, &kept)).await
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use tokio::time::Instant;

    use super::*;
    use crate::device::{AxisPose, FrameSource as _};

    fn camera(device: &str, format: &str) -> V4l2Camera {
        let config = CameraConfig {
            device: device.to_owned(),
            format: format.to_owned(),
            timeout_ms: 50,
            ..CameraConfig::default()
        };
        let unknown = AxisPose { position: None, settled: false };
        V4l2Camera::start(&config, (64, 48), Arc::new(move |_, _| (unknown, unknown))).unwrap()
    }

    #[tokio::test]
    async fn a_camera_that_is_not_there_says_so() {
        let absent = camera("/dev/plenalign-no-such-camera", "GREY");
        let mut state = absent.state();
        let told =
            state.wait_for(|state| state.fault.as_ref().is_some_and(|fault| fault.contains("connect the camera")));
        tokio::time::timeout(Duration::from_secs(20), told).await.unwrap().unwrap();
        let error = absent.frame(Instant::now()).await.unwrap_err();
        assert!(matches!(error, DeviceError::Disconnected { .. }), "{error}");
        assert!(error.to_string().contains("there is no /dev/plenalign-no-such-camera"), "{error}");
        assert!(absent.newest().is_none());
    }

    #[tokio::test]
    async fn a_camera_is_let_go_when_it_is_asked_for() {
        let camera = camera("/dev/plenalign-no-such-camera", "GREY");
        let mut state = camera.state();
        camera.end().await;
        let ended = async { while state.changed().await.is_ok() {} };
        tokio::time::timeout(Duration::ZERO, ended).await.expect("the thread that takes frames has ended");
    }

    #[tokio::test]
    async fn a_file_that_is_no_camera_says_so() {
        let none = camera("/dev/null", "Y12");
        let mut state = none.state();
        let told = state.wait_for(|state| state.fault.as_ref().is_some_and(|fault| fault.contains("no video device")));
        tokio::time::timeout(Duration::from_secs(20), told).await.unwrap().unwrap();
    }

    #[tokio::test]
    async fn recompressed_frames_are_not_measured() {
        let error = camera("/dev/null", "MJPG").frame(Instant::now()).await.unwrap_err();
        assert!(
            matches!(error, DeviceError::Refused { .. }) && error.to_string().contains("for viewing only"),
            "{error}"
        );
    }
}
