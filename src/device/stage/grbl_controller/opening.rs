//! Opening a controller: what it is, what its settings say, and where they disagree with the configuration.

use std::sync::atomic::{AtomicBool, AtomicU64};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::{Notify, mpsc, watch};
use tokio::time::Instant;

use super::super::grbl::{self, Grbl, Settings};
use super::reports::{listen, poll};
use super::{ANSWER, Axis, AxisSetup, Controller, GrblController, POLL_MOVING, START_UP, device_error};
use crate::device::port::{Answer, LineKind, Notice, Port, PortError};
use crate::device::{DeviceError, StageState};
use crate::units::Millimetres;

/// Time given to whatever moves when the port is opened.
const OPENING_STOP: Duration = Duration::from_millis(300);

impl GrblController {
    /// Stops whatever moves, resets the controller, checks what it is and reads its settings. Positions are unknown
    /// until the axes are homed.
    ///
    /// # Errors
    /// [`DeviceError::WrongDevice`] when something other than Grbl 1.1 answers, [`DeviceError::Timeout`] when nothing
    /// does, [`DeviceError::Disconnected`] when the stream ends, [`DeviceError::Refused`] when its settings cannot be
    /// worked with.
    pub async fn connect<T>(io: T, name: &str, location: &str, axes: Vec<AxisSetup>) -> Result<Self, DeviceError>
    where
        T: AsyncRead + AsyncWrite + Send + Unpin + 'static,
    {
        let (port, mut notices) = Port::start(io, Grbl);
        let identity = start_up(&port, &mut notices, name).await?;
        let options = ask(&port, name, grbl::BUILD_INFO).await?;
        let settings = Settings::from_lines(&ask(&port, name, grbl::SETTINGS).await?.lines);
        if settings.is_on(13) {
            return Err(DeviceError::Refused {
                device: name.to_owned(),
                reason: "it reports inches; set $13=0".to_owned(),
            });
        }
        let axes = axes
            .into_iter()
            .map(|setup| Axis {
                disagreements: disagreements(&setup, &settings),
                state: watch::Sender::new(StageState {
                    connected: true,
                    homed: false,
                    position: Millimetres(0.0),
                    moving: false,
                    at_rest_since: None,
                    fault: None,
                }),
                home: Mutex::new(None),
                setup,
            })
            .collect();
        let controller = Arc::new(Controller {
            name: name.to_owned(),
            location: location.to_owned(),
            identity,
            settings,
            homes_single_axes: grbl::homes_single_axes(&options.lines),
            axes,
            port,
            readings: watch::Sender::new(None),
            alarm: watch::Sender::new(None),
            stops: watch::Sender::new(0),
            stops_under_way: watch::Sender::new(0),
            restarts: watch::Sender::new(0),
            restart_is_ours: AtomicBool::new(false),
            homing: AtomicBool::new(false),
            watched: AtomicU64::new(0),
            poll_now: Arc::new(Notify::new()),
            work_offset: Mutex::new(None),
            operation: tokio::sync::Mutex::new(()),
            stopping: tokio::sync::Mutex::new(()),
        });
        tokio::spawn(listen(Arc::downgrade(&controller), notices, controller.port.closed()));
        tokio::spawn(poll(Arc::downgrade(&controller), Arc::clone(&controller.poll_now)));
        controller.fresh_reading(0).await?;
        Ok(Self { controller })
    }
}

/// Stops and resets, and returns what the controller calls itself.
async fn start_up(port: &Port, notices: &mut mpsc::Receiver<Notice>, name: &str) -> Result<String, DeviceError> {
    let closed = |error: PortError| device_error(name, "be reset", error);
    // The first bytes of all: nothing that an earlier program started goes on.
    port.urgent(&[grbl::JOG_CANCEL, grbl::HOLD], false).map_err(closed)?;
    tokio::time::sleep(OPENING_STOP).await;
    let mut heard: Option<String> = None;
    for _ in 0..3 {
        // What was said before the reset, a start at power-up among it, is no answer to it.
        while notices.try_recv().is_ok() {}
        port.urgent(&[grbl::RESET], true).map_err(closed)?;
        let deadline = Instant::now() + START_UP;
        loop {
            match tokio::time::timeout_at(deadline, notices.recv()).await {
                Err(_) => break,
                Ok(None) => {
                    let reason = port.closed().borrow().clone().unwrap_or_else(|| "the port was closed".to_owned());
                    return Err(DeviceError::Disconnected { device: name.to_owned(), reason });
                }
                Ok(Some(Notice { kind: LineKind::Started, line, .. })) => {
                    let version = grbl::banner(&line).unwrap_or_default();
                    if version.starts_with("Grbl 1.1") {
                        return Ok(version.to_owned());
                    }
                    return Err(wrong_device(name, version));
                }
                Ok(Some(notice)) => {
                    if notice.kind == LineKind::Noise && heard.is_none() {
                        heard = Some(notice.line.chars().take(60).collect());
                    }
                }
            }
        }
    }
    match heard {
        Some(line) => Err(wrong_device(name, &format!("something that says `{}`", line.escape_debug()))),
        None => Err(DeviceError::Timeout {
            device: name.to_owned(),
            what: "answer a reset".to_owned(),
            allowed: 3 * START_UP,
        }),
    }
}

fn wrong_device(name: &str, found: &str) -> DeviceError {
    DeviceError::WrongDevice { device: name.to_owned(), expected: "Grbl 1.1".to_owned(), found: found.to_owned() }
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

/// What differs between a controller's settings and an axis's configuration, one sentence each.
fn disagreements(setup: &AxisSetup, settings: &Settings) -> Vec<String> {
    let AxisSetup { axis, letter, config } = setup;
    let number = |group: u16| group + letter.index() as u16;
    let mut sentences = Vec::new();
    match settings.of_axis(100, *letter) {
        Some(steps) if (steps / config.steps_per_mm - 1.0).abs() > 1e-6 => sentences.push(format!(
            "The controller makes {steps} steps/mm on {} (${}), the configuration of the {axis} axis says {}.",
            letter.name(),
            number(100),
            config.steps_per_mm
        )),
        None => sentences.push(format!("The controller has no setting ${} for the {axis} axis.", number(100))),
        Some(_) => {}
    }
    if let Some(rate) = settings.of_axis(110, *letter).map(|rate| rate / 60.0).filter(|r| *r < config.speed_mm_per_s) {
        sentences.push(format!(
            "The controller moves the {axis} axis at {rate:.3} mm/s at most (${}), the configuration says {} mm/s.",
            number(110),
            config.speed_mm_per_s
        ));
    }
    match settings.of_axis(120, *letter) {
        Some(acceleration) if (acceleration / config.acceleration_mm_per_s2 - 1.0).abs() > 1e-6 => {
            sentences.push(format!(
                "The controller accelerates the {axis} axis at {acceleration} mm/s² (${}), the configuration says {} \
                 mm/s².",
                number(120),
                config.acceleration_mm_per_s2
            ));
        }
        _ => {}
    }
    let travel = config.high_limit_mm - config.low_limit_mm;
    if let Some(length) = settings.of_axis(130, *letter).filter(|length| *length + 1e-6 < travel) {
        sentences.push(format!(
            "The controller's travel of the {axis} axis is {length} mm (${}), less than the {travel} mm between the \
             configured limits.",
            number(130)
        ));
    }
    if !settings.is_on(22) {
        sentences.push(format!("Homing is off in the controller ($22): the {axis} axis cannot be homed."));
    }
    if !settings.is_on(20) {
        sentences.push(format!("Soft limits are off in the controller ($20): it does not bound the {axis} axis."));
    }
    let homes_negative = settings.get(23).is_some_and(|mask| (mask as u32) & (1 << letter.index()) != 0);
    if homes_negative != (config.home_side.sign() * setup.direction() < 0.0) {
        sentences.push(format!(
            "The controller homes the {axis} axis towards its {} end ($23), the configuration says the other.",
            if homes_negative { "negative" } else { "positive" }
        ));
    }
    sentences
}
