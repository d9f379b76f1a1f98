//! Raw frames from and to files: PNG, TIFF and PGM, monochrome, 8 bits and up to 16.

use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageError, ImageFormat, ImageReader};

use super::{RawImage, Samples, depth};

/// Why a raw frame's file could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum RawFileError {
    /// The file is missing, cannot be opened, or the disk refuses.
    #[error("cannot read or write {path}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not a picture of a kind this program reads, or is damaged.
    #[error("{path}: not a readable PNG, TIFF or PGM picture", path = path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        source: ImageError,
    },
    /// The picture has colours or a sample type that a raw monochrome frame does not have.
    #[error("{path}: a raw frame is monochrome with 8 or 16 bits a pixel; this picture is {found}", path = path.display())]
    NotMonochrome {
        /// The file.
        path: PathBuf,
        /// The colour type found.
        found: String,
    },
    /// The file's extension names no format that can be written.
    #[error("{path}: cannot write this format; the name must end in .png, .tiff or .pgm", path = path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
}

/// Reads a raw frame. Two bytes a sample are taken as 16 bits, unless the file says that fewer are significant: a PNG by
/// its sBIT chunk, a TIFF by MaxSampleValue, a PGM by its maxval. So a frame of 9 to 15 bits that [`write()`] wrote comes
/// back as it was; one that another program left in the low bits, without a word in the file, cannot be told from a dark
/// frame of 16 bits.
///
/// # Errors
/// [`RawFileError`] names the file and what is wrong with it.
pub fn read(path: &Path) -> Result<RawImage, RawFileError> {
    let io = |source| RawFileError::Io { path: path.to_owned(), source };
    let decode = |source| match source {
        ImageError::IoError(source) if source.kind() != std::io::ErrorKind::UnexpectedEof => {
            RawFileError::Io { path: path.to_owned(), source }
        }
        source => RawFileError::Decode { path: path.to_owned(), source },
    };
    let reader = ImageReader::open(path).map_err(io)?.with_guessed_format().map_err(io)?;
    let format = reader.format();
    let picture = reader.decode().map_err(decode)?;
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    match picture {
        DynamicImage::ImageLuma8(buffer) => Ok(RawImage::from_u8(width, height, buffer.into_raw())),
        DynamicImage::ImageLuma16(buffer) => {
            let stated = depth::stated(path, format).map_err(io)?;
            let (bits, samples) = depth::significant(stated, buffer.into_raw());
            Ok(RawImage::from_u16(width, height, bits, samples))
        }
        other => Err(RawFileError::NotMonochrome { path: path.to_owned(), found: format!("{:?}", other.color()) }),
    }
}

/// Writes a raw frame in the format that the file's extension names, with its depth as [`read`] understands it.
///
/// # Errors
/// [`RawFileError::UnknownFormat`] for another extension, [`RawFileError::Io`] when the disk refuses.
pub fn write(path: &Path, raw: &RawImage) -> Result<(), RawFileError> {
    let format = match path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
        Some("png") => ImageFormat::Png,
        Some("tif" | "tiff") => ImageFormat::Tiff,
        Some("pgm") => ImageFormat::Pnm,
        _ => return Err(RawFileError::UnknownFormat { path: path.to_owned() }),
    };
    let (width, height) = (raw.width() as u32, raw.height() as u32);
    let saved = match raw.samples() {
        Samples::U8(samples) => image::save_buffer(path, samples, width, height, image::ColorType::L8),
        Samples::U16(samples) if raw.bits() < 16 => depth::write(path, format, raw, samples),
        Samples::U16(samples) => {
            let bytes: Vec<u8> = samples.iter().flat_map(|s| s.to_ne_bytes()).collect();
            image::save_buffer(path, &bytes, width, height, image::ColorType::L16)
        }
    };
    saved.map_err(|source| match source {
        ImageError::IoError(source) => RawFileError::Io { path: path.to_owned(), source },
        source => RawFileError::Decode { path: path.to_owned(), source },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_survive_every_format() {
        let folder = tempfile::tempdir().unwrap();
        let shallow = RawImage::from_u8(3, 2, vec![0, 50, 100, 150, 200, 255]);
        let deep = RawImage::from_u16(2, 2, 16, vec![0, 1, 4095, 65535]);
        for name in ["a.png", "a.tiff", "a.pgm"] {
            let path = folder.path().join(name);
            write(&path, &shallow).unwrap();
            assert_eq!(read(&path).unwrap(), shallow, "{name}");
            write(&path, &deep).unwrap();
            assert_eq!(read(&path).unwrap(), deep, "{name}");
        }
    }

    #[test]
    fn frames_of_ten_and_twelve_bits_keep_their_white_level() {
        let folder = tempfile::tempdir().unwrap();
        for bits in [9, 10, 12, 15] {
            let white = (1u16 << bits) - 1;
            let bright: Vec<u16> = (0..=white).step_by(7).chain([white]).collect();
            let dark: Vec<u16> = (0..200).collect();
            for samples in [bright, dark] {
                let frame = RawImage::from_u16(samples.len(), 1, bits, samples);
                for name in ["a.png", "a.tiff", "a.tif", "a.pgm"] {
                    let path = folder.path().join(name);
                    write(&path, &frame).unwrap();
                    let back = read(&path).unwrap();
                    assert_eq!(back.white_level(), white, "{name}");
                    assert_eq!(back, frame, "{name} of {bits} bits");
                }
            }
        }
    }

    #[test]
    fn a_stated_depth_that_the_samples_do_not_have_is_not_believed() {
        let folder = tempfile::tempdir().unwrap();
        // A PNG whose sBIT says 12 bits, with the values in the low bits instead of the high ones.
        let path = folder.path().join("low.png");
        let mut encoder = png::Encoder::new(std::fs::File::create(&path).unwrap(), 3, 1);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Sixteen);
        let mut writer = encoder.write_header().unwrap();
        writer.write_chunk(png::chunk::sBIT, &[12]).unwrap();
        writer.write_image_data(&[0, 5, 15, 255, 7, 1]).unwrap();
        writer.finish().unwrap();
        assert_eq!(read(&path).unwrap(), RawImage::from_u16(3, 1, 16, vec![5, 4095, 1793]));
        // A maxval that is no depth: the values scale to 16 bits.
        let path = folder.path().join("odd.pgm");
        std::fs::write(&path, b"P5\n2 1\n1000\n\x03\xe8\x01\xf4").unwrap();
        assert_eq!(read(&path).unwrap(), RawImage::from_u16(2, 1, 16, vec![65535, 32768]));
    }

    #[test]
    fn a_wrong_file_is_named_with_its_fault() {
        let folder = tempfile::tempdir().unwrap();
        let missing = read(&folder.path().join("none.png")).unwrap_err();
        assert!(matches!(missing, RawFileError::Io { .. }), "{missing}");
        let text = folder.path().join("text.png");
        std::fs::write(&text, "no picture at all").unwrap();
        assert!(matches!(read(&text).unwrap_err(), RawFileError::Decode { .. }));
        let colour = folder.path().join("colour.png");
        image::RgbImage::new(4, 4).save(&colour).unwrap();
        assert!(matches!(read(&colour).unwrap_err(), RawFileError::NotMonochrome { .. }));
        let raw = RawImage::from_u8(1, 1, vec![0]);
        assert!(matches!(write(&folder.path().join("x.gif"), &raw).unwrap_err(), RawFileError::UnknownFormat { .. }));
    }
}
