//! What an operator sets up, and the simulated one.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::faults::Faults;

/// What the job tells the operator to set up before the camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Setup {
    /// A diffuser before the lens, for a white frame.
    Diffuser,
    /// Diffuser off, shell off, in air: the triple-level board at these distances from the main lens's principal
    /// point, mm.
    #[serde(rename = "boards_in_air")]
    AirTripleBoard {
        /// Nearest, middle and farthest level; three times the same for a flat board.
        distances_mm: [f64; 3],
    },
    /// Shell mounted, tank filled, flat board at this distance from the shell's outer vertex, mm.
    #[serde(rename = "board_in_water")]
    WaterBoard {
        /// Distance in water, mm.
        distance_mm: f64,
    },
    /// The lens pushed by hand to the least e the shell allows, motors off; then the board as in `WaterBoard`.
    LeastE {
        /// Distance of the board in water, mm.
        distance_mm: f64,
    },
    /// Shell taken off, tank away, motors on again.
    ShellOff,
    /// The aperture set to a diameter, mm.
    Aperture {
        /// Diameter, mm.
        diameter_mm: f64,
        /// The number on the lens's ring.
        ring_f_number: f64,
    },
}

impl Setup {
    /// Longest distance of a board and widest aperture that are believed, mm; largest number on a lens's ring.
    const MOST: f64 = 1e5;

    /// Whether every number in it can be.
    ///
    /// # Errors
    /// Which cannot, and what it can be.
    pub fn check(&self) -> Result<(), String> {
        let numbers: &[(&str, f64)] = match *self {
            Self::AirTripleBoard { distances_mm: [near, middle, far] } => {
                &[("distances_mm[0]", near), ("distances_mm[1]", middle), ("distances_mm[2]", far)]
            }
            Self::WaterBoard { distance_mm } | Self::LeastE { distance_mm } => &[("distance_mm", distance_mm)],
            Self::Aperture { diameter_mm, ring_f_number } => {
                &[("diameter_mm", diameter_mm), ("ring_f_number", ring_f_number)]
            }
            Self::Diffuser | Self::ShellOff => &[],
        };
        match numbers.iter().find(|(_, value)| !(*value > 0.0 && *value <= Self::MOST)) {
            Some((field, value)) => Err(format!("{field} {value}: it has to be above 0, and at most {}", Self::MOST)),
            None => Ok(()),
        }
    }
}

/// The simulated operator: obeys a set-up instruction on the simulated bench.
pub trait SimulatedOperator: Send + Sync {
    /// Carries out the instruction at once.
    fn obey(&self, setup: &Setup);
    /// Whether the operator also confirms by itself.
    fn confirms(&self) -> bool;
    /// Which earlier step is asked for again in place of confirming `step`, by an operator who confirms by itself.
    fn asks_again(&self, step: u32) -> Option<u32> {
        let _ = step;
        None
    }
    /// The simulated truth as a JSON object, for reports.
    fn truth(&self) -> serde_json::Value;
    /// What goes wrong with the simulated bench.
    fn faults(&self) -> Faults;
    /// Makes that go wrong, and nothing else, from now on.
    fn set_faults(&self, faults: Faults);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_set_up_at_a_place_that_is_none() {
        assert_eq!(Setup::WaterBoard { distance_mm: 800.0 }.check(), Ok(()));
        let why = Setup::AirTripleBoard { distances_mm: [100.0, -1.0, 120.0] }.check().unwrap_err();
        assert!(why.contains("distances_mm[1] -1: it has to be above 0"), "{why}");
        assert!(Setup::Aperture { diameter_mm: f64::NAN, ring_f_number: 4.0 }.check().is_err());
    }
}
