//! What is on the boards: periodic textures made by code, band-limited at every scale. They are grey; a sensor with
//! colour filters sees patches of colour on them.

mod charuco;
mod fish;
mod natural;
mod noise;

use std::sync::Arc;

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::raw::Channel;

/// Texels along a side: over two and a half times the field at the default scale, so that strips differ.
pub const SIDE: usize = 1024;

/// What is on a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Texture {
    /// A chessboard with marker-like squares.
    Charuco,
    /// Random, with the amplitude spectrum of natural scenes.
    Natural,
    /// A guppy: bright patches on a pale body over gravel.
    Guppy,
    /// An Oscar: dark body with bright blotches over plants.
    Oscar,
}

/// A periodic texture with its coarser levels. Values are reflectances, 0 to 1.
#[derive(Debug, Clone)]
pub struct TextureMap {
    texel: f64,
    levels: Vec<Level>,
    /// What red, green and blue pixels see, where that is not the grey.
    channels: Option<Arc<[TextureMap; 3]>>,
}

/// One level: a square of texels whose side is a power of two.
#[derive(Debug, Clone)]
pub struct Level {
    shift: u32,
    scale: f32,
    /// Each texel with its right, lower and lower right neighbour, a byte each: one load serves an interpolation.
    quads: Vec<u32>,
}

impl TextureMap {
    /// Makes a texture by its name in the configuration.
    ///
    /// `texel` is the side of a texel on the board, mm. The textures have detail down to about two texels: half of a
    /// pixel's footprint on the board ([`super::renderer::Tracer::footprint`]) shows detail at the scale of a
    /// micro-image's pixels.
    #[must_use]
    pub fn generate(kind: Texture, texel: f64, seed: u64) -> Self {
        Self::from_values(&values(kind, seed), texel)
    }

    /// As [`Self::generate`], with colours: in each channel the reflectance is the grey one times a factor from
    /// 1 − `colour` to 1 (0 to 1; 0 leaves all grey), whose smooth patches, a sixteenth of the period across and more, each
    /// channel has for itself.
    #[must_use]
    pub fn generate_coloured(kind: Texture, texel: f64, seed: u64, colour: f64) -> Self {
        let grey = values(kind, seed);
        let channel = |channel: Channel| {
            let seed = seed ^ 0xc010_0000_0000_0000 ^ (channel.index() as u64 + 1);
            let patches = noise::field(SIDE, seed, |x, y| if x.hypot(y) <= 8.0 { 1.0 } else { 0.0 });
            let share = |patch: f32| 1.0 - colour as f32 * (0.5 + 0.5 * patch.tanh());
            let tinted: Vec<f32> = grey.iter().zip(&patches).map(|(grey, &patch)| grey * share(patch)).collect();
            Self::from_values(&tinted, texel)
        };
        let channels = (colour > 0.0).then(|| Arc::new(Channel::ALL.map(channel)));
        Self { channels, ..Self::from_values(&grey, texel) }
    }

    /// A texture from its texels, row by row: the square of a power of two of them, reflectances from 0 to 1.
    ///
    /// # Panics
    /// If their number is not the square of a power of two: a mistake of the caller's.
    #[must_use]
    pub fn from_values(values: &[f32], texel: f64) -> Self {
        let side = values.len().isqrt();
        assert!(side.is_power_of_two() && side * side == values.len(), "{} texels are no square of 2^n", values.len());
        let mut levels = vec![Level::new(values, side, texel)];
        let mut finer = values.to_vec();
        let mut size = side;
        while size > 1 {
            size /= 2;
            finer = halved(&finer, size);
            levels.push(Level::new(&finer, size, texel * (side / size) as f64));
        }
        Self { texel, levels, channels: None }
    }

    /// What a channel's pixels see of it, with the same texels; `None` for monochrome ones.
    #[must_use]
    pub fn in_channel(&self, channel: Option<Channel>) -> &Self {
        match (&self.channels, channel) {
            (Some(channels), Some(channel)) => &channels[channel.index()],
            _ => self,
        }
    }

    /// Side of a texel, mm.
    #[must_use]
    pub const fn texel(&self) -> f64 {
        self.texel
    }

    /// Period of the texture, mm.
    #[must_use]
    pub fn side(&self) -> f64 {
        self.texel * f64::from(1u32 << self.levels[0].shift)
    }

    /// The level whose texels are 2^`level` times as wide as the finest ones, or the coarsest there is.
    #[must_use]
    pub fn level(&self, level: usize) -> &Level {
        &self.levels[level.min(self.levels.len() - 1)]
    }
}

/// The texels of a texture by its name.
fn values(kind: Texture, seed: u64) -> Vec<f32> {
    match kind {
        Texture::Charuco => charuco::generate(SIDE, seed),
        Texture::Natural => natural::generate(SIDE, seed),
        Texture::Guppy => fish::guppy(SIDE, seed),
        Texture::Oscar => fish::oscar(SIDE, seed),
    }
}

/// Means of two by two texels.
fn halved(finer: &[f32], size: usize) -> Vec<f32> {
    let mut coarse = vec![0.0; size * size];
    for y in 0..size {
        for x in 0..size {
            let at = |dx: usize, dy: usize| finer[(2 * y + dy) * 2 * size + 2 * x + dx];
            coarse[y * size + x] = 0.25 * (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1));
        }
    }
    coarse
}

impl Level {
    fn new(values: &[f32], size: usize, texel: f64) -> Self {
        let bytes: Vec<u32> = values.iter().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u32).collect();
        let mask = size - 1;
        let quads = (0..size * size)
            .into_par_iter()
            .map(|k| {
                let (x, y) = (k & mask, k / size);
                let at = |dx: usize, dy: usize| bytes[((y + dy) & mask) * size + ((x + dx) & mask)];
                at(0, 0) | at(1, 0) << 8 | at(0, 1) << 16 | at(1, 1) << 24
            })
            .collect();
        Self { shift: size.trailing_zeros(), scale: (1.0 / texel) as f32, quads }
    }

    /// Reflectances at places on the board (mm), interpolated between texel centres; the texture repeats for ever.
    /// The slices have one length.
    #[inline(always)]
    pub fn sample(&self, xs: &[f32], ys: &[f32], out: &mut [f32]) {
        const BLOCK: usize = 64;
        // 1.5 · 2²³: added to a whole number of less than 2²², it leaves that number in the lowest bits.
        const WHOLE: f32 = 12_582_912.0;
        let mask = (1u32 << self.shift) - 1;
        for ((xs, ys), out) in xs.chunks(BLOCK).zip(ys.chunks(BLOCK)).zip(out.chunks_mut(BLOCK)) {
            let mut index = [0u32; BLOCK];
            let mut quad = [0u32; BLOCK];
            let mut right = [0.0f32; BLOCK];
            let mut down = [0.0f32; BLOCK];
            let n = out.len().min(xs.len()).min(ys.len());
            for i in 0..n {
                // A texel's centre is half a texel from its edge. Far outside (or not a number) anything will do.
                let x = bounded(xs[i] * self.scale - 0.5);
                let y = bounded(ys[i] * self.scale - 0.5);
                let (left, top) = (x.floor(), y.floor());
                right[i] = x - left;
                down[i] = y - top;
                let texel = |place: f32| (place + WHOLE).to_bits() & mask;
                index[i] = (texel(top) << self.shift) | texel(left);
            }
            for i in 0..n {
                quad[i] = self.quads[index[i] as usize];
            }
            for i in 0..n {
                let corner = |k: u32| ((quad[i] >> (8 * k)) & 255) as i32 as f32;
                let above = corner(0) + (corner(1) - corner(0)) * right[i];
                let below = corner(2) + (corner(3) - corner(2)) * right[i];
                out[i] = (above + (below - above) * down[i]) * (1.0 / 255.0);
            }
        }
    }
}

/// Within a million texels, and a number even where the place is none (`clamp` would keep NaN).
#[inline(always)]
#[allow(clippy::manual_clamp)]
fn bounded(place: f32) -> f32 {
    place.max(-1.0e6).min(1.0e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(level: &Level, x: f32, y: f32) -> f32 {
        let mut out = [0.0];
        level.sample(&[x], &[y], &mut out);
        out[0]
    }

    #[test]
    fn places_between_texels_are_interpolated_and_the_texture_repeats() {
        let map = TextureMap::from_values(&[0.0, 1.0, 0.2, 0.6], 2.0);
        let finest = map.level(0);
        assert_eq!(map.side(), 4.0);
        assert!((at(finest, 1.0, 1.0) - 0.0).abs() < 1e-6);
        assert!((at(finest, 3.0, 1.0) - 1.0).abs() < 1e-6);
        assert!((at(finest, 2.0, 2.0) - 0.45).abs() < 1e-6);
        assert!((at(finest, 2.0 - 40.0, 2.0 + 400.0) - 0.45).abs() < 1e-6);
        assert!((at(map.level(7), 0.3, 0.9) - 0.45).abs() < 3e-3);
        assert!(at(finest, f32::NAN, f32::INFINITY).is_finite());
    }

    #[test]
    fn channels_are_the_grey_texture_in_patches_of_their_own_colour() {
        let map = TextureMap::generate_coloured(Texture::Natural, 1.0, 5, 0.4);
        let grey = TextureMap::generate(Texture::Natural, 1.0, 5);
        assert_eq!(map.in_channel(None).levels[0].quads, grey.levels[0].quads);
        let bytes = |map: &TextureMap| map.levels[0].quads.iter().map(|q| f64::from(q & 255)).collect::<Vec<f64>>();
        let of_grey = bytes(&grey);
        let ratios = Channel::ALL.map(|channel| {
            let tinted = bytes(map.in_channel(Some(channel)));
            tinted.iter().zip(&of_grey).map(|(t, g)| t / g.max(1.0)).collect::<Vec<f64>>()
        });
        // Neighbouring bright texels have nearly one ratio: the colour is smooth, the detail the grey's.
        for (ratio, &grey) in ratios.iter().flat_map(|channel| channel.iter().zip(&of_grey)) {
            assert!(grey < 60.0 || (0.58..=1.01).contains(ratio), "{ratio}");
        }
        let bright: Vec<usize> =
            (0..SIDE * SIDE - 1).filter(|&k| of_grey[k] > 100.0 && of_grey[k + 1] > 100.0).collect();
        let steps = bright.iter().map(|&k| (ratios[0][k + 1] - ratios[0][k]).abs()).sum::<f64>() / bright.len() as f64;
        let spread =
            |a: &[f64], b: &[f64]| bright.iter().map(|&k| (a[k] - b[k]).powi(2)).sum::<f64>() / bright.len() as f64;
        assert!(steps < 0.01, "{steps}");
        assert!(spread(&ratios[0], &ratios[1]) > 0.005 && spread(&ratios[1], &ratios[2]) > 0.005);
        let plain = TextureMap::generate_coloured(Texture::Natural, 1.0, 5, 0.0);
        assert_eq!(plain.in_channel(Some(Channel::Blue)).levels[0].quads, grey.levels[0].quads);
    }

    #[test]
    fn every_texture_is_reproducible_and_has_contrast_at_fine_and_coarse_scales() {
        for kind in [Texture::Charuco, Texture::Natural, Texture::Guppy, Texture::Oscar] {
            let map = TextureMap::generate(kind, 1.0, 5);
            let again = TextureMap::generate(kind, 1.0, 5);
            assert_eq!(map.levels[0].quads, again.levels[0].quads, "{kind:?}");
            for (level, least) in [(1, 0.12), (3, 0.08), (5, 0.03)] {
                let values: Vec<f64> = map.levels[level].quads.iter().map(|q| f64::from(q & 255) / 255.0).collect();
                let mean = values.iter().sum::<f64>() / values.len() as f64;
                let sigma = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt();
                assert!((0.2..0.8).contains(&mean), "{kind:?} at level {level}: mean {mean}");
                assert!(sigma > least, "{kind:?} at level {level}: contrast {sigma}");
            }
        }
    }
}
