//! What grblHAL has of its own, on its twin: soft limits that keep a pull-off from the switches.

use plenalign::config::AxisConfig;
use plenalign::device::{DeviceError, Stage};
use plenalign::sim::plant::Slides;
use plenalign::sim::stage::grbl::{FirmwareConfig, GrblFirmware};
use plenalign::sim::stage::{ControllerTwin, PULL_OFF_MM, Protocol};
use plenalign::units::Millimetres;

use super::kit::{Kit, Rig, START, bench, near};

/// A kit whose twin is set as `change` says.
fn kit(change: impl FnOnce(&mut FirmwareConfig)) -> Kit {
    let mut bench = bench(Protocol::GrblHal);
    for axis in [&mut bench.focus, &mut bench.e] {
        axis.accept_wider_firmware_limits = true;
    }
    let axes: [(&AxisConfig, f64); 2] = [(&bench.focus, START[0]), (&bench.e, START[1])];
    let slides = Slides::new(&axes);
    let mut config = FirmwareConfig::grblhal(&[&bench.focus, &bench.e]);
    change(&mut config);
    let twin = ControllerTwin::new(GrblFirmware::new(config, slides.clone()));
    Kit { driver: Protocol::GrblHal, bench, slides, twin }
}

async fn homed(kit: &Kit) -> Rig {
    let rig = kit.connect().await.unwrap();
    rig.focus.home(rig.focus.generation()).await.unwrap();
    rig.e.home(rig.e.generation()).await.unwrap();
    rig
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
    let rig = homed(&kit(|_| {})).await;
    let (focus, e) = ((0.0, 5.0), (-5.0, 30.0));
    limits_are(&rig, [focus, e]).await;
    for (stage, (low, high)) in [(&rig.focus, focus), (&rig.e, e)] {
        for end in [low, high] {
            stage.move_to(Millimetres(end), stage.generation()).await.unwrap();
        }
    }
    let rig = homed(&kit(|config| config.hard_limits = false)).await;
    let off = PULL_OFF_MM;
    limits_are(&rig, [(focus.0 - off, focus.1 + off), (e.0 - off, e.1 + off)]).await;
}
