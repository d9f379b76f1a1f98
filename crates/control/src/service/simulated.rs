//! What is made to go wrong with a simulated bench: at once, or by a plan.

use std::sync::{Arc, PoisonError};
use std::time::Duration;

use tokio::time::Instant;
use tokio_util::sync::{CancellationToken, DropGuard};

use super::Service;
use bench::device::SimulatedOperator;
use bench::device::faults::{FaultPlan, Faults};
use bench::store::{Hindrance, Store};

/// A plan in force.
pub(super) struct PlanInForce {
    plan: Arc<FaultPlan>,
    began: Instant,
    /// Ends it with this.
    _end: DropGuard,
}

/// The simulated world and the disk: everything that can be made to go wrong.
struct Hands {
    operator: Arc<dyn SimulatedOperator>,
    store: Store,
}

impl Hands {
    fn set(&self, faults: Faults) {
        self.operator.set_faults(faults);
        let disk = faults.disk;
        self.store.hinder(Hindrance { full: disk.full, delay: Duration::from_millis(disk.delay_ms.into()) });
    }

    /// Lets the plan's events come and go until nothing changes any more.
    async fn carry_out(&self, plan: &FaultPlan, began: Instant) {
        let mut seconds = 0.0;
        loop {
            let faults = plan.at(seconds);
            tracing::info!(seconds, ?faults, "the plan of faults goes on");
            self.set(faults);
            let Some(next) = plan.next_change(seconds) else { return };
            tokio::time::sleep_until(began + Duration::from_secs_f64(next)).await;
            seconds = next;
        }
    }
}

impl Service {
    fn hands(&self) -> Option<Hands> {
        let operator = self.bench.simulated.clone()?;
        Some(Hands { operator, store: self.journal.store().clone() })
    }

    /// What is made to go wrong now; `None` with a bench that is not simulated.
    #[must_use]
    pub fn faults(&self) -> Option<Faults> {
        self.bench.simulated.as_ref().map(|operator| operator.faults())
    }

    /// Makes that go wrong, and nothing else, from now on; a plan in force ends. Nothing happens with a bench that is
    /// not simulated.
    pub fn set_faults(&self, faults: Faults) {
        let mut plan = self.fault_plan.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(hands) = self.hands() {
            *plan = None;
            hands.set(faults);
        }
    }

    /// Puts a plan in force, in the place of another; what went wrong before goes right again unless the plan names it.
    /// Nothing happens with a bench that is not simulated. Must be called within a tokio runtime.
    pub fn run_fault_plan(&self, plan: FaultPlan) {
        let mut in_force = self.fault_plan.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(hands) = self.hands() else { return };
        let (plan, began) = (Arc::new(plan), Instant::now());
        let end = CancellationToken::new();
        *in_force = Some(PlanInForce { plan: Arc::clone(&plan), began, _end: end.clone().drop_guard() });
        // From this very moment, not from when the task first runs.
        hands.set(plan.at(0.0));
        let tasks = self.tasks.clone();
        tokio::spawn(async move {
            let carried_out = end.run_until_cancelled(hands.carry_out(&plan, began));
            tasks.run_until_cancelled(carried_out).await;
        });
    }

    /// The plan in force, and for how long it has been.
    #[must_use]
    pub fn fault_plan(&self) -> Option<(Arc<FaultPlan>, Duration)> {
        let plan = self.fault_plan.lock().unwrap_or_else(PoisonError::into_inner);
        plan.as_ref().map(|plan| (Arc::clone(&plan.plan), plan.began.elapsed()))
    }
}
