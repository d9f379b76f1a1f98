use super::*;
use crate::loops::calibrated::tests::preset;
use crate::loops::room::{Contact, EAxis};

fn goal(step: ShellStep) -> ShellGoal {
    ShellGoal {
        e_mm: 0.0,
        wall_mm: -0.1,
        tolerance_mm: 0.1,
        spacing_px: preset().design.mla.target_spacing() / preset().pixel_mm,
        step,
        high_limit_mm: 32.0,
        scale_sigma: 0.05,
        zero_sigma_mm: 0.2,
        backlash_mm: 0.05,
        leg_mm: 0.0,
        home_mm: 30.0,
        probe_mm: 0.5,
        most_mm: 40.0,
        spacing_tolerance_px: 0.016,
        most_trim_mm: 0.2,
        departure_mm: 0.6,
    }
}

struct Outcome {
    decisions: Vec<ShellDecision>,
    least_e: f64,
    least_reading: f64,
    spacing: f64,
    e: f64,
    walled_off: bool,
}

/// Runs the loop against a bench: true e of a reading, and what the air step left of Δv: a residual that it knows
/// and an error that it does not.
fn run(step: ShellStep, e_of: impl Fn(f64) -> f64, residual: f64, delta_v_error: f64, sigma: f64) -> Outcome {
    run_sticking(step, e_of, residual, |_, trim| trim + delta_v_error, sigma)
}

/// The same with the true trim at a turn of one by the reading.
fn run_sticking(
    step: ShellStep,
    e_of: impl Fn(f64) -> f64,
    residual: f64,
    true_trim: impl Fn(u32, f64) -> f64,
    sigma: f64,
) -> Outcome {
    let mut camera = preset();
    camera.lens_to_mla_mm += residual;
    // Where the carriage stands does not change before it is moved again.
    let (mut trim, mut truly) = (0.0, true_trim(0, 0.0));
    let measured = |at: At| {
        if at.trim != trim {
            (trim, truly) = (at.trim, true_trim(at.turn - 1, at.trim));
        }
        let noise = if at.turn.is_multiple_of(2) { sigma } else { -sigma };
        (camera.spacing_px(e_of(at.reading), truly) + noise, sigma)
    };
    let mut shell = ShellLoop::new(goal(step), camera);
    let turns = drive(&mut shell, 30.0, measured, |_| Some(room(AxisModel::new(30.0, 30.0, 0.0, 0.0))));
    let least = |of: &dyn Fn(f64) -> f64| turns.iter().map(|(at, _)| of(at.reading)).fold(f64::INFINITY, f64::min);
    let e = e_of(turns.last().unwrap().0.reading);
    Outcome {
        least_e: least(&e_of),
        least_reading: least(&|reading| reading),
        spacing: camera.spacing_px(e, truly),
        e,
        walled_off: shell.walled_off(),
        decisions: turns.into_iter().map(|(_, decision)| decision).collect(),
    }
}

/// A turn of the loop, and where the axes then stand by their readings, mm.
#[derive(Debug, Clone, Copy)]
struct At {
    turn: u32,
    reading: f64,
    trim: f64,
}

/// Runs a loop from a reading of the e axis (mm) until it ends, forty turns at the most: what is measured at each, with its
/// standard uncertainty (px), and the room that there is.
fn drive(
    shell: &mut ShellLoop,
    start: f64,
    mut measured: impl FnMut(At) -> (f64, f64),
    room: impl Fn(At) -> Option<Room>,
) -> Vec<(At, ShellDecision)> {
    let mut turns = Vec::new();
    let mut at = At { turn: 0, reading: start, trim: 0.0 };
    while at.turn < 40 {
        let (spacing_px, sigma_px) = measured(at);
        let seen = ShellObservation {
            e_reading_mm: at.reading,
            trim_mm: at.trim,
            spacing_px,
            sigma_px,
            sigma_random_px: sigma_px,
        };
        let decision = shell.next(seen, |_| room(at));
        turns.push((at, decision.clone()));
        at.turn += 1;
        match decision {
            ShellDecision::ProbeE { to_mm } | ShellDecision::MoveE { to_mm, .. } => at.reading = to_mm,
            ShellDecision::Trim { by_mm, .. } => at.trim += by_mm,
            ShellDecision::MoreFrames | ShellDecision::Verify => {}
            _ => break,
        }
    }
    turns
}

/// The room where the lens touches half a millimetre beyond an l_bound of 0.
fn room(e: AxisModel) -> Room {
    Room { contact: Contact { e_mm: -0.5, measured_sigma_mm: None }, e: EAxis::alone(e) }
}

fn moves(outcome: &Outcome) -> usize {
    let is_move = |d: &&ShellDecision| matches!(d, ShellDecision::MoveE { .. } | ShellDecision::Trim { .. });
    outcome.decisions.iter().filter(is_move).count()
}

#[test]
fn scale_zero_and_delta_v_errors_converge_without_passing_the_wall() {
    for scale in [0.95, 1.0, 1.05] {
        for zero in [-0.15, 0.0, 0.15] {
            for delta_v_error in [-0.004, 0.0, 0.004] {
                let outcome = run(
                    ShellStep::TranslateEThenTrim,
                    |q| 30.0 + zero + scale * (q - 30.0),
                    delta_v_error / 2.0,
                    delta_v_error / 4.0,
                    0.006,
                );
                let what = format!("scale {scale} zero {zero} Δv {delta_v_error}: {:?}", outcome.decisions);
                assert_eq!(outcome.decisions.last(), Some(&ShellDecision::Done), "{what}");
                assert!((outcome.spacing - goal(ShellStep::TranslateE).spacing_px).abs() < 0.03, "{what}");
                assert!(outcome.least_reading >= -0.1 - 1e-9, "{what}");
                assert!(outcome.least_e >= -0.1 - 0.2, "{} {what}", outcome.least_e);
                assert!(moves(&outcome) <= 5, "{what}");
            }
        }
    }
}

#[test]
fn the_first_long_move_covers_at_most_its_share() {
    let outcome = run(ShellStep::TranslateEThenTrim, |q| q, 0.0, 0.0, 0.004);
    assert!(matches!(outcome.decisions[0], ShellDecision::ProbeE { to_mm } if (to_mm - 29.5).abs() < 1e-9));
    assert!(
        matches!(outcome.decisions[1], ShellDecision::MoveE { to_mm, .. } if to_mm >= 29.5 * 0.15 - 0.1),
        "{:?}",
        outcome.decisions
    );
}

#[test]
fn beyond_the_wall_the_papers_loop_ends_and_ours_trims() {
    // Δv too large: the criterion is met only at negative e.
    let plain = run(ShellStep::TranslateE, |q| q, 0.01, 0.0, 0.004);
    assert!(matches!(plain.decisions.last(), Some(ShellDecision::NotConverged { why }) if why.contains("wall")));
    let ours = run(ShellStep::TranslateEThenTrim, |q| q, 0.01, 0.0, 0.004);
    assert_eq!(ours.decisions.last(), Some(&ShellDecision::Done), "{:?}", ours.decisions);
    assert!(ours.decisions.iter().any(|d| matches!(d, ShellDecision::Trim { .. })));
    assert!(ours.e.abs() < 0.8, "{}", ours.e);
    let held = run(ShellStep::HoldETrim, |q| q, 0.01, 0.0, 0.004);
    assert_eq!(held.decisions.last(), Some(&ShellDecision::Done), "{:?}", held.decisions);
    assert!(held.decisions.iter().any(|d| matches!(d, ShellDecision::Trim { .. })));
    assert!(!ours.walled_off && !held.walled_off);
}

/// The wall is of the axis's reading: an axis that goes less far than it reads comes to it before e is where it is wanted.
#[test]
fn an_axis_that_is_at_the_wall_before_its_optimum_says_so() {
    let held = run(ShellStep::HoldETrim, |q| 30.0 - 0.9 * (30.0 - q), 0.0, 0.0, 0.004);
    assert_eq!(held.decisions.last(), Some(&ShellDecision::Done), "{:?}", held.decisions);
    assert!(held.walled_off && held.e > 2.5, "{}", held.e);
}

/// A carriage that arrives up to a hundredth of a millimetre short of its reading is trimmed again; one that never moves
/// is a fault.
#[test]
fn a_focus_axis_that_sticks_is_trimmed_again() {
    let mut done = 0;
    for seed in 0..40u32 {
        let short_mm = |turn: u32| 0.01 * f64::from((seed * 97 + turn * 389 + turn * turn * 61) % 101) / 100.0;
        let sticks = |turn: u32, trim: f64| trim + 0.005 - short_mm(turn);
        let outcome = run_sticking(ShellStep::HoldETrim, |q| q, 0.0, sticks, 0.002);
        let last = outcome.decisions.last().unwrap();
        assert!(!matches!(last, ShellDecision::Fault(_)), "{seed}: {:?}", outcome.decisions);
        if *last == ShellDecision::Done {
            done += 1;
            assert!((outcome.spacing - goal(ShellStep::TranslateE).spacing_px).abs() < 0.03, "{}", outcome.spacing);
        }
    }
    assert!(done >= 36, "{done} of 40");
    let dead = run_sticking(ShellStep::HoldETrim, |q| q, 0.0, |_, _| 0.008, 0.002);
    assert!(
        matches!(dead.decisions.last(), Some(ShellDecision::Fault(MoveFault::NotMoving { .. }))),
        "{:?}",
        dead.decisions
    );
}

/// A focus axis that goes a fifth further than it is asked to needs one trim more, not one after another.
#[test]
fn a_second_trim_goes_by_what_the_first_has_shown() {
    let outcome = run_sticking(ShellStep::HoldETrim, |q| q, 0.0, |_, trim| 1.2 * trim + 0.1, 0.002);
    assert_eq!(outcome.decisions.last(), Some(&ShellDecision::Done), "{:?}", outcome.decisions);
    let trims = outcome.decisions.iter().filter(|decision| matches!(decision, ShellDecision::Trim { .. })).count();
    assert_eq!(trims, 2, "{:?}", outcome.decisions);
}

#[test]
fn a_dead_or_reversed_axis_ends_the_loop_after_the_probe() {
    let dead = run(ShellStep::TranslateEThenTrim, |_| 30.0, 0.0, 0.0, 0.004);
    assert!(
        matches!(dead.decisions.last(), Some(ShellDecision::Fault(MoveFault::NotMoving { .. }))),
        "{:?}",
        dead.decisions
    );
    assert_eq!(dead.decisions.len(), 2);
    let reversed = run(ShellStep::TranslateEThenTrim, |q| 60.0 - q, 0.0, 0.0, 0.004);
    assert!(
        matches!(reversed.decisions.last(), Some(ShellDecision::Fault(MoveFault::Reversed { .. }))),
        "{:?}",
        reversed.decisions
    );
    assert_eq!(reversed.decisions.len(), 2);
}

/// What the configuration says of an axis's scale is what a wrong `steps_per_mm` makes untrue.
#[test]
fn an_axis_that_goes_further_than_it_reads_never_touches() {
    for scale in [0.5, 1.1, 1.2, 1.28, 1.31, 1.5, 1.8, 2.0, 3.0, 5.0] {
        for sigma in [0.002, 0.004, 0.02, 0.04, 0.06] {
            for zero in [-0.15, 0.0, 0.15] {
                let outcome = run(ShellStep::TranslateEThenTrim, |q| 30.0 + zero + scale * (q - 30.0), 0.0, 0.0, sigma);
                let what = format!("scale {scale} zero {zero} σ = {sigma} px: {:?}", outcome.decisions);
                assert!(outcome.least_e > -0.4, "{} {what}", outcome.least_e);
                if scale > 1.5 {
                    assert!(matches!(outcome.decisions.last(), Some(ShellDecision::Fault(_))), "{what}");
                }
            }
        }
    }
}

/// A first move that the noise hides is followed by one that tells, and by no long one.
#[test]
fn a_dead_axis_is_sent_no_long_way() {
    for sigma in [0.004, 0.02, 0.04] {
        let dead = run(ShellStep::TranslateEThenTrim, |_| 30.0, 0.0, 0.0, sigma);
        assert!(
            matches!(dead.decisions.last(), Some(ShellDecision::Fault(MoveFault::NotMoving { .. }))),
            "{sigma}: {:?}",
            dead.decisions
        );
        assert!(dead.least_reading > 19.0, "σ = {sigma} px: {:?}", dead.decisions);
    }
}

/// Each of its moves is as long as what the ones before have shown of its scale, or too short to tell.
#[test]
fn an_axis_that_slips_all_the_way_ends_the_loop() {
    for sigma in [0.004, 0.02, 0.06] {
        let slipping = run(ShellStep::TranslateEThenTrim, |q| 30.0 + 0.6 * (q - 30.0), 0.0, 0.0, sigma);
        let last = slipping.decisions.last();
        let told = matches!(last, Some(ShellDecision::Fault(MoveFault::WrongScale { axis: AxisName::E, .. })));
        assert!(told, "σ = {sigma} px: {:?}", slipping.decisions);
    }
}

/// The picture is wrong by as much as three standard uncertainties, either way, by water, board or radii: the lens never
/// touches, the focus is found all the same, and e is no further off than it has to be.
#[test]
fn a_lens_stays_clear_by_what_e_is_uncertain_by() {
    let camera = preset();
    for sigma_mm in [0.05, 0.19, 0.4, 1.0] {
        for off in [-2.9, 0.0, 2.9] {
            let shown = |at: At| at.reading + off * sigma_mm;
            let mut shell = ShellLoop::new(goal(ShellStep::TranslateEThenTrim), camera);
            let turns = drive(
                &mut shell,
                30.0,
                |at| (camera.spacing_px(shown(at), at.trim), 0.004),
                |at| Some(room(AxisModel::new(at.reading, shown(at), sigma_mm, 0.0))),
            );
            let what = format!("σ(e) {sigma_mm} mm, {off} of it off: {turns:?}");
            let (end, last) = turns.last().unwrap();
            assert_eq!(*last, ShellDecision::Done, "{what}");
            assert!(turns.iter().all(|(at, _)| at.reading > -0.5), "touched {what}");
            // The axis's reading does not pass the wall either.
            let wanted = 0.0_f64.max(3.0 * sigma_mm - 0.5).max(off * sigma_mm - 0.1);
            assert!((shown(*end) - wanted).abs() < 0.2, "{} {what}", end.reading);
        }
    }
}

/// What is measured nearer to the shell makes e less uncertain, by less from place to place: the loop does not spend its moves on
/// that, and has some left to bring the spacing to its target.
#[test]
fn a_room_that_grows_by_less_and_less_is_not_followed_to_the_last_move() {
    let camera = preset();
    let mut shell = ShellLoop::new(goal(ShellStep::TranslateEThenTrim), camera);
    let turns = drive(
        &mut shell,
        30.0,
        |at| (camera.spacing_px(at.reading, at.trim), 0.004),
        |at| Some(room(AxisModel::new(at.reading, at.reading, 0.7 + 0.15 * at.reading.min(8.0), 0.0))),
    );
    let (end, last) = turns.last().unwrap();
    assert_eq!(*last, ShellDecision::Done, "{turns:?}");
    // Where the room has room for it no more, e is 2.9 mm.
    assert!((2.9..3.7).contains(&end.reading) && shell.held_off() && shell.trimmed(), "{turns:?}");
}

/// Whatever was decided before: a picture that leaves less than two and a half standard uncertainties takes the lens back to
/// where there are three, and nothing is done before.
#[test]
fn a_lens_that_is_found_too_near_is_taken_back() {
    const UNSURE_MM: f64 = 0.4;
    /// By then it has come to its optimum.
    const NEAR: u32 = 3;
    let camera = preset();
    for late in 1..5 {
        let mut shell = ShellLoop::new(goal(ShellStep::TranslateEThenTrim), camera);
        let turns = drive(
            &mut shell,
            30.0,
            |at| (camera.spacing_px(at.reading, at.trim), 0.004),
            |at| {
                let sigma_mm = if at.turn < late { 0.02 } else { UNSURE_MM };
                Some(room(AxisModel::new(at.reading, at.reading, sigma_mm, 0.0)))
            },
        );
        let left_mm = |reading: f64| reading + 0.5;
        let too_near = |at: &At| at.turn >= late && left_mm(at.reading) < 2.5 * UNSURE_MM;
        for (_, decision) in turns.iter().filter(|(at, _)| too_near(at)) {
            assert!(
                matches!(decision, ShellDecision::MoveE { to_mm, .. } if (left_mm(*to_mm) - 3.0 * UNSURE_MM).abs() < 1e-6),
                "{late}: {turns:?}"
            );
        }
        let (end, last) = turns.last().unwrap();
        assert!(*last == ShellDecision::Done && !too_near(end), "{late}: {turns:?}");
        // Before it is near it does not go there.
        assert_eq!(turns.iter().any(|(at, _)| too_near(at)), late >= NEAR, "{late}: {turns:?}");
    }
}

/// Without a budget nobody can say how near the lens is.
#[test]
fn nothing_goes_towards_the_shell_without_room() {
    let camera = preset();
    for (step, start) in [
        (ShellStep::TranslateEThenTrim, 30.0),
        (ShellStep::TranslateE, 30.0),
        (ShellStep::TranslateE, 1.5),
        (ShellStep::HoldETrim, 30.0),
    ] {
        let mut shell = ShellLoop::new(goal(step), camera);
        let turns = drive(&mut shell, start, |at| (camera.spacing_px(at.reading, at.trim), 0.004), |_| None);
        assert!(turns.iter().all(|(at, _)| at.reading >= start), "{step:?} from {start}: {turns:?}");
    }
}
