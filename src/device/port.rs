//! The owner task of one serial port, and the handle in front of it.
//!
//! The task alone reads and writes the port. A request is a line that the device answers with lines and an end; the
//! next request is written only when the one before has ended, whether or not its caller still waits, so that dropping
//! a caller's future never cuts a command from its reply. Urgent bytes (a stop) pass every queue and may land in the
//! middle of a line: they are for protocols that pick such bytes out of the stream. Nothing is ever flushed, because
//! draining a serial port blocks the thread.
//!
//! ```text
//!   callers --request--> queue --\                      /--> answer to the request under way
//!                                 owner task <--> device
//!   callers --urgent bytes-------/                      \--> notices (reports, alarms, start-up), numbered
//! ```

use std::collections::VecDeque;
use std::io::ErrorKind;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::Instant;
use tokio_serial::{SerialPortBuilderExt, SerialStream};

use super::DeviceError;

/// Longest line taken; anything longer is noise and dropped up to the next line end.
const LONGEST_LINE: usize = 512;

/// What a line means to the port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineKind {
    /// Part of the answer to the request under way.
    Data,
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
    /// Nothing the protocol knows.
    Noise,
}

/// A protocol of lines.
pub trait LineProtocol: Send + 'static {
    /// Tells what a line means.
    fn classify(&self, line: &str) -> LineKind;
}

/// Why a request did not get its answer.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PortError {
    /// The port is gone.
    #[error("{0}")]
    Closed(String),
    /// No end of the answer in time; the device has to be reset before it is asked again.
    #[error("no answer within {0:?}")]
    Timeout(Duration),
    /// Refused: the device's own line.
    #[error("{0}")]
    Refused(String),
    /// The device halted: its own line.
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
pub struct Answer {
    /// Lines before the end.
    pub lines: Vec<String>,
    /// Number of the line that ended it: notices with a greater number came later.
    pub line_number: u64,
}

/// A line that the device sent by itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Notice {
    /// What it means.
    pub kind: LineKind,
    /// The line.
    pub line: String,
    /// Its number.
    pub line_number: u64,
}

struct Request {
    bytes: Vec<u8>,
    allowed: Duration,
    generation: u64,
    reply: oneshot::Sender<Result<Answer, PortError>>,
}

struct Urgent {
    bytes: Vec<u8>,
    restart_expected: bool,
    written: oneshot::Sender<()>,
}

/// The handle in front of a port's owner task. The port closes when every handle is dropped.
#[derive(Clone)]
pub struct Port {
    requests: mpsc::Sender<Request>,
    urgent: mpsc::Sender<Urgent>,
    closed: watch::Receiver<Option<String>>,
    generation: Arc<AtomicU64>,
}

impl Port {
    /// Starts the owner task of a port. Must be called within a tokio runtime.
    ///
    /// Notices arrive on the receiver returned; when it is full the oldest unread are kept and new ones dropped.
    pub fn start<T, P>(io: T, protocol: P) -> (Self, mpsc::Receiver<Notice>)
    where
        T: AsyncRead + AsyncWrite + Send + Unpin + 'static,
        P: LineProtocol,
    {
        let (requests, request_queue) = mpsc::channel(16);
        let (urgent, urgent_queue) = mpsc::channel(64);
        let (notices, notice_queue) = mpsc::channel(256);
        let (close, closed) = watch::channel(None);
        let generation = Arc::new(AtomicU64::new(0));
        let owner = Owner {
            protocol,
            notices,
            generation: Arc::clone(&generation),
            lines: LineBuffer::default(),
            line_number: 0,
            pending: None,
            in_step: true,
            out: VecDeque::new(),
            urgent_left: 0,
            urgent_acks: Vec::new(),
        };
        tokio::spawn(async move {
            let reason = owner.run(io, request_queue, urgent_queue).await;
            close.send_replace(Some(reason));
        });
        (Self { requests, urgent, closed, generation }, notice_queue)
    }

    /// The number that a request made now should carry: [`Port::cancel_requests`] makes it outdated.
    #[must_use]
    pub fn generation(&self) -> u64 {
        self.generation.load(Ordering::SeqCst)
    }

    /// Makes every request with the present generation, queued or still to come, fail as cancelled instead of being
    /// written. Call it before the urgent bytes of a stop.
    pub fn cancel_requests(&self) {
        self.generation.fetch_add(1, Ordering::SeqCst);
    }

    /// Sends a request of `generation` and waits for its answer.
    ///
    /// # Errors
    /// See [`PortError`].
    pub async fn request(
        &self,
        bytes: impl Into<Vec<u8>>,
        allowed: Duration,
        generation: u64,
    ) -> Result<Answer, PortError> {
        let (reply, answer) = oneshot::channel();
        let request = Request { bytes: bytes.into(), allowed, generation, reply };
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

    /// Why the port is closed, once it is.
    #[must_use]
    pub fn closed(&self) -> watch::Receiver<Option<String>> {
        self.closed.clone()
    }

    fn closed_error(&self) -> PortError {
        PortError::Closed(self.closed.borrow().clone().unwrap_or_else(|| "the port is closed".to_owned()))
    }
}

struct Pending {
    lines: Vec<String>,
    allowed: Duration,
    deadline: Instant,
    reply: oneshot::Sender<Result<Answer, PortError>>,
}

struct Owner<P> {
    protocol: P,
    notices: mpsc::Sender<Notice>,
    generation: Arc<AtomicU64>,
    lines: LineBuffer,
    line_number: u64,
    pending: Option<Pending>,
    in_step: bool,
    out: VecDeque<u8>,
    /// How many bytes at the front of `out` are urgent.
    urgent_left: usize,
    urgent_acks: Vec<oneshot::Sender<()>>,
}

impl<P: LineProtocol> Owner<P> {
    /// Runs until the port or every handle is gone, and says why it ended.
    async fn run<T>(
        mut self,
        io: T,
        mut requests: mpsc::Receiver<Request>,
        mut urgent: mpsc::Receiver<Urgent>,
    ) -> String
    where
        T: AsyncRead + AsyncWrite + Send + Unpin + 'static,
    {
        let (mut reader, mut writer) = tokio::io::split(io);
        let mut buffer = [0u8; 1024];
        let reason = loop {
            let deadline = self.pending.as_ref().map(|pending| pending.deadline);
            let front: Vec<u8> = self.out.iter().copied().take(64).collect();
            tokio::select! {
                biased;
                message = urgent.recv() => match message {
                    Some(message) => self.take_urgent(message),
                    None => break "closed by its users".to_owned(),
                },
                read = reader.read(&mut buffer) => match read {
                    // A serial port whose device is gone reads as end of file, for ever.
                    Ok(0) => break "the connection was closed at the other end".to_owned(),
                    Ok(count) => self.take_bytes(&buffer[..count]),
                    Err(error) if error.kind() == ErrorKind::Interrupted => {}
                    Err(error) => break format!("reading failed: {error}"),
                },
                wrote = writer.write(&front), if !front.is_empty() => match wrote {
                    Ok(0) => break "the connection takes no more bytes".to_owned(),
                    Ok(count) => self.written(count),
                    Err(error) if error.kind() == ErrorKind::Interrupted => {}
                    Err(error) => break format!("writing failed: {error}"),
                },
                request = requests.recv(), if self.pending.is_none() && self.out.is_empty() => match request {
                    Some(request) => self.take_request(request),
                    None => break "closed by its users".to_owned(),
                },
                () = sleep_until(deadline), if deadline.is_some() => self.time_out(),
            }
        };
        if let Some(pending) = self.pending.take() {
            let _ = pending.reply.send(Err(PortError::Closed(reason.clone())));
        }
        // Requests that still wait learn the reason, too.
        requests.close();
        while let Some(request) = requests.recv().await {
            let _ = request.reply.send(Err(PortError::Closed(reason.clone())));
        }
        reason
    }

    fn take_urgent(&mut self, message: Urgent) {
        if message.restart_expected {
            // What is still unsent of the request under way would be read as a line of the restarted device's.
            self.out.truncate(self.urgent_left);
            self.end_pending(Err(PortError::Restarted));
            self.in_step = false;
        }
        for (offset, &byte) in message.bytes.iter().enumerate() {
            self.out.insert(self.urgent_left + offset, byte);
        }
        self.urgent_left += message.bytes.len();
        self.urgent_acks.push(message.written);
    }

    fn take_request(&mut self, request: Request) {
        if request.generation != self.generation.load(Ordering::SeqCst) {
            let _ = request.reply.send(Err(PortError::Cancelled));
        } else if !self.in_step {
            let _ = request.reply.send(Err(PortError::OutOfStep));
        } else {
            self.out.extend(request.bytes);
            self.pending = Some(Pending {
                lines: Vec::new(),
                allowed: request.allowed,
                deadline: Instant::now() + request.allowed,
                reply: request.reply,
            });
        }
    }

    fn written(&mut self, count: usize) {
        self.out.drain(..count);
        self.urgent_left = self.urgent_left.saturating_sub(count);
        if self.urgent_left == 0 {
            for ack in self.urgent_acks.drain(..) {
                let _ = ack.send(());
            }
        }
    }

    fn take_bytes(&mut self, bytes: &[u8]) {
        for line in self.lines.push(bytes) {
            self.line_number += 1;
            let kind = self.protocol.classify(&line);
            match kind {
                LineKind::Data => {
                    if let Some(pending) = &mut self.pending {
                        // A device that never ends its answer is bounded by the deadline and by this.
                        if pending.lines.len() < 1024 {
                            pending.lines.push(line.clone());
                        }
                    }
                    self.notify(kind, line);
                }
                LineKind::Done => self.end_pending(Ok(())),
                LineKind::Refused => self.end_pending(Err(PortError::Refused(line))),
                LineKind::Halted => {
                    self.in_step = false;
                    self.end_pending(Err(PortError::Halted(line.clone())));
                    self.notify(kind, line);
                }
                LineKind::Started => {
                    self.end_pending(Err(PortError::Restarted));
                    self.in_step = true;
                    self.notify(kind, line);
                }
                LineKind::Notice => self.notify(kind, line),
                LineKind::Noise => {
                    tracing::debug!(line = %line, "a line on a serial port is not understood");
                    self.notify(kind, line);
                }
            }
        }
    }

    fn notify(&self, kind: LineKind, line: String) {
        if self.notices.try_send(Notice { kind, line, line_number: self.line_number }).is_err() {
            tracing::debug!("a notice from a serial port was dropped: nobody reads them");
        }
    }

    fn end_pending(&mut self, result: Result<(), PortError>) {
        if let Some(pending) = self.pending.take() {
            let answer = result.map(|()| Answer { lines: pending.lines, line_number: self.line_number });
            let _ = pending.reply.send(answer);
        }
    }

    fn time_out(&mut self) {
        if let Some(allowed) = self.pending.as_ref().map(|pending| pending.allowed) {
            // A late end would be taken for the next request's.
            self.in_step = false;
            self.out.truncate(self.urgent_left);
            self.end_pending(Err(PortError::Timeout(allowed)));
        }
    }
}

async fn sleep_until(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => tokio::time::sleep_until(deadline).await,
        None => std::future::pending().await,
    }
}

/// Cuts a stream of bytes into lines, whatever the fragments it comes in.
#[derive(Debug, Default)]
pub struct LineBuffer {
    line: Vec<u8>,
    overlong: bool,
}

impl LineBuffer {
    /// Takes bytes and returns the lines they complete, without line ends and blank lines. A line longer than the
    /// bound is dropped whole; bytes that are not text become U+FFFD.
    pub fn push(&mut self, bytes: &[u8]) -> Vec<String> {
        let mut lines = Vec::new();
        for &byte in bytes {
            if byte == b'\n' || byte == b'\r' {
                if !self.overlong && !self.line.is_empty() {
                    lines.push(String::from_utf8_lossy(&self.line).into_owned());
                }
                self.line.clear();
                self.overlong = false;
            } else if self.line.len() < LONGEST_LINE {
                self.line.push(byte);
            } else {
                self.overlong = true;
            }
        }
        lines
    }
}

/// Opens a serial port, 8 data bits, no parity, one stop bit.
///
/// # Errors
/// [`DeviceError::Busy`] when another program holds it, [`DeviceError::Disconnected`] when it is not there or cannot be
/// opened.
pub fn open_serial(device: &str, path: &Path, baud: u32) -> Result<SerialStream, DeviceError> {
    tokio_serial::new(path.to_string_lossy(), baud).open_native_async().map_err(|error| match error.kind() {
        // The crate says so when the exclusive lock is taken, not when there is no device.
        tokio_serial::ErrorKind::NoDevice => {
            DeviceError::Busy { device: device.to_owned(), reason: format!("{}: {error}", path.display()) }
        }
        tokio_serial::ErrorKind::Io(ErrorKind::NotFound) => DeviceError::Disconnected {
            device: device.to_owned(),
            reason: format!("there is no {}; connect it, or correct its `port`", path.display()),
        },
        _ => DeviceError::Disconnected {
            device: device.to_owned(),
            reason: format!("{} cannot be opened: {error}", path.display()),
        },
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use tokio::io::duplex;

    use super::*;

    /// `ok` ends, `no` refuses, `!` halts, `hello` starts, `*` is a notice.
    struct Plain;

    impl LineProtocol for Plain {
        fn classify(&self, line: &str) -> LineKind {
            match line {
                "ok" => LineKind::Done,
                "no" => LineKind::Refused,
                "!" => LineKind::Halted,
                "hello" => LineKind::Started,
                "*" => LineKind::Notice,
                _ => LineKind::Data,
            }
        }
    }

    const SECOND: Duration = Duration::from_secs(1);

    #[tokio::test(start_paused = true)]
    async fn a_dropped_caller_does_not_cut_a_command_from_its_reply() {
        let (near, mut far) = duplex(256);
        let (port, _notices) = Port::start(near, Plain);
        {
            let first = port.request("first\n", SECOND, 0);
            assert!(tokio::time::timeout(Duration::from_millis(10), first).await.is_err());
        }
        let second = tokio::spawn({
            let port = port.clone();
            async move { port.request("second\n", SECOND, 0).await }
        });
        let mut buffer = [0u8; 64];
        let count = far.read(&mut buffer).await.unwrap();
        assert_eq!(&buffer[..count], b"first\n", "the second is written only after the first's end");
        far.write_all(b"one\r\nok\r\n").await.unwrap();
        let count = far.read(&mut buffer).await.unwrap();
        assert_eq!(&buffer[..count], b"second\n");
        far.write_all(b"tw").await.unwrap();
        far.write_all(b"o\r\nok\r\n").await.unwrap();
        assert_eq!(second.await.unwrap().unwrap().lines, ["two"]);
    }

    #[tokio::test(start_paused = true)]
    async fn urgent_bytes_pass_the_queue_and_a_stop_cancels_what_waits() {
        let (near, mut far) = duplex(256);
        let (port, mut notices) = Port::start(near, Plain);
        let first = tokio::spawn({
            let port = port.clone();
            async move { port.request("first\n", SECOND, 0).await }
        });
        tokio::time::sleep(Duration::from_millis(1)).await;
        let second = tokio::spawn({
            let port = port.clone();
            async move { port.request("second\n", SECOND, 0).await }
        });
        tokio::time::sleep(Duration::from_millis(1)).await;
        port.cancel_requests();
        port.urgent(b"\x85", false).unwrap().await.unwrap();
        far.write_all(b"*\nok\n").await.unwrap();
        assert!(first.await.unwrap().is_ok());
        assert_eq!(second.await.unwrap(), Err(PortError::Cancelled));
        let mut buffer = [0u8; 64];
        let count = far.read(&mut buffer).await.unwrap();
        assert_eq!(&buffer[..count], b"first\n\x85");
        assert_eq!(notices.recv().await.unwrap().line, "*");
    }

    #[tokio::test(start_paused = true)]
    async fn after_a_timeout_nothing_is_asked_until_the_device_starts_anew() {
        let (near, mut far) = duplex(256);
        let (port, _notices) = Port::start(near, Plain);
        assert_eq!(port.request("a\n", SECOND, 0).await, Err(PortError::Timeout(SECOND)));
        assert_eq!(port.request("b\n", SECOND, 0).await, Err(PortError::OutOfStep));
        far.write_all(b"ok\nhello\n").await.unwrap();
        tokio::time::sleep(Duration::from_millis(1)).await;
        let third = tokio::spawn({
            let port = port.clone();
            async move { port.request("c\n", SECOND, 0).await }
        });
        let mut buffer = [0u8; 64];
        let count = far.read(&mut buffer).await.unwrap();
        assert_eq!(&buffer[..count], b"a\n");
        let count = far.read(&mut buffer).await.unwrap();
        assert_eq!(&buffer[..count], b"c\n");
        far.write_all(b"no\n").await.unwrap();
        assert_eq!(third.await.unwrap(), Err(PortError::Refused("no".to_owned())));
    }

    #[tokio::test(start_paused = true)]
    async fn end_of_file_closes_the_port_and_says_so() {
        let (near, far) = duplex(256);
        let (port, _notices) = Port::start(near, Plain);
        let waiting = tokio::spawn({
            let port = port.clone();
            async move { port.request("a\n", SECOND, 0).await }
        });
        tokio::time::sleep(Duration::from_millis(1)).await;
        drop(far);
        assert!(matches!(waiting.await.unwrap(), Err(PortError::Closed(_))));
        let mut closed = port.closed();
        closed.wait_for(Option::is_some).await.unwrap();
        assert!(matches!(port.request("b\n", SECOND, 0).await, Err(PortError::Closed(_))));
        assert!(port.urgent(b"!", false).is_err());
    }

    #[test]
    fn a_missing_port_is_told_from_a_busy_one() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let _guard = runtime.enter();
        let error = open_serial("controller `main`", Path::new("/dev/does-not-exist"), 115_200).unwrap_err();
        assert!(matches!(error, DeviceError::Disconnected { .. }), "{error}");
        assert!(error.to_string().contains("/dev/does-not-exist"));
    }

    proptest! {
        #[test]
        fn lines_do_not_depend_on_fragments(bytes in proptest::collection::vec(any::<u8>(), 0..2000), cut in 1usize..50) {
            let whole = LineBuffer::default().push(&bytes);
            let mut buffer = LineBuffer::default();
            let pieces: Vec<String> = bytes.chunks(cut).flat_map(|piece| buffer.push(piece)).collect();
            prop_assert_eq!(&whole, &pieces);
            prop_assert!(whole.iter().all(|line| !line.is_empty() && line.chars().count() <= LONGEST_LINE));
        }

        #[test]
        fn noise_costs_at_most_the_line_it_is_in(noise in proptest::collection::vec(any::<u8>(), 0..2000)) {
            let mut buffer = LineBuffer::default();
            buffer.push(&noise);
            buffer.push(b"\r\n");
            prop_assert_eq!(buffer.push(b"ok\r\n"), vec!["ok".to_owned()]);
        }
    }
}
