//! The whole simulated bench: real drivers at one end of a pipe, firmware twins at the other, and a camera that renders
//! what they do, or plays files.

use std::sync::Arc;

use super::camera::SimulatedCamera;
use super::stage::simulated_stages;
use super::truth::Truth;
use crate::config::{CameraDriver, Config};
use crate::device::camera::files::FilesCamera;
use crate::device::{Bench, DeviceError, FrameSource, Stage};

/// Builds the simulated bench of a configuration. Must be called within a tokio runtime.
///
/// # Errors
/// When a twin's driver refuses the configuration.
pub async fn open(config: &Arc<Config>) -> Result<Bench, DeviceError> {
    let truth = Truth::new(config);
    let (focus, e, _twin) = simulated_stages(Arc::clone(&truth) as _, &config.bench).await?;
    let (focus, e): (Arc<dyn Stage>, Arc<dyn Stage>) = (Arc::new(focus), Arc::new(e));
    let camera: Arc<dyn FrameSource> = match config.bench.camera.driver {
        CameraDriver::V4l2 => Arc::new(SimulatedCamera::new(Arc::clone(&truth), Arc::clone(&focus), Arc::clone(&e))),
        CameraDriver::Files => {
            let size = (config.sensor.width_px as usize, config.sensor.height_px as usize);
            Arc::new(FilesCamera::start(&config.bench.camera, size))
        }
    };
    Ok(Bench { focus, e, camera, simulated: Some(truth) })
}
