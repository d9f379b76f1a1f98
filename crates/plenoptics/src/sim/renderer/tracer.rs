//! Single rays in double precision: what a frame's geometry truly is, for choosing textures and for judging estimators.

use super::camera::{CameraTruth, Lattice};
use super::rays::{Path, Plane, Ray};
use super::unit::power_as_shift;
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

    /// Lattice indices of a microlens: (0, 0) is the one at `CameraTruth::offset`.
    #[must_use]
    pub fn index(&self, lens: Microlens) -> [i32; 2] {
        self.lattice.nearest(lens.centre).index.map(|index| index as i32)
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
        let focal_length = self.camera.microlens_focal_length(self.camera.microlens_type(self.index(lens)));
        let shift = power_as_shift(&self.camera, focal_length);
        let p = [0, 1].map(|k| p[k] - lens.centre[k] + shift * u[k]);
        let ray = self.path.through_lens(p, u, lens.centre);
        match &self.path.spheres {
            Some(spheres) => spheres.refract(ray),
            None => ray,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::optics::tests::reference_camera;
    use crate::sim::renderer::{Medium, RenderOptions, render};
    use crate::sim::scene::Scene;
    use crate::sim::texture::TextureMap;

    const PIXEL: f64 = 0.00345;
    const DISTANCE: f64 = 167.17;

    fn camera() -> CameraTruth {
        CameraTruth::from_design(&reference_camera(), 2.205, Medium::Air, PIXEL, 1160, 1160)
    }

    fn board() -> Board {
        Board::new(DISTANCE, Arc::new(TextureMap::from_values(&[1.0], 1.0)))
    }

    #[test]
    fn distortion_bends_chief_rays_by_browns_law() {
        for k1 in [-0.8, 0.5] {
            let camera = CameraTruth { distortion_k1: k1, ..camera() };
            let tracer = Tracer::new(&camera);
            for position in [[600.3, 640.0], [20.0, 700.0], [1150.0, 1140.0]] {
                let lens = tracer.microlens_at(position);
                let p = camera.sensor_from_frame(tracer.micro_image_centre(lens));
                let point = tracer.board_point(&board(), lens, tracer.micro_image_centre(lens), [0.0; 2]).unwrap();
                let t = point.map(|x| x / DISTANCE);
                let stretch = 1.0 + k1 * (t[0] * t[0] + t[1] * t[1]);
                for k in 0..2 {
                    let image_side = -p[k] / (camera.lens_to_mla + camera.mla_to_sensor);
                    assert!((t[k] * stretch - image_side).abs() < 1e-13, "{k1}: {t:?} for {image_side}");
                }
            }
        }
    }

    #[test]
    fn distortion_changes_the_spacing_off_axis_by_its_astigmatism() {
        let k1 = -0.3;
        let (ideal, bent) = (camera(), CameraTruth { distortion_k1: k1, ..camera() });
        let place = [1.9, 0.0];
        // Rays from a near point meet the lens at m with slopes (X − m)/L; the law scales small changes of the slope by
        // 1 + 3 k1 t² along the radius and by 1 + k1 t² across it, as if 1/L were so much larger.
        let t: f64 = place[0] / ideal.lens_to_mla;
        for (axis, power) in [(0, 3.0), (1, 1.0)] {
            let spacing = |camera: &CameraTruth| {
                let tracer = Tracer::new(camera);
                let between = Microlens { centre: place };
                let point =
                    tracer.board_point(&board(), between, tracer.micro_image_centre(between), [0.0; 2]).unwrap();
                let lens = |sign: f64| {
                    let mut centre = place;
                    centre[axis] += sign * camera.mla_pitch / 2.0;
                    Microlens { centre }
                };
                tracer.spacing(&board(), [lens(-1.0), lens(1.0)], point).unwrap()
            };
            let paraxial = |k1: f64| {
                let image = 1.0 / (1.0 / ideal.focal_length - (1.0 + power * k1 * t * t) / DISTANCE);
                let a = image - ideal.lens_to_mla;
                ideal.mla_pitch * (a - ideal.mla_to_sensor) / a / PIXEL
            };
            let found = spacing(&bent) - spacing(&ideal);
            let expected = paraxial(k1) - paraxial(0.0);
            println!("axis {axis}: {found:.4} px for {expected:.4} px");
            assert!(expected.abs() > 0.05 && (found / expected - 1.0).abs() < 0.03, "{found} for {expected}");
        }
    }

    /// Centroids of a frame's light within 14 px of places.
    fn centroids(frame: &[f32], places: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let centroid = |place: &[f64; 2]| {
            let mut sums = [0.0f64; 3];
            for (k, &value) in frame.iter().enumerate() {
                let (x, y) = ((k % 1160) as f64, (k / 1160) as f64);
                if (x - place[0]).hypot(y - place[1]) < 14.0 {
                    let value = f64::from(value);
                    sums = [sums[0] + value, sums[1] + value * x, sums[2] + value * y];
                }
            }
            [sums[1] / sums[0], sums[2] / sums[0]]
        };
        places.iter().map(centroid).collect()
    }

    #[test]
    fn a_wandering_pupil_moves_the_outer_micro_images_and_distortion_does_not() {
        let options = RenderOptions { rays: 8, seed: 1 };
        // A narrow aperture, so that the micro-images have dark all around them.
        let ideal = CameraTruth { aperture: 0.6 * camera().aperture, ..camera() };
        let walking = CameraTruth { pupil_walk: 0.4, ..ideal };
        let tracer = Tracer::new(&ideal);
        let lenses = [[1130.0, 1130.0], [30.0, 570.0], [580.0, 580.0]].map(|position| tracer.microlens_at(position));
        let places = lenses.map(|lens| tracer.micro_image_centre(lens));
        let white = render(&ideal, &Scene::Diffuser, options);
        let before = centroids(&white, &places);
        let after = centroids(&render(&walking, &Scene::Diffuser, options), &places);
        let (d, b) = (ideal.lens_to_mla, ideal.mla_to_sensor);
        for (k, lens) in lenses.iter().enumerate() {
            let [x, y] = lens.centre;
            // The pupil's centre is δ beyond M: seen from the microlens, c (1 + b/(d + δ)) instead of c (1 + b/d). The
            // chief ray meets the lens δ before that, and has there the slope s (1 + δ/f) on the other side.
            let mut delta = 0.0;
            for _ in 0..60 {
                let slope = x.hypot(y) / (d + delta);
                delta = 0.4 * (slope * (1.0 + delta / ideal.focal_length) / 0.1).powi(2);
            }
            for axis in 0..2 {
                let expected = lens.centre[axis] * (b / (d + delta) - b / d) / PIXEL;
                let rendered = after[k][axis] - before[k][axis];
                let single = Tracer::new(&walking).micro_image_centre(*lens)[axis] - places[k][axis];
                println!("lens {k}, axis {axis}: {rendered:.4} px, ray {single:.4} px, expected {expected:.4} px");
                assert!((single - expected).abs() < 1e-9, "{single} for {expected}");
                assert!((rendered - single).abs() < 0.02, "{rendered} for {single}");
            }
        }
        assert!((after[0][0] - before[0][0]).abs() > 0.2);
        let distorted = CameraTruth { distortion_k1: -0.5, ..ideal };
        assert_eq!(white, render(&distorted, &Scene::Diffuser, options));
    }
}
