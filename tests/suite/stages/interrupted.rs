//! Motion that another command than the driver's interrupts, and what a controller says by itself.

use std::time::Duration;

use plenalign::device::{DeviceError, Stage, StopDelivery};
use plenalign::sim::stage::Protocol;
use plenalign::units::Millimetres;

use super::super::until::elapse;
use super::kit::{homed, near};

#[tokio::test(start_paused = true)]
async fn a_zaber_move_that_another_command_interrupts_says_so_and_keeps_the_position() {
    // Another program's: a move elsewhere, a speed that a stop ends, a stop.
    for others in [&["/1 2 move rel 20000\n"] as &[&str], &["/1 2 move vel 16384\n", "/1 2 stop\n"], &["/1 2 stop\n"]] {
        let rig = homed(Protocol::Zaber).await;
        let moving = tokio::spawn({
            let stage = rig.e.clone();
            async move { stage.move_to(Millimetres(10.0), stage.generation()).await }
        });
        for other in others {
            elapse(Duration::from_secs(1)).await;
            rig.twin.receive(other.as_bytes());
        }
        let error = moving.await.unwrap().unwrap_err();
        let said = error.to_string();
        assert!(
            matches!(error, DeviceError::Refused { .. }) && said.contains("NI: ") && said.contains("10.000"),
            "{said}"
        );
        let state = rig.e.read_state().await.unwrap();
        assert!(state.homed && !state.moving && state.fault.is_none(), "{state:?}");
        assert!(near(state.position.value(), rig.slides.at(1), 0.003), "{state:?} at {}", rig.slides.at(1));
        // What comes next is as ever.
        assert!(near(rig.e.move_to(Millimetres(12.0), rig.e.generation()).await.unwrap().value(), 12.0, 0.003));
    }
}

#[tokio::test(start_paused = true)]
async fn zaber_alerts_that_another_program_switched_on_disturb_nothing() {
    let rig = homed(Protocol::Zaber).await;
    rig.twin.receive(b"/1 set comm.alert 1\n");
    for target in [25.0, 24.0, 24.9] {
        assert!(near(rig.e.move_to(Millimetres(target), rig.e.generation()).await.unwrap().value(), target, 0.003));
    }
    let moving = tokio::spawn({
        let stage = rig.e.clone();
        async move { stage.move_to(Millimetres(10.0), stage.generation()).await }
    });
    elapse(Duration::from_secs(1)).await;
    assert_eq!(rig.e.stop().await, StopDelivery::Confirmed);
    assert!(matches!(moving.await.unwrap(), Err(DeviceError::Stopped { .. })));
    let state = rig.e.read_state().await.unwrap();
    assert!(state.homed && near(state.position.value(), rig.slides.at(1), 0.003), "{state:?}");
    rig.focus.home(rig.focus.generation()).await.unwrap();
    assert!(near(rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap().value(), 20.0, 0.003));
}
