//! What a job that is no alignment came to.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::Measure;
use crate::loops::through_focus::FittedPlace;
use bench::device::AxisName;

/// What a job that is no alignment came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Outcome {
    /// Where the axes stand after homing.
    Homing {
        /// Readback of the focus axis, mm; `null` while unknown.
        focus_mm: Option<f64>,
        /// Readback of the e axis, mm; `null` while unknown.
        e_mm: Option<f64>,
    },
    /// The camera as a triple-level board has it.
    Calibration {
        /// Distances of the board's levels from the lens's principal point, mm.
        distances_mm: [f64; 3],
        /// d, mm.
        lens_to_mla_mm: f64,
        /// b, mm.
        mla_to_sensor_mm: f64,
        /// d + N b, mm.
        image_distance_mm: f64,
        /// Its standard uncertainty, mm.
        image_distance_sigma_mm: f64,
        /// Δv, mm: d + N b less the air design's v.
        delta_v_mm: f64,
    },
    /// The least e that the lens's barrel allows.
    LBound {
        /// l_bound, clearance included, mm.
        l_bound_mm: f64,
        /// Standard uncertainty of the e at which the lens touches, with all that is taken for granted, mm.
        sigma_mm: f64,
        /// The e wall that follows, mm.
        e_wall_mm: f64,
    },
    /// The spacing against an axis's position.
    FocusSweep {
        /// The axis swept.
        axis: AxisName,
        /// Positions asked for.
        positions: u32,
        /// Positions at which a spacing was measured: the job's iterations have them.
        measured: u32,
        /// Where the spacing meets its target, between two neighbours, mm; `null` where it does not.
        crossing_mm: Option<f64>,
        /// Its standard uncertainty by the spacings' own and by how they bend between the two, mm.
        crossing_sigma_mm: Option<f64>,
        /// The spacing's change at best focus, px per mm: the curve's, or that between the two neighbours where there is no
        /// curve; `null` where there is neither.
        slope_px_per_mm: Option<f64>,
        /// Best focus: where a curve through all spacings, px, meets the target; `null` where it does not, or there are too few.
        #[serde(default)]
        best_focus: Option<FittedPlace>,
        /// Where a curve about the greatest EOGs is greatest; `null` where they have no peak. It is not where the spacing
        /// meets its target: how sharp a view looks depends on how it is put together, too.
        #[serde(default)]
        eog_peak: Option<FittedPlace>,
    },
    /// The spacing over time.
    SpacingWatch {
        /// Measurements made: the job's iterations have them.
        measured: u32,
        /// How often there was nothing that could be measured: the job's log says why.
        #[serde(default)]
        unmeasured: u32,
        /// Their mean, px.
        mean_px: f64,
        /// Their scatter about a straight line over time, px.
        scatter_px: f64,
        /// That line's slope, px per hour.
        drift_px_per_h: f64,
        /// Its standard uncertainty by the scatter about the line, px per hour; `null` where too little was measured to tell.
        #[serde(default)]
        drift_sigma_px_per_h: Option<f64>,
        /// Least spacing, px.
        least_px: f64,
        /// Greatest spacing, px.
        greatest_px: f64,
    },
}

impl Outcome {
    /// The figure that a job was for, with what it measured last on its way; `None` where it came to none.
    pub(crate) fn measure(&self, last: Option<Measure>) -> Option<Measure> {
        let told = |name: &str, value: f64, sigma: f64| Measure { name: name.to_owned(), value, sigma, target: None };
        match self {
            Self::LBound { l_bound_mm, sigma_mm, .. } => Some(told("l_bound_mm", *l_bound_mm, *sigma_mm)),
            Self::FocusSweep { axis, crossing_mm, crossing_sigma_mm, best_focus, .. } => {
                let curve = best_focus.as_ref().map(|best| (best.position_mm, best.sigma_mm));
                let best = curve.or(crossing_mm.zip(*crossing_sigma_mm));
                let name = match axis {
                    AxisName::Focus => "best_focus_mm",
                    AxisName::E => "best_focus_e_mm",
                };
                best.map(|(at_mm, sigma_mm)| told(name, at_mm, sigma_mm))
            }
            Self::Calibration { delta_v_mm, image_distance_sigma_mm, .. } => {
                Some(told("delta_v_mm", *delta_v_mm, *image_distance_sigma_mm))
            }
            // Most of what one spacing is uncertain by, the mean of many is, too.
            Self::SpacingWatch { mean_px, .. } => last.map(|last| Measure { value: *mean_px, ..last }),
            Self::Homing { .. } => last,
        }
    }
}
