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
mod tests {
    use proptest::prelude::*;

    use super::*;
    use plenoptics::raw::Samples;

    fn format(name: &str) -> PixelFormat {
        PixelFormat::from_name(name).unwrap()
    }

    #[track_caller]
    fn unpacked(name: &str, buffer: &[u8], width: usize, height: usize) -> RawImage {
        unpack(buffer, width, height, 0, format(name)).unwrap()
    }

    #[test]
    fn stride_and_chroma_are_left_out() {
        let padded = [1, 2, 3, 0, 4, 5, 6];
        let image = unpack(&padded, 3, 2, 4, format("GREY")).unwrap();
        assert_eq!(image.samples(), &Samples::U8(vec![1, 2, 3, 4, 5, 6]));
        let yuyv = [10, 128, 20, 128, 30, 128, 40, 128];
        assert_eq!(unpacked("YUYV", &yuyv, 2, 2).samples(), &Samples::U8(vec![10, 20, 30, 40]));
        assert_eq!(unpacked("UYVY", &yuyv, 2, 2).samples(), &Samples::U8(vec![128; 4]));
        assert_eq!(unpacked("NV12", &[1, 2, 3, 4, 128, 128], 2, 2).samples(), &Samples::U8(vec![1, 2, 3, 4]));
        assert_eq!(unpack(&padded, 3, 2, 2, format("GREY")), Err(UnpackError::Stride { stride: 2, width: 3 }));
        assert_eq!(unpack(&padded, 4, 2, 4, format("GREY")), Err(UnpackError::Short { got: 7, needed: 8 }));
    }

    #[test]
    fn grey_is_made_of_colours() {
        let colours = [255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255];
        assert_eq!(unpacked("RGB3", &colours, 4, 1).samples(), &Samples::U8(vec![77, 149, 29, 255]));
        assert_eq!(unpacked("BGR3", &colours, 4, 1).samples(), &Samples::U8(vec![29, 149, 77, 255]));
    }

    #[test]
    fn words_keep_their_depth_and_byte_order() {
        assert_eq!(unpacked("Y10", &[0xff, 0x03, 1, 0], 2, 1), RawImage::from_u16(2, 1, 10, vec![1023, 1]));
        assert_eq!(unpacked("Y16 -BE", &[0x12, 0x34], 1, 1), RawImage::from_u16(1, 1, 16, vec![0x1234]));
        assert_eq!(unpacked("RG12", &[0x34, 0x02], 1, 1), RawImage::from_u16(1, 1, 12, vec![0x234]));
    }

    #[test]
    fn a_value_in_the_high_bits_is_refused() {
        let refused = unpack(&[0xc0, 0xff], 1, 1, 0, format("Y10")).unwrap_err();
        assert_eq!(refused, UnpackError::Depth { bits_set: 0xffc0, bits: 10 });
        assert!(refused.to_string().contains("0xffc0"), "{refused}");
    }

    #[test]
    fn mipi_groups_are_taken_apart() {
        // The kernel's documentation: bytes of P0 to P3, then P3[1:0] P2[1:0] P1[1:0] P0[1:0].
        let ten = [0x80, 0x40, 0x20, 0x10, 0b11_10_01_00];
        let image = unpacked("Y10P", &ten, 4, 1);
        assert_eq!(image, RawImage::from_u16(4, 1, 10, vec![0x200, 0x101, 0x82, 0x43]));
        assert_eq!(unpacked("pRAA", &ten, 3, 1), RawImage::from_u16(3, 1, 10, vec![0x200, 0x101, 0x82]));
        // P0, P1, then P1[3:0] P0[3:0].
        assert_eq!(unpacked("Y12P", &[0xab, 0x12, 0x3c], 2, 1), RawImage::from_u16(2, 1, 12, vec![0xabc, 0x123]));
        // P1[1:0] P0[5:0], P2[3:0] P1[5:2], P3[5:0] P2[5:4].
        let fourteen = [1, 2, 3, 4, 0b0100_0001, 0b0011_1000, 0b1111_1010];
        let expected = vec![1 << 6 | 1, 2 << 6 | 0b100001, 3 << 6 | 0b100011, 4 << 6 | 0b111110];
        assert_eq!(unpacked("Y14P", &fourteen, 4, 1), RawImage::from_u16(4, 1, 14, expected));
    }

    #[test]
    fn dense_samples_run_over_bytes() {
        // 1111111111 0000000001 1010101010 0101010101
        let bytes = [0b1111_1111, 0b1100_0000, 0b0001_1010, 0b1010_1001, 0b0101_0101];
        assert_eq!(unpacked("Y10B", &bytes, 4, 1), RawImage::from_u16(4, 1, 10, vec![1023, 1, 682, 341]));
    }

    #[test]
    fn dense_samples_of_genicam_cameras_run_over_bytes_and_rows() {
        let of = |name: &str, buffer: &[u8], width, height, stride| {
            unpack(buffer, width, height, stride, PixelFormat::from_genicam_name(name).unwrap()).unwrap()
        };
        // Bits 0 to 9 of the run are the first sample, 10 to 19 the second: 0x3ff, 0x001, 0x2aa, 0x155.
        let ten = [0xff, 0x07, 0xa0, 0x6a, 0x55];
        assert_eq!(of("Mono10p", &ten, 4, 1, 0), RawImage::from_u16(4, 1, 10, vec![0x3ff, 1, 0x2aa, 0x155]));
        assert_eq!(of("BayerRG10p", &ten[..4], 3, 1, 0), RawImage::from_u16(3, 1, 10, vec![0x3ff, 1, 0x2aa]));
        // Three rows of one sample each begin within a byte; padded, each begins with one.
        let twelve = [0xbc, 0x3a, 0x12, 0xef, 0x0d];
        assert_eq!(of("Mono12p", &twelve, 1, 3, 0), RawImage::from_u16(1, 3, 12, vec![0xabc, 0x123, 0xdef]));
        let padded = [0xbc, 0x0a, 0, 0x23, 0x01];
        assert_eq!(of("Mono12p", &padded, 1, 2, 3), RawImage::from_u16(1, 2, 12, vec![0xabc, 0x123]));
        let format = PixelFormat::from_genicam_name("Mono12p").unwrap();
        assert_eq!(unpack(&twelve, 1, 4, 0, format), Err(UnpackError::Short { got: 5, needed: 6 }));
    }

    #[test]
    fn pairs_of_genicam_cameras_are_taken_apart() {
        let of = |name: &str, buffer: &[u8], width, height, stride| {
            unpack(buffer, width, height, stride, PixelFormat::from_genicam_name(name).unwrap()).unwrap()
        };
        // As the camera makers' manuals have it: the high bits in bytes 0 and 2, the first pixel's low ones in the low half of
        // the byte between.
        let twelve = [0xab, 0x3c, 0x12];
        assert_eq!(of("Mono12Packed", &twelve, 2, 1, 0), RawImage::from_u16(2, 1, 12, vec![0xabc, 0x123]));
        assert_eq!(of("BayerBG12Packed", &twelve, 1, 2, 0), RawImage::from_u16(1, 2, 12, vec![0xabc, 0x123]));
        // What lies besides is no part of a sample.
        let ten = [0xa9, 0b1110_1101, 0x56];
        assert_eq!(of("Mono10Packed", &ten, 2, 1, 0), RawImage::from_u16(2, 1, 10, vec![0x2a5, 0x15a]));
        assert_eq!(of("BayerGR10Packed", &ten[..2], 1, 1, 0), RawImage::from_u16(1, 1, 10, vec![0x2a5]));
        let padded = [0xab, 0x0c, 0, 0, 0x12, 0x03];
        assert_eq!(of("Mono12Packed", &padded, 1, 2, 4), RawImage::from_u16(1, 2, 12, vec![0xabc, 0x123]));
        let format = PixelFormat::from_genicam_name("Mono12Packed").unwrap();
        assert_eq!(unpack(&twelve, 3, 1, 0, format), Err(UnpackError::Short { got: 3, needed: 5 }));
    }

    fn jpeg(kind: jpeg_encoder::ColorType, pixels: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        jpeg_encoder::Encoder::new(&mut bytes, 95).encode(pixels, 16, 8, kind).unwrap();
        bytes
    }

    #[test]
    fn the_luma_of_a_jpeg_is_read() {
        let ramp: Vec<u8> = (0..128).map(|i| (i % 16 * 15) as u8).collect();
        let near = |image: &RawImage| {
            let Samples::U8(samples) = image.samples() else { panic!("8 bits") };
            assert!(samples.iter().zip(&ramp).all(|(a, b)| a.abs_diff(*b) <= 4), "{samples:?}");
        };
        let grey = jpeg(jpeg_encoder::ColorType::Luma, &ramp);
        near(&unpacked("MJPG", &grey, 16, 8));
        let colour: Vec<u8> = ramp.iter().flat_map(|&v| [v, v, v]).collect();
        near(&unpacked("MJPG", &jpeg(jpeg_encoder::ColorType::Rgb, &colour), 16, 8));
        // A buffer is longer than the picture in it.
        near(&unpacked("MJPG", &[&grey[..], &[0; 50]].concat(), 16, 8));
    }

    #[test]
    fn a_jpeg_without_its_tables_is_read_with_the_standards() {
        // The encoder's tables are the standard's: taken out, nothing else changes.
        let mut bytes = jpeg(jpeg_encoder::ColorType::Luma, &[90; 128]);
        while let Some(at) = bytes.windows(2).position(|marker| marker == [0xff, 0xc4]) {
            let length = usize::from(u16::from_be_bytes([bytes[at + 2], bytes[at + 3]]));
            bytes.drain(at..at + 2 + length);
        }
        assert_eq!(unpacked("MJPG", &bytes, 16, 8).samples(), &Samples::U8(vec![90; 128]));
    }

    #[test]
    fn a_broken_jpeg_says_so() {
        let good = jpeg(
            jpeg_encoder::ColorType::Luma,
            &(0..128).map(|i| i * 37 % 251).map(|v: u32| v as u8).collect::<Vec<_>>(),
        );
        let refused = |bytes: &[u8], width| unpack(bytes, width, 8, 0, format("MJPG")).unwrap_err().to_string();
        assert!(refused(&good, 8).contains("16x8 pixels instead of 8x8"));
        assert!(refused(&good[..good.len() / 2], 16).contains("JPEG"));
        assert!(refused(b"no picture", 16).contains("JPEG"));
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

    /// Samples bit by bit at the places that the formats' definitions give each.
    fn packed(samples: &[u16], format: PixelFormat) -> Vec<u8> {
        let bits = usize::from(format.bits());
        let mut bytes = vec![0u8; format.row_bytes(samples.len())];
        for (index, sample) in samples.iter().enumerate() {
            for bit in (0..bits).filter(|bit| sample >> bit & 1 == 1) {
                let place = match (format.layout(), index % 2, bit.checked_sub(bits - 8)) {
                    (Layout::DenseLow, ..) => index * bits + bit,
                    (_, 0, Some(high)) => index / 2 * 24 + high,
                    (_, _, Some(high)) => index / 2 * 24 + 16 + high,
                    (_, 0, None) => index / 2 * 24 + 8 + bit,
                    (_, _, None) => index / 2 * 24 + 12 + bit,
                };
                bytes[place / 8] |= 1 << (place % 8);
            }
        }
        bytes
    }

    proptest! {
        #[test]
        fn what_is_packed_is_unpacked(
            width in 1usize..40,
            height in 1usize..5,
            padding in 0usize..4,
            sown in any::<u64>(),
            format in proptest::sample::select(
                PixelFormat::genicam()
                    .iter()
                    .copied()
                    .filter(|format| matches!(format.layout(), Layout::DenseLow | Layout::Pairs))
                    .collect::<Vec<_>>()
            ),
        ) {
            let of = |index: usize| (sown.rotate_left(index as u32 * 7) ^ index as u64) as u16 & format.white_level();
            let samples: Vec<u16> = (0..width * height).map(of).collect();
            let image = RawImage::from_u16(width, height, format.bits(), samples.clone());
            prop_assert_eq!(&unpack(&packed(&samples, format), width, height, 0, format).unwrap(), &image);
            let stride = format.row_bytes(width) + padding;
            let rows = samples.chunks(width).flat_map(|row| {
                let mut row = packed(row, format);
                row.resize(stride, 0xff);
                row
            });
            prop_assert_eq!(unpack(&rows.collect::<Vec<u8>>(), width, height, stride, format).unwrap(), image);
        }

        #[test]
        fn no_buffer_breaks_it(
            buffer in proptest::collection::vec(any::<u8>(), 0..300),
            width in 0usize..20,
            height in 0usize..20,
            stride in 0usize..60,
            format in proptest::sample::select([PixelFormat::all(), PixelFormat::genicam()].concat()),
        ) {
            if let Ok(image) = unpack(&buffer, width, height, stride, format) {
                prop_assert_eq!((image.width(), image.height()), (width, height));
            }
        }
    }
}
