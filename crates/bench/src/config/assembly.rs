//! `[assembly]`: how the camera is put together, and to which tolerances.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where l_bound comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LBoundSource {
    /// From `l_bound_mm`.
    Configured,
    /// Measured by the job (Eqs. 9–12), before the air step.
    Measure,
}

/// What the shell step may change to meet Eq. 16.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ShellStep {
    /// Translate e; where the criterion lies beyond the wall, hold e at its optimum and trim Δv (Eq. 8, e fixed).
    TranslateEThenTrim,
    /// Translate e only, as the paper does; ends "not converged" at the wall.
    TranslateE,
    /// Move e to its optimum by its readback and trim Δv only.
    HoldETrim,
}

/// Which spacing counts as in focus behind the shell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SpacingTarget {
    /// Eq. 16, which holds for rays near the axis.
    Paraxial,
    /// What the estimator measures when Eq. 16 holds near the axis: exact rays through the shell, averaged over the
    /// estimator's window.
    Exact,
}

/// `[assembly]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AssemblyConfig {
    /// l_bound, the least e the lens's barrel allows with the clearance wanted, mm.
    pub l_bound_mm: f64,
    /// Whether `l_bound_mm` holds or is measured.
    pub l_bound: LBoundSource,
    /// Clearance added to a measured l_bound, mm (at least three times its uncertainty is taken).
    pub clearance_mm: f64,
    /// e at which the shell is mounted, mm.
    pub initial_e_mm: f64,
    /// Δv_TOL, mm.
    pub delta_v_tolerance_mm: f64,
    /// Tolerance of e, mm.
    pub e_tolerance_mm: f64,
    /// δ: diameter of the blur disc still called sharp, px.
    pub blur_limit_px: f64,
    /// What the shell step may change.
    pub shell_step: ShellStep,
    /// Which spacing the shell step aims at.
    pub spacing_target: SpacingTarget,
}

impl Default for AssemblyConfig {
    fn default() -> Self {
        Self {
            l_bound_mm: 0.0,
            l_bound: LBoundSource::Configured,
            clearance_mm: 0.5,
            initial_e_mm: 30.0,
            delta_v_tolerance_mm: 0.005,
            e_tolerance_mm: 0.1,
            blur_limit_px: 1.0,
            shell_step: ShellStep::TranslateEThenTrim,
            spacing_target: SpacingTarget::Exact,
        }
    }
}

impl AssemblyConfig {
    /// The e wall for an l_bound (mm): l_bound less the e tolerance. No command and no overshoot may pass it.
    #[must_use]
    pub fn e_wall_mm(&self, l_bound_mm: f64) -> f64 {
        l_bound_mm - self.e_tolerance_mm
    }
}
