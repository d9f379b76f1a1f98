//! A connected PI controller: the questions and commands of GCS 2.

use std::sync::{Arc, Mutex, PoisonError};

use async_trait::async_trait;
use tokio::sync::{mpsc, oneshot, watch};

use super::axis::AxisSetup;
use super::exchange::Exchange;
use super::pi::{self, Line, Pi};
use super::polled::{AxisReading, Dialogue, Homing, Polled};
use super::session::{AxisFacts, Driver, Session, Wanted};
use crate::device::DeviceError;
use crate::device::port::{Answer, Notice, Port, PortError};
use crate::device::serial::Wire;

/// Drives PI controllers that speak GCS 2 and have limit switches and a servo, e.g. C-863.
#[derive(Debug, Clone, Copy, Default)]
pub struct PiDriver;

struct Axis {
    name: String,
    /// Its bit in the answer to #5.
    bit: u64,
    /// The controller's units a millimetre.
    scale: f64,
    facts: AxisFacts,
    /// The controller's limits, mm.
    limits: (f64, f64),
    homes_negative: bool,
}

struct PiDialogue {
    exchange: Exchange<Line>,
    identity: String,
    axes: Vec<Axis>,
    /// An error that the controller made by itself and that asking has cleared; until the next homing.
    fault: Mutex<Option<String>>,
}

#[async_trait]
impl Driver for PiDriver {
    fn name(&self) -> &'static str {
        "pi"
    }

    async fn connect(&self, wire: Wire, wanted: Wanted) -> Result<Arc<dyn Session>, DeviceError> {
        let name = wanted.name.clone();
        let (port, notices) = Port::start(wire, Pi::default(), wanted.orders.shared());
        let exchange = exchange(name, port);
        // The first bytes of all stop what an earlier program left moving, and end what it left unfinished.
        exchange.port.urgent(&[pi::STOP, b'\n'], false).map_err(|error| exchange.error("stop", error))?;
        let identity = identity(&exchange, notices).await?;
        let mut dialogue = PiDialogue { exchange, identity, axes: Vec::new(), fault: Mutex::new(None) };
        // What the stop made, and what was there before, is no error of ours.
        dialogue.error().await?;
        let names = dialogue.exchange.ask("name its axes", b"SAI?\n").await?;
        let names: Vec<String> = names.lines.into_iter().map(|line| line.text).collect();
        for link in &wanted.axes {
            let axis = dialogue.learn(link.setup(), &names).await?;
            dialogue.axes.push(axis);
        }
        Polled::start(dialogue, wanted).await
    }

    async fn identify(&self, wire: Wire, name: &str) -> Result<String, DeviceError> {
        let (port, notices) = Port::start(wire, Pi::default(), Arc::default());
        identity(&exchange(name.to_owned(), port), notices).await
    }
}

fn exchange(name: String, port: Port<Line>) -> Exchange<Line> {
    Exchange { name, port, resync: Some(pi::IDENTITY.to_vec()), meaning: str::to_owned }
}

/// Asks the controller what it is.
async fn identity(exchange: &Exchange<Line>, mut notices: mpsc::Receiver<Notice<Line>>) -> Result<String, DeviceError> {
    let what = "a PI controller that speaks GCS 2";
    let answer = exchange.identify(what, pi::IDENTITY, &mut notices, |line| line.text.clone()).await?;
    Exchange::drain(notices);
    let identity = last(exchange, answer)?;
    if identity.contains("Physik Instrumente") || identity.contains("PI") {
        return Ok(identity);
    }
    Err(DeviceError::WrongDevice { device: exchange.name.clone(), expected: what.to_owned(), found: identity })
}

fn last(exchange: &Exchange<Line>, answer: Answer<Line>) -> Result<String, DeviceError> {
    let line = answer.lines.into_iter().next_back();
    line.map(|line| line.text).ok_or_else(|| exchange.senseless("an answer without a line"))
}

impl PiDialogue {
    async fn number(&self, word: &str, axis: &str) -> Result<f64, DeviceError> {
        let answer = self.exchange.ask(&format!("answer {word}"), pi::question(word, axis)).await?;
        let line = last(&self.exchange, answer)?;
        pi::number(&line, axis).ok_or_else(|| self.exchange.senseless(format!("{word} {axis}: `{line}`")))
    }

    async fn yes(&self, word: &str, axis: &str) -> Result<bool, DeviceError> {
        Ok(self.number(word, axis).await? != 0.0)
    }

    /// Asks for the error, which clears it.
    async fn error(&self) -> Result<i32, DeviceError> {
        let line = last(&self.exchange, self.exchange.ask("answer ERR?", pi::ERROR).await?)?;
        line.parse().map_err(|_| self.exchange.senseless(format!("ERR?: `{line}`")))
    }

    /// Which axes move, a bit each.
    async fn moving(&self) -> Result<u64, DeviceError> {
        let line = last(&self.exchange, self.exchange.ask("say what moves", [pi::MOTION]).await?)?;
        u64::from_str_radix(line.trim_start_matches("0x"), 16)
            .map_err(|_| self.exchange.senseless(format!("what moves: `{line}`")))
    }

    /// Commands, and asks whether they were taken.
    async fn command(&self, commands: &[String], generation: u64) -> Result<(), DeviceError> {
        let what = format!("take {}", commands.join(", "));
        let answer = self.exchange.command(&what, pi::checked(commands), generation).await?;
        let line = last(&self.exchange, answer)?;
        match line.parse::<i32>() {
            Ok(0) => Ok(()),
            Ok(error) => {
                self.note(error);
                Err(DeviceError::Refused {
                    device: self.exchange.name.clone(),
                    reason: format!("error {error}: {} ({})", pi::error_meaning(error), commands.join(", ")),
                })
            }
            Err(_) => Err(self.exchange.senseless(format!("ERR?: `{line}`"))),
        }
    }

    fn fault(&self) -> Option<String> {
        self.fault.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn set_fault(&self, fault: Option<String>) {
        *self.fault.lock().unwrap_or_else(PoisonError::into_inner) = fault;
    }

    /// Keeps an error that is the controller's own, which asking has cleared: a negative one. The others are told to
    /// whoever gave the command.
    fn note(&self, error: i32) {
        if error < 0 {
            self.set_fault(Some(format!("error {error}: {}", pi::error_meaning(error))));
        }
    }

    /// An axis's settings against its configuration.
    async fn learn(&self, setup: &AxisSetup, names: &[String]) -> Result<Axis, DeviceError> {
        let (device, config) = (&self.exchange.name, &setup.config);
        let (name, axis) = (config.axis.clone(), setup.axis);
        let index = names.iter().position(|found| *found == name).filter(|&index| index < 64).ok_or_else(|| {
            let reason = format!("it has no axis `{name}`; its axes are {}", names.join(", "));
            DeviceError::Refused { device: device.clone(), reason }
        })?;
        let scale = config.steps_per_mm;
        let (mut disagreements, mut contradictions) = (Vec::new(), Vec::new());
        // Not every controller knows the question: then the unit stays untold.
        if let Ok(answer) = self.exchange.ask("name its unit", pi::question("PUN?", &name)).await {
            let line = last(&self.exchange, answer)?;
            let unit = pi::value(&line, &name).unwrap_or_default().to_ascii_uppercase();
            let told = match unit.as_str() {
                "MM" => Some(1.0),
                "UM" | "\u{b5}M" | "MICRON" => Some(1000.0),
                _ => None,
            };
            match told {
                Some(told) if f64::abs(told / scale - 1.0) > 1e-9 => contradictions.push(format!(
                    "The controller counts the {axis} axis in {unit} (PUN?), {told} a millimetre; the configuration \
                     says {scale} (bench.{axis}.steps_per_mm)."
                )),
                None => disagreements.push(format!(
                    "The controller counts the {axis} axis in `{unit}` (PUN?), whose length is not known here."
                )),
                Some(_) => {}
            }
        }
        let limits = (self.number("TMN?", &name).await? / scale, self.number("TMX?", &name).await? / scale);
        let homes_negative = setup.homes_negative();
        // A reference move to a limit ends there; should it end elsewhere, the limits are compared again after it.
        let home = if homes_negative { limits.0 } else { limits.1 };
        let limits_mm = setup.range(limits, home);
        let acceleration = self.number("ACC?", &name).await.map(|acceleration| acceleration / scale);
        if let Ok(acceleration) = acceleration
            && (acceleration / config.acceleration_mm_per_s2 - 1.0).abs() > 0.01
        {
            disagreements.push(format!(
                "The controller accelerates the {axis} axis at {acceleration:.3} mm/s² (ACC?), the configuration says \
                 {} mm/s².",
                config.acceleration_mm_per_s2
            ));
        }
        // A question that it does not know leaves an error behind.
        self.error().await?;
        let acceleration = acceleration.unwrap_or(config.acceleration_mm_per_s2);
        let mut facts = AxisFacts {
            disagreements,
            contradictions,
            speed_mm_per_s: config.speed_mm_per_s,
            acceleration_mm_per_s2: acceleration.min(config.acceleration_mm_per_s2).max(1e-6),
            limits_mm: Some(limits_mm),
            ..AxisFacts::default()
        };
        facts.note(setup.compare_limits(limits_mm.0, limits_mm.1));
        Ok(Axis { name, bit: 1 << index, scale, facts, limits, homes_negative })
    }
}

#[async_trait]
impl Dialogue for PiDialogue {
    fn identity(&self) -> String {
        self.identity.clone()
    }

    fn facts(&self, axis: usize) -> AxisFacts {
        self.axes[axis].facts.clone()
    }

    fn limits(&self, axis: usize) -> Option<(f64, f64)> {
        Some(self.axes[axis].limits)
    }

    /// Where a reference move ends is a setting of the stage's: it is only known once one was watched.
    fn home_position(&self) -> Option<f64> {
        None
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

    /// Neighbouring questions have answers of different forms, so that a doubled answer is never taken for the next.
    async fn read(&self, axis: usize) -> Result<AxisReading, DeviceError> {
        let Axis { name, bit, scale, .. } = &self.axes[axis];
        let moving = self.moving().await? & bit != 0;
        let position = self.number("POS?", name).await? / scale;
        let error = self.error().await?;
        let referenced = self.yes("FRF?", name).await?;
        self.note(error);
        Ok(AxisReading { position, moving, referenced: Some(referenced), fault: self.fault() })
    }

    /// Its neighbours are orders, whose answers have another form. That it is not referenced, or has failed, these tell.
    async fn glance(&self, axis: usize) -> Result<AxisReading, DeviceError> {
        let Axis { name, bit, scale, .. } = &self.axes[axis];
        let moving = self.moving().await? & bit != 0;
        let position = self.number("POS?", name).await? / scale;
        Ok(AxisReading { position, moving, referenced: None, fault: self.fault() })
    }

    async fn prepare(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        self.set_fault(None);
        self.error().await?;
        self.command(&[format!("SVO {} 1", self.axes[axis].name)], generation).await
    }

    /// Runs to the limit switch at the configured side: which way a search for a reference switch begins depends on
    /// where the axis stands.
    async fn start_homing(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        let Axis { name, homes_negative, .. } = &self.axes[axis];
        let word = if *homes_negative { "FNL" } else { "FPL" };
        self.command(&[format!("{word} {name}")], generation).await
    }

    async fn homing(&self, axis: usize) -> Result<Homing, DeviceError> {
        Ok(self.read(axis).await?.homing("limit switch"))
    }

    async fn start_move(&self, axis: usize, position: f64, speed: f64, generation: u64) -> Result<(), DeviceError> {
        let Axis { name, scale, .. } = &self.axes[axis];
        let commands = [format!("VEL {name} {:.6}", speed * scale), format!("MOV {name} {:.6}", position * scale)];
        self.command(&commands, generation).await
    }

    async fn why_short(&self, _: usize) -> Option<String> {
        self.fault()
    }

    async fn switch_off(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        self.command(&[format!("SVO {} 0", self.axes[axis].name)], generation).await
    }

    fn halt(&self, _: bool) -> Result<oneshot::Receiver<()>, PortError> {
        self.exchange.port.urgent(&[pi::STOP], false)
    }
}
