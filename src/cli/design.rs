//! `plenalign design`.

use std::fmt::Write as _;
use std::io::Write as _;
use std::process::ExitCode;

use super::Context;
use crate::control::design::{DesignView, SolutionView};

/// Arguments of `plenalign design`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(context: Context, args: Args) -> anyhow::Result<ExitCode> {
    let view = DesignView::of(&context.config, &context.origin);
    let mut text = if args.json { serde_json::to_string_pretty(&view)? } else { table(&view)? };
    if args.json {
        text.push('\n');
    }
    std::io::stdout().write_all(text.as_bytes())?;
    Ok(ExitCode::SUCCESS)
}

/// One quantity of the solutions' table: name, unit, digits, value in air where there is one, value of a solution.
type Row = (&'static str, &'static str, usize, Option<f64>, fn(&SolutionView) -> Option<f64>);

fn table(view: &DesignView) -> Result<String, std::fmt::Error> {
    let air = &view.air;
    let rows: [Row; 11] = [
        ("Δv", "mm", 4, Some(0.0), |s| Some(s.delta_v_mm)),
        ("e", "mm", 3, None, |s| Some(s.e_mm)),
        ("object distance seen by the lens", "mm", 2, Some(air.object_distance_mm), |s| Some(s.equivalent_distance_mm)),
        ("image distance", "mm", 4, Some(air.image_distance_mm), |s| Some(s.image_distance_mm)),
        ("aperture diameter", "mm", 3, Some(air.aperture_mm), |s| Some(s.aperture_mm)),
        ("  change", "mm", 3, Some(0.0), |s| Some(s.aperture_change_mm)),
        ("  working f-number", "", 2, Some(air.image_distance_mm / air.aperture_mm), |s| Some(s.main_lens_f_number)),
        ("  number on the ring", "", 2, None, |s| Some(s.aperture_ring_f_number)),
        ("field of view inside the shell", "°", 2, Some(air.fov_deg), |s| Some(s.fov_inner_deg)),
        ("field of view in water", "°", 2, None, |s| s.fov_water_deg),
        ("half width of board seen", "mm", 1, Some(air.half_width_mm), |s| s.half_width_mm),
    ];
    let mut out = String::new();
    writeln!(out, "Camera: {}", view.origin)?;
    writeln!(out, "Water:  refractive index {:.6}", view.water_refractive_index)?;
    writeln!(out)?;
    writeln!(out, "{:<33} {:>4} {:>10} {:>10} {:>10}", "", "", "air", "clarity", "joint")?;
    for (name, unit, digits, in_air, of) in rows {
        let number = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"));
        let [air, clarity, joint] = [in_air, of(&view.clarity), of(&view.joint)].map(number);
        writeln!(out, "{name:<33} {unit:>4} {air:>10} {clarity:>10} {joint:>10}")?;
    }
    writeln!(out)?;
    let mut line = |name: &str, value: String| writeln!(out, "{name:<33} {value}");
    line("FOV optimisation", format!("e = {:.3} mm", view.fov_optimal_e_mm))?;
    if let Some(best) = nearest_width(view) {
        line("board seen, nearest to air's", best)?;
    }
    line("greatest e", format!("{:.1} mm, the shell's rim in the corners of the picture", view.e_max_mm))?;
    line(
        "microlens array",
        format!("a = {:.4} mm, b = {:.4} mm, f/{:.2}", view.mla.a_mm, view.mla.b_mm, view.mla.f_number),
    )?;
    line("spacing in focus", format!("{:.3} px", view.spacing_target_px))?;
    for (name, [one, three]) in [
        ("depth resolution, air design", view.depth_resolution_mm),
        ("depth resolution in water, joint", view.depth_resolution_water_mm),
    ] {
        line(name, format!("{one:.1} mm over one lens pitch, {three:.1} mm over three (half a pixel of parallax)"))?;
    }
    let limit = view.blur_limit_px;
    let depth = match view.depth_of_field {
        Some(depth) => format!("{} (blur within {limit} px)", interval(Some(depth.near_mm), depth.far_mm, 0)),
        None => format!("nothing in the water is within a blur of {limit} px"),
    };
    line("depth of field in water", depth)?;
    let tolerance = interval(view.e_tolerance.low_mm, view.e_tolerance.high_mm, 2);
    line("tolerance of e, Δv held", format!("{tolerance} (blur within {limit} px)"))?;
    for notice in &view.notices {
        writeln!(out, "\nNote: {notice}.")?;
    }
    Ok(out)
}

/// Which of the shell added directly, clarity and joint sees a width of board nearest to what the air design sees.
/// `None` where none sees a width.
fn nearest_width(view: &DesignView) -> Option<String> {
    let air = view.air.half_width_mm;
    let widths = [
        ("shell added directly", view.direct.half_width_mm),
        ("clarity", view.clarity.half_width_mm),
        ("joint", view.joint.half_width_mm),
    ];
    let known = || widths.iter().filter_map(|&(name, half)| half.map(|half| (name, half)));
    let (best, _) = known().min_by(|a, b| (a.1 - air).abs().total_cmp(&(b.1 - air).abs()))?;
    let all: Vec<String> = known().map(|(name, half)| format!("{name} {half:.1}")).collect();
    Some(format!("{best} (half widths: air {air:.1}, {} mm)", all.join(", ")))
}

/// An interval in mm, open where an end is at infinity.
fn interval(low: Option<f64>, high: Option<f64>, digits: usize) -> String {
    match (low, high) {
        (Some(low), Some(high)) => format!("{low:.digits$} to {high:.digits$} mm"),
        (Some(low), None) => format!("from {low:.digits$} mm to infinity"),
        (None, Some(high)) => format!("up to {high:.digits$} mm"),
        (None, None) => "any".to_owned(),
    }
}
