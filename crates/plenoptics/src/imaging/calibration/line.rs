//! d and b of a camera from its boards' spacings: the straight line v = d + N b, and what had to be found besides.

use nalgebra::DMatrix;

use super::adjustment::{Problem, Solution};
use super::pitch::MicroImagePitch;
use super::unknowns::{Degeneracy, Known, Unknown, listed};
use super::{CalibrationError, CalibrationOptions};

/// Share of its own size by which b may be uncertain, and d, and the boards' distance beyond f: four standard deviations
/// from nothing at all, as two spacings have to be to count as different.
const TOLD: f64 = 0.25;
/// The same for f: what is engraved on a lens is better than that.
const FOCAL_LENGTH_TOLD: f64 = 0.05;
/// Least over greatest singular value below which the equations have no solution of their own, only rounding.
const SINGULAR: f64 = 1e-10;
/// Correlation with the loosest unknown that makes another part of its degeneracy: knowing it would more than halve the
/// loosest one's uncertainty.
const PART: f64 = 0.9;

/// One board of the calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// L: distance from the main lens's principal point, mm; with the common shift that was found.
    pub distance_mm: f64,
    /// Spacing on the axis, px.
    pub spacing_px: f64,
    /// Its standard uncertainty, px.
    pub sigma_px: f64,
    /// What the fit leaves of its image distance, mm.
    pub residual_mm: f64,
}

/// A number with its standard uncertainty.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The number, mm.
    pub value_mm: f64,
    /// Its standard uncertainty, mm.
    pub sigma_mm: f64,
}

/// The micro-image pitch as an equation of the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedPitch {
    /// As measured, with the MLA pitch's own uncertainty.
    pub measured: MicroImagePitch,
    /// What the fitted d and b make it, px.
    pub fitted_px: f64,
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
    /// What all boards' distances turned out to have in common beyond those given, mm; `None` where it was held at 0.
    pub shift: Option<Estimate>,
    /// f; `None` where it was held.
    pub focal_length: Option<Estimate>,
    /// The micro-image pitch, where it was an equation.
    pub micro_image_pitch: Option<FittedPitch>,
    /// The boards, by rising distance.
    pub levels: Vec<Level>,
    /// Sum of squared residuals of boards and pitch in units of their uncertainty.
    pub chi_squared: f64,
    /// Equations (boards, pitch, and what was known beforehand) beyond the unknowns.
    pub degrees_of_freedom: usize,
    /// Condition of the equations, each unknown in units of what they tell of it alone: 1 at best; how many times the
    /// unknowns' correlation widens them at worst.
    pub condition: f64,
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

/// The boards' distances (mm, as the caller gave them) by rising distance, where they can be calibrated from.
pub(super) fn checked(distances_mm: &[f64], options: &CalibrationOptions) -> Result<Vec<f64>, CalibrationError> {
    let unknown = unknowns(options);
    let equations = usize::from(options.hold_b.is_some()) + usize::from(options.micro_image_pitch.is_some());
    let priors = [options.distances, options.focal_length].into_iter().filter(|known| known.prior_mm().is_some());
    let told_besides = equations + priors.count();
    let wanted: Vec<Unknown> = match options.hold_b {
        Some(_) => unknown.iter().copied().filter(|&u| u != Unknown::B).collect(),
        None => unknown.clone(),
    };
    let needed = unknown.len().saturating_sub(told_besides).max(1);
    if needed > 3 {
        // Spacing against distance is a fraction of two linear functions of the distance, whatever the number of boards:
        // three numbers and no more.
        return Err(CalibrationError::CannotTellApart(Degeneracy {
            unknowns: unknown,
            loosest: (Unknown::FocalLength, f64::INFINITY),
            with_pitch: false,
            distances_known: false,
        }));
    }
    if distances_mm.len() < needed {
        let (given, unknowns) = (distances_mm.len(), listed(&wanted));
        return Err(CalibrationError::TooFewLevels { given, needed, unknowns });
    }
    let focal_length_mm = options.main_lens.focal_length;
    // Steps may be counted from anywhere.
    let imaged = |l: f64| l.is_finite() && (l > focal_length_mm || options.distances == Known::NotAtAll);
    if let Some(&distance_mm) = distances_mm.iter().find(|&&l| !imaged(l)) {
        return Err(CalibrationError::ImpossibleLevel { distance_mm, focal_length_mm });
    }
    let mut distances = distances_mm.to_vec();
    distances.sort_unstable_by(f64::total_cmp);
    match distances.windows(2).find(|w| w[1] - w[0] < 1e-6 * w[1].abs().max(focal_length_mm)) {
        Some(equal) => Err(CalibrationError::EqualLevels { distance_mm: equal[0] }),
        None => Ok(distances),
    }
}

/// What the options leave to be found.
fn unknowns(options: &CalibrationOptions) -> Vec<Unknown> {
    let mut unknown = vec![Unknown::D, Unknown::B];
    unknown.extend(options.distances.free().then_some(Unknown::Distance));
    unknown.extend(options.focal_length.free().then_some(Unknown::FocalLength));
    unknown
}

/// The straight line v = d + N b through boards by rising distance (mm), with the spacings' covariance (px²) and, where
/// it is to be an equation, the micro-image pitch.
///
/// # Errors
/// [`CalibrationError::Degenerate`] where the spacings cannot be told apart and nothing else tells b,
/// [`CalibrationError::CannotTellApart`] where the equations leave unknowns undetermined, and
/// [`CalibrationError::NoSolution`] where no real boards have these spacings.
pub fn fit_line(
    distances_mm: &[f64],
    spacings_px: &[f64],
    covariance_px: &DMatrix<f64>,
    micro_image_pitch: Option<MicroImagePitch>,
    options: &CalibrationOptions,
) -> Result<ConjugateLine, CalibrationError> {
    let count = distances_mm.len();
    let mla_pitch = options.frame.spacing.mla_pitch_px;
    let sigma = |k: usize| covariance_px[(k, k)].max(0.0).sqrt();
    if options.hold_b.is_none() && micro_image_pitch.is_none() {
        for k in 1..count {
            if spacings_px[k - 1] - spacings_px[k] < 4.0 * sigma(k).hypot(sigma(k - 1)) {
                let (first_px, second_px) = (spacings_px[k - 1], spacings_px[k]);
                return Err(CalibrationError::Degenerate { first_px, second_px });
            }
        }
    }
    // What the made pitch is uncertain by shows in the ratio of the two pitches, b/d of which is a few per cent only.
    let pitch = micro_image_pitch.map(|measured| MicroImagePitch {
        sigma_px: measured.sigma_px.hypot(measured.pitch_px * options.mla_pitch_relative_sigma),
        ..measured
    });
    if let Some(MicroImagePitch { pitch_px, .. }) = pitch.filter(|p| p.pitch_px <= mla_pitch) {
        return Err(CalibrationError::ImpossiblePitch { pitch_px, mla_pitch_px: mla_pitch });
    }
    let resolutions: Vec<f64> = spacings_px.iter().map(|l| mla_pitch / (mla_pitch - l)).collect();
    let problem = Problem {
        lens: options.main_lens,
        distances_mm,
        // dN/dl = N²/D.
        leverage: resolutions.iter().map(|n| n * n / mla_pitch).collect(),
        resolutions,
        covariance_px,
        each_sigma_mm: options.distance_each_sigma_mm,
        ratio: pitch.map(|p| (p.pitch_px / mla_pitch - 1.0, p.sigma_px / mla_pitch)),
        held_b: options.hold_b,
        shift: options.distances,
        focal_length: options.focal_length,
    };
    let solution = problem.solve().ok_or_else(|| CalibrationError::NoSolution {
        focal_length_mm: options.main_lens.focal_length,
        spacings_px: spacings_px.to_vec(),
    })?;
    if let Some(degeneracy) = degeneracy(&solution, &problem) {
        return Err(CalibrationError::CannotTellApart(degeneracy));
    }
    let state = solution.state;
    let estimate = |unknown| {
        let at = solution.free.iter().position(|&u| u == unknown)?;
        Some(Estimate { value_mm: state.value(unknown), sigma_mm: solution.covariance[(at, at)].sqrt() })
    };
    let residuals = problem.residuals_mm(&state);
    let level = |k: usize| Level {
        distance_mm: distances_mm[k] + state.shift,
        spacing_px: spacings_px[k],
        sigma_px: sigma(k),
        residual_mm: residuals[k],
    };
    let term = |i: usize, j: usize| solution.covariance[(i, j)];
    Ok(ConjugateLine {
        d_mm: state.d,
        b_mm: state.b,
        covariance: [[term(0, 0), term(0, 1)], [term(1, 0), term(1, 1)]],
        shift: estimate(Unknown::Distance),
        focal_length: estimate(Unknown::FocalLength),
        micro_image_pitch: pitch
            .map(|measured| FittedPitch { measured, fitted_px: mla_pitch * (1.0 + state.b / state.d) }),
        levels: (0..count).map(level).collect(),
        chi_squared: solution.chi_squared,
        degrees_of_freedom: solution.degrees_of_freedom,
        condition: solution.told.condition(),
    })
}

/// Which unknowns the equations leave undetermined, if any: the one that comes out too loose, and those of which knowing
/// any one would mend it.
fn degeneracy(solution: &Solution, problem: &Problem) -> Option<Degeneracy> {
    let (state, free) = (solution.state, &solution.free);
    let covariance = solution.told.covariance();
    let sigma = |k: usize| covariance[(k, k)].sqrt();
    // By how much each is looser than it may be.
    let excess = |k: usize| {
        let allowed = match free[k] {
            Unknown::D => TOLD * state.d.abs(),
            Unknown::B => TOLD * state.b.abs(),
            Unknown::Distance => TOLD * (problem.distances_mm[0] + state.shift - state.f),
            Unknown::FocalLength => FOCAL_LENGTH_TOLD * state.f,
        };
        sigma(k) / allowed
    };
    let worst = (0..free.len()).max_by(|&i, &j| excess(i).total_cmp(&excess(j)))?;
    let singular = solution.told.condition() > 1.0 / SINGULAR;
    // Written so that a NaN does not pass.
    if !singular && excess(worst) <= 1.0 {
        return None;
    }
    let part = |k: &usize| *k == worst || (covariance[(*k, worst)] / (sigma(*k) * sigma(worst))).abs() > PART;
    Some(Degeneracy {
        unknowns: (0..free.len()).filter(part).map(|k| free[k]).collect(),
        loosest: (free[worst], if singular { f64::INFINITY } else { sigma(worst) }),
        with_pitch: problem.ratio.is_some(),
        distances_known: problem.shift == Known::Exactly,
    })
}
