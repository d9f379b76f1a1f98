//! Sections of `[bench.simulation]` for what a real camera's picture has and an ideal one's has not. All of it is off by
//! default.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// `[bench.simulation.microlenses]`: how the microlenses differ from each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MicrolensesConfig {
    /// Focal lengths of the types of microlenses, over f_MLA; empty: all are f_MLA. A square array has two, chequered: the
    /// type is (i + j) mod 2; a hexagonal one three, no two alike side by side: (i − j) mod 3. i counts along the array's
    /// x axis, j along its second axis (60° from it in a hexagonal array), from the microlens nearest to the axis before
    /// the array is shifted. All share one b.
    pub focal_factors: Vec<f64>,
    /// Share of the microlenses that let no light through, 0 to 1.
    pub dead_share: f64,
    /// Share of the microlenses that are dirty, 0 to 1.
    pub dirty_share: f64,
    /// Least and greatest transmission of a dirty microlens: two are drawn, one for either side of its aperture, and it
    /// changes evenly between them.
    pub dirty_transmission: [f64; 2],
}

impl Default for MicrolensesConfig {
    fn default() -> Self {
        Self { focal_factors: Vec::new(), dead_share: 0.0, dirty_share: 0.0, dirty_transmission: [0.3, 0.9] }
    }
}

/// `[bench.simulation.dust]`: round specks on the sensor or its cover glass.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DustConfig {
    /// How many, over the whole frame.
    pub specks: u32,
    /// Least and greatest radius, µm.
    pub radius_um: [f64; 2],
    /// Least and greatest share of the light that a speck takes, 0 to 1.
    pub opacity: [f64; 2],
    /// How far before the sensor they lie, µm: 0 on it; less than b.
    pub height_um: f64,
}

impl Default for DustConfig {
    fn default() -> Self {
        Self { specks: 0, radius_um: [2.0, 12.0], opacity: [0.3, 1.0], height_um: 0.0 }
    }
}

/// `[bench.simulation.bubbles]`: bubbles of air in the water, drops of water in air, between camera and board. Those
/// that would touch the board or lie behind it are not there; before a diffuser none is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BubblesConfig {
    /// How many, over the whole field.
    pub count: u32,
    /// Least and greatest radius, mm.
    pub radius_mm: [f64; 2],
    /// Least and greatest distance, mm: in water from the shell's outer vertex, in air from the main lens.
    pub distance_mm: [f64; 2],
    /// Radiance of the lamp that each mirrors, over that of a white board.
    pub highlight: f64,
}

impl Default for BubblesConfig {
    fn default() -> Self {
        Self { count: 0, radius_mm: [0.2, 0.8], distance_mm: [60.0, 400.0], highlight: 8.0 }
    }
}

/// `[bench.simulation.motion]`: what moves while the shutter is open. Each movement is even and centred on the frame's
/// nominal pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MotionConfig {
    /// Moments at which the exposure is sampled; 1 takes the picture at one moment, and nothing blurs. With more, the
    /// travel of the bench's axes during a frame blurs it too. A frame takes so many times longer to render.
    pub steps: u32,
    /// Travel of MLA and sensor along Δv in one exposure, µm.
    pub delta_v_um: f64,
    /// Travel of the lens along e in one exposure, µm.
    pub e_um: f64,
    /// Travel of the board along its own x and y in one exposure, µm.
    pub board_um: [f64; 2],
}

impl Default for MotionConfig {
    fn default() -> Self {
        Self { steps: 1, delta_v_um: 0.0, e_um: 0.0, board_um: [0.0, 0.0] }
    }
}

/// `[bench.simulation.reel]`: previews from light that was traced before, so that they keep pace with an axis in motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ReelConfig {
    /// The true Δv that a preview shows is the nearest multiple of this, µm, and nothing blurs; 0: every pose is traced.
    pub step_um: f64,
    /// Poses whose light is kept; each takes four bytes a pixel.
    pub poses: u32,
}

impl Default for ReelConfig {
    fn default() -> Self {
        Self { step_um: 0.0, poses: 64 }
    }
}

/// `[bench.simulation.mosaic]`: what the colour filters of a sensor with `sensor.mosaic` let through, and the boards'
/// colours, which a monochrome sensor sees grey.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MosaicConfig {
    /// What red, green and blue pixels make of white light, over what a monochrome pixel does.
    pub sensitivities: [f64; 3],
    /// How far a channel's reflectance falls below the grey texture's at most, 0 to 1: smooth patches from the seed, for
    /// each channel its own.
    pub colour: f64,
}

impl Default for MosaicConfig {
    fn default() -> Self {
        Self { sensitivities: [0.6, 1.0, 0.5], colour: 0.4 }
    }
}
