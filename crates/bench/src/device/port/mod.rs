//! The owner task of one serial port, and the handle in front of it.
//!
//! The task alone reads and writes the port. A request is answered by messages up to an end; the next request is written
//! only when the one before has ended, whether or not its caller still waits, so that dropping a caller's future never
//! cuts a command from its reply. Urgent bytes (a stop) pass every queue; where the protocol picks such bytes out of the
//! stream they may land in the middle of a line, elsewhere they wait for the end of the message being written. Nothing
//! is ever flushed, because draining a serial port blocks the thread.
//!
//! ```text
//!   callers --request--> queue --\                      /--> answer to the request under way
//!                                 owner task <--> device
//!   callers --urgent bytes-------/                      \--> notices (reports, alarms, start-up), numbered
//! ```

mod lines;
mod owner;
mod received;
#[cfg(test)]
mod tests;

use std::fmt::Debug;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::{mpsc, oneshot, watch};

pub use lines::LineBuffer;
use owner::Owner;
pub use received::Received;

/// Most messages kept of one answer.
const MOST_PARTS: usize = 1024;

/// What a message means to the port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Part of the answer to the request under way.
    Data,
    /// Part of the answer, and its end.
    Last,
    /// End of the answer: done.
    Done,
    /// End of the answer: refused.
    Refused,
    /// The device has stopped taking requests until it is reset; the request under way gets no answer.
    Halted,
    /// The device has started anew: nothing is under way, requests are taken again.
    Started,
    /// Something that the device says by itself.
    Notice,
    /// Nothing the protocol knows, or nothing that answers the request under way.
    Noise,
}

/// How a port goes on after a request without an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Recovery {
    /// Answers say which request they belong to: late ones do no harm.
    None,
    /// A late answer would be taken for the next request's: nothing is asked until the device has started anew or
    /// [`Port::resynchronise`] has brought it into step.
    Required,
}

/// A protocol: how bytes make messages, and what those mean.
pub trait Protocol: Send + 'static {
    /// A whole message.
    type Message: Clone + Debug + Send + 'static;
    /// How the port goes on after a time-out.
    const RECOVERY: Recovery;
    /// Whether urgent bytes may be written in the middle of a request.
    const URGENT_ANYWHERE: bool;

    /// Takes bytes, in whatever fragments, and returns the messages that they complete. Keeps a bounded rest.
    fn frame(&mut self, bytes: &[u8]) -> Vec<Self::Message>;

    /// Forgets an unfinished message: it will not be continued.
    fn gap(&mut self) {}

    /// Tells what a message means, given the bytes of the request under way.
    fn classify(&self, message: &Self::Message, request: Option<&[u8]>) -> Kind;

    /// A message in words, for logs and errors.
    fn text(&self, message: &Self::Message) -> String;
}

/// Why a request did not get its answer.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PortError {
    /// The port is gone.
    #[error("{0}")]
    Closed(String),
    /// No end of the answer in time.
    #[error("no answer within {0:?}")]
    Timeout(Duration),
    /// Refused: the device's own words.
    #[error("{0}")]
    Refused(String),
    /// The device halted: its own words.
    #[error("{0}")]
    Halted(String),
    /// The device started anew before it answered.
    #[error("the controller was reset before it answered")]
    Restarted,
    /// A stop came before the request was written.
    #[error("a stop came first")]
    Cancelled,
    /// An earlier request has no end yet; a reset is needed.
    #[error("an earlier request was never answered; the controller has to be reset first")]
    OutOfStep,
}

/// The answer to a request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Answer<M = String> {
    /// Messages before the end (and with it, where the end says something).
    pub lines: Vec<M>,
    /// Number of the message that ended it: notices with a greater number came later.
    pub line_number: u64,
}

/// A message that the device sent by itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Notice<M = String> {
    /// What it means.
    pub kind: Kind,
    /// The message.
    pub line: M,
    /// Its number.
    pub line_number: u64,
}

struct Request<M> {
    bytes: Vec<u8>,
    allowed: Duration,
    /// `None` for a question, which no stop makes outdated.
    generation: Option<u64>,
    resync: bool,
    reply: oneshot::Sender<Result<Answer<M>, PortError>>,
}

struct Urgent {
    bytes: Vec<u8>,
    restart_expected: bool,
    written: oneshot::Sender<()>,
}

/// The handle in front of a port's owner task. The port closes when every handle is dropped.
#[derive(Debug)]
pub struct Port<M = String> {
    requests: mpsc::Sender<Request<M>>,
    urgent: mpsc::Sender<Urgent>,
    close: Arc<watch::Sender<Option<String>>>,
    closed: watch::Receiver<Option<String>>,
    generation: Arc<AtomicU64>,
    received: Arc<Mutex<Received>>,
}

impl<M> Clone for Port<M> {
    fn clone(&self) -> Self {
        Self {
            requests: self.requests.clone(),
            urgent: self.urgent.clone(),
            close: Arc::clone(&self.close),
            closed: self.closed.clone(),
            generation: Arc::clone(&self.generation),
            received: Arc::clone(&self.received),
        }
    }
}

impl<M: Clone + Debug + Send + 'static> Port<M> {
    /// Starts the owner task of a port. Commands carry the generation at which they were given; those of an older one
    /// than `generation` has are refused as cancelled instead of being written. Must be called within a tokio runtime.
    ///
    /// Notices arrive on the receiver returned; when it is full the oldest unread are kept and new ones dropped.
    pub fn start<T, P>(io: T, protocol: P, generation: Arc<AtomicU64>) -> (Self, mpsc::Receiver<Notice<M>>)
    where
        T: AsyncRead + AsyncWrite + Send + Unpin + 'static,
        P: Protocol<Message = M>,
    {
        let (requests, request_queue) = mpsc::channel(16);
        let (urgent, urgent_queue) = mpsc::channel(64);
        let (notices, notice_queue) = mpsc::channel(256);
        let (close, close_asked) = watch::channel(None);
        let (closing, closed) = watch::channel(None);
        let received: Arc<Mutex<Received>> = Arc::default();
        let owner = Owner::new(protocol, notices, Arc::clone(&generation), Arc::clone(&received));
        tokio::spawn(async move {
            let reason = owner.run(io, request_queue, urgent_queue, close_asked).await;
            closing.send_replace(Some(reason));
        });
        (Self { requests, urgent, close: Arc::new(close), closed, generation, received }, notice_queue)
    }

    /// The number that a command given now should carry.
    #[must_use]
    pub fn generation(&self) -> u64 {
        self.generation.load(Ordering::SeqCst)
    }

    /// Sends a command of `generation` and waits for its answer.
    ///
    /// # Errors
    /// See [`PortError`].
    pub async fn request(
        &self,
        bytes: impl Into<Vec<u8>>,
        allowed: Duration,
        generation: u64,
    ) -> Result<Answer<M>, PortError> {
        self.send(bytes.into(), allowed, Some(generation), false).await
    }

    /// Asks something that moves nothing, which no stop makes outdated.
    ///
    /// # Errors
    /// See [`PortError`].
    pub async fn ask(&self, bytes: impl Into<Vec<u8>>, allowed: Duration) -> Result<Answer<M>, PortError> {
        self.send(bytes.into(), allowed, None, false).await
    }

    /// Asks something whose answer can be no other's, however late others come: with it the port is in step again.
    ///
    /// # Errors
    /// See [`PortError`].
    pub async fn resynchronise(&self, bytes: impl Into<Vec<u8>>, allowed: Duration) -> Result<Answer<M>, PortError> {
        self.send(bytes.into(), allowed, None, true).await
    }

    async fn send(
        &self,
        bytes: Vec<u8>,
        allowed: Duration,
        generation: Option<u64>,
        resync: bool,
    ) -> Result<Answer<M>, PortError> {
        let (reply, answer) = oneshot::channel();
        let request = Request { bytes, allowed, generation, resync, reply };
        if self.requests.send(request).await.is_err() {
            return Err(self.closed_error());
        }
        answer.await.unwrap_or_else(|_| Err(self.closed_error()))
    }

    /// Sends bytes past every queue. The receiver is told when they have been handed to the operating system.
    ///
    /// `restart_expected` says that the bytes restart the device, so that the port waits for that before it writes
    /// anything else.
    ///
    /// # Errors
    /// When the port is gone, or takes no bytes any more.
    pub fn urgent(&self, bytes: &[u8], restart_expected: bool) -> Result<oneshot::Receiver<()>, PortError> {
        let (written, receiver) = oneshot::channel();
        match self.urgent.try_send(Urgent { bytes: bytes.to_vec(), restart_expected, written }) {
            Ok(()) => Ok(receiver),
            Err(mpsc::error::TrySendError::Full(_)) => Err(PortError::Closed("the port takes no bytes".to_owned())),
            Err(mpsc::error::TrySendError::Closed(_)) => Err(self.closed_error()),
        }
    }

    /// Closes the port for every holder of a handle.
    pub fn close(&self, reason: &str) {
        self.close.send_modify(|asked| {
            asked.get_or_insert_with(|| reason.to_owned());
        });
    }

    /// Why the port is closed, once it is.
    #[must_use]
    pub fn closed(&self) -> watch::Receiver<Option<String>> {
        self.closed.clone()
    }

    /// What has come in since the port was opened, whether or not it made sense.
    #[must_use]
    pub fn received(&self) -> Received {
        self.received.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn closed_error(&self) -> PortError {
        PortError::Closed(self.closed.borrow().clone().unwrap_or_else(|| "the port is closed".to_owned()))
    }
}
