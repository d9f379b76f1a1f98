//! A raw frame as tiles are cut from it.

use super::plan::Lens;
use super::shape::Shape;

/// Samples that lie in one cache line at least.
const TOUCH_STEP: usize = 32;

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
