//! A raw frame made ready for measuring: its light, micro-images, pairs, and noise.

use super::SpacingError;
use crate::imaging::grid::Grid;
use crate::imaging::matching::exposure::Exposure;
use crate::imaging::matching::gains::Light;
use crate::imaging::matching::masks::{MARGIN_PX, MASK_FRACTION, mask_radius};
use crate::imaging::matching::model::{Model, QUANTISATION};
use crate::imaging::matching::motion::Motion;
use crate::imaging::matching::normal::LEAST_PAIRS;
use crate::imaging::matching::plan::{Job, Pair, Plan};
use crate::imaging::matching::pupil::Pupil;
use crate::imaging::matching::run::Pass;
use crate::imaging::matching::samples::Frame;
use crate::imaging::matching::shape::Shape;
use crate::imaging::mosaic::green;
use crate::raw::{CfaPattern, RawImage};

/// One micro-image of a prepared frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MicroImage {
    /// Lattice indices in the frame's grid.
    pub index: [i32; 2],
    /// Its centre, px.
    pub centre: [f64; 2],
    /// Which of several regions it belongs to; `None`: it is left out.
    pub region: Option<usize>,
}

/// Standard deviation of a frame's noise as it shows within the micro-images of its grid, grey levels; `None` where they are
/// too few, dark or saturated.
#[must_use]
pub fn noise_about(raw: &RawImage, mosaic: Option<CfaPattern>, grid: &Grid) -> Option<f64> {
    let (width, height) = (raw.width(), raw.height());
    if grid.frame_size != [width, height] {
        return None;
    }
    let (samples, white) = levels_of(raw, mosaic);
    let plan = Plan::new(grid, &Motion::NONE, largest_radius(grid.pitch_px()) + MARGIN_PX, usize::MAX);
    if plan.pairs < LEAST_PAIRS {
        return None;
    }
    let frame = Frame { samples: &samples, width, height, white, mosaic };
    Exposure::new(&plan, largest_radius(grid.pitch_px()), usize::MAX).check(&frame, &plan).ok()
}

/// Grey levels of a raw frame, of a mosaic green's and what lies between them; and the level that is white.
fn levels_of(raw: &RawImage, mosaic: Option<CfaPattern>) -> (Vec<f32>, f32) {
    (mosaic.map_or_else(|| raw.to_f32(), |pattern| green(raw, pattern)), f32::from(raw.white_level()))
}

/// Radius of the largest masks on a lattice of this pitch, px.
fn largest_radius(pitch: f64) -> f64 {
    MASK_FRACTION * pitch / 2.0
}

/// A raw frame made ready for measuring its spacing.
#[derive(Debug, Clone)]
pub struct SpacingFrame {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Grey levels; of a mosaic green's, and what lies between them.
    samples: Vec<f32>,
    white: f32,
    pub(super) mosaic: Option<CfaPattern>,
    /// Share of light that reaches each pixel, relative to a micro-image's centre.
    shares: Vec<f32>,
    pub(super) plan: Plan,
    /// Micro-images wholly within the frame, in the plan's order.
    pub(super) micro_images: Vec<MicroImage>,
    /// Through how much of their microlens pixels see.
    pub(super) pupil: Pupil,
    /// Distance of nearest neighbours in the grid, px.
    pub(super) pitch: f64,
    /// Standard deviation of the raw frame's noise as estimated from itself, grey levels.
    pub(super) noise: f64,
    /// The lattice's basis, px.
    pub(super) basis: [[f64; 2]; 2],
}

impl SpacingFrame {
    /// Prepares a frame of a monochrome sensor, or of one with a Bayer mosaic: the spacing is then that of green.
    /// `vignetting` has one value for each pixel: the share of light that reaches it, relative to a micro-image's centre.
    ///
    /// # Errors
    /// [`SpacingError`] when the grid or the vignetting belong to another frame size, when there are too few
    /// micro-images, or when the frame is saturated or dark.
    pub fn new(
        raw: &RawImage,
        mosaic: Option<CfaPattern>,
        vignetting: &[f32],
        grid: &Grid,
    ) -> Result<Self, SpacingError> {
        let (width, height) = (raw.width(), raw.height());
        if grid.frame_size != [width, height] || vignetting.len() != width * height {
            return Err(SpacingError::WrongSize { frame: [width, height], grid: grid.frame_size });
        }
        let pitch = grid.pitch_px();
        let radius = largest_radius(pitch);
        let plan = Plan::new(grid, &Motion::NONE, radius + MARGIN_PX, usize::MAX);
        if plan.pairs < LEAST_PAIRS {
            return Err(SpacingError::TooFewMicroImages { pairs: plan.pairs, needed: LEAST_PAIRS });
        }
        let (samples, white) = levels_of(raw, mosaic);
        let frame = Frame { samples: &samples, width, height, white, mosaic };
        let noise = Exposure::new(&plan, radius, usize::MAX).check(&frame, &plan)?;
        let micro_images = (0..).zip(&plan.indices).map(|(lens, &index)| MicroImage {
            index,
            centre: plan.centre(lens),
            region: Some(0),
        });
        let micro_images: Vec<MicroImage> = micro_images.collect();
        let centres: Vec<[f64; 2]> = micro_images.iter().map(|m| m.centre).collect();
        let pupil = Pupil::new(&centres, pitch, |_, [x, y]| vignetting[y * width + x]);
        Ok(Self {
            width,
            height,
            samples,
            white,
            mosaic,
            shares: vignetting.to_vec(),
            plan,
            micro_images,
            pupil,
            pitch,
            noise,
            basis: grid.basis,
        })
    }

    /// Distance of nearest neighbours in the grid (the micro-image pitch), px.
    #[must_use]
    pub const fn micro_image_pitch_px(&self) -> f64 {
        self.pitch
    }

    /// Standard deviation of the raw frame's noise as one frame by itself shows it, grey levels: sharp texture makes it too
    /// large.
    #[must_use]
    pub const fn noise_grey_levels(&self) -> f64 {
        self.noise
    }

    /// Assigns each micro-image to a region, or leaves it out: pairs count only within one region.
    pub fn assign_regions(&mut self, region_of: impl Fn(&MicroImage) -> Option<usize>) {
        for k in 0..self.micro_images.len() {
            self.micro_images[k].region = region_of(&self.micro_images[k]);
        }
    }

    /// How many regions there are.
    pub(super) fn regions(&self) -> usize {
        self.micro_images.iter().filter_map(|m| m.region).max().map_or(1, |region| region + 1)
    }

    /// All pairs within regions.
    pub(super) fn pairs(&self) -> Vec<Pair> {
        let links = self.plan.jobs.iter().flat_map(Job::links);
        links.filter_map(|link| self.within(link.pair)).collect()
    }

    /// The work of comparing all pairs within regions.
    pub(super) fn jobs(&self) -> Vec<Job> {
        self.jobs_of(Some)
    }

    /// The work of comparing the pairs within regions that `taken` leaves, as it leaves them.
    pub(super) fn jobs_of(&self, taken: impl Fn(Pair) -> Option<Pair>) -> Vec<Job> {
        let jobs = self.plan.jobs.iter().map(|job| {
            let pairs: Vec<Pair> = job.links().filter_map(|link| taken(self.within(link.pair)?)).collect();
            self.plan.job(&pairs)
        });
        jobs.filter(|job| !job.rows.is_empty()).collect()
    }

    /// A pair with the region that both of its micro-images belong to.
    fn within(&self, pair: Pair) -> Option<Pair> {
        let [a, b] = [pair.first, pair.second].map(|lens| self.micro_images[lens as usize].region);
        a.filter(|_| a == b).map(|region| Pair { region: region as u8, ..pair })
    }

    /// Noise (grey levels) in this unit of the frame's own estimate.
    pub(super) fn noise(&self, scale: f64) -> f64 {
        (self.noise * scale).max(QUANTISATION)
    }

    /// Radius of the masks for spacings near these, px.
    pub(super) fn radius_for(&self, spacings: &[f64]) -> f64 {
        spacings.iter().map(|&spacing| mask_radius(&self.pupil, spacing)).fold(0.0, f64::max)
    }

    /// Radius (px) about the centres within which pixels see through their whole microlens.
    pub(super) fn whole_radius(&self) -> f64 {
        0.5 * self.pupil.whole * self.pitch
    }

    /// Radius of the largest masks, px.
    pub(super) fn largest_radius(&self) -> f64 {
        largest_radius(self.pitch)
    }

    /// Has `work` compare pairs at a model within masks of this radius (px), at a noise in this unit of the frame's own
    /// estimate.
    pub(super) fn at<R>(
        &self,
        model: &Model,
        radius: f64,
        noise_scale: f64,
        work: impl FnOnce(&Pass<'_, f32>) -> R,
    ) -> R {
        let Self { width, height, white, mosaic, .. } = *self;
        work(&Pass {
            frame: &Frame { samples: &self.samples, width, height, white, mosaic },
            light: Light::Shares(&self.shares, [width, height]),
            lenses: &self.plan.lenses,
            model,
            shape: &Shape::new(radius),
            noise: self.noise(noise_scale),
        })
    }
}
