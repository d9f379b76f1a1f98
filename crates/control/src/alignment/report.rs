//! The report of an alignment, from what it found.

use super::Findings;
use crate::budget::{Budget, Evidence, PitchSeen};
use crate::events::InView;
use crate::job::request::JobKind;
use crate::job::{Interval, JobState, Report, SpacingTargets};
use crate::measuring::eye::{Eye, Seen};
use crate::motion::Motion;
use crate::running::context::JobContext;
use bench::config::Config;
use bench::device::AxisName;

/// The tilt (degrees) between lens and MLA that a spacing's tilt (px per half frame width) would mean if nothing else
/// were tilted: d changes by (dl/dΔv)⁻¹ over half the frame's width.
fn tilt_deg(tilt_px: f64, slope_px_per_mm: f64, half_width_mm: f64) -> f64 {
    (tilt_px / slope_px_per_mm / half_width_mm).atan().to_degrees()
}

/// What is said of the shell step where none was begun.
const fn without_shell_step(kind: JobKind) -> &'static str {
    match kind {
        JobKind::AirOnly => "none: this job sets Δv in air",
        _ => "the shell step was not reached",
    }
}

/// What was seen from the end of the air step on, last through masks of a radius (px); `None` where that is not enough for a
/// budget.
pub(crate) fn evidence(eye: &Eye, findings: &Findings, window_px: f64) -> Option<Evidence> {
    let air = eye.air_step()?;
    let pitch = eye.sight().zip(eye.white_frame()).and_then(|(sight, frame)| {
        let focus_mm = frame.focus.position?.value();
        let grid = &sight.white().grid;
        let sigma_px = grid.sigma.pitch_px;
        (sigma_px > 0.0).then(|| PitchSeen { pitch_px: grid.pitch_px(), sigma_px, focus_mm })
    });
    Some(Evidence {
        air: air.camera,
        focus_mm: air.focus_mm,
        focus_scale: air.focus_scale.unwrap_or(1.0),
        places: air.places,
        boards: air.boards?,
        pitch,
        shell: findings.through_shell.clone(),
        tilt_change: findings.tilt_change,
        window_px,
    })
}

/// An axis whose readback has changed by more than this has been moved, mm: a servo that holds its place may read a micrometre
/// beside it.
pub(crate) const MOVED_MM: f64 = 2e-3;

/// Whether each axis still stands where it did in a measurement, by its readback (mm) now; one that is unknown does not.
fn rest_since(seen: &Seen, readbacks_mm: [Option<f64>; 2]) -> [bool; 2] {
    let [focus_mm, e_mm] = readbacks_mm;
    let rests =
        |then: Option<f64>, now: Option<f64>| then.zip(now).is_some_and(|(then, now)| (now - then).abs() <= MOVED_MM);
    [rests(seen.focus_mm, focus_mm), rests(seen.e_mm, e_mm)]
}

/// What the last measurement was and where, for a report of a job that has moved an axis since.
fn before_last_move(seen: &Seen, findings: &Findings, readbacks_mm: [Option<f64>; 2]) -> String {
    let at = |mm: Option<f64>| mm.map_or_else(|| "an unknown place".to_owned(), |mm| format!("{mm:.4} mm"));
    let e = findings.e.map_or_else(String::new, |(e, sigma)| format!(", e by it {e:.3} ± {sigma:.3} mm"));
    let places_known = readbacks_mm.iter().all(Option::is_some);
    let beside = if places_known {
        "is of before the last move and not of where the job ended"
    } else {
        "may not be of where the job ended, as the place of an axis has been lost"
    };
    format!(
        "the last measurement {beside}: with the focus axis at {} and the e axis at {} the spacing was {:.4} ± {:.4} px{e}",
        at(seen.focus_mm),
        at(seen.e_mm),
        seen.spacing.spacing_px,
        seen.spacing.spacing_sigma_px,
    )
}

/// `astray` is the axis that the picture has shown to stand elsewhere than it reads.
#[allow(clippy::too_many_arguments)] // Every one is a different thing, named at the one call.
pub(crate) fn report(
    context: &JobContext,
    motion: &Motion,
    eye: &Eye,
    config: &Config,
    design_origin: &str,
    findings: &Findings,
    astray: Option<AxisName>,
    outcome: JobState,
    reason: &str,
) -> Report {
    let design = config.design();
    let l_bound_mm = motion.l_bound_mm();
    let solution = findings.solution.unwrap_or_else(|| design.joint(l_bound_mm));
    let readbacks_mm = AxisName::ALL.map(|axis| motion.position_mm(axis).ok());
    let measured = findings.seen.as_ref();
    let [focus_rests, e_rests] = measured.map_or([true; 2], |seen| rest_since(seen, readbacks_mm));
    // What was seen before an axis moved is not what the job has come to.
    let seen = measured.filter(|_| focus_rests && e_rests);
    // Nor is anything that goes by the reading of an axis that has not followed.
    let known = seen.filter(|_| astray.is_none()).and_then(|seen| evidence(eye, findings, seen.window_px));
    let budget = known.and_then(|seen| Budget::of(config, &seen, solution.e));
    let (delta_v_mm, delta_v_sigma_mm) = budget
        .as_ref()
        .map(|budget| (budget.delta_v_mm, budget.delta_v_sigma_mm))
        .or_else(|| {
            // In air the picture tells it, and the axis only once there has been a trim.
            let told = focus_rests && (astray != Some(AxisName::Focus) || findings.through_shell.is_empty());
            let here = findings.delta_v_air.filter(|_| told);
            here.map(|(delta_v, sigma)| (delta_v + findings.trim_mm, sigma))
        })
        .unzip();
    let (e_mm, e_sigma_mm) = budget
        .as_ref()
        .map(|budget| (budget.e_mm, budget.e_sigma_mm))
        .or_else(|| findings.e.filter(|_| e_rests))
        .unzip();
    // What is aimed for at the e that was reached: "re-optimise Δv with e fixed".
    let delta_v_target_mm = e_mm.map_or(solution.delta_v, |e| design.clarity(e).delta_v);
    let half_width_mm = config.sensor_extent().width / 2.0;
    // Over the levels of a board the spacing changes by what they stand apart.
    let of_one_board = seen.filter(|seen| seen.in_view != InView::SteppedBoard);
    let tilt_px = of_one_board.map(|seen| [seen.spacing.tilt_x_px, seen.spacing.tilt_y_px]);
    let slope = findings.camera.map(|camera| camera.slope_delta_v(e_mm.unwrap_or(solution.e), findings.trim_mm));
    // The aperture is to be set for what is aimed at until Δv is known.
    let aperture_mm = design.aperture(delta_v_mm.unwrap_or(solution.delta_v));
    let blur_mm = config.assembly.blur_limit_px * eye.pixel_mm();
    let reached = delta_v_mm.zip(e_mm);
    let depth = reached.and_then(|(delta_v, e)| design.depth_of_field(delta_v, e, blur_mm));
    let e_tolerance = reached.and_then(|(delta_v, _)| design.e_tolerance(delta_v, blur_mm));
    let fov_water = reached.and_then(|(delta_v, e)| design.fov_in_water(2.0 * half_width_mm, delta_v, e));
    let mut notes = findings.notes.clone();
    if context.snapshot().simulated {
        notes.insert(0, "SIMULATED: no real device was driven".to_owned());
    }
    if tilt_px.is_some() && slope.is_some() {
        notes.push(
            "tilt is between lens and MLA only if the board is square to the axis and the shell centred: turn the board by 180° before naming the cause".to_owned(),
        );
    }
    notes.extend(measured.filter(|_| seen.is_none()).map(|seen| before_last_move(seen, findings, readbacks_mm)));
    notes.extend(budget.iter().flat_map(|budget| budget.contradictions.clone()));
    let truth = context.truth().map(|mut truth| {
        if let (Some(truth), Some(air)) = (truth.as_object_mut(), &findings.truth_air) {
            truth.insert("air".to_owned(), air.clone());
        }
        truth
    });
    Report {
        outcome,
        reason: reason.to_owned(),
        shell_step_done: findings
            .shell_step_done
            .clone()
            .unwrap_or_else(|| without_shell_step(context.snapshot().kind).to_owned()),
        design_origin: design_origin.to_owned(),
        delta_v_mm,
        delta_v_sigma_mm,
        delta_v_target_mm,
        delta_v_air_mm: findings.delta_v_air.filter(|_| findings.air_done).map(|(delta_v, _)| delta_v),
        delta_v_air_target_mm: solution.delta_v,
        e_mm,
        e_sigma_mm,
        e_target_mm: solution.e,
        e_wall_mm: motion.e_wall_mm(),
        focus_readback_mm: readbacks_mm[0].filter(|_| astray != Some(AxisName::Focus)),
        e_readback_mm: readbacks_mm[1].filter(|_| astray != Some(AxisName::E)),
        image_distance_mm: delta_v_mm.map(|delta_v| design.air_image_distance() + delta_v),
        spacing_px: seen.map(|seen| seen.spacing.spacing_px),
        spacing_sigma_px: seen.map(|seen| seen.spacing.spacing_sigma_px),
        // One seen in air is not for the shell's target, which holds once the shell is on.
        spacing_target_px: seen.map_or_else(|| eye.target_px(), |seen| seen.target_px),
        spacing_targets: SpacingTargets {
            paraxial_px: eye.paraxial_target_px(),
            chief_ray_px: design
                .exact_in_water(solution.delta_v, solution.e)
                .chief_pair_spacing()
                .map(|spacing| spacing / eye.pixel_mm()),
            window_px: findings.camera.map(|camera| camera.exact_target_px(solution.e)),
        },
        moves_air: findings.moves_air,
        moves_shell: findings.moves_shell,
        fov_water_deg: fov_water.map(f64::to_degrees),
        aperture_mm,
        aperture_ring_f_number: design.main_lens.ring_f_number(aperture_mm),
        depth_of_field: depth.map(|depth| Interval { low_mm: Some(depth.near), high_mm: depth.far }),
        e_tolerance: e_tolerance.map(|e| Interval { low_mm: e.low, high_mm: e.high }),
        tilt_px,
        tilt_sigma_deg: of_one_board
            .zip(slope)
            .map(|(seen, slope)| tilt_deg(seen.tilt_sigma_px, slope, half_width_mm).abs()),
        tilt_deg: tilt_px.zip(slope).map(|(tilt, slope)| tilt.map(|t| tilt_deg(t, slope, half_width_mm))),
        eog_before: findings.eog_before,
        eog_after: findings.eog_after.filter(|_| seen.is_some()),
        focus_scale: findings.focus_scale,
        e_scale: findings.e_scale,
        l_bound_mm,
        l_bound_sigma_mm: findings.l_bound_sigma_mm,
        budget,
        time_spent: Some(context.clock().time_spent()),
        notes,
        truth,
    }
}
