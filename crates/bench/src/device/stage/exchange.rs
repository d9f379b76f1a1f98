//! What the dialogues of the polled protocols share: asking with a second try, errors in the words of the bench.

use std::fmt::Debug;
use std::time::Duration;

use tokio::sync::mpsc;

use super::strangers;
use crate::device::DeviceError;
use crate::device::port::{Answer, Kind, Notice, Port, PortError};

/// Longest wait for an answer.
pub const ANSWER: Duration = Duration::from_millis(500);
/// Tries of a first question: the rest of what an earlier program wrote may spoil the first.
const TRIES: u32 = 3;

/// A port and the question that brings it back into step.
pub struct Exchange<M> {
    /// The controller's name, for errors.
    pub name: String,
    /// Its port.
    pub port: Port<M>,
    /// A question whose answer can be no other's, where late answers can be taken for others.
    pub resync: Option<Vec<u8>>,
    /// A refusal in words.
    pub meaning: fn(&str) -> String,
}

impl<M: Clone + Debug + Send + 'static> Exchange<M> {
    /// An error of the port in the words of the bench.
    pub fn error(&self, what: &str, error: PortError) -> DeviceError {
        let device = self.name.clone();
        match error {
            PortError::Closed(reason) => DeviceError::Disconnected { device, reason },
            PortError::Timeout(allowed) => DeviceError::Timeout { device, what: what.to_owned(), allowed },
            PortError::Refused(words) => DeviceError::Refused { device, reason: (self.meaning)(&words) },
            other => DeviceError::Refused { device, reason: other.to_string() },
        }
    }

    /// Brings the port back into step, if it has to be.
    async fn back_in_step(&self) -> Result<(), PortError> {
        match &self.resync {
            Some(question) => self.port.resynchronise(question.clone(), ANSWER).await.map(|_| ()),
            None => Ok(()),
        }
    }

    /// Asks, once more if no answer came.
    ///
    /// # Errors
    /// As the port has them, in the words of the bench.
    pub async fn ask(&self, what: &str, bytes: impl Into<Vec<u8>>) -> Result<Answer<M>, DeviceError> {
        self.ask_again(what, bytes, None).await
    }

    /// Asks, once more if no answer came, and before that another question, where the first one's answer may come behind
    /// that of the question that brought the port back into step.
    ///
    /// # Errors
    /// As the port has them, in the words of the bench.
    pub async fn ask_again(
        &self,
        what: &str,
        bytes: impl Into<Vec<u8>>,
        between: Option<Vec<u8>>,
    ) -> Result<Answer<M>, DeviceError> {
        let bytes = bytes.into();
        let answer = match self.port.ask(bytes.clone(), ANSWER).await {
            Err(PortError::Timeout(_) | PortError::OutOfStep | PortError::Cancelled) => {
                let again = async {
                    self.back_in_step().await?;
                    if let Some(between) = between {
                        self.port.ask(between, ANSWER).await?;
                    }
                    self.port.ask(bytes, ANSWER).await
                };
                again.await
            }
            other => other,
        };
        answer.map_err(|error| self.error(what, error))
    }

    /// Commands, once: whether a command without an answer was carried out is not known.
    ///
    /// # Errors
    /// As the port has them, in the words of the bench.
    pub async fn command(
        &self,
        what: &str,
        bytes: impl Into<Vec<u8>>,
        generation: u64,
    ) -> Result<Answer<M>, DeviceError> {
        let bytes = bytes.into();
        let answer = match self.port.request(bytes.clone(), ANSWER, generation).await {
            // It was not written: an earlier question had no answer.
            Err(PortError::OutOfStep) => match self.back_in_step().await {
                Ok(()) => self.port.request(bytes, ANSWER, generation).await,
                Err(error) => Err(error),
            },
            other => other,
        };
        answer.map_err(|error| self.error(what, error))
    }

    /// Asks the first question: what the controller is. Says what was heard where no answer came.
    ///
    /// # Errors
    /// [`DeviceError::WrongDevice`] when something else was heard, [`DeviceError::Timeout`] when nothing was.
    pub async fn identify(
        &self,
        expected: &str,
        question: &[u8],
        notices: &mut mpsc::Receiver<Notice<M>>,
        text: impl Fn(&M) -> String,
    ) -> Result<Answer<M>, DeviceError> {
        let mut heard: Option<String> = None;
        for _ in 0..TRIES {
            match self.port.resynchronise(question.to_vec(), ANSWER).await {
                Ok(answer) => return Ok(answer),
                Err(PortError::Timeout(_) | PortError::OutOfStep) => {}
                Err(error) => return Err(self.error("say what it is", error)),
            }
            while let Ok(notice) = notices.try_recv() {
                if notice.kind == Kind::Noise && heard.is_none() {
                    heard = Some(text(&notice.line).chars().take(60).collect());
                }
            }
        }
        Err(match heard {
            Some(words) => DeviceError::WrongDevice {
                device: self.name.clone(),
                expected: expected.to_owned(),
                found: strangers::something(&words),
            },
            None => DeviceError::Timeout {
                device: self.name.clone(),
                what: "say what it is".to_owned(),
                allowed: TRIES * ANSWER,
            },
        })
    }

    /// An answer that makes no sense.
    pub fn senseless(&self, detail: impl Into<String>) -> DeviceError {
        DeviceError::Protocol { device: self.name.clone(), detail: detail.into() }
    }

    /// Reads and forgets what the controller says by itself, for as long as the port is open.
    pub fn drain(mut notices: mpsc::Receiver<Notice<M>>) {
        tokio::spawn(async move { while notices.recv().await.is_some() {} });
    }
}
