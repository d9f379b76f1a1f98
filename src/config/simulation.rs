//! `[bench.simulation]`: the simulated bench's truth.

use serde::{Deserialize, Serialize};

/// What is on the simulated boards.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Texture {
    /// A chessboard with marker-like squares.
    Charuco,
    /// Random, with the amplitude spectrum of natural scenes.
    Natural,
    /// A guppy: bright patches on a pale body over gravel.
    Guppy,
    /// An Oscar: dark body with bright blotches over plants.
    Oscar,
}

/// `[bench.simulation]`: how the simulated bench differs from what is configured, and how it looks. The daemon's
/// control loops never read this section.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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
    /// Tilt of the board about y and x, mrad.
    pub board_tilt_mrad: [f64; 2],
    /// Rotation of the array, from +x towards +y, degrees; absent: drawn from the seed within ±1°.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub array_rotation_deg: Option<f64>,
    /// Whether microlenses let neighbours' light through (an array without baffles).
    pub cross_talk: bool,
    /// Read noise, grey levels of an 8-bit frame, standard deviation.
    pub read_noise_levels: f64,
    /// Photon noise: electrons that make a grey level of an 8-bit frame; 0 for none.
    pub electrons_per_level: f64,
    /// Rays a pixel of a measured frame.
    pub rays: u32,
    /// Rays a pixel of the live preview.
    pub preview_rays: u32,
    /// Frames a second of the live preview.
    pub preview_rate_hz: f64,
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
            board_tilt_mrad: [0.0, 0.0],
            array_rotation_deg: None,
            cross_talk: false,
            read_noise_levels: 2.0,
            electrons_per_level: 0.0,
            rays: 64,
            preview_rays: 4,
            preview_rate_hz: 15.0,
        }
    }
}
