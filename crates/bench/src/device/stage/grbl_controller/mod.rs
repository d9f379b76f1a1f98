//! A connected controller with Grbl 1.1, grblHAL or FluidNC.
//!
//! Moves are jogs in machine coordinates: the controller checks them against its soft limits before they start, and a
//! single byte ends them. Everything that moves runs one at a time; a stop passes them all.

mod asking;
mod checks;
mod fluidnc;
mod follow;
mod moves;
mod opening;
mod renewal;
mod reports;
mod stop;
mod switches;
mod told;

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use async_trait::async_trait;
use tokio::sync::{Notify, watch};
use tokio::time::Instant;

use super::axis::AxisLink;
use super::grbl::{self, Alarm, Dialect, Letter, Mode};
use super::orders::Orders;
use super::session::{AxisFacts, Session};
use super::stopping::Stopping;
use crate::config::Side;
use crate::device::jog::Course;
use crate::device::port::{Port, PortError};
use crate::device::{DeviceError, StageState, StopDelivery};
use plenoptics::units::Millimetres;

pub use opening::GrblDriver;
use switches::Way;
use told::Told;

/// Time between status requests in motion: 10 Hz is what Grbl's interface document allows.
const POLL_MOVING: Duration = Duration::from_millis(100);
/// Longest wait for the answer to anything but homing.
const ANSWER: Duration = Duration::from_secs(2);
/// Longest wait for FluidNC's configuration, which is some ten thousand characters.
const DUMPED: Duration = Duration::from_secs(6);
/// A board that resets when its port is opened spends a second and more in its boot loader.
const START_UP: Duration = Duration::from_secs(2);

/// A status report with a known machine position.
#[derive(Debug, Clone, PartialEq)]
struct Reading {
    mode: Mode,
    machine: [f64; 3],
    limits: [bool; 3],
    hold_pressed: bool,
    line_number: u64,
    at: Instant,
}

struct Axis {
    link: AxisLink,
    letter: Letter,
    facts: Mutex<AxisFacts>,
    way: Mutex<Way>,
}

impl Axis {
    fn facts(&self) -> AxisFacts {
        locked(&self.facts).clone()
    }
}

struct Controller {
    name: String,
    identity: String,
    dialect: Dialect,
    told: Mutex<Told>,
    /// Whether another may have changed the settings since they were read.
    settings_stale: AtomicBool,
    axes: Vec<Axis>,
    port: Port,
    orders: Arc<Orders>,
    readings: watch::Sender<Option<Reading>>,
    alarm: watch::Sender<Option<Alarm>>,
    restarts: watch::Sender<u64>,
    restart_is_ours: AtomicBool,
    /// Which axis was told to move last.
    moved: Mutex<Option<usize>>,
    homing: AtomicBool,
    /// How many operations want readings at the faster rate.
    watched: AtomicU64,
    poll_now: Arc<Notify>,
    /// When the controller last said something.
    heard: Mutex<Instant>,
    /// When it last started anew.
    restarted: Mutex<Option<Instant>>,
    work_offset: Mutex<Option<[f64; 3]>>,
    operation: tokio::sync::Mutex<()>,
    stopping: Stopping,
}

#[async_trait]
impl Session for Controller {
    fn identity(&self) -> String {
        self.identity.clone()
    }

    fn facts(&self, axis: usize) -> AxisFacts {
        self.axes[axis].facts()
    }

    fn closed(&self) -> watch::Receiver<Option<String>> {
        self.port.closed()
    }

    async fn read_state(&self, axis: usize) -> Result<StageState, DeviceError> {
        if let Some(error) = self.closed_error() {
            return Err(error);
        }
        // Homing is answered by silence until its end, a critical alarm until the reset: the state already says so.
        let mute = self.homing.load(Ordering::SeqCst) || self.alarm.borrow().is_some_and(Alarm::is_mute);
        if !mute {
            self.fresh_reading(self.latest_line()).await?;
        }
        Ok(self.axes[axis].link.state())
    }

    async fn home(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        self.home_axis(axis, generation).await
    }

    fn homing_barred(&self, axis: usize) -> Option<String> {
        let limits = self.readings.borrow().as_ref()?.limits;
        self.axes[axis].barred(limits)
    }

    async fn step_off(
        &self,
        axis: usize,
        towards: Side,
        distance_mm: f64,
        generation: u64,
    ) -> Result<bool, DeviceError> {
        self.step_axis_off(axis, towards, distance_mm, generation).await
    }

    async fn set_position(&self, axis: usize, position: Millimetres, generation: u64) -> Result<(), DeviceError> {
        let _operation = self.operation.lock().await;
        let Axis { link, letter, .. } = &self.axes[axis];
        self.ready(link.name(), generation).await?;
        self.unlock(generation).await?;
        let reading = self.rest(self.latest_line()).await?;
        // A stop meanwhile may have cost the position.
        self.ready(link.name(), generation).await?;
        let offset = position.value() - link.setup().config.home_position_mm;
        link.set_home(reading.machine[letter.index()] - link.setup().direction() * offset);
        self.fresh_reading(self.latest_line()).await.map(|_| ())
    }

    async fn move_at(
        &self,
        axis: usize,
        target: Millimetres,
        speed_mm_per_s: f64,
        generation: u64,
    ) -> Result<Millimetres, DeviceError> {
        self.move_axis(axis, target, speed_mm_per_s, generation).await
    }

    async fn follow(&self, axis: usize, course: Course, generation: u64) -> Result<Millimetres, DeviceError> {
        self.follow_course(axis, course, generation).await
    }

    /// Grbl can switch off all of its motors only: every axis of the controller loses its position.
    async fn release(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        let _operation = self.operation.lock().await;
        self.ready(self.axes[axis].link.name(), generation).await?;
        self.forget_positions();
        self.forget_ways();
        let answer = self.port.request(grbl::SLEEP, ANSWER, generation).await;
        answer.map_err(|error| self.device_error("switch its motors off", error))?;
        // What comes next has to know that it sleeps.
        self.fresh_reading(self.latest_line()).await.map(|_| ())
    }

    async fn bring_to_rest(&self) -> StopDelivery {
        self.rest_now().await
    }
}

impl Controller {
    fn device_error(&self, what: &str, error: PortError) -> DeviceError {
        device_error(&self.name, self.dialect, what, error)
    }

    fn homes_single_axes(&self) -> bool {
        locked(&self.told).homes_single_axes()
    }
}

fn device_error(name: &str, dialect: Dialect, what: &str, error: PortError) -> DeviceError {
    let device = name.to_owned();
    match error {
        PortError::Closed(reason) => DeviceError::Disconnected { device, reason },
        PortError::Timeout(allowed) => DeviceError::Timeout { device, what: what.to_owned(), allowed },
        PortError::Refused(line) => {
            DeviceError::Refused { device, reason: format!("{line}: {}", grbl::error_meaning(&line, dialect)) }
        }
        PortError::Halted(line) => {
            let alarm = Alarm::from_line(&line, dialect).map_or_else(|| line.clone(), |alarm| alarm.to_string());
            DeviceError::Alarm { device, reason: format!("{alarm}; it was to {what}") }
        }
        PortError::Restarted | PortError::Cancelled | PortError::OutOfStep => {
            DeviceError::Refused { device, reason: error.to_string() }
        }
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
