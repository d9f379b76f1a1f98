//! A sweep in a report: what was seen against the position, and best focus by it.

use std::fmt::Write as _;

use super::html::number;
use super::plot::{Point, Series, by_position};
use crate::control::job::outcome::Outcome;
use crate::control::job::{Iteration, JobSnapshot};
use crate::control::loops::through_focus::FittedPlace;
use crate::device::AxisName;
use crate::text::escape;

/// A sweep's curves: the spacing and the EOG against the position, with best focus by each.
pub(super) fn through_focus(page: &mut String, job: &JobSnapshot) {
    let Some(Outcome::FocusSweep { axis, best_focus, eog_peak, .. }) = &job.outcome else { return };
    let seen = |value: &dyn Fn(&Iteration) -> Option<(f64, f64)>| points(job, *axis, value);
    let curve = |best: &Option<FittedPlace>| -> Vec<Point> {
        let points = best.iter().flat_map(|best| &best.curve);
        points.map(|point| Point { at: point.position_mm, value: point.value, bar: None }).collect()
    };
    let series = |name, class, points, marked| Series { name, class, points, marked };
    let told = |best: &Option<FittedPlace>, none: &str| {
        best.as_ref()
            .map_or_else(|| none.to_owned(), |best| number(Some(best.position_mm), Some(best.sigma_mm), 4) + " mm")
    };
    page.push_str("<h2>Through focus</h2>\n");
    let place = format!("position of the {axis} axis, mm");
    let figures = [
        (
            format!("Spacing; best focus at {}", told(best_focus, "no place of the sweep")),
            "px",
            vec![
                series(
                    "spacing",
                    "measured apart",
                    seen(&|it| Some((it.spacing.spacing_px, it.spacing.spacing_sigma_px))),
                    true,
                ),
                series("target", "target", seen(&|it| Some((it.spacing_target_px, 0.0))), false),
                series("fitted", "second", curve(best_focus), false),
            ],
        ),
        (
            format!("EOG of the central view, per pixel; greatest at {}", told(eog_peak, "no place of the sweep")),
            "",
            vec![
                series("EOG", "measured apart", seen(&|it| Some((it.eog?, 0.0))), true),
                series("fitted", "second", curve(eog_peak), false),
            ],
        ),
    ];
    for (caption, unit, series) in figures {
        if let Some(svg) = by_position(&caption, &place, unit, &series) {
            let _ = writeln!(page, "<figure>{svg}<figcaption>{}</figcaption></figure>", escape(&caption));
        }
    }
}

/// A value and its standard uncertainty, 0 for none, wherever the axis was.
fn points(job: &JobSnapshot, axis: AxisName, value: impl Fn(&Iteration) -> Option<(f64, f64)>) -> Vec<Point> {
    let one = |it: &Iteration| {
        let at = match axis {
            AxisName::Focus => it.focus_mm,
            AxisName::E => it.e_mm,
        }?;
        let (value, sigma) = value(it)?;
        Some(Point { at, value, bar: (sigma > 0.0).then_some(2.0 * sigma) })
    };
    job.iterations.iter().filter_map(one).collect()
}
