//! One axis of a controller through all its connections: its coordinate, its state, where its home is.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;

use crate::config::AxisConfig;
use crate::device::{AxisName, MoveTime, StageState};
use plenoptics::units::Millimetres;

/// A firmware limit this far beyond the configured one is no wider, mm: limits are written with two decimals.
const LIMIT_TOLERANCE_MM: f64 = 0.01;

/// One axis as configured.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisSetup {
    /// Which axis.
    pub axis: AxisName,
    /// Its configuration: `config.axis` is its name on the controller.
    pub config: AxisConfig,
}

impl AxisSetup {
    /// An axis of the configuration.
    #[must_use]
    pub fn new(axis: AxisName, config: &AxisConfig) -> Self {
        Self { axis, config: config.clone() }
    }

    /// +1 where the controller's positive direction is the coordinate's, −1 where it is the other.
    #[must_use]
    pub fn direction(&self) -> f64 {
        if self.config.reversed { -1.0 } else { 1.0 }
    }

    /// Coordinate for a controller's position, given the controller's position at home; all mm.
    #[must_use]
    pub fn coordinate(&self, machine: f64, home: f64) -> f64 {
        self.config.home_position_mm + self.direction() * (machine - home)
    }

    /// Least and greatest coordinate between two of the controller's positions, in either order, given its position at
    /// home; all mm.
    #[must_use]
    pub fn range(&self, ends: (f64, f64), home: f64) -> (f64, f64) {
        let (a, b) = (self.coordinate(ends.0, home), self.coordinate(ends.1, home));
        (a.min(b), a.max(b))
    }

    /// Controller's position for a coordinate, given the controller's position at home; all mm.
    #[must_use]
    pub fn machine(&self, coordinate: f64, home: f64) -> f64 {
        home + self.direction() * (coordinate - self.config.home_position_mm)
    }

    /// Whether homing runs towards the controller's negative end.
    #[must_use]
    pub fn homes_negative(&self) -> bool {
        self.config.home_side.sign() * self.direction() < 0.0
    }

    /// A controller's own limits (coordinate, mm) against the configured ones: a sentence where they differ and that does
    /// no harm.
    ///
    /// # Errors
    /// A sentence when the controller's are wider and that is not accepted: a contradiction.
    pub fn compare_limits(&self, low: f64, high: f64) -> Result<Option<String>, String> {
        let config = &self.config;
        let (wanted_low, wanted_high) = (config.low_limit_mm, config.high_limit_mm);
        let axis = self.axis;
        let wider = low < wanted_low - LIMIT_TOLERANCE_MM || high > wanted_high + LIMIT_TOLERANCE_MM;
        let narrower = low > wanted_low + LIMIT_TOLERANCE_MM || high < wanted_high - LIMIT_TOLERANCE_MM;
        let ranges = format!("from {low:.3} to {high:.3} mm, the configuration from {wanted_low} to {wanted_high} mm");
        if wider && !config.accept_wider_firmware_limits {
            return Err(format!(
                "The controller's own limits let the {axis} axis travel {ranges}; narrow the controller's, or set \
                 bench.{axis}.accept_wider_firmware_limits = true."
            ));
        }
        Ok(match (wider, narrower) {
            (true, _) => Some(format!(
                "The controller's own limits are wider than the configured ones, which is accepted: it lets the {axis} \
                 axis travel {ranges}."
            )),
            (false, true) => Some(format!("The controller lets the {axis} axis travel {ranges}.")),
            (false, false) => None,
        })
    }
}

impl MoveTime {
    /// Of a motion at rest at both ends: distance mm, speed mm/s, acceleration mm/s².
    #[must_use]
    pub fn of_trapezoid(distance: f64, speed: f64, acceleration: f64) -> Self {
        let (speed, acceleration) = (speed.max(1e-6), acceleration.max(1e-6));
        // Too short to reach the speed: a triangle.
        let predicted = if distance * acceleration < speed * speed {
            2.0 * (distance / acceleration).sqrt()
        } else {
            distance / speed + speed / acceleration
        };
        // Half as much again, ramps that a controller may round, and the time to see its end.
        let maximum = 2.0 + 1.5 * (distance / speed + speed / acceleration);
        // A day bounds what a speed of next to nothing would make of it.
        let seconds = |s: f64| Duration::from_secs_f64(s.clamp(0.0, 86_400.0));
        Self { predicted: seconds(predicted), maximum: seconds(maximum) }
    }
}

/// One axis through all its connections.
#[derive(Debug)]
pub struct Axis {
    /// As configured.
    pub setup: AxisSetup,
    state: watch::Sender<StageState>,
    /// Controller's position at home, mm, while the position is known.
    home: Mutex<Option<f64>>,
}

impl Axis {
    /// An axis that nothing is known of yet.
    #[must_use]
    pub fn new(setup: AxisSetup) -> Arc<Self> {
        let state = watch::Sender::new(StageState {
            connected: false,
            homed: false,
            position: Millimetres(0.0),
            moving: false,
            at_rest_since: None,
            limit_switch: false,
            fault: Some("not connected yet".to_owned()),
        });
        Arc::new(Self { setup, state, home: Mutex::new(None) })
    }

    /// Its state, as it changes.
    #[must_use]
    pub fn subscribe(&self) -> watch::Receiver<StageState> {
        self.state.subscribe()
    }

    /// Says that no controller is connected, and why.
    pub fn set_absent(&self, reason: &str) {
        self.state.send_if_modified(|state| {
            let absent = StageState {
                connected: false,
                homed: false,
                moving: false,
                at_rest_since: None,
                limit_switch: false,
                fault: Some(reason.to_owned()),
                position: state.position,
            };
            let changed = *state != absent;
            *state = absent;
            changed
        });
    }

    /// Forgets where home is: the position is unknown.
    pub fn forget_home(&self) {
        *self.home_lock() = None;
        self.state.send_modify(|state| state.homed = false);
    }

    fn home_lock(&self) -> MutexGuard<'_, Option<f64>> {
        self.home.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// An axis as one connection has it: what an ended connection still says is not heard.
#[derive(Debug, Clone)]
pub struct AxisLink {
    axis: Arc<Axis>,
    live: Arc<AtomicBool>,
}

impl AxisLink {
    /// The axis for a connection that lasts while `live` is set.
    #[must_use]
    pub fn new(axis: &Arc<Axis>, live: &Arc<AtomicBool>) -> Self {
        Self { axis: Arc::clone(axis), live: Arc::clone(live) }
    }

    /// As configured.
    #[must_use]
    pub fn setup(&self) -> &AxisSetup {
        &self.axis.setup
    }

    /// Which axis.
    #[must_use]
    pub fn name(&self) -> AxisName {
        self.axis.setup.axis
    }

    /// The state now.
    #[must_use]
    pub fn state(&self) -> StageState {
        self.axis.state.borrow().clone()
    }

    /// Changes the state.
    pub fn modify(&self, change: impl FnOnce(&mut StageState)) {
        self.axis.state.send_if_modified(|state| {
            // Looked at under the state's lock: what comes after the end of the connection changes nothing.
            let live = self.live.load(Ordering::SeqCst);
            if live {
                change(state);
            }
            live
        });
    }

    /// Controller's position at home, mm, while the position is known.
    #[must_use]
    pub fn home(&self) -> Option<f64> {
        *self.axis.home_lock()
    }

    /// Sets the controller's position at home, mm: from now on the position is known.
    pub fn set_home(&self, machine: f64) {
        if self.live.load(Ordering::SeqCst) {
            *self.axis.home_lock() = Some(machine);
        }
        self.modify(|state| state.homed = true);
    }

    /// Forgets where home is: the position is unknown.
    pub fn forget_home(&self) {
        if self.live.load(Ordering::SeqCst) {
            self.axis.forget_home();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::BenchConfig;

    #[test]
    fn coordinates_and_controllers_positions_are_each_others_inverse() {
        let mut config = BenchConfig::default().e;
        for reversed in [false, true] {
            config.reversed = reversed;
            let setup = AxisSetup::new(AxisName::E, &config);
            let machine = setup.machine(12.25, -3.0);
            assert!((setup.coordinate(machine, -3.0) - 12.25).abs() < 1e-12);
            assert_eq!(setup.coordinate(-3.0, -3.0), config.home_position_mm);
            assert_eq!(setup.homes_negative(), reversed, "home_side is high");
        }
    }

    #[test]
    fn wider_limits_are_refused_until_accepted_and_then_told() {
        let mut config = BenchConfig::default().e;
        let setup = |config: &AxisConfig| AxisSetup::new(AxisName::E, config);
        let same = setup(&config).compare_limits(-5.0, 32.005);
        assert_eq!(same, Ok(None));
        let narrower = setup(&config).compare_limits(-4.0, 32.0).unwrap().unwrap();
        assert!(narrower.contains("-4.000 to 32.000"), "{narrower}");
        let error = setup(&config).compare_limits(-5.0, 33.0).unwrap_err();
        assert!(error.contains("bench.e.accept_wider_firmware_limits = true"), "{error}");
        config.accept_wider_firmware_limits = true;
        let told = setup(&config).compare_limits(-5.0, 33.0).unwrap().unwrap();
        assert!(told.contains("wider") && told.contains("33.000"), "{told}");
    }

    #[test]
    fn a_move_takes_the_time_of_its_trapezoid_or_triangle() {
        let long = MoveTime::of_trapezoid(10.0, 5.0, 20.0);
        assert!((long.predicted.as_secs_f64() - 2.25).abs() < 1e-9);
        // 0.2 mm at 20 mm/s²: 0.1 s up, 0.1 s down, and 5 mm/s never reached.
        let short = MoveTime::of_trapezoid(0.2, 5.0, 20.0);
        assert!((short.predicted.as_secs_f64() - 0.2).abs() < 1e-9);
        assert!(short.maximum > short.predicted && long.maximum > long.predicted);
        assert_eq!(MoveTime::of_trapezoid(0.0, 5.0, 20.0).predicted.as_secs_f64(), 0.0);
    }
}
