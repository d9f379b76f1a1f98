//! A frame by its grid: how bright it is about every micro-image, and what a profile leaves of it.

use rayon::prelude::*;

use super::bins::Bins;
use super::drawn::Drawn;
use super::place::{Place, along_row};
use super::{TERMS, Vignetting, VignettingError, usable_radius};
use crate::imaging::grid::{Grid, MicroImage, reciprocal};
use crate::imaging::matching::motion::Field as FrameField;
use crate::imaging::matching::plan::GOLDEN;
use crate::raw::RawImage;

/// Width of the profile's bins, px: a micro-image's edge falls over several pixels.
const BIN_PX: f64 = 0.5;
/// Most bins along a side of the cell.
const BINS_MAX: usize = 160;
/// Pixels a bin should get.
const PIXELS_PER_BIN: usize = 24;
/// Pixels per bin beyond which more add nothing: the profile's noise is a thirtieth of a pixel's.
const PIXELS_ENOUGH: usize = 900;
/// Rounds in which what the profile leaves is averaged and added: they take out the blur of binning.
const ROUNDS: usize = 2;
/// Products that are added up side by side.
const SIDE_BY_SIDE: usize = 8;
/// Fewest micro-images with all their neighbours in the frame that make a profile.
const LEAST_MICRO_IMAGES: usize = 9;

/// A frame with its grid and its brightness about every micro-image.
pub(super) struct Field<'a> {
    grid: &'a Grid,
    values: Vec<f32>,
    /// First lattice indices of the table of brightness, and its columns and rows.
    first: [i32; 2],
    size: [usize; 2],
    /// Mean over a cell about each micro-image; NaN where its window leaves the frame.
    brightness: Vec<f32>,
}

impl<'a> Field<'a> {
    pub(super) fn new(frame: &RawImage, grid: &'a Grid) -> Result<Self, VignettingError> {
        let size = [frame.width(), frame.height()];
        if size != grid.frame_size {
            return Err(VignettingError::OtherFrameSize { grid: grid.frame_size, frame: size });
        }
        let values = frame.to_f32();
        let window = Window::new(grid);
        let lenses: Vec<_> = grid.micro_images_within(0.0).collect();
        let means: Vec<Option<f32>> =
            lenses.par_iter().with_min_len(32).map(|m| window.mean(&values, size, [m.x, m.y])).collect();
        let found = means.iter().flatten().count();
        if found < LEAST_MICRO_IMAGES {
            return Err(VignettingError::TooFewMicroImages { found, least: LEAST_MICRO_IMAGES });
        }
        let bounds = |f: fn(&MicroImage) -> i32| {
            let (low, high) = lenses.iter().map(f).fold((i32::MAX, i32::MIN), |(l, h), i| (l.min(i), h.max(i)));
            (low, (high - low + 1) as usize)
        };
        let ((i0, columns), (j0, rows)) = (bounds(|m| m.i), bounds(|m| m.j));
        let mut brightness = vec![f32::NAN; columns * rows];
        for (m, mean) in lenses.iter().zip(means) {
            if let Some(mean) = mean {
                brightness[(m.j - j0) as usize * columns + (m.i - i0) as usize] = mean;
            }
        }
        Ok(Self { grid, values, first: [i0, j0], size: [columns, rows], brightness })
    }

    pub(super) fn pixels(&self) -> usize {
        self.values.len()
    }

    /// Brightness at a place: bilinear between micro-images.
    #[inline]
    fn brightness_at(&self, place: &Place) -> Option<f32> {
        let [s, t] = place.beyond.map(|beyond| beyond as f32);
        let [i, j] = [0, 1].map(|k| place.cell[k] - self.first[k]);
        if i < 0 || j < 0 || i as usize + 1 >= self.size[0] || j as usize + 1 >= self.size[1] {
            return None;
        }
        let at = j as usize * self.size[0] + i as usize;
        let (a, b) = (self.brightness[at], self.brightness[at + 1]);
        let (c, d) = (self.brightness[at + self.size[0]], self.brightness[at + self.size[0] + 1]);
        let value = (a * (1.0 - s) + b * s) * (1.0 - t) + (c * (1.0 - s) + d * s) * t;
        value.is_finite().then_some(value)
    }

    /// A profile of zeros that changes over the field or does not.
    pub(super) fn empty(&self, bends: bool) -> Vignetting {
        let pitch_px = self.grid.pitch_px();
        let enough = ((self.pixels() / PIXELS_PER_BIN) as f64).sqrt() as usize;
        let side = ((pitch_px / BIN_PX).round() as usize).min(enough).clamp(4, BINS_MAX);
        Vignetting { side, terms: vec![[0.0; TERMS]; side * side], bends, pitch_px, usable_radius: 0.0, residual: 0.0 }
    }

    /// The profile of the whole field, least squares over the pixels.
    pub(super) fn profile(&self) -> Vignetting {
        self.fitted::<1>(self.empty(false), ROUNDS)
    }

    /// The profile that changes over the field, started from the one that does not.
    pub(super) fn bent_profile(&self, plain: &Vignetting) -> Vignetting {
        self.fitted::<TERMS>(Vignetting { terms: plain.terms.clone(), ..self.empty(true) }, 1)
    }

    fn fitted<const N: usize>(&self, mut profile: Vignetting, rounds: usize) -> Vignetting {
        for round in 0..=rounds {
            let sums = self.average_residual::<N>(&profile, |_| 0, 1);
            let Some(bins) = sums.first() else { break };
            profile.residual = (bins.squares / bins.weight.max(1e-12)).sqrt();
            if round < rounds {
                bins.add_to(&mut profile);
            }
        }
        profile.usable_radius = usable_radius(&profile, self.grid);
        profile
    }

    /// What the profile leaves of the frame, averaged over the cell, for `parts` sets of micro-images apart.
    pub(super) fn average_residual<const N: usize>(
        &self,
        profile: &Vignetting,
        part: impl Fn([i32; 2]) -> usize + Sync,
        parts: usize,
    ) -> Vec<Bins<N>> {
        let [w, h] = self.grid.frame_size;
        let field = FrameField::new(self.grid.frame_size);
        // A profile to begin with predicts nothing.
        let blank = profile.terms.iter().flatten().all(|&value| value == 0.0);
        let drawn = (!blank).then(|| Drawn::<N>::new(profile));
        let fresh = || (0..parts).map(|_| Bins::new(profile.side)).collect::<Vec<_>>();
        // Rows are left out of frames that have far more pixels than the bins need. Spread by the golden ratio, those that
        // are taken are in step with no lattice.
        let share = (profile.side * profile.side * PIXELS_ENOUGH) as f64 / self.pixels() as f64;
        let taken = |y: usize| (y as f64 * GOLDEN).fract() < share;
        // A few bands of rows, each with its own sums: their merging costs little beside the pixels.
        let band = h.div_ceil(4).max(1);
        (0..h.div_ceil(band))
            .into_par_iter()
            .map(|n| {
                let mut bins = fresh();
                for y in (n * band..((n + 1) * band).min(h)).filter(|&y| taken(y)) {
                    let values = &self.values[y * w..][..w];
                    along_row(self.grid, y, |x, place| {
                        let Some(brightness) = self.brightness_at(&place) else { return };
                        let at = field.coordinates([x as f64, y as f64]);
                        let share = drawn.as_ref().map_or(0.0, |drawn| drawn.transmission(&place, at));
                        let to = &mut bins[part(place.micro_image())];
                        to.add(&place, at, brightness, values[x] - brightness * share);
                    });
                }
                bins
            })
            // Merged in one order, whichever band was done first: the same frame has the same profile to the last digit.
            .collect::<Vec<_>>()
            .into_iter()
            .fold(fresh(), |a, b| a.into_iter().zip(&b).map(|(a, b)| a.merged(b)).collect())
    }
}

/// A window over which a lattice's white frame has the same mean wherever it is laid: a triangle along both lattice
/// vectors.
struct Window {
    rows: Vec<WindowRow>,
    /// How far it reaches from its middle, px.
    reach: [isize; 2],
}

/// A row of it: where it begins from the middle, px, and its weights.
struct WindowRow {
    x: isize,
    y: isize,
    weights: Vec<f32>,
}

impl Window {
    fn new(grid: &Grid) -> Self {
        let r = reciprocal(grid.basis);
        let [a, b] = grid.basis;
        let reach = [(a[0].abs() + b[0].abs()).floor() as isize, (a[1].abs() + b[1].abs()).floor() as isize];
        let weight = |x: isize, y: isize| {
            let [s, t] = [0, 1].map(|k| 1.0 - (r[k][0] * x as f64 + r[k][1] * y as f64).abs());
            if s > 0.0 && t > 0.0 { (s * t) as f32 } else { 0.0 }
        };
        let mut rows = Vec::new();
        for y in -reach[1]..=reach[1] {
            // A parallelogram's rows have no gaps.
            let within: Vec<isize> = (-reach[0]..=reach[0]).filter(|&x| weight(x, y) > 0.0).collect();
            if let (Some(&x), Some(&last)) = (within.first(), within.last()) {
                rows.push(WindowRow { x, y, weights: (x..=last).map(|x| weight(x, y)).collect() });
            }
        }
        let area: f32 = rows.iter().flat_map(|row| &row.weights).sum();
        rows.iter_mut().flat_map(|row| &mut row.weights).for_each(|weight| *weight /= area.max(1e-12));
        let reach = rows.iter().fold([0, 0], |[x, y], row| {
            [x.max(-row.x).max(row.x + row.weights.len() as isize - 1), y.max(row.y.abs())]
        });
        Self { rows, reach }
    }

    /// The mean about a place; `None` where the window leaves the frame.
    fn mean(&self, values: &[f32], size: [usize; 2], at: [f64; 2]) -> Option<f32> {
        let centre = at.map(|at| at.round() as isize);
        let within = |k: usize| centre[k] >= self.reach[k] && centre[k] + self.reach[k] < size[k] as isize;
        if !(within(0) && within(1)) {
            return None;
        }
        // Sums side by side, which one instruction adds up.
        let mut sums = [0.0f32; SIDE_BY_SIDE];
        for row in &self.rows {
            let from = (centre[1] + row.y) as usize * size[0] + (centre[0] + row.x) as usize;
            let values = &values[from..][..row.weights.len()];
            let (weights, values) = (row.weights.chunks(SIDE_BY_SIDE), values.chunks(SIDE_BY_SIDE));
            for (weights, values) in weights.zip(values) {
                sums.iter_mut()
                    .zip(weights.iter().zip(values))
                    .for_each(|(sum, (weight, value))| *sum += weight * value);
            }
        }
        Some(sums.iter().sum())
    }
}
