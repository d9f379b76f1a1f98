//! What a view takes from each micro-image, looked up by lattice indices.

use super::Patches;
use crate::imaging::depth::DepthState;
use crate::imaging::grid::Grid;

/// One micro-image, whether or not it lies wholly in the frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    /// Its centre, px.
    pub(super) centre: [f32; 2],
    /// Its spacing, px; NaN where it is not known.
    pub(super) spacing: f32,
}

/// The micro-images that any place of the frame can need.
pub(super) struct Cells {
    origin: [i32; 2],
    size: [usize; 2],
    cells: Vec<Cell>,
}

impl Cells {
    /// Those of a grid, and so many lattice steps beyond the frame. With patches of one size all have its spacing.
    pub(super) fn new(grid: &Grid, patches: Patches, beyond: i32) -> Self {
        let [right, bottom] = grid.frame_size.map(|n| n as f64 - 0.5);
        // Corners and the middles of edges: a distorted lattice bulges.
        let places = [-0.5, right / 2.0, right].map(|x| [-0.5, bottom / 2.0, bottom].map(|y| grid.indices_at(x, y)));
        let along = |axis: usize| places.iter().flatten().map(move |at| at[axis]);
        let low = [0, 1].map(|axis| along(axis).fold(f64::INFINITY, f64::min).floor() as i32 - beyond);
        let high = [0, 1].map(|axis| along(axis).fold(f64::NEG_INFINITY, f64::max).ceil() as i32 + beyond);
        let size = [0, 1].map(|axis| (high[axis] - low[axis]) as usize + 1);
        let spacing = |index: [i32; 2]| match patches {
            Patches::Fixed(spacing_px) => spacing_px as f32,
            Patches::Own(map) => map
                .lens(index)
                .filter(|lens| lens.state != DepthState::Unknown)
                .map_or(f32::NAN, |lens| lens.spacing_px as f32),
        };
        let cells = (low[1]..=high[1])
            .flat_map(|j| (low[0]..=high[0]).map(move |i| [i, j]))
            .map(|[i, j]| Cell { centre: grid.position(i, j).map(|x| x as f32), spacing: spacing([i, j]) })
            .collect();
        Self { origin: low, size, cells }
    }

    /// The micro-image with these lattice indices.
    #[inline(always)]
    pub(super) fn get(&self, [i, j]: [i32; 2]) -> Option<Cell> {
        let column = i.wrapping_sub(self.origin[0]) as usize;
        let row = j.wrapping_sub(self.origin[1]) as usize;
        (column < self.size[0] && row < self.size[1]).then(|| self.cells[row * self.size[0] + column])
    }
}
