//! What is Thorlabs' own: K-Cubes, whose numbers are others than a rack's, and controllers that cannot be driven.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use plenalign::config::{AxisConfig, BenchConfig, Config};
use plenalign::device::stage::axis::AxisSetup;
use plenalign::device::stage::supervisor::{Controller, ControllerStage};
use plenalign::device::stage::thorlabs::{Body, HOST, Message};
use plenalign::device::stage::thorlabs_controller::ThorlabsDriver;
use plenalign::device::{AxisName, DeviceError, Stage, StopDelivery};
use plenalign::sim::plant::{Plant, Slides};
use plenalign::sim::stage::drive::DriveConfig;
use plenalign::sim::stage::line::Line;
use plenalign::sim::stage::thorlabs::ThorlabsFirmware;
use plenalign::sim::stage::{ControllerTwin, Protocol, firmware};
use plenalign::units::Millimetres;
use tokio::time::{Instant, timeout};

use super::super::until::elapse;
use super::contradictions::set_homing;
use super::kit::{Behind, Kit, bench, near, wait_for};

/// One axis on a controller of its own, and what its motor turns.
struct Cube {
    axis: AxisName,
    config: AxisConfig,
    slides: Arc<Slides>,
    twin: ControllerTwin,
}

/// What makes a controller with one axis.
type Maker = fn(DriveConfig, &Arc<dyn Plant>) -> ThorlabsFirmware;

impl Cube {
    fn new(axis: AxisName, config: &AxisConfig, make: Maker) -> Self {
        let slides = Slides::new(&[(config, config.home_position_mm - 3.0 * config.home_side.sign())]);
        let plant: Arc<dyn Plant> = slides.clone();
        let twin = ControllerTwin::new(make(DriveConfig::of(config), &plant));
        Self { axis, config: config.clone(), slides, twin }
    }

    async fn connect(&self) -> Result<ControllerStage, DeviceError> {
        let (dial, setup) = (Arc::new(self.twin.dial()), AxisSetup::new(self.axis, &self.config));
        let controller = Controller::start("controller `cube`", Box::new(ThorlabsDriver), dial, None, vec![setup]);
        controller.first_attempt().await?;
        Ok(controller.stage(self.axis).unwrap())
    }
}

fn cubes() -> BenchConfig {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/examples/thorlabs-kcubes.toml");
    Config::load(&file).unwrap().bench
}

#[tokio::test(start_paused = true)]
async fn two_cubes_of_either_kind_are_a_bench() {
    let bench = cubes();
    assert_ne!(bench.focus.controller, bench.e.controller);
    let kinds: [(Maker, &str); 2] = [(ThorlabsFirmware::kdc101, "KDC101"), (ThorlabsFirmware::kst101, "KST101")];
    for (make, name) in kinds {
        for (axis, config) in [(AxisName::Focus, &bench.focus), (AxisName::E, &bench.e)] {
            let cube = Cube::new(axis, config, make);
            let stage = cube.connect().await.unwrap();
            let info = stage.info();
            assert!(info.identity.starts_with(&format!("Thorlabs {name}, serial number 2")), "{}", info.identity);
            assert_eq!((info.contradictions, info.disagreements), (Vec::new(), Vec::<String>::new()), "{name}");
            stage.home(stage.generation()).await.unwrap();
            assert!(near(cube.slides.at(0), config.home_position_mm, 0.004), "{name}: {}", cube.slides.at(0));
            // It goes as fast as it is told, which its numbers for speed decide.
            let from = Millimetres(config.home_position_mm);
            for target in [3.0, 1.0] {
                let target = Millimetres(target);
                let here = stage.state().borrow().position;
                let (time, began) = (stage.move_time(here, target), Instant::now());
                let readback = stage.move_to(target, stage.generation()).await.unwrap();
                let (took, longest) = (began.elapsed(), time.predicted + Duration::from_millis(600));
                assert!(took + Duration::from_millis(20) >= time.predicted && took < longest, "{took:?}, {time:?}");
                assert!(near(readback.value(), target.value(), 0.003), "{name}: {readback}");
                assert!(near(cube.slides.at(0), target.value(), 0.006), "{name}: {}", cube.slides.at(0));
            }
            let moving = tokio::spawn({
                let stage = stage.clone();
                async move { stage.move_to(from, stage.generation()).await }
            });
            elapse(Duration::from_millis(700)).await;
            assert_eq!(stage.stop().await, StopDelivery::Confirmed);
            assert_eq!(moving.await.unwrap(), Err(DeviceError::Stopped { axis }));
            assert!(stage.read_state().await.unwrap().homed, "{name}: a stop keeps the position");
        }
    }
}

#[tokio::test(start_paused = true)]
async fn the_example_of_cubes_is_what_one_axis_makes_of_a_twin() {
    let config = cubes().focus;
    let slides = Slides::new(&[(&config, 0.0)]);
    let twin = firmware(Protocol::Thorlabs, &[&config], slides.clone());
    let cube = Cube { axis: AxisName::Focus, config, slides, twin };
    assert!(cube.connect().await.unwrap().info().identity.contains("KDC101"));
}

#[tokio::test(start_paused = true)]
async fn an_axis_that_is_not_there_is_refused_in_words() {
    let mut config = cubes().e;
    config.axis = "2".to_owned();
    let refused = Cube::new(AxisName::E, &config, ThorlabsFirmware::kdc101).connect().await.err().unwrap();
    assert!(matches!(&refused, DeviceError::Refused { reason, .. } if reason.contains("one channel")), "{refused}");
    let mut kit = Kit::new(Protocol::Thorlabs);
    kit.bench.e.axis = "3".to_owned();
    let refused = kit.connect().await.err().unwrap();
    assert!(matches!(&refused, DeviceError::Refused { reason, .. } if reason.contains("bay 3 is empty")), "{refused}");
}

#[tokio::test(start_paused = true)]
async fn a_model_whose_units_are_not_known_is_refused_in_words() {
    let make = |axis: DriveConfig, plant: &Arc<dyn Plant>| ThorlabsFirmware::kst101(axis, plant).with_model("TST001");
    let cube = Cube::new(AxisName::Focus, &cubes().focus, make);
    let at = cube.slides.at(0);
    let refused = cube.connect().await.err().unwrap();
    let DeviceError::WrongDevice { expected, found, .. } = &refused else { panic!("{refused}") };
    assert!(expected.contains("KDC101") && found.contains("TST001"), "{refused}");
    assert_eq!(cube.slides.at(0), at);
}

/// Another program has asked for states again and again, and has left: they are acknowledged no more.
#[tokio::test(start_paused = true)]
async fn a_unit_that_fell_silent_for_want_of_a_host_is_woken() {
    let kit = Kit::new(Protocol::Thorlabs);
    for bay in [0x21, 0x22] {
        kit.twin.receive(&[0x11, 0x00, 0, 0, bay, 0x01]);
    }
    elapse(Duration::from_secs(10)).await;
    let rig = kit.connect().await.unwrap();
    rig.focus.home(rig.focus.generation()).await.unwrap();
    assert!(near(rig.focus.move_to(Millimetres(1.0), rig.focus.generation()).await.unwrap().value(), 1.0, 0.003));
}

/// Another program switches a motor off: its axis may be anywhere from then on.
#[tokio::test(start_paused = true)]
async fn a_motor_that_is_switched_off_has_lost_its_position() {
    let rig = super::kit::homed(Protocol::Thorlabs).await;
    rig.twin.receive(&[0x10, 0x02, 1, 2, 0x22, 0x01]);
    wait_for(&rig.e, "unknown", |state| !state.homed).await;
    let fault = rig.e.state().borrow().fault.clone();
    assert!(fault.as_ref().is_some_and(|fault| fault.contains("switched off")), "{fault:?}");
    rig.e.home(rig.e.generation()).await.unwrap();
    assert!(near(rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap().value(), 20.0, 0.003));
}

/// What was not stored is lost with the power, and its own program may set it: to home towards the other end, the shell.
#[tokio::test(start_paused = true)]
async fn homing_that_was_turned_round_since_it_was_connected_moves_nothing() {
    let rig = super::kit::homed(Protocol::Thorlabs).await;
    let stood = rig.slides.at(1);
    set_homing(&rig.twin, 2, 1);
    let error = rig.e.home(rig.e.generation()).await.unwrap_err();
    assert!(error.to_string().contains("reverse limit switch"), "{error}");
    assert_eq!(rig.slides.at(1), stood);
    set_homing(&rig.twin, 1, 4);
    rig.e.home(rig.e.generation()).await.unwrap();
}

/// Homing that would take far longer than it is given, and a switch that stops nothing, are said.
#[tokio::test(start_paused = true)]
async fn parameters_that_do_no_harm_are_told() {
    let kit = Kit::with(Protocol::Thorlabs, bench(Protocol::Thorlabs));
    let numbers = |slow: i32| [&[1u8, 0, 1, 0, 4, 0], &slow.to_le_bytes()[..], &[0; 4]].concat();
    kit.twin.receive(&[&[0x40, 0x04, 14, 0, 0xA2, 0x01], &numbers(100)[..]].concat());
    // The one switch is ignored, the limits in numbers too.
    kit.twin.receive(&[0x23, 0x04, 16, 0, 0xA2, 0x01, 1, 0, 1, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0]);
    let rig = kit.connect().await.unwrap();
    let info = rig.e.info();
    let told = info.disagreements.join(" ");
    assert!(
        told.contains("homes the e axis at 0.000 mm/s") && told.contains("CW limit switch of the e axis stops nothing"),
        "{told}"
    );
    assert_eq!((info.firmware_limits, info.contradictions), (None, Vec::new()));
    assert_eq!(rig.focus.info().disagreements, Vec::<String>::new());
}

/// A bench on a rack whose messages pass `says` one by one: what comes of each is what is heard of it.
fn rack(mut says: impl FnMut(Message) -> Vec<Message> + Send + 'static) -> Kit {
    let mut kit = Kit::new(Protocol::Thorlabs);
    let plant: Arc<dyn Plant> = kit.slides.clone();
    let drives = [&kit.bench.focus, &kit.bench.e].map(DriveConfig::of).to_vec();
    let says = move |bytes: Vec<u8>| Message::all(&bytes).flat_map(&mut says).flat_map(|said| said.bytes()).collect();
    let firmware = Behind { says: Box::new(says), ..Behind::new(ThorlabsFirmware::bsc203(drives, &plant)) };
    kit.twin = ControllerTwin::new(firmware);
    kit
}

/// The second bay.
const E_BAY: u8 = 0x22;
const STATE: u16 = 0x0481;
const BITS: u16 = 0x042A;
const INFO: u16 = 0x0006;

/// An encoder that has a fault counts what it likes, and its axis is told to be at rest and homed all the same.
#[tokio::test(start_paused = true)]
async fn a_position_under_a_fault_of_its_encoder_is_not_believed() {
    let faulty = Arc::<AtomicBool>::default();
    let fault = Arc::clone(&faulty);
    let kit = rack(move |mut message| {
        let at = match message.id {
            STATE => 13,
            BITS => 5,
            _ => return vec![message],
        };
        if let Body::Data(data) = &mut message.body
            && message.source == E_BAY
            && fault.load(Ordering::SeqCst)
        {
            data[at] |= 0x02;
        }
        vec![message]
    });
    let rig = kit.homed().await;
    faulty.store(true, Ordering::SeqCst);
    wait_for(&rig.e, "unknown", |state| !state.homed).await;
    let said = rig.e.state().borrow().fault.clone();
    assert!(said.as_ref().is_some_and(|said| said.contains("encoder")), "{said:?}");
    let stood = rig.slides.at(1);
    assert!(rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.is_err());
    assert_eq!(rig.slides.at(1), stood);
    assert!(rig.focus.state().borrow().homed, "the other has an encoder of its own");
    let error = rig.e.home(rig.e.generation()).await.unwrap_err();
    assert!(error.to_string().contains("encoder"), "{error}");
    faulty.store(false, Ordering::SeqCst);
    assert!(!rig.e.read_state().await.unwrap().homed, "it does not come back by itself");
    rig.e.home(rig.e.generation()).await.unwrap();
    assert!(near(rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap().value(), 20.0, 0.003));
}

/// What one bay complains about is no reason of the other's; what the controller does may be.
#[tokio::test(start_paused = true)]
async fn a_complaint_is_believed_of_whoever_it_is_about() {
    for (source, believed) in [(0x21, false), (E_BAY, true), (0x11, true)] {
        let complains = Arc::<AtomicBool>::default();
        let due = Arc::clone(&complains);
        let kit = rack(move |message| {
            let mut data = vec![0; 68];
            data[4..12].copy_from_slice(b"too warm");
            let complaint = Message { id: 0x0081, dest: HOST, source, body: Body::Data(data) };
            let due = due.swap(false, Ordering::SeqCst);
            due.then_some(complaint).into_iter().chain([message]).collect()
        });
        let rig = kit.homed().await;
        let mover = rig.e.clone();
        let moving = tokio::spawn(async move { mover.move_to(Millimetres(5.0), mover.generation()).await });
        wait_for(&rig.e, "on its way", |state| state.position.value() < 25.0).await;
        complains.store(true, Ordering::SeqCst);
        // Another program stops it.
        rig.twin.receive(&[0x65, 0x04, 1, 2, E_BAY, 0x01]);
        let error = moving.await.unwrap().unwrap_err();
        assert_eq!(error.to_string().contains("too warm"), believed, "{source:#x}: {error}");
        assert_eq!(rig.e.read_state().await.unwrap().homed, !believed, "{source:#x}");
        // Nor is it of the next move.
        if believed {
            rig.e.home(rig.e.generation()).await.unwrap();
        }
        assert!(near(rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap().value(), 20.0, 0.003));
    }
}

/// Bays and main board answer each for itself: the answer of a bay may come behind that of the main board, which was asked
/// later, and would be half a second old.
#[tokio::test(start_paused = true)]
async fn what_a_bay_said_before_the_main_board_was_asked_is_not_taken_for_now() {
    for late in [STATE, BITS] {
        let armed = Arc::<AtomicBool>::default();
        let (arming, passed) = (Arc::clone(&armed), Arc::<AtomicBool>::default());
        let released = Arc::clone(&passed);
        let (mut held, mut asked) = (Vec::new(), false);
        let kit = rack(move |message| {
            asked |= message.id == INFO && !held.is_empty();
            if message.source != E_BAY {
                return vec![message];
            }
            if held.is_empty() && !(message.id == late && arming.swap(false, Ordering::SeqCst)) {
                return vec![message];
            }
            held.push(message);
            if !asked {
                return Vec::new();
            }
            released.store(true, Ordering::SeqCst);
            std::mem::take(&mut held)
        });
        let rig = kit.homed().await;
        // Each answer takes its time, so that every one is seen by itself.
        rig.twin.set_line(Line { delay: Duration::from_millis(5), ..Line::default() });
        let mover = rig.e.clone();
        let moving = tokio::spawn(async move { mover.move_to(Millimetres(5.0), mover.generation()).await });
        wait_for(&rig.e, "on its way", |state| state.position.value() < 27.0).await;
        armed.store(true, Ordering::SeqCst);
        let mut state = rig.e.state();
        while !moving.is_finished() {
            let changed = timeout(Duration::from_millis(100), state.changed()).await.is_ok();
            let (says, at) = (state.borrow_and_update().position.value(), rig.slides.at(1));
            // Half a second at 5 mm/s are 2.5 mm. Until the next answer comes, the last one counts.
            if changed && passed.load(Ordering::SeqCst) {
                assert!(near(says, at, 1.0), "{late:#x}: {says} at {at}");
            }
        }
        assert!(passed.load(Ordering::SeqCst), "nothing was late");
        assert!(near(moving.await.unwrap().unwrap().value(), 5.0, 0.003));
    }
}
