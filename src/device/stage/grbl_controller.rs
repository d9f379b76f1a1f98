//! A Grbl 1.1 controller and the stages on it, over any byte stream.
//!
//! Moves are jogs in machine coordinates: the controller checks them against its soft limits before they start, and a
//! single byte ends them. Everything that moves runs in a task of its own, one at a time, so that dropping a caller's
//! future neither cuts a command nor leaves a motion unwatched; a stop passes them all.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::time::Duration;

use async_trait::async_trait;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::sync::{Notify, mpsc, watch};
use tokio::time::Instant;

use super::grbl::{self, Alarm, Grbl, Letter, Mode, Settings};
use crate::config::AxisConfig;
use crate::device::port::{Answer, LineKind, Notice, Port, PortError};
use crate::device::{AxisName, DeviceError, Stage, StageInfo, StageState, StopDelivery};
use crate::units::Millimetres;

/// Time between status requests at rest: Grbl's interface document asks for 5 Hz at most as a rule.
const POLL_AT_REST: Duration = Duration::from_millis(200);
/// Time between status requests in motion: 10 Hz is what it allows.
const POLL_MOVING: Duration = Duration::from_millis(100);
/// Longest wait for the answer to anything but homing.
const ANSWER: Duration = Duration::from_secs(2);
/// Silence after which the controller counts as lost.
const SILENCE: Duration = Duration::from_millis(1500);
/// Time beyond its own deceleration that an axis may take to stop before the controller is reset under it.
const STOP_SPARE: Duration = Duration::from_millis(200);
/// Time given to whatever moves when the port is opened.
const OPENING_STOP: Duration = Duration::from_millis(300);
/// A board that resets when its port is opened spends a second and more in its boot loader.
const START_UP: Duration = Duration::from_secs(2);
/// Distance between target and readback that is no arrival, mm: Grbl reports three decimals of whole motor steps.
const ARRIVAL_MM: f64 = 0.01;

/// One axis as configured.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisSetup {
    axis: AxisName,
    letter: Letter,
    config: AxisConfig,
}

impl AxisSetup {
    /// The axis of a letter on the controller.
    ///
    /// # Errors
    /// [`DeviceError::Refused`] when the letter is none of the controller's.
    pub fn new(axis: AxisName, letter: &str, config: &AxisConfig) -> Result<Self, DeviceError> {
        let letter = Letter::from_name(letter).ok_or_else(|| DeviceError::Refused {
            device: format!("the {axis} axis"),
            reason: format!("a Grbl controller has no axis `{letter}`; its axes are X, Y and Z"),
        })?;
        Ok(Self { axis, letter, config: config.clone() })
    }

    fn direction(&self) -> f64 {
        if self.config.reversed { -1.0 } else { 1.0 }
    }

    /// Coordinate for a machine position, both mm, given the machine position at home.
    fn coordinate(&self, machine: f64, home: f64) -> f64 {
        self.config.home_position_mm + self.direction() * (machine - home)
    }

    /// Machine position for a coordinate, both mm.
    fn machine(&self, coordinate: f64, home: f64) -> f64 {
        home + self.direction() * (coordinate - self.config.home_position_mm)
    }
}

/// A status report with a known machine position.
#[derive(Debug, Clone, PartialEq)]
struct Reading {
    mode: Mode,
    machine: [f64; 3],
    line_number: u64,
    at: Instant,
}

struct Axis {
    setup: AxisSetup,
    state: watch::Sender<StageState>,
    disagreements: Vec<String>,
    /// Machine position at home, mm, while the position is known.
    home: Mutex<Option<f64>>,
}

/// A Grbl 1.1 controller.
#[derive(Clone)]
pub struct GrblController {
    inner: Arc<Inner>,
}

struct Inner {
    name: String,
    location: String,
    identity: String,
    settings: Settings,
    homes_single_axes: bool,
    axes: Vec<Axis>,
    port: Port,
    readings: watch::Sender<Option<Reading>>,
    alarm: watch::Sender<Option<Alarm>>,
    stops: watch::Sender<u64>,
    restarts: watch::Sender<u64>,
    restart_is_ours: AtomicBool,
    homing: AtomicBool,
    /// How many operations want readings at the faster rate.
    watched: AtomicU64,
    poll_now: Arc<Notify>,
    work_offset: Mutex<Option<[f64; 3]>>,
    operation: tokio::sync::Mutex<()>,
    stopping: tokio::sync::Mutex<()>,
}

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
        let inner = Arc::new(Inner {
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
            restarts: watch::Sender::new(0),
            restart_is_ours: AtomicBool::new(false),
            homing: AtomicBool::new(false),
            watched: AtomicU64::new(0),
            poll_now: Arc::new(Notify::new()),
            work_offset: Mutex::new(None),
            operation: tokio::sync::Mutex::new(()),
            stopping: tokio::sync::Mutex::new(()),
        });
        tokio::spawn(listen(Arc::downgrade(&inner), notices, inner.port.closed()));
        tokio::spawn(poll(Arc::downgrade(&inner), Arc::clone(&inner.poll_now)));
        inner.fresh_reading(0).await?;
        Ok(Self { inner })
    }

    /// The stage of one of the controller's axes, if it has it.
    #[must_use]
    pub fn stage(&self, axis: AxisName) -> Option<GrblStage> {
        let index = self.inner.axes.iter().position(|candidate| candidate.setup.axis == axis)?;
        Some(GrblStage { inner: Arc::clone(&self.inner), index })
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

fn device_error(name: &str, what: &str, error: PortError) -> DeviceError {
    let device = name.to_owned();
    match error {
        PortError::Closed(reason) => DeviceError::Disconnected { device, reason },
        PortError::Timeout(allowed) => DeviceError::Timeout { device, what: what.to_owned(), allowed },
        PortError::Refused(line) => {
            DeviceError::Refused { device, reason: format!("{line}: {}", grbl::error_meaning(&line)) }
        }
        PortError::Halted(line) => DeviceError::Alarm {
            device,
            reason: Alarm::from_line(&line).map_or_else(|| line.clone(), |alarm| alarm.to_string()),
        },
        PortError::Restarted | PortError::Cancelled | PortError::OutOfStep => {
            DeviceError::Refused { device, reason: error.to_string() }
        }
    }
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

/// Takes what the controller says by itself, until the port closes or every stage is dropped.
async fn listen(inner: Weak<Inner>, mut notices: mpsc::Receiver<Notice>, mut closed: watch::Receiver<Option<String>>) {
    while let Some(notice) = notices.recv().await {
        let Some(inner) = inner.upgrade() else { return };
        inner.take_notice(&notice);
    }
    let reason = match closed.wait_for(Option::is_some).await {
        Ok(reason) => reason.clone(),
        Err(_) => None,
    };
    if let Some(inner) = inner.upgrade() {
        let reason = reason.unwrap_or_else(|| "the port is closed".to_owned());
        tracing::warn!(controller = %inner.name, reason = %reason, "a stage controller is lost");
        inner.forget_positions();
        inner.set_states(|state| {
            state.connected = false;
            state.moving = false;
            state.at_rest_since = None;
            state.fault = Some(reason.clone());
        });
    }
}

/// Asks for the status again and again, until the port closes or every stage is dropped.
async fn poll(weak: Weak<Inner>, poll_now: Arc<Notify>) {
    loop {
        let asked = Instant::now();
        let period = {
            let Some(inner) = weak.upgrade() else { return };
            if inner.port.closed().borrow().is_some() {
                return;
            }
            // In homing and after a critical alarm nothing is answered.
            let mute = inner.homing.load(Ordering::SeqCst) || inner.alarm.borrow().is_some_and(Alarm::needs_reset);
            if !mute {
                // A full queue means that the device takes no bytes: the silence will tell.
                let _ = inner.port.urgent(&[grbl::STATUS], false);
                inner.note_silence();
            }
            if inner.watched.load(Ordering::SeqCst) > 0 { POLL_MOVING } else { POLL_AT_REST }
        };
        tokio::select! {
            () = tokio::time::sleep_until(asked + period) => {}
            () = poll_now.notified() => tokio::time::sleep_until(asked + POLL_MOVING).await,
        }
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Asks for readings at the faster rate while it lives.
struct Watching<'a>(&'a Inner);

impl Drop for Watching<'_> {
    fn drop(&mut self) {
        self.0.watched.fetch_sub(1, Ordering::SeqCst);
    }
}

impl Inner {
    fn watching(&self) -> Watching<'_> {
        self.watched.fetch_add(1, Ordering::SeqCst);
        self.poll_now.notify_one();
        Watching(self)
    }

    fn set_states(&self, change: impl Fn(&mut StageState)) {
        for axis in &self.axes {
            axis.state.send_modify(&change);
        }
    }

    fn forget_positions(&self) {
        for axis in &self.axes {
            *locked(&axis.home) = None;
            axis.state.send_modify(|state| state.homed = false);
        }
    }

    fn take_notice(&self, notice: &Notice) {
        match notice.kind {
            LineKind::Started => {
                if !self.restart_is_ours.swap(false, Ordering::SeqCst) && self.alarm.borrow().is_none() {
                    tracing::warn!(controller = %self.name, "a stage controller has restarted by itself");
                    self.forget_positions();
                }
                self.alarm.send_replace(None);
                self.restarts.send_modify(|count| *count += 1);
            }
            LineKind::Halted => {
                let alarm = Alarm::from_line(&notice.line).unwrap_or(Alarm(0));
                tracing::warn!(controller = %self.name, alarm = %alarm, "a stage controller is in alarm");
                self.forget_positions();
                self.set_states(|state| {
                    state.moving = false;
                    state.fault = Some(alarm.to_string());
                });
                self.alarm.send_replace(Some(alarm));
            }
            _ => {
                if let Some(status) = grbl::status(&notice.line) {
                    self.take_status(&status, notice.line_number);
                }
            }
        }
    }

    fn take_status(&self, status: &grbl::Status, line_number: u64) {
        let mut offset = locked(&self.work_offset);
        *offset = status.work_offset.or(*offset);
        let machine = status.machine.or_else(|| {
            let (work, offset) = (status.work?, (*offset)?);
            Some(std::array::from_fn(|i| work[i] + offset[i]))
        });
        drop(offset);
        let Some(machine) = machine else { return };
        let now = Instant::now();
        for axis in &self.axes {
            let home = *locked(&axis.home);
            let at = machine[axis.setup.letter.index()];
            let position = Millimetres(axis.setup.coordinate(at, home.unwrap_or(at)));
            axis.state.send_modify(|state| {
                let moved = state.position != position;
                state.connected = true;
                state.position = position;
                state.moving = !status.mode.at_rest();
                if state.moving {
                    state.at_rest_since = None;
                } else if moved || state.at_rest_since.is_none() {
                    state.at_rest_since = Some(now);
                }
                match status.mode {
                    Mode::Alarm if state.fault.is_none() => {
                        state.fault = Some("the controller is locked until it is homed".to_owned());
                    }
                    Mode::Alarm => {}
                    Mode::Sleep => state.fault = Some("the controller is asleep; stop to wake it".to_owned()),
                    Mode::Door => state.fault = Some("the controller's safety door is open".to_owned()),
                    Mode::Hold(_) => state.fault = Some("the controller is held; stop to release it".to_owned()),
                    _ => state.fault = None,
                }
            });
        }
        self.readings.send_replace(Some(Reading { mode: status.mode, machine, line_number, at: now }));
    }

    fn note_silence(&self) {
        let silent = self.readings.borrow().as_ref().is_some_and(|reading| reading.at.elapsed() > SILENCE);
        if silent && self.axes.iter().any(|axis| axis.state.borrow().connected) {
            self.set_states(|state| {
                state.connected = false;
                state.at_rest_since = None;
                state.fault = Some("the controller does not answer".to_owned());
            });
        }
    }

    fn latest_line(&self) -> u64 {
        self.readings.borrow().as_ref().map_or(0, |reading| reading.line_number)
    }

    fn closed_error(&self) -> Option<DeviceError> {
        let reason = self.port.closed().borrow().clone()?;
        Some(DeviceError::Disconnected { device: self.name.clone(), reason })
    }

    fn timeout(&self, what: &str, allowed: Duration) -> DeviceError {
        DeviceError::Timeout { device: self.name.clone(), what: what.to_owned(), allowed }
    }

    /// A reading later than a line.
    async fn fresh_reading(&self, after_line: u64) -> Result<Reading, DeviceError> {
        let mut readings = self.readings.subscribe();
        let mut closed = self.port.closed();
        self.poll_now.notify_one();
        tokio::select! {
            reading = readings.wait_for(|r| r.as_ref().is_some_and(|r| r.line_number > after_line)) => {
                let reading = reading.ok().and_then(|reading| reading.clone());
                reading.ok_or_else(|| self.timeout("report its status", ANSWER))
            }
            _ = closed.wait_for(Option::is_some) => {
                Err(self.closed_error().unwrap_or_else(|| self.timeout("report its status", ANSWER)))
            }
            () = tokio::time::sleep(ANSWER) => Err(self.timeout("report its status", ANSWER)),
        }
    }

    /// Waits until two readings one after another, both later than a line, say rest at the same place.
    async fn rest(&self, mut after_line: u64) -> Result<Reading, DeviceError> {
        let mut last: Option<Reading> = None;
        loop {
            let reading = self.fresh_reading(after_line).await?;
            after_line = reading.line_number;
            // Locked but at rest: the alarm itself is reported by whoever asked for the motion.
            let resting = reading.mode.at_rest();
            if resting && last.as_ref().is_some_and(|last| last.machine == reading.machine) {
                return Ok(reading);
            }
            last = resting.then_some(reading);
        }
    }

    /// Resets the controller and waits for its start; tells whether that came.
    async fn restart(&self) -> bool {
        let mut restarts = self.restarts.subscribe();
        let before = *restarts.borrow_and_update();
        self.restart_is_ours.store(true, Ordering::SeqCst);
        if self.port.urgent(&[grbl::RESET], true).is_err() {
            return false;
        }
        matches!(tokio::time::timeout(START_UP, restarts.wait_for(|&count| count > before)).await, Ok(Ok(_)))
    }

    /// Speed (mm/s) and acceleration (mm/s²) that an axis really has.
    fn dynamics(&self, axis: &Axis) -> (f64, f64) {
        let AxisSetup { letter, config, .. } = &axis.setup;
        let rate = self.settings.of_axis(110, *letter).map_or(f64::INFINITY, |rate| rate / 60.0);
        let acceleration = self.settings.of_axis(120, *letter).unwrap_or(f64::INFINITY);
        (config.speed_mm_per_s.min(rate).max(1e-6), config.acceleration_mm_per_s2.min(acceleration).max(1e-6))
    }

    /// What keeps an operation from starting.
    fn ready(&self, axis: AxisName, generation: u64) -> Result<(), DeviceError> {
        if let Some(error) = self.closed_error() {
            return Err(error);
        }
        if self.port.generation() != generation {
            return Err(DeviceError::Stopped { axis });
        }
        Ok(())
    }

    async fn move_to(&self, index: usize, target: Millimetres, generation: u64) -> Result<Millimetres, DeviceError> {
        let axis = &self.axes[index];
        let name = axis.setup.axis;
        let _operation = self.operation.lock().await;
        self.ready(name, generation)?;
        if !target.value().is_finite() {
            return Err(DeviceError::Refused { device: self.name.clone(), reason: format!("{target} is no position") });
        }
        if let Some(alarm) = *self.alarm.borrow() {
            return Err(DeviceError::Alarm { device: self.name.clone(), reason: alarm.to_string() });
        }
        let Some(home) = *locked(&axis.home) else { return Err(DeviceError::NotHomed { axis: name }) };
        let _watching = self.watching();
        let from = self.fresh_reading(self.latest_line()).await?;
        let letter = axis.setup.letter;
        let machine = axis.setup.machine(target.value(), home);
        let distance = (machine - from.machine[letter.index()]).abs();
        let (speed, acceleration) = self.dynamics(axis);
        // A trapezoid takes distance/speed + speed/acceleration; half as much again, and the time to see its end.
        let allowed = Duration::from_secs_f64(2.0 + 1.5 * (distance / speed + speed / acceleration));

        let line = grbl::jog(letter, machine, speed * 60.0);
        let answer = match self.port.request(line, ANSWER, generation).await {
            Ok(answer) => answer,
            Err(_) if self.port.generation() != generation => return self.stopped(name).await,
            Err(error) => {
                if matches!(error, PortError::Timeout(_) | PortError::OutOfStep) {
                    self.stop().await;
                }
                return Err(device_error(&self.name, "take a move", error));
            }
        };
        let mut alarm = self.alarm.subscribe();
        let alarmed = async {
            match alarm.wait_for(Option::is_some).await {
                Ok(alarm) => *alarm,
                Err(_) => None,
            }
        };
        let reading = tokio::select! {
            biased;
            () = self.stop_after(generation) => return self.stopped(name).await,
            alarm = alarmed => {
                let reason = alarm.unwrap_or(Alarm(0)).to_string();
                return Err(DeviceError::Alarm { device: self.name.clone(), reason });
            }
            reading = self.rest(answer.line_number) => reading,
            () = tokio::time::sleep(allowed) => Err(self.timeout(&format!("end a move of {distance:.3} mm"), allowed)),
        };
        let reading = match reading {
            Ok(reading) => reading,
            Err(error) => {
                self.stop().await;
                return Err(error);
            }
        };
        if locked(&axis.home).is_none() {
            return Err(DeviceError::NotHomed { axis: name });
        }
        let reached = axis.setup.coordinate(reading.machine[letter.index()], home);
        if (reached - target.value()).abs() > ARRIVAL_MM {
            return Err(DeviceError::Protocol {
                device: self.name.clone(),
                detail: format!("the {name} axis came to rest at {reached:.3} mm on its way to {target:.3}"),
            });
        }
        Ok(Millimetres(reached))
    }

    /// Returns once a stop has outdated a generation.
    async fn stop_after(&self, generation: u64) {
        if self.stops.subscribe().wait_for(|&count| count > generation).await.is_err() {
            std::future::pending::<()>().await;
        }
    }

    /// Waits for the end of the stop that ended an operation.
    async fn stopped<T>(&self, axis: AxisName) -> Result<T, DeviceError> {
        let _stopping = self.stopping.lock().await;
        Err(DeviceError::Stopped { axis })
    }

    async fn home(&self, index: usize, generation: u64) -> Result<(), DeviceError> {
        let name = self.axes[index].setup.axis;
        let _operation = self.operation.lock().await;
        self.ready(name, generation)?;
        let locked_up = self.alarm.borrow().is_some_and(Alarm::needs_reset);
        let held = self.readings.borrow().as_ref().is_some_and(|r| matches!(r.mode, Mode::Hold(_) | Mode::Sleep));
        if (locked_up || held) && !self.restart().await {
            return Err(self.timeout("answer a reset", START_UP));
        }
        let single = self.homes_single_axes || self.axes.len() == 1;
        let homed: Vec<&Axis> =
            self.axes.iter().enumerate().filter(|(i, _)| !single || *i == index).map(|(_, axis)| axis).collect();
        let letter = self.homes_single_axes.then(|| self.axes[index].setup.letter);
        for axis in &homed {
            *locked(&axis.home) = None;
            axis.state.send_modify(|state| {
                state.homed = false;
                state.moving = true;
                state.at_rest_since = None;
                state.fault = None;
            });
        }
        self.homing.store(true, Ordering::SeqCst);
        let answer = self.port.request(grbl::home(letter), self.homing_time(), generation).await;
        self.homing.store(false, Ordering::SeqCst);
        // It was silent while it homed: that is not to be taken for a loss.
        self.readings.send_modify(|reading| {
            if let Some(reading) = reading {
                reading.at = Instant::now();
            }
        });
        let answer = match answer {
            Ok(answer) => answer,
            Err(_) if self.port.generation() != generation => return self.stopped(name).await,
            Err(error) => {
                if matches!(error, PortError::Timeout(_) | PortError::OutOfStep) {
                    self.stop().await;
                }
                return Err(device_error(&self.name, &format!("home the {name} axis"), error));
            }
        };
        let _watching = self.watching();
        let reading = tokio::select! {
            biased;
            () = self.stop_after(generation) => return self.stopped(name).await,
            reading = self.rest(answer.line_number) => reading?,
        };
        for axis in homed {
            let at = reading.machine[axis.setup.letter.index()];
            *locked(&axis.home) = Some(at);
            axis.state.send_modify(|state| {
                state.homed = true;
                state.position = Millimetres(axis.setup.config.home_position_mm);
                state.moving = false;
                state.fault = None;
                state.at_rest_since = Some(reading.at);
            });
        }
        Ok(())
    }

    /// Longest time that homing can take by the controller's own settings.
    fn homing_time(&self) -> Duration {
        let setting = |number, otherwise| self.settings.get(number).filter(|v| *v > 0.0).unwrap_or(otherwise);
        let (locate, seek, pull_off) = (setting(24, 25.0) / 60.0, setting(25, 500.0) / 60.0, setting(27, 1.0));
        let longest = Letter::ALL
            .into_iter()
            .map(|letter| {
                let rate = self.settings.of_axis(110, letter).map_or(seek, |rate| seek.min(rate / 60.0)).max(1e-3);
                let travel = self.settings.of_axis(130, letter).unwrap_or(200.0);
                // Grbl searches over 1.5 travels and approaches slowly over five pull-offs, at most.
                1.5 * travel / rate + 2.0 * pull_off / rate + 5.0 * pull_off / locate.min(rate)
            })
            .fold(0.0, f64::max);
        Duration::from_secs_f64((10.0 + 1.2 * longest).min(1800.0))
    }

    async fn stop(&self) -> StopDelivery {
        self.port.cancel_requests();
        let generation = self.port.generation();
        self.stops.send_modify(|count| *count = (*count).max(generation));
        let blind = self.homing.load(Ordering::SeqCst) || self.alarm.borrow().is_some_and(Alarm::needs_reset);
        // In homing, and after a critical alarm, a reset is all that the controller obeys.
        let bytes: &[u8] = if blind { &[] } else { &[grbl::JOG_CANCEL, grbl::HOLD] };
        if !blind {
            match self.port.urgent(bytes, false) {
                Err(_) => return StopDelivery::Undeliverable,
                Ok(written) => {
                    if tokio::time::timeout(STOP_SPARE, written).await.is_err() {
                        return StopDelivery::Undeliverable;
                    }
                }
            }
        }
        let after_line = self.latest_line();
        let _watching = self.watching();
        let _stopping = self.stopping.lock().await;
        let deceleration = self.axes.iter().map(|axis| self.dynamics(axis)).map(|(v, a)| v / a).fold(0.0, f64::max);
        let allowed = STOP_SPARE + Duration::from_secs_f64(deceleration.min(5.0));
        let rested = if blind {
            None
        } else {
            tokio::time::timeout(allowed, self.rest_or_hold(after_line)).await.ok().and_then(Result::ok)
        };
        match rested {
            Some(before) => {
                // The reset throws away what a held line has left, and releases the hold. At rest no step is lost.
                if self.restart().await
                    && let Ok(after) = self.fresh_reading(self.latest_line()).await
                    && after.machine != before.machine
                {
                    self.forget_positions();
                }
                StopDelivery::Confirmed
            }
            None => {
                self.forget_positions();
                let restarted = self.restart().await;
                self.forget_positions();
                if restarted { StopDelivery::Confirmed } else { self.undelivered() }
            }
        }
    }

    fn undelivered(&self) -> StopDelivery {
        match self.port.closed().borrow().is_some() {
            true => StopDelivery::Undeliverable,
            false => StopDelivery::Sent,
        }
    }

    /// A reading that proves rest after a stop: a hold that is complete, or rest twice.
    async fn rest_or_hold(&self, mut after_line: u64) -> Result<Reading, DeviceError> {
        let mut last: Option<Reading> = None;
        loop {
            let reading = self.fresh_reading(after_line).await?;
            after_line = reading.line_number;
            let resting = reading.mode.at_rest();
            let same = last.as_ref().is_some_and(|last| last.machine == reading.machine);
            if reading.mode == Mode::Hold(true) || (resting && same) {
                return Ok(reading);
            }
            last = resting.then_some(reading);
        }
    }
}

/// One axis of a [`GrblController`].
#[derive(Clone)]
pub struct GrblStage {
    inner: Arc<Inner>,
    index: usize,
}

impl GrblStage {
    fn axis(&self) -> &Axis {
        &self.inner.axes[self.index]
    }

    fn gone(&self) -> DeviceError {
        DeviceError::Disconnected { device: self.inner.name.clone(), reason: "its task has ended".to_owned() }
    }
}

#[async_trait]
impl Stage for GrblStage {
    fn info(&self) -> StageInfo {
        StageInfo {
            axis: self.axis().setup.axis,
            driver: "grbl".to_owned(),
            identity: self.inner.identity.clone(),
            location: self.inner.location.clone(),
            disagreements: self.axis().disagreements.clone(),
        }
    }

    fn state(&self) -> watch::Receiver<StageState> {
        self.axis().state.subscribe()
    }

    async fn read_state(&self) -> Result<StageState, DeviceError> {
        if let Some(error) = self.inner.closed_error() {
            return Err(error);
        }
        // Homing is answered by silence until its end, a critical alarm until the reset: the state already says so.
        let mute =
            self.inner.homing.load(Ordering::SeqCst) || self.inner.alarm.borrow().is_some_and(Alarm::needs_reset);
        if !mute {
            self.inner.fresh_reading(self.inner.latest_line()).await?;
        }
        Ok(self.axis().state.borrow().clone())
    }

    fn homes_also(&self) -> Option<AxisName> {
        let other = self.inner.axes.iter().enumerate().find(|(index, _)| *index != self.index);
        other.filter(|_| !self.inner.homes_single_axes).map(|(_, axis)| axis.setup.axis)
    }

    async fn home(&self) -> Result<(), DeviceError> {
        let (inner, index) = (Arc::clone(&self.inner), self.index);
        let generation = inner.port.generation();
        tokio::spawn(async move { inner.home(index, generation).await }).await.unwrap_or_else(|_| Err(self.gone()))
    }

    /// Grbl can switch off all of its motors only: every axis of the controller loses its position.
    async fn release(&self) -> Result<(), DeviceError> {
        let inner = Arc::clone(&self.inner);
        let (axis, generation) = (self.axis().setup.axis, inner.port.generation());
        let released = tokio::spawn(async move {
            let _operation = inner.operation.lock().await;
            inner.ready(axis, generation)?;
            inner.forget_positions();
            let answer = inner.port.request(grbl::SLEEP, ANSWER, generation).await;
            answer.map_err(|error| device_error(&inner.name, "switch its motors off", error))?;
            // What comes next has to know that it sleeps.
            inner.fresh_reading(inner.latest_line()).await.map(|_| ())
        });
        released.await.unwrap_or_else(|_| Err(self.gone()))
    }

    async fn move_to(&self, target: Millimetres) -> Result<Millimetres, DeviceError> {
        let (inner, index) = (Arc::clone(&self.inner), self.index);
        let generation = inner.port.generation();
        tokio::spawn(async move { inner.move_to(index, target, generation).await })
            .await
            .unwrap_or_else(|_| Err(self.gone()))
    }

    async fn stop(&self) -> StopDelivery {
        let inner = Arc::clone(&self.inner);
        tokio::spawn(async move { inner.stop().await }).await.unwrap_or(StopDelivery::Undeliverable)
    }
}
