//! Whoever stood at the bench: every step was carried out when it was recorded.

use std::collections::HashMap;

use crate::device::faults::Faults;
use crate::device::{Setup, SimulatedOperator};
use crate::record::messages::Answer;

/// What the operator is called in recorded answers.
pub const OPERATOR: &str = "operator";

/// An operator who has done everything already.
pub(super) struct ReplayedOperator {
    /// In place of which steps which earlier ones were asked for again.
    again: HashMap<u32, u32>,
}

impl ReplayedOperator {
    pub(super) fn new(answers: &[Answer]) -> Self {
        let operators = answers.iter().filter(|answer| answer.device == OPERATOR);
        Self { again: operators.filter_map(|answer| answer.step.zip(answer.again)).collect() }
    }
}

impl SimulatedOperator for ReplayedOperator {
    fn obey(&self, _: &Setup) {}

    fn confirms(&self) -> bool {
        true
    }

    fn asks_again(&self, step: u32) -> Option<u32> {
        self.again.get(&step).copied()
    }

    /// A recording of pictures knows none.
    fn truth(&self) -> serde_json::Value {
        serde_json::Value::Null
    }

    fn faults(&self) -> Faults {
        Faults::default()
    }

    fn set_faults(&self, _: Faults) {}
}
