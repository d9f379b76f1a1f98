//! A wire on which things go wrong.

use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::time::sleep;

/// What goes wrong on a wire. By default nothing.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Line {
    /// Bytes that arrive at the driver before anything else.
    pub noise: Vec<u8>,
    /// Most bytes that arrive at the driver at a time; 0 for as many as come.
    pub fragment: usize,
    /// Pause between fragments.
    pub pause: Duration,
    /// How long what the controller says is on its way.
    pub delay: Duration,
    /// Whether everything the driver writes comes back to it as well.
    pub echo: bool,
    /// Whether everything the controller says arrives twice.
    pub doubled: bool,
    /// Whether bytes come out wrong both ways, as with the wrong baud rate.
    pub garbled: bool,
    /// One byte in this many that the controller says is lost; 0 for none.
    pub loses_one_in: usize,
    /// One byte in this many that the controller says comes out wrong; 0 for none.
    pub garbles_one_in: usize,
}

/// What a byte looks like at another baud rate.
const fn garble(byte: u8) -> u8 {
    byte.rotate_left(3) ^ 0xE1
}

impl Line {
    /// Passes bytes between the driver's end and the controller's until either closes. What goes wrong may change
    /// meanwhile.
    pub async fn run<A, B>(now: &Mutex<Self>, mut driver: A, mut controller: B)
    where
        A: AsyncRead + AsyncWrite + Unpin,
        B: AsyncRead + AsyncWrite + Unpin,
    {
        let line = || now.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let noise = line().noise;
        if !noise.is_empty() && driver.write_all(&noise).await.is_err() {
            return;
        }
        let (mut down, mut up) = ([0u8; 256], [0u8; 256]);
        let mut counted = 0usize;
        loop {
            tokio::select! {
                read = driver.read(&mut down) => {
                    let Ok(count @ 1..) = read else { return };
                    let line = line();
                    let mut bytes = down[..count].to_vec();
                    if line.echo && driver.write_all(&bytes).await.is_err() {
                        return;
                    }
                    if line.garbled {
                        bytes.iter_mut().for_each(|byte| *byte = garble(*byte));
                    }
                    if controller.write_all(&bytes).await.is_err() {
                        return;
                    }
                }
                read = controller.read(&mut up) => {
                    let Ok(count @ 1..) = read else { return };
                    let line = line();
                    let one_in = |many: usize, counted: usize| many > 0 && counted.is_multiple_of(many);
                    let mut bytes: Vec<u8> = Vec::with_capacity(2 * count);
                    for &byte in &up[..count] {
                        counted += 1;
                        if !one_in(line.loses_one_in, counted) {
                            let wrong = line.garbled || one_in(line.garbles_one_in, counted);
                            bytes.push(if wrong { garble(byte) } else { byte });
                        }
                    }
                    if line.doubled {
                        bytes.extend_from_within(..);
                    }
                    if !line.delay.is_zero() {
                        sleep(line.delay).await;
                    }
                    let size = if line.fragment == 0 { bytes.len().max(1) } else { line.fragment };
                    for piece in bytes.chunks(size) {
                        if driver.write_all(piece).await.is_err() {
                            return;
                        }
                        if !line.pause.is_zero() {
                            sleep(line.pause).await;
                        }
                    }
                }
            }
        }
    }
}
