//! What is connected to the daemon's machine.

use axum::Json;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::error::{Problem, Result};
use crate::device::connected::{self, ConnectedCamera, ConnectedPort};

/// A camera that is connected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct CameraFound {
    /// Its device file.
    path: String,
    /// What `bench.camera.device` can be to mean it, the steadiest name first.
    names: Vec<String>,
    /// What its driver calls it.
    card: String,
    /// The formats it offers that this program reads.
    formats: Vec<String>,
    /// Why no frames can be had of it; null where they can.
    unusable: Option<String>,
}

/// A serial port that is there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct PortFound {
    /// Its device file.
    path: String,
    /// What a controller's `port` can be to mean it, the steadiest name first.
    names: Vec<String>,
    /// What its USB device calls itself; null for what is no USB device.
    product: Option<String>,
}

/// What is connected to the daemon's machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct DevicesFound {
    /// Cameras, as `plenalign camera list` has them.
    cameras: Vec<CameraFound>,
    /// Serial ports.
    serial_ports: Vec<PortFound>,
}

impl From<ConnectedCamera> for CameraFound {
    fn from(camera: ConnectedCamera) -> Self {
        let names = camera.names();
        let ConnectedCamera { node, formats } = camera;
        Self { path: node.path.display().to_string(), names, card: node.card, formats, unusable: node.unusable }
    }
}

impl From<ConnectedPort> for PortFound {
    fn from(port: ConnectedPort) -> Self {
        Self { path: port.path.display().to_string(), names: port.names, product: port.product }
    }
}

/// Cameras and serial ports that are connected now, whether the configuration names them or not.
#[utoipa::path(
    get, path = "/api/v1/devices", operation_id = "get_devices", tag = "bench",
    responses((status = 200, body = DevicesFound))
)]
pub(super) async fn get() -> Result<Json<DevicesFound>> {
    let look = || DevicesFound {
        cameras: connected::cameras().into_iter().map(Into::into).collect(),
        serial_ports: connected::ports().into_iter().map(Into::into).collect(),
    };
    // A driver may take its time to answer.
    tokio::task::spawn_blocking(look).await.map(Json).map_err(|_| Problem::internal())
}
