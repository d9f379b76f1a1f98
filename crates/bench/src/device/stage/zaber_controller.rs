//! A connected Zaber controller: the questions and commands of its ASCII protocol.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use async_trait::async_trait;
use tokio::sync::{mpsc, oneshot, watch};

use super::axis::AxisSetup;
use super::exchange::{ANSWER, Exchange};
use super::polled::{AxisReading, Dialogue, Homing, Polled};
use super::session::{AxisFacts, Driver, Session, Wanted};
use super::zaber::{self, ACCELERATION_UNIT, Item, Message, SPEED_UNIT, Zaber};
use crate::device::DeviceError;
use crate::device::port::{Answer, Notice, Port, PortError};
use crate::device::serial::Wire;

/// Drives Zaber devices that speak the ASCII protocol (firmware 6 and 7).
#[derive(Debug, Clone, Copy)]
pub struct ZaberDriver {
    /// Address of the device in its chain.
    pub address: u8,
}

struct Axis {
    number: u8,
    /// Microsteps a millimetre.
    scale: f64,
    facts: AxisFacts,
    limits: (f64, f64),
}

struct ZaberDialogue {
    exchange: Exchange<Item>,
    address: u8,
    /// Number of the next command.
    next: AtomicU8,
    identity: String,
    /// Whether a move takes its speed and acceleration with it (firmware 7.25 and later).
    speed_in_move: bool,
    axes: Vec<Axis>,
}

#[async_trait]
impl Driver for ZaberDriver {
    fn name(&self) -> &'static str {
        "zaber"
    }

    async fn connect(&self, wire: Wire, wanted: Wanted) -> Result<Arc<dyn Session>, DeviceError> {
        let name = wanted.name.clone();
        let (port, notices) = Port::start(wire, Zaber::default(), wanted.orders.shared());
        let exchange = Exchange { name, port, resync: None, meaning: zaber::rejection };
        // The first bytes of all end what an earlier program left unfinished, and stop what it left moving.
        let mut stop = b"\n".to_vec();
        stop.extend(zaber::unnumbered(self.address, 0, "stop"));
        exchange.port.urgent(&stop, false).map_err(|error| exchange.error("stop", error))?;
        let mut dialogue = ZaberDialogue::introduced(exchange, self.address, notices).await?;
        for link in &wanted.axes {
            let axis = dialogue.learn(link.setup()).await?;
            dialogue.axes.push(axis);
        }
        Polled::start(dialogue, wanted).await
    }

    async fn identify(&self, wire: Wire, name: &str) -> Result<String, DeviceError> {
        let (port, notices) = Port::start(wire, Zaber::default(), Arc::default());
        let exchange = Exchange { name: name.to_owned(), port, resync: None, meaning: zaber::rejection };
        Ok(ZaberDialogue::introduced(exchange, self.address, notices).await?.identity)
    }
}

fn message(exchange: &Exchange<Item>, answer: Answer<Item>) -> Result<Message, DeviceError> {
    match answer.lines.into_iter().next_back() {
        Some(Item::Message(message)) => Ok(message),
        other => Err(exchange.senseless(format!("{other:?}"))),
    }
}

impl ZaberDialogue {
    /// Asks the device what it is.
    async fn introduced(
        exchange: Exchange<Item>,
        address: u8,
        mut notices: mpsc::Receiver<Notice<Item>>,
    ) -> Result<Self, DeviceError> {
        let mut dialogue = Self {
            exchange,
            address,
            next: AtomicU8::new(0),
            identity: String::new(),
            speed_in_move: false,
            axes: Vec::new(),
        };
        let question = dialogue.numbered(0, "get device.id");
        let text = |item: &Item| match item {
            Item::Message(message) => message.data.clone(),
            Item::Other(line) => line.clone(),
        };
        let what = format!("a Zaber device with the address {address}");
        let answer = dialogue.exchange.identify(&what, &question, &mut notices, text).await?;
        Exchange::drain(notices);
        let id = message(&dialogue.exchange, answer)?.data;
        let version = dialogue.setting(0, "version").await?;
        let serial = dialogue.setting(0, "system.serial").await?;
        dialogue.identity = format!("Zaber device {id}, serial number {serial}, firmware {version}");
        dialogue.speed_in_move = version.parse::<f64>().is_ok_and(|version| version >= 7.25);
        Ok(dialogue)
    }

    fn numbered(&self, axis: u8, words: &str) -> Vec<u8> {
        let id = self.next.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |id| Some((id + 1) % 100)).unwrap_or(0);
        zaber::command(self.address, axis, id, words)
    }

    async fn question(&self, axis: u8, words: &str) -> Result<Message, DeviceError> {
        let what = format!("answer `{words}`");
        // Each try has a number of its own, so that a late answer to the first is not taken for the second's.
        match self.exchange.port.ask(self.numbered(axis, words), ANSWER).await {
            Err(PortError::Timeout(_) | PortError::Cancelled) => {
                let answer = self.exchange.port.ask(self.numbered(axis, words), ANSWER).await;
                message(&self.exchange, answer.map_err(|error| self.exchange.error(&what, error))?)
            }
            answer => message(&self.exchange, answer.map_err(|error| self.exchange.error(&what, error))?),
        }
    }

    async fn setting(&self, axis: u8, name: &str) -> Result<String, DeviceError> {
        Ok(self.question(axis, &format!("get {name}")).await?.data)
    }

    async fn value(&self, axis: u8, name: &str) -> Result<f64, DeviceError> {
        let text = self.setting(axis, name).await?;
        let value = text.parse::<f64>().ok().filter(|value| value.is_finite());
        value.ok_or_else(|| self.exchange.senseless(format!("{name} is `{text}`")))
    }

    async fn command(&self, axis: usize, words: &str, generation: u64) -> Result<Message, DeviceError> {
        let bytes = self.numbered(self.axes[axis].number, words);
        let answer = self.exchange.command(&format!("take `{words}`"), bytes, generation).await?;
        message(&self.exchange, answer)
    }

    /// An axis's settings against its configuration.
    async fn learn(&self, setup: &AxisSetup) -> Result<Axis, DeviceError> {
        let (device, name, config) = (&self.exchange.name, setup.axis, &setup.config);
        let number = config.axis.parse().ok().filter(|number| (1..=9).contains(number)).ok_or_else(|| {
            let reason = format!("a Zaber device has no axis `{}`; its axes are 1 to 9", config.axis);
            DeviceError::Refused { device: device.clone(), reason }
        })?;
        let scale = config.steps_per_mm;
        let limits = (self.value(number, "limit.min").await? / scale, self.value(number, "limit.max").await? / scale);
        let speed = self.value(number, "maxspeed").await? / SPEED_UNIT / scale;
        let acceleration = self.value(number, "accel").await? / ACCELERATION_UNIT / scale;
        // Zaber's homing ends at position 0, at the negative end.
        let limits_mm = setup.range(limits, 0.0);
        let (mut disagreements, mut contradictions) = (Vec::new(), Vec::new());
        if !setup.homes_negative() {
            contradictions.push(format!(
                "The controller homes the {name} axis towards its negative end, the configuration says the other \
                 (bench.{name}.home_side and reversed)."
            ));
        }
        if speed < config.speed_mm_per_s * 0.999 {
            disagreements.push(format!(
                "The controller moves the {name} axis at {speed:.3} mm/s at most (maxspeed), the configuration says {} \
                 mm/s.",
                config.speed_mm_per_s
            ));
        }
        if speed > config.speed_mm_per_s * 1.001 && !self.speed_in_move {
            contradictions.push(format!(
                "The controller's firmware moves the {name} axis at {speed:.3} mm/s whatever a move asks for, faster than \
                 the configured {} mm/s; lower its maxspeed, or update its firmware to 7.25 or later.",
                config.speed_mm_per_s
            ));
        }
        // The protocol counts in whole units: half of one is none's fault.
        let unit = 1.0 / ACCELERATION_UNIT / scale;
        if (acceleration - config.acceleration_mm_per_s2).abs() > (0.01 * acceleration).max(0.51 * unit) {
            disagreements.push(format!(
                "The controller accelerates the {name} axis at {acceleration:.3} mm/s² (accel), the configuration says \
                 {} mm/s².",
                config.acceleration_mm_per_s2
            ));
        }
        let mut facts = AxisFacts {
            disagreements,
            contradictions,
            speed_mm_per_s: speed.min(config.speed_mm_per_s).max(1e-6),
            acceleration_mm_per_s2: acceleration.min(config.acceleration_mm_per_s2).max(1e-6),
            limits_mm: Some(limits_mm),
            ..AxisFacts::default()
        };
        facts.note(setup.compare_limits(limits_mm.0, limits_mm.1));
        Ok(Axis { number, scale, facts, limits })
    }
}

#[async_trait]
impl Dialogue for ZaberDialogue {
    fn identity(&self) -> String {
        self.identity.clone()
    }

    fn facts(&self, axis: usize) -> AxisFacts {
        self.axes[axis].facts.clone()
    }

    fn limits(&self, axis: usize) -> Option<(f64, f64)> {
        Some(self.axes[axis].limits)
    }

    fn home_position(&self) -> Option<f64> {
        Some(0.0)
    }

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
        let Axis { number, scale, .. } = &self.axes[axis];
        let answer = self.question(*number, "get pos").await?;
        let position: f64 = answer
            .data
            .parse()
            .ok()
            .filter(|position: &f64| position.is_finite())
            .ok_or_else(|| self.exchange.senseless(format!("its position is `{}`", answer.data)))?;
        let referenced = match zaber::referenced(&answer.flag) {
            Some(referenced) => referenced,
            None => zaber::all_referenced(&self.question(*number, "warnings").await?.data),
        };
        Ok(AxisReading {
            position: position / scale,
            moving: answer.busy,
            referenced: Some(referenced),
            fault: zaber::fault(&answer.flag),
        })
    }

    async fn prepare(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        self.command(axis, "warnings clear", generation).await?;
        self.command(axis, "driver enable", generation).await.map(|_| ())
    }

    async fn start_homing(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        self.command(axis, "home", generation).await.map(|_| ())
    }

    async fn homing(&self, axis: usize) -> Result<Homing, DeviceError> {
        Ok(self.read(axis).await?.homing("home sensor"))
    }

    async fn start_move(&self, axis: usize, position: f64, speed: f64, generation: u64) -> Result<(), DeviceError> {
        let Axis { scale, facts, .. } = &self.axes[axis];
        let mut words = format!("move abs {:.0}", position * scale);
        if self.speed_in_move {
            let speed = (speed * scale * SPEED_UNIT).round().max(1.0);
            let acceleration = (facts.acceleration_mm_per_s2 * scale * ACCELERATION_UNIT).round().max(1.0);
            words.push_str(&format!(" {speed:.0} {acceleration:.0}"));
        }
        self.command(axis, &words, generation).await.map(|_| ())
    }

    async fn why_short(&self, axis: usize) -> Option<String> {
        zaber::fault(&self.question(self.axes[axis].number, "get pos").await.ok()?.flag)
    }

    async fn interrupted(&self, axis: usize) -> Option<String> {
        zaber::interruption(&self.question(self.axes[axis].number, "get pos").await.ok()?.flag)
    }

    async fn switch_off(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        self.command(axis, "driver disable", generation).await.map(|_| ())
    }

    fn halt(&self, hard: bool) -> Result<oneshot::Receiver<()>, PortError> {
        let words = if hard { "estop" } else { "stop" };
        self.exchange.port.urgent(&zaber::unnumbered(self.address, 0, words), false)
    }
}
