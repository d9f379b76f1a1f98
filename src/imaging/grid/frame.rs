//! A frame in logarithm, and the refusals that need no lattice.

use rayon::prelude::*;

use super::{GridError, GridOptions};
use crate::raw::{RawImage, Samples};

/// Share of pixels at the frame's maximum above which a frame counts as saturated. A well-lit white frame has far
/// fewer; beyond it the plateaus of the micro-images are clipped.
const SATURATED_SHARE: f64 = 0.3;

/// How many noise sigmas the grey levels (1st to 99th percentile) must spread over: pure Gaussian noise spreads 4.65,
/// uniform noise 3.4.
const SPREAD_LEAST: f64 = 6.0;

/// Floor under the logarithm, as a share of the spread of grey levels: keeps the noise of dark gaps and dark textures
/// from outweighing the gaps themselves.
const FLOOR_SHARE: f64 = 0.2;

/// The logarithm of a frame above its dark level, row by row.
#[derive(Debug, Clone)]
pub struct LogFrame {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Logarithm of the grey levels, natural.
    pub values: Vec<f32>,
}

/// Grey levels of a frame, from a sample of its rows.
struct Levels {
    dark: f64,
    bright: f64,
    noise: f64,
    maximum: u16,
    share_at_maximum: f64,
}

impl LogFrame {
    /// Takes the logarithm of a frame that has something in it.
    ///
    /// # Errors
    /// [`GridError::TooSmall`], [`GridError::Blank`], [`GridError::Saturated`].
    pub fn new(image: &RawImage, options: &GridOptions) -> Result<Self, GridError> {
        let (width, height) = (image.width(), image.height());
        let least = (4.0 * options.pitch_px[0]).ceil().max(16.0) as usize;
        if width < least || height < least {
            return Err(GridError::TooSmall { width, height, least });
        }
        let levels = Levels::of(image);
        let spread = levels.bright - levels.dark;
        // The blank frame first: where every pixel is the same, every pixel is at the maximum.
        let blank = spread < SPREAD_LEAST * levels.noise.max(0.3);
        // A plateau below full scale is a clipped one only where noise would have broken it up otherwise.
        let clipped = is_full_scale(levels.maximum) || (!blank && levels.noise > 0.0);
        if levels.share_at_maximum > SATURATED_SHARE && clipped {
            return Err(GridError::Saturated {
                percent: 100.0 * levels.share_at_maximum,
                level: levels.maximum,
                limit: 100.0 * SATURATED_SHARE,
            });
        }
        if blank {
            return Err(GridError::Blank { spread, noise: levels.noise });
        }
        let floor = FLOOR_SHARE * spread + 2.0 * levels.noise;
        let table: Vec<f32> = (0..=usize::from(levels.maximum))
            .map(|level| ((level as f64 - levels.dark).max(0.0) + floor).ln() as f32)
            .collect();
        let top = table.len() - 1;
        let mut values = vec![0.0; width * height];
        let rows = values.par_chunks_mut(width);
        match image.samples() {
            Samples::U8(samples) => rows.zip(samples.par_chunks(width)).for_each(|(row, from)| {
                row.iter_mut().zip(from).for_each(|(v, &s)| *v = table[usize::from(s).min(top)]);
            }),
            Samples::U16(samples) => rows.zip(samples.par_chunks(width)).for_each(|(row, from)| {
                row.iter_mut().zip(from).for_each(|(v, &s)| *v = table[usize::from(s).min(top)]);
            }),
        }
        Ok(Self { width, height, values })
    }
}

impl Levels {
    fn of(image: &RawImage) -> Self {
        match image.samples() {
            Samples::U8(samples) => Self::count(image.width(), samples, u16::from),
            Samples::U16(samples) => Self::count(image.width(), samples, |s| s),
        }
    }

    fn count<T: Copy + Ord + Send + Sync>(width: usize, samples: &[T], level: impl Fn(T) -> u16) -> Self {
        let maximum = samples.par_iter().copied().max().map_or(0, &level);
        let rows = samples.len() / width;
        let step = rows.div_ceil(256).max(1);
        let mut values: Vec<u16> = Vec::new();
        let mut jumps: Vec<u16> = Vec::new();
        for row in samples.chunks_exact(width).step_by(step) {
            values.extend(row.iter().map(|&s| level(s)));
            // Second differences: a smooth slope is no noise.
            jumps.extend(row.windows(3).map(|w| {
                let (a, b, c) = (i32::from(level(w[0])), i32::from(level(w[1])), i32::from(level(w[2])));
                (a - 2 * b + c).unsigned_abs().min(u32::from(u16::MAX)) as u16
            }));
        }
        let at_maximum = values.iter().filter(|&&v| v == maximum).count();
        let share_at_maximum = at_maximum as f64 / values.len().max(1) as f64;
        // Second differences of white noise scatter by sqrt(6) sigma. The lower quartile (0.319 sigma for a Gaussian)
        // comes from the flattest parts, where texture enters least.
        let quartile = quantile(&mut jumps, 0.25);
        let noise = (quartile + 0.5) / 0.319 / 6f64.sqrt();
        let noise = if quartile > 0.0 { noise } else { 0.0 };
        Self {
            dark: quantile(&mut values, 0.01),
            bright: quantile(&mut values, 0.99),
            noise,
            maximum,
            share_at_maximum,
        }
    }
}

/// Whether a level is the greatest of a converter of 8 to 16 bits.
fn is_full_scale(level: u16) -> bool {
    level >= 255 && (u32::from(level) + 1).is_power_of_two()
}

fn quantile(values: &mut [u16], q: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let rank = ((values.len() - 1) as f64 * q) as usize;
    f64::from(*values.select_nth_unstable(rank).1)
}
