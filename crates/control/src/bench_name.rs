//! What a bench is called, in the history and for its lock.

use bench::config::BenchConfig;
use bench::device::position::position;
use bench::store::BenchName;

/// A bench's names as they are now: a device that is plugged in later is known at the next start.
#[must_use]
pub fn bench_name(bench: &BenchConfig) -> BenchName {
    let spelled = bench.name_by(|port| Some(port.display().to_string())).unwrap_or_default();
    BenchName { spelled, devices: bench.name_by(position) }
}
