//! Whether a lattice's nodes are the micro-images, all of them and nothing else.
//!
//! What repeats with an array repeats with every coarser lattice that it contains, and its harmonics repeat with finer
//! ones: a spectrum shows all of them. Only one has a micro-image at every node and a gap between every two.

use super::frame::{Frame, Window};
use super::{Grid, MicroImage};
use crate::optics::ArrayKind;

/// Nodes that are looked at.
const NODES: usize = 4000;
/// Part of the pitch over which a level is the mean, about its place.
const DISC_RADIUS: f64 = 0.06;
/// Rows of nodes that are looked at together.
const BAND: i32 = 12;
/// Fewest neighbours of a kind that say anything.
const EDGES_LEAST: f64 = 6.0;
/// Standard errors by which a kind of neighbours has to fall short of what a lattice's have between them, where there are
/// many; and from how many on those are told well enough from the kind itself.
const SIGNIFICANCE: f64 = 3.5;
const MANY: f64 = 8.0;
/// Part of the deepest kind's valleys that those of every kind of neighbours must have: within a micro-image they are
/// hills.
const VALLEY_LEAST: f64 = 0.2;
/// First vectors of the lattices that one can be a harmonic of, in its own basis; the second is turned by the array's
/// symmetry.
const COARSER: [[i32; 2]; 11] =
    [[1, 1], [2, 0], [2, 1], [1, 2], [2, 2], [3, 0], [3, 1], [1, 3], [4, 0], [5, 0], [6, 0]];

/// Mean logarithms of a frame about places of it.
struct Levels<'a> {
    frame: &'a Frame<'a>,
    window: Window,
    reach: f64,
    values: Vec<f32>,
}

impl<'a> Levels<'a> {
    fn new(frame: &'a Frame<'a>, pitch: f64) -> Self {
        let reach = (DISC_RADIUS * pitch).max(0.5);
        let most = reach as isize;
        let within = |&(dx, dy): &(isize, isize)| (dx * dx + dy * dy) as f64 <= reach * reach;
        let points: Vec<(isize, isize)> =
            (-most..=most).flat_map(|dy| (-most..=most).map(move |dx| (dx, dy))).filter(within).collect();
        let values = vec![0.0; points.len()];
        Self { frame, window: Window::new(&points, 1, frame.width), reach, values }
    }

    fn at(&mut self, [x, y]: [f64; 2]) -> Option<f64> {
        let (x, y) = (x.round(), y.round());
        let (right, bottom) = (self.frame.width as f64 - 1.0, self.frame.height as f64 - 1.0);
        if x < self.reach || y < self.reach || x + self.reach > right || y + self.reach > bottom {
            return None;
        }
        let middle = y as isize * self.frame.width as isize + x as isize;
        self.frame.logarithms(middle, &self.window, &mut self.values);
        Some(self.values.iter().map(|&v| f64::from(v)).sum::<f64>() / self.values.len() as f64)
    }
}

/// How deep the frame's valleys are between every two neighbouring nodes: mean logarithm of the two less that of the middle
/// between them.
struct Valleys {
    /// First node, which of the steps to its neighbours, and depth.
    edges: Vec<([i32; 2], usize, f64)>,
    array: ArrayKind,
    steps: usize,
}

impl Valleys {
    fn new(frame: &Frame, grid: &Grid) -> Self {
        let mut levels = Levels::new(frame, grid.pitch_px());
        let nodes: Vec<MicroImage> = grid.micro_images_within(0.0).collect();
        let parts = nodes.len().div_ceil(NODES).max(1) as i32;
        let steps = grid.neighbour_steps();
        let mut edges = Vec::new();
        // Bands of rows: every so many single ones would be in step with a coarser lattice.
        for m in nodes.iter().filter(|m| m.j.div_euclid(BAND).rem_euclid(parts) == 0) {
            let Some(own) = levels.at([m.x, m.y]) else { continue };
            for (k, step) in steps.iter().enumerate() {
                let other = grid.position(m.i + step[0], m.j + step[1]);
                let between = [f64::midpoint(m.x, other[0]), f64::midpoint(m.y, other[1])];
                if let (Some(other), Some(between)) = (levels.at(other), levels.at(between)) {
                    edges.push(([m.i, m.j], k, f64::midpoint(own, other) - between));
                }
            }
        }
        Self { edges, array: grid.array, steps: steps.len() }
    }

    /// Whether the kinds of neighbours that a coarser lattice tells apart all have a valley between them, as far as chance
    /// allows.
    fn between_every_kind(&self, first: [i32; 2]) -> bool {
        let [[a, b], [c, d]] = basis(self.array, first);
        let index = a * d - b * c;
        let mut kinds = vec![[0.0; 3]; (index * index) as usize * self.steps];
        for &([i, j], step, depth) in &self.edges {
            let kind = (d * i - c * j).rem_euclid(index) * index + (a * j - b * i).rem_euclid(index);
            let sums = &mut kinds[kind as usize * self.steps + step];
            *sums = [sums[0] + 1.0, sums[1] + depth, sums[2] + depth * depth];
        }
        let (mut least, mut greatest) = (f64::INFINITY, 0.0f64);
        for [count, sum, squares] in kinds.into_iter().filter(|k| k[0] >= EDGES_LEAST) {
            let mean = sum / count;
            let sigma = ((squares / count - mean * mean).max(0.0) / (count - 1.0)).sqrt();
            least = least.min(mean + SIGNIFICANCE * (1.0 + MANY / count) * sigma);
            greatest = greatest.max(mean);
        }
        least > VALLEY_LEAST * greatest
    }
}

/// A coarser lattice's vectors in the basis of a lattice, from the first of them.
fn basis(array: ArrayKind, [p, q]: [i32; 2]) -> [[i32; 2]; 2] {
    match array {
        ArrayKind::Square => [[p, q], [-q, p]],
        ArrayKind::Hexagonal => [[p, q], [-q, p + q]],
    }
}

/// Bases (px) of the lattices that this one can be a harmonic of, the finest first: those whose cells show neighbours of it
/// without a gap between them. A harmonic of an array has nodes within its micro-images, and none between those.
pub(super) fn suspects(frame: &Frame, grid: &Grid) -> Vec<[[f64; 2]; 2]> {
    let valleys = Valleys::new(frame, grid);
    let mut found: Vec<_> = COARSER
        .iter()
        .filter(|&&first| !valleys.between_every_kind(first))
        .map(|&first| basis(grid.array, first))
        .collect();
    found.sort_by_key(|[[a, b], [c, d]]| a * d - b * c);
    let [a, b] = grid.basis;
    let px = |[m, n]: [i32; 2]| [0, 1].map(|k| f64::from(m) * a[k] + f64::from(n) * b[k]);
    found.into_iter().map(|vectors| vectors.map(px)).collect()
}
