//! The figures of a report as words, the same for a terminal and for paper.

use crate::control::job::{Interval, Report};

const NOT_MEASURED: &str = "not measured";

/// What a report says, line by line: a name and a value with its uncertainty.
pub(crate) fn figures(report: &Report) -> Vec<(&'static str, String)> {
    // What follows from Δv and e is not told without both.
    let reached = report.delta_v_mm.is_some() && report.e_mm.is_some();
    let mut rows = vec![
        (
            "Δv",
            format!(
                "{}  target {:.4} mm",
                value(report.delta_v_mm, report.delta_v_sigma_mm, 4),
                report.delta_v_target_mm
            ),
        ),
        (
            "Δv after the air step",
            format!("{}  target {:.4} mm", value(report.delta_v_air_mm, None, 4), report.delta_v_air_target_mm),
        ),
        (
            "e",
            format!(
                "{}  target {:.3} mm, wall {:.3} mm",
                value(report.e_mm, report.e_sigma_mm, 3),
                report.e_target_mm,
                report.e_wall_mm
            ),
        ),
        ("image distance v + Δv", value(report.image_distance_mm, None, 4)),
        (
            "spacing",
            match (report.spacing_px, report.spacing_sigma_px) {
                (Some(spacing), Some(sigma)) => {
                    format!("{spacing:.4} ± {sigma:.4} px  target {:.4} px", report.spacing_target_px)
                }
                _ => format!("not measured  target {:.4} px", report.spacing_target_px),
            },
        ),
        ("in focus at", {
            let targets = report.spacing_targets;
            format!(
                "{:.4} px near the axis (Eq. 16), {} for the chief rays, {} in the estimator's window",
                targets.paraxial_px,
                pixels(targets.chief_ray_px),
                pixels(targets.window_px)
            )
        }),
        ("moves", format!("{} in air, {} with the shell, probes not counted", report.moves_air, report.moves_shell)),
        ("shell step", report.shell_step_done.clone()),
        ("readbacks", {
            let (focus, e) = (report.focus_readback_mm, report.e_readback_mm);
            format!("focus {}, e {}", value(focus, None, 4), value(e, None, 3))
        }),
        (
            "field of view in water",
            match report.fov_water_deg {
                Some(fov) => format!("{fov:.2}°"),
                None if reached => "past the shell".to_owned(),
                None => NOT_MEASURED.to_owned(),
            },
        ),
        (
            "aperture to set",
            format!("{:.3} mm, f/{:.2} on the ring", report.aperture_mm, report.aperture_ring_f_number),
        ),
        ("depth of field in water", interval(report.depth_of_field, reached, 0)),
        ("e within the blur limit", interval(report.e_tolerance, reached, 2)),
        ("l_bound", value(Some(report.l_bound_mm), report.l_bound_sigma_mm, 3)),
    ];
    if let Some(budget) = &report.budget {
        rows.insert(0, ("verdict", budget.conclusion.clone()));
    }
    if let Some([x, y]) = report.tilt_px {
        let sigma = report.tilt_sigma_deg.map_or_else(String::new, |sigma| format!(" ± {sigma:.3}°"));
        let angle = report
            .tilt_deg
            .map_or_else(String::new, |[x, y]| format!(" ({x:+.3}°, {y:+.3}°{sigma} if it is the MLA's)"));
        rows.push(("tilt x, y", format!("{x:+.4}, {y:+.4} px per half width{angle}")));
    }
    if let (Some(before), Some(after)) = (report.eog_before, report.eog_after) {
        rows.push(("EOG per pixel", format!("{before:.1} before, {after:.1} after")));
    }
    for (name, scale) in [("scale of the focus axis", report.focus_scale), ("scale of the e axis", report.e_scale)] {
        if let Some(scale) = scale {
            rows.push((name, format!("{scale:.4} as the picture has it")));
        }
    }
    if let Some(spent) = report.time_spent {
        let parts = spent.parts().map(|(part, seconds)| format!("{part} {seconds:.1} s"));
        rows.push(("time", format!("{:.1} s: {}", spent.total_s, parts.join(", "))));
    }
    rows.push(("design", report.design_origin.clone()));
    rows
}

/// What the columns of [`budget`] are.
pub(crate) const BUDGET: [&str; 4] = ["uncertainty from", "of Δv, µm", "of e, µm", "of the blur, px"];

/// What Δv, e and the blur are uncertain by, part by part, the one that costs most first.
pub(crate) fn budget(report: &Report) -> Vec<[String; 4]> {
    let row = |name: &str, delta_v_mm: f64, e_mm: f64, off_focus_px: f64| {
        let um = |mm: f64, digits: usize| format!("{:.digits$}", 1000.0 * mm);
        [name.to_owned(), um(delta_v_mm, 2), um(e_mm, 1), format!("{off_focus_px:.4}")]
    };
    let rows = report.budget.iter().flat_map(|budget| {
        let whole = row("all together", budget.delta_v_sigma_mm, budget.e_sigma_mm, budget.off_focus_sigma_px);
        let parts = budget.parts.iter().map(|part| row(&part.name, part.delta_v_mm, part.e_mm, part.off_focus_px));
        parts.chain([whole]).collect::<Vec<_>>()
    });
    rows.collect()
}

/// A length with its uncertainty, mm.
pub(crate) fn value(value: Option<f64>, sigma: Option<f64>, digits: usize) -> String {
    match (value, sigma) {
        (Some(value), Some(sigma)) => format!("{value:.digits$} ± {sigma:.digits$} mm"),
        (Some(value), None) => format!("{value:.digits$} mm"),
        (None, _) => NOT_MEASURED.to_owned(),
    }
}

/// `reached` says whether that from which an interval follows was measured.
fn interval(interval: Option<Interval>, reached: bool, digits: usize) -> String {
    let Some(interval) = interval else {
        return if reached { "none is that sharp" } else { NOT_MEASURED }.to_owned();
    };
    let end = |end: Option<f64>| end.map_or_else(|| "∞".to_owned(), |end| format!("{end:.digits$} mm"));
    format!("{} to {}", end(interval.low_mm), end(interval.high_mm))
}

fn pixels(value: Option<f64>) -> String {
    value.map_or_else(|| "unknown".to_owned(), |value| format!("{value:.4} px"))
}
