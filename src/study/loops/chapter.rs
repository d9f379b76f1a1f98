//! The chapter of the loops, of what all benches came to.

use super::outcome::{Aligned, BenchOutcome, Ended, Taken};
use super::{MEASUREMENT_S, PLAIN_STEP_MM, SCALE_SIGMA, SIDE, ZERO_SIGMA_MM};
use crate::config::Config;
use crate::study::chapter::{Chapter, Chart, Curve, Finding, Table};

/// The benches, by number, whose frames could all be measured, and what a strategy took there.
fn ended_well(runs: &[BenchOutcome], strategy: usize) -> impl Iterator<Item = (usize, Aligned)> {
    runs.iter().enumerate().filter_map(move |(k, run)| match run.by(strategy) {
        Ended::Aligned(aligned) => Some((k, *aligned)),
        Ended::Refused(_) => None,
    })
}

/// The chapter; the outcomes are in the order of the benches' indices.
pub(super) fn chapter(config: &Config, runs: &[BenchOutcome]) -> Chapter {
    let mut chapter = Chapter::default();
    let design = config.design();
    let joint = design.joint(config.assembly.l_bound_mm);
    let target_px = design.mla.target_spacing() / config.pixel_pitch().millimetres();
    let tolerance = config.tolerances().delta_v_mm;
    chapter.text.push(format!(
        "{} benches of their own axes (scale ±{:.0} %, zero ±{ZERO_SIGMA_MM} mm, one standard deviation), each aligned by \
         both strategies with the same estimator on {SIDE}×{SIDE} px frames. The paper's strategy reads: adjust further \
         while Δv_1 is too small, in the opposite direction when it is too great, until within the tolerance. With steps \
         of one size that ends for certain only if a step is at most twice the tolerance, {:.0} moves for Δv = {:.3} mm at \
         ±{tolerance} mm; here it starts with steps of {} mm (Δv) and {} mm (e), and halves them at every overshoot.",
        runs.len(),
        100.0 * SCALE_SIGMA,
        joint.delta_v / (2.0 * tolerance),
        joint.delta_v,
        PLAIN_STEP_MM[0],
        PLAIN_STEP_MM[1],
    ));
    chapter.text.push(format!(
        "Time is simulated: moves by the configured speeds and accelerations, settling, and {MEASUREMENT_S} s for a frame \
         and its measurement."
    ));
    let mut table = Table::new(
        "loops",
        "Median and greatest over the benches",
        &["loop", "strategy", "moves", "travel, mm", "time, s", "error left, rms", "converged", "past the wall"],
    );
    let wall = config.assembly.e_wall_mm(config.assembly.l_bound_mm);
    let mut past = [0usize; 2];
    let mut medians = [[0.0; 2]; 2];
    let names = ["plain", "this program's"];
    for (stage, (name, unit)) in [("Δv in air", "µm"), ("e with the shell", "px")].into_iter().enumerate() {
        for (strategy, label) in names.into_iter().enumerate() {
            let aligned: Vec<Aligned> = ended_well(runs, strategy).map(|(_, aligned)| aligned).collect();
            let taken: Vec<Taken> = aligned.iter().map(|aligned| *aligned.taken(stage)).collect();
            if taken.is_empty() {
                continue;
            }
            let figures = |value: &dyn Fn(&Taken) -> f64, digits: usize| {
                let mut values: Vec<f64> = taken.iter().map(value).collect();
                values.sort_unstable_by(f64::total_cmp);
                let (median, most) = (values[values.len() / 2], values[values.len() - 1]);
                (format!("{median:.digits$} ({most:.digits$})"), median)
            };
            // Summed in the order of the indices, so that the sum does not depend on who worked out which.
            let square = aligned.iter().map(|a| a.error(stage).powi(2)).sum::<f64>() / aligned.len() as f64;
            let error = if stage == 0 { 1000.0 * square.sqrt() } else { square.sqrt() };
            let converged = taken.iter().filter(|t| t.converged).count();
            if stage == 1 {
                past[strategy] = taken.iter().filter(|t| t.least_e_mm < wall).count();
            }
            let (moves, median) = figures(&|t| f64::from(t.moves), 0);
            medians[stage][strategy] = median;
            table.push([
                name.to_owned(),
                label.to_owned(),
                moves,
                figures(&|t| t.travel_mm, 2).0,
                figures(&|t| t.seconds, 1).0,
                format!("{error:.3} {unit}"),
                format!("{converged} of {}", runs.len()),
                if stage == 1 { format!("{} of {}", past[strategy], taken.len()) } else { "–".to_owned() },
            ]);
        }
    }
    chapter.tables.push(table);
    chapter.findings.push(Finding::new(
        "moves, Δv and e together (median)",
        format!(
            "{:.0} by the plain strategy, {:.0} by this program's",
            medians[0][0] + medians[1][0],
            medians[0][1] + medians[1][1]
        ),
        "this program's loops know the slope of spacing against travel and learn the axis's scale from the picture",
    ));
    chapter.findings.push(Finding::new(
        format!("benches on which the lens was taken past the wall at e = {wall:.2} mm"),
        format!("{} by the plain strategy, {} by this program's, of {}", past[0], past[1], runs.len()),
        "to see an overshoot the plain strategy has to make one, and behind l_bound is the shell; what this program goes \
         beyond by is its axis's scale and zero error, which the wall has to include",
    ));
    for (stage, (name, title, y)) in [
        ("delta_v", "Error left in Δv", "Δv − target, µm"),
        ("spacing", "Error left in the spacing", "spacing − target, px"),
    ]
    .into_iter()
    .enumerate()
    {
        let scale = if stage == 0 { 1000.0 } else { 1.0 };
        let curves = names
            .into_iter()
            .enumerate()
            .map(|(strategy, label)| {
                let points =
                    ended_well(runs, strategy).map(|(k, aligned)| [k as f64, scale * aligned.error(stage)]).collect();
                Curve::marks(label, points)
            })
            .collect();
        chapter.charts.push(Chart {
            name: name.to_owned(),
            title: format!("{title}, bench by bench"),
            x: "bench".to_owned(),
            y: y.to_owned(),
            curves,
        });
    }
    for (strategy, name) in names.into_iter().enumerate() {
        let refused: Vec<&str> = runs
            .iter()
            .filter_map(|run| match run.by(strategy) {
                Ended::Refused(why) => Some(why.as_str()),
                Ended::Aligned(_) => None,
            })
            .collect();
        if let Some(first) = refused.first() {
            chapter.text.push(format!(
                "On {} of the benches a frame of the {name} loops was refused, which ended them, as it ends a job; they \
                 count as not converged, and are in no other figure. The first: {first}.",
                refused.len()
            ));
        }
    }
    chapter.text.push(format!("The target of the spacing is {target_px:.3} px (Eq. 16)."));
    chapter
}
