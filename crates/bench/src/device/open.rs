//! From configuration to the devices of a hardware bench: the one place that names concrete drivers.
//!
//! Missing hardware is no error here: its state says why it is missing, and it is opened when it comes. Nothing ever
//! falls back to the simulated bench.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use super::camera::files::FilesCamera;
use super::camera::genicam::GenicamCamera;
use super::camera::poses::poses_of_stages;
use super::camera::v4l2::V4l2Camera;
use super::serial::{Dial as _, SerialDial};
use super::stage::axis::AxisSetup;
use super::stage::grbl_controller::GrblDriver;
use super::stage::pi_controller::PiDriver;
use super::stage::session::Driver;
use super::stage::supervisor::{Controller, check_identity};
use super::stage::thorlabs_controller::ThorlabsDriver;
use super::stage::tmcl_controller::TmclDriver;
use super::stage::zaber_controller::ZaberDriver;
use super::{AxisName, Bench, DeviceError, FrameSource, Stage};
use crate::config::{AxisConfig, BenchConfig, CameraDriver, ControllerConfig, ControllerDriver};

/// Longest wait at the start for the controllers that are there.
const FIRST_ATTEMPT: Duration = Duration::from_secs(10);

/// Opens every device of a hardware bench; frames must have `frame_size` columns and rows.
///
/// # Errors
/// What in the configuration keeps a device from ever being used.
pub async fn open_hardware(bench: &BenchConfig, frame_size: (usize, usize)) -> Result<Bench, DeviceError> {
    let (focus, e) = open_stages(bench).await?;
    let settle = |axis: &AxisConfig| Duration::from_millis(axis.settle_ms);
    let poses = poses_of_stages((focus.state(), settle(&bench.focus)), (e.state(), settle(&bench.e)));
    let camera: Arc<dyn FrameSource> = match bench.camera.driver {
        CameraDriver::V4l2 => Arc::new(V4l2Camera::start(&bench.camera, frame_size, poses)?),
        CameraDriver::Genicam => Arc::new(GenicamCamera::start(&bench.camera, frame_size, poses)?),
        CameraDriver::Files => Arc::new(FilesCamera::start(&bench.camera, frame_size)),
    };
    Ok(Bench { focus, e, camera, simulated: None })
}

/// The driver of a controller.
#[must_use]
pub fn driver(config: &ControllerConfig) -> Box<dyn Driver> {
    match config.driver {
        ControllerDriver::Grbl => Box::new(GrblDriver { baud: config.baud() }),
        ControllerDriver::Zaber => Box::new(ZaberDriver { address: config.address }),
        ControllerDriver::Pi => Box::new(PiDriver),
        ControllerDriver::Tmcl => Box::new(TmclDriver { address: config.address }),
        ControllerDriver::Thorlabs => Box::new(ThorlabsDriver),
    }
}

/// Opens a controller's port and asks what is there, and nothing else: nothing is stopped, set or moved. Opening a port
/// may still reset a board that is wired so, as an Arduino is. `name` is the controller's in the configuration.
///
/// # Errors
/// [`DeviceError::Busy`] when another program holds the port, [`DeviceError::Disconnected`] when it cannot be opened,
/// [`DeviceError::Timeout`] when nothing answers, [`DeviceError::WrongDevice`] when another controller does than the
/// configured one.
pub async fn identify(name: &str, config: &ControllerConfig) -> Result<String, DeviceError> {
    let device = controller_name(name);
    let identity = driver(config).identify(SerialDial::of(&device, config).open().await?, &device).await?;
    check_identity(&device, &identity, config.identity.as_deref())?;
    Ok(identity)
}

/// Opens the controllers that the two axes are on: one that has both, or one for each. Returns when each has been tried
/// once; what is not there then is connected when it comes.
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
        wanted.entry(&config.controller).or_default().push(AxisSetup::new(axis, config));
    }
    let mut controllers = Vec::new();
    for (name, setups) in wanted {
        let device = controller_name(name);
        let config = bench.controllers.get(name).ok_or_else(|| DeviceError::Disconnected {
            device: device.clone(),
            reason: format!("there is no [bench.controllers.{name}] in the configuration; add it, with its `port`"),
        })?;
        let dial = SerialDial::of(&device, config);
        let identity = config.identity.clone();
        controllers.push(Controller::start(&device, driver(config), Arc::new(dial), identity, setups));
    }
    let tried = async {
        for controller in &controllers {
            // The reason is in the state.
            let _ = controller.first_attempt().await;
        }
    };
    let _ = tokio::time::timeout(FIRST_ATTEMPT, tried).await;
    let stage = |axis| {
        let found = controllers.iter().find_map(|controller| controller.stage(axis));
        found.map(|stage| Arc::new(stage) as Arc<dyn Stage>).ok_or_else(|| DeviceError::Disconnected {
            device: format!("the {axis} axis"),
            reason: "no controller has it".to_owned(),
        })
    };
    Ok((stage(AxisName::Focus)?, stage(AxisName::E)?))
}

fn controller_name(name: &str) -> String {
    format!("controller `{name}`")
}
