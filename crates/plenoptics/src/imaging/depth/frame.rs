//! A frame made ready for depth: its micro-images, their neighbours, and what noise and range it has.

use rayon::prelude::*;

use super::Places;
use super::overlap::Disc;
use crate::imaging::grid::Grid;
use crate::imaging::spacing::{LEAST_PAIRS, MASK_FRACTION, SpacingError};
use crate::raw::{CfaPattern, Channel};

/// Pixels that interpolation and slopes reach beyond the discs that are compared.
const MARGIN_PX: f64 = 5.0;
/// About so many micro-images tell noise and range.
const SAMPLE: usize = 400;
/// Part of a disc that the noise is taken from: its edge may see the gap.
const NOISE_PART: f64 = 0.85;
/// What rounding to whole grey levels adds to a frame's noise, grey levels.
const QUANTISATION: f32 = 0.289;

/// One micro-image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lens {
    /// Lattice indices.
    pub(super) index: [i32; 2],
    /// Centre, px.
    pub(super) centre: [f64; 2],
}

/// A frame made ready for depth.
#[derive(Debug, Clone)]
pub struct DepthFrame<'a> {
    pub(super) grid: &'a Grid,
    /// Grey levels with the vignetting divided out, row by row.
    pub(super) values: &'a [f32],
    pub(super) width: usize,
    /// The mosaic of the sensor, of which only green pixels are a reference.
    pub(super) mosaic: Option<CfaPattern>,
    /// Micro-images wholly within the frame, row by row of the lattice.
    pub(super) lenses: Vec<Lens>,
    pub(super) places: Places,
    /// Nearest neighbours, each pair once.
    pub(super) pairs: Vec<[usize; 2]>,
    /// The pixels of a micro-image that are compared.
    pub(super) disc: Disc,
    /// Standard deviation of the noise, grey levels.
    pub(super) noise: f32,
    /// The brightest that micro-images show but for their brightest hundredth, grey levels: black is 0.
    pub(super) range: f32,
}

impl<'a> DepthFrame<'a> {
    /// Makes a frame ready whose vignetting is divided out, row by row. With a mosaic the values are those of green,
    /// interpolated where the sensor did not measure it.
    ///
    /// # Errors
    /// [`SpacingError`] where grid and values do not belong together, or there are too few micro-images.
    pub fn new(values: &'a [f32], mosaic: Option<CfaPattern>, grid: &'a Grid) -> Result<Self, SpacingError> {
        let [width, height] = grid.frame_size;
        if values.len() != width * height {
            let rows = values.len().checked_div(width).unwrap_or(0);
            return Err(SpacingError::WrongSize { frame: [width, rows], grid: grid.frame_size });
        }
        let disc = Disc::new(MASK_FRACTION * grid.pitch_px() / 2.0);
        let margin = disc.radius() + MARGIN_PX + 0.5;
        let lenses: Vec<Lens> =
            grid.micro_images_within(margin).map(|m| Lens { index: [m.i, m.j], centre: [m.x, m.y] }).collect();
        let places = Places::new(lenses.iter().map(|lens| lens.index));
        let mut pairs = Vec::with_capacity(lenses.len() * grid.neighbour_steps().len());
        for (first, lens) in lenses.iter().enumerate() {
            let next = |step: &[i32; 2]| places.of([lens.index[0] + step[0], lens.index[1] + step[1]]);
            pairs.extend(grid.neighbour_steps().iter().filter_map(next).map(|second| [first, second]));
        }
        if pairs.len() < LEAST_PAIRS {
            return Err(SpacingError::TooFewMicroImages { pairs: pairs.len(), needed: LEAST_PAIRS });
        }
        let mut frame = Self { grid, values, width, mosaic, lenses, places, pairs, disc, noise: 0.0, range: 0.0 };
        frame.noise = frame.noise_level().max(QUANTISATION);
        frame.range = frame.brightest();
        Ok(frame)
    }

    /// The pixel nearest a micro-image's centre.
    pub(super) fn nearest(&self, lens: usize) -> [i32; 2] {
        self.lenses[lens].centre.map(|x| x.round() as i32)
    }

    /// Whether the sensor measured the pixel in the colour that is compared.
    #[inline]
    pub(super) fn is_reference(&self, x: usize, y: usize) -> bool {
        self.mosaic.is_none_or(|pattern| pattern.channel(x, y) == Channel::Green)
    }

    /// A spread sample of the micro-images.
    fn sample(&self) -> impl IndexedParallelIterator<Item = usize> {
        // No divisor of a row's length: a sample along columns would see a few of them only.
        let step = (self.lenses.len() / SAMPLE).max(1) | 1;
        (0..self.lenses.len()).into_par_iter().step_by(step)
    }

    /// The lower quartile over micro-images of what a filter blind to planes and saddles leaves: it belongs to those
    /// without sharp texture. In a mosaic the filter is spread so that it meets pixels of one colour.
    fn noise_level(&self) -> f32 {
        let (values, width) = (self.values, self.width);
        let apart = if self.mosaic.is_some() { 2 } else { 1 };
        let disc = Disc::new(NOISE_PART * self.disc.radius());
        let mut variances: Vec<f32> = self
            .sample()
            .map(|lens| {
                let (mut sum, mut count) = (0.0f32, 0.0f32);
                for (x, y, n) in disc.rows(self.nearest(lens)) {
                    for k in (0..n).filter(|&k| self.is_reference(x + k, y)) {
                        let at = y * width + x + k;
                        let line = |k: usize| values[k - apart] - 2.0 * values[k] + values[k + apart];
                        let response = line(at - apart * width) - 2.0 * line(at) + line(at + apart * width);
                        sum += response * response;
                        count += 1.0;
                    }
                }
                // 36 is the sum of squares of the filter (1 −2 1) × (1 −2 1).
                sum / 36.0 / count.max(1.0)
            })
            .collect();
        let quartile = variances.len() / 4;
        variances.select_nth_unstable_by(quartile, f32::total_cmp).1.sqrt()
    }

    /// The 99th percentile of mean and two standard deviations of the micro-images.
    fn brightest(&self) -> f32 {
        let mut tops: Vec<f32> = self
            .sample()
            .map(|lens| {
                let (mut sum, mut squares, mut count) = (0.0f64, 0.0f64, 0.0f64);
                for (x, y, n) in self.disc.rows(self.nearest(lens)) {
                    for &value in &self.values[y * self.width + x..][..n] {
                        sum += f64::from(value);
                        squares += f64::from(value * value);
                    }
                    count += n as f64;
                }
                let mean = sum / count.max(1.0);
                (mean + 2.0 * (squares / count.max(1.0) - mean * mean).max(0.0).sqrt()) as f32
            })
            .collect();
        let place = tops.len() * 99 / 100;
        *tops.select_nth_unstable_by(place, f32::total_cmp).1
    }
}
