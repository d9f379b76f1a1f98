//! Vectors out of rows of numbers, and back.
//!
//! Code that works on vectors has no closures: they would not be compiled for the instruction set in use.

use pulp::Simd;

use super::shape::LANES;

/// The vector that begins at a place of a row.
#[inline(always)]
pub(in crate::imaging) fn load<S: Simd>(row: &[f32], at: usize) -> S::f32s {
    S::as_simd_f32s(&row[at..at + S::F32_LANES]).0[0]
}

/// The vector of whole numbers that begin at a place of a row.
#[inline(always)]
pub(in crate::imaging) fn widened<S: Simd, T: Copy + Into<f32>>(row: &[T], at: usize) -> S::f32s {
    // Its length is known to the compiler, which makes one conversion of it that never leaves the registers.
    let mut line = [0.0f32; LANES];
    let row = &row[at..at + S::F32_LANES];
    for k in 0..S::F32_LANES {
        line[k] = row[k].into();
    }
    load::<S>(&line, 0)
}

/// So many vectors from a place of a row on.
#[inline(always)]
pub(in crate::imaging) fn vectors<S: Simd>(row: &[f32], at: usize, count: usize) -> &[S::f32s] {
    &S::as_simd_f32s(&row[at..at + count * S::F32_LANES]).0[..count]
}

/// Puts a vector at a place of a row.
#[inline(always)]
pub(in crate::imaging) fn store<S: Simd>(row: &mut [f32], at: usize, value: S::f32s) {
    S::as_mut_simd_f32s(&mut row[at..at + S::F32_LANES]).0[0] = value;
}
