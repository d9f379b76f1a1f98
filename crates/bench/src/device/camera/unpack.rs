//! From a driver's buffer to a frame, and from its sequence numbers to frames lost.

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use plenoptics::raw::{Layout, PixelFormat, RawImage};

/// Why a buffer is no frame.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
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
    /// Samples are larger than the format's depth allows: the driver puts the value elsewhere.
    #[error(
        "samples reach 0x{bits_set:x}, which {bits} bits do not hold: the driver puts the value into other bits than \
         its format says"
    )]
    Depth {
        /// Every bit that is set in any sample.
        bits_set: u16,
        /// Depth of the format.
        bits: u8,
    },
    /// No JPEG picture of the size agreed.
    #[error("the JPEG picture cannot be used: {0}")]
    Jpeg(String),
}

/// Makes a frame of `width` by `height` pixels out of a buffer whose rows begin every `stride` bytes (0: not padded). Of
/// formats with colour the luma is read, of RGB made (ITU-R BT.601).
///
/// # Errors
/// When the buffer cannot hold such a frame, or its samples belie the format.
pub fn unpack(
    buffer: &[u8],
    width: usize,
    height: usize,
    stride: usize,
    format: PixelFormat,
) -> Result<RawImage, UnpackError> {
    if format.layout() == Layout::Jpeg {
        return unpack_jpeg(buffer, width, height);
    }
    if matches!(format.layout(), Layout::DenseLow | Layout::Pairs) && stride == 0 {
        // Without padding a row begins where the one before has ended, within a byte.
        let pixels = width * height;
        let needed = format.row_bytes(pixels);
        let short = UnpackError::Short { got: buffer.len(), needed };
        let run = buffer.get(..needed).filter(|_| pixels > 0).ok_or(short)?;
        return Ok(RawImage::from_u16(width, height, format.bits(), grouped(run, pixels, format)));
    }
    let row = format.row_bytes(width);
    let stride = if stride == 0 { row } else { stride };
    if stride < row || row == 0 {
        return Err(UnpackError::Stride { stride, width });
    }
    // The last row need not be padded.
    let needed = stride * height.saturating_sub(1) + row;
    if buffer.len() < needed || height == 0 {
        return Err(UnpackError::Short { got: buffer.len(), needed });
    }
    let rows = buffer.chunks(stride).take(height).map(|line| &line[..row]);
    let bytes = || Vec::with_capacity(width * height);
    let words = || Vec::with_capacity(width * height);
    match format.layout() {
        Layout::Bytes { step: 1, .. } => {
            let mut samples: Vec<u8> = bytes();
            rows.for_each(|line| samples.extend_from_slice(line));
            Ok(RawImage::from_u8(width, height, samples))
        }
        Layout::Bytes { first, step } => {
            let mut samples: Vec<u8> = bytes();
            rows.for_each(|line| samples.extend(line.iter().skip(first).step_by(step)));
            Ok(RawImage::from_u8(width, height, samples))
        }
        Layout::Rgb { red_first } => {
            let (r, b) = if red_first { (0, 2) } else { (2, 0) };
            // Weights in 1/256, their sum 256.
            let luma = |p: &[u8]| (77 * u32::from(p[r]) + 150 * u32::from(p[1]) + 29 * u32::from(p[b]) + 128) >> 8;
            let mut samples: Vec<u8> = bytes();
            rows.for_each(|line| samples.extend(line.chunks_exact(3).map(|pixel| luma(pixel) as u8)));
            Ok(RawImage::from_u8(width, height, samples))
        }
        Layout::Words { big_endian } => {
            let word = if big_endian { u16::from_be_bytes } else { u16::from_le_bytes };
            let mut samples: Vec<u16> = words();
            rows.for_each(|line| samples.extend(line.chunks_exact(2).map(|pair| word([pair[0], pair[1]]))));
            deep(width, height, format.bits(), samples)
        }
        Layout::Mipi => {
            let (count, group_bytes) = format.mipi_group();
            let low_bits = usize::from(format.bits()) - 8;
            let mut samples: Vec<u16> = words();
            for line in rows {
                let end = samples.len() + width;
                for group in line.chunks_exact(group_bytes) {
                    let (high, low) = group.split_at(count);
                    let low = low.iter().rev().fold(0u32, |bits, &byte| bits << 8 | u32::from(byte));
                    for (i, &high) in high.iter().enumerate() {
                        let rest = low >> (i * low_bits) & ((1 << low_bits) - 1);
                        samples.push(u16::from(high) << low_bits | rest as u16);
                    }
                }
                samples.truncate(end);
            }
            deep(width, height, format.bits(), samples)
        }
        Layout::Dense => {
            let bits = u32::from(format.bits());
            let mut samples: Vec<u16> = words();
            for line in rows {
                let (mut held, mut count) = (0u32, 0);
                let end = samples.len() + width;
                for &byte in line {
                    (held, count) = (held << 8 | u32::from(byte), count + 8);
                    if count >= bits {
                        count -= bits;
                        samples.push((held >> count & ((1 << bits) - 1)) as u16);
                    }
                }
                samples.truncate(end);
            }
            deep(width, height, format.bits(), samples)
        }
        Layout::DenseLow | Layout::Pairs => {
            let samples = rows.flat_map(|line| grouped(line, width, format)).collect();
            Ok(RawImage::from_u16(width, height, format.bits(), samples))
        }
        Layout::Jpeg => unpack_jpeg(buffer, width, height),
    }
}

/// So many samples that lie in groups of whole bytes, a group at a time.
fn grouped(bytes: &[u8], count: usize, format: PixelFormat) -> Vec<u16> {
    match (format.layout(), format.bits()) {
        (Layout::Pairs, bits) => {
            let low_bits = bits - 8;
            let sample = |high: u8, low: u8| u16::from(high) << low_bits | u16::from(low) & ((1 << low_bits) - 1);
            in_groups(bytes, count, |[first, low, second]| [sample(first, low), sample(second, low >> 4)])
        }
        (_, 10) => in_groups(bytes, count, |b: [u8; 5]| {
            let held = u64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], 0, 0, 0]);
            [held, held >> 10, held >> 20, held >> 30].map(|sample| (sample & 0x3ff) as u16)
        }),
        _ => in_groups(bytes, count, |b: [u8; 3]| {
            let held = u32::from_le_bytes([b[0], b[1], b[2], 0]);
            [held, held >> 12].map(|sample| (sample & 0xfff) as u16)
        }),
    }
}

/// So many samples of groups of `BYTES`, of which `apart` takes one apart; the last may end early.
fn in_groups<const BYTES: usize, const SAMPLES: usize>(
    bytes: &[u8],
    count: usize,
    apart: impl Fn([u8; BYTES]) -> [u16; SAMPLES],
) -> Vec<u16> {
    let mut samples = Vec::with_capacity(count + SAMPLES);
    let (groups, rest) = bytes.as_chunks::<BYTES>();
    samples.extend(groups.iter().flat_map(|&group| apart(group)));
    samples.extend(apart(filled(rest)));
    samples.truncate(count);
    samples
}

/// A group whose last bytes are not there.
fn filled<const N: usize>(rest: &[u8]) -> [u8; N] {
    let mut group = [0; N];
    group[..rest.len()].copy_from_slice(rest);
    group
}

/// A frame of more than 8 bits whose samples keep to their depth.
fn deep(width: usize, height: usize, bits: u8, samples: Vec<u16>) -> Result<RawImage, UnpackError> {
    let bits_set = samples.iter().fold(0, |all, sample| all | sample);
    if bits < 16 && bits_set >> bits != 0 {
        return Err(UnpackError::Depth { bits_set, bits });
    }
    Ok(RawImage::from_u16(width, height, bits, samples))
}

fn unpack_jpeg(buffer: &[u8], width: usize, height: usize) -> Result<RawImage, UnpackError> {
    let tables_left_out = !buffer.windows(2).any(|marker| marker == [0xff, 0xc4]);
    let samples = if tables_left_out && buffer.starts_with(&[0xff, 0xd8]) {
        // Motion JPEG may leave its Huffman tables out, being always the standard's: the decoder puts those in for a
        // picture that says it is of an AVI file.
        let mut told = b"\xff\xd8\xff\xe0\x00\x10AVI1\0\0\0\0\0\0\0\0\0\0".to_vec();
        told.extend_from_slice(&buffer[2..]);
        decode_jpeg(&told, width, height)
    } else {
        decode_jpeg(buffer, width, height)
    };
    Ok(RawImage::from_u8(width, height, samples?))
}

fn decode_jpeg(bytes: &[u8], width: usize, height: usize) -> Result<Vec<u8>, UnpackError> {
    let refused = |why: String| UnpackError::Jpeg(why);
    // The decoder makes the rest of a picture that is cut short grey; and only says so in its strict mode, which refuses
    // what cameras put between a picture's parts.
    if !bytes.windows(2).rev().any(|marker| marker == [0xff, 0xd9]) {
        return Err(refused("its end is missing".to_owned()));
    }
    let options = DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::Luma);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|error| refused(format!("{error:?}")))?;
    let (columns, rows) = decoder.dimensions().unwrap_or_default();
    if (columns, rows) != (width, height) || width * height == 0 {
        return Err(refused(format!("it has {columns}x{rows} pixels instead of {width}x{height}")));
    }
    let mut samples = vec![0; width * height];
    decoder.decode_into(&mut samples).map_err(|error| refused(format!("{error:?}")))?;
    Ok(samples)
}

/// Frames lost between two sequence numbers of a driver, which count in 32 bits and wrap.
#[must_use]
pub fn frames_lost(previous: u32, now: u32) -> u32 {
    let step = now.wrapping_sub(previous);
    // A step back is a driver that began to count anew; a repeated number is no loss.
    if step == 0 || step > u32::MAX / 2 { 0 } else { step - 1 }
}

#[cfg(test)]
mod tests;
