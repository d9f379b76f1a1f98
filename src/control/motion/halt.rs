//! What ends motion: the latched stop of both axes, and halts without a latch.

use std::sync::atomic::Ordering;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::time::Instant;
use utoipa::ToSchema;

use super::{Claim, Motion, index};
use crate::control::events::StopView;
use crate::device::{AxisName, DeviceError, StopDelivery};
use crate::telemetry;

/// How often an axis is told to halt, at most, and how long the command that it was under has to end each time.
const HALTS: usize = 5;
const HALT_ALLOWED: Duration = Duration::from_millis(200);

/// What became of a stop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StopReport {
    /// The focus axis.
    pub focus: StopDelivery,
    /// The e axis.
    pub e: StopDelivery,
    /// From the request until the last byte of the stop order was handed to the operating system, on every axis reached,
    /// ms; 0 where an earlier stop was being carried out already, absent where no axis was reached.
    pub latency_ms: Option<f64>,
}

impl Motion {
    /// The stop's latch.
    #[must_use]
    pub fn stop_view(&self) -> StopView {
        StopView { latched: self.stopped.load(Ordering::SeqCst), since: self.state().stopped_since }
    }

    /// Stops both axes at once and latches: no motion until [`Motion::reset_stop`].
    pub async fn stop(&self) -> StopReport {
        self.stop_asked(Instant::now()).await
    }

    /// [`Motion::stop`] asked for at a moment before: its latency counts from there.
    pub async fn stop_asked(&self, asked: Instant) -> StopReport {
        if !self.stopped.swap(true, Ordering::SeqCst) {
            self.state().stopped_since = Some(jiff::Timestamp::now());
        }
        let report = self.halt_asked(asked).await;
        if let Some(latency_ms) = report.latency_ms {
            telemetry::stop_sent(Duration::from_secs_f64(latency_ms / 1000.0));
        }
        report
    }

    /// Stops both axes at once without latching: what ends every job.
    pub async fn halt(&self) -> StopReport {
        self.halt_asked(Instant::now()).await
    }

    async fn halt_asked(&self, asked: Instant) -> StopReport {
        self.state().approached = [false; 2];
        for halts in &self.halts {
            halts.fetch_add(1, Ordering::SeqCst);
        }
        let (focus, e) = tokio::join!(self.bench.focus.stop(), self.bench.e.stop());
        // An order that went out before this one was asked for stops the axis already: nothing was waited for.
        let latency_ms = [(AxisName::Focus, focus), (AxisName::E, e)]
            .into_iter()
            .filter(|&(_, delivery)| delivery != StopDelivery::Undeliverable)
            .filter_map(|(axis, _)| self.bench.stage(axis).stop_sent())
            .map(|sent| sent.saturating_duration_since(asked).as_secs_f64() * 1000.0)
            .reduce(f64::max);
        StopReport { focus, e, latency_ms }
    }

    /// Stops one axis (and whatever else its controller moves) at once without latching, and ends the command that it is
    /// under. Where that command told its next piece in the very same moment, the axis is stopped again.
    pub async fn halt_axis(&self, axis: AxisName) -> StopDelivery {
        let at = index(axis);
        let mut delivery = StopDelivery::Undeliverable;
        for _ in 0..HALTS {
            self.state().approached[at] = false;
            self.halts[at].fetch_add(1, Ordering::SeqCst);
            delivery = self.bench.stage(axis).stop().await;
            let from = Instant::now();
            while self.is_commanded(axis) && from.elapsed() < HALT_ALLOWED {
                tokio::time::sleep(Duration::from_millis(2)).await;
            }
            if !self.is_commanded(axis) {
                break;
            }
        }
        delivery
    }

    pub(super) fn check_halt(&self, claim: &Claim) -> Result<(), DeviceError> {
        let halted = self.halts[index(claim.axis)].load(Ordering::SeqCst) != claim.halts;
        if halted { Err(DeviceError::Stopped { axis: claim.axis }) } else { Ok(()) }
    }

    /// Latches without a motion to stop: the stop of an earlier run, still in force.
    pub(in crate::control) fn latch(&self, since: Option<jiff::Timestamp>) {
        self.state().stopped_since = since;
        self.stopped.store(true, Ordering::SeqCst);
    }

    /// Allows motion again. Nothing resumes by itself.
    pub fn reset_stop(&self) {
        self.state().stopped_since = None;
        self.stopped.store(false, Ordering::SeqCst);
    }
}
