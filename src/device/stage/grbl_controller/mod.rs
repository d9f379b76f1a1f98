//! A Grbl 1.1 controller and the stages on it, over any byte stream.
//!
//! Moves are jogs in machine coordinates: the controller checks them against its soft limits before they start, and a
//! single byte ends them. Everything that moves runs in a task of its own, one at a time, so that dropping a caller's
//! future neither cuts a command nor leaves a motion unwatched; a stop passes them all.

mod moves;
mod opening;
mod reports;
mod stop;

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use async_trait::async_trait;
use tokio::sync::{Notify, watch};
use tokio::time::Instant;

use super::grbl::{self, Alarm, Letter, Mode, Settings};
use crate::config::AxisConfig;
use crate::device::port::{Port, PortError};
use crate::device::{AxisName, DeviceError, Stage, StageInfo, StageState, StopDelivery};
use crate::units::Millimetres;
use stop::UnderWay;

/// Time between status requests in motion: 10 Hz is what Grbl's interface document allows.
const POLL_MOVING: Duration = Duration::from_millis(100);
/// Longest wait for the answer to anything but homing.
const ANSWER: Duration = Duration::from_secs(2);
/// A board that resets when its port is opened spends a second and more in its boot loader.
const START_UP: Duration = Duration::from_secs(2);

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
    controller: Arc<Controller>,
}

struct Controller {
    name: String,
    location: String,
    identity: String,
    settings: Settings,
    homes_single_axes: bool,
    axes: Vec<Axis>,
    port: Port,
    readings: watch::Sender<Option<Reading>>,
    alarm: watch::Sender<Option<Alarm>>,
    /// The newest generation that a stop has outdated.
    stops: watch::Sender<u64>,
    /// How many stops are under way.
    stops_under_way: watch::Sender<u32>,
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
    /// The stage of one of the controller's axes, if it has it.
    #[must_use]
    pub fn stage(&self, axis: AxisName) -> Option<GrblStage> {
        let index = self.controller.axes.iter().position(|candidate| candidate.setup.axis == axis)?;
        Some(GrblStage { controller: Arc::clone(&self.controller), index })
    }
}

/// One axis of a [`GrblController`].
#[derive(Clone)]
pub struct GrblStage {
    controller: Arc<Controller>,
    index: usize,
}

impl GrblStage {
    fn axis(&self) -> &Axis {
        &self.controller.axes[self.index]
    }

    fn gone(&self) -> DeviceError {
        DeviceError::Disconnected { device: self.controller.name.clone(), reason: "its task has ended".to_owned() }
    }
}

#[async_trait]
impl Stage for GrblStage {
    fn info(&self) -> StageInfo {
        StageInfo {
            axis: self.axis().setup.axis,
            driver: "grbl".to_owned(),
            identity: self.controller.identity.clone(),
            location: self.controller.location.clone(),
            disagreements: self.axis().disagreements.clone(),
        }
    }

    fn state(&self) -> watch::Receiver<StageState> {
        self.axis().state.subscribe()
    }

    async fn read_state(&self) -> Result<StageState, DeviceError> {
        if let Some(error) = self.controller.closed_error() {
            return Err(error);
        }
        // Homing is answered by silence until its end, a critical alarm until the reset: the state already says so.
        let mute = self.controller.homing.load(Ordering::SeqCst)
            || self.controller.alarm.borrow().is_some_and(Alarm::needs_reset);
        if !mute {
            self.controller.fresh_reading(self.controller.latest_line()).await?;
        }
        Ok(self.axis().state.borrow().clone())
    }

    fn homes_also(&self) -> Option<AxisName> {
        let other = self.controller.axes.iter().enumerate().find(|(index, _)| *index != self.index);
        other.filter(|_| !self.controller.homes_single_axes).map(|(_, axis)| axis.setup.axis)
    }

    async fn home(&self) -> Result<(), DeviceError> {
        let (controller, index) = (Arc::clone(&self.controller), self.index);
        let generation = controller.port.generation();
        tokio::spawn(async move { controller.home(index, generation).await }).await.unwrap_or_else(|_| Err(self.gone()))
    }

    /// Grbl can switch off all of its motors only: every axis of the controller loses its position.
    async fn release(&self) -> Result<(), DeviceError> {
        let controller = Arc::clone(&self.controller);
        let (axis, generation) = (self.axis().setup.axis, controller.port.generation());
        let released = tokio::spawn(async move {
            let _operation = controller.operation.lock().await;
            controller.ready(axis, generation).await?;
            controller.forget_positions();
            let answer = controller.port.request(grbl::SLEEP, ANSWER, generation).await;
            answer.map_err(|error| device_error(&controller.name, "switch its motors off", error))?;
            // What comes next has to know that it sleeps.
            controller.fresh_reading(controller.latest_line()).await.map(|_| ())
        });
        released.await.unwrap_or_else(|_| Err(self.gone()))
    }

    async fn move_to(&self, target: Millimetres) -> Result<Millimetres, DeviceError> {
        let (controller, index) = (Arc::clone(&self.controller), self.index);
        let generation = controller.port.generation();
        tokio::spawn(async move { controller.move_to(index, target, generation).await })
            .await
            .unwrap_or_else(|_| Err(self.gone()))
    }

    async fn stop(&self) -> StopDelivery {
        let controller = Arc::clone(&self.controller);
        // At once, before the task runs: what is commanded from now on waits for the end of the stop.
        let under_way = UnderWay::new(&controller);
        controller.outdate_commands();
        let stopped = tokio::spawn(async move {
            let delivery = controller.bring_to_rest().await;
            drop(under_way);
            delivery
        });
        stopped.await.unwrap_or(StopDelivery::Undeliverable)
    }
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

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
