//! Places of micro-images in a textured frame, from their mean profile.
//!
//! A slope of the scene's brightness continues within each micro-image and jumps back at its edge: a sawtooth in step
//! with the lattice, which shifts the phase of its harmonics. Here each micro-image is compared, within its own cell,
//! with the frame's mean profile V: `I(c + r) = V(r − u) T(r)`, where T is a parabola for the scene about it. That is
//! solved for T without a shift first and is then linear in u. V is given the array's own symmetry, so that it defines
//! the centre whatever the grid it was averaged with.
//!
//! What the parabola leaves of a micro-image says how far its place is to be believed: those on even parts of the scene
//! outweigh those full of detail.

mod mean;
mod sample;
mod shift;

use fourier::Complex;
use nalgebra::{DMatrix, SMatrix};
use rayon::prelude::*;

use super::demodulate::Lens;
use super::fit::{Fit, Model};
use super::frame::{Frame, Window};
use super::harmonics::Harmonics;
use super::phases::Phases;
use super::{Grid, MicroImage, reciprocal};
use crate::optics::ArrayKind;
use mean::{Profile, smoothed};
use sample::{by_chance, halves};
use shift::{ShiftTask, terms};

/// Bins of the mean profile per px.
const BINS_PER_PX: f64 = 2.0;
/// Part of a cell on either side over which the mean profile is smoothed, twice: what is finer there is texture more often
/// than an edge of micro-images.
const SMOOTHED: f64 = 0.02;
/// Terms of the scene about a micro-image: 1, x, y, x², xy, y².
const TERMS: usize = 6;
/// The profile is drawn for micro-image centres at so many places between two pixels, in both directions: from there
/// the linear step is short. Fewer do where pixels are left out.
const PLACES: usize = 4;
const PLACES_SPARSE: usize = 2;

/// Pixels that the mean profile is taken from: more add nothing. They are added up in so many parts.
const PROFILE_PIXELS: usize = 1_500_000;
const PROFILE_PARTS: usize = 8;

/// Micro-images that go before all others where there are many, and how little (px) they may still move when these follow.
const FORERUNNERS: usize = 2500;
const FORERUNNERS_AT_REST_PX: f64 = 0.02;
/// A profile known from elsewhere is drawn anew where the lattice's vectors have changed by more than this, px: at the
/// edge of a cell that moves it half as far, out on one side and in on the other, which shifts nothing.
const VECTORS_STEADY_PX: f64 = 0.005;
/// Standard errors of the fit's shift below which a grid does not move.
const AT_REST_SIGMAS: f64 = 0.5;

/// Least share of a mean profile's slopes that is taken for the micro-images' edges: below it two halves do not tell it.
const SHARE_LEAST: f64 = 0.03;
/// What it is taken for where micro-images are too few for halves.
const SHARE_OF_FEW: f64 = 0.3;

/// A micro-image's profile that is known from elsewhere: relative transmission at fractional lattice indices.
pub(super) type Known<'a> = &'a dyn Fn(f64, f64) -> f64;

/// What it may cost to place a grid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Effort {
    /// Every so many pixels of every so many rows are read.
    pub step: usize,
    /// Rounds in which profile and grid are brought together, at most.
    pub rounds: usize,
    /// A grid that moves less from one round to the next is at rest, px.
    pub at_rest_px: f64,
}

/// A grid placed by the frame's mean profile.
pub(super) struct Matched {
    pub fit: Fit,
    /// Mean logarithm of the standard errors (px) of single micro-images: what starts are compared by.
    pub error_log: f64,
}

/// The best of what several starts lead to, by what the profile leaves of the micro-images.
pub(super) fn matched_best(
    frame: &Frame,
    starts: &[Grid],
    lenses: &[MicroImage],
    known: Option<Known>,
    model: Model,
    effort: Effort,
) -> Option<Matched> {
    /// Starts that are nearer to each other than this, px, lead to the same place.
    const APART_PX: f64 = 0.3;
    let mut best: Option<Matched> = None;
    let mut drawn = None;
    for (n, start) in starts.iter().enumerate() {
        if starts[..n].iter().any(|earlier| earlier.distance_to(start) < APART_PX) {
            continue;
        }
        let Some(found) = matched(frame, start, lenses, known, model, effort, &mut drawn) else { continue };
        if best.as_ref().is_none_or(|b| found.error_log < b.error_log) {
            best = Some(found);
        }
    }
    best
}

/// Places a grid by the mean profile about its `lenses` (their indices count); `None` where they do not determine it.
/// `drawn` keeps what a known profile was drawn for.
fn matched(
    frame: &Frame,
    grid: &Grid,
    lenses: &[MicroImage],
    known: Option<Known>,
    model: Model,
    effort: Effort,
    drawn: &mut Option<Matcher>,
) -> Option<Matched> {
    let mut at = grid.clone();
    // The profile is averaged with the grid that it corrects: both settle together, a part of the micro-images first.
    let few = by_chance(lenses, FORERUNNERS);
    let mut all = few.len() == lenses.len();
    let mut rounds = 0;
    while rounds < effort.rounds {
        let lenses: Vec<MicroImage> = if all { lenses } else { &few }
            .iter()
            .map(|m| {
                let [x, y] = at.position(m.i, m.j);
                MicroImage { x, y, ..*m }
            })
            .collect();
        let harmonics = Harmonics::new(&at).waves;
        let matcher = match drawn.take_if(|drawn| known.is_some() && drawn.serves(&at)) {
            Some(drawn) => drawn,
            None => Matcher::new(frame, &at, &lenses, known, effort.step)?,
        };
        let matcher = drawn.insert(matcher);
        let places = matcher.run(frame, &lenses, &harmonics);
        let phases = Phases::new(&at, &places, &harmonics).by_certainty();
        let fit = phases.fit(model)?;
        let moved = fit.grid.distance_to(&at);
        rounds += 1;
        let last = rounds == effort.rounds;
        // What is within the fit's own uncertainty is no motion.
        let unsure = AT_REST_SIGMAS * fit.sigma[0].max(fit.sigma[1]);
        if all && (moved < effort.at_rest_px.max(unsure) || last) {
            let (residual_px, scatter_px) = phases.residual_and_scatter_about(&fit.grid);
            let error_log = -places.iter().map(|l| l.sums[0].norm().ln()).sum::<f64>() / places.len() as f64;
            let share = if known.is_some() { 1.0 } else { matcher.true_share(frame, &at, &lenses) };
            let sigma = phases.sigma(&fit, 1.0 / share);
            let fit = Fit { grid: Grid { residual_px, scatter_px, sigma, ..fit.grid }, ..fit };
            return Some(Matched { fit, error_log });
        }
        at = fit.grid;
        if !all && (moved < FORERUNNERS_AT_REST_PX.max(unsure) || last) {
            (all, rounds) = (true, 0);
        }
    }
    None
}

/// Compares micro-images with the frame's mean profile.
struct Matcher {
    /// The lattice's vectors that it was made for, px.
    basis: [[f64; 2]; 2],
    /// Half a pitch, px: what the scene's terms count in.
    scale: f64,
    /// Pixels of a cell from the one nearest its centre, and the same as a window on the frame.
    cell: Vec<(isize, isize)>,
    window: Window,
    reach: [isize; 2],
    /// Shapes for `places` centres in both directions.
    shapes: Vec<Shape>,
    places: usize,
}

/// The profile about a micro-image's centre at one place between the pixels.
struct Shape {
    /// Orthonormal columns that span the profile times the scene's terms.
    span: DMatrix<f32>,
    /// From their coefficients to those of the terms.
    terms: SMatrix<f32, TERMS, TERMS>,
    /// Derivatives by a shift in x and in y of the profile itself.
    slopes: [Vec<f32>; 2],
}

impl Matcher {
    /// From the frame's own mean profile, every `step`-th pixel of it; `None` where there is too little of it.
    fn new(frame: &Frame, grid: &Grid, lenses: &[MicroImage], known: Option<Known>, step: usize) -> Option<Self> {
        let [a, b] = grid.basis;
        let step = step as isize;
        let most = [(a[0].abs() + b[0].abs()) as isize + 1, (a[1].abs() + b[1].abs()) as isize + 1];
        let mut cell = Vec::new();
        for dy in (-most[1] / step..=most[1] / step).map(|n| n * step) {
            for dx in (-most[0] / step..=most[0] / step).map(|n| n * step) {
                if in_cell(grid, dx as f64, dy as f64) {
                    cell.push((dx, dy));
                }
            }
        }
        if cell.len() < 3 * TERMS {
            return None;
        }
        let reach = cell.iter().fold([0, 0], |r, c| [r[0].max(c.0.abs()), r[1].max(c.1.abs())]);
        let window = Window::new(&cell, step as usize, frame.width);
        let places = if step > 1 { PLACES_SPARSE } else { PLACES };
        let (basis, scale) = (grid.basis, grid.pitch_px() / 2.0);
        let mut matcher = Self { basis, scale, cell, window, reach, shapes: Vec::new(), places };
        let own = if known.is_none() { Some(matcher.mean_profile(frame, grid, lenses)?) } else { None };
        let profile = |u: f64, v: f64| match (&own, known) {
            (_, Some(known)) => known(u, v),
            (Some(own), None) => own.at(u, v),
            (None, None) => 0.0,
        };
        let shapes: Option<Vec<Shape>> = (0..places * places)
            .map(|k| matcher.shape(&profile, [k % places, k / places].map(|n| matcher.place_between(n))))
            .collect();
        matcher.shapes = shapes?;
        Some(matcher)
    }

    /// Whether what was drawn is as good for this grid.
    fn serves(&self, grid: &Grid) -> bool {
        self.basis.as_flattened().iter().zip(grid.basis.as_flattened()).all(|(a, b)| (a - b).abs() < VECTORS_STEADY_PX)
    }

    fn shape(&self, profile: &dyn Fn(f64, f64) -> f64, place: [f64; 2]) -> Option<Shape> {
        let r = reciprocal(self.basis);
        let value = |x: f64, y: f64| profile(r[0][0] * x + r[0][1] * y, r[1][0] * x + r[1][1] * y);
        let count = self.cell.len();
        let mut products = DMatrix::<f64>::zeros(count, TERMS);
        let mut slopes = [Vec::with_capacity(count), Vec::with_capacity(count)];
        for (n, &(dx, dy)) in self.cell.iter().enumerate() {
            let (x, y) = (dx as f64 - place[0], dy as f64 - place[1]);
            let v = value(x, y);
            for (k, term) in terms(dx, dy, self.scale).into_iter().enumerate() {
                products[(n, k)] = v * term;
            }
            // V(r − u) = V(r) − u·∇V.
            slopes[0].push((value(x - 0.5, y) - value(x + 0.5, y)) as f32);
            slopes[1].push((value(x, y - 0.5) - value(x, y + 0.5)) as f32);
        }
        let qr = products.qr();
        let inverse: SMatrix<f64, TERMS, TERMS> = qr.r().fixed_view::<TERMS, TERMS>(0, 0).try_inverse()?;
        Some(Shape { span: qr.q().cast(), terms: inverse.cast(), slopes })
    }

    /// Where between two pixels the shapes with this number have their centre, px.
    fn place_between(&self, number: usize) -> f64 {
        (number as f64 + 0.5) / self.places as f64 - 0.5
    }

    fn complete(&self, size: [usize; 2], m: &MicroImage) -> Option<(isize, isize)> {
        let (cx, cy) = (m.x.round() as isize, m.y.round() as isize);
        let inside = cx >= self.reach[0]
            && cy >= self.reach[1]
            && cx + self.reach[0] < size[0] as isize
            && cy + self.reach[1] < size[1] as isize;
        inside.then_some((cx, cy))
    }

    fn mean_profile(&self, frame: &Frame, grid: &Grid, lenses: &[MicroImage]) -> Option<Profile> {
        let r = reciprocal(grid.basis);
        let size = [frame.width, frame.height];
        let side = ((grid.pitch_px() * BINS_PER_PX).round() as usize).clamp(8, 160);
        let every = (lenses.len() * self.cell.len()).div_ceil(PROFILE_PIXELS).max(1);
        let taken: Vec<(&MicroImage, [isize; 2])> =
            lenses.iter().step_by(every).filter_map(|m| self.complete(size, m).map(|(cx, cy)| (m, [cx, cy]))).collect();
        let complete = taken.len();
        // The parts do not depend on the machine, so that neither do the sums' last digits.
        let parts: Vec<Vec<[f32; 2]>> = taken
            .par_chunks(complete.div_ceil(PROFILE_PARTS).max(1))
            .map(|part| self.binned(frame, part, r, side))
            .collect();
        let mut bins = vec![[0.0f32; 2]; side * side];
        for part in &parts {
            for (bin, more) in bins.iter_mut().zip(part) {
                bin[0] += more[0];
                bin[1] += more[1];
            }
        }
        if complete < 9 {
            return None;
        }
        // The array's own symmetry is the profile's: what departs from it is texture, or a centre that is off.
        let sums: Vec<(f64, f64)> = (0..side * side)
            .map(|n| {
                let [mut p, mut q] = [n % side, n / side];
                let mut sum = (0.0, 0.0);
                for _ in 0..grid.array.turns() {
                    let bin = bins[q * side + p];
                    sum = (sum.0 + f64::from(bin[0]), sum.1 + f64::from(bin[1]));
                    [p, q] = grid.array.turned([p, q], side);
                }
                sum
            })
            .collect();
        // Bins that no pixel fell into take the mean of those about them.
        let about = |n: usize| {
            let (q, p) = (n / side, n % side);
            let mut sum = (0.0, 0.0);
            for dq in [side - 1, 0, 1] {
                for dp in [side - 1, 0, 1] {
                    let s = sums[(q + dq) % side * side + (p + dp) % side];
                    sum = (sum.0 + s.0, sum.1 + s.1);
                }
            }
            sum.0 / sum.1.max(1e-12)
        };
        let mut values: Vec<f64> =
            (0..side * side).map(|n| if sums[n].1 > 0.0 { sums[n].0 / sums[n].1 } else { about(n) }).collect();
        let reach = (SMOOTHED * side as f64).round() as usize;
        for (along, across) in [(1, side), (side, 1), (1, side), (side, 1)] {
            values = smoothed(&values, side, [along, across], reach);
        }
        Some(Profile { side, values })
    }

    /// How much of the slopes of the frame's own mean profile is the micro-images' edges, and not what their textures leave
    /// of them in the mean: 0 to 1. Shifts come out smaller by so much, and so does their scatter. It is what the profiles
    /// of two halves of the micro-images have in common.
    fn true_share(&self, frame: &Frame, grid: &Grid, lenses: &[MicroImage]) -> f64 {
        let halves = halves(lenses.len());
        let profile = |half: bool| {
            let lenses: Vec<MicroImage> =
                lenses.iter().zip(&halves).filter(|(_, h)| **h == half).map(|(m, _)| *m).collect();
            self.mean_profile(frame, grid, &lenses)
        };
        let (Some(one), Some(other)) = (profile(false), profile(true)) else { return SHARE_OF_FEW };
        let side = one.side;
        let (mut common, mut all) = (0.0, 0.0);
        for n in 0..side * side {
            let (q, p) = (n / side, n % side);
            // A pixel's distance, as shifts are told from.
            for next in [q * side + (p + 2) % side, (q + 2) % side * side + p] {
                let [a, b] = [&one, &other].map(|profile| profile.values[next] - profile.values[n]);
                common += a * b;
                all += 0.5 * (a * a + b * b);
            }
        }
        // The profile of all has half the variance of what is not common.
        let share = common / (common + 0.5 * (all - common)).max(1e-12);
        share.clamp(SHARE_LEAST, 1.0)
    }

    /// Sums over micro-images, each with the pixel nearest its centre: of mean times level, and of the mean's square.
    fn binned(
        &self,
        frame: &Frame,
        lenses: &[(&MicroImage, [isize; 2])],
        reciprocal: [[f64; 2]; 2],
        side: usize,
    ) -> Vec<[f32; 2]> {
        let mut bins = vec![[0.0f32; 2]; side * side];
        let mut values = vec![0.0f32; self.cell.len()];
        // The cell's pixels in bins from its middle.
        let places: Vec<[f32; 2]> = self
            .cell
            .iter()
            .map(|&(dx, dy)| reciprocal.map(|[gx, gy]| ((gx * dx as f64 + gy * dy as f64) * side as f64) as f32))
            .collect();
        for &(m, [cx, cy]) in lenses {
            frame.levels(cy * frame.width as isize + cx, &self.window, &mut values);
            let mean = values.iter().sum::<f32>() / values.len() as f32;
            if mean <= 0.0 {
                continue;
            }
            // Less than a cell from the centre: one more makes it positive, and truncation rounds it.
            let first = [0, 1].map(|k| {
                let [gx, gy] = reciprocal[k];
                ((gx * (cx as f64 - m.x) + gy * (cy as f64 - m.y) + 1.0) * side as f64 + 0.5) as f32
            });
            for (&[u, v], &value) in places.iter().zip(&values) {
                let bin = |at: f32| {
                    let bin = at as u32 as usize;
                    // Comparisons: a division costs more than all the rest.
                    let bin = if bin >= side { bin - side } else { bin };
                    if bin >= side { bin - side } else { bin }
                };
                let to = &mut bins[bin(first[1] + v) * side + bin(first[0] + u)];
                // Least squares for I = mean V: the dark ones say little of it.
                to[0] += mean * value;
                to[1] += mean * mean;
            }
        }
        bins
    }

    /// Those of `lenses` that are complete, each shift written as phases of the lattice's `harmonics` whose modulus is
    /// the inverse of its standard error.
    fn run(&self, frame: &Frame, lenses: &[MicroImage], harmonics: &[[f64; 2]]) -> Vec<Lens> {
        let size = [frame.width, frame.height];
        let mut polynomials: [Vec<f32>; TERMS] = std::array::from_fn(|_| Vec::with_capacity(self.cell.len()));
        for &(dx, dy) in &self.cell {
            polynomials.iter_mut().zip(terms(dx, dy, self.scale)).for_each(|(all, term)| all.push(term as f32));
        }
        let arch = pulp::Arch::new();
        lenses
            .par_iter()
            .with_min_len(32)
            .map_init(
                || std::array::from_fn(|_| vec![0.0f32; self.cell.len()]),
                |buffers, at| {
                    let (cx, cy) = self.complete(size, at)?;
                    let (fx, fy) = (at.x - cx as f64, at.y - cy as f64);
                    let number = |f: f64| (((f + 0.5) * self.places as f64) as usize).min(self.places - 1);
                    let (px, py) = (number(fx), number(fy));
                    let shape = &self.shapes[py * self.places + px];
                    let (shift, sigma) = arch.dispatch(ShiftTask {
                        frame,
                        window: &self.window,
                        middle: cy * size[0] as isize + cx,
                        shape,
                        buffers,
                        polynomials: &polynomials,
                    })?;
                    let shift = [shift[0] + self.place_between(px) - fx, shift[1] + self.place_between(py) - fy];
                    let mut sums = [Complex::new(0.0, 0.0); 3];
                    for (sum, g) in sums.iter_mut().zip(harmonics) {
                        let cycles = (g[0] * shift[0] + g[1] * shift[1]).clamp(-0.49, 0.49);
                        *sum = Complex::from_polar(1.0 / sigma, std::f64::consts::TAU * cycles);
                    }
                    Some(Lens { at: *at, sums })
                },
            )
            .flatten_iter()
            .collect()
    }
}

/// Whether a displacement (px) from a micro-image centre lies nearer to it than to any neighbour.
fn in_cell(grid: &Grid, x: f64, y: f64) -> bool {
    let [a, b] = grid.basis;
    let mut neighbours = vec![a, b];
    if grid.array == ArrayKind::Hexagonal {
        neighbours.push([b[0] - a[0], b[1] - a[1]]);
    }
    neighbours.iter().all(|n| (x * n[0] + y * n[1]).abs() <= 0.5 * (n[0] * n[0] + n[1] * n[1]))
}
