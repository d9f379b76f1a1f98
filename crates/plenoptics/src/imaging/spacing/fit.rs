//! The fit of a spacing: from where it begins to where it rests.

use std::slice;

use super::search::Candidate;
use super::solve::{Outcome, Solver};
use super::{
    FORERUNNERS, FORERUNNERS_AT_REST_PX, Fitted, LEAST_PAIRS, RegionSpacings, SpacingError, SpacingFrame,
    SpacingOptions, check_range, check_scene, no_match, reach,
};
use crate::imaging::matching::model::{FIELD_TERMS, Model, USUAL_TERMS};
use crate::imaging::matching::normal::{LEAST_CORRELATION, noise_scale};
use crate::imaging::matching::plan::GOLDEN;
use crate::imaging::matching::pupil::Corrected;

/// What a fit begins with.
pub(super) fn begun(starts: &[f64], scales: &[f64], options: &SpacingOptions) -> Model {
    let model = Model { scales: scales.to_vec(), ..Model::flat(starts.to_vec()) };
    match options.field_held {
        Some(held) => model.with_field(held),
        None => model,
    }
}

/// The terms of the field that are fitted of any frame.
pub(super) fn usual_terms(options: &SpacingOptions) -> Vec<usize> {
    (if options.field_held.is_some() { FIELD_TERMS } else { 0 }..USUAL_TERMS).collect()
}

pub(super) fn fit<'a>(
    frames: &'a [SpacingFrame],
    starts: &[f64],
    scales: &[f64],
    options: &SpacingOptions,
) -> Result<Fitted<'a>, SpacingError> {
    let model = begun(starts, scales, options);
    let near = match (starts, frames) {
        ([_], [frame]) => led(frame, &model, options),
        _ => None,
    };
    fit_from(near.map_or(model, |near| Model { free: Vec::new(), ..near }), frames, options)
}

/// Fits all pairs, from a model that is near enough.
pub(super) fn fit_from<'a>(
    mut model: Model,
    frames: &'a [SpacingFrame],
    options: &SpacingOptions,
) -> Result<Fitted<'a>, SpacingError> {
    let count = model.spacings.len();
    let reach = reach(options);
    let noise = frames.first().map_or(0.0, |f| f.noise);
    let directions = frames.first().map_or(0, |f| f.plan.direction_count);
    let mut solver = Solver::new(frames, frames.iter().map(SpacingFrame::jobs).collect());
    solver.mask(&model);
    let mut outcome = solver.iterate(&mut model, reach, 0.05, 10);
    let scarce = solver.normal.region_pairs.iter().copied().min().unwrap_or(0);
    if scarce < LEAST_PAIRS {
        return Err(SpacingError::TooFewMicroImages { pairs: scarce, needed: LEAST_PAIRS });
    }
    if outcome == Outcome::Converged {
        // Before all terms are unknown: rows and columns apart cannot be told by one direction.
        // Texture that the noise estimate took for noise is what matching pairs do not leave as residual.
        let scale = noise_scale(1.0, solver.normal.residual);
        if solver.normal.contents.correlation() >= LEAST_CORRELATION
            && solver.normal.check_texture(noise, directions).is_err()
        {
            solver.at_noise(scale, &model);
            solver.normal.check_texture(noise, directions)?;
        }
        solver.noise_scale = scale;
        model.free = usual_terms(options);
        solver.mask(&model);
        outcome = solver.iterate(&mut model, reach, 2e-4, 20);
        while outcome == Outcome::Converged && count == 1 && options.field_held.is_none() {
            let Some(free) = solver.normal.demanded(&model) else { break };
            model.free = free;
            outcome = solver.iterate(&mut model, reach, 2e-4, 20);
        }
    }
    let normal = &solver.normal;
    let correlation = normal.contents.correlation();
    let inverse = normal.inverse().filter(|_| outcome != Outcome::Undetermined);
    let Some(inverse) = inverse else {
        // Where much of the field does not match, what there is of texture does not determine anything either.
        return Err(if normal.contents.are_blank() || correlation < LEAST_CORRELATION {
            SpacingError::NoTexture { noise }
        } else {
            SpacingError::Unsettled { near_px: model.spacings[0], correlation }
        });
    };
    if outcome == Outcome::Lost || correlation < LEAST_CORRELATION {
        return Err(no_match(options, Candidate { spacing: model.spacings[0], correlation }));
    }
    normal.check_texture(noise, directions)?;
    check_scene(&model, frames)?;
    // Frames of one pose are of one camera, and masked alike.
    let window_px = solver.radii.first().copied().unwrap_or_default();
    let free: Vec<Corrected> =
        model.spacings.iter().filter_map(|&l| Some(frames.first()?.pupil.corrected(l, window_px))).collect();
    for region in &free {
        check_range(options, region.spacing)?;
    }
    let slope_of = |unknown: usize| free[if unknown < free.len() { unknown } else { 0 }].slope;
    let [tilt_x, tilt_y, curvature, ..] = model.terms.map(|term| slope_of(0) * term);
    let mut covariance = normal.scatter(&model, &inverse, &normal.step(&inverse));
    for row in 0..covariance.nrows() {
        for column in 0..covariance.ncols() {
            covariance[(row, column)] *= slope_of(row) * slope_of(column);
        }
    }
    let regions = RegionSpacings {
        spacings_px: free.iter().map(|free| free.spacing).collect(),
        sigmas_random_px: (0..count).map(|r| slope_of(r) * solver.noise_variance(&model, &inverse, r).sqrt()).collect(),
        field_px: [tilt_x, tilt_y, curvature],
        covariance,
        window_px,
        pairs: normal.region_pairs.clone(),
        correlation,
        residual_ratio: normal.residual,
    };
    Ok(Fitted { regions, model, free, solver })
}

/// A model brought near to where all pairs will have it by a part of a frame's pairs; `None` where they are not so many, or
/// these do not match or settle.
pub(super) fn led(frame: &SpacingFrame, start: &Model, options: &SpacingOptions) -> Option<Model> {
    let pairs = frame.pairs();
    if pairs.len() < 4 * FORERUNNERS {
        return None;
    }
    let share = FORERUNNERS as f64 / pairs.len() as f64;
    let few = (0u32..).zip(&pairs).filter(|(k, _)| (f64::from(*k) * GOLDEN).fract() < share);
    let jobs = few.map(|(_, &pair)| frame.plan.job(&[pair])).collect();
    let mut solver = Solver::new(slice::from_ref(frame), vec![jobs]);
    let mut model = start.clone();
    for (tolerance, free) in [(0.05, Vec::new()), (FORERUNNERS_AT_REST_PX, usual_terms(options))] {
        model.free = free;
        solver.mask(&model);
        let outcome = solver.iterate(&mut model, reach(options), tolerance, 10);
        // Rows and columns apart cannot be told by one direction.
        let texture = solver.normal.check_texture(frame.noise, frame.plan.direction_count);
        let matches = solver.normal.contents.correlation() >= LEAST_CORRELATION;
        if outcome != Outcome::Converged || texture.is_err() || !matches {
            return None;
        }
    }
    Some(model)
}
