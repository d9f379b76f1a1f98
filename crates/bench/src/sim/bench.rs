//! The whole simulated bench: real drivers at one end of a pipe, firmware twins at the other, and a camera that renders
//! what they do, or plays files.

use std::sync::Arc;
use std::time::Duration;

use super::camera::SimulatedCamera;
use super::stage::line::Line;
use super::stage::{ControllerTwin, simulated_stages};
use super::truth::Truth;
use crate::config::{CameraDriver, Config};
use crate::device::camera::files::FilesCamera;
use crate::device::faults::Faults;
use crate::device::{AxisName, Bench, DeviceError, FrameSource, Setup, SimulatedOperator, Stage};

/// Builds the simulated bench of a configuration. Must be called within a tokio runtime.
///
/// # Errors
/// When a twin's driver refuses the configuration.
pub async fn open(config: &Arc<Config>) -> Result<Bench, DeviceError> {
    let truth = Truth::new(config);
    let (focus, e, twin) = simulated_stages(Arc::clone(&truth) as _, &config.bench).await?;
    let (focus, e): (Arc<dyn Stage>, Arc<dyn Stage>) = (Arc::new(focus), Arc::new(e));
    let camera: Arc<dyn FrameSource> = match config.bench.camera.driver {
        CameraDriver::V4l2 | CameraDriver::Genicam => {
            Arc::new(SimulatedCamera::new(Arc::clone(&truth), Arc::clone(&focus), Arc::clone(&e)))
        }
        CameraDriver::Files => {
            let size = (config.sensor.width_px as usize, config.sensor.height_px as usize);
            Arc::new(FilesCamera::start(&config.bench.camera, size))
        }
    };
    Ok(Bench { focus, e, camera, simulated: Some(Arc::new(Hand { truth, twin })) })
}

/// Whoever stands at the simulated bench: sets it up, and makes things go wrong.
struct Hand {
    truth: Arc<Truth>,
    twin: ControllerTwin,
}

impl SimulatedOperator for Hand {
    fn obey(&self, setup: &Setup) {
        self.truth.obey(setup);
    }

    fn confirms(&self) -> bool {
        self.truth.config().bench.simulation.operator_confirms
    }

    fn truth(&self) -> serde_json::Value {
        self.truth.report()
    }

    fn faults(&self) -> Faults {
        *self.truth.faults().borrow()
    }

    fn set_faults(&self, faults: Faults) {
        let before = self.faults();
        self.truth.set_faults(faults);
        for (index, axis) in AxisName::ALL.into_iter().enumerate() {
            self.twin.stall(index, faults.axis(axis).stalled);
        }
        let serial = faults.serial;
        self.twin.set_line(Line {
            delay: Duration::from_millis(serial.delay_ms.into()),
            loses_one_in: serial.lost_one_in as usize,
            garbles_one_in: serial.garbled_one_in as usize,
            ..Line::default()
        });
        self.twin.power(!serial.unpowered);
        match (before.serial.unplugged, serial.unplugged) {
            (false, true) => self.twin.unplug(),
            (true, false) => self.twin.plug_in(),
            _ => {}
        }
    }
}
