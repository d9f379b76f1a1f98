//! The microlens array: Eqs. 6, 7, 9, 15, 16 in both modes, with a signed.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How the microlenses are arranged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ArrayKind {
    /// On a square lattice.
    Square,
    /// On a hexagonal lattice; its pitch is the distance of nearest neighbours.
    Hexagonal,
}

impl ArrayKind {
    /// The word used in configuration and results.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Square => "square",
            Self::Hexagonal => "hexagonal",
        }
    }

    /// How many times an array turns into itself within a full turn.
    #[must_use]
    pub const fn turns(self) -> usize {
        match self {
            Self::Square => 4,
            Self::Hexagonal => 6,
        }
    }

    /// Where the smallest of these turns takes a place of the array's unit cell, by its indices along the two axes in a grid of
    /// `side` × `side` places.
    #[must_use]
    pub const fn turned(self, [p, q]: [usize; 2], side: usize) -> [usize; 2] {
        match self {
            Self::Square => [(side - q) % side, p],
            Self::Hexagonal => [(side - q) % side, (p + q) % side],
        }
    }
}

/// On which side of the MLA the main lens's image lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MlaMode {
    /// Behind the MLA, towards the sensor: a > 0, spacing below the pitch.
    Galilean,
    /// Before the MLA: a < 0, spacing above the pitch.
    Keplerian,
}

/// A microlens array at a fixed distance b before the sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mla {
    /// Arrangement of the microlenses.
    pub array: ArrayKind,
    /// D_MLA: the made pitch, mm.
    pub pitch: f64,
    /// f_MLA: focal length of a microlens, mm.
    pub focal_length: f64,
    /// N = |a| / b at the design point.
    pub angular_resolution: f64,
    /// Galilean or Keplerian.
    pub mode: MlaMode,
}

impl Mla {
    /// N with the sign of a: positive in Galilean mode, negative in Keplerian.
    #[must_use]
    pub fn signed_resolution(&self) -> f64 {
        match self.mode {
            MlaMode::Galilean => self.angular_resolution,
            MlaMode::Keplerian => -self.angular_resolution,
        }
    }

    /// b (Eqs. 6 and 7): MLA to sensor at the design point, mm.
    #[must_use]
    pub fn b(&self) -> f64 {
        self.focal_length * (1.0 - 1.0 / self.signed_resolution())
    }

    /// a (Eq. 7), signed: from the MLA to the main lens's image at the design point, mm.
    #[must_use]
    pub fn a(&self) -> f64 {
        self.signed_resolution() * self.b()
    }

    /// Eq. 16: the in-focus spacing at the design point, mm on the sensor.
    #[must_use]
    pub fn target_spacing(&self) -> f64 {
        self.spacing(self.a())
    }

    /// The spacing (mm on the sensor) of an image at signed distance `a` (mm) from the MLA: l = D (a − b) / a.
    #[must_use]
    pub fn spacing(&self, a: f64) -> f64 {
        spacing(self.pitch, a, self.b())
    }

    /// How the spacing grows with `a` (mm, signed): dl/da = D b / a², dimensionless and positive in both modes. With the
    /// MLA carried along, dl/dΔv is its negative.
    #[must_use]
    pub fn spacing_slope(&self, a: f64) -> f64 {
        self.pitch * self.b() / (a * a)
    }

    /// Eq. 9: the signed distance a (mm) of the image whose spacing on the sensor is `spacing` (mm).
    #[must_use]
    pub fn a_from_spacing(&self, spacing: f64) -> f64 {
        a_from_spacing(self.pitch, spacing, self.b())
    }

    /// Eq. 18: b_D, the distance (mm) at which a microlens images an object at signed distance `a` (mm) sharply.
    #[must_use]
    pub fn focus_distance(&self, a: f64) -> f64 {
        1.0 / (1.0 / self.focal_length + 1.0 / a)
    }

    /// Eq. 19: diameter (mm) on the sensor of the blur disc of an image at signed distance `a` (mm) from the MLA.
    /// In image terms this is |spacing − target spacing|, exactly.
    #[must_use]
    pub fn blur(&self, a: f64) -> f64 {
        let focus = self.focus_distance(a);
        self.pitch * (focus - self.b()).abs() / focus.abs()
    }

    /// f-number of a microlens, b / D_MLA (Section 2.2).
    #[must_use]
    pub fn f_number(&self) -> f64 {
        self.b() / self.pitch
    }
}

/// l = D (a − b) / a, with a pitch and b of the caller's (calibrated ones, say). All in mm.
#[must_use]
pub fn spacing(pitch: f64, a: f64, b: f64) -> f64 {
    pitch * (1.0 - b / a)
}

/// Eq. 15's v_ADJ: the image distance (mm) on which a camera with a calibrated d and b (mm) is focused in air, with the
/// design's angular resolution signed as in [`Mla::signed_resolution`]: d + N b.
#[must_use]
pub fn adjusted_image_distance(lens_to_mla: f64, b: f64, signed_resolution: f64) -> f64 {
    lens_to_mla + signed_resolution * b
}

/// Eq. 9 with a pitch and b of the caller's: a = b D / (D − l). All in mm; infinite where l = D.
#[must_use]
pub fn a_from_spacing(pitch: f64, spacing: f64, b: f64) -> f64 {
    b * pitch / (pitch - spacing)
}

/// Pitch (mm) of the micro-images on the sensor: D_MLA (d + b) / d, the chief rays' intersection with the sensor.
#[must_use]
pub fn micro_image_pitch(pitch: f64, lens_to_mla: f64, b: f64) -> f64 {
    pitch * (lens_to_mla + b) / lens_to_mla
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn mla(mode: MlaMode, angular_resolution: f64) -> Mla {
        Mla { array: ArrayKind::Square, pitch: 0.1, focal_length: 0.5, angular_resolution, mode }
    }

    #[test]
    fn the_reference_array() {
        let mla = mla(MlaMode::Galilean, 3.13);
        assert!((mla.b() - 0.340_255_591_054).abs() < 1e-11 && (mla.a() - 1.065).abs() < 1e-12);
        assert!((mla.target_spacing() / 0.003_45 - 19.725).abs() < 5e-4);
        // The micro-images' pitch is 1.75 % above the microlenses' in the air design.
        assert!((micro_image_pitch(0.1, 19.447_82, mla.b()) / 0.1 - 1.0175).abs() < 5e-5);
    }

    #[test]
    fn keplerian_spacing_exceeds_the_pitch() {
        let mla = mla(MlaMode::Keplerian, 4.0);
        assert!(mla.a() < 0.0);
        // Eq. 16 for a Keplerian array, with a positive: D (a + b) / a.
        let (a, b) = (mla.a().abs(), mla.b());
        assert!((mla.target_spacing() - mla.pitch * (a + b) / a).abs() < 1e-15);
    }

    proptest! {
        #[test]
        fn conjugates_and_inverses(
            keplerian: bool, resolution in 1.2..12.0f64, offset in -0.5..0.5f64,
        ) {
            let mla = mla(if keplerian { MlaMode::Keplerian } else { MlaMode::Galilean }, resolution);
            let (a, b) = (mla.a(), mla.b());
            // Eq. 6 and Eq. 7, a signed.
            prop_assert!((1.0 / b - 1.0 / a - 1.0 / mla.focal_length).abs() < 1e-12);
            prop_assert!((a.abs() / b / resolution - 1.0).abs() < 1e-12);
            prop_assert!((mla.focus_distance(a) / b - 1.0).abs() < 1e-12);
            let moved = a * (1.0 + offset);
            let spacing = mla.spacing(moved);
            prop_assert!((mla.a_from_spacing(spacing) / moved - 1.0).abs() < 1e-9);
            // The blur disc is the departure of the spacing from its target.
            prop_assert!((mla.blur(moved) - (spacing - mla.target_spacing()).abs()).abs() < 1e-13);
            let h = 1e-5 * moved;
            let slope = (mla.spacing(moved + h) - mla.spacing(moved - h)) / (2.0 * h);
            prop_assert!((mla.spacing_slope(moved) / slope - 1.0).abs() < 1e-6);
        }
    }
}
