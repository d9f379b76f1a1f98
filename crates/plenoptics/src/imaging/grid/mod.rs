//! The lattice of micro-image centres: where every microlens paints on the sensor.
//!
//! ```text
//!   frame.rs                    spectrum.rs   peaks of the Fourier spectrum that make a lattice
//!   its pixels, or                                    |
//!   their logarithms --> demodulate.rs   phase of the lattice's first harmonics about each micro-image
//!                                                     |
//!               phases.rs, fit.rs   robust affine or polynomial map through the phases
//!                                                     |
//!                      profile.rs   in textured frames: the same map through shifts against the mean profile
//!
//!                        sigma.rs   how uncertain the map is, from what it leaves of neighbouring micro-images
//!
//!   search.rs: all of it, with nothing known or from a known grid; check.rs: a glance at a known grid
//! ```
//!
//! Nothing is thresholded and no edge is traced: the dark gaps between micro-images make the lattice's harmonics, and
//! their phase about a micro-image says where its centre is. In the logarithm of the frame the vignetting is a term
//! beside the texture rather than a factor, so that texture averages out over the array.

mod check;
mod demodulate;
mod fit;
mod frame;
pub(super) mod harmonics;
mod nodes;
mod phases;
mod profile;
mod search;
mod sigma;
mod spectrum;

use crate::optics::ArrayKind;

pub(super) use phases::median;

pub use check::{GridCheck, GridState, check_grid};
pub use frame::{check_light, pixel_noise};
pub use search::{PITCH_FOLLOWED, find_grid, lens_residuals, refine_grid};
pub use sigma::GridSigma;

/// Where the micro-images are: a lattice, `centre + i basis[0] + j basis[1]`, with a smooth departure from it where
/// the array has one.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Square or hexagonal.
    pub array: ArrayKind,
    /// The lattice point nearest the frame's centre: x and y, px; a micro-image centre where nothing departs from the
    /// lattice.
    pub centre: [f64; 2],
    /// The lattice's basis, px: for a square array along its rotated x and y; for a hexagonal one along a nearest
    /// neighbour and 60° further.
    pub basis: [[f64; 2]; 2],
    /// Columns and rows of the frame the grid belongs to.
    pub frame_size: [usize; 2],
    /// Smooth departure of the micro-image centres from the lattice, where the data ask for one.
    pub distortion: Option<Distortion>,
    /// What the map leaves, px: the median distance from the grid of neighbourhoods of five by five micro-images. That
    /// is how far it can be believed; errors of single micro-images are not in it.
    pub residual_px: f64,
    /// Distance of single micro-images from the grid, px, median: noise, texture and the array's own errors from lens to
    /// lens.
    pub scatter_px: f64,
    /// How far the frame's lattice phases agree, from 0 (noise) to 1 (a clean white frame).
    pub coherence: f64,
    /// Standard uncertainties of pitch, rotation and centre; zeros of a grid that was given and not found.
    pub sigma: GridSigma,
}

/// Departure of the micro-image centres from an affine lattice: polynomials in the lattice indices. The lattice is the
/// best affine one for the frame's micro-images, so that the departure is zero in the mean but not at index (0, 0).
#[derive(Debug, Clone, PartialEq)]
pub struct Distortion {
    /// Degree, 2 to 5.
    pub degree: usize,
    /// Lattice indices are divided by this before they enter the polynomials.
    pub scale: f64,
    /// Coefficients of x and y, px, for the monomials of degree 0, then 1 and so on, each by falling power of i.
    pub coefficients: Vec<[f64; 2]>,
}

impl Distortion {
    /// The departure at (possibly fractional) lattice indices, px.
    #[must_use]
    pub fn at(&self, i: f64, j: f64) -> [f64; 2] {
        let mut sum = [0.0; 2];
        for (term, c) in fit::monomials(i / self.scale, j / self.scale, self.degree).zip(&self.coefficients) {
            sum[0] += term * c[0];
            sum[1] += term * c[1];
        }
        sum
    }
}

/// What to look for in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridOptions {
    /// Least and greatest micro-image pitch that is looked for, px.
    pub pitch_px: [f64; 2],
    /// Greatest degree of the polynomial map, 1 (an affine lattice) to 5. The data decide up to here, and only frames
    /// as clean as a white frame are asked.
    pub degree_max: usize,
    /// Fewest complete micro-images that make a grid.
    pub micro_images_min: usize,
}

impl Default for GridOptions {
    fn default() -> Self {
        Self { pitch_px: [8.0, 100.0], degree_max: 5, micro_images_min: 16 }
    }
}

/// Why a frame has no grid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GridError {
    /// Too few pixels for a lattice of the least pitch.
    #[error("frame of {width}x{height} px is too small: a grid needs at least {least} px in both directions")]
    TooSmall {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Least side, px.
        least: usize,
    },
    /// Nothing in the frame stands out from the noise of its pixels.
    #[error(
        "frame is blank: grey levels spread over {spread:.1}, pixel noise alone is {noise:.1}; light the diffuser or \
         board, take the lens cap off or lengthen the exposure"
    )]
    Blank {
        /// Grey levels between the 1st and the 99th percentile.
        spread: f64,
        /// Standard deviation of the pixel noise, grey levels.
        noise: f64,
    },
    /// Too many pixels are at the top of the scale.
    #[error(
        "frame is saturated: {percent:.0} % of its pixels are at the maximum of {level}; shorten the exposure so that \
         fewer than {limit:.0} % are"
    )]
    Saturated {
        /// Share of pixels at the maximum.
        percent: f64,
        /// The maximum, grey levels.
        level: u16,
        /// Greatest share allowed.
        limit: f64,
    },
    /// The spectrum has no lattice, or its phases do not hold together: not a raw plenoptic frame.
    #[error(
        "no lattice of micro-images between {least} and {greatest} px pitch in this frame ({reason}): not a raw \
         plenoptic frame, or its micro-images overlap without contrast"
    )]
    NoLattice {
        /// Least pitch looked for, px.
        least: f64,
        /// Greatest pitch looked for, px.
        greatest: f64,
        /// What was missing.
        reason: String,
    },
    /// There is a lattice, but too little of it.
    #[error("only {found} complete micro-images of pitch {pitch:.1} px in this frame; a grid needs at least {least}")]
    TooFewMicroImages {
        /// Complete micro-images.
        found: usize,
        /// Their pitch, px.
        pitch: f64,
        /// Fewest that make a grid.
        least: usize,
    },
    /// The known grid is for another frame size.
    #[error("grid of a {}x{} frame cannot be fitted to a frame of {}x{} px", grid[0], grid[1], frame[0], frame[1])]
    OtherFrameSize {
        /// Columns and rows of the grid's frame.
        grid: [usize; 2],
        /// Columns and rows of this frame.
        frame: [usize; 2],
    },
    /// The known grid does not fit this frame.
    #[error(
        "the known grid no longer fits this frame: {reason}; find the grid anew from a white frame at this setting"
    )]
    DoesNotFit {
        /// What is wrong.
        reason: String,
    },
}

/// One micro-image of a grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MicroImage {
    /// Lattice index along `basis[0]`.
    pub i: i32,
    /// Lattice index along `basis[1]`.
    pub j: i32,
    /// Micro-image centre, px.
    pub x: f64,
    /// Micro-image centre, px.
    pub y: f64,
}

/// What a frame says about one micro-image of a grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LensResidual {
    /// The micro-image, at its place in the grid.
    pub micro_image: MicroImage,
    /// Where the frame has it less where the grid has it: x and y, px.
    pub offset_px: [f64; 2],
    /// Contrast of the lattice about this micro-image, relative to the median over the frame: near 0 where a
    /// microlens is missing, dead, covered or sees black.
    pub contrast: f64,
}

impl Grid {
    /// An affine grid.
    #[must_use]
    pub fn affine(array: ArrayKind, centre: [f64; 2], basis: [[f64; 2]; 2], frame_size: [usize; 2]) -> Self {
        Self {
            array,
            centre,
            basis,
            frame_size,
            distortion: None,
            residual_px: 0.0,
            scatter_px: 0.0,
            coherence: 1.0,
            sigma: GridSigma::default(),
        }
    }

    /// Centre of the micro-image with lattice indices (i, j), px.
    #[must_use]
    pub fn position(&self, i: i32, j: i32) -> [f64; 2] {
        self.position_at(f64::from(i), f64::from(j))
    }

    /// Where fractional lattice indices lie, px: (0.5, 0) is half way between two neighbours.
    #[must_use]
    pub fn position_at(&self, i: f64, j: f64) -> [f64; 2] {
        let d = self.distortion.as_ref().map_or([0.0; 2], |d| d.at(i, j));
        [
            self.centre[0] + i * self.basis[0][0] + j * self.basis[1][0] + d[0],
            self.centre[1] + i * self.basis[0][1] + j * self.basis[1][1] + d[1],
        ]
    }

    /// Fractional lattice indices of a place in the frame (px): the inverse of [`Grid::position_at`].
    #[must_use]
    pub fn indices_at(&self, x: f64, y: f64) -> [f64; 2] {
        let reciprocal = reciprocal(self.basis);
        let invert = |x: f64, y: f64| {
            let (dx, dy) = (x - self.centre[0], y - self.centre[1]);
            [dx * reciprocal[0][0] + dy * reciprocal[0][1], dx * reciprocal[1][0] + dy * reciprocal[1][1]]
        };
        let mut indices = invert(x, y);
        if let Some(distortion) = &self.distortion {
            // The departure is a small fraction of the pitch and smooth: each round gains two digits or more.
            for _ in 0..4 {
                let d = distortion.at(indices[0], indices[1]);
                indices = invert(x - d[0], y - d[1]);
            }
        }
        indices
    }

    /// Lattice indices of the micro-image whose centre is nearest to a place in the frame (px).
    #[must_use]
    pub fn index_of(&self, x: f64, y: f64) -> [i32; 2] {
        let at = self.indices_at(x, y);
        let rounded = [at[0].round() as i32, at[1].round() as i32];
        if self.array == ArrayKind::Square {
            return rounded;
        }
        // Rounding the oblique indices of a hexagonal lattice can miss by one step.
        let mut best = rounded;
        let mut best_distance = f64::INFINITY;
        for [di, dj] in [[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, -1], [-1, 1]] {
            let (i, j) = (rounded[0].saturating_add(di), rounded[1].saturating_add(dj));
            let (u, v) = (f64::from(i) - at[0], f64::from(j) - at[1]);
            let dx = u * self.basis[0][0] + v * self.basis[1][0];
            let dy = u * self.basis[0][1] + v * self.basis[1][1];
            let distance = dx * dx + dy * dy;
            if distance < best_distance {
                (best, best_distance) = ([i, j], distance);
            }
        }
        best
    }

    /// The micro-image whose centre is nearest to a place in the frame (px). It may lie outside the frame.
    #[must_use]
    pub fn nearest(&self, x: f64, y: f64) -> MicroImage {
        let [i, j] = self.index_of(x, y);
        let [x, y] = self.position(i, j);
        MicroImage { i, j, x, y }
    }

    /// Every micro-image whose centre is at least `margin_px` inside the frame's outline (the outer edges of its
    /// pixels), row by row of the lattice: `pitch_px() / 2` gives the complete ones, a negative margin also those
    /// outside.
    pub fn micro_images_within(&self, margin_px: f64) -> impl Iterator<Item = MicroImage> + '_ {
        let [right, bottom] = self.frame_size.map(|n| n as f64 - 0.5 - margin_px);
        let least = margin_px - 0.5;
        // Bounds of j over the frame, and for each j those of i, from the corners and edges in lattice coordinates,
        // with a step to spare for the distortion.
        let r = reciprocal(self.basis);
        let corners = [[least, least], [right, least], [least, bottom], [right, bottom]];
        let v = corners.map(|c| (c[0] - self.centre[0]) * r[1][0] + (c[1] - self.centre[1]) * r[1][1]);
        let low = v.iter().copied().fold(f64::INFINITY, f64::min).floor() as i32 - 1;
        let high = v.iter().copied().fold(f64::NEG_INFINITY, f64::max).ceil() as i32 + 1;
        (low..=high).flat_map(move |j| {
            // basis[0] lies within 45° of +x, so that its x component bounds i.
            let x0 = self.centre[0] + f64::from(j) * self.basis[1][0];
            let (first, last) = ((least - x0) / self.basis[0][0], (right - x0) / self.basis[0][0]);
            ((first.floor() as i32 - 1)..=(last.ceil() as i32 + 1)).filter_map(move |i| {
                let [x, y] = self.position(i, j);
                (x >= least && x <= right && y >= least && y <= bottom).then_some(MicroImage { i, j, x, y })
            })
        })
    }

    /// Greatest distance between the places that this grid and another have for the same micro-image, among those about
    /// the frame's centre and corners, px.
    pub(crate) fn distance_to(&self, other: &Self) -> f64 {
        let [w, h] = self.frame_size.map(|n| n as f64 - 1.0);
        [[0.0, 0.0], [w, 0.0], [0.0, h], [w, h], [w / 2.0, h / 2.0]]
            .iter()
            .map(|&[x, y]| {
                let [i, j] = self.indices_at(x, y);
                let to = other.position_at(i, j);
                (to[0] - x).hypot(to[1] - y)
            })
            .fold(0.0, f64::max)
    }

    /// Number of complete micro-images: those whose centre is at least half a pitch inside the frame.
    #[must_use]
    pub fn micro_images(&self) -> usize {
        self.micro_images_within(self.pitch_px() / 2.0).count()
    }

    /// Distance of nearest neighbours, px (mean over the basis).
    #[must_use]
    pub fn pitch_px(&self) -> f64 {
        let length = |v: [f64; 2]| v[0].hypot(v[1]);
        f64::midpoint(length(self.basis[0]), length(self.basis[1]))
    }

    /// Rotation from +x towards +y, radians: in (−45°, 45°] for square, (−30°, 30°] for hexagonal arrays. The mean
    /// over the basis: shear does not enter.
    #[must_use]
    pub fn rotation(&self) -> f64 {
        let period = match self.array {
            ArrayKind::Square => std::f64::consts::FRAC_PI_2,
            ArrayKind::Hexagonal => std::f64::consts::FRAC_PI_3,
        };
        let first = self.basis[0][1].atan2(self.basis[0][0]);
        let second = self.basis[1][1].atan2(self.basis[1][0]) - period;
        let shear = (second - first + period / 2.0).rem_euclid(period) - period / 2.0;
        let angle = (first + shear / 2.0).rem_euclid(period);
        if angle > period / 2.0 { angle - period } else { angle }
    }

    /// Steps from a micro-image to its nearest neighbours in lattice indices, one of each opposite pair: two for a
    /// square array, three for a hexagonal one.
    #[must_use]
    pub fn neighbour_steps(&self) -> &'static [[i32; 2]] {
        match self.array {
            ArrayKind::Square => &[[1, 0], [0, 1]],
            ArrayKind::Hexagonal => &[[1, 0], [0, 1], [-1, 1]],
        }
    }
}

/// Rows that turn a displacement (px) into lattice indices: the lattice's reciprocal basis, cycles per px.
pub(crate) fn reciprocal(basis: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let [[ax, ay], [bx, by]] = basis;
    let area = ax * by - ay * bx;
    [[by / area, -bx / area], [-ay / area, ax / area]]
}
