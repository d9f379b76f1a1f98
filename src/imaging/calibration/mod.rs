//! Calibration from a board of several levels: d and b from the spacings of boards at known distances.
//!
//! Each board's spacing l_i gives N_i = D/(D − l_i) (which is a_i/b), and its distance L_i the image distance
//! v_i = f L_i/(L_i − f). Since v_i = d + N_i b, (d, b) is a straight-line fit of v against N (the paper's references 28
//! and 29, restated). N is negative in Keplerian mode; nothing else changes. Near b or d alone, d + N b at the design's
//! N lies amid the boards and is known far better.

mod regions;

use nalgebra::{DMatrix, DVector, Matrix2, Vector2};

pub use regions::{Bin, Strips, find_strips};

use super::grid::Grid;
use super::measurement::{FrameOptions, MeasurementError, WhiteModel, prepare_frame};
use super::spacing::{SpacingError, measure_regions};
use crate::optics::MainLens;
use crate::raw::RawImage;

/// Correlation of neighbours below which a strip is no board.
const LEAST_CORRELATION: f64 = 0.6;

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
        unknowns: &'static str,
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
}

impl From<SpacingError> for CalibrationError {
    fn from(error: SpacingError) -> Self {
        Self::Measurement(error.into())
    }
}

/// What is known for a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationOptions {
    /// How the frame is measured; the MLA pitch is D.
    pub frame: FrameOptions,
    /// Side of a pixel, mm.
    pub pixel_mm: f64,
    /// The main lens: f must be known, it cannot be told from d and b.
    pub main_lens: MainLens,
    /// Standard uncertainty that all distances share (where the principal point is), mm.
    pub distance_sigma_mm: f64,
    /// b and its standard uncertainty (mm), where the boards cannot tell it: while Δv is far off.
    pub hold_b: Option<(f64, f64)>,
}

/// One board of the calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// L: distance from the main lens's principal point, mm.
    pub distance_mm: f64,
    /// Spacing on the axis, px.
    pub spacing_px: f64,
    /// Its standard uncertainty, px.
    pub sigma_px: f64,
    /// What the fit leaves of its image distance, mm.
    pub residual_mm: f64,
}

/// d and b from a frame, with what else the frame shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// d and b.
    pub line: ConjugateLine,
    /// Tilt x, tilt y (px per half frame width) and curvature (px per half width squared) at the mean spacing.
    pub field_px: [f64; 3],
    /// Radius of the masks that pairs were compared with, px.
    pub window_px: f64,
    /// The micro-images of the frame.
    pub grid: Grid,
}

/// The straight line v = d + N b, with the covariance of d and b.
#[derive(Debug, Clone, PartialEq)]
pub struct ConjugateLine {
    /// d: main lens to MLA, mm.
    pub d_mm: f64,
    /// b: MLA to sensor, mm.
    pub b_mm: f64,
    /// Covariance of d and b, mm².
    pub covariance: [[f64; 2]; 2],
    /// The boards, by rising distance.
    pub levels: Vec<Level>,
    /// Sum of squared residuals in units of their uncertainty.
    pub chi_squared: f64,
    /// Residuals beyond the unknowns.
    pub degrees_of_freedom: usize,
}

impl ConjugateLine {
    /// Standard uncertainty of d, mm.
    #[must_use]
    pub fn d_sigma_mm(&self) -> f64 {
        self.covariance[0][0].sqrt()
    }

    /// Standard uncertainty of b, mm.
    #[must_use]
    pub fn b_sigma_mm(&self) -> f64 {
        self.covariance[1][1].sqrt()
    }

    /// d + N b for a signed N (mm) and its standard uncertainty (mm): at the design's N this is v_ADJ of Eq. 15.
    #[must_use]
    pub fn image_distance(&self, signed_resolution: f64) -> (f64, f64) {
        let n = signed_resolution;
        let [[dd, db], [_, bb]] = self.covariance;
        (self.d_mm + n * self.b_mm, (dd + 2.0 * n * db + n * n * bb).max(0.0).sqrt())
    }
}

/// Calibrates d and b from a frame of boards side by side at the given distances (mm, in any order).
///
/// # Errors
/// [`CalibrationError`] for degenerate levels, boards that cannot be told apart, or a frame that cannot be measured.
pub fn calibrate(
    raw: &RawImage,
    white: Option<&WhiteModel>,
    distances_mm: &[f64],
    options: &CalibrationOptions,
) -> Result<Calibration, CalibrationError> {
    let distances = checked(distances_mm, options)?;
    let mut prepared = prepare_frame(raw, white, &options.frame)?;
    let pitch = prepared.frame.micro_image_pitch_px();
    let mla_pitch = options.frame.spacing.mla_pitch_px;
    let wanted = distances.len();
    let not_found = |found| CalibrationError::BoardsNotFound { found, wanted };
    let strips = find_strips(&prepared.frame, &options.frame.spacing, wanted).ok_or_else(|| not_found(0))?;
    let found = strips.correlations.iter().filter(|&&c| c >= LEAST_CORRELATION).count();
    if found < wanted {
        return Err(not_found(found));
    }
    prepared.frame.assign_regions(|m| strips.of(m.centre, pitch));
    // A tilt between lens and MLA changes d across the array, which a board feels by dl/dd = (D − l)²/(D b).
    let mean = strips.spacings_px.iter().sum::<f64>() / wanted as f64;
    let scales: Vec<f64> = strips.spacings_px.iter().map(|l| ((mla_pitch - l) / (mla_pitch - mean)).powi(2)).collect();
    let (grid, frames) = (prepared.grid, [prepared.frame]);
    let regions = measure_regions(&frames, &strips.spacings_px, &scales, &options.frame.spacing);
    let regions = regions.map_err(|error| match error {
        // A strip that is only just wide enough has nothing left beside its boundaries.
        SpacingError::TooFewMicroImages { .. } => not_found(wanted - 1),
        error => error.into(),
    })?;
    // The nearer a board, the larger its spacing, in both modes: its image lies further behind the lens, so a grows (or
    // is less negative), and l = D (1 − b/a) grows with a.
    let mut order: Vec<usize> = (0..wanted).collect();
    order.sort_unstable_by(|&i, &j| regions.spacings_px[j].total_cmp(&regions.spacings_px[i]));
    let spacings: Vec<f64> = order.iter().map(|&r| regions.spacings_px[r]).collect();
    let covariance = DMatrix::from_fn(wanted, wanted, |i, j| {
        let random = if i == j { regions.sigmas_random_px[order[i]].powi(2) } else { 0.0 };
        // With few field blocks the scatter can come out below noise alone by chance.
        regions.covariance[(order[i], order[j])].max(if i == j { random } else { f64::NEG_INFINITY })
    });
    let line = fit_line(&distances, &spacings, &covariance, options)?;
    Ok(Calibration { line, field_px: regions.field_px, window_px: regions.window_px, grid })
}

fn checked(distances_mm: &[f64], options: &CalibrationOptions) -> Result<Vec<f64>, CalibrationError> {
    let needed = if options.hold_b.is_some() { 1 } else { 2 };
    if distances_mm.len() < needed {
        let unknowns = if needed == 1 { "d" } else { "d and b" };
        return Err(CalibrationError::TooFewLevels { given: distances_mm.len(), needed, unknowns });
    }
    let focal_length_mm = options.main_lens.focal_length;
    if let Some(&distance_mm) = distances_mm.iter().find(|&&l| !(l.is_finite() && l > focal_length_mm)) {
        return Err(CalibrationError::ImpossibleLevel { distance_mm, focal_length_mm });
    }
    let mut distances = distances_mm.to_vec();
    distances.sort_unstable_by(f64::total_cmp);
    match distances.windows(2).find(|w| w[1] - w[0] < 1e-6 * w[1]) {
        Some(equal) => Err(CalibrationError::EqualLevels { distance_mm: equal[0] }),
        None => Ok(distances),
    }
}

/// The straight line v = d + N b through boards by rising distance, with the spacings' covariance (px²).
///
/// # Errors
/// [`CalibrationError::Degenerate`] where the spacings cannot be told apart and b is not held.
pub fn fit_line(
    distances_mm: &[f64],
    spacings_px: &[f64],
    covariance_px: &DMatrix<f64>,
    options: &CalibrationOptions,
) -> Result<ConjugateLine, CalibrationError> {
    let count = distances_mm.len();
    let pitch = options.frame.spacing.mla_pitch_px;
    if options.hold_b.is_none() {
        for k in 1..count {
            let sigma = covariance_px[(k, k)].max(0.0).sqrt().hypot(covariance_px[(k - 1, k - 1)].max(0.0).sqrt());
            if spacings_px[k - 1] - spacings_px[k] < 4.0 * sigma {
                let (first_px, second_px) = (spacings_px[k - 1], spacings_px[k]);
                return Err(CalibrationError::Degenerate { first_px, second_px });
            }
        }
    }
    let image_distances: Vec<f64> = distances_mm.iter().map(|&l| options.main_lens.image_distance(l)).collect();
    let resolutions: Vec<f64> = spacings_px.iter().map(|l| pitch / (pitch - l)).collect();
    // dN/dl = N²/D; dv/dL = −(v/L)².
    let leverage: Vec<f64> = resolutions.iter().map(|n| n * n / pitch).collect();
    let lengthening: Vec<f64> = image_distances.iter().zip(distances_mm).map(|(v, l)| (v / l).powi(2)).collect();
    let mut b = options.hold_b.map_or_else(|| rough_b(&image_distances, &resolutions), |(b, _)| b);
    let mut solved = None;
    // The weights depend on b: a second round with the fitted b settles them.
    for _ in 0..3 {
        let noise = DMatrix::from_fn(count, count, |i, j| {
            b * b * leverage[i] * leverage[j] * covariance_px[(i, j)] + if i == j { 1e-16 } else { 0.0 }
        });
        let Some(weight) = noise.cholesky().map(|c| c.inverse()) else { break };
        let design = DMatrix::from_fn(count, 2, |i, j| if j == 0 { 1.0 } else { resolutions[i] });
        let v = DVector::from_column_slice(&image_distances);
        let projected = design.transpose() * &weight;
        let normal = &projected * &design;
        let mut normal = Matrix2::new(normal[(0, 0)], normal[(0, 1)], normal[(1, 0)], normal[(1, 1)]);
        let right = &projected * &v;
        let mut right = Vector2::new(right[0], right[1]);
        if let Some((held, sigma)) = options.hold_b {
            let precision = 1.0 / sigma.max(1e-9).powi(2);
            normal[(1, 1)] += precision;
            right[1] += precision * held;
        }
        let Some(inverse) = normal.try_inverse() else { break };
        let solution = inverse * right;
        b = solution[1];
        let line = Vector2::new(solution[0], solution[1]);
        let residuals = &v - &design * line;
        let chi_squared = (residuals.transpose() * &weight * &residuals)[(0, 0)];
        // What the shared uncertainty of the distances does to the solution.
        let pull = inverse * (&projected * DVector::from_column_slice(&lengthening)) * options.distance_sigma_mm;
        solved = Some((line, inverse, pull, residuals, chi_squared));
    }
    let degenerate = || {
        let (first_px, second_px) = (spacings_px[0], spacings_px[count - 1]);
        CalibrationError::Degenerate { first_px, second_px }
    };
    let (line, inverse, pull, residuals, chi_squared) = solved.ok_or_else(degenerate)?;
    let degrees_of_freedom = (count + usize::from(options.hold_b.is_some())).saturating_sub(2);
    // Residuals larger than the spacings' uncertainty explains widen the result.
    let widening = if degrees_of_freedom > 0 { (chi_squared / degrees_of_freedom as f64).max(1.0) } else { 1.0 };
    let term = |i: usize, j: usize| inverse[(i, j)] * widening + pull[i] * pull[j];
    let levels = (0..count)
        .map(|k| Level {
            distance_mm: distances_mm[k],
            spacing_px: spacings_px[k],
            sigma_px: covariance_px[(k, k)].max(0.0).sqrt(),
            residual_mm: residuals[k],
        })
        .collect();
    Ok(ConjugateLine {
        d_mm: line[0],
        b_mm: line[1],
        covariance: [[term(0, 0), term(0, 1)], [term(1, 0), term(1, 1)]],
        levels,
        chi_squared,
        degrees_of_freedom,
    })
}

/// b from the outermost boards.
fn rough_b(image_distances: &[f64], resolutions: &[f64]) -> f64 {
    let last = image_distances.len() - 1;
    (image_distances[last] - image_distances[0]) / (resolutions[last] - resolutions[0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::mla::spacing;

    fn options(hold_b: Option<(f64, f64)>) -> CalibrationOptions {
        CalibrationOptions {
            frame: FrameOptions::new(0.1 / 0.00345),
            pixel_mm: 0.00345,
            main_lens: MainLens { focal_length: 20.0 },
            distance_sigma_mm: 0.0,
            hold_b,
        }
    }

    /// Spacings (px) that boards at these distances have in a camera with this d and b.
    fn spacings(distances: &[f64], d: f64, b: f64) -> Vec<f64> {
        let lens = MainLens { focal_length: 20.0 };
        distances.iter().map(|&l| spacing(0.1, lens.image_distance(l) - d, b) / 0.00345).collect()
    }

    #[test]
    fn exact_spacings_give_d_and_b_back() {
        for d in [21.652_86, 19.447_8, 24.3] {
            let distances = [159.17, 167.17, 175.17];
            let l = spacings(&distances, d, 0.34);
            let covariance = DMatrix::from_diagonal_element(3, 3, 0.005f64.powi(2));
            let c = fit_line(&distances, &l, &covariance, &options(None)).unwrap();
            assert!((c.d_mm - d).abs() < 1e-9 && (c.b_mm - 0.34).abs() < 1e-9, "{c:?}");
            assert!((c.image_distance(3.13).0 - d - 3.13 * 0.34).abs() < 1e-9);
        }
    }

    #[test]
    fn uncertainties_are_those_of_the_reference() {
        // optics.md: boards at 167 ± 8 mm and 0.005 px give σ(d) = 2.9 µm and σ(d + N b) = 0.34 µm.
        let distances = [159.174_586, 167.174_586, 175.174_586];
        let covariance = DMatrix::from_diagonal_element(3, 3, 0.005f64.powi(2));
        let l = spacings(&distances, 21.652_860_5, 0.340_255_6);
        let c = fit_line(&distances, &l, &covariance, &options(None)).unwrap();
        assert!((c.d_sigma_mm() - 2.9e-3).abs() < 0.2e-3, "{}", c.d_sigma_mm());
        assert!((c.image_distance(3.13).1 - 0.34e-3).abs() < 0.03e-3, "{}", c.image_distance(3.13).1);
        // At Δv = 0: 85 and 57 µm, or 3 µm with b held.
        let l = spacings(&distances, 19.447_82, 0.340_255_6);
        let c = fit_line(&distances, &l, &covariance, &options(None)).unwrap();
        assert!((c.d_sigma_mm() - 85e-3).abs() < 5e-3, "{}", c.d_sigma_mm());
        assert!((c.image_distance(3.13).1 - 57e-3).abs() < 4e-3, "{}", c.image_distance(3.13).1);
        let c = fit_line(&distances, &l, &covariance, &options(Some((0.340_255_6, 0.0)))).unwrap();
        assert!((c.image_distance(3.13).1 - 3e-3).abs() < 1e-3, "{}", c.image_distance(3.13).1);
    }

    #[test]
    fn degenerate_levels_are_refused() {
        let refused = |levels: &[f64]| checked(levels, &options(None)).unwrap_err();
        assert!(matches!(refused(&[700.0]), CalibrationError::TooFewLevels { .. }));
        assert!(matches!(refused(&[700.0, 800.0, 700.0]), CalibrationError::EqualLevels { .. }));
        assert!(matches!(refused(&[700.0, 15.0]), CalibrationError::ImpossibleLevel { .. }));
        assert!(matches!(refused(&[700.0, f64::NAN]), CalibrationError::ImpossibleLevel { .. }));
        let covariance = DMatrix::from_diagonal_element(2, 2, 0.01f64.powi(2));
        let close = fit_line(&[700.0, 701.0], &[20.0, 19.99], &covariance, &options(None));
        assert!(matches!(close, Err(CalibrationError::Degenerate { .. })), "{close:?}");
    }
}
