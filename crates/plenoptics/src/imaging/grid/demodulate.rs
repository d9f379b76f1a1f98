//! Phase of the lattice's first harmonics about each micro-image.
//!
//! About a micro-image the frame is multiplied by a window and by exp(2πi g·r) for each first harmonic g, and summed:
//! the sum's phase is 2π g·u, where u is how far the true centre lies from the place assumed.

use fourier::Complex;
use rayon::prelude::*;

use super::frame::{Frame, Window};
use super::harmonics::{Harmonics, Point};
use super::{Grid, MicroImage};

/// A micro-image and its harmonics.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lens {
    pub at: MicroImage,
    /// One sum for each of the demodulator's harmonics, its phase relative to the assumed centre.
    pub sums: [Complex<f64>; 3],
}

/// Window times harmonics, for one lattice.
pub(super) struct Demodulator {
    /// Harmonics, cycles per px.
    pub harmonics: Vec<[f64; 2]>,
    /// Places of the window's samples from the pixel nearest the centre, px, row by row.
    points: Vec<(isize, isize)>,
    /// Pixels from one sample to the next.
    step: usize,
    reach: [isize; 2],
    /// Real and imaginary weights, harmonic by harmonic.
    weights: Vec<[Vec<f32>; 2]>,
}

impl Demodulator {
    /// With a window sampled at every `step`-th pixel of every `step`-th row.
    pub(super) fn new(grid: &Grid, step: usize) -> Self {
        let step = step.max(1) as isize;
        let harmonics = Harmonics::new(grid);
        let steps = harmonics.reach.map(|reach| reach / step);
        let (mut points, mut window) = (Vec::new(), Vec::new());
        for dy in (-steps[1]..=steps[1]).map(|n| n * step) {
            for dx in (-steps[0]..=steps[0]).map(|n| n * step) {
                let weight = harmonics.window(dx as f64, dy as f64);
                if weight > 0.0 {
                    points.push((dx, dy));
                    window.push(Point { x: dx as f64, y: dy as f64, weight });
                }
            }
        }
        let weights = harmonics.kernels(&window);
        Self { harmonics: harmonics.waves, points, step: step as usize, reach: steps.map(|n| n * step), weights }
    }

    /// Those of `lenses` whose window lies within `part` of the frame (x, y, width, height).
    pub(super) fn run(&self, frame: &Frame, lenses: &[MicroImage], part: [usize; 4]) -> Vec<Lens> {
        let [x0, y0, w, h] = part.map(|n| n as isize);
        let reach = self.reach;
        let width = frame.width as isize;
        let window = Window::new(&self.points, self.step, frame.width);
        let arch = pulp::Arch::new();
        lenses
            .par_iter()
            .with_min_len(64)
            .map_init(
                || vec![0.0f32; self.points.len()],
                |values, at| {
                    let (cx, cy) = (at.x.round() as isize, at.y.round() as isize);
                    let inside =
                        cx - reach[0] >= x0 && cy - reach[1] >= y0 && cx + reach[0] < x0 + w && cy + reach[1] < y0 + h;
                    inside.then(|| {
                        let pixels = Pixels { frame, window: &window, middle: cy * width + cx };
                        arch.dispatch(LensTask { demodulator: self, pixels, values, at, nearest: [cx, cy] })
                    })
                },
            )
            .flatten_iter()
            .collect()
    }

    #[inline(always)]
    fn sums(&self, values: &[f32], at: &MicroImage, [cx, cy]: [isize; 2]) -> [Complex<f64>; 3] {
        let mut sums = [Complex::new(0.0, 0.0); 3];
        for ((sum, [re, im]), g) in sums.iter_mut().zip(&self.weights).zip(&self.harmonics) {
            let (real, imaginary) = dot2(values, re, im);
            // From the pixel that the window was laid on to the assumed centre.
            let shift = g[0] * (at.x - cx as f64) + g[1] * (at.y - cy as f64);
            *sum = Complex::new(f64::from(real), f64::from(imaginary))
                * Complex::from_polar(1.0, -std::f64::consts::TAU * shift);
        }
        sums
    }
}

/// Where a window's pixels are.
struct Pixels<'a> {
    frame: &'a Frame<'a>,
    window: &'a Window,
    /// The pixel that the window is laid on.
    middle: isize,
}

/// The harmonics of one micro-image, compiled for the instruction set in use.
struct LensTask<'a> {
    demodulator: &'a Demodulator,
    pixels: Pixels<'a>,
    values: &'a mut [f32],
    at: &'a MicroImage,
    /// Column and row of the pixel nearest the micro-image.
    nearest: [isize; 2],
}

impl pulp::WithSimd for LensTask<'_> {
    type Output = Lens;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) -> Lens {
        let Self { demodulator, pixels, values, at, nearest } = self;
        pixels.frame.logarithms(pixels.middle, pixels.window, values);
        Lens { at: *at, sums: demodulator.sums(values, at, nearest) }
    }
}

/// Two dot products in one pass, in eight lanes that the compiler keeps in vector registers.
#[inline(always)]
fn dot2(values: &[f32], re: &[f32], im: &[f32]) -> (f32, f32) {
    let mut r = [0.0f32; 8];
    let mut i = [0.0f32; 8];
    let (v8, v_rest) = values.as_chunks::<8>();
    let (re8, re_rest) = re.as_chunks::<8>();
    let (im8, im_rest) = im.as_chunks::<8>();
    for ((v, a), b) in v8.iter().zip(re8).zip(im8) {
        for k in 0..8 {
            r[k] += v[k] * a[k];
            i[k] += v[k] * b[k];
        }
    }
    let (mut real, mut imaginary) = (r.iter().sum::<f32>(), i.iter().sum::<f32>());
    for ((v, a), b) in v_rest.iter().zip(re_rest).zip(im_rest) {
        real += v * a;
        imaginary += v * b;
    }
    (real, imaginary)
}
