//! A connected controller that speaks only when it is asked: what Zaber, PI and Trinamic controllers have in common.
//!
//! A protocol's [`Dialogue`] knows the questions and commands; this asks the questions again and again, and carries out
//! one motion an axis at a time. A stop passes them all.

mod follow;
mod motion;
mod watch;

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use async_trait::async_trait;
use tokio::sync::{Notify, oneshot, watch as channel};
use tokio::time::Instant;

use super::axis::AxisLink;
use super::orders::Orders;
use super::session::{AxisFacts, Session, Wanted};
use super::stopping::Stopping;
use crate::device::jog::Course;
use crate::device::port::PortError;
use crate::device::{DeviceError, StageState, StopDelivery};
use plenoptics::units::Millimetres;

/// What a controller says of an axis.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisReading {
    /// Position in the controller's own coordinate, mm.
    pub position: f64,
    /// Whether the axis moves.
    pub moving: bool,
    /// Whether the controller says that it knows the axis's reference; `None` where it cannot say.
    pub referenced: Option<bool>,
    /// Why the axis cannot move, by the controller.
    pub fault: Option<String>,
}

impl AxisReading {
    /// How far homing is, of a controller that says itself whether it has found what it homes to.
    #[must_use]
    pub fn homing(self, what: &str) -> Homing {
        match self {
            Self { moving: true, position, .. } => Homing::Running(position),
            Self { fault: Some(fault), .. } => Homing::Failed(fault),
            Self { referenced: Some(true), position, .. } => Homing::Done(position),
            _ => Homing::Failed(format!("it came to rest without having found its {what}; check it, home again")),
        }
    }
}

/// How far homing is.
#[derive(Debug, Clone, PartialEq)]
pub enum Homing {
    /// Not at its end: the controller's own coordinate now, mm.
    Running(f64),
    /// At its end: the controller's own coordinate there, mm.
    Done(f64),
    /// At rest without having found its reference, for this reason.
    Failed(String),
}

/// The questions and commands of one protocol to one controller. Positions and speeds are mm and mm/s in the
/// controller's own direction; axes are numbered as configured. Commands carry the generation at which they were given.
#[async_trait]
pub trait Dialogue: Send + Sync + 'static {
    /// What the controller says it is.
    fn identity(&self) -> String;

    /// What is known of an axis from connecting.
    fn facts(&self, axis: usize) -> AxisFacts;

    /// The controller's own limits of an axis in its own coordinate, mm, where it has some.
    fn limits(&self, axis: usize) -> Option<(f64, f64)>;

    /// The controller's position at home, mm, where it is the same for ever.
    fn home_position(&self) -> Option<f64>;

    /// Whether the controller moves an axis to a position only after its own homing.
    fn needs_reference(&self) -> bool;

    /// Why the port has closed, once it has.
    fn closed(&self) -> channel::Receiver<Option<String>>;

    /// Closes the port.
    fn close(&self, reason: &str);

    /// Asks for position and state of an axis.
    async fn read(&self, axis: usize) -> Result<AxisReading, DeviceError>;

    /// Asks for the position of an axis that moves, with no more than it takes to believe it, where that is quicker.
    async fn glance(&self, axis: usize) -> Result<AxisReading, DeviceError> {
        self.read(axis).await
    }

    /// Clears faults and switches the motor on.
    async fn prepare(&self, axis: usize, generation: u64) -> Result<(), DeviceError>;

    /// Starts homing.
    async fn start_homing(&self, axis: usize, generation: u64) -> Result<(), DeviceError>;

    /// Asks how far homing is.
    async fn homing(&self, axis: usize) -> Result<Homing, DeviceError>;

    /// Starts a move to a position.
    async fn start_move(&self, axis: usize, position: f64, speed: f64, generation: u64) -> Result<(), DeviceError>;

    /// Gives a move that is under way another end, at the same speed. Where the controller has to be told the speed with
    /// each move, as [`Dialogue::start_move`] does.
    async fn go_on(&self, axis: usize, position: f64, speed: f64, generation: u64) -> Result<(), DeviceError> {
        self.start_move(axis, position, speed, generation).await
    }

    /// Why a motion ended short of its target, if the controller knows.
    async fn why_short(&self, axis: usize) -> Option<String>;

    /// How another command than this program's interrupted the last motion, if the controller knows that one did.
    async fn interrupted(&self, _axis: usize) -> Option<String> {
        None
    }

    /// Switches the motor off.
    async fn switch_off(&self, axis: usize, generation: u64) -> Result<(), DeviceError>;

    /// Sends a stop of every axis past every queue; the harder one if there is one. Told when it has been written.
    fn halt(&self, hard: bool) -> Result<oneshot::Receiver<()>, PortError>;
}

struct Axis {
    link: AxisLink,
    operation: tokio::sync::Mutex<()>,
    homing: AtomicBool,
    /// Whether it is looked at by what moves it, more often than by the rest.
    followed: AtomicBool,
    seen: Mutex<Option<Seen>>,
}

/// Where an axis was said to be, in the controller's own coordinate, mm.
#[derive(Debug, Clone, Copy)]
struct Seen {
    position: f64,
    moving: bool,
    at: Instant,
}

/// A connected controller.
pub struct Polled<D> {
    name: String,
    dialogue: D,
    axes: Vec<Axis>,
    orders: Arc<Orders>,
    /// How many operations want readings at the faster rate.
    watched: AtomicU64,
    poll_now: Arc<Notify>,
    /// How long the last reading took.
    reading_takes: channel::Sender<Duration>,
    stopping: Stopping,
}

impl<D: Dialogue> Polled<D> {
    /// Takes over a controller that has been identified and brought to rest.
    ///
    /// # Errors
    /// When it does not tell its state.
    pub async fn start(dialogue: D, wanted: Wanted) -> Result<Arc<dyn Session>, DeviceError> {
        let axes = wanted.axes.into_iter().map(|link| Axis {
            link,
            operation: tokio::sync::Mutex::new(()),
            homing: AtomicBool::new(false),
            followed: AtomicBool::new(false),
            seen: Mutex::new(None),
        });
        let session = Arc::new(Self {
            name: wanted.name,
            dialogue,
            axes: axes.collect(),
            orders: wanted.orders,
            watched: AtomicU64::new(0),
            poll_now: Arc::new(Notify::new()),
            reading_takes: channel::Sender::new(Duration::ZERO),
            stopping: Stopping::default(),
        });
        for (index, axis) in session.axes.iter().enumerate() {
            let reading = session.dialogue.read(index).await?;
            // Only a controller that says itself that it has kept its reference is believed, and only as to where
            // its home is for ever or was when it was homed under this program's eyes.
            match session.dialogue.home_position().or_else(|| axis.link.home()) {
                Some(home) if reading.referenced == Some(true) && reading.fault.is_none() => axis.link.set_home(home),
                _ => axis.link.forget_home(),
            }
            session.take_reading(index, &reading);
        }
        tokio::spawn(watch::poll(Arc::downgrade(&session), Arc::clone(&session.poll_now)));
        Ok(session)
    }

    fn axis(&self, index: usize) -> &Axis {
        &self.axes[index]
    }

    fn refused(&self, reason: impl Into<String>) -> DeviceError {
        DeviceError::Refused { device: self.name.clone(), reason: reason.into() }
    }

    fn timeout(&self, what: &str, allowed: Duration) -> DeviceError {
        DeviceError::Timeout { device: self.name.clone(), what: what.to_owned(), allowed }
    }

    fn forget_positions(&self) {
        for axis in &self.axes {
            axis.link.forget_home();
        }
    }
}

#[async_trait]
impl<D: Dialogue> Session for Polled<D> {
    fn identity(&self) -> String {
        self.dialogue.identity()
    }

    fn facts(&self, axis: usize) -> AxisFacts {
        self.dialogue.facts(axis)
    }

    fn closed(&self) -> channel::Receiver<Option<String>> {
        self.dialogue.closed()
    }

    async fn read_state(&self, axis: usize) -> Result<StageState, DeviceError> {
        self.look(axis).await?;
        Ok(self.axis(axis).link.state())
    }

    async fn home(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        self.home_axis(axis, generation).await
    }

    async fn set_position(&self, axis: usize, position: Millimetres, generation: u64) -> Result<(), DeviceError> {
        let _operation = self.axis(axis).operation.lock().await;
        self.ready(axis, generation).await?;
        if self.dialogue.needs_reference() {
            return Err(self.refused("it moves to positions only after its own homing; home the axis"));
        }
        let reading = self.look(axis).await?;
        if reading.moving {
            return Err(self.refused("the axis moves"));
        }
        if let Some(reason) = reading.fault {
            return Err(DeviceError::Alarm { device: self.name.clone(), reason });
        }
        self.dialogue.prepare(axis, generation).await?;
        self.ready(axis, generation).await?;
        let link = &self.axis(axis).link;
        let offset = position.value() - link.setup().config.home_position_mm;
        link.set_home(reading.position - link.setup().direction() * offset);
        self.look(axis).await.map(|_| ())
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

    async fn release(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        let _operation = self.axis(axis).operation.lock().await;
        self.ready(axis, generation).await?;
        self.axis(axis).link.forget_home();
        self.dialogue.switch_off(axis, generation).await
    }

    async fn bring_to_rest(&self) -> StopDelivery {
        self.stop_now().await
    }
}

/// Counts a watcher while it lives.
struct Watching<'a>(&'a AtomicU64);

impl Drop for Watching<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::SeqCst);
    }
}
