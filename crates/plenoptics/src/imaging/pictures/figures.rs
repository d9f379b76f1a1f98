//! What a frame's micro-images show, in numbers.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::Pictures;
use crate::imaging::depth::{DepthState, LensDepth};

/// Least, quartiles and greatest of something.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Spread {
    /// The least.
    pub least: f64,
    /// A quarter is below.
    pub lower_quartile: f64,
    /// Half is below.
    pub median: f64,
    /// A quarter is above.
    pub upper_quartile: f64,
    /// The greatest.
    pub greatest: f64,
}

impl Spread {
    /// Of some values; `None` where there are none.
    pub fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.collect();
        values.sort_unstable_by(f64::total_cmp);
        let last = values.len().checked_sub(1)?;
        let at = |quarters: usize| values[last * quarters / 4];
        Some(Self { least: at(0), lower_quartile: at(1), median: at(2), upper_quartile: at(3), greatest: at(4) })
    }
}

/// What is known about all micro-images together.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct DepthFigures {
    /// Columns and rows of the frame.
    pub frame_px: [usize; 2],
    /// `square` or `hexagonal`.
    pub array: String,
    /// Distance of neighbouring micro-images, px.
    pub micro_image_pitch_px: f64,
    /// Micro-images wholly within the frame.
    pub micro_images: usize,
    /// Of them with a spacing from their own texture.
    pub measured: usize,
    /// Of them with a spacing from those around them.
    pub inferred: usize,
    /// Of them about which nothing can be known.
    pub unknown: usize,
    /// Spacings, px; absent where none is known.
    pub spacing_px: Option<Spread>,
    /// Sizes of the patches that a view takes, px.
    pub patch_px: Option<Spread>,
    /// Virtual depths a/b.
    pub virtual_depth: Option<Spread>,
    /// Distances along the axis, mm; absent without a pose.
    pub distance_mm: Option<Spread>,
    /// Structural similarity of the micro-images' patches with the matching content of their neighbours, mean, −1 to 1.
    pub ssim_mean: f64,
}

/// What is known about one micro-image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LensFigures {
    /// Lattice indices.
    pub index: [i32; 2],
    /// Centre, px of the raw frame.
    pub centre_px: [f64; 2],
    /// Spacing, px; where unknown a guess.
    pub spacing_px: f64,
    /// Its standard uncertainty, px; `null` where unknown.
    pub sigma_px: Option<f64>,
    /// Structural similarity with the matching content of its neighbours, −1 to 1.
    pub ssim: f64,
    /// Where the spacing comes from.
    pub state: DepthState,
    /// a/b; `null` where unknown.
    pub virtual_depth: Option<f64>,
    /// Distance along the axis, mm; `null` where unknown, or without a pose.
    pub distance_mm: Option<f64>,
}

impl Pictures {
    /// What is known about all micro-images together. `mla_pitch_px` is D_MLA.
    #[must_use]
    pub fn figures(&self, mla_pitch_px: f64) -> DepthFigures {
        let grid = self.grid();
        let pitch_px = grid.pitch_px();
        let lenses = &self.depth.lenses;
        let count = |state: DepthState| lenses.iter().filter(|lens| lens.state == state).count();
        let known = || lenses.iter().filter(|lens| is_known(lens)).map(|lens| lens.spacing_px);
        DepthFigures {
            frame_px: grid.frame_size,
            array: grid.array.name().to_owned(),
            micro_image_pitch_px: pitch_px,
            micro_images: lenses.len(),
            measured: count(DepthState::Measured),
            inferred: count(DepthState::Inferred),
            unknown: count(DepthState::Unknown),
            spacing_px: Spread::of(known()),
            patch_px: Spread::of(known().map(|spacing_px| (pitch_px - spacing_px).abs())),
            virtual_depth: Spread::of(known().map(|spacing_px| virtual_depth(spacing_px, mla_pitch_px))),
            distance_mm: Spread::of(self.distances_mm.iter().copied().flatten()),
            ssim_mean: self.depth.ssim_mean(),
        }
    }

    /// What is known about every micro-image. `mla_pitch_px` is D_MLA.
    pub fn lens_figures(&self, mla_pitch_px: f64) -> impl Iterator<Item = LensFigures> {
        self.depth.lenses.iter().zip(&self.distances_mm).map(move |(lens, &distance_mm)| {
            let known = is_known(lens);
            LensFigures {
                index: lens.index,
                centre_px: lens.centre_px,
                spacing_px: lens.spacing_px,
                sigma_px: known.then_some(lens.sigma_px),
                ssim: lens.ssim,
                state: lens.state,
                virtual_depth: known.then(|| virtual_depth(lens.spacing_px, mla_pitch_px)),
                distance_mm,
            }
        })
    }
}

fn is_known(lens: &LensDepth) -> bool {
    lens.state != DepthState::Unknown
}

/// a/b of a spacing, from Eq. 9: l = D (1 − b/a).
fn virtual_depth(spacing_px: f64, mla_pitch_px: f64) -> f64 {
    mla_pitch_px / (mla_pitch_px - spacing_px)
}
