//! `[assembly]`: how the camera is put together, and to which tolerances.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Config;

/// By how much Δv may change the spacing where its tolerance is not configured, px: a twentieth of the blur that is
/// called sharp.
const DELTA_V_SPACING_PX: f64 = 0.045;
/// The same of e, whose crossing is what a run ends with, px.
pub const E_SPACING_PX: f64 = 0.016;
/// No tolerance of e is wider where it is not configured, mm: beyond it the field of view changes.
const MOST_E_MM: f64 = 1.0;
/// How far the e wall lies beyond l_bound where no tolerance of e is configured, mm.
const WALL_MM: f64 = 0.1;

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
    /// l_bound, the least e the lens's barrel allows with `clearance_mm` left, mm.
    pub l_bound_mm: f64,
    /// Whether `l_bound_mm` holds or is measured.
    pub l_bound: LBoundSource,
    /// How much greater l_bound is than the e at which the lens touches the shell, mm: of `l_bound_mm` so much is clearance, and
    /// so much is added to what is measured, or three times its uncertainty where that is more.
    pub clearance_mm: f64,
    /// e at which the shell is mounted, mm.
    pub initial_e_mm: f64,
    /// Δv_TOL, mm; left out, what changes the spacing by 0.045 px, rounded to 1, 2 or 5 times a power of ten.
    pub delta_v_tolerance_mm: Option<f64>,
    /// Tolerance of e, mm; left out, what changes the spacing by 0.016 px, rounded likewise, 1 at most.
    pub e_tolerance_mm: Option<f64>,
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
            delta_v_tolerance_mm: None,
            e_tolerance_mm: None,
            blur_limit_px: 1.0,
            shell_step: ShellStep::TranslateEThenTrim,
            spacing_target: SpacingTarget::Exact,
        }
    }
}

impl AssemblyConfig {
    /// The e wall for an l_bound (mm): l_bound less the configured e tolerance, or less 0.1 mm, but no further than its
    /// clearance. No command and no overshoot may pass it.
    #[must_use]
    pub fn e_wall_mm(&self, l_bound_mm: f64) -> f64 {
        l_bound_mm - self.e_tolerance_mm.unwrap_or(WALL_MM).min(self.clearance_mm)
    }

    /// The e at which the lens touches the shell by what is configured, mm.
    #[must_use]
    pub fn contact_mm(&self) -> f64 {
        self.l_bound_mm - self.clearance_mm
    }
}

/// To what Δv and e are to be set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerances {
    /// Δv_TOL, mm.
    pub delta_v_mm: f64,
    /// Tolerance of e, mm.
    pub e_mm: f64,
}

impl Config {
    /// The tolerances as configured; where they are not, what changes the spacing of the joint solution by 0.045 px (Δv, and no
    /// less than a step of its axis) and by 0.016 px (e), rounded to 1, 2 or 5 times a power of ten.
    #[must_use]
    pub fn tolerances(&self) -> Tolerances {
        let design = self.design();
        let solution = design.joint(self.assembly.l_bound_mm);
        let [by_delta_v, by_e] = design.spacing_slopes(&solution).map(|slope| slope / self.pixel_pitch().millimetres());
        let assembly = &self.assembly;
        Tolerances {
            // No finer than the axis can be set.
            delta_v_mm: assembly
                .delta_v_tolerance_mm
                .unwrap_or_else(|| rounded((DELTA_V_SPACING_PX / by_delta_v).max(1.0 / self.bench.focus.steps_per_mm))),
            e_mm: assembly.e_tolerance_mm.unwrap_or_else(|| rounded(E_SPACING_PX / by_e).min(MOST_E_MM)),
        }
    }
}

/// The number nearest in ratio of those that are 1, 2 or 5 times a power of ten.
fn rounded(value: f64) -> f64 {
    let decade = 10f64.powf(value.log10().floor());
    let off = |step: &&f64| (value / decade / **step).ln().abs();
    [1.0, 2.0, 5.0, 10.0].iter().min_by(|a, b| off(a).total_cmp(&off(b))).map_or(value, |step| step * decade)
}
