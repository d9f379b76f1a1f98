//! The management API: what speaks here, and which devices there are.

use serde_json::{Value, json};

use super::common::Device;
use super::server::Facade;

/// Versions of the API that are spoken.
const VERSIONS: [u32; 1] = [1];

impl Facade {
    /// The value at a path of the management API.
    pub(super) fn management(&self, path: &[&str]) -> Option<Value> {
        match path {
            ["apiversions"] => Some(json!(VERSIONS)),
            ["v1", "description"] => Some(json!({
                "ServerName": if self.service.bench().is_simulated() { "Plenalign (SIMULATED bench)" } else { "Plenalign" },
                "Manufacturer": "Plenalign",
                "ManufacturerVersion": env!("CARGO_PKG_VERSION"),
                "Location": nix::unistd::gethostname().ok().and_then(|name| name.into_string().ok()).unwrap_or_default(),
            })),
            ["v1", "configureddevices"] => {
                let simulated = self.service.bench().is_simulated();
                let devices = Device::ALL.map(|device| {
                    json!({
                        "DeviceName": device.name(simulated),
                        "DeviceType": device.kind(),
                        "DeviceNumber": device.number(),
                        "UniqueID": self.unique_id(device),
                    })
                });
                Some(json!(devices))
            }
            _ => None,
        }
    }
}
