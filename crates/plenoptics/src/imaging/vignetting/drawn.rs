//! A profile drawn so finely that straight lines between its points do, for where every pixel of a frame asks.

use super::place::Place;
use super::{Stencil, TERMS, Vignetting, added, stencil};

/// Points per bin along each lattice vector. Of a micro-image's edge, which falls over three pixels or more, straight
/// lines between points an eighth of a pixel apart miss less than a thousandth.
const FINER: usize = 4;

/// The first `N` terms of a profile at points all over the cell, its far sides included.
pub(super) struct Drawn<const N: usize> {
    /// Steps along each lattice vector.
    side: usize,
    points: Vec<[f32; N]>,
}

impl<const N: usize> Drawn<N> {
    pub(super) fn new(profile: &Vignetting) -> Self {
        const { assert!(N <= TERMS, "a profile has no more terms") };
        let bins = profile.side;
        let side = FINER * bins;
        let stencils: Vec<Stencil> =
            (0..=side).map(|k| stencil((k / FINER % bins, (k % FINER) as f64 / FINER as f64), bins)).collect();
        let weighed = |values: [&[f32]; 4], weights: [f32; 4]| -> [f32; N] {
            std::array::from_fn(|k| values.iter().zip(weights).map(|(value, weight)| weight * value[k]).sum())
        };
        // Between the columns of bins first, then between their rows.
        let lines: Vec<Vec<[f32; N]>> = (0..bins)
            .map(|row| {
                let row = &profile.terms[row * bins..][..bins];
                stencils.iter().map(|(at, weights)| weighed(at.map(|bin| &row[bin][..]), *weights)).collect()
            })
            .collect();
        let points = stencils.iter().flat_map(|(at, weights)| {
            let lines = at.map(|bin| &lines[bin]);
            (0..=side).map(move |p| weighed(lines.map(|line| &line[p][..]), *weights))
        });
        Self { side, points: points.collect() }
    }

    /// Relative transmission at a place, which lies at (x, y) in the frame.
    #[inline]
    pub(super) fn transmission(&self, place: &Place, at: [f64; 2]) -> f32 {
        added(&self.at(place), at)
    }

    #[inline]
    fn at(&self, place: &Place) -> [f32; N] {
        let [(p, s), (q, t)] = place.bins(self.side).map(|(point, beyond)| (point, beyond as f32));
        let above = &self.points[q * (self.side + 1) + p..][..2];
        let below = &self.points[(q + 1) * (self.side + 1) + p..][..2];
        std::array::from_fn(|k| {
            let between = |line: &[[f32; N]]| line[0][k] + s * (line[1][k] - line[0][k]);
            let (above, below) = (between(above), between(below));
            above + t * (below - above)
        })
    }
}
