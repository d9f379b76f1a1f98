//! View pixels from the micro-images about them.

use rayon::prelude::*;

use super::{Blend, Extent, PATCH_LEAST_PX, Patches, View, ViewError, ViewFrame, ViewOptions};
use crate::imaging::depth::{DepthMap, DepthState};
use crate::imaging::grid::{Grid, reciprocal};

/// Weight of a micro-image whose spacing is not known beside those whose is.
const UNKNOWN_WEIGHT: f64 = 0.05;
/// Weight that what lies beyond the used part of a micro-image keeps, so that a place which nothing else shows is not
/// left out.
const BEYOND_WEIGHT: f64 = 1e-4;
/// Difference in spacing that makes it doubtful whether two micro-images see the same surface, px.
const SAME_SURFACE_PX: f64 = 0.75;
/// Pixels over which a micro-image's used part ends.
const EDGE_PX: f64 = 1.5;

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
    let painter = Painter {
        frame,
        patches: options.patches,
        blend: options.blend,
        // A microlens turns the aperture round: what passes it at +x reaches each micro-image at −x.
        within: [-u * frame.radius, -v * frame.radius],
        pitch: pitch_px,
        ratio: patch_px / pitch_px,
        inverse: reciprocal(grid.basis),
    };
    let planes = frame.planes.len();
    // Pixel by pixel all colours together; the scene's right is the frame's left.
    let pixels: Vec<f32> = (0..height)
        .into_par_iter()
        .flat_map_iter(|row| {
            let y = (height - 1 - row) as f64;
            let qy = (y + 0.5) / scale - 0.5;
            let painter = &painter;
            (0..width).flat_map(move |column| {
                let x = (width - 1 - column) as f64;
                painter.pixel([(x + 0.5) / scale - 0.5, qy]).into_iter().take(planes)
            })
        })
        .collect();
    let planes = (0..planes).map(|plane| pixels.iter().skip(plane).step_by(planes).copied().collect()).collect();
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
    patches: Patches<'a>,
    blend: Blend,
    /// Where within its micro-image a patch is taken from, px.
    within: [f64; 2],
    pitch: f64,
    /// (P − l)/P of the typical patch.
    ratio: f64,
    /// Rows that turn px into lattice indices.
    inverse: [[f64; 2]; 2],
}

impl Painter<'_> {
    /// The colours at a place of the frame (px).
    fn pixel(&self, q: [f64; 2]) -> [f32; 3] {
        let mut sums = [0.0; 3];
        let mut weights = 0.0;
        let surface = match (self.blend, self.patches) {
            (Blend::WholeAperture, Patches::Own(map)) => self.surface(map, q),
            _ => None,
        };
        let mut add = |index: [i32; 2], weight: f64| {
            if weight > 0.0 {
                weights += self.contribute(index, q, weight, surface, &mut sums);
            }
        };
        let grid = &self.frame.grid;
        match self.blend {
            Blend::Abutting => add(grid.index_of(q[0], q[1]), 1.0),
            Blend::Seamless => {
                for (index, weight) in corners(grid, q) {
                    add(index, weight);
                }
            }
            Blend::WholeAperture => {
                let at = grid.indices_at(q[0], q[1]);
                let reach = self.frame.radius / self.ratio.abs();
                // A disc in lattice coordinates reaches as far as the longer of the reciprocal vectors.
                let [steps_i, steps_j] = self.inverse.map(|row| (reach * row[0].hypot(row[1])).ceil() as i32);
                let [i, j] = at.map(|x| x.round() as i32);
                for j in j - steps_j..=j + steps_j {
                    for i in i - steps_i..=i + steps_i {
                        add([i, j], 1.0);
                    }
                }
            }
        }
        if weights > 0.0 { sums.map(|sum| (sum / weights) as f32) } else { [0.0; 3] }
    }

    /// The spacing of the surface at a place of the frame: that of the micro-images around it, as far as they see the same
    /// surface as the nearest. `None` where the nearest knows nothing.
    fn surface(&self, map: &DepthMap, q: [f64; 2]) -> Option<f64> {
        let grid = &self.frame.grid;
        let known = |index: [i32; 2]| map.lens(index).filter(|lens| lens.state != DepthState::Unknown);
        let nearest = known(grid.index_of(q[0], q[1]))?.spacing_px;
        let (mut sum, mut weights) = (0.0, 0.0);
        for (index, weight) in corners(grid, q) {
            if let Some(lens) = known(index) {
                let weight = weight * agreement(lens.spacing_px, nearest);
                sum += weight * lens.spacing_px;
                weights += weight;
            }
        }
        Some(if weights > 1e-6 { sum / weights } else { nearest })
    }

    /// Adds what a micro-image shows of a place, and returns its weight. With a surface's spacing it shows the place there,
    /// and counts as far as it sees that surface.
    fn contribute(&self, [i, j]: [i32; 2], q: [f64; 2], weight: f64, surface: Option<f64>, sums: &mut [f64; 3]) -> f64 {
        let grid = &self.frame.grid;
        let c = grid.position(i, j);
        let patch = |spacing_px: f64| (self.pitch - spacing_px) / self.pitch;
        let (ratio, trust) = match self.patches {
            Patches::Fixed(_) => (self.ratio, 1.0),
            Patches::Own(map) => match (map.lens([i, j]).filter(|lens| lens.state != DepthState::Unknown), surface) {
                (Some(lens), Some(surface)) => (patch(surface), agreement(lens.spacing_px, surface)),
                (Some(lens), None) => (patch(lens.spacing_px), 1.0),
                (None, Some(surface)) => (patch(surface), UNKNOWN_WEIGHT),
                (None, None) => (self.ratio, UNKNOWN_WEIGHT),
            },
        };
        let from = [0, 1].map(|axis| self.within[axis] + (q[axis] - c[axis]) * ratio);
        let inside = ((self.frame.radius - from[0].hypot(from[1])) / EDGE_PX + 1.0).clamp(0.0, 1.0);
        // Where the whole aperture is wanted, what is not seen through it does not count at all.
        let least = if self.blend == Blend::WholeAperture { 0.0 } else { BEYOND_WEIGHT };
        let (x, y) = (c[0] + from[0], c[1] + from[1]);
        let [w, h] = grid.frame_size;
        let on_frame = x >= -0.5 && y >= -0.5 && x <= w as f64 - 0.5 && y <= h as f64 - 0.5;
        let weight = weight * trust * inside.max(least) * if on_frame { 1.0 } else { BEYOND_WEIGHT };
        if weight > 0.0 {
            let taps = Taps::new([w, h], x, y);
            for (sum, plane) in sums.iter_mut().zip(&self.frame.planes) {
                *sum += weight * f64::from(taps.read(plane));
            }
        }
        weight
    }
}

/// The micro-images at the corners of the lattice cell that a place (px) lies in, each with how near it is: the weights
/// sum to one everywhere.
fn corners(grid: &Grid, q: [f64; 2]) -> [([i32; 2], f64); 4] {
    let at = grid.indices_at(q[0], q[1]);
    let cell = at.map(f64::floor);
    let [s, t] = [smooth(at[0] - cell[0]), smooth(at[1] - cell[1])];
    let [i, j] = cell.map(|x| x as i32);
    [([i, j], (1.0 - s) * (1.0 - t)), ([i + 1, j], s * (1.0 - t)), ([i, j + 1], (1.0 - s) * t), ([i + 1, j + 1], s * t)]
}

/// How far two spacings (px) can be those of one surface, 0 to 1.
fn agreement(one: f64, other: f64) -> f64 {
    (1.0 + ((one - other) / SAME_SURFACE_PX).powi(2)).powi(-2)
}

/// Rises from 0 to 1 without a kink at either end.
fn smooth(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

/// The four pixels about a place and their weights; outside the frame, its edge.
struct Taps {
    places: [usize; 4],
    weights: [f32; 4],
}

impl Taps {
    fn new([w, h]: [usize; 2], x: f64, y: f64) -> Self {
        let (x, y) = (x.clamp(0.0, (w - 1) as f64), y.clamp(0.0, (h - 1) as f64));
        let (x0, y0) = (x as usize, y as usize);
        let (x1, y1) = ((x0 + 1).min(w - 1), (y0 + 1).min(h - 1));
        let (s, t) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
        Self {
            places: [y0 * w + x0, y0 * w + x1, y1 * w + x0, y1 * w + x1],
            weights: [(1.0 - s) * (1.0 - t), s * (1.0 - t), (1.0 - s) * t, s * t],
        }
    }

    fn read(&self, plane: &[f32]) -> f32 {
        (0..4).map(|k| self.weights[k] * plane[self.places[k]]).sum()
    }
}
