//! A raw frame as tiles are cut from it.

use super::plan::Lens;
use super::shape::Shape;
use crate::raw::{CfaPattern, Channel};

/// Samples that lie in one cache line at least.
const TOUCH_STEP: usize = 32;

/// A sample of a raw frame.
pub(in crate::imaging) trait Sample: Copy + Default + PartialOrd + Send + Sync + Into<f32> {
    /// Its grey level.
    fn level(self) -> u32;

    /// The same to calculate with.
    #[inline(always)]
    fn grey(self) -> f32 {
        self.into()
    }

    /// The line of its own kind.
    fn line(lines: &mut EdgeLines) -> &mut Vec<Self>;
}

/// One line of samples of each kind: where a tile reaches over the frame's edge, the edge is continued.
#[derive(Debug, Clone, Default)]
pub(in crate::imaging) struct EdgeLines {
    bytes: Vec<u8>,
    words: Vec<u16>,
    reals: Vec<f32>,
}

impl Sample for u8 {
    #[inline(always)]
    fn level(self) -> u32 {
        u32::from(self)
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

    fn line(lines: &mut EdgeLines) -> &mut Vec<Self> {
        &mut lines.words
    }
}

impl Sample for f32 {
    #[inline(always)]
    fn level(self) -> u32 {
        self as u32
    }

    fn line(lines: &mut EdgeLines) -> &mut Vec<Self> {
        &mut lines.reals
    }
}

/// A raw frame as tiles are cut from it.
#[derive(Debug, Clone, Copy)]
pub(in crate::imaging) struct Frame<'a, T> {
    pub(in crate::imaging) samples: &'a [T],
    pub(in crate::imaging) width: usize,
    pub(in crate::imaging) height: usize,
    /// Samples from here on are saturated.
    pub(in crate::imaging) white: T,
    /// The mosaic of the sensor, of which only green pixels are a reference; the others hold what lies between them.
    pub(in crate::imaging) mosaic: Option<CfaPattern>,
}

impl<T: Sample> Frame<'_, T> {
    /// Whether the sensor measured the pixel at column `x`, row `y`, in the colour that is compared.
    #[inline]
    pub(in crate::imaging) fn is_reference(&self, x: usize, y: usize) -> bool {
        self.mosaic.is_none_or(|pattern| pattern.channel(x, y) == Channel::Green)
    }

    /// Reads a little of every cache line that a tile will be cut from. Nothing waits for these reads, so that the
    /// memory works on many at a time; the cut itself would wait for one row after another.
    #[inline(always)]
    pub(in crate::imaging) fn touch(&self, lens: &Lens, shape: &Shape) -> u32 {
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
