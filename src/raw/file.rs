//! Raw frames from and to files: PNG, TIFF and PGM, 8 and 16 bits, monochrome.

use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageError, ImageReader};

use super::{RawImage, Samples};

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

/// Reads a raw frame. 16-bit files are taken as 16 bits deep.
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
    let picture = ImageReader::open(path).map_err(io)?.with_guessed_format().map_err(io)?.decode().map_err(decode)?;
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    match picture {
        DynamicImage::ImageLuma8(buffer) => Ok(RawImage::from_u8(width, height, buffer.into_raw())),
        DynamicImage::ImageLuma16(buffer) => Ok(RawImage::from_u16(width, height, 16, buffer.into_raw())),
        other => Err(RawFileError::NotMonochrome { path: path.to_owned(), found: format!("{:?}", other.color()) }),
    }
}

/// Writes a raw frame in the format that the file's extension names.
///
/// # Errors
/// [`RawFileError::UnknownFormat`] for another extension, [`RawFileError::Io`] when the disk refuses.
pub fn write(path: &Path, raw: &RawImage) -> Result<(), RawFileError> {
    let known = path
        .extension()
        .and_then(|e| e.to_str())
        .is_some_and(|e| ["png", "tif", "tiff", "pgm"].contains(&e.to_ascii_lowercase().as_str()));
    if !known {
        return Err(RawFileError::UnknownFormat { path: path.to_owned() });
    }
    let (width, height) = (raw.width() as u32, raw.height() as u32);
    let saved = match raw.samples() {
        Samples::U8(samples) => image::save_buffer(path, samples, width, height, image::ColorType::L8),
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
