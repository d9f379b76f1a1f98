//! `--faults PLAN.json`: what is to go wrong with the simulated bench, and when.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use serde::de::DeserializeOwned;

use crate::control::Service;
use crate::device::faults::{FaultPlan, PlanError};

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
        self.faults.as_deref().map(|path| read_plan(path, FaultPlan::check)).transpose()
    }
}

/// The plan of faults in a file.
///
/// # Errors
/// Where it cannot be read, or is none, and why.
pub(super) fn read_plan<P: DeserializeOwned>(
    path: &Path,
    check: impl FnOnce(&P) -> Result<(), PlanError>,
) -> anyhow::Result<P> {
    let text = std::fs::read(path).with_context(|| format!("{} cannot be read", path.display()))?;
    let none = || format!("{} is no plan of faults", path.display());
    let plan: P =
        serde_path_to_error::deserialize(&mut serde_json::Deserializer::from_slice(&text)).with_context(none)?;
    check(&plan).with_context(none)?;
    Ok(plan)
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
