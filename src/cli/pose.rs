//! Where the camera was when a frame was taken, as the command line says it.

/// Δv, and e or that it was in air; each may be left out.
#[derive(Debug, clap::Args)]
pub(super) struct PoseArgs {
    /// Δv at which the frames were taken, mm: gives distances, with --e or --air.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub(super) delta_v: Option<f64>,
    /// e at which the frames were taken through the shell, mm.
    #[arg(long, value_name = "MM", allow_negative_numbers = true, conflicts_with = "air")]
    pub(super) e: Option<f64>,
    /// The frames were taken in air, without the shell.
    #[arg(long)]
    pub(super) air: bool,
}

impl PoseArgs {
    /// # Errors
    /// When a number is not finite.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        for (name, value) in [("--delta-v", self.delta_v), ("--e", self.e)] {
            anyhow::ensure!(value.is_none_or(f64::is_finite), "{name} must be a finite number of millimetres");
        }
        Ok(())
    }
}
