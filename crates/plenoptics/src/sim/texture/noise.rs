//! Periodic random fields.

use fourier::Complex;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// A periodic random field of `side`² texels with mean 0 and standard deviation 1, whose amplitude is `amplitude(x, y)`
/// at x and y cycles a side.
pub(super) fn field(side: usize, seed: u64, amplitude: impl Fn(f64, f64) -> f64) -> Vec<f32> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut values: Vec<Complex<f32>> =
        (0..side * side).map(|_| Complex::new(random.random::<f32>() - 0.5, 0.0)).collect();
    let (forward, inverse) = (fourier::forward(side), fourier::inverse(side));
    // Rows, transpose, rows: after filtering the same again, which leaves the field as it lay.
    forward.process(&mut values);
    transpose(&mut values, side);
    forward.process(&mut values);
    let cycles = |k: usize| if k <= side / 2 { k as f64 } else { k as f64 - side as f64 };
    for (k, value) in values.iter_mut().enumerate() {
        // The transposition has put the x frequency on the rows.
        *value *= if k == 0 { 0.0 } else { amplitude(cycles(k / side), cycles(k % side)) as f32 };
    }
    inverse.process(&mut values);
    transpose(&mut values, side);
    inverse.process(&mut values);
    let power: f64 = values.iter().map(|v| f64::from(v.re).powi(2)).sum::<f64>() / values.len() as f64;
    let scale = (1.0 / power.sqrt()) as f32;
    values.iter().map(|v| v.re * scale).collect()
}

fn transpose(values: &mut [Complex<f32>], side: usize) {
    for y in 0..side {
        for x in 0..y {
            values.swap(y * side + x, x * side + y);
        }
    }
}

/// 0 below `low`, 1 above `high`, smooth between.
pub(super) fn smoothstep(low: f32, high: f32, value: f32) -> f32 {
    let t = ((value - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// 1/f noise, the spectrum of natural scenes (Field, 1987): every octave has the same contrast, from `lowest` cycles a
/// side down to two texels, with the vertical stretched by `stretch`. A Gaussian roll-off keeps interpolation clean.
pub(super) fn natural(side: usize, seed: u64, lowest: f64, stretch: f64) -> Vec<f32> {
    let highest = side as f64 / 3.2;
    field(side, seed, |x, y| {
        let f = x.hypot(y * stretch);
        (1.0 / f.max(lowest)) * (-0.5 * (x.hypot(y) / highest).powi(2)).exp()
    })
}
