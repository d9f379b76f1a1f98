//! Moves, homing and stops of a polled controller.

use std::sync::atomic::Ordering;
use std::time::Duration;

use super::watch::POLL_MOVING;
use super::{Dialogue, Homing, Polled};
use crate::device::{AxisName, DeviceError, MoveTime, StopDelivery};
use plenoptics::units::Millimetres;

/// Distance between target and readback that is no arrival, mm.
pub(super) const ARRIVAL_MM: f64 = 0.01;
/// Time beyond its own deceleration that an axis may take to stop before it is stopped harder.
const STOP_SPARE: Duration = Duration::from_millis(200);
/// Time for the harder stop to show.
const HARD_STOP: Duration = Duration::from_secs(1);
/// Way beyond one and a half times the axis's travel that homing may take: to and fro at the switch.
const SEARCH_SPARE_MM: f64 = 10.0;
/// Answers in a row that say that homing has failed: between its phases a controller may seem to be at rest.
const FAILED_HOMING: u32 = 3;

/// Why homing has been given up.
fn lost(axis: AxisName, way: f64, travel: f64) -> String {
    format!(
        "it has gone {way:.1} mm and not found the switch that it homes to, on an axis of {travel:.1} mm; check the \
         switch, the direction (bench.{axis}.home_side, reversed) and the scale (steps_per_mm), then home again"
    )
}

impl<D: Dialogue> Polled<D> {
    /// Waits until no stop is under way, and tells what keeps an operation from starting.
    pub(super) async fn ready(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        self.orders.no_stop_under_way().await;
        if let Some(reason) = self.dialogue.closed().borrow().clone() {
            return Err(DeviceError::Disconnected { device: self.name.clone(), reason });
        }
        if self.orders.generation() != generation {
            return Err(DeviceError::Stopped { axis: self.axis(axis).link.name() });
        }
        Ok(())
    }

    /// What a command that failed comes to: the stop that came before it, if one did.
    async fn failed<T>(&self, axis: usize, generation: u64, error: DeviceError) -> Result<T, DeviceError> {
        if self.orders.generation() != generation {
            return self.stopped(axis).await;
        }
        if matches!(error, DeviceError::Timeout { .. } | DeviceError::Protocol { .. }) {
            // Whether it moves is not known.
            self.stop().await;
        }
        Err(error)
    }

    /// Waits for the end of the stop that ended an operation.
    pub(super) async fn stopped<T>(&self, axis: usize) -> Result<T, DeviceError> {
        self.stopping.ended().await;
        Err(DeviceError::Stopped { axis: self.axis(axis).link.name() })
    }

    /// Waits until an axis's position is not known any more.
    async fn home_lost(&self, axis: usize) {
        while self.axis(axis).link.home().is_some() {
            tokio::time::sleep(POLL_MOVING).await;
        }
    }

    pub(super) fn alarm(&self, axis: usize, reason: String) -> DeviceError {
        self.axis(axis).link.forget_home();
        DeviceError::Alarm { device: self.name.clone(), reason }
    }

    pub(super) async fn move_axis(
        &self,
        index: usize,
        target: Millimetres,
        speed: f64,
        generation: u64,
    ) -> Result<Millimetres, DeviceError> {
        let axis = self.axis(index);
        let (name, setup) = (axis.link.name(), axis.link.setup());
        let _operation = axis.operation.lock().await;
        self.ready(index, generation).await?;
        if !target.value().is_finite() {
            return Err(self.refused(format!("{target} is no position")));
        }
        if speed.is_nan() || speed <= 0.0 {
            return Err(self.refused(format!("{speed} mm/s is no speed")));
        }
        let facts = self.dialogue.facts(index);
        let speed = speed.min(facts.speed_mm_per_s);
        let from = self.look(index).await?;
        if let Some(reason) = from.fault {
            return Err(self.alarm(index, reason));
        }
        let homed = axis.link.state().homed;
        let Some(home) = axis.link.home().filter(|_| homed) else { return Err(DeviceError::NotHomed { axis: name }) };
        let position = setup.machine(target.value(), home);
        let distance = (position - from.position).abs();
        let allowed = MoveTime::of_trapezoid(distance, speed, facts.acceleration_mm_per_s2).maximum;
        let _watching = self.watching();
        if let Err(error) = self.dialogue.start_move(index, position, speed, generation).await {
            return self.failed(index, generation, error).await;
        }
        let reading = tokio::select! {
            biased;
            () = self.orders.outdated(generation) => return self.stopped(index).await,
            () = self.home_lost(index) => Err(DeviceError::NotHomed { axis: name }),
            reading = self.rest(index) => reading,
            () = tokio::time::sleep(allowed) => Err(self.timeout(&format!("end a move of {distance:.3} mm"), allowed)),
        };
        let reading = match reading {
            Ok(reading) => reading,
            Err(error) => {
                self.stop().await;
                return Err(error);
            }
        };
        if let Some(reason) = reading.fault {
            return Err(self.alarm(index, reason));
        }
        if axis.link.home().is_none() {
            return Err(DeviceError::NotHomed { axis: name });
        }
        let reached = setup.coordinate(reading.position, home);
        if (reached - target.value()).abs() > ARRIVAL_MM {
            return Err(self.came_to_rest_short(index, reached, target).await);
        }
        Ok(Millimetres(reached))
    }

    /// Why an axis stands elsewhere (mm) than it was sent.
    pub(super) async fn came_to_rest_short(&self, index: usize, reached: f64, target: Millimetres) -> DeviceError {
        if let Some(reason) = self.dialogue.why_short(index).await {
            return self.alarm(index, reason);
        }
        let name = self.axis(index).link.name();
        let detail = format!("the {name} axis came to rest at {reached:.3} mm on its way to {target:.3}");
        match self.dialogue.interrupted(index).await {
            Some(reason) => self.refused(format!("{reason}; {detail}")),
            None => DeviceError::Protocol { device: self.name.clone(), detail },
        }
    }

    pub(super) async fn home_axis(&self, index: usize, generation: u64) -> Result<(), DeviceError> {
        let axis = self.axis(index);
        let _operation = axis.operation.lock().await;
        self.ready(index, generation).await?;
        let _watching = self.watching();
        axis.link.forget_home();
        axis.homing.store(true, Ordering::SeqCst);
        let ended = self.run_homing(index, generation).await;
        axis.homing.store(false, Ordering::SeqCst);
        let home = match ended {
            Ok(home) => home,
            Err(error) => {
                if self.orders.generation() != generation {
                    return self.stopped(index).await;
                }
                if !matches!(error, DeviceError::Disconnected { .. } | DeviceError::Refused { .. }) {
                    self.stop().await;
                }
                // What it came to shows at once.
                let _ = self.look(index).await;
                return Err(error);
            }
        };
        if let Some(ends) = self.dialogue.limits(index) {
            // Only now is it certain where the controller's own limits lie.
            let setup = axis.link.setup();
            let (low, high) = setup.range(ends, home);
            setup.compare_limits(low, high).map_err(|sentence| self.refused(sentence))?;
        }
        axis.link.set_home(home);
        self.look(index).await.map(|_| ())
    }

    async fn run_homing(&self, index: usize, generation: u64) -> Result<f64, DeviceError> {
        let setup = self.axis(index).link.setup();
        let travel = setup.config.high_limit_mm - setup.config.low_limit_mm;
        // Homing speeds are the controller's own: a tenth of the axis's speed is taken for the slowest.
        let allowed = Duration::from_secs_f64((20.0 + 10.0 * travel / setup.config.speed_mm_per_s).min(1800.0));
        let what = format!("home the {} axis", setup.axis);
        let steps = async {
            self.dialogue.prepare(index, generation).await?;
            self.dialogue.start_homing(index, generation).await?;
            let mut failed = 0;
            let (farthest, mut way, mut last) = (1.5 * travel + SEARCH_SPARE_MM, 0.0, None);
            loop {
                tokio::time::sleep(POLL_MOVING).await;
                match self.dialogue.homing(index).await? {
                    Homing::Running(at) => {
                        failed = 0;
                        let step = f64::abs(at - last.replace(at).unwrap_or(at));
                        // More at once is no way: the coordinate was set anew.
                        way += if step < 0.25 * farthest { step } else { 0.0 };
                        if way > farthest {
                            return Err(self.alarm(index, lost(setup.axis, way, travel)));
                        }
                    }
                    Homing::Done(home) => return Ok(home),
                    Homing::Failed(reason) if failed + 1 == FAILED_HOMING => {
                        return Err(DeviceError::Alarm { device: self.name.clone(), reason });
                    }
                    Homing::Failed(_) => failed += 1,
                }
            }
        };
        tokio::select! {
            biased;
            () = self.orders.outdated(generation) => {
                Err(DeviceError::Stopped { axis: self.axis(index).link.name() })
            }
            ended = steps => ended,
            () = tokio::time::sleep(allowed) => Err(self.timeout(&what, allowed)),
        }
    }

    /// Stops what moves and what waits to move, without having been asked to.
    pub(super) async fn stop(&self) -> StopDelivery {
        self.orders.outdate();
        self.stop_now().await
    }

    pub(super) async fn stop_now(&self) -> StopDelivery {
        if !self.send_halt(false).await {
            return StopDelivery::Undeliverable;
        }
        let _watching = self.watching();
        self.stopping.prove(self.prove_rest()).await
    }

    async fn prove_rest(&self) -> StopDelivery {
        let deceleration = (0..self.axes.len())
            .map(|axis| self.dialogue.facts(axis))
            .map(|facts| facts.speed_mm_per_s / facts.acceleration_mm_per_s2)
            .fold(0.0, f64::max);
        // Rest is seen by two readings of every axis, which on a slow line take their time.
        let readings = 4 * self.axes.len() as u32 * *self.reading_takes.borrow();
        let seen = 2 * POLL_MOVING + readings.min(Duration::from_secs(2));
        let allowed = STOP_SPARE + Duration::from_secs_f64(deceleration.min(5.0)) + seen;
        if tokio::time::timeout(allowed, self.all_rest()).await == Ok(true) {
            return StopDelivery::Confirmed;
        }
        // Whatever it still does, the steps may be wrong from here on.
        self.forget_positions();
        if !self.send_halt(true).await {
            return StopDelivery::Undeliverable;
        }
        if tokio::time::timeout(HARD_STOP + seen, self.all_rest()).await == Ok(true) {
            return StopDelivery::Confirmed;
        }
        match self.dialogue.closed().borrow().is_some() {
            true => StopDelivery::Undeliverable,
            false => StopDelivery::Sent,
        }
    }

    async fn send_halt(&self, hard: bool) -> bool {
        match self.dialogue.halt(hard) {
            Ok(written) => {
                let sent = matches!(tokio::time::timeout(STOP_SPARE, written).await, Ok(Ok(())));
                // The order that begins the stop: a harder one after it is a second stop.
                if sent && !hard {
                    self.orders.stop_sent();
                }
                sent
            }
            Err(_) => false,
        }
    }

    async fn all_rest(&self) -> bool {
        for axis in 0..self.axes.len() {
            if self.rest(axis).await.is_err() {
                return false;
            }
        }
        true
    }
}
