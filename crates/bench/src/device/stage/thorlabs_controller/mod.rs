//! A connected Thorlabs controller: the questions and commands of APT.

mod checks;
mod questions;

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use async_trait::async_trait;
use tokio::sync::{mpsc, oneshot, watch};

use super::axis::AxisSetup;
use super::exchange::Exchange;
use super::polled::{AxisReading, Dialogue, Homing, Polled};
use super::session::{AxisFacts, Driver, Session, Wanted};
use super::thorlabs::model::{Info, Model, Motor, known_models};
use super::thorlabs::status::Bits;
use super::thorlabs::{Apt, CHANNEL, FIRST_BAY, MAIN_BOARD, Message, Stop, USB_UNIT, complaint, id};
use crate::device::DeviceError;
use crate::device::port::{Notice, Port, PortError};
use crate::device::serial::Wire;
use questions::Turn;

/// Nearer to its target than this an axis need not be seen to begin, mm.
const THERE_MM: f64 = 1e-3;
/// Homing ends at the controller's zero, give or take this, mm.
const HOME_MM: f64 = 0.01;
/// Who says of himself that he is nobody, as some units do.
const UNNAMED: u8 = 0;
/// Looks at an axis within which it has to begin what it was told.
const BEGINNING: u32 = 20;

/// Drives Thorlabs controllers for brushed servo motors (KDC101) and stepper motors (KST101, BSC20x).
#[derive(Debug, Clone, Copy, Default)]
pub struct ThorlabsDriver;

struct Axis {
    /// The unit's address: a K-Cube's own, or its bay's.
    unit: u8,
    /// Units of position a millimetre.
    scale: f64,
    facts: AxisFacts,
    /// Where the controller stops the axis by its own numbers, mm.
    limits: Option<(f64, f64)>,
    setup: AxisSetup,
    /// Whether it was homed on this connection: before, its motor may have been switched off, turned, and on again.
    seen_homed: AtomicBool,
}

/// What each unit complained about last, since its axis was told to move.
type Complaints = Arc<Mutex<HashMap<u8, String>>>;

struct ThorlabsDialogue {
    exchange: Exchange<Message>,
    identity: String,
    model: &'static Model,
    turn: tokio::sync::Mutex<Turn>,
    axes: Vec<Axis>,
    complaints: Complaints,
}

#[async_trait]
impl Driver for ThorlabsDriver {
    fn name(&self) -> &'static str {
        "thorlabs"
    }

    async fn connect(&self, wire: Wire, wanted: Wanted) -> Result<Arc<dyn Session>, DeviceError> {
        let (port, notices) = Port::start(wire, Apt::default(), wanted.orders.shared());
        let exchange = exchange(&wanted.name, port);
        // The first bytes of all stop what an earlier program left moving, and what it left talking: a unit whose states
        // nobody acknowledges falls silent.
        let units = wanted.axes.iter().filter_map(|link| checks::bay(link.setup()));
        let stops: Vec<u8> = units.map(|bay| FIRST_BAY + bay).chain([USB_UNIT]).flat_map(quiet).collect();
        exchange.port.urgent(&stops, false).map_err(|error| exchange.error("stop", error))?;
        let (info, complaints) = introduced(&exchange, notices).await?;
        let Some(model) = info.model() else {
            return Err(DeviceError::WrongDevice {
                device: exchange.name,
                expected: format!("a controller whose units are known here: {}", known_models()),
                found: info.to_string(),
            });
        };
        let turn = tokio::sync::Mutex::default();
        let identity = info.to_string();
        let mut dialogue = ThorlabsDialogue { exchange, identity, model, turn, axes: Vec::new(), complaints };
        let mut units = Vec::new();
        for link in &wanted.axes {
            let unit = dialogue.unit(link.setup()).await?;
            dialogue.settle(unit).await?;
            units.push(unit);
        }
        for (link, unit) in wanted.axes.iter().zip(units) {
            let axis = dialogue.learn(link.setup(), unit).await?;
            dialogue.axes.push(axis);
        }
        Polled::start(dialogue, wanted).await
    }

    async fn identify(&self, wire: Wire, name: &str) -> Result<String, DeviceError> {
        let (port, notices) = Port::start(wire, Apt::default(), Arc::default());
        Ok(introduced(&exchange(name, port), notices).await?.0.to_string())
    }
}

/// Stops what a unit does, and what it says by itself.
fn quiet(unit: u8) -> Vec<u8> {
    let stop = Message::short(id::STOP, unit, CHANNEL, Stop::Ramp as u8).bytes();
    [stop, Message::short(id::STOP_UPDATES, unit, 0, 0).bytes()].concat()
}

/// Asks both kinds of units what they are: only one of them is there.
fn who() -> Vec<u8> {
    [USB_UNIT, MAIN_BOARD].map(|unit| Message::short(id::REQ_INFO, unit, 0, 0).bytes()).concat()
}

fn exchange(name: &str, port: Port<Message>) -> Exchange<Message> {
    Exchange { name: name.to_owned(), port, resync: Some(who()), meaning: str::to_owned }
}

/// Asks the controller what it is. From then on what it says by itself is listened to for complaints.
async fn introduced(
    exchange: &Exchange<Message>,
    mut notices: mpsc::Receiver<Notice<Message>>,
) -> Result<(Info, Complaints), DeviceError> {
    let text = |message: &Message| format!("message {:#06x}", message.id);
    let answer = exchange.identify("a Thorlabs controller", &who(), &mut notices, text).await?;
    let info = answer.lines.last().and_then(Info::read);
    let info = info.ok_or_else(|| exchange.senseless("what it is without a name"))?;
    let heard = Complaints::default();
    let hears = Arc::clone(&heard);
    tokio::spawn(async move {
        while let Some(notice) = notices.recv().await {
            if let Some(words) = complaint(&notice.line) {
                tracing::warn!(unit = notice.line.source, %words, "a Thorlabs controller complains");
                hears.lock().unwrap_or_else(PoisonError::into_inner).insert(notice.line.source, words);
            }
        }
    });
    Ok((info, heard))
}

impl ThorlabsDialogue {
    /// What a look at an axis says.
    fn reading(&self, axis: &Axis, (position, bits): (i32, Bits)) -> AxisReading {
        AxisReading {
            position: f64::from(position) / axis.scale,
            moving: bits.moves(),
            referenced: Some(bits.knows_its_place() && axis.seen_homed.load(Ordering::SeqCst)),
            fault: bits.fault(),
        }
    }

    /// A target in the controller's units, where its own limits allow it: it would stop there, short of the target.
    fn target(&self, axis: &Axis, position: f64) -> Result<i32, DeviceError> {
        let refused = |reason: String| DeviceError::Refused { device: self.exchange.name.clone(), reason };
        if let Some((low, high)) = axis.limits.filter(|(low, high)| position < low - 0.5e-3 || position > high + 0.5e-3)
        {
            return Err(refused(format!(
                "{position:.3} mm is beyond the controller's soft limits, {low:.3} to {high:.3} mm in its own coordinate"
            )));
        }
        let target = (position * axis.scale).round();
        if target.abs() > f64::from(i32::MAX) {
            return Err(refused(format!("a target of {target} units is beyond what it counts to")));
        }
        Ok(target as i32)
    }

    /// Waits until an axis does what it was just told, or has done it; it says nothing when it is told.
    async fn begun(
        &self,
        turn: &mut Turn,
        axis: &Axis,
        what: &str,
        generation: u64,
        done: impl Fn(i32, Bits) -> bool,
    ) -> Result<(), DeviceError> {
        for _ in 0..BEGINNING {
            if self.exchange.port.generation() != generation {
                // A stop has come, which looks for itself.
                return Ok(());
            }
            // As a rule this says it at once.
            if self.state(turn, axis.unit).await?.1.moves() {
                return Ok(());
            }
            let (position, bits) = self.whole(turn, axis.unit).await?;
            if bits.moves() || done(position, bits) {
                return Ok(());
            }
        }
        Err(self.exchange.senseless(format!("it did not begin to {what}")))
    }

    fn complaints(&self) -> MutexGuard<'_, HashMap<u8, String>> {
        self.complaints.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What an axis's unit has complained about, or the controller that it is in: another bay's complaint says nothing of it.
    fn complaint(&self, unit: u8) -> Option<String> {
        let complaints = self.complaints();
        [unit, MAIN_BOARD, UNNAMED].iter().find_map(|source| complaints.get(source).cloned())
    }

    fn forget_complaints(&self, unit: u8) {
        self.complaints().retain(|&source, _| ![unit, MAIN_BOARD, UNNAMED].contains(&source));
    }
}

#[async_trait]
impl Dialogue for ThorlabsDialogue {
    fn identity(&self) -> String {
        self.identity.clone()
    }

    fn facts(&self, axis: usize) -> AxisFacts {
        self.axes[axis].facts.clone()
    }

    fn limits(&self, axis: usize) -> Option<(f64, f64)> {
        self.axes[axis].limits
    }

    /// Another program may set the position counter anew: it is only known once homing was watched.
    fn home_position(&self) -> Option<f64> {
        None
    }

    /// It would move without; but that it has been switched off and on shows only by its having lost its home.
    fn needs_reference(&self) -> bool {
        true
    }

    fn closed(&self) -> watch::Receiver<Option<String>> {
        self.exchange.port.closed()
    }

    fn close(&self, reason: &str) {
        self.exchange.port.close(reason);
    }

    async fn read(&self, axis: usize) -> Result<AxisReading, DeviceError> {
        let axis = &self.axes[axis];
        let mut turn = self.turn.lock().await;
        Ok(self.reading(axis, self.whole(&mut turn, axis.unit).await?))
    }

    /// Whether it is on is seen by its status: the question for that alone goes unanswered on some units.
    async fn prepare(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        let axis = &self.axes[axis];
        self.forget_complaints(axis.unit);
        let mut turn = self.turn.lock().await;
        let on = Message::short(id::SET_ENABLED, axis.unit, CHANNEL, 1);
        // No move has another acceleration than the configured one, nor a greater speed; homing has a speed of its own.
        self.at_speed(&mut turn, axis, axis.facts.speed_mm_per_s, on, generation).await?;
        for _ in 0..BEGINNING {
            if self.whole(&mut turn, axis.unit).await?.1.enabled() {
                return Ok(());
            }
        }
        let reason = "its motor stays switched off; see its display, or switch it on with Thorlabs' own program";
        Err(DeviceError::Refused { device: self.exchange.name.clone(), reason: reason.to_owned() })
    }

    async fn start_homing(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        let axis = &self.axes[axis];
        let mut turn = self.turn.lock().await;
        axis.seen_homed.store(false, Ordering::SeqCst);
        // Now: since it was connected it may have lost what was not stored, or been set by its own program.
        let homing = self.ask(&mut turn, axis.unit, "tell how it homes", id::REQ_HOMING, CHANNEL).await?;
        if let Some(reason) = checks::homes_elsewhere(&axis.setup, &homing) {
            return Err(DeviceError::Refused { device: self.exchange.name.clone(), reason });
        }
        let home = Message::short(id::MOVE_HOME, axis.unit, CHANNEL, 0);
        self.tell(&mut turn, axis.unit, "begin to home", home, generation).await?;
        // It still says that it is homed, of another time, until it begins.
        self.begun(&mut turn, axis, "home", generation, |_, bits| !bits.homed()).await
    }

    async fn homing(&self, axis: usize) -> Result<Homing, DeviceError> {
        let axis = &self.axes[axis];
        let mut turn = self.turn.lock().await;
        let (position, bits) = self.whole(&mut turn, axis.unit).await?;
        let reading = AxisReading { referenced: Some(bits.homed()), ..self.reading(axis, (position, bits)) };
        Ok(match reading.homing("limit switch") {
            Homing::Done(at) if at.abs() > HOME_MM => Homing::Failed(format!(
                "it says that it is homed, and stands at {at:.3} mm and not at its zero; home again"
            )),
            Homing::Done(at) => {
                axis.seen_homed.store(true, Ordering::SeqCst);
                Homing::Done(at)
            }
            other => other,
        })
    }

    async fn start_move(&self, axis: usize, position: f64, speed: f64, generation: u64) -> Result<(), DeviceError> {
        let axis = &self.axes[axis];
        let target = self.target(axis, position)?;
        self.forget_complaints(axis.unit);
        let mut turn = self.turn.lock().await;
        // Switched off and on while others were asked, it counts from where it stands.
        let (_, bits) = self.whole(&mut turn, axis.unit).await?;
        if !bits.knows_its_place() {
            let reason =
                "it has lost its reference, its motor is off, or its encoder has a fault; home the axis".to_owned();
            return Err(DeviceError::Refused { device: self.exchange.name.clone(), reason });
        }
        let go = Message::numbers(id::MOVE_ABSOLUTE, axis.unit, &[target]);
        self.at_speed(&mut turn, axis, speed, go, generation).await?;
        // At a limit it may not begin: why it stands tells that afterwards.
        let there =
            |at: i32, bits: Bits| (f64::from(at) - f64::from(target)).abs() < THERE_MM * axis.scale || bits.at_limit();
        self.begun(&mut turn, axis, "move", generation, there).await
    }

    async fn go_on(&self, axis: usize, position: f64, _: f64, generation: u64) -> Result<(), DeviceError> {
        let axis = &self.axes[axis];
        let go = Message::numbers(id::MOVE_ABSOLUTE, axis.unit, &[self.target(axis, position)?]);
        let mut turn = self.turn.lock().await;
        self.tell(&mut turn, axis.unit, "take a move", go, generation).await
    }

    async fn why_short(&self, axis: usize) -> Option<String> {
        let axis = &self.axes[axis];
        let mut turn = self.turn.lock().await;
        let seen = self.whole(&mut turn, axis.unit).await.ok();
        seen.and_then(|(_, bits)| bits.trouble()).or_else(|| self.complaint(axis.unit))
    }

    async fn switch_off(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        let axis = &self.axes[axis];
        let mut turn = self.turn.lock().await;
        let off = Message::short(id::SET_ENABLED, axis.unit, CHANNEL, 2);
        self.tell(&mut turn, axis.unit, "switch its motor off", off, generation).await
    }

    /// There is no message that stops all bays: one for each.
    fn halt(&self, hard: bool) -> Result<oneshot::Receiver<()>, PortError> {
        let how = if hard { Stop::AtOnce } else { Stop::Ramp };
        let stop = |axis: &Axis| Message::short(id::STOP, axis.unit, CHANNEL, how as u8).bytes();
        self.exchange.port.urgent(&self.axes.iter().flat_map(stop).collect::<Vec<u8>>(), false)
    }
}

/// Which question asks for position and status at once.
const fn state_question(motor: Motor) -> u16 {
    match motor {
        Motor::Servo => id::REQ_SERVO,
        Motor::Stepper => id::REQ_STEPPER,
    }
}
