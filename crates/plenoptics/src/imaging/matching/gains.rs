//! What takes the vignetting out of a tile: the profile drawn about a micro-image's centre at so many places between two
//! pixels that a tile takes the patch nearest to its own. Nothing depends on the frame's size, and all of it stays in the
//! cache.
//!
//! A profile that is the same all over the field is kept as gains. One that bends over the field is kept as its terms,
//! and a tile adds them up at its own place.

use pulp::Simd;
use rayon::prelude::*;

use super::motion::Field;
use super::plan::{Lens, nearest_place, place};
use super::shape::Shape;
use super::vector::{store, widened};
use crate::imaging::grid::{Grid, reciprocal};
use crate::imaging::vignetting::Vignetting;

/// Places between two pixels along each axis: a patch is within 0.045 px of its right place.
const PHASES: usize = 16;
/// Unit of the gains.
const GAIN_UNIT: f32 = 1.0 / 8192.0;
/// Steps of a term from nothing to its greatest.
const STEPS: f32 = 32_767.0;
/// What the profile itself is kept about: it lies between 0 and twice this.
const PLATEAU: f32 = 1.0;
/// The profile and its changes along x, along y, and with r².
const TERMS: usize = 4;
/// Below this share of the brightest, vignetting is not divided out any further: it would only blow up noise.
const LEAST_VIGNETTING: f32 = 0.2;
/// Numbers beyond the last, for rows of tiles that reach over it.
const SPARE: usize = 16;
/// The patches are drawn anew where another basis of the lattice would move the profile at a mask's edge by more, px.
const STALE_PX: f64 = 0.02;

/// The patches of all places between pixels.
#[derive(Debug, Clone)]
pub(in crate::imaging) struct Gains {
    profile: Vignetting,
    /// The lattice's basis that they are drawn for, px.
    basis: [[f64; 2]; 2],
    /// Radius of the largest masks, px.
    radius: f64,
    /// The largest tiles there are.
    largest: Shape,
    /// Columns of a patch.
    columns: usize,
    field: Field,
    /// Gains of a profile that does not bend.
    gains: Vec<u16>,
    /// Terms of one that does: of each row of a patch one term after the other.
    terms: Vec<i16>,
    units: [f32; TERMS],
}

/// What is divided out of a frame.
#[derive(Debug, Clone, Copy)]
pub(in crate::imaging) enum Light<'a> {
    /// A profile about every micro-image's centre.
    Drawn(&'a Gains),
    /// The share of light that reaches each pixel of a frame of this width and height.
    Shares(&'a [f32], [usize; 2]),
}

/// One micro-image's patch.
#[derive(Debug, Clone, Copy)]
pub(in crate::imaging) enum Patch<'a> {
    Drawn {
        of: &'a Gains,
        /// Number of its first row.
        row: usize,
        /// Field coordinates of the pixel nearest the micro-image's centre, and the sum of their squares.
        field: [f32; 3],
    },
    /// The shares of a whole frame, its size, and the pixel nearest the micro-image's centre.
    Shares(&'a [f32], [usize; 2], [i32; 2]),
}

impl<'a> Light<'a> {
    /// The patch of a micro-image.
    #[inline(always)]
    pub(in crate::imaging) fn patch(&self, lens: &Lens) -> Patch<'a> {
        match *self {
            Self::Drawn(gains) => gains.patch(lens),
            Self::Shares(shares, size) => Patch::Shares(shares, size, lens.nearest),
        }
    }
}

impl Gains {
    /// For tiles of masks up to `radius` (px) in frames with this grid.
    pub(in crate::imaging) fn new(profile: &Vignetting, grid: &Grid, radius: f64) -> Self {
        let largest = Shape::new(radius);
        let mut gains = Self {
            profile: profile.clone(),
            basis: grid.basis,
            radius,
            largest,
            // Without what rows are padded by: there a row runs on into the next.
            columns: largest.cut(),
            field: Field::new(grid.frame_size),
            gains: Vec::new(),
            terms: Vec::new(),
            units: [0.0; TERMS],
        };
        gains.draw();
        gains
    }

    /// Draws the patches anew where they no longer serve a lattice with this basis.
    pub(in crate::imaging) fn follow(&mut self, basis: [[f64; 2]; 2]) {
        let pitch = self.basis[0][0].hypot(self.basis[0][1]);
        let change = self.basis.iter().zip(basis).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max);
        if change / pitch * self.radius > STALE_PX {
            self.basis = basis;
            self.draw();
        }
    }

    /// Relative transmission of a pixel about a micro-image's centre (both px).
    pub(in crate::imaging) fn share(&self, centre: [f64; 2], pixel: [usize; 2]) -> f32 {
        let at = pixel.map(|n| n as f64);
        let [u, v] = indices(self.basis, [at[0] - centre[0], at[1] - centre[1]]);
        let [x, y] = self.field.coordinates(at);
        self.profile.transmission(u, v, x, y)
    }

    fn draw(&mut self) {
        let [column, row] = self.largest.middle().map(|n| n as f64);
        let (rows, columns, basis, half) = (self.largest.rows, self.columns, self.basis, self.field.half);
        // Of a pixel, from where the field coordinates are those of the pixel nearest the centre.
        let at = |phase: usize, k: usize| {
            let (x, y) = ((k % columns) as f64 - column, (k / columns) as f64 - row);
            let [u, v] = indices(basis, [x - place(phase % PHASES, PHASES), y - place(phase / PHASES, PHASES)]);
            let [profile, by_x, by_y, by_square] = self.profile.terms_at(u, v);
            let (x, y) = ((x / half) as f32, (y / half) as f32);
            [
                profile + x * by_x + y * by_y + (x * x + y * y) * by_square,
                by_x + 2.0 * x * by_square,
                by_y + 2.0 * y * by_square,
                by_square,
            ]
        };
        let patch = |phase: usize| (0..rows * columns).map(|k| at(phase, k)).collect::<Vec<_>>();
        let patches: Vec<Vec<[f32; TERMS]>> = (0..PHASES * PHASES).into_par_iter().map(patch).collect();
        if !self.profile.bends() {
            self.gains = patches.iter().flatten().map(|[share, ..]| gain(*share)).collect();
            // A row of a smaller tile may reach beyond the last.
            self.gains.resize(self.gains.len() + SPARE, 0);
            return;
        }
        let about = |k: usize| if k == 0 { PLATEAU } else { 0.0 };
        let most = |k: usize| patches.iter().flatten().map(|terms| terms[k].abs()).fold(1e-6, f32::max);
        let units: [f32; TERMS] = std::array::from_fn(|k| if k == 0 { PLATEAU } else { most(k) } / STEPS);
        let steps = |value: f32, k: usize| ((value - about(k)) / units[k]).round().clamp(-STEPS, STEPS) as i16;
        self.terms.clear();
        for row in patches.iter().flat_map(|patch| patch.chunks_exact(columns)) {
            for k in 0..TERMS {
                self.terms.extend(row.iter().map(|terms| steps(terms[k], k)));
            }
        }
        self.terms.resize(self.terms.len() + SPARE, 0);
        self.units = units;
    }

    /// By how many pixels tiles of a shape begin within the largest.
    #[inline(always)]
    const fn inset(&self, shape: &Shape) -> usize {
        self.largest.disc - shape.disc
    }

    /// The patch of a micro-image.
    #[inline(always)]
    pub(in crate::imaging) fn patch(&self, lens: &Lens) -> Patch<'_> {
        let [px, py] = lens.fraction.map(|fraction| nearest_place(fraction, PHASES));
        let [x, y] = self.field.coordinates(lens.nearest.map(f64::from)).map(|v| v as f32);
        Patch::Drawn { of: self, row: (py * PHASES + px) * self.largest.rows, field: [x, y, x * x + y * y] }
    }
}

impl<'a> Patch<'a> {
    /// The gains of the rows of a tile, where the profile is the same all over the field; else there are shares only.
    #[inline(always)]
    pub(in crate::imaging) fn gains(&self, shape: &Shape) -> Option<Rows<'a>> {
        match *self {
            Self::Drawn { of, row, .. } if !of.gains.is_empty() => {
                let inset = of.inset(shape);
                Some(Rows { gains: &of.gains[(row + inset) * of.columns + inset..], columns: of.columns })
            }
            _ => None,
        }
    }

    /// So many of the shares of light of a row of a tile.
    #[inline(always)]
    pub(in crate::imaging) fn shares<S: Simd>(
        &self,
        simd: S,
        y: usize,
        shape: &Shape,
        columns: usize,
        into: &mut [f32],
    ) {
        let least = simd.splat_f32s(LEAST_VIGNETTING);
        match *self {
            Self::Drawn { of, row, field: [fx, fy, r] } => {
                let inset = of.inset(shape);
                let wide = of.columns;
                let rows = &of.terms[(row + y + inset) * TERMS * wide + inset..][..(TERMS - 1) * wide + columns];
                let [unit, along_x, along_y, square] = of.units;
                let plateau = simd.splat_f32s(PLATEAU);
                let (unit, along_x) = (simd.splat_f32s(unit), simd.splat_f32s(fx * along_x));
                let (along_y, square) = (simd.splat_f32s(fy * along_y), simd.splat_f32s(r * square));
                for k in 0..columns / S::F32_LANES {
                    let at = k * S::F32_LANES;
                    let share = simd.mul_add_e_f32s(unit, widened::<S, i16>(rows, at), plateau);
                    let share = simd.mul_add_e_f32s(along_x, widened::<S, i16>(rows, at + wide), share);
                    let share = simd.mul_add_e_f32s(along_y, widened::<S, i16>(rows, at + 2 * wide), share);
                    let share = simd.mul_add_e_f32s(square, widened::<S, i16>(rows, at + 3 * wide), share);
                    store::<S>(into, at, simd.max_f32s(share, least));
                }
            }
            Self::Shares(shares, size, nearest) => {
                let line = &shares[frame_row(size, nearest, y, shape)..][..size[0]];
                for (x, share) in into[..columns].iter_mut().enumerate() {
                    *share = line[frame_column(size, nearest, x, shape)].max(LEAST_VIGNETTING);
                }
            }
        }
    }

    /// The gain at a pixel of a tile.
    #[inline(always)]
    pub(in crate::imaging) fn gain(&self, x: usize, y: usize, shape: &Shape) -> f32 {
        let share = match *self {
            Self::Drawn { of, row, field: [fx, fy, r] } => {
                if let Some(rows) = self.gains(shape) {
                    return f32::from(rows.row(y, x + 1)[x]) * GAIN_UNIT;
                }
                let inset = of.inset(shape);
                let (wide, from) = (of.columns, (row + y + inset) * TERMS * of.columns + inset + x);
                let term = |k: usize| f32::from(of.terms[from + k * wide]) * of.units[k];
                PLATEAU + term(0) + fx * term(1) + fy * term(2) + r * term(3)
            }
            Self::Shares(shares, size, nearest) => {
                shares[frame_row(size, nearest, y, shape) + frame_column(size, nearest, x, shape)]
            }
        };
        1.0 / share.max(LEAST_VIGNETTING)
    }
}

/// The gains of a patch, row by row.
#[derive(Debug, Clone, Copy)]
pub(in crate::imaging) struct Rows<'a> {
    gains: &'a [u16],
    columns: usize,
}

impl<'a> Rows<'a> {
    /// What one step of the gains is.
    pub(in crate::imaging) const UNIT: f32 = GAIN_UNIT;

    /// So many of a row of a tile.
    #[inline(always)]
    pub(in crate::imaging) fn row(&self, y: usize, columns: usize) -> &'a [u16] {
        &self.gains[y * self.columns..][..columns]
    }
}

/// Where the frame's row begins that a row of a tile is cut from: the edge is continued.
#[inline(always)]
fn frame_row([width, height]: [usize; 2], nearest: [i32; 2], y: usize, shape: &Shape) -> usize {
    let row = (nearest[1] + y as i32 - shape.middle()[1] as i32).max(0) as usize;
    row.min(height - 1) * width
}

/// The frame's column that a column of a tile is cut from.
#[inline(always)]
fn frame_column([width, _]: [usize; 2], nearest: [i32; 2], x: usize, shape: &Shape) -> usize {
    let column = (nearest[0] + x as i32 - shape.middle()[0] as i32).max(0) as usize;
    column.min(width - 1)
}

/// Lattice indices of a displacement, px.
fn indices(basis: [[f64; 2]; 2], [x, y]: [f64; 2]) -> [f64; 2] {
    reciprocal(basis).map(|g| g[0] * x + g[1] * y)
}

/// A share of light as a gain.
fn gain(share: f32) -> u16 {
    (1.0 / (share.max(LEAST_VIGNETTING) * GAIN_UNIT)).round() as u16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::ArrayKind;

    const BASIS: [[f64; 2]; 2] = [[21.3, 0.4], [-0.4, 21.3]];
    const RADIUS: f64 = 8.5;

    /// A profile that falls from its centre on, and how it bends over the field.
    fn profile(bend: f32) -> Vignetting {
        const SIDE: usize = 43;
        let near = |k: usize| ((k.min(SIDE - k)) as f32 / SIDE as f32, if 2 * k < SIDE { 1.0f32 } else { -1.0 });
        Vignetting::from_terms(
            SIDE,
            (0..SIDE * SIDE)
                .map(|k| {
                    let ((u, side), (v, _)) = (near(k % SIDE), near(k / SIDE));
                    let r = u.hypot(v);
                    let share = 1.0 - 0.9 / (1.0 + ((0.45 - r) / 0.03).exp());
                    [share, bend * side * u, bend * 0.5 * v, -bend * r * r]
                })
                .collect(),
            bend != 0.0,
        )
    }

    /// Greatest departure of the gains of lenses all over a frame from the profile's own, about the micro-image's own
    /// centre and about that of its patch, within the masks.
    fn departures(bend: f32, [dx, dy]: [f64; 2]) -> [f32; 2] {
        let profile = profile(bend);
        let grid = Grid::affine(ArrayKind::Square, [250.0, 200.0], BASIS, [501, 401]);
        let gains = Gains::new(&profile, &grid, RADIUS);
        let shape = Shape::new(RADIUS - 2.5);
        let first = gains.patch(&Lens { nearest: [0, 0], fraction: [0.0; 2] });
        assert_eq!(first.gains(&shape).is_none(), bend != 0.0);
        let mut worst = [0.0f32; 2];
        for k in 0..400 {
            let centre = [20.0 + f64::from(k % 20) * 24.01 + dx, 20.0 + f64::from(k / 20) * 19.013 + dy];
            let nearest = centre.map(f64::round);
            let fraction = [centre[0] - nearest[0], centre[1] - nearest[1]];
            let lens = Lens { nearest: nearest.map(|n| n as i32), fraction };
            let patch = gains.patch(&lens);
            let steady = fraction.map(|f| place(((f + 0.5) * PHASES as f64) as usize, PHASES));
            assert!((steady[0] - fraction[0]).hypot(steady[1] - fraction[1]) < 0.05);
            let drawn = [nearest[0] + steady[0], nearest[1] + steady[1]];
            let [column, row] = shape.middle();
            for (x, y) in (0..shape.cut() * shape.rows).map(|k| (k % shape.cut(), k / shape.cut())) {
                let pixel = [nearest[0] as usize + x - column, nearest[1] as usize + y - row];
                let off = [pixel[0] as f64 - centre[0], pixel[1] as f64 - centre[1]];
                if off[0].hypot(off[1]) < RADIUS {
                    for (worst, about) in worst.iter_mut().zip([centre, drawn]) {
                        let share = gains.share(about, pixel);
                        *worst = worst.max((patch.gain(x, y, &shape) * share - 1.0).abs());
                    }
                }
            }
        }
        worst
    }

    #[test]
    fn patches_are_the_profile_at_their_place_wherever_it_bends() {
        for bend in [0.0, 0.2] {
            let [own, drawn] = departures(bend, [0.31, 0.77]);
            assert!(drawn < 0.5 * GAIN_UNIT + 2e-6, "bend {bend}: {drawn}");
            // A mask's edge is where the profile falls by a quarter of itself a pixel.
            assert!(own < 0.05 * 0.25, "bend {bend}: {own}");
        }
    }

    #[test]
    fn patches_are_drawn_anew_when_the_lattice_has_changed_enough_to_see() {
        let grid = Grid::affine(ArrayKind::Square, [250.0, 200.0], BASIS, [501, 401]);
        let mut gains = Gains::new(&profile(0.0), &grid, RADIUS);
        let before = gains.gains.clone();
        let by = |change: f64| BASIS.map(|v| v.map(|x| x * (1.0 + change)));
        gains.follow(by(0.9 * STALE_PX / RADIUS));
        assert_eq!(gains.gains, before);
        gains.follow(by(1.1 * STALE_PX / RADIUS));
        assert_ne!(gains.gains, before);
        assert_eq!(gains.basis, by(1.1 * STALE_PX / RADIUS));
    }
}
