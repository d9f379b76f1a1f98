//! The profile of a micro-image: how much light of an even scene reaches each of its pixels.
//!
//! A white frame repeats with the lattice, so that every pixel of every micro-image adds to one profile over the
//! lattice's cell. Averaged over the array it is free of the white frame's own noise; drawn over another grid it serves
//! a frame taken at another Δv, where the micro-image centres have moved.
//!
//! A frame is modelled as `brightness(place) * transmission(place in the cell)`, the brightness being the mean over a
//! cell about the place, so that uneven light on the diffuser (or the texture of a board) is no part of the profile.

use rayon::prelude::*;

use super::grid::{Grid, reciprocal};
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
/// Lattice indices are taken exactly at every so many pixels of a row and linearly between: the departure of an array
/// from its lattice is smooth.
const KNOT_STEP: usize = 16;
/// Transmission down to which a micro-image is usable: below, the profile's slope makes small errors of the grid large.
const USABLE_TRANSMISSION: f64 = 0.8;
/// Difference between profile and frame that no measurement notices.
const MISFIT_HARMLESS: f64 = 0.02;

/// Why there is no profile.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum VignettingError {
    /// The grid is for another frame size.
    #[error("grid of a {}x{} frame cannot serve a frame of {}x{} px", grid[0], grid[1], frame[0], frame[1])]
    OtherFrameSize {
        /// Columns and rows of the grid's frame.
        grid: [usize; 2],
        /// Columns and rows of this frame.
        frame: [usize; 2],
    },
    /// Too little of the array is in the frame.
    #[error("only {found} micro-images have all their neighbours in the frame; a profile needs at least {least}")]
    TooFewMicroImages {
        /// How many there are.
        found: usize,
        /// Fewest that make a profile.
        least: usize,
    },
    /// There is no light at the micro-image centres.
    #[error("the micro-images are dark at their centres: no white frame of this grid; check the light and the grid")]
    Dark,
}

/// What a profile has in a bin, side by side: a pixel takes all of it.
type Terms = [f32; 4];

/// A micro-image's transmission over the lattice's cell, 1 on its plateau.
#[derive(Debug, Clone, PartialEq)]
pub struct Vignetting {
    /// Bins along each lattice vector; bin (p, q) is centred on the lattice indices (p / side, q / side).
    side: usize,
    /// In each bin the profile, and its changes per half frame width in x, in y, and in r².
    terms: Vec<Terms>,
    /// How many of these there are: the first alone, or all where the field asks for them.
    count: usize,
    /// Pitch of the grid it was taken with, px.
    pitch_px: f64,
    /// Radius about the centre within which the transmission stays above 0.8, pitches.
    usable_radius: f64,
    /// Root mean square of what the profile leaves of the frame it was taken from, relative to the plateau.
    residual: f64,
}

/// What light reaches the pixels of a frame: a profile drawn over the frame's grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Light {
    /// Relative transmission of every pixel, row by row: near 0 in the gaps, 1 on the plateaus.
    pub shares: Vec<f32>,
    /// Radius about a micro-image centre within which the transmission (mean around the circle) stays above 0.8, px.
    pub usable_radius_px: f64,
}

/// How well a profile fits a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProfileFit {
    /// Root mean square difference between the profile and the frame's own mean profile, relative to the plateau.
    pub misfit: f64,
    /// What the frame's texture alone makes of that difference (from the scatter between parts of the array).
    pub misfit_sigma: f64,
}

impl std::fmt::Display for ProfileFit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [misfit, texture] = [self.misfit, self.misfit_sigma].map(|share| 100.0 * share);
        write!(f, "its profile is off by {misfit:.1} %, of which texture explains {texture:.1} %")
    }
}

impl ProfileFit {
    /// Whether the profile may be used for the frame: the misfit is harmless, or no more than texture makes.
    #[must_use]
    pub fn fits(&self) -> bool {
        self.misfit < MISFIT_HARMLESS + 2.0 * self.misfit_sigma
    }
}

impl Vignetting {
    /// The profile of a white frame.
    ///
    /// # Errors
    /// [`VignettingError`] where grid and frame do not belong together or the frame is dark.
    pub fn from_white(white: &RawImage, grid: &Grid) -> Result<Self, VignettingError> {
        let field = Field::new(white, grid)?;
        let plain = field.profile(None);
        let bent = field.profile(Some(&plain));
        // Three times as many numbers take a share of 3 bins / pixels off the residual by chance alone.
        let bins = (plain.side * plain.side) as f64;
        let chance = 3.0 * bins / field.pixels() as f64;
        let gain = 1.0 - (bent.residual / plain.residual.max(1e-9)).powi(2);
        let chosen = if gain > 4.0 * chance + 0.02 && chance < 0.1 { bent } else { plain };
        chosen.normalised()
    }

    /// The profile of a frame of any content, for want of a white one: texture averages out over the array as far as
    /// it goes. What of it is odd about the centre is taken for texture.
    ///
    /// # Errors
    /// As [`Vignetting::from_white`].
    pub fn from_textured(frame: &RawImage, grid: &Grid) -> Result<Self, VignettingError> {
        let field = Field::new(frame, grid)?;
        let mut profile = field.profile(None);
        let side = profile.side;
        let old = profile.terms.clone();
        for q in 0..side {
            for p in 0..side {
                let opposite = (side - q) % side * side + (side - p) % side;
                profile.terms[q * side + p][0] = f32::midpoint(old[q * side + p][0], old[opposite][0]);
            }
        }
        profile.normalised()
    }

    /// Relative transmission at fractional lattice indices (u, v), where x and y are the place in the frame from its
    /// centre in units of half its width.
    #[must_use]
    pub fn transmission(&self, u: f64, v: f64, x: f64, y: f64) -> f32 {
        let [profile, by_x, by_y, by_square] = self.interpolated(u, v);
        profile + (x as f32) * by_x + (y as f32) * by_y + ((x * x + y * y) as f32) * by_square
    }

    /// The profile at fractional lattice indices, and its changes per half frame width in x, in y, and in r².
    pub(super) fn terms_at(&self, u: f64, v: f64) -> [f32; 4] {
        self.interpolated(u, v)
    }

    /// Whether the profile changes over the field.
    pub(super) const fn bends(&self) -> bool {
        self.count > 1
    }

    /// A profile of `side` by `side` bins.
    #[cfg(test)]
    pub(super) fn from_terms(side: usize, terms: Vec<[f32; 4]>, bends: bool) -> Self {
        let count = if bends { 4 } else { 1 };
        Self { side, terms, count, pitch_px: 0.0, usable_radius: 0.4, residual: 0.0 }
    }

    /// Relative transmission at a pixel of a frame with this grid (px).
    #[must_use]
    pub fn at(&self, grid: &Grid, x: f64, y: f64) -> f32 {
        let [u, v] = grid.indices_at(x, y);
        let [fx, fy] = field_coordinates(grid, x, y);
        self.transmission(u, v, fx, fy)
    }

    /// Relative transmission of every pixel of a frame with this grid, row by row: near 0 in the gaps, 1 on the
    /// plateaus. The grid may be another than the profile's own.
    #[must_use]
    pub fn render(&self, grid: &Grid) -> Vec<f32> {
        let [w, h] = grid.frame_size;
        let mut values = vec![0.0; w * h];
        values.par_chunks_mut(w.max(1)).enumerate().for_each(|(y, row)| {
            along_row(grid, y, |x, u, v| {
                let [fx, fy] = field_coordinates(grid, x as f64, y as f64);
                row[x] = self.transmission(u, v, fx, fy);
            });
        });
        values
    }

    /// The profile drawn over a grid, its own or another.
    #[must_use]
    pub fn over(&self, grid: &Grid) -> Light {
        Light { shares: self.render(grid), usable_radius_px: self.usable_radius_px(grid) }
    }

    /// Radius about a micro-image centre within which the transmission (mean around the circle) stays above 0.8, px,
    /// on a grid with this pitch.
    #[must_use]
    pub fn usable_radius_px(&self, grid: &Grid) -> f64 {
        self.usable_radius * grid.pitch_px()
    }

    /// Root mean square of what the profile leaves of the frame it was taken from, relative to the plateau: the
    /// frame's noise, and whatever else the model does not have.
    #[must_use]
    pub fn residual(&self) -> f64 {
        self.residual
    }

    /// How well the profile, carried to `grid`, fits a frame of any content.
    ///
    /// # Errors
    /// As [`Vignetting::from_white`].
    pub fn fit(&self, frame: &RawImage, grid: &Grid) -> Result<ProfileFit, VignettingError> {
        let field = Field::new(frame, grid)?;
        // Blocks of six by six micro-images take turns, so that neighbouring texture stays together.
        let quarter = |i: i32, j: i32| (i.div_euclid(6) & 1) as usize + 2 * (j.div_euclid(6) & 1) as usize;
        let empty = field.empty(1);
        let sums = field.average_residual(&empty, quarter, 4);
        let solved = |bins: &Bins| {
            let mut profile = empty.clone();
            bins.add_to(&mut profile);
            profile.normalised()
        };
        let parts: Vec<Self> = sums.iter().filter_map(|bins| solved(bins).ok()).collect();
        let whole = sums.into_iter().reduce(Bins::merged).map_or(Err(VignettingError::Dark), |bins| solved(&bins))?;
        let misfit = self.difference(&whole);
        let spread: f64 = parts.iter().map(|p| p.difference(&whole).powi(2)).sum::<f64>();
        // Four parts: the variance of their mean is the sum of squares over 4 * 3.
        let misfit_sigma = if parts.len() == 4 { (spread / 12.0).sqrt() } else { misfit };
        Ok(ProfileFit { misfit, misfit_sigma })
    }

    /// Root mean square difference of two profiles over the cell, after the best common factor.
    fn difference(&self, other: &Self) -> f64 {
        const SIDE: usize = 48;
        let (mut aa, mut ab, mut bb) = (0.0, 0.0, 0.0);
        for q in 0..SIDE {
            for p in 0..SIDE {
                let (u, v) = (p as f64 / SIDE as f64, q as f64 / SIDE as f64);
                let (a, b) = (f64::from(self.interpolated(u, v)[0]), f64::from(other.interpolated(u, v)[0]));
                aa += a * a;
                ab += a * b;
                bb += b * b;
            }
        }
        ((bb - ab * ab / aa.max(1e-12)).max(0.0) / (SIDE * SIDE) as f64).sqrt()
    }

    /// The terms at fractional lattice indices: cubic (Catmull–Rom) between the bins, periodic.
    #[inline]
    fn interpolated(&self, u: f64, v: f64) -> Terms {
        let ((p, wp), (q, wq)) = (stencil(u, self.side), stencil(v, self.side));
        let mut sums = [0.0; 4];
        for (row, wy) in q.iter().zip(wq) {
            let row = &self.terms[row * self.side..][..self.side];
            for (&column, wx) in p.iter().zip(wp) {
                let weight = wx * wy;
                for (sum, term) in sums.iter_mut().zip(row[column]) {
                    *sum += weight * term;
                }
            }
        }
        sums
    }

    /// The same profile with its plateau at 1.
    fn normalised(mut self) -> Result<Self, VignettingError> {
        // The plateau: the mean within a sixth of a pitch about the centre.
        let mut plateau = (0.0f64, 0usize);
        for (p, q) in within(self.side, 1.0 / 6.0) {
            plateau.0 += f64::from(self.terms[q * self.side + p][0]);
            plateau.1 += 1;
        }
        let plateau = plateau.0 / plateau.1.max(1) as f64;
        if !(plateau.is_finite() && plateau > 1e-6) {
            return Err(VignettingError::Dark);
        }
        self.terms.as_flattened_mut().iter_mut().for_each(|t| *t = (f64::from(*t) / plateau) as f32);
        self.residual /= plateau;
        Ok(self)
    }
}

/// Bins within so many cell sides of the cell's corner (a micro-image centre).
fn within(side: usize, radius: f64) -> impl Iterator<Item = (usize, usize)> {
    let near = move |p: usize| p.min(side - p) as f64 / side as f64;
    (0..side).flat_map(move |q| (0..side).map(move |p| (p, q))).filter(move |&(p, q)| near(p).hypot(near(q)) <= radius)
}

/// x and y from the frame's centre in units of half its width.
fn field_coordinates(grid: &Grid, x: f64, y: f64) -> [f64; 2] {
    let [w, h] = grid.frame_size.map(|n| n as f64);
    [(x - (w - 1.0) / 2.0) / (w / 2.0), (y - (h - 1.0) / 2.0) / (w / 2.0)]
}

/// Calls `visit` with every x of row `y` and its fractional lattice indices.
fn along_row(grid: &Grid, y: usize, mut visit: impl FnMut(usize, f64, f64)) {
    let w = grid.frame_size[0];
    let mut left = grid.indices_at(0.0, y as f64);
    for x0 in (0..w).step_by(KNOT_STEP) {
        let right = grid.indices_at((x0 + KNOT_STEP) as f64, y as f64);
        let step = [(right[0] - left[0]) / KNOT_STEP as f64, (right[1] - left[1]) / KNOT_STEP as f64];
        for k in 0..KNOT_STEP.min(w - x0) {
            visit(x0 + k, left[0] + k as f64 * step[0], left[1] + k as f64 * step[1]);
        }
        left = right;
    }
}

/// The greatest whole number that is not above a lattice index. Truncation and a comparison: `f64::floor` is a call where
/// SSE 4.1 cannot be taken for granted.
#[inline]
fn floor(u: f64) -> i32 {
    let whole = u as i32;
    whole - i32::from(u < f64::from(whole))
}

/// The bin at or before a fractional lattice index, and the share of a bin beyond it.
#[inline]
fn bin_of(u: f64, side: usize) -> (usize, f64) {
    let at = (u - f64::from(floor(u))) * side as f64;
    let base = (at as usize).min(side - 1);
    (base, at - base as f64)
}

/// Bins along one lattice vector, and their weights.
type Stencil = ([usize; 4], [f32; 4]);

/// Bins and Catmull–Rom weights about a fractional lattice index.
#[inline]
fn stencil(u: f64, side: usize) -> Stencil {
    let (base, t) = bin_of(u, side);
    let t = t as f32;
    // Comparisons instead of remainders: a division costs more than all the rest.
    let next = if base + 1 == side { 0 } else { base + 1 };
    let bins = [if base == 0 { side - 1 } else { base - 1 }, base, next, if next + 1 == side { 0 } else { next + 1 }];
    let (t2, t3) = (t * t, t * t * t);
    let weights = [
        0.5 * (-t3 + 2.0 * t2 - t),
        0.5 * (3.0 * t3 - 5.0 * t2 + 2.0),
        0.5 * (-3.0 * t3 + 4.0 * t2 + t),
        0.5 * (t3 - t2),
    ];
    (bins, weights)
}

/// A frame with its grid and its brightness about every micro-image.
struct Field<'a> {
    grid: &'a Grid,
    values: Vec<f32>,
    /// First lattice indices of the table of brightness, and its columns and rows.
    first: [i32; 2],
    size: [usize; 2],
    /// Mean over a cell about each micro-image; NaN where its window leaves the frame.
    brightness: Vec<f32>,
}

impl<'a> Field<'a> {
    fn new(frame: &RawImage, grid: &'a Grid) -> Result<Self, VignettingError> {
        const LEAST: usize = 9;
        let size = [frame.width(), frame.height()];
        if size != grid.frame_size {
            return Err(VignettingError::OtherFrameSize { grid: grid.frame_size, frame: size });
        }
        let values = frame.to_f32();
        let window = Window::new(grid);
        let lenses: Vec<_> = grid.micro_images_within(0.0).collect();
        let means: Vec<Option<f32>> =
            lenses.par_iter().with_min_len(32).map(|m| window.mean(&values, size, m.x, m.y)).collect();
        let found = means.iter().flatten().count();
        if found < LEAST {
            return Err(VignettingError::TooFewMicroImages { found, least: LEAST });
        }
        let bounds = |f: fn(&super::grid::MicroImage) -> i32| {
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

    fn pixels(&self) -> usize {
        self.values.len()
    }

    /// Brightness at fractional lattice indices: bilinear between micro-images.
    fn brightness_at(&self, u: f64, v: f64) -> Option<f32> {
        let (i, j) = (floor(u), floor(v));
        let (s, t) = ((u - f64::from(i)) as f32, (v - f64::from(j)) as f32);
        let (i, j) = (i - self.first[0], j - self.first[1]);
        if i < 0 || j < 0 || i as usize + 1 >= self.size[0] || j as usize + 1 >= self.size[1] {
            return None;
        }
        let at = j as usize * self.size[0] + i as usize;
        let (a, b) = (self.brightness[at], self.brightness[at + 1]);
        let (c, d) = (self.brightness[at + self.size[0]], self.brightness[at + self.size[0] + 1]);
        let value = (a * (1.0 - s) + b * s) * (1.0 - t) + (c * (1.0 - s) + d * s) * t;
        value.is_finite().then_some(value)
    }

    /// A profile of zeros with so many terms.
    fn empty(&self, count: usize) -> Vignetting {
        let pitch_px = self.grid.pitch_px();
        let enough = ((self.pixels() / PIXELS_PER_BIN) as f64).sqrt() as usize;
        let side = ((pitch_px / BIN_PX).round() as usize).min(enough).clamp(4, BINS_MAX);
        Vignetting { side, terms: vec![[0.0; 4]; side * side], count, pitch_px, usable_radius: 0.0, residual: 0.0 }
    }

    /// The profile, least squares over the pixels: one for the whole field, or with changes over the field when
    /// started from that.
    fn profile(&self, start: Option<&Vignetting>) -> Vignetting {
        let (mut profile, rounds) = match start {
            None => (self.empty(1), ROUNDS),
            Some(start) => {
                let mut profile = self.empty(4);
                profile.terms.clone_from(&start.terms);
                (profile, 1)
            }
        };
        for round in 0..=rounds {
            let sums = self.average_residual(&profile, |_, _| 0, 1);
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
    fn average_residual(
        &self,
        profile: &Vignetting,
        part: impl Fn(i32, i32) -> usize + Sync,
        parts: usize,
    ) -> Vec<Bins> {
        let [w, h] = self.grid.frame_size;
        let count = profile.count;
        // A profile to begin with predicts nothing.
        let blank = profile.terms.iter().flatten().all(|&value| value == 0.0);
        let fresh = || (0..parts).map(|_| Bins::new(profile.side, count)).collect::<Vec<_>>();
        // Rows are left out of frames that have far more pixels than the bins need; the step is odd, so that lattices
        // in step with the pixels are not seen at half their phases.
        let step = (self.pixels() / (profile.side * profile.side * PIXELS_ENOUGH)).max(1) | 1;
        // A few bands of rows, each with its own sums: their merging costs little beside the pixels.
        let band = h.div_ceil(4).max(1);
        (0..h.div_ceil(band))
            .into_par_iter()
            .map(|n| {
                let mut bins = fresh();
                for y in (n * band..((n + 1) * band).min(h)).step_by(step) {
                    along_row(self.grid, y, |x, u, v| {
                        let Some(brightness) = self.brightness_at(u, v) else { return };
                        let [fx, fy] = field_coordinates(self.grid, x as f64, y as f64);
                        let predicted = if blank { 0.0 } else { brightness * profile.transmission(u, v, fx, fy) };
                        let to = part(floor(u + 0.5), floor(v + 0.5));
                        bins[to].add(u, v, [fx, fy], brightness, self.values[y * w + x] - predicted);
                    });
                }
                bins
            })
            // Merged in one order, whichever band was done first: the same frame has the same profile to the last digit.
            .collect::<Vec<_>>()
            .into_iter()
            .fold(fresh(), |a, b| a.into_iter().zip(b).map(|(a, b)| a.merged(b)).collect())
    }
}

/// Sums over the bins of a cell.
struct Bins {
    side: usize,
    count: usize,
    /// Normal matrix (row by row, full) and right-hand side of each bin.
    sums: Vec<f64>,
    squares: f64,
    weight: f64,
}

impl Bins {
    fn new(side: usize, count: usize) -> Self {
        Self { side, count, sums: vec![0.0; side * side * (count * count + count)], squares: 0.0, weight: 0.0 }
    }

    fn add(&mut self, u: f64, v: f64, [x, y]: [f64; 2], brightness: f32, residual: f32) {
        let (side, count) = (self.side, self.count);
        let (b, r) = (f64::from(brightness), f64::from(residual));
        let terms = [b, b * x, b * y, b * (x * x + y * y)];
        let stride = count * count + count;
        self.squares += r * r;
        self.weight += b * b;
        let split = |u: f64| {
            let (base, t) = bin_of(u, side);
            [(base, 1.0 - t), (if base + 1 == side { 0 } else { base + 1 }, t)]
        };
        let columns = split(u);
        for (q, wy) in split(v) {
            for (p, wx) in columns {
                let w = wx * wy;
                let to = &mut self.sums[(q * side + p) * stride..][..stride];
                if count == 1 {
                    to[0] += w * b * b;
                    to[1] += w * b * r;
                    continue;
                }
                for k in 0..count {
                    to[count * count + k] += w * terms[k] * r;
                    for l in 0..count {
                        to[k * count + l] += w * terms[k] * terms[l];
                    }
                }
            }
        }
    }

    fn merged(mut self, other: Self) -> Self {
        self.sums.iter_mut().zip(&other.sums).for_each(|(a, b)| *a += b);
        self.squares += other.squares;
        self.weight += other.weight;
        self
    }

    /// Solves every bin and adds what it finds to the profile. Bins that no pixel fell into (a lattice in step with
    /// the pixels leaves some) take the mean of their neighbours.
    fn add_to(&self, profile: &mut Vignetting) {
        let (side, count) = (self.side, self.count);
        let stride = count * count + count;
        let enough = 0.02 * self.weight / (side * side) as f64;
        let mut steps: Vec<Option<[f64; 4]>> = self
            .sums
            .chunks_exact(stride)
            .map(|sums| {
                if sums[0] <= enough {
                    return None;
                }
                if count == 1 {
                    return Some([sums[1] / sums[0], 0.0, 0.0, 0.0]);
                }
                let normal = nalgebra::Matrix4::from_row_slice(&sums[..16]);
                let right = nalgebra::Vector4::from_row_slice(&sums[16..]);
                normal.cholesky().map(|c| {
                    let s = c.solve(&right);
                    [s[0], s[1], s[2], s[3]]
                })
            })
            .collect();
        for _ in 0..side {
            let known = steps.clone();
            let mut missing = false;
            for q in 0..side {
                for p in 0..side {
                    if known[q * side + p].is_some() {
                        continue;
                    }
                    missing = true;
                    let about = [
                        known[q * side + (p + 1) % side],
                        known[q * side + (p + side - 1) % side],
                        known[(q + 1) % side * side + p],
                        known[(q + side - 1) % side * side + p],
                    ];
                    let n = about.iter().flatten().count();
                    if n > 0 {
                        let mean = |k: usize| about.iter().flatten().map(|a| a[k]).sum::<f64>() / n as f64;
                        steps[q * side + p] = Some([mean(0), mean(1), mean(2), mean(3)]);
                    }
                }
            }
            if !missing {
                break;
            }
        }
        for (terms, step) in profile.terms.iter_mut().zip(steps) {
            for (term, s) in terms.iter_mut().zip(step.unwrap_or_default()) {
                *term += s as f32;
            }
        }
    }
}

/// Radius, in pitches, within which the mean around the circle stays above [`USABLE_TRANSMISSION`] of the plateau.
fn usable_radius(profile: &Vignetting, grid: &Grid) -> f64 {
    const STEPS: usize = 50;
    const DIRECTIONS: usize = 48;
    let r = reciprocal(grid.basis);
    let ring = |radius: f64| {
        let sum: f64 = (0..DIRECTIONS)
            .map(|k| {
                let angle = std::f64::consts::TAU * k as f64 / DIRECTIONS as f64;
                let (x, y) = (radius * profile.pitch_px * angle.cos(), radius * profile.pitch_px * angle.sin());
                f64::from(profile.interpolated(r[0][0] * x + r[0][1] * y, r[1][0] * x + r[1][1] * y)[0])
            })
            .sum();
        sum / DIRECTIONS as f64
    };
    let plateau = f64::midpoint(ring(0.0), ring(1.0 / 8.0));
    let radius = |k: usize| 0.5 * k as f64 / STEPS as f64;
    (0..=STEPS).take_while(|&k| ring(radius(k)) >= USABLE_TRANSMISSION * plateau).last().map_or(0.0, radius)
}

/// A window over which a lattice's white frame has the same mean wherever it is laid: a triangle along both lattice
/// vectors.
struct Window {
    points: Vec<(isize, isize, f32)>,
}

impl Window {
    fn new(grid: &Grid) -> Self {
        let r = reciprocal(grid.basis);
        let [a, b] = grid.basis;
        let reach = [(a[0].abs() + b[0].abs()).floor() as isize, (a[1].abs() + b[1].abs()).floor() as isize];
        let mut points = Vec::new();
        for dy in -reach[1]..=reach[1] {
            for dx in -reach[0]..=reach[0] {
                let (x, y) = (dx as f64, dy as f64);
                let s = 1.0 - (r[0][0] * x + r[0][1] * y).abs();
                let t = 1.0 - (r[1][0] * x + r[1][1] * y).abs();
                if s > 0.0 && t > 0.0 {
                    points.push((dx, dy, (s * t) as f32));
                }
            }
        }
        let area: f32 = points.iter().map(|p| p.2).sum();
        points.iter_mut().for_each(|p| p.2 /= area.max(1e-12));
        Self { points }
    }

    fn mean(&self, values: &[f32], [w, h]: [usize; 2], x: f64, y: f64) -> Option<f32> {
        let (cx, cy) = (x.round() as isize, y.round() as isize);
        let mut sum = 0.0;
        for &(dx, dy, weight) in &self.points {
            let (x, y) = (cx + dx, cy + dy);
            if x < 0 || y < 0 || x >= w as isize || y >= h as isize {
                return None;
            }
            sum += weight * values[y as usize * w + x as usize];
        }
        Some(sum)
    }
}
