//! What a job that is no alignment came to, as words: the same for a terminal and for paper.

use super::figures::value;
use crate::control::job::outcome::Outcome;

/// What an outcome says, line by line: a name and a value with its uncertainty.
pub(crate) fn outcome_figures(outcome: &Outcome) -> Vec<(&'static str, String)> {
    let mm = |of: f64, digits| value(Some(of), None, digits);
    match outcome {
        Outcome::Homing { focus_mm, e_mm } => vec![("focus axis", place(*focus_mm)), ("e axis", place(*e_mm))],
        Outcome::Calibration {
            distances_mm,
            lens_to_mla_mm,
            mla_to_sensor_mm,
            image_distance_mm,
            image_distance_sigma_mm,
            delta_v_mm,
        } => vec![
            ("image distance d + N b", value(Some(*image_distance_mm), Some(*image_distance_sigma_mm), 4)),
            ("lens to MLA d", mm(*lens_to_mla_mm, 4)),
            ("MLA to sensor b", mm(*mla_to_sensor_mm, 4)),
            ("Δv", mm(*delta_v_mm, 4)),
            ("board, or its levels, at", distances_mm.map(|distance_mm| mm(distance_mm, 1)).join(", ")),
        ],
        Outcome::LBound { l_bound_mm, sigma_mm, e_wall_mm } => {
            vec![("l_bound", value(Some(*l_bound_mm), Some(*sigma_mm), 3)), ("e wall", mm(*e_wall_mm, 3))]
        }
        Outcome::FocusSweep {
            axis,
            positions,
            measured,
            crossing_mm,
            crossing_sigma_mm,
            slope_px_per_mm,
            best_focus,
            eog_peak,
        } => {
            let curve = best_focus.as_ref().map(|best| (best.position_mm, best.sigma_mm));
            let peak = eog_peak.as_ref().map(|peak| (peak.position_mm, peak.sigma_mm));
            let told = |best: Option<(f64, f64)>| {
                best.map_or_else(
                    || "no place of the sweep".to_owned(),
                    |(at_mm, sigma)| value(Some(at_mm), Some(sigma), 4),
                )
            };
            // One best focus: the curve's, or where there is no curve that between the two positions about it.
            let best = match (curve, crossing_mm.zip(*crossing_sigma_mm)) {
                (None, Some(crossing)) => ("in focus between two positions", told(Some(crossing))),
                (curve, _) => ("best focus", told(curve)),
            };
            let slope = slope_px_per_mm.map_or_else(|| "not measured".to_owned(), |slope| format!("{slope:+.4} px/mm"));
            vec![
                ("axis", axis.to_string()),
                best,
                ("EOG greatest at", told(peak)),
                ("slope", slope),
                ("measured", format!("{measured} of {positions} positions")),
            ]
        }
        Outcome::SpacingWatch {
            measured,
            unmeasured,
            mean_px,
            scatter_px,
            drift_px_per_h,
            drift_sigma_px_per_h,
            least_px,
            greatest_px,
        } => {
            let sigma = drift_sigma_px_per_h.map_or_else(String::new, |sigma| format!(" ± {sigma:.4}"));
            vec![
                ("mean", format!("{mean_px:.4} px")),
                ("scatter", format!("{scatter_px:.4} px")),
                ("between", format!("{least_px:.4} and {greatest_px:.4} px")),
                ("drift", format!("{drift_px_per_h:+.4}{sigma} px/h")),
                ("measured", format!("{measured} of {} times", measured + unmeasured)),
            ]
        }
    }
}

fn place(readback_mm: Option<f64>) -> String {
    readback_mm.map_or_else(|| "unknown".to_owned(), |at_mm| value(Some(at_mm), None, 3))
}
