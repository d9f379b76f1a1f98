//! The Grbl driver against the firmware twin: over a pipe on a paused clock, and over a pseudo-terminal in real time.

// The helpers below are tests' code, too.
#![allow(clippy::unwrap_used)]

use std::sync::{Arc, Mutex};
use std::time::Duration;

use plenalign::config::{AxisConfig, BenchConfig};
use plenalign::device::serial::{Dial, SerialDial, Wire};
use plenalign::device::stage::axis::AxisSetup;
use plenalign::device::stage::grbl_controller::GrblDriver;
use plenalign::device::stage::supervisor::{Controller, ControllerStage};
use plenalign::device::{AxisName, DeviceError, Stage, StopDelivery};
use plenalign::sim::plant::Plant;
use plenalign::sim::stage::grbl::{FirmwareConfig, GrblFirmware};
use plenalign::sim::stage::{ControllerTwin, PULL_OFF_MM};
use plenalign::units::Millimetres;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream};
use tokio::time::{Instant, sleep, timeout};

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
        // A micrometre beyond, so that the soft limit, which is at the switch, can be reached.
        let at = self.at(axis);
        if self.closes_below[axis] { at < self.switch[axis] - 1e-3 } else { at > self.switch[axis] + 1e-3 }
    }
}

struct Rig {
    focus: ControllerStage,
    e: ControllerStage,
    twin: ControllerTwin,
    slides: Arc<Slides>,
}

const START: [f64; 2] = [1.3, 20.4];

fn setups(bench: &BenchConfig) -> Vec<AxisSetup> {
    vec![AxisSetup::new(AxisName::Focus, &bench.focus), AxisSetup::new(AxisName::E, &bench.e)]
}

async fn connect(dial: impl Dial + 'static, bench: &BenchConfig) -> Result<Controller, DeviceError> {
    let controller = Controller::start("controller `main`", Box::new(GrblDriver), Arc::new(dial), None, setups(bench));
    controller.first_attempt().await.map(|()| controller)
}

async fn rig_with(change: impl FnOnce(&mut FirmwareConfig)) -> Rig {
    rig_on(BenchConfig::default(), change).await
}

/// Where the firmware's limits may be wider than the configured ones.
async fn accepting_rig_with(change: impl FnOnce(&mut FirmwareConfig)) -> Rig {
    let mut bench = BenchConfig::default();
    bench.focus.accept_wider_firmware_limits = true;
    bench.e.accept_wider_firmware_limits = true;
    rig_on(bench, change).await
}

async fn rig_on(bench: BenchConfig, change: impl FnOnce(&mut FirmwareConfig)) -> Rig {
    let slides = Slides::new(START, &bench);
    let mut config = FirmwareConfig::for_axes(&[&bench.focus, &bench.e]);
    change(&mut config);
    let twin = ControllerTwin::new(GrblFirmware::new(config, slides.clone()));
    let controller = connect(twin.dial(), &bench).await.unwrap();
    let stage = |axis| controller.stage(axis).unwrap();
    Rig { focus: stage(AxisName::Focus), e: stage(AxisName::E), twin, slides }
}

async fn homed_rig() -> Rig {
    let rig = rig_with(|_| {}).await;
    rig.focus.home().await.unwrap();
    rig.e.home().await.unwrap();
    rig
}

fn near(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance
}

#[tokio::test(start_paused = true)]
async fn homing_finds_the_switches_and_moves_arrive_where_they_say() {
    let rig = rig_with(|_| {}).await;
    assert_eq!(rig.focus.info().identity, "Grbl 1.1h");
    assert_eq!(rig.focus.info().disagreements, Vec::<String>::new());
    assert_eq!(rig.e.info().disagreements, Vec::<String>::new());
    assert_eq!(rig.focus.move_to(Millimetres(1.0)).await, Err(DeviceError::NotHomed { axis: AxisName::Focus }));
    assert_eq!(rig.slides.at(0), START[0], "nothing moves before homing");

    rig.focus.home().await.unwrap();
    assert!(near(rig.slides.at(0), 0.0, 0.003), "{}", rig.slides.at(0));
    assert_eq!(rig.slides.at(1), START[1], "the other axis is left alone");
    assert!(!rig.e.read_state().await.unwrap().homed);
    rig.e.home().await.unwrap();
    assert!(near(rig.slides.at(1), 30.0, 0.003), "{}", rig.slides.at(1));

    for target in [0.7, -0.35, 4.9] {
        let began = Instant::now();
        let readback = rig.focus.move_to(Millimetres(target)).await.unwrap();
        assert!(near(readback.value(), target, 0.002), "{readback}");
        assert!(near(rig.slides.at(0), target, 0.005), "{}", rig.slides.at(0));
        assert!(began.elapsed() < Duration::from_secs(6), "{:?}", began.elapsed());
    }
    let readback = rig.e.move_to(Millimetres(12.0)).await.unwrap();
    assert!(near(readback.value(), 12.0, 0.002) && near(rig.slides.at(1), 12.0, 0.005));
    let state = rig.e.read_state().await.unwrap();
    assert!(state.homed && state.connected && !state.moving && state.at_rest_since.is_some(), "{state:?}");
    assert_eq!(state.fault, None);
}

#[tokio::test(start_paused = true)]
async fn a_stock_build_homes_both_axes_at_once_and_says_so() {
    let rig = rig_with(|config| config.single_axis_homing = false).await;
    assert_eq!(rig.focus.homes_also(), Some(AxisName::E));
    rig.focus.home().await.unwrap();
    assert!(rig.focus.state().borrow().homed && rig.e.state().borrow().homed);
    assert!(near(rig.slides.at(0), 0.0, 0.003) && near(rig.slides.at(1), 30.0, 0.003));
    let readback = rig.e.move_to(Millimetres(29.0)).await.unwrap();
    assert!(near(readback.value(), 29.0, 0.002));
}

#[tokio::test(start_paused = true)]
async fn motors_report_to_the_plant_at_least_every_ten_milliseconds() {
    let rig = homed_rig().await;
    *rig.slides.last.lock().unwrap() = None;
    *rig.slides.longest_gap.lock().unwrap() = Duration::ZERO;
    rig.e.move_to(Millimetres(20.0)).await.unwrap();
    // The first and last micrometres of a move take longer than that for a single motor step.
    let longest = *rig.slides.longest_gap.lock().unwrap();
    assert!(longest <= Duration::from_millis(20), "{longest:?}");
}

#[tokio::test(start_paused = true)]
async fn a_stop_in_mid_move_ends_it_within_its_deceleration_and_keeps_the_position() {
    let rig = homed_rig().await;
    let mover = rig.e.clone();
    let moving = tokio::spawn(async move { mover.move_to(Millimetres(5.0)).await });
    sleep(Duration::from_secs(2)).await;
    assert!(rig.e.state().borrow().moving);
    let (asked, at) = (Instant::now(), rig.slides.at(1));
    assert_eq!(rig.e.stop().await, StopDelivery::Confirmed);
    // 250 ms of deceleration, two readings, a reset.
    assert!(asked.elapsed() < Duration::from_millis(900), "{:?}", asked.elapsed());
    let stopped = rig.slides.at(1);
    assert!(near(stopped, at, 0.7), "5 mm/s and 20 mm/s² make 0.625 mm: {at} to {stopped}");
    assert_eq!(moving.await.unwrap(), Err(DeviceError::Stopped { axis: AxisName::E }));
    sleep(Duration::from_secs(5)).await;
    assert_eq!(rig.slides.at(1), stopped);
    let state = rig.e.read_state().await.unwrap();
    assert!(state.homed && near(state.position.value(), stopped, 0.003), "{state:?}");
    // It goes on from there.
    let readback = rig.e.move_to(Millimetres(25.0)).await.unwrap();
    assert!(near(readback.value(), 25.0, 0.002) && near(rig.slides.at(1), 25.0, 0.005));
}

#[tokio::test(start_paused = true)]
async fn a_stop_cancels_the_moves_that_wait_and_works_at_rest() {
    let rig = homed_rig().await;
    let first = tokio::spawn({
        let stage = rig.e.clone();
        async move { stage.move_to(Millimetres(5.0)).await }
    });
    sleep(Duration::from_millis(500)).await;
    let second = tokio::spawn({
        let stage = rig.focus.clone();
        async move { stage.move_to(Millimetres(3.0)).await }
    });
    sleep(Duration::from_millis(10)).await;
    let (a, b) = tokio::join!(rig.focus.stop(), rig.e.stop());
    assert_eq!((a, b), (StopDelivery::Confirmed, StopDelivery::Confirmed));
    assert!(matches!(first.await.unwrap(), Err(DeviceError::Stopped { .. })));
    assert!(matches!(second.await.unwrap(), Err(DeviceError::Stopped { .. })));
    assert!(near(rig.slides.at(0), 0.0, 0.003));
    assert_eq!(rig.focus.stop().await, StopDelivery::Confirmed);
    assert!(rig.focus.read_state().await.unwrap().homed);
}

#[tokio::test(start_paused = true)]
async fn a_motion_commanded_during_a_stop_begins_after_it() {
    let rig = rig_with(|_| {}).await;
    // A stop at rest takes some status reports and a reset: the reset must not hit what is commanded on the way.
    for delay_ms in [0, 20, 90, 150, 250, 400] {
        let home = async {
            sleep(Duration::from_millis(delay_ms)).await;
            rig.e.home().await
        };
        let (delivery, homed) = tokio::join!(rig.focus.stop(), home);
        assert_eq!(delivery, StopDelivery::Confirmed);
        assert_eq!(homed, Ok(()), "homing commanded {delay_ms} ms after the stop");
        let (_, reached) = tokio::join!(rig.focus.stop(), async {
            sleep(Duration::from_millis(delay_ms)).await;
            rig.e.move_to(Millimetres(30.0)).await
        });
        assert!(reached.is_ok(), "a move commanded {delay_ms} ms after the stop: {reached:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_stop_while_homing_resets_and_the_position_stays_unknown() {
    let rig = rig_with(|_| {}).await;
    let homing = tokio::spawn({
        let stage = rig.e.clone();
        async move { stage.home().await }
    });
    sleep(Duration::from_secs(1)).await;
    assert_eq!(rig.e.stop().await, StopDelivery::Confirmed);
    let at = rig.slides.at(1);
    assert_eq!(homing.await.unwrap(), Err(DeviceError::Stopped { axis: AxisName::E }));
    sleep(Duration::from_secs(3)).await;
    assert_eq!(rig.slides.at(1), at);
    let state = rig.e.read_state().await.unwrap();
    assert!(!state.homed && state.fault.is_some(), "{state:?}");
    rig.e.home().await.unwrap();
    assert!(near(rig.slides.at(1), 30.0, 0.003));
}

#[tokio::test(start_paused = true)]
async fn a_target_beyond_the_soft_limits_is_refused_without_motion() {
    let rig = homed_rig().await;
    let at = rig.slides.at(1);
    let error = rig.e.move_to(Millimetres(40.0)).await.unwrap_err();
    assert!(matches!(&error, DeviceError::Refused { reason, .. } if reason.contains("error:15")), "{error}");
    assert_eq!(rig.slides.at(1), at);
    assert!(rig.e.read_state().await.unwrap().homed);
}

#[tokio::test(start_paused = true)]
async fn a_limit_switch_is_an_alarm_that_homing_leaves() {
    let bench = BenchConfig::default();
    // Soft limits that lie beyond the switch, as with a wrong pull-off.
    let rig = accepting_rig_with(|config| {
        if let Some(axis) = &mut config.axes[1] {
            axis.travel_mm = 60.0;
        }
        config.pull_off_mm = 4.0;
    })
    .await;
    rig.e.home().await.unwrap();
    // The driver takes the pull-off's end for 30 mm; the switch, 4 mm on, lies inside the travel.
    let error = rig.e.move_to(Millimetres(bench.e.high_limit_mm + 1.99)).await;
    assert!(error.is_ok(), "{error:?}");
    rig.twin.stall(1, true);
    rig.e.move_to(Millimetres(30.0)).await.unwrap();
    rig.twin.stall(1, false);
    // The motor lost steps: the switch now comes 4 mm early.
    let error = rig.e.move_to(Millimetres(33.0)).await.unwrap_err();
    assert!(matches!(&error, DeviceError::Alarm { reason, .. } if reason.contains("ALARM:1")), "{error}");
    let state = rig.e.state().borrow().clone();
    assert!(!state.homed && state.fault.is_some_and(|fault| fault.contains("limit switch")));
    assert!(matches!(rig.e.move_to(Millimetres(20.0)).await, Err(DeviceError::Alarm { .. })));
    rig.e.home().await.unwrap();
    assert_eq!(rig.e.read_state().await.unwrap().fault, None);
    assert!(near(rig.e.move_to(Millimetres(20.0)).await.unwrap().value(), 20.0, 0.002));
}

#[tokio::test(start_paused = true)]
async fn homing_without_a_switch_fails_in_words() {
    let rig = rig_with(|_| {}).await;
    rig.twin.stall(0, true);
    let error = rig.focus.home().await.unwrap_err();
    assert!(matches!(&error, DeviceError::Alarm { reason, .. } if reason.contains("ALARM:9")), "{error}");
    assert!(!rig.focus.state().borrow().homed);
    rig.twin.stall(0, false);
    rig.focus.home().await.unwrap();
}

#[tokio::test(start_paused = true)]
async fn dropping_the_caller_of_a_move_leaves_driver_and_controller_in_step() {
    let rig = homed_rig().await;
    assert!(timeout(Duration::from_millis(700), rig.e.move_to(Millimetres(20.0))).await.is_err());
    let readback = rig.e.move_to(Millimetres(22.0)).await.unwrap();
    assert!(near(readback.value(), 22.0, 0.002) && near(rig.slides.at(1), 22.0, 0.005));
}

#[tokio::test(start_paused = true)]
async fn an_unplugged_controller_is_disconnected_and_its_position_unknown() {
    let rig = homed_rig().await;
    let moving = tokio::spawn({
        let stage = rig.e.clone();
        async move { stage.move_to(Millimetres(5.0)).await }
    });
    sleep(Duration::from_secs(1)).await;
    rig.twin.unplug();
    let error = moving.await.unwrap().unwrap_err();
    assert!(matches!(error, DeviceError::Disconnected { .. }), "{error}");
    sleep(Duration::from_millis(10)).await;
    let state = rig.e.state().borrow().clone();
    assert!(!state.connected && !state.homed && !state.moving && state.fault.is_some(), "{state:?}");
    assert!(matches!(rig.e.read_state().await, Err(DeviceError::Disconnected { .. })));
    assert!(matches!(rig.focus.move_to(Millimetres(1.0)).await, Err(DeviceError::Disconnected { .. })));
    assert_eq!(rig.e.stop().await, StopDelivery::Undeliverable);
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
async fn settings_that_differ_from_the_configuration_are_told() {
    let rig = accepting_rig_with(|config| {
        if let Some(axis) = &mut config.axes[0] {
            axis.steps_per_mm = 80.0;
            axis.homes_negative = false;
        }
    })
    .await;
    let told = rig.focus.info().disagreements.join(" ");
    assert!(told.contains("$100") && told.contains("80") && told.contains("$23"), "{told}");
    assert!(rig.e.info().disagreements.is_empty());
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
    sleep(Duration::from_millis(500)).await;
    assert!(slides.at(1) < START[1] - 0.5);
    // The program that started the motion dies; another opens the port.
    drop(first);
    before.await.unwrap();
    let controller = connect(twin.dial(), &bench).await.unwrap();
    let at = slides.at(1);
    assert!(at > START[1] - 4.0, "{at}");
    sleep(Duration::from_secs(3)).await;
    assert_eq!(slides.at(1), at);
    assert!(!controller.stage(AxisName::E).unwrap().state().borrow().homed);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_driver_moves_an_axis_over_a_pseudo_terminal() {
    let mut bench = BenchConfig::default();
    // Quick axes: this runs in real time.
    for axis in [&mut bench.focus, &mut bench.e] {
        axis.speed_mm_per_s = 20.0;
        axis.acceleration_mm_per_s2 = 200.0;
    }
    let slides = Slides::new([-1.5, 20.0], &bench);
    let mut config = FirmwareConfig::for_axes(&[&bench.focus, &bench.e]);
    config.locate_rate_mm_per_min = 300.0;
    let twin = ControllerTwin::new(GrblFirmware::new(config, slides.clone()));
    let path = twin.serve_on_terminal().unwrap();
    let dial = SerialDial { device: "controller `main`".to_owned(), port: path, baud: 115_200 };
    let controller = connect(dial.clone(), &bench).await.unwrap();
    let busy = dial.open().await.err().unwrap();
    assert!(matches!(busy, DeviceError::Busy { .. }), "{busy}");
    let focus = controller.stage(AxisName::Focus).unwrap();
    focus.home().await.unwrap();
    let readback = focus.move_to(Millimetres(3.0)).await.unwrap();
    assert!(near(readback.value(), 3.0, 0.002) && near(slides.at(0), 3.0, 0.005), "{readback}");
    assert_eq!(focus.stop().await, StopDelivery::Confirmed);
    twin.unplug();
    let mut state = focus.state();
    let lost = timeout(Duration::from_secs(5), state.wait_for(|state| !state.connected)).await;
    assert!(lost.is_ok(), "the loss of the terminal is seen");
}
