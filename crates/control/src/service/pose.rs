//! Where the camera was when a frame was taken, as far as it is known: what turns spacings into distances.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::Service;
use crate::events::ShellState;
use bench::device::Frame;
use plenoptics::imaging::pictures::Pose;
use plenoptics::optics::ExactView;

/// What is before the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Medium {
    /// Air, without the shell.
    Air,
    /// Water, behind the shell.
    Water,
}

/// Where the camera was.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PoseView {
    /// What was before it. Distances count in water from the shell's outer vertex, in air from the main lens's principal
    /// point.
    pub medium: Medium,
    /// Δv, mm: as the last air step calibrated it, or as the focus axis reads.
    pub delta_v_mm: f64,
    /// e as the axis reads, mm; absent in air.
    pub e_mm: Option<f64>,
    /// Whether Δv, d and b are those of an air step rather than of the design and the axis's zero.
    pub calibrated: bool,
}

impl Service {
    /// Where the camera was when a frame was taken; the error is what is not known of it, and what would make it known.
    ///
    /// # Errors
    /// In words.
    pub(super) fn pose_of(&self, frame: &Frame) -> Result<(Pose, PoseView), String> {
        let homed = |axis: &str| format!("the {axis} axis's position is not known; home it");
        let focus_mm = frame.focus.position.ok_or_else(|| homed("focus"))?.value();
        let e_mm = match self.motion.shell() {
            ShellState::Off => None,
            ShellState::On => Some(frame.e.position.ok_or_else(|| homed("e"))?.value()),
            ShellState::Unknown => {
                return Err("it is not known whether the shell is on; say so (PUT /api/v1/shell)".to_owned());
            }
        };
        let design = self.config.design();
        let air = self.eye.air_step();
        let trim_mm = air.as_ref().map_or(0.0, |air| air.focus_scale.unwrap_or(1.0) * (focus_mm - air.focus_mm));
        let delta_v_mm = air.as_ref().map_or(focus_mm, |air| air.delta_v.0 + trim_mm);
        let designed = match e_mm {
            Some(e_mm) => design.exact_in_water(delta_v_mm, e_mm),
            None => design.exact_in_air(delta_v_mm, design.air_distance),
        };
        let view = match &air {
            Some(air) => ExactView {
                lens_to_mla: air.camera.lens_to_mla_mm + trim_mm,
                b: air.camera.mla_to_sensor_mm,
                ..designed
            },
            None => designed,
        };
        let medium = if e_mm.is_some() { Medium::Water } else { Medium::Air };
        let pose = Pose { view, pixel_mm: self.config.pixel_pitch().millimetres() };
        Ok((pose, PoseView { medium, delta_v_mm, e_mm, calibrated: air.is_some() }))
    }
}
