//! How the bench fares, for whoever keeps watch from outside.

use std::sync::atomic::Ordering;

use super::Service;
use crate::events::BenchView;
use bench::telemetry::BenchGauges;

impl Service {
    /// The bench as it is, for whoever keeps watch from outside.
    #[must_use]
    pub fn gauges(&self) -> BenchGauges {
        let view = self.bench_view();
        let ready = self.hindrances_of(&view).is_empty();
        let camera = view.camera;
        BenchGauges {
            frame_age: self.bench.camera.newest().map(|frame| frame.exposed_to.elapsed()),
            camera_online: camera.online,
            frames_lost: camera.frames_lost,
            frames_damaged: camera.frames_damaged,
            axes: view
                .axes
                .iter()
                .map(|axis| (axis.axis.name(), axis.connected, axis.homed, axis.position_mm))
                .collect(),
            stop_latched: view.stop.latched,
            lease_held: view.lease.is_some(),
            job_running: view.job.is_some(),
            simulated: view.simulated,
            ready,
            history_writable: view.history_fault.is_none(),
            disk_free: self.disk_free_bytes(),
            disk_kept: u64::from(self.config.record.keep_free_mb) << 20,
        }
    }

    /// Room left on the disk of the state folder, bytes; `None` where that cannot be told.
    #[must_use]
    pub fn disk_free_bytes(&self) -> Option<u64> {
        self.journal.store().disk_free_bytes()
    }

    /// What keeps the bench from working now, one sentence each; nothing where all is well.
    #[must_use]
    pub fn hindrances(&self) -> Vec<String> {
        self.hindrances_of(&self.bench_view())
    }

    /// The same of the bench as it was seen.
    #[must_use]
    pub fn hindrances_of(&self, view: &BenchView) -> Vec<String> {
        let mut hindrances = Vec::new();
        if self.closing.load(Ordering::SeqCst) {
            hindrances.push("the program is shutting down".to_owned());
        }
        for axis in &view.axes {
            if let Some(why) = axis.absence() {
                hindrances.push(format!("the {} axis is not connected: {why}", axis.axis));
            } else {
                hindrances.extend(self.motion.stage_info(axis.axis).contradictions);
            }
        }
        if let Some(why) = view.camera.absence() {
            hindrances.push(format!("the camera is not online: {why}"));
        }
        hindrances
    }
}
