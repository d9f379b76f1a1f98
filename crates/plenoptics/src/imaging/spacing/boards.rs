//! Whether a field that is taken for one board's shows two.
//!
//! Two boards side by side, or one in front of another, have a spacing each; one with tilt and curvature fitted to both
//! lies between them, or is the larger one's alone, and nothing of it looks wrong. Looked for is the part of the field,
//! on one side of a straight edge or between two that are parallel, where
//!
//! - pairs do not match, as they do elsewhere: boards that differ by more than matching is linear over; or else
//! - one step more of the normal equation would give a spacing of its own by which most is gained.
//!
//! Then all pairs are fitted once more with a spacing for each of the two. In a frame that is read live there is no time for
//! that: what one step says has to do ([`unevenness`]).

use std::f64::consts::PI;

use nalgebra::DVector;
use serde::Serialize;

use super::frame::SpacingFrame;
use super::map::LEAST_WEIGHT;
use super::solve::{Outcome, Solver};
use super::{SpacingOptions, reach, search};
use crate::imaging::matching::model::{Local, Model};
use crate::imaging::matching::normal::{Compared, LEAST_CORRELATION, LEAST_PAIRS, Normal};
use crate::imaging::matching::plan::{Job, Pair};

/// Directions in which edges are looked for.
const DIRECTIONS: usize = 12;
/// Places along each side of a frame by which edges are told.
const PLACES: usize = 24;
/// Slices of the field between which edges may lie.
const SLICES: usize = 20;
/// Least share of the pairs that either board has.
const LEAST_SHARE: f64 = 0.1;
/// A step that is smaller is none, px: what one board's own flaws make of it; and px for the square of each pixel out of
/// focus, where fine texture and coarse have spacings of their own. One board has shown 0.04 px, and 7 px out 0.37 px.
const LEAST_STEP_PX: f64 = 0.05;
const LEAST_STEP_BLURRED: f64 = 0.015;
/// Standard uncertainties that a step must stand above none: the likeliest of many edges is large by chance.
const SIGNIFICANCE: f64 = 5.0;
/// Least steps that it has to be where nothing but one step of the normal equation says so: 0.1 px in focus, where one
/// board has not exceeded 0.06 px.
const LEAST_UNEVEN: f64 = 2.0;
/// What a part that does not match at all counts as, as an unevenness.
const MISMATCHED_COUNTS: f64 = 10.0;
/// Shares of pairs that do not match: at least in a board's part of the field, and at most elsewhere.
const MISMATCHED: [f64; 2] = [0.5, 0.2];

/// Two boards in one field.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TwoBoards {
    /// Spacing on the axis as each has it, px: first that of the larger part of the field.
    pub spacings_px: [f64; 2],
    /// Standard uncertainty of their difference, px.
    pub difference_sigma_px: f64,
    /// The second's share of the pairs.
    pub share: f64,
}

/// A part of the field.
#[derive(Debug, Clone, Copy)]
struct Part {
    /// The direction across its edges.
    across: [f64; 2],
    /// Where it begins and ends along that, in field coordinates.
    range: [f64; 2],
}

impl Part {
    fn holds(&self, at: [f64; 2]) -> bool {
        (self.range[0]..self.range[1]).contains(&along(self.across, at))
    }

    /// The work of comparing a frame's pairs, those within as region 1 and the others as 0; none across an edge.
    fn jobs(&self, frame: &SpacingFrame) -> Vec<Job> {
        let within = |lens: u32| self.holds(frame.plan.field.coordinates(frame.plan.centre(lens)));
        frame.jobs_of(|pair| {
            let [first, second] = [pair.first, pair.second].map(within);
            (first == second).then_some(Pair { region: u8::from(first), ..pair })
        })
    }
}

fn along([x, y]: [f64; 2], at: [f64; 2]) -> f64 {
    x * at[0] + y * at[1]
}

/// What pairs say of a spacing of their own.
#[derive(Debug, Clone, Copy, Default)]
struct Said {
    pairs: f64,
    /// How many do not match.
    mismatched: f64,
    /// The gradient, and the information with everything local.
    gradient: f64,
    information: Local,
}

impl Said {
    fn add(&mut self, other: &Self) {
        self.pairs += other.pairs;
        self.mismatched += other.mismatched;
        self.gradient += other.gradient;
        self.information += other.information;
    }

    fn less(&self, other: &Self) -> Self {
        Self {
            pairs: self.pairs - other.pairs,
            mismatched: self.mismatched - other.mismatched,
            gradient: self.gradient - other.gradient,
            information: self.information - other.information,
        }
    }
}

/// A part whose spacing is another one.
struct Step {
    part: Part,
    /// By how much, px.
    px: f64,
    /// Its standard uncertainty from noise alone, px.
    sigma: f64,
}

/// Where the field says what, and all of it.
struct Field {
    places: Vec<([f64; 2], Said)>,
    all: Said,
}

/// The two boards in frames of one pose that one spacing was fitted to; `None` where there is one, or two cannot be told.
pub(super) fn two_boards(solver: &Solver<'_>, model: &Model, options: &SpacingOptions) -> Option<TwoBoards> {
    let compared: Vec<Compared<'_>> = solver.compared().collect();
    let field = Field::new(&compared, &solver.normal, model);
    let found = |part: Part| Some((part, search_within(&part, solver.frames.first()?, options)?));
    let pupil = &solver.frames.first()?.pupil;
    let least_px = |spacing: f64| least_step_px(pupil.blur(spacing));
    // A second fit costs as much as the first, and one step underrates a difference by no more than a half.
    let worth = |&(_, start): &(Part, f64)| (start - model.spacings[0]).abs() > 0.5 * least_px(model.spacings[0]);
    let stepped = || {
        let step = field.stepped(&solver.normal, model)?;
        Some((step.part, model.spacings[0] + step.px)).filter(worth)
    };
    let (part, start) = field.mismatched().and_then(found).or_else(stepped)?;
    let mut apart = Solver::new(solver.frames, solver.frames.iter().map(|frame| part.jobs(frame)).collect());
    apart.radii.clone_from(&solver.radii);
    apart.noise_scale = solver.noise_scale;
    let mut sided = Model { scales: vec![1.0; 2], spacings: vec![model.spacings[0], start], ..model.clone() };
    let settled = apart.iterate(&mut sided, reach(options), 1e-3, 20) == Outcome::Converged;
    let &[outside, inside] = &apart.normal.region_pairs[..] else { return None };
    let share = inside as f64 / (outside + inside) as f64;
    // Pairs across an edge count for neither.
    if !settled || outside.min(inside) < LEAST_PAIRS || share.min(1.0 - share) < 0.75 * LEAST_SHARE {
        return None;
    }
    let inverse = apart.normal.inverse()?;
    let scatter = apart.normal.scatter(&sided, &inverse, &apart.normal.step(&inverse));
    let [first, second] = [0, 1].map(|k| pupil.corrected(sided.spacings[k], solver.radii[0]));
    let sigma = first.slope * (scatter[(0, 0)] + scatter[(1, 1)] - 2.0 * scatter[(0, 1)]).max(0.0).sqrt();
    let least_px = least_px(first.spacing).min(least_px(second.spacing));
    if (second.spacing - first.spacing).abs() < least_px.max(SIGNIFICANCE * sigma) {
        return None;
    }
    let mut spacings_px = [first.spacing, second.spacing];
    if share > 0.5 {
        spacings_px.reverse();
    }
    Some(TwoBoards { spacings_px, difference_sigma_px: sigma, share: share.min(1.0 - share) })
}

/// The least step (px) between two boards that are so far out of focus (px).
fn least_step_px(blur_px: f64) -> f64 {
    LEAST_STEP_PX + LEAST_STEP_BLURRED * blur_px * blur_px
}

/// By how much the spacing of a field steps between two parts of it, as one step of the normal equation says, so far out of
/// focus (px): 1 and more where that is as between two boards.
pub(in crate::imaging) fn unevenness(frame: &Compared<'_>, normal: &Normal, model: &Model, blur_px: f64) -> f64 {
    let field = Field::new(std::slice::from_ref(frame), normal, model);
    if field.mismatched().is_some() {
        return MISMATCHED_COUNTS;
    }
    match field.stepped(normal, model) {
        // Small by either is small: noise has it go to and fro, and not leap.
        Some(Step { px, sigma, .. }) => px.abs() / (LEAST_UNEVEN * least_step_px(blur_px)).max(SIGNIFICANCE * sigma),
        None => 0.0,
    }
}

/// The spacing (px) at which pairs within a part of a frame match best, where they do.
fn search_within(part: &Part, frame: &SpacingFrame, options: &SpacingOptions) -> Option<f64> {
    let mut only = frame.clone();
    only.assign_regions(|lens| part.holds(frame.plan.field.coordinates(lens.centre)).then_some(0));
    let found = search::search(&[only], options.mla_pitch_px, options.mode);
    found.candidates.first().filter(|best| best.correlation >= LEAST_CORRELATION).map(|best| best.spacing)
}

impl Field {
    /// What the pairs of frames said at a state of the model.
    fn new(frames: &[Compared<'_>], normal: &Normal, model: &Model) -> Self {
        let mut places = vec![([0.0; 2], Said::default()); PLACES * PLACES];
        let mut all = Said::default();
        let place = |v: f64| (((v + 1.0) / 2.0 * PLACES as f64).max(0.0) as usize).min(PLACES - 1);
        for (k, Compared { jobs, noise }) in frames.iter().enumerate() {
            let unit = noise.powi(-2);
            for (link, score) in jobs.iter().flat_map(|job| job.links().zip(&job.scores)).filter(|(_, s)| s.compared())
            {
                let weight = normal.weight(k, score);
                let [along, across] = model.derivatives(0, &link.pair.place);
                let [[own, mixed], [also, _]] = score.information.map(|row| row.map(f64::from));
                let said = Said {
                    pairs: 1.0,
                    mismatched: f64::from(u8::from(weight < LEAST_WEIGHT)),
                    gradient: unit * weight * f64::from(score.score[0]),
                    information: unit * weight * (own * along + 0.5 * (mixed + also) * across),
                };
                let at = link.pair.place.at;
                let (mean, sum) = &mut places[place(at[1]) * PLACES + place(at[0])];
                sum.add(&said);
                all.add(&said);
                for (mean, at) in mean.iter_mut().zip(at) {
                    *mean += (at - *mean) / sum.pairs;
                }
            }
        }
        places.retain(|(_, said)| said.pairs > 0.0);
        Self { places, all }
    }

    /// The part of which most speaks.
    fn likeliest(&self, speaks: impl Fn(&Said) -> Option<f64>) -> Option<(Part, Said)> {
        let mut best: Option<(f64, Part, Said)> = None;
        for direction in 0..DIRECTIONS {
            let (sin, cos) = (PI * direction as f64 / DIRECTIONS as f64).sin_cos();
            let across = [cos, sin];
            let edges = self.edges(across);
            for (k, (from, before)) in edges.iter().enumerate() {
                for (to, until) in &edges[k + 1..] {
                    let said = until.less(before);
                    if !(LEAST_SHARE..=1.0 - LEAST_SHARE).contains(&(said.pairs / self.all.pairs)) {
                        continue;
                    }
                    let Some(gain) = speaks(&said) else { continue };
                    if best.as_ref().is_none_or(|(most, ..)| gain > *most) {
                        best = Some((gain, Part { across, range: [*from, *to] }, said));
                    }
                }
            }
        }
        best.map(|(_, part, said)| (part, said))
    }

    /// Where edges may lie along a direction, and what is said before each.
    fn edges(&self, across: [f64; 2]) -> Vec<(f64, Said)> {
        let mut places: Vec<(f64, &Said)> = self.places.iter().map(|(at, said)| (along(across, *at), said)).collect();
        places.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut edges = vec![(f64::NEG_INFINITY, Said::default())];
        let mut sum = Said::default();
        for (k, (at, said)) in places.iter().enumerate() {
            sum.add(said);
            let next = places.get(k + 1).map(|(next, _)| f64::midpoint(*at, *next));
            if next.is_none() || sum.pairs * SLICES as f64 >= self.all.pairs * edges.len() as f64 {
                edges.push((next.unwrap_or(f64::INFINITY), sum));
            }
        }
        edges
    }

    /// The part where pairs do not match, and do elsewhere.
    fn mismatched(&self) -> Option<Part> {
        if self.all.mismatched < LEAST_SHARE * self.all.pairs {
            return None;
        }
        let likelihood = |said: &Said| {
            let share = (said.mismatched / said.pairs).clamp(1e-6, 1.0 - 1e-6);
            said.mismatched * share.ln() + (said.pairs - said.mismatched) * (1.0 - share).ln()
        };
        let mismatched = self.likeliest(|within| {
            let others = self.all.less(within);
            let [there, elsewhere] = [within, &others].map(|said| said.mismatched / said.pairs);
            let [most, least] = MISMATCHED;
            (there >= most && elsewhere <= least).then(|| likelihood(within) + likelihood(&others))
        });
        mismatched.map(|(part, _)| part)
    }

    /// The part that would have a spacing of its own.
    fn stepped(&self, normal: &Normal, model: &Model) -> Option<Step> {
        let inverse = normal.inverse()?;
        let step = normal.step(&inverse);
        let free = |local: &Local| {
            let terms = model.free.iter().map(|term| local[term + 1]);
            DVector::from_iterator(1 + model.free.len(), [local[0]].into_iter().chain(terms))
        };
        // What is left for it once everything else has taken its own, and how surely.
        let own = |said: &Said| {
            let others = free(&said.information);
            let information = said.information[0] - others.dot(&(&inverse * &others));
            let left = said.gradient - others.dot(&step);
            (information > 1e-9 * self.all.information[0]).then_some([left, information])
        };
        let (part, said) = self.likeliest(|said| own(said).map(|[left, information]| left * left / information))?;
        let [left, information] = own(&said)?;
        Some(Step { part, px: left / information, sigma: information.powf(-0.5) })
    }
}
