//! The spacing of every single micro-image, and hence how far away what it sees is.
//!
//! ```text
//!   frame.rs    a frame made ready: micro-images, neighbours, noise; overlap.rs: the pixels that two neighbours share
//!   volume.rs   how alike neighbours are (SSIM) at every spacing that they may have
//!   paths.rs    the spacing of each micro-image that its neighbours allow: semi-global matching over the lattice
//!   refine.rs   from there to parts of a pixel, pair by pair (fit.rs), each with its uncertainty
//!   settle.rs   micro-images from their pairs, and those without texture from those with it, as far as they reach
//! ```
//!
//! The size of a micro-image's patch in a view is the pitch less its spacing, so that choosing a patch's size by how well
//! it agrees with the matching content of its neighbours is the same search. Distances follow from spacings by
//! [`crate::optics::DistanceTable`].

mod fit;
mod frame;
mod overlap;
mod paths;
mod refine;
mod settle;
mod volume;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

pub use frame::DepthFrame;

use super::grid::Grid;
use super::spacing::capture_range;
use crate::optics::MlaMode;

/// Steps of the search over the spacing for each micro-image pitch.
const STEPS_PER_PITCH: f64 = 50.0;
/// Least step, px: finer ones tell nothing that the refinement does not.
const LEAST_STEP_PX: f64 = 0.5;

/// What is known before the spacings are looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthOptions {
    /// Least and greatest spacing that is looked for, px.
    pub spacing_px: [f64; 2],
    /// How far a micro-image without texture may take its spacing from those around it, as a standard uncertainty, px:
    /// beyond, it is unknown.
    pub sigma_max_px: f64,
}

impl DepthOptions {
    /// All that can be captured with an MLA of this pitch (px).
    #[must_use]
    pub fn new(mode: MlaMode, mla_pitch_px: f64) -> Self {
        Self { spacing_px: capture_range(mode).map(|share| share * mla_pitch_px), sigma_max_px: 0.5 }
    }
}

/// Where a micro-image's spacing comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum DepthState {
    /// From its own texture.
    Measured,
    /// From micro-images around it, for want of texture.
    Inferred,
    /// Nothing can be known.
    Unknown,
}

/// One micro-image's spacing.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LensDepth {
    /// Lattice indices in the frame's grid.
    pub index: [i32; 2],
    /// Centre of the micro-image, px.
    pub centre_px: [f64; 2],
    /// Spacing between its image points and its neighbours', px. Where unknown, the search's guess, for rendering only.
    pub spacing_px: f64,
    /// Standard uncertainty of that, px; infinite where unknown.
    pub sigma_px: f64,
    /// Structural similarity of the micro-image's patch with the matching content of its neighbours, −1 to 1.
    pub ssim: f64,
    /// Where the spacing comes from.
    pub state: DepthState,
}

/// The spacings over a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthMap {
    /// The micro-images' grid.
    pub grid: Grid,
    /// Every micro-image wholly within the frame, row by row of the lattice.
    pub lenses: Vec<LensDepth>,
    /// Where each lattice index is in `lenses`.
    places: Places,
}

impl DepthMap {
    /// Of micro-images that are given.
    #[cfg(test)]
    pub(in crate::imaging) fn of(grid: &Grid, lenses: Vec<LensDepth>) -> Self {
        let places = Places::new(lenses.iter().map(|lens| lens.index));
        Self { grid: grid.clone(), lenses, places }
    }

    /// The micro-image with these lattice indices, if it lies wholly within the frame.
    #[must_use]
    pub fn lens(&self, index: [i32; 2]) -> Option<&LensDepth> {
        self.place(index).map(|k| &self.lenses[k])
    }

    /// Structural similarity of the micro-images' patches with the matching content of their neighbours, mean over all
    /// of them, −1 to 1: how well the frame's views fit together.
    #[must_use]
    pub fn ssim_mean(&self) -> f64 {
        self.lenses.iter().map(|lens| lens.ssim).sum::<f64>() / self.lenses.len().max(1) as f64
    }

    /// Where in `lenses` the micro-image with these lattice indices is.
    #[must_use]
    pub fn place(&self, index: [i32; 2]) -> Option<usize> {
        self.places.of(index)
    }
}

/// Places of lattice indices in a list of micro-images.
#[derive(Debug, Clone, PartialEq)]
struct Places {
    origin: [i32; 2],
    size: [usize; 2],
    /// `u32::MAX` where there is none.
    places: Vec<u32>,
}

impl Places {
    fn new(indices: impl Iterator<Item = [i32; 2]> + Clone) -> Self {
        let (mut low, mut high) = ([i32::MAX; 2], [i32::MIN; 2]);
        for index in indices.clone() {
            for axis in 0..2 {
                low[axis] = low[axis].min(index[axis]);
                high[axis] = high[axis].max(index[axis]);
            }
        }
        if low[0] > high[0] {
            return Self { origin: [0; 2], size: [0; 2], places: Vec::new() };
        }
        let size = [0, 1].map(|axis| (high[axis] - low[axis]) as usize + 1);
        let mut places = vec![u32::MAX; size[0] * size[1]];
        for (k, index) in indices.enumerate() {
            places[(index[1] - low[1]) as usize * size[0] + (index[0] - low[0]) as usize] = k as u32;
        }
        Self { origin: low, size, places }
    }

    fn of(&self, index: [i32; 2]) -> Option<usize> {
        let [column, row] = [0, 1].map(|axis| index[axis].wrapping_sub(self.origin[axis]) as usize);
        if column >= self.size[0] || row >= self.size[1] {
            return None;
        }
        let place = self.places[row * self.size[0] + column];
        (place != u32::MAX).then_some(place as usize)
    }
}

/// The top of the parabola through a value and its neighbours, in steps from that value and within half of one; the value
/// itself where there is no top.
fn top(values: &[f32], at: usize) -> f64 {
    let Some(&[before, here, after]) = at.checked_sub(1).and_then(|first| values.get(first..first + 3)) else {
        return 0.0;
    };
    let bend = f64::from(2.0 * here - before - after);
    if bend <= 0.0 { 0.0 } else { (f64::from(after - before) / (2.0 * bend)).clamp(-0.5, 0.5) }
}

impl DepthFrame<'_> {
    /// The spacing of every micro-image.
    #[must_use]
    pub fn depth_map(&self, options: &DepthOptions) -> DepthMap {
        let [least, greatest] = options.spacing_px;
        let step = (self.grid.pitch_px() / STEPS_PER_PITCH).max(LEAST_STEP_PX);
        let count = ((greatest - least) / step).ceil().max(1.0) as usize + 1;
        let spacings: Vec<f64> =
            (0..count).map(|k| least + (greatest - least) * k as f64 / (count - 1) as f64).collect();
        let volume = volume::Volume::new(self, &spacings);
        let labels = paths::labels(self, &volume);
        let between = (greatest - least) / (count - 1) as f64;
        let chosen: Vec<f64> = labels
            .iter()
            .enumerate()
            .map(|(lens, &label)| spacings[label] + between * top(volume.ssim(lens), label))
            .collect();
        let pairs = refine::pairs(self, &chosen, options);
        let lenses = settle::settle(self, &chosen, &pairs, options)
            .into_iter()
            .zip(&self.lenses)
            .zip(labels.iter().enumerate())
            .map(|((settled, lens), (k, &label))| LensDepth {
                index: lens.index,
                centre_px: lens.centre,
                spacing_px: settled.spacing_px,
                sigma_px: settled.sigma_px,
                ssim: f64::from(volume.ssim(k)[label]),
                state: settled.state,
            })
            .collect();
        DepthMap { grid: self.grid.clone(), lenses, places: self.places.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_top_of_three_values_is_that_of_their_parabola() {
        let parabola = |x: f32| 3.0 - (x - 1.3).powi(2);
        let values: Vec<f32> = (0..4).map(|x| parabola(x as f32)).collect();
        assert!((top(&values, 1) - 0.3).abs() < 1e-6);
        assert_eq!([top(&values, 0), top(&values, 3)], [0.0; 2]);
        assert_eq!(top(&[1.0, 0.5, 1.0], 1), 0.0);
        // What goes on rising has its top beyond.
        assert_eq!(top(&[0.0, 0.9, 1.0], 1), 0.5);
    }
}
