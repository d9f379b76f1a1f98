//! What every driver does on a good day: identify, home, move, stop, jog, refuse.

use std::sync::Arc;
use std::time::Duration;

use plenalign::device::jog::{Next, deadman, jog};
use plenalign::device::{AxisName, DeviceError, Stage, StopDelivery};
use plenalign::sim::stage::{PULL_OFF_MM, Protocol};
use plenalign::units::Millimetres;
use tokio::time::{Instant, timeout};

use super::super::until::elapse;
use super::kit::{Kit, START, bench, every_protocol, homed, near};

every_protocol!(
    it_says_what_it_is_and_moves_nothing_before_homing,
    homing_and_moves_end_where_they_say_and_when,
    a_stop_in_mid_move_takes_its_deceleration_and_keeps_the_position,
    a_stop_passes_what_waits,
    a_crowd_of_stops_takes_no_longer_than_two,
    a_stop_while_homing_leaves_the_position_unknown,
    a_motion_commanded_during_a_stop_begins_after_it,
    a_slower_move_is_slower,
    a_jog_goes_on_while_it_is_held,
    dropping_the_caller_of_a_move_leaves_it_in_step,
    a_released_motor_has_to_be_homed,
    a_position_is_set_where_the_controller_can_do_without_homing,
    the_state_is_renewed_five_times_a_second_in_motion,
    wider_limits_are_refused_until_accepted,
    a_target_beyond_the_controllers_limits_is_refused_without_motion,
);

async fn it_says_what_it_is_and_moves_nothing_before_homing(driver: Protocol) {
    let kit = Kit::new(driver);
    let rig = kit.connect().await.unwrap();
    let info = rig.focus.info();
    let identity = match driver {
        Protocol::Grbl => "Grbl 1.1h",
        Protocol::GrblHal => "GrblHAL 1.1f",
        Protocol::FluidNc => "FluidNC v3.9.1",
        Protocol::Zaber => "Zaber device 50081, serial number 104233, firmware 7.36",
        Protocol::Pi => "(c)2013 Physik Instrumente (PI) GmbH & Co. KG, C-863.12, 0115500218, 1.2.5.3",
        Protocol::Tmcl => "TMCM-6214, firmware 1.07",
        Protocol::Thorlabs => "Thorlabs BSC203, serial number 70184932, firmware 2.1.9",
    };
    assert_eq!((info.identity.as_str(), info.driver.as_str()), (identity, driver.driver().name()));
    assert_eq!(info.disagreements, Vec::<String>::new());
    assert_eq!(rig.e.info().disagreements, Vec::<String>::new());
    let limits = info.firmware_limits.map(|(low, high)| (low.value(), high.value()));
    if driver == Protocol::Tmcl {
        assert_eq!(limits, None, "TMCL has none in numbers");
    } else {
        let (low, high) = limits.unwrap();
        // Grbl's own limit on the home side is the switch.
        let low_end = match driver {
            Protocol::Grbl => kit.bench.focus.home_position_mm - PULL_OFF_MM,
            _ => kit.bench.focus.low_limit_mm,
        };
        assert!(near(low, low_end, 1e-3) && near(high, 5.0, 1e-3), "{low} {high}");
    }
    let state = rig.e.read_state().await.unwrap();
    assert!(state.connected && !state.homed && !state.moving, "{state:?}");
    assert_eq!(
        rig.focus.move_to(Millimetres(1.0), rig.focus.generation()).await,
        Err(DeviceError::NotHomed { axis: AxisName::Focus })
    );
    assert_eq!([rig.slides.at(0), rig.slides.at(1)], START);
}

async fn homing_and_moves_end_where_they_say_and_when(driver: Protocol) {
    let rig = Kit::new(driver).connect().await.unwrap();
    rig.focus.home(rig.focus.generation()).await.unwrap();
    assert!(near(rig.slides.at(0), 0.0, 0.004), "{}", rig.slides.at(0));
    assert_eq!(rig.slides.at(1), START[1], "the other axis is left alone");
    assert!(!rig.e.read_state().await.unwrap().homed);
    rig.e.home(rig.e.generation()).await.unwrap();
    assert!(near(rig.slides.at(1), 30.0, 0.004), "{}", rig.slides.at(1));
    let mut from = Millimetres(0.0);
    for target in [0.7, 0.05, 4.9, 4.9] {
        let target = Millimetres(target);
        let (time, began) = (rig.focus.move_time(from, target), Instant::now());
        let readback = rig.focus.move_to(target, rig.focus.generation()).await.unwrap();
        let took = began.elapsed();
        assert!(near(readback.value(), target.value(), 0.003), "{readback}");
        assert!(near(rig.slides.at(0), target.value(), 0.006), "{}", rig.slides.at(0));
        // The end is seen by two readings, a tenth of a second each and more.
        let longest = time.predicted + Duration::from_millis(600);
        assert!(took + Duration::from_millis(5) >= time.predicted && took < longest, "{took:?} against {time:?}");
        from = target;
    }
    let readback = rig.e.move_to(Millimetres(12.0), rig.e.generation()).await.unwrap();
    assert!(near(readback.value(), 12.0, 0.003) && near(rig.slides.at(1), 12.0, 0.006), "{readback}");
    let state = rig.e.read_state().await.unwrap();
    assert!(state.homed && state.connected && !state.moving && state.at_rest_since.is_some(), "{state:?}");
    assert_eq!(state.fault, None);
}

async fn a_stop_in_mid_move_takes_its_deceleration_and_keeps_the_position(driver: Protocol) {
    let rig = homed(driver).await;
    let mover = rig.e.clone();
    let moving = tokio::spawn(async move { mover.move_to(Millimetres(5.0), mover.generation()).await });
    elapse(Duration::from_secs(2)).await;
    assert!(rig.e.state().borrow().moving);
    let (asked, at) = (Instant::now(), rig.slides.at(1));
    // When the motor really stands still, a millisecond resolved.
    let slides = rig.slides.clone();
    let still = tokio::spawn(async move {
        let mut last = slides.at(1);
        let mut since = Instant::now();
        loop {
            elapse(Duration::from_millis(5)).await;
            if slides.at(1) != last {
                (last, since) = (slides.at(1), Instant::now());
            } else if since.elapsed() > Duration::from_millis(100) {
                return since;
            }
        }
    });
    assert_eq!(rig.e.stop().await, StopDelivery::Confirmed);
    assert!(asked.elapsed() < Duration::from_millis(1000), "{:?}", asked.elapsed());
    let latency = still.await.unwrap() - asked;
    // 5 mm/s at 20 mm/s² are 250 ms; Grbl carries out 50 ms before that, FluidNC 120.
    let (buffered, way) = match driver {
        Protocol::Grbl | Protocol::GrblHal => (50, 0.875),
        Protocol::FluidNc => (120, 1.225),
        _ => (0, 0.625),
    };
    assert!(latency < Duration::from_millis(290 + buffered), "{latency:?}");
    let stopped = rig.slides.at(1);
    assert!(near(stopped, at, way + 0.075), "5 mm/s and 20 mm/s² make {way} mm: {at} to {stopped}");
    assert_eq!(moving.await.unwrap(), Err(DeviceError::Stopped { axis: AxisName::E }));
    elapse(Duration::from_secs(5)).await;
    assert_eq!(rig.slides.at(1), stopped);
    let state = rig.e.read_state().await.unwrap();
    assert!(state.homed && near(state.position.value(), stopped, 0.004), "{state:?}");
    assert_eq!(state.fault, None);
    // It goes on from there.
    let readback = rig.e.move_to(Millimetres(25.0), rig.e.generation()).await.unwrap();
    assert!(near(readback.value(), 25.0, 0.003) && near(rig.slides.at(1), 25.0, 0.006));
}

async fn a_stop_passes_what_waits(driver: Protocol) {
    let rig = homed(driver).await;
    let first = tokio::spawn({
        let stage = rig.e.clone();
        async move { stage.move_to(Millimetres(5.0), stage.generation()).await }
    });
    elapse(Duration::from_millis(500)).await;
    let second = tokio::spawn({
        let stage = rig.e.clone();
        async move { stage.move_to(Millimetres(29.0), stage.generation()).await }
    });
    elapse(Duration::from_millis(10)).await;
    // In the same moment as the stop, before its task can have run.
    let third = rig.focus.move_to(Millimetres(3.0), rig.focus.generation());
    let (third, a, b) = tokio::join!(third, rig.focus.stop(), rig.e.stop());
    assert_eq!((a, b), (StopDelivery::Confirmed, StopDelivery::Confirmed));
    assert_eq!(third, Err(DeviceError::Stopped { axis: AxisName::Focus }));
    assert_eq!(first.await.unwrap(), Err(DeviceError::Stopped { axis: AxisName::E }));
    assert_eq!(second.await.unwrap(), Err(DeviceError::Stopped { axis: AxisName::E }));
    let at = [rig.slides.at(0), rig.slides.at(1)];
    elapse(Duration::from_secs(5)).await;
    assert_eq!([rig.slides.at(0), rig.slides.at(1)], at);
    assert!(near(at[0], 0.0, 0.004), "the focus axis never began: {}", at[0]);
    assert_eq!(rig.focus.stop().await, StopDelivery::Confirmed, "at rest, too");
    assert!(rig.focus.read_state().await.unwrap().homed);
}

/// However many ask for a stop at once, and whether or not they wait for its answer.
async fn a_crowd_of_stops_takes_no_longer_than_two(driver: Protocol) {
    let rig = homed(driver).await;
    let mut took = Vec::new();
    for (crowd, target) in [(1, 5.0), (40, 29.0)] {
        let moving = tokio::spawn({
            let stage = rig.e.clone();
            async move { stage.move_to(Millimetres(target), stage.generation()).await }
        });
        elapse(Duration::from_millis(500)).await;
        let from = Instant::now();
        let stop = |_| {
            let stage = rig.e.clone();
            tokio::spawn(async move { stage.stop().await })
        };
        for stopped in (0..crowd).map(stop).collect::<Vec<_>>() {
            assert_eq!(stopped.await.unwrap(), StopDelivery::Confirmed);
        }
        took.push(from.elapsed());
        assert_eq!(moving.await.unwrap(), Err(DeviceError::Stopped { axis: AxisName::E }));
    }
    assert!(
        took[1] < 3 * took[0],
        "{driver:?}: one is answered after {:?}, the last of a crowd after {:?}",
        took[0],
        took[1]
    );
}

async fn a_stop_while_homing_leaves_the_position_unknown(driver: Protocol) {
    let rig = Kit::new(driver).connect().await.unwrap();
    let homing = tokio::spawn({
        let stage = rig.e.clone();
        async move { stage.home(stage.generation()).await }
    });
    elapse(Duration::from_secs(1)).await;
    assert!(rig.e.state().borrow().moving);
    assert_eq!(rig.e.stop().await, StopDelivery::Confirmed);
    let at = rig.slides.at(1);
    assert_eq!(homing.await.unwrap(), Err(DeviceError::Stopped { axis: AxisName::E }));
    elapse(Duration::from_secs(3)).await;
    assert_eq!(rig.slides.at(1), at);
    assert!(!rig.e.read_state().await.unwrap().homed);
    rig.e.home(rig.e.generation()).await.unwrap();
    assert!(near(rig.slides.at(1), 30.0, 0.004));
}

async fn a_motion_commanded_during_a_stop_begins_after_it(driver: Protocol) {
    let rig = homed(driver).await;
    for delay_ms in [0, 90, 250] {
        let (delivery, reached) = tokio::join!(rig.focus.stop(), async {
            elapse(Duration::from_millis(delay_ms)).await;
            // Not the very moment of the stop: what is commanded then is stopped.
            rig.e.move_to(Millimetres(30.0), rig.e.generation()).await
        });
        assert_eq!(delivery, StopDelivery::Confirmed);
        assert!(reached.is_ok(), "a move commanded {delay_ms} ms after the stop: {reached:?}");
    }
}

async fn a_slower_move_is_slower(driver: Protocol) {
    let rig = homed(driver).await;
    let began = Instant::now();
    rig.e.move_at(Millimetres(29.0), 0.5, rig.e.generation()).await.unwrap();
    assert!(began.elapsed() > Duration::from_millis(1950), "{:?}", began.elapsed());
    for speed in [0.0, -1.0, f64::NAN] {
        assert!(
            matches!(
                rig.e.move_at(Millimetres(28.0), speed, rig.e.generation()).await,
                Err(DeviceError::Refused { .. })
            ),
            "{speed}"
        );
    }
    assert!(near(rig.slides.at(1), 29.0, 0.006));
}

async fn a_jog_goes_on_while_it_is_held(driver: Protocol) {
    let rig = homed(driver).await;
    let stage: Arc<dyn Stage> = Arc::new(rig.e.clone());
    let hold = Duration::from_millis(500);
    let (grip, dead) = deadman(hold);
    let to_ten = |_| Ok::<_, DeviceError>(Next { to: Millimetres(10.0), speed_mm_per_s: 2.0 });
    let jogging = tokio::spawn({
        let stage = stage.clone();
        async move { jog(&stage, Millimetres(10.0), dead, stage.generation(), to_ten).await }
    });
    for _ in 0..8 {
        elapse(Duration::from_millis(250)).await;
        grip.renew(hold);
    }
    assert!(rig.e.state().borrow().moving, "held for two seconds");
    let at = rig.slides.at(1);
    assert!(near(at, 26.1, 0.4), "{at}");
    // Nobody renews it: half a second on, and the deceleration.
    let reached = timeout(Duration::from_secs(3), jogging).await.unwrap().unwrap().unwrap();
    assert!(near(reached.value(), rig.slides.at(1), 0.004), "{reached}");
    assert!(rig.slides.at(1) > at - 1.4 && rig.slides.at(1) < at - 0.9, "{at} to {}", rig.slides.at(1));
    drop(grip);

    // Dropped, with its caller: it stops at once.
    let (grip, dead) = deadman(Duration::from_secs(60));
    let caller = tokio::spawn(async move { jog(&stage, Millimetres(10.0), dead, stage.generation(), to_ten).await });
    elapse(Duration::from_secs(1)).await;
    // What FluidNC has worked out ahead is 70 ms more than Grbl's.
    let way = if driver == Protocol::FluidNc { 0.45 } else { 0.3 };
    caller.abort();
    drop(grip);
    let at = rig.slides.at(1);
    elapse(Duration::from_secs(3)).await;
    assert!(near(rig.slides.at(1), at, way) && !rig.e.state().borrow().moving, "{at} to {}", rig.slides.at(1));
}

async fn dropping_the_caller_of_a_move_leaves_it_in_step(driver: Protocol) {
    let rig = homed(driver).await;
    assert!(timeout(Duration::from_millis(700), rig.e.move_to(Millimetres(20.0), rig.e.generation())).await.is_err());
    let readback = rig.e.move_to(Millimetres(22.0), rig.e.generation()).await.unwrap();
    assert!(near(readback.value(), 22.0, 0.003) && near(rig.slides.at(1), 22.0, 0.006));
}

async fn a_released_motor_has_to_be_homed(driver: Protocol) {
    let rig = homed(driver).await;
    rig.e.release(rig.e.generation()).await.unwrap();
    assert!(!rig.e.read_state().await.unwrap().homed);
    let refused = rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap_err();
    assert!(matches!(refused, DeviceError::NotHomed { .. } | DeviceError::Alarm { .. }), "{refused}");
    assert!(near(rig.slides.at(1), 30.0, 0.004));
    rig.e.home(rig.e.generation()).await.unwrap();
    assert!(near(rig.e.move_to(Millimetres(20.0), rig.e.generation()).await.unwrap().value(), 20.0, 0.003));
}

async fn a_position_is_set_where_the_controller_can_do_without_homing(driver: Protocol) {
    let rig = Kit::new(driver).connect().await.unwrap();
    let set = rig.e.set_position(Millimetres(START[1]), rig.e.generation()).await;
    if matches!(driver, Protocol::Zaber | Protocol::Pi | Protocol::Thorlabs) {
        assert!(matches!(&set, Err(DeviceError::Refused { reason, .. }) if reason.contains("home")), "{set:?}");
        assert!(!rig.e.read_state().await.unwrap().homed);
        return;
    }
    set.unwrap();
    let state = rig.e.read_state().await.unwrap();
    assert!(state.homed && near(state.position.value(), START[1], 1e-3), "{state:?}");
    assert_eq!(rig.slides.at(1), START[1], "nothing moves");
    // Machine space is negative on Grbl: unhomed, its soft limits allow that way only.
    let readback = rig.e.move_to(Millimetres(START[1] - 2.0), rig.e.generation()).await.unwrap();
    assert!(near(readback.value(), 18.4, 0.003) && near(rig.slides.at(1), 18.4, 0.006), "{readback}");
}

async fn the_state_is_renewed_five_times_a_second_in_motion(driver: Protocol) {
    let rig = homed(driver).await;
    let mover = rig.e.clone();
    let moving = tokio::spawn(async move { mover.move_to(Millimetres(15.0), mover.generation()).await });
    elapse(Duration::from_millis(500)).await;
    let (mut state, mut count, until) = (rig.e.state(), 0, Instant::now() + Duration::from_secs(2));
    let mut last = state.borrow().position;
    while tokio::time::timeout_at(until, state.changed()).await.is_ok() {
        let now = state.borrow_and_update().position;
        count += u32::from(now != last);
        last = now;
    }
    assert!(count >= 10, "{count} in two seconds");
    moving.await.unwrap().unwrap();
}

async fn wider_limits_are_refused_until_accepted(driver: Protocol) {
    if driver == Protocol::Tmcl {
        // It has no limits in numbers.
        return;
    }
    let mut kit = Kit::new(driver);
    kit.bench.e.low_limit_mm += 1.0;
    let rig = kit.connect().await.unwrap();
    let error = rig.e.home(rig.e.generation()).await.unwrap_err();
    assert!(error.to_string().contains("accept_wider_firmware_limits"), "{error}");
    assert_eq!(rig.slides.at(1), START[1]);
    let mut kit = Kit::with(driver, bench(driver));
    kit.bench.e.low_limit_mm += 1.0;
    kit.bench.e.accept_wider_firmware_limits = true;
    let rig = kit.connect().await.unwrap();
    let told = rig.e.info().disagreements.join(" ");
    assert!(told.contains("wider") && told.contains("-5.000"), "{told}");
    assert_eq!(rig.focus.info().disagreements, Vec::<String>::new());
    rig.e.home(rig.e.generation()).await.unwrap();
}

async fn a_target_beyond_the_controllers_limits_is_refused_without_motion(driver: Protocol) {
    if driver == Protocol::Tmcl {
        return;
    }
    let rig = homed(driver).await;
    let at = rig.slides.at(1);
    let error = rig.e.move_to(Millimetres(40.0), rig.e.generation()).await.unwrap_err();
    let words = match driver {
        Protocol::Grbl | Protocol::GrblHal => "error:15",
        Protocol::FluidNc => "beyond the travel",
        Protocol::Zaber => "BADDATA",
        Protocol::Thorlabs => "soft limits",
        _ => "error 7",
    };
    assert!(matches!(&error, DeviceError::Refused { reason, .. } if reason.contains(words)), "{error}");
    assert_eq!(rig.slides.at(1), at);
    assert!(rig.e.read_state().await.unwrap().homed);
    assert!(near(rig.e.move_to(Millimetres(29.0), rig.e.generation()).await.unwrap().value(), 29.0, 0.003));
}
