//! Raw frames as Foxglove's messages, to the last bit, and back.

use super::foxglove;
use plenoptics::raw::{CfaPattern, RawImage, Samples};

/// Frame of reference of the camera's pictures.
const FRAME_ID: &str = "camera";

/// A frame as a message. Depths above 8 bits are two bytes a pixel, little-endian, the value in the low bits.
#[must_use]
pub fn raw_message(image: &RawImage, taken: jiff::Timestamp, mosaic: Option<CfaPattern>) -> foxglove::RawImage {
    let (encoding, bytes, data) = match (image.samples(), mosaic) {
        (Samples::U8(samples), mosaic) => (mosaic.map_or("mono8", bayer), 1, samples.clone()),
        (Samples::U16(samples), _) => ("mono16", 2, samples.iter().flat_map(|sample| sample.to_le_bytes()).collect()),
    };
    foxglove::RawImage {
        timestamp: Some(super::stamp(taken)),
        frame_id: FRAME_ID.to_owned(),
        // Frames are far below four thousand million pixels wide.
        width: image.width() as u32,
        height: image.height() as u32,
        encoding: encoding.to_owned(),
        step: (image.width() * bytes) as u32,
        data: data.into(),
    }
}

fn bayer(pattern: CfaPattern) -> &'static str {
    match pattern {
        CfaPattern::Rggb => "bayer_rggb8",
        CfaPattern::Bggr => "bayer_bggr8",
        CfaPattern::Grbg => "bayer_grbg8",
        CfaPattern::Gbrg => "bayer_gbrg8",
    }
}

/// The frame in a message; `bits` are the significant ones of a 16-bit pixel, where they are known.
///
/// # Errors
/// Why it is no frame of one sample a pixel, in words.
pub fn raw_image(message: &foxglove::RawImage, bits: Option<u32>) -> Result<RawImage, String> {
    let (width, height, step) = (message.width as usize, message.height as usize, message.step as usize);
    let bytes = match message.encoding.as_str() {
        "mono8" | "8UC1" | "bayer_rggb8" | "bayer_bggr8" | "bayer_grbg8" | "bayer_gbrg8" => 1,
        "mono16" | "16UC1" => 2,
        other => return Err(format!("its pixels are {other:?}; mono8, mono16 and bayer_…8 can be read")),
    };
    let row = width.checked_mul(bytes).filter(|&row| row > 0 && row <= step);
    let (Some(row), Some(whole)) = (row, step.checked_mul(height).filter(|&whole| whole > 0)) else {
        return Err(format!("its size of {width}x{height} pixels does not fit rows of {step} bytes"));
    };
    // The last row may do without its padding.
    if message.data.len() < whole - (step - row) {
        return Err(format!("it has {} bytes, and {width}x{height} pixels need {whole}", message.data.len()));
    }
    let rows = message.data.chunks(step).take(height);
    let samples = rows.flat_map(|line| &line[..row]);
    if bytes == 1 {
        return Ok(RawImage::from_u8(width, height, samples.copied().collect()));
    }
    let bits = bits.unwrap_or(16);
    let Some(depth) = u8::try_from(bits).ok().filter(|bits| (9..=16).contains(bits)) else {
        return Err(format!("its pixels have two bytes and are said to have {bits} bits"));
    };
    let pairs: Vec<u8> = samples.copied().collect();
    let samples = pairs.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
    Ok(RawImage::from_u16(width, height, depth, samples))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_comes_back_to_the_last_bit() {
        let taken = jiff::Timestamp::UNIX_EPOCH;
        let eight = RawImage::from_u8(5, 3, (0..15).map(|i| i * 17).collect());
        for mosaic in [None, Some(CfaPattern::Grbg)] {
            assert_eq!(raw_image(&raw_message(&eight, taken, mosaic), Some(8)).unwrap(), eight);
        }
        let twelve = RawImage::from_u16(5, 3, 12, (0..15).map(|i| i * 273).collect());
        assert_eq!(raw_image(&raw_message(&twelve, taken, None), Some(12)).unwrap(), twelve);
    }

    #[test]
    fn rows_may_be_padded_and_what_does_not_fit_is_refused() {
        let mut message = foxglove::RawImage {
            width: 2,
            height: 2,
            step: 3,
            encoding: "mono8".to_owned(),
            data: vec![1, 2, 99, 3, 4].into(),
            ..Default::default()
        };
        assert_eq!(raw_image(&message, None).unwrap(), RawImage::from_u8(2, 2, vec![1, 2, 3, 4]));
        message.data = vec![1, 2, 99, 3].into();
        assert!(raw_image(&message, None).unwrap_err().contains("4 bytes"));
        message.step = 1;
        assert!(raw_image(&message, None).unwrap_err().contains("rows of 1 bytes"));
        message.encoding = "rgb8".to_owned();
        assert!(raw_image(&message, None).unwrap_err().contains("rgb8"));
        let deep = foxglove::RawImage {
            width: 1,
            height: 1,
            step: 2,
            encoding: "mono16".to_owned(),
            data: vec![1, 2].into(),
            ..Default::default()
        };
        assert!(raw_image(&deep, Some(40)).unwrap_err().contains("40 bits"));
    }
}
