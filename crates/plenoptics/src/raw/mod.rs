//! A raw frame's pixels, as the sensor gave them: the one image type that devices produce, the simulated camera
//! renders and imaging reads.
//!
//! Frame coordinates: pixel centres at integers, x right, y down, (0, 0) the centre of the first pixel.

mod cfa;
mod depth;
mod file;
mod format;
mod histogram;
mod scaled;
mod window;

pub use cfa::{CfaPattern, Channel};
pub use file::{RawFileError, read, write};
pub use format::{Layout, PixelFormat};
pub use histogram::{CLIPPED_SHARE, Histogram, clipped_from};
pub use window::Window;

/// A raw frame of one sample a pixel, row by row from the top: monochrome, or a mosaic whose [`CfaPattern`] is known to
/// whoever configured the camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawImage {
    width: usize,
    height: usize,
    bits: u8,
    samples: Samples,
}

/// The samples of a [`RawImage`]: one byte each up to 8 bits of depth, two above.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Samples {
    /// Depths up to 8 bits.
    U8(Vec<u8>),
    /// Depths from 9 to 16 bits, the value in the low bits.
    U16(Vec<u16>),
}

impl Samples {
    /// How many samples there are.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::U8(samples) => samples.len(),
            Self::U16(samples) => samples.len(),
        }
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl RawImage {
    /// An 8-bit frame.
    ///
    /// # Panics
    /// If the number of samples is not width times height, or there are none: a mistake of the caller's.
    #[must_use]
    pub fn from_u8(width: usize, height: usize, samples: Vec<u8>) -> Self {
        Self::new(width, height, 8, Samples::U8(samples))
    }

    /// A frame of 9 to 16 bits, the value in the low bits of each sample.
    ///
    /// # Panics
    /// If the number of samples is not width times height, there are none, or the depth is not 9 to 16.
    #[must_use]
    pub fn from_u16(width: usize, height: usize, bits: u8, samples: Vec<u16>) -> Self {
        assert!((9..=16).contains(&bits), "depth of {bits} bits is not 9 to 16");
        Self::new(width, height, bits, Samples::U16(samples))
    }

    fn new(width: usize, height: usize, bits: u8, samples: Samples) -> Self {
        assert!(
            !samples.is_empty() && samples.len() == width * height,
            "{} samples do not fill {width}x{height}",
            samples.len()
        );
        Self { width, height, bits, samples }
    }

    /// Columns.
    #[must_use]
    pub const fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub const fn height(&self) -> usize {
        self.height
    }

    /// Significant bits of a sample.
    #[must_use]
    pub const fn bits(&self) -> u8 {
        self.bits
    }

    /// The largest value a sample can have: a sample with this value is saturated.
    #[must_use]
    pub const fn white_level(&self) -> u16 {
        ((1u32 << self.bits) - 1) as u16
    }

    /// The samples as stored.
    #[must_use]
    pub const fn samples(&self) -> &Samples {
        &self.samples
    }

    /// The samples as 32-bit floats in grey levels of the frame's own depth.
    #[must_use]
    pub fn to_f32(&self) -> Vec<f32> {
        match &self.samples {
            Samples::U8(samples) => samples.iter().map(|&s| f32::from(s)).collect(),
            Samples::U16(samples) => samples.iter().map(|&s| f32::from(s)).collect(),
        }
    }

    /// The samples scaled to 8 bits, for viewing and never for measuring.
    #[must_use]
    pub fn to_view(&self) -> Vec<u8> {
        match &self.samples {
            Samples::U8(samples) => samples.clone(),
            Samples::U16(samples) => samples.iter().map(|&s| (s >> (self.bits - 8)) as u8).collect(),
        }
    }
}
