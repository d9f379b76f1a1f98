//! The microlenses that are not as their neighbours are, from a white frame.
//!
//! Every micro-image is compared with the profile that the whole array has: `pedestal + height * transmission`, fitted
//! to its pixels. A dead microlens has no height, a missing one lets light through that has not the profile's shape, a
//! dirty one is darker than its neighbours or uneven.

use std::collections::HashMap;

use rayon::prelude::*;
use serde::Serialize;

use super::grid::{Grid, MicroImage, median};
use super::vignetting::Vignetting;
use crate::raw::{RawImage, Samples};

/// Light relative to the neighbours' below which a microlens is dead.
const DEAD: f64 = 0.3;
/// Height relative to the neighbours' below which the light has not the shape of a micro-image.
const SHAPED: f64 = 0.5;
/// Light relative to the neighbours' beyond which a microlens is dirty.
const EVEN: [f64; 2] = [0.88, 1.15];
/// What a profile may leave in a clean micro-image beyond what it leaves in most, relative to the light.
const MISFIT: f64 = 0.06;

/// What is wrong with a microlens.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum MicrolensFlag {
    /// It lets hardly any light through.
    Dead,
    /// Light comes through that no microlens has gathered.
    Missing,
    /// It is darker or brighter than its neighbours, or unevenly lit: dirt, a scratch, dust before it.
    Dirty,
}

/// A microlens that is not as its neighbours are.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FlaggedMicrolens {
    /// Lattice indices in the white frame's grid.
    pub index: [i32; 2],
    /// Centre of its micro-image in the white frame, px.
    pub centre_px: [f64; 2],
    /// What is wrong with it.
    pub flag: MicrolensFlag,
    /// Light on its plateau relative to the median of its neighbours'.
    pub transmission: f64,
    /// Root mean square of what the array's profile leaves of its micro-image, relative to that light.
    pub misfit: f64,
}

/// A micro-image's own height and pedestal of the array's profile, and what the profile leaves; grey levels.
#[derive(Debug, Clone, Copy)]
struct Shape {
    at: MicroImage,
    height: f64,
    pedestal: f64,
    left: f64,
}

/// The microlenses of a white frame that are dead, missing or dirty, by rows of the lattice. Those whose micro-images
/// are cut off by the frame's edge are not judged.
#[must_use]
pub fn flagged_microlenses(white: &RawImage, grid: &Grid, vignetting: &Vignetting) -> Vec<FlaggedMicrolens> {
    let size = [white.width(), white.height()];
    if size != grid.frame_size {
        return Vec::new();
    }
    let lenses: Vec<MicroImage> = grid.micro_images_within(0.5 * grid.pitch_px()).collect();
    let shapes: Vec<Shape> = match white.samples() {
        Samples::U8(samples) => lenses.par_iter().map(|&at| shape(samples, grid, vignetting, at)).collect(),
        Samples::U16(samples) => lenses.par_iter().map(|&at| shape(samples, grid, vignetting, at)).collect(),
    };
    let dark = median(&mut shapes.iter().map(|s| s.pedestal).collect::<Vec<_>>());
    let light = |s: &Shape| s.height + s.pedestal - dark;
    let all: HashMap<(i32, i32), &Shape> = shapes.iter().map(|s| ((s.at.i, s.at.j), s)).collect();
    // Light and profile change slowly over the field: what is usual is what the neighbours have.
    let usual = |s: &Shape, of: &dyn Fn(&Shape) -> f64| {
        let about = (-2..=2).flat_map(|dj| (-2..=2).map(move |di| (di, dj))).filter(|&d| d != (0, 0));
        let found = about.filter_map(|(di, dj)| all.get(&(s.at.i + di, s.at.j + dj)).map(|s| of(s)));
        median(&mut found.collect::<Vec<_>>())
    };
    shapes
        .iter()
        .filter_map(|s| {
            let usual_light = usual(s, &light);
            if usual_light <= 0.0 {
                return None;
            }
            let (transmission, height) = (light(s) / usual_light, s.height / usual_light);
            let (misfit, usual_misfit) = (s.left / usual_light, usual(s, &|s| s.left) / usual_light);
            let flag = if transmission < DEAD {
                MicrolensFlag::Dead
            } else if height < SHAPED && height < SHAPED * transmission {
                MicrolensFlag::Missing
            } else if !(EVEN[0]..EVEN[1]).contains(&transmission) || misfit > usual_misfit + MISFIT {
                MicrolensFlag::Dirty
            } else {
                return None;
            };
            let MicroImage { i, j, x, y } = s.at;
            Some(FlaggedMicrolens { index: [i, j], centre_px: [x, y], flag, transmission, misfit })
        })
        .collect()
}

/// Least squares of a pedestal and a height of the profile over the pixels of a micro-image's own circle.
fn shape<T: Copy + Into<u16>>(samples: &[T], grid: &Grid, vignetting: &Vignetting, at: MicroImage) -> Shape {
    let [width, height] = grid.frame_size;
    let radius = 0.5 * grid.pitch_px();
    let rows = (at.y - radius).ceil().max(0.0) as usize..=((at.y + radius) as usize).min(height - 1);
    let columns = (at.x - radius).ceil().max(0.0) as usize..=((at.x + radius) as usize).min(width - 1);
    let (mut n, mut t1, mut t2, mut v1, mut v2, mut tv) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for y in rows {
        for x in columns.clone() {
            if (x as f64 - at.x).hypot(y as f64 - at.y) > radius {
                continue;
            }
            let t = f64::from(vignetting.at(grid, x as f64, y as f64));
            let v = f64::from(samples[y * width + x].into());
            n += 1.0;
            t1 += t;
            t2 += t * t;
            v1 += v;
            v2 += v * v;
            tv += t * v;
        }
    }
    let spread = (t2 - t1 * t1 / n).max(1e-9);
    let height = (tv - t1 * v1 / n) / spread;
    let pedestal = (v1 - height * t1) / n;
    let left = (v2 - v1 * v1 / n - height * height * spread).max(0.0) / n;
    Shape { at, height, pedestal, left: left.sqrt() }
}
