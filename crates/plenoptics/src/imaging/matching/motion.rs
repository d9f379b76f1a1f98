//! How a grid has moved in its frame: shift, scale and rotation.

use nalgebra::{Matrix4, Vector4};

use crate::imaging::grid::Grid;
use crate::imaging::live::GridMotion;

/// A similarity about the frame's middle.
///
/// Its numbers are displacements, px: along x and y in the middle, and half a frame's width from it outwards (scale) and
/// from +x towards +y (rotation). In them every displacement is linear.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::imaging) struct Motion(pub(in crate::imaging) Vector4<f64>);

/// The frame that motions are about.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::imaging) struct Field {
    /// Its middle, px.
    middle: [f64; 2],
    /// Half its width, px: the unit of field coordinates.
    pub(in crate::imaging) half: f64,
    /// Half its height over half its width.
    aspect: f64,
}

impl Field {
    pub(in crate::imaging) fn new([width, height]: [usize; 2]) -> Self {
        let [width, height] = [width, height].map(|n| n as f64);
        Self { middle: [(width - 1.0) / 2.0, (height - 1.0) / 2.0], half: width / 2.0, aspect: height / width }
    }

    /// Field coordinates of a place, px.
    pub(in crate::imaging) fn coordinates(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [(x - self.middle[0]) / self.half, (y - self.middle[1]) / self.half]
    }

    /// Standard uncertainty of the displacement in a corner, px, at this covariance of a motion.
    pub(in crate::imaging) fn sigma(&self, covariance: &Matrix4<f64>) -> f64 {
        let variance = |[x, y]: [f64; 2]| {
            let rows = [Vector4::new(1.0, 0.0, x, -y), Vector4::new(0.0, 1.0, y, x)];
            rows.map(|row| row.dot(&(covariance * row))).into_iter().fold(0.0, f64::max)
        };
        self.corners().map(variance).into_iter().fold(0.0, f64::max).sqrt()
    }

    /// The frame's corners in field coordinates.
    pub(in crate::imaging) fn corners(&self) -> [[f64; 2]; 4] {
        [[-1.0, -self.aspect], [1.0, -self.aspect], [-1.0, self.aspect], [1.0, self.aspect]]
    }
}

impl Motion {
    pub(in crate::imaging) const NONE: Self = Self(Vector4::new(0.0, 0.0, 0.0, 0.0));

    /// The motion that brings a grid to another one, whichever micro-images the two count from: the nearest ones in the
    /// frame's middle are the same.
    pub(in crate::imaging) fn between(from: &Grid, to: &Grid) -> Self {
        let field = Field::new(from.frame_size);
        let was = from.nearest(field.middle[0], field.middle[1]);
        let is = to.nearest(was.x, was.y);
        // The quotient of the bases as complex numbers, the mean of the two vectors'.
        let (mut re, mut im) = (0.0, 0.0);
        for (a, b) in from.basis.iter().zip(to.basis) {
            let square = a[0] * a[0] + a[1] * a[1];
            re += 0.5 * (a[0] * b[0] + a[1] * b[1]) / square;
            im += 0.5 * (a[0] * b[1] - a[1] * b[0]) / square;
        }
        let mut motion = Self(Vector4::new(0.0, 0.0, (re - 1.0) * field.half, im * field.half));
        let [x, y] = motion.displacement(field.coordinates([was.x, was.y]));
        motion.0[0] = is.x - was.x - x;
        motion.0[1] = is.y - was.y - y;
        motion
    }

    /// Displacement at a place of the field, px.
    #[inline]
    pub(in crate::imaging) fn displacement(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [along_x, along_y, scale, turn] = self.0.into();
        [along_x + scale * x - turn * y, along_y + scale * y + turn * x]
    }

    /// Where a place goes, px.
    #[inline]
    pub(in crate::imaging) fn moved(&self, field: &Field, at: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.displacement(field.coordinates(at));
        [at[0] + x, at[1] + y]
    }

    /// What a direction turns to, with its length.
    pub(in crate::imaging) fn turned(&self, field: &Field, [x, y]: [f64; 2]) -> [f64; 2] {
        let (re, im) = (1.0 + self.0[2] / field.half, self.0[3] / field.half);
        [re * x - im * y, re * y + im * x]
    }

    /// The moved grid. Its micro-images keep their indices.
    pub(in crate::imaging) fn of(&self, grid: &Grid) -> Grid {
        let field = Field::new(grid.frame_size);
        let mut moved = grid.clone();
        moved.centre = self.moved(&field, grid.centre);
        moved.basis = grid.basis.map(|v| self.turned(&field, v));
        if let Some(distortion) = &mut moved.distortion {
            distortion.coefficients.iter_mut().for_each(|c| *c = self.turned(&field, *c));
        }
        moved
    }

    /// What it is to those who do not count in half frame widths, with its uncertainty in a corner, px.
    pub(in crate::imaging) fn reported(&self, field: &Field, sigma_px: f64) -> GridMotion {
        let [x, y, scale, turn] = self.0.into();
        let scale = scale / field.half;
        GridMotion {
            shift_px: [x, y],
            scale,
            rotation: (turn / field.half).atan2(1.0 + scale),
            greatest_px: self.greatest(field),
            sigma_px,
        }
    }

    /// Greatest displacement in the frame, px: that of a corner.
    pub(in crate::imaging) fn greatest(&self, field: &Field) -> f64 {
        let length = |at: [f64; 2]| {
            let [x, y] = self.displacement(at);
            x.hypot(y)
        };
        field.corners().map(length).into_iter().fold(0.0, f64::max)
    }
}

/// The normal equation of a motion, from the displacements of single places.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::imaging) struct Sums {
    /// Sums of the weights, of weights times x, y and their squares.
    weight: f64,
    x: f64,
    y: f64,
    square: f64,
    right: Vector4<f64>,
    /// Weighted squares of the displacements, and how many numbers they are.
    squares: f64,
    count: f64,
}

impl Sums {
    /// Adds a displacement (px) at a place of the field, of a weight and counting so many times.
    #[inline]
    pub(in crate::imaging) fn add(&mut self, [x, y]: [f64; 2], [ux, uy]: [f64; 2], weight: f64, count: f64) {
        self.weight += weight;
        self.x += weight * x;
        self.y += weight * y;
        self.square += weight * (x * x + y * y);
        self.right += Vector4::new(ux, uy, x * ux + y * uy, x * uy - y * ux) * weight;
        self.squares += weight * (ux * ux + uy * uy);
        self.count += 2.0 * count;
    }

    /// The motion nearest to the displacements, and the inverse of the normal matrix; `None` where they do not determine
    /// it.
    pub(in crate::imaging) fn solved(&self) -> Option<(Vector4<f64>, Matrix4<f64>)> {
        let Self { weight: w, x, y, square: r, .. } = *self;
        let normal = Matrix4::new(w, 0.0, x, -y, 0.0, w, y, x, x, y, r, 0.0, -y, x, 0.0, r);
        let inverse = normal.try_inverse().filter(|inverse| inverse.iter().all(|v| v.is_finite()))?;
        Some((inverse * self.right, inverse))
    }

    /// Variance of a displacement of weight 1 about the motion.
    pub(in crate::imaging) fn variance(&self) -> f64 {
        (self.squares - self.solved().map_or(0.0, |(motion, _)| motion.dot(&self.right))).max(0.0)
            / (self.count - 4.0).max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::grid::Distortion;
    use crate::optics::ArrayKind;

    #[test]
    fn a_motion_is_found_between_grids_and_moves_every_micro_image() {
        let basis = [[20.0, 1.0], [-1.2, 20.1]];
        let bent = Distortion {
            degree: 2,
            scale: 20.0,
            coefficients: [0.1, 0.0, 0.2, 0.5, 0.3, -0.4].map(|c| [c, -c]).to_vec(),
        };
        let straight = Grid::affine(ArrayKind::Square, [305.1, 196.2], basis, [600, 400]);
        for grid in [straight.clone(), Grid { distortion: Some(bent), ..straight }] {
            let field = Field::new(grid.frame_size);
            let motion = Motion(Vector4::new(1.5, -2.5, 0.9, -1.3));
            let moved = motion.of(&grid);
            for (i, j) in [(0, 0), (12, -7), (-11, 9)] {
                let (expected, found) = (motion.moved(&field, grid.position(i, j)), moved.position(i, j));
                assert!((expected[0] - found[0]).hypot(expected[1] - found[1]) < 1e-9);
            }
            assert!((Motion::between(&grid, &moved).0 - motion.0).norm() < 1e-9);
            let corner = motion.displacement([1.0, -400.0 / 600.0]);
            assert!((motion.greatest(&field) - corner[0].hypot(corner[1])).abs() < 1.0);
        }
        assert_eq!(Motion::NONE.greatest(&Field::new([600, 400])), 0.0);
    }
}
