//! By how much a micro-image is shifted against the mean one: its profile, and the vectors that tell a shift.

use nalgebra::SVector;

use super::{Shape, TERMS};
use crate::imaging::grid::frame::{Frame, Window};

/// A micro-image's shift from its shape's place, compiled for the instruction set in use.
pub(super) struct ShiftTask<'a> {
    pub(super) frame: &'a Frame<'a>,
    pub(super) window: &'a Window,
    /// The pixel that the window is laid on.
    pub(super) middle: isize,
    pub(super) shape: &'a Shape,
    /// Room for the micro-image and for its derivatives in x and y.
    pub(super) buffers: &'a mut [Vec<f32>; 3],
    /// The scene's terms over the cell.
    pub(super) polynomials: &'a [Vec<f32>; TERMS],
}

impl pulp::WithSimd for ShiftTask<'_> {
    type Output = Option<([f64; 2], f64)>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) -> Self::Output {
        let Self { frame, window, middle, shape, buffers, polynomials } = self;
        frame.levels(middle, window, &mut buffers[0]);
        shape.shift(buffers, polynomials)
    }
}

impl Shape {
    /// A micro-image's shift from the shape's place, px, and its standard error; `None` where it is dark.
    #[inline(always)]
    fn shift(&self, buffers: &mut [Vec<f32>; 3], polynomials: &[Vec<f32>; TERMS]) -> Option<([f64; 2], f64)> {
        let [left, sx, sy] = buffers;
        let count = left.len();
        let scene = self.terms * SVector::from(self.project(left));
        let [p0, p1, p2, p3, p4, p5] = polynomials.each_ref().map(|p| &p[..count]);
        let [slopes_x, slopes_y] = self.slopes.each_ref().map(|s| &s[..count]);
        let (sx, sy) = (&mut sx[..count], &mut sy[..count]);
        for n in 0..count {
            let t = (p0[n] * scene[0] + p1[n] * scene[1])
                + (p2[n] * scene[2] + p3[n] * scene[3])
                + (p4[n] * scene[4] + p5[n] * scene[5]);
            sx[n] = t * slopes_x[n];
            sy[n] = t * slopes_y[n];
        }
        self.project(sx);
        self.project(sy);
        let (xx, xy, yy) = (f64::from(dot(sx, sx)), f64::from(dot(sx, sy)), f64::from(dot(sy, sy)));
        let (x, y) = (f64::from(dot(sx, left)), f64::from(dot(sy, left)));
        let determinant = xx * yy - xy * xy;
        if determinant.is_nan() || determinant <= 1e-6 * xx * yy {
            return None;
        }
        let shift = [(yy * x - xy * y) / determinant, (xx * y - xy * x) / determinant];
        let rest = f64::from(dot(left, left)) - shift[0] * x - shift[1] * y;
        let variance = rest.max(1e-9) / count as f64;
        Some((shift, (variance * (xx + yy) / (2.0 * determinant)).sqrt()))
    }

    /// Takes from values what the span has of them, and returns its coefficients.
    #[inline(always)]
    fn project(&self, values: &mut [f32]) -> [f32; TERMS] {
        let count = values.len();
        let span = &self.span.as_slice()[..TERMS * count];
        let mut coefficients = [0.0f32; TERMS];
        for (coefficient, column) in coefficients.iter_mut().zip(span.chunks_exact(count)) {
            *coefficient = dot(values, column);
        }
        let (c0, rest) = span.split_at(count);
        let (c1, rest) = rest.split_at(count);
        let (c2, rest) = rest.split_at(count);
        let (c3, rest) = rest.split_at(count);
        let (c4, c5) = rest.split_at(count);
        for n in 0..count {
            values[n] -= (coefficients[0] * c0[n] + coefficients[1] * c1[n])
                + (coefficients[2] * c2[n] + coefficients[3] * c3[n])
                + (coefficients[4] * c4[n] + coefficients[5] * c5[n]);
        }
        coefficients
    }
}

#[inline(always)]
pub(super) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0f32; 8];
    let (a8, a_rest) = a.as_chunks::<8>();
    let (b8, b_rest) = b.as_chunks::<8>();
    for (a, b) in a8.iter().zip(b8) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    sums.iter().sum::<f32>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f32>()
}

pub(super) fn terms(dx: isize, dy: isize, scale: f64) -> [f64; TERMS] {
    let (s, t) = (dx as f64 / scale, dy as f64 / scale);
    [1.0, s, t, s * s, s * t, t * t]
}
