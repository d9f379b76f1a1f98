//! A controller's settings read again: whoever shares its port may have changed them.

use std::sync::atomic::Ordering;

use super::super::grbl::{self, Letter, Settings};
use super::super::session::AxisFacts;
use super::{ANSWER, Controller, POLL_MOVING, checks, device_error, locked};
use crate::device::DeviceError;

/// How often the settings are asked for where not all are told.
const TRIES: usize = 4;

impl Controller {
    /// Notes that another may have commanded the controller.
    pub(super) fn shared_with_another(&self, sign: &str) {
        if !self.settings_stale.swap(true, Ordering::SeqCst) {
            tracing::warn!(controller = %self.name, sign, "another program may command a stage controller");
        }
    }

    /// Reads the settings again where another may have changed them.
    ///
    /// # Errors
    /// When the controller does not tell them, or contradicts the configuration now.
    pub(super) async fn renew_if_stale(&self, index: usize) -> Result<(), DeviceError> {
        if self.settings_stale.load(Ordering::SeqCst) { self.renew_settings(index).await } else { Ok(()) }
    }

    /// Reads the settings again where another may have changed them and nothing moves, so that what contradicts is told,
    /// and what contradicts no longer. Returns whether it did.
    pub(super) async fn renew_at_rest(&self) -> bool {
        if !self.settings_stale.load(Ordering::SeqCst) {
            return false;
        }
        let Ok(_operation) = self.operation.try_lock() else { return false };
        if let Err(error) = self.renew_settings(0).await {
            tracing::warn!(controller = %self.name, %error, "a stage controller's settings were read again");
        }
        true
    }

    /// Reads the settings again, and compares them with the configuration.
    ///
    /// # Errors
    /// When the controller does not tell them, or contradicts the configuration of an axis now.
    pub(super) async fn renew_settings(&self, index: usize) -> Result<(), DeviceError> {
        self.settings_stale.store(false, Ordering::SeqCst);
        let told = self.told_settings().await.inspect_err(|_| self.settings_stale.store(true, Ordering::SeqCst))?;
        let before = std::mem::replace(&mut *locked(&self.settings), told.clone());
        if told != before {
            tracing::warn!(controller = %self.name, "a stage controller's settings are not what they were");
            let moved = |number| told.get(number) != before.get(number);
            // What makes another place of the same count of steps.
            if moved(3) || moved(13) || Letter::ALL.iter().any(|letter| moved(100 + letter.index() as u16)) {
                self.forget_positions();
            }
            for axis in &self.axes {
                let homes_also = axis.facts().homes_also;
                let facts = checks::facts(axis.link.setup(), axis.letter, &told, self.zero);
                *locked(&axis.facts) = AxisFacts { homes_also, ..facts };
            }
            self.share_contradictions();
        }
        self.axes[index].facts().check_motion(&self.name)
    }

    /// Every setting. Where another's answer ends this question, what it was answered comes later.
    async fn told_settings(&self) -> Result<Settings, DeviceError> {
        let before = locked(&self.settings).clone();
        for _ in 0..TRIES {
            let answer = self.port.ask(grbl::SETTINGS, ANSWER).await;
            let answer = answer.map_err(|error| device_error(&self.name, "tell its settings", error))?;
            let told = Settings::from_lines(&answer.lines);
            if told.covers(&before) {
                return Ok(told);
            }
            tokio::time::sleep(POLL_MOVING).await;
        }
        let detail = "it does not tell every setting; does another program command it?".to_owned();
        Err(DeviceError::Protocol { device: self.name.clone(), detail })
    }

    /// Where to home one axis is to home the other, what contradicts one keeps both from moving.
    pub(super) fn share_contradictions(&self) {
        if self.homes_single_axes {
            return;
        }
        let all: Vec<String> = self.axes.iter().flat_map(|axis| axis.facts().contradictions).collect();
        for axis in &self.axes {
            locked(&axis.facts).contradictions.clone_from(&all);
        }
    }
}
