//! Where a sample of micro-images is, by the micro-image's known profile.
//!
//! A slope of the scene's brightness continues within each micro-image and jumps back at its edge, which shifts the phases
//! of the lattice's harmonics. Here each micro-image is compared within its own cell with the profile V: `I(c + r) = V(r − u)
//! T(r)`, where T is a parabola for the scene about it. That is solved for T without a shift first and is then linear in
//! u: all that is asked of a micro-image's pixels are a few sums with weights that are known beforehand. What the parabola
//! leaves says how far a place is to be believed.

use nalgebra::{DMatrix, Matrix4, SMatrix, SVector};
use pulp::Simd;
use rayon::prelude::*;

use crate::imaging::grid::{Grid, reciprocal};
use crate::imaging::matching::motion::{Field, Motion, Sums};
use crate::imaging::matching::plan::{GOLDEN, nearest_place, place};
use crate::imaging::matching::samples::{Frame, Sample};
use crate::imaging::matching::shape::LANES;
use crate::imaging::matching::vector::vectors;
use crate::imaging::vignetting::Vignetting;
use crate::optics::ArrayKind;

/// Frames after which every micro-image has been looked at, and how many take a turn at least and at most.
const TURNS: usize = 6;
const LEAST: usize = 1152;
const MOST: usize = 2048;
/// Fewest that say anything of the grid.
const FEWEST: usize = 9;
/// Micro-images that one thread looks at, at least.
const CHUNK: usize = 64;
/// Rows of a cell that are read, about.
const ROWS_PER_PITCH: f64 = 15.0;
/// Terms of the scene about a micro-image: 1, x, y, x², xy, y².
const SCENE: usize = 6;
/// Sums over a micro-image's pixels: its scene's terms, and those of its derivatives along x and along y.
const SUMS: usize = 3 * SCENE;
/// Profiles are drawn for centres at so many places between two pixels along each axis: from there the step is linear.
const PLACES: usize = 2;
/// Micro-images that say so many times more of their place than the median are no surer.
const CERTAINTY_CAP: f64 = 10.0;
/// Share of the micro-images that says what an outlier is: the surest.
const SUREST: f64 = 0.1;
/// Rounds of reweighting.
const ROUNDS: usize = 4;
/// How far a step may lead, px: beyond it the profile is not linear, and the step only a direction.
const REACH_PX: f64 = 1.0;
/// Standard errors in units of what the scatter between micro-images makes them, measured on exact-ray frames.
const SIGMA_FACTOR: f64 = 1.3;

/// What micro-images say of how the grid has moved.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    pub(super) motion: Motion,
    pub(super) covariance: Matrix4<f64>,
    /// Mean logarithm of the standard errors (px) of single micro-images: what starts are compared by.
    pub(super) error_log: f64,
}

/// Which of the micro-images are looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Turn {
    /// All of them.
    All,
    /// Those whose turn it is.
    Next,
    /// Those of the last turn once more.
    Again,
}

/// The micro-images, and the weights of their sums.
#[derive(Debug, Clone)]
pub(super) struct Places {
    field: Field,
    /// In such an order that those one after another lie all over the frame.
    lenses: Vec<Lens>,
    /// How many take a turn, and the first of the last turn.
    turn: usize,
    first: usize,
    /// Rows of the cell: offset from the middle in y and x, first weight, and how many.
    rows: Vec<(i32, i32, usize, usize)>,
    /// Pixels from the middle one that the cell reaches.
    reach: [i32; 2],
    shapes: Vec<Shape>,
    sorted: Vec<f64>,
    rooms: Vec<Vec<f32>>,
}

/// A micro-image.
#[derive(Debug, Clone)]
struct Lens {
    /// Its centre in the known grid, px, and the same in field coordinates.
    base: [f64; 2],
    place: [f64; 2],
    /// How far from where it was looked for it is, px, and the inverse of its standard error; that is 0 where nothing was
    /// found.
    shift: [f64; 2],
    certainty: f64,
}

/// The profile about a centre at one place between pixels.
#[derive(Debug, Clone)]
struct Shape {
    /// Weights of the sums, one sum after the other.
    weights: Vec<f32>,
    /// Pixels of a cell.
    count: usize,
    /// From the first sums to the scene's terms.
    scene: SMatrix<f64, SCENE, SCENE>,
    /// Products of the derivatives' weights: along x, mixed, along y.
    products: [SMatrix<f64, SCENE, SCENE>; 3],
}

impl Places {
    pub(super) fn new(grid: &Grid, profile: &Vignetting) -> Self {
        let field = Field::new(grid.frame_size);
        let step = ((grid.pitch_px() / ROWS_PER_PITCH).round() as i32).max(1);
        let [a, b] = grid.basis;
        let most = [0, 1].map(|k| (a[k].abs() + b[k].abs()) as i32 + 1);
        let (mut rows, mut cell, mut reach) = (Vec::new(), Vec::new(), [0, 0]);
        for dy in (-most[1] / step..=most[1] / step).map(|n| n * step) {
            let begin = cell.len();
            cell.extend(
                (-most[0]..=most[0]).filter(|&dx| in_cell(grid, f64::from(dx), f64::from(dy))).map(|dx| [dx, dy]),
            );
            if let Some(&[first, _]) = cell.get(begin) {
                rows.push((dy, first, begin, cell.len() - begin));
                reach = [reach[0].max(first.abs()).max(cell[cell.len() - 1][0]), reach[1].max(dy.abs())];
            }
        }
        let all: Vec<[f64; 2]> = grid.micro_images_within(0.0).map(|m| [m.x, m.y]).collect();
        let lens = |base: [f64; 2]| Lens { base, place: field.coordinates(base), shift: [0.0; 2], certainty: 0.0 };
        let lenses: Vec<Lens> = scattered(all.len()).into_iter().map(|k| lens(all[k])).collect();
        let shapes = (0..PLACES * PLACES)
            .map(|k| Shape::new(grid, profile, &cell, [place(k % PLACES, PLACES), place(k / PLACES, PLACES)]))
            .collect();
        // Turns of about one length.
        let turns = lenses.len().div_ceil((lenses.len() / TURNS).clamp(LEAST, MOST)).max(1);
        let turn = lenses.len().div_ceil(turns);
        let rooms = vec![vec![0.0; cell.len().next_multiple_of(LANES)]; lenses.len().div_ceil(CHUNK)];
        Self { field, turn, first: 0, rows, reach, shapes, sorted: Vec::with_capacity(lenses.len()), rooms, lenses }
    }

    /// Looks at a frame with this dark level about where a motion has the micro-images. `None` where they do not determine
    /// how the grid has moved from there.
    pub(super) fn look<T: Sample>(
        &mut self,
        frame: &Frame<'_, T>,
        dark: f32,
        about: &Motion,
        turn: Turn,
    ) -> Option<Placed> {
        let count = self.lenses.len();
        if turn == Turn::Next {
            self.first = if self.first + self.turn < count { self.first + self.turn } else { 0 };
        }
        let range = if turn == Turn::All { 0..count } else { self.first..(self.first + self.turn).min(count) };
        let (field, rows, reach, shapes) = (&self.field, &self.rows, self.reach, &self.shapes);
        let arch = pulp::Arch::new();
        self.lenses[range.clone()].par_chunks_mut(CHUNK).zip(&mut self.rooms).for_each(|(lenses, values)| {
            arch.dispatch(Compare { frame, field, rows, reach, shapes, dark, about, lenses, values });
        });
        self.fit(about, range)
    }

    /// Shift, scale and rotation through some of the micro-images.
    fn fit(&mut self, about: &Motion, range: std::ops::Range<usize>) -> Option<Placed> {
        let Self { field, lenses, sorted, .. } = self;
        let lenses = &lenses[range];
        let found = || lenses.iter().filter(|l| l.certainty > 0.0);
        sorted.clear();
        sorted.extend(found().map(|l| l.certainty));
        let count = sorted.len();
        if count < FEWEST {
            return None;
        }
        let error_log = -sorted.iter().map(|c| c.ln()).sum::<f64>() / count as f64;
        let cap = CERTAINTY_CAP * *sorted.select_nth_unstable_by(count / 2, f64::total_cmp).1;
        let sure = *sorted.select_nth_unstable_by((count as f64 * (1.0 - SUREST)) as usize, f64::total_cmp).1;
        let mut motion = Motion::NONE;
        let mut covariance = Matrix4::zeros();
        let mut spread = 1.0f64;
        for round in 0..ROUNDS {
            let mut sums = Sums::default();
            for lens in found() {
                let certainty = lens.certainty.min(cap);
                let [ux, uy] = motion.displacement(lens.place);
                let left = [lens.shift[0] - ux, lens.shift[1] - uy];
                // Huber's weights first, which have one minimum, then Tukey's, which let go of outliers.
                let z = certainty * (left[0] * left[0] + left[1] * left[1]).sqrt() / spread;
                let robust = match round {
                    0 => 1.0,
                    1 => (1.345 / z).min(1.0),
                    _ => (1.0 - (z / 4.685).powi(2)).max(0.0).powi(2),
                };
                sums.add(lens.place, left, certainty * certainty * robust, robust);
            }
            let (step, inverse) = sums.solved()?;
            motion.0 += step;
            covariance = inverse * sums.variance();
            sorted.clear();
            sorted.extend(found().filter(|l| l.certainty >= sure).map(|lens| {
                let [ux, uy] = motion.displacement(lens.place);
                lens.certainty.min(cap) * (lens.shift[0] - ux).hypot(lens.shift[1] - uy)
            }));
            // The median of the length of two normal numbers is 1.18 of their deviation.
            let middle = sorted.len() / 2;
            spread = (*sorted.select_nth_unstable_by(middle, f64::total_cmp).1 / 1.177).max(1e-6);
        }
        let far = motion.greatest(field);
        if far > REACH_PX {
            motion.0 *= REACH_PX / far;
        }
        covariance *= SIGMA_FACTOR.powi(2);
        Some(Placed { motion: Motion(about.0 + motion.0), covariance, error_log })
    }
}

/// So many numbers in an order of which every part is spread evenly: by the fractions of the golden ratio's multiples.
fn scattered(count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    // The n-th multiple falls into the n-th place of the order: the inverse of sorting by fraction.
    order.sort_by(|&a, &b| (a as f64 * GOLDEN).fract().total_cmp(&(b as f64 * GOLDEN).fract()));
    let mut places = vec![0; count];
    order.iter().enumerate().for_each(|(rank, &n)| places[n] = rank);
    places
}

impl Shape {
    fn new(grid: &Grid, profile: &Vignetting, cell: &[[i32; 2]], place: [f64; 2]) -> Self {
        let r = reciprocal(grid.basis);
        let value = |x: f64, y: f64| {
            let [u, v] = r.map(|g| g[0] * x + g[1] * y);
            f64::from(profile.terms_at(u, v)[0])
        };
        let count = cell.len();
        let scale = grid.pitch_px() / 2.0;
        let (mut scene, mut slopes) = (DMatrix::<f64>::zeros(count, SCENE), DMatrix::<f64>::zeros(count, 2 * SCENE));
        for (n, &[dx, dy]) in cell.iter().enumerate() {
            let (x, y) = (f64::from(dx) - place[0], f64::from(dy) - place[1]);
            let (s, t) = (f64::from(dx) / scale, f64::from(dy) / scale);
            // V(r − u) = V(r) − u·∇V.
            let along_x = value(x - 0.5, y) - value(x + 0.5, y);
            let along_y = value(x, y - 0.5) - value(x, y + 0.5);
            for (k, term) in [1.0, s, t, s * s, s * t, t * t].into_iter().enumerate() {
                scene[(n, k)] = value(x, y) * term;
                slopes[(n, k)] = along_x * term;
                slopes[(n, SCENE + k)] = along_y * term;
            }
        }
        let qr = scene.qr();
        let span = qr.q();
        // What the scene's terms cannot imitate of a shift.
        let slopes = &slopes - &span * (span.transpose() * &slopes);
        let products = slopes.transpose() * &slopes;
        let part = |i: usize, j: usize| products.fixed_view::<SCENE, SCENE>(i * SCENE, j * SCENE).into_owned();
        let terms = qr.r().fixed_view::<SCENE, SCENE>(0, 0).try_inverse().unwrap_or_default();
        let mut weights = Vec::new();
        for column in span.column_iter().chain(slopes.column_iter()) {
            weights.extend(column.iter().map(|&w| w as f32));
            weights.resize(weights.len().next_multiple_of(LANES), 0.0);
        }
        Self { weights, count, scene: terms, products: [part(0, 0), part(0, 1), part(1, 1)] }
    }

    /// A micro-image's shift from the shape's place, px, and its standard error; `None` where it is dark.
    #[inline(always)]
    fn shift<S: Simd>(&self, simd: S, values: &[f32]) -> Option<([f64; 2], f64)> {
        let mut sums = [0.0f64; SUMS];
        for k in 0..SUMS / 3 {
            let [a, b, c] = products(simd, values, &self.weights[3 * k * values.len()..]);
            sums[3 * k] = f64::from(a);
            sums[3 * k + 1] = f64::from(b);
            sums[3 * k + 2] = f64::from(c);
        }
        let span = SVector::<f64, SCENE>::from_column_slice(&sums[..SCENE]);
        let scene = self.scene * span;
        let (mut along_x, mut along_y) = (0.0, 0.0);
        for k in 0..SCENE {
            along_x += scene[k] * sums[SCENE + k];
            along_y += scene[k] * sums[2 * SCENE + k];
        }
        let xx = scene.dot(&(self.products[0] * scene));
        let xy = scene.dot(&(self.products[1] * scene));
        let yy = scene.dot(&(self.products[2] * scene));
        let determinant = xx * yy - xy * xy;
        if determinant.is_nan() || determinant <= 1e-6 * xx * yy {
            return None;
        }
        let shift = [(yy * along_x - xy * along_y) / determinant, (xx * along_y - xy * along_x) / determinant];
        let all = f64::from(squares(simd, values));
        let rest = all - span.norm_squared() - shift[0] * along_x - shift[1] * along_y;
        // The sums' own rounding is a millionth of all.
        let variance = rest.max(1e-6 * all) / self.count as f64;
        Some((shift, (variance * (xx + yy) / (2.0 * determinant)).sqrt()))
    }
}

struct Compare<'a, T> {
    frame: &'a Frame<'a, T>,
    field: &'a Field,
    rows: &'a [(i32, i32, usize, usize)],
    reach: [i32; 2],
    shapes: &'a [Shape],
    dark: f32,
    about: &'a Motion,
    lenses: &'a mut [Lens],
    /// Room for a micro-image's pixels.
    values: &'a mut [f32],
}

impl<T: Sample> pulp::WithSimd for Compare<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { frame, field, rows, reach, shapes, dark, about, lenses, values } = self;
        let size = [frame.width as i32, frame.height as i32];
        for lens in lenses {
            let centre = about.moved(field, lens.base);
            let nearest = [centre[0].round() as i32, centre[1].round() as i32];
            lens.certainty = 0.0;
            let mut inside = true;
            for k in 0..2 {
                inside &= nearest[k] >= reach[k] && nearest[k] + reach[k] < size[k];
            }
            if !inside {
                continue;
            }
            for &(dy, dx, begin, count) in rows {
                let from = (nearest[1] + dy) as usize * frame.width + (nearest[0] + dx) as usize;
                for (value, sample) in values[begin..begin + count].iter_mut().zip(&frame.samples[from..from + count]) {
                    *value = sample.grey() - dark;
                }
            }
            let fraction = [centre[0] - f64::from(nearest[0]), centre[1] - f64::from(nearest[1])];
            let [px, py] = [nearest_place(fraction[0], PLACES), nearest_place(fraction[1], PLACES)];
            if let Some((shift, sigma)) = shapes[py * PLACES + px].shift(simd, values) {
                lens.shift = [shift[0] + place(px, PLACES) - fraction[0], shift[1] + place(py, PLACES) - fraction[1]];
                lens.certainty = 1.0 / sigma;
            }
        }
    }
}

/// Dot products of a row with three others that follow each other. All have a length of whole lanes.
#[inline(always)]
fn products<S: Simd>(simd: S, values: &[f32], rows: &[f32]) -> [f32; 3] {
    let count = values.len() / S::F32_LANES;
    let length = count * S::F32_LANES;
    let values = vectors::<S>(values, 0, count);
    let a = vectors::<S>(rows, 0, count);
    let b = vectors::<S>(rows, length, count);
    let c = vectors::<S>(rows, 2 * length, count);
    let zero = simd.splat_f32s(0.0);
    // Two sums each, so that none waits for itself.
    let mut sums = [zero; 6];
    let mut n = 0;
    while n + 1 < count {
        let (v, w) = (values[n], values[n + 1]);
        sums[0] = simd.mul_add_e_f32s(v, a[n], sums[0]);
        sums[1] = simd.mul_add_e_f32s(v, b[n], sums[1]);
        sums[2] = simd.mul_add_e_f32s(v, c[n], sums[2]);
        sums[3] = simd.mul_add_e_f32s(w, a[n + 1], sums[3]);
        sums[4] = simd.mul_add_e_f32s(w, b[n + 1], sums[4]);
        sums[5] = simd.mul_add_e_f32s(w, c[n + 1], sums[5]);
        n += 2;
    }
    if n < count {
        sums[0] = simd.mul_add_e_f32s(values[n], a[n], sums[0]);
        sums[1] = simd.mul_add_e_f32s(values[n], b[n], sums[1]);
        sums[2] = simd.mul_add_e_f32s(values[n], c[n], sums[2]);
    }
    [
        simd.reduce_sum_f32s(simd.add_f32s(sums[0], sums[3])),
        simd.reduce_sum_f32s(simd.add_f32s(sums[1], sums[4])),
        simd.reduce_sum_f32s(simd.add_f32s(sums[2], sums[5])),
    ]
}

/// The sum of a row's squares.
#[inline(always)]
fn squares<S: Simd>(simd: S, values: &[f32]) -> f32 {
    let mut sum = simd.splat_f32s(0.0);
    for &value in vectors::<S>(values, 0, values.len() / S::F32_LANES) {
        sum = simd.mul_add_e_f32s(value, value, sum);
    }
    simd.reduce_sum_f32s(sum)
}

/// Whether a displacement (px) from a micro-image centre lies nearer to it than to any neighbour.
fn in_cell(grid: &Grid, x: f64, y: f64) -> bool {
    let [a, b] = grid.basis;
    let third = if grid.array == ArrayKind::Hexagonal { [b[0] - a[0], b[1] - a[1]] } else { a };
    [a, b, third].iter().all(|n| (x * n[0] + y * n[1]).abs() <= 0.5 * (n[0] * n[0] + n[1] * n[1]))
}
