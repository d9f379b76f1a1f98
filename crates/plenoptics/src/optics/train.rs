//! The optical train as it is drawn: where a few rays run from the sensor through MLA, main lens and shell to the object.
//!
//! Points are (z, x) of the frame of [`super::trace`], mm: z along the axis from M towards the object, so that the MLA is
//! at −d and the sensor at −(d + b).

use nalgebra::Vector3;

use super::{CameraDesign, Ray};

/// Of a ray: where along the axis and how far beside it, mm from M.
pub type TrainPoint = [f64; 2];

/// A camera at one pose, to be drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrainPose {
    /// Δv, mm.
    pub delta_v: f64,
    /// e, mm; `None` in air without the shell.
    pub e: Option<f64>,
    /// Diameter of the main lens's aperture, mm.
    pub aperture: f64,
    /// The sensor's width, mm.
    pub sensor_width: f64,
}

/// Rays of one point of the object.
#[derive(Debug, Clone, PartialEq)]
pub struct RayBundle {
    /// Where on the sensor its image lies: −1 and 1 are the edges, 0 the axis.
    pub field: f64,
    /// The rays through the aperture's one edge, its middle and its other edge, as far as light comes that way; each
    /// from the sensor to the object.
    pub rays: Vec<Vec<TrainPoint>>,
}

impl CameraDesign {
    /// Rays of three points of the object, on the axis and at the edges of what the sensor sees. Refraction at main lens
    /// and microlenses is that of thin lenses, at the shell exact; the light of a point passes each microlens as if its
    /// nearest ray's. Empty where the object appears within the focal length: nothing is imaged.
    #[must_use]
    pub fn optical_train(&self, pose: &TrainPose) -> Vec<RayBundle> {
        let equivalent = match pose.e {
            None => self.air_distance,
            Some(e) => self.shell.equivalent_distance(self.object_distance, e),
        };
        if equivalent <= self.main_lens.focal_length {
            return Vec::new();
        }
        let image_distance = self.main_lens.image_distance(equivalent);
        let to_sensor = self.lens_to_mla(pose.delta_v) + self.mla.b();
        let bundle = |field: f64| {
            // Where the chief ray through this place on the sensor passes the main lens's image.
            let image = field * pose.sensor_width / 2.0 * image_distance / to_sensor;
            let heights = [-0.5, 0.0, 0.5].map(|part| part * pose.aperture);
            let rays = heights.iter().filter_map(|&height| self.drawn_ray(pose, height, image, image_distance));
            RayBundle { field, rays: rays.collect() }
        };
        [-1.0, 0.0, 1.0].map(bundle).into()
    }

    /// The ray through the main lens at `height` that runs to the point of its image plane at `image` (mm from the axis),
    /// from the sensor to the object. `None` where no light comes that way.
    fn drawn_ray(&self, pose: &TrainPose, height: f64, image: f64, image_distance: f64) -> Option<Vec<TrainPoint>> {
        let (d, b) = (self.lens_to_mla(pose.delta_v), self.mla.b());
        let slope = (height - image) / image_distance;
        let at_mla = height - slope * d;
        let microlens = (at_mla / self.mla.pitch).round() * self.mla.pitch;
        let behind = slope + (at_mla - microlens) / self.mla.focal_length;
        let mut points = vec![[-(d + b), at_mla - behind * b], [-d, at_mla], [0.0, height]];
        let before = slope - height / self.main_lens.focal_length;
        let ray = Ray::from_slopes(Vector3::new(height, 0.0, 0.0), before, 0.0);
        let (last, object) = match pose.e {
            None => (ray, self.air_distance),
            Some(e) => {
                let [in_shell, in_water] = self.shell.path(&ray, e)?;
                points.extend([in_shell, in_water].map(|ray| [ray.origin.z, ray.origin.x]));
                (in_water, e + self.shell.outer_radius + self.object_distance)
            }
        };
        points.push([object, last.at_plane(object)?[0]]);
        Some(points)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::tests::{keplerian_camera, reference_camera};

    const WIDTH: f64 = 4.002;

    fn pose(camera: &CameraDesign, e: f64) -> TrainPose {
        let solution = camera.clarity(e);
        TrainPose { delta_v: solution.delta_v, e: Some(e), aperture: solution.aperture, sensor_width: WIDTH }
    }

    #[test]
    fn rays_of_a_point_come_from_one_place() {
        for camera in [reference_camera(), keplerian_camera()] {
            let bundles = camera.optical_train(&pose(&camera, 0.0));
            assert_eq!(bundles.len(), 3);
            let axis = &bundles[1];
            assert_eq!((axis.field, axis.rays.len()), (0.0, 3));
            for ray in &axis.rays {
                let [.., object] = ray[..] else { panic!("{ray:?}") };
                assert!(object[1].abs() < 0.05, "a ray of the axis misses the object by {} mm", object[1]);
                assert!((object[0] - (camera.shell.outer_radius + camera.object_distance)).abs() < 1e-9);
                assert_eq!(ray.len(), 6);
            }
            assert!(axis.rays[1].iter().all(|point| point[1] == 0.0), "{:?}", axis.rays[1]);
        }
    }

    #[test]
    fn the_edge_of_the_sensor_sees_the_edge_of_the_board() {
        let camera = reference_camera();
        for e in [0.0, 30.0] {
            let pose = pose(&camera, e);
            let half = camera.half_width_in_water(WIDTH, pose.delta_v, e).unwrap();
            let bundles = camera.optical_train(&pose);
            let edges = [&bundles[0], &bundles[2]].map(|bundle| bundle.rays[1].last().unwrap()[1]);
            assert!((edges[0] - half).abs() < 1e-6 && (edges[1] + half).abs() < 1e-6, "{edges:?} {half}");
        }
    }

    #[test]
    fn in_air_the_shell_bends_nothing() {
        let camera = reference_camera();
        let pose = TrainPose { delta_v: 0.0, e: None, aperture: camera.aperture(0.0), sensor_width: WIDTH };
        let bundles = camera.optical_train(&pose);
        for bundle in &bundles {
            let ends: Vec<_> = bundle.rays.iter().map(|ray| *ray.last().unwrap()).collect();
            assert!(ends.iter().all(|end| (end[1] - ends[0][1]).abs() < 1e-9 && end[0] == 800.0), "{ends:?}");
            assert!(bundle.rays.iter().all(|ray| ray.len() == 4));
        }
    }

    #[test]
    fn nothing_is_drawn_of_what_is_not_imaged() {
        let mut camera = reference_camera();
        camera.object_distance = 1.0;
        let near = TrainPose { delta_v: 0.0, e: Some(-59.0), aperture: 6.0, sensor_width: WIDTH };
        assert_eq!(camera.optical_train(&near), []);
    }
}
