//! A frame seen in logarithm, and the refusals that need no lattice.

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

/// Depth to which samples enter the table of logarithms: its steps are far below the noise of any sensor.
const TABLE_BITS: u32 = 12;

/// Pixels from which [`Frame::glanced`] takes the levels, and how many of them lie side by side.
const GLANCE_PIXELS: usize = 8192;
const GLANCE_RUN: usize = 64;

/// A frame's pixels, read as logarithms or as levels above its dark one where they are asked for: the frame is not
/// copied.
pub(super) struct Frame<'a> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    samples: &'a Samples,
    /// Natural logarithms of the levels without their last `dropped_bits`.
    table: Vec<f32>,
    dropped_bits: u32,
    dark: f32,
}

impl<'a> Frame<'a> {
    /// A frame that has something in it.
    ///
    /// # Errors
    /// [`GridError::TooSmall`], [`GridError::Blank`], [`GridError::Saturated`].
    pub(super) fn new(image: &'a RawImage, options: &GridOptions) -> Result<Self, GridError> {
        let (width, height) = (image.width(), image.height());
        let least = (4.0 * options.pitch_px[0]).ceil().max(16.0) as usize;
        if width < least || height < least {
            return Err(GridError::TooSmall { width, height, least });
        }
        Self::with_levels(image, &Levels::of(image))
    }

    /// The same from a glance at a few thousand pixels.
    ///
    /// # Errors
    /// [`GridError::Blank`], [`GridError::Saturated`].
    pub(super) fn glanced(image: &'a RawImage) -> Result<Self, GridError> {
        let levels = match image.samples() {
            Samples::U8(samples) => Levels::of_runs(glances(samples)),
            Samples::U16(samples) => Levels::of_runs(glances(samples)),
        };
        Self::with_levels(image, &levels)
    }

    fn with_levels(image: &'a RawImage, levels: &Levels) -> Result<Self, GridError> {
        levels.refuse()?;
        let dropped_bits = (u16::BITS - levels.maximum.leading_zeros()).saturating_sub(TABLE_BITS);
        let middle = 0.5 * f64::from((1u32 << dropped_bits) - 1);
        let table = (0..=u32::from(levels.maximum) >> dropped_bits)
            .map(|step| levels.logarithm(f64::from(step << dropped_bits) + middle))
            .collect();
        let (width, height) = (image.width(), image.height());
        Ok(Self { width, height, samples: image.samples(), table, dropped_bits, dark: levels.dark as f32 })
    }

    /// Logarithms of a window's pixels about pixel number `middle`.
    #[inline(always)]
    pub(super) fn logarithms(&self, middle: isize, window: &Window, into: &mut [f32]) {
        let (top, dropped) = (self.table.len() - 1, self.dropped_bits);
        match self.samples {
            Samples::U8(samples) => window.gather(samples, middle, into, |s| self.table[usize::from(s).min(top)]),
            Samples::U16(samples) => {
                window.gather(samples, middle, into, |s| self.table[usize::from(s >> dropped).min(top)]);
            }
        }
    }

    /// Levels above the dark one of a window's pixels about pixel number `middle`.
    #[inline(always)]
    pub(super) fn levels(&self, middle: isize, window: &Window, into: &mut [f32]) {
        let dark = self.dark;
        match self.samples {
            Samples::U8(samples) => window.gather(samples, middle, into, |s| f32::from(s) - dark),
            Samples::U16(samples) => window.gather(samples, middle, into, |s| f32::from(s) - dark),
        }
    }

    /// Logarithms of a part of a row.
    pub(super) fn row(&self, y: usize, from: usize, into: &mut [f32]) {
        let (top, dropped) = (self.table.len() - 1, self.dropped_bits);
        let start = y * self.width + from;
        match self.samples {
            Samples::U8(samples) => {
                into.iter_mut().zip(&samples[start..]).for_each(|(v, &s)| *v = self.table[usize::from(s).min(top)]);
            }
            Samples::U16(samples) => {
                let log = |s: u16| self.table[usize::from(s >> dropped).min(top)];
                into.iter_mut().zip(&samples[start..]).for_each(|(v, &s)| *v = log(s));
            }
        }
    }
}

/// Places about a pixel, row by row, as runs of pixels at even distances: what is read of a frame about each micro-image.
pub(super) struct Window {
    /// Pixels from one of a run to the next.
    step: usize,
    /// First pixel of each run from the middle one, as pixels of the frame, and how many the run has.
    runs: Vec<(isize, usize)>,
}

impl Window {
    /// Of `points` (columns and rows from the middle one) in the order of rows, `step` columns apart in each, in frames of
    /// so many columns.
    pub(super) fn new(points: &[(isize, isize)], step: usize, frame_width: usize) -> Self {
        let runs = points.chunk_by(|a, b| a.1 == b.1 && b.0 - a.0 == step as isize);
        let runs = runs.map(|run| (run[0].1 * frame_width as isize + run[0].0, run.len())).collect();
        Self { step, runs }
    }

    #[inline(always)]
    fn gather<T: Copy>(&self, samples: &[T], middle: isize, mut into: &mut [f32], value: impl Fn(T) -> f32) {
        for &(first, count) in &self.runs {
            let (run, rest) = into.split_at_mut(count);
            let samples = &samples[(middle + first) as usize..][..(count - 1) * self.step + 1];
            if self.step == 1 {
                run.iter_mut().zip(samples).for_each(|(v, &s)| *v = value(s));
            } else {
                run.iter_mut().zip(samples.iter().step_by(self.step)).for_each(|(v, &s)| *v = value(s));
            }
            into = rest;
        }
    }
}

/// Short runs of pixels, spread evenly.
fn glances<T>(samples: &[T]) -> impl Iterator<Item = &[T]> {
    let runs = (GLANCE_PIXELS / GLANCE_RUN).min(samples.len().div_ceil(GLANCE_RUN)).max(1);
    // An odd distance: the runs do not line up in columns.
    let apart = (samples.len() / runs) | 1;
    (0..runs).filter_map(move |k| samples.get(k * apart..(k * apart + GLANCE_RUN).min(samples.len())))
}

/// Standard deviation of a frame's noise, grey levels, from what the flattest parts of its rows leave; `None` where so many
/// pixels are clipped that these are among them.
#[must_use]
pub fn pixel_noise(image: &RawImage) -> Option<f64> {
    let levels = (image.width() > 0 && image.height() > 0).then(|| Levels::of(image))?;
    (levels.share_at_maximum < SATURATED_SHARE && levels.noise > 0.0).then_some(levels.noise)
}

/// Grey levels of a frame, from a sample of its pixels.
struct Levels {
    dark: f64,
    bright: f64,
    noise: f64,
    maximum: u16,
    share_at_maximum: f64,
}

impl Levels {
    fn of(image: &RawImage) -> Self {
        match image.samples() {
            Samples::U8(samples) => Self::of_rows(image.width(), samples),
            Samples::U16(samples) => Self::of_rows(image.width(), samples),
        }
    }

    fn of_rows<T: Copy + Ord + Send + Sync + Into<u16>>(width: usize, samples: &[T]) -> Self {
        let step = (samples.len() / width).div_ceil(256).max(1);
        let levels = Self::of_runs(samples.chunks_exact(width).step_by(step));
        // The greatest of all pixels: the table of logarithms ends there.
        let maximum = samples.par_iter().copied().max().map_or(0, Into::into);
        let share_at_maximum = if maximum == levels.maximum { levels.share_at_maximum } else { 0.0 };
        Self { maximum, share_at_maximum, ..levels }
    }

    /// From some runs of neighbouring pixels.
    fn of_runs<'a, T: Copy + Into<u16> + 'a>(runs: impl Iterator<Item = &'a [T]>) -> Self {
        let mut values: Vec<u16> = Vec::new();
        let mut jumps: Vec<u16> = Vec::new();
        for run in runs {
            values.extend(run.iter().map(|&s| -> u16 { s.into() }));
            // Second differences: a smooth slope is no noise.
            jumps.extend(run.windows(3).map(|w| {
                let [a, b, c] = [w[0], w[1], w[2]].map(|s| i32::from(s.into()));
                (a - 2 * b + c).unsigned_abs().min(u32::from(u16::MAX)) as u16
            }));
        }
        let maximum = values.iter().copied().max().unwrap_or(0);
        let at_maximum = values.iter().filter(|&&v| v == maximum).count();
        let share_at_maximum = at_maximum as f64 / values.len().max(1) as f64;
        // Second differences of white noise scatter by sqrt(6) sigma. The lower quartile (0.319 sigma for a Gaussian)
        // comes from the flattest parts, where texture enters least.
        let quartile = quantile(&mut jumps, 0.25);
        let noise = (quartile + 0.5) / 0.319 / 6f64.sqrt();
        let noise = if quartile > 0.0 { noise } else { 0.0 };
        let (dark, bright) = (quantile(&mut values, 0.01), quantile(&mut values, 0.99));
        Self { dark, bright, noise, maximum, share_at_maximum }
    }

    /// Refuses a frame without light or without detail in its lights.
    fn refuse(&self) -> Result<(), GridError> {
        let spread = self.bright - self.dark;
        // The blank frame first: where every pixel is the same, every pixel is at the maximum.
        let blank = spread < SPREAD_LEAST * self.noise.max(0.3);
        // A plateau below full scale is a clipped one only where noise would have broken it up otherwise.
        let clipped = is_full_scale(self.maximum) || (!blank && self.noise > 0.0);
        if self.share_at_maximum > SATURATED_SHARE && clipped {
            return Err(GridError::Saturated {
                percent: 100.0 * self.share_at_maximum,
                level: self.maximum,
                limit: 100.0 * SATURATED_SHARE,
            });
        }
        if blank {
            return Err(GridError::Blank { spread, noise: self.noise });
        }
        Ok(())
    }

    /// Logarithm of a grey level above the dark one.
    fn logarithm(&self, level: f64) -> f32 {
        let floor = FLOOR_SHARE * (self.bright - self.dark) + 2.0 * self.noise;
        ((level - self.dark).max(0.0) + floor).ln() as f32
    }
}

/// Whether a frame has light to be seen by, and not too much of it. A micro-image is darker at its edge than in its middle
/// however far out of focus it is: a frame without contrast is no matter of focus.
///
/// # Errors
/// [`GridError::Blank`], [`GridError::Saturated`].
pub fn check_light(image: &RawImage) -> Result<(), GridError> {
    Levels::of(image).refuse()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_read_the_pixels_at_their_points() {
        const WIDTH: usize = 31;
        let samples: Vec<u16> = (0..WIDTH as u16 * 20).collect();
        for step in 1..4isize {
            // Rows of several lengths, as a disc has them, and one that is not there.
            let points: Vec<(isize, isize)> = [(-2, 1), (-1, 3), (1, 2), (2, 0)]
                .into_iter()
                .flat_map(|(row, reach)| (-reach..=reach).map(move |n| (n * step, row * step)))
                .collect();
            let window = Window::new(&points, step as usize, WIDTH);
            assert_eq!(window.runs.len(), 4);
            let mut values = vec![0.0; points.len()];
            window.gather(&samples, 10 * WIDTH as isize + 15, &mut values, f32::from);
            for ((dx, dy), value) in points.into_iter().zip(values) {
                assert_eq!(value, ((10 + dy) * WIDTH as isize + 15 + dx) as f32, "{dx}, {dy} by {step}");
            }
        }
    }
}
