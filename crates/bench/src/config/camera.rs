//! `[main_lens]`, `[mla]`, `[sensor]`, `[shell]`, `[water]`, `[object]`: the plenoptic camera, its shell, the water.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use plenoptics::optics::{ArrayKind, MlaMode, water};
use plenoptics::raw::CfaPattern;

/// `[main_lens]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MainLensConfig {
    /// f, mm.
    pub focal_length_mm: f64,
    /// From the mount's face, which a ruler can touch, to the principal plane, mm, positive towards the object.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub principal_from_mount_mm: Option<f64>,
    /// Standard uncertainty of `principal_from_mount_mm`, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub principal_from_mount_sigma_mm: Option<f64>,
}

impl Default for MainLensConfig {
    fn default() -> Self {
        Self { focal_length_mm: 20.0, principal_from_mount_mm: None, principal_from_mount_sigma_mm: None }
    }
}

/// `[mla]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct MlaConfig {
    /// Square or hexagonal.
    pub array: ArrayKind,
    /// D_MLA: made pitch of the microlenses, mm.
    pub pitch_mm: f64,
    /// f_MLA, mm.
    pub focal_length_mm: f64,
    /// N = a / b.
    pub angular_resolution: f64,
    /// Galilean or Keplerian.
    pub mode: MlaMode,
}

impl Default for MlaConfig {
    fn default() -> Self {
        Self {
            array: ArrayKind::Square,
            pitch_mm: 0.1,
            focal_length_mm: 0.5,
            angular_resolution: 3.13,
            mode: MlaMode::Galilean,
        }
    }
}

/// `[sensor]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SensorConfig {
    /// Side of a pixel, µm.
    pub pixel_um: f64,
    /// Columns of a raw frame.
    pub width_px: u32,
    /// Rows of a raw frame.
    pub height_px: u32,
    /// Bayer pattern of its colour filters; absent: a monochrome sensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mosaic: Option<CfaPattern>,
}

impl Default for SensorConfig {
    fn default() -> Self {
        Self { pixel_um: 3.45, width_px: 1160, height_px: 1160, mosaic: None }
    }
}

/// `[shell]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ShellConfig {
    /// l_OC, mm.
    pub outer_radius_mm: f64,
    /// l_O'C, mm.
    pub inner_radius_mm: f64,
    /// Refractive index of the shell, relative to air.
    pub refractive_index: f64,
}

impl Default for ShellConfig {
    fn default() -> Self {
        Self { outer_radius_mm: 59.0, inner_radius_mm: 51.0, refractive_index: 1.49 }
    }
}

/// `[water]`: either a refractive index, or what it follows from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WaterConfig {
    /// Refractive index, relative to air.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refractive_index: Option<f64>,
    /// Temperature, °C.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<f64>,
    /// Salinity, ‰.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub salinity_permille: Option<f64>,
    /// Wavelength in vacuum, nm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
}

impl Default for WaterConfig {
    fn default() -> Self {
        Self { refractive_index: Some(1.333), temperature_c: None, salinity_permille: None, wavelength_nm: None }
    }
}

/// `[object]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ObjectConfig {
    /// d_OBJ in water, from the shell's outer vertex O, mm.
    pub distance_mm: f64,
    /// d_OBJ of the air design, from the main lens's principal point, mm.
    pub air_distance_mm: f64,
}

impl Default for ObjectConfig {
    fn default() -> Self {
        Self { distance_mm: 800.0, air_distance_mm: 800.0 }
    }
}

impl WaterConfig {
    /// The water's refractive index relative to air: the one given, or that of Quan and Fry for the conditions given.
    ///
    /// NaN where neither is given in full or a condition is out of range, which [`Config::validate`](super::Config::validate)
    /// refuses beforehand: a checked configuration has an index.
    #[must_use]
    pub fn index(&self) -> f64 {
        match (self.refractive_index, self.temperature_c, self.salinity_permille, self.wavelength_nm) {
            (Some(index), ..) => index,
            (None, Some(temperature), Some(salinity), Some(wavelength)) => {
                water::refractive_index(temperature, salinity, wavelength).unwrap_or(f64::NAN)
            }
            _ => f64::NAN,
        }
    }
}
