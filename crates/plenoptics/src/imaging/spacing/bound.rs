//! The Cramér–Rao bound: how well any unbiased estimator could tell the spacing from these pixels and this noise.
//!
//! An object point that the microlens with centre c shows at r from c is shown by every other whose mask it falls into;
//! the spacing moves the image by −r/(P − l) a pixel of spacing. Texture is unknown: what moves all its images alike
//! could be texture, so that only the departure of r from its mean over the views of the same point tells anything.
//! Gain and offset of every micro-image are unknown too, as are the terms of the model: the bound is the joint one.

use nalgebra::DMatrix;

use super::frame::SpacingFrame;
use super::solve::Solver;
use crate::imaging::matching::model::{LOCAL, Model, Place};
use crate::imaging::matching::run::each;
use crate::imaging::matching::shape::Shape;
use crate::imaging::matching::tile::Tile;

/// Noise variance of the spline's slope along one axis at a pixel, in units of a pixel's: 18 z²/(1 − z²), z = √3 − 2.
const SLOPE_NOISE: f64 = 1.392_304_845;
/// The same at a green pixel of a mosaic whose other pixels are filled in from the green ones about them.
const MOSAIC_SLOPE_NOISE: f64 = 0.487_113_585;

/// Sums over one micro-image: moments of the three ways of moving (spread, stretch, shear), each with itself and the
/// others.
type Moments = [[f64; 3]; 3];

/// Standard deviation (px) below which no unbiased estimator of the spacing on the axis comes, tilt, curvature and the
/// other free terms of the model being unknown too. `None` where the frames hold no information.
pub(super) fn bound(solver: &Solver<'_>, model: &Model) -> Option<f64> {
    let n = model.unknowns();
    let mut information = DMatrix::<f64>::zeros(n, n);
    for (frame, &radius) in solver.frames.iter().zip(&solver.radii) {
        add(frame, model, (radius, solver.noise_scale), &mut information);
    }
    for (unknown, prior) in model.prior() {
        information[(unknown, unknown)] += prior;
    }
    let inverse = information.cholesky()?.inverse();
    Some(inverse[(0, 0)].sqrt()).filter(|bound| bound.is_finite())
}

fn add(frame: &SpacingFrame, model: &Model, (radius, noise_scale): (f64, f64), information: &mut DMatrix<f64>) {
    let views = Views::new(frame, model, radius, frame.noise(noise_scale));
    let lenses: Vec<[u32; 1]> = (0..frame.micro_images.len() as u32).map(|lens| [lens]).collect();
    let moments = frame.at(model, radius, noise_scale, |pass| {
        each(pass, &lenses, |lens, tiles| views.moments(lens, &tiles[0], pass.shape))
    });
    for (micro_image, moments) in frame.micro_images.iter().zip(&moments) {
        let Some(region) = micro_image.region else { continue };
        let at = frame.plan.field.coordinates(micro_image.centre);
        let off_axis = frame.plan.directions.off_axis(at);
        // Spacing, tilt and curvature spread the images; stretch and shear turn the direction of it. What lies across a pair
        // says nothing new about the matrix that turns directions.
        let [spread, stretch, shear] = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
            .map(|turn| model.derivatives(region, &Place { at, turn, off_axis })[0]);
        let rows = [spread, stretch - spread, shear - spread];
        for (row, moments) in rows.iter().zip(moments) {
            for (column, moment) in rows.iter().zip(moments) {
                for (i, at) in (0..LOCAL).filter_map(|i| Some((i, model.unknown(region, i)?))) {
                    for (j, to) in (0..LOCAL).filter_map(|j| Some((j, model.unknown(region, j)?))) {
                        information[(at, to)] += moment * row[i] * column[j];
                    }
                }
            }
        }
    }
}

/// Where else each point of a micro-image is seen.
struct Views<'a> {
    frame: &'a SpacingFrame,
    /// Steps to other micro-images that can share points with one, and by how much a point moves within it.
    steps: Vec<([i32; 2], [f64; 2])>,
    radius: f64,
    /// Micro-image pitch less spacing, px.
    patch: f64,
    noise: f64,
    /// Cosine and sine of the first lattice direction.
    first: [f64; 2],
}

impl<'a> Views<'a> {
    fn new(frame: &'a SpacingFrame, model: &Model, radius: f64, noise: f64) -> Self {
        let patch = frame.pitch - model.spacings[0];
        let share = patch / frame.pitch;
        let [a, b] = frame.basis;
        let reach = ((2.0 * radius / patch.abs().max(0.1)) as i32 + 1).min(40);
        let mut steps = Vec::new();
        for i in -reach..=reach {
            for j in -reach..=reach {
                let along = |axis: usize| share * (f64::from(i) * a[axis] + f64::from(j) * b[axis]);
                let moved = [along(0), along(1)];
                if moved[0].hypot(moved[1]) < 2.0 * radius {
                    steps.push(([i, j], moved));
                }
            }
        }
        let length = a[0].hypot(a[1]);
        let first = [a[0] / length, a[1] / length];
        Self { frame, steps, radius, patch, noise, first }
    }

    /// Information that a micro-image's pixels hold about the three ways of moving.
    fn moments(&self, lens: usize, tile: &Tile, shape: &Shape) -> Moments {
        let index = self.frame.micro_images[lens].index;
        let seen: Vec<[f64; 2]> = self
            .steps
            .iter()
            .filter(|([i, j], _)| self.frame.plan.lens([index[0] + i, index[1] + j]).is_some())
            .map(|&(_, moved)| moved)
            .collect();
        // Weighted sums of 1, the value, the three ways of moving, and the products of all with all.
        let mut sums = [[0.0f64; 5]; 5];
        let mut noise_share = Moments::default();
        let [cos, sin] = self.first;
        let slope_noise = if self.frame.mosaic.is_some() { MOSAIC_SLOPE_NOISE } else { SLOPE_NOISE };
        tile.disc(shape, self.radius, |at, r| {
            let Some(share) = tile.share(shape, at, r) else { return };
            let precision = share * share;
            let mean = mean_moved(&seen, r, self.radius);
            // r less its mean over the views: what is left of it is the mean movement.
            let q = [mean[0] / self.patch, mean[1] / self.patch];
            let turned = [q[0] * cos + q[1] * sin, q[1] * cos - q[0] * sin];
            let back = |v: [f64; 2]| [v[0] * cos - v[1] * sin, v[0] * sin + v[1] * cos];
            let ways = [q, back([turned[0], -turned[1]]), back([turned[1], turned[0]])];
            let slope = slope(tile, shape, at);
            let moving = ways.map(|way| slope[0] * way[0] + slope[1] * way[1]);
            let row = [1.0, f64::from(tile.values[at]), moving[0], moving[1], moving[2]];
            for (sums, a) in sums.iter_mut().zip(row) {
                for (sum, b) in sums.iter_mut().zip(row) {
                    *sum += precision * a * b;
                }
            }
            for (shares, a) in noise_share.iter_mut().zip(ways) {
                for (share, b) in shares.iter_mut().zip(ways) {
                    // The precision cancels against the noise's own growth where vignetting was divided out.
                    *share += slope_noise * self.noise * self.noise * (a[0] * b[0] + a[1] * b[1]);
                }
            }
        });
        project(&mut sums, 0);
        project(&mut sums, 1);
        let variance = self.noise * self.noise;
        std::array::from_fn(|a| std::array::from_fn(|b| (sums[a + 2][b + 2] - noise_share[a][b]) / variance))
    }
}

/// Slope of the interpolating spline at a pixel of a tile.
fn slope(tile: &Tile, shape: &Shape, at: usize) -> [f64; 2] {
    const ACROSS: [f32; 3] = [1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0];
    let c = |dy: usize, dx: usize| tile.coefficients[at + dy * shape.stride + dx - shape.stride - 1];
    let x: f32 = (0..3).map(|k| ACROSS[k] * 0.5 * (c(k, 2) - c(k, 0))).sum();
    let y: f32 = (0..3).map(|k| ACROSS[k] * 0.5 * (c(2, k) - c(0, k))).sum();
    [f64::from(x), f64::from(y)]
}

/// How far, in the mean over its views, the point seen at `r` is moved.
fn mean_moved(views: &[[f64; 2]], r: [f64; 2], radius: f64) -> [f64; 2] {
    let (mut sum, mut count) = ([0.0; 2], 0.0);
    for moved in views {
        let there = [r[0] - moved[0], r[1] - moved[1]];
        if there[0] * there[0] + there[1] * there[1] < radius * radius {
            sum = [sum[0] + moved[0], sum[1] + moved[1]];
            count += 1.0;
        }
    }
    sum.map(|s| s / f64::max(count, 1.0))
}

/// Takes out of all sums what could be told by the quantity in row `by` just as well.
fn project(sums: &mut [[f64; 5]; 5], by: usize) {
    let own = sums[by][by];
    if own <= 1e-12 {
        return;
    }
    let row = sums[by];
    for (k, sums) in sums.iter_mut().enumerate() {
        let share = row[k] / own;
        for (sum, value) in sums.iter_mut().zip(row) {
            *sum -= share * value;
        }
    }
}
