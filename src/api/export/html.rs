//! A job's report: one page with everything in it, to be read without a network and printed.

use std::fmt::Write as _;

use super::figures::{BUDGET, budget, figures};
use super::outcome::outcome_figures;
use super::plot::{Point, Series, by_iteration, field_map};
use super::steps::steps;
use super::through_focus::through_focus;
use crate::config::Config;
use crate::control::history::read::JobArchive;
use crate::control::job::{Iteration, JobSnapshot};
use crate::text::{data_uri, escape, time};

const STYLE: &str = "
:root { color-scheme: light; }
body { font: 14px/1.45 system-ui, sans-serif; color: #111; max-width: 50rem; margin: 1.5rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin: 0 0 .3rem; } h2 { font-size: 1.1rem; margin: 1.6rem 0 .4rem; }
.simulated { background: #b00020; color: #fff; font-weight: 700; font-size: 1.2rem; text-align: center;
  padding: .5rem; letter-spacing: .06em; -webkit-print-color-adjust: exact; print-color-adjust: exact; }
.outcome { font-weight: 700; } .converged { color: #0a6b2d; }
.failed, .not_converged, .interrupted, .cancelled { color: #b00020; }
table { border-collapse: collapse; width: 100%; font-size: 12px; }
th, td { text-align: left; padding: .15rem .5rem .15rem 0; border-bottom: 1px solid #ddd; vertical-align: top; }
.discarded { color: #777; }
td.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
svg { width: 100%; height: auto; font: 11px system-ui, sans-serif; } svg.map { max-width: 30rem; }
svg rect { -webkit-print-color-adjust: exact; print-color-adjust: exact; }
.grid { stroke: #e4e4e4; } .line, .bar { fill: none; stroke: currentColor; stroke-width: 1.5; }
.bar { stroke-width: 1; } circle { fill: currentColor; } text { fill: #333; }
text.y { text-anchor: end; } text.x, text.unit { text-anchor: middle; }
.measured { color: #1f5fa8; } .target { color: #b00020; } .target .line { stroke-dasharray: 5 3; }
.second { color: #0a6b2d; } .apart path.line { stroke: none; }
figure { margin: 0; } figcaption { font-size: 12px; color: #444; } .pair { display: flex; gap: 1rem; flex-wrap: wrap; }
.pair img { width: 22rem; max-width: 100%; image-rendering: pixelated; border: 1px solid #999; }
pre { white-space: pre-wrap; font-size: 11px; } .quiet { color: #555; }
@media screen and (max-width: 40rem) { table { display: block; overflow-x: auto; } pre { overflow-wrap: anywhere; } }
@media print { body { margin: 0; max-width: none; } h2, figure, tr { break-inside: avoid; } h2 { break-after: avoid; } }
";

/// The report as a page.
#[must_use]
pub fn html(archive: &JobArchive) -> String {
    let mut page = String::new();
    let job = &archive.job;
    let title = format!("{}Plenalign report {}", if job.simulated { "SIMULATED: " } else { "" }, job.id);
    let _ = write!(
        page,
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>{}</title>\n<meta name=\"viewport\" content=\"width=device-width\">\n<style>{STYLE}</style>\n</head>\n<body>\n",
        escape(&title)
    );
    banner(&mut page, archive);
    head(&mut page, archive);
    if let Some(report) = &job.report {
        figures_table(&mut page, &figures(report));
        for note in &report.notes {
            let _ = writeln!(page, "<p class=\"quiet\">{}</p>", escape(note));
        }
        budget_table(&mut page, &budget(report));
    }
    if let Some(outcome) = &job.outcome {
        figures_table(&mut page, &outcome_figures(outcome));
    }
    through_focus(&mut page, job);
    plots(&mut page, job);
    field(&mut page, archive);
    pictures(&mut page, archive);
    iterations(&mut page, job);
    moves(&mut page, archive);
    steps(&mut page, &job.steps);
    asked(&mut page, archive);
    log(&mut page, archive);
    if let Some(run) = &archive.run {
        let _ = writeln!(page, "<h2>Configuration in force</h2>\n<pre>{}</pre>", escape(&run.configuration));
    }
    banner(&mut page, archive);
    page.push_str("</body>\n</html>\n");
    page
}

fn figures_table(page: &mut String, rows: &[(&str, String)]) {
    let _ = writeln!(page, "<h2>Figures</h2>\n<table>");
    for (name, value) in rows {
        let _ = writeln!(page, "<tr><th scope=\"row\">{}</th><td>{}</td></tr>", escape(name), escape(value));
    }
    page.push_str("</table>\n");
}

fn budget_table(page: &mut String, rows: &[[String; 4]]) {
    if rows.is_empty() {
        return;
    }
    let heads = BUDGET.map(|head| format!("<th>{head}</th>")).concat();
    let _ = writeln!(page, "<h2>Budget</h2>\n<table>\n<tr>{heads}</tr>");
    for [name, numbers @ ..] in rows {
        let numbers = numbers.each_ref().map(|number| format!("<td class=\"n\">{number}</td>")).concat();
        let _ = writeln!(page, "<tr><th scope=\"row\">{}</th>{numbers}</tr>", escape(name));
    }
    page.push_str("</table>\n");
}

fn banner(page: &mut String, archive: &JobArchive) {
    if archive.job.simulated {
        page.push_str("<p class=\"simulated\">SIMULATED: no real device was driven; every figure is computed</p>\n");
    }
}

fn head(page: &mut String, archive: &JobArchive) {
    let job = &archive.job;
    // Also a class of the style sheet.
    let state = job.state.to_string();
    let kind =
        serde_json::to_value(job.kind).ok().and_then(|word| word.as_str().map(str::to_owned)).unwrap_or_default();
    // l_bound is one symbol.
    let _ = writeln!(page, "<h1>{}</h1>", escape(&kind.replace('_', " ").replace("l bound", "l_bound")));
    let _ = writeln!(page, "<p class=\"outcome {state}\">{}</p>", state.replace('_', " "));
    if let Some(reason) = job.reason.as_ref().filter(|reason| **reason != state) {
        let _ = writeln!(page, "<p>{}</p>", escape(reason));
    }
    page.push_str("<table>\n");
    let mut row = |name: &str, value: &str| {
        let _ = writeln!(page, "<tr><th scope=\"row\">{name}</th><td>{}</td></tr>", escape(value));
    };
    row("Job", &job.id.to_string());
    if let Some(note) = &job.request.note {
        row("Note", note);
    }
    if !job.owner.is_empty() {
        row("Started by", &job.owner);
    }
    row("Accepted", &time(job.created_at));
    row("Ended", &job.ended_at.map_or_else(|| "not yet".to_owned(), time));
    if let Some(run) = &archive.run {
        row("Program", &format!("plenalign {} (run {} of {})", run.version, run.id, time(run.started_at)));
        row("Bench", &run.bench);
    }
    page.push_str("</table>\n");
}

fn points(iterations: &[&Iteration], value: impl Fn(&Iteration) -> Option<(f64, Option<f64>)>) -> Vec<Point> {
    let point = |it: &Iteration| {
        value(it).map(|(value, sigma)| Point { at: f64::from(it.number), value, bar: sigma.map(|s| 2.0 * s) })
    };
    iterations.iter().copied().filter_map(point).collect()
}

fn plots(page: &mut String, job: &JobSnapshot) {
    if job.iterations.is_empty() {
        page.push_str("<p class=\"quiet\">Nothing was measured.</p>\n");
        return;
    }
    let counting: Vec<&Iteration> = job.iterations.iter().filter(|it| !it.discarded).collect();
    let iterations = counting.as_slice();
    let series = |name, class, points, marked| Series { name, class, points, marked };
    let spacing = points(iterations, |it| Some((it.spacing.spacing_px, Some(it.spacing.spacing_sigma_px))));
    let target = points(iterations, |it| Some((it.spacing_target_px, None)));
    let error = points(iterations, |it| {
        Some((it.spacing.spacing_px - it.spacing_target_px, Some(it.spacing.spacing_sigma_px)))
    });
    let figures = [
        (
            "Spacing against target, by iteration; bars are ± 2 standard uncertainties",
            "px",
            vec![series("spacing", "measured", spacing, true), series("target", "target", target, false)],
        ),
        (
            "Spacing less target in the last iterations",
            "px",
            vec![series("spacing less target", "measured", last(error), true)],
        ),
        (
            "Readback of the focus axis, by iteration",
            "mm",
            vec![series("focus axis", "measured", points(iterations, |it| Some((it.focus_mm?, None))), true)],
        ),
        (
            "Readback of the e axis, by iteration, and e as the picture has it",
            "mm",
            vec![
                series("e axis", "measured", points(iterations, |it| Some((it.e_mm?, None))), true),
                series(
                    "e in the picture",
                    "second",
                    points(iterations, |it| Some((it.e_estimate_mm?, it.e_estimate_sigma_mm))),
                    true,
                ),
            ],
        ),
    ];
    page.push_str("<h2>Iterations</h2>\n");
    for (caption, unit, series) in figures {
        if let Some(svg) = by_iteration(caption, unit, &series) {
            let _ = writeln!(page, "<figure>{svg}<figcaption>{}</figcaption></figure>", escape(caption));
        }
    }
}

/// The last of the points: what the first moves bring would hide them.
fn last(points: Vec<Point>) -> Vec<Point> {
    const LAST: usize = 5;
    let skipped = points.len().saturating_sub(LAST);
    points.into_iter().skip(skipped).collect()
}

fn field(page: &mut String, archive: &JobArchive) {
    let Some(it) = archive.job.iterations.last() else { return };
    let config = archive.run.as_ref().and_then(|run| Config::from_toml(&run.configuration, "the job's").ok());
    let shape = config.map_or(1.0, |config| f64::from(config.sensor.height_px) / f64::from(config.sensor.width_px));
    let spacing = &it.spacing;
    let error = |x: f64, y: f64| {
        let field = spacing.tilt_x_px * x + spacing.tilt_y_px * y + spacing.curvature_px * (x * x + y * y);
        spacing.spacing_px + field - it.spacing_target_px
    };
    let caption = format!(
        "Spacing less target over the frame, from the tilt ({:+.4}, {:+.4} px per half width) and curvature ({:+.4} px at half the width) of iteration {}: red is too large, blue too small",
        spacing.tilt_x_px, spacing.tilt_y_px, spacing.curvature_px, it.number
    );
    let _ = writeln!(
        page,
        "<h2>Field</h2>\n<figure>{}<figcaption>{}</figcaption></figure>",
        field_map("Spacing less target over the frame", "px", shape, error),
        escape(&caption)
    );
}

fn pictures(page: &mut String, archive: &JobArchive) {
    if archive.pictures.is_empty() {
        return;
    }
    page.push_str("<h2>Central view</h2>\n<div class=\"pair\">\n");
    for picture in &archive.pictures {
        let caption = match picture.name.as_str() {
            "before" => "with the shell, before its first move",
            "after" => "in the last measurement",
            other => other,
        };
        let simulated = if archive.job.simulated { " · SIMULATED" } else { "" };
        let _ = writeln!(
            page,
            "<figure><img alt=\"{0}\" src=\"{1}\"><figcaption>{0}, {2}{simulated}</figcaption></figure>",
            escape(caption),
            escape(&data_uri(&picture.media_type, &picture.bytes)),
            time(picture.at)
        );
    }
    page.push_str("</div>\n");
}

pub(super) fn number(value: Option<f64>, sigma: Option<f64>, digits: usize) -> String {
    match (value, sigma) {
        (Some(value), Some(sigma)) => format!("{value:.digits$} ± {sigma:.digits$}"),
        (Some(value), None) => format!("{value:.digits$}"),
        (None, _) => "–".to_owned(),
    }
}

fn iterations(page: &mut String, job: &JobSnapshot) {
    if job.iterations.is_empty() {
        return;
    }
    page.push_str("<p class=\"quiet\">Each row's Δv and e, and their ±, are by the pictures up to it alone; the figures above have in them what is configured, too, and what that is uncertain by.</p>\n");
    page.push_str(
        "<table>\n<tr><th>#</th><th>what</th><th>focus, mm</th><th>e, mm</th><th>Δv, mm</th><th>e measured, mm</th><th>spacing, px</th><th>target, px</th><th>decision</th></tr>\n",
    );
    for it in &job.iterations {
        let (class, counts) =
            if it.discarded { (" class=\"discarded\"", "Done again, counts no more. ") } else { ("", "") };
        let cells = [
            it.number.to_string(),
            it.kind.word().to_owned(),
            number(it.focus_mm, None, 4),
            number(it.e_mm, None, 3),
            number(it.delta_v_mm, it.delta_v_sigma_mm, 4),
            number(it.e_estimate_mm, it.e_estimate_sigma_mm, 3),
            number(Some(it.spacing.spacing_px), Some(it.spacing.spacing_sigma_px), 4),
            number(Some(it.spacing_target_px), None, 4),
        ];
        let cells: String = cells.iter().map(|cell| format!("<td class=\"n\">{}</td>", escape(cell))).collect();
        let _ = writeln!(page, "<tr{class}>{cells}<td>{counts}{}</td></tr>", escape(&it.decision));
    }
    page.push_str("</table>\n");
}

fn moves(page: &mut String, archive: &JobArchive) {
    if archive.moves.is_empty() {
        return;
    }
    page.push_str(
        "<h2>Moves</h2>\n<table>\n<tr><th>began</th><th>axis</th><th>what</th><th>from, mm</th><th>to, mm</th><th>stood at, mm</th><th>outcome</th></tr>\n",
    );
    for motion in &archive.moves {
        let outcome = motion.outcome.as_deref().unwrap_or("under way");
        let _ = writeln!(
            page,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td>{}</td></tr>",
            time(motion.started_at),
            escape(&motion.axis),
            escape(&motion.what),
            number(motion.from_mm, None, 4),
            number(motion.to_mm, None, 4),
            number(motion.end_mm, None, 4),
            escape(outcome)
        );
    }
    page.push_str("</table>\n");
}

fn asked(page: &mut String, archive: &JobArchive) {
    if archive.operator_steps.is_empty() {
        return;
    }
    page.push_str("<h2>Operator</h2>\n<table>\n<tr><th>#</th><th>asked</th><th>confirmed</th><th>what</th></tr>\n");
    for asked in &archive.operator_steps {
        let _ = writeln!(
            page,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            asked.step.number,
            time(asked.asked_at),
            asked.confirmed_at.map_or_else(|| "–".to_owned(), time),
            escape(&asked.step.instruction)
        );
    }
    page.push_str("</table>\n");
}

fn log(page: &mut String, archive: &JobArchive) {
    if archive.job.log.is_empty() {
        return;
    }
    page.push_str("<h2>Log</h2>\n<table>\n");
    for line in &archive.job.log {
        let _ = writeln!(page, "<tr><td>{}</td><td>{}</td></tr>", time(line.at), escape(&line.message));
    }
    page.push_str("</table>\n");
}
