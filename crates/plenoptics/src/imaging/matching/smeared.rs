//! What one pair says about smear that grows with the distance from the micro-images' centres.

use super::shape::Shape;
use super::tile::Tile;
use crate::imaging::interpolation::{bend_weights, slope_weights, weights};

/// Least pixels of a pair that are compared.
const LEAST_PIXELS: f64 = 12.0;

/// Sums over the pixels of pairs.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::imaging) struct Smeared {
    /// Products of a regressor with the difference of the two, and with the difference that a smear of 1 would make.
    pub(in crate::imaging) excess: f64,
    pub(in crate::imaging) energy: f64,
}

/// What a reference and its neighbour say that lies in the direction `unit`, at a spacing along it and across it (px).
pub(in crate::imaging) fn of_pair(
    [a, b]: [&Tile; 2],
    shape: &Shape,
    (unit, [along, across]): ([f64; 2], [f64; 2]),
    radius: f64,
) -> Smeared {
    let shift = [along * unit[0] - across * unit[1], along * unit[1] + across * unit[0]];
    let corners = [a.corner(shape), b.corner(shape)];
    // From a pixel of the one's tile to the place in the other's which shows the same.
    let place = [0, 1].map(|k| shift[k] + f64::from(corners[0][k] - corners[1][k]));
    let whole = place.map(|place| place.floor() as isize);
    let fraction = [0, 1].map(|k| (place[k] - place[k].floor()) as f32);
    let corner = (whole[1] - 1) * shape.stride as isize + whole[0] - 1;
    // From the one's centre to the other's.
    let step = [0, 1].map(|k| f64::from(b.nearest[k] - a.nearest[k]) + b.fraction[k] - a.fraction[k]);
    let spline = Spline { weights: fraction.map(|t| [weights(t), slope_weights(t), bend_weights(t)]), unit };
    let (ux, uy) = (unit[0] as f32, unit[1] as f32);
    let slope = |at: usize| ux * a.slopes[0][at] + uy * a.slopes[1][at];
    let bend = |at: usize| {
        let across = slope(at + 1) - slope(at - 1);
        let down = slope(at + shape.stride) - slope(at - shape.stride);
        f64::from(0.5 * (ux * across + uy * down))
    };
    let along = |r: [f64; 2]| (r[0] * unit[0] + r[1] * unit[1]).powi(2);
    let (mut count, mut sums, mut squares, mut mixed, mut regressor, mut energy) =
        (0.0, [0.0; 2], [0.0; 2], [0.0; 2], 0.0, 0.0);
    let mut products = 0.0;
    a.disc(shape, radius, |at, [dx, dy]| {
        let there = [dx + shift[0] - step[0], dy + shift[1] - step[1]];
        if there[0] * there[0] + there[1] * there[1] > radius * radius {
            return;
        }
        let from = at.wrapping_add_signed(corner);
        if a.counted()[at] <= 0.0 || b.amplitudes[from + shape.stride + 1] <= 0.0 {
            return;
        }
        let further = along([dx, dy]) - along(there);
        let (own, [other, other_bend]) = (f64::from(a.values[at]), spline.at(&b.coefficients[from..], shape.stride));
        let by = further * bend(at);
        count += 1.0;
        regressor += by;
        energy += by * further * other_bend;
        for (k, value) in [own, other].into_iter().enumerate() {
            sums[k] += value;
            squares[k] += value * value;
            mixed[k] += by * value;
        }
        products += own * other;
    });
    if count < LEAST_PIXELS {
        return Smeared::default();
    }
    // Each about its mean: a micro-image's gain and offset are its own.
    let [own, other] = [0, 1].map(|k| squares[k] - sums[k] * sums[k] / count);
    if products - sums[0] * sums[1] / count < 0.5 * (own.max(0.0) * other.max(0.0)).sqrt() {
        return Smeared::default();
    }
    let gain = (own / other.max(1e-9)).max(0.0).sqrt().clamp(0.25, 4.0);
    let [own, other] = [0, 1].map(|k| mixed[k] - regressor * sums[k] / count);
    Smeared { excess: own - gain * other, energy: gain * energy }
}

/// A spline's value and second derivative along a direction, at one fraction of a pixel.
struct Spline {
    /// Along x and y: of the value, the slope and the second derivative.
    weights: [[[f32; 4]; 3]; 2],
    unit: [f64; 2],
}

impl Spline {
    /// From the coefficients that begin at the first of the sixteen about the place.
    fn at(&self, coefficients: &[f32], stride: usize) -> [f64; 2] {
        let [by_x, by_y] = &self.weights;
        let mut sums = [0.0f32; 4];
        for row in 0..4 {
            let line = &coefficients[row * stride..][..4];
            let [value, slope, bend] =
                [0, 1, 2].map(|k| line.iter().zip(by_x[k]).map(|(c, weight)| c * weight).sum::<f32>());
            sums[0] += by_y[0][row] * value;
            sums[1] += by_y[0][row] * bend;
            sums[2] += by_y[1][row] * slope;
            sums[3] += by_y[2][row] * value;
        }
        let [value, xx, xy, yy] = sums.map(f64::from);
        let [ux, uy] = self.unit;
        [value, ux * ux * xx + 2.0 * ux * uy * xy + uy * uy * yy]
    }
}
