//! What the service keeps watch of by itself: the history, the lease, the devices, and what is measured; each change is
//! published.

use std::sync::{Arc, PoisonError};
use std::time::Duration;

use serde_json::json;
use tokio::sync::watch;
use tokio::time::Instant;

use super::Service;
use crate::ServiceError;
use crate::events::{Event, MeasurementView};
use crate::job::JobState;
use bench::access::PROGRAM;
use bench::store::records::Audit;

/// Rest between two looks at the bench's state for the events, at least.
const VIEW_INTERVAL: Duration = Duration::from_millis(100);
/// Between two signs of life of a watcher, at most.
const PULSE: Duration = Duration::from_millis(500);
/// Between two attempts to read how an earlier run left the stop.
const TRY_AGAIN: Duration = Duration::from_secs(1);
/// Rest between two measurements in whole of the live picture, at least; and in units of what the last one took, so that
/// the meter's readings and the pictures have the most of the machine. Where it is in doubt what is in view, as long as the
/// last one took.
const LIVE_REST: Duration = Duration::from_millis(500);
const LIVE_SHARE: u32 = 3;

impl Service {
    /// Starts the watchers; they end with the service.
    pub(super) fn watch(self: &Arc<Self>) {
        let (watched, measured, leased) = (Arc::clone(self), Arc::clone(self), Arc::clone(self));
        let (kept, held, pruned) = (Arc::clone(self), Arc::clone(self), Arc::clone(self));
        let read = Arc::clone(self);
        tokio::spawn(async move { pruned.tasks.clone().run_until_cancelled(pruned.watch_retention()).await });
        tokio::spawn(async move { kept.tasks.clone().run_until_cancelled(kept.watch_history()).await });
        tokio::spawn(async move { held.tasks.clone().run_until_cancelled(held.keep_lease()).await });
        tokio::spawn(async move { leased.tasks.clone().run_until_cancelled(leased.watch_lease()).await });
        tokio::spawn(async move { watched.tasks.clone().run_until_cancelled(watched.watch_bench()).await });
        tokio::spawn(async move { measured.tasks.clone().run_until_cancelled(measured.watch_focus()).await });
        tokio::spawn(async move { read.tasks.clone().run_until_cancelled(read.watch_meter()).await });
    }

    /// Returns once it is known what an earlier run has left, or that the history cannot be read now.
    pub async fn open_history(&self) {
        if let Err(error) = self.history_ready().await {
            tracing::error!(%error, "the history is not open");
        }
    }

    /// Makes sure that the history can be written; in a file that does not know this run yet, it does so from here on.
    /// The stop of an earlier run is taken up before this returns to the first, and to whoever came with it.
    pub(super) async fn history_ready(&self) -> Result<(), ServiceError> {
        let _one = self.recalling.lock().await;
        let jobs = || self.all_jobs().iter().map(|job| job.chronicle()).collect();
        let begun = self.journal.ready(jobs).await?;
        self.recall_stop().await;
        if !begun {
            return Ok(());
        }
        if self.leases.view().is_none()
            && let Some(lease) = self.journal.kept_lease().await?
        {
            self.leases.restore(lease);
        }
        self.publish_bench();
        Ok(())
    }

    /// Keeps the history going: knows when it can be written and when not, and tells.
    async fn watch_history(&self) {
        let mut health = self.journal.store().health();
        let mut said = None;
        loop {
            let error = match self.history_ready().await {
                Ok(()) => {
                    self.keep_stop().await;
                    None
                }
                Err(error) => Some(error.to_string()),
            };
            // It is tried every second, for as long as somebody takes to make room.
            if let Some(error) = error.as_ref().filter(|error| said.as_ref() != Some(*error)) {
                tracing::warn!(%error, "nothing moves for now");
            }
            said = error;
            self.publish_bench();
            tokio::select! {
                changed = health.changed() => if changed.is_err() { return },
                () = self.stop_left_over() => {}
            }
        }
    }

    /// Waits until the stop's latch, as an earlier run left it or as it is to be kept, is to be tried again.
    async fn stop_left_over(&self) {
        loop {
            tokio::time::sleep(TRY_AGAIN).await;
            if self.motion.is_stop_unread() || self.is_stop_unkept() {
                return;
            }
        }
    }

    /// Ends what moves under a lease that is over, and publishes the bench's state, whenever the lease changes or runs out.
    async fn watch_lease(&self) {
        let mut changes = self.leases.changes();
        loop {
            let runs_out = self.leases.runs_out();
            tokio::select! {
                changed = changes.changed() => if changed.is_err() { return },
                () = tokio::time::sleep(PULSE) => {
                    beat(&self.pulses[1]);
                    continue;
                }
                () = async {
                    match runs_out {
                        Some(until) => tokio::time::sleep_until(until).await,
                        None => std::future::pending().await,
                    }
                } => {}
            }
            beat(&self.pulses[1]);
            changes.mark_unchanged();
            // At once; and a controller may take its time to stop.
            let motion = Arc::clone(&self.motion);
            let mut ending = Box::pin(async move { motion.end_uncontrolled().await });
            if futures_util::poll!(&mut ending).is_pending() {
                tokio::spawn(ending);
            }
            for lease in self.leases.take_run_out() {
                self.journal.audit(Audit {
                    at: jiff::Timestamp::now(),
                    who: PROGRAM.to_owned(),
                    what: "lease.expire".to_owned(),
                    detail: json!({ "lease": lease.id, "owner": lease.owner, "note": lease.note }),
                    from: None,
                });
            }
            self.lease_unkept.notify_one();
            self.publish_bench();
        }
    }

    /// Has the history know the lease as it is, one write after another: however often it is renewed, none waits for the
    /// disk behind another.
    async fn keep_lease(&self) {
        loop {
            self.lease_unkept.notified().await;
            while self.write_lease().await.is_err() {
                tokio::time::sleep(TRY_AGAIN).await;
            }
        }
    }

    /// Returns once each of the service's watchers has come round: whoever bounds the wait learns whether they are stuck.
    pub async fn shows_life(&self) -> bool {
        for pulse in &self.pulses {
            let mut beats = pulse.subscribe();
            if beats.changed().await.is_err() {
                return false;
            }
        }
        true
    }

    /// Publishes the bench's state as it is. One at a time: a state that was seen first is not told last.
    pub(super) fn publish_bench(&self) {
        let _one = self.publishing.lock().unwrap_or_else(PoisonError::into_inner);
        let bench = self.bench_view();
        self.recent.bench(&bench);
        // Nobody listening is no error.
        let _ = self.events.send(Event::Bench { bench: Box::new(bench) });
    }

    pub(super) fn publish_measurement(&self, measurement: MeasurementView) {
        self.recent.measurement(&measurement, self.sees_levels());
        *self.measurement.lock().unwrap_or_else(PoisonError::into_inner) = Some(measurement.clone());
        let _ = self.events.send(Event::Measurement { measurement: Box::new(measurement) });
    }

    /// Publishes the bench's state whenever a device's changes, or what stands before the camera does.
    async fn watch_bench(&self) {
        let mut focus = self.bench.focus.state();
        let mut e = self.bench.e.state();
        let mut camera = self.bench.camera.state();
        let mut setups = self.eye.setups();
        loop {
            let changed = tokio::select! {
                changed = setups.changed() => changed.is_ok(),
                () = self.motion.shell_said() => true,
                changed = focus.changed() => changed.is_ok(),
                changed = e.changed() => changed.is_ok(),
                changed = camera.changed() => changed.is_ok(),
                () = tokio::time::sleep(PULSE) => {
                    beat(&self.pulses[0]);
                    continue;
                }
            };
            if !changed {
                return;
            }
            beat(&self.pulses[0]);
            if !focus.borrow_and_update().homed {
                self.eye.lose_air_step();
            }
            e.mark_unchanged();
            camera.mark_unchanged();
            setups.mark_unchanged();
            self.publish_bench();
            tokio::time::sleep(VIEW_INTERVAL).await;
        }
    }

    /// Publishes what the jobs measure and, while somebody watches or a reading is in doubt, and no job measures, the live
    /// picture's measurement in whole.
    async fn watch_focus(&self) {
        let (mut measured, mut doubted) = (self.eye.measured(), self.readings.doubted());
        let (mut ended, mut took) = (Instant::now(), Duration::ZERO);
        let mut due = ended + LIVE_REST;
        loop {
            tokio::select! {
                changed = measured.changed() => {
                    if changed.is_err() {
                        return;
                    }
                    let newest = measured.borrow_and_update().clone();
                    if let Some(measurement) = newest {
                        // Of a stepped board it is of one level, and no reading's.
                        if !self.sees_levels() {
                            self.readings.compare(&measurement);
                        }
                        self.publish_measurement(measurement);
                    }
                }
                changed = doubted.changed() => {
                    if changed.is_err() {
                        return;
                    }
                    if *doubted.borrow_and_update() {
                        due = due.min(ended + took);
                    }
                }
                () = tokio::time::sleep_until(due) => {
                    let began = Instant::now();
                    // Who only reads the meter is to learn, too, whether what it reads is of one board.
                    let wanted = Arc::strong_count(&self.onlookers) > 1 || *doubted.borrow();
                    if wanted && self.current().is_none_or(|job| job.snapshot().state == JobState::WaitingForOperator) {
                        match self.eye.measure_live().await {
                            Some(Ok(measurement)) => {
                                self.readings.compare(&measurement);
                                self.publish_measurement(measurement);
                            }
                            Some(Err(failed)) => self.readings.not_measured(failed),
                            None => {}
                        }
                    }
                    (ended, took) = (Instant::now(), began.elapsed());
                    due = ended + LIVE_REST.max(LIVE_SHARE * took);
                }
            }
        }
    }
}

fn beat(pulse: &watch::Sender<u64>) {
    pulse.send_modify(|beats| *beats += 1);
}
