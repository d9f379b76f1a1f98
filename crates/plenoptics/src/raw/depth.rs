//! How files say that of their 16 bits a sample only 9 to 15 are significant.
//!
//! | format | says it by | samples in the file |
//! |---|---|---|
//! | PNG | sBIT chunk | scaled to 16 bits: the value in the high bits, its own high bits repeated below |
//! | TIFF | MaxSampleValue tag (281) | as they are |
//! | PGM | maxval | as they are |

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Write as _};
use std::path::Path;

use image::codecs::pnm::{GraymapHeader, PnmDecoder, PnmEncoder, SampleEncoding};
use image::error::{EncodingError, ImageFormatHint};
use image::{ExtendedColorType, ImageEncoder as _, ImageError, ImageFormat, ImageResult};
use tiff::decoder::Decoder as TiffDecoder;
use tiff::encoder::{TiffEncoder, colortype::Gray16};
use tiff::tags::Tag;

use super::RawImage;

/// What a file says of its samples' depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stated {
    /// Nothing.
    Nothing,
    /// So many bits, and the decoded samples are scaled to 16 of them.
    Scaled(u8),
    /// So many bits, and the samples are as they are.
    AsTheyAre(u8),
}

/// What the file says. A header that the second reading cannot make sense of says nothing.
pub(super) fn stated(path: &Path, format: Option<ImageFormat>) -> io::Result<Stated> {
    let file = BufReader::new(File::open(path)?);
    let bits = |white: u64| white.checked_add(1).filter(|levels| levels.is_power_of_two()).map(u64::ilog2);
    let depth = |bits: Option<u32>| bits.and_then(|bits| u8::try_from(bits).ok()).filter(|bits| (9..16).contains(bits));
    let stated = match format {
        Some(ImageFormat::Png) => {
            let reader = png::Decoder::new(file).read_info().ok();
            let bits = reader.and_then(|reader| reader.info().sbit.as_ref().and_then(|bits| bits.first().copied()));
            depth(bits.map(u32::from)).map(Stated::Scaled)
        }
        Some(ImageFormat::Pnm) => {
            // The decoder scales by 65535/maxval and rounds.
            let white = PnmDecoder::new(file).ok().map(|decoder| u64::from(decoder.into_inner().1.maximal_sample()));
            depth(white.and_then(bits)).map(Stated::Scaled)
        }
        Some(ImageFormat::Tiff) => {
            let white = TiffDecoder::new(file)
                .ok()
                .and_then(|mut decoder| decoder.find_tag_unsigned::<u64>(Tag::MaxSampleValue).ok().flatten());
            depth(white.and_then(bits)).map(Stated::AsTheyAre)
        }
        _ => None,
    };
    Ok(stated.unwrap_or(Stated::Nothing))
}

/// The samples at the depth stated, and that depth: 16 bits where nothing is stated or the samples belie it.
pub(super) fn significant(stated: Stated, samples: Vec<u16>) -> (u8, Vec<u16>) {
    match stated {
        Stated::AsTheyAre(bits) if samples.iter().all(|&sample| sample >> bits == 0) => (bits, samples),
        Stated::Scaled(bits) => {
            // Whether by repeating bits or by multiplying and rounding: the high bits are the value. Values that
            // neither would give were never scaled.
            let value = |sample: u16| sample >> (16 - bits);
            let honest = |&sample: &u16| {
                let value = value(sample);
                sample.abs_diff(multiplied(value, bits)) <= 1
                    || sample == repeated(value, bits)
                    || sample == value << (16 - bits)
            };
            if samples.iter().all(honest) { (bits, samples.into_iter().map(value).collect()) } else { (16, samples) }
        }
        _ => (16, samples),
    }
}

/// A value of `bits` bits in the high ones of 16, its own high bits repeated below.
const fn repeated(value: u16, bits: u8) -> u16 {
    let high = value << (16 - bits);
    high | high >> bits
}

/// A value of `bits` bits times 65535/(2^bits − 1), rounded.
const fn multiplied(value: u16, bits: u8) -> u16 {
    let white = (1u32 << bits) - 1;
    ((value as u32 * 65535 + white / 2) / white) as u16
}

/// Writes samples of 9 to 15 bits with their depth stated.
pub(super) fn write(path: &Path, format: ImageFormat, raw: &RawImage, samples: &[u16]) -> ImageResult<()> {
    let (width, height) = (raw.width() as u32, raw.height() as u32);
    let mut file = BufWriter::new(File::create(path)?);
    match format {
        ImageFormat::Png => write_png(&mut file, raw, samples).map_err(|error| match error {
            png::EncodingError::IoError(error) => ImageError::IoError(error),
            error => encoding(format, error),
        })?,
        ImageFormat::Tiff => write_tiff(&mut file, raw, samples).map_err(|error| match error {
            tiff::TiffError::IoError(error) => ImageError::IoError(error),
            error => encoding(format, error),
        })?,
        _ => {
            let white = u32::from(raw.white_level());
            let header = GraymapHeader { encoding: SampleEncoding::Binary, width, height, maxwhite: white };
            let bytes: Vec<u8> = samples.iter().flat_map(|sample| sample.to_ne_bytes()).collect();
            let encoder = PnmEncoder::new(&mut file).with_header(header.into());
            encoder.write_image(&bytes, width, height, ExtendedColorType::L16)?;
        }
    }
    Ok(file.flush()?)
}

fn encoding(format: ImageFormat, error: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> ImageError {
    ImageError::Encoding(EncodingError::new(ImageFormatHint::Exact(format), error))
}

fn write_png(file: &mut BufWriter<File>, raw: &RawImage, samples: &[u16]) -> Result<(), png::EncodingError> {
    let mut encoder = png::Encoder::new(file, raw.width() as u32, raw.height() as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let mut writer = encoder.write_header()?;
    writer.write_chunk(png::chunk::sBIT, &[raw.bits()])?;
    let bytes: Vec<u8> = samples.iter().flat_map(|&sample| repeated(sample, raw.bits()).to_be_bytes()).collect();
    writer.write_image_data(&bytes)?;
    writer.finish()
}

fn write_tiff(file: &mut BufWriter<File>, raw: &RawImage, samples: &[u16]) -> Result<(), tiff::TiffError> {
    let mut encoder = TiffEncoder::new(file)?;
    let mut picture = encoder.new_image::<Gray16>(raw.width() as u32, raw.height() as u32)?;
    picture.encoder().write_tag(Tag::MaxSampleValue, raw.white_level())?;
    picture.write_data(samples)
}
