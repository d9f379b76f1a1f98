//! The unknowns: a spacing for each region, and the terms by which it departs from that over the field and between
//! lattice directions.

use nalgebra::{DMatrix, DVector, SVector};

use crate::imaging::grid::Grid;

/// Numbers that belong to one region: to its spacing, then to each of the terms.
pub(in crate::imaging) const LOCAL: usize = 1 + TERMS;
pub(in crate::imaging) type Local = SVector<f64, LOCAL>;
/// Tilt along x and y, curvature, astigmatism, row less column, diagonals' difference; then what a wide field demands.
pub(in crate::imaging) const TERMS: usize = 9;
/// Terms that every field has.
pub(in crate::imaging) const USUAL_TERMS: usize = 6;
/// The numbers of a region's spacing and the usual terms, each with each.
pub(in crate::imaging) type UsualMatrix = [[f64; 1 + USUAL_TERMS]; 1 + USUAL_TERMS];
/// Terms of wide fields, in the order in which they are asked for: with r⁴ and the astigmatism's with r⁴, then with r⁶.
pub(in crate::imaging) const WIDE_TERMS: [&[usize]; 2] = [&[6, 7], &[8]];
/// Tilt along x and y, and curvature, come first.
pub(in crate::imaging) const FIELD_TERMS: usize = 3;
/// Field blocks along each side of a frame, for the scatter between parts of the field.
pub(in crate::imaging) const BLOCKS: usize = 6;
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
    pub(in crate::imaging) fn off_axis(&self, [x, y]: [f64; 2]) -> [f64; 2] {
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
    pub(in crate::imaging) at: [f64; 2],
    /// Cosine and sine of twice the angle from the lattice's first direction to the pair's.
    pub(in crate::imaging) turn: [f64; 2],
    /// X² − Y² and 2 X Y of the midpoint's field coordinates along and across the lattice's first direction.
    pub(in crate::imaging) off_axis: [f64; 2],
}

impl Place {
    /// The field block that it lies in.
    pub(in crate::imaging) fn block(&self) -> usize {
        let place = |v: f64| (((v + 1.0) / 2.0 * BLOCKS as f64).max(0.0) as usize).min(BLOCKS - 1);
        place(self.at[1]) * BLOCKS + place(self.at[0])
    }

    /// What the terms do to the spacing along the pair and across it.
    #[inline]
    pub(in crate::imaging) fn terms(&self) -> [[f64; TERMS]; 2] {
        let ([x, y], [cos, sin], [even, mixed]) = (self.at, self.turn, self.off_axis);
        let square = x * x + y * y;
        // Differences of two perpendicular directions: each departs from the mean by half of it.
        let [along, across] = [0.5 * (even * cos + mixed * sin), 0.5 * (mixed * cos - even * sin)];
        let fourth = square * square;
        [
            [x, y, square, along, 0.5 * cos, 0.5 * sin, fourth, square * along, square * fourth],
            [0.0, 0.0, 0.0, across, -0.5 * sin, 0.5 * cos, 0.0, square * across, 0.0],
        ]
    }
}

/// Unknowns: a spacing for each region, then those of the terms that are free.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::imaging) struct Model {
    /// How strongly the terms act in each region; as many as there are regions.
    pub(in crate::imaging) scales: Vec<f64>,
    /// Spacing on the axis in each region, px: the mean over directions.
    pub(in crate::imaging) spacings: Vec<f64>,
    /// Tilt x, tilt y, curvature (px per half frame width, squared for the last); the curvature along the radius less that
    /// across it; then, px, the spacing along the first lattice direction less that across it, and the same for directions
    /// 45° further.
    /// Last what is in proportion to r⁴, to r² times the astigmatism's, and to r⁶.
    pub(in crate::imaging) terms: [f64; TERMS],
    /// Which terms are unknowns, rising.
    pub(in crate::imaging) free: Vec<usize>,
}

impl Model {
    /// One spacing everywhere.
    pub(in crate::imaging) fn flat(spacings: Vec<f64>) -> Self {
        Self { scales: vec![1.0; spacings.len()], spacings, terms: [0.0; TERMS], free: Vec::new() }
    }

    /// With tilt x, tilt y and curvature as they are known to be.
    pub(in crate::imaging) fn with_field(mut self, field: [f64; FIELD_TERMS]) -> Self {
        self.terms[..FIELD_TERMS].copy_from_slice(&field);
        self
    }

    pub(in crate::imaging) fn unknowns(&self) -> usize {
        self.spacings.len() + self.free.len()
    }

    /// The spacing of a region at a place: along the pair, and across it (px, 90° from +x towards +y).
    #[inline(always)]
    pub(in crate::imaging) fn spacing(&self, region: usize, place: &Place) -> [f64; 2] {
        let [along, across] = place.terms();
        let scale = self.scales[region];
        let (mut sums, axis) = ([0.0; 2], self.spacings[region]);
        for k in 0..TERMS {
            sums[0] += self.terms[k] * along[k];
            sums[1] += self.terms[k] * across[k];
        }
        [axis + scale * sums[0], scale * sums[1]]
    }

    /// Derivatives of those two with respect to the region's spacing and to all terms, free or not.
    #[inline(always)]
    pub(in crate::imaging) fn derivatives(&self, region: usize, place: &Place) -> [Local; 2] {
        let scale = self.scales[region];
        let [along, across] = place.terms();
        let with = |first: f64, terms: [f64; TERMS]| {
            let mut local = Local::zeros();
            local[0] = first;
            for k in 0..TERMS {
                local[k + 1] = scale * terms[k];
            }
            local
        };
        [with(1.0, along), with(0.0, across)]
    }

    /// Of a region's spacing and all terms: which of the unknowns each is, where it is one.
    pub(in crate::imaging) fn unknown(&self, region: usize, local: usize) -> Option<usize> {
        match local.checked_sub(1) {
            None => Some(region),
            Some(term) => self.free.binary_search(&term).ok().map(|k| self.spacings.len() + k),
        }
    }

    /// What of a vector over the unknowns belongs to a region's spacing and to the terms.
    pub(in crate::imaging) fn local(&self, unknowns: &DVector<f64>, region: usize) -> Local {
        Local::from_fn(|k, _| self.unknown(region, k).map_or(0.0, |unknown| unknowns[unknown]))
    }

    /// Of a covariance of the unknowns that of the first region's spacing and the usual terms; zero for terms held.
    pub(in crate::imaging) fn usual(&self, covariance: &DMatrix<f64>) -> UsualMatrix {
        let of = |row: usize, column: usize| Some(covariance[(self.unknown(0, row)?, self.unknown(0, column)?)]);
        std::array::from_fn(|row| std::array::from_fn(|column| of(row, column).unwrap_or_default()))
    }

    /// Information (1/px²) that comes from what arrays are like: rows and columns of no real one differ by more.
    pub(in crate::imaging) fn prior(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let n = self.spacings.len();
        let asymmetric = self.free.iter().enumerate().filter(|&(_, &term)| (FIELD_TERMS..USUAL_TERMS).contains(&term));
        asymmetric.map(move |(k, _)| (n + k, ASYMMETRY_PX.powi(-2)))
    }

    /// The value of an unknown.
    pub(in crate::imaging) fn value(&self, unknown: usize) -> f64 {
        let n = self.spacings.len();
        if unknown < n { self.spacings[unknown] } else { self.terms[self.free[unknown - n]] }
    }

    pub(in crate::imaging) fn advance(&mut self, step: &DVector<f64>) {
        let n = self.spacings.len();
        for (spacing, change) in self.spacings.iter_mut().zip(step.iter()) {
            *spacing += change;
        }
        for (&term, change) in self.free.iter().zip(step.iter().skip(n)) {
            self.terms[term] += change;
        }
    }
}
