//! Whoever stood at the bench: every step was carried out when it was recorded.

use crate::device::faults::Faults;
use crate::device::{Setup, SimulatedOperator};

/// An operator who has done everything already.
pub(super) struct ReplayedOperator;

impl SimulatedOperator for ReplayedOperator {
    fn obey(&self, _: &Setup) {}

    fn confirms(&self) -> bool {
        true
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
