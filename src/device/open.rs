//! From configuration to the devices of a hardware bench: the one place that names concrete drivers.
//!
//! Missing hardware is an error that names it; nothing here ever falls back to the simulated bench.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use super::camera::files::FilesCamera;
use super::camera::v4l2::{V4l2Camera, poses_of_stages};
use super::port::open_serial;
use super::stage::grbl_controller::{AxisSetup, GrblController};
use super::{AxisName, Bench, DeviceError, FrameSource, Stage};
use crate::config::{AxisConfig, BenchConfig, CameraDriver, ControllerDriver};

/// Opens every device of a hardware bench; frames must have `frame_size` columns and rows.
///
/// A camera that is not there yet is no error: its state says so, and it is opened when it comes.
///
/// # Errors
/// What keeps a stage controller from being used, naming the controller.
pub async fn open_hardware(bench: &BenchConfig, frame_size: (usize, usize)) -> Result<Bench, DeviceError> {
    let (focus, e) = open_stages(bench).await?;
    let settle = |axis: &AxisConfig| Duration::from_millis(axis.settle_ms);
    let poses = poses_of_stages((focus.state(), settle(&bench.focus)), (e.state(), settle(&bench.e)));
    let camera: Arc<dyn FrameSource> = match bench.camera.driver {
        CameraDriver::V4l2 => Arc::new(V4l2Camera::start(&bench.camera, frame_size, poses)?),
        CameraDriver::Files => Arc::new(FilesCamera::start(&bench.camera, frame_size)),
    };
    Ok(Bench { focus, e, camera, simulated: None })
}

/// Opens the controllers that the two axes are on: one that has both, or one for each.
///
/// # Errors
/// As [`open_hardware`].
pub async fn open_stages(bench: &BenchConfig) -> Result<(Arc<dyn Stage>, Arc<dyn Stage>), DeviceError> {
    let axes = [(AxisName::Focus, &bench.focus), (AxisName::E, &bench.e)];
    if bench.focus.controller == bench.e.controller && bench.focus.axis.eq_ignore_ascii_case(&bench.e.axis) {
        return Err(DeviceError::Refused {
            device: controller_name(&bench.focus.controller),
            reason: format!("focus and e axis are both `{}` on it; give each its own", bench.focus.axis),
        });
    }
    let mut wanted: BTreeMap<&str, Vec<AxisSetup>> = BTreeMap::new();
    for (axis, config) in axes {
        wanted.entry(&config.controller).or_default().push(AxisSetup::new(axis, &config.axis, config)?);
    }
    let mut stages: BTreeMap<AxisName, Arc<dyn Stage>> = BTreeMap::new();
    for (name, setups) in wanted {
        let device = controller_name(name);
        let config = bench.controllers.get(name).ok_or_else(|| DeviceError::Disconnected {
            device: device.clone(),
            reason: format!("there is no [bench.controllers.{name}] in the configuration; add it, with its `port`"),
        })?;
        let controller = match config.driver {
            ControllerDriver::Grbl => {
                let port = open_serial(&device, &config.port, config.baud)?;
                GrblController::connect(port, &device, &config.port.display().to_string(), setups).await?
            }
        };
        for axis in AxisName::ALL {
            if let Some(stage) = controller.stage(axis) {
                stages.insert(axis, Arc::new(stage));
            }
        }
    }
    let mut take = |axis| {
        stages.remove(&axis).ok_or_else(|| DeviceError::Disconnected {
            device: format!("the {axis} axis"),
            reason: "no controller has it".to_owned(),
        })
    };
    Ok((take(AxisName::Focus)?, take(AxisName::E)?))
}

fn controller_name(name: &str) -> String {
    format!("controller `{name}`")
}
