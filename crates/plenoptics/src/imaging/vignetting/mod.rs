//! The profile of a micro-image: how much light of an even scene reaches each of its pixels.
//!
//! A white frame repeats with the lattice, so that every pixel of every micro-image adds to one profile over the
//! lattice's cell. Averaged over the array it is free of the white frame's own noise; drawn over another grid it serves
//! a frame taken at another Δv, where the micro-image centres have moved.
//!
//! A frame is modelled as `brightness(place) * transmission(place in the cell)`, the brightness being the mean over a
//! cell about the place, so that uneven light on the diffuser (or the texture of a board) is no part of the profile.

mod bins;
mod drawn;
mod field;
mod place;

use std::borrow::Cow;

use rayon::prelude::*;

use super::grid::{Grid, reciprocal};
use super::matching::motion::Field as FrameField;
use crate::optics::ArrayKind;
use crate::raw::RawImage;
use bins::Bins;
use drawn::Drawn;
use field::Field;
use place::{Place, along_row};

/// Terms of a profile: itself, and its changes per half frame width in x, in y, and in r².
const TERMS: usize = 4;
/// Transmission down to which a micro-image is usable: below, the profile's slope makes small errors of the grid large.
const USABLE_TRANSMISSION: f64 = 0.8;
/// Difference between profile and frame that no measurement notices.
const MISFIT_HARMLESS: f64 = 0.02;

/// A picture that is blurred on its way from the microlenses has smaller micro-images of the same light: an aperture that makes
/// them smaller takes twice as large a share of their light. The share of the white frame's usable radius below which, and of
/// its light above which, a picture is blurred: by less, no spacing is moved by more than its uncertainty.
const BLURRED_RADIUS: f64 = 0.95;
const BLURRED_LIGHT: f64 = 0.95;

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
    /// The whole picture is blurred, and was not in the white frame.
    #[error(
        "the picture is blurred as a whole, or torn: of its micro-images {:.0} % of the radius is usable that is in the white frame, and their light is the same; look at it: where it is torn, see to the camera's cable and bandwidth, else to what is between array and sensor, then take the white frame anew",
        100.0 * radius
    )]
    Blurred {
        /// The micro-images' usable radius, relative to the white frame's.
        radius: f64,
    },
    /// There is no light at the micro-image centres.
    #[error("the micro-images are dark at their centres: no white frame of this grid; check the light and the grid")]
    Dark,
}

/// A micro-image's transmission over the lattice's cell, 1 on its plateau.
#[derive(Debug, Clone, PartialEq)]
pub struct Vignetting {
    /// Bins along each lattice vector; bin (p, q) is centred on the lattice indices (p / side, q / side).
    side: usize,
    /// In each bin the profile, and its changes per half frame width in x, in y, and in r²: 0 where it does not change.
    terms: Vec<[f32; TERMS]>,
    /// Whether it changes over the field.
    bends: bool,
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
    /// Where the frame is blurred as a whole and the white frame was not: its micro-images' usable radius, relative to that of
    /// the white frame's.
    pub blurred: Option<f64>,
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
        self.excess() < 0.0
    }

    /// By how much the misfit is greater than what does no harm and what texture makes.
    fn excess(&self) -> f64 {
        self.misfit - MISFIT_HARMLESS - 2.0 * self.misfit_sigma
    }
}

impl Vignetting {
    /// The profile of a white frame.
    ///
    /// # Errors
    /// [`VignettingError`] where grid and frame do not belong together or the frame is dark.
    pub fn from_white(white: &RawImage, grid: &Grid) -> Result<Self, VignettingError> {
        let field = Field::new(white, grid)?;
        let plain = field.profile();
        let bent = field.bent_profile(&plain);
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
        let mut profile = field.profile();
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
        added(&self.terms_at(u, v), [x, y])
    }

    /// The profile at fractional lattice indices, and its changes per half frame width in x, in y, and in r²: cubic
    /// (Catmull–Rom) between the bins, periodic.
    pub(super) fn terms_at(&self, u: f64, v: f64) -> [f32; TERMS] {
        let [(p, wp), (q, wq)] = Place::new([u, v]).bins(self.side).map(|bin| stencil(bin, self.side));
        let mut sums = [0.0; TERMS];
        for (row, wy) in q.into_iter().zip(wq) {
            let row = &self.terms[row * self.side..][..self.side];
            for (column, wx) in p.into_iter().zip(wp) {
                let weight = wx * wy;
                for (sum, term) in sums.iter_mut().zip(row[column]) {
                    *sum += weight * term;
                }
            }
        }
        sums
    }

    /// Whether the profile changes over the field.
    pub(super) const fn bends(&self) -> bool {
        self.bends
    }

    /// A profile of `side` by `side` bins.
    #[cfg(test)]
    pub(super) fn from_terms(side: usize, terms: Vec<[f32; TERMS]>, bends: bool) -> Self {
        Self { side, terms, bends, pitch_px: 0.0, usable_radius: 0.4, residual: 0.0 }
    }

    /// Relative transmission at a pixel of a frame with this grid (px).
    #[must_use]
    pub fn at(&self, grid: &Grid, x: f64, y: f64) -> f32 {
        let [u, v] = grid.indices_at(x, y);
        let [fx, fy] = FrameField::new(grid.frame_size).coordinates([x, y]);
        self.transmission(u, v, fx, fy)
    }

    /// Relative transmission of every pixel of a frame with this grid, row by row: near 0 in the gaps, 1 on the
    /// plateaus. The grid may be another than the profile's own.
    #[must_use]
    pub fn render(&self, grid: &Grid) -> Vec<f32> {
        self.render_part(grid, [0, 0], grid.frame_size)
    }

    /// The same of a part of a frame of that size, which begins at that column and row; the grid is by the part's pixels.
    pub(super) fn render_part(&self, grid: &Grid, from: [usize; 2], of: [usize; 2]) -> Vec<f32> {
        if self.bends { self.drawn_over::<TERMS>(grid, from, of) } else { self.drawn_over::<1>(grid, from, of) }
    }

    fn drawn_over<const N: usize>(&self, grid: &Grid, from: [usize; 2], of: [usize; 2]) -> Vec<f32> {
        let [w, h] = grid.frame_size;
        let (drawn, field) = (Drawn::<N>::new(self), FrameField::new(of));
        let mut values = vec![0.0; w * h];
        values.par_chunks_mut(w.max(1)).enumerate().for_each(|(y, row)| {
            along_row(grid, y, |x, place| {
                let at = [x + from[0], y + from[1]].map(|k| k as f64);
                row[x] = drawn.transmission(&place, field.coordinates(at));
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
        let quarter = |[i, j]: [i32; 2]| (i.div_euclid(6) & 1) as usize + 2 * (j.div_euclid(6) & 1) as usize;
        let empty = field.empty(false);
        let sums = field.average_residual(&empty, quarter, 4);
        let solved = |bins: &Bins<1>| {
            let mut profile = empty.clone();
            bins.add_to(&mut profile);
            profile.normalised()
        };
        let parts: Vec<Self> = sums.iter().filter_map(|bins| solved(bins).ok()).collect();
        let whole = sums
            .into_iter()
            .reduce(|sums, more| sums.merged(&more))
            .map_or(Err(VignettingError::Dark), |bins| solved(&bins))?;
        let misfits = self.differences(&whole, grid.array);
        let mut squares = [0.0; 2];
        for part in &parts {
            let apart = part.differences(&whole, grid.array);
            squares.iter_mut().zip(apart).for_each(|(sum, difference)| *sum += difference * difference);
        }
        // Texture makes a radius of few micro-images uncertain: each part has to show it.
        let shown = || parts.len() == 4 && parts.iter().all(|part| self.blurred(part, grid).is_some());
        let blurred = self.blurred(&whole, grid).filter(|_| shown());
        let fit = |k: usize| {
            let misfit = misfits[k];
            // Four parts: the variance of their mean is the sum of squares over 4 * 3.
            let misfit_sigma = if parts.len() == 4 { (squares[k] / 12.0).sqrt() } else { misfit };
            ProfileFit { misfit, misfit_sigma, blurred }
        };
        let [whole, even] = [fit(0), fit(1)];
        Ok(if even.excess() > whole.excess() { even } else { whole })
    }

    /// The usable radius of a frame's own profile, relative to this one's, where that frame is blurred as a whole beside it.
    fn blurred(&self, own: &Self, grid: &Grid) -> Option<f64> {
        let radius = usable_radius(own, grid) / self.usable_radius;
        let light = |profile: &Self| {
            profile.terms.iter().map(|terms| f64::from(terms[0])).sum::<f64>() / profile.terms.len() as f64
        };
        (radius < BLURRED_RADIUS && light(own) > BLURRED_LIGHT * light(self)).then_some(radius)
    }

    /// What to divide out of a frame with this grid: the profile itself where it fits the frame so, or else the frame's own. What
    /// the profile of another setting leaves is alike in all micro-images and matches as they lie: it pulls the spacing towards
    /// their pitch, the more the less texture there is beside it.
    ///
    /// # Errors
    /// As [`Vignetting::from_white`], and [`VignettingError::Blurred`].
    pub(super) fn fitting(
        &self,
        fit: &ProfileFit,
        frame: &RawImage,
        grid: &Grid,
    ) -> Result<Cow<'_, Self>, VignettingError> {
        match fit.blurred {
            _ if fit.fits() => Ok(Cow::Borrowed(self)),
            Some(radius) => Err(VignettingError::Blurred { radius }),
            None => Self::from_textured(frame, grid).map(Cow::Owned),
        }
    }

    /// Root mean square differences of two profiles over the cell, after the best common factor: of all there is, and of
    /// what has the array's own symmetry. That is what an aperture changes, and texture hardly has it.
    fn differences(&self, other: &Self, array: ArrayKind) -> [f64; 2] {
        const SIDE: usize = 48;
        let values = |profile: &Self| -> Vec<f64> {
            let place = |n: usize| [n % SIDE, n / SIDE].map(|k| k as f64 / SIDE as f64);
            (0..SIDE * SIDE).map(|n| f64::from(profile.terms_at(place(n)[0], place(n)[1])[0])).collect()
        };
        let (own, others) = (values(self), values(other));
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let factor = product(&own, &others) / product(&own, &own).max(1e-12);
        let left: Vec<f64> = own.iter().zip(&others).map(|(own, other)| other - factor * own).collect();
        let turns = array.turns();
        let alike = |n: usize| {
            let [mut p, mut q] = [n % SIDE, n / SIDE];
            let mut sum = 0.0;
            for _ in 0..turns {
                sum += left[q * SIDE + p] + left[p * SIDE + q];
                [p, q] = array.turned([p, q], SIDE);
            }
            sum / (2 * turns) as f64
        };
        let rms = |squares: f64| (squares / (SIDE * SIDE) as f64).sqrt();
        [rms(product(&left, &left)), rms((0..SIDE * SIDE).map(|n| alike(n).powi(2)).sum())]
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

/// What a profile's terms, or the first of them, count for at a place in the field: 1, x, y and r².
#[inline]
fn factors([x, y]: [f64; 2]) -> [f64; TERMS] {
    [1.0, x, y, x * x + y * y]
}

/// The terms added up as they count there.
#[inline]
fn added(terms: &[f32], at: [f64; 2]) -> f32 {
    terms.iter().zip(factors(at)).map(|(term, factor)| factor as f32 * term).sum()
}

/// Bins along one lattice vector, and their weights.
type Stencil = ([usize; 4], [f32; 4]);

/// Bins and Catmull–Rom weights a share of a bin beyond one of so many.
#[inline]
fn stencil((base, t): (usize, f64), side: usize) -> Stencil {
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
                f64::from(profile.terms_at(r[0][0] * x + r[0][1] * y, r[1][0] * x + r[1][1] * y)[0])
            })
            .sum();
        sum / DIRECTIONS as f64
    };
    let plateau = f64::midpoint(ring(0.0), ring(1.0 / 8.0));
    let radius = |k: usize| 0.5 * k as f64 / STEPS as f64;
    (0..=STEPS).take_while(|&k| ring(radius(k)) >= USABLE_TRANSMISSION * plateau).last().map_or(0.0, radius)
}
