//! Exact rays: Snell's law in vector form at both spheres of the shell, straight lines between.
//!
//! The frame has its origin at the main lens's principal point M and z along the axis towards the water; x and y are
//! the sensor's. C, the shell's centre, is at z = e, the outer vertex O at z = e + l_OC.

use nalgebra::Vector3;

use super::Shell;
use super::shell::N_AIR;

/// A ray of light, followed against its direction of travel: from the lens towards the object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// A point on it, mm from M.
    pub origin: Vector3<f64>,
    /// Where it runs, of length 1.
    pub direction: Vector3<f64>,
}

impl Ray {
    /// The ray from `origin` (mm) with slopes dx/dz and dy/dz, towards larger z.
    #[must_use]
    pub fn from_slopes(origin: Vector3<f64>, slope_x: f64, slope_y: f64) -> Self {
        Self { origin, direction: Vector3::new(slope_x, slope_y, 1.0).normalize() }
    }

    /// The chief ray of M itself at an angle (rad) to the axis, in the plane of x and z.
    #[must_use]
    pub fn from_principal_point(angle: f64) -> Self {
        Self { origin: Vector3::zeros(), direction: Vector3::new(angle.sin(), 0.0, angle.cos()) }
    }

    /// Angle to the axis, rad, 0 to π.
    #[must_use]
    pub fn angle(&self) -> f64 {
        self.direction.x.hypot(self.direction.y).atan2(self.direction.z)
    }

    /// Where it meets the plane at `z` (mm): x and y, mm. `None` where it runs along the plane or away from it.
    #[must_use]
    pub fn at_plane(&self, z: f64) -> Option<[f64; 2]> {
        let length = (z - self.origin.z) / self.direction.z;
        (length.is_finite() && length >= 0.0)
            .then(|| [self.origin.x + length * self.direction.x, self.origin.y + length * self.direction.y])
    }

    /// Where it leaves a sphere about `centre` (mm): the further intersection, so that the origin may lie inside or
    /// before the sphere. `None` where it misses.
    fn exit_from_sphere(&self, centre: Vector3<f64>, radius: f64) -> Option<Vector3<f64>> {
        let from_centre = self.origin - centre;
        let along = from_centre.dot(&self.direction);
        let root = along * along - (from_centre.norm_squared() - radius * radius);
        let length = root.max(0.0).sqrt() - along;
        (root >= 0.0 && length >= 0.0).then(|| self.origin + length * self.direction)
    }
}

/// Snell's law in vector form: the direction after a surface whose unit `normal` points into the half space entered,
/// from index `n_from` to `n_to`. `direction` has length 1. `None` on total reflection.
#[must_use]
pub fn refract(direction: Vector3<f64>, normal: Vector3<f64>, n_from: f64, n_to: f64) -> Option<Vector3<f64>> {
    let ratio = n_from / n_to;
    let cos_from = direction.dot(&normal);
    let cos_to_squared = 1.0 - ratio * ratio * (1.0 - cos_from * cos_from);
    (cos_to_squared >= 0.0).then(|| ratio * direction + (cos_to_squared.sqrt() - ratio * cos_from) * normal)
}

impl Shell {
    /// Follows a ray from the air inside, out through both spheres, into the water; e in mm. The ray returned starts on
    /// the outer sphere.
    ///
    /// `None` where no light comes that way: the ray misses the shell, passes behind the hemisphere's rim (the plane
    /// through C), or is totally reflected.
    #[must_use]
    pub fn trace(&self, ray: &Ray, e: f64) -> Option<Ray> {
        self.path(ray, e).map(|[_, in_water]| in_water)
    }

    /// The same with the ray's way through the shell: first the ray within the shell, which starts on the inner sphere,
    /// then that in the water.
    #[must_use]
    pub fn path(&self, ray: &Ray, e: f64) -> Option<[Ray; 2]> {
        let centre = Vector3::new(0.0, 0.0, e);
        let surface = |ray: &Ray, radius: f64, n_from: f64, n_to: f64| {
            let point = ray.exit_from_sphere(centre, radius)?;
            if point.z < e {
                return None;
            }
            let direction = refract(ray.direction, (point - centre) / radius, n_from, n_to)?;
            Some(Ray { origin: point, direction })
        };
        let in_shell = surface(ray, self.inner_radius, N_AIR, self.n_shell)?;
        let in_water = surface(&in_shell, self.outer_radius, self.n_shell, self.n_water)?;
        Some([in_shell, in_water])
    }

    /// The exact angle to the axis in water (rad) of the ray through M at `angle` to the axis in air (rad); e in mm.
    /// `None` where [`Shell::trace`] gives none.
    #[must_use]
    pub fn angle_in_water(&self, angle: f64, e: f64) -> Option<f64> {
        self.trace(&Ray::from_principal_point(angle), e).map(|ray| ray.angle())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn reference() -> Shell {
        Shell { outer_radius: 59.0, inner_radius: 51.0, n_shell: 1.49, n_water: 1.333 }
    }

    #[test]
    fn snell_in_numbers() {
        let direction = Vector3::new(0.5, 0.0, 0.75_f64.sqrt());
        let refracted = refract(direction, Vector3::z(), 1.0, 1.333).unwrap();
        assert!((refracted.x - 0.5 / 1.333).abs() < 1e-15 && (refracted.norm() - 1.0).abs() < 1e-15);
        // Beyond asin(1 / 1.333) = 48.6° nothing leaves the water.
        let steep = Vector3::new(0.8, 0.0, 0.6);
        assert_eq!(refract(steep, Vector3::z(), 1.333, 1.0), None);
    }

    #[test]
    fn rays_that_bring_no_light_are_none() {
        let shell = reference();
        // Behind the rim: e beyond l_O'C / tan.
        assert!(shell.trace(&Ray::from_principal_point(0.5), 51.0 / 0.5_f64.tan() - 0.1).is_some());
        assert!(shell.trace(&Ray::from_principal_point(0.5), 51.0 / 0.5_f64.tan() + 0.1).is_none());
        // Past the shell altogether.
        assert!(shell.trace(&Ray::from_principal_point(1.2), 200.0).is_none());
        assert!(shell.trace(&Ray::from_principal_point(0.1), -60.0).is_none());
    }

    proptest! {
        #[test]
        fn the_distance_from_the_centre_times_the_index_is_kept(
            angle in 0.0..0.6f64, e in -40.0..40.0f64, n_shell in 1.35..1.8f64, n_water in 1.3..1.34f64,
        ) {
            // Concentric spheres: n times the distance at which a ray passes C is the same in every layer, which gives
            // the angle in water without vectors.
            let shell = Shell { n_shell, n_water, ..reference() };
            let h = e * angle.sin();
            let turn = |radius: f64, n_from: f64, n_to: f64| (h / radius / n_to).asin() - (h / radius / n_from).asin();
            let expected = angle - turn(51.0, 1.0, n_shell) - turn(59.0, n_shell, n_water);
            let traced = shell.angle_in_water(angle, e).unwrap();
            prop_assert!((traced - expected).abs() < 1e-12, "{traced} {expected}");
        }

        #[test]
        fn rays_near_the_axis_meet_where_the_paraxial_model_says(
            inner in 30.0..150.0f64, thickness in 0.5..15.0f64, n_shell in 1.35..1.8f64, n_water in 1.3..1.4f64,
            distance in 100.0..3000.0f64, relative_e in -0.5..0.9f64,
        ) {
            let shell = Shell { outer_radius: inner + thickness, inner_radius: inner, n_shell, n_water };
            let e = relative_e * inner;
            let equivalent = shell.equivalent_distance(distance, e);
            // A ray through the lens at a small height, as if from A'', meets the axis at A.
            let height = 1e-4 * inner;
            let ray = Ray::from_slopes(Vector3::new(height, 0.0, 0.0), -height / equivalent, 0.0);
            let [x, _] = shell.trace(&ray, e).unwrap().at_plane(e + shell.outer_radius + distance).unwrap();
            prop_assert!(x.abs() < 1e-6 * height * (1.0 + distance / inner), "{x} at height {height}");
        }

        #[test]
        fn one_index_everywhere_is_a_straight_line(angle in 0.0..0.6f64, e in -40.0..40.0f64) {
            let shell = Shell { n_shell: 1.0, n_water: 1.0, ..reference() };
            prop_assert!((shell.angle_in_water(angle, e).unwrap() - angle).abs() < 1e-12);
        }
    }
}
