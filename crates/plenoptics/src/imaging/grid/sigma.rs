//! How uncertain a grid is.
//!
//! What the map leaves of the micro-images says how far they can be believed, but not one by one: neighbours see the same
//! edge between them and the same piece of the scene, and err together. So what is squared and added up is the error that
//! neighbourhoods of them bring into the map, over all places of a neighbourhood.

use nalgebra::{Matrix2, Vector2};

use super::fit::Fit;
use super::phases::Phases;

/// Micro-images along each side of a neighbourhood.
const REACH: usize = 2;
/// Independent micro-images that a fitted number takes away: neighbours are not.
const PER_UNKNOWN: f64 = 1.5;
/// What the centre is off by that no scatter shows, px: root mean square in frames of another renderer without noise.
const CENTRE_LEAST_PX: f64 = 0.003;

/// Standard uncertainties of a grid.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GridSigma {
    /// Of the pitch, px.
    pub pitch_px: f64,
    /// Of the rotation, radians.
    pub rotation_rad: f64,
    /// Of the centre, px: of its x and of its y alike.
    pub centre_px: f64,
}

/// A micro-image in the fit.
struct Node {
    index: [i32; 2],
    /// From the middle of all, px.
    place: [f64; 2],
    weight: f64,
    /// What is left of its place, px.
    left: [f64; 2],
}

impl Phases<'_> {
    /// Standard uncertainties of what was fitted to these phases. Those of a pitch and a rotation hold whether the model
    /// has them or not. The scatter is so much (`factor`) smaller than the errors that it comes from.
    pub(super) fn sigma(&self, fit: &Fit, factor: f64) -> GridSigma {
        let nodes = self.nodes(fit);
        let total: f64 = nodes.iter().map(|n| n.weight).sum();
        let square: f64 = nodes.iter().map(|n| n.weight * n.place[0].hypot(n.place[1]).powi(2)).sum();
        if nodes.is_empty() || total <= 0.0 || square <= 0.0 {
            return GridSigma { pitch_px: f64::INFINITY, rotation_rad: f64::INFINITY, centre_px: f64::INFINITY };
        }
        // What each brings into the shift in x and y, the scale and the rotation.
        let scores: Vec<([i32; 2], [f64; 4])> =
            nodes.iter().map(|n| (n.index, brought(n.place, n.left).map(|s| n.weight * s))).collect();
        let variances = neighbourhoods(&scores);
        // As many as are alike in weight.
        let alike = total * total / nodes.iter().map(|n| n.weight * n.weight).sum::<f64>();
        let taken = PER_UNKNOWN * fit.unknowns as f64;
        let few = alike / (alike - taken).max(0.1 * alike);
        let [x, y, scale, turn] = variances.map(|variance| variance * few * factor * factor);
        let shift = x.max(y) / (total * total);
        let (scale, turn) = (scale / (square * square), turn / (square * square));
        let middle = self.middle(fit);
        let off = [0, 1].map(|k| fit.grid.centre[k] - middle[k]);
        let lever = 0.5 * (off[0] * off[0] + off[1] * off[1]);
        GridSigma {
            pitch_px: scale.sqrt() * fit.grid.pitch_px(),
            rotation_rad: turn.sqrt(),
            centre_px: (shift + lever * (scale + turn) + CENTRE_LEAST_PX * CENTRE_LEAST_PX).sqrt(),
        }
    }

    /// Weighted middle of the micro-images, px.
    fn middle(&self, fit: &Fit) -> [f64; 2] {
        let count = self.harmonics.len();
        let mut sums = [0.0; 3];
        for (lens, left) in self.lenses.iter().zip(fit.left.chunks_exact(count)) {
            let weight: f64 = left.iter().map(|[_, w]| w).sum();
            sums = [sums[0] + weight * lens.at.x, sums[1] + weight * lens.at.y, sums[2] + weight];
        }
        [sums[0] / sums[2].max(1e-300), sums[1] / sums[2].max(1e-300)]
    }

    fn nodes(&self, fit: &Fit) -> Vec<Node> {
        let count = self.harmonics.len();
        let along = |g: &[f64; 2]| Vector2::new(g[0], g[1]);
        let normal: Matrix2<f64> = self.harmonics.iter().map(|g| along(g) * along(g).transpose()).sum();
        let Some(inverse) = normal.try_inverse() else { return Vec::new() };
        let middle = self.middle(fit);
        let node = |(lens, left): (&super::demodulate::Lens, &[[f64; 2]])| {
            let cycles: Vector2<f64> = self.harmonics.iter().zip(left).map(|(g, [left, _])| along(g) * *left).sum();
            let place = [lens.at.x, lens.at.y];
            Node {
                index: [lens.at.i, lens.at.j],
                place: [0, 1].map(|k| place[k] - middle[k]),
                weight: left.iter().map(|[_, weight]| weight).sum::<f64>() / count as f64,
                left: (inverse * cycles).into(),
            }
        };
        self.lenses.iter().zip(fit.left.chunks_exact(count)).map(node).filter(|n| n.weight > 0.0).collect()
    }
}

/// What a displacement at a place brings into the shift in x and y, the scale and the rotation.
fn brought([x, y]: [f64; 2], [dx, dy]: [f64; 2]) -> [f64; 4] {
    [dx, dy, x * dx + y * dy, x * dy - y * dx]
}

/// Squares of the sums over neighbourhoods, added up over all places of a neighbourhood, each micro-image once.
fn neighbourhoods(scores: &[([i32; 2], [f64; 4])]) -> [f64; 4] {
    let bound = |axis: usize| {
        let all = scores.iter().map(|(at, _)| at[axis]);
        all.clone().min().zip(all.max()).unwrap_or((0, 0))
    };
    let [(i0, i1), (j0, j1)] = [bound(0), bound(1)];
    let (columns, rows) = ((i1 - i0) as usize + REACH, (j1 - j0) as usize + REACH);
    let mut sums = vec![[0.0f64; 4]; columns * rows];
    for ([i, j], score) in scores {
        for place in 0..REACH * REACH {
            let (column, row) = ((i - i0) as usize + place % REACH, (j - j0) as usize + place / REACH);
            sums[row * columns + column].iter_mut().zip(score).for_each(|(sum, s)| *sum += s);
        }
    }
    let mut squares = [0.0; 4];
    for sum in &sums {
        squares.iter_mut().zip(sum).for_each(|(square, s)| *square += s * s / (REACH * REACH) as f64);
    }
    squares
}
