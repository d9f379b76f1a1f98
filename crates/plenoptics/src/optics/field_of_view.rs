//! Field of view in air, inside the shell and in water, and the two bounds that it and the lens's barrel set on e.
//!
//! The inner field of view is seen from M through the air; the shell turns its edge rays by Snell's law. With the lens
//! behind C (e > 0) the field in water is wider than the inner one, with the lens towards the water (e < 0) narrower,
//! and at e = 0 the same.

use super::{CameraDesign, Shell};

/// The sensor's extent on which a field of view is based, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorExtent {
    /// Width, mm.
    pub width: f64,
    /// Height, mm.
    pub height: f64,
}

impl SensorExtent {
    /// The sensor's diagonal, mm: its corners go black first.
    #[must_use]
    pub fn diagonal(&self) -> f64 {
        self.width.hypot(self.height)
    }
}

/// Both bounds on e, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EBounds {
    /// l_bound: below it the lens's barrel touches the shell.
    pub low: f64,
    /// Above it the shell's rim shows as black edges.
    pub high: f64,
}

impl Shell {
    /// The full field of view in water (rad) of a full inner field of view (rad) with the lens at e (mm): the exact
    /// Snell trace of the edge's chief ray, doubled. `None` where the edge ray brings no light: past the shell's rim or
    /// the shell itself.
    #[must_use]
    pub fn fov_in_water(&self, inner_fov: f64, e: f64) -> Option<f64> {
        self.angle_in_water(inner_fov / 2.0, e).map(|angle| 2.0 * angle)
    }

    /// The greatest e (mm) at which a full inner field of view (rad) clears the rim of a hemispherical shell:
    /// l_O'C / tan(α / 2). Take α over the sensor's diagonal.
    #[must_use]
    pub fn e_max(&self, inner_fov: f64) -> f64 {
        self.inner_radius / (inner_fov / 2.0).tan()
    }
}

impl CameraDesign {
    /// The full inner field of view α (rad) over an extent of the sensor (mm) at Δv (mm): 2 atan(w / (2 (d + b))).
    #[must_use]
    pub fn inner_fov(&self, extent: f64, delta_v: f64) -> f64 {
        2.0 * (extent / 2.0 / (self.lens_to_mla(delta_v) + self.mla.b())).atan()
    }

    /// The full field of view in water (rad) over an extent of the sensor (mm) at Δv and e (mm). `None` where the edge
    /// ray brings no light.
    #[must_use]
    pub fn fov_in_water(&self, extent: f64, delta_v: f64, e: f64) -> Option<f64> {
        self.shell.fov_in_water(self.inner_fov(extent, delta_v), e)
    }

    /// Half the width (mm) of a board at `object_distance` in water that an extent of the sensor (mm) sees at Δv and e
    /// (mm). `None` where the edge ray brings no light.
    #[must_use]
    pub fn half_width_in_water(&self, extent: f64, delta_v: f64, e: f64) -> Option<f64> {
        let [x, _] = self.exact_in_water(delta_v, e).chief_board_point([-extent / 2.0, 0.0])?;
        Some(x)
    }

    /// Half the width (mm) of a board in air, at a distance from M (mm), that an extent of the sensor (mm) sees at Δv
    /// (mm).
    #[must_use]
    pub fn half_width_in_air(&self, extent: f64, delta_v: f64, distance: f64) -> f64 {
        distance * (self.inner_fov(extent, delta_v) / 2.0).tan()
    }

    /// Both bounds on e at Δv (mm): l_bound (mm) below, the shell's rim above.
    #[must_use]
    pub fn e_bounds(&self, sensor: &SensorExtent, l_bound: f64, delta_v: f64) -> EBounds {
        EBounds { low: l_bound, high: self.shell.e_max(self.inner_fov(sensor.diagonal(), delta_v)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::tests::reference_camera;

    const SENSOR: SensorExtent = SensorExtent { width: 4.002, height: 4.002 };

    #[test]
    fn the_field_widens_with_e() {
        // 60° inner field behind the reference shell, as Snell's law has it.
        let shell = reference_camera().shell;
        for (e, degrees) in [(-51.0, 43.33), (-30.0, 50.90), (0.0, 60.0), (10.0, 62.94), (30.0, 69.10)] {
            let fov = shell.fov_in_water(60_f64.to_radians(), e).unwrap().to_degrees();
            assert!((fov - degrees).abs() < 0.006, "e = {e}: {fov}");
        }
        assert!((shell.e_max(60_f64.to_radians()) - 88.33).abs() < 0.006);
    }

    #[test]
    fn a_lens_at_the_shell_sees_as_through_a_flat_port() {
        // With M on O' the inner surface does not turn the ray by where it meets it but by its angle alone.
        let shell = Shell { outer_radius: 51.0 + 1e-9, ..reference_camera().shell };
        let angle = 20_f64.to_radians();
        let fov = shell.fov_in_water(2.0 * angle, -51.0 + 1e-9).unwrap() / 2.0;
        assert!((fov.sin() - angle.sin() / 1.333).abs() < 1e-7, "{fov}");
    }

    #[test]
    fn the_reference_camera_sees() {
        let camera = reference_camera();
        let (clarity, joint) = (camera.clarity(30.0), camera.joint(0.0));
        let degrees = |fov: f64| fov.to_degrees();
        for (fov, expected) in [
            (camera.inner_fov(SENSOR.width, 0.0), 11.55),
            (camera.inner_fov(SENSOR.width, clarity.delta_v), 10.62),
            (camera.inner_fov(SENSOR.width, joint.delta_v), 10.40),
            (camera.fov_in_water(SENSOR.width, 0.0, 30.0).unwrap(), 13.32),
            (camera.fov_in_water(SENSOR.width, clarity.delta_v, 30.0).unwrap(), 12.25),
            (camera.fov_in_water(SENSOR.width, joint.delta_v, 0.0).unwrap(), 10.40),
        ] {
            assert!((degrees(fov) - expected).abs() < 0.006, "{} {expected}", degrees(fov));
        }
        for (half, expected) in [
            (camera.half_width_in_air(SENSOR.width, 0.0, 800.0), 80.9),
            (camera.half_width_in_water(SENSOR.width, 0.0, 30.0).unwrap(), 102.6),
            (camera.half_width_in_water(SENSOR.width, clarity.delta_v, 30.0).unwrap(), 94.2),
            (camera.half_width_in_water(SENSOR.width, joint.delta_v, 0.0).unwrap(), 78.2),
        ] {
            assert!((half - expected).abs() < 0.06, "{half} {expected}");
        }
        let bounds = camera.e_bounds(&SENSOR, -1.5, joint.delta_v);
        assert_eq!(bounds.low, -1.5);
        assert_eq!(camera.fov_in_water(SENSOR.diagonal(), joint.delta_v, bounds.high + 0.1), None);
        assert!(camera.fov_in_water(SENSOR.diagonal(), joint.delta_v, bounds.high - 0.1).is_some());
    }
}
