//! A controller's settings read again: whoever shares its port may have changed them.

use std::sync::atomic::Ordering;

use super::super::grbl::{self, Dialect, Settings, Tree, Votes};
use super::told::Told;
use super::{ANSWER, Controller, DUMPED, POLL_MOVING, locked};
use crate::device::{AxisName, DeviceError};

/// How often the settings are asked for where not all are told.
const TRIES: usize = 6;

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
            // What contradicts is asked for until it was told twice alike: it may have been damaged on its way.
            if self.axes.iter().any(|axis| !axis.facts().contradictions.is_empty()) {
                self.settings_stale.store(true, Ordering::SeqCst);
            }
        }
        self.axes[index].facts().check_motion(&self.name)
    }

    async fn told_anew(&self) -> Result<Told, DeviceError> {
        let before = locked(&self.told).clone();
        match before {
            Told::Settings { settings, dialect: Dialect::GrblHal, .. } => {
                let settings = self.told_settings(&settings).await?;
                // What Grbl is built with is one of its settings ($22).
                let answer = self.port.ask(grbl::BUILD_INFO, ANSWER).await;
                let options = answer.map_err(|error| self.device_error("tell its options", error))?;
                Ok(Told::built(settings, Dialect::GrblHal, &options.lines))
            }
            Told::Settings { settings, dialect, zero, single } => {
                Ok(Told::Settings { settings: self.told_settings(&settings).await?, dialect, zero, single })
            }
            Told::Tree(tree, letters) => Ok(Told::Tree(self.told_tree(tree).await?, letters)),
        }
    }

    /// Every setting, told twice alike: the ones from before count. Where another's answer ends this question, what it was
    /// answered comes later.
    async fn told_settings(&self, before: &Settings) -> Result<Settings, DeviceError> {
        let mut votes = Votes::default();
        votes.told(before);
        for _ in 0..TRIES {
            let answer = self.port.ask(grbl::SETTINGS, ANSWER).await;
            let answer = answer.map_err(|error| self.device_error("tell its settings", error))?;
            if let Some(told) = votes.told(&Settings::from_lines(&answer.lines)) {
                return Ok(told);
            }
            tokio::time::sleep(POLL_MOVING).await;
        }
        let detail = "it does not tell every setting twice alike; does another program command it?".to_owned();
        Err(DeviceError::Protocol { device: self.name.clone(), detail })
    }

    /// The configuration, told twice alike: the one from before counts.
    async fn told_tree(&self, before: Tree) -> Result<Tree, DeviceError> {
        let mut twice = Twice { last: Some(before), wrong: None };
        for _ in 0..=TRIES {
            let answer = self.port.ask(grbl::DUMP, DUMPED).await;
            let answer = answer.map_err(|error| self.device_error("tell its configuration", error))?;
            if let Some(tree) = twice.told(&answer.lines) {
                return Ok(tree);
            }
            tokio::time::sleep(POLL_MOVING).await;
        }
        Err(twice.error(&self.name))
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

/// A configuration that is believed once it was told twice alike. A line has no checksum, and a byte may come out wrong: what
/// decides the way that an axis goes to find its switch is not taken from one reading.
#[derive(Debug, Default)]
pub(super) struct Twice {
    last: Option<Tree>,
    wrong: Option<String>,
}

impl Twice {
    /// Takes a dump, and returns the configuration where it is the one of before.
    pub(super) fn told(&mut self, lines: &[String]) -> Option<Tree> {
        match Tree::from_lines(lines) {
            Ok(tree) if self.last.as_ref() == Some(&tree) => return Some(tree),
            Ok(tree) => self.last = Some(tree),
            Err(why) => self.wrong = Some(why),
        }
        None
    }

    /// That it was not told twice alike.
    pub(super) fn error(self, device: &str) -> DeviceError {
        let why = self.wrong.unwrap_or_else(|| "each time it told another".to_owned());
        let detail = format!("its configuration ($CD) was not told twice alike: {why}");
        DeviceError::Protocol { device: device.to_owned(), detail }
    }
}
