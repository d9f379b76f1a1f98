//! What every driver does on a bad day: alarms, power failures, unplugged and exchanged controllers.

use std::sync::Arc;
use std::time::Duration;

use clap::ValueEnum as _;
use plenalign::config::{BenchConfig, ControllerDriver};
use plenalign::device::serial::Dial;
use plenalign::device::{AxisName, DeviceError, Stage, StopDelivery};
use plenalign::sim::stage::drive::DriveConfig;
use plenalign::sim::stage::zaber::ZaberFirmware;
use plenalign::sim::stage::{ControllerTwin, PULL_OFF_MM, Protocol};
use plenalign::units::Millimetres;
use tokio::time::Instant;

use super::super::until::elapse;
use super::kit::{Kit, START, every_protocol, homed, near, wait_for};

every_protocol!(
    a_limit_switch_is_an_alarm_that_homing_leaves,
    homing_without_a_switch_fails_in_words,
    a_power_failure_at_rest_makes_the_position_unknown,
    a_power_failure_in_mid_move_ends_it,
    an_unplugged_controller_comes_back_without_resuming,
    a_controller_that_is_absent_at_the_start_is_connected_when_it_comes,
    a_busy_port_is_tried_again,
    another_kind_of_device_is_refused,
    another_identity_is_refused,
);

async fn a_limit_switch_is_an_alarm_that_homing_leaves(driver: Protocol) {
    let rig = homed(driver).await;
    // The motor loses five millimetres of steps: the switch now comes that much early.
    rig.twin.stall(1, true);
    rig.e.move_to(Millimetres(25.0), rig.e.generation()).await.unwrap();
    rig.twin.stall(1, false);
    let error = rig.e.move_to(Millimetres(29.9), rig.e.generation()).await.unwrap_err();
    let words = match driver {
        Protocol::Grbl | Protocol::GrblHal | Protocol::FluidNc => "ALARM:1",
        Protocol::Zaber => "WL",
        Protocol::Pi => "-1024",
        Protocol::Tmcl => "right limit switch",
        Protocol::Thorlabs => "a limit switch",
    };
    assert!(matches!(&error, DeviceError::Alarm { reason, .. } if reason.contains(words)), "{error}");
    let switch = BenchConfig::default().e.home_position_mm + PULL_OFF_MM;
    assert!(near(rig.slides.at(1), switch, 0.1), "it stands at the switch: {}", rig.slides.at(1));
    assert!(!rig.e.state().borrow().homed);
    let error = rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap_err();
    assert!(matches!(error, DeviceError::Alarm { .. } | DeviceError::NotHomed { .. }), "{error}");
    rig.e.home(rig.e.generation()).await.unwrap();
    assert_eq!(rig.e.read_state().await.unwrap().fault, None);
    assert!(near(rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap().value(), 20.0, 0.003));
    assert!(near(rig.slides.at(1), 20.0, 0.006), "{}", rig.slides.at(1));
}

async fn homing_without_a_switch_fails_in_words(driver: Protocol) {
    let rig = Kit::new(driver).connect().await.unwrap();
    rig.twin.stall(0, true);
    let error = rig.focus.home(rig.focus.generation()).await.unwrap_err();
    assert!(matches!(error, DeviceError::Alarm { .. } | DeviceError::Timeout { .. }), "{error}");
    assert!(!rig.focus.state().borrow().homed && !rig.focus.read_state().await.unwrap().moving);
    rig.twin.stall(0, false);
    rig.focus.home(rig.focus.generation()).await.unwrap();
    assert!(near(rig.slides.at(0), 0.0, 0.004));
}

async fn a_power_failure_at_rest_makes_the_position_unknown(driver: Protocol) {
    let rig = homed(driver).await;
    rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap();
    rig.twin.power_cycle();
    let seen = wait_for(&rig.e, "unknown after a power failure", |state| !state.homed).await;
    assert!(seen < Duration::from_secs(2), "{seen:?}");
    let error = rig.e.move_to(Millimetres(25.0), rig.e.generation()).await.unwrap_err();
    assert!(matches!(error, DeviceError::NotHomed { .. }), "{error}");
    assert!(near(rig.slides.at(1), 20.0, 0.006), "nothing moved");
    rig.e.home(rig.e.generation()).await.unwrap();
    assert!(near(rig.e.move_to(Millimetres(25.0), rig.e.generation()).await.unwrap().value(), 25.0, 0.003));
    assert!(near(rig.slides.at(1), 25.0, 0.006));
}

async fn a_power_failure_in_mid_move_ends_it(driver: Protocol) {
    let rig = homed(driver).await;
    let mover = rig.e.clone();
    let moving = tokio::spawn(async move { mover.move_to(Millimetres(5.0), mover.generation()).await });
    elapse(Duration::from_secs(1)).await;
    rig.twin.power_cycle();
    let at = rig.slides.at(1);
    let error = moving.await.unwrap().unwrap_err();
    assert!(!matches!(error, DeviceError::Disconnected { .. }), "{error}");
    elapse(Duration::from_secs(5)).await;
    assert_eq!(rig.slides.at(1), at, "nothing resumes");
    assert!(!rig.e.read_state().await.unwrap().homed);
    rig.e.home(rig.e.generation()).await.unwrap();
    assert!(near(rig.slides.at(1), 30.0, 0.004));
}

async fn an_unplugged_controller_comes_back_without_resuming(driver: Protocol) {
    let rig = homed(driver).await;
    let moving = tokio::spawn({
        let stage = rig.e.clone();
        async move { stage.move_to(Millimetres(-4.0), stage.generation()).await }
    });
    elapse(Duration::from_secs(1)).await;
    rig.twin.unplug();
    let error = moving.await.unwrap().unwrap_err();
    assert!(matches!(error, DeviceError::Disconnected { .. }), "{error}");
    wait_for(&rig.e, "disconnected", |state| !state.connected).await;
    let state = rig.e.state().borrow().clone();
    assert!(!state.homed && !state.moving && state.fault.is_some(), "{state:?}");
    assert!(matches!(rig.e.read_state().await, Err(DeviceError::Disconnected { .. })));
    assert!(matches!(
        rig.focus.move_to(Millimetres(1.0), rig.focus.generation()).await,
        Err(DeviceError::Disconnected { .. })
    ));
    assert_eq!(rig.e.stop().await, StopDelivery::Undeliverable);

    // The controller goes on by itself meanwhile; the first thing after the reconnection is a stop.
    elapse(Duration::from_millis(1500)).await;
    rig.twin.plug_in();
    let back = wait_for(&rig.e, "connected again", |state| state.connected);
    tokio::time::timeout(Duration::from_secs(20), back).await.unwrap();
    elapse(Duration::from_secs(1)).await;
    // Grbl may be locked after the reset; why it was not there is no fault of now.
    let fault = rig.e.state().borrow().fault.clone();
    let locked = |fault: &String| driver.driver() == ControllerDriver::Grbl && fault.contains("home");
    assert!(fault.as_ref().is_none_or(locked), "{fault:?}");
    let at = rig.slides.at(1);
    assert!(at > -3.0, "it was stopped on its way: {at}");
    elapse(Duration::from_secs(10)).await;
    assert_eq!(rig.slides.at(1), at, "nothing resumes");
    let state = rig.e.read_state().await.unwrap();
    assert!(state.connected, "{state:?}");
    // These say that they kept their reference; the others cannot, or were reset.
    let kept = matches!(driver, Protocol::Zaber | Protocol::Pi);
    assert_eq!(state.homed, kept, "{state:?}");
    if kept {
        assert!(near(state.position.value(), at, 0.004), "{state:?} at {at}");
    }
    rig.e.home(rig.e.generation()).await.unwrap();
    assert!(near(rig.slides.at(1), 30.0, 0.004));

    // Unplugged and without power: no controller keeps its reference then.
    rig.twin.unplug();
    wait_for(&rig.e, "disconnected", |state| !state.connected).await;
    rig.twin.power_cycle();
    rig.twin.plug_in();
    wait_for(&rig.e, "connected", |state| state.connected).await;
    assert!(!rig.e.read_state().await.unwrap().homed);
}

async fn a_controller_that_is_absent_at_the_start_is_connected_when_it_comes(driver: Protocol) {
    let kit = Kit::new(driver);
    kit.twin.unplug();
    let controller = kit.start();
    let error = controller.first_attempt().await.unwrap_err();
    assert!(matches!(error, DeviceError::Disconnected { .. }), "{error}");
    let rig = kit.rig(&controller);
    let state = rig.focus.state().borrow().clone();
    assert_eq!(state.fault.as_deref(), Some("it is unplugged"));
    assert_eq!(rig.focus.home(rig.focus.generation()).await, Err(error));
    assert_eq!(rig.focus.info().identity, "");
    elapse(Duration::from_secs(60)).await;
    kit.twin.plug_in();
    let came = wait_for(&rig.focus, "connected", |state| state.connected).await;
    // The pause between two tries, and what connecting takes.
    assert!(came < Duration::from_secs(8), "{came:?}");
    let fault = rig.focus.read_state().await.unwrap().fault;
    assert!(!fault.as_deref().unwrap_or_default().contains("unplugged"), "{fault:?}");
    rig.focus.home(rig.focus.generation()).await.unwrap();
    assert!(!rig.focus.info().identity.is_empty());
}

async fn a_busy_port_is_tried_again(driver: Protocol) {
    let kit = Kit::new(driver);
    let held = kit.twin.dial().open().await.unwrap();
    elapse(Duration::from_millis(1)).await;
    let controller = kit.start();
    let error = controller.first_attempt().await.unwrap_err();
    assert!(matches!(error, DeviceError::Busy { .. }), "{error}");
    let rig = kit.rig(&controller);
    assert!(rig.e.state().borrow().fault.as_ref().is_some_and(|fault| fault.contains("in use")));
    drop(held);
    wait_for(&rig.e, "connected", |state| state.connected).await;
}

async fn another_kind_of_device_is_refused(driver: Protocol) {
    for &other in Protocol::value_variants() {
        if other.driver() == driver.driver() {
            continue;
        }
        let (kit, another) = (Kit::new(driver), Kit::new(other));
        let controller = kit.start_on(Arc::new(another.twin.dial()), None);
        let error = controller.first_attempt().await.unwrap_err();
        assert!(
            matches!(error, DeviceError::WrongDevice { .. } | DeviceError::Timeout { .. }),
            "{driver:?} on {other:?}: {error}"
        );
        let rig = kit.rig(&controller);
        assert!(!rig.e.state().borrow().connected && rig.e.state().borrow().fault.is_some());
        elapse(Duration::from_secs(40)).await;
        assert!(!rig.e.state().borrow().connected, "{driver:?} on {other:?}");
        assert_eq!([another.slides.at(0), another.slides.at(1)], START, "nothing moved");
    }
}

async fn another_identity_is_refused(driver: Protocol) {
    let kit = Kit::new(driver);
    let controller = kit.start_on(Arc::new(kit.twin.dial()), Some("the one in the corner"));
    let error = controller.first_attempt().await.unwrap_err();
    assert!(matches!(&error, DeviceError::WrongDevice { expected, .. } if expected.contains("corner")), "{error}");
    assert!(!kit.rig(&controller).e.state().borrow().connected);
}

/// Leads to one twin first and to another from then on.
struct Exchanged(ControllerTwin, ControllerTwin, std::sync::atomic::AtomicBool);

#[async_trait::async_trait]
impl Dial for Exchanged {
    fn location(&self) -> String {
        "pipe".to_owned()
    }

    async fn open(&self) -> Result<plenalign::device::serial::Wire, DeviceError> {
        let first = !self.2.swap(true, std::sync::atomic::Ordering::SeqCst);
        if first { self.0.dial().open().await } else { self.1.dial().open().await }
    }
}

#[tokio::test(start_paused = true)]
async fn a_controller_exchanged_for_another_is_refused() {
    let kit = Kit::new(Protocol::Zaber);
    let drives = vec![DriveConfig::of(&kit.bench.focus), DriveConfig::of(&kit.bench.e)];
    let plant: Arc<dyn plenalign::sim::plant::Plant> = kit.slides.clone();
    let other = ControllerTwin::new(ZaberFirmware::new(drives, &plant).with_version("7.40"));
    let controller = kit.start_on(Arc::new(Exchanged(kit.twin.clone(), other, Default::default())), None);
    controller.first_attempt().await.unwrap();
    let rig = kit.rig(&controller);
    kit.twin.unplug();
    let refused = |state: &plenalign::device::StageState| {
        state.fault.as_ref().is_some_and(|fault| fault.contains("7.36") && fault.contains("7.40"))
    };
    wait_for(&rig.e, "refused", refused).await;
    assert!(!rig.e.state().borrow().connected);
    assert!(matches!(rig.e.home(rig.e.generation()).await, Err(DeviceError::WrongDevice { .. })));
}

/// Cannot be opened, for this reason, and notes when that was tried.
struct Closed(DeviceError, std::sync::Mutex<Vec<Instant>>);

#[async_trait::async_trait]
impl Dial for Closed {
    fn location(&self) -> String {
        "nowhere".to_owned()
    }

    async fn open(&self) -> Result<plenalign::device::serial::Wire, DeviceError> {
        self.1.lock().unwrap().push(Instant::now());
        Err(self.0.clone())
    }
}

#[tokio::test(start_paused = true)]
async fn what_is_not_there_is_tried_at_growing_pauses_and_what_is_refused_at_long_ones() {
    let device = || "controller `main`".to_owned();
    let absent = DeviceError::Disconnected { device: device(), reason: "unplugged".to_owned() };
    let wrong = DeviceError::WrongDevice { device: device(), expected: "one".to_owned(), found: "two".to_owned() };
    for (error, wanted_ms) in
        [(absent, vec![250, 500, 1000, 2000, 4000, 5000, 5000]), (wrong, vec![15_000, 15_000, 15_000])]
    {
        let closed = Arc::new(Closed(error.clone(), Default::default()));
        let controller = Kit::new(Protocol::Grbl).start_on(closed.clone(), None);
        elapse(Duration::from_secs(60)).await;
        let tried = closed.1.lock().unwrap().clone();
        let pauses: Vec<u64> = tried.windows(2).map(|pair| (pair[1] - pair[0]).as_millis() as u64).collect();
        // The clock of tokio's timers has a grain of a millisecond.
        let as_wanted = pauses.iter().zip(&wanted_ms).all(|(&pause, &wanted)| pause.abs_diff(wanted) <= 2);
        assert!(pauses.len() >= wanted_ms.len() && as_wanted, "{error}: {pauses:?}");
        drop(controller);
    }
}

#[tokio::test(start_paused = true)]
async fn an_old_zaber_firmware_that_is_too_fast_is_refused() {
    let mut kit = Kit::new(Protocol::Zaber);
    let drives = vec![DriveConfig::of(&kit.bench.focus), DriveConfig::of(&kit.bench.e)];
    let plant: Arc<dyn plenalign::sim::plant::Plant> = kit.slides.clone();
    kit.twin = ControllerTwin::new(ZaberFirmware::new(drives, &plant).with_version("6.28"));
    let rig = kit.connect().await.unwrap();
    rig.focus.home(rig.focus.generation()).await.unwrap();
    let (began, time) = (Instant::now(), rig.focus.move_time(Millimetres(0.0), Millimetres(4.0)));
    rig.focus.move_to(Millimetres(4.0), rig.focus.generation()).await.unwrap();
    assert!(began.elapsed() < time.predicted + Duration::from_millis(600));
    // Without a speed in the move the device's own would be taken.
    kit.bench.focus.speed_mm_per_s = 1.0;
    drop(rig);
    elapse(Duration::from_millis(10)).await;
    let rig = kit.connect().await.unwrap();
    let error = rig.focus.move_to(Millimetres(3.0), rig.focus.generation()).await.unwrap_err();
    assert!(error.to_string().contains("maxspeed") && error.to_string().contains("7.25"), "{error}");
    assert!(near(rig.slides.at(0), 4.0, 0.006));
}

#[tokio::test(start_paused = true)]
async fn two_controllers_of_different_kinds_share_no_stop() {
    let (zaber, pi) = (Kit::new(Protocol::Zaber), Kit::new(Protocol::Pi));
    let (first, second) = (zaber.connect().await.unwrap(), pi.connect().await.unwrap());
    first.focus.home(first.focus.generation()).await.unwrap();
    second.e.home(second.e.generation()).await.unwrap();
    let moving = tokio::spawn({
        let stage = second.e.clone();
        async move { stage.move_to(Millimetres(20.0), stage.generation()).await }
    });
    elapse(Duration::from_millis(500)).await;
    assert_eq!(first.focus.stop().await, StopDelivery::Confirmed);
    assert!(near(moving.await.unwrap().unwrap().value(), 20.0, 0.003));
    assert_eq!(first.focus.info().axis, AxisName::Focus);
}
