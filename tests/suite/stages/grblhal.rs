//! What grblHAL has of its own, on its twin: soft limits that keep a pull-off from the switches, and settings for what Grbl is
//! built with.

use std::time::Duration;

use plenalign::device::{AxisName, DeviceError, Stage};
use plenalign::sim::stage::grbl::FirmwareConfig;
use plenalign::sim::stage::{PULL_OFF_MM, Protocol};
use plenalign::units::Millimetres;
use tokio::time::timeout;

use super::super::until::until;
use super::kit::{Kit, Rig, START, bench, near, wait_for};

/// A kit whose twin is set as `change` says.
fn kit(change: impl FnOnce(&mut FirmwareConfig)) -> Kit {
    let mut bench = bench(Protocol::GrblHal);
    for axis in [&mut bench.focus, &mut bench.e] {
        axis.accept_wider_firmware_limits = true;
    }
    Kit::grbl(Protocol::GrblHal, bench, START, change)
}

/// What the driver says of the limits is what the controller lets its axes go to.
async fn limits_are(rig: &Rig, expected: [(f64, f64); 2]) {
    for (stage, (low, high)) in [&rig.focus, &rig.e].into_iter().zip(expected) {
        let told = stage.info().firmware_limits.map(|(low, high)| (low.value(), high.value())).unwrap();
        assert!(near(told.0, low, 1e-3) && near(told.1, high, 1e-3), "{told:?} for {low} to {high}");
        for (end, beyond) in [(low, -0.1), (high, 0.1)] {
            let refused = stage.move_to(Millimetres(end + beyond), stage.generation()).await.unwrap_err();
            assert!(
                matches!(&refused, DeviceError::Refused { reason, .. } if reason.contains("error:15")),
                "{refused}"
            );
        }
    }
}

/// They are by a pull-off narrower than stock Grbl's at either end, and only where the switches are on.
#[tokio::test(start_paused = true)]
async fn where_hard_limits_are_on_the_soft_limits_keep_a_pull_off_from_both_ends() {
    let rig = kit(|_| {}).homed().await;
    let (focus, e) = ((0.0, 5.0), (-5.0, 30.0));
    limits_are(&rig, [focus, e]).await;
    for (stage, (low, high)) in [(&rig.focus, focus), (&rig.e, e)] {
        for end in [low, high] {
            stage.move_to(Millimetres(end), stage.generation()).await.unwrap();
        }
    }
    let rig = kit(|config| config.hard_limits = false).homed().await;
    let off = PULL_OFF_MM;
    limits_are(&rig, [(focus.0 - off, focus.1 + off), (e.0 - off, e.1 + off)]).await;
}

/// Home is the machine's zero by a bit of `$22`, and the limits begin there.
#[tokio::test(start_paused = true)]
async fn where_home_is_made_zero_the_soft_limits_begin_there() {
    let kit = kit(|_| {});
    kit.twin.receive(b"$22=11\n");
    let rig = kit.homed().await;
    assert!(near(rig.slides.at(0), 0.0, 0.004) && near(rig.slides.at(1), 30.0, 0.004));
    // The switch is a pull-off beyond, and the travel by one longer.
    limits_are(&rig, [(0.0, 5.0 + PULL_OFF_MM), (-5.0 - PULL_OFF_MM, 30.0)]).await;
}

/// How it homes is a setting, which another program may change: both are homed at once from then on.
#[tokio::test(start_paused = true)]
async fn homing_that_takes_another_axis_along_since_it_was_connected_moves_nothing_at_first() {
    let kit = kit(|_| {});
    let rig = kit.connect().await.unwrap();
    assert_eq!(rig.focus.homes_also(), None);
    // They move one after the other all the same.
    assert_eq!([&rig.focus, &rig.e].map(|stage| stage.takes_turns_with()), [Some(AxisName::E), Some(AxisName::Focus)]);
    rig.twin.receive(b"$22=1\n");
    let error = rig.focus.home(rig.focus.generation()).await.unwrap_err();
    assert!(error.to_string().contains("the e axis too"), "{error}");
    assert_eq!([rig.slides.at(0), rig.slides.at(1)], START);
    assert_eq!(rig.focus.homes_also(), Some(AxisName::E));
    rig.focus.home(rig.focus.generation()).await.unwrap();
    assert!(near(rig.slides.at(0), 0.0, 0.004) && near(rig.slides.at(1), 30.0, 0.004));
    // And where home is made zero from then on.
    rig.twin.receive(b"$22=11\n");
    rig.e.home(rig.e.generation()).await.unwrap();
    assert!(near(rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap().value(), 20.0, 0.003));
    assert_eq!(rig.focus.homes_also(), None);
}

/// Shortened jogs, and homing that leaves an axis out and would count it as homed where it stands.
#[tokio::test(start_paused = true)]
async fn settings_that_make_another_motion_of_one_move_nothing() {
    for (before, set, mend, words) in
        [(&b""[..], &b"$40=1\n"[..], &b"$40=0\n"[..], "$40=0"), (b"$22=9\n", b"$45=1\n", b"$45=3\n", "$44 to $49")]
    {
        let kit = kit(|_| {});
        kit.twin.receive(before);
        kit.twin.receive(set);
        let rig = kit.connect().await.unwrap();
        let error = rig.e.home(rig.e.generation()).await.unwrap_err();
        assert!(error.to_string().contains(words), "{error}");
        assert_eq!([rig.slides.at(0), rig.slides.at(1)], START);
        rig.twin.receive(mend);
        told(&rig, "set right", |contradictions| contradictions.is_empty()).await;
        rig.e.home(rig.e.generation()).await.unwrap();
        rig.twin.receive(set);
        told(&rig, "set wrong", |contradictions| contradictions.join(" ").contains(words)).await;
        let error = rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap_err();
        assert!(error.to_string().contains(words), "{error}");
        assert!(near(rig.slides.at(1), 30.0, 0.004));
    }
}

/// Waits for what is said of the e axis: settings are read again where another may have changed them.
async fn told(rig: &Rig, what: &str, is: impl Fn(Vec<String>) -> bool) {
    let said = until(what, async || is(rig.e.info().contradictions));
    timeout(Duration::from_secs(20), said).await.unwrap_or_else(|_| panic!("it is never {what}"));
}

/// What a jog beyond the limits comes to on such a controller.
#[tokio::test(start_paused = true)]
async fn the_twin_shortens_jogs_where_it_is_set_to() {
    let rig = kit(|_| {}).homed().await;
    rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap();
    rig.twin.receive(b"$J=G90 G21 Y50 F300\n");
    assert!(rig.e.read_state().await.unwrap().at_rest_since.is_some(), "it is refused");
    rig.twin.receive(b"$40=1\n$J=G90 G21 Y50 F300\n");
    wait_for(&rig.e, "at its limit", |state| near(state.position.value(), 30.0, 0.003)).await;
}
