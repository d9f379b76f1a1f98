//! A raw frame made ready for measuring: vignetting divided out, spline coefficients, slopes, micro-images, noise.

use std::collections::HashMap;

use rayon::prelude::*;

use super::SpacingError;
use super::model::{Directions, Place};
use super::slopes::slopes;
use crate::imaging::grid::Grid;
use crate::imaging::interpolation::spline_coefficients;
use crate::imaging::mosaic::green;
use crate::optics::ArrayKind;
use crate::raw::{CfaPattern, Channel, RawImage};

/// Share of the micro-image's radius that is used: beyond it vignetting falls steeply and neighbours leak in.
pub const MASK_FRACTION: f64 = 0.8;
/// The smallest masks, as a part of the micro-image's radius, where the profile falls from its centre on.
const LEAST_MASK_FRACTION: f64 = 0.5;
/// Share of the centre's light from which on a pixel counts as seeing through its whole microlens.
const WHOLE_SHARE: f64 = 0.985;
/// Pixels that the spline and the slopes reach beyond the mask.
pub(in crate::imaging) const MARGIN_PX: f64 = 4.0;
/// Below this share of the brightest, vignetting is not divided out any further: it would only blow up noise.
pub(in crate::imaging) const LEAST_VIGNETTING: f32 = 0.2;
/// Share of saturated pixels within the masks above which a frame is refused.
pub(in crate::imaging) const SATURATED_SHARE: f64 = 0.4;

/// One micro-image of a prepared frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MicroImage {
    /// Lattice indices in the frame's grid.
    pub index: [i32; 2],
    /// Its centre, px.
    pub centre: [f64; 2],
    /// Which of several regions it belongs to; `None`: it is left out.
    pub region: Option<usize>,
    /// Mean grey level within the mask, vignetting divided out.
    pub(super) mean: f32,
    /// Variance of the grey level within the mask, noise taken out as far as known (never negative).
    pub(super) texture: f32,
}

/// Two neighbouring micro-images, by their places in [`SpacingFrame::micro_images`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Pair {
    /// The first micro-image.
    pub first: usize,
    /// Its neighbour along the lattice direction.
    pub second: usize,
    /// Lattice direction: 0 and 1 along the basis, 2 along their difference (hexagonal arrays).
    pub direction: usize,
}

/// A raw frame made ready for measuring its spacing.
#[derive(Debug, Clone)]
pub struct SpacingFrame {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Grey levels with vignetting divided out.
    pub(super) values: Vec<f32>,
    /// Spline coefficients of `values`.
    pub(super) coefficients: Vec<f32>,
    /// Inverse noise variance of `values` in units of the raw frame's: vignetting squared; 0 for saturated pixels.
    pub(super) precision: Vec<f32>,
    /// Slopes of slightly smoothed `values` along x and y.
    pub(super) slopes: [Vec<f32>; 2],
    /// Sum of squares of the slope filter: the slopes' noise variance in units of that of `values`.
    pub(super) slope_noise: f64,
    /// Micro-images wholly within the frame.
    pub(super) micro_images: Vec<MicroImage>,
    /// Nearest neighbours, each pair once.
    pub(super) pairs: Vec<Pair>,
    /// Radius of the masks, px.
    pub(super) radius: f64,
    /// Part of the micro-image's radius within which pixels see through their whole microlens.
    pub(super) whole: f64,
    /// Distance of nearest neighbours in the grid, px.
    pub(super) pitch: f64,
    /// Standard deviation of the raw frame's noise, grey levels.
    pub(super) noise: f64,
    /// The mosaic of the sensor, of which only green pixels are a reference.
    pub(super) mosaic: Option<CfaPattern>,
    /// Arrangement of the array.
    pub(super) array: ArrayKind,
    /// The lattice's basis, px.
    pub(super) basis: [[f64; 2]; 2],
    /// How the array lies in the frame.
    pub(super) directions: Directions,
}

impl SpacingFrame {
    /// Prepares a monochrome frame. `vignetting` has one value for each pixel: the share of light that reaches it, relative to a
    /// micro-image's centre. `slope_sigma` is the smoothing (px) of the slopes that matching is done with.
    ///
    /// # Errors
    /// [`SpacingError`] when the grid or the vignetting belong to another frame size, when there are too few
    /// micro-images, or when the frame is saturated or dark.
    pub fn new(raw: &RawImage, vignetting: &[f32], grid: &Grid, slope_sigma: f64) -> Result<Self, SpacingError> {
        Self::of(raw, None, vignetting, grid, slope_sigma)
    }

    /// Prepares a frame of a sensor with a Bayer mosaic where one is given, as [`SpacingFrame::new`] does; the spacing is
    /// that of green.
    ///
    /// # Errors
    /// As [`SpacingFrame::new`].
    pub fn of(
        raw: &RawImage,
        mosaic: Option<CfaPattern>,
        vignetting: &[f32],
        grid: &Grid,
        slope_sigma: f64,
    ) -> Result<Self, SpacingError> {
        let (width, height) = (raw.width(), raw.height());
        if grid.frame_size != [width, height] || vignetting.len() != width * height {
            return Err(SpacingError::WrongSize { frame: [width, height], grid: grid.frame_size });
        }
        let pitch = grid.pitch_px();
        let radius = MASK_FRACTION * pitch / 2.0;
        let (mut micro_images, pairs) = lattice(grid, radius + MARGIN_PX);
        let needed = super::LEAST_PAIRS;
        if pairs.len() < needed {
            return Err(SpacingError::TooFewMicroImages { pairs: pairs.len(), needed });
        }
        let samples = mosaic.map_or_else(|| raw.to_f32(), |pattern| green(raw, pattern));
        let white = f32::from(raw.white_level());
        check_exposure(&samples, width, &micro_images, radius, white)?;
        let (values, precision): (Vec<f32>, Vec<f32>) = samples
            .par_iter()
            .zip(vignetting)
            .with_min_len(1 << 14)
            .map(|(&sample, &share)| {
                let share = share.max(LEAST_VIGNETTING);
                (sample / share, if sample >= white { 0.0 } else { share * share })
            })
            .unzip();
        let noise = noise_level(&samples, width, mosaic, &micro_images, radius);
        describe(&mut micro_images, &values, &precision, width, radius, noise);
        let coefficients = spline_coefficients(&values, width);
        let (slopes, slope_noise) = slopes(&values, width, slope_sigma);
        let centres: Vec<[f64; 2]> = micro_images.iter().map(|m| m.centre).collect();
        let whole = whole_fraction(&centres, pitch, |_, [x, y]| vignetting[y * width + x]);
        Ok(Self {
            width,
            height,
            values,
            coefficients,
            precision,
            slopes,
            slope_noise,
            micro_images,
            pairs,
            radius,
            whole,
            pitch,
            noise,
            mosaic,
            array: grid.array,
            basis: grid.basis,
            directions: Directions::new(grid),
        })
    }

    /// The micro-images wholly within the frame.
    #[must_use]
    pub fn micro_images(&self) -> &[MicroImage] {
        &self.micro_images
    }

    /// Nearest neighbours among them, each pair once.
    #[must_use]
    pub fn pairs(&self) -> &[Pair] {
        &self.pairs
    }

    /// Grey levels with vignetting divided out, row by row, and the number of columns.
    #[must_use]
    pub fn values(&self) -> (&[f32], usize) {
        (&self.values, self.width)
    }

    /// Radius about a micro-image's centre within which it is compared, px.
    #[must_use]
    pub const fn mask_radius_px(&self) -> f64 {
        self.radius
    }

    /// The brightest that the micro-images show but for their brightest hundredth, grey levels: black is 0.
    #[must_use]
    pub fn range(&self) -> f32 {
        let mut tops: Vec<f32> = self.micro_images.iter().map(|m| m.mean + 2.0 * m.texture.sqrt()).collect();
        let place = tops.len() * 99 / 100;
        if tops.is_empty() {
            return 0.0;
        }
        *tops.select_nth_unstable_by(place, f32::total_cmp).1
    }

    /// Standard deviation of the frame's noise as estimated from itself, grey levels of the raw frame.
    #[must_use]
    pub const fn noise_grey_levels(&self) -> f64 {
        self.noise
    }

    /// Distance of nearest neighbours in the grid (the micro-image pitch), px.
    #[must_use]
    pub const fn micro_image_pitch_px(&self) -> f64 {
        self.pitch
    }

    /// Assigns each micro-image to a region, or leaves it out: pairs count only within one region.
    pub fn assign_regions(&mut self, region_of: impl Fn(&MicroImage) -> Option<usize>) {
        for k in 0..self.micro_images.len() {
            self.micro_images[k].region = region_of(&self.micro_images[k]);
        }
    }

    /// Field coordinates of a position (px): from the frame's centre in units of half its width.
    #[must_use]
    pub fn field(&self, position: [f64; 2]) -> [f64; 2] {
        let half = self.width as f64 / 2.0;
        [
            (position[0] - (self.width as f64 - 1.0) / 2.0) / half,
            (position[1] - (self.height as f64 - 1.0) / 2.0) / half,
        ]
    }

    /// The position (px) that has these field coordinates.
    pub(super) fn position(&self, field: [f64; 2]) -> [f64; 2] {
        let half = self.width as f64 / 2.0;
        [field[0] * half + (self.width as f64 - 1.0) / 2.0, field[1] * half + (self.height as f64 - 1.0) / 2.0]
    }

    /// The region that both micro-images of a pair belong to.
    pub(super) fn region_of(&self, pair: Pair) -> Option<usize> {
        let (a, b) = (self.micro_images[pair.first].region, self.micro_images[pair.second].region);
        a.filter(|_| a == b)
    }

    /// Whether the sensor measured the pixel at column `x`, row `y`, in the colour that is compared.
    #[inline]
    pub(super) fn is_reference(&self, x: usize, y: usize) -> bool {
        self.mosaic.is_none_or(|pattern| pattern.channel(x, y) == Channel::Green)
    }

    /// Where, and along which direction, a pair measures.
    pub(super) fn place_of(&self, pair: Pair) -> Place {
        let (a, b) = (self.micro_images[pair.first].centre, self.micro_images[pair.second].centre);
        let at = self.field([f64::midpoint(a[0], b[0]), f64::midpoint(a[1], b[1])]);
        self.directions.place(at, pair.direction)
    }
}

/// Micro-images at least `margin` px from the frame's outermost pixel centres, and the pairs of neighbours among them.
fn lattice(grid: &Grid, margin: f64) -> (Vec<MicroImage>, Vec<Pair>) {
    let micro_images: Vec<MicroImage> = grid
        .micro_images_within(margin + 0.5)
        .map(|m| MicroImage { index: [m.i, m.j], centre: [m.x, m.y], region: Some(0), mean: 0.0, texture: 0.0 })
        .collect();
    let places: HashMap<[i32; 2], usize> = micro_images.iter().enumerate().map(|(k, m)| (m.index, k)).collect();
    let mut pairs = Vec::new();
    for (first, m) in micro_images.iter().enumerate() {
        for (direction, step) in grid.neighbour_steps().iter().enumerate() {
            if let Some(&second) = places.get(&[m.index[0] + step[0], m.index[1] + step[1]]) {
                pairs.push(Pair { first, second, direction });
            }
        }
    }
    (micro_images, pairs)
}

/// Calls `visit` with the offset of each pixel row's first pixel within the disc, and how many there are.
pub(super) fn disc_rows(centre: [f64; 2], radius: f64, width: usize, mut visit: impl FnMut(usize, usize)) {
    let top = (centre[1] - radius).ceil().max(0.0) as usize;
    let bottom = (centre[1] + radius).floor() as usize;
    for y in top..=bottom {
        let half = (radius * radius - (y as f64 - centre[1]).powi(2)).max(0.0).sqrt();
        let left = (centre[0] - half).ceil() as usize;
        let right = (centre[0] + half).floor();
        if right >= left as f64 {
            visit(y * width + left, right as usize + 1 - left);
        }
    }
}

fn check_exposure(
    samples: &[f32],
    width: usize,
    micro_images: &[MicroImage],
    radius: f64,
    white: f32,
) -> Result<(), SpacingError> {
    let (count, saturated, sum) = micro_images
        .par_iter()
        .map(|m| {
            let mut totals = (0usize, 0usize, 0.0f64);
            disc_rows(m.centre, radius, width, |start, n| {
                let row = &samples[start..start + n];
                totals.0 += n;
                totals.1 += row.iter().filter(|&&s| s >= white).count();
                totals.2 += f64::from(row.iter().sum::<f32>());
            });
            totals
        })
        .collect::<Vec<_>>()
        .into_iter()
        .fold((0, 0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1, a.2 + b.2));
    let share = saturated as f64 / count.max(1) as f64;
    if share > SATURATED_SHARE {
        return Err(SpacingError::Saturated { share });
    }
    let mean = sum / count.max(1) as f64;
    let least = least_mean(f64::from(white));
    if mean < least {
        return Err(SpacingError::Dark { mean, least });
    }
    Ok(())
}

/// Mean grey level of the masks below which a frame with this white level is too dark: an 8-bit frame whose micro-images
/// average three grey levels holds no texture above its own quantisation.
pub(in crate::imaging) fn least_mean(white: f64) -> f64 {
    (white * 0.012).min(3.0)
}

/// Part of the micro-image's radius within which no light is cut off, from the profile's mean around circles about
/// micro-image centres: `share` has the light that reaches the pixel in a column and row.
pub(in crate::imaging) fn whole_fraction(
    centres: &[[f64; 2]],
    pitch: f64,
    share: impl Fn([f64; 2], [usize; 2]) -> f32,
) -> f64 {
    const DIRECTIONS: usize = 24;
    let every = (centres.len() / 64).max(1);
    let ring = |fraction: f64| {
        let (mut sum, mut count) = (0.0, 0.0);
        for &centre in centres.iter().step_by(every) {
            for k in 0..DIRECTIONS {
                let (sin, cos) = (std::f64::consts::TAU * k as f64 / DIRECTIONS as f64).sin_cos();
                let reach = fraction * pitch / 2.0;
                let pixel = [centre[0] + reach * cos, centre[1] + reach * sin].map(|v| v.round() as usize);
                sum += f64::from(share(centre, pixel));
                count += 1.0;
            }
        }
        sum / f64::max(count, 1.0)
    };
    let least = WHOLE_SHARE * f64::midpoint(ring(0.1), ring(0.25));
    (0..)
        .map(|k| MASK_FRACTION - 0.02 * f64::from(k))
        .take_while(|&fraction| fraction > LEAST_MASK_FRACTION)
        .find(|&fraction| ring(fraction) >= least)
        .unwrap_or(LEAST_MASK_FRACTION)
}

/// Standard deviation of the noise: the lower quartile over micro-images of what a filter blind to planes and saddles
/// leaves. The lower quartile belongs to micro-images without sharp texture.
///
/// In a mosaic the filter is spread so that it meets pixels of one colour.
fn noise_level(
    samples: &[f32],
    width: usize,
    mosaic: Option<CfaPattern>,
    micro_images: &[MicroImage],
    radius: f64,
) -> f64 {
    let apart = if mosaic.is_some() { 2 } else { 1 };
    let counts = |k: usize| mosaic.is_none_or(|pattern| pattern.channel(k % width, k / width) == Channel::Green);
    let mut variances: Vec<f64> = micro_images
        .par_iter()
        .map(|m| {
            let (mut sum, mut count) = (0.0f64, 0usize);
            disc_rows(m.centre, 0.85 * radius, width, |start, n| {
                for k in (start..start + n).filter(|&k| counts(k)) {
                    let line = |k: usize| samples[k - apart] - 2.0 * samples[k] + samples[k + apart];
                    let response = line(k - apart * width) - 2.0 * line(k) + line(k + apart * width);
                    sum += f64::from(response * response);
                    count += 1;
                }
            });
            // 36 is the sum of squares of the filter (1 −2 1) × (1 −2 1).
            sum / 36.0 / count.max(1) as f64
        })
        .collect();
    let quartile = variances.len() / 4;
    let (_, variance, _) = variances.select_nth_unstable_by(quartile, f64::total_cmp);
    variance.sqrt()
}

/// Mean and texture of each micro-image.
fn describe(micro_images: &mut [MicroImage], values: &[f32], precision: &[f32], width: usize, radius: f64, noise: f64) {
    micro_images.par_iter_mut().for_each(|m| {
        let (mut count, mut sum, mut squares, mut share) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
        disc_rows(m.centre, radius, width, |start, n| {
            for k in start..start + n {
                if precision[k] > 0.0 {
                    let value = f64::from(values[k]);
                    count += 1.0;
                    sum += value;
                    squares += value * value;
                    share += f64::from(1.0 / precision[k]);
                }
            }
        });
        if count > 0.0 {
            let mean = sum / count;
            m.mean = mean as f32;
            m.texture = (squares / count - mean * mean - noise * noise * share / count).max(0.0) as f32;
        }
    });
}
