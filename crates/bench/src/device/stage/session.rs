//! What a protocol's driver is to the rest: a way to make a connected controller of a stream, and that controller.

use std::sync::Arc;

use async_trait::async_trait;
use tokio::sync::watch;

use super::axis::AxisLink;
use super::orders::Orders;
use crate::config::Side;
use crate::device::jog::Course;
use crate::device::serial::Wire;
use crate::device::{AxisName, DeviceError, StageState, StopDelivery};
use plenoptics::units::Millimetres;

/// What a connection is made for.
pub struct Wanted {
    /// The controller's name, for errors.
    pub name: String,
    /// The axes configured on it.
    pub axes: Vec<AxisLink>,
    /// Its commands and stops.
    pub orders: Arc<Orders>,
}

/// Speaks one protocol.
#[async_trait]
pub trait Driver: Send + Sync {
    /// The driver's name in the configuration, e.g. `grbl`.
    fn name(&self) -> &'static str;

    /// Stops whatever moves, checks what answers, reads its settings and compares them with the configuration. Nothing
    /// that was under way before goes on.
    ///
    /// # Errors
    /// [`DeviceError::WrongDevice`] when something else answers, [`DeviceError::Timeout`] when nothing does,
    /// [`DeviceError::Disconnected`] when the stream ends, [`DeviceError::Refused`] when the controller's settings
    /// cannot be worked with.
    async fn connect(&self, wire: Wire, wanted: Wanted) -> Result<Arc<dyn Session>, DeviceError>;

    /// Asks what is at the other end, and nothing else: it sends questions only, none that stops, resets, sets or moves
    /// anything. `name` is the controller's, for errors.
    ///
    /// # Errors
    /// [`DeviceError::WrongDevice`] when something else answers, [`DeviceError::Timeout`] when nothing does,
    /// [`DeviceError::Disconnected`] when the stream ends.
    async fn identify(&self, wire: Wire, name: &str) -> Result<String, DeviceError>;
}

/// What is known of an axis from connecting.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AxisFacts {
    /// What differs between the controller's settings and the configuration and does no harm, one sentence each.
    pub disagreements: Vec<String>,
    /// Where the controller's settings would take the axis elsewhere than the configuration says (the end it homes to,
    /// its direction, its scale, its limits), and what to change, one sentence each. While there is one, nothing moves.
    pub contradictions: Vec<String>,
    /// The other axis, where the controller can home only both at once.
    pub homes_also: Option<AxisName>,
    /// The other axis, where the controller moves one of the two at a time.
    pub takes_turns_with: Option<AxisName>,
    /// Speed that the axis really has, mm/s.
    pub speed_mm_per_s: f64,
    /// Acceleration that the axis really has, mm/s².
    pub acceleration_mm_per_s2: f64,
    /// The controller's own limits, in the axis's coordinate, where it has some.
    pub limits_mm: Option<(f64, f64)>,
}

impl AxisFacts {
    /// Takes what a comparison of the controller's limits with the configured ones came to
    /// ([`AxisSetup::compare_limits`](super::axis::AxisSetup::compare_limits)).
    pub fn note(&mut self, compared: Result<Option<String>, String>) {
        match compared {
            Ok(sentence) => self.disagreements.extend(sentence),
            Err(sentence) => self.contradictions.push(sentence),
        }
    }

    /// Refuses motion while controller and configuration contradict each other. `device` is the controller's name.
    ///
    /// # Errors
    /// [`DeviceError::Refused`] with every contradiction.
    pub fn check_motion(&self, device: &str) -> Result<(), DeviceError> {
        if self.contradictions.is_empty() {
            return Ok(());
        }
        let reason = format!("nothing moves until one of the two is changed: {}", self.contradictions.join(" "));
        Err(DeviceError::Refused { device: device.to_owned(), reason })
    }
}

/// A controller that is connected and identified. Axes are numbered as in [`Wanted`].
#[async_trait]
pub trait Session: Send + Sync {
    /// What the controller says it is, version included; the same one says the same after a reconnection.
    fn identity(&self) -> String;

    /// What is known of an axis from connecting.
    fn facts(&self, axis: usize) -> AxisFacts;

    /// Why the connection has ended, once it has.
    fn closed(&self) -> watch::Receiver<Option<String>>;

    /// See [`Stage::read_state`](crate::device::Stage::read_state).
    ///
    /// # Errors
    /// As there.
    async fn read_state(&self, axis: usize) -> Result<StageState, DeviceError>;

    /// See [`Stage::home`](crate::device::Stage::home); `generation` is what it was admitted under.
    ///
    /// # Errors
    /// As there.
    async fn home(&self, axis: usize, generation: u64) -> Result<(), DeviceError>;

    /// See [`Stage::homing_barred`](crate::device::Stage::homing_barred).
    fn homing_barred(&self, _axis: usize) -> Option<String> {
        None
    }

    /// See [`Stage::step_off`](crate::device::Stage::step_off); `generation` is what it was admitted under.
    ///
    /// # Errors
    /// As there.
    async fn step_off(
        &self,
        axis: usize,
        _towards: Side,
        _distance_mm: f64,
        _generation: u64,
    ) -> Result<bool, DeviceError> {
        let reason = "its axes have a switch's input for each end, and leave a switch by homing".to_owned();
        Err(DeviceError::Refused { device: format!("axis {axis}'s controller"), reason })
    }

    /// See [`Stage::set_position`](crate::device::Stage::set_position); `generation` is what it was admitted under.
    ///
    /// # Errors
    /// As there.
    async fn set_position(&self, axis: usize, position: Millimetres, generation: u64) -> Result<(), DeviceError>;

    /// See [`Stage::move_at`](crate::device::Stage::move_at); `generation` is what it was admitted under.
    ///
    /// # Errors
    /// As there.
    async fn move_at(
        &self,
        axis: usize,
        target: Millimetres,
        speed_mm_per_s: f64,
        generation: u64,
    ) -> Result<Millimetres, DeviceError>;

    /// See [`Stage::follow`](crate::device::Stage::follow); `generation` is what it was admitted under.
    ///
    /// # Errors
    /// As there.
    async fn follow(&self, axis: usize, course: Course, generation: u64) -> Result<Millimetres, DeviceError>;

    /// See [`Stage::release`](crate::device::Stage::release); `generation` is what it was admitted under.
    ///
    /// # Errors
    /// As there.
    async fn release(&self, axis: usize, generation: u64) -> Result<(), DeviceError>;

    /// Brings every axis to rest, past every queue. What was commanded before has been outdated already.
    async fn bring_to_rest(&self) -> StopDelivery;
}
