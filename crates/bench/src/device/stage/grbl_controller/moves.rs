//! The motions of a controller: moves and homing, one at a time, each watched to its end.

use std::sync::atomic::Ordering;
use std::time::Duration;

use tokio::time::Instant;

use super::super::grbl::{self, Alarm, Dialect, Letter, Mode};
use super::{ANSWER, Axis, AxisFacts, Controller, Reading, locked};
use crate::device::port::PortError;
use crate::device::{AxisName, DeviceError, MoveTime};
use plenoptics::units::Millimetres;

/// Distance between target and readback that is no arrival, mm: Grbl reports three decimals of whole motor steps.
pub(super) const ARRIVAL_MM: f64 = 0.01;
/// A target this far beyond the controller's limits is at them, mm: home is, and it is reported with three decimals.
const BOUND_MM: f64 = 0.002;
/// A home switch trips at the same place again to this, mm.
const SWITCH_MM: f64 = 0.05;

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
            return Err(self.alarmed(alarm));
        }
        self.renew_if_stale(index).await?;
        let _watching = self.watching();
        let from = self.fresh_reading(self.latest_line()).await?;
        // Only now: a reset meanwhile has lost it.
        let Some(home) = axis.link.home() else { return Err(DeviceError::NotHomed { axis: name }) };
        let letter = axis.letter;
        let machine = axis.link.setup().machine(target.value(), home);
        self.check_reach(axis, target, machine)?;
        self.free(&from, generation).await?;
        let distance = (machine - from.machine[letter.index()]).abs();
        let AxisFacts { speed_mm_per_s: greatest, acceleration_mm_per_s2: acceleration, .. } = axis.facts();
        let speed = speed_mm_per_s.min(greatest);
        let allowed = MoveTime::of_trapezoid(distance, speed, acceleration).maximum;

        axis.note_move(machine - from.machine[letter.index()], from.limits);
        *locked(&self.moved) = Some(index);
        let mut restarts = self.restarts.subscribe();
        let begun = *restarts.borrow_and_update();
        let line = grbl::jog(letter, machine, speed * 60.0);
        let answer = match self.port.request(line, ANSWER, generation).await {
            Ok(answer) => answer,
            Err(_) if self.orders.generation() != generation => return self.stopped(name).await,
            Err(error) => {
                if matches!(error, PortError::Timeout(_) | PortError::OutOfStep) {
                    self.stop().await;
                }
                return Err(self.port_error("take a move", error));
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
            alarm = alarmed => return Err(self.alarmed(alarm.unwrap_or(Alarm::unknown(self.dialect)))),
            () = async { let _ = restarts.wait_for(|&count| count > begun).await.is_ok(); } => return Err(self.restarted()),
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
            return Err(self.held(name, reached, target, reading.hold_pressed));
        }
        Ok(Millimetres(reached))
    }

    /// It came to rest elsewhere than it was told to.
    pub(super) fn held(&self, name: AxisName, reached: f64, target: Millimetres, hold_pressed: bool) -> DeviceError {
        let whose = match hold_pressed {
            true => "its feed-hold input is pressed",
            false => "its feed-hold input, or another program, has told it to hold",
        };
        let reason = format!("the {name} axis came to rest at {reached:.3} mm on its way to {target:.3}: {whose}");
        DeviceError::Refused { device: self.name.clone(), reason }
    }

    /// Waits for the end of the stop that ended an operation.
    pub(super) async fn stopped<T>(&self, axis: AxisName) -> Result<T, DeviceError> {
        self.stopping.ended().await;
        Err(DeviceError::Stopped { axis })
    }

    pub(super) async fn home_axis(&self, index: usize, generation: u64) -> Result<(), DeviceError> {
        let name = self.axes[index].link.name();
        let _operation = self.operation.lock().await;
        self.ready(name, generation).await?;
        self.wake().await?;
        let admitted = self.axes[index].facts().homes_also;
        self.renew_settings(index).await?;
        // Whether the other one may move was looked at by what was known before.
        if let Some(other) = self.axes[index].facts().homes_also.filter(|_| admitted.is_none()) {
            let reason =
                format!("by its settings now, to home the {name} axis is to home the {other} axis too; home it again");
            return Err(DeviceError::Refused { device: self.name.clone(), reason });
        }
        let alone = self.homes_single_axes();
        let single = alone || self.axes.len() == 1;
        let homed: Vec<&Axis> =
            self.axes.iter().enumerate().filter(|(i, _)| !single || *i == index).map(|(_, axis)| axis).collect();
        let letter = alone.then(|| self.axes[index].letter);
        // Pins are told only while they are pressed: what one report leaves out may have been lost on its way.
        let first = self.fresh_reading(self.latest_line()).await?;
        let second = self.fresh_reading(first.line_number).await?;
        let limits = std::array::from_fn(|pin| first.limits[pin] || second.limits[pin]);
        self.check_switches(&homed, limits)?;
        // A stop may have come meanwhile.
        self.ready(name, generation).await?;
        for axis in &homed {
            axis.note_homing(limits);
            axis.link.forget_home();
            axis.link.modify(|state| {
                state.homed = false;
                state.moving = true;
                state.at_rest_since = None;
                state.fault = None;
            });
        }
        self.homing.store(true, Ordering::SeqCst);
        *locked(&self.moved) = None;
        let allowed = locked(&self.told).homing_time(letter);
        let began = Instant::now();
        let answer = self.port.request(grbl::home(letter), allowed, generation).await;
        let took = began.elapsed();
        for axis in &homed {
            axis.note_homed(answer.as_ref().map(drop), self.dialect);
        }
        let stopped = self.orders.generation() != generation;
        if let (Err(PortError::Timeout(_) | PortError::OutOfStep), false) = (&answer, stopped) {
            // While it counts as homing: a reset is all that ends it.
            self.stop().await;
        }
        self.homing.store(false, Ordering::SeqCst);
        // It was silent while it homed: that is not to be taken for a loss.
        *locked(&self.heard) = Instant::now();
        let answer = match answer {
            Ok(answer) => answer,
            Err(_) if stopped => return self.stopped(name).await,
            Err(error) => return Err(self.device_error(&format!("home the {name} axis"), error)),
        };
        let _watching = self.watching();
        let reading = tokio::select! {
            biased;
            () = self.orders.outdated(generation) => return self.stopped(name).await,
            reading = self.rest(answer.line_number) => reading?,
        };
        for axis in &homed {
            self.check_homed(axis, &reading, took)?;
        }
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

    /// Whether homing ended where the controller's configuration says that it ends, and not at once.
    fn check_homed(&self, axis: &Axis, reading: &Reading, took: Duration) -> Result<(), DeviceError> {
        let told = locked(&self.told);
        let (name, letter) = (axis.link.name(), axis.letter);
        let at = reading.machine[letter.index()];
        let reason = match told.home_mm(letter) {
            Some(home) if (at - home).abs() > ARRIVAL_MM => format!(
                "homing the {name} axis has ended at the machine position {at:.3} mm, and not at {home:.3}, as the controller is set \
                 and built: was this axis homed at all? Where it stands is not known"
            ),
            _ if took < told.least_homing_time(letter) => format!(
                "homing the {name} axis was over after {took:.1?}, too soon to have moved it: where it stands is not known"
            ),
            _ => return Ok(()),
        };
        Err(DeviceError::Refused { device: self.name.clone(), reason })
    }

    /// Whether a machine position is within what the controller can be told to go to.
    pub(super) fn is_within_bounds(&self, letter: Letter, machine_mm: f64) -> bool {
        let bounds = locked(&self.told).bounds_mm(letter);
        bounds.is_none_or(|(low, high)| (low - BOUND_MM..=high + BOUND_MM).contains(&machine_mm))
    }

    /// Refuses a target that the controller would make another of, or at which the home switch trips.
    pub(super) fn check_reach(&self, axis: &Axis, target: Millimetres, machine_mm: f64) -> Result<(), DeviceError> {
        if self.dialect != Dialect::FluidNc {
            return self.check_trip(axis, target);
        }
        if self.is_within_bounds(axis.letter, machine_mm) {
            return Ok(());
        }
        let name = axis.link.name();
        let reason =
            format!("{target:.3} is beyond the travel of the {name} axis (max_travel_mm, from its home position)");
        Err(DeviceError::Refused { device: self.name.clone(), reason })
    }

    /// Frees an axis that is homed for motion: FluidNC stays locked until every axis of its machine is homed.
    pub(super) async fn free(&self, reading: &Reading, generation: u64) -> Result<(), DeviceError> {
        if self.dialect == Dialect::FluidNc && reading.mode == Mode::Alarm {
            self.unlock(generation).await
        } else {
            Ok(())
        }
    }

    /// Refuses a target where the home switch trips: it would end in an alarm, and cost every axis its reference.
    fn check_trip(&self, axis: &Axis, target: Millimetres) -> Result<(), DeviceError> {
        let Some(switch) = locked(&self.told).switch_mm() else { return Ok(()) };
        let config = &axis.link.setup().config;
        let side = config.home_side;
        let trip = config.home_position_mm + side.sign() * switch;
        if (target.value() - trip).abs() > SWITCH_MM {
            return Ok(());
        }
        let name = axis.link.name();
        let reason = format!(
            "{target:.3} is where the {name} axis's home switch trips: keep bench.{name}.{side}_limit_mm a millimetre from it"
        );
        Err(DeviceError::Refused { device: self.name.clone(), reason })
    }

    /// It came up anew under a motion.
    pub(super) fn restarted(&self) -> DeviceError {
        let reason = "it restarted while the axis moved, and its position is lost: see to its supply, then home it";
        DeviceError::Alarm { device: self.name.clone(), reason: reason.to_owned() }
    }

    /// Leaves the lock that the controller starts in, without homing; an alarm that needs a reset stays.
    pub(super) async fn unlock(&self, generation: u64) -> Result<(), DeviceError> {
        if let Some(alarm) = *self.alarm.borrow() {
            return Err(DeviceError::Alarm { device: self.name.clone(), reason: alarm.to_string() });
        }
        if self.fresh_reading(self.latest_line()).await?.mode == Mode::Alarm {
            let answer = self.port.request(grbl::UNLOCK, ANSWER, generation).await;
            answer.map_err(|error| self.device_error("unlock", error))?;
        }
        Ok(())
    }

    /// What a port says, in the device's words, with what the last motion tells of an alarm.
    fn port_error(&self, what: &str, error: PortError) -> DeviceError {
        match error {
            PortError::Halted(line) => {
                self.alarmed(Alarm::from_line(&line, self.dialect).unwrap_or(Alarm::unknown(self.dialect)))
            }
            other => self.device_error(what, other),
        }
    }
}
