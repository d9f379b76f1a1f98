//! What was recorded beside what came of replaying it.

use serde::Serialize;
use serde_json::{Value, json};

use super::Ended;
use crate::events::MeasurementView;
use crate::job::{Iteration, IterationKind, Stage};

/// A measurement or a decision.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Figure {
    Measured(Box<MeasurementView>),
    Decided(Box<Iteration>),
}

/// What a step of the comparison is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum What {
    /// A measurement.
    Measurement,
    /// A decision.
    Decision,
}

impl What {
    const fn word(self) -> &'static str {
        match self {
            Self::Measurement => "measurement",
            Self::Decision => "decision",
        }
    }
}

/// A measurement or decision as recorded and as replayed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Step {
    /// Which.
    pub what: What,
    /// Counted from 1 among its like.
    pub number: usize,
    /// Part of the alignment, of a decision.
    pub stage: Option<Stage>,
    /// Why it moved, or did not, of a decision.
    pub kind: Option<IterationKind>,
    /// Spacing recorded, px; `null` where there was no such step.
    pub recorded_px: Option<f64>,
    /// Spacing replayed, px; `null` where there was no such step.
    pub replayed_px: Option<f64>,
    /// What was decided when it was recorded, in a sentence.
    pub recorded_decision: Option<String>,
    /// What is decided now.
    pub replayed_decision: Option<String>,
    /// Whether all of it is the same, to the last bit.
    pub same: bool,
}

/// A value that differs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// In what, as `decision 3`.
    pub at: String,
    /// Which of its fields, dotted.
    pub field: String,
    /// As recorded.
    pub recorded: Value,
    /// As replayed.
    pub replayed: Value,
}

impl Figure {
    const fn what(&self) -> What {
        match self {
            Self::Measured(_) => What::Measurement,
            Self::Decided(_) => What::Decision,
        }
    }

    const fn spacing_px(&self) -> f64 {
        match self {
            Self::Measured(view) => view.spacing.spacing_px,
            Self::Decided(iteration) => iteration.spacing.spacing_px,
        }
    }

    fn decision(&self) -> Option<&str> {
        match self {
            Self::Measured(_) => None,
            Self::Decided(iteration) => Some(&iteration.decision),
        }
    }

    /// Every value that has to be the same: all but when it was decided, which is now, and what its measurement has.
    fn values(&self) -> Value {
        let mut values = match self {
            Self::Measured(view) => serde_json::to_value(view),
            Self::Decided(iteration) => serde_json::to_value(iteration),
        }
        .unwrap_or_default();
        if let (Self::Decided(_), Some(values)) = (self, values.as_object_mut()) {
            values.remove("at");
            values.remove("eog");
        }
        values
    }
}

/// Sets what was recorded beside what came of replaying it. Steps that only the replay has are differences where the
/// recording is of a `whole` job; otherwise it went on where the recording ends.
pub(super) fn compare(recorded: &[Figure], replayed: &[Figure], whole: bool) -> (Vec<Step>, Vec<Difference>) {
    let (mut steps, mut differences) = (Vec::new(), Vec::new());
    let mut numbers = [0, 0];
    let length = if whole { recorded.len().max(replayed.len()) } else { recorded.len() };
    for index in 0..length {
        let pair = (recorded.get(index), replayed.get(index));
        let Some(one) = pair.0.or(pair.1) else { continue };
        let what = one.what();
        let number = &mut numbers[usize::from(what == What::Decision)];
        *number += 1;
        let at = format!("{} {number}", what.word());
        let before = differences.len();
        match pair {
            (Some(then), Some(now)) if then.what() == now.what() => {
                differ(&at, "", &then.values(), &now.values(), &mut differences);
            }
            (then, now) => {
                let word = |figure: Option<&Figure>| figure.map_or(Value::Null, |figure| json!(figure.what().word()));
                let (recorded, replayed) = (word(then), word(now));
                differences.push(Difference { at, field: "step".to_owned(), recorded, replayed });
            }
        }
        let (stage, kind) = match one {
            Figure::Decided(iteration) => (Some(iteration.stage), Some(iteration.kind)),
            Figure::Measured(_) => (None, None),
        };
        let decision = |figure: Option<&Figure>| figure.and_then(Figure::decision).map(str::to_owned);
        steps.push(Step {
            what,
            number: *number,
            stage,
            kind,
            recorded_px: pair.0.map(Figure::spacing_px),
            replayed_px: pair.1.map(Figure::spacing_px),
            recorded_decision: decision(pair.0),
            replayed_decision: decision(pair.1),
            same: differences.len() == before,
        });
    }
    (steps, differences)
}

/// How two jobs' ends differ.
pub(super) fn ends(recorded: &Ended, replayed: &Ended) -> Vec<Difference> {
    let mut differences = Vec::new();
    let value = |end: &Ended| serde_json::to_value(end).unwrap_or_default();
    differ("end", "", &value(recorded), &value(replayed), &mut differences);
    differences
}

fn differ(at: &str, field: &str, recorded: &Value, replayed: &Value, found: &mut Vec<Difference>) {
    match (recorded, replayed) {
        (Value::Object(then), Value::Object(now)) => {
            let names = then.keys().chain(now.keys().filter(|name| !then.contains_key(*name)));
            for name in names {
                let field = if field.is_empty() { name.clone() } else { format!("{field}.{name}") };
                let get = |of: &serde_json::Map<String, Value>| of.get(name).cloned().unwrap_or(Value::Null);
                differ(at, &field, &get(then), &get(now), found);
            }
        }
        (then, now) if then == now => {}
        (then, now) => found.push(Difference {
            at: at.to_owned(),
            field: field.to_owned(),
            recorded: then.clone(),
            replayed: now.clone(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(spacing_px: f64) -> Figure {
        let message = bench::record::messages::Measurement {
            spacing: Some(bench::record::messages::Spacing { spacing_px, ..Default::default() }),
            ..Default::default()
        };
        Figure::Measured(Box::new(crate::recording::words::measured(&message)))
    }

    #[test]
    fn the_last_bit_counts() {
        let (one, next) = (19.25, f64::from_bits(19.25f64.to_bits() + 1));
        assert!(compare(&[measured(one)], &[measured(one)], true).1.is_empty());
        let (steps, differences) = compare(&[measured(one)], &[measured(next)], true);
        assert!(!steps[0].same);
        let [difference] = &differences[..] else { panic!("{differences:?}") };
        assert_eq!((difference.at.as_str(), difference.field.as_str()), ("measurement 1", "spacing.spacing_px"));
        assert_eq!(difference.recorded, json!(19.25));
    }

    #[test]
    fn what_is_missing_or_too_much_differs_of_a_whole_job_only() {
        let (two, one) = ([measured(1.0), measured(2.0)], [measured(1.0)]);
        assert_eq!(compare(&two, &one, false).1[0].replayed, Value::Null);
        assert_eq!(compare(&one, &two, true).1[0].at, "measurement 2");
        assert!(compare(&one, &two, false).1.is_empty());
    }
}
