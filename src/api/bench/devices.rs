//! What is connected to the daemon's machine.

use std::sync::{Mutex, PoisonError};

use axum::Json;
use axum::extract::State;
use serde::{Deserialize, Serialize};
use tokio::sync::watch;
use utoipa::ToSchema;

use crate::api::App;
use crate::api::error::{Problem, Result};
use crate::device::camera::genicam::found::FoundCamera;
use crate::device::camera::genicam::survey;
use crate::device::connected::{self, ConnectedCamera, ConnectedPort};

/// A camera that is connected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(in crate::api) struct CameraFound {
    /// Its device file; of a camera on the network, its address.
    path: String,
    /// What its frames come by: `Video4Linux2`, `GigE Vision` or `USB3 Vision`.
    standard: String,
    /// What `bench.camera.device` can be to mean it, the steadiest name first.
    names: Vec<String>,
    /// What its driver calls it; of a GenICam camera, its maker and model.
    card: String,
    /// The formats it offers that this program reads.
    formats: Vec<String>,
    /// Why no frames can be had of it; null where they can.
    unusable: Option<String>,
}

/// A serial port that is there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(in crate::api) struct PortFound {
    /// Its device file.
    path: String,
    /// What a controller's `port` can be to mean it, the steadiest name first.
    names: Vec<String>,
    /// What its USB device calls itself; null for what is no USB device.
    product: Option<String>,
}

/// What is connected to the daemon's machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub(in crate::api) struct DevicesFound {
    /// Cameras, as `plenalign camera list` has them.
    cameras: Vec<CameraFound>,
    /// Serial ports.
    serial_ports: Vec<PortFound>,
    /// What could not be looked at, and why, one sentence each: an interface of `bench.camera.interfaces` that is not there,
    /// or more cameras than are read at once.
    #[serde(default)]
    notes: Vec<String>,
}

/// Looks at what is connected once at a time: whoever asks meanwhile has the outcome of the look that is under way.
#[derive(Debug, Default)]
pub(in crate::api) struct Lookout {
    /// Of the last look; without a value while it is under way.
    outcome: Mutex<Option<watch::Receiver<Option<DevicesFound>>>>,
}

impl Lookout {
    async fn found(&self, look: impl FnOnce() -> DevicesFound + Send + 'static) -> Result<DevicesFound> {
        let mut outcome = self.join(look);
        // Nothing comes of a look that has panicked.
        let found = outcome.wait_for(Option::is_some).await.map_err(|_| Problem::internal())?;
        found.clone().ok_or_else(Problem::internal)
    }

    fn join(&self, look: impl FnOnce() -> DevicesFound + Send + 'static) -> watch::Receiver<Option<DevicesFound>> {
        let mut last = self.outcome.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(outcome) = last.as_ref().filter(|last| last.borrow().is_none() && last.has_changed().is_ok()) {
            return outcome.clone();
        }
        let (tell, outcome) = watch::channel(None);
        // A driver may take its time to answer.
        tokio::task::spawn_blocking(move || tell.send_replace(Some(look())));
        last.insert(outcome).clone()
    }
}

impl From<ConnectedCamera> for CameraFound {
    fn from(camera: ConnectedCamera) -> Self {
        let names = camera.names();
        let ConnectedCamera { node, formats } = camera;
        Self {
            path: node.path.display().to_string(),
            standard: "Video4Linux2".to_owned(),
            names,
            card: node.card,
            formats,
            unusable: node.unusable,
        }
    }
}

impl From<FoundCamera> for CameraFound {
    fn from(camera: FoundCamera) -> Self {
        Self {
            path: camera.path(),
            names: camera.names(),
            standard: camera.standard().to_owned(),
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
/// looked for on the interfaces of `bench.camera.interfaces`, which takes a second for each; one that the daemon has in use is
/// not disturbed for it. Whoever asks while others are waiting for their answer gets the same.
#[utoipa::path(
    get, path = "/api/v1/devices", operation_id = "get_devices", tag = "bench",
    responses((status = 200, body = DevicesFound))
)]
pub(in crate::api) async fn get(State(app): State<App>) -> Result<Json<DevicesFound>> {
    let interfaces = app.service.config().bench.camera.interfaces.clone();
    let look = move || {
        let (genicam, notes) = survey::cameras(&interfaces);
        DevicesFound {
            cameras: connected::cameras()
                .into_iter()
                .map(Into::into)
                .chain(genicam.into_iter().map(Into::into))
                .collect(),
            serial_ports: connected::ports().into_iter().map(Into::into).collect(),
            notes,
        }
    };
    app.lookout.found(look).await.map(Json)
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;

    fn nothing(notes: &[&str]) -> DevicesFound {
        let notes = notes.iter().map(|note| (*note).to_owned()).collect();
        DevicesFound { cameras: Vec::new(), serial_ports: Vec::new(), notes }
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn who_asks_while_others_wait_gets_the_same_answer() {
        let lookout = Lookout::default();
        let (go_on, waits) = mpsc::channel::<()>();
        let first = lookout.join(move || {
            waits.recv().unwrap();
            nothing(&["the first look"])
        });
        let also = lookout.join(|| nothing(&["a look beside it"]));
        go_on.send(()).unwrap();
        for mut outcome in [first, also] {
            let found = outcome.wait_for(Option::is_some).await.unwrap().clone();
            assert_eq!(found, Some(nothing(&["the first look"])));
        }
        // What was seen then is not taken for what is there now.
        assert_eq!(lookout.found(|| nothing(&["the next look"])).await.unwrap(), nothing(&["the next look"]));
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn a_look_that_fails_does_not_keep_the_next_from_being_taken() {
        let lookout = Lookout::default();
        assert!(lookout.found(|| panic!("a driver's library did")).await.is_err());
        assert_eq!(lookout.found(|| nothing(&[])).await.unwrap(), nothing(&[]));
    }
}
