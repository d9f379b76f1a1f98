//! A bench's two axes on one twin of any protocol, with the real driver in front of it.

use std::sync::Arc;
use std::time::Duration;

use clap::ValueEnum as _;
use plenalign::config::{AxisConfig, BenchConfig, ControllerConfig, Side};
use plenalign::device::serial::Dial;
use plenalign::device::stage::axis::AxisSetup;
use plenalign::device::stage::supervisor::{Controller, ControllerStage};
use plenalign::device::{AxisName, DeviceError, Stage, StageState, open};
use plenalign::sim::plant::Slides;
use plenalign::sim::stage::grbl::{FirmwareConfig, GrblFirmware};
use plenalign::sim::stage::{ControllerTwin, Firmware, Protocol, firmware};
use tokio::time::{Instant, timeout};

/// Where the slides stand at power-up.
pub(super) const START: [f64; 2] = [1.3, 20.4];

/// Runs an async test of the kit for every protocol.
macro_rules! every_protocol {
    ($($test:ident),* $(,)?) => {
        mod grbl { $(#[tokio::test(start_paused = true)] async fn $test() { super::$test(super::Protocol::Grbl).await; })* }
        mod grblhal { $(#[tokio::test(start_paused = true)] async fn $test() { super::$test(super::Protocol::GrblHal).await; })* }
        mod fluidnc { $(#[tokio::test(start_paused = true)] async fn $test() { super::$test(super::Protocol::FluidNc).await; })* }
        mod zaber { $(#[tokio::test(start_paused = true)] async fn $test() { super::$test(super::Protocol::Zaber).await; })* }
        mod pi { $(#[tokio::test(start_paused = true)] async fn $test() { super::$test(super::Protocol::Pi).await; })* }
        mod tmcl { $(#[tokio::test(start_paused = true)] async fn $test() { super::$test(super::Protocol::Tmcl).await; })* }
        mod thorlabs { $(#[tokio::test(start_paused = true)] async fn $test() { super::$test(super::Protocol::Thorlabs).await; })* }
    };
}
pub(super) use every_protocol;

#[test]
fn every_protocol_is_in_the_list() {
    use Protocol::{FluidNc, Grbl, GrblHal, Pi, Thorlabs, Tmcl, Zaber};
    let all = [Grbl, GrblHal, FluidNc, Zaber, Pi, Tmcl, Thorlabs];
    assert_eq!(Protocol::value_variants(), all, "every_protocol! has to have it, too");
}

/// A bench whose axes a controller of this kind can have.
pub(super) fn bench(driver: Protocol) -> BenchConfig {
    let mut bench = BenchConfig::default();
    suit(driver, &mut bench);
    bench
}

/// Makes a bench's axes ones that a controller of this kind can have.
pub(crate) fn suit(driver: impl Into<Protocol>, bench: &mut BenchConfig) {
    let driver = driver.into();
    for (axis, name) in [&mut bench.focus, &mut bench.e].into_iter().zip(driver.first_axes()) {
        name.clone_into(&mut axis.axis);
    }
    match driver {
        // Zaber's homing runs towards the controller's negative end.
        Protocol::Zaber => {
            for axis in [&mut bench.focus, &mut bench.e] {
                axis.reversed = axis.home_side == Side::High;
            }
            (bench.focus.steps_per_mm, bench.e.steps_per_mm) = (20_000.0, 20_000.0);
        }
        Protocol::Pi | Protocol::FluidNc | Protocol::GrblHal => {
            if driver == Protocol::Pi {
                // It counts in mm.
                (bench.focus.steps_per_mm, bench.e.steps_per_mm) = (1.0, 1.0);
            }
            // Their limits begin where homing ends.
            for axis in [&mut bench.focus, &mut bench.e] {
                let limit = if axis.home_side == Side::High { &mut axis.high_limit_mm } else { &mut axis.low_limit_mm };
                *limit = axis.home_position_mm;
            }
        }
        Protocol::Grbl | Protocol::Tmcl => {}
        // Microsteps of a motor on a screw of 1 mm a turn.
        Protocol::Thorlabs => (bench.focus.steps_per_mm, bench.e.steps_per_mm) = (409_600.0, 409_600.0),
    }
}

/// A twin and what its motors turn.
pub(super) struct Kit {
    pub(super) driver: Protocol,
    pub(super) bench: BenchConfig,
    pub(super) slides: Arc<Slides>,
    pub(super) twin: ControllerTwin,
}

/// A firmware that is given of each byte that comes what `hears` makes of it, and of the time that passes what `waits` does;
/// what it says is what `says` makes of it.
pub(super) struct Behind {
    pub(super) firmware: Box<dyn Firmware>,
    pub(super) hears: Box<dyn FnMut(u8) -> Vec<u8> + Send>,
    pub(super) waits: Box<dyn FnMut(f64) -> f64 + Send>,
    pub(super) says: Box<dyn FnMut(Vec<u8>) -> Vec<u8> + Send>,
}

impl Behind {
    /// One that changes nothing.
    pub(super) fn new(firmware: impl Firmware + 'static) -> Self {
        Self {
            firmware: Box::new(firmware),
            hears: Box::new(|byte| vec![byte]),
            waits: Box::new(|seconds| seconds),
            says: Box::new(|bytes| bytes),
        }
    }
}

impl Firmware for Behind {
    fn receive(&mut self, byte: u8) {
        (self.hears)(byte).into_iter().for_each(|byte| self.firmware.receive(byte));
    }

    fn pause(&mut self) {
        self.firmware.pause();
    }

    fn take_output(&mut self) -> Vec<u8> {
        (self.says)(self.firmware.take_output())
    }

    fn advance(&mut self, seconds: f64) {
        self.firmware.advance((self.waits)(seconds));
    }

    fn is_moving(&self) -> bool {
        self.firmware.is_moving()
    }

    fn stall(&mut self, axis: usize, stalled: bool) {
        self.firmware.stall(axis, stalled);
    }

    fn power_cycle(&mut self) {
        self.firmware.power_cycle();
    }
}

/// The stages of a connected kit.
pub(super) struct Rig {
    pub(super) focus: ControllerStage,
    pub(super) e: ControllerStage,
    pub(super) slides: Arc<Slides>,
    pub(super) twin: ControllerTwin,
}

impl Kit {
    pub(super) fn new(driver: Protocol) -> Self {
        Self::with(driver, bench(driver))
    }

    pub(super) fn with(driver: Protocol, bench: BenchConfig) -> Self {
        Self::standing(driver, bench, START)
    }

    /// A kit whose slides stand somewhere else at power-up.
    pub(super) fn standing(driver: Protocol, bench: BenchConfig, start: [f64; 2]) -> Self {
        let axes: [(&AxisConfig, f64); 2] = [(&bench.focus, start[0]), (&bench.e, start[1])];
        let slides = Slides::new(&axes);
        let twin = firmware(driver, &[&bench.focus, &bench.e], slides.clone());
        Self { driver, bench, slides, twin }
    }

    /// A kit of Grbl's, or one of its heirs', whose twin is set as `change` says, its axes standing where `start` says.
    pub(super) fn grbl(
        driver: Protocol,
        bench: BenchConfig,
        start: [f64; 2],
        change: impl FnOnce(&mut FirmwareConfig),
    ) -> Self {
        let mut kit = Self::standing(driver, bench, start);
        let axes = [&kit.bench.focus, &kit.bench.e];
        let mut config = match driver {
            Protocol::FluidNc => FirmwareConfig::fluidnc(&axes),
            Protocol::GrblHal => FirmwareConfig::grblhal(&axes),
            _ => FirmwareConfig::for_axes(&axes),
        };
        change(&mut config);
        kit.twin = ControllerTwin::new(GrblFirmware::new(config, kit.slides.clone()));
        kit
    }

    pub(super) fn start_on(&self, dial: Arc<dyn Dial>, expected: Option<&str>) -> Controller {
        let config = ControllerConfig {
            driver: self.driver.driver(),
            port: "/dev/null".into(),
            baud: None,
            identity: None,
            address: 1,
        };
        let setups =
            vec![AxisSetup::new(AxisName::Focus, &self.bench.focus), AxisSetup::new(AxisName::E, &self.bench.e)];
        Controller::start("controller `main`", open::driver(&config), dial, expected.map(str::to_owned), setups)
    }

    pub(super) fn start(&self) -> Controller {
        self.start_on(Arc::new(self.twin.dial()), None)
    }

    pub(super) fn rig(&self, controller: &Controller) -> Rig {
        let stage = |axis| controller.stage(axis).unwrap();
        Rig {
            focus: stage(AxisName::Focus),
            e: stage(AxisName::E),
            slides: self.slides.clone(),
            twin: self.twin.clone(),
        }
    }

    pub(super) async fn connect(&self) -> Result<Rig, DeviceError> {
        let controller = self.start();
        controller.first_attempt().await?;
        Ok(self.rig(&controller))
    }

    /// Connected, with both axes homed.
    pub(super) async fn homed(&self) -> Rig {
        let rig = self.connect().await.unwrap();
        rig.focus.home(rig.focus.generation()).await.unwrap();
        rig.e.home(rig.e.generation()).await.unwrap();
        rig
    }
}

/// A connected rig with both axes homed.
pub(super) async fn homed(driver: Protocol) -> Rig {
    Kit::new(driver).homed().await
}

/// Waits for a state of a stage.
pub(super) async fn wait_for(stage: &ControllerStage, what: &str, is: impl Fn(&StageState) -> bool) -> Duration {
    let began = Instant::now();
    let mut state = stage.state();
    let waited = timeout(Duration::from_secs(60), state.wait_for(|state| is(state))).await.is_ok();
    assert!(waited, "never {what}: {:?}", stage.state().borrow().clone());
    began.elapsed()
}

pub(super) fn near(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance
}
