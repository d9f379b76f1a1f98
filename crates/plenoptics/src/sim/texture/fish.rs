//! Fish-like textures: bodies with fins, scales and patches before gravel or plants.
//!
//! A fish has its own coordinates: `along` from −0.5 at the snout to 0.5 at the tail fin's end, and `across`, both in
//! lengths of the fish.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use rayon::prelude::*;

use super::noise::{natural, smoothstep};

/// Where a fish is and which way it swims.
struct Fish {
    x: f32,
    y: f32,
    cos: f32,
    sin: f32,
    /// −1 for one that swims to the right.
    way: f32,
    length: f32,
    /// Where on the noise its patches are taken from.
    patch: usize,
}

/// How a species looks.
struct Species {
    /// Fish along a side of the texture.
    shoal: usize,
    /// Length, texels.
    length: f32,
    /// Greatest half width, lengths.
    depth: f32,
    /// Where the tail fin begins, and its half width at its end, lengths.
    tail: (f32, f32),
    /// Reflectance of the body and of its patches.
    body: f32,
    patches: f32,
    /// Noise above which a patch is, in standard deviations.
    threshold: f32,
    /// Width of a scale, texels.
    scale: f32,
}

/// Small pale fish with dark patches and broad striped tails, over gravel.
pub(super) fn guppy(side: usize, seed: u64) -> Vec<f32> {
    let species = Species {
        shoal: 5,
        length: 190.0,
        depth: 0.13,
        tail: (0.16, 0.21),
        body: 0.72,
        patches: 0.12,
        threshold: 0.55,
        scale: 7.0,
    };
    paint(side, seed, &species, &gravel(side, seed))
}

/// Large dark fish with bright blotches, before plants.
pub(super) fn oscar(side: usize, seed: u64) -> Vec<f32> {
    let species = Species {
        shoal: 3,
        length: 330.0,
        depth: 0.21,
        tail: (0.32, 0.13),
        body: 0.2,
        patches: 0.82,
        threshold: 0.35,
        scale: 11.0,
    };
    paint(side, seed, &species, &plants(side, seed))
}

/// Pebbles of many tones, one in each cell of a jittered grid, with dark gaps.
fn gravel(side: usize, seed: u64) -> Vec<f32> {
    const CELL: usize = 16;
    let cells = side / CELL;
    let mut random = Pcg64::seed_from_u64(seed ^ 1);
    let pebbles: Vec<(f32, f32, f32)> = (0..cells * cells)
        .map(|_| (random.random_range(0.2..0.8), random.random_range(0.2..0.8), random.random_range(0.15..0.85)))
        .collect();
    let mut values = vec![0.0; side * side];
    values.par_chunks_mut(side).enumerate().for_each(|(y, row)| {
        for (x, value) in row.iter_mut().enumerate() {
            let (px, py) = (x as f32 / CELL as f32, y as f32 / CELL as f32);
            let (mut least, mut second, mut tone) = (f32::MAX, f32::MAX, 0.0);
            for k in 0..9 {
                let (i, j) = (px.floor() + (k % 3) as f32 - 1.0, py.floor() + (k / 3) as f32 - 1.0);
                let wrap = |t: f32| (t as i32).rem_euclid(cells as i32) as usize;
                let pebble = pebbles[wrap(j) * cells + wrap(i)];
                let distance = (i + pebble.0 - px).hypot(j + pebble.1 - py);
                if distance < least {
                    (second, least, tone) = (least, distance, pebble.2);
                } else if distance < second {
                    second = distance;
                }
            }
            *value = tone * (0.25 + 0.75 * smoothstep(0.0, 0.25, second - least));
        }
    });
    values
}

/// Upright leaves: noise stretched along the vertical.
fn plants(side: usize, seed: u64) -> Vec<f32> {
    natural(side, seed ^ 2, 10.0, 5.0).iter().map(|v| 0.42 + 0.32 * (1.2 * v).tanh()).collect()
}

fn paint(side: usize, seed: u64, species: &Species, background: &[f32]) -> Vec<f32> {
    let shoal = shoal(side, seed, species);
    let patches = natural(side, seed ^ 3, 20.0, 1.0);
    let grain = natural(side, seed ^ 4, 40.0, 1.0);
    let mut values = vec![0.0; side * side];
    values.par_chunks_mut(side).enumerate().for_each(|(y, row)| {
        for (x, value) in row.iter_mut().enumerate() {
            let here = y * side + x;
            let seen = shoal.iter().rev().find_map(|fish| {
                let (along, across) = fish.coordinates(x as f32, y as f32, side as f32);
                species.reflectance(along, across, patches[(here + fish.patch) % (side * side)], fish.length)
            });
            *value = (seen.unwrap_or(background[here]) + 0.1 * grain[here]).clamp(0.0, 1.0);
        }
    });
    values
}

fn shoal(side: usize, seed: u64, species: &Species) -> Vec<Fish> {
    let mut random = Pcg64::seed_from_u64(seed ^ 5);
    let step = side as f32 / species.shoal as f32;
    (0..species.shoal * species.shoal)
        .map(|k| {
            let (i, j) = ((k % species.shoal) as f32, (k / species.shoal) as f32);
            let angle: f32 = random.random_range(-0.5..0.5);
            Fish {
                x: (i + random.random_range(0.2..0.8)) * step,
                y: (j + random.random_range(0.2..0.8)) * step,
                cos: angle.cos(),
                sin: angle.sin(),
                way: if random.random() { 1.0 } else { -1.0 },
                length: species.length * random.random_range(0.8..1.2),
                patch: random.random_range(0..side * side),
            }
        })
        .collect()
}

impl Fish {
    /// The fish's own coordinates of a texel; the texture repeats.
    fn coordinates(&self, x: f32, y: f32, side: f32) -> (f32, f32) {
        let wrap = |t: f32| t - side * (t / side).round();
        let (dx, dy) = (wrap(x - self.x), wrap(y - self.y));
        let along = (dx * self.cos + dy * self.sin) * self.way / self.length;
        (along, (dy * self.cos - dx * self.sin) / self.length)
    }
}

impl Species {
    /// What the fish shows at its own coordinates; `None` beside it.
    fn reflectance(&self, along: f32, across: f32, noise: f32, length: f32) -> Option<f32> {
        if !(-0.5..0.5).contains(&along) {
            return None;
        }
        let (start, fan) = self.tail;
        // The body is an ellipse that ends a little behind where the tail fin begins.
        let end = start + 0.08;
        let t = (2.0 * along + 0.5 - end) / (end + 0.5);
        let body = self.depth * (1.0 - t * t).max(0.0).sqrt();
        if across.abs() < body {
            if (along + 0.4).hypot(across + 0.2 * self.depth) < 0.022 {
                return Some(0.02);
            }
            let patch = smoothstep(self.threshold - 0.15, self.threshold + 0.15, noise);
            let tone = self.body + (self.patches - self.body) * patch;
            // Scales: two families of slanting lines.
            let (u, v) = ((along + across) * length / self.scale, (along - across) * length / self.scale);
            let edge = ((u.fract().abs() - 0.5).abs() * 2.0).max((v.fract().abs() - 0.5).abs() * 2.0);
            return Some(tone * (1.0 - 0.55 * smoothstep(0.75, 0.95, edge)));
        }
        if along > start {
            let width = fan * (0.35 + 0.65 * (along - start) / (0.5 - start));
            if across.abs() < width {
                // Rays of the fin.
                let ray = 0.5 + 0.5 * (across / width * 22.0).sin();
                return Some(self.patches + (self.body - self.patches) * (0.15 + 0.85 * ray));
            }
        }
        // Fins above and below, thin and striped.
        let fin = body + 0.07 * (1.0 - ((along - 0.02) / 0.2).powi(2)).max(0.0);
        (across.abs() < fin).then(|| 0.45 + 0.3 * ((along - 0.4 * across.abs()) * length / 2.2).sin())
    }
}
