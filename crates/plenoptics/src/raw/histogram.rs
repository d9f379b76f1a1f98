//! How many pixels of a raw frame have which grey level.

use super::{RawImage, Samples};

/// From which level on a sample counts as clipped, on a scale that ends at `white`: many a camera clips a little below the
/// end of its scale.
#[must_use]
pub const fn clipped_from(white: u16) -> u16 {
    white - white / 50
}

/// More clipped pixels than that are a fault of the exposure: fewer are hot pixels and mirrored lamps.
pub const CLIPPED_SHARE: f64 = 0.002;

/// The pixels of one frame by grey level, at its full depth; of a mosaic all colours together.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Histogram {
    counts: Vec<u32>,
    pixels: u64,
    white: u16,
}

/// Tables that neighbouring samples are counted in, in turn: of equal ones none waits for the one before.
const TABLES: usize = 4;

impl Histogram {
    /// Counts every pixel of a frame whose scale ends at `white`: at its greatest level, or below that where a camera
    /// sends video levels.
    #[must_use]
    pub fn of(image: &RawImage, white: u16) -> Self {
        let levels = usize::from(image.white_level()) + 1;
        let counts = match image.samples() {
            Samples::U8(samples) => {
                let mut tables = [[0u32; 256]; TABLES];
                let (whole, rest) = samples.as_chunks::<TABLES>();
                for four in whole {
                    for (table, sample) in tables.iter_mut().zip(four) {
                        table[usize::from(*sample)] += 1;
                    }
                }
                for sample in rest {
                    tables[0][usize::from(*sample)] += 1;
                }
                (0..levels).map(|level| tables.iter().map(|table| table[level]).sum()).collect()
            }
            Samples::U16(samples) => {
                let mut counts = vec![0u32; levels];
                for sample in samples {
                    // What lies beyond the frame's depth is as white as can be.
                    counts[usize::from(*sample).min(levels - 1)] += 1;
                }
                counts
            }
        };
        Self { counts, pixels: image.samples().len() as u64, white: white.min(image.white_level()) }
    }

    /// How many grey levels there are: 256 for 8 bits.
    #[must_use]
    pub fn levels(&self) -> usize {
        self.counts.len()
    }

    /// The pixels in as many equal ranges of grey levels, darkest first; never more ranges than there are levels. Where
    /// they do not come out even, the last is narrower.
    #[must_use]
    pub fn in_ranges(&self, ranges: usize) -> Vec<u64> {
        let width = self.levels().div_ceil(ranges.max(1)).max(1);
        self.counts.chunks(width).map(|range| range.iter().map(|&count| u64::from(count)).sum()).collect()
    }

    /// Share of the pixels at level 0.
    #[must_use]
    pub fn black_share(&self) -> f64 {
        self.share_from_to(0, 1)
    }

    /// From which level on a pixel is [clipped](clipped_from).
    #[must_use]
    pub const fn clipped_from(&self) -> u16 {
        clipped_from(self.white)
    }

    /// Share of the pixels that are clipped.
    #[must_use]
    pub fn clipped_share(&self) -> f64 {
        self.share_from_to(usize::from(self.clipped_from()), self.levels())
    }

    fn share_from_to(&self, from: usize, to: usize) -> f64 {
        let count: u64 = self.counts[from..to].iter().map(|&count| u64::from(count)).sum();
        count as f64 / self.pixels as f64
    }

    /// The level that this share of the pixels is at or below, as a part of white: 1 beyond it.
    #[must_use]
    pub fn level_of(&self, share: f64) -> f64 {
        let wanted = share * self.pixels as f64;
        let mut below = 0.0;
        for (level, &count) in self.counts.iter().enumerate() {
            below += f64::from(count);
            if below >= wanted {
                return (level as f64 / f64::from(self.white)).min(1.0);
            }
        }
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pixel_is_counted_at_the_frames_own_depth() {
        let eight = Histogram::of(&RawImage::from_u8(5, 2, vec![0, 0, 0, 7, 7, 128, 251, 254, 255, 255]), 255);
        let counts = eight.in_ranges(256);
        assert_eq!((counts.len(), counts.iter().sum::<u64>()), (256, 10));
        assert_eq!((counts[0], counts[7], counts[128], counts[255]), (3, 2, 1, 2));
        assert_eq!(eight.in_ranges(2), [5, 5]);
        assert!((eight.black_share() - 0.3).abs() < 1e-12);
        // From 250 of 255 on.
        assert!((eight.clipped_share() - 0.4).abs() < 1e-12);

        let twelve = Histogram::of(&RawImage::from_u16(4, 1, 12, vec![0, 4012, 4013, 4095]), 4095);
        assert_eq!((twelve.levels(), twelve.in_ranges(4096)[4013]), (4096, 1));
        assert_eq!(twelve.in_ranges(65_536).len(), 4096, "no more than there are");
        assert_eq!(twelve.in_ranges(256)[255], 1, "sixteen levels in each");
        let from = usize::from(clipped_from(4095));
        assert_eq!(from, 4014);
        assert!((twelve.clipped_share() - 0.25).abs() < 1e-12);
    }

    #[test]
    fn video_levels_are_clipped_at_their_own_white() {
        let video = Histogram::of(&RawImage::from_u8(5, 1, vec![16, 188, 230, 231, 240]), 235);
        assert_eq!((video.levels(), video.clipped_from()), (256, 231));
        assert!((video.clipped_share() - 0.4).abs() < 1e-12);
        assert!((video.level_of(0.4) - 0.8).abs() < 1e-12 && (video.level_of(1.0) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_level_is_found_by_the_share_below_it() {
        let ramp = Histogram::of(&RawImage::from_u8(256, 1, (0..=255).collect()), 255);
        assert!((ramp.level_of(0.5) - 127.0 / 255.0).abs() < 1e-12);
        assert!((ramp.level_of(1.0) - 1.0).abs() < 1e-12);
        assert!(ramp.level_of(0.0) < 1e-12);
    }
}
