//! What is connected to the daemon's machine.

use axum::Json;
use axum::extract::State;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::App;
use super::error::{Problem, Result};
use crate::device::camera::genicam::find::{self, NetworkCamera};
use crate::device::connected::{self, ConnectedCamera, ConnectedPort};

/// A camera that is connected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(super) struct CameraFound {
    /// Its device file; of a camera on the network, its address.
    path: String,
    /// What `bench.camera.device` can be to mean it, the steadiest name first.
    names: Vec<String>,
    /// What its driver calls it; of a camera on the network, its maker and model.
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

impl From<NetworkCamera> for CameraFound {
    fn from(camera: NetworkCamera) -> Self {
        Self {
            path: camera.address.to_string(),
            names: camera.names(),
            formats: camera.readable(),
            card: camera.model,
            unusable: camera.unusable,
        }
    }
}

impl From<ConnectedPort> for PortFound {
    fn from(port: ConnectedPort) -> Self {
        Self { path: port.path.display().to_string(), names: port.names, product: port.product }
    }
}

/// Cameras and serial ports that are connected now, whether the configuration names them or not. Cameras on the network are
/// looked for on the interfaces of `bench.camera.interfaces`, which takes a second for each.
#[utoipa::path(
    get, path = "/api/v1/devices", operation_id = "get_devices", tag = "bench",
    responses((status = 200, body = DevicesFound))
)]
pub(super) async fn get(State(app): State<App>) -> Result<Json<DevicesFound>> {
    let interfaces = app.service.config().bench.camera.interfaces.clone();
    let look = move || {
        let (network, wrong) = find::cameras(&interfaces);
        for why in wrong {
            tracing::warn!("{why}");
        }
        DevicesFound {
            cameras: connected::cameras()
                .into_iter()
                .map(Into::into)
                .chain(network.into_iter().map(Into::into))
                .collect(),
            serial_ports: connected::ports().into_iter().map(Into::into).collect(),
        }
    };
    // A driver may take its time to answer.
    tokio::task::spawn_blocking(look).await.map(Json).map_err(|_| Problem::internal())
}
