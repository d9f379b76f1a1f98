//! Following the grid from frame to frame.
//!
//! The lattice's phases say whether there is a lattice, and where to within the pitch; places by the profile say where to
//! hundredths of a pixel. What single frames say is combined by a Kalman filter whose grid may drift: its gain follows from
//! how far the places can be believed. Texture moves them as much as noise does, and is the same in frame after frame: so
//! the micro-images take turns. A jump is followed at once.

use nalgebra::{Matrix4, Vector4};

use super::LiveError;
use super::lattice::{Lattice, LatticeFit};
use super::places::{Placed, Places, Turn};
use crate::imaging::grid::{Grid, GridSigma};
use crate::imaging::matching::motion::{Field, Motion};
use crate::imaging::matching::samples::{Frame, Sample};
use crate::imaging::vignetting::Vignetting;

/// Agreement of the lattice's phases below which there is no lattice.
const LEAST_COHERENCE: f64 = 0.3;
/// Standard uncertainties beyond which a displacement by the phases is sure: neighbouring micro-images show the same
/// texture, so that the scatter between them says too little.
const SURE: f64 = 4.0;
/// Displacement (px) by the phases beyond which places are also looked for where they have them.
const FAR_PX: f64 = 1.0;
/// Displacement in pitches that the phases can tell: from half a pitch on they say as well that the next micro-image has
/// come nearer.
const MOST_PITCHES: f64 = 0.4;
/// Drift from one frame to the next, px: an assembler at its fastest moves the edge of a large frame by half as much again.
const DRIFT_PX: f64 = 0.02;
/// The same of the rotation: no motor turns the array.
const TURN_PX: f64 = 0.0005;
/// How far the rotation of the grid given may be off, px, where the first frame does not say otherwise.
const FIRST_TURN_PX: f64 = 0.05;
/// Share of what a frame says of a departure that is followed at least: with it a drift of 1 px/s at 30 frames/s is followed
/// less than 0.1 px behind.
const LEAST_GAIN: f64 = 0.3;
/// A departure that is a jump: so many px beyond so many standard uncertainties.
const JUMP_PX: f64 = 0.1;
const JUMP_SIGMAS: f64 = 3.0;
/// Step (px) that leaves places as they are, within which the comparison with the profile is linear.
const LINEAR_PX: f64 = 0.3;
/// Most steps.
const STEPS: usize = 8;

/// Follows a grid.
#[derive(Debug)]
pub(super) struct Follower {
    grid: Grid,
    field: Field,
    lattice: Lattice,
    places: Places,
    /// How the grid has moved up to the newest frame, and its covariance (px²): none before the first.
    motion: Motion,
    covariance: Option<Matrix4<f64>>,
}

impl Follower {
    pub(super) fn new(grid: &Grid, profile: &Vignetting) -> Self {
        Self {
            grid: grid.clone(),
            field: Field::new(grid.frame_size),
            lattice: Lattice::new(grid),
            places: Places::new(grid, profile),
            motion: Motion::NONE,
            covariance: None,
        }
    }

    /// How the grid has moved up to the newest frame.
    pub(super) const fn motion(&self) -> &Motion {
        &self.motion
    }

    pub(super) const fn field(&self) -> &Field {
        &self.field
    }

    /// The grid as it was given.
    pub(super) const fn given(&self) -> &Grid {
        &self.grid
    }

    /// The grid where it is now.
    pub(super) fn grid(&self) -> Grid {
        let mut grid = self.motion.of(&self.grid);
        if let Some(covariance) = &self.covariance {
            let sigma = |k: usize| covariance[(k, k)].sqrt();
            grid.sigma = GridSigma {
                pitch_px: sigma(2) / self.field.half * grid.pitch_px(),
                rotation_rad: sigma(3) / self.field.half,
                centre_px: sigma(0).max(sigma(1)),
            };
        }
        grid
    }

    /// Standard uncertainty of the displacement in a corner, px.
    pub(super) fn sigma_px(&self) -> f64 {
        self.covariance.map_or(f64::INFINITY, |covariance| self.field.sigma(&covariance))
    }

    /// Follows from where the grid was found in a whole frame.
    pub(super) fn start_from(&mut self, found: &Grid) {
        self.motion = Motion::between(&self.grid, found);
        let GridSigma { pitch_px, rotation_rad, centre_px } = found.sigma;
        let scale_px = pitch_px / found.pitch_px() * self.field.half;
        let sigmas = Vector4::new(centre_px, centre_px, scale_px, rotation_rad * self.field.half);
        self.covariance = Some(Matrix4::from_diagonal(&sigmas.component_mul(&sigmas)));
    }

    /// Follows the grid into a frame of so much noise (grey levels).
    pub(super) fn follow<T: Sample>(&mut self, frame: &Frame<'_, T>, bits: u8, noise: f64) -> Result<(), LiveError> {
        let fit = self.lattice.look(frame, bits, noise, &self.motion);
        let LatticeFit { shift_px, sigma_px, coherence, .. } = fit;
        // Where micro-images differ by more than the phases can tell there is no saying how far they moved.
        if coherence < LEAST_COHERENCE {
            return Err(LiveError::GridNotSeen { coherence, least: LEAST_COHERENCE });
        }
        let most_px = MOST_PITCHES * self.grid.pitch_px();
        if shift_px > most_px + SURE * sigma_px {
            return Err(LiveError::GridMoved { shift_px, sigma_px, most_px });
        }
        let found = self.placed(frame, &fit);
        match found {
            Some(found) => self.combine(&found),
            // Too few micro-images have their whole cell in the frame.
            None => {
                let covariance = Matrix4::identity() * (sigma_px / 2.0).powi(2);
                self.combine(&Placed { motion: Motion(self.motion.0 + fit.motion.0), covariance, error_log: 0.0 });
            }
        }
        Ok(())
    }

    /// Where the micro-images are by their profile: about where they were, or where the phases have them if that is
    /// elsewhere and fits better.
    fn placed<T: Sample>(&mut self, frame: &Frame<'_, T>, fit: &LatticeFit) -> Option<Placed> {
        let first = self.covariance.is_none();
        let start = self.motion;
        let far = fit.shift_px > if first { FAR_PX } else { FAR_PX + SURE * fit.sigma_px };
        if !far && !first {
            return self.settled(frame, start, Turn::Next);
        }
        let here = self.settled(frame, start, Turn::All);
        let there = if far { self.settled(frame, Motion(start.0 + fit.motion.0), Turn::All) } else { None };
        match (here, there) {
            (Some(here), Some(there)) => Some(if there.error_log < here.error_log { there } else { here }),
            (here, there) => here.or(there),
        }
    }

    /// Steps until the comparison with the profile is a linear one.
    fn settled<T: Sample>(&mut self, frame: &Frame<'_, T>, start: Motion, turn: Turn) -> Option<Placed> {
        let dark = self.lattice.dark();
        let mut about = start;
        let mut turn = turn;
        for step in 1..=STEPS {
            let found = self.places.look(frame, dark, &about, turn)?;
            let moved = Motion(found.motion.0 - about.0).greatest(&self.field);
            if moved < LINEAR_PX || step == STEPS {
                return Some(found);
            }
            about = found.motion;
            if turn == Turn::Next {
                turn = Turn::Again;
            }
        }
        None
    }

    /// Takes in what a frame says.
    fn combine(&mut self, found: &Placed) {
        let noise = found.covariance;
        let mut before = self.covariance.unwrap_or_else(|| {
            let far = self.grid.pitch_px().powi(2);
            Matrix4::from_diagonal(&Vector4::new(far, far, far, FIRST_TURN_PX.powi(2)))
        });
        // A drift of so much as makes the gain the least, where the frame says little.
        let least = LEAST_GAIN * LEAST_GAIN / (1.0 - LEAST_GAIN);
        for k in 0..3 {
            before[(k, k)] += DRIFT_PX.powi(2).max(least * noise[(k, k)]);
        }
        before[(3, 3)] += TURN_PX.powi(2);
        let departure = found.motion.0 - self.motion.0;
        let sum = before + noise;
        let beyond = |departure: f64, variance: f64| departure > JUMP_PX + JUMP_SIGMAS * variance.sqrt();
        let jumped = beyond(Motion(departure).greatest(&self.field), self.field.sigma(&sum).powi(2))
            || beyond(departure[3].abs(), sum[(3, 3)]);
        match sum.try_inverse() {
            Some(inverse) if !jumped => {
                let gain = before * inverse;
                self.motion = Motion(self.motion.0 + gain * departure);
                let after = (Matrix4::identity() - gain) * before;
                self.covariance = Some((after + after.transpose()) * 0.5);
            }
            _ => {
                self.motion = found.motion;
                self.covariance = Some(noise);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::ArrayKind;

    fn follower() -> Follower {
        let grid = Grid::affine(ArrayKind::Square, [250.3, 200.1], [[21.3, 0.4], [-0.4, 21.3]], [500, 400]);
        Follower::new(&grid, &Vignetting::from_terms(4, vec![[1.0, 0.0, 0.0, 0.0]; 16], false))
    }

    fn placed(motion: [f64; 4], sigma: f64) -> Placed {
        Placed { motion: Motion(motion.into()), covariance: Matrix4::identity() * sigma * sigma, error_log: 0.0 }
    }

    #[test]
    fn a_drift_is_followed_closely_and_a_jump_at_once() {
        for sigma in [0.01, 0.05, 0.2] {
            let mut follower = follower();
            follower.combine(&placed([3.0, -2.0, 1.0, 0.01], sigma));
            assert!((follower.motion.0.xyz() - Vector4::new(3.0, -2.0, 1.0, 0.0).xyz()).norm() < 0.01);
            // One px a second at 30 frames a second.
            for frame in 1..=60 {
                follower.combine(&placed([3.0, -2.0, 1.0 + f64::from(frame) / 30.0, 0.0], sigma));
            }
            assert!((follower.motion.0[2] - 3.0).abs() < 0.09, "{sigma}: {:?}", follower.motion);
            assert!(follower.sigma_px() < 1.5 * follower.field.sigma(&(Matrix4::identity() * sigma * sigma)));
            for jump in [[5.0, -2.0, 3.0, 0.0], [5.0, -2.0, 3.0, 1.5]] {
                follower.combine(&placed(jump, sigma));
                assert!((follower.motion.0 - Vector4::from(jump)).norm() < 0.1, "{sigma}: {:?}", follower.motion);
            }
        }
    }

    #[test]
    fn what_frames_say_is_averaged_as_far_as_it_is_uncertain() {
        let mut follower = follower();
        for frame in 0..100 {
            let error = if frame % 2 == 0 { 0.1 } else { -0.1 };
            follower.combine(&placed([error, error, 0.0, error], 0.1));
        }
        assert!(follower.motion.0.xyz().amax() < 0.03 && follower.motion.0[3].abs() < 0.01, "{:?}", follower.motion);
    }
}
