//! What real Grbl firmware does to its driver, on a twin that does the same: both switches of an axis on one pin, both
//! axes homed in one block, stops that take what is buffered first, half a second of deafness after each alarm.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use plenalign::config::{BenchConfig, Side};
use plenalign::device::{DeviceError, Stage, StopDelivery};
use plenalign::sim::stage::Protocol;
use plenalign::sim::stage::grbl::{FirmwareConfig, GrblFirmware};
use plenalign::sim::stage::{ControllerTwin, PULL_OFF_MM};
use plenalign::units::Millimetres;
use tokio::time::{Instant, timeout};

use super::super::until::{elapse, until};
use super::kit::{Behind, Kit, Rig, START, near, wait_for};

/// Where e's far switch closes on these slides: a millimetre beyond its limit of travel.
const FAR_SWITCH: f64 = -6.0;

/// A bench whose twin was built as `change` says, its axes standing where `start` says.
fn kit(start: [f64; 2], change: impl FnOnce(&mut FirmwareConfig)) -> Kit {
    Kit::grbl(Protocol::Grbl, BenchConfig::default(), start, change)
}

/// Runs e into its far switch: its motor has lost 25 mm of steps.
async fn run_into_the_far_switch(rig: &Rig) {
    rig.e.move_to(Millimetres(0.0), rig.e.generation()).await.unwrap();
    rig.twin.stall(1, true);
    rig.e.move_to(Millimetres(25.0), rig.e.generation()).await.unwrap();
    rig.twin.stall(1, false);
    let error = rig.e.move_to(Millimetres(10.0), rig.e.generation()).await.unwrap_err();
    assert!(matches!(&error, DeviceError::Alarm { reason, .. } if reason.contains("far switch")), "{error}");
    assert!(near(rig.slides.at(1), FAR_SWITCH, 0.05), "{}", rig.slides.at(1));
}

#[tokio::test(start_paused = true)]
async fn homing_from_the_far_switch_moves_nothing() {
    for single_axis_homing in [false, true] {
        let kit = kit([1.3, 20.4], |config| config.single_axis_homing = single_axis_homing);
        let rig = kit.homed().await;
        run_into_the_far_switch(&rig).await;
        let stood = rig.slides.at(1);
        for _ in 0..3 {
            let error = rig.e.home(rig.e.generation()).await.unwrap_err();
            assert!(matches!(&error, DeviceError::Refused { reason, .. } if reason.contains("switch")), "{error}");
            assert_eq!(rig.e.stop().await, StopDelivery::Confirmed);
        }
        assert_eq!(rig.slides.at(1), stood, "not by a micrometre towards the shell");
        // The other axis is homed by itself where the controller can.
        assert_eq!(rig.focus.home(rig.focus.generation()).await.is_ok(), single_axis_homing);
        assert_eq!(rig.slides.at(1), stood);
    }
}

#[tokio::test(start_paused = true)]
async fn a_stop_at_speed_keeps_the_reference_whenever_it_comes() {
    let kit = kit([1.3, 20.4], |_| {});
    // The firmware's own default, by which it says nothing for a while after each motion.
    kit.twin.receive(b"$1=25\n");
    let rig = kit.homed().await;
    for n in 0..24 {
        let (from, to) = if n % 2 == 0 { (28.0, 5.0) } else { (5.0, 28.0) };
        rig.e.move_to(Millimetres(from), rig.e.generation()).await.unwrap();
        let mover = rig.e.clone();
        let moving = tokio::spawn(async move { mover.move_to(Millimetres(to), mover.generation()).await });
        elapse(Duration::from_millis(320 + 17 * n)).await;
        assert_eq!(rig.e.stop().await, StopDelivery::Confirmed, "{n}");
        assert!(moving.await.unwrap().is_err(), "{n}");
        let state = rig.e.read_state().await.unwrap();
        assert!(state.homed && near(state.position.value(), rig.slides.at(1), 0.004), "{n}: {state:?}");
        assert!(rig.focus.state().borrow().homed, "{n}");
    }
}

#[tokio::test(start_paused = true)]
async fn homing_both_axes_takes_as_long_as_the_slower_one_needs() {
    let kit = kit([4.0, -1.0], |config| {
        config.single_axis_homing = false;
        if let Some(focus) = &mut config.axes[0] {
            focus.max_rate_mm_per_min = 30.0;
        }
    });
    let rig = kit.connect().await.unwrap();
    let began = Instant::now();
    rig.e.home(rig.e.generation()).await.unwrap();
    // 33 mm at 0.5 mm/s.
    assert!(began.elapsed() > Duration::from_secs(66), "{:?}", began.elapsed());
    assert!(near(rig.slides.at(0), 0.0, 0.003) && near(rig.slides.at(1), 30.0, 0.003));
}

#[tokio::test(start_paused = true)]
async fn homing_without_an_end_is_ended_by_what_ends_homing_and_nothing_before_it() {
    let mut kit = kit([1.3, 20.4], |_| {});
    let config = FirmwareConfig::for_axes(&[&kit.bench.focus, &kit.bench.e]);
    // What it was sent since nothing in its homing comes to an end any more.
    let sent: Arc<Mutex<Option<Vec<u8>>>> = Arc::default();
    let (hearing, waiting) = (sent.clone(), sent.clone());
    kit.twin = ControllerTwin::new(Behind {
        hears: Box::new(move |byte| {
            hearing.lock().unwrap().iter_mut().for_each(|sent| sent.push(byte));
            vec![byte]
        }),
        waits: Box::new(move |seconds| {
            let homing = waiting.lock().unwrap().as_ref().is_some_and(|sent| !sent.contains(&0x18));
            if homing { seconds / 1000.0 } else { seconds }
        }),
        ..Behind::new(GrblFirmware::new(config, kit.slides.clone()))
    });
    let rig = kit.connect().await.unwrap();
    let homing = {
        let stage = rig.e.clone();
        tokio::spawn(async move { stage.home(stage.generation()).await })
    };
    wait_for(&rig.e, "moving", |state| state.moving).await;
    elapse(Duration::from_millis(50)).await;
    *sent.lock().unwrap() = Some(Vec::new());
    let error = homing.await.unwrap().unwrap_err();
    assert!(matches!(error, DeviceError::Timeout { .. }), "{error}");
    let sent = sent.lock().unwrap().clone().unwrap();
    assert_eq!(sent.first(), Some(&0x18), "{}", String::from_utf8_lossy(&sent));
    assert!(!rig.e.state().borrow().homed && !rig.e.state().borrow().moving);
    assert_eq!(rig.e.home(rig.e.generation()).await, Ok(()), "and it can be homed then");
}

#[tokio::test(start_paused = true)]
async fn a_reset_that_falls_into_an_alarms_message_is_given_again() {
    let kit = kit([1.3, 20.4], |_| {});
    for wait_ms in [0, 100, 400, 600] {
        let rig = kit.homed().await;
        let mover = rig.e.clone();
        let moving = tokio::spawn(async move { mover.move_to(Millimetres(5.0), mover.generation()).await });
        elapse(Duration::from_millis(700)).await;
        // Steps that the motor did not make bring the home switch early.
        rig.twin.stall(1, true);
        moving.await.unwrap().unwrap();
        rig.twin.stall(1, false);
        assert!(rig.e.move_to(Millimetres(30.0), rig.e.generation()).await.is_err(), "the switch is hit");
        elapse(Duration::from_millis(wait_ms)).await;
        assert_eq!(rig.e.stop().await, StopDelivery::Confirmed, "{wait_ms}");
        assert_eq!(rig.e.home(rig.e.generation()).await, Ok(()), "{wait_ms}");
        drop(rig);
        elapse(Duration::from_millis(10)).await;
    }
}

/// Steps off until the switch lets go, or not.
async fn stepped_off(rig: &Rig, towards: Side) -> Result<usize, DeviceError> {
    for pieces in 0..100 {
        if rig.e.step_off(towards, 0.2, rig.e.generation()).await? {
            return Ok(pieces);
        }
    }
    panic!("it goes on and on");
}

#[tokio::test(start_paused = true)]
async fn the_way_off_the_far_switch_is_away_from_it_and_ends_where_it_lets_go() {
    for hard_limits in [true, false] {
        let kit = kit([1.3, 20.4], |config| config.single_axis_homing = false);
        let rig = kit.homed().await;
        run_into_the_far_switch(&rig).await;
        if !hard_limits {
            assert_eq!(rig.e.stop().await, StopDelivery::Confirmed);
            rig.twin.receive(b"$21=0\n");
        }
        let stood = rig.slides.at(1);
        assert!(stepped_off(&rig, Side::High).await.unwrap() <= 1);
        let stands = rig.slides.at(1);
        assert!(stands >= FAR_SWITCH && stands < stood + 0.41, "{stood} to {stands}");
        // Its stop is confirmed, and it is homed from there.
        assert_eq!(rig.e.stop().await, StopDelivery::Confirmed);
        rig.e.home(rig.e.generation()).await.unwrap();
        assert!(near(rig.slides.at(1), 30.0, 0.003), "{}", rig.slides.at(1));
        assert_eq!(rig.e.read_state().await.unwrap().fault, None);
    }
}

#[tokio::test(start_paused = true)]
async fn the_way_off_a_switch_is_three_millimetres_long_however_often_it_is_asked_for() {
    let kit = kit([1.3, 20.4], |_| {});
    let rig = kit.homed().await;
    run_into_the_far_switch(&rig).await;
    // A motor that does not turn: the switch stays pressed.
    rig.twin.stall(1, true);
    let error = stepped_off(&rig, Side::High).await.unwrap_err();
    assert!(matches!(&error, DeviceError::Refused { reason, .. } if reason.contains("by hand")), "{error}");
    rig.twin.stall(1, false);
    let stood = rig.slides.at(1);
    assert!(stepped_off(&rig, Side::High).await.is_err());
    assert_eq!(rig.slides.at(1), stood);
}

#[tokio::test(start_paused = true)]
async fn where_soft_limits_keep_an_axis_on_its_switch_no_setting_is_written() {
    // Powered up on its far switch, a controller counts from zero, and its soft limits allow the negative way only.
    let kit = kit([1.3, -6.5], |_| {});
    let rig = kit.connect().await.unwrap();
    let barred = rig.e.home(rig.e.generation()).await.unwrap_err();
    assert!(barred.to_string().contains("leave-switch"), "{barred}");
    let fault = rig.e.read_state().await.unwrap().fault;
    assert!(fault.as_ref().is_some_and(|fault| fault.contains("limit switch")), "{fault:?}");
    let error = rig.e.step_off(Side::High, 0.2, rig.e.generation()).await.unwrap_err();
    assert!(
        matches!(&error, DeviceError::Refused { reason, .. } if reason.contains("$20") && reason.contains("by hand"))
    );
    assert_eq!(rig.slides.at(1), -6.5);
    assert!(rig.e.info().disagreements.is_empty(), "its soft limits are on still");
}

#[tokio::test(start_paused = true)]
async fn an_axis_that_ran_into_its_home_switch_is_homed_from_there() {
    let kit = kit([1.3, 20.4], |_| {});
    let rig = kit.homed().await;
    rig.twin.stall(0, true);
    rig.focus.move_to(Millimetres(4.0), rig.focus.generation()).await.unwrap();
    rig.twin.stall(0, false);
    let error = rig.focus.move_to(Millimetres(-1.0), rig.focus.generation()).await.unwrap_err();
    assert!(error.to_string().contains("home switch"), "{error}");
    assert_eq!(rig.focus.stop().await, StopDelivery::Confirmed);
    rig.focus.home(rig.focus.generation()).await.unwrap();
    assert!(near(rig.slides.at(0), 0.0, 0.003));
}

#[tokio::test(start_paused = true)]
async fn a_move_onto_the_home_switch_is_refused_and_costs_no_reference() {
    let near = "from its home switch";
    let clear = kit([1.3, 20.4], |_| {});
    assert!(!clear.homed().await.e.info().disagreements.join(" ").contains(near), "a millimetre is far enough");
    let mut kit = kit([1.3, 20.4], |_| {});
    let (focus, e) = (&mut kit.bench.focus, &mut kit.bench.e);
    focus.low_limit_mm = focus.home_position_mm - PULL_OFF_MM;
    e.high_limit_mm = e.home_position_mm + PULL_OFF_MM;
    let rig = kit.homed().await;
    for (stage, limit) in [(&rig.e, kit.bench.e.high_limit_mm), (&rig.focus, kit.bench.focus.low_limit_mm)] {
        let told = stage.info().disagreements.join(" ");
        assert!(told.contains(near) && told.contains("_limit_mm = ") && told.contains("$27"), "{told}");
        let error = stage.move_to(Millimetres(limit), stage.generation()).await.unwrap_err();
        assert!(
            matches!(&error, DeviceError::Refused { reason, .. } if reason.contains("home switch trips")),
            "{error}"
        );
        assert!(stage.read_state().await.unwrap().homed);
    }
    assert!(rig.e.move_to(Millimetres(31.5), rig.e.generation()).await.is_ok(), "beside it is as good as anywhere");
}

#[tokio::test(start_paused = true)]
async fn what_ends_a_move_is_said_in_words() {
    let kit = kit([1.3, 20.4], |_| {});
    let rig = kit.homed().await;
    for (end, words) in [(&b"!"[..], "hold"), (b"", "restarted")] {
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
        assert!(error.to_string().contains(words), "{error}");
        assert!(!error.to_string().contains("cannot be understood"), "{error}");
    }
    assert!(!rig.e.state().borrow().homed && rig.slides.at(1) > 20.0);
}

/// grblHAL whose reports leave the pins out would be homed from a far switch.
#[tokio::test(start_paused = true)]
async fn a_controller_that_does_not_report_its_pins_moves_nothing() {
    let kit = Kit::new(Protocol::GrblHal);
    kit.twin.receive(b"$10=1\n");
    let rig = kit.connect().await.unwrap();
    for stage in [&rig.focus, &rig.e] {
        let error = stage.home(stage.generation()).await.unwrap_err();
        assert!(error.to_string().contains("set $10=17"), "{error}");
    }
    assert_eq!([rig.slides.at(0), rig.slides.at(1)], START);
}

/// Asleep, its motors are off.
#[tokio::test(start_paused = true)]
async fn a_controller_that_another_program_put_to_sleep_has_lost_its_positions() {
    let rig = kit([1.3, 20.4], |_| {}).homed().await;
    rig.twin.receive(b"$SLP\n");
    wait_for(&rig.e, "unknown", |state| !state.homed).await;
    assert_eq!(rig.e.stop().await, StopDelivery::Confirmed);
    assert!(!rig.focus.state().borrow().homed && !rig.e.state().borrow().homed);
}

#[tokio::test(start_paused = true)]
async fn settings_that_another_program_changes_are_noticed_before_the_next_motion() {
    let kit = kit([1.3, 20.4], |_| {});
    let rig = kit.homed().await;
    rig.twin.receive(b"$101=800\n");
    // Its answer comes unasked for.
    elapse(Duration::from_millis(500)).await;
    let stood = rig.slides.at(1);
    let error = rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap_err();
    assert!(error.to_string().contains("$101"), "{error}");
    assert_eq!(rig.slides.at(1), stood);
    assert!(rig.e.info().contradictions.join(" ").contains("$101"));
    assert!(!rig.e.state().borrow().homed, "a step is another length now");
    rig.twin.receive(b"$101=400\n$1=25\n$21=0\n");
    let agreed = until("nothing contradicts", async || rig.e.info().contradictions.is_empty());
    timeout(Duration::from_secs(10), agreed).await.expect("it is told, too, once it is set right");
    rig.e.home(rig.e.generation()).await.unwrap();
    let told = rig.e.info().disagreements.join(" ");
    assert!(told.contains("$1=255") && told.contains("$21=1"), "{told}");
    assert!(near(rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap().value(), 20.0, 0.003));
}
