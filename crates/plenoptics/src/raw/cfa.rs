//! Colour filter arrays: which colour a pixel of a mosaic sees.

use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A Bayer pattern, named by its first two rows from the frame's upper left.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CfaPattern {
    /// Red at (0, 0), blue at (1, 1).
    Rggb,
    /// Blue at (0, 0), red at (1, 1).
    Bggr,
    /// Red at (1, 0), blue at (0, 1).
    Grbg,
    /// Blue at (1, 0), red at (0, 1).
    Gbrg,
}

/// A colour of the mosaic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Channel {
    /// Red.
    Red,
    /// Green, in both kinds of rows.
    Green,
    /// Blue.
    Blue,
}

impl Channel {
    /// All of them, in the order of their index.
    pub const ALL: [Self; 3] = [Self::Red, Self::Green, Self::Blue];

    /// 0 for red, 1 for green, 2 for blue.
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }
}

impl CfaPattern {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Rggb, Self::Bggr, Self::Grbg, Self::Gbrg];

    /// The colour that the pixel at column `x` and row `y` sees.
    #[must_use]
    pub const fn channel(self, x: usize, y: usize) -> Channel {
        // Column and row of the first red pixel.
        let (red_x, red_y) = match self {
            Self::Rggb => (0, 0),
            Self::Bggr => (1, 1),
            Self::Grbg => (1, 0),
            Self::Gbrg => (0, 1),
        };
        match (x % 2 == red_x, y % 2 == red_y) {
            (true, true) => Channel::Red,
            (false, false) => Channel::Blue,
            _ => Channel::Green,
        }
    }

    /// Its name as in configurations: `rggb`, `bggr`, `grbg` or `gbrg`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rggb => "rggb",
            Self::Bggr => "bggr",
            Self::Grbg => "grbg",
            Self::Gbrg => "gbrg",
        }
    }
}

impl FromStr for CfaPattern {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|pattern| pattern.name().eq_ignore_ascii_case(name))
            .ok_or_else(|| format!("{name:?} is no Bayer pattern: rggb, bggr, grbg or gbrg"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_spells_the_first_two_rows() {
        for pattern in CfaPattern::ALL {
            let spelt: String = [(0, 0), (1, 0), (0, 1), (1, 1)]
                .map(|(x, y)| match pattern.channel(x + 6, y + 4) {
                    Channel::Red => 'r',
                    Channel::Green => 'g',
                    Channel::Blue => 'b',
                })
                .iter()
                .collect();
            assert_eq!(spelt, pattern.name());
            assert_eq!(pattern.name().to_uppercase().parse(), Ok(pattern));
            assert_eq!(serde_json::to_value(pattern).unwrap(), pattern.name());
        }
        assert!("rgbg".parse::<CfaPattern>().unwrap_err().contains("grbg"));
        assert_eq!(Channel::ALL.map(Channel::index), [0, 1, 2]);
    }
}
