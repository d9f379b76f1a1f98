//! The uncertainty that pixel noise alone gives the spacing on the axis.
//!
//! The noise of a pixel enters every pair that its micro-image takes part in; with a neighbour on either side most of it
//! cancels. So its weights are gathered pixel by pixel over all pairs before they are squared: on a sample of
//! micro-images, which is carried to all by the ratio to what the pairs' own sums say.

use pulp::Simd;
use rayon::prelude::*;

use super::compare::{Overlap, Warp};
use super::frame::{Frame, Sample};
use super::gains::Gains;
use super::normal::{Matrix, Model, Normal, Terms, derivatives};
use super::plan::{Job, Plan, Star};
use super::score::Order;
use super::shape::Shape;
use super::tile::{Tile, Workspace};

/// Micro-images of the sample.
const WANTED: usize = 96;
/// How many of them are looked at again in every frame: the ratio hardly changes from one to the next.
const A_FRAME: usize = 4;

/// A sample of micro-images and room for its work.
#[derive(Debug, Clone)]
pub(super) struct Random {
    places: Vec<Place>,
    /// The first to be looked at next.
    next: usize,
}

/// One micro-image of the sample.
#[derive(Debug, Clone)]
struct Place {
    star: Star,
    /// Variance gathered pixel by pixel, and what the pairs' own sums make of it.
    found: [f64; 2],
    own: Tile,
    other: Tile,
    work: Workspace,
    warp: Warp,
    weights: Vec<f32>,
}

/// What all micro-images of the sample share.
pub(super) struct Setting<'a, T> {
    pub(super) frame: &'a Frame<'a, T>,
    pub(super) gains: &'a Gains,
    pub(super) plan: &'a Plan,
    pub(super) model: &'a Model,
    pub(super) normal: &'a Normal,
    pub(super) shape: &'a Shape,
    /// Noise, grey levels.
    pub(super) noise: f64,
}

impl Random {
    pub(super) fn new(plan: &Plan) -> Self {
        let place = |star| Place {
            star,
            found: [0.0; 2],
            own: Tile::default(),
            other: Tile::default(),
            work: Workspace::default(),
            warp: Warp::default(),
            weights: Vec::new(),
        };
        Self { places: plan.stars(WANTED).into_iter().map(place).collect(), next: 0 }
    }

    /// Variance of the spacing on the axis from pixel noise, px², where `inverse` is that of the information. The whole
    /// sample is looked at where the last frame says nothing of this one.
    pub(super) fn variance<T: Sample>(&mut self, setting: &Setting<'_, T>, inverse: &Matrix, whole: bool) -> f64 {
        let along: Terms = inverse.column(0).into_owned();
        let arch = pulp::Arch::new();
        let jobs = &setting.plan.jobs;
        let range = if whole { 0..self.places.len() } else { self.next..(self.next + A_FRAME).min(self.places.len()) };
        self.next = if range.end < self.places.len() { range.end } else { 0 };
        self.places[range].par_iter_mut().with_min_len(2).for_each(|place| {
            arch.dispatch(Gather { place, setting, jobs, along: &along });
        });
        // Relative to the frame's own, so that frames of other noise or light may stand side by side.
        let sum = |k: usize| self.places.iter().map(|p| p.found[k]).sum::<f64>();
        let all = along.dot(&(setting.normal.random * along)) * setting.noise.powi(2);
        all * sum(0) / sum(1).max(1e-300)
    }
}

struct Gather<'a, T> {
    place: &'a mut Place,
    setting: &'a Setting<'a, T>,
    jobs: &'a [Job],
    along: &'a Terms,
}

impl<T: Sample> pulp::WithSimd for Gather<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { place, setting, jobs, along } = self;
        let Place { star, found, own, other, work, warp, weights } = place;
        let Setting { frame, gains, plan, model, normal, shape, noise } = *setting;
        weights.clear();
        weights.resize(shape.size(), 0.0);
        *found = [0.0; 2];
        own.prepare(simd, frame, (&plan.lenses[star.lens as usize], gains), shape, work);
        for ray in &star.rays {
            let score = &jobs[ray.job as usize].scores[ray.score as usize];
            if !score.compared() {
                continue;
            }
            let pair = &ray.pair;
            let (lens, sign) = if ray.outwards { (pair.second, 1.0) } else { (pair.first, -1.0) };
            other.prepare(simd, frame, (&plan.lenses[lens as usize], gains), shape, work);
            let spacing = model.spacing(pair, &plan.directions);
            let Some(overlap) = Overlap::new(own, other, shape, pair.unit.map(|u| sign * u), spacing) else { continue };
            let Some(moments) = overlap.compare(simd, own, other, shape, warp) else { continue };
            let order = Order::new(&moments, noise);
            let factor =
                derivatives(pair, &plan.directions).dot(along) * normal.weight(score) / (noise * noise).max(1e-6);
            found[1] += factor * factor * order.random(&moments);
            // The neighbour's role mirrors the reference's: it counts as the same again.
            let strength = (2.0 * factor * order.trust) as f32;
            let [ux, uy] = overlap.unit;
            let (slope_mean, mean) = (moments.slope_mean as f32, moments.reference_mean as f32);
            let projection = order.projection as f32;
            for row in 0..overlap.rows {
                let from = overlap.own + row * shape.stride;
                let near = overlap.nearest + row * shape.stride;
                for k in 0..overlap.columns {
                    let weight = own.amplitudes[from + k] * other.amplitudes[near + k];
                    let slope = ux * own.slopes[0][from + k] + uy * own.slopes[1][from + k] - slope_mean;
                    let slope = slope - projection * (own.values[from + k] - mean);
                    weights[from + k] += strength * weight * slope;
                }
            }
        }
        let patch = gains.patch(&plan.lenses[star.lens as usize]);
        // In units of what the pairs of the whole frame make of it.
        let unit = 1.0 / along.dot(&(normal.random * along)).max(1e-300);
        for (y, line) in weights.chunks_exact(shape.stride).enumerate() {
            for (x, &weight) in line.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
                found[0] += unit * (f64::from(weight) * f64::from(patch.gain(x, y, shape))).powi(2);
            }
        }
        found[1] *= unit;
    }
}
