//! What a caller asks for with a job: its kind, and what that kind takes.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::field::{Invalid, MAX_TEXT, turns_text};
use bench::config::Config;
use bench::device::AxisName;
use bench::whole::whole_or_none;

/// What a job is to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum JobKind {
    /// Δv in air, then e with the shell on.
    JointAlignment,
    /// Δv in air alone, to what the joint solution wants.
    AirOnly,
    /// e with the shell on alone, after an air step of this run of the program.
    ShellOnly,
    /// Δv for an e that is held (Eq. 8 with e fixed): in air, then trimmed with the shell on.
    ClarityOnly,
    /// l_bound, the least e that the lens's barrel allows (Eqs. 9–12).
    LBoundMeasurement,
    /// The spacing at equal steps of one axis, which goes back where it was.
    FocusSweep,
    /// The spacing over time, with nothing moved.
    SpacingWatch,
    /// d and b from a triple-level board in air, with nothing moved.
    Calibration,
    /// Homing of one axis or both.
    Homing,
}

impl JobKind {
    /// Every kind.
    pub const ALL: [Self; 9] = [
        Self::JointAlignment,
        Self::AirOnly,
        Self::ShellOnly,
        Self::ClarityOnly,
        Self::LBoundMeasurement,
        Self::FocusSweep,
        Self::SpacingWatch,
        Self::Calibration,
        Self::Homing,
    ];
}

/// What a caller asks for with a job. What a kind does not take is refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct JobRequest {
    /// What to do.
    pub kind: JobKind,
    /// What it is for, in the caller's words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(
        min_length = 1,
        max_length = 200,
        pattern = "^[^\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069]*[^\\s\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069][^\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069]*$"
    )]
    pub note: Option<String>,
    /// Whether it is recorded; as `record.jobs` of the configuration has it where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub record: Option<bool>,
    /// The e to hold, mm (clarity only); the configured initial e where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = -1000, maximum = 1000)]
    pub e_mm: Option<f64>,
    /// Distance of the board's middle from the lens's principal point in air, mm (calibration, focus sweep); where the
    /// joint solution has it unless given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 1, maximum = 100000)]
    pub distance_mm: Option<f64>,
    /// The axis to move (focus sweep).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<AxisName>,
    /// Where the sweep begins, mm (focus sweep).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = -10000, maximum = 10000)]
    pub from_mm: Option<f64>,
    /// Where it ends, mm (focus sweep).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = -10000, maximum = 10000)]
    pub to_mm: Option<f64>,
    /// Positions measured, both ends included (focus sweep); 11 where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "whole_or_none")]
    #[schema(minimum = 2, maximum = 200)]
    pub steps: Option<u32>,
    /// For how long, s (spacing watch).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 1, maximum = 86400)]
    pub duration_s: Option<f64>,
    /// Between two measurements, s (spacing watch); 1 where it is not given, and longer where more than 500 measurements
    /// would be made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(minimum = 0.1, maximum = 3600)]
    pub interval_s: Option<f64>,
    /// The axes to home (homing); both where it is not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schema(min_items = 1, max_items = 2)]
    pub axes: Option<Vec<AxisName>>,
}

/// Positions of a focus sweep, at most.
const MAX_STEPS: u32 = 200;
/// Measurements of a spacing watch, at most.
const MAX_MEASUREMENTS: f64 = 500.0;

/// Positions to sweep over.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sweep {
    pub(crate) axis: AxisName,
    pub(crate) from_mm: f64,
    pub(crate) to_mm: f64,
    pub(crate) steps: u32,
}

impl JobRequest {
    /// A request with nothing but its kind.
    #[must_use]
    pub const fn of(kind: JobKind) -> Self {
        Self {
            kind,
            note: None,
            record: None,
            e_mm: None,
            distance_mm: None,
            axis: None,
            from_mm: None,
            to_mm: None,
            steps: None,
            duration_s: None,
            interval_s: None,
            axes: None,
        }
    }

    /// What a kind takes beside a note and whether it is recorded.
    #[must_use]
    pub const fn takes(kind: JobKind) -> &'static [&'static str] {
        match kind {
            JobKind::ClarityOnly => &["e_mm"],
            JobKind::Calibration => &["distance_mm"],
            JobKind::FocusSweep => &["distance_mm", "axis", "from_mm", "to_mm", "steps"],
            JobKind::SpacingWatch => &["duration_s", "interval_s"],
            JobKind::Homing => &["axes"],
            JobKind::JointAlignment | JobKind::AirOnly | JobKind::ShellOnly | JobKind::LBoundMeasurement => &[],
        }
    }

    /// What of it a kind cannot do without.
    #[must_use]
    pub const fn needs(kind: JobKind) -> &'static [&'static str] {
        match kind {
            JobKind::FocusSweep => &["axis", "from_mm", "to_mm"],
            JobKind::SpacingWatch => &["duration_s"],
            _ => &[],
        }
    }

    /// Whether the kind takes what is given, has what it needs, and every number is within its range, for the camera that is
    /// configured.
    ///
    /// # Errors
    /// [`Invalid`], naming the field.
    pub fn check(&self, config: &Config) -> Result<(), Invalid> {
        let takes = Self::takes(self.kind);
        for (field, given) in [
            ("e_mm", self.e_mm.is_some()),
            ("distance_mm", self.distance_mm.is_some()),
            ("axis", self.axis.is_some()),
            ("from_mm", self.from_mm.is_some()),
            ("to_mm", self.to_mm.is_some()),
            ("steps", self.steps.is_some()),
            ("duration_s", self.duration_s.is_some()),
            ("interval_s", self.interval_s.is_some()),
            ("axes", self.axes.is_some()),
        ] {
            if given && !takes.contains(&field) {
                let taken = if takes.is_empty() { "nothing but note and record".to_owned() } else { takes.join(", ") };
                return invalid(field, format!("this kind of job takes {taken}"));
            }
        }
        let cannot_be =
            |note: &str| note.trim().is_empty() || note.chars().count() > MAX_TEXT || note.contains(turns_text);
        if self.note.as_deref().is_some_and(cannot_be) {
            let what = format!("1 to {MAX_TEXT} characters are needed, and no marks that turn the direction of text");
            return invalid("note", what);
        }
        within("e_mm", self.e_mm, -1e3, 1e3)?;
        within("distance_mm", self.distance_mm, 1.0, 1e5)?;
        let focal_mm = config.main_lens.focal_length_mm;
        if let Some(distance_mm) = self.distance_mm.filter(|distance_mm| *distance_mm <= focal_mm) {
            let what = format!(
                "a board at {distance_mm} mm has no image: it stands within the lens's focal length, {focal_mm} mm"
            );
            return invalid("distance_mm", what);
        }
        within("from_mm", self.from_mm, -1e4, 1e4)?;
        within("to_mm", self.to_mm, -1e4, 1e4)?;
        within("duration_s", self.duration_s, 1.0, 86_400.0)?;
        within("interval_s", self.interval_s, 0.1, 3600.0)?;
        within("steps", self.steps.map(f64::from), 2.0, f64::from(MAX_STEPS))?;
        if self.axes.as_ref().is_some_and(|axes| axes.is_empty() || axes.len() > 2) {
            return invalid("axes", "one or both of focus and e are needed".to_owned());
        }
        match self.kind {
            JobKind::FocusSweep => self.sweep().map(drop),
            JobKind::SpacingWatch => self.watch().map(drop),
            _ => Ok(()),
        }
    }

    /// The positions of a focus sweep.
    pub(crate) fn sweep(&self) -> Result<Sweep, Invalid> {
        let (Some(axis), Some(from_mm), Some(to_mm)) = (self.axis, self.from_mm, self.to_mm) else {
            let missing = if self.axis.is_none() {
                "axis"
            } else if self.from_mm.is_none() {
                "from_mm"
            } else {
                "to_mm"
            };
            return invalid(missing, "a focus sweep needs axis, from_mm and to_mm".to_owned());
        };
        Ok(Sweep { axis, from_mm, to_mm, steps: self.steps.unwrap_or(11) })
    }

    /// Duration and interval of a spacing watch, s; the interval is lengthened where there would be too many measurements.
    pub(crate) fn watch(&self) -> Result<(f64, f64), Invalid> {
        let interval_s = self.interval_s.unwrap_or(1.0);
        let Some(duration_s) = self.duration_s else {
            return invalid("duration_s", "a spacing watch needs its duration".to_owned());
        };
        Ok((duration_s, interval_s.max(duration_s / MAX_MEASUREMENTS)))
    }
}

fn invalid<T>(field: &'static str, what: String) -> Result<T, Invalid> {
    Err(Invalid { field, what })
}

fn within(field: &'static str, value: Option<f64>, low: f64, high: f64) -> Result<(), Invalid> {
    match value {
        Some(value) if !(low..=high).contains(&value) => {
            invalid(field, format!("{value} is not within {low} to {high}"))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(request: &JobRequest) -> Option<&'static str> {
        request.check(&Config::default()).err().map(|Invalid { field, .. }| field)
    }

    #[test]
    fn a_kind_takes_what_it_takes_and_needs_what_it_needs() {
        let of = JobRequest::of;
        assert_eq!(field(&of(JobKind::JointAlignment)), None);
        assert_eq!(field(&JobRequest { e_mm: Some(20.0), ..of(JobKind::JointAlignment) }), Some("e_mm"));
        assert_eq!(field(&JobRequest { e_mm: Some(20.0), ..of(JobKind::ClarityOnly) }), None);
        assert_eq!(field(&of(JobKind::FocusSweep)), Some("axis"));
        let sweep =
            JobRequest { axis: Some(AxisName::Focus), from_mm: Some(0.0), to_mm: Some(1.0), ..of(JobKind::FocusSweep) };
        assert_eq!(field(&sweep), None);
        assert_eq!(field(&JobRequest { steps: Some(1), ..sweep.clone() }), Some("steps"));
        assert_eq!(field(&JobRequest { to_mm: Some(f64::NAN), ..sweep.clone() }), Some("to_mm"));
        assert_eq!(field(&JobRequest { note: Some("to 1.5 mm\u{202e}".into()), ..sweep.clone() }), Some("note"));
        assert_eq!(field(&JobRequest { note: Some(" ".into()), ..sweep.clone() }), Some("note"));
        let board_at = |distance_mm| JobRequest { distance_mm: Some(distance_mm), ..sweep.clone() };
        assert_eq!((field(&board_at(20.0)), field(&board_at(20.1))), (Some("distance_mm"), None));
        assert_eq!(field(&of(JobKind::SpacingWatch)), Some("duration_s"));
        let watch = JobRequest { duration_s: Some(3600.0), ..of(JobKind::SpacingWatch) };
        assert_eq!((field(&watch), watch.watch().unwrap()), (None, (3600.0, 7.2)));
        assert_eq!(JobRequest { interval_s: Some(10.0), ..watch }.watch().unwrap(), (3600.0, 10.0));
        assert_eq!(field(&JobRequest { axes: Some(vec![]), ..of(JobKind::Homing) }), Some("axes"));
    }
}
