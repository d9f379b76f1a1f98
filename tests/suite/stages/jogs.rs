//! A held jog over the real drivers' wires: how fast it goes, and how far after the program is killed at any of its orders.

use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll};
use std::time::Duration;

use async_trait::async_trait;
use plenalign::config::Side;
use plenalign::control::events::ShellState;
use plenalign::control::motion::{Admission, Motion};
use plenalign::device::jog::deadman;
use plenalign::device::serial::{Dial, Wire};
use plenalign::device::{AxisName, Bench, DeviceError};
use plenalign::sim::plant::Slides;
use plenalign::sim::stage::Protocol;
use plenalign::sim::stage::TwinDial;
use plenalign::sim::stage::line::Line;
use plenalign::units::Millimetres;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::Instant;

use super::super::bench::{rules, small_config};
use super::super::fakes::fakes;
use super::super::until::elapse;
use super::kit::Kit;
use super::stopped_at_every_poll::orders;

macro_rules! on {
    ($protocol:ident, $driver:ident, $($test:ident),* $(,)?) => {
        mod $protocol { $(#[tokio::test(start_paused = true)] async fn $test() {
            super::$test(super::Protocol::$driver).await;
        })* }
    };
}

macro_rules! that_go_on {
    ($($test:ident),* $(,)?) => {
        on!(grbl, Grbl, $($test),*);
        on!(grblhal, GrblHal, $($test),*);
        on!(fluidnc, FluidNc, $($test),*);
        on!(zaber, Zaber, $($test),*);
        on!(pi, Pi, $($test),*);
        on!(tmcl, Tmcl, $($test),*);
        on!(thorlabs, Thorlabs, $($test),*);
    };
}

that_go_on!(
    a_held_jog_keeps_its_speed,
    killed_at_any_order_a_jog_is_at_rest_in_time,
    over_a_slow_line_a_killed_jog_is_at_rest_in_time,
    killed_at_any_order_near_the_wall_a_jog_is_at_rest_in_its_way,
);

/// A wire that hears nothing any more after so many orders: what a killed program leaves behind.
#[derive(Clone)]
struct Cut(Arc<Mutex<State>>);

struct State {
    driver: Protocol,
    written: Vec<u8>,
    /// After how many orders it is cut.
    after: usize,
    cut: Option<Instant>,
}

struct CutDial(TwinDial, Cut);

struct CutWire(Wire, Cut);

impl Cut {
    /// Cuts the wire after so many orders from now on.
    fn after(&self, orders: usize) {
        let mut state = self.0.lock().unwrap();
        state.written.clear();
        (state.after, state.cut) = (orders, None);
    }

    fn at(&self) -> Option<Instant> {
        self.0.lock().unwrap().cut
    }

    fn orders(&self) -> usize {
        let state = self.0.lock().unwrap();
        orders(state.driver, &state.written)
    }
}

impl State {
    fn write(&mut self, bytes: &[u8]) {
        self.written.extend(bytes);
        // Orders that are lines count when they are whole.
        let whole = match self.driver {
            Protocol::Tmcl | Protocol::Thorlabs => self.written.len(),
            _ => self.written.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1),
        };
        if orders(self.driver, &self.written[..whole]) >= self.after {
            self.cut = Some(Instant::now());
        }
    }
}

#[async_trait]
impl Dial for CutDial {
    fn location(&self) -> String {
        "cut".to_owned()
    }

    async fn open(&self) -> Result<Wire, DeviceError> {
        Ok(Box::new(CutWire(self.0.open().await?, self.1.clone())))
    }
}

impl AsyncRead for CutWire {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.0).poll_read(cx, buf)
    }
}

impl AsyncWrite for CutWire {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<std::io::Result<usize>> {
        if self.1.at().is_some() {
            return Poll::Ready(Ok(bytes.len()));
        }
        let wrote = Pin::new(&mut self.0).poll_write(cx, bytes);
        if let Poll::Ready(Ok(count)) = wrote {
            self.1.0.lock().unwrap().write(&bytes[..count]);
        }
        wrote
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.0).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<std::io::Result<()>> {
        Pin::new(&mut self.0).poll_shutdown(cx)
    }
}

struct Held {
    motion: Arc<Motion>,
    admit: Box<dyn Fn() -> Admission>,
    slides: Arc<Slides>,
    cut: Cut,
}

impl Held {
    /// Both axes on one controller, e homed and moved to a position.
    async fn at(driver: Protocol, position: f64) -> Self {
        Self::over(driver, position, Duration::ZERO).await
    }

    /// The same where what the controller says is on its way for a while.
    async fn over(driver: Protocol, position: f64, delay: Duration) -> Self {
        let kit = Kit::new(driver);
        let cut = Cut(Arc::new(Mutex::new(State { driver, written: Vec::new(), after: usize::MAX, cut: None })));
        let controller = kit.start_on(Arc::new(CutDial(kit.twin.dial(), cut.clone())), None);
        controller.first_attempt().await.unwrap();
        let stage = |axis| Arc::new(controller.stage(axis).unwrap());
        let bench = Bench { focus: stage(AxisName::Focus), e: stage(AxisName::E), ..fakes().bench };
        let mut config = small_config(1);
        config.bench.focus = kit.bench.focus.clone();
        config.bench.e = kit.bench.e.clone();
        // What is looked at is how an axis is told to go to the wall, which is where it is configured for one that is exact.
        (config.bench.e.zero_uncertainty_mm, config.bench.e.scale_uncertainty) = (0.0, 0.0);
        let (motion, admit) = rules(config, bench);
        motion.home(&admit(), AxisName::E).await.unwrap();
        motion.set_shell(ShellState::Off);
        motion.go(&admit(), AxisName::E, Millimetres(position)).await.unwrap();
        motion.set_shell(ShellState::On);
        kit.twin.set_line(Line { delay, ..Line::default() });
        Self { motion, admit: Box::new(admit), slides: kit.slides, cut }
    }

    /// Begins a jog towards the shell that is held for a minute.
    fn jog(&self, speed: f64) {
        let (motion, admission) = (Arc::clone(&self.motion), (self.admit)());
        tokio::spawn(async move {
            let (_grip, dead) = deadman(Duration::from_secs(60));
            // However it ends: the wire may be cut.
            let _ = motion.jog(&admission, AxisName::E, Side::Low, speed, dead).await;
        });
    }

    fn at_now(&self) -> f64 {
        self.slides.at(1)
    }

    /// Jogs until so many orders have been written, of which the last is heard and nothing after it. Returns how long the
    /// axis still moved, s, how far, mm, and from where; `None` where the jog has come to its end before that.
    async fn killed_after(&self, orders: usize, speed: f64) -> Option<(f64, f64, f64)> {
        self.cut.after(orders);
        self.jog(speed);
        let begun = Instant::now();
        let killed = loop {
            if let Some(at) = self.cut.at() {
                break at;
            }
            if begun.elapsed() > Duration::from_secs(10) {
                return None;
            }
            elapse(Duration::from_millis(1)).await;
        };
        let from = self.at_now();
        let (mut rested, mut at) = (Instant::now(), from);
        while rested.elapsed() < Duration::from_secs(1) {
            elapse(Duration::from_millis(1)).await;
            if self.at_now() != at {
                (rested, at) = (Instant::now(), self.at_now());
            }
        }
        Some(((rested - killed).as_secs_f64(), from - at, from))
    }
}

async fn a_held_jog_keeps_its_speed(driver: Protocol) {
    let held = Held::at(driver, 29.0).await;
    let speed = held.motion.jog_speed_mm_per_s(AxisName::E);
    // 20 mm/s² for 0.2 s: what is left of 0.3 s after a tenth for the next order.
    assert!((speed - 4.0).abs() < 0.01, "{speed}");
    held.cut.after(usize::MAX);
    held.jog(5.0);
    let (begun, from) = (Instant::now(), held.at_now());
    let mut slowest = f64::INFINITY;
    let mut before = from;
    while begun.elapsed() < Duration::from_secs(5) {
        elapse(Duration::from_millis(100)).await;
        let went = before - held.at_now();
        before = held.at_now();
        if begun.elapsed() > Duration::from_millis(800) {
            slowest = slowest.min(went / 0.1);
        }
    }
    let (way, orders) = (from - held.at_now(), held.cut.orders());
    println!("{driver:?}: {way:.2} mm in 5 s, never below {slowest:.2} mm/s once at speed, in {orders} orders");
    // A ramp of 0.2 s, during which it is told less, and what it takes to begin.
    assert!(way > 4.8 * speed && way < 5.0 * speed, "{way} mm");
    assert!(slowest > 0.95 * speed, "{slowest} mm/s");
}

async fn killed_at_any_order_a_jog_is_at_rest_in_time(driver: Protocol) {
    let (mut longest, mut farthest) = (0.0_f64, 0.0_f64);
    for orders in 1..=30 {
        let held = Held::at(driver, 25.0).await;
        let (took, way, _) = held.killed_after(orders, 5.0).await.unwrap();
        (longest, farthest) = (longest.max(took), farthest.max(way));
        // The controller is looked at every 5 ms.
        assert!(took <= 0.306, "{driver:?}, killed at order {orders}: {took:.3} s more, {way:.3} mm");
    }
    println!("{driver:?}: killed at each of 30 orders: {longest:.3} s and {farthest:.3} mm more at most");
}

/// Answers that come late make a jog slower, and what is still travelled no longer.
async fn over_a_slow_line_a_killed_jog_is_at_rest_in_time(driver: Protocol) {
    for (delay_ms, least_mm) in [(15, 14.0), (40, 2.0)] {
        let delay = Duration::from_millis(delay_ms);
        let held = Held::over(driver, 29.0, delay).await;
        let from = held.at_now();
        held.jog(5.0);
        elapse(Duration::from_secs(5)).await;
        let (way, mut longest) = (from - held.at_now(), 0.0_f64);
        for orders in 1..=12 {
            let held = Held::over(driver, 25.0, delay).await;
            let (took, way, _) = held.killed_after(orders, 5.0).await.unwrap();
            longest = longest.max(took);
            assert!(took <= 0.306, "{driver:?}, {delay:?} late, killed at order {orders}: {took:.3} s, {way:.3} mm");
        }
        println!("{driver:?}, answers {delay:?} late: {way:.2} mm in 5 s; killed, {longest:.3} s more at most");
        assert!(way > least_mm, "{way} mm in 5 s");
    }
}

async fn killed_at_any_order_near_the_wall_a_jog_is_at_rest_in_its_way(driver: Protocol) {
    let (mut longest, mut farthest, mut in_zone) = (0.0_f64, 0.0_f64, 0);
    for orders in 1.. {
        let held = Held::at(driver, 1.6).await;
        let wall = held.motion.e_wall_reading_mm();
        let Some((took, way, from)) = held.killed_after(orders, 5.0).await else { break };
        assert!(
            took <= 0.306 && held.at_now() > wall - 0.003,
            "{driver:?}, order {orders}: {took} s, {way} mm from {from}"
        );
        if from <= wall + 1.0 {
            in_zone += 1;
            (longest, farthest) = (longest.max(took), farthest.max(way));
            // Of whole motor steps: 0.0025 mm.
            assert!(way <= 0.2 + 0.003, "{driver:?}, killed at order {orders}: {way:.3} mm more from {from:.3}");
        }
    }
    println!(
        "{driver:?}: killed at each of {in_zone} orders near the wall: {longest:.3} s, {farthest:.3} mm more at most"
    );
    assert!(in_zone > 8, "{in_zone}");
}
