//! What only the Grbl driver does, against its firmware's twin. What every driver does is in `stages`.

// The helpers below are tests' code, too.
#![allow(clippy::unwrap_used)]

use std::sync::{Arc, Mutex};
use std::time::Duration;

use plenalign::config::{AxisConfig, BenchConfig};
use plenalign::device::serial::{Dial, Wire};
use plenalign::device::stage::axis::AxisSetup;
use plenalign::device::stage::grbl_controller::GrblDriver;
use plenalign::device::stage::supervisor::{Controller, ControllerStage};
use plenalign::device::{AxisName, DeviceError, Stage, StopDelivery};
use plenalign::sim::plant::Plant;
use plenalign::sim::stage::grbl::{FirmwareConfig, GrblFirmware};
use plenalign::sim::stage::{ControllerTwin, PULL_OFF_MM};
use plenalign::units::Millimetres;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream};
use tokio::time::Instant;

use super::until::elapse;

/// Two slides with a home switch each: positions are the axes' own coordinates.
struct Slides {
    at: Mutex<[f64; 2]>,
    start: [f64; 2],
    switch: [f64; 2],
    closes_below: [bool; 2],
    longest_gap: Mutex<Duration>,
    last: Mutex<Option<Instant>>,
}

impl Slides {
    fn new(start: [f64; 2], bench: &BenchConfig) -> Arc<Self> {
        let side = |axis: &AxisConfig| axis.home_side.sign();
        Arc::new(Self {
            at: Mutex::new(start),
            start,
            switch: [&bench.focus, &bench.e].map(|axis| axis.home_position_mm + side(axis) * PULL_OFF_MM),
            closes_below: [&bench.focus, &bench.e].map(|axis| side(axis) < 0.0),
            longest_gap: Mutex::new(Duration::ZERO),
            last: Mutex::new(None),
        })
    }

    fn at(&self, axis: usize) -> f64 {
        self.at.lock().unwrap()[axis]
    }
}

impl Plant for Slides {
    fn motor_moved(&self, axis: usize, position_mm: f64) {
        self.at.lock().unwrap()[axis] = self.start[axis] + position_mm;
        let now = Instant::now();
        if let Some(last) = self.last.lock().unwrap().replace(now) {
            let mut longest = self.longest_gap.lock().unwrap();
            *longest = (now - last).max(*longest);
        }
    }

    fn home_switch_closed(&self, axis: usize) -> bool {
        let at = self.at(axis);
        if self.closes_below[axis] { at <= self.switch[axis] } else { at >= self.switch[axis] }
    }

    fn limit_switch_closed(&self, axis: usize) -> bool {
        self.home_switch_closed(axis)
    }
}

struct Rig {
    focus: ControllerStage,
    e: ControllerStage,
    slides: Arc<Slides>,
}

const START: [f64; 2] = [1.3, 20.4];

fn setups(bench: &BenchConfig) -> Vec<AxisSetup> {
    vec![AxisSetup::new(AxisName::Focus, &bench.focus), AxisSetup::new(AxisName::E, &bench.e)]
}

async fn connect(dial: impl Dial + 'static, bench: &BenchConfig) -> Result<Controller, DeviceError> {
    let controller =
        Controller::start("controller `main`", Box::new(GrblDriver::default()), Arc::new(dial), None, setups(bench));
    controller.first_attempt().await.map(|()| controller)
}

async fn rig_with(change: impl FnOnce(&mut FirmwareConfig)) -> Rig {
    rig_on(BenchConfig::default(), change).await
}

async fn rig_on(bench: BenchConfig, change: impl FnOnce(&mut FirmwareConfig)) -> Rig {
    let slides = Slides::new(START, &bench);
    let mut config = FirmwareConfig::for_axes(&[&bench.focus, &bench.e]);
    change(&mut config);
    let twin = ControllerTwin::new(GrblFirmware::new(config, slides.clone()));
    let controller = connect(twin.dial(), &bench).await.unwrap();
    let stage = |axis| controller.stage(axis).unwrap();
    Rig { focus: stage(AxisName::Focus), e: stage(AxisName::E), slides }
}

async fn homed_rig() -> Rig {
    let rig = rig_with(|_| {}).await;
    rig.focus.home(rig.focus.generation()).await.unwrap();
    rig.e.home(rig.e.generation()).await.unwrap();
    rig
}

fn near(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance
}

#[tokio::test(start_paused = true)]
async fn a_stock_build_homes_both_axes_at_once_and_says_so() {
    let rig = rig_with(|config| config.single_axis_homing = false).await;
    assert_eq!(rig.focus.homes_also(), Some(AxisName::E));
    rig.focus.home(rig.focus.generation()).await.unwrap();
    assert!(rig.focus.state().borrow().homed && rig.e.state().borrow().homed);
    assert!(near(rig.slides.at(0), 0.0, 0.003) && near(rig.slides.at(1), 30.0, 0.003));
    let readback = rig.e.move_to(Millimetres(29.0), rig.e.generation()).await.unwrap();
    assert!(near(readback.value(), 29.0, 0.002));
}

#[tokio::test(start_paused = true)]
async fn motors_report_to_the_plant_at_least_every_ten_milliseconds() {
    let rig = homed_rig().await;
    *rig.slides.last.lock().unwrap() = None;
    *rig.slides.longest_gap.lock().unwrap() = Duration::ZERO;
    rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap();
    // The first and last micrometres of a move take longer than that for a single motor step.
    let longest = *rig.slides.longest_gap.lock().unwrap();
    assert!(longest <= Duration::from_millis(20), "{longest:?}");
}

#[tokio::test(start_paused = true)]
async fn a_motion_commanded_during_a_stop_begins_after_it() {
    let rig = rig_with(|_| {}).await;
    // A stop at rest takes some status reports and a reset: the reset must not hit what is commanded on the way.
    for delay_ms in [0, 20, 90, 150, 250, 400] {
        let home = async {
            elapse(Duration::from_millis(delay_ms)).await;
            rig.e.home(rig.e.generation()).await
        };
        let (delivery, homed) = tokio::join!(rig.focus.stop(), home);
        assert_eq!(delivery, StopDelivery::Confirmed);
        assert_eq!(homed, Ok(()), "homing commanded {delay_ms} ms after the stop");
        let (_, reached) = tokio::join!(rig.focus.stop(), async {
            elapse(Duration::from_millis(delay_ms)).await;
            rig.e.move_to(Millimetres(30.0), rig.e.generation()).await
        });
        assert!(reached.is_ok(), "a move commanded {delay_ms} ms after the stop: {reached:?}");
    }
}

/// Leads once to a stream that is there already.
struct Once(Mutex<Option<Wire>>);

#[async_trait::async_trait]
impl Dial for Once {
    fn location(&self) -> String {
        "pipe".to_owned()
    }

    async fn open(&self) -> Result<Wire, DeviceError> {
        let gone = || DeviceError::Disconnected { device: "pipe".to_owned(), reason: "it led there once".to_owned() };
        self.0.lock().unwrap().take().ok_or_else(gone)
    }
}

/// Connects to a far end that says what it is told to and hears what is said.
async fn connect_to(script: impl AsyncFnOnce(DuplexStream) + Send + 'static) -> Result<Controller, DeviceError> {
    let (near, far) = tokio::io::duplex(1024);
    let local = async move { script(far).await };
    let bench = BenchConfig::default();
    tokio::select! {
        result = connect(Once(Mutex::new(Some(Box::new(near)))), &bench) => result,
        () = async { local.await; std::future::pending::<()>().await } => unreachable!(),
    }
}

#[tokio::test(start_paused = true)]
async fn another_device_is_named() {
    let answer = |text: &'static [u8]| {
        move |mut far: DuplexStream| async move {
            let mut buffer = [0u8; 16];
            while far.read(&mut buffer).await.is_ok_and(|count| count > 0) {
                far.write_all(text).await.unwrap();
            }
        }
    };
    let error = connect_to(answer(b"\r\nGrbl 0.9j ['$' for help]\r\n")).await.err().unwrap();
    assert!(matches!(&error, DeviceError::WrongDevice { found, .. } if found == "Grbl 0.9j"), "{error}");
    let error = connect_to(answer(b"@01 0 OK IDLE -- 0\r\n")).await.err().unwrap();
    assert!(matches!(&error, DeviceError::WrongDevice { found, .. } if found.contains("@01 0 OK")), "{error}");
    let error = connect_to(answer(b"")).await.err().unwrap();
    assert!(matches!(&error, DeviceError::Timeout { .. }), "{error}");
}

#[tokio::test(start_paused = true)]
async fn settings_that_differ_and_do_no_harm_are_told() {
    let rig = rig_with(|config| {
        if let Some(axis) = &mut config.axes[0] {
            axis.acceleration_mm_per_s2 = 15.0;
        }
    })
    .await;
    let told = rig.focus.info().disagreements.join(" ");
    assert!(told.contains("$120") && told.contains("15"), "{told}");
    assert!(rig.e.info().disagreements.is_empty());
    rig.focus.home(rig.focus.generation()).await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn where_one_command_homes_both_axes_what_contradicts_one_keeps_both_from_moving() {
    let contradicted = |single_axis_homing| {
        rig_with(move |config| {
            config.single_axis_homing = single_axis_homing;
            if let Some(axis) = &mut config.axes[1] {
                axis.homes_negative = true;
            }
        })
    };
    let both = contradicted(false).await;
    for stage in [&both.focus, &both.e] {
        let error = stage.home(stage.generation()).await.unwrap_err();
        assert!(matches!(&error, DeviceError::Refused { reason, .. } if reason.contains("$23")), "{error}");
    }
    assert_eq!([both.slides.at(0), both.slides.at(1)], START);
    let single = contradicted(true).await;
    single.focus.home(single.focus.generation()).await.unwrap();
    assert!(single.e.home(single.e.generation()).await.is_err());
    assert_eq!(single.slides.at(1), START[1]);
}

#[tokio::test(start_paused = true)]
async fn a_scale_that_differs_by_what_is_printed_only_does_not_contradict() {
    // Printed as 133.333 and 20997.375: half of the last decimal, and what 32 bits hold.
    for (configured, printed, agrees) in
        [(133.333_33, 133.333_33, true), (133.333_4, 133.333_4, true), (400.0, 400.001, false), (80.0, 80.4, false)]
    {
        let mut bench = BenchConfig::default();
        bench.e.steps_per_mm = configured;
        let rig = rig_on(bench, |config| {
            if let Some(axis) = &mut config.axes[1] {
                axis.steps_per_mm = printed;
            }
        })
        .await;
        let homed = rig.e.home(rig.e.generation()).await;
        assert_eq!(homed.is_ok(), agrees, "{configured} configured, {printed} set: {homed:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn motion_under_way_at_opening_is_stopped() {
    let bench = BenchConfig::default();
    let slides = Slides::new(START, &bench);
    let config = FirmwareConfig::for_axes(&[&bench.focus, &bench.e]);
    let twin = ControllerTwin::new(GrblFirmware::new(config, slides.clone()));
    let (mut first, far) = tokio::io::duplex(1024);
    let serving = twin.clone();
    let before = tokio::spawn(async move { serving.serve(far).await });
    first.write_all(b"$X\n$J=G91 G21 Y-8 F300\n").await.unwrap();
    elapse(Duration::from_millis(500)).await;
    assert!(slides.at(1) < START[1] - 0.5);
    // The program that started the motion dies; another opens the port.
    drop(first);
    before.await.unwrap();
    let controller = connect(twin.dial(), &bench).await.unwrap();
    let at = slides.at(1);
    assert!(at > START[1] - 4.0, "{at}");
    elapse(Duration::from_secs(3)).await;
    assert_eq!(slides.at(1), at);
    assert!(!controller.stage(AxisName::E).unwrap().state().borrow().homed);
}

#[tokio::test(start_paused = true)]
async fn a_controller_that_takes_no_bytes_is_given_up_and_a_stop_does_not_hang() {
    // A pipe that nobody reads: it fills, and so does every queue before it.
    let (near, _far) = tokio::io::duplex(1);
    let bench = BenchConfig::default();
    let began = Instant::now();
    let error = connect(Once(Mutex::new(Some(Box::new(near)))), &bench).await.err().unwrap();
    assert!(matches!(error, DeviceError::Timeout { .. }), "{error}");
    assert!(began.elapsed() < Duration::from_secs(10), "{:?}", began.elapsed());
}

#[tokio::test(start_paused = true)]
async fn a_controller_whose_settings_memory_was_blank_is_understood() {
    let rig = rig_with(|config| config.blank_settings = true).await;
    assert_eq!(rig.e.info().disagreements, Vec::<String>::new());
    rig.e.home(rig.e.generation()).await.unwrap();
    assert!(near(rig.slides.at(1), 30.0, 0.003));
}

#[tokio::test(start_paused = true)]
async fn an_open_safety_door_ends_a_move_and_says_so() {
    let bench = BenchConfig::default();
    let slides = Slides::new(START, &bench);
    let config = FirmwareConfig::for_axes(&[&bench.focus, &bench.e]);
    let twin = ControllerTwin::new(GrblFirmware::new(config, slides.clone()));
    let controller = connect(twin.dial(), &bench).await.unwrap();
    let e = controller.stage(AxisName::E).unwrap();
    e.home(e.generation()).await.unwrap();
    let mover = e.clone();
    let moving = tokio::spawn(async move { mover.move_to(Millimetres(5.0), mover.generation()).await });
    elapse(Duration::from_secs(1)).await;
    // The door's switch, which the real-time byte stands for.
    twin.receive(b"\x84");
    let error = moving.await.unwrap().unwrap_err();
    assert!(matches!(&error, DeviceError::Alarm { reason, .. } if reason.contains("door")), "{error}");
    let at = slides.at(1);
    assert!(at < 28.0 && at > 22.0, "{at}");
    elapse(Duration::from_secs(3)).await;
    assert_eq!(slides.at(1), at);
    e.home(e.generation()).await.unwrap();
    assert!(near(e.move_to(Millimetres(20.0), e.generation()).await.unwrap().value(), 20.0, 0.002));
}
