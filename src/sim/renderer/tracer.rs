//! Single rays in double precision: what a frame's geometry truly is, for choosing textures and for judging estimators.

use super::camera::{CameraTruth, Lattice};
use super::rays::{Path, Plane, Ray};
use crate::sim::scene::Board;

/// A microlens, by where its centre is on the array, mm from the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Microlens {
    /// x and y, mm.
    pub centre: [f64; 2],
}

/// Traces single rays of one camera.
#[derive(Debug, Clone, Copy)]
pub struct Tracer {
    camera: CameraTruth,
    lattice: Lattice,
    path: Path<f64>,
}

impl Tracer {
    /// A tracer for this camera.
    #[must_use]
    pub fn new(camera: &CameraTruth) -> Self {
        Self { camera: *camera, lattice: Lattice::new(camera), path: Path::new(camera) }
    }

    /// The microlens through which a baffled pixel at this position of the frame (px) looks.
    #[must_use]
    pub fn microlens_at(&self, position: [f64; 2]) -> Microlens {
        let place = self.path.chief_on_mla(self.camera.sensor_from_frame(position));
        Microlens { centre: self.lattice.nearest(place).centre }
    }

    /// Centre of a microlens's micro-image: where the ray from M through the microlens's centre meets the sensor, px.
    #[must_use]
    pub fn micro_image_centre(&self, lens: Microlens) -> [f64; 2] {
        self.camera.frame_from_sensor(self.path.chief_on_sensor(lens.centre))
    }

    /// The microlens `i` and `j` lattice steps from another.
    #[must_use]
    pub fn step(&self, lens: Microlens, i: i32, j: i32) -> Microlens {
        let origin = self.lattice.centre(0.0, 0.0);
        let there = self.lattice.centre(f64::from(i), f64::from(j));
        Microlens { centre: [lens.centre[0] + there[0] - origin[0], lens.centre[1] + there[1] - origin[1]] }
    }

    /// Where on a board (its own x and y, mm) the ray ends that starts at `position` on the sensor (px) and passes the
    /// microlens at `u` from its centre (mm). `None` when it is blocked.
    #[must_use]
    pub fn board_point(&self, board: &Board, lens: Microlens, position: [f64; 2], u: [f64; 2]) -> Option<[f64; 2]> {
        let plane = Plane::new(&self.camera, board);
        let ray = self.ray(lens, position, u);
        let point = plane.meet(&ray);
        (ray.open && point.iter().all(|x| x.is_finite())).then_some(point)
    }

    /// Where on the sensor (px) the ray through the microlens's centre starts that ends at `point` on the board (mm).
    /// `None` when no open ray does.
    #[must_use]
    pub fn image_point(&self, board: &Board, lens: Microlens, point: [f64; 2]) -> Option<[f64; 2]> {
        let mut position = self.micro_image_centre(lens);
        // Newton on the traced map, which is close to linear.
        for _ in 0..30 {
            let here = self.board_point(board, lens, position, [0.0; 2])?;
            let step = 0.01;
            let right = self.board_point(board, lens, [position[0] + step, position[1]], [0.0; 2])?;
            let down = self.board_point(board, lens, [position[0], position[1] + step], [0.0; 2])?;
            let j = [
                [(right[0] - here[0]) / step, (down[0] - here[0]) / step],
                [(right[1] - here[1]) / step, (down[1] - here[1]) / step],
            ];
            let determinant = j[0][0] * j[1][1] - j[0][1] * j[1][0];
            let miss = [point[0] - here[0], point[1] - here[1]];
            let change = [
                (j[1][1] * miss[0] - j[0][1] * miss[1]) / determinant,
                (j[0][0] * miss[1] - j[1][0] * miss[0]) / determinant,
            ];
            position = [position[0] + change[0], position[1] + change[1]];
            if change[0].hypot(change[1]) < 1e-10 {
                return Some(position);
            }
        }
        None
    }

    /// How far apart (px on the sensor) two microlenses' chief rays see the same point of a board.
    #[must_use]
    pub fn spacing(&self, board: &Board, lenses: [Microlens; 2], point: [f64; 2]) -> Option<f64> {
        let one = self.image_point(board, lenses[0], point)?;
        let other = self.image_point(board, lenses[1], point)?;
        Some((other[0] - one[0]).hypot(other[1] - one[1]))
    }

    /// How far apart on a board two neighbouring pixels of one micro-image look, near the axis, mm.
    #[must_use]
    pub fn footprint(&self, board: &Board) -> Option<f64> {
        let (lens, centre) = self.middle();
        let here = self.board_point(board, lens, centre, [0.0; 2])?;
        let right = self.board_point(board, lens, [centre[0] + 1.0, centre[1]], [0.0; 2])?;
        Some((right[0] - here[0]).hypot(right[1] - here[1]))
    }

    /// The area (mm²) of a board that one pixel's rays cover near the axis: footprint and blur together.
    pub(super) fn pixel_area(&self, board: &Board) -> Option<f64> {
        let (lens, centre) = self.middle();
        let edge = 0.45 * self.camera.mla_pitch;
        let left = self.board_point(board, lens, centre, [-edge, 0.0])?;
        let right = self.board_point(board, lens, centre, [edge, 0.0])?;
        let blur = (right[0] - left[0]).hypot(right[1] - left[1]) / 0.9;
        Some(self.footprint(board)?.powi(2) + std::f64::consts::FRAC_PI_4 * blur * blur)
    }

    fn middle(&self) -> (Microlens, [f64; 2]) {
        let lens = self.microlens_at(self.camera.frame_from_sensor([0.0; 2]));
        (lens, self.micro_image_centre(lens))
    }

    fn ray(&self, lens: Microlens, position: [f64; 2], u: [f64; 2]) -> Ray<f64> {
        let p = self.camera.sensor_from_frame(position);
        let ray = self.path.through_lens([p[0] - lens.centre[0], p[1] - lens.centre[1]], u, lens.centre);
        match &self.path.spheres {
            Some(spheres) => spheres.refract(ray),
            None => ray,
        }
    }
}
