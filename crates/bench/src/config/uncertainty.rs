//! `[uncertainty]`: how well what is configured is known.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[uncertainty]`: standard uncertainties of configured values, 0 for one that is exact. What the axes' are uncertain by
/// is in their own sections.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct UncertaintyConfig {
    /// Of f, as a share of it.
    pub focal_length: f64,
    /// Of D_MLA, as a share of it.
    pub mla_pitch: f64,
    /// Of f_MLA, as a share of it.
    pub mla_focal_length: f64,
    /// Of b, as a share of it.
    pub mla_to_sensor: f64,
    /// Of where the main lens's exit pupil is, mm: it makes the micro-images' pitch, and is taken to be at M.
    pub exit_pupil_mm: f64,
    /// Of the distance that all boards in air share, mm, besides that of the principal plane.
    pub boards_in_air_mm: f64,
    /// Of each board's step from there, mm.
    pub board_steps_mm: f64,
    /// Of the board's distance in water, mm.
    pub board_in_water_mm: f64,
    /// Of the angle by which a board is not square to the axis, each way, degrees.
    pub board_tilt_deg: f64,
    /// Of the water's index, with the light's wavelength.
    pub water_index: f64,
    /// Of the shell's radii, each, mm.
    pub shell_radii_mm: f64,
    /// Of the shell's index.
    pub shell_index: f64,
    /// Of where the shell's centre is beside the lens's axis, each way, mm.
    pub shell_decentre_mm: f64,
    /// Of what the shell's aberrations add to the spacing over the estimator's window, as a share of it.
    pub shell_aberrations: f64,
}

impl Default for UncertaintyConfig {
    fn default() -> Self {
        Self {
            focal_length: 0.005,
            mla_pitch: 1e-5,
            mla_focal_length: 0.002,
            mla_to_sensor: 0.002,
            exit_pupil_mm: 0.1,
            boards_in_air_mm: 0.1,
            board_steps_mm: 0.1,
            board_in_water_mm: 1.0,
            board_tilt_deg: 0.5,
            water_index: 8e-4,
            shell_radii_mm: 0.05,
            shell_index: 0.001,
            shell_decentre_mm: 0.2,
            shell_aberrations: 0.15,
        }
    }
}

impl UncertaintyConfig {
    /// Each with its key.
    #[must_use]
    pub const fn keyed(&self) -> [(&'static str, f64); 14] {
        [
            ("uncertainty.focal_length", self.focal_length),
            ("uncertainty.mla_pitch", self.mla_pitch),
            ("uncertainty.mla_focal_length", self.mla_focal_length),
            ("uncertainty.mla_to_sensor", self.mla_to_sensor),
            ("uncertainty.exit_pupil_mm", self.exit_pupil_mm),
            ("uncertainty.boards_in_air_mm", self.boards_in_air_mm),
            ("uncertainty.board_steps_mm", self.board_steps_mm),
            ("uncertainty.board_in_water_mm", self.board_in_water_mm),
            ("uncertainty.board_tilt_deg", self.board_tilt_deg),
            ("uncertainty.water_index", self.water_index),
            ("uncertainty.shell_radii_mm", self.shell_radii_mm),
            ("uncertainty.shell_index", self.shell_index),
            ("uncertainty.shell_decentre_mm", self.shell_decentre_mm),
            ("uncertainty.shell_aberrations", self.shell_aberrations),
        ]
    }
}
