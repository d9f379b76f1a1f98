//! Stopping a controller at once, out of band, and proving that it rests.

use std::sync::atomic::Ordering;
use std::time::Duration;

use super::super::grbl::{self, Alarm};
use super::{Controller, START_UP};
use crate::device::StopDelivery;

/// Time beyond its own deceleration that an axis may take to stop before the controller is reset under it.
const STOP_SPARE: Duration = Duration::from_millis(200);

impl Controller {
    /// Resets the controller and waits for its start; tells whether that came. `blind` says that the reset is the stop
    /// itself, nothing having gone before it.
    pub(super) async fn restart(&self, blind: bool) -> bool {
        let mut restarts = self.restarts.subscribe();
        let before = *restarts.borrow_and_update();
        self.restart_is_ours.store(true, Ordering::SeqCst);
        let Ok(written) = self.port.urgent(&[grbl::RESET], true) else { return false };
        if !matches!(tokio::time::timeout(STOP_SPARE, written).await, Ok(Ok(()))) {
            return false;
        }
        if blind {
            self.orders.stop_sent();
        }
        matches!(tokio::time::timeout(START_UP, restarts.wait_for(|&count| count > before)).await, Ok(Ok(_)))
    }

    /// Stops what moves and what waits to move, without having been asked to.
    pub(super) async fn stop(&self) -> StopDelivery {
        self.orders.outdate();
        self.rest_now().await
    }

    pub(super) async fn rest_now(&self) -> StopDelivery {
        let blind = self.homing.load(Ordering::SeqCst) || self.alarm.borrow().is_some_and(Alarm::needs_reset);
        // In homing, and after a critical alarm, a reset is all that the controller obeys.
        let bytes: &[u8] = if blind { &[] } else { &[grbl::JOG_CANCEL, grbl::HOLD] };
        if !blind {
            match self.port.urgent(bytes, false) {
                Err(_) => return StopDelivery::Undeliverable,
                Ok(written) => {
                    if tokio::time::timeout(STOP_SPARE, written).await.is_err() {
                        return StopDelivery::Undeliverable;
                    }
                    self.orders.stop_sent();
                }
            }
        }
        let after_line = self.latest_line();
        let _watching = self.watching();
        let _stopping = self.stopping.lock().await;
        let deceleration = self
            .axes
            .iter()
            .map(|axis| axis.facts.speed_mm_per_s / axis.facts.acceleration_mm_per_s2)
            .fold(0.0, f64::max);
        let allowed = STOP_SPARE + Duration::from_secs_f64(deceleration.min(5.0));
        let rested = if blind {
            None
        } else {
            tokio::time::timeout(allowed, self.rest_or_hold(after_line)).await.ok().and_then(Result::ok)
        };
        match rested {
            Some(before) => {
                // The reset throws away what a held line has left, and releases the hold. At rest no step is lost.
                if self.restart(false).await
                    && let Ok(after) = self.fresh_reading(self.latest_line()).await
                    && after.machine != before.machine
                {
                    self.forget_positions();
                }
                StopDelivery::Confirmed
            }
            None => {
                self.forget_positions();
                let restarted = self.restart(blind).await;
                self.forget_positions();
                if restarted { StopDelivery::Confirmed } else { self.undelivered() }
            }
        }
    }

    fn undelivered(&self) -> StopDelivery {
        match self.port.closed().borrow().is_some() {
            true => StopDelivery::Undeliverable,
            false => StopDelivery::Sent,
        }
    }
}
