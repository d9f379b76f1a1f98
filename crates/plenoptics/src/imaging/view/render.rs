//! View pixels from the micro-images about them.

use rayon::prelude::*;

use super::cells::Cells;
use super::taps::{Cubic, Linear, Taps};
use super::{Blend, Extent, PATCH_LEAST_PX, Patches, View, ViewError, ViewFrame, ViewOptions};
use crate::imaging::depth::{DepthMap, DepthState};
use crate::imaging::grid::{Grid, reciprocal};

/// Weight of a micro-image whose spacing is not known beside those whose is.
const UNKNOWN_WEIGHT: f32 = 0.05;
/// Weight that what lies beyond the used part of a micro-image keeps, so that a place which nothing else shows is not
/// left out.
const BEYOND_WEIGHT: f32 = 1e-4;
/// Difference in spacing that makes it doubtful whether two micro-images see the same surface, px.
const SAME_SURFACE_PX: f32 = 0.75;
/// Pixels over which a micro-image's used part ends.
const EDGE_PX: f32 = 1.5;
/// View pixels from one place whose lattice indices are worked out to the next: between them they are interpolated.
const KNOT_STEP: usize = 16;

/// Draws a view.
///
/// # Errors
/// [`ViewError`] where the spacing leaves no patch, the direction none of the aperture, or no spacing is known.
pub fn render(frame: &ViewFrame, options: &ViewOptions) -> Result<View, ViewError> {
    let grid = &frame.grid;
    let (pitch_px, patch_px) = (grid.pitch_px(), patch_px(grid, options.patches)?);
    let [u, v] = options.direction;
    // What is no number is no direction either.
    if !(0.0..=1.0).contains(&u.hypot(v)) {
        return Err(ViewError::Direction { direction: options.direction });
    }
    let Extent { width, height, scale } = extent(grid, options.patches)?;
    let ratio = patch_px / pitch_px;
    let inverse = reciprocal(grid.basis);
    // A disc in lattice coordinates reaches as far as the longer of the reciprocal vectors.
    let reach = frame.radius / ratio.abs();
    let steps = match options.blend {
        Blend::WholeAperture => inverse.map(|row| (reach * row[0].hypot(row[1])).ceil() as i32),
        Blend::Abutting | Blend::Seamless => [1, 1],
    };
    let painter = Painter {
        frame,
        blend: options.blend,
        own: matches!(options.patches, Patches::Own(_)),
        cells: Cells::new(grid, options.patches, steps[0].max(steps[1]) + 1),
        // A microlens turns the aperture round: what passes it at +x reaches each micro-image at −x.
        within: [-u * frame.radius, -v * frame.radius].map(|x| x as f32),
        radius: frame.radius as f32,
        pitch: pitch_px as f32,
        ratio: ratio as f32,
        steps,
    };
    let planes = frame.planes.len();
    // Pixel by pixel all colours together.
    let mut pixels = vec![0.0f32; width * height * planes];
    pixels.par_chunks_mut(width * planes).enumerate().for_each(|(row, pixels)| {
        // The scene's right is the frame's left, and its top the frame's bottom.
        let place =
            |column: usize| [(width - 1 - column) as f64, (height - 1 - row) as f64].map(|x| (x + 0.5) / scale - 0.5);
        for first in (0..width).step_by(KNOT_STEP) {
            let count = KNOT_STEP.min(width - first);
            let (from, to) = (place(first), place(first + count - 1));
            let (at, end) = (grid.indices_at(from[0], from[1]), grid.indices_at(to[0], to[1]));
            for k in 0..count {
                let share = k as f64 / (count - 1).max(1) as f64;
                let at = [at[0] + share * (end[0] - at[0]), at[1] + share * (end[1] - at[1])];
                let q = [from[0] + share * (to[0] - from[0]), from[1]].map(|x| x as f32);
                let colours = painter.pixel(q, at);
                pixels[(first + k) * planes..][..planes].copy_from_slice(&colours[..planes]);
            }
        }
    });
    let planes = match planes {
        1 => vec![pixels],
        _ => (0..planes).map(|plane| pixels.iter().skip(plane).step_by(planes).copied().collect()).collect(),
    };
    Ok(View { width, height, planes, scale })
}

/// How large a view with these patches is, whatever its direction.
///
/// # Errors
/// [`ViewError`] where the spacing leaves no patch, or none is known.
pub fn extent(grid: &Grid, patches: Patches) -> Result<Extent, ViewError> {
    let scale = patch_px(grid, patches)?.abs() / grid.pitch_px();
    let [width, height] = grid.frame_size.map(|n| ((n as f64 * scale) as usize).max(1));
    Ok(Extent { width, height, scale })
}

/// P − l of the typical patch, px.
fn patch_px(grid: &Grid, patches: Patches) -> Result<f64, ViewError> {
    let pitch_px = grid.pitch_px();
    let spacing_px = match patches {
        Patches::Fixed(spacing_px) => spacing_px,
        Patches::Own(map) => typical(map).ok_or(ViewError::NoDepth)?,
    };
    let patch_px = pitch_px - spacing_px;
    if (PATCH_LEAST_PX..=pitch_px).contains(&patch_px.abs()) {
        Ok(patch_px)
    } else {
        Err(ViewError::Patch { spacing_px, pitch_px, patch_px })
    }
}

/// The median of the spacings that are known, px.
fn typical(map: &DepthMap) -> Option<f64> {
    let mut known: Vec<f64> =
        map.lenses.iter().filter(|lens| lens.state != DepthState::Unknown).map(|lens| lens.spacing_px).collect();
    let middle = known.len() / 2;
    (!known.is_empty()).then(|| *known.select_nth_unstable_by(middle, f64::total_cmp).1)
}

struct Painter<'a> {
    frame: &'a ViewFrame,
    blend: Blend,
    /// Whether each micro-image has a spacing of its own.
    own: bool,
    cells: Cells,
    /// Where within its micro-image a patch is taken from, px.
    within: [f32; 2],
    /// Radius about a micro-image's centre that is used, px.
    radius: f32,
    pitch: f32,
    /// (P − l)/P of the typical patch.
    ratio: f32,
    /// Lattice steps to either side within which a micro-image may see a place.
    steps: [i32; 2],
}

/// Weighted colours of a place.
#[derive(Default)]
struct Sum {
    colours: [f32; 3],
    weights: f32,
}

impl Painter<'_> {
    /// The colours at a place of the frame (px) with these lattice indices.
    fn pixel(&self, q: [f32; 2], at: [f64; 2]) -> [f32; 3] {
        let mut sum = Sum::default();
        match self.blend {
            Blend::Abutting => {
                self.contribute(self.frame.grid.index_of(f64::from(q[0]), f64::from(q[1])), q, 1.0, None, &mut sum);
            }
            Blend::Seamless => {
                for (index, weight) in corners(at) {
                    self.contribute(index, q, weight, None, &mut sum);
                }
            }
            Blend::WholeAperture => {
                let surface = if self.own { self.surface(q, at) } else { None };
                let [i, j] = at.map(|x| x.round() as i32);
                for j in j - self.steps[1]..=j + self.steps[1] {
                    for i in i - self.steps[0]..=i + self.steps[0] {
                        self.contribute([i, j], q, 1.0, surface, &mut sum);
                    }
                }
            }
        }
        let Sum { colours, weights } = sum;
        if weights > 0.0 { colours.map(|colour| colour / weights) } else { [0.0; 3] }
    }

    /// The spacing of the surface at a place of the frame: that of the micro-images around it, as far as they see the same
    /// surface as the nearest. `None` where the nearest knows nothing.
    fn surface(&self, q: [f32; 2], at: [f64; 2]) -> Option<f32> {
        let known = |index: [i32; 2]| self.cells.get(index).map(|cell| cell.spacing).filter(|l| !l.is_nan());
        let nearest = known(self.frame.grid.index_of(f64::from(q[0]), f64::from(q[1])))?;
        let (mut sum, mut weights) = (0.0, 0.0);
        for (index, weight) in corners(at) {
            if let Some(spacing) = known(index) {
                let weight = weight * agreement(spacing, nearest);
                sum += weight * spacing;
                weights += weight;
            }
        }
        Some(if weights > 1e-6 { sum / weights } else { nearest })
    }

    /// Adds what a micro-image shows of a place. With a surface's spacing it shows the place there, and counts as far as
    /// it sees that surface.
    #[inline(always)]
    fn contribute(&self, index: [i32; 2], q: [f32; 2], weight: f32, surface: Option<f32>, sum: &mut Sum) {
        let Some(cell) = self.cells.get(index) else { return };
        let patch = |spacing_px: f32| (self.pitch - spacing_px) / self.pitch;
        let (ratio, trust) = if !self.own {
            (self.ratio, 1.0)
        } else {
            match (cell.spacing.is_nan(), surface) {
                (false, Some(surface)) => (patch(surface), agreement(cell.spacing, surface)),
                (false, None) => (patch(cell.spacing), 1.0),
                (true, Some(surface)) => (patch(surface), UNKNOWN_WEIGHT),
                (true, None) => (self.ratio, UNKNOWN_WEIGHT),
            }
        };
        let c = cell.centre;
        let from = [self.within[0] + (q[0] - c[0]) * ratio, self.within[1] + (q[1] - c[1]) * ratio];
        let radius = (from[0] * from[0] + from[1] * from[1]).sqrt();
        let inside = ((self.radius - radius) / EDGE_PX + 1.0).clamp(0.0, 1.0);
        // Where the whole aperture is wanted, what is not seen through it does not count at all.
        let least = if self.blend == Blend::WholeAperture { 0.0 } else { BEYOND_WEIGHT };
        let (x, y) = (c[0] + from[0], c[1] + from[1]);
        let [w, h] = self.frame.grid.frame_size;
        let on_frame = x >= -0.5 && y >= -0.5 && x <= w as f32 - 0.5 && y <= h as f32 - 0.5;
        let weight = weight * trust * inside.max(least) * if on_frame { 1.0 } else { BEYOND_WEIGHT };
        if weight > 0.0 {
            match self.blend {
                Blend::WholeAperture => sum.add(&self.frame.planes, weight, &Cubic::new([w, h], x, y)),
                Blend::Abutting | Blend::Seamless => sum.add(&self.frame.planes, weight, &Linear::new([w, h], x, y)),
            }
        }
    }
}

impl Sum {
    #[inline(always)]
    fn add(&mut self, planes: &[Vec<f32>], weight: f32, taps: &impl Taps) {
        self.weights += weight;
        for (colour, plane) in self.colours.iter_mut().zip(planes) {
            *colour += weight * taps.read(plane);
        }
    }
}

/// The micro-images at the corners of the lattice cell that lattice indices lie in, each with how near it is: the weights
/// sum to one everywhere.
#[inline(always)]
fn corners(at: [f64; 2]) -> [([i32; 2], f32); 4] {
    let cell = at.map(f64::floor);
    let [s, t] = [smooth((at[0] - cell[0]) as f32), smooth((at[1] - cell[1]) as f32)];
    let [i, j] = cell.map(|x| x as i32);
    [([i, j], (1.0 - s) * (1.0 - t)), ([i + 1, j], s * (1.0 - t)), ([i, j + 1], (1.0 - s) * t), ([i + 1, j + 1], s * t)]
}

/// How far two spacings (px) can be those of one surface, 0 to 1.
fn agreement(one: f32, other: f32) -> f32 {
    (1.0 + ((one - other) / SAME_SURFACE_PX).powi(2)).powi(-2)
}

/// Rises from 0 to 1 without a kink at either end.
fn smooth(t: f32) -> f32 {
    t * t * (3.0 - 2.0 * t)
}
