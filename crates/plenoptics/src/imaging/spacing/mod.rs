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
//! curvatures along the radius and across it: shells and distortion make them differ. l_0, the value on the axis and the
//! mean over directions, is what Eqs. 9 and 16 mean. s is by how much rows and columns differ, h the same for the
//! diagonals: with l_0 they make the symmetric 2×2 matrix that turns a step on the array into one between image points,
//! which then also lie across the pair by −½ s sin 2φ + ½ h cos 2φ.
//!
//! ```text
//!   frame.rs     a frame with its light, micro-images, pairs and noise
//!   search.rs    where to start: correlation over the capture range
//!   solve.rs     all pairs at state after state of the model, until it fits
//!   map.rs, bound.rs, smear.rs    what else the fitted frame says
//! ```
//!
//! Micro-images are matched by `imaging::matching`, as they are live.

mod boards;
mod bound;
mod error;
mod fit;
mod frame;
mod map;
mod search;
mod smear;
mod solve;

use std::slice;

use serde::Serialize;

use fit::{begun, fit, fit_from, led};

pub use boards::TwoBoards;
pub(in crate::imaging) use boards::unevenness;
pub use error::SpacingError;
pub use frame::{MicroImage, SpacingFrame, noise_about};
pub use map::{LensSpacing, LensState, PairMatch, SpacingMap};
pub use search::{GALILEAN_RANGE, KEPLERIAN_RANGE, capture_range, correlation_map};

pub use super::matching::masks::{MASK_FRACTION, nominal_mask_radius};
use super::matching::model::{BLOCKS, FIELD_TERMS, Model, USUAL_TERMS};
pub use super::matching::normal::LEAST_PAIRS;
use super::matching::normal::{Compared, LEAST_CORRELATION};
use super::matching::pupil::Corrected;
use crate::optics::MlaMode;
use search::{Candidate, Found};
use solve::Solver;

/// Candidates of the search nearer than this are the same, px.
const SAME_PX: f64 = 1.0;
/// Correlation from which a match in the other mode is none by chance.
const SURE_CORRELATION: f64 = 0.8;
/// Correlation by which a match must be better than any other.
const RIVAL_MARGIN: f64 = 0.02;

/// Standard uncertainty that neither noise nor the scatter between regions shows, px: interpolation, the lopsided blur
/// at a mask's edge and the pixels' own area act alike all over a frame. The root mean square error in noise-free
/// exact-ray frames of four textures on square and hexagonal arrays.
pub(crate) const MODEL_SIGMA_PX: f64 = 0.002;
/// Relative distance from the micro-images' own within which a spacing is theirs and no board's. Capture ranges end
/// outside it.
const FIXED_PATTERN: f64 = 0.03;
/// What the squared change of the spacing during an exposure comes out by at most, px² (standard uncertainty), where
/// nothing moves and neither noise nor scatter between parts of the field shows it: texture as sharp as pixels and their
/// own area. Frames of printed text at rest showed −0.09 ± 0.09; with it none of some thousand at rest is refused.
const SMEAR_SIGMA: f64 = 0.1;
/// How many standard uncertainties it must stand above none to be refused: from a change of two thirds of a pixel on.
const SMEAR_SIGNIFICANCE: f64 = 4.0;

/// Pairs that go before the others where these are many, and how far (px) their last step may still be from rest.
const FORERUNNERS: usize = 1500;
const FORERUNNERS_AT_REST_PX: f64 = 0.005;

/// Scatter of the spacing between blocks of the field that one board does not have, px: it has 0.01 to 0.04, three boards
/// 8 mm apart have 0.4 to 1.2.
const SEVERAL_PX: f64 = 0.1;

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
    /// Nothing moves, by other frames of the same pose: one that looks smeared is measured all the same.
    pub at_rest: bool,
    /// The Cramér–Rao bound is wanted, too.
    pub bound: bool,
}

impl SpacingOptions {
    /// Nothing known but the MLA pitch (px).
    #[must_use]
    pub const fn new(mla_pitch_px: f64) -> Self {
        Self { mla_pitch_px, mode: None, start_px: None, field_held: None, at_rest: false, bound: false }
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
    /// texture, every micro-image's gain and offset, and the field terms being unknown too. `None` where it was not asked
    /// for.
    pub sigma_bound_px: Option<f64>,
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
    pub covariance: [[f64; 1 + USUAL_TERMS]; 1 + USUAL_TERMS],
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
    /// The two boards that are in the field where it has more than one spacing: what is said above is neither's.
    pub two_boards: Option<TwoBoards>,
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
    measure(frames, options)
        .map(|(spacing, Fitted { model, free, solver, .. })| (spacing, map::map(&solver, &model, &free[0])))
}

/// Spacings of regions, and what led to them.
struct Fitted<'a> {
    regions: RegionSpacings,
    model: Model,
    /// The model's spacings freed of what the aperture's edge does to them.
    free: Vec<Corrected>,
    /// The frames with what their pairs said at the model.
    solver: Solver<'a>,
}

fn measure<'a>(frames: &'a [SpacingFrame], options: &SpacingOptions) -> Result<(Spacing, Fitted<'a>), SpacingError> {
    let from = start(frames, options)?;
    let fitted = match fit(frames, &[from], &[1.0], options) {
        // The expected value was too far off: look for the spacing as if nothing had been known.
        Err(
            SpacingError::NoMatch { .. }
            | SpacingError::BeyondRange { .. }
            | SpacingError::OtherMode { .. }
            | SpacingError::Unsettled { .. }
            | SpacingError::NoTexture { .. },
        ) if options.start_px.is_some() => {
            let options = SpacingOptions { start_px: None, ..*options };
            fit(frames, &[start(frames, &options)?], &[1.0], &options)?
        }
        fitted => fitted?,
    };
    let Fitted { regions, model, solver, free } = &fitted;
    let slope = free[0].slope;
    let mut covariance = model.usual(&regions.covariance);
    let mut sigma_random_px = regions.sigmas_random_px[0];
    let two_boards = boards::two_boards(solver, model, options);
    let several_boards = are_several(covariance[0][0], sigma_random_px);
    if !several_boards && !options.at_rest {
        let mut smears = frames.iter().zip(&solver.radii).filter_map(|(f, &radius)| smear::smear(f, model, radius));
        if let Some(smear) = smears.find(|s| s.square > SMEAR_SIGNIFICANCE * s.sigma.hypot(SMEAR_SIGMA)) {
            return Err(SpacingError::Moved { change_px: smear.square.sqrt() });
        }
    }
    // All that a frame is refused for has been asked, of all pairs: strict weights make none acceptable.
    let compared: Vec<Compared<'_>> = solver.compared().collect();
    let mut seen = model.clone();
    if let Some(refined) = solver.normal.refined(&compared, model) {
        seen.advance(&refined.change);
        covariance = model.usual(&(refined.covariance * slope.powi(2)));
        sigma_random_px *= refined.noise;
    }
    covariance[0][0] = whole_variance(covariance[0][0], sigma_random_px, free[0].sigma);
    let bound = || bound::bound(solver, model).ok_or(SpacingError::NoTexture { noise: frames[0].noise });
    let sigma_bound_px = if options.bound { Some(slope * bound()?) } else { None };
    let [tilt_x_px, tilt_y_px, curvature_px, astigmatism_px, row_column_px, diagonal_px, ..] =
        seen.terms.map(|term| slope * term);
    let spacing = Spacing {
        on_axis_px: regions.spacings_px[0] + slope * (seen.spacings[0] - model.spacings[0]),
        sigma_px: covariance[0][0].sqrt(),
        sigma_random_px,
        sigma_bound_px,
        tilt_x_px,
        tilt_y_px,
        curvature_px,
        astigmatism_px,
        row_column_px,
        diagonal_px,
        covariance,
        window_px: regions.window_px,
        pairs: regions.pairs[0],
        correlation: regions.correlation,
        residual_ratio: regions.residual_ratio,
        noise_grey_levels: frames[0].noise(solver.noise_scale),
        two_boards,
    };
    Ok((spacing, fitted))
}

/// Whether the spacing differs between parts of the field by more than noise and one board's own flaws make of it, by the
/// variance (px²) of the whole from the scatter between blocks and its standard uncertainty by noise (px). Micro-images of
/// boards at different distances differ as if they were smeared.
fn are_several(scatter: f64, sigma_random_px: f64) -> bool {
    let blocks = BLOCKS as f64;
    (blocks * scatter.sqrt()) > SEVERAL_PX.hypot(2.0 * blocks * sigma_random_px)
}

/// Variance of a spacing, px², from the scatter between field blocks, the standard uncertainty by noise alone (px), and
/// what is known of the model's own limits.
pub(super) fn whole_variance(scatter: f64, sigma_random_px: f64, sigma_correction_px: f64) -> f64 {
    // Noise alone is never less than all there is: with few blocks the scatter can come out low by chance.
    scatter.max(sigma_random_px.powi(2)) + MODEL_SIGMA_PX.powi(2) + sigma_correction_px.powi(2)
}

/// Looks for the spacing of a frame as if nothing were known of it: near enough to follow it from there (px), with tilt x,
/// tilt y and curvature. Of many pairs a part has said that; of few all have.
///
/// # Errors
/// [`SpacingError`] says why nothing is found.
pub(in crate::imaging) fn find_spacing(
    frame: &SpacingFrame,
    options: &SpacingOptions,
) -> Result<(f64, [f64; FIELD_TERMS]), SpacingError> {
    let frames = slice::from_ref(frame);
    let model = begun(&[start(frames, options)?], &[1.0], options);
    if let Some(Model { spacings, terms: [tilt_x, tilt_y, curvature, ..], .. }) = led(frame, &model, options) {
        return Ok((spacings[0], [tilt_x, tilt_y, curvature]));
    }
    let RegionSpacings { spacings_px, field_px, .. } = fit_from(model, frames, options)?.regions;
    Ok((spacings_px[0], field_px))
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

/// How far a fit may lead from its start, px.
fn reach(options: &SpacingOptions) -> f64 {
    0.15 * options.mla_pitch_px
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
    let found = search::search(frames, pitch, options.mode);
    let matching = found.candidates.first().filter(|best| best.correlation >= LEAST_CORRELATION);
    let Some(best) = matching else { return Err(not_found(frames, options, &found)) };
    // What decorrelates the best match, noise apart, is interpolation and blur: another one hardly worse is as good.
    let rivals = 1.0 - 1.5 * (1.0 - best.correlation) - RIVAL_MARGIN;
    let mut others = found.candidates.iter();
    match others.find(|c| (c.spacing - best.spacing).abs() > SAME_PX && c.correlation > rivals) {
        Some(rival) => Err(SpacingError::Ambiguous { first_px: best.spacing, second_px: rival.spacing }),
        None => Ok(best.spacing),
    }
}

/// Why a search found nothing.
fn not_found(frames: &[SpacingFrame], options: &SpacingOptions, found: &Found) -> SpacingError {
    if found.blank {
        return SpacingError::NoTexture { noise: frames[0].noise };
    }
    let pitch = options.mla_pitch_px;
    if let Some((best, last)) = found.end.filter(|(best, _)| best.correlation >= LEAST_CORRELATION) {
        return beyond(options, best.spacing, last);
    }
    let other = options.mode.map(|mode| match mode {
        MlaMode::Galilean => (mode, MlaMode::Keplerian),
        MlaMode::Keplerian => (mode, MlaMode::Galilean),
    });
    if let Some((mode, other)) = other {
        let there = search::search(frames, pitch, Some(other)).candidates;
        if let Some(best) = there.first().filter(|best| best.correlation >= SURE_CORRELATION) {
            return SpacingError::OtherMode { spacing_px: best.spacing, mla_pitch_px: pitch, mode };
        }
    }
    let best = found.candidates.first().copied().or(found.end.map(|(best, _)| best));
    no_match(options, best.unwrap_or(Candidate { spacing: f64::NAN, correlation: 0.0 }))
}

/// That the spacing is beyond an end of a range that was searched: of the mode's, or the one nearer to what was found (px).
fn beyond(options: &SpacingOptions, found_px: f64, above: bool) -> SpacingError {
    let mla_pitch_px = options.mla_pitch_px;
    let nearer = if found_px < mla_pitch_px { MlaMode::Galilean } else { MlaMode::Keplerian };
    let [from_px, to_px] = capture_range(options.mode.unwrap_or(nearer)).map(|end| end * mla_pitch_px);
    SpacingError::BeyondRange { from_px, to_px, above, mla_pitch_px }
}

/// Refuses a spacing (px) that is none of those searched. A fit may lead there from within: far out of focus it is what chance
/// or the array itself has repeat, or a board's that is too blurred for a number.
pub(in crate::imaging) fn check_range(options: &SpacingOptions, spacing_px: f64) -> Result<(), SpacingError> {
    let mla_pitch_px = options.mla_pitch_px;
    let of_pitch = spacing_px / mla_pitch_px;
    let ranges = search::ranges(options.mode);
    if ranges.iter().any(|[low, high]| (*low..=*high).contains(&of_pitch)) {
        return Ok(());
    }
    Err(match options.mode {
        Some(mode) if (mode == MlaMode::Galilean) != (of_pitch < 1.0) => {
            SpacingError::OtherMode { spacing_px, mla_pitch_px, mode }
        }
        // Between two modes' ranges it is above the nearer's if that is the lower one.
        _ => beyond(options, spacing_px, of_pitch > KEPLERIAN_RANGE[1] || (GALILEAN_RANGE[1]..1.0).contains(&of_pitch)),
    })
}

/// That the best that there is does not do.
fn no_match(options: &SpacingOptions, best: Candidate) -> SpacingError {
    let Candidate { spacing, correlation } = best;
    let ranges = options.mode.map_or([GALILEAN_RANGE[0], KEPLERIAN_RANGE[1]], capture_range);
    let [from_px, to_px] = ranges.map(|end| end * options.mla_pitch_px);
    if correlation < LEAST_CORRELATION {
        return SpacingError::NoMatch { from_px, to_px, correlation };
    }
    if spacing < from_px || spacing > to_px {
        return beyond(options, spacing, spacing > to_px);
    }
    SpacingError::Unsettled { near_px: spacing, correlation }
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
