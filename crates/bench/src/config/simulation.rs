//! `[bench.simulation]`: the simulated bench's truth.

pub use plenoptics::sim::texture::Texture;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{BubblesConfig, DustConfig, MicrolensesConfig, MosaicConfig, MotionConfig, ReelConfig};

/// `[bench.simulation]`: how the simulated bench differs from what is configured, and how it looks. The daemon's
/// control loops never read this section.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SimulationConfig {
    /// Seed of noise, texture, and the array's rotation and offset.
    pub seed: u64,
    /// Whether the simulated operator carries out and confirms the job's steps by itself.
    pub operator_confirms: bool,
    /// Texture of the boards.
    pub texture: Texture,
    /// True focal length less the configured, relative.
    pub focal_length_error: f64,
    /// True d less the design's d when the focus axis reads 0, mm.
    pub lens_to_mla_error_mm: f64,
    /// True travel over commanded travel, less 1, of the focus axis.
    pub focus_scale_error: f64,
    /// True travel over commanded travel, less 1, of the e axis.
    pub e_scale_error: f64,
    /// Whether the focus axis moves the wrong way.
    pub focus_sign_flip: bool,
    /// Whether the e axis moves the wrong way.
    pub e_sign_flip: bool,
    /// Lost motion of the focus axis on reversal, mm.
    pub focus_backlash_mm: f64,
    /// Lost motion of the e axis on reversal, mm.
    pub e_backlash_mm: f64,
    /// Moves of either axis shorter than this stick, mm.
    pub friction_step_mm: f64,
    /// True e less the e axis's reading at its home position, mm.
    pub e_zero_offset_mm: f64,
    /// True e at which the lens touches the shell, mm.
    pub contact_e_mm: f64,
    /// Tilt of the MLA about the sensor's y and x axes, mrad: d grows along +x and +y.
    pub mla_tilt_mrad: [f64; 2],
    /// Tilt of the main lens about y and x, mrad.
    pub lens_tilt_mrad: [f64; 2],
    /// Decentre of the shell's centre from the lens's axis, mm.
    pub shell_decentre_mm: [f64; 2],
    /// True board distance less the one asked for, mm.
    pub board_placement_error_mm: f64,
    /// The same of the nearest, middle and farthest level of a triple-level board in air, besides, mm; of a flat board in air the
    /// first each first time that it is put up, the second each second, the third each third.
    pub level_errors_mm: [f64; 3],
    /// The same of the board in water, besides, mm.
    pub water_board_error_mm: f64,
    /// Tilt of the board about y and x, mrad.
    pub board_tilt_mrad: [f64; 2],
    /// Rotation of the array, from +x towards +y, degrees; absent: drawn from the seed within ±1°.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub array_rotation_deg: Option<f64>,
    /// Brown's k1 of the main lens: a chief ray's slope on the image side is its slope t in air on the object side times
    /// 1 + k1 t² (an OpenCV k1: slopes are heights over the focal length). Positive is pincushion, negative barrel. It
    /// moves and stretches what is seen, not the white frame's grid.
    pub distortion_k1: f64,
    /// Aberration of the exit pupil: how far its centre moves along the axis, towards the board, for the field whose slope
    /// on the object side is 0.1, mm; it grows with the slope's square. It moves the micro-images of the outer field:
    /// positive towards the axis.
    pub exit_pupil_walk_mm: f64,
    /// Whether microlenses let neighbours' light through (an array without baffles).
    pub cross_talk: bool,
    /// Read noise, grey levels of an 8-bit frame, standard deviation.
    pub read_noise_levels: f64,
    /// Photon noise: electrons that make a grey level of an 8-bit frame; 0 for none.
    pub electrons_per_level: f64,
    /// Depth of a frame, 8 to 16 bits; white stays at the same share of the range.
    pub bits: u8,
    /// Rays a pixel of a measured frame.
    pub rays: u32,
    /// Rays a pixel of the live preview.
    pub preview_rays: u32,
    /// Frames a second of the live preview.
    pub preview_rate_hz: f64,
    /// How the microlenses differ from each other.
    pub microlenses: MicrolensesConfig,
    /// Dust on the sensor or its cover glass.
    pub dust: DustConfig,
    /// Bubbles before the camera.
    pub bubbles: BubblesConfig,
    /// What moves while the shutter is open.
    pub motion: MotionConfig,
    /// How previews keep pace with an axis in motion.
    pub reel: ReelConfig,
    /// The sensor's colour filters and the board's colours.
    pub mosaic: MosaicConfig,
}

impl Default for SimulationConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            operator_confirms: true,
            texture: Texture::Natural,
            focal_length_error: 0.0,
            lens_to_mla_error_mm: 0.0,
            focus_scale_error: 0.05,
            e_scale_error: 0.05,
            focus_sign_flip: false,
            e_sign_flip: false,
            focus_backlash_mm: 0.03,
            e_backlash_mm: 0.03,
            friction_step_mm: 0.0,
            e_zero_offset_mm: 0.0,
            contact_e_mm: -0.5,
            mla_tilt_mrad: [0.0, 0.0],
            lens_tilt_mrad: [0.0, 0.0],
            shell_decentre_mm: [0.0, 0.0],
            board_placement_error_mm: 0.0,
            level_errors_mm: [0.0; 3],
            water_board_error_mm: 0.0,
            board_tilt_mrad: [0.0, 0.0],
            array_rotation_deg: None,
            distortion_k1: 0.0,
            exit_pupil_walk_mm: 0.0,
            cross_talk: false,
            read_noise_levels: 2.0,
            electrons_per_level: 0.0,
            bits: 8,
            rays: 64,
            preview_rays: 4,
            preview_rate_hz: 30.0,
            microlenses: MicrolensesConfig::default(),
            dust: DustConfig::default(),
            bubbles: BubblesConfig::default(),
            motion: MotionConfig::default(),
            reel: ReelConfig::default(),
            mosaic: MosaicConfig::default(),
        }
    }
}
