//! Opening a controller: what it is and what its settings say.

use std::sync::atomic::{AtomicBool, AtomicU64};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use async_trait::async_trait;
use tokio::sync::{Notify, mpsc, watch};
use tokio::time::Instant;

use super::super::axis::{AxisLink, AxisSetup};
use super::super::grbl::{self, Grbl, Letter, Settings};
use super::super::session::{AxisFacts, Driver, Session, Wanted};
use super::super::stopping::Stopping;
use super::reports::{listen, poll};
use super::{ANSWER, Axis, Controller, POLL_MOVING, START_UP, checks, device_error};
use crate::device::port::{Answer, Kind, Lines, Notice, Port, PortError};
use crate::device::serial::Wire;
use crate::device::{AxisName, DeviceError};

/// Time given to whatever moves when the port is opened.
const OPENING_STOP: Duration = Duration::from_millis(300);

/// Drives Grbl 1.1 and grblHAL.
#[derive(Debug, Clone, Copy, Default)]
pub struct GrblDriver;

#[async_trait]
impl Driver for GrblDriver {
    fn name(&self) -> &'static str {
        "grbl"
    }

    /// Resets the controller: positions are unknown until the axes are homed.
    async fn connect(&self, wire: Wire, wanted: Wanted) -> Result<Arc<dyn Session>, DeviceError> {
        let name = wanted.name;
        let (port, mut notices) = Port::start(wire, Lines::new(Grbl), wanted.orders.shared());
        let identity = start_up(&port, &mut notices, &name).await?;
        let options = ask(&port, &name, grbl::BUILD_INFO).await?;
        let settings = Settings::from_lines(&ask(&port, &name, grbl::SETTINGS).await?.lines);
        if settings.is_on(13) {
            return Err(DeviceError::Refused { device: name, reason: "it reports inches; set $13=0".to_owned() });
        }
        let homes_single_axes = grbl::homes_single_axes(&options.lines);
        let zero = grbl::homes_to_zero(&options.lines);
        let names: Vec<AxisName> = wanted.axes.iter().map(AxisLink::name).collect();
        let mut axes = Vec::new();
        for link in wanted.axes {
            let letter = letter(&name, link.setup())?;
            let homes_also = names.iter().copied().find(|other| *other != link.name() && !homes_single_axes);
            let facts = AxisFacts { homes_also, ..checks::facts(link.setup(), letter, &settings, zero) };
            let (facts, way) = (Mutex::new(facts), Mutex::default());
            link.forget_home();
            axes.push(Axis { link, letter, facts, way });
        }
        let controller = Arc::new(Controller {
            name,
            identity,
            settings: Mutex::new(settings),
            settings_stale: AtomicBool::new(false),
            zero,
            homes_single_axes,
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
        let (port, mut notices) = Port::start(wire, Lines::new(Grbl), Arc::default());
        match started(&port, &mut notices, name, Instant::now() + START_UP).await? {
            Start::Version(version) => known(name, version),
            Start::Silence(heard) => match port.ask(grbl::BUILD_INFO, ANSWER).await {
                Ok(answer) => match grbl::version(&answer.lines) {
                    Some(version) => known(name, version),
                    None => Err(wrong_device(name, &unreadable(&answer.lines.join(" ")))),
                },
                // A board that takes its time to start has done so now.
                Err(PortError::Restarted) => match started(&port, &mut notices, name, Instant::now() + ANSWER).await? {
                    Start::Version(version) => known(name, version),
                    Start::Silence(heard) => Err(no_answer(name, "say what it is", heard, ANSWER)),
                },
                Err(PortError::Timeout(_)) => Err(no_answer(name, "say what it is", heard, ANSWER)),
                Err(error) => Err(device_error(name, "say what it is", error)),
            },
        }
    }
}

fn letter(name: &str, setup: &AxisSetup) -> Result<Letter, DeviceError> {
    Letter::from_name(&setup.config.axis).ok_or_else(|| DeviceError::Refused {
        device: name.to_owned(),
        reason: format!("a Grbl controller has no axis `{}`; its axes are X, Y and Z", setup.config.axis),
    })
}

/// Stops and resets, and returns what the controller calls itself.
async fn start_up(port: &Port, notices: &mut mpsc::Receiver<Notice>, name: &str) -> Result<String, DeviceError> {
    let closed = |error: PortError| device_error(name, "be reset", error);
    // The first bytes of all: nothing that an earlier program started goes on.
    port.urgent(&[grbl::JOG_CANCEL, grbl::HOLD], false).map_err(closed)?;
    tokio::time::sleep(OPENING_STOP).await;
    let mut heard: Option<String> = None;
    for _ in 0..3 {
        // What was said before the reset, a start at power-up among it, is no answer to it; but it may tell who is there.
        while let Ok(notice) = notices.try_recv() {
            note_noise(&mut heard, &notice);
        }
        port.urgent(&[grbl::RESET], true).map_err(closed)?;
        match started(port, notices, name, Instant::now() + START_UP).await? {
            Start::Version(version) => return known(name, version),
            Start::Silence(line) => heard = telling(heard, line),
        }
    }
    // Whoever knows no reset byte may answer a line: an error is better than silence.
    if let Ok(Ok(answer)) = tokio::time::timeout(ANSWER, port.resynchronise(grbl::BUILD_INFO, ANSWER)).await {
        heard = telling(heard, Some(answer.lines.join(" ")).filter(|lines| !lines.is_empty()));
    }
    while let Ok(notice) = notices.try_recv() {
        note_noise(&mut heard, &notice);
    }
    Err(no_answer(name, "answer a reset", heard, 3 * START_UP))
}

/// Keeps a line that made no sense, or one that says more of who is there.
fn note_noise(heard: &mut Option<String>, notice: &Notice) {
    if notice.kind == Kind::Noise && !notice.line.trim().is_empty() {
        *heard = telling(heard.take(), Some(notice.line.chars().take(60).collect()));
    }
}

/// The first of two lines, but for a second one that names another firmware.
fn telling(first: Option<String>, second: Option<String>) -> Option<String> {
    let names = |line: &String| ["Marlin", "Klipper", "FluidNC"].iter().any(|name| line.contains(name));
    if first.as_ref().is_some_and(names) {
        first
    } else {
        second.filter(|line| first.is_none() || names(line)).or(first)
    }
}

/// What came of waiting for a controller's start.
enum Start {
    /// It has said its version.
    Version(String),
    /// It has not; the first line that made no sense, where there was one.
    Silence(Option<String>),
}

/// Waits for the line with which a controller starts.
async fn started(
    port: &Port,
    notices: &mut mpsc::Receiver<Notice>,
    name: &str,
    deadline: Instant,
) -> Result<Start, DeviceError> {
    let mut heard: Option<String> = None;
    loop {
        match tokio::time::timeout_at(deadline, notices.recv()).await {
            Err(_) => return Ok(Start::Silence(heard)),
            Ok(None) => {
                let reason = port.closed().borrow().clone().unwrap_or_else(|| "the port was closed".to_owned());
                return Err(DeviceError::Disconnected { device: name.to_owned(), reason });
            }
            Ok(Some(Notice { kind: Kind::Started, line, .. })) => {
                return Ok(Start::Version(grbl::banner(&line).unwrap_or_default().to_owned()));
            }
            Ok(Some(notice)) => note_noise(&mut heard, &notice),
        }
    }
}

/// A version, where it is one that this program drives.
fn known(name: &str, version: String) -> Result<String, DeviceError> {
    if version.starts_with("Grbl 1.1") || version.starts_with("GrblHAL 1.1") {
        return Ok(version);
    }
    Err(wrong_device(name, &version))
}

fn no_answer(name: &str, what: &str, heard: Option<String>, allowed: Duration) -> DeviceError {
    match heard {
        Some(line) => wrong_device(name, &unreadable(&line)),
        None => DeviceError::Timeout { device: name.to_owned(), what: what.to_owned(), allowed },
    }
}

/// What was heard instead of an answer, and what it hints at.
fn unreadable(line: &str) -> String {
    let hint = if line.contains('\u{fffd}') { " (is the baud rate right?)" } else { "" };
    format!("something that says `{}`{hint}", line.escape_debug())
}

fn wrong_device(name: &str, found: &str) -> DeviceError {
    DeviceError::WrongDevice {
        device: name.to_owned(),
        expected: "Grbl 1.1 or grblHAL".to_owned(),
        found: found.to_owned(),
    }
}

/// Asks once the controller has started; a board may start twice when its port is opened.
async fn ask(port: &Port, name: &str, line: &[u8]) -> Result<Answer, DeviceError> {
    let deadline = Instant::now() + START_UP;
    while Instant::now() < deadline {
        match port.request(line, ANSWER, port.generation()).await {
            Err(PortError::Restarted | PortError::OutOfStep) => tokio::time::sleep(POLL_MOVING).await,
            other => return other.map_err(|error| device_error(name, "tell its settings", error)),
        }
    }
    port.request(line, ANSWER, port.generation()).await.map_err(|error| device_error(name, "tell its settings", error))
}
