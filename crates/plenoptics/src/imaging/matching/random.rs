//! The uncertainty that pixel noise alone gives the spacing on the axis.
//!
//! The noise of a pixel enters every pair that its micro-image takes part in; with a neighbour on either side most of it
//! cancels. So its weights are gathered pixel by pixel over all pairs before they are squared: on a sample of
//! micro-images, which is carried to all by the ratio to what the pairs' own sums say.

use nalgebra::DVector;
use pulp::Simd;
use rayon::prelude::*;

use super::compare::{Overlap, Warp};
use super::model::Local;
use super::normal::Normal;
use super::plan::{Job, Plan, Star};
use super::run::Pass;
use super::samples::Sample;
use super::score::Order;
use super::tile::{Tile, Workspace};

/// How many of the sample are looked at again in every frame: the ratio hardly changes from one to the next.
const A_FRAME: usize = 4;

/// A sample of micro-images and room for its work.
#[derive(Debug, Clone)]
pub(in crate::imaging) struct Random {
    places: Vec<Member>,
    /// The first to be looked at next.
    next: usize,
}

/// One micro-image of the sample.
#[derive(Debug, Clone)]
struct Member {
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
pub(in crate::imaging) struct Setting<'a, T> {
    /// At the state of the model that the pairs were compared at.
    pub(in crate::imaging) pass: &'a Pass<'a, T>,
    /// The pairs of the frame.
    pub(in crate::imaging) jobs: &'a [Job],
    pub(in crate::imaging) normal: &'a Normal,
    /// Which of the frames of the normal equation.
    pub(in crate::imaging) frame: usize,
}

impl Random {
    /// Of so many micro-images at most.
    pub(in crate::imaging) fn new(plan: &Plan, jobs: &[Job], most: usize) -> Self {
        let place = |star| Member {
            star,
            found: [0.0; 2],
            own: Tile::default(),
            other: Tile::default(),
            work: Workspace::default(),
            warp: Warp::default(),
            weights: Vec::new(),
        };
        Self { places: plan.stars(jobs, most).into_iter().map(place).collect(), next: 0 }
    }

    /// Variance of an unknown from pixel noise, px², where `along` is its row of the inverse of the information, `WHAT` of
    /// the pairs having been compared. The whole sample is looked at where the last frame says nothing of this one.
    pub(in crate::imaging) fn variance<T: Sample, const WHAT: usize>(
        &mut self,
        setting: &Setting<'_, T>,
        along: &DVector<f64>,
        whole: bool,
    ) -> f64 {
        let arch = pulp::Arch::new();
        let Setting { pass, normal, frame, .. } = *setting;
        let regions = pass.model.spacings.len();
        let along: Vec<Local> = (0..regions).map(|region| pass.model.local(along, region)).collect();
        let random: f64 = along.iter().enumerate().map(|(r, along)| normal.random(frame, r, along)).sum();
        let range = if whole { 0..self.places.len() } else { self.next..(self.next + A_FRAME).min(self.places.len()) };
        self.next = if range.end < self.places.len() { range.end } else { 0 };
        self.places[range].par_iter_mut().with_min_len(2).for_each(|place| {
            arch.dispatch(Gather::<T, WHAT> { place, setting, along: &along, random });
        });
        // Relative to the frame's own, so that frames of other noise or light may stand side by side.
        let sum = |k: usize| self.places.iter().map(|p| p.found[k]).sum::<f64>();
        random * pass.noise.powi(2) * sum(0) / sum(1).max(1e-300)
    }
}

struct Gather<'a, T, const WHAT: usize> {
    place: &'a mut Member,
    setting: &'a Setting<'a, T>,
    along: &'a [Local],
    random: f64,
}

impl<T: Sample, const WHAT: usize> pulp::WithSimd for Gather<'_, T, WHAT> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { place, setting, along, random } = self;
        let Member { star, found, own, other, work, warp, weights } = place;
        let Setting { pass, jobs, normal, frame } = *setting;
        let Pass { frame: samples, light, lenses, model, shape, noise } = *pass;
        weights.clear();
        weights.resize(shape.size(), 0.0);
        *found = [0.0; 2];
        own.prepare(simd, samples, (&lenses[star.lens as usize], light), shape, work);
        for ray in &star.rays {
            let score = &jobs[ray.job as usize].scores[ray.score as usize];
            if !score.compared() {
                continue;
            }
            let pair = &ray.pair;
            let region = usize::from(pair.region);
            let (lens, sign) = if ray.outwards { (pair.second, 1.0) } else { (pair.first, -1.0) };
            other.prepare(simd, samples, (&lenses[lens as usize], light), shape, work);
            let spacing = model.spacing(region, &pair.place);
            let Some(overlap) = Overlap::new(own, other, shape, pair.unit.map(|u| sign * u), spacing) else { continue };
            let Some(moments) = overlap.compare::<S, WHAT>(simd, own, other, shape, warp) else { continue };
            let order = Order::new(&moments, noise);
            let scale = normal.weight(frame, score) / (noise * noise).max(1e-6);
            let rows = model.derivatives(region, &pair.place);
            let factors = [scale * rows[0].dot(&along[region]), scale * rows[1].dot(&along[region])];
            let [ux, uy] = overlap.unit;
            let mean = moments.reference_mean as f32;
            // Along the pair, and across it.
            let ways = [[ux, uy], [-uy, ux]];
            for k in 0..WHAT {
                found[1] += factors[k] * factors[k] * order.energy[k];
                // The neighbour's role mirrors the reference's: it counts as the same again.
                let strength = (2.0 * factors[k] * order.trust[k]) as f32;
                let (slope_mean, projection) = (moments.slope_mean[k] as f32, order.projection[k] as f32);
                let [wx, wy] = ways[k];
                for row in 0..overlap.rows {
                    let from = overlap.own + row * shape.stride;
                    let near = overlap.nearest + row * shape.stride;
                    for x in 0..overlap.columns {
                        let weight = own.counted()[from + x] * other.amplitudes[near + x];
                        let slope = wx * own.slopes[0][from + x] + wy * own.slopes[1][from + x] - slope_mean;
                        let slope = slope - projection * (own.values[from + x] - mean);
                        weights[from + x] += strength * weight * slope;
                    }
                }
            }
        }
        let patch = light.patch(&lenses[star.lens as usize]);
        // In units of what the pairs of the whole frame make of it.
        let unit = 1.0 / random.max(1e-300);
        for (y, line) in weights.chunks_exact(shape.stride).enumerate() {
            for (x, &weight) in line.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
                found[0] += unit * (f64::from(weight) * f64::from(patch.gain(x, y, shape))).powi(2);
            }
        }
        found[1] *= unit;
    }
}
