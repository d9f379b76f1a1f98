//! The pixels of a frame by the cells of its lattice.

use crate::imaging::grid::Grid;

/// Lattice indices are taken exactly at every so many pixels of a row and linearly between: the departure of an array
/// from its lattice is smooth.
const KNOT_STEP: usize = 16;

/// A place by the lattice.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Lattice indices of the corner of the cell that it lies in: a micro-image's.
    pub(super) cell: [i32; 2],
    /// How far beyond that corner it lies, in lattice vectors: 0 to 1.
    pub(super) beyond: [f64; 2],
}

impl Place {
    #[inline]
    pub(super) fn new([u, v]: [f64; 2]) -> Self {
        let cell = [floor(u), floor(v)];
        Self { cell, beyond: [u - f64::from(cell[0]), v - f64::from(cell[1])] }
    }

    /// Lattice indices of the micro-image that it belongs to.
    #[inline]
    pub(super) fn micro_image(&self) -> [i32; 2] {
        [0, 1].map(|k| self.cell[k] + i32::from(self.beyond[k] >= 0.5))
    }

    /// The bins at or before it, of so many along each lattice vector, and the share of a bin beyond them.
    #[inline]
    pub(super) fn bins(&self, side: usize) -> [(usize, f64); 2] {
        self.beyond.map(|beyond| {
            let at = beyond * side as f64;
            let base = (at as usize).min(side - 1);
            (base, at - base as f64)
        })
    }
}

/// Calls `visit` with every x of row `y` and its place.
#[inline]
pub(super) fn along_row(grid: &Grid, y: usize, mut visit: impl FnMut(usize, Place)) {
    let w = grid.frame_size[0];
    let mut left = grid.indices_at(0.0, y as f64);
    for x0 in (0..w).step_by(KNOT_STEP) {
        let right = grid.indices_at((x0 + KNOT_STEP) as f64, y as f64);
        let step = [(right[0] - left[0]) / KNOT_STEP as f64, (right[1] - left[1]) / KNOT_STEP as f64];
        for k in 0..KNOT_STEP.min(w - x0) {
            visit(x0 + k, Place::new([left[0] + k as f64 * step[0], left[1] + k as f64 * step[1]]));
        }
        left = right;
    }
}

/// The greatest whole number that is not above a lattice index. Truncation and a comparison: `f64::floor` is a call where
/// SSE 4.1 cannot be taken for granted.
#[inline]
fn floor(u: f64) -> i32 {
    let whole = u as i32;
    whole - i32::from(u < f64::from(whole))
}
