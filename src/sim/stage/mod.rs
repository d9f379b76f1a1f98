//! Twins of the stage controllers: Grbl 1.1's firmware behind a pipe or a pseudo-terminal, for the real driver to talk
//! to.
//!
//! The twin speaks bytes. Its motors take time, its switches and motors act on a [`Plant`], and it runs on tokio's
//! clock, so that a paused clock makes simulated minutes short. Blocks come to rest between one another: unlike Grbl it
//! does not blend lines.

mod firmware;
mod gcode;
mod motion;
mod settings;

use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::Notify;
use tokio::time::Instant;
use tokio_serial::{SerialPort, SerialStream};

pub use firmware::Firmware;
pub use settings::{FirmwareAxis, FirmwareConfig, PULL_OFF_MM};

use crate::config::BenchConfig;
use crate::device::stage::grbl_controller::{AxisSetup, GrblController, GrblStage};
use crate::device::{AxisName, DeviceError};
use crate::sim::plant::Plant;

/// How often a moving firmware is brought up to the clock.
const TICK: Duration = Duration::from_millis(5);

/// A controller twin: its firmware, and what can be made to go wrong with it.
#[derive(Clone)]
pub struct ControllerTwin {
    firmware: Arc<Mutex<Firmware>>,
    unplug: Arc<Notify>,
}

impl ControllerTwin {
    /// A controller just powered up.
    #[must_use]
    pub fn new(config: FirmwareConfig, plant: Arc<dyn Plant>) -> Self {
        Self { firmware: Arc::new(Mutex::new(Firmware::new(config, plant))), unplug: Arc::new(Notify::new()) }
    }

    /// Makes a motor stand still whatever steps it is given, or follow them again. Axes count from 0.
    pub fn stall(&self, axis: usize, stalled: bool) {
        self.with(|firmware| firmware.stall(axis, stalled));
    }

    /// Cuts the connection: [`ControllerTwin::serve`] returns and drops its stream.
    pub fn unplug(&self) {
        self.unplug.notify_one();
    }

    fn with<R>(&self, act: impl FnOnce(&mut Firmware) -> R) -> R {
        act(&mut self.firmware.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Runs the firmware behind a byte stream until the stream ends or is unplugged. Sleeps while nothing moves.
    pub async fn serve<T: AsyncRead + AsyncWrite + Unpin>(&self, io: T) {
        let (mut reader, mut writer) = tokio::io::split(io);
        let mut buffer = [0u8; 256];
        let mut unsent: Vec<u8> = Vec::new();
        let mut reached = Instant::now();
        loop {
            let moving = self.with(|firmware| {
                unsent.extend(firmware.take_output());
                firmware.is_moving()
            });
            tokio::select! {
                () = self.unplug.notified() => return,
                read = reader.read(&mut buffer) => {
                    let count = match read {
                        Ok(0) | Err(_) => return,
                        Ok(count) => count,
                    };
                    self.with(|firmware| {
                        firmware.advance(reached.elapsed().as_secs_f64());
                        for &byte in &buffer[..count] {
                            firmware.receive(byte);
                        }
                    });
                    reached = Instant::now();
                }
                wrote = writer.write(&unsent), if !unsent.is_empty() => match wrote {
                    Ok(0) | Err(_) => return,
                    Ok(count) => drop(unsent.drain(..count)),
                },
                () = tokio::time::sleep_until(reached + TICK), if moving => {
                    let now = Instant::now();
                    self.with(|firmware| firmware.advance((now - reached).as_secs_f64()));
                    reached = now;
                }
            }
            if !moving && !self.with(|firmware| firmware.is_moving()) {
                reached = Instant::now();
            }
        }
    }

    /// Opens a pseudo-terminal with the firmware behind it and returns the path that a driver or a terminal program
    /// opens. It lasts until the twin is unplugged or the runtime ends.
    ///
    /// # Errors
    /// When the system gives no pseudo-terminal.
    pub fn serve_on_terminal(&self) -> io::Result<PathBuf> {
        let (near, far) = SerialStream::pair().map_err(io::Error::from)?;
        let path = far.name().ok_or_else(|| io::Error::other("the pseudo-terminal has no name"))?;
        let twin = self.clone();
        tokio::spawn(async move {
            // Kept open: with no far end open, reads would fail as if unplugged.
            let _far = far;
            twin.serve(near).await;
        });
        Ok(PathBuf::from(path))
    }
}

/// The bench's two axes on one simulated controller: the real driver, a pipe, the twin's firmware. The plant's axes are
/// numbered by their configured letters, X being 0; motors count in the controller's direction (`reversed` applies).
///
/// Must be called within a tokio runtime; both tasks end when the stages are dropped.
///
/// # Errors
/// When the configuration gives the axes the same letter, or one that the controller does not have.
pub async fn simulated_stages(
    plant: Arc<dyn Plant>,
    bench: &BenchConfig,
) -> Result<(GrblStage, GrblStage, ControllerTwin), DeviceError> {
    let twin = ControllerTwin::new(FirmwareConfig::for_axes(&bench.focus, &bench.e), plant);
    let (near, far) = tokio::io::duplex(1024);
    let serving = twin.clone();
    tokio::spawn(async move { serving.serve(far).await });
    if bench.focus.axis.eq_ignore_ascii_case(&bench.e.axis) {
        return Err(DeviceError::Refused {
            device: "simulated controller".to_owned(),
            reason: format!("focus and e axis are both `{}`; the simulated bench has one controller", bench.e.axis),
        });
    }
    let axes = vec![
        AxisSetup::new(AxisName::Focus, &bench.focus.axis, &bench.focus)?,
        AxisSetup::new(AxisName::E, &bench.e.axis, &bench.e)?,
    ];
    let controller = GrblController::connect(near, "simulated controller", "simulated", axes).await?;
    let stage = |axis| {
        controller.stage(axis).ok_or_else(|| DeviceError::Protocol {
            device: "simulated controller".to_owned(),
            detail: format!("no {axis} axis"),
        })
    };
    Ok((stage(AxisName::Focus)?, stage(AxisName::E)?, twin))
}
