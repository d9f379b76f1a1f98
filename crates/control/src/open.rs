//! From the configuration to the bench: the one place that chooses between real devices and twins.

use std::sync::Arc;

use bench::config::{BenchDriver, Config};
use bench::device::{Bench, DeviceError};
use bench::{device, sim};

/// Opens the configured bench. A hardware bench whose devices are missing is an error, never a simulation.
///
/// # Errors
/// When a device is missing, busy, or not the one configured.
pub async fn open_bench(config: &Arc<Config>) -> Result<Bench, DeviceError> {
    match config.bench.driver {
        BenchDriver::Simulated => sim::bench::open(config).await,
        BenchDriver::Hardware => {
            let size = (config.sensor.width_px as usize, config.sensor.height_px as usize);
            device::open::open_hardware(&config.bench, size).await
        }
    }
}
