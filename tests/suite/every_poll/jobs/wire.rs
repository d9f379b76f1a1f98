//! The wire to a simulated Grbl controller, with every line that moves noted when it is written: below the layer that
//! looks at a command's generation.

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll};

use async_trait::async_trait;
use futures_util::task::AtomicWaker;
use plenalign::device::serial::{Dial, Wire};
use plenalign::device::{AxisName, DeviceError};
use plenalign::sim::stage::TwinDial;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};

use super::points::{Point, Points};

/// What is wrong with the wire.
#[derive(Default)]
pub(super) struct Trouble {
    /// Nothing passes either way, and nothing can be opened.
    cut: AtomicBool,
    /// What the controller says is lost.
    deaf: AtomicBool,
    reader: AtomicWaker,
}

impl Trouble {
    pub(super) fn cut(&self, cut: bool) {
        self.cut.store(cut, Ordering::SeqCst);
        self.reader.wake();
    }

    pub(super) fn deafen(&self, deaf: bool) {
        self.deaf.store(deaf, Ordering::SeqCst);
        self.reader.wake();
    }

    fn is_cut(&self) -> bool {
        self.cut.load(Ordering::SeqCst)
    }
}

pub(super) struct Tapped {
    pub(super) dial: TwinDial,
    pub(super) points: Arc<Points>,
    pub(super) trouble: Arc<Trouble>,
}

#[async_trait]
impl Dial for Tapped {
    fn location(&self) -> String {
        "tapped".to_owned()
    }

    async fn open(&self) -> Result<Wire, DeviceError> {
        if self.trouble.is_cut() {
            let (device, reason) = ("tapped wire".to_owned(), "it is unplugged".to_owned());
            return Err(DeviceError::Disconnected { device, reason });
        }
        let (points, trouble) = (Arc::clone(&self.points), Arc::clone(&self.trouble));
        Ok(Box::new(TappedWire { wire: self.dial.open().await?, points, trouble, line: Vec::new(), dead: false }))
    }
}

struct TappedWire {
    wire: Wire,
    points: Arc<Points>,
    trouble: Arc<Trouble>,
    line: Vec<u8>,
    /// Cut once: what is plugged in again is another wire.
    dead: bool,
}

impl TappedWire {
    fn is_dead(&mut self) -> bool {
        self.dead |= self.trouble.is_cut();
        self.dead
    }

    /// Notes the lines that move in what was written.
    fn note(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            match byte {
                b'\n' => {
                    if let Some(point) = written(&String::from_utf8_lossy(&std::mem::take(&mut self.line))) {
                        self.points.pass(point);
                    }
                }
                // Real-time bytes are no part of a line.
                b'?' | b'!' | b'~' | 0x18 | 0x80.. => {}
                byte => self.line.push(byte),
            }
        }
    }
}

/// What a line moves, if it does; releasing a motor counts, and so does the word that lets an axis in alarm move.
fn written(line: &str) -> Option<Point> {
    let what = match line {
        _ if line.starts_with("$J=") => "move",
        _ if line.starts_with("$H") => "home",
        _ if line.starts_with("$SLP") => "release",
        _ if line.starts_with("$X") => "unlock",
        _ => return None,
    };
    Some(Point::Written(if line.contains('Y') { AxisName::E } else { AxisName::Focus }, what))
}

impl AsyncRead for TappedWire {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<std::io::Result<()>> {
        self.trouble.reader.register(cx.waker());
        if self.is_dead() {
            return Poll::Ready(Ok(()));
        }
        while self.trouble.deaf.load(Ordering::SeqCst) {
            let mut lost = [0; 256];
            let mut lost = ReadBuf::new(&mut lost);
            std::task::ready!(Pin::new(&mut self.wire).poll_read(cx, &mut lost))?;
            if lost.filled().is_empty() {
                return Poll::Ready(Ok(()));
            }
        }
        Pin::new(&mut self.wire).poll_read(cx, buf)
    }
}

impl AsyncWrite for TappedWire {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<std::io::Result<usize>> {
        if self.is_dead() {
            return Poll::Ready(Err(std::io::ErrorKind::BrokenPipe.into()));
        }
        let wrote = Pin::new(&mut self.wire).poll_write(cx, bytes);
        if let Poll::Ready(Ok(count)) = wrote {
            self.note(&bytes[..count]);
        }
        wrote
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.wire).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.wire).poll_shutdown(cx)
    }
}
