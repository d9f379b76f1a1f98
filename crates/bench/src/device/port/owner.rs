//! The task that owns a port.

use std::collections::VecDeque;
use std::io::ErrorKind;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::Instant;

use crate::telemetry;

use super::{Answer, Kind, MOST_PARTS, Notice, PortError, Protocol, Received, Recovery, Request, Urgent};

/// Silence after which the bytes of an unfinished message are not continued.
const GAP: Duration = Duration::from_millis(100);

struct Pending<M> {
    request: Vec<u8>,
    parts: Vec<M>,
    allowed: Duration,
    deadline: Instant,
    /// `None` of a question, which no stop makes outdated.
    generation: Option<u64>,
    resync: bool,
    asked: Instant,
    reply: oneshot::Sender<Result<Answer<M>, PortError>>,
}

/// What the task knows of its port.
pub(super) struct Owner<P: Protocol> {
    protocol: P,
    notices: mpsc::Sender<Notice<P::Message>>,
    generation: Arc<AtomicU64>,
    number: u64,
    pending: Option<Pending<P::Message>>,
    in_step: bool,
    /// Bytes to write: the rest of a request that has been begun, urgent bytes, a request not begun yet.
    out: VecDeque<u8>,
    /// How many bytes at the front of `out` are the rest of a request that must not be interrupted.
    begun: usize,
    /// How many bytes after those are urgent.
    urgent_left: usize,
    urgent_acks: Vec<oneshot::Sender<()>>,
    heard: Instant,
    received: Arc<Mutex<Received>>,
}

impl<P: Protocol> Owner<P> {
    pub(super) fn new(
        protocol: P,
        notices: mpsc::Sender<Notice<P::Message>>,
        generation: Arc<AtomicU64>,
        received: Arc<Mutex<Received>>,
    ) -> Self {
        Self {
            protocol,
            notices,
            generation,
            number: 0,
            pending: None,
            in_step: true,
            out: VecDeque::new(),
            begun: 0,
            urgent_left: 0,
            urgent_acks: Vec::new(),
            heard: Instant::now(),
            received,
        }
    }

    /// Runs until the port or every handle is gone, and says why it ended.
    pub(super) async fn run<T>(
        mut self,
        io: T,
        mut requests: mpsc::Receiver<Request<P::Message>>,
        mut urgent: mpsc::Receiver<Urgent>,
        mut close: watch::Receiver<Option<String>>,
    ) -> String
    where
        T: AsyncRead + AsyncWrite + Send + Unpin + 'static,
    {
        let (mut reader, mut writer) = tokio::io::split(io);
        let mut buffer = [0u8; 1024];
        let reason = loop {
            self.cancel_outdated();
            let deadline = self.pending.as_ref().map(|pending| pending.deadline);
            let front: Vec<u8> = self.out.iter().copied().take(64).collect();
            // Writing comes before reading: a device that never falls silent must not keep a stop from it.
            tokio::select! {
                biased;
                message = urgent.recv() => match message {
                    Some(message) => self.take_urgent(message),
                    None => break "closed by its users".to_owned(),
                },
                asked = close.wait_for(Option::is_some) => {
                    break asked.ok().and_then(|reason| reason.clone()).unwrap_or_else(|| "closed by its users".to_owned());
                }
                wrote = writer.write(&front), if !front.is_empty() => match wrote {
                    Ok(0) => break "the connection takes no more bytes".to_owned(),
                    Ok(count) => self.written(count),
                    Err(error) if error.kind() == ErrorKind::Interrupted => {}
                    Err(error) => break format!("writing failed: {error}"),
                },
                read = reader.read(&mut buffer) => match read {
                    // A serial port whose device is gone reads as end of file, for ever.
                    Ok(0) => break "the connection was closed at the other end".to_owned(),
                    Ok(count) => self.take_bytes(&buffer[..count]),
                    Err(error) if error.kind() == ErrorKind::Interrupted => {}
                    Err(error) => break format!("reading failed: {error}"),
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
            self.drop_unsent();
            self.end_pending(Err(PortError::Restarted));
            self.in_step = false;
        }
        self.cancel_outdated();
        let at = self.begun + self.urgent_left;
        for (offset, &byte) in message.bytes.iter().enumerate() {
            self.out.insert(at + offset, byte);
        }
        self.urgent_left += message.bytes.len();
        self.urgent_acks.push(message.written);
    }

    /// Cancels a command of which nothing has been written yet, where a stop has come: written after it, it would begin a
    /// motion.
    fn cancel_outdated(&mut self) {
        let newest = self.generation.load(Ordering::SeqCst);
        let unsent = self.out.len() - self.begun - self.urgent_left;
        let cancelled = self.pending.as_ref().is_some_and(|pending| {
            pending.generation.is_some_and(|given| given != newest) && unsent == pending.request.len()
        });
        if cancelled {
            self.drop_unsent();
            self.end_pending(Err(PortError::Cancelled));
        }
    }

    /// Forgets the request that waits to be written, but for one begun that must be completed.
    fn drop_unsent(&mut self) {
        self.out.truncate(self.begun + self.urgent_left);
    }

    fn take_request(&mut self, request: Request<P::Message>) {
        if request.generation.is_some_and(|generation| generation != self.generation.load(Ordering::SeqCst)) {
            let _ = request.reply.send(Err(PortError::Cancelled));
        } else if !self.in_step && !request.resync {
            let _ = request.reply.send(Err(PortError::OutOfStep));
        } else {
            self.out.extend(&request.bytes);
            self.pending = Some(Pending {
                parts: Vec::new(),
                allowed: request.allowed,
                deadline: Instant::now() + request.allowed,
                generation: request.generation,
                resync: request.resync,
                asked: Instant::now(),
                reply: request.reply,
                request: request.bytes,
            });
        }
    }

    fn written(&mut self, count: usize) {
        self.out.drain(..count);
        let of_begun = count.min(self.begun);
        let of_urgent = (count - of_begun).min(self.urgent_left);
        let of_request = count - of_begun - of_urgent;
        self.begun -= of_begun;
        self.urgent_left -= of_urgent;
        if of_request > 0 && !P::URGENT_ANYWHERE {
            self.begun = self.out.len();
        }
        if self.urgent_left == 0 {
            for ack in self.urgent_acks.drain(..) {
                let _ = ack.send(());
            }
        }
    }

    fn take_bytes(&mut self, bytes: &[u8]) {
        if self.heard.elapsed() > GAP {
            self.protocol.gap();
        }
        self.heard = Instant::now();
        self.received.lock().unwrap_or_else(PoisonError::into_inner).note(bytes);
        for message in self.protocol.frame(bytes) {
            self.number += 1;
            let under_way = self.pending.as_ref().map(|pending| pending.request.as_slice());
            let kind = self.protocol.classify(&message, under_way);
            match kind {
                Kind::Data => {
                    self.keep(message.clone());
                    self.notify(kind, message);
                }
                Kind::Last => {
                    self.keep(message);
                    self.end_pending(Ok(()));
                }
                // An answer to nothing that was asked here.
                Kind::Done | Kind::Refused if self.pending.is_none() && self.in_step => self.notify(kind, message),
                Kind::Done => self.end_pending(Ok(())),
                Kind::Refused => self.end_pending(Err(PortError::Refused(self.protocol.text(&message)))),
                Kind::Halted => {
                    self.in_step = false;
                    self.end_pending(Err(PortError::Halted(self.protocol.text(&message))));
                    self.notify(kind, message);
                }
                Kind::Started => {
                    self.end_pending(Err(PortError::Restarted));
                    self.in_step = true;
                    self.notify(kind, message);
                }
                Kind::Notice => self.notify(kind, message),
                Kind::Noise => {
                    tracing::debug!(message = %self.protocol.text(&message), "not understood on a serial port");
                    self.notify(kind, message);
                }
            }
        }
    }

    fn keep(&mut self, message: P::Message) {
        if let Some(pending) = &mut self.pending {
            // A device that never ends its answer is bounded by the deadline and by this.
            if pending.parts.len() < MOST_PARTS {
                pending.parts.push(message);
            }
        }
    }

    fn notify(&self, kind: Kind, message: P::Message) {
        if self.notices.try_send(Notice { kind, line: message, line_number: self.number }).is_err() {
            tracing::debug!("a notice from a serial port was dropped: nobody reads them");
        }
    }

    fn end_pending(&mut self, result: Result<(), PortError>) {
        if let Some(pending) = self.pending.take() {
            self.in_step |= pending.resync && matches!(result, Ok(()) | Err(PortError::Refused(_)));
            if matches!(result, Ok(()) | Err(PortError::Refused(_))) {
                telemetry::round_trip(pending.asked.elapsed());
            }
            let answer = result.map(|()| Answer { lines: pending.parts, line_number: self.number });
            let _ = pending.reply.send(answer);
        }
    }

    fn time_out(&mut self) {
        if let Some(allowed) = self.pending.as_ref().map(|pending| pending.allowed) {
            // A late end would be taken for the next request's, unless it says whose it is.
            self.in_step &= P::RECOVERY == Recovery::None;
            self.drop_unsent();
            self.protocol.gap();
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
