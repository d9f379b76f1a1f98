//! A controller's settings read again: whoever shares its port may have changed them.

use std::sync::atomic::Ordering;
use std::time::Duration;

use super::super::grbl::{self, Dialect, Votes};
use super::asking::{Asker, Twice};
use super::told::Told;
use super::{ANSWER, Controller, locked};
use crate::device::{AxisName, DeviceError};

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
        let told = self.told_anew().await.inspect_err(|_| self.settings_stale.store(true, Ordering::SeqCst))?;
        let before = std::mem::replace(&mut *locked(&self.told), told.clone());
        if told != before {
            tracing::warn!(controller = %self.name, "a stage controller's settings are not what they were");
            if told.displaces(&before) {
                self.forget_positions();
            }
            let names: Vec<AxisName> = self.axes.iter().map(|axis| axis.link.name()).collect();
            for axis in &self.axes {
                *locked(&axis.facts) = told.facts(axis.link.setup(), axis.letter, &names);
            }
            self.share_contradictions();
            // What contradicts is read once more soon: the line may have lost the same byte twice.
            if self.axes.iter().any(|axis| !axis.facts().contradictions.is_empty()) {
                self.settings_stale.store(true, Ordering::SeqCst);
            }
        }
        self.axes[index].facts().check_motion(&self.name)
    }

    async fn told_anew(&self) -> Result<Told, DeviceError> {
        // A start that comes in between is not waited out: whoever polls waits for this.
        let asker = Asker { port: &self.port, name: &self.name, dialect: self.dialect, patience: Duration::ZERO };
        let before = locked(&self.told).clone();
        match before {
            Told::Settings { settings, dialect, zero, single } => {
                let settings = asker.settings(Votes::after(&settings)).await?;
                if dialect != Dialect::GrblHal {
                    return Ok(Told::Settings { settings, dialect, zero, single });
                }
                // What Grbl is built with is one of its settings ($22).
                let options = asker.ask(grbl::BUILD_INFO, ANSWER).await?;
                Ok(Told::built(settings, dialect, &options.lines))
            }
            Told::Tree(tree, letters) => Ok(Told::Tree(asker.tree(Twice::after(tree)).await?, letters)),
        }
    }

    /// Where to home one axis is to home the other, what contradicts one keeps both from moving.
    pub(super) fn share_contradictions(&self) {
        if self.homes_single_axes() {
            return;
        }
        let all: Vec<String> = self.axes.iter().flat_map(|axis| axis.facts().contradictions).collect();
        for axis in &self.axes {
            locked(&axis.facts).contradictions.clone_from(&all);
        }
    }
}
