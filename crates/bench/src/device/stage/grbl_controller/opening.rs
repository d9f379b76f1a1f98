//! Opening a controller: what it is and what its settings say.

use std::sync::atomic::{AtomicBool, AtomicU64};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use async_trait::async_trait;
use tokio::sync::{Notify, mpsc, watch};
use tokio::time::Instant;

use super::super::axis::{AxisLink, AxisSetup};
use super::super::grbl::{self, Dialect, Grbl, Letter, Version, Votes};
use super::super::session::{Driver, Session, Wanted};
use super::super::stopping::Stopping;
use super::super::strangers::Heard;
use super::asking::{Asker, Twice};
use super::reports::{listen, poll};
use super::told::Told;
use super::{ANSWER, Axis, Controller, START_UP, device_error};
use crate::device::port::{Kind, Notice, Port, PortError};
use crate::device::serial::Wire;
use crate::device::{AxisName, DeviceError};

/// Time given to whatever moves when the port is opened.
const OPENING_STOP: Duration = Duration::from_millis(300);

/// The baud rate of nearly every board with one of these firmwares.
const USUAL_BAUD: u32 = 115_200;
/// What ought to answer.
const EXPECTED: &str = "Grbl 1.1, grblHAL, or FluidNC 3.7 to 4";
/// Most lines of a stranger that are kept.
const MOST_LINES: usize = 32;

/// Drives Grbl 1.1, grblHAL and FluidNC: the firmware says which it is.
#[derive(Debug, Clone, Copy)]
pub struct GrblDriver {
    /// The baud rate that the port is opened with, for what is said where nothing readable comes.
    pub baud: u32,
}

impl Default for GrblDriver {
    fn default() -> Self {
        Self { baud: USUAL_BAUD }
    }
}

#[async_trait]
impl Driver for GrblDriver {
    fn name(&self) -> &'static str {
        "grbl"
    }

    /// Resets the controller: positions are unknown until the axes are homed.
    async fn connect(&self, wire: Wire, wanted: Wanted) -> Result<Arc<dyn Session>, DeviceError> {
        let name = wanted.name;
        let (port, mut notices) = Port::start(wire, Grbl::default(), wanted.orders.shared());
        let started = self.start_up(&port, &mut notices, &name).await?;
        let started = if started.is_unclear() { started } else { known(&name, started)? };
        let asker = Asker { port: &port, name: &name, dialect: started.dialect, patience: START_UP };
        let options = asker.ask(grbl::BUILD_INFO, ANSWER).await?;
        // Some builds start with Grbl's own words, and a user may have changed FluidNC's.
        let version = match grbl::version(&options.lines) {
            Some(told) if told.dialect != started.dialect && started.dialect == Dialect::Grbl => told,
            _ => started,
        };
        let Version { dialect, words: identity } = known(&name, version)?;
        let letters = wanted.axes.iter().map(|link| letter(&name, link.setup())).collect::<Result<Vec<_>, _>>()?;
        let asker = Asker { dialect, ..asker };
        let told = if dialect == Dialect::FluidNc {
            Told::Tree(asker.tree(Twice::default()).await?, letters.clone())
        } else {
            Told::built(asker.settings(Votes::default()).await?, dialect, &options.lines)
        };
        if told.reports_inches() {
            let reason = "it reports inches; set $13=0 (FluidNC: report_inches: false)".to_owned();
            return Err(DeviceError::Refused { device: name, reason });
        }
        let names: Vec<AxisName> = wanted.axes.iter().map(AxisLink::name).collect();
        let mut axes = Vec::new();
        for (link, letter) in wanted.axes.into_iter().zip(letters) {
            let (facts, way) = (Mutex::new(told.facts(link.setup(), letter, &names)), Mutex::default());
            link.forget_home();
            axes.push(Axis { link, letter, facts, way });
        }
        // What contradicts is read once more soon: the line may have lost the same byte twice.
        let unsure = axes.iter().any(|axis| !axis.facts().contradictions.is_empty());
        let controller = Arc::new(Controller {
            name,
            identity,
            dialect,
            told: Mutex::new(told),
            settings_stale: AtomicBool::new(unsure),
            axes,
            port,
            orders: wanted.orders,
            readings: watch::Sender::new(None),
            alarm: watch::Sender::new(None),
            restarts: watch::Sender::new(0),
            restart_is_ours: AtomicBool::new(false),
            moved: Mutex::new(None),
            homing: AtomicBool::new(false),
            watched: AtomicU64::new(0),
            poll_now: Arc::new(Notify::new()),
            heard: Mutex::new(Instant::now()),
            restarted: Mutex::new(None),
            work_offset: Mutex::new(None),
            operation: tokio::sync::Mutex::new(()),
            stopping: Stopping::default(),
        });
        controller.share_contradictions();
        tokio::spawn(listen(Arc::downgrade(&controller), notices, controller.port.closed()));
        tokio::spawn(poll(Arc::downgrade(&controller), Arc::clone(&controller.poll_now)));
        controller.fresh_reading(0).await?;
        Ok(controller)
    }

    /// What a board says by itself when its port is opened is enough; where it says nothing, it is asked for its
    /// version.
    async fn identify(&self, wire: Wire, name: &str) -> Result<String, DeviceError> {
        let (port, mut notices) = Port::start(wire, Grbl::default(), Arc::default());
        let mut lines = Vec::new();
        let mut version = started(&port, &mut notices, name, Instant::now() + START_UP, &mut lines).await?;
        if version.as_ref().is_none_or(Version::is_unclear) {
            match port.ask(grbl::BUILD_INFO, ANSWER).await {
                Ok(answer) => {
                    version = grbl::version(&answer.lines).or(version);
                    lines.extend(answer.lines);
                }
                // A board that takes its time to start has done so now.
                Err(PortError::Restarted) => {
                    version = started(&port, &mut notices, name, Instant::now() + ANSWER, &mut lines).await?;
                }
                Err(PortError::Timeout(_)) => {}
                Err(error) => return Err(device_error(name, Dialect::default(), "say what it is", error)),
            }
        }
        while let Ok(notice) = notices.try_recv() {
            note(&mut lines, &notice);
        }
        match version {
            Some(version) => Ok(known(name, version)?.words),
            None => Err(self.stranger(name, &port, &lines, "say what it is", ANSWER)),
        }
    }
}

impl GrblDriver {
    /// Stops and resets, and returns what the controller calls itself.
    async fn start_up(
        self,
        port: &Port,
        notices: &mut mpsc::Receiver<Notice>,
        name: &str,
    ) -> Result<Version, DeviceError> {
        let closed = |error: PortError| device_error(name, Dialect::default(), "be reset", error);
        // The first bytes of all: nothing that an earlier program started goes on.
        port.urgent(&[grbl::JOG_CANCEL, grbl::HOLD], false).map_err(closed)?;
        tokio::time::sleep(OPENING_STOP).await;
        let mut lines = Vec::new();
        for _ in 0..3 {
            // What was said before the reset, a start at power-up among it, is no answer to it; but it may tell who is there.
            while let Ok(notice) = notices.try_recv() {
                note(&mut lines, &notice);
            }
            port.urgent(&[grbl::RESET], true).map_err(closed)?;
            if let Some(version) = started(port, notices, name, Instant::now() + START_UP, &mut lines).await? {
                return Ok(version);
            }
        }
        // Whoever knows no reset byte may answer a line: an error is better than silence.
        if let Ok(Ok(answer)) = tokio::time::timeout(ANSWER, port.resynchronise(grbl::BUILD_INFO, ANSWER)).await {
            lines.extend(answer.lines);
        }
        while let Ok(notice) = notices.try_recv() {
            note(&mut lines, &notice);
        }
        Err(self.stranger(name, port, &lines, "answer a reset", 3 * START_UP))
    }

    /// That something else is there, or nothing.
    fn stranger(self, device: &str, port: &Port, lines: &[String], what: &str, allowed: Duration) -> DeviceError {
        let sent = [&[grbl::JOG_CANCEL, grbl::HOLD, grbl::RESET], grbl::BUILD_INFO].concat();
        let (received, baud) = (port.received(), (self.baud, USUAL_BAUD));
        Heard { device, what, allowed, lines, received: &received, sent: &sent, expected: EXPECTED, baud }.error()
    }
}

fn letter(name: &str, setup: &AxisSetup) -> Result<Letter, DeviceError> {
    Letter::from_name(&setup.config.axis).ok_or_else(|| DeviceError::Refused {
        device: name.to_owned(),
        reason: format!("a Grbl controller has no axis `{}`; its axes are X, Y and Z", setup.config.axis),
    })
}

/// Keeps a line that made no sense: it may tell who is there.
fn note(lines: &mut Vec<String>, notice: &Notice) {
    if notice.kind == Kind::Noise && !notice.line.trim().is_empty() && lines.len() < MOST_LINES {
        lines.push(notice.line.clone());
    }
}

/// Waits for the line with which a controller starts, and keeps those that made no sense.
async fn started(
    port: &Port,
    notices: &mut mpsc::Receiver<Notice>,
    name: &str,
    deadline: Instant,
    lines: &mut Vec<String>,
) -> Result<Option<Version>, DeviceError> {
    loop {
        match tokio::time::timeout_at(deadline, notices.recv()).await {
            Err(_) => return Ok(None),
            Ok(None) => {
                let reason = port.closed().borrow().clone().unwrap_or_else(|| "the port was closed".to_owned());
                return Err(DeviceError::Disconnected { device: name.to_owned(), reason });
            }
            Ok(Some(Notice { kind: Kind::Started, line, .. })) => return Ok(grbl::banner(&line)),
            Ok(Some(notice)) => note(lines, &notice),
        }
    }
}

/// A version, where it is one that this program drives.
fn known(name: &str, version: Version) -> Result<Version, DeviceError> {
    if version.is_known() {
        return Ok(version);
    }
    Err(DeviceError::WrongDevice { device: name.to_owned(), expected: EXPECTED.to_owned(), found: version.words })
}
