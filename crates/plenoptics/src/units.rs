//! Lengths that meet between modules, as types that cannot be mixed up.
//!
//! Inside a formula a length is a plain `f64` whose unit is in its doc line; on a wire it is a number with its unit in
//! the key. Between modules, where millimetres, micrometres and pixels meet, it is one of these types, and this file
//! holds the only conversions.

use std::fmt;
use std::ops::{Add, Div, Mul, Neg, Sub};

use serde::{Deserialize, Serialize};

macro_rules! length {
    ($(#[$doc:meta])* $name:ident, $suffix:literal) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $name(pub f64);

        impl $name {
            /// The bare number, for a formula or a wire.
            #[must_use]
            pub const fn value(self) -> f64 {
                self.0
            }

            /// The distance from zero.
            #[must_use]
            pub const fn abs(self) -> Self {
                Self(self.0.abs())
            }
        }

        impl Add for $name {
            type Output = Self;
            fn add(self, other: Self) -> Self {
                Self(self.0 + other.0)
            }
        }

        impl Sub for $name {
            type Output = Self;
            fn sub(self, other: Self) -> Self {
                Self(self.0 - other.0)
            }
        }

        impl Neg for $name {
            type Output = Self;
            fn neg(self) -> Self {
                Self(-self.0)
            }
        }

        impl Mul<f64> for $name {
            type Output = Self;
            fn mul(self, factor: f64) -> Self {
                Self(self.0 * factor)
            }
        }

        impl Div<f64> for $name {
            type Output = Self;
            fn div(self, divisor: f64) -> Self {
                Self(self.0 / divisor)
            }
        }

        impl Div for $name {
            type Output = f64;
            fn div(self, other: Self) -> f64 {
                self.0 / other.0
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                if let Some(precision) = f.precision() {
                    write!(f, "{:.*} {}", precision, self.0, $suffix)
                } else {
                    write!(f, "{} {}", self.0, $suffix)
                }
            }
        }
    };
}

length! {
    /// A length in the world or on an axis, in millimetres.
    Millimetres, "mm"
}
length! {
    /// A small length, in micrometres.
    Micrometres, "µm"
}
length! {
    /// A length on the sensor, in pixels.
    Pixels, "px"
}

impl From<Micrometres> for Millimetres {
    fn from(length: Micrometres) -> Self {
        Self(length.0 / 1000.0)
    }
}

impl From<Millimetres> for Micrometres {
    fn from(length: Millimetres) -> Self {
        Self(length.0 * 1000.0)
    }
}

/// The side of a (square) pixel: the one bridge between lengths on the sensor and pixels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct PixelPitch(pub Micrometres);

impl PixelPitch {
    /// The pitch in millimetres.
    #[must_use]
    pub fn millimetres(self) -> f64 {
        Millimetres::from(self.0).value()
    }

    /// A length on the sensor in pixels.
    #[must_use]
    pub fn to_pixels(self, length: Millimetres) -> Pixels {
        Pixels(length.value() / self.millimetres())
    }

    /// A length in pixels as a length on the sensor.
    #[must_use]
    pub fn to_millimetres(self, length: Pixels) -> Millimetres {
        Millimetres(length.value() * self.millimetres())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conversions_go_there_and_back() {
        let pitch = PixelPitch(Micrometres(3.45));
        let length = Millimetres(0.1);
        assert!((pitch.to_pixels(length).value() - 28.985_507_246_4).abs() < 1e-9);
        assert!((pitch.to_millimetres(pitch.to_pixels(length)) - length).abs().value() < 1e-15);
        assert_eq!(Micrometres::from(Millimetres(0.005)), Micrometres(5.0));
    }

    #[test]
    fn a_length_is_shown_with_its_unit() {
        assert_eq!(format!("{:.2}", Millimetres(1.0)), "1.00 mm");
        assert_eq!(Pixels(2.5).to_string(), "2.5 px");
    }
}
