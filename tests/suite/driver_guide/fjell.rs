//! The Fjell F2, an invented controller of up to four axes: its driver, all of it.

use std::sync::Arc;

use async_trait::async_trait;
use plenalign::device::DeviceError;
use plenalign::device::port::{Kind, LineBuffer, Notice, Port, PortError, Protocol, Recovery};
use plenalign::device::serial::Wire;
use plenalign::device::stage::axis::AxisSetup;
use plenalign::device::stage::exchange::Exchange;
use plenalign::device::stage::polled::{AxisReading, Dialogue, Homing, Polled};
use plenalign::device::stage::session::{AxisFacts, Driver, Session, Wanted};
use tokio::sync::{mpsc, oneshot, watch};

/// Asks what the controller is.
const IDENTITY: &[u8] = b"ID\r";
/// Stops every axis, wherever it comes in the stream; answered by nothing.
const STOP: &[u8] = b"!";
/// Where homing ends, in the controller's own coordinate, mm.
const HOME_MM: f64 = 0.0;

/// Cuts the stream into lines, and knows an answer by the word that it repeats.
#[derive(Default)]
pub(super) struct Fjell {
    lines: LineBuffer,
}

/// The word that a request begins with and its answer repeats: `A?` of `A?`, `AG` of `AG 1200 500`.
fn word(request: &[u8]) -> &[u8] {
    request.split(|byte| matches!(byte, b' ' | b'\r')).next().unwrap_or_default()
}

/// The numbers behind an answer's word, where there are so many and nothing else.
fn numbers<const N: usize>(line: &str) -> Option<[f64; N]> {
    let number = |text: &str| text.parse().ok().filter(|number: &f64| number.is_finite());
    line.split(' ').skip(1).map(number).collect::<Option<Vec<f64>>>()?.try_into().ok()
}

/// Whether a line has the form of the answer to a request of this word. Widths are fixed: with a byte lost it has not.
fn fits(word: &[u8], line: &str) -> bool {
    match word {
        b"ID" => line.len() > 3,
        [_, b'?'] => line.len() == 18 && numbers::<4>(line).is_some(),
        [_, b'L'] => line.len() == 22 && numbers::<2>(line).is_some(),
        _ => line.ends_with(" OK"),
    }
}

impl Protocol for Fjell {
    type Message = String;
    // A late answer looks like the next one: after a time-out nothing is asked until the port is back in step.
    const RECOVERY: Recovery = Recovery::Required;
    // The controller picks the stop out of the stream, also from the middle of a line.
    const URGENT_ANYWHERE: bool = true;

    fn frame(&mut self, bytes: &[u8]) -> Vec<String> {
        self.lines.push(bytes)
    }

    fn gap(&mut self) {
        self.lines = LineBuffer::default();
    }

    fn classify(&self, line: &String, request: Option<&[u8]>) -> Kind {
        let Some(request) = request else { return Kind::Noise };
        match line.as_bytes().strip_prefix(word(request)) {
            Some([b' ', b'E', ..]) => Kind::Refused,
            Some(_) if fits(word(request), line) => Kind::Last,
            // An answer to something else, one that has lost a byte, or what was sent, come back: not this answer.
            _ => Kind::Noise,
        }
    }

    fn text(&self, line: &String) -> String {
        line.clone()
    }
}

/// A refusal in words: what is wrong, and what to do about it.
fn meaning(line: &str) -> String {
    let words = match line.rsplit(' ').next() {
        Some("E1") => "it does not know the command",
        Some("E2") => "the axis is not homed; home it",
        Some("E3") => "the position is beyond its limits",
        Some("E4") => "the motor is off, or in fault; home the axis",
        _ => "see the controller's manual",
    };
    format!("`{line}`: {words}")
}

/// Why an axis cannot move, by the number that the controller gives.
fn fault(code: f64) -> Option<String> {
    match code as i64 {
        0 => None,
        1 => Some("a limit switch is closed (fault 1); home the axis".to_owned()),
        2 => Some("the motor's driver is too hot (fault 2); let it cool down, then home the axis".to_owned()),
        other => Some(format!("fault {other}; see the controller's manual, then home the axis")),
    }
}

/// Drives Fjell F2 controllers.
#[derive(Debug, Clone, Copy)]
pub(super) struct FjellDriver;

struct Axis {
    letter: String,
    /// The controller's units a millimetre.
    scale: f64,
    facts: AxisFacts,
    /// The controller's own limits, mm.
    limits: (f64, f64),
}

struct FjellDialogue {
    exchange: Exchange<String>,
    identity: String,
    axes: Vec<Axis>,
}

#[async_trait]
impl Driver for FjellDriver {
    fn name(&self) -> &'static str {
        "fjell"
    }

    async fn connect(&self, wire: Wire, wanted: Wanted) -> Result<Arc<dyn Session>, DeviceError> {
        let (port, notices) = Port::start(wire, Fjell::default(), wanted.orders.shared());
        let exchange = exchange(&wanted.name, port);
        // The first bytes of all stop what an earlier program left moving, and end what it left unfinished.
        exchange.port.urgent(b"!\r", false).map_err(|error| exchange.error("stop", error))?;
        let identity = identity(&exchange, notices).await?;
        let mut dialogue = FjellDialogue { exchange, identity, axes: Vec::new() };
        for link in &wanted.axes {
            let axis = dialogue.learn(link.setup()).await?;
            dialogue.axes.push(axis);
        }
        Polled::start(dialogue, wanted).await
    }

    async fn identify(&self, wire: Wire, name: &str) -> Result<String, DeviceError> {
        let (port, notices) = Port::start(wire, Fjell::default(), Arc::default());
        identity(&exchange(name, port), notices).await
    }
}

fn exchange(name: &str, port: Port) -> Exchange<String> {
    Exchange { name: name.to_owned(), port, resync: Some(IDENTITY.to_vec()), meaning }
}

/// Asks the controller what it is.
async fn identity(
    exchange: &Exchange<String>,
    mut notices: mpsc::Receiver<Notice<String>>,
) -> Result<String, DeviceError> {
    let what = "a Fjell F2";
    let answer = exchange.identify(what, IDENTITY, &mut notices, String::clone).await?;
    Exchange::drain(notices);
    let identity = answer.lines.concat().trim_start_matches("ID ").to_owned();
    if identity.starts_with("Fjell F2 ") {
        return Ok(identity);
    }
    Err(DeviceError::WrongDevice { device: exchange.name.clone(), expected: what.to_owned(), found: identity })
}

impl FjellDialogue {
    /// Asks an axis, and gives the numbers in its answer.
    async fn numbers<const N: usize>(&self, question: String) -> Result<[f64; N], DeviceError> {
        let answer = self.exchange.ask(&format!("answer `{question}`"), format!("{question}\r")).await?;
        let line = answer.lines.concat();
        numbers(&line).ok_or_else(|| self.exchange.senseless(format!("`{line}`")))
    }

    /// Commands an axis, once: what was commanded before a stop is not sent after it.
    async fn command(&self, axis: usize, words: &str, generation: u64) -> Result<(), DeviceError> {
        let line = format!("{}{words}", self.axes[axis].letter);
        self.exchange.command(&format!("take `{line}`"), format!("{line}\r"), generation).await.map(drop)
    }

    /// An axis's settings against its configuration.
    async fn learn(&self, setup: &AxisSetup) -> Result<Axis, DeviceError> {
        let (device, config, axis) = (&self.exchange.name, &setup.config, setup.axis);
        let refused = |reason: String| DeviceError::Refused { device: device.clone(), reason };
        let (letter, scale) = (config.axis.clone(), config.steps_per_mm);
        if !["A", "B", "C", "D"].contains(&letter.as_str()) {
            return Err(refused(format!("it has no axis `{letter}`; its axes are A to D")));
        }
        let [low, high] = self.numbers(format!("{letter}L")).await?;
        let limits = (low / scale, high / scale);
        let limits_mm = setup.range(limits, HOME_MM);
        let mut facts = AxisFacts {
            speed_mm_per_s: config.speed_mm_per_s,
            acceleration_mm_per_s2: config.acceleration_mm_per_s2,
            limits_mm: Some(limits_mm),
            ..AxisFacts::default()
        };
        if !setup.homes_negative() {
            facts.contradictions.push(format!(
                "It homes the {axis} axis to its negative end, the configuration says the other; set `home_side` or \
                 `reversed` in [bench.{axis}] as the stage is mounted."
            ));
        }
        // Limits that are wider than the configured ones contradict them, unless that is accepted.
        facts.note(setup.compare_limits(limits_mm.0, limits_mm.1));
        Ok(Axis { letter, scale, facts, limits })
    }
}

#[async_trait]
impl Dialogue for FjellDialogue {
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
        Some(HOME_MM)
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
        let Axis { letter, scale, .. } = &self.axes[axis];
        let [position, moving, homed, code] = self.numbers(format!("{letter}?")).await?;
        Ok(AxisReading {
            position: position / scale,
            moving: moving != 0.0,
            referenced: Some(homed != 0.0),
            fault: fault(code),
        })
    }

    async fn prepare(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        self.command(axis, "P 1", generation).await
    }

    async fn start_homing(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        self.command(axis, "H", generation).await
    }

    async fn homing(&self, axis: usize) -> Result<Homing, DeviceError> {
        Ok(self.read(axis).await?.homing("home switch"))
    }

    async fn start_move(&self, axis: usize, position: f64, speed: f64, generation: u64) -> Result<(), DeviceError> {
        let scale = self.axes[axis].scale;
        let words = format!("G {:.0} {:.0}", position * scale, (speed * scale).max(1.0));
        self.command(axis, &words, generation).await
    }

    async fn why_short(&self, axis: usize) -> Option<String> {
        self.read(axis).await.ok()?.fault
    }

    async fn switch_off(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        self.command(axis, "P 0", generation).await
    }

    fn halt(&self, _hard: bool) -> Result<oneshot::Receiver<()>, PortError> {
        self.exchange.port.urgent(STOP, false)
    }
}
