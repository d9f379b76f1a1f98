//! What FluidNC has of its own, on its twin: a configuration that is read and never assumed, jogs that it shortens to its
//! limits, a machine position after homing that is set, alarms of its own.

use std::time::Duration;

use plenalign::config::{BenchConfig, Side};
use plenalign::device::{AxisName, DeviceError, Stage, StopDelivery};
use plenalign::sim::stage::grbl::{FirmwareConfig, GrblFirmware};
use plenalign::sim::stage::{ControllerTwin, Protocol};
use plenalign::units::Millimetres;
use tokio::io::{AsyncReadExt, AsyncWriteExt, duplex};
use tokio::time::timeout;

use super::super::until::{elapse, until};
use super::kit::{Behind, Kit, START, bench, near, wait_for};

/// A kit whose twin is set as `change` says, its axes standing where `start` says.
fn kit(start: [f64; 2], change: impl FnOnce(&mut FirmwareConfig)) -> Kit {
    on(bench(Protocol::FluidNc), start, change)
}

fn on(bench: BenchConfig, start: [f64; 2], change: impl FnOnce(&mut FirmwareConfig)) -> Kit {
    Kit::grbl(Protocol::FluidNc, bench, start, change)
}

fn keys(pairs: &[(&str, &str)]) -> Vec<(String, String)> {
    pairs.iter().map(|&(key, value)| (key.to_owned(), value.to_owned())).collect()
}

#[tokio::test(start_paused = true)]
async fn what_cannot_be_read_or_driven_moves_nothing_and_says_why() {
    for (key, value, words) in [
        ("axes/y/homing/positive_direction", "ture", "tells `ture` as axes/y/homing/positive_direction"),
        ("axes/y/homing/positive_direction", "false", "negative end"),
        ("axes/y/homing/mpos_mm", "nan", "axes/y/homing/mpos_mm"),
        ("axes/y/max_travel_mm", "x", "axes/y/max_travel_mm"),
        ("axes/y/motor0/pulloff_mm", "x", "axes/y/motor0/pulloff_mm"),
        ("axes/y/steps_per_mm", "x", "axes/y/steps_per_mm"),
        ("axes/y/homing/cycle", "-1", "cycle: -1"),
        ("axes/y/motor0/standard_stepper/direction_pin", "NO_PIN", "tells `NO_PIN` as the direction_pin"),
        ("axes/y/motor0/standard_stepper/direction_pin", "gpio.5:low", "inverts the direction of Y"),
        ("axes/y/motor0/standard_stepper/direction_pin", "gpio.5:odd", "is not known"),
        ("axes/y/motor0/limit_pos_pin", "NO_PIN", "no limit switch at the end"),
        ("kinematics/CoreXY", "", "Cartesian"),
        ("macros/after_homing", "G0 Y1", "by itself"),
        ("report_inches", "odd", "report_inches"),
    ] {
        let kit = kit(START, |config| config.keys = keys(&[(key, value)]));
        let rig = kit.connect().await.unwrap();
        for error in [
            rig.e.home(rig.e.generation()).await.unwrap_err(),
            rig.e.set_position(Millimetres(20.0), rig.e.generation()).await.unwrap_err(),
            rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap_err(),
        ] {
            assert!(matches!(&error, DeviceError::Refused { reason, .. } if reason.contains(words)), "{key}: {error}");
        }
        assert_eq!(rig.slides.at(1), START[1], "{key}");
        assert_eq!(rig.e.stop().await, StopDelivery::Confirmed, "{key}");
    }
    let motors = kit(START, |config| config.keys = keys(&[("axes/y/motor1", ""), ("axes/y/motor1/pulloff_mm", "1.0")]));
    let rig = motors.connect().await.unwrap();
    assert!(rig.e.info().contradictions.join(" ").contains("two motors"), "{:?}", rig.e.info().contradictions);
    assert!(rig.focus.home(rig.focus.generation()).await.is_ok(), "the other axis has one");
    let inches = kit(START, |config| config.keys = keys(&[("report_inches", "true")]));
    let error = inches.connect().await.err().unwrap();
    assert!(error.to_string().contains("report_inches: false"), "{error}");
}

#[tokio::test(start_paused = true)]
async fn what_differs_and_does_no_harm_is_told() {
    let kit = kit(START, |config| {
        config.keys = keys(&[
            ("axes/y/max_rate_mm_per_min", "120.000000"),
            ("axes/y/acceleration_mm_per_sec2", "10.000000"),
            ("axes/y/soft_limits", "false"),
            ("axes/y/motor0/hard_limits", "false"),
            ("stepping/idle_ms", "250"),
            ("axes/y/homing/seek_scaler", "1.010000"),
        ]);
    });
    let rig = kit.connect().await.unwrap();
    let told = rig.e.info().disagreements.join(" ");
    for words in [
        "2.000 mm/s at most",
        "10 mm/s²",
        "axes/y/soft_limits",
        "axes/y/motor0/hard_limits",
        "idle_ms: 255",
        "seek_scaler",
    ] {
        assert!(told.contains(words), "{words}: {told}");
    }
    assert_eq!((rig.e.info().contradictions, rig.e.info().firmware_limits), (Vec::new(), None));
}

/// Wherever home is for the controller, and whichever way round it counts.
#[tokio::test(start_paused = true)]
async fn coordinates_follow_the_machine_position_that_homing_is_set_to() {
    for (home_mm, reversed) in [(0.0, false), (-12.5, false), (140.0, false), (0.0, true), (70.25, true)] {
        let mut bench = bench(Protocol::FluidNc);
        bench.e.reversed = reversed;
        let kit = on(bench, START, |config| {
            if let Some(axis) = &mut config.axes[1] {
                axis.home_mm = home_mm;
            }
        });
        let rig = kit.homed().await;
        assert!(near(rig.slides.at(1), 30.0, 0.004), "{home_mm}: {}", rig.slides.at(1));
        let limits = rig.e.info().firmware_limits.map(|(low, high)| (low.value(), high.value())).unwrap();
        assert!(near(limits.0, -5.0, 1e-3) && near(limits.1, 30.0, 1e-3), "{home_mm}: {limits:?}");
        for target in [30.0, -4.9, 12.0] {
            let reached = rig.e.move_to(Millimetres(target), rig.e.generation()).await.unwrap();
            assert!(
                near(reached.value(), target, 0.003) && near(rig.slides.at(1), target, 0.006),
                "{home_mm}: {reached}"
            );
        }
    }
}

#[tokio::test(start_paused = true)]
async fn one_axis_is_moved_while_the_other_is_not_homed() {
    for must_home in [true, false] {
        let kit = kit(START, |config| config.must_home = must_home);
        let rig = kit.connect().await.unwrap();
        rig.focus.home(rig.focus.generation()).await.unwrap();
        assert_eq!(rig.focus.read_state().await.unwrap().fault, None, "it is locked for the other's sake");
        let reached = rig.focus.move_to(Millimetres(2.5), rig.focus.generation()).await.unwrap();
        assert!(near(reached.value(), 2.5, 0.003), "{reached}");
        let refused = rig.e.move_to(Millimetres(10.0), rig.e.generation()).await.unwrap_err();
        assert_eq!(refused, DeviceError::NotHomed { axis: AxisName::E });
        assert_eq!(rig.slides.at(1), START[1]);
    }
}

#[tokio::test(start_paused = true)]
async fn where_axes_are_not_homed_alone_both_are() {
    let both = kit(START, |config| config.single_axis_homing = false);
    let rig = both.connect().await.unwrap();
    assert_eq!(rig.focus.homes_also(), Some(AxisName::E));
    rig.focus.home(rig.focus.generation()).await.unwrap();
    assert!(near(rig.slides.at(0), 0.0, 0.004) && near(rig.slides.at(1), 30.0, 0.004));
    assert!(rig.e.read_state().await.unwrap().homed);
    // One that is homed neither alone nor with the others is not homed at all.
    let never = kit(START, |config| {
        config.single_axis_homing = false;
        config.keys = keys(&[("axes/y/homing/cycle", "0")]);
    });
    let rig = never.connect().await.unwrap();
    let error = rig.focus.home(rig.focus.generation()).await.unwrap_err();
    assert!(error.to_string().contains("cannot be homed"), "{error}");
    assert_eq!([rig.slides.at(0), rig.slides.at(1)], START);
}

#[tokio::test(start_paused = true)]
async fn after_a_start_it_is_homed_without_a_stop() {
    let kit = kit(START, |_| {});
    let rig = kit.homed().await;
    rig.twin.power_cycle();
    wait_for(&rig.e, "unknown", |state| !state.homed).await;
    // `ALARM:14` has come behind the start.
    elapse(Duration::from_secs(1)).await;
    let state = rig.e.read_state().await.unwrap();
    assert!(state.fault.as_ref().is_some_and(|fault| fault.contains("homed")), "{state:?}");
    rig.e.home(rig.e.generation()).await.unwrap();
    assert!(near(rig.slides.at(1), 30.0, 0.004));
}

#[tokio::test(start_paused = true)]
async fn a_configuration_that_changes_is_read_again_before_anything_homes() {
    let kit = kit(START, |_| {});
    let rig = kit.homed().await;
    rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap();
    rig.twin.receive(b"$/axes/y/homing/positive_direction=false\n");
    let stood = rig.slides.at(1);
    let error = rig.e.home(rig.e.generation()).await.unwrap_err();
    assert!(error.to_string().contains("positive_direction"), "{error}");
    assert_eq!(rig.slides.at(1), stood);
    rig.twin.receive(b"$/axes/y/homing/positive_direction=true\n");
    let agreed = until("nothing contradicts", async || rig.e.info().contradictions.is_empty());
    timeout(Duration::from_secs(20), agreed).await.expect("it is told, too, once it is set right");
    rig.e.home(rig.e.generation()).await.unwrap();
}

/// Slides of which e stands on its far switch.
const FAR: [f64; 2] = [1.3, -6.3];

#[tokio::test(start_paused = true)]
async fn homing_from_a_switch_that_is_not_known_moves_nothing() {
    for separate_pins in [true, false] {
        let kit = kit(FAR, |config| config.separate_pins = separate_pins);
        let rig = kit.connect().await.unwrap();
        let barred = rig.e.home(rig.e.generation()).await.unwrap_err();
        assert!(barred.to_string().contains("leave-switch"), "{barred}");
        assert_eq!(rig.slides.at(1), FAR[1]);
        // By its operator's word it leaves the switch, and is homed then.
        let mut pieces = 0;
        while !rig.e.step_off(Side::High, 0.2, rig.e.generation()).await.unwrap() {
            pieces += 1;
            assert!(pieces < 10);
        }
        assert!(near(rig.slides.at(1), -6.0, 0.21), "{}", rig.slides.at(1));
        rig.e.home(rig.e.generation()).await.unwrap();
        assert!(near(rig.slides.at(1), 30.0, 0.004));
    }
}

/// From outside its soft limits FluidNC would draw an axis into them, however short a way was asked for.
#[tokio::test(start_paused = true)]
async fn an_axis_outside_its_soft_limits_is_not_moved_off_its_switch() {
    let kit = kit(FAR, |config| {
        if let Some(axis) = &mut config.axes[1] {
            axis.home_mm = 140.0;
        }
    });
    let rig = kit.connect().await.unwrap();
    let error = rig.e.step_off(Side::High, 0.2, rig.e.generation()).await.unwrap_err();
    assert!(error.to_string().contains("soft_limits") && error.to_string().contains("by hand"), "{error}");
    assert_eq!(rig.slides.at(1), FAR[1]);

    // What it would have done.
    let (mut wire, far) = duplex(4096);
    let twin = kit.twin.clone();
    drop(rig);
    elapse(Duration::from_secs(1)).await;
    tokio::spawn(async move { twin.serve(far).await });
    wire.write_all(b"$X\n$J=G91 G21 Y0.2000 F60.00\n").await.unwrap();
    let mut said = [0u8; 4096];
    assert!(wire.read(&mut said).await.is_ok());
    elapse(Duration::from_secs(5)).await;
    assert!(kit.slides.at(1) > FAR[1] + 2.0, "{}", kit.slides.at(1));
}

/// What a firmware hears that answers homing and does nothing.
fn without_homing() -> impl FnMut(u8) -> Vec<u8> {
    let mut line = Vec::new();
    move |byte| match byte {
        b'?' | b'!' | b'~' | 0x18 | 0x80.. => vec![byte],
        b'\n' => {
            let mut line = std::mem::take(&mut line);
            if line.starts_with(b"$H") {
                line.clear();
            }
            line.push(byte);
            line
        }
        _ => {
            line.push(byte);
            Vec::new()
        }
    }
}

/// The machine position of an axis that was never moved is 0, and so may be that of a homed one.
#[tokio::test(start_paused = true)]
async fn homing_that_ends_at_once_or_elsewhere_has_homed_nothing() {
    for (axis, words) in [(AxisName::Focus, "too soon"), (AxisName::E, "and not at 30.000")] {
        let mut kit = kit(START, |_| {});
        let config = FirmwareConfig::fluidnc(&[&kit.bench.focus, &kit.bench.e]);
        let firmware = GrblFirmware::new(config, kit.slides.clone());
        kit.twin = ControllerTwin::new(Behind { hears: Box::new(without_homing()), ..Behind::new(firmware) });
        let rig = kit.connect().await.unwrap();
        let stage = if axis == AxisName::E { &rig.e } else { &rig.focus };
        let error = stage.home(stage.generation()).await.unwrap_err();
        assert!(error.to_string().contains(words), "{axis}: {error}");
        assert!(!stage.read_state().await.unwrap().homed);
    }
}

#[tokio::test(start_paused = true)]
async fn what_ends_a_move_is_said_in_words() {
    let kit = kit(START, |_| {});
    let rig = kit.homed().await;
    for (end, words) in [(&b"!"[..], "hold"), (b"\x18", "ALARM:3"), (b"", "restarted")] {
        rig.e.home(rig.e.generation()).await.unwrap();
        let mover = rig.e.clone();
        let moving = tokio::spawn(async move { mover.move_to(Millimetres(5.0), mover.generation()).await });
        elapse(Duration::from_millis(900)).await;
        if end.is_empty() {
            rig.twin.power_cycle();
        } else {
            rig.twin.receive(end);
        }
        let error = moving.await.unwrap().unwrap_err();
        assert!(error.to_string().contains(words), "{words}: {error}");
        assert!(!error.to_string().contains("cannot be understood"), "{error}");
    }
    assert!(!rig.e.state().borrow().homed && rig.slides.at(1) > 20.0);
}
