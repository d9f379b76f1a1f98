//! One controller, whether it is there or not: connected, watched, connected again, and the stages on it.
//!
//! ```text
//!             opened, identified, same as before
//!   absent ---------------------------------------> connected
//!     ^  \__ pause, growing; the reason is shown        |
//!     \_________________________________________________/
//!        end of the stream, or silence: positions unknown
//! ```
//!
//! Connecting stops whatever moves, and nothing resumes: a position counts as known after a reconnection only where the
//! controller itself says that it has kept its reference.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::Duration;

use async_trait::async_trait;
use tokio::sync::watch;
use tokio::time::Instant;

use super::axis::{Axis, AxisLink, AxisSetup};
use super::orders::Orders;
use super::session::{AxisFacts, Driver, Session, Wanted};
use crate::config::Side;
use crate::device::jog::Course;
use crate::device::ramp::Ramp;
use crate::device::serial::Dial;
use crate::device::{AxisName, DeviceError, MoveTime, Stage, StageInfo, StageState, StopDelivery};
use crate::telemetry;
use plenoptics::units::Millimetres;

/// First and longest pause before a controller that is not there is tried again.
const PAUSES: (Duration, Duration) = (Duration::from_millis(250), Duration::from_secs(5));
/// Longest wait between a first reading and the end of connecting.
const CONNECTING: Duration = Duration::from_secs(1);
/// Pause after another device answered, or one that is refused: it is not to be pestered.
const PAUSE_REFUSED: Duration = Duration::from_secs(15);

/// A stage controller of the configuration.
#[derive(Clone)]
pub struct Controller {
    shared: Arc<Shared>,
}

struct Shared {
    name: String,
    driver: Box<dyn Driver>,
    dial: Arc<dyn Dial>,
    /// What the controller's identity must contain.
    expected: Option<String>,
    axes: Vec<Arc<Axis>>,
    orders: Arc<Orders>,
    connection: watch::Sender<Connection>,
    /// What was found at the last connection.
    found: Mutex<Found>,
}

#[derive(Clone)]
enum Connection {
    /// No attempt has ended yet.
    New,
    Absent(DeviceError),
    Present(Arc<dyn Session>),
}

#[derive(Default)]
struct Found {
    identity: Option<String>,
    facts: Vec<AxisFacts>,
}

impl Controller {
    /// Starts connecting a controller, and goes on until every stage of it is dropped. `name` is for errors;
    /// `expected` must be contained in what the controller says it is. Must be called within a tokio runtime.
    #[must_use]
    pub fn start(
        name: &str,
        driver: Box<dyn Driver>,
        dial: Arc<dyn Dial>,
        expected: Option<String>,
        setups: Vec<AxisSetup>,
    ) -> Self {
        let shared = Arc::new(Shared {
            name: name.to_owned(),
            driver,
            dial,
            expected,
            axes: setups.into_iter().map(Axis::new).collect(),
            orders: Arc::default(),
            connection: watch::Sender::new(Connection::New),
            found: Mutex::default(),
        });
        tokio::spawn(supervise(Arc::downgrade(&shared)));
        Self { shared }
    }

    /// Waits until the first attempt to connect has ended.
    ///
    /// # Errors
    /// Why it failed.
    pub async fn first_attempt(&self) -> Result<(), DeviceError> {
        let mut connection = self.shared.connection.subscribe();
        let ended = connection.wait_for(|connection| !matches!(connection, Connection::New)).await;
        match ended.as_deref() {
            Ok(Connection::Absent(error)) => Err(error.clone()),
            _ => Ok(()),
        }
    }

    /// The stage of one of the controller's axes, if it has it.
    #[must_use]
    pub fn stage(&self, axis: AxisName) -> Option<ControllerStage> {
        let index = self.shared.axes.iter().position(|candidate| candidate.setup.axis == axis)?;
        Some(ControllerStage { shared: Arc::clone(&self.shared), index })
    }
}

async fn supervise(weak: Weak<Shared>) {
    let mut pause = PAUSES.0;
    loop {
        let Some(shared) = weak.upgrade() else { return };
        let live = Arc::new(AtomicBool::new(true));
        match shared.connect(&live).await {
            Ok(session) => {
                pause = PAUSES.0;
                let mut closed = session.closed();
                shared.connection.send_replace(Connection::Present(session));
                // Only the stages keep it alive from here on.
                drop(shared);
                let reason = match closed.wait_for(Option::is_some).await {
                    Ok(reason) => reason.clone().unwrap_or_default(),
                    Err(_) => "its task has ended".to_owned(),
                };
                live.store(false, Ordering::SeqCst);
                let Some(shared) = weak.upgrade() else { return };
                tracing::warn!(controller = %shared.name, reason = %reason, "a stage controller is lost");
                shared.absent(DeviceError::Disconnected { device: shared.name.clone(), reason });
            }
            Err(error) => {
                live.store(false, Ordering::SeqCst);
                let refused = matches!(error, DeviceError::WrongDevice { .. } | DeviceError::Refused { .. });
                pause = if refused { PAUSE_REFUSED } else { pause.min(PAUSES.1) };
                shared.absent(error);
            }
        }
        tokio::time::sleep(pause).await;
        pause = (2 * pause).min(PAUSES.1);
    }
}

/// Whether a controller says what the configuration demands of it, where that demands something.
///
/// # Errors
/// [`DeviceError::WrongDevice`] where it does not.
pub(in crate::device) fn check_identity(
    device: &str,
    identity: &str,
    expected: Option<&str>,
) -> Result<(), DeviceError> {
    match expected {
        Some(expected) if !identity.contains(expected) => Err(DeviceError::WrongDevice {
            device: device.to_owned(),
            expected: format!("one that says `{expected}`"),
            found: identity.to_owned(),
        }),
        _ => Ok(()),
    }
}

impl Shared {
    async fn connect(&self, live: &Arc<AtomicBool>) -> Result<Arc<dyn Session>, DeviceError> {
        let wire = self.dial.open().await?;
        let wanted = Wanted {
            name: self.name.clone(),
            axes: self.axes.iter().map(|axis| AxisLink::new(axis, live)).collect(),
            orders: Arc::clone(&self.orders),
        };
        let session = self.driver.connect(wire, wanted).await?;
        let identity = session.identity();
        check_identity(&self.name, &identity, self.expected.as_deref())?;
        let mut found = self.found.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(before) = found.identity.as_ref().filter(|before| **before != identity) {
            return Err(DeviceError::WrongDevice {
                device: self.name.clone(),
                expected: format!("{before}, which was there before (restart after exchanging a controller)"),
                found: identity,
            });
        }
        tracing::info!(controller = %self.name, identity = %identity, "a stage controller is connected");
        telemetry::connected(&self.name);
        found.facts = (0..self.axes.len()).map(|axis| session.facts(axis)).collect();
        found.identity = Some(identity);
        Ok(session)
    }

    fn absent(&self, error: DeviceError) {
        // The device is named where the state is shown: the reason is enough, unless the kind of error tells more.
        let reason = match &error {
            DeviceError::Disconnected { reason, .. } => reason.clone(),
            other => other.to_string(),
        };
        for axis in &self.axes {
            axis.set_absent(&reason);
        }
        let changed = match &*self.connection.borrow() {
            Connection::Absent(before) => *before != error,
            Connection::New => true,
            // Its loss has been said.
            Connection::Present(_) => false,
        };
        if changed {
            tracing::warn!(controller = %self.name, reason = %error, "a stage controller is not there");
        }
        self.connection.send_replace(Connection::Absent(error));
    }

    /// The connected controller. Where a state says already that it is, its connection is waited for.
    async fn session(&self) -> Result<Arc<dyn Session>, DeviceError> {
        let mut connection = self.connection.subscribe();
        let connecting = || self.axes.iter().any(|axis| axis.subscribe().borrow().connected);
        let present = connection.wait_for(|connection| matches!(connection, Connection::Present(_)) || !connecting());
        let _ = tokio::time::timeout(CONNECTING, present).await.is_ok();
        self.session_now()
    }

    fn session_now(&self) -> Result<Arc<dyn Session>, DeviceError> {
        match &*self.connection.borrow() {
            Connection::Present(session) => match &*session.closed().borrow() {
                Some(reason) => Err(DeviceError::Disconnected { device: self.name.clone(), reason: reason.clone() }),
                None => Ok(Arc::clone(session)),
            },
            Connection::Absent(error) => Err(error.clone()),
            Connection::New => {
                Err(DeviceError::Disconnected { device: self.name.clone(), reason: "it is being connected".to_owned() })
            }
        }
    }

    /// What is known of an axis: from its controller where it is connected, from the last connection else.
    fn facts(&self, axis: usize) -> Option<AxisFacts> {
        if let Ok(session) = self.session_now() {
            return Some(session.facts(axis));
        }
        self.found.lock().unwrap_or_else(PoisonError::into_inner).facts.get(axis).cloned()
    }
}

/// One axis of a [`Controller`].
#[derive(Clone)]
pub struct ControllerStage {
    shared: Arc<Shared>,
    index: usize,
}

impl ControllerStage {
    fn axis(&self) -> &Axis {
        &self.shared.axes[self.index]
    }

    /// Runs a command in a task of its own, so that dropping its caller neither cuts it nor leaves a motion unwatched.
    async fn run<R, F>(&self, command: impl FnOnce(Arc<dyn Session>, usize) -> F) -> Result<R, DeviceError>
    where
        R: Send + 'static,
        F: Future<Output = Result<R, DeviceError>> + Send + 'static,
    {
        let task = tokio::spawn(command(self.shared.session().await?, self.index));
        match task.await {
            Ok(ended) => ended,
            Err(_) => {
                // What it had moving is watched by nobody.
                self.stop().await;
                let device = self.shared.name.clone();
                Err(DeviceError::Disconnected { device, reason: "its task has ended".to_owned() })
            }
        }
    }

    /// [`Self::run`] for what leads to motion: refused while the connected controller contradicts the configuration.
    async fn run_motion<R, F>(
        &self,
        command: impl FnOnce(Arc<dyn Session>, usize) -> F + Send + 'static,
    ) -> Result<R, DeviceError>
    where
        R: Send + 'static,
        F: Future<Output = Result<R, DeviceError>> + Send + 'static,
    {
        let device = self.shared.name.clone();
        self.run(move |session, axis| async move {
            session.facts(axis).check_motion(&device)?;
            command(session, axis).await
        })
        .await
    }
}

#[async_trait]
impl Stage for ControllerStage {
    fn info(&self) -> StageInfo {
        let facts = self.shared.facts(self.index).unwrap_or_default();
        let identity = self.shared.found.lock().unwrap_or_else(PoisonError::into_inner).identity.clone();
        StageInfo {
            axis: self.axis().setup.axis,
            driver: self.shared.driver.name().to_owned(),
            identity: identity.unwrap_or_default(),
            location: self.shared.dial.location(),
            disagreements: facts.disagreements,
            contradictions: facts.contradictions,
            firmware_limits: facts.limits_mm.map(|(low, high)| (Millimetres(low), Millimetres(high))),
        }
    }

    fn state(&self) -> watch::Receiver<StageState> {
        self.axis().subscribe()
    }

    async fn read_state(&self) -> Result<StageState, DeviceError> {
        self.shared.session().await?.read_state(self.index).await
    }

    fn homes_also(&self) -> Option<AxisName> {
        self.shared.facts(self.index)?.homes_also
    }

    fn takes_turns_with(&self) -> Option<AxisName> {
        self.shared.facts(self.index)?.takes_turns_with
    }

    fn generation(&self) -> u64 {
        self.shared.orders.generation()
    }

    fn move_time(&self, from: Millimetres, to: Millimetres) -> MoveTime {
        let Ramp { speed_mm_per_s, acceleration_mm_per_s2 } = self.ramp();
        MoveTime::of_trapezoid((to - from).abs().value(), speed_mm_per_s, acceleration_mm_per_s2)
    }

    fn ramp(&self) -> Ramp {
        let config = &self.axis().setup.config;
        let (speed_mm_per_s, acceleration_mm_per_s2) = match self.shared.facts(self.index) {
            Some(facts) => (facts.speed_mm_per_s, facts.acceleration_mm_per_s2),
            None => (config.speed_mm_per_s, config.acceleration_mm_per_s2),
        };
        Ramp { speed_mm_per_s, acceleration_mm_per_s2 }
    }

    async fn home(&self, generation: u64) -> Result<(), DeviceError> {
        self.run_motion(move |session, axis| async move { session.home(axis, generation).await }).await
    }

    fn homing_barred(&self) -> Option<String> {
        self.shared.session_now().ok()?.homing_barred(self.index)
    }

    async fn step_off(&self, towards: Side, distance_mm: f64, generation: u64) -> Result<bool, DeviceError> {
        self.run_motion(
            move |session, axis| async move { session.step_off(axis, towards, distance_mm, generation).await },
        )
        .await
    }

    async fn set_position(&self, position: Millimetres, generation: u64) -> Result<(), DeviceError> {
        self.run_motion(move |session, axis| async move { session.set_position(axis, position, generation).await })
            .await
    }

    fn forget_position(&self) {
        self.axis().forget_home();
    }

    async fn move_at(
        &self,
        target: Millimetres,
        speed_mm_per_s: f64,
        generation: u64,
    ) -> Result<Millimetres, DeviceError> {
        self.run_motion(
            move |session, axis| async move { session.move_at(axis, target, speed_mm_per_s, generation).await },
        )
        .await
    }

    async fn follow(&self, course: Course, generation: u64) -> Result<Millimetres, DeviceError> {
        self.run_motion(move |session, axis| async move { session.follow(axis, course, generation).await }).await
    }

    async fn release(&self, generation: u64) -> Result<(), DeviceError> {
        self.run(move |session, axis| async move { session.release(axis, generation).await }).await
    }

    fn stop_sent(&self) -> Option<Instant> {
        self.shared.orders.newest_stop_sent()
    }

    async fn stop(&self) -> StopDelivery {
        // At once, before the task runs: what is commanded from now on waits for the end of the stop.
        let under_way = self.shared.orders.stop();
        let Ok(session) = self.shared.session().await else { return StopDelivery::Undeliverable };
        let stopped = tokio::spawn(async move {
            let delivery = session.bring_to_rest().await;
            drop(under_way);
            delivery
        });
        stopped.await.unwrap_or(StopDelivery::Undeliverable)
    }
}
