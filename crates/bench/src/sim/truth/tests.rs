//! The truth beside the design.

use super::*;

fn bench(change: impl FnOnce(&mut Config)) -> Arc<Truth> {
    let mut config = Config::default();
    change(&mut config);
    Truth::new(&Arc::new(config))
}

#[test]
fn scale_and_backlash_act_on_the_carriage() {
    let truth = bench(|_| {});
    let start = truth.pose().e_mm;
    truth.motor_moved(1, 1.0);
    let up = truth.pose().e_mm;
    truth.motor_moved(1, 0.0);
    let down = truth.pose().e_mm;
    truth.motor_moved(1, -1.0);
    let further = truth.pose().e_mm;
    assert!((up - start - 1.05).abs() < 0.031, "the first way up may lose the play");
    assert!((up - down - (1.05 - 0.03)).abs() < 1e-9);
    assert!((down - further - 1.05).abs() < 1e-9);
}

#[test]
fn a_reports_delta_v_has_the_error_of_d_at_the_axiss_zero_in_it() {
    let truth = bench(|config| config.bench.simulation.lens_to_mla_error_mm = -0.1);
    let reported = truth.report()["delta_v_mm"].as_f64().unwrap();
    assert!((reported - truth.pose().delta_v_mm + 0.1).abs() < 1e-12, "{reported}");
}

#[test]
fn a_flat_board_is_in_one_piece_wherever_it_is_put() {
    let truth = bench(|config| config.bench.simulation.level_errors_mm = [0.1, -0.2, 0.3]);
    let stands = |distances_mm| {
        truth.obey(&Setup::AirTripleBoard { distances_mm });
        let Surroundings::AirTripleBoard { distances_mm, .. } = truth.pose().surroundings else { unreachable!() };
        distances_mm
    };
    assert_eq!(stands([100.0, 110.0, 120.0]), [100.1, 109.8, 120.3]);
    for board in [100.1, 99.8, 100.3] {
        assert_eq!(stands([100.0; 3]), [board; 3]);
    }
}

#[test]
fn the_switch_closes_where_pulling_off_ends_at_home() {
    let truth = bench(|config| config.bench.simulation.e_zero_offset_mm = 0.1);
    let mut count = 0.0;
    while !truth.home_switch_closed(1) {
        count += 0.001;
        truth.motor_moved(1, count);
    }
    truth.motor_moved(1, count - PULL_OFF_MM);
    assert!((truth.pose().e_mm - 30.1).abs() < 0.06, "{}", truth.pose().e_mm);
    assert!(!truth.home_switch_closed(1));
}

#[test]
fn a_flipped_axis_goes_the_other_way_and_friction_holds_short_moves() {
    let flipped = bench(|config| config.bench.simulation.e_sign_flip = true);
    let start = flipped.pose().e_mm;
    flipped.motor_moved(1, 2.0);
    assert!(flipped.pose().e_mm < start - 1.9);
    let sticky = bench(|config| config.bench.simulation.friction_step_mm = 0.2);
    let start = sticky.pose().delta_v_mm;
    sticky.motor_moved(0, 0.1);
    assert_eq!(sticky.pose().delta_v_mm, start);
    sticky.motor_moved(0, 0.5);
    assert!(sticky.pose().delta_v_mm > start + 0.4);
}

#[test]
fn a_screw_that_slips_goes_less_far_and_more_play_loses_more() {
    let truth = bench(|_| {});
    truth.motor_moved(1, 1.0);
    let start = truth.pose().e_mm;
    let mut faults = Faults::default();
    faults.e.slip_share = 0.25;
    truth.set_faults(faults);
    truth.motor_moved(1, 2.0);
    assert!((truth.pose().e_mm - start - 0.75 * 1.05).abs() < 1e-9);
    faults.e = AxisFaults { backlash_mm: 0.2, limit_switch: true, ..AxisFaults::default() };
    truth.set_faults(faults);
    truth.motor_moved(1, 1.0);
    let down = truth.pose().e_mm;
    truth.motor_moved(1, 2.0);
    assert!((truth.pose().e_mm - down - (1.05 - 0.23)).abs() < 1e-9);
    assert!(truth.limit_switch_closed(1) && !truth.limit_switch_closed(0));
}

#[test]
fn the_shell_stops_the_lens_and_the_touch_is_remembered() {
    let truth = bench(|_| {});
    truth.obey(&Setup::WaterBoard { distance_mm: 800.0 });
    truth.motor_moved(1, -60.0);
    assert_eq!(truth.pose().e_mm, -0.5);
    assert_eq!(truth.report()["touched_shell"], true);
    // However small the steps are that lead away from it.
    for step in 1..=4000 {
        truth.motor_moved(1, -60.0 + 0.001 * f64::from(step));
    }
    assert!(truth.pose().e_mm > 2.0, "{}", truth.pose().e_mm);
}
