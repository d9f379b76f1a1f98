//! A controller below the layer that commands pass with their generation: it carries out an order or refuses it by that,
//! as the drivers' sessions and ports do, and keeps what it was told, in order.

use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use async_trait::async_trait;
use plenalign::device::jog::{Course, Seen};
use plenalign::device::serial::{Dial, Wire};
use plenalign::device::stage::axis::{AxisLink, AxisSetup};
use plenalign::device::stage::orders::Orders;
use plenalign::device::stage::session::{AxisFacts, Driver, Session, Wanted};
use plenalign::device::stage::supervisor::Controller;
use plenalign::device::{AxisName, DeviceError, StageState, StopDelivery};
use plenalign::units::Millimetres;
use tokio::sync::watch;
use tokio::task::yield_now;
use tokio::time::Instant;

use super::super::bench::small_config;

/// What a controller was told, and what the test noted between.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Told {
    /// An order that moves an axis.
    Order(AxisName, &'static str),
    Stop,
    /// From here on nothing may move.
    Ended,
}

/// The far end of the wire.
#[derive(Clone)]
pub(super) struct FarEnd(Arc<Inner>);

struct Inner {
    /// Whether it moves one axis at a time.
    takes_turns: bool,
    told: Mutex<Vec<Told>>,
    delivery: Mutex<StopDelivery>,
    links: Mutex<Vec<AxisLink>>,
    closed: watch::Sender<Option<String>>,
    /// Counts the times it was reset under its user.
    resets: watch::Sender<u32>,
}

impl FarEnd {
    pub(super) fn new(takes_turns: bool) -> Self {
        Self(Arc::new(Inner {
            takes_turns,
            told: Mutex::default(),
            delivery: Mutex::new(StopDelivery::Confirmed),
            links: Mutex::default(),
            closed: watch::Sender::new(None),
            resets: watch::Sender::new(0),
        }))
    }

    /// Starts what connects to it, with both axes on it.
    pub(super) fn controller(&self) -> Controller {
        let bench = small_config(1).bench;
        let setups = vec![AxisSetup::new(AxisName::Focus, &bench.focus), AxisSetup::new(AxisName::E, &bench.e)];
        Controller::start("controller `told`", Box::new(self.clone()), Arc::new(self.clone()), None, setups)
    }

    pub(super) fn told(&self) -> MutexGuard<'_, Vec<Told>> {
        self.0.told.lock().unwrap()
    }

    /// What becomes of stops from now on.
    pub(super) fn delivers(&self, delivery: StopDelivery) {
        *self.0.delivery.lock().unwrap() = delivery;
    }

    /// Pulls the cable.
    pub(super) fn unplug(&self) {
        self.0.closed.send_replace(Some("unplugged".to_owned()));
    }

    /// Resets the controller, which forgets where its axes are.
    pub(super) fn reset(&self) {
        self.0.resets.send_modify(|count| *count += 1);
        for link in self.0.links.lock().unwrap().iter() {
            link.forget_home();
            at_rest(link);
        }
    }

    /// Puts both axes where they were homed.
    pub(super) fn put_home(&self) {
        for link in self.0.links.lock().unwrap().iter() {
            put(link, Millimetres(link.setup().config.home_position_mm));
            link.set_home(0.0);
        }
    }

    /// Makes both axes' positions unknown.
    pub(super) fn forget_home(&self) {
        self.0.links.lock().unwrap().iter().for_each(AxisLink::forget_home);
    }
}

fn at_rest(link: &AxisLink) {
    link.modify(|state| (state.moving, state.at_rest_since) = (false, Some(Instant::now())));
}

fn put(link: &AxisLink, position: Millimetres) {
    link.modify(|state| (state.connected, state.position, state.fault) = (true, position, None));
    at_rest(link);
}

#[async_trait]
impl Dial for FarEnd {
    fn location(&self) -> String {
        "a test".to_owned()
    }

    async fn open(&self) -> Result<Wire, DeviceError> {
        match &*self.0.closed.borrow() {
            Some(reason) => Err(DeviceError::Disconnected { device: "told".to_owned(), reason: reason.clone() }),
            None => Ok(Box::new(tokio::io::duplex(1).0)),
        }
    }
}

#[async_trait]
impl Driver for FarEnd {
    fn name(&self) -> &'static str {
        "told"
    }

    async fn connect(&self, _: Wire, wanted: Wanted) -> Result<Arc<dyn Session>, DeviceError> {
        *self.0.links.lock().unwrap() = wanted.axes.clone();
        for link in &wanted.axes {
            put(link, Millimetres(0.0));
        }
        let operation = [tokio::sync::Mutex::default(), tokio::sync::Mutex::default()];
        Ok(Arc::new(NearEnd { far: self.clone(), axes: wanted.axes, orders: wanted.orders, operation }))
    }

    async fn identify(&self, _: Wire, _: &str) -> Result<String, DeviceError> {
        Ok("told".to_owned())
    }
}

struct NearEnd {
    far: FarEnd,
    axes: Vec<AxisLink>,
    orders: Arc<Orders>,
    operation: [tokio::sync::Mutex<()>; 2],
}

impl NearEnd {
    /// Carries an order out, where none has come since that outdates it: looked at when the order is written, as a port
    /// does.
    async fn order(&self, axis: usize, what: &'static str, generation: u64) -> Result<(), DeviceError> {
        let link = &self.axes[axis];
        let _operation = self.operation[axis].lock().await;
        self.orders.no_stop_under_way().await;
        // A reading of where it stands.
        yield_now().await;
        let stopped = DeviceError::Stopped { axis: link.name() };
        let mut closed = self.far.0.closed.subscribe();
        let mut resets = self.far.0.resets.subscribe();
        {
            // Looking and writing are one, as in a port's one owner: no stop of another thread comes between them.
            let mut told = self.far.told();
            if self.orders.generation() != generation {
                return Err(stopped);
            }
            if closed.borrow().is_some() {
                return Err(DeviceError::Disconnected { device: "told".to_owned(), reason: "unplugged".to_owned() });
            }
            if what == "move" && link.home().is_none() {
                return Err(DeviceError::NotHomed { axis: link.name() });
            }
            told.push(Told::Order(link.name(), what));
        }
        link.modify(|state| (state.moving, state.at_rest_since) = (true, None));
        let moves = async {
            for _ in 0..3 {
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        };
        let ended = tokio::select! {
            biased;
            () = self.orders.outdated(generation) => Err(stopped),
            _ = closed.wait_for(Option::is_some) => {
                Err(DeviceError::Disconnected { device: "told".to_owned(), reason: "unplugged".to_owned() })
            }
            _ = resets.changed() => {
                Err(DeviceError::Alarm { device: "told".to_owned(), reason: "it was reset".to_owned() })
            }
            () = moves => Ok(()),
        };
        at_rest(link);
        ended
    }
}

#[async_trait]
impl Session for NearEnd {
    fn identity(&self) -> String {
        "told".to_owned()
    }

    fn facts(&self, axis: usize) -> AxisFacts {
        let config = &self.axes[axis].setup().config;
        AxisFacts {
            takes_turns_with: self.far.0.takes_turns.then(|| self.axes[1 - axis].name()),
            speed_mm_per_s: config.speed_mm_per_s,
            acceleration_mm_per_s2: config.acceleration_mm_per_s2,
            ..AxisFacts::default()
        }
    }

    fn closed(&self) -> watch::Receiver<Option<String>> {
        self.far.0.closed.subscribe()
    }

    async fn read_state(&self, axis: usize) -> Result<StageState, DeviceError> {
        yield_now().await;
        Ok(self.axes[axis].state())
    }

    async fn home(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        let link = &self.axes[axis];
        link.forget_home();
        self.order(axis, "home", generation).await?;
        put(link, Millimetres(link.setup().config.home_position_mm));
        link.set_home(0.0);
        Ok(())
    }

    async fn set_position(&self, axis: usize, position: Millimetres, _: u64) -> Result<(), DeviceError> {
        put(&self.axes[axis], position);
        self.axes[axis].set_home(0.0);
        Ok(())
    }

    async fn move_at(
        &self,
        axis: usize,
        target: Millimetres,
        _: f64,
        generation: u64,
    ) -> Result<Millimetres, DeviceError> {
        self.order(axis, "move", generation).await?;
        put(&self.axes[axis], target);
        Ok(target)
    }

    /// Every piece is told where the one before has ended.
    async fn follow(&self, axis: usize, mut course: Course, generation: u64) -> Result<Millimetres, DeviceError> {
        loop {
            let at = self.axes[axis].state().position;
            let Some(next) = course(Seen { at, speed_mm_per_s: 0.0 }) else { return Ok(at) };
            self.move_at(axis, next.to, next.speed_mm_per_s, generation).await?;
        }
    }

    async fn release(&self, axis: usize, generation: u64) -> Result<(), DeviceError> {
        self.axes[axis].forget_home();
        self.order(axis, "release", generation).await
    }

    async fn bring_to_rest(&self) -> StopDelivery {
        let delivery = *self.far.0.delivery.lock().unwrap();
        if delivery != StopDelivery::Undeliverable {
            self.far.told().push(Told::Stop);
            self.orders.stop_sent();
        }
        // Until it rests, or does not say so.
        tokio::time::sleep(Duration::from_millis(5)).await;
        self.axes.iter().for_each(at_rest);
        delivery
    }
}
