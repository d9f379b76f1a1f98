//! The spacing l_P0P1: the distance on the sensor between the image points of one object point under adjacent
//! microlenses, estimated jointly from all pairs of neighbouring micro-images.
//!
//! ```text
//!        micro-image A            micro-image B
//!      (      x      )          (   x         )
//!             |<------ spacing ----->|                 the same object point: l apart
//!      |<--- micro-image pitch --->|                   so within the micro-image it moves by l − pitch
//! ```
//!
//! In the field the spacing is l(x, y, φ) = l_0 + t_x x + t_y y + k r² + ½ a r² cos 2(φ − ψ) + ½ s cos 2φ + ½ h sin 2φ, x
//! and y from the frame's centre in units of half its width, r and ψ the same in polar coordinates, ψ and the pair's
//! direction φ from the array's rows; a pair counts at its midpoint. k and a are the mean and the difference of the
//! curvatures along the radius and across it: shells and distortion make them differ. l_0, the value on the axis and the mean over directions, is what Eqs. 9 and 16 mean. s is by how much rows
//! and columns differ, h the same for the diagonals: with l_0 they make the symmetric 2×2 matrix that turns a step on the
//! array into one between image points, which then also lie across the pair by −½ s sin 2φ + ½ h cos 2φ.

mod bound;
mod error;
mod frame;
mod map;
mod model;
mod noise;
mod pair;
mod patch;
mod score;
mod search;
mod slopes;
mod smear;
mod solve;

use nalgebra::DVector;
use serde::Serialize;

pub use error::SpacingError;
pub(super) use frame::{LEAST_VIGNETTING, MARGIN_PX, SATURATED_SHARE, least_mean, whole_fraction};
pub use frame::{MASK_FRACTION, MicroImage, Pair, SpacingFrame};
pub use map::{LensSpacing, LensState, PairMatch, SpacingMap};
pub(super) use model::{ASYMMETRY_PX, Directions, FIELD_TERMS, QUANTISATION, TERMS};
pub use pair::{PairFit, PairStep};
pub(super) use score::{BLOCKS, MODEL_SHARE, block};
pub use search::{GALILEAN_RANGE, KEPLERIAN_RANGE, capture_range, correlation_map};

use crate::optics::{ArrayKind, MlaMode};
use model::Model;
use score::PairScore;
use solve::{Normal, Outcome, iterate};

/// Fewer pairs than this leave nothing to tell scatter from.
pub const LEAST_PAIRS: usize = 24;
/// Smoothing of the slopes that matching is done with, px.
pub const SLOPE_SIGMA_PX: f64 = 1.0;
/// Least half width (px) of the overlap of two masks.
const LEAST_OVERLAP_PX: f64 = 1.5;
/// Median residual, in units of what a right noise estimate would leave, of pairs that match.
const USUAL_RESIDUAL: f64 = 0.8;
/// Correlation of neighbours below which they do not show the same thing.
pub(super) const LEAST_CORRELATION: f64 = 0.6;

/// Candidates of the search nearer than this are the same, px.
const SAME_PX: f64 = 1.0;
/// Correlation by which a match must be better than any other.
const RIVAL_MARGIN: f64 = 0.02;

/// Standard uncertainty that neither noise nor the scatter between regions shows, px: interpolation, the lopsided blur
/// at a mask's edge and the pixels' own area act alike all over a frame. The root mean square error in noise-free
/// exact-ray frames of four textures on square and hexagonal arrays.
pub(crate) const MODEL_SIGMA_PX: f64 = 0.002;
/// Relative distance from the micro-images' own within which a spacing is theirs and no board's. Capture ranges end
/// outside it.
const FIXED_PATTERN: f64 = 0.03;
/// A change of the spacing during the exposure that is refused, px, and how many standard errors it must stand above
/// none.
const SMEAR_PX: f64 = 1.0;
const SMEAR_SIGNIFICANCE: f64 = 5.0;

/// What the caller knows before measuring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpacingOptions {
    /// D_MLA, the made pitch of the microlenses, px: the capture range is a range of it.
    pub mla_pitch_px: f64,
    /// Only this mode's range is searched; both where `None`.
    pub mode: Option<MlaMode>,
    /// Expected spacing, px, tried before any search.
    pub start_px: Option<f64>,
    /// Tilt x, tilt y (px per half frame width) and curvature (px per half width squared) where they are known and not
    /// to be fitted.
    pub field_held: Option<[f64; 3]>,
}

impl SpacingOptions {
    /// Nothing known but the MLA pitch (px).
    #[must_use]
    pub const fn new(mla_pitch_px: f64) -> Self {
        Self { mla_pitch_px, mode: None, start_px: None, field_held: None }
    }
}

/// A measured spacing.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Spacing {
    /// l_0: the spacing on the axis, px.
    pub on_axis_px: f64,
    /// Its standard uncertainty, px: noise and what the model cannot explain, from the scatter between field blocks and
    /// from what is known of the model's own limits.
    pub sigma_px: f64,
    /// Its standard uncertainty from pixel noise alone, px.
    pub sigma_random_px: f64,
    /// The Cramér–Rao bound, px: no unbiased estimator's `sigma_random_px` is less for the pixels within the masks,
    /// texture, every micro-image's gain and offset, and the field terms being unknown too.
    pub sigma_bound_px: f64,
    /// t_x: rise of the spacing along x, px per half frame width.
    pub tilt_x_px: f64,
    /// t_y: rise of the spacing along y (down), px per half frame width.
    pub tilt_y_px: f64,
    /// k: rise of the spacing with the squared distance from the axis, px per half frame width squared.
    pub curvature_px: f64,
    /// a: the curvature seen by pairs along the radius less that seen by pairs across it, px per half width squared.
    pub astigmatism_px: f64,
    /// s: spacing along the array's rows (its first lattice direction) less that along its columns, px.
    pub row_column_px: f64,
    /// h: the same for the directions 45° further, px.
    pub diagonal_px: f64,
    /// Covariance of l_0, t_x, t_y, k, a, s, h (px²), from the scatter between field blocks. Zero for terms held.
    pub covariance: [[f64; 1 + TERMS]; 1 + TERMS],
    /// Radius of the masks about the micro-images' centres, px: the spacing is a mean over what two of them share, which
    /// matters where it depends on the place within the micro-image (through a shell).
    pub window_px: f64,
    /// Pairs of neighbouring micro-images that were compared.
    pub pairs: usize,
    /// Correlation of neighbours at this spacing, noise taken out: 1 where they show the same thing.
    pub correlation: f64,
    /// Median residual of the pairs in units of what noise alone would leave.
    pub residual_ratio: f64,
    /// Noise of the (first) frame as estimated from itself and from what matched pairs leave, grey levels.
    pub noise_grey_levels: f64,
}

/// Spacings of several regions that share tilt and curvature.
#[derive(Debug, Clone, PartialEq)]
pub struct RegionSpacings {
    /// Spacing on the axis as each region has it, px.
    pub spacings_px: Vec<f64>,
    /// Standard uncertainty of each from pixel noise alone, px.
    pub sigmas_random_px: Vec<f64>,
    /// Tilt x, tilt y (px per half frame width), curvature (px per half width squared), before a region's scale.
    pub field_px: [f64; 3],
    /// Covariance (px²) of the spacings, then of the terms that were free; from the scatter between blocks.
    pub covariance: nalgebra::DMatrix<f64>,
    /// Radius of the masks about the micro-images' centres, px.
    pub window_px: f64,
    /// Pairs compared in each region.
    pub pairs: Vec<usize>,
    /// Correlation of neighbours, noise taken out.
    pub correlation: f64,
    /// Median residual of the pairs in units of what noise alone would leave.
    pub residual_ratio: f64,
}

/// Measures the spacing of one frame, or of several frames of the same pose together.
///
/// # Errors
/// [`SpacingError`] says why there is no number to be had.
pub fn measure_spacing(frames: &[SpacingFrame], options: &SpacingOptions) -> Result<Spacing, SpacingError> {
    measure(frames, options).map(|(spacing, _)| spacing)
}

/// Measures as [`measure_spacing`], and says what every micro-image makes of it.
///
/// # Errors
/// [`SpacingError`] says why there is no number to be had.
pub fn measure_spacing_map(
    frames: &[SpacingFrame],
    options: &SpacingOptions,
) -> Result<(Spacing, SpacingMap), SpacingError> {
    measure(frames, options).map(|(spacing, Fitted { model, scores, .. })| (spacing, map::map(frames, &model, &scores)))
}

/// Spacings of regions, and what led to them.
struct Fitted {
    regions: RegionSpacings,
    model: Model,
    /// What each frame's pairs say at the model.
    scores: Vec<Vec<PairScore>>,
}

fn measure(frames: &[SpacingFrame], options: &SpacingOptions) -> Result<(Spacing, Fitted), SpacingError> {
    let from = start(frames, options)?;
    let fitted = match fit(frames, &[from], &[1.0], options) {
        // The expected value was too far off: look for the spacing as if nothing had been known.
        Err(SpacingError::NoMatch { .. } | SpacingError::NoTexture { .. }) if options.start_px.is_some() => {
            let options = SpacingOptions { start_px: None, ..*options };
            fit(frames, &[start(frames, &options)?], &[1.0], &options)?
        }
        fitted => fitted?,
    };
    let Fitted { regions, model, .. } = &fitted;
    let mut covariance = [[0.0; 1 + TERMS]; 1 + TERMS];
    let places: Vec<usize> = std::iter::once(0).chain(model.free.iter().map(|term| 1 + term)).collect();
    for (i, &row) in places.iter().enumerate() {
        for (j, &column) in places.iter().enumerate() {
            covariance[row][column] = regions.covariance[(i, j)];
        }
    }
    let sigma_random_px = regions.sigmas_random_px[0];
    // Noise alone is never less than all there is: with few blocks the scatter can come out low by chance.
    covariance[0][0] = covariance[0][0].max(sigma_random_px.powi(2)) + MODEL_SIGMA_PX.powi(2);
    for smear in frames.iter().filter_map(|frame| smear::smear(frame, model)) {
        if smear.change_px > SMEAR_PX && smear.significance > SMEAR_SIGNIFICANCE {
            return Err(SpacingError::Moved { change_px: smear.change_px });
        }
    }
    let sigma_bound_px = bound::bound(frames, model).ok_or(SpacingError::NoTexture { noise: frames[0].noise })?;
    let spacing = Spacing {
        on_axis_px: regions.spacings_px[0],
        sigma_px: covariance[0][0].sqrt(),
        sigma_random_px,
        sigma_bound_px,
        tilt_x_px: regions.field_px[0],
        tilt_y_px: regions.field_px[1],
        curvature_px: regions.field_px[2],
        astigmatism_px: model.terms[FIELD_TERMS],
        row_column_px: model.terms[FIELD_TERMS + 1],
        diagonal_px: model.terms[FIELD_TERMS + 2],
        covariance,
        window_px: regions.window_px,
        pairs: regions.pairs[0],
        correlation: regions.correlation,
        residual_ratio: regions.residual_ratio,
        noise_grey_levels: model.noise(&frames[0]),
    };
    Ok((spacing, fitted))
}

/// Measures the spacings of regions (see [`SpacingFrame::assign_regions`]) that share tilt and curvature; `starts` are
/// approximate spacings (px, within a pixel or so), `scales` how strongly the field terms act in each region.
///
/// # Errors
/// [`SpacingError`] says why there is no number to be had.
pub fn measure_regions(
    frames: &[SpacingFrame],
    starts: &[f64],
    scales: &[f64],
    options: &SpacingOptions,
) -> Result<RegionSpacings, SpacingError> {
    fit(frames, starts, scales, options).map(|fitted| fitted.regions)
}

fn fit(
    frames: &[SpacingFrame],
    starts: &[f64],
    scales: &[f64],
    options: &SpacingOptions,
) -> Result<Fitted, SpacingError> {
    let mut model = Model { scales: scales.to_vec(), ..Model::flat(starts.to_vec()) };
    if let Some(held) = options.field_held {
        model.terms[..FIELD_TERMS].copy_from_slice(&held);
    }
    let reach = 0.15 * options.mla_pitch_px;
    let noise = frames.first().map_or(0.0, |f| f.noise);
    let (mut outcome, mut normal) = iterate(frames, None, &mut model, reach, 0.05, 10);
    let scarce = normal.region_pairs.iter().copied().min().unwrap_or(0);
    if scarce < LEAST_PAIRS {
        return Err(SpacingError::TooFewMicroImages { pairs: scarce, needed: LEAST_PAIRS });
    }
    if outcome == Outcome::Converged {
        // Before all terms are unknown: rows and columns apart cannot be told by one direction.
        if normal.correlation >= LEAST_CORRELATION {
            check_texture(&normal, noise).and_then(|()| check_directions(&normal, frames))?;
        }
        model.free_terms(options.field_held.is_some());
        model.mask = mask(frames, &model.spacings, options);
        // Texture that the noise estimate took for noise is what matching pairs do not leave as residual.
        model.noise_scale = noise_scale(1.0, normal.residual);
        (outcome, normal) = iterate(frames, None, &mut model, reach, 2e-4, 20);
    }
    let inverse = normal.inverse().filter(|_| outcome != Outcome::Undetermined);
    let Some(inverse) = inverse else { return Err(SpacingError::NoTexture { noise }) };
    if outcome == Outcome::Lost || normal.correlation < LEAST_CORRELATION {
        return Err(no_match(options, normal.correlation));
    }
    check_texture(&normal, noise)?;
    check_scene(&model, frames)?;
    let sigmas_random_px = (0..starts.len())
        .map(|r| {
            noise::noise_variance(frames, &model, &normal.scores, &DVector::from(inverse.column(r).clone_owned()))
                .sqrt()
        })
        .collect();
    let [tilt_x, tilt_y, curvature, ..] = model.terms;
    let regions = RegionSpacings {
        spacings_px: model.spacings.clone(),
        sigmas_random_px,
        field_px: [tilt_x, tilt_y, curvature],
        covariance: normal.scatter(&inverse),
        window_px: frames.first().map_or(0.0, |frame| model.radius(frame)),
        pairs: normal.region_pairs.clone(),
        correlation: normal.correlation,
        residual_ratio: normal.residual,
    };
    Ok(Fitted { regions, model, scores: normal.scores })
}

/// Where to start iterating: the caller's value where neighbours match there, else what a search finds.
fn start(frames: &[SpacingFrame], options: &SpacingOptions) -> Result<f64, SpacingError> {
    let pitch = options.mla_pitch_px;
    if !(pitch.is_finite() && pitch > 0.0) {
        return Err(SpacingError::Impossible { what: "an MLA pitch (px)", value: pitch });
    }
    if frames.is_empty() {
        return Err(SpacingError::TooFewMicroImages { pairs: 0, needed: LEAST_PAIRS });
    }
    if let Some(start) = options.start_px {
        return Ok(start);
    }
    let candidates = search::search(frames, pitch, options.mode);
    let Some(best) = candidates.first() else { return Err(no_match(options, 0.0)) };
    if best.correlation < LEAST_CORRELATION {
        return Err(no_match(options, best.correlation));
    }
    // What decorrelates the best match, noise apart, is interpolation and blur: another one hardly worse is as good.
    let rivals = 1.0 - 1.5 * (1.0 - best.correlation) - RIVAL_MARGIN;
    match candidates.iter().find(|c| (c.spacing - best.spacing).abs() > SAME_PX && c.correlation > rivals) {
        Some(rival) => Err(SpacingError::Ambiguous { first_px: best.spacing, second_px: rival.spacing }),
        None => Ok(best.spacing),
    }
}

/// The masks for spacings near these, in units of half the micro-image pitch: as large as the main lens's aperture cuts
/// nothing off, and never so small that they hardly overlap.
///
/// Near the edge of its micro-image a pixel sees through a part of its microlens only. Out of focus its blur is then
/// lopsided, which pulls the spacing towards the one in focus (by 0.06 px of 6 px at Δv = 0, 0.2 of 7 px at e = 30);
/// in focus the light lies lopsided on the pixel itself (0.006 px).
fn mask(frames: &[SpacingFrame], spacings: &[f64], options: &SpacingOptions) -> f64 {
    let pitch = frames.first().map_or(options.mla_pitch_px, |f| f.pitch);
    let whole = frames.iter().map(|f| f.whole).fold(MASK_FRACTION, f64::min);
    spacings.iter().map(|&spacing| mask_fraction(whole, pitch, spacing)).fold(0.0, f64::max)
}

/// The mask for one spacing, where pixels see through their whole microlens within the part `whole`.
pub(super) fn mask_fraction(whole: f64, pitch: f64, spacing: f64) -> f64 {
    // Masks a shift apart overlap by their diameter less the shift.
    let shift = (spacing - pitch).abs();
    whole.max((shift / 2.0 + LEAST_OVERLAP_PX) / (pitch / 2.0)).min(MASK_FRACTION)
}

/// Noise in units of the frames' own estimate, at which the pairs' residuals are what they usually are: those here are at
/// a noise in the unit `scale`.
pub(super) fn noise_scale(scale: f64, residual: f64) -> f64 {
    (scale * scale * residual / USUAL_RESIDUAL).clamp(0.01, 1.0).sqrt()
}

fn no_match(options: &SpacingOptions, correlation: f64) -> SpacingError {
    let range = |low: f64, high: f64| (low * options.mla_pitch_px, high * options.mla_pitch_px);
    let (from_px, to_px) = match options.mode {
        Some(MlaMode::Galilean) => range(GALILEAN_RANGE[0], GALILEAN_RANGE[1]),
        Some(MlaMode::Keplerian) => range(KEPLERIAN_RANGE[0], KEPLERIAN_RANGE[1]),
        None => range(GALILEAN_RANGE[0], KEPLERIAN_RANGE[1]),
    };
    SpacingError::NoMatch { from_px, to_px, correlation }
}

fn check_texture(normal: &Normal, noise: f64) -> Result<(), SpacingError> {
    if normal.texture_significance() < 4.0 { Err(SpacingError::NoTexture { noise }) } else { Ok(()) }
}

/// Refuses a spacing at which micro-images match as they lie: an image point there would have its image at infinity, so
/// that what repeats belongs to the array (a profile that is not its own, dirt that repeats, the cells of a screen).
fn check_scene(model: &Model, frames: &[SpacingFrame]) -> Result<(), SpacingError> {
    let pitch_px = frames.first().map_or(0.0, |f| f.pitch);
    if model.spacings.iter().any(|l| (l / pitch_px - 1.0).abs() < FIXED_PATTERN) {
        return Err(SpacingError::FixedPattern { pitch_px });
    }
    Ok(())
}

/// Refuses a texture that tells the spacing along one direction of the array only.
fn check_directions(normal: &Normal, frames: &[SpacingFrame]) -> Result<(), SpacingError> {
    let total: f64 = normal.by_direction.iter().sum();
    // Three directions of a hexagonal array never go blind to one texture together; two of a square array do.
    if frames.iter().all(|f| f.array == ArrayKind::Square) {
        for (direction, along_rows) in [(1, true), (0, false)] {
            if normal.by_direction[direction] < 0.01 * total {
                return Err(SpacingError::OneDirection { along_rows });
            }
        }
    }
    Ok(())
}
