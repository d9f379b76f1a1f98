//! The unknowns: a spacing for each region, and the terms by which it departs from that over the field and between
//! lattice directions.

use nalgebra::DVector;

use super::frame::{MASK_FRACTION, SpacingFrame};
use crate::imaging::grid::Grid;

/// Tilt along x and y, curvature, astigmatism, row less column, diagonals' difference.
pub(in crate::imaging) const TERMS: usize = 6;
/// Tilt along x and y, and curvature, come first.
pub(in crate::imaging) const FIELD_TERMS: usize = 3;
/// How much rows and columns of an array differ, px: where texture tells nothing about it, no more than this is
/// believed.
pub(in crate::imaging) const ASYMMETRY_PX: f64 = 0.5;
/// Standard deviation of a grey level's rounding: no frame has less noise.
pub(in crate::imaging) const QUANTISATION: f64 = 0.288_675;

/// How the array lies in the frame: what of a place the terms depend on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::imaging) struct Directions {
    /// Cosine and sine of twice the angle from +x to the first lattice direction.
    first: [f64; 2],
    /// The same from the first lattice direction to each.
    turns: [[f64; 2]; 3],
}

impl Directions {
    pub(in crate::imaging) fn new(grid: &Grid) -> Self {
        let [a, b] = grid.basis;
        let mut turns = [[1.0, 0.0]; 3];
        for (turn, [i, j]) in turns.iter_mut().zip(grid.neighbour_steps()) {
            let (i, j) = (f64::from(*i), f64::from(*j));
            let step = [i * a[0] + j * b[0], i * a[1] + j * b[1]];
            let angle = (a[0] * step[1] - a[1] * step[0]).atan2(a[0] * step[0] + a[1] * step[1]);
            *turn = [(2.0 * angle).cos(), (2.0 * angle).sin()];
        }
        let [x, y] = a;
        let square = x * x + y * y;
        Self { first: [(x * x - y * y) / square, 2.0 * x * y / square], turns }
    }

    /// X² − Y² and 2 X Y of field coordinates along and across the lattice's first direction.
    #[inline]
    pub(super) fn off_axis(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [cos, sin] = self.first;
        let (even, mixed) = (x * x - y * y, 2.0 * x * y);
        [even * cos + mixed * sin, mixed * cos - even * sin]
    }

    /// Where a pair along one of the lattice's directions measures.
    #[inline]
    pub(in crate::imaging) fn place(&self, at: [f64; 2], direction: usize) -> Place {
        Place { at, turn: self.turns[direction], off_axis: self.off_axis(at) }
    }
}

/// Where and along which direction a pair measures the spacing.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(in crate::imaging) struct Place {
    /// The pair's midpoint in field coordinates.
    pub(super) at: [f64; 2],
    /// Cosine and sine of twice the angle from the lattice's first direction to the pair's.
    pub(super) turn: [f64; 2],
    /// X² − Y² and 2 X Y of the midpoint's field coordinates along and across the lattice's first direction.
    pub(super) off_axis: [f64; 2],
}

impl Place {
    /// What the terms do to the spacing along the pair and across it.
    #[inline]
    pub(in crate::imaging) fn terms(&self) -> [[f64; TERMS]; 2] {
        let ([x, y], [cos, sin], [even, mixed]) = (self.at, self.turn, self.off_axis);
        // Differences of two perpendicular directions: each departs from the mean by half of it.
        [
            [x, y, x * x + y * y, 0.5 * (even * cos + mixed * sin), 0.5 * cos, 0.5 * sin],
            [0.0, 0.0, 0.0, 0.5 * (mixed * cos - even * sin), -0.5 * sin, 0.5 * cos],
        ]
    }
}

/// Unknowns: a spacing for each region, then those of the terms that are free.
#[derive(Debug, Clone)]
pub(super) struct Model {
    /// How strongly the terms act in each region; as many as there are regions.
    pub(super) scales: Vec<f64>,
    /// Spacing on the axis in each region, px: the mean over directions.
    pub(super) spacings: Vec<f64>,
    /// Tilt x, tilt y, curvature (px per half frame width, squared for the last); the curvature along the radius less that
    /// across it; then, px, the spacing along the first lattice direction less that across it, and the same for directions
    /// 45° further.
    pub(super) terms: [f64; TERMS],
    /// Which terms are unknowns, rising.
    pub(super) free: Vec<usize>,
    /// Radius of the masks, in units of half the micro-image pitch.
    pub(super) mask: f64,
    /// Noise in units of the frames' own estimates, which sharp texture makes too large.
    pub(super) noise_scale: f64,
}

impl Model {
    /// One spacing everywhere, and masks of full size.
    pub(super) fn flat(spacings: Vec<f64>) -> Self {
        let scales = vec![1.0; spacings.len()];
        Self { scales, spacings, terms: [0.0; TERMS], free: Vec::new(), mask: MASK_FRACTION, noise_scale: 1.0 }
    }

    /// Makes the terms unknown; the field terms only where they are not held.
    pub(super) fn free_terms(&mut self, field_held: bool) {
        self.free = (if field_held { FIELD_TERMS } else { 0 }..TERMS).collect();
    }

    /// Radius of the masks in a frame, px.
    pub(super) fn radius(&self, frame: &SpacingFrame) -> f64 {
        self.mask * frame.pitch / 2.0
    }

    pub(super) fn noise(&self, frame: &SpacingFrame) -> f64 {
        (frame.noise * self.noise_scale).max(QUANTISATION)
    }

    pub(super) fn unknowns(&self) -> usize {
        self.spacings.len() + self.free.len()
    }

    /// The spacing of a region at a place: along the pair, and across it (px, 90° from +x towards +y).
    pub(super) fn spacing(&self, region: usize, place: &Place) -> [f64; 2] {
        let departure = place.terms().map(|terms| {
            self.scales[region] * self.terms.iter().zip(terms).map(|(term, value)| term * value).sum::<f64>()
        });
        [self.spacings[region] + departure[0], departure[1]]
    }

    /// Derivatives of those two with respect to the unknowns.
    pub(super) fn derivatives(&self, region: usize, place: &Place, [along, across]: &mut [Vec<f64>; 2]) {
        let n = self.spacings.len();
        let terms = place.terms();
        for (row, terms) in [(&mut *along, terms[0]), (across, terms[1])] {
            row.clear();
            row.resize(n, 0.0);
            row.extend(self.free.iter().map(|&term| self.scales[region] * terms[term]));
        }
        along[region] = 1.0;
    }

    /// Information (1/px²) that comes from what arrays are like: rows and columns of no real one differ by more.
    pub(super) fn prior(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let n = self.spacings.len();
        let asymmetric = self.free.iter().enumerate().filter(|&(_, &term)| term >= FIELD_TERMS);
        asymmetric.map(move |(k, _)| (n + k, ASYMMETRY_PX.powi(-2)))
    }

    /// The value of an unknown.
    pub(super) fn value(&self, unknown: usize) -> f64 {
        let n = self.spacings.len();
        if unknown < n { self.spacings[unknown] } else { self.terms[self.free[unknown - n]] }
    }

    pub(super) fn advance(&mut self, step: &DVector<f64>) {
        let n = self.spacings.len();
        for (spacing, change) in self.spacings.iter_mut().zip(step.iter()) {
            *spacing += change;
        }
        for (&term, change) in self.free.iter().zip(step.iter().skip(n)) {
            self.terms[term] += change;
        }
    }
}
