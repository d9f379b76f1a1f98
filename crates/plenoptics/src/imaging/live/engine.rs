//! One frame from its samples to its spacing.

use super::follow::Follower;
use super::{LiveError, LiveOptions, LivePart, LiveSpacing};
use crate::imaging::grid::Grid;
use crate::imaging::matching::compare::ALONG;
use crate::imaging::matching::damping::Damping;
use crate::imaging::matching::exposure::Exposure;
use crate::imaging::matching::gains::{Gains, Light};
use crate::imaging::matching::masks::{MARGIN_PX, MASK_FRACTION, mask_radius};
use crate::imaging::matching::model::{FIELD_TERMS, Model, QUANTISATION, USUAL_TERMS};
use crate::imaging::matching::motion::Motion;
use crate::imaging::matching::normal::{Compared, LEAST_CORRELATION, LEAST_PAIRS, Normal, Refined, noise_scale};
use crate::imaging::matching::plan::Plan;
use crate::imaging::matching::pupil::Pupil;
use crate::imaging::matching::random::{Random, Setting};
use crate::imaging::matching::run::{Clusters, Pass, Pool, run};
use crate::imaging::matching::samples::{Frame, Sample};
use crate::imaging::matching::shape::Shape;
use crate::imaging::spacing::{SpacingError, check_range, unevenness, whole_variance};
use crate::imaging::vignetting::Vignetting;

/// Micro-images that light and noise are told from.
const EXPOSED: usize = 128;
/// Micro-images that the uncertainty by noise is told from.
const SAMPLED: usize = 96;
/// Displacement (px) in a corner from which centres are moved.
const NOTICEABLE_PX: f64 = 0.02;
/// Displacement (px) in a corner from which the frame is planned anew: up to here the masks of all micro-images stay within
/// it, and the directions of pairs as they are. A rotation turns them.
const TRAVEL_PX: f64 = 2.0;
const TRAVEL_TURN_PX: f64 = 0.25;
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
/// Blocks beyond the unknowns below which their scatter says too little by itself.
const LEAST_SPARE: usize = 12;
/// Most rounds of the clusters, and most passes over all pairs.
const ROUNDS: usize = 12;
const PASSES: usize = 12;

/// Where the next frame starts.
#[derive(Debug, Clone)]
pub(super) struct State {
    model: Model,
    /// Noise in units of the frame's own estimate, which sharp texture makes too large; unknown before the first frame.
    noise_scale: Option<f64>,
}

impl State {
    /// A spacing (px) with its tilt x, tilt y and curvature.
    pub(super) fn new(spacing: f64, field: [f64; FIELD_TERMS]) -> Self {
        Self { model: Model::flat(vec![spacing]).with_field(field), noise_scale: None }
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
    /// The model's terms that are fitted.
    free: Vec<usize>,
    /// Radius of the largest masks, px.
    radius: f64,
    /// Through how much of their microlens pixels see.
    pupil: Pupil,
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
            exposure: Exposure::new(&plan, radius, EXPOSED),
            clusters: Clusters::new(plan.clusters(wanted)),
            random: Random::new(&plan, &plan.jobs, SAMPLED),
            plan,
        })
    }
}

impl Engine {
    pub(super) fn new(grid: &Grid, profile: &Vignetting, options: &LiveOptions) -> Result<Self, SpacingError> {
        let radius = MASK_FRACTION * grid.pitch_px() / 2.0;
        let work = Work::new(grid, &Motion::NONE, radius, options)?;
        let (gains, pupil) = drawn(profile, grid, &work.plan, radius);
        Ok(Self {
            follower: Follower::new(grid, profile),
            planned: Motion::NONE,
            moved: Motion::NONE,
            pool: Pool::default(),
            normals: [Normal::default(), Normal::default()],
            options: *options,
            free: free_terms(&work.plan, options),
            radius,
            pupil,
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

    /// Divides this profile out of frames from now on.
    pub(super) fn divide_out(&mut self, profile: &Vignetting) {
        (self.gains, self.pupil) = drawn(profile, &self.follower.grid(), &self.work.plan, self.radius);
    }

    /// The grid where it is now.
    pub(super) fn grid(&self) -> Grid {
        self.follower.grid()
    }

    pub(super) fn measure<T: Sample>(
        &mut self,
        frame: &Frame<'_, T>,
        bits: u8,
        ended: &mut dyn FnMut(LivePart),
    ) -> Result<LiveSpacing, LiveError> {
        let raw_noise = self.work.exposure.check(frame, &self.work.plan)?;
        ended(LivePart::Exposure);
        self.follower.follow(frame, bits, raw_noise)?;
        self.keep_up()?;
        ended(LivePart::Grid);
        let state = self.state.clone().ok_or(LiveError::NoStart)?;
        let mut model = Model { free: self.free.clone(), ..state.model };
        if let Some(field) = self.options.field_held {
            model = model.with_field(field);
        }
        let known = state.noise_scale;
        let settled = self.settle(frame, raw_noise, &mut model, known);
        let found = settled.and_then(|scale| {
            ended(LivePart::Clusters);
            self.finish(frame, raw_noise, &mut model, (scale, known), ended)
        });
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
        let from_px = model.spacings[0];
        let reach = 0.15 * self.options.mla_pitch_px;
        let mut scale = known_scale.unwrap_or(1.0);
        let mut shape = None;
        let mut axis = Model { free: Vec::new(), ..model.clone() };
        for _ in 0..ROUNDS {
            let now = self.shape(axis.spacings[0]);
            let fresh = shape.replace(now) != Some(now);
            let noise = (raw_noise * scale).max(QUANTISATION);
            let Self { gains, work: Work { plan, clusters, .. }, normals: [normal, _], .. } = self;
            let light = Light::Drawn(gains);
            let pass = Pass { frame, light, lenses: &plan.lenses, model: &axis, shape: &now, noise };
            clusters.run(&pass, fresh);
            normal.gather(&[Compared { jobs: &clusters.jobs, noise }], &axis);
            let Some(inverse) = normal.inverse() else { return Err(self.no_match(0, from_px, raw_noise)) };
            let step = normal.step(&inverse);
            let sigma = normal.scatter(&axis, &inverse, &step)[(0, 0)].sqrt();
            let step = step[0];
            // What the clusters cannot tell from nothing is left to all pairs.
            if step.abs() < SETTLED_PX.max((2.0 * sigma).min(UNSURE_PX)) {
                if normal.contents.correlation() < LEAST_CORRELATION {
                    return Err(self.no_match(0, from_px, raw_noise));
                }
                if known_scale.is_none() {
                    scale = noise_scale(scale, normal.residual);
                }
                model.spacings = axis.spacings;
                return Ok(scale);
            }
            // Matching is linear over about a pixel: a longer step is only a direction.
            axis.spacings[0] += step.clamp(-1.0, 1.0);
            let moved = (axis.spacings[0] - from_px).abs();
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
        ended: &mut dyn FnMut(LivePart),
    ) -> Result<LiveSpacing, LiveError> {
        let from_px = model.spacings[0];
        let noise = (raw_noise * scale).max(QUANTISATION);
        let mut damping = Damping::new(PASSES);
        for passes in 1..=PASSES {
            let shape = self.shape(model.spacings[0]);
            let before = model.clone();
            let Self { gains, work: Work { plan, random, .. }, pool, normals: [_, normal], .. } = self;
            let light = Light::Drawn(gains);
            let pass = Pass { frame, light, lenses: &plan.lenses, model: &before, shape: &shape, noise };
            run::<_, ALONG>(&pass, &mut plan.jobs, pool);
            ended(LivePart::Pairs);
            normal.gather(&[Compared { jobs: &plan.jobs, noise }], &before);
            let pairs = normal.region_pairs[0];
            if pairs < LEAST_PAIRS {
                return Err(SpacingError::TooFewMicroImages { pairs, needed: LEAST_PAIRS }.into());
            }
            let Some(inverse) = normal.inverse() else { return Err(self.no_match(1, from_px, raw_noise)) };
            let whole = normal.step(&inverse);
            let mut step = damping.damped(&whole);
            ended(LivePart::Equations);
            let largest = step.abs().sum();
            if largest > 1.0 {
                step /= largest;
            }
            model.advance(&step);
            // What comes to rest late or by shortening alone has to be settled besides.
            let at_rest = largest <= FINAL_STEP_PX && 2 * passes <= PASSES;
            if !at_rest && !normal.is_settled(&before, &inverse, &step, &whole) {
                continue;
            }
            let correlation = normal.contents.correlation();
            if correlation < LEAST_CORRELATION {
                return Err(self.no_match(1, from_px, raw_noise));
            }
            normal.check_texture(raw_noise, plan.direction_count)?;
            if self.options.field_held.is_none()
                && let Some(free) = normal.demanded(&before)
            {
                self.free.clone_from(&free);
                model.free = free;
                continue;
            }
            let setting = Setting { pass: &pass, jobs: &plan.jobs, normal, frame: 0 };
            let along = inverse.column(0).into_owned();
            let sigma_random_px = random.variance::<_, ALONG>(&setting, &along, known_scale.is_none()).sqrt();
            ended(LivePart::Noise);
            let compared = Compared { jobs: &plan.jobs, noise };
            let unevenness = unevenness(&compared, normal, &before, self.pupil.blur(model.spacings[0]));
            ended(LivePart::Boards);
            let window_px = f64::from(shape.edge) - 0.5;
            let free = self.pupil.corrected(model.spacings[0], window_px);
            check_range(&self.options.of_spacing(), free.spacing)?;
            let mut seen = model.clone();
            let (scatter, noise) = match normal.refined(&[compared], &before) {
                Some(Refined { change, covariance, noise }) => {
                    seen.advance(&change);
                    (covariance, noise)
                }
                None => (normal.scatter(&before, &inverse, &step), 1.0),
            };
            let mut covariance = before.usual(&(scatter * free.slope.powi(2)));
            let sigma_random_px = sigma_random_px * free.slope * noise;
            let least = if normal.spare(before.unknowns()) < LEAST_SPARE { sigma_random_px } else { 0.0 };
            let sigma_scatter_px = covariance[0][0].sqrt().max(least);
            covariance[0][0] = whole_variance(covariance[0][0], sigma_random_px, free.sigma);
            ended(LivePart::Equations);
            let residual_ratio = normal.residual;
            self.state = Some(State { model: model.clone(), noise_scale: Some(noise_scale(scale, residual_ratio)) });
            let [tilt_x_px, tilt_y_px, curvature_px, astigmatism_px, row_column_px, diagonal_px, ..] =
                seen.terms.map(|term| term * free.slope);
            return Ok(LiveSpacing {
                on_axis_px: free.spacing + free.slope * (seen.spacings[0] - model.spacings[0]),
                sigma_px: covariance[0][0].sqrt(),
                sigma_scatter_px,
                sigma_random_px,
                tilt_x_px,
                tilt_y_px,
                curvature_px,
                astigmatism_px,
                row_column_px,
                diagonal_px,
                covariance,
                window_px,
                pairs,
                correlation,
                residual_ratio,
                unevenness,
                noise_grey_levels: raw_noise,
                grid: self.follower.motion().reported(self.follower.field(), self.follower.sigma_px()),
                passes,
            });
        }
        Err(self.no_match(1, from_px, raw_noise))
    }

    /// Tiles for spacings near this one.
    fn shape(&self, spacing: f64) -> Shape {
        Shape::new(mask_radius(&self.pupil, spacing))
    }

    /// What it means that the clusters (0) or all pairs (1) do not match.
    fn no_match(&self, which: usize, from_px: f64, noise: f64) -> LiveError {
        let contents = &self.normals[which].contents;
        if contents.are_blank() {
            return SpacingError::NoTexture { noise }.into();
        }
        LiveError::Lost { from_px, correlation: contents.correlation() }
    }
}

/// A profile drawn for the micro-images of a plan on a grid, within masks of so large a radius (px); and through how much of
/// their microlens pixels see by it.
fn drawn(profile: &Vignetting, grid: &Grid, plan: &Plan, radius: f64) -> (Gains, Pupil) {
    let gains = Gains::new(profile, grid, radius);
    let centres: Vec<[f64; 2]> = (0..plan.lenses.len() as u32).map(|lens| plan.centre(lens)).collect();
    let pupil = Pupil::new(&centres, grid.pitch_px(), |centre, pixel| gains.share(centre, pixel));
    (gains, pupil)
}

/// Which terms are unknowns. Directions of a plan are told apart by the cosine's term, three directions also by the sine's:
/// pairs are compared along themselves only.
fn free_terms(plan: &Plan, options: &LiveOptions) -> Vec<usize> {
    let alike = options.directions_alike;
    let fitted = |&term: &usize| match term {
        term if term < FIELD_TERMS => options.field_held.is_none(),
        FIELD_TERMS => true,
        term if term + 1 == USUAL_TERMS => !alike && plan.direction_count == 3,
        _ => !alike,
    };
    (0..USUAL_TERMS).filter(fitted).collect()
}
