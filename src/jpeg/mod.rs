//! Greyscale JPEG: by libjpeg-turbo where the machine has it, and by an encoder in Rust where it has not.

mod turbo;

use std::sync::LazyLock;

pub use turbo::{TurboError, TurboJpeg};

/// What encodes.
pub enum Encoder {
    /// libjpeg-turbo.
    Turbo(TurboJpeg),
    /// The crate `jpeg-encoder`, with SIMD: takes about twice as long.
    Rust,
}

/// The encoder of this machine, looked for once.
static HERE: LazyLock<Encoder> = LazyLock::new(|| match TurboJpeg::load() {
    Ok(turbo) => Encoder::Turbo(turbo),
    Err(error) => {
        tracing::info!(%error, "pictures are encoded without libjpeg-turbo");
        Encoder::Rust
    }
});

impl Encoder {
    /// The fastest one that this machine has.
    #[must_use]
    pub fn here() -> &'static Self {
        &HERE
    }

    /// What it is called.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Turbo(_) => "libjpeg-turbo",
            Self::Rust => "jpeg-encoder",
        }
    }

    /// A picture of 8-bit samples, row after row from the top, at a quality of 1 to 100.
    ///
    /// # Errors
    /// In words, when there are not `width` times `height` samples, or JPEG has no room for so many columns or rows.
    pub fn grey(&self, samples: &[u8], width: usize, height: usize, quality: u8) -> Result<Vec<u8>, String> {
        let too_large = |_| format!("a frame of {width}x{height} is too large for JPEG");
        let (w, h) = (u16::try_from(width).map_err(too_large)?, u16::try_from(height).map_err(too_large)?);
        match self {
            Self::Turbo(turbo) => turbo.grey(samples, w, h, quality).map_err(|error| error.to_string()),
            Self::Rust => {
                let mut bytes = Vec::with_capacity(samples.len() / 4);
                jpeg_encoder::Encoder::new(&mut bytes, quality)
                    .encode(samples, w, h, jpeg_encoder::ColorType::Luma)
                    .map_err(|error| error.to_string())?;
                Ok(bytes)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Micro-images, with a texture in each and noise over all.
    fn samples(width: usize, height: usize) -> Vec<u8> {
        let mut noise = 1u32;
        let pixel = |index: usize| {
            let (x, y) = ((index % width) as f64, (index / width) as f64);
            let (dx, dy) = (x % 29.0 - 14.5, y % 29.0 - 14.5);
            let disc = if dx.hypot(dy) < 13.0 { 150.0 } else { 12.0 };
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise = f64::from(noise >> 24) / 32.0 - 4.0;
            (disc + 60.0 * (x / 3.7).sin() * (y / 5.1).cos() + noise).clamp(0.0, 255.0) as u8
        };
        (0..width * height).map(pixel).collect()
    }

    fn decoded(jpeg: &[u8]) -> image::GrayImage {
        let image = image::load_from_memory(jpeg).unwrap();
        assert_eq!(image.color(), image::ColorType::L8);
        image.into_luma8()
    }

    fn turbo() -> Encoder {
        Encoder::Turbo(TurboJpeg::load().expect("deploy/setup.sh test installs libturbojpeg0"))
    }

    #[test]
    fn both_encoders_make_the_same_picture() {
        let turbo = turbo();
        // Also sizes that are no multiples of a block, and one smaller than a block.
        for (width, height) in [(256, 128), (131, 77), (5, 3), (1, 1)] {
            let raw = samples(width, height);
            for quality in [10, 50, 80, 95, 100] {
                let [a, b] = [&turbo, &Encoder::Rust].map(|encoder| {
                    let jpeg = encoder.grey(&raw, width, height, quality).unwrap();
                    let picture = decoded(&jpeg);
                    assert_eq!((picture.width() as usize, picture.height() as usize), (width, height));
                    picture.into_raw()
                });
                // The same tables and the same transform: what is rounded the other way is a step of the table, and rare.
                let squares = |a: &[u8], b: &[u8]| {
                    let square = |(a, b): (&u8, &u8)| (f64::from(*a) - f64::from(*b)).powi(2);
                    a.iter().zip(b).map(square).sum::<f64>() / a.len() as f64
                };
                let (apart, lost) = (squares(&a, &b), squares(&a, &raw));
                assert!(apart <= 0.1 * lost + 0.5, "{width}x{height} at {quality}: {apart} apart, {lost} lost");
                assert!(
                    lost <= 1.1 * squares(&b, &raw) + 0.5,
                    "{width}x{height} at {quality}: libjpeg-turbo loses more, {lost}"
                );
            }
        }
    }

    #[test]
    fn a_lower_quality_takes_fewer_bytes() {
        let raw = samples(256, 256);
        for encoder in [turbo(), Encoder::Rust] {
            let length = |quality| encoder.grey(&raw, 256, 256, quality).unwrap().len();
            assert!(length(30) < length(80) && length(80) < length(95), "{}", encoder.name());
        }
    }

    #[test]
    fn what_cannot_be_encoded_is_said() {
        for encoder in [turbo(), Encoder::Rust] {
            assert!(encoder.grey(&[0; 11], 4, 3, 80).is_err(), "{}: too few samples", encoder.name());
            assert!(encoder.grey(&[], 0, 3, 80).is_err(), "{}: no columns", encoder.name());
            let wide = encoder.grey(&vec![0; 70_000], 70_000, 1, 80).unwrap_err();
            assert!(wide.contains("70000x1"), "{wide}");
        }
        // 65500 is what libjpeg has room for.
        assert!(turbo().grey(&vec![0; 65_535], 65_535, 1, 80).is_err());
    }

    #[test]
    fn threads_encode_side_by_side() {
        let turbo = turbo();
        let raw = samples(320, 240);
        let alone = turbo.grey(&raw, 320, 240, 80).unwrap();
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..20 {
                        assert_eq!(turbo.grey(&raw, 320, 240, 80).unwrap(), alone);
                    }
                });
            }
        });
    }
}
