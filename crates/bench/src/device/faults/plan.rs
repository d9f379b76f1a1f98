//! Faults that come and go by themselves: which, when, and for how long; of a simulated bench, or of whatever else can be made
//! to go wrong.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use utoipa::ToSchema;

use super::{FaultRange, Faults};

/// Most events of a plan.
const MAX_EVENTS: usize = 1000;
/// Latest begin and longest duration of an event, s: a week.
const MAX_SECONDS: f64 = 604_800.0;

/// What is to go wrong, and when: with a simulated bench, or with whatever else has faults of its own. Counted from the moment
/// at which the plan is put in force.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
#[schema(
    description = "What is to go wrong with a simulated bench, and when. Counted from the moment at which the plan is put \
                        in force, in\nthe bench's own time."
)]
pub struct FaultPlan<F = Faults> {
    /// What happens, in any order. Where events overlap, everything that any of them names goes wrong; of two that name
    /// the same, the later one counts.
    #[schema(max_items = 1000, value_type = Vec<FaultEvent>)]
    pub events: Vec<FaultEvent<F>>,
}

/// Something that goes wrong for a while.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct FaultEvent<F = Faults> {
    /// When it begins, s after the plan was put in force.
    #[schema(minimum = 0, maximum = 604_800)]
    pub at_s: f64,
    /// How long it lasts, s; without, to the end.
    #[serde(default)]
    #[schema(minimum = 0, maximum = 604_800)]
    pub lasts_s: Option<f64>,
    /// What goes wrong; what is not named is left as it is.
    #[schema(value_type = Faults)]
    pub faults: F,
}

/// A plan that cannot be.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// There are too many events.
    #[error("{found} events are more than the {MAX_EVENTS} that a plan may have")]
    TooMany {
        /// How many there are.
        found: usize,
    },
    /// A time is none.
    #[error("events[{event}].{field}: {value} s is not within 0 to {MAX_SECONDS} s")]
    Time {
        /// Which event, counted from 0.
        event: usize,
        /// Which of its times.
        field: &'static str,
        /// What it says.
        value: f64,
    },
    /// A fault is outside its range.
    #[error("events[{event}].faults.{}: {fault}", fault.field)]
    Fault {
        /// Which event, counted from 0.
        event: usize,
        /// What is wrong with it.
        fault: FaultRange,
    },
}

impl PlanError {
    /// Where in the plan, as a path.
    #[must_use]
    pub fn field(&self) -> String {
        match self {
            Self::TooMany { .. } => "events".to_owned(),
            Self::Time { event, field, .. } => format!("events[{event}].{field}"),
            Self::Fault { event, fault } => format!("events[{event}].faults.{}", fault.field),
        }
    }
}

/// What can go wrong at a time; by default nothing does.
pub trait Plannable: Default + Clone + Serialize + DeserializeOwned {
    /// Whether every number is within its range.
    ///
    /// # Errors
    /// The first that is not.
    fn check(&self) -> Result<(), FaultRange>;
}

impl<F> FaultEvent<F> {
    fn ends_at(&self) -> Option<f64> {
        self.lasts_s.map(|lasts| self.at_s + lasts)
    }
}

impl<F: Plannable> FaultPlan<F> {
    /// Whether the plan can be carried out.
    ///
    /// # Errors
    /// The first thing that cannot be.
    pub fn check(&self) -> Result<(), PlanError> {
        let found = self.events.len();
        if found > MAX_EVENTS {
            return Err(PlanError::TooMany { found });
        }
        for (event, planned) in self.events.iter().enumerate() {
            for (field, value) in [("at_s", Some(planned.at_s)), ("lasts_s", planned.lasts_s)] {
                if let Some(value) = value.filter(|value| !(0.0..=MAX_SECONDS).contains(value)) {
                    return Err(PlanError::Time { event, field, value });
                }
            }
            planned.faults.check().map_err(|fault| PlanError::Fault { event, fault })?;
        }
        Ok(())
    }

    /// What goes wrong so many seconds after the plan was put in force.
    #[must_use]
    pub fn at(&self, seconds: f64) -> F {
        let lasts = |event: &&FaultEvent<F>| event.at_s <= seconds && event.ends_at().is_none_or(|end| seconds < end);
        let mut now: Vec<&FaultEvent<F>> = self.events.iter().filter(lasts).collect();
        now.sort_by(|one, other| one.at_s.total_cmp(&other.at_s));
        now.into_iter().fold(F::default(), |faults, event| overlaid(&faults, &event.faults))
    }

    /// The next moment after so many seconds at which anything begins or ends; `None` when nothing changes any more.
    #[must_use]
    pub fn next_change(&self, seconds: f64) -> Option<f64> {
        let times = self.events.iter().flat_map(|event| [Some(event.at_s), event.ends_at()]);
        times.flatten().filter(|&at| at > seconds).min_by(f64::total_cmp)
    }
}

/// Faults with what others name laid over them.
fn overlaid<F: Plannable>(faults: &F, over: &F) -> F {
    let json = |faults: &F| serde_json::to_value(faults).unwrap_or_default();
    let mut merged = json(faults);
    overlay(&mut merged, &json(over), &json(&F::default()));
    // What was made of faults can be read as such.
    serde_json::from_value(merged).unwrap_or_else(|_| over.clone())
}

fn overlay(into: &mut Value, over: &Value, nothing: &Value) {
    match (into, over, nothing) {
        (Value::Object(into), Value::Object(over), Value::Object(nothing)) => {
            for (key, over) in over {
                if let (Some(into), Some(nothing)) = (into.get_mut(key), nothing.get(key)) {
                    overlay(into, over, nothing);
                }
            }
        }
        (into, over, nothing) if over != nothing => *into = over.clone(),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::super::PictureFault;
    use super::*;

    fn plan(text: &str) -> FaultPlan {
        serde_json::from_str(text).unwrap()
    }

    #[test]
    fn events_come_go_and_overlap() {
        let plan = plan(
            r#"{"events": [
                {"at_s": 20, "faults": {"camera": {"picture": "dark"}, "e": {"slip_share": 0.2}}},
                {"at_s": 5, "lasts_s": 30, "faults": {"e": {"slip_share": 0.5, "stalled": true}}}
            ]}"#,
        );
        assert_eq!(plan.check(), Ok(()));
        assert_eq!(plan.at(4.9), Faults::default());
        assert_eq!(plan.at(5.0).e.slip_share, 0.5);
        let both = plan.at(25.0);
        assert_eq!((both.e.slip_share, both.e.stalled, both.camera.picture), (0.2, true, PictureFault::Dark));
        let after = plan.at(35.0);
        assert_eq!((after.e.slip_share, after.e.stalled), (0.2, false));
        let changes: Vec<f64> = std::iter::successors(plan.next_change(0.0), |&at| plan.next_change(at)).collect();
        assert_eq!(changes, [5.0, 20.0, 35.0]);
    }

    #[test]
    fn what_cannot_be_is_named_with_its_place() {
        let faulty =
            plan(r#"{"events": [{"at_s": 0, "faults": {}}, {"at_s": 1, "faults": {"e": {"slip_share": 2}}}]}"#);
        assert_eq!(faulty.check().unwrap_err().field(), "events[1].faults.e.slip_share");
        let early = plan(r#"{"events": [{"at_s": -1, "faults": {}}]}"#);
        assert_eq!(early.check().unwrap_err().field(), "events[0].at_s");
        let event = FaultEvent { at_s: 0.0, lasts_s: None, faults: Faults::default() };
        assert!(FaultPlan { events: vec![event.clone(); 1000] }.check().is_ok());
        let error = FaultPlan { events: vec![event; 1001] }.check().unwrap_err();
        assert!(error.to_string().contains("1001 events"), "{error}");
    }
}
