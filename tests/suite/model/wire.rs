//! The tapped wire between a daemon and its controller: what moves an axis is noted, in every protocol.

use std::sync::Arc;

use async_trait::async_trait;
use plenalign::config::ControllerDriver;
use plenalign::device::serial::{Dial, Wire};
use plenalign::device::stage::thorlabs::{FIRST_BAY, Message, id};
use plenalign::device::stage::tmcl::{FRAME, Frame, Request, command};
use plenalign::device::{AxisName, DeviceError};
use plenalign::sim::stage::TwinDial;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio_util::sync::CancellationToken;

use super::rig::{Record, Seen};

/// A way to the twin that notes what moves on it, and that a killed daemon loses for good.
pub(super) struct Tapped {
    pub(super) driver: ControllerDriver,
    pub(super) dial: TwinDial,
    pub(super) record: Arc<Record>,
    pub(super) cut: CancellationToken,
}

#[async_trait]
impl Dial for Tapped {
    fn location(&self) -> String {
        "tapped".to_owned()
    }

    async fn open(&self) -> Result<Wire, DeviceError> {
        if self.cut.is_cancelled() {
            let (device, reason) = ("tapped wire".to_owned(), "its daemon was killed".to_owned());
            return Err(DeviceError::Disconnected { device, reason });
        }
        let controller = self.dial.open().await?;
        let (near, far) = tokio::io::duplex(1024);
        let (record, cut, tap) = (Arc::clone(&self.record), self.cut.clone(), Tap::new(self.driver));
        tokio::spawn(async move { cut.run_until_cancelled(pass(far, controller, tap, &record)).await });
        Ok(Box::new(near))
    }
}

/// Passes bytes both ways, and notes each order that begins a motion.
async fn pass(mut daemon: tokio::io::DuplexStream, mut controller: Wire, mut tap: Tap, record: &Record) {
    let (mut down, mut up) = ([0u8; 256], [0u8; 256]);
    loop {
        tokio::select! {
            biased;
            read = daemon.read(&mut down) => {
                let Ok(count @ 1..) = read else { return };
                for order in down[..count].iter().filter_map(|&byte| tap.take(byte)) {
                    record.note(order);
                }
                if controller.write_all(&down[..count]).await.is_err() {
                    return;
                }
            }
            read = controller.read(&mut up) => {
                let Ok(count @ 1..) = read else { return };
                if daemon.write_all(&up[..count]).await.is_err() {
                    return;
                }
            }
        }
    }
}

/// What has come of the order that is being written.
struct Tap {
    driver: ControllerDriver,
    unfinished: Vec<u8>,
}

impl Tap {
    const fn new(driver: ControllerDriver) -> Self {
        Self { driver, unfinished: Vec::new() }
    }

    /// Takes a byte; the order that begins a motion, where it ends one.
    fn take(&mut self, byte: u8) -> Option<Seen> {
        if self.driver == ControllerDriver::Tmcl {
            self.unfinished.push(byte);
            let frame: Frame = self.unfinished.as_slice().try_into().ok()?;
            self.unfinished.clear();
            return frame_order(&frame);
        }
        if self.driver == ControllerDriver::Thorlabs {
            self.unfinished.push(byte);
            let (message, _) = Message::read(&self.unfinished)?;
            self.unfinished.clear();
            return message_order(&message);
        }
        match byte {
            b'\n' => {
                let line = String::from_utf8_lossy(&std::mem::take(&mut self.unfinished)).into_owned();
                self.line_order(line)
            }
            // Real-time bytes are no part of a line.
            b'?' | b'!' | b'~' | 0x80.. if self.driver == ControllerDriver::Grbl => None,
            0..=31 => None,
            byte => {
                self.unfinished.push(byte);
                None
            }
        }
    }

    /// The motion that a line begins, if it does.
    fn line_order(&self, line: String) -> Option<Seen> {
        let begins = |word: &str| line.starts_with(word);
        let mut words = line.split(' ');
        let (homing, moves, axis) = match self.driver {
            ControllerDriver::Grbl => (begins("$H"), begins("$J="), if line.contains('Y') { "2" } else { "1" }),
            ControllerDriver::Zaber => (line.contains(" home"), line.contains(" move "), words.nth(1)?),
            ControllerDriver::Pi | ControllerDriver::Tmcl | ControllerDriver::Thorlabs => {
                (begins("FNL ") || begins("FPL ") || begins("FRF "), begins("MOV "), words.nth(1)?)
            }
        };
        let axis = if axis == "2" { AxisName::E } else { AxisName::Focus };
        (homing || moves).then_some(Seen::Order { axis, homing, line })
    }
}

/// The motion that a TMCL frame begins, if it does.
fn frame_order(frame: &Frame) -> Option<Seen> {
    let request = Request::read(frame);
    let (homing, moves) = (request.command == command::RFS && request.kind == 0, request.command == command::MVP);
    let axis = if request.motor == 1 { AxisName::E } else { AxisName::Focus };
    (homing || moves).then(|| Seen::Order { axis, homing, line: format!("{request:?}") })
}

/// The motion that a Thorlabs message begins, if it does.
fn message_order(message: &Message) -> Option<Seen> {
    let (homing, moves) = (message.id == id::MOVE_HOME, message.id == id::MOVE_ABSOLUTE);
    let axis = if message.dest == FIRST_BAY + 1 { AxisName::E } else { AxisName::Focus };
    (homing || moves).then(|| Seen::Order { axis, homing, line: format!("{message:?}") })
}

#[test]
fn the_orders_of_every_protocol_are_known() {
    use ControllerDriver::{Grbl, Pi, Thorlabs, Tmcl, Zaber};
    let frame = |command, motor| Request { address: 1, command, kind: 0, motor, value: 5 }.frame().to_vec();
    let short = |id, unit| Message::short(id, unit, 1, 0).bytes();
    let go = Message::numbers(id::MOVE_ABSOLUTE, FIRST_BAY, &[5]).bytes();
    let orders: [(ControllerDriver, [Vec<u8>; 2], Vec<u8>); 5] = [
        (Grbl, [b"$J=G53 X1 F60\n".to_vec(), b"?$HY\n".to_vec()], b"$$\n".to_vec()),
        (Zaber, [b"/01 1 07 move abs 5:00\n".to_vec(), b"/01 2 08 home:00\n".to_vec()], b"/01 1 get pos:00\n".to_vec()),
        (Pi, [b"VEL 1 2.0\nMOV 1 5.0\nERR?\n".to_vec(), b"\x18FPL 2\n".to_vec()], b"\x05SVO 1 1\n".to_vec()),
        (Tmcl, [frame(command::MVP, 0), frame(command::RFS, 1)], frame(command::GAP, 0)),
        (Thorlabs, [go, short(id::MOVE_HOME, FIRST_BAY + 1)], short(id::REQ_BITS, FIRST_BAY)),
    ];
    assert_eq!(FRAME, frame(command::MVP, 0).len());
    for (driver, [moves, homes], other) in orders {
        let mut tap = Tap::new(driver);
        let bytes = [&other[..], &moves, &other, &homes, &other].concat();
        let found: Vec<_> = bytes.into_iter().filter_map(|byte| tap.take(byte)).collect();
        let told = |seen: &Seen| matches!(seen, Seen::Order { axis: AxisName::E, homing: true, .. });
        assert_eq!((found.len(), told(&found[0]), told(&found[1])), (2, false, true), "{driver:?}: {found:?}");
    }
}
