//! The spacing of the image points under adjacent microlenses, as jobs and loops reckon with it.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A spacing measured by a job's iteration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SpacingReading {
    /// Spacing on axis, px.
    pub spacing_px: f64,
    /// Its standard uncertainty, px.
    pub spacing_sigma_px: f64,
    /// Tilt along x, px per half frame width.
    pub tilt_x_px: f64,
    /// Tilt along y, px per half frame width.
    pub tilt_y_px: f64,
    /// Field curvature, px at half the frame's width from the centre.
    pub curvature_px: f64,
    /// Neighbour pairs used.
    pub pairs: u32,
    /// Frames combined.
    pub frames: u32,
}

impl SpacingReading {
    /// The least that either tilt's standard uncertainty can be, px: a slope over an evenly filled field is, at its edge, √3
    /// times as uncertain as the mean.
    pub(crate) fn least_tilt_sigma_px(&self) -> f64 {
        3.0_f64.sqrt() * self.spacing_sigma_px
    }
}

/// How the spacing's tilt differs through the shell from what it was in air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TiltChange {
    /// Along x and y, px per half frame width.
    pub px: [f64; 2],
    /// The standard uncertainty of each, px, with what the field's parts scatter by.
    pub sigma_px: f64,
    /// The least that it can be, by the spacings' own uncertainty, px.
    pub least_sigma_px: f64,
}
