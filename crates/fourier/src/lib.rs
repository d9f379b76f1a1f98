//! Plans of Fourier transforms of single precision.
//!
//! A crate of its own for the compiler's sake: RustFFT is generic, and whoever plans a transform compiles all of its
//! algorithms. Here that is done once, and not again with each change of the imaging, for it and for its tests.

use std::sync::Arc;

use realfft::{RealFftPlanner, RealToComplex};
pub use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlanner};

/// The plan of a transform of `length` complex samples: exp(−2πi jk/`length`), not normalised.
#[must_use]
pub fn forward(length: usize) -> Arc<dyn Fft<f32>> {
    FftPlanner::new().plan_fft_forward(length)
}

/// The plan of a transform back: exp(+2πi jk/`length`), not normalised, so that both one after the other give `length`
/// times the samples.
#[must_use]
pub fn inverse(length: usize) -> Arc<dyn Fft<f32>> {
    FftPlanner::new().plan_fft_inverse(length)
}

/// The plan of a transform of `length` real samples into the `length`/2 + 1 complex ones that are not each other's
/// conjugates; not normalised.
#[must_use]
pub fn real_forward(length: usize) -> Arc<dyn RealToComplex<f32>> {
    RealFftPlanner::new().plan_fft_forward(length)
}
