//! The motion rules over the simulated bench.

use std::sync::Arc;
use std::time::Duration;

use plenalign::config::Side;
use plenalign::control::events::ShellState;
use plenalign::control::{Refusal, ServiceError, open_bench};
use plenalign::device::AxisName;
use plenalign::device::jog::deadman;
use plenalign::units::Millimetres;
use tokio::time::Instant;

use super::bench::{rules, small_config};
use super::fakes::fakes;
use super::until::elapse;

#[tokio::test(start_paused = true)]
async fn a_jog_ends_at_the_wall_at_the_deadman_and_at_a_stop() {
    let config = small_config(1);
    let bench = open_bench(&Arc::new(config.clone())).await.unwrap();
    let (motion, admit) = rules(config, bench);
    let (_grip, dead) = deadman(Duration::from_secs(60));
    assert!(motion.jog(&admit(), AxisName::E, Side::Low, 5.0, dead).await.is_err(), "not homed");
    motion.home(&admit(), AxisName::E).await.unwrap();

    // Nobody holds it any more: it ends on its way.
    let (_grip, dead) = deadman(Duration::from_millis(400));
    let reached = motion.jog(&admit(), AxisName::E, Side::Low, 5.0, dead).await.unwrap().value();
    assert!(reached < 29.9 && reached > 28.0, "{reached}");

    // Held to the end: the wall, and not a hair further.
    let (_grip, dead) = deadman(Duration::from_secs(60));
    let reached = motion.jog(&admit(), AxisName::E, Side::Low, 5.0, dead).await.unwrap().value();
    let wall = motion.e_wall_reading_mm();
    assert!((reached - wall).abs() < 0.003, "{reached} at a wall of {wall}");
    let (_grip, dead) = deadman(Duration::from_secs(60));
    let again = motion.jog(&admit(), AxisName::E, Side::Low, 5.0, dead).await.unwrap().value();
    assert!((again - reached).abs() < 0.003, "{reached} to {again}");

    // A stop ends it whoever holds it, and keeps another from beginning.
    let jogging = tokio::spawn({
        let (motion, admission) = (Arc::clone(&motion), admit());
        let (grip, dead) = deadman(Duration::from_secs(60));
        async move {
            let _grip = grip;
            motion.jog(&admission, AxisName::E, Side::High, 2.0, dead).await
        }
    });
    elapse(Duration::from_secs(2)).await;
    motion.stop(Instant::now(), "a test").await;
    assert!(jogging.await.unwrap().is_err());
    let (_grip, dead) = deadman(Duration::from_secs(60));
    assert!(motion.jog(&admit(), AxisName::E, Side::High, 2.0, dead).await.is_err(), "the stop is latched");
}

/// Beyond its own limits a controller refuses in its own words, and some stop with an alarm: nothing is sent there.
#[tokio::test(start_paused = true)]
async fn an_axis_goes_no_further_than_its_controller_lets_it() {
    let mut config = small_config(1);
    config.bench.focus.low_limit_mm = -20.0;
    let bench = open_bench(&Arc::new(config.clone())).await.unwrap();
    let (motion, admit) = rules(config, bench);
    motion.home(&admit(), AxisName::Focus).await.unwrap();
    let (low, high) = motion.range_mm(AxisName::Focus);
    assert!(low > -20.0 && low < 0.0 && high > low, "{low} to {high}");
    let refused = motion.check(AxisName::Focus, Millimetres(low - 0.1)).unwrap_err();
    assert!(matches!(refused, ServiceError::Refused(Refusal::Limit { .. })), "{refused}");
    let (_grip, dead) = deadman(Duration::from_secs(60));
    let reached = motion.jog(&admit(), AxisName::Focus, Side::Low, 2.0, dead).await.unwrap().value();
    assert!((reached - low).abs() < 0.003, "{reached} where it may go to {low}");
}

/// Three standard uncertainties of its zero and scale together are not enough to have the lens touch.
#[tokio::test]
async fn a_hand_that_sees_no_picture_goes_no_nearer_than_the_axis_is_known() {
    for (zero_mm, scale) in [(0.2, 0.05), (0.2, 0.0), (0.0, 0.0), (0.02, 0.001), (0.5, 0.1), (1.0, 0.2)] {
        let mut config = small_config(1);
        (config.bench.e.zero_uncertainty_mm, config.bench.e.scale_uncertainty) = (zero_mm, scale);
        let (home_mm, contact_mm) = (config.bench.e.home_position_mm, config.assembly.contact_mm());
        let wall_mm = config.assembly.e_wall_mm(config.assembly.l_bound_mm);
        let fakes = fakes();
        let (motion, admit) = rules(config, fakes.bench);
        for shell in [ShellState::Unknown, ShellState::On] {
            motion.set_shell(shell);
            let nearest = motion.e_wall_reading_mm();
            assert_eq!(motion.range_mm(AxisName::E).0, nearest);
            for step in 0..64 {
                let angle = f64::from(step) * std::f64::consts::TAU / 64.0;
                let e_mm = nearest + 3.0 * (zero_mm * angle.sin() + (nearest - home_mm) * scale * angle.cos());
                assert!(e_mm > contact_mm - 1e-6, "±{zero_mm} mm, ±{scale}: at {nearest} e may be {e_mm}");
            }
            motion.go(&admit(), AxisName::E, Millimetres(nearest)).await.unwrap();
            let beyond = motion.go(&admit(), AxisName::E, Millimetres(nearest - 0.01)).await;
            let refused = matches!(&beyond, Err(ServiceError::Refused(Refusal::Wall { .. })));
            let untold = beyond.unwrap_err().to_string().contains("[bench.e]");
            assert!(refused && untold == (nearest > wall_mm), "±{zero_mm} mm, ±{scale}: {nearest}");
            assert_eq!(motion.is_e_untold(), untold);
        }
        // With no shell there is nothing to touch.
        motion.set_shell(ShellState::Off);
        assert_eq!((motion.e_wall_reading_mm(), motion.is_e_untold()), (wall_mm, false));
        // Where it is mounted after all, the lens is only taken back, as far as is asked and no further.
        motion.go(&admit(), AxisName::E, Millimetres(wall_mm)).await.unwrap();
        motion.set_shell(ShellState::On);
        let nearer = motion.go(&admit(), AxisName::E, Millimetres(wall_mm - 0.01)).await;
        assert!(matches!(nearer, Err(ServiceError::Refused(Refusal::Wall { .. }))), "{nearer:?}");
        if motion.e_wall_reading_mm() > wall_mm + 1.0 {
            fakes.e.told.lock().unwrap().clear();
            for back_mm in [0.02, 0.1] {
                motion.go(&admit(), AxisName::E, Millimetres(wall_mm + back_mm)).await.unwrap();
            }
            assert_eq!(*fakes.e.told.lock().unwrap(), [wall_mm + 0.02, wall_mm + 0.1]);
        }
    }
}

#[tokio::test]
async fn near_the_wall_the_shell_is_approached_in_short_pieces() {
    for (shell, short) in [(ShellState::Unknown, true), (ShellState::On, true), (ShellState::Off, false)] {
        let fakes = fakes();
        let (motion, admit) = rules(small_config(1), fakes.bench);
        motion.set_shell(shell);
        let wall = motion.e_wall_reading_mm();
        motion.go(&admit(), AxisName::E, Millimetres(wall + 0.05)).await.unwrap();
        let told = fakes.e.told.lock().unwrap().clone();
        assert_eq!(told.last().copied(), Some(wall + 0.05));
        let mut at = 30.0;
        let mut longest_near = 0.0f64;
        for to in told {
            if to < at && to < wall + 1.0 - 1e-9 {
                assert!(!short || at <= wall + 1.0 + 1e-9, "from {at} into the zone at once, to {to}");
                longest_near = longest_near.max(at - to);
            }
            at = to;
        }
        assert_eq!(longest_near <= 0.2 + 1e-9, short, "{shell:?}: {longest_near}");
        // Away from it there is nothing to be careful of.
        fakes.e.told.lock().unwrap().clear();
        motion.go(&admit(), AxisName::E, Millimetres(20.0)).await.unwrap();
        assert!(fakes.e.told.lock().unwrap().len() <= 2);
    }
}

#[tokio::test]
async fn a_target_is_approached_from_its_side_over_the_whole_play() {
    for (side, sign) in [(Side::High, 1.0), (Side::Low, -1.0)] {
        let mut config = small_config(1);
        (config.bench.e.approach, config.bench.e.backlash_mm) = (side, 0.1);
        let fakes = fakes();
        let (motion, admit) = rules(config, fakes.bench);
        let told = async |to: f64| {
            fakes.e.told.lock().unwrap().clear();
            motion.go(&admit(), AxisName::E, Millimetres(to)).await.unwrap();
            fakes.e.told.lock().unwrap().clone()
        };
        // From the other side: past the target first, by twice the play and something.
        told(15.0).await;
        let legs = told(15.0 + 3.0 * sign).await;
        let [.., beside, at] = legs[..] else { panic!("{side:?}: {legs:?}") };
        assert_eq!(at, 15.0 + 3.0 * sign);
        assert!((beside - at - 0.25 * sign).abs() < 1e-9, "{side:?}: {legs:?}");
        // On from there the play is taken up: straight, however short the way.
        assert_eq!(told(15.0 + 2.99 * sign).await, [15.0 + 2.99 * sign], "{side:?}");
        // Back by as little: the play is in between again.
        let back = told(15.0 + 3.0 * sign).await;
        assert!(back.len() == 2 && (back[0] - back[1]) * sign > 0.2, "{side:?}: {back:?}");
    }
}

#[tokio::test(start_paused = true)]
async fn frames_count_as_at_rest_from_when_both_axes_have_settled() {
    let mut config = small_config(1);
    (config.bench.focus.settle_ms, config.bench.e.settle_ms) = (200, 700);
    let fakes = fakes();
    let at_rest = fakes.e.at_rest_since().unwrap();
    let (motion, _) = rules(config, fakes.bench);
    assert_eq!(motion.settled_from(), Some(at_rest + Duration::from_millis(700)));
    elapse(Duration::from_secs(5)).await;
    fakes.e.rest(None);
    assert_eq!(motion.settled_from(), None);
    let later = tokio::time::Instant::now();
    fakes.e.rest(Some(later));
    assert_eq!(motion.settled_from(), Some(later + Duration::from_millis(700)));
}

#[tokio::test(start_paused = true)]
async fn a_long_move_is_told_a_second_at_a_time() {
    let config = small_config(1);
    let bench = open_bench(&Arc::new(config.clone())).await.unwrap();
    let (motion, admit) = rules(config, bench.clone());
    motion.home(&admit(), AxisName::E).await.unwrap();
    let mut state = bench.e.state();
    let watched = tokio::spawn(async move {
        let (mut longest, mut since) = (Duration::ZERO, tokio::time::Instant::now());
        while state.changed().await.is_ok() {
            let moving = state.borrow_and_update().moving;
            if moving {
                longest = longest.max(since.elapsed());
            } else {
                since = tokio::time::Instant::now();
            }
            if since.elapsed() > Duration::from_secs(60) {
                break;
            }
        }
        longest
    });
    motion.go(&admit(), AxisName::E, Millimetres(12.0)).await.unwrap();
    drop((motion, admit, bench));
    let longest = watched.await.unwrap();
    assert!(longest > Duration::from_millis(500) && longest < Duration::from_millis(1500), "{longest:?}");
}
