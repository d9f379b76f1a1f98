//! `--faults PLAN.json`: what is to go wrong with the simulated bench, and when.

use std::path::PathBuf;

use anyhow::{Context as _, bail};

use crate::control::Service;
use crate::device::faults::FaultPlan;

/// The option of commands that can run the simulated bench.
#[derive(Debug, Default, clap::Args)]
pub(super) struct FaultArgs {
    /// Plan of what goes wrong with the simulated bench, and when: see docs/faults.md.
    #[arg(long, value_name = "PLAN.json")]
    faults: Option<PathBuf>,
}

impl FaultArgs {
    /// Whether a plan is named.
    pub(super) const fn is_given(&self) -> bool {
        self.faults.is_some()
    }

    /// The plan named, if one is.
    pub(super) fn read(&self) -> anyhow::Result<Option<FaultPlan>> {
        let Some(path) = &self.faults else { return Ok(None) };
        let text = std::fs::read(path).with_context(|| format!("{} cannot be read", path.display()))?;
        let plan: FaultPlan = serde_path_to_error::deserialize(&mut serde_json::Deserializer::from_slice(&text))
            .with_context(|| format!("{} is no plan of faults", path.display()))?;
        plan.check().with_context(|| format!("{} is no plan of faults", path.display()))?;
        Ok(Some(plan))
    }
}

/// Puts a plan in force.
///
/// # Errors
/// With a bench that is not simulated.
pub(super) fn put_in_force(service: &Service, plan: Option<FaultPlan>) -> anyhow::Result<()> {
    let Some(plan) = plan else { return Ok(()) };
    if !service.bench().is_simulated() {
        bail!("--faults is for the simulated bench only: leave it away, or add --simulated");
    }
    service.run_fault_plan(plan);
    Ok(())
}
