//! Calibration from a board of several levels: d and b from the spacings of boards at known distances.
//!
//! Each board's spacing l_i gives N_i = D/(D − l_i) (which is a_i/b), and its distance L_i the image distance
//! v_i = f L_i/(L_i − f). Since v_i = d + N_i b, (d, b) is a straight-line fit of v against N (the paper's references 28
//! and 29, restated). N is negative in Keplerian mode; nothing else changes. Near b or d alone, d + N b at the design's
//! N lies amid the boards and is known far better.
//!
//! Where only the steps between the boards are known, their common distance is a third unknown; f may be a fourth. 1/N
//! is a fraction of two linear functions of the distance, so spacings alone tell three numbers, and those badly: f, b
//! and d cannot be told apart from spacings against distance. The micro-image pitch, D (d + b)/d, is the equation that
//! helps. What the equations at hand leave undetermined is refused by name.

mod adjustment;
mod error;
mod line;
mod pitch;
mod regions;
#[cfg(test)]
mod tests;
mod unknowns;

use nalgebra::DMatrix;

pub use error::CalibrationError;
pub use line::{ConjugateLine, Estimate, FittedPitch, Level, fit_line};
pub use pitch::{MicroImagePitch, PitchSource};
pub use regions::{Bin, Strips, find_strips};
pub use unknowns::{Degeneracy, Known, Unknown};

use super::grid::Grid;
use super::measurement::{FrameOptions, MeasurementError, WhiteModel, prepare_frame};
use super::misfit::WhiteMisfit;
use super::spacing::{SpacingError, measure_regions};
use crate::optics::MainLens;
use crate::raw::RawImage;

/// Correlation of neighbours below which a strip is no board.
const LEAST_CORRELATION: f64 = 0.6;

/// What is known for a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationOptions {
    /// How the frame is measured; the MLA pitch is D.
    pub frame: FrameOptions,
    /// Side of a pixel, mm.
    pub pixel_mm: f64,
    /// The main lens.
    pub main_lens: MainLens,
    /// How well what all distances share is known: where the principal point is, or where the boards stand as a whole.
    /// Where not at all, only the steps between the distances given count.
    pub distances: Known,
    /// Standard uncertainty that each distance has of its own (how well the steps were made), mm, >= 0.
    pub distance_each_sigma_mm: f64,
    /// How well f is known.
    pub focal_length: Known,
    /// b and its standard uncertainty (mm), where the boards cannot tell it: while Δv is far off.
    pub hold_b: Option<(f64, f64)>,
    /// The micro-image pitch as one more equation, and where it comes from.
    pub micro_image_pitch: Option<PitchSource>,
    /// Standard relative uncertainty of the made MLA pitch, >= 0; it matters against the micro-image pitch only.
    pub mla_pitch_relative_sigma: f64,
}

impl CalibrationOptions {
    /// Distances and f known exactly, b free, and spacings as the only equations. `pixel_mm` is the side of a pixel.
    #[must_use]
    pub const fn new(frame: FrameOptions, pixel_mm: f64, main_lens: MainLens) -> Self {
        Self {
            frame,
            pixel_mm,
            main_lens,
            distances: Known::Exactly,
            distance_each_sigma_mm: 0.0,
            focal_length: Known::Exactly,
            hold_b: None,
            micro_image_pitch: None,
            mla_pitch_relative_sigma: 0.0,
        }
    }

    fn check(&self) -> Result<(), CalibrationError> {
        let sigma = |known: Known| known.prior_mm().unwrap_or(1.0);
        let given_pitch = match self.micro_image_pitch {
            Some(PitchSource::Given(pitch)) => pitch.sigma_px,
            Some(PitchSource::Frame) | None => 1.0,
        };
        let impossible = |what, value, needed| Err(CalibrationError::ImpossibleOption { what, value, needed });
        for (what, value) in [
            ("an uncertainty of all distances", sigma(self.distances)),
            ("an uncertainty of f", sigma(self.focal_length)),
            ("an uncertainty of the micro-image pitch", given_pitch),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return impossible(what, value, "it must be finite and above 0");
            }
        }
        for (what, value) in [
            ("an uncertainty of each distance", self.distance_each_sigma_mm),
            ("an uncertainty of the held b", self.hold_b.map_or(0.0, |(_, sigma)| sigma)),
            ("a relative uncertainty of the MLA pitch", self.mla_pitch_relative_sigma),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return impossible(what, value, "it must be finite and not below 0");
            }
        }
        Ok(())
    }
}

/// d and b from a frame, with what else the frame shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// d and b.
    pub line: ConjugateLine,
    /// Tilt x, tilt y (px per half frame width) and curvature (px per half width squared) at the mean spacing.
    pub field_px: [f64; 3],
    /// Standard uncertainty of tilt x and of tilt y, px: boards side by side look tilted where their spacings err apart.
    pub tilt_sigmas_px: [f64; 2],
    /// Radius of the masks that pairs were compared with, px.
    pub window_px: f64,
    /// The micro-images of the frame.
    pub grid: Grid,
}

/// The boards of a frame as the frame shows them, whatever their distances.
#[derive(Debug, Clone, PartialEq)]
pub struct Boards {
    /// From the nearest board to the furthest, px.
    spacings_px: Vec<f64>,
    /// Their covariance, px².
    covariance: DMatrix<f64>,
    micro_image_pitch: Option<MicroImagePitch>,
    field_px: [f64; 3],
    tilt_sigmas_px: [f64; 2],
    window_px: f64,
    grid: Grid,
}

impl Boards {
    /// Measures so many boards side by side.
    ///
    /// # Errors
    /// [`CalibrationError`] for boards that cannot be told apart, or a frame that cannot be measured.
    pub fn measure(
        raw: &RawImage,
        white: Option<&WhiteModel>,
        wanted: usize,
        options: &CalibrationOptions,
    ) -> Result<Self, CalibrationError> {
        let mut prepared = prepare_frame(raw, white, &options.frame)?;
        let pitch = prepared.frame.micro_image_pitch_px();
        let mla_pitch = options.frame.spacing.mla_pitch_px;
        let misfit = prepared.vignetting_fit.filter(|fit| !fit.fits());
        let not_found = |found| {
            let failed = CalibrationError::BoardsNotFound { found, wanted };
            match misfit {
                Some(fit) => MeasurementError::from(WhiteMisfit { fit, failed: failed.to_string() }).into(),
                None => failed,
            }
        };
        let strips = find_strips(&prepared.frame, &options.frame.spacing, wanted).ok_or_else(|| not_found(0))?;
        let found = strips.correlations.iter().filter(|&&c| c >= LEAST_CORRELATION).count();
        if found < wanted {
            return Err(not_found(found));
        }
        prepared.frame.assign_regions(|m| strips.of(m.centre, pitch));
        // A tilt between lens and MLA changes d across the array, which a board feels by dl/dd = (D − l)²/(D b).
        let mean = strips.spacings_px.iter().sum::<f64>() / wanted as f64;
        let scales: Vec<f64> =
            strips.spacings_px.iter().map(|l| ((mla_pitch - l) / (mla_pitch - mean)).powi(2)).collect();
        let (grid, frames) = (prepared.grid, [prepared.frame]);
        let regions = measure_regions(&frames, &strips.spacings_px, &scales, &options.frame.spacing);
        let regions = regions.map_err(|error| match error {
            // A strip that is only just wide enough has nothing left beside its boundaries.
            SpacingError::TooFewMicroImages { .. } => not_found(wanted - 1),
            error => MeasurementError::with_white(error, misfit).into(),
        })?;
        // The nearer a board, the larger its spacing, in both modes: its image lies further behind the lens, so a grows
        // (or is less negative), and l = D (1 − b/a) grows with a.
        let mut order: Vec<usize> = (0..wanted).collect();
        order.sort_unstable_by(|&i, &j| regions.spacings_px[j].total_cmp(&regions.spacings_px[i]));
        let covariance = DMatrix::from_fn(wanted, wanted, |i, j| {
            let random = if i == j { regions.sigmas_random_px[order[i]].powi(2) } else { 0.0 };
            // With few field blocks the scatter can come out below noise alone by chance.
            regions.covariance[(order[i], order[j])].max(if i == j { random } else { f64::NEG_INFINITY })
        });
        // The tilts follow the spacings.
        let tilt_sigmas_px = [wanted, wanted + 1]
            .map(|tilt| regions.covariance.get((tilt, tilt)).map_or(0.0, |variance| variance.max(0.0).sqrt()));
        let micro_image_pitch = match options.micro_image_pitch {
            None => None,
            Some(PitchSource::Frame) => Some(MicroImagePitch::of(&grid)),
            Some(PitchSource::Given(pitch)) => Some(pitch),
        };
        Ok(Self {
            spacings_px: order.iter().map(|&r| regions.spacings_px[r]).collect(),
            covariance,
            micro_image_pitch,
            field_px: regions.field_px,
            tilt_sigmas_px,
            window_px: regions.window_px,
            grid,
        })
    }

    /// Calibrates d and b from the boards' distances (mm, in any order), or from the steps between these.
    ///
    /// # Errors
    /// [`CalibrationError`] for degenerate levels.
    pub fn calibrate(
        &self,
        distances_mm: &[f64],
        options: &CalibrationOptions,
    ) -> Result<Calibration, CalibrationError> {
        options.check()?;
        let distances = line::checked(distances_mm, options)?;
        let (found, wanted) = (self.spacings_px.len(), distances.len());
        if found != wanted {
            return Err(CalibrationError::BoardsNotFound { found, wanted });
        }
        let line = fit_line(&distances, &self.spacings_px, &self.covariance, self.micro_image_pitch, options)?;
        Ok(Calibration {
            line,
            field_px: self.field_px,
            tilt_sigmas_px: self.tilt_sigmas_px,
            window_px: self.window_px,
            grid: self.grid.clone(),
        })
    }
}

/// Calibrates d and b from a frame of boards side by side at the given distances (mm, in any order), or with
/// the steps between these.
///
/// # Errors
/// [`CalibrationError`] for degenerate levels, boards that cannot be told apart, or a frame that cannot be measured.
pub fn calibrate(
    raw: &RawImage,
    white: Option<&WhiteModel>,
    distances_mm: &[f64],
    options: &CalibrationOptions,
) -> Result<Calibration, CalibrationError> {
    // What is wrong with the request is said before any work is done.
    options.check()?;
    line::checked(distances_mm, options)?;
    Boards::measure(raw, white, distances_mm.len(), options)?.calibrate(distances_mm, options)
}
