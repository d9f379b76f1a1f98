//! Twins of the stage controllers: firmwares behind a pipe, a pseudo-terminal or a TCP port, for the real drivers, and
//! for the vendors' own programs, to talk to.
//!
//! A twin speaks bytes. Its motors take time, its switches and motors act on a [`Plant`], and it runs on tokio's clock,
//! so that a paused clock makes simulated minutes short.

pub mod drive;
pub mod grbl;
pub mod line;
pub mod pi;
mod pi_parameters;
mod protocol;
pub mod thorlabs;
pub mod tmcl;
pub mod zaber;

use std::io;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use async_trait::async_trait;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::watch;
use tokio::time::Instant;
use tokio_serial::{SerialPort, SerialStream};

use crate::config::{AxisConfig, BenchConfig};
use crate::device::serial::{Dial, Wire};
use crate::device::stage::axis::AxisSetup;
use crate::device::stage::grbl_controller::GrblDriver;
use crate::device::stage::supervisor::{Controller, ControllerStage};
use crate::device::{AxisName, DeviceError};
use crate::sim::plant::Plant;
use drive::DriveConfig;
use grbl::{FirmwareConfig, GrblFirmware};
use line::Line;
use pi::PiFirmware;
pub use protocol::Protocol;
use thorlabs::ThorlabsFirmware;
use tmcl::TmclFirmware;
use zaber::ZaberFirmware;

/// How often a moving firmware is brought up to the clock.
const TICK: Duration = Duration::from_millis(5);
/// Silence after which a firmware gives up an unfinished frame.
const PAUSE: Duration = Duration::from_millis(50);
/// Distance from the home switch after homing, mm: an axis's `home_position_mm` is this far off its switch.
pub const PULL_OFF_MM: f64 = 3.0;
/// Distance of the switch at the end opposite to home from the limit of travel, mm.
pub const FAR_SWITCH_MM: f64 = 1.0;

/// A controller's firmware: bytes in, bytes out, motors turned as time passes. No I/O and no clock of its own.
pub trait Firmware: Send {
    /// Takes a byte from the wire.
    fn receive(&mut self, byte: u8);

    /// Notes that no byte came for a while.
    fn pause(&mut self) {}

    /// What the firmware has to say since it was asked last.
    fn take_output(&mut self) -> Vec<u8>;

    /// Lets time pass, seconds.
    fn advance(&mut self, seconds: f64);

    /// Whether time makes a difference to it: whether anything moves.
    fn is_moving(&self) -> bool;

    /// Makes a motor stand still whatever steps it is given, or follow them again. Axes count from 0.
    fn stall(&mut self, axis: usize, stalled: bool);

    /// Power goes off and on: everything stands still, nothing is remembered but the settings.
    fn power_cycle(&mut self);
}

/// The firmware of a protocol's controllers, set up for axes as configured.
#[must_use]
pub fn firmware(protocol: impl Into<Protocol>, axes: &[&AxisConfig], plant: Arc<dyn Plant>) -> ControllerTwin {
    let drives: Vec<DriveConfig> = axes.iter().map(|axis| DriveConfig::of(axis)).collect();
    match protocol.into() {
        Protocol::Grbl => ControllerTwin::new(GrblFirmware::new(FirmwareConfig::for_axes(axes), plant)),
        Protocol::GrblHal => ControllerTwin::new(GrblFirmware::new(FirmwareConfig::grblhal(axes), plant)),
        Protocol::FluidNc => ControllerTwin::new(GrblFirmware::new(FirmwareConfig::fluidnc(axes), plant)),
        Protocol::Zaber => ControllerTwin::new(ZaberFirmware::new(drives, &plant)),
        Protocol::Pi => ControllerTwin::new(PiFirmware::new(drives, &plant)),
        Protocol::Tmcl => ControllerTwin::new(TmclFirmware::new(drives, &plant)),
        Protocol::Thorlabs => ControllerTwin::new(ThorlabsFirmware::of(drives, &plant)),
    }
}

/// A controller twin: its firmware, and what can be made to go wrong with it.
#[derive(Clone)]
pub struct ControllerTwin {
    firmware: Arc<Mutex<dyn Firmware>>,
    plugged: Arc<watch::Sender<bool>>,
    powered: Arc<AtomicBool>,
    line: Arc<Mutex<Line>>,
    /// How many streams are being served.
    served: Arc<watch::Sender<u32>>,
    /// Up to when the firmware has run: with nobody connected it goes on.
    reached: Arc<Mutex<Instant>>,
}

impl ControllerTwin {
    /// A controller just powered up, plugged in.
    #[must_use]
    pub fn new(firmware: impl Firmware + 'static) -> Self {
        Self {
            firmware: Arc::new(Mutex::new(firmware)),
            plugged: Arc::new(watch::Sender::new(true)),
            powered: Arc::new(AtomicBool::new(true)),
            line: Arc::default(),
            served: Arc::new(watch::Sender::new(0)),
            reached: Arc::new(Mutex::new(Instant::now())),
        }
    }

    /// Makes a motor stand still whatever steps it is given, or follow them again. Axes count from 0.
    pub fn stall(&self, axis: usize, stalled: bool) {
        self.now(|firmware| firmware.stall(axis, stalled));
    }

    /// Switches the controller off and on while its port stays.
    pub fn power_cycle(&self) {
        self.now(|firmware| firmware.power_cycle());
    }

    /// Takes the power away, or gives it back, while the port stays. Without power nothing moves and nothing is said.
    pub fn power(&self, on: bool) {
        if self.powered.swap(on, Ordering::SeqCst) != on {
            self.power_cycle();
        }
    }

    /// Gives the firmware bytes as if they came over the wire.
    pub fn receive(&self, bytes: &[u8]) {
        self.now(|firmware| bytes.iter().for_each(|&byte| firmware.receive(byte)));
    }

    /// Cuts the connection: [`ControllerTwin::serve`] returns and drops its stream.
    pub fn unplug(&self) {
        self.plugged.send_replace(false);
    }

    /// Ends what [`ControllerTwin::unplug`] began.
    pub fn plug_in(&self) {
        self.plugged.send_replace(true);
    }

    /// What goes wrong on the wire to it from now on; noise is for streams and terminals that are opened later.
    pub fn set_line(&self, line: Line) {
        *self.line.lock().unwrap_or_else(PoisonError::into_inner) = line;
    }

    fn with<R>(&self, act: impl FnOnce(&mut dyn Firmware) -> R) -> R {
        act(&mut *self.firmware.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Runs the firmware behind a byte stream until the stream ends or is unplugged. Sleeps while nothing moves.
    pub async fn serve<T: AsyncRead + AsyncWrite + Unpin>(&self, io: T) {
        self.served.send_modify(|count| *count += 1);
        self.run(io).await;
        self.served.send_modify(|count| *count -= 1);
    }

    /// Brings the firmware up to the clock, and acts on it then.
    fn now<R>(&self, act: impl FnOnce(&mut dyn Firmware) -> R) -> R {
        let mut reached = self.reached.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        let passed = now - std::mem::replace(&mut *reached, now);
        self.with(|firmware| {
            firmware.advance(passed.as_secs_f64());
            act(firmware)
        })
    }

    /// Serves with what goes wrong on the wire.
    async fn serve_over_its_line<T: AsyncRead + AsyncWrite + Unpin>(&self, io: T) {
        let (a, b) = tokio::io::duplex(1024);
        tokio::join!(Line::run(&self.line, io, a), self.serve(b));
    }

    async fn run<T: AsyncRead + AsyncWrite + Unpin>(&self, io: T) {
        let (mut reader, mut writer) = tokio::io::split(io);
        let mut plugged = self.plugged.subscribe();
        let mut buffer = [0u8; 256];
        let mut unsent: Vec<u8> = Vec::new();
        let mut heard = Instant::now();
        loop {
            let powered = self.powered.load(Ordering::SeqCst);
            let moving = self.now(|firmware| {
                let said = firmware.take_output();
                unsent.extend(said.into_iter().filter(|_| powered));
                firmware.is_moving()
            });
            let tick = Instant::now() + TICK;
            tokio::select! {
                _ = plugged.wait_for(|plugged| !plugged) => return,
                read = reader.read(&mut buffer) => {
                    let count = match read {
                        Ok(0) | Err(_) => return,
                        Ok(count) => count,
                    };
                    let paused = heard.elapsed() > PAUSE;
                    heard = Instant::now();
                    if !self.powered.load(Ordering::SeqCst) {
                        continue;
                    }
                    self.now(|firmware| {
                        if paused {
                            firmware.pause();
                        }
                        for &byte in &buffer[..count] {
                            firmware.receive(byte);
                        }
                    });
                }
                wrote = writer.write(&unsent), if !unsent.is_empty() => match wrote {
                    Ok(0) | Err(_) => return,
                    Ok(count) => drop(unsent.drain(..count)),
                },
                () = tokio::time::sleep_until(tick), if moving => {}
            }
        }
    }

    /// A way to the twin through pipes, one at a time.
    #[must_use]
    pub fn dial(&self) -> TwinDial {
        TwinDial(self.clone())
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
            twin.serve_over_its_line(near).await;
        });
        Ok(PathBuf::from(path))
    }
}

/// A way to a twin through pipes: one stream at a time, as a serial port is opened exclusively.
#[derive(Clone)]
pub struct TwinDial(ControllerTwin);

#[async_trait]
impl Dial for TwinDial {
    fn location(&self) -> String {
        "simulated".to_owned()
    }

    async fn open(&self) -> Result<Wire, DeviceError> {
        let twin = self.0.clone();
        if !*twin.plugged.borrow() {
            return Err(DeviceError::Disconnected {
                device: "simulated controller".to_owned(),
                reason: "it is unplugged".to_owned(),
            });
        }
        if *twin.served.borrow() > 0 {
            return Err(DeviceError::Busy {
                device: "simulated controller".to_owned(),
                reason: "another stream is open".to_owned(),
            });
        }
        let (near, far) = tokio::io::duplex(1024);
        tokio::spawn(async move { twin.serve_over_its_line(far).await });
        Ok(Box::new(near))
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
) -> Result<(ControllerStage, ControllerStage, ControllerTwin), DeviceError> {
    let device = "simulated controller";
    if bench.focus.axis.eq_ignore_ascii_case(&bench.e.axis) {
        return Err(DeviceError::Refused {
            device: device.to_owned(),
            reason: format!("focus and e axis are both `{}`; the simulated bench has one controller", bench.e.axis),
        });
    }
    let twin = ControllerTwin::new(GrblFirmware::new(FirmwareConfig::for_axes(&[&bench.focus, &bench.e]), plant));
    let mut axes = vec![AxisSetup::new(AxisName::Focus, &bench.focus), AxisSetup::new(AxisName::E, &bench.e)];
    for axis in &mut axes {
        // The twin's limits begin at the switch, which is its own choice and not the configuration's.
        axis.config.accept_wider_firmware_limits = true;
    }
    let controller = Controller::start(device, Box::new(GrblDriver::default()), Arc::new(twin.dial()), None, axes);
    controller.first_attempt().await?;
    let stage = |axis| {
        controller
            .stage(axis)
            .ok_or_else(|| DeviceError::Protocol { device: device.to_owned(), detail: format!("no {axis} axis") })
    };
    Ok((stage(AxisName::Focus)?, stage(AxisName::E)?, twin))
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum as _;
    use proptest::prelude::*;

    use super::*;
    use crate::sim::plant::Slides;

    proptest! {
        #[test]
        fn no_bytes_break_a_firmware(
            driver in prop::sample::select(Protocol::value_variants()),
            words in proptest::collection::vec(
                prop_oneof![
                    proptest::collection::vec(any::<u8>(), 0..40),
                    // What comes near to being understood.
                    "[/$]?[0-9A-Za-z?=.# -]{0,24}\n".prop_map(String::into_bytes),
                    "(/1 1 )?(move abs|home|MOV 1|FNL 1|SVO 1|\\$H|\\$CD|\\$/axes/x/homing/cycle=|\\$J=X)[ -]?[0-9.]{0,12}\n"
                        .prop_map(String::into_bytes),
                ],
                0..20,
            ),
        ) {
            let mut bench = BenchConfig::default();
            for (axis, name) in [&mut bench.focus, &mut bench.e].into_iter().zip(driver.first_axes()) {
                name.clone_into(&mut axis.axis);
            }
            let slides = Slides::new(&[(&bench.focus, 1.0), (&bench.e, 20.0)]);
            let twin = firmware(driver, &[&bench.focus, &bench.e], slides.clone());
            for word in words {
                twin.with(|firmware| {
                    for byte in word {
                        firmware.receive(byte);
                    }
                    firmware.advance(0.05);
                    let said = firmware.take_output();
                    assert!(said.len() < 1 << 16, "{} bytes at once", said.len());
                });
            }
            prop_assert!(slides.at(0).is_finite() && slides.at(1).is_finite());
        }
    }
}
