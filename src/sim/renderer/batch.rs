//! Many rays at once: arrays that the compiler turns into vector instructions.

use std::ops::Range;

use super::bubbles::Bubbles;
use super::rays::{Path, Plane, Ray};
use super::sampling::Pattern;
use super::unit::UnevenRow;
use crate::sim::texture::Level;

/// Rays in a batch: few enough that all arrays stay in the first-level cache.
const SIZE: usize = 256;

type Lane = [f32; SIZE];

/// One board as a batch sees it.
pub(super) struct Layer<'a> {
    pub(super) plane: Plane<f32>,
    pub(super) range: [f32; 2],
    pub(super) origin: [f32; 2],
    pub(super) level: &'a Level,
    /// What of it is there; all where `None`.
    pub(super) outline: Option<&'a Level>,
}

/// Rays on their way, and whose they are.
pub(super) struct Batch {
    pixel: f32,
    radius: f32,
    count: usize,
    /// Pixel and first ray of each run of rays; a run ends where the next begins.
    owners: [(u32, u32); SIZE],
    runs: usize,
    p: [Lane; 2],
    u: [Lane; 2],
    c: [Lane; 2],
    from: [Lane; 3],
    along: [Lane; 3],
    open: Lane,
    board: [Lane; 2],
    value: Lane,
    /// What dust and microlenses leave of each ray; kept only by cameras that have such.
    weight: Lane,
}

impl Batch {
    #[inline(always)]
    pub(super) fn new(pixel: f32, radius: f32) -> Self {
        const ZERO: Lane = [0.0; SIZE];
        Self {
            pixel,
            radius,
            count: 0,
            owners: [(0, 0); SIZE],
            runs: 0,
            p: [ZERO; 2],
            u: [ZERO; 2],
            c: [ZERO; 2],
            from: [ZERO; 3],
            along: [ZERO; 3],
            open: ZERO,
            board: [ZERO; 2],
            value: ZERO,
            weight: ZERO,
        }
    }

    #[inline(always)]
    pub(super) fn is_full(&self) -> bool {
        self.count == SIZE
    }

    /// How many rays there are.
    #[inline(always)]
    pub(super) fn len(&self) -> usize {
        self.count
    }

    #[inline(always)]
    fn open_run(&mut self, x: usize, rays: &Range<usize>) -> usize {
        self.owners[self.runs] = (x as u32, self.count as u32);
        self.runs += 1;
        rays.len().min(SIZE - self.count)
    }

    /// Adds rays of pixel `x`, whose centre is at `p`, through the microlens at `centre`; says how many fitted.
    #[inline(always)]
    pub(super) fn add(
        &mut self,
        x: usize,
        p: [f64; 2],
        centre: [f64; 2],
        pattern: &Pattern,
        rays: Range<usize>,
    ) -> usize {
        let fit = self.open_run(x, &rays);
        let to = self.count..self.count + fit;
        let of = rays.start..rays.start + fit;
        for k in 0..2 {
            let base = (p[k] - centre[k]) as f32;
            let c = centre[k] as f32;
            let (pixel, radius) = (self.pixel, self.radius);
            fill(&mut self.p[k][to.clone()], &pattern.pixel[k][of.clone()], |jitter| base + jitter * pixel);
            fill(&mut self.u[k][to.clone()], &pattern.lens[k][of.clone()], |lens| lens * radius);
            fill(&mut self.c[k][to.clone()], &pattern.lens[k][of.clone()], |_| c);
        }
        self.count += fit;
        fit
    }

    /// As [`Self::add`], with place from the centre and centre for each ray by itself.
    #[inline(always)]
    pub(super) fn add_each(
        &mut self,
        x: usize,
        pattern: &Pattern,
        rays: Range<usize>,
        place: impl Fn([f64; 2]) -> ([f64; 2], [f64; 2]),
    ) -> usize {
        let fit = self.open_run(x, &rays);
        for ray in rays.start..rays.start + fit {
            let (p, c) = place([f64::from(pattern.pixel[0][ray]), f64::from(pattern.pixel[1][ray])]);
            for k in 0..2 {
                self.p[k][self.count] = p[k] as f32;
                self.u[k][self.count] = pattern.lens[k][ray] * self.radius;
                self.c[k][self.count] = c[k] as f32;
            }
            self.count += 1;
        }
        fit
    }

    /// Passes the rays from the lane `from` on through dust and the microlenses as they are.
    #[inline(never)]
    pub(super) fn dim(&mut self, from: usize, row: &mut UnevenRow<'_>) {
        for i in from..self.count {
            let passed = row.pass(at(&self.p, i), at(&self.u, i), at(&self.c, i));
            self.weight[i] = passed.weight;
            self.p[0][i] = passed.p[0];
            self.p[1][i] = passed.p[1];
        }
    }

    /// Takes from every ray's value what [`Self::dim`] found.
    #[inline(never)]
    pub(super) fn apply_weights(&mut self) {
        for (value, weight) in self.value.iter_mut().zip(&self.weight).take(self.count) {
            *value *= weight;
        }
    }

    /// Finds what every ray sees.
    #[inline(always)]
    pub(super) fn trace(&mut self, path: &Path<f32>, diffuse: bool, layers: &[Layer<'_>], bubbles: Option<&Bubbles>) {
        // Whole vectors: the lanes past the end hold old rays, whose values nobody collects.
        let n = self.count.next_multiple_of(16).min(SIZE);
        if path.aberrated {
            self.leave::<true>(n, path, diffuse);
        } else {
            self.leave::<false>(n, path, diffuse);
        }
        if diffuse {
            return;
        }
        if let Some(spheres) = &path.spheres {
            for i in 0..n {
                let ray = spheres.refract(self.ray(i));
                self.keep(i, &ray);
            }
        }
        self.value[..n].fill(0.0);
        if let Some(bubbles) = bubbles {
            self.pass_bubbles(bubbles);
        }
        for layer in layers {
            self.look(n, layer);
        }
    }

    /// Lets the rays pass the bubbles, and keeps the light they meet there.
    #[inline(never)]
    fn pass_bubbles(&mut self, bubbles: &Bubbles) {
        for i in 0..self.count {
            let (ray, light) = bubbles.pass(self.ray(i));
            self.keep(i, &ray);
            self.value[i] = light;
        }
    }

    /// Lets the rays leave the main lens; before a diffuser that is all they do.
    #[inline(always)]
    fn leave<const ABERRATED: bool>(&mut self, n: usize, path: &Path<f32>, diffuse: bool) {
        if diffuse {
            for i in 0..n {
                let open = path.through::<ABERRATED>(at(&self.p, i), at(&self.u, i), at(&self.c, i)).open;
                self.value[i] = if open { 1.0 } else { 0.0 };
            }
            return;
        }
        for i in 0..n {
            let ray = path.through::<ABERRATED>(at(&self.p, i), at(&self.u, i), at(&self.c, i));
            self.keep(i, &ray);
        }
    }

    /// Lets the rays still open look at a board, and closes those that meet it.
    #[inline(always)]
    fn look(&mut self, n: usize, layer: &Layer<'_>) {
        if none(&self.open[..n]) {
            return;
        }
        for i in 0..n {
            let board = layer.plane.meet(&self.ray(i));
            self.board[0][i] = board[0];
            self.board[1][i] = board[1];
        }
        // How much of each ray ends here. Most batches meet one strip of several only: the others need no texture.
        let mut share = [0.0f32; SIZE];
        for (i, share) in share.iter_mut().enumerate().take(n) {
            let inside = (self.board[0][i] >= layer.range[0]) & (self.board[0][i] <= layer.range[1]);
            *share = if inside { self.open[i] } else { 0.0 };
        }
        if none(&share[..n]) {
            return;
        }
        let mut seen = [0.0f32; SIZE];
        let (board_x, board_y) = (&self.board[0], &self.board[1]);
        let mut shifted = [[0.0f32; SIZE]; 2];
        for i in 0..n {
            shifted[0][i] = board_x[i] + layer.origin[0];
            shifted[1][i] = board_y[i] + layer.origin[1];
        }
        if let Some(outline) = layer.outline {
            outline.sample(&shifted[0][..n], &shifted[1][..n], &mut seen[..n]);
            for (share, there) in share.iter_mut().zip(&seen).take(n) {
                *share *= there;
            }
        }
        layer.level.sample(&shifted[0][..n], &shifted[1][..n], &mut seen[..n]);
        for i in 0..n {
            self.value[i] += share[i] * seen[i];
            self.open[i] -= share[i];
        }
    }

    /// Adds up the pixels' rays and empties the batch.
    #[inline(always)]
    pub(super) fn collect(&mut self, row: &mut [f32], weight: f32) {
        for run in 0..self.runs {
            let (x, start) = self.owners[run];
            let end = if run + 1 < self.runs { self.owners[run + 1].1 as usize } else { self.count };
            row[x as usize] += sum(&self.value[start as usize..end]) * weight;
        }
        self.count = 0;
        self.runs = 0;
    }

    #[inline(always)]
    fn keep(&mut self, i: usize, ray: &Ray<f32>) {
        for k in 0..3 {
            self.from[k][i] = ray.from[k];
            self.along[k][i] = ray.along[k];
        }
        self.open[i] = if ray.open { 1.0 } else { 0.0 };
    }

    #[inline(always)]
    fn ray(&self, i: usize) -> Ray<f32> {
        Ray {
            from: [self.from[0][i], self.from[1][i], self.from[2][i]],
            along: [self.along[0][i], self.along[1][i], self.along[2][i]],
            open: self.open[i] > 0.0,
        }
    }
}

#[inline(always)]
fn at(lanes: &[Lane; 2], i: usize) -> [f32; 2] {
    [lanes[0][i], lanes[1][i]]
}

/// Each value from one of the pattern's.
#[inline(always)]
fn fill(to: &mut [f32], pattern: &[f32], value: impl Fn(f32) -> f32) {
    // A preview's four rays are one vector, without the preamble of a loop.
    if let (Ok(to), Ok(pattern)) = (<&mut [f32; 4]>::try_from(&mut *to), <&[f32; 4]>::try_from(pattern)) {
        *to = pattern.map(value);
        return;
    }
    for (to, pattern) in to.iter_mut().zip(pattern) {
        *to = value(*pattern);
    }
}

/// Whether all values, none of which is negative, are zero; a multiple of sixteen of them.
#[inline(always)]
fn none(values: &[f32]) -> bool {
    let mut lanes = [0.0f32; 16];
    for values in values.as_chunks::<16>().0 {
        for (lane, value) in lanes.iter_mut().zip(values) {
            *lane += value;
        }
    }
    lanes == [0.0; 16]
}

/// The sum in eight lanes, which a processor can add at once.
#[inline(always)]
fn sum(values: &[f32]) -> f32 {
    if let [a, b, c, d] = values {
        return a + b + c + d;
    }
    let mut lanes = [0.0f32; 8];
    let chunks = values.chunks_exact(8);
    let rest: f32 = chunks.remainder().iter().sum();
    for chunk in chunks {
        for (lane, value) in lanes.iter_mut().zip(chunk) {
            *lane += value;
        }
    }
    lanes.iter().sum::<f32>() + rest
}
