//! The mean profile of micro-images.

/// A periodic profile over the lattice's cell.
pub(super) struct Profile {
    pub(super) side: usize,
    pub(super) values: Vec<f64>,
}

impl Profile {
    /// Bilinear between the bins.
    pub(super) fn at(&self, u: f64, v: f64) -> f64 {
        let split = |u: f64| {
            let at = (u - u.floor()) * self.side as f64;
            let base = at as usize;
            (base % self.side, (base + 1) % self.side, at - base as f64)
        };
        let ((p0, p1, s), (q0, q1, t)) = (split(u), split(v));
        let value = |q: usize, p: usize| self.values[q * self.side + p];
        (value(q0, p0) * (1.0 - s) + value(q0, p1) * s) * (1.0 - t)
            + (value(q1, p0) * (1.0 - s) + value(q1, p1) * s) * t
    }
}

/// Means over so many bins on either side along one direction of a periodic profile: strides along that and across it.
pub(super) fn smoothed(values: &[f64], side: usize, [along, across]: [usize; 2], reach: usize) -> Vec<f64> {
    let mut means = vec![0.0; side * side];
    for row in 0..side {
        for n in 0..side {
            let about = (0..=2 * reach).map(|k| values[row * across + (n + side + k - reach) % side * along]);
            means[row * across + n * along] = about.sum::<f64>() / (2 * reach + 1) as f64;
        }
    }
    means
}
