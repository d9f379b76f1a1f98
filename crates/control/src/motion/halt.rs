//! What ends motion: the stop of both axes, which latches, and halts without a latch.

use std::sync::atomic::Ordering;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::time::Instant;
use utoipa::ToSchema;

use super::Motion;
use crate::events::StopDeliveries;
use crate::refusal::Refusal;
use bench::device::{AxisName, StopDelivery};
use bench::telemetry;

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
    /// Whether the latch is on the disk already, so that it outlives a restart. Where it is not, writing it is tried again.
    pub kept: bool,
}

impl Motion {
    /// Stops both axes at once and latches: no motion until the stop is reset. `by` is who stops, `asked` when that was
    /// asked for: the latency counts from there.
    pub async fn stop(&self, asked: Instant, by: &str) -> StopReport {
        self.latch(by);
        let report = self.halt_asked(asked).await;
        self.delivered(StopDeliveries { focus: report.focus, e: report.e });
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
        let (focus, e) = tokio::join!(self.bench.focus.stop(), self.bench.e.stop());
        // An order that went out before this one was asked for stops the axis already: nothing was waited for.
        let latency_ms = [(AxisName::Focus, focus), (AxisName::E, e)]
            .into_iter()
            .filter(|&(_, delivery)| delivery != StopDelivery::Undeliverable)
            .filter_map(|(axis, _)| self.bench.stage(axis).stop_sent())
            .map(|sent| sent.saturating_duration_since(asked).as_secs_f64() * 1000.0)
            .reduce(f64::max);
        StopReport { focus, e, latency_ms, kept: false }
    }

    /// Stops one axis, latching nothing, and ends the command that the axis is under.
    pub async fn halt_axis(&self, axis: AxisName) -> StopDelivery {
        let delivery = self.stop_axis(axis).await;
        self.freed(axis).await;
        delivery
    }

    /// Whether the stop is not latched.
    ///
    /// # Errors
    /// [`Refusal::Stopped`] while it is.
    pub(super) fn check_latch(&self) -> Result<(), Refusal> {
        if self.stopped.load(Ordering::SeqCst) { Err(Refusal::Stopped) } else { Ok(()) }
    }
}
