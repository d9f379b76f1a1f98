//! A connected Trinamic module: the questions and commands of TMCL.

use std::sync::atomic::{AtomicI32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use async_trait::async_trait;
use tokio::sync::{mpsc, oneshot, watch};

use super::axis::AxisSetup;
use super::exchange::Exchange;
use super::polled::{AxisReading, Dialogue, Homing, Polled};
use super::session::{AxisFacts, Driver, Session, Wanted};
use super::tmcl::{self, Frame, Reply, Request, Tmcl, command, parameter};
use crate::device::DeviceError;
use crate::device::port::{Answer, Notice, Port, PortError};
use crate::device::serial::Wire;

/// The user's global parameter that tells a module that was switched off and on: it is lost then.
const MARK: u8 = 55;
/// No current of this size exists: the current at rest has not been taken away.
const UNTOUCHED: i32 = -1;

/// Drives Trinamic modules whose speeds are microsteps a second, over TMCL in direct mode.
#[derive(Debug, Clone, Copy)]
pub struct TmclDriver {
    /// Address of the module.
    pub address: u8,
}

struct Axis {
    motor: u8,
    /// Microsteps a millimetre.
    scale: f64,
    facts: AxisFacts,
    homes_negative: bool,
    /// Current at rest before the motor was switched off.
    standby: AtomicI32,
}

struct TmclDialogue {
    exchange: Exchange<Frame>,
    address: u8,
    model: u16,
    identity: String,
    /// What the mark was set to.
    mark: i32,
    turn: tokio::sync::Mutex<Turn>,
    /// How many stops have been sent.
    stops: Mutex<u64>,
    axes: Vec<Axis>,
}

/// What keeps one exchange's answer from being taken for another's, whichever tasks ask: an answer names its command and
/// no motor or parameter, and may come late or doubled. So no two exchanges with the same command are neighbours: the
/// answer to the one between them comes after every answer to the first.
struct Turn {
    /// Command of the last exchange.
    last: u8,
    /// How many stops had been sent before the last exchange that was put between two.
    stops: u64,
}

#[async_trait]
impl Driver for TmclDriver {
    fn name(&self) -> &'static str {
        "tmcl"
    }

    async fn connect(&self, wire: Wire, wanted: Wanted) -> Result<Arc<dyn Session>, DeviceError> {
        let name = wanted.name.clone();
        let (port, notices) = Port::start(wire, Tmcl::default(), wanted.orders.shared());
        let (exchange, model, identity) = self.introduced(name, port, notices).await?;
        if tmcl::INTERNAL_UNITS.contains(&model) {
            return Err(DeviceError::WrongDevice {
                device: exchange.name,
                expected: "a module whose speeds are microsteps a second, e.g. TMCM-6214".to_owned(),
                found: format!("TMCM-{model}, whose speeds are numbers of its own"),
            });
        }
        let mut dialogue = TmclDialogue {
            exchange,
            address: self.address,
            model,
            identity,
            // Another one at every connection, and never 0.
            mark: i32::from(rand::random::<u16>()) + 1,
            turn: tokio::sync::Mutex::new(Turn { last: command::VERSION, stops: 0 }),
            stops: Mutex::default(),
            axes: Vec::new(),
        };
        for link in &wanted.axes {
            // Nothing that an earlier program started goes on.
            let motor = motor(&dialogue.exchange.name, link.setup())?;
            dialogue.stop_motor(motor).await?;
        }
        for link in &wanted.axes {
            let axis = dialogue.learn(link.setup()).await?;
            dialogue.axes.push(axis);
        }
        dialogue.ask("take a mark", (command::SGP, MARK, tmcl::USER_BANK), dialogue.mark).await?;
        Polled::start(dialogue, wanted).await
    }

    async fn identify(&self, wire: Wire, name: &str) -> Result<String, DeviceError> {
        let (port, notices) = Port::start(wire, Tmcl::default(), Arc::default());
        Ok(self.introduced(name.to_owned(), port, notices).await?.2)
    }
}

impl TmclDriver {
    /// Asks the module what it is; returns its model, and that with its firmware in words.
    async fn introduced(
        self,
        name: String,
        port: Port<Frame>,
        mut notices: mpsc::Receiver<Notice<Frame>>,
    ) -> Result<(Exchange<Frame>, u16, String), DeviceError> {
        let version = Request { address: self.address, command: command::VERSION, kind: 1, motor: 0, value: 0 };
        let resync = Some(version.frame().to_vec());
        let exchange = Exchange { name, port, resync, meaning: refusal };
        let what = format!("a Trinamic module with the address {}", self.address);
        let text = |frame: &Frame| format!("{frame:02x?}");
        let answer = exchange.identify(&what, &version.frame(), &mut notices, text).await?;
        Exchange::drain(notices);
        let value = reply(&exchange, &answer)?.value as u32;
        let (model, major, minor) = ((value >> 16) as u16, (value >> 8) & 0xFF, value & 0xFF);
        Ok((exchange, model, format!("TMCM-{model}, firmware {major}.{minor:02}")))
    }
}

fn refusal(status: &str) -> String {
    let number = status.parse().unwrap_or(0);
    format!("status {number}: {}", tmcl::status_meaning(number))
}

fn reply(exchange: &Exchange<Frame>, answer: &Answer<Frame>) -> Result<Reply, DeviceError> {
    answer.lines.last().map(Reply::read).ok_or_else(|| exchange.senseless("an answer without a frame"))
}

fn motor(device: &str, setup: &AxisSetup) -> Result<u8, DeviceError> {
    setup.config.axis.parse().ok().filter(|motor| *motor < 6).ok_or_else(|| DeviceError::Refused {
        device: device.to_owned(),
        reason: format!("a Trinamic module has no motor `{}`; its motors are 0 to 5", setup.config.axis),
    })
}

impl TmclDialogue {
    fn request(&self, command: u8, kind: u8, motor: u8, value: i32) -> Frame {
        Request { address: self.address, command, kind, motor, value }.frame()
    }

    /// Waits until an exchange with a command may begin, and puts one with another command before it if need be. The
    /// exchange lasts as long as what is returned is held.
    async fn turn(&self, command: u8) -> Result<tokio::sync::MutexGuard<'_, Turn>, DeviceError> {
        let mut turn = self.turn.lock().await;
        // A stop is written past every queue, and what it is made of is answered like any exchange.
        let in_stop = matches!(command, command::RFS | command::MST) && turn.stops != *self.stops();
        if turn.last == command || in_stop {
            let (other, kind, bank) = match [command, turn.last].contains(&command::GGP) {
                true => (command::VERSION, 1, 0),
                false => (command::GGP, MARK, tmcl::USER_BANK),
            };
            let stops = *self.stops();
            // Before it is written: dropped from here on, it is written all the same.
            turn.last = other;
            self.exchange.ask("answer", self.request(other, kind, bank, 0)).await?;
            turn.stops = stops;
        }
        turn.last = command;
        Ok(turn)
    }

    fn stops(&self) -> MutexGuard<'_, u64> {
        self.stops.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Asks, once more if no answer came; also for what no stop makes outdated.
    async fn ask(&self, what: &str, (command, kind, motor): (u8, u8, u8), value: i32) -> Result<i32, DeviceError> {
        let _turn = self.turn(command).await?;
        let answer = self.exchange.ask(what, self.request(command, kind, motor, value)).await?;
        Ok(reply(&self.exchange, &answer)?.value)
    }

    async fn parameter(&self, motor: u8, number: u8) -> Result<i32, DeviceError> {
        self.ask(&format!("tell its parameter {number}"), (command::GAP, number, motor), 0).await
    }

    /// Whether the module has kept its mark, and so has not been switched off and on.
    async fn marked(&self) -> Result<bool, DeviceError> {
        Ok(self.ask("tell its mark", (command::GGP, MARK, tmcl::USER_BANK), 0).await? == self.mark)
    }

    async fn stop_motor(&self, motor: u8) -> Result<(), DeviceError> {
        self.ask("end a search", (command::RFS, 1, motor), 0).await?;
        self.ask("stop", (command::MST, 0, motor), 0).await.map(|_| ())
    }

    async fn command(
        &self,
        what: &str,
        (command, kind, motor): (u8, u8, u8),
        value: i32,
        generation: u64,
    ) -> Result<(), DeviceError> {
        let _turn = self.turn(command).await?;
        self.exchange.command(what, self.request(command, kind, motor, value), generation).await.map(|_| ())
    }

    /// An axis's settings against its configuration.
    async fn learn(&self, setup: &AxisSetup) -> Result<Axis, DeviceError> {
        let (axis, config) = (setup.axis, &setup.config);
        let motor = motor(&self.exchange.name, setup)?;
        let scale = config.steps_per_mm;
        // A module without the choice refuses the question.
        if self.parameter(motor, parameter::UNIT_MODE).await == Ok(0) {
            return Err(DeviceError::Refused {
                device: self.exchange.name.clone(),
                reason: format!("its speeds are numbers of its own; set axis parameter 255 of motor {motor} to 1"),
            });
        }
        let (mut disagreements, mut contradictions) = (Vec::new(), Vec::new());
        // A module that cannot turn its motors the other way round refuses the question.
        let inverted = match self.parameter(motor, parameter::REVERSE_SHAFT).await {
            Ok(value) => value != 0,
            Err(DeviceError::Refused { .. }) => false,
            Err(error) => return Err(error),
        };
        if inverted != config.motor_inverted {
            contradictions.push(format!(
                "The controller {} the {axis} axis's motor the other way round (axis parameter 251), the configuration \
                 says that it {} (bench.{axis}.motor_inverted).",
                if inverted { "turns" } else { "does not turn" },
                if inverted { "does not" } else { "does" },
            ));
        }
        let acceleration = f64::from(self.parameter(motor, parameter::ACCELERATION).await?) / scale;
        if (acceleration / config.acceleration_mm_per_s2 - 1.0).abs() > 0.01 {
            disagreements.push(format!(
                "The controller accelerates the {axis} axis at {acceleration:.3} mm/s² (axis parameter 5), the \
                 configuration says {} mm/s².",
                config.acceleration_mm_per_s2
            ));
        }
        for (number, side) in [(parameter::LEFT_DISABLED, "left"), (parameter::RIGHT_DISABLED, "right")] {
            // Some models mean the opposite by it.
            if !tmcl::STOPS_BY_ONE.contains(&self.model) && self.parameter(motor, number).await? != 0 {
                disagreements.push(format!(
                    "The {side} limit switch of the {axis} axis stops nothing (axis parameter {number})."
                ));
            }
        }
        let facts = AxisFacts {
            disagreements,
            contradictions,
            speed_mm_per_s: config.speed_mm_per_s,
            acceleration_mm_per_s2: acceleration.min(config.acceleration_mm_per_s2).max(1e-6),
            // TMCL has switches at the ends and no limits in numbers.
            limits_mm: None,
            ..AxisFacts::default()
        };
        let homes_negative = setup.homes_negative();
        Ok(Axis { motor, scale, facts, homes_negative, standby: AtomicI32::new(UNTOUCHED) })
    }
}

#[async_trait]
impl Dialogue for TmclDialogue {
    fn identity(&self) -> String {
        self.identity.clone()
    }

    fn facts(&self, axis: usize) -> AxisFacts {
        self.axes[axis].facts.clone()
    }

    fn limits(&self, _: usize) -> Option<(f64, f64)> {
        None
    }

    fn home_position(&self) -> Option<f64> {
        None
    }

    fn needs_reference(&self) -> bool {
        false
    }

    fn closed(&self) -> watch::Receiver<Option<String>> {
        self.exchange.port.closed()
    }

    fn close(&self, reason: &str) {
        self.exchange.port.close(reason);
    }

    async fn read(&self, axis: usize) -> Result<AxisReading, DeviceError> {
        let Axis { motor, scale, .. } = &self.axes[axis];
        let speed = self.parameter(*motor, parameter::ACTUAL_SPEED).await?;
        let searching = self.ask("tell of its search", (command::RFS, 2, *motor), 0).await? != 0;
        let position = self.parameter(*motor, parameter::POSITION).await?;
        let marked = self.marked().await?;
        Ok(AxisReading {
            position: f64::from(position) / scale,
            moving: speed != 0 || searching,
            // It cannot say that it is referenced; without its mark it was switched off and is not.
            referenced: (!marked).then_some(false),
            fault: None,
        })
    }

    async fn glance(&self, axis: usize) -> Result<AxisReading, DeviceError> {
        let Axis { motor, scale, .. } = &self.axes[axis];
        // A module that has been switched off and on counts from 0 again.
        let marked = self.marked().await?;
        let position = f64::from(self.parameter(*motor, parameter::POSITION).await?) / scale;
        Ok(AxisReading { position, moving: true, referenced: (!marked).then_some(false), fault: None })
    }

    async fn prepare(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        if !self.marked().await? {
            let mark = (command::SGP, MARK, tmcl::USER_BANK);
            self.command("take a mark", mark, self.mark, generation).await?;
        }
        let Axis { motor, standby, .. } = &self.axes[axis];
        let current = standby.swap(UNTOUCHED, Ordering::SeqCst);
        if current == UNTOUCHED {
            return Ok(());
        }
        self.command("switch on", (command::SAP, parameter::STANDBY_CURRENT, *motor), current, generation).await
    }

    async fn start_homing(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        let Axis { motor, homes_negative, .. } = &self.axes[axis];
        let mode = tmcl::SEARCH_LEFT_SWITCH + if *homes_negative { 0 } else { tmcl::SEARCH_RIGHT };
        self.command("take a search mode", (command::SAP, parameter::SEARCH_MODE, *motor), mode, generation).await?;
        self.command("begin a search", (command::RFS, 0, *motor), 0, generation).await
    }

    async fn homing(&self, axis: usize) -> Result<Homing, DeviceError> {
        let reading = self.read(axis).await?;
        Ok(match reading {
            AxisReading { moving: true, position, .. } => Homing::Running(position),
            AxisReading { referenced: Some(false), .. } => {
                Homing::Failed("it was switched off and on while homing; home it again".to_owned())
            }
            AxisReading { position, .. } => Homing::Done(position),
        })
    }

    async fn start_move(&self, axis: usize, position: f64, speed: f64, generation: u64) -> Result<(), DeviceError> {
        let Axis { motor, scale, .. } = &self.axes[axis];
        let speed = (speed * scale).round().clamp(1.0, f64::from(i32::MAX)) as i32;
        self.command("take a speed", (command::SAP, parameter::SPEED, *motor), speed, generation).await?;
        self.go_on(axis, position, 0.0, generation).await
    }

    async fn go_on(&self, axis: usize, position: f64, _: f64, generation: u64) -> Result<(), DeviceError> {
        let Axis { motor, scale, .. } = &self.axes[axis];
        let target = (position * scale).round();
        if target.abs() > f64::from(i32::MAX) {
            return Err(self.exchange.senseless(format!("a target of {target} microsteps")));
        }
        self.command("take a move", (command::MVP, 0, *motor), target as i32, generation).await
    }

    async fn why_short(&self, axis: usize) -> Option<String> {
        let motor = self.axes[axis].motor;
        let left = self.parameter(motor, parameter::LEFT_SWITCH).await.is_ok_and(|closed| closed != 0);
        let right = self.parameter(motor, parameter::RIGHT_SWITCH).await.is_ok_and(|closed| closed != 0);
        let side = if left {
            "left"
        } else if right {
            "right"
        } else {
            return None;
        };
        Some(format!("its {side} limit switch was hit; find out why, then home the axis"))
    }

    /// A module has no switch for its motors: it takes the current at rest away.
    async fn switch_off(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        let Axis { motor, standby, .. } = &self.axes[axis];
        if standby.load(Ordering::SeqCst) == UNTOUCHED {
            standby.store(self.parameter(*motor, parameter::STANDBY_CURRENT).await?, Ordering::SeqCst);
        }
        self.command("switch off", (command::SAP, parameter::STANDBY_CURRENT, *motor), 0, generation).await
    }

    fn halt(&self, _: bool) -> Result<oneshot::Receiver<()>, PortError> {
        let mut bytes = Vec::new();
        for axis in &self.axes {
            bytes.extend(self.request(command::RFS, 1, axis.motor, 0));
            bytes.extend(self.request(command::MST, 0, axis.motor, 0));
        }
        // Counted together with its being queued: what is asked once it counts is written after it.
        let mut stops = self.stops();
        *stops += 1;
        self.exchange.port.urgent(&bytes, false)
    }
}
