//! Pixel formats: from a driver's buffer to a frame, and from its sequence numbers to frames lost.

use crate::raw::RawImage;

/// A pixel format that this program reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelFormat {
    /// One byte a pixel, grey.
    Grey,
    /// Two bytes a pixel, luma first, chroma shared by pairs: the luma is read.
    Yuyv,
}

impl PixelFormat {
    /// The format of a configured four-character code.
    #[must_use]
    pub fn from_code(code: &str) -> Option<Self> {
        match code {
            "GREY" => Some(Self::Grey),
            "YUYV" => Some(Self::Yuyv),
            _ => None,
        }
    }

    /// Its V4L2 four-character code.
    #[must_use]
    pub const fn code(self) -> &'static [u8; 4] {
        match self {
            Self::Grey => b"GREY",
            Self::Yuyv => b"YUYV",
        }
    }

    const fn bytes_per_pixel(self) -> usize {
        match self {
            Self::Grey => 1,
            Self::Yuyv => 2,
        }
    }
}

/// Why a buffer is no frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum UnpackError {
    /// A row is shorter than its pixels.
    #[error("rows of {stride} bytes cannot hold {width} pixels")]
    Stride {
        /// Bytes a row.
        stride: usize,
        /// Pixels a row.
        width: usize,
    },
    /// The buffer ends before the last pixel.
    #[error("{got} bytes instead of {needed}")]
    Short {
        /// Bytes there.
        got: usize,
        /// Bytes needed.
        needed: usize,
    },
}

/// Makes a frame of `width` by `height` pixels out of a buffer whose rows begin every `stride` bytes (0: tightly
/// packed).
///
/// # Errors
/// When the buffer cannot hold such a frame.
pub fn unpack(
    buffer: &[u8],
    width: usize,
    height: usize,
    stride: usize,
    format: PixelFormat,
) -> Result<RawImage, UnpackError> {
    let row = width * format.bytes_per_pixel();
    let stride = if stride == 0 { row } else { stride };
    if stride < row || row == 0 {
        return Err(UnpackError::Stride { stride, width });
    }
    // The last row need not be padded.
    let needed = stride * height.saturating_sub(1) + row;
    if buffer.len() < needed || height == 0 {
        return Err(UnpackError::Short { got: buffer.len(), needed });
    }
    let mut samples = Vec::with_capacity(width * height);
    for line in buffer.chunks(stride).take(height) {
        match format {
            PixelFormat::Grey => samples.extend_from_slice(&line[..row]),
            PixelFormat::Yuyv => samples.extend(line[..row].iter().step_by(2)),
        }
    }
    Ok(RawImage::from_u8(width, height, samples))
}

/// Frames lost between two sequence numbers of a driver, which count in 32 bits and wrap.
#[must_use]
pub fn frames_lost(previous: u32, now: u32) -> u32 {
    let step = now.wrapping_sub(previous);
    // A step back is a driver that began to count anew; a repeated number is no loss.
    if step == 0 || step > u32::MAX / 2 { 0 } else { step - 1 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::raw::Samples;

    #[test]
    fn stride_and_chroma_are_left_out() {
        let padded = [1, 2, 3, 0, 4, 5, 6];
        let image = unpack(&padded, 3, 2, 4, PixelFormat::Grey).unwrap();
        assert_eq!(image.samples(), &Samples::U8(vec![1, 2, 3, 4, 5, 6]));
        let yuyv = [10, 128, 20, 128, 30, 128, 40, 128];
        let image = unpack(&yuyv, 2, 2, 0, PixelFormat::Yuyv).unwrap();
        assert_eq!(image.samples(), &Samples::U8(vec![10, 20, 30, 40]));
        assert_eq!(unpack(&padded, 3, 2, 2, PixelFormat::Grey), Err(UnpackError::Stride { stride: 2, width: 3 }));
        assert_eq!(unpack(&padded, 4, 2, 4, PixelFormat::Grey), Err(UnpackError::Short { got: 7, needed: 8 }));
    }

    #[test]
    fn gaps_are_counted_over_the_wrap() {
        assert_eq!(frames_lost(4, 5), 0);
        assert_eq!(frames_lost(4, 8), 3);
        assert_eq!(frames_lost(u32::MAX, 0), 0);
        assert_eq!(frames_lost(u32::MAX - 1, 2), 3);
        assert_eq!(frames_lost(100, 0), 0, "the driver began anew");
        assert_eq!(frames_lost(7, 7), 0);
    }

    proptest! {
        #[test]
        fn no_buffer_breaks_it(
            buffer in proptest::collection::vec(any::<u8>(), 0..300),
            width in 0usize..20,
            height in 0usize..20,
            stride in 0usize..60,
            yuyv: bool,
        ) {
            let format = if yuyv { PixelFormat::Yuyv } else { PixelFormat::Grey };
            if let Ok(image) = unpack(&buffer, width, height, stride, format) {
                prop_assert_eq!((image.width(), image.height()), (width, height));
            }
        }
    }
}
