//! Packed pixels, read one by one.

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
    let good =
        jpeg(jpeg_encoder::ColorType::Luma, &(0..128).map(|i| i * 37 % 251).map(|v: u32| v as u8).collect::<Vec<_>>());
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
