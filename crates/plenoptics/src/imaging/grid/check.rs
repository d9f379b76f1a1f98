//! Whether a known grid still fits, from a spread sample of its micro-images: cheap enough for every frame of a live
//! view.
//!
//! The same two steps as for a whole frame, harmonics and then the mean profile, but about a few hundred micro-images and
//! from every few pixels of them; the rest of the frame is not touched.

use super::demodulate::Demodulator;
use super::fit::Model;
use super::frame::Frame;
use super::phases::Phases;
use super::profile::{Effort, Known, matched_best};
use super::search::{CLEAN_SCATTER, PITCH_FOLLOWED};
use super::{Grid, GridError, MicroImage};
use crate::imaging::vignetting::Vignetting;
use crate::raw::RawImage;

/// Micro-images looked at in frames up to four megapixels, and in the largest; in between one for so many pixels.
const MICRO_IMAGES: usize = 256;
const MICRO_IMAGES_MOST: usize = 768;
const PIXELS_EACH: usize = 16_384;
/// Fewest that say anything of the grid.
const MICRO_IMAGES_LEAST: usize = 9;
/// Samples a pitch, in both directions: the first harmonic needs no more.
const SAMPLES_PER_PITCH: f64 = 10.0;
/// Coherence below which the array is gone: noise and other arrays reach 0.15 by chance, a chequered board under a
/// hexagonal array comes down to 0.33.
const COHERENCE_LOST: f64 = 0.25;
/// Share of the best coherence at which a known grid counts as the start: a shift of a tenth of a pitch.
const AS_GOOD: f64 = 0.8;
/// What the mean profile may cost: two rounds bring it as near as so few micro-images can tell.
const EFFORT: Effort = Effort { step: 1, rounds: 4, at_rest_px: 0.1 };

/// How a frame's micro-images lie against a known grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridCheck {
    /// Where the frame has the grid less where the grid has it, at the frame's centre: x and y, px. Whole steps of the
    /// lattice cannot be seen.
    pub shift_px: [f64; 2],
    /// Standard error of each of the two, px, from the scatter among the micro-images: texture is in it.
    pub shift_sigma_px: f64,
    /// Relative change of the pitch.
    pub scale_change: f64,
    /// Its standard error.
    pub scale_change_sigma: f64,
    /// Length of the shift at the worst of the frame's centre and corners, px.
    pub displacement_px: f64,
    /// Standard error of the displacement in a corner, px.
    pub displacement_sigma_px: f64,
    /// How far the phases agree once shift and scale are taken out, from 0 (noise) to 1 (a clean white frame).
    pub coherence: f64,
    /// Modulation of the frame's logarithm at the lattice's first harmonics, median over the micro-images.
    pub contrast: f64,
    /// Micro-images looked at.
    pub micro_images: usize,
}

/// What a [`GridCheck`] comes down to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GridState {
    /// The grid holds.
    Fits,
    /// The array is there and has moved: the grid is to be refined.
    Moved,
    /// Nothing in the frame is in step with the grid: it is to be found anew.
    Lost,
}

impl GridCheck {
    /// Displacement up to which a grid counts as unmoved, px.
    pub const TOLERANCE_PX: f64 = 0.1;

    /// Whether the grid still holds, to [`Self::TOLERANCE_PX`]. What texture alone would do (three standard errors) is
    /// no movement.
    #[must_use]
    pub fn state(&self) -> GridState {
        if self.coherence < COHERENCE_LOST || self.scale_change.abs() > PITCH_FOLLOWED {
            GridState::Lost
        } else if self.displacement_px > Self::TOLERANCE_PX.max(3.0 * self.displacement_sigma_px) {
            GridState::Moved
        } else {
            GridState::Fits
        }
    }
}

/// Checks a known grid against a frame, white or textured: shift, change of the pitch and coherence, from a few hundred
/// micro-images spread over the frame.
///
/// A white frame is checked to hundredths of a pixel. A textured one is compared with `white`, the profile of a white
/// frame of the same grid, which says to a tenth or two of a pixel where the array is; without one it is compared with
/// its own mean profile, which is up to three times worse. The standard errors say how far to trust it.
///
/// # Errors
/// [`GridError::OtherFrameSize`], [`GridError::Blank`], [`GridError::Saturated`]; [`GridError::DoesNotFit`] where too
/// few of the grid's micro-images lie in the frame.
pub fn check_grid(image: &RawImage, grid: &Grid, white: Option<&Vignetting>) -> Result<GridCheck, GridError> {
    let size = [image.width(), image.height()];
    if size != grid.frame_size {
        return Err(GridError::OtherFrameSize { grid: grid.frame_size, frame: size });
    }
    let frame = Frame::glanced(image)?;
    let step = ((grid.pitch_px() / SAMPLES_PER_PITCH).round() as usize).max(1);
    let demodulator = Demodulator::new(grid, step);
    let chosen = spread(grid);
    let lenses = demodulator.run(&frame, &chosen, [0, 0, size[0], size[1]]);
    let too_few = || GridError::DoesNotFit { reason: "too few of its micro-images lie in the frame".to_owned() };
    if lenses.len() < MICRO_IMAGES_LEAST {
        return Err(too_few());
    }
    let phases = Phases::new(grid, &lenses, &demodulator.harmonics);
    let together = phases.brought_together(PITCH_FOLLOWED);
    let coherence = phases.coherence_about(&together);
    // Texture shifts the phases, and the mean profile hardly: in a clean frame they are the better of the two.
    let clean = phases.scatter_about(&together) < CLEAN_SCATTER * grid.pitch_px();
    let fit = if clean {
        // About where the micro-images are: a window that is off by pixels sees their neighbours unevenly.
        let moved: Vec<MicroImage> = chosen
            .iter()
            .map(|m| {
                let [x, y] = together.position(m.i, m.j);
                MicroImage { x, y, ..*m }
            })
            .collect();
        let lenses = demodulator.run(&frame, &moved, [0, 0, size[0], size[1]]);
        Phases::new(&together, &lenses, &demodulator.harmonics).fit(Model::ScaleShift)
    } else {
        let profile = |u: f64, v: f64| white.map_or(0.0, |white| f64::from(white.transmission(u, v, 0.0, 0.0)));
        let known: Option<Known> = if white.is_some() { Some(&profile) } else { None };
        // From the known grid itself where the phases have nothing against it: their own place is astray by texture.
        let mut starts = vec![grid.clone()];
        if phases.coherence() < AS_GOOD * coherence {
            starts.push(together);
        }
        matched_best(&frame, &starts, &chosen, known, Model::ScaleShift, Effort { step, ..EFFORT }).map(|m| m.fit)
    };
    let fit = fit.ok_or_else(too_few)?;
    let middle = size.map(|n| (n as f64 - 1.0) / 2.0);
    let [i, j] = grid.indices_at(middle[0], middle[1]);
    let now = fit.grid.position_at(i, j);
    let corner = middle[0].hypot(middle[1]);
    let [sigma_x, sigma_y, sigma_scale] = fit.sigma;
    let factor = if clean {
        1.0
    } else {
        // Measured on exact-ray frames of four textures: a profile taken from the frame itself errs with the frame, and
        // the less the micro-images agree the further they err together.
        let own = if white.is_some() { 1.3 } else { 3.0 };
        own * shared_scene(grid, lenses.len()).sqrt() / coherence.max(COHERENCE_LOST)
    };
    let (shift_sigma_px, scale_change_sigma) = (factor * sigma_x.max(sigma_y), factor * sigma_scale);
    Ok(GridCheck {
        shift_px: [now[0] - middle[0], now[1] - middle[1]],
        shift_sigma_px,
        scale_change: fit.grid.pitch_px() / grid.pitch_px() - 1.0,
        scale_change_sigma,
        displacement_px: fit.grid.distance_to(grid),
        displacement_sigma_px: shift_sigma_px.hypot(scale_change_sigma * corner),
        coherence,
        contrast: phases.modulation(),
        micro_images: lenses.len(),
    })
}

/// Micro-images all over the frame, one by chance from each of as many parts of it: at even distances they would be in
/// step with a chequered board, and what its squares do to them would add up.
fn spread(grid: &Grid) -> Vec<MicroImage> {
    let [w, h] = grid.frame_size.map(|n| n as f64);
    // A window reaches about a pitch about its micro-image.
    let margin = grid.pitch_px();
    let (inner_w, inner_h) = ((w - 2.0 * margin).max(1.0), (h - 2.0 * margin).max(1.0));
    let count = (grid.frame_size[0] * grid.frame_size[1] / PIXELS_EACH).clamp(MICRO_IMAGES, MICRO_IMAGES_MOST);
    // As many rows as columns to the length.
    let columns = ((count as f64 * inner_w / inner_h).sqrt() as usize).clamp(1, count);
    let rows = (count / columns).max(1);
    let mut state = 1u64;
    let mut chance = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut found: Vec<MicroImage> = (0..columns * rows)
        .map(|k| {
            let x = inner_w * ((k % columns) as f64 + chance()) / columns as f64;
            let y = inner_h * ((k / columns) as f64 + chance()) / rows as f64;
            grid.nearest(margin + x, margin + y)
        })
        .collect();
    // Frames of few micro-images meet some of them twice.
    found.sort_by_key(|m| (m.j, m.i));
    found.dedup_by_key(|m| (m.j, m.i));
    found
}

/// How many of so many micro-images over the frame show the same piece of scene, and err together.
fn shared_scene(grid: &Grid, lenses: usize) -> f64 {
    /// Pitches over which micro-images show a scene again.
    const REACH: f64 = 2.5;
    let [w, h] = grid.frame_size.map(|n| n as f64 / grid.pitch_px());
    (REACH * REACH * lenses as f64 / (w * h)).max(1.0)
}
