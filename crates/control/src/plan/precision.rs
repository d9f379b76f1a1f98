//! What a plan expects its measurements to be good to.

use super::Plan;
use bench::config::{BenchDriver, BoardTexture, Config};

/// What a spacing is good to over a texture.
struct OverTexture {
    /// What the estimator's own model is good to, px.
    model_px: f64,
    /// Standard uncertainty, px, by a grey level of noise in a single pixel: the frame's pixels share it.
    px_per_level: f64,
}

/// As measured in frames of either renderer with a noise of 2 grey levels; of print the estimator's bias is the most.
const fn over(texture: BoardTexture) -> OverTexture {
    let (model_px, px_per_level) = match texture {
        BoardTexture::Natural => (0.002, 0.4),
        BoardTexture::Charuco => (0.002, 0.17),
        BoardTexture::Print => (0.006, 0.25),
    };
    OverTexture { model_px, px_per_level }
}

/// A texture in words.
const fn name(texture: BoardTexture) -> &'static str {
    match texture {
        BoardTexture::Natural => "natural texture",
        BoardTexture::Charuco => "ChArUco",
        BoardTexture::Print => "print",
    }
}

/// Noise assumed where none is configured, grey levels of 255.
const NOISE_LEVELS: f64 = 2.0;

/// Standard uncertainties to be expected from the picture alone, and what they assume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Precision {
    /// Noise of a pixel that is assumed, grey levels of 255.
    pub(super) noise_levels: f64,
    /// What is on the boards, in words.
    pub(super) texture: &'static str,
    /// Of a measured spacing, px.
    pub(super) spacing_px: f64,
    /// Of Δv by one board at the solution, mm.
    pub(super) delta_v_mm: f64,
    /// Of e by the spacing near its optimum, mm: with the axis's own where the picture cannot tell it.
    pub(super) e_mm: f64,
}

/// Noise of a pixel, grey levels of 255: as the bench is simulated, or assumed.
fn noise_levels(config: &Config) -> f64 {
    match config.bench.driver {
        BenchDriver::Simulated => config.bench.simulation.read_noise_levels,
        BenchDriver::Hardware => NOISE_LEVELS,
    }
}

/// Standard uncertainty to be expected of a spacing, px.
pub(super) fn spacing_sigma_px(config: &Config) -> f64 {
    let pixels = f64::from(config.sensor.width_px) * f64::from(config.sensor.height_px);
    let OverTexture { model_px, px_per_level } = over(config.boards.texture);
    model_px.hypot(px_per_level * noise_levels(config) / pixels.sqrt())
}

impl Precision {
    /// That of a plan.
    pub(super) fn of(config: &Config, plan: &Plan) -> Self {
        let spacing_px = spacing_sigma_px(config);
        let pitch_px = plan.design.mla.pitch / config.pixel_pitch().millimetres();
        let solution = &plan.solution;
        let by_delta_v = plan.design.spacing_per_delta_v(solution.equivalent_distance, solution.delta_v).abs()
            / config.pixel_pitch().millimetres();
        let by_e = plan.slope_e(plan.solution.e) * pitch_px;
        let (picture_mm, axis_mm) = (spacing_px / by_e, plan.e.unknown_mm(plan.solution.e));
        Self {
            noise_levels: noise_levels(config),
            texture: name(config.boards.texture),
            spacing_px,
            delta_v_mm: spacing_px / by_delta_v,
            e_mm: picture_mm * axis_mm / picture_mm.hypot(axis_mm),
        }
    }
}
