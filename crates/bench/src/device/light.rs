//! What makes a camera's pictures brighter or darker, with values, limits and units as the camera has them.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Which of a camera's controls.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ControlName {
    /// How long a frame is exposed.
    Exposure,
    /// How much what was exposed is amplified: signal and noise alike.
    Gain,
}

impl ControlName {
    /// All, in the order in which a picture is made brighter: a longer exposure has less noise than a greater gain.
    pub const ALL: [Self; 2] = [Self::Exposure, Self::Gain];

    /// The word used in paths and messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Exposure => "exposure",
            Self::Gain => "gain",
        }
    }
}

impl std::fmt::Display for ControlName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// What a control's numbers are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum ControlUnit {
    /// Milliseconds.
    Ms,
    /// A factor: at 2 everything is twice as bright as at 1.
    Factor,
    /// Decibels of amplitude: 20 more are ten times as bright.
    Db,
    /// The camera driver's own numbers, of which it says no more than that larger ones are brighter.
    Driver,
}

impl ControlUnit {
    /// What stands behind a number: `" ms"`, or nothing.
    #[must_use]
    pub const fn suffix(self) -> &'static str {
        match self {
            Self::Ms => " ms",
            Self::Db => " dB",
            Self::Factor | Self::Driver => "",
        }
    }
}

/// A control of a camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LightControl {
    /// Which it is.
    pub name: ControlName,
    /// What the camera calls it: its key in `[bench.camera.controls]`.
    pub key: String,
    /// What value and limits are.
    pub unit: ControlUnit,
    /// The value now; null where it cannot be read.
    pub value: Option<f64>,
    /// Least value.
    pub minimum: f64,
    /// Greatest value.
    pub maximum: f64,
    /// Between values, counted from the least.
    pub step: f64,
    /// What it is without anybody's doing.
    pub default: f64,
    /// Whether the camera adjusts it by itself.
    pub automatic: bool,
    /// Why it cannot be set; null where it can.
    pub locked: Option<String>,
}

impl LightControl {
    /// The value nearest to the one wanted that it takes; `None` outside its limits.
    #[must_use]
    pub fn nearest(&self, wanted: f64) -> Option<f64> {
        if !(self.minimum..=self.maximum).contains(&wanted) {
            return None;
        }
        let steps = ((wanted - self.minimum) / self.step).round();
        // Divided by the steps in a unit where there are whole ones of them, so that 0.3 is not 0.30000000000000004.
        let per_unit = (1.0 / self.step).round();
        let on_step = if per_unit >= 1.0 && (per_unit * self.step - 1.0).abs() < 1e-9 {
            (self.minimum * per_unit + steps).round() / per_unit
        } else {
            self.minimum + steps * self.step
        };
        let last = if on_step > self.maximum { on_step - self.step } else { on_step };
        Some(last)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exposure() -> LightControl {
        LightControl {
            name: ControlName::Exposure,
            key: "exposure_time_absolute".to_owned(),
            unit: ControlUnit::Ms,
            value: Some(10.0),
            minimum: 0.1,
            maximum: 100.0,
            step: 0.1,
            default: 10.0,
            automatic: false,
            locked: None,
        }
    }

    #[test]
    fn the_nearest_value_lies_on_a_step_within_the_limits() {
        let control = exposure();
        for (wanted, nearest) in [(0.1, 0.1), (0.26, 0.3), (12.34, 12.3), (99.97, 100.0), (100.0, 100.0)] {
            assert_eq!(control.nearest(wanted), Some(nearest));
        }
        for outside in [0.0, 0.099, 100.01, -5.0, f64::NAN, f64::INFINITY] {
            assert_eq!(control.nearest(outside), None, "{outside}");
        }
        // Steps are counted from the least value, and the last may lie below the greatest.
        let coarse = LightControl { minimum: -2.0, maximum: 19.0, step: 5.0, ..control };
        for (wanted, nearest) in [(-2.0, -2.0), (0.0, -2.0), (1.0, 3.0), (18.0, 18.0), (19.0, 18.0)] {
            assert_eq!(coarse.nearest(wanted), Some(nearest));
        }
    }
}
