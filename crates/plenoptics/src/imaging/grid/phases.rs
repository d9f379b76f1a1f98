//! Phases of many micro-images: what they say together without a model, and of single ones.

use fourier::Complex;
use rayon::prelude::*;

use super::Grid;
use super::demodulate::Lens;

/// Contrast above the median counts no more than this: a bright outlier is still one micro-image.
const CONTRAST_CAP: f64 = 1.5;
/// The same for certainty: micro-images that say ten times more of their place than the median are no surer.
const CERTAINTY_CAP: f64 = 10.0;

/// Micro-images that one thread looks at, at least.
const PART: usize = 512;
/// Contrast below which a micro-image says nothing of its place.
const CONTRAST_LEAST: f64 = 0.3;
/// Share of the greatest power of the brought-together harmonics that another change of the pitch needs to be as good.
const AS_GOOD: f64 = 0.6;

/// Phases of all micro-images as observations of a displacement field.
pub(super) struct Phases<'a> {
    pub grid: &'a Grid,
    pub lenses: &'a [Lens],
    pub harmonics: &'a [[f64; 2]],
    /// Modulus and cycles of each sum, micro-image by micro-image.
    pub observations: Vec<[f64; 2]>,
    /// Median modulus of each harmonic's sum.
    pub medians: Vec<f64>,
    /// Greatest modulus that counts, medians.
    pub cap: f64,
    pub moduli_are_certainty: bool,
}

impl<'a> Phases<'a> {
    pub(super) fn new(grid: &'a Grid, lenses: &'a [Lens], harmonics: &'a [[f64; 2]]) -> Self {
        let count = harmonics.len();
        let observations: Vec<[f64; 2]> = lenses
            .par_iter()
            .with_min_len(PART)
            .flat_map_iter(|l| l.sums[..count].iter().map(|&sum| [sum.norm(), cycles(sum)]))
            .collect();
        let moduli = |h: usize| observations.iter().skip(h).step_by(count).map(|[modulus, _]| *modulus);
        let medians = (0..count).map(|h| median(&mut moduli(h).collect::<Vec<_>>()).max(1e-12)).collect();
        Self { grid, lenses, harmonics, observations, medians, cap: CONTRAST_CAP, moduli_are_certainty: false }
    }

    /// The same where the moduli are the inverse of standard errors: they count up to a greater multiple of the median,
    /// and the surest say what an outlier is. Where a chequered board has an edge in most micro-images, the others do.
    pub(super) fn by_certainty(self) -> Self {
        Self { cap: CERTAINTY_CAP, moduli_are_certainty: true, ..self }
    }

    /// Contrast of a micro-image relative to the median: the weakest of its harmonics.
    pub(super) fn contrast(&self, lens: &Lens) -> f64 {
        (0..self.harmonics.len()).map(|h| lens.sums[h].norm() / self.medians[h]).fold(f64::INFINITY, f64::min)
    }

    /// Where a micro-image is, less where it was assumed, px: least squares over its harmonics.
    pub(super) fn displacement(&self, lens: &Lens) -> [f64; 2] {
        let (mut n, mut q) = (nalgebra::Matrix2::<f64>::zeros(), nalgebra::Vector2::<f64>::zeros());
        for (h, g) in self.harmonics.iter().enumerate() {
            let g = nalgebra::Vector2::new(g[0], g[1]);
            n += g * g.transpose();
            q += g * cycles(lens.sums[h]);
        }
        n.try_inverse().map_or([0.0; 2], |inverse| {
            let u = inverse * q;
            [u[0], u[1]]
        })
    }

    /// Where the micro-images that have contrast are, less where a grid near the assumed one has them, px.
    fn offsets_from(&self, grid: &Grid) -> Offsets {
        let offset = |l: &Lens| {
            let ([x, y], to) = (self.displacement(l), grid.position(l.at.i, l.at.j));
            [l.at.x + x - to[0], l.at.y + y - to[1]]
        };
        let seen = |l: &&Lens| self.contrast(l) > CONTRAST_LEAST;
        Offsets::new(self.lenses.iter().filter(seen).map(|l| ([l.at.i, l.at.j], offset(l))).collect())
    }

    /// Median distance of single micro-images from a grid near the assumed one, px.
    pub(super) fn scatter_about(&self, grid: &Grid) -> f64 {
        self.offsets_from(grid).scatter()
    }

    /// Median distance of neighbourhoods of five by five micro-images from a grid near the assumed one, px: of each the
    /// median offset in x and in y, so that single micro-images' own errors are not in it. Their scatter where the
    /// frame has too few for that. With it the scatter itself.
    pub(super) fn residual_and_scatter_about(&self, grid: &Grid) -> (f64, f64) {
        /// Neighbourhoods that are looked at.
        const ENOUGH: usize = 2000;
        let offsets = self.offsets_from(grid);
        let scatter = offsets.scatter();
        let every = offsets.all.len().div_ceil(ENOUGH).max(1);
        let mut distances: Vec<f64> = Vec::new();
        for (i, j) in self.lenses.iter().step_by(every).map(|l| (l.at.i, l.at.j)) {
            let about: Vec<[f64; 2]> = (0..25).filter_map(|k| offsets.at([i - 2 + k % 5, j - 2 + k / 5])).collect();
            if about.len() > 12 {
                let [x, y] = [0, 1].map(|axis| median(&mut about.iter().map(|o| o[axis]).collect::<Vec<_>>()));
                distances.push(x.hypot(y));
            }
        }
        (if distances.len() < 9 { scatter } else { median(&mut distances) }, scatter)
    }

    /// How far the phases agree with the grid: 1 where every one is zero, near 0 for noise.
    pub(super) fn coherence(&self) -> f64 {
        (0..self.harmonics.len())
            .map(|h| {
                let aligned: f64 = self.lenses.iter().map(|l| l.sums[h].re).sum();
                let all: f64 = self.lenses.iter().map(|l| l.sums[h].norm()).sum();
                aligned / all.max(1e-12)
            })
            .fold(1.0, f64::min)
    }

    /// The same about another grid, near this one: how far the phases would agree with that.
    pub(super) fn coherence_about(&self, other: &Grid) -> f64 {
        (0..self.harmonics.len())
            .map(|h| {
                let g = self.harmonics[h];
                let aligned: f64 = self
                    .lenses
                    .iter()
                    .map(|l| {
                        let [x, y] = other.position(l.at.i, l.at.j);
                        let cycles = g[0] * (x - l.at.x) + g[1] * (y - l.at.y);
                        (l.sums[h] * Complex::from_polar(1.0, -std::f64::consts::TAU * cycles)).re
                    })
                    .sum();
                let all: f64 = self.lenses.iter().map(|l| l.sums[h].norm()).sum();
                aligned / all.max(1e-12)
            })
            .fold(1.0, f64::min)
    }

    /// Median amplitude of the weakest harmonic.
    pub(super) fn modulation(&self) -> f64 {
        // The sum of a cosine's samples is half its amplitude.
        2.0 * self.medians.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// The shift of the whole lattice (px) from the mean phase: the start, when nothing is known of the centre.
    pub(super) fn common_shift(&self) -> [f64; 2] {
        let mut sums = [Complex::new(0.0, 0.0); 3];
        for lens in self.lenses {
            for (h, sum) in sums.iter_mut().enumerate().take(self.harmonics.len()) {
                *sum += lens.sums[h];
            }
        }
        // Two harmonics are enough, and phases of three need not be unwrapped consistently.
        let [a, b] = self.grid.basis;
        let (s, t) = (cycles(sums[0]), cycles(sums[1]));
        [s * a[0] + t * b[0], s * a[1] + t * b[1]]
    }

    /// Shift and change of the pitch that bring the phases together best, from sums over the whole array: nothing needs
    /// to be unwrapped and texture averages out, so that it holds where single micro-images say little. `most` is the
    /// greatest relative change of the pitch.
    pub(super) fn brought_together(&self, most: f64) -> Grid {
        let [w, h] = self.grid.frame_size.map(|n| n as f64);
        let pitch = self.grid.pitch_px();
        // An eighth of a pitch in a corner from one to the next.
        let steps = (most * w.hypot(h) / 2.0 / (pitch / 8.0)).ceil().clamp(1.0, 200.0);
        let middle = [(w - 1.0) / 2.0, (h - 1.0) / 2.0];
        // Cycles a harmonic turns by at a micro-image for a relative change of the pitch.
        let turn = |lens: &Lens, h: usize| {
            let g = self.harmonics[h];
            g[0] * (lens.at.x - middle[0]) + g[1] * (lens.at.y - middle[1])
        };
        let first = |lens: &Lens, h: usize, change: f64| {
            // No micro-image counts for more than a few.
            let share = (CONTRAST_CAP * self.medians[h] / lens.sums[h].norm().max(1e-12)).min(1.0);
            lens.sums[h] * share * Complex::from_polar(1.0, -std::f64::consts::TAU * change * turn(lens, h))
        };
        let count = 2 * steps as usize + 1;
        let mut scores = vec![0.0; count];
        let mut row = vec![Complex::new(0.0, 0.0); count];
        for h in 0..self.harmonics.len() {
            row.fill(Complex::new(0.0, 0.0));
            for lens in self.lenses {
                let mut at = first(lens, h, -most);
                let next = Complex::from_polar(1.0, -std::f64::consts::TAU * most / steps * turn(lens, h));
                for sum in &mut row {
                    *sum += at;
                    at *= next;
                }
            }
            for (score, sum) in scores.iter_mut().zip(&row) {
                *score += sum.norm_sqr() / self.medians[h].powi(2);
            }
        }
        // The nearest to no change among those about as good: changes are small, and texture has chance maxima anywhere.
        let greatest = scores.iter().copied().fold(0.0, f64::max);
        let summit =
            |k: usize| (k == 0 || scores[k - 1] <= scores[k]) && (k + 1 == count || scores[k + 1] <= scores[k]);
        let best = (0..count)
            .filter(|&k| scores[k] > AS_GOOD * greatest && summit(k))
            .min_by_key(|&k| k.abs_diff(count / 2))
            .unwrap_or(count / 2);
        let mut change = most * (best as f64 / steps - 1.0);
        if best > 0 && best + 1 < count {
            let (low, high) = (scores[best - 1], scores[best + 1]);
            let curvature = low - 2.0 * scores[best] + high;
            if curvature < 0.0 {
                change += 0.5 * (low - high) / curvature * most / steps;
            }
        }
        let [s, t] = [0, 1].map(|h| cycles(self.lenses.iter().map(|l| first(l, h, change)).sum()));
        let [a, b] = self.grid.basis;
        let mut grid = self.grid.clone();
        grid.basis = grid.basis.map(|v| v.map(|x| x * (1.0 + change)));
        if let Some(d) = &mut grid.distortion {
            d.coefficients.iter_mut().for_each(|c| *c = c.map(|x| x * (1.0 + change)));
        }
        grid.centre = [0, 1].map(|k| grid.centre[k] + change * (grid.centre[k] - middle[k]) + s * a[k] + t * b[k]);
        grid
    }
}

/// Offsets (px) of micro-images, found by their lattice indices.
struct Offsets {
    all: Vec<[f64; 2]>,
    /// Number in `all` plus one, row by row of the lattice from `first` on; 0 where there is none.
    numbers: Vec<u32>,
    first: [i32; 2],
    columns: usize,
}

impl Offsets {
    fn new(offsets: Vec<([i32; 2], [f64; 2])>) -> Self {
        let bound = |axis: usize| {
            let indices = offsets.iter().map(|(at, _)| at[axis]);
            indices.clone().min().zip(indices.max()).unwrap_or((0, 0))
        };
        let [(i0, i1), (j0, j1)] = [bound(0), bound(1)];
        let [columns, rows] = [i1 - i0 + 1, j1 - j0 + 1].map(|n| n as usize);
        let mut numbers = vec![0; columns * rows];
        for (n, ([i, j], _)) in offsets.iter().enumerate() {
            numbers[(j - j0) as usize * columns + (i - i0) as usize] = n as u32 + 1;
        }
        Self { all: offsets.into_iter().map(|(_, offset)| offset).collect(), numbers, first: [i0, j0], columns }
    }

    fn at(&self, [i, j]: [i32; 2]) -> Option<[f64; 2]> {
        let [i, j] = [i - self.first[0], j - self.first[1]].map(|n| usize::try_from(n).ok());
        let (i, j) = (i.filter(|&i| i < self.columns)?, j?);
        let number = *self.numbers.get(j * self.columns + i)?;
        self.all.get((number as usize).checked_sub(1)?).copied()
    }

    /// Their median length, px.
    fn scatter(&self) -> f64 {
        median(&mut self.all.iter().map(|o| o[0].hypot(o[1])).collect::<Vec<_>>())
    }
}

/// A sum's phase in cycles, in (−½, ½].
pub(super) fn cycles(sum: Complex<f64>) -> f64 {
    sum.arg() / std::f64::consts::TAU
}

/// The middle one of some values, the upper of two; 0 of none.
pub(in crate::imaging) fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_are_found_by_their_indices() {
        let places = [[-2, 5], [0, 5], [1, 7], [-2, 8]];
        let offset = |[i, j]: [i32; 2]| [f64::from(i), f64::from(j) / 2.0];
        let offsets = Offsets::new(places.map(|at| (at, offset(at))).to_vec());
        for i in -4..4 {
            for j in 3..11 {
                let expected = places.contains(&[i, j]).then(|| offset([i, j]));
                assert_eq!(offsets.at([i, j]), expected, "{i}, {j}");
            }
        }
        assert_eq!(Offsets::new(Vec::new()).at([0, 0]), None);
    }
}
