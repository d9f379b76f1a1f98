//! A raw frame as tiles are cut from it, with the gains that take its vignetting out.

use super::plan::Lens;
use super::shape::Shape;
use crate::imaging::spacing::LEAST_VIGNETTING;

/// Samples that lie in one cache line at least.
const TOUCH_STEP: usize = 32;
/// Unit of the gains.
pub(super) const GAIN_UNIT: f32 = 1.0 / 8192.0;
/// Gains beyond the last, for rows of tiles that reach over it.
const SPARE: usize = 16;

/// A sample of a raw frame.
pub(super) trait Sample: Copy + Default + Ord + Send + Sync + Into<f32> {
    /// Its grey level.
    fn level(self) -> u32;

    /// The same to calculate with.
    fn grey(self) -> f32;

    /// The line of its own kind.
    fn line(lines: &mut EdgeLines) -> &mut Vec<Self>;
}

/// One line of samples of either kind: where a tile reaches over the frame's edge, the edge is continued.
#[derive(Debug, Clone, Default)]
pub(super) struct EdgeLines {
    bytes: Vec<u8>,
    words: Vec<u16>,
}

impl Sample for u8 {
    #[inline(always)]
    fn level(self) -> u32 {
        u32::from(self)
    }

    #[inline(always)]
    fn grey(self) -> f32 {
        f32::from(self)
    }

    fn line(lines: &mut EdgeLines) -> &mut Vec<Self> {
        &mut lines.bytes
    }
}

impl Sample for u16 {
    #[inline(always)]
    fn level(self) -> u32 {
        u32::from(self)
    }

    #[inline(always)]
    fn grey(self) -> f32 {
        f32::from(self)
    }

    fn line(lines: &mut EdgeLines) -> &mut Vec<Self> {
        &mut lines.words
    }
}

/// A raw frame as tiles are cut from it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame<'a, T> {
    pub(super) samples: &'a [T],
    pub(super) gains: &'a Gains,
    pub(super) width: usize,
    pub(super) height: usize,
    /// Samples from here on are saturated.
    pub(super) white: T,
}

impl<T: Sample> Frame<'_, T> {
    /// Reads a little of every cache line that a tile will be cut from. Nothing waits for these reads, so that the
    /// memory works on many at a time; the cut itself would wait for one row after another.
    #[inline(always)]
    pub(super) fn touch(&self, lens: &Lens, shape: &Shape) -> u32 {
        let [column, row] = shape.middle();
        let left = (lens.nearest[0] as isize - column as isize).max(0) as usize;
        let top = (lens.nearest[1] as isize - row as isize).max(0) as usize;
        let last = (left + shape.stride).min(self.width).saturating_sub(1);
        let mut read = 0u32;
        for y in top..(top + shape.rows).min(self.height) {
            let Some(line) = self.samples.get(y * self.width..(y + 1) * self.width) else { continue };
            let mut x = left;
            while x < last {
                read = read.wrapping_add(u32::from(line[x] >= self.white));
                x += TOUCH_STEP;
            }
            read = read.wrapping_add(u32::from(line[last] >= self.white));
        }
        read
    }
}

/// What every pixel of every tile is multiplied by to take the vignetting out: one micro-image after another, in the
/// order of the plan, so that the memory is read from one end to the other.
#[derive(Debug, Clone)]
pub(super) struct Gains {
    gains: Vec<u16>,
    /// The largest tiles there are.
    largest: Shape,
    columns: usize,
}

impl Gains {
    /// For tiles up to `largest`; `vignetting` has the share of light of every pixel.
    pub(super) fn new(vignetting: &[f32], size: [usize; 2], lenses: &[Lens], largest: Shape) -> Self {
        let [column, row] = largest.middle();
        // Without what rows are padded by: there a row runs on into the next.
        let columns = largest.cut();
        let one = |lens: &Lens| {
            let within = |at: isize, axis: usize| at.clamp(0, size[axis] as isize - 1) as usize;
            let (left, top) = (lens.nearest[0] as isize - column as isize, lens.nearest[1] as isize - row as isize);
            (0..largest.rows * columns).map(move |k| {
                let (x, y) = (within(left + (k % columns) as isize, 0), within(top + (k / columns) as isize, 1));
                gain(vignetting[y * size[0] + x])
            })
        };
        let mut gains: Vec<u16> = lenses.iter().flat_map(one).collect();
        // A row of a smaller tile may reach beyond the last.
        gains.resize(gains.len() + SPARE, 0);
        Self { gains, largest, columns }
    }

    /// So many of the gains of a row of a tile.
    #[inline(always)]
    pub(super) fn row(&self, lens: u32, y: usize, shape: &Shape, columns: usize) -> &[u16] {
        let inset = self.largest.disc - shape.disc;
        let from = (lens as usize * self.largest.rows + y + inset) * self.columns + inset;
        &self.gains[from..from + columns]
    }
}

/// A share of light as a gain.
pub(super) fn gain(share: f32) -> u16 {
    (1.0 / (share.max(LEAST_VIGNETTING) * GAIN_UNIT)).round() as u16
}
