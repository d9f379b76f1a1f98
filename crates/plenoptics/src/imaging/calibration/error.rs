//! Why a calibration could not be done.

use super::unknowns::Degeneracy;
use crate::imaging::grid::GridError;
use crate::imaging::measurement::MeasurementError;
use crate::imaging::spacing::SpacingError;

/// Why a calibration could not be done.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// Grid, vignetting or spacing failed.
    #[error(transparent)]
    Measurement(#[from] MeasurementError),
    /// Too few levels for the unknowns.
    #[error("{given} level(s) cannot tell {unknowns}: give at least {needed} boards at different distances")]
    TooFewLevels {
        /// Levels given.
        given: usize,
        /// Levels needed.
        needed: usize,
        /// What is to be found.
        unknowns: String,
    },
    /// A level cannot be imaged.
    #[error(
        "a board at {distance_mm} mm has no real image: distances are from the main lens's principal point and must exceed its focal length of {focal_length_mm} mm"
    )]
    ImpossibleLevel {
        /// The distance given, mm.
        distance_mm: f64,
        /// f, mm.
        focal_length_mm: f64,
    },
    /// Two levels are at the same distance.
    #[error("two boards are at {distance_mm} mm: levels at equal distances cannot tell d and b apart")]
    EqualLevels {
        /// That distance, mm.
        distance_mm: f64,
    },
    /// An option has no meaning.
    #[error("{what} of {value} is impossible: {needed}")]
    ImpossibleOption {
        /// Which.
        what: &'static str,
        /// As given.
        value: f64,
        /// What would be right.
        needed: &'static str,
    },
    /// The picture shows fewer boards than the caller names.
    #[error(
        "{found} of {wanted} boards could be told apart in the picture: each needs texture, a strip at least four micro-images wide, and a spacing of its own"
    )]
    BoardsNotFound {
        /// Boards found.
        found: usize,
        /// Boards named.
        wanted: usize,
    },
    /// The spacings do not differ by more than their uncertainty.
    #[error(
        "the boards' spacings ({first_px:.3} and {second_px:.3} px) do not differ by more than their uncertainty: put the boards further apart"
    )]
    Degenerate {
        /// One spacing, px.
        first_px: f64,
        /// The other, px.
        second_px: f64,
    },
    /// The equations leave some of the unknowns undetermined.
    #[error("{0}")]
    CannotTellApart(Degeneracy),
    /// No real boards behind a lens of this focal length have these spacings.
    #[error(
        "no boards with these steps before a lens of f = {focal_length_mm} mm have the spacings {spacings_px:.3?} px: check the levels, f and the MLA pitch"
    )]
    NoSolution {
        /// f, mm.
        focal_length_mm: f64,
        /// The spacings by rising distance, px.
        spacings_px: Vec<f64>,
    },
    /// The micro-image pitch is not above the MLA pitch.
    #[error(
        "the micro-image pitch of {pitch_px:.4} px is not above the MLA pitch of {mla_pitch_px:.4} px, as (d + b)/d must make it: check the MLA pitch and the pixel"
    )]
    ImpossiblePitch {
        /// Measured, px.
        pitch_px: f64,
        /// D_MLA, px.
        mla_pitch_px: f64,
    },
}

impl From<SpacingError> for CalibrationError {
    fn from(error: SpacingError) -> Self {
        Self::Measurement(error.into())
    }
}

impl From<GridError> for CalibrationError {
    fn from(error: GridError) -> Self {
        Self::Measurement(error.into())
    }
}
