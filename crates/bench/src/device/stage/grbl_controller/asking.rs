//! Asking a controller what it is set to, until it was told twice alike.

use std::time::Duration;

use tokio::time::Instant;

use super::super::grbl::{self, Dialect, Settings, Tree, Votes};
use super::{ANSWER, DUMPED, POLL_MOVING, device_error};
use crate::device::DeviceError;
use crate::device::port::{Answer, Port, PortError};

/// How often it is asked what it is set to, until it tells that twice alike.
const TRIES: usize = 6;

/// Who asks.
#[derive(Clone, Copy)]
pub(super) struct Asker<'a> {
    pub(super) port: &'a Port,
    /// The controller's name, for errors.
    pub(super) name: &'a str,
    pub(super) dialect: Dialect,
    /// How long a start that comes in between is waited out: a board may start twice when its port is opened.
    pub(super) patience: Duration,
}

impl Asker<'_> {
    /// Asks.
    pub(super) async fn ask(&self, line: &[u8], allowed: Duration) -> Result<Answer, DeviceError> {
        let deadline = Instant::now() + self.patience;
        loop {
            match self.port.ask(line, allowed).await {
                Err(PortError::Restarted | PortError::OutOfStep) if Instant::now() < deadline => {
                    tokio::time::sleep(POLL_MOVING).await;
                }
                answer => {
                    let error = |error| device_error(self.name, self.dialect, "tell its settings", error);
                    return answer.map_err(error);
                }
            }
        }
    }

    /// The numbered settings. Where another's answer ends this question, what it was answered comes later.
    pub(super) async fn settings(&self, mut votes: Votes) -> Result<Settings, DeviceError> {
        let told =
            self.until_believed(grbl::SETTINGS, ANSWER, |lines| votes.told(&Settings::from_lines(lines))).await?;
        told.ok_or_else(|| {
            let detail = "its settings ($$) were not told twice alike; does another program command it?".to_owned();
            DeviceError::Protocol { device: self.name.to_owned(), detail }
        })
    }

    /// FluidNC's configuration.
    pub(super) async fn tree(&self, mut twice: Twice) -> Result<Tree, DeviceError> {
        let told = self.until_believed(grbl::DUMP, DUMPED, |lines| twice.told(lines)).await?;
        told.ok_or_else(|| twice.error(self.name))
    }

    /// Asks until `told` makes something of an answer; nothing where it never does.
    async fn until_believed<T>(
        &self,
        line: &[u8],
        allowed: Duration,
        mut told: impl FnMut(&[String]) -> Option<T>,
    ) -> Result<Option<T>, DeviceError> {
        for _ in 0..TRIES {
            let found = told(&self.ask(line, allowed).await?.lines);
            if found.is_some() {
                return Ok(found);
            }
            tokio::time::sleep(POLL_MOVING).await;
        }
        Ok(None)
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
    /// One that what was told before counts for.
    pub(super) const fn after(before: Tree) -> Self {
        Self { last: Some(before), wrong: None }
    }

    /// Takes a dump, and returns the configuration where it is the one of before.
    fn told(&mut self, lines: &[String]) -> Option<Tree> {
        match Tree::from_lines(lines) {
            Ok(tree) if self.last.as_ref() == Some(&tree) => return Some(tree),
            Ok(tree) => self.last = Some(tree),
            Err(why) => self.wrong = Some(why),
        }
        None
    }

    /// That it was not told twice alike.
    fn error(self, device: &str) -> DeviceError {
        let why = self.wrong.unwrap_or_else(|| "each time it told another".to_owned());
        let detail = format!("its configuration ($CD) was not told twice alike: {why}");
        DeviceError::Protocol { device: device.to_owned(), detail }
    }
}
