//! The motions of a controller: moves and homing, one at a time, each watched to its end.

use std::sync::atomic::Ordering;
use std::time::Duration;

use tokio::time::Instant;

use super::super::grbl::{self, Alarm, Letter, Mode};
use super::{ANSWER, Axis, AxisFacts, Controller, START_UP, device_error, locked};
use crate::device::port::PortError;
use crate::device::{AxisName, DeviceError, MoveTime};
use crate::units::Millimetres;

/// Distance between target and readback that is no arrival, mm: Grbl reports three decimals of whole motor steps.
const ARRIVAL_MM: f64 = 0.01;

impl Controller {
    /// Waits until no stop is under way, and tells what keeps an operation from starting.
    pub(super) async fn ready(&self, axis: AxisName, generation: u64) -> Result<(), DeviceError> {
        self.orders.no_stop_under_way().await;
        if let Some(error) = self.closed_error() {
            return Err(error);
        }
        if self.orders.generation() != generation {
            return Err(DeviceError::Stopped { axis });
        }
        Ok(())
    }

    pub(super) async fn move_axis(
        &self,
        index: usize,
        target: Millimetres,
        speed_mm_per_s: f64,
        generation: u64,
    ) -> Result<Millimetres, DeviceError> {
        let axis = &self.axes[index];
        let name = axis.link.name();
        let _operation = self.operation.lock().await;
        self.ready(name, generation).await?;
        if speed_mm_per_s.is_nan() || speed_mm_per_s <= 0.0 {
            let reason = format!("{speed_mm_per_s} mm/s is no speed");
            return Err(DeviceError::Refused { device: self.name.clone(), reason });
        }
        if !target.value().is_finite() {
            return Err(DeviceError::Refused { device: self.name.clone(), reason: format!("{target} is no position") });
        }
        if let Some(alarm) = *self.alarm.borrow() {
            return Err(DeviceError::Alarm { device: self.name.clone(), reason: alarm.to_string() });
        }
        let _watching = self.watching();
        let from = self.fresh_reading(self.latest_line()).await?;
        // Only now: a reset meanwhile has lost it.
        let Some(home) = axis.link.home() else { return Err(DeviceError::NotHomed { axis: name }) };
        let letter = axis.letter;
        let machine = axis.link.setup().machine(target.value(), home);
        let distance = (machine - from.machine[letter.index()]).abs();
        let AxisFacts { speed_mm_per_s: greatest, acceleration_mm_per_s2: acceleration, .. } = axis.facts;
        let speed = speed_mm_per_s.min(greatest);
        let allowed = MoveTime::of_trapezoid(distance, speed, acceleration).maximum;

        let line = grbl::jog(letter, machine, speed * 60.0);
        let answer = match self.port.request(line, ANSWER, generation).await {
            Ok(answer) => answer,
            Err(_) if self.orders.generation() != generation => return self.stopped(name).await,
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
            () = self.orders.outdated(generation) => return self.stopped(name).await,
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
        if axis.link.home().is_none() {
            return Err(DeviceError::NotHomed { axis: name });
        }
        let reached = axis.link.setup().coordinate(reading.machine[letter.index()], home);
        if (reached - target.value()).abs() > ARRIVAL_MM {
            return Err(DeviceError::Protocol {
                device: self.name.clone(),
                detail: format!("the {name} axis came to rest at {reached:.3} mm on its way to {target:.3}"),
            });
        }
        Ok(Millimetres(reached))
    }

    /// Waits for the end of the stop that ended an operation.
    pub(super) async fn stopped<T>(&self, axis: AxisName) -> Result<T, DeviceError> {
        let _stopping = self.stopping.lock().await;
        Err(DeviceError::Stopped { axis })
    }

    pub(super) async fn home_axis(&self, index: usize, generation: u64) -> Result<(), DeviceError> {
        let name = self.axes[index].link.name();
        let _operation = self.operation.lock().await;
        self.ready(name, generation).await?;
        let locked_up = self.alarm.borrow().is_some_and(Alarm::needs_reset);
        let held = self.readings.borrow().as_ref().is_some_and(|r| matches!(r.mode, Mode::Hold(_) | Mode::Sleep));
        if (locked_up || held) && !self.restart(false).await {
            return Err(self.timeout("answer a reset", START_UP));
        }
        let single = self.homes_single_axes || self.axes.len() == 1;
        let homed: Vec<&Axis> =
            self.axes.iter().enumerate().filter(|(i, _)| !single || *i == index).map(|(_, axis)| axis).collect();
        let letter = self.homes_single_axes.then(|| self.axes[index].letter);
        for axis in &homed {
            axis.link.forget_home();
            axis.link.modify(|state| {
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
        *locked(&self.heard) = Instant::now();
        let answer = match answer {
            Ok(answer) => answer,
            Err(_) if self.orders.generation() != generation => return self.stopped(name).await,
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
            () = self.orders.outdated(generation) => return self.stopped(name).await,
            reading = self.rest(answer.line_number) => reading?,
        };
        for axis in homed {
            let at = reading.machine[axis.letter.index()];
            axis.link.set_home(at);
            axis.link.modify(|state| {
                state.position = Millimetres(axis.link.setup().config.home_position_mm);
                state.moving = false;
                state.fault = None;
                state.at_rest_since = Some(reading.at);
            });
        }
        Ok(())
    }

    /// Leaves the lock that the controller starts in, without homing; an alarm that needs a reset stays.
    pub(super) async fn unlock(&self, generation: u64) -> Result<(), DeviceError> {
        if let Some(alarm) = *self.alarm.borrow() {
            return Err(DeviceError::Alarm { device: self.name.clone(), reason: alarm.to_string() });
        }
        if self.fresh_reading(self.latest_line()).await?.mode == Mode::Alarm {
            let answer = self.port.request(grbl::UNLOCK, ANSWER, generation).await;
            answer.map_err(|error| device_error(&self.name, "unlock", error))?;
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
}
