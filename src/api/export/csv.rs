//! A job's iterations as CSV.

use serde_json::Value;

use crate::control::history::read::JobArchive;
use crate::text::csv_field;

/// Columns and where each is in an iteration.
const COLUMNS: &[(&str, &str)] = &[
    ("number", "/number"),
    ("at", "/at"),
    ("stage", "/stage"),
    ("kind", "/kind"),
    ("axis", "/axis"),
    ("focus_mm", "/focus_mm"),
    ("e_mm", "/e_mm"),
    ("delta_v_mm", "/delta_v_mm"),
    ("delta_v_sigma_mm", "/delta_v_sigma_mm"),
    ("e_estimate_mm", "/e_estimate_mm"),
    ("e_estimate_sigma_mm", "/e_estimate_sigma_mm"),
    ("spacing_px", "/spacing/spacing_px"),
    ("spacing_sigma_px", "/spacing/spacing_sigma_px"),
    ("spacing_predicted_px", "/spacing_predicted_px"),
    ("spacing_target_px", "/spacing_target_px"),
    ("tilt_x_px", "/spacing/tilt_x_px"),
    ("tilt_y_px", "/spacing/tilt_y_px"),
    ("curvature_px", "/spacing/curvature_px"),
    ("pairs", "/spacing/pairs"),
    ("frames", "/spacing/frames"),
    ("discarded", "/discarded"),
    ("decision", "/decision"),
];

/// A job's iterations, a line each; the first two columns say of which job, and whether it was simulated.
#[must_use]
pub fn csv(archive: &JobArchive) -> String {
    let names = COLUMNS.iter().map(|(name, _)| *name);
    let mut text = ["job", "simulated"].into_iter().chain(names).collect::<Vec<_>>().join(",");
    text.push_str("\r\n");
    let (job, simulated) = (archive.job.id.to_string(), archive.job.simulated.to_string());
    for iteration in &archive.job.iterations {
        let iteration = serde_json::to_value(iteration).unwrap_or_default();
        let cells = COLUMNS.iter().map(|(_, at)| match iteration.pointer(at) {
            None | Some(Value::Null) => String::new(),
            Some(Value::String(text)) => csv_field(text),
            Some(value) => value.to_string(),
        });
        text.push_str(&[job.clone(), simulated.clone()].into_iter().chain(cells).collect::<Vec<_>>().join(","));
        text.push_str("\r\n");
    }
    text
}
