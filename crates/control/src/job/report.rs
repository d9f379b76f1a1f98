//! What a job came to: the report of an alignment, and where its time went.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::{JobState, Measure};
use crate::budget::Budget;

/// Near and far end of an interval; `null` for infinity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Interval {
    /// Lower end, mm.
    pub low_mm: Option<f64>,
    /// Upper end, mm.
    pub high_mm: Option<f64>,
}

/// The spacing of the board in focus behind the shell, at the e aimed for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct SpacingTargets {
    /// Eq. 16, which holds for rays near the axis, px.
    pub paraxial_px: f64,
    /// The one pair of chief rays astride the axis, exactly traced, px.
    pub chief_ray_px: Option<f64>,
    /// Exact rays averaged over the estimator's window, px; `null` before the first measurement.
    pub window_px: Option<f64>,
}

/// Where a job's time went, from when it was accepted to its report, s. The parts add up to the whole.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TimeSpent {
    /// The whole.
    pub total_s: f64,
    /// A person had been asked to do something, and had not confirmed it.
    pub operator_s: f64,
    /// Axes were on their way.
    pub motion_s: f64,
    /// Axes stood, and what they carry had not settled.
    pub settling_s: f64,
    /// The camera had yet to give a frame that was exposed at rest.
    pub frames_s: f64,
    /// Frames were measured.
    pub measuring_s: f64,
    /// Whatever else.
    pub other_s: f64,
}

impl TimeSpent {
    /// What has been spent since an earlier moment of the same job.
    #[must_use]
    pub(crate) fn since(&self, before: &Self) -> Self {
        Self {
            total_s: self.total_s - before.total_s,
            operator_s: self.operator_s - before.operator_s,
            motion_s: self.motion_s - before.motion_s,
            settling_s: self.settling_s - before.settling_s,
            frames_s: self.frames_s - before.frames_s,
            measuring_s: self.measuring_s - before.measuring_s,
            other_s: self.other_s - before.other_s,
        }
    }

    /// What is left of the time that such a job usually takes by itself (s), the operator's not counted, s; `None` where it
    /// has taken longer: when it ends is not known then.
    #[must_use]
    pub fn time_left_s(&self, usual_s: f64) -> Option<f64> {
        let left_s = usual_s - (self.total_s - self.operator_s);
        (left_s > 0.0).then_some(left_s)
    }

    /// The parts in the order in which they are told: what each is, and how long it took, s.
    #[must_use]
    pub const fn parts(&self) -> [(&'static str, f64); 6] {
        [
            ("operator", self.operator_s),
            ("motion", self.motion_s),
            ("settling", self.settling_s),
            ("waiting for frames", self.frames_s),
            ("measuring", self.measuring_s),
            ("other", self.other_s),
        ]
    }
}

/// What an alignment came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Report {
    /// `converged`, `not_converged`, `cancelled` or `failed`.
    pub outcome: JobState,
    /// Why, in words.
    pub reason: String,
    /// What the shell step changed to meet the criterion, in words.
    pub shell_step_done: String,
    /// Where the design's numbers come from.
    pub design_origin: String,
    /// Δv as measured, mm; `null` where the focus axis has been moved since it was.
    pub delta_v_mm: Option<f64>,
    /// Its standard uncertainty, mm.
    pub delta_v_sigma_mm: Option<f64>,
    /// Δv wanted for the e reached, mm.
    pub delta_v_target_mm: f64,
    /// Δv at the end of the air step, mm; `null` where it came to none.
    pub delta_v_air_mm: Option<f64>,
    /// Δv wanted in the air step, mm.
    pub delta_v_air_target_mm: f64,
    /// e as the picture has it, mm; `null` where the axis has been moved since it was measured.
    pub e_mm: Option<f64>,
    /// Its standard uncertainty, mm.
    pub e_sigma_mm: Option<f64>,
    /// e wanted, mm.
    pub e_target_mm: f64,
    /// The e wall, mm.
    pub e_wall_mm: f64,
    /// Readback of the focus axis, mm.
    pub focus_readback_mm: Option<f64>,
    /// Readback of the e axis, mm.
    pub e_readback_mm: Option<f64>,
    /// v + Δv, mm.
    pub image_distance_mm: Option<f64>,
    /// Spacing at the end, px; `null` where an axis has been moved since it was measured.
    pub spacing_px: Option<f64>,
    /// Its standard uncertainty, px.
    pub spacing_sigma_px: Option<f64>,
    /// Spacing wanted, px: one of `spacing_targets`.
    pub spacing_target_px: f64,
    /// What "in focus" is called by rays near the axis and by exact ones.
    pub spacing_targets: SpacingTargets,
    /// Moves in the air step, its probe not counted.
    pub moves_air: u32,
    /// Moves in the shell step, its probe not counted.
    pub moves_shell: u32,
    /// Field of view in water over the sensor's width, degrees; `null` where the edge sees past the shell, or Δv
    /// or e was not measured.
    pub fov_water_deg: Option<f64>,
    /// Aperture diameter to set, mm.
    pub aperture_mm: f64,
    /// The number on the lens's ring for it.
    pub aperture_ring_f_number: f64,
    /// Depth of field in water, from the shell's outer vertex; `null` where nothing is that sharp, or Δv or e was
    /// not measured.
    pub depth_of_field: Option<Interval>,
    /// e values between which the blur stays within the limit, Δv held; `null` where there are none, or Δv or e was not
    /// measured.
    pub e_tolerance: Option<Interval>,
    /// Tilt along x and y at the end, px per half frame width; `null` over a board of several levels.
    pub tilt_px: Option<[f64; 2]>,
    /// The same as an angle between lens and MLA if nothing else were tilted, degrees.
    pub tilt_deg: Option<[f64; 2]>,
    /// The standard uncertainty of either angle, degrees.
    #[serde(default)]
    pub tilt_sigma_deg: Option<f64>,
    /// Energy of gradient of the central view before the first move with the shell, mean per pixel.
    pub eog_before: Option<f64>,
    /// The same at the end.
    pub eog_after: Option<f64>,
    /// True travel over commanded travel as the picture has it, focus axis; `null` where it was not seen to move.
    pub focus_scale: Option<f64>,
    /// True travel over commanded travel as the picture has it, e axis; `null` where it was not seen to move.
    pub e_scale: Option<f64>,
    /// l_bound used, mm.
    pub l_bound_mm: f64,
    /// Standard uncertainty of a measured l_bound with all that is taken for granted, mm.
    pub l_bound_sigma_mm: Option<f64>,
    /// What Δv, e and focus are good to; `null` where the camera was not looked at through the shell, and in a report of a
    /// version that did not tell.
    #[serde(default)]
    pub budget: Option<Budget>,
    /// Where the time went; `null` in a report of a version that did not tell.
    #[serde(default)]
    pub time_spent: Option<TimeSpent>,
    /// What a reader should know before trusting the figures, one sentence each.
    pub notes: Vec<String>,
    /// The simulated truth, on a simulated bench.
    #[schema(value_type = Option<Object>)]
    pub truth: Option<serde_json::Value>,
}

impl Report {
    /// Whether it tells the figure that a job was at last measured to have.
    pub(crate) fn tells(&self, measure: &Measure) -> bool {
        match measure.name.as_str() {
            "delta_v_mm" => self.delta_v_mm.is_some(),
            _ => self.spacing_px.is_some(),
        }
    }
}
