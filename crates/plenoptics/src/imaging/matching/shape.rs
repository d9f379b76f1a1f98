//! How large tiles are, and how far the filters that make them reach.

/// Pixels that the longest vectors hold.
pub(in crate::imaging) const LANES: usize = 16;
/// Reach of the horizontal half of the spline's prefilter, px: its tail is below 0.2 %.
pub(in crate::imaging) const FIR: usize = 5;
/// Pixels from the mask's edge that a warped neighbour's spline reaches.
pub(in crate::imaging) const SPLINE: usize = 2;
/// Rows that the vertical half of the prefilter needs to settle.
const SETTLE: usize = 3;
/// Columns before the mask.
pub(in crate::imaging) const LEFT: usize = SPLINE + FIR;
/// Rows above the mask.
pub(in crate::imaging) const ABOVE: usize = SPLINE + SETTLE;

/// How large tiles are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::imaging) struct Shape {
    /// Radius at which masks have fallen to nothing, px: they end over one pixel.
    pub(in crate::imaging) edge: f32,
    /// Pixels from the one nearest the centre to the mask's last.
    pub(in crate::imaging) disc: usize,
    pub(in crate::imaging) rows: usize,
    /// From one row to the next, with room for the last vector of a row to reach beyond the mask.
    pub(in crate::imaging) stride: usize,
    /// Pixels that this machine's vectors hold, which rows are padded for.
    pub(in crate::imaging) lanes: usize,
}

/// How many numbers this machine's vectors hold.
struct Lanes;

impl pulp::WithSimd for Lanes {
    type Output = usize;

    fn with_simd<S: pulp::Simd>(self, _: S) -> usize {
        S::F32_LANES
    }
}

impl Shape {
    /// For masks of this radius, px.
    pub(in crate::imaging) fn new(radius: f64) -> Self {
        let disc = (radius + 1.0).floor().max(1.0) as usize;
        let lanes = pulp::Arch::new().dispatch(Lanes);
        let stride = (2 * (LEFT + disc) + 1 + 3).next_multiple_of(lanes);
        Self { edge: (radius + 0.5) as f32, disc, rows: 2 * (ABOVE + disc) + 1, stride, lanes }
    }

    /// Column and row of the pixel nearest the centre.
    pub(in crate::imaging) const fn middle(&self) -> [usize; 2] {
        [LEFT + self.disc, ABOVE + self.disc]
    }

    /// Columns that are needed.
    pub(in crate::imaging) const fn cut(&self) -> usize {
        2 * (LEFT + self.disc) + 1
    }

    /// Columns that are cut, in whole vectors.
    pub(in crate::imaging) const fn columns(&self) -> usize {
        self.cut().next_multiple_of(self.lanes)
    }

    pub(in crate::imaging) const fn size(&self) -> usize {
        self.rows * self.stride
    }
}
