//! One frame from its samples to its spacing.

use super::exposure::Exposure;
use super::follow::Follower;
use super::frame::{Frame, Sample};
use super::gains::Gains;
use super::motion::Motion;
use super::normal::{Model, Normal, TERMS, Terms, free_terms};
use super::plan::Plan;
use super::random::{Random, Setting};
use super::run::{Clusters, Pass, Pool, run};
use super::shape::Shape;
use super::{LiveError, LiveOptions, LiveSpacing};
use crate::imaging::grid::Grid;
use crate::imaging::spacing::{
    LEAST_CORRELATION, LEAST_PAIRS, MARGIN_PX, MASK_FRACTION, MODEL_SIGMA_PX, QUANTISATION, SpacingError,
    mask_fraction, noise_scale, whole_fraction,
};
use crate::imaging::vignetting::Vignetting;

/// Displacement (px) in a corner from which centres are moved.
const NOTICEABLE_PX: f64 = 0.02;
/// Displacement (px) in a corner from which the frame is planned anew: up to here the masks of all micro-images stay within
/// it, and the directions of pairs as they are. A rotation turns them.
const TRAVEL_PX: f64 = 2.0;
const TRAVEL_TURN_PX: f64 = 0.25;
/// Content beyond the noise's, in units of the noise's, below which a frame that does not match shows nothing.
const LEAST_CONTRAST: f64 = 0.25;
/// Clusters that are settled first, at most and as a share of the micro-images.
const CLUSTERS: usize = 96;
const CLUSTERS_SHARE: usize = 64;
const LEAST_CLUSTERS: usize = 20;
/// Step (px) of the clusters below which all pairs may follow.
const SETTLED_PX: f64 = 0.03;
/// Step (px) beyond which the clusters are followed however unsure they are.
const UNSURE_PX: f64 = 0.3;
/// Step (px) of all pairs after which another would change nothing.
const FINAL_STEP_PX: f64 = 0.02;
/// Most rounds of the clusters, and most passes over all pairs.
const ROUNDS: usize = 12;
const PASSES: usize = 6;

/// Where the next frame starts.
#[derive(Debug, Clone, Copy)]
pub(super) struct State {
    terms: Terms,
    /// Noise in units of the frame's own estimate, which sharp texture makes too large; unknown before the first frame.
    noise_scale: Option<f64>,
}

impl State {
    /// A spacing (px) with its tilt x, tilt y and curvature.
    pub(super) fn new(spacing: f64, [tilt_x, tilt_y, curvature]: [f64; 3]) -> Self {
        Self { terms: Terms::from([spacing, tilt_x, tilt_y, curvature, 0.0, 0.0, 0.0]), noise_scale: None }
    }
}

/// Everything that stays from frame to frame.
#[derive(Debug)]
pub(super) struct Engine {
    follower: Follower,
    /// Where the grid was when the frame was planned, and when centres were moved last.
    planned: Motion,
    moved: Motion,
    work: Work,
    gains: Gains,
    pool: Pool,
    /// Normal equations of the clusters and of all pairs.
    normals: [Normal; 2],
    options: LiveOptions,
    free: [bool; TERMS],
    pitch: f64,
    /// Radius of the largest masks, px.
    radius: f64,
    /// Part of the micro-image's radius within which pixels see through their whole microlens.
    whole: f64,
    pub(super) state: Option<State>,
}

/// What is planned for where the grid is.
#[derive(Debug)]
struct Work {
    plan: Plan,
    exposure: Exposure,
    clusters: Clusters,
    random: Random,
}

impl Work {
    fn new(grid: &Grid, motion: &Motion, radius: f64, options: &LiveOptions) -> Result<Self, SpacingError> {
        let plan = Plan::new(grid, motion, radius + MARGIN_PX, options.micro_images_most);
        if plan.pairs < LEAST_PAIRS {
            return Err(SpacingError::TooFewMicroImages { pairs: plan.pairs, needed: LEAST_PAIRS });
        }
        let wanted = (plan.lenses.len() / CLUSTERS_SHARE).clamp(LEAST_CLUSTERS, CLUSTERS);
        Ok(Self {
            exposure: Exposure::new(&plan, radius),
            clusters: Clusters::new(plan.clusters(wanted)),
            random: Random::new(&plan),
            plan,
        })
    }
}

impl Engine {
    pub(super) fn new(grid: &Grid, profile: &Vignetting, options: &LiveOptions) -> Result<Self, SpacingError> {
        let pitch = grid.pitch_px();
        let radius = MASK_FRACTION * pitch / 2.0;
        let gains = Gains::new(profile, grid, radius);
        let work = Work::new(grid, &Motion::NONE, radius, options)?;
        let plan = &work.plan;
        let few = work.clusters.jobs.iter().map(|job| job.scores.len()).sum();
        let centres: Vec<[f64; 2]> = (0..plan.lenses.len() as u32).map(|lens| plan.centre(lens)).collect();
        Ok(Self {
            follower: Follower::new(grid, profile),
            planned: Motion::NONE,
            moved: Motion::NONE,
            pool: Pool::default(),
            normals: [Normal::new(few), Normal::new(plan.pairs)],
            options: *options,
            free: free_terms(plan, options.field_held.is_some(), options.directions_alike),
            pitch,
            radius,
            whole: whole_fraction(&centres, pitch, |centre, pixel| gains.share(centre, pixel)),
            state: options.start_px.map(|start| State::new(start, options.field_held.unwrap_or_default())),
            gains,
            work,
        })
    }

    /// Follows the grid from where it was found in a whole frame.
    pub(super) fn start_from(&mut self, found: &Grid) -> Result<(), SpacingError> {
        self.follower.start_from(found);
        self.keep_up()
    }

    /// The grid where it is now.
    pub(super) fn grid(&self) -> Grid {
        self.follower.grid()
    }

    pub(super) fn measure<T: Sample>(&mut self, frame: &Frame<'_, T>, bits: u8) -> Result<LiveSpacing, LiveError> {
        let raw_noise = self.work.exposure.check(frame, &self.work.plan)?;
        self.follower.follow(frame, bits, raw_noise)?;
        self.keep_up()?;
        let state = self.state.ok_or(LiveError::NoStart)?;
        let mut model = Model { terms: state.terms, free: self.free };
        if let Some(field) = self.options.field_held {
            model.terms.fixed_rows_mut::<3>(1).copy_from_slice(&field);
        }
        let known = state.noise_scale;
        let settled = self.settle(frame, raw_noise, &mut model, known);
        let found = settled.and_then(|scale| self.finish(frame, raw_noise, &mut model, (scale, known)));
        if matches!(found, Err(LiveError::Lost { .. })) {
            self.state = None;
        }
        found
    }

    /// Moves all that knows where micro-images are to where they are now.
    fn keep_up(&mut self) -> Result<(), SpacingError> {
        let (motion, field) = (*self.follower.motion(), self.follower.field());
        let from = |other: &Motion| Motion(motion.0 - other.0);
        if from(&self.moved).greatest(field) < NOTICEABLE_PX {
            return Ok(());
        }
        let travelled = from(&self.planned);
        if travelled.greatest(field) > TRAVEL_PX || travelled.0[3].abs() > TRAVEL_TURN_PX {
            let given = self.follower.given();
            self.work = Work::new(given, &motion, self.radius, &self.options)?;
            self.planned = motion;
        } else {
            self.work.plan.shift_to(&motion);
        }
        self.gains.follow(self.follower.given().basis.map(|v| motion.turned(self.follower.field(), v)));
        self.moved = motion;
        Ok(())
    }

    /// Brings the model near enough for one step of all pairs, on the clusters alone; returns the noise's scale.
    fn settle<T: Sample>(
        &mut self,
        frame: &Frame<'_, T>,
        raw_noise: f64,
        model: &mut Model,
        known_scale: Option<f64>,
    ) -> Result<f64, LiveError> {
        let from_px = model.terms[0];
        let reach = 0.15 * self.options.mla_pitch_px;
        let mut scale = known_scale.unwrap_or(1.0);
        let mut shape = None;
        let mut axis = model.axis_only();
        for _ in 0..ROUNDS {
            let now = self.shape(axis.terms[0]);
            let fresh = shape.replace(now) != Some(now);
            let noise = (raw_noise * scale).max(QUANTISATION);
            let Self { gains, work: Work { plan, clusters, .. }, normals: [normal, _], .. } = self;
            let pass = Pass {
                frame,
                gains,
                lenses: &plan.lenses,
                directions: &plan.directions,
                model: &axis,
                shape: &now,
                noise,
            };
            clusters.run(&pass, fresh);
            normal.gather(&clusters.jobs, &plan.directions, &axis, noise);
            let correlation = normal.correlation;
            let Some(inverse) = normal.inverse(&axis.free) else { return Err(self.no_match(0, from_px, raw_noise)) };
            let step = normal.step(&inverse);
            let sigma = normal.scatter(&inverse, &step, 1)[(0, 0)].sqrt();
            let step = step[0];
            // What the clusters cannot tell from nothing is left to all pairs.
            if step.abs() < SETTLED_PX.max((2.0 * sigma).min(UNSURE_PX)) {
                if correlation < LEAST_CORRELATION {
                    return Err(self.no_match(0, from_px, raw_noise));
                }
                if known_scale.is_none() {
                    scale = noise_scale(scale, normal.residual);
                }
                model.terms[0] = axis.terms[0];
                return Ok(scale);
            }
            // Matching is linear over about a pixel: a longer step is only a direction.
            axis.terms[0] += step.clamp(-1.0, 1.0);
            let moved = (axis.terms[0] - from_px).abs();
            if !moved.is_finite() || moved > reach {
                break;
            }
        }
        Err(self.no_match(0, from_px, raw_noise))
    }

    /// Newton steps over all pairs, one where the start is near, and what follows from the last.
    fn finish<T: Sample>(
        &mut self,
        frame: &Frame<'_, T>,
        raw_noise: f64,
        model: &mut Model,
        (scale, known_scale): (f64, Option<f64>),
    ) -> Result<LiveSpacing, LiveError> {
        let from_px = model.terms[0];
        let noise = (raw_noise * scale).max(QUANTISATION);
        for passes in 1..=PASSES {
            let shape = self.shape(model.terms[0]);
            let Self { gains, work: Work { plan, .. }, pool, normals: [_, normal], .. } = self;
            let pass =
                Pass { frame, gains, lenses: &plan.lenses, directions: &plan.directions, model, shape: &shape, noise };
            run(&pass, &mut plan.jobs, pool);
            normal.gather(&plan.jobs, &plan.directions, model, noise);
            if normal.pairs < LEAST_PAIRS {
                return Err(SpacingError::TooFewMicroImages { pairs: normal.pairs, needed: LEAST_PAIRS }.into());
            }
            let Some(inverse) = normal.inverse(&model.free) else {
                return Err(self.no_match(1, from_px, raw_noise));
            };
            let mut step = normal.step(&inverse);
            let largest = step.abs().sum();
            if largest > 1.0 {
                step /= largest;
            }
            let before = *model;
            model.terms += step;
            if largest > FINAL_STEP_PX {
                continue;
            }
            if normal.correlation < LEAST_CORRELATION {
                return Err(self.no_match(1, from_px, raw_noise));
            }
            self.check_texture(raw_noise)?;
            let Self { gains, work: Work { plan, random, .. }, normals: [_, normal], .. } = self;
            let setting = Setting { frame, gains, plan, model: &before, normal, shape: &shape, noise };
            let sigma_random_px = random.variance(&setting, &inverse, known_scale.is_none()).sqrt();
            let mut covariance = normal.scatter(&inverse, &step, model.unknowns());
            // Noise alone is never less than all there is: with few blocks the scatter can come out low by chance.
            covariance[(0, 0)] = covariance[(0, 0)].max(sigma_random_px.powi(2)) + MODEL_SIGMA_PX.powi(2);
            self.state = Some(State { terms: model.terms, noise_scale: Some(noise_scale(scale, normal.residual)) });
            let [on_axis_px, tilt_x_px, tilt_y_px, curvature_px, astigmatism_px, row_column_px, diagonal_px] =
                model.terms.into();
            return Ok(LiveSpacing {
                on_axis_px,
                sigma_px: covariance[(0, 0)].sqrt(),
                sigma_random_px,
                tilt_x_px,
                tilt_y_px,
                curvature_px,
                astigmatism_px,
                row_column_px,
                diagonal_px,
                covariance: covariance.transpose().into(),
                window_px: f64::from(shape.edge) - 0.5,
                pairs: normal.pairs,
                correlation: normal.correlation,
                residual_ratio: normal.residual,
                noise_grey_levels: raw_noise,
                grid: self.follower.motion().reported(self.follower.field(), self.follower.sigma_px()),
                passes,
            });
        }
        Err(self.no_match(1, from_px, raw_noise))
    }

    /// Tiles for spacings near this one: masks as large as the main lens's aperture cuts nothing off, and never so small
    /// that they hardly overlap.
    fn shape(&self, spacing: f64) -> Shape {
        Shape::new(mask_fraction(self.whole, self.pitch, spacing) * self.pitch / 2.0)
    }

    /// What it means that the clusters (0) or all pairs (1) do not match.
    fn no_match(&self, which: usize, from_px: f64, noise: f64) -> LiveError {
        let normal = &self.normals[which];
        if normal.contrast < LEAST_CONTRAST {
            return SpacingError::NoTexture { noise }.into();
        }
        LiveError::Lost { from_px, correlation: normal.correlation }
    }

    fn check_texture(&self, noise: f64) -> Result<(), SpacingError> {
        let [_, normal] = &self.normals;
        if normal.texture_significance() < 4.0 {
            return Err(SpacingError::NoTexture { noise });
        }
        let total: f64 = normal.by_direction.iter().sum();
        // Three directions of a hexagonal array never go blind to one texture together; two of a square array do.
        if self.work.plan.direction_count == 2 {
            for (direction, along_rows) in [(1, true), (0, false)] {
                if normal.by_direction[direction] < 0.01 * total {
                    return Err(SpacingError::OneDirection { along_rows });
                }
            }
        }
        Ok(())
    }
}
