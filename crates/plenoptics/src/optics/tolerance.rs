//! How far from its design point a camera stays sharp: depth of field (Eqs. 17–19), tolerance of e, depth resolution.
//!
//! The blur limit δ is a disc's diameter on the sensor. In image terms the blur is |spacing − target spacing| exactly,
//! so "in focus" is the band of spacings within δ of the target, and both ends of it lead back through Eq. 9 and Gauss
//! to an equivalent distance: the near end has the larger spacing, in both modes.

use super::{CameraDesign, MlaMode, Solution};

/// Object distances in water between which the blur stays within the limit, mm from the shell's outer vertex O.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthOfField {
    /// Nearest sharp distance, ≥ 0.
    pub near: f64,
    /// Furthest sharp distance; `None` for infinity.
    pub far: Option<f64>,
}

/// Values of e between which the blur stays within the limit, Δv held, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EInterval {
    /// Least e; `None` where none is too small.
    pub low: Option<f64>,
    /// Greatest e; `None` where none is too large.
    pub high: Option<f64>,
}

impl CameraDesign {
    /// δ_D (Eqs. 17–19): diameter (mm on the sensor) of the blur disc of an object in water (mm from O), with the camera
    /// at Δv and e (mm).
    #[must_use]
    pub fn blur_at(&self, object_distance: f64, delta_v: f64, e: f64) -> f64 {
        let v = self.main_lens.image_distance(self.shell.equivalent_distance(object_distance, e));
        self.mla.blur(v - self.lens_to_mla(delta_v))
    }

    /// The same in air without the shell, for an object at a distance from M (mm).
    #[must_use]
    pub fn blur_in_air(&self, distance: f64, delta_v: f64) -> f64 {
        self.mla.blur(self.main_lens.image_distance(distance) - self.lens_to_mla(delta_v))
    }

    /// Object distances in water over which the blur stays within `limit` (mm on the sensor) at Δv and e (mm). `None`
    /// where nothing in the water is that sharp.
    #[must_use]
    pub fn depth_of_field(&self, delta_v: f64, e: f64, limit: f64) -> Option<DepthOfField> {
        let [nearest, furthest] = [0.0, f64::INFINITY].map(|distance| self.shell.equivalent_distance(distance, e));
        let (near, far) = self.sharp_equivalents(delta_v, limit);
        if near >= furthest || far.is_some_and(|far| far <= nearest) {
            return None;
        }
        Some(DepthOfField {
            near: if near <= nearest { 0.0 } else { self.shell.object_distance(near, e) },
            far: far.filter(|&far| far < furthest).map(|far| self.shell.object_distance(far, e)),
        })
    }

    /// Object distances in air without the shell, mm from M, over which the blur stays within `limit` (mm on the sensor)
    /// at Δv (mm). `None` where nothing is that sharp.
    #[must_use]
    pub fn depth_of_field_in_air(&self, delta_v: f64, limit: f64) -> Option<DepthOfField> {
        let (near, far) = self.sharp_equivalents(delta_v, limit);
        near.is_finite().then_some(DepthOfField { near, far })
    }

    /// Values of e for which the object at the design's distance stays within `limit` (mm on the sensor), Δv held (mm).
    /// `None` where no e makes it that sharp.
    #[must_use]
    pub fn e_tolerance(&self, delta_v: f64, limit: f64) -> Option<EInterval> {
        let (near, far) = self.sharp_equivalents(delta_v, limit);
        let e = |equivalent| self.shell.e_from_equivalent(equivalent, self.object_distance);
        near.is_finite().then(|| EInterval { low: (near > 0.0).then(|| e(near)), high: far.map(e) })
    }

    /// Equivalent distances (mm from M) at which the spacing is `limit` above and below its target. The near one is 0
    /// where every nearer object is sharp and infinite where nothing is; the far one is `None` for infinity.
    fn sharp_equivalents(&self, delta_v: f64, limit: f64) -> (f64, Option<f64>) {
        let target = self.mla.target_spacing();
        let near = match self.equivalent_vergence(target + limit, delta_v) {
            Some(vergence) if vergence > 0.0 => 1.0 / vergence,
            Some(_) => f64::INFINITY,
            // An image that receded to infinity and came back from behind, which an object nearer than f does; and the
            // image before the MLA that is the far end of everything in Keplerian mode.
            None => match self.mla.mode {
                MlaMode::Galilean => 0.0,
                MlaMode::Keplerian => f64::INFINITY,
            },
        };
        let far = self.equivalent_vergence(target - limit, delta_v).filter(|&vergence| vergence > 0.0);
        (near, far.map(|vergence| 1.0 / vergence))
    }

    /// 1 / l_A''M (1/mm) of a spacing (mm on the sensor) with the MLA at Δv (mm): Eq. 9 and Gauss in reciprocals, which
    /// stay finite where a or v is infinite; ≤ 0 where the object would be beyond infinity. `None` where the image is on
    /// the wrong side of the MLA for its mode: in Galilean mode between lens and MLA, in Keplerian mode not there.
    fn equivalent_vergence(&self, spacing: f64, delta_v: f64) -> Option<f64> {
        let d = self.lens_to_mla(delta_v);
        let inverse_a = (self.mla.pitch - spacing) / (self.mla.b() * self.mla.pitch);
        // v = d + a, so 1 / v = (1 / a) / (1 + d / a); 1 + d / a = v / a is negative between lens and MLA only.
        let v_over_a = 1.0 + d * inverse_a;
        let between = v_over_a < 0.0;
        (between == (self.mla.mode == MlaMode::Keplerian))
            .then(|| 1.0 / self.main_lens.focal_length - inverse_a / v_over_a)
    }

    /// The change of object distance in water (mm) that changes the parallax between microlenses `pitches` apart by
    /// `parallax` (mm on the sensor), at an object distance (mm from O) and with the camera at Δv and e (mm).
    #[must_use]
    pub fn depth_resolution_in_water(
        &self,
        object_distance: f64,
        delta_v: f64,
        e: f64,
        parallax: f64,
        pitches: f64,
    ) -> f64 {
        let equivalent = self.shell.equivalent_distance(object_distance, e);
        self.depth_resolution_in_air(equivalent, delta_v, parallax, pitches)
            / self.shell.longitudinal_magnification(object_distance)
    }

    /// The same in air without the shell, at a distance from M (mm). The paper gives it for the air design and half a
    /// pixel; its 30 mm at 800 mm is a parallax over about three pitches.
    #[must_use]
    pub fn depth_resolution_in_air(&self, distance: f64, delta_v: f64, parallax: f64, pitches: f64) -> f64 {
        parallax / (pitches * self.spacing_per_equivalent(distance, delta_v).abs())
    }

    /// How the spacing changes with the equivalent distance, d l / d l_A''M, dimensionless, < 0. Since l_A''M grows with
    /// e one for one, it is also d l / d e at Δv held.
    #[must_use]
    pub fn spacing_per_equivalent(&self, equivalent_distance: f64, delta_v: f64) -> f64 {
        let v = self.main_lens.image_distance(equivalent_distance);
        // From Gauss, dv / d l_A''M = −(v / l_A''M)².
        -self.mla.spacing_slope(v - self.lens_to_mla(delta_v)) * (v / equivalent_distance).powi(2)
    }

    /// By how much the spacing changes at a solution, mm on the sensor per mm: with Δv, and with e, both without their sign.
    #[must_use]
    pub fn spacing_slopes(&self, solution: &Solution) -> [f64; 2] {
        let (distance, delta_v) = (solution.equivalent_distance, solution.delta_v);
        [self.spacing_per_delta_v(distance, delta_v).abs(), self.spacing_per_equivalent(distance, delta_v).abs()]
    }

    /// How the spacing changes with Δv at an equivalent distance held (mm), d l / d Δv, dimensionless, < 0: the MLA
    /// moves towards the image in Galilean mode and away from it in Keplerian.
    #[must_use]
    pub fn spacing_per_delta_v(&self, equivalent_distance: f64, delta_v: f64) -> f64 {
        -self.mla.spacing_slope(self.main_lens.image_distance(equivalent_distance) - self.lens_to_mla(delta_v))
    }
}

#[cfg(test)]
mod tests {
    use crate::optics::tests::{keplerian_camera, reference_camera};
    use proptest::prelude::*;

    const PIXEL: f64 = 0.003_45;

    #[test]
    fn the_reference_camera_resolves_and_responds() {
        let camera = reference_camera();
        let joint = camera.joint(0.0);
        let resolution = |pitches| camera.depth_resolution_in_air(800.0, 0.0, PIXEL / 2.0, pitches);
        assert!((resolution(1.0) - 87.5).abs() < 0.06 && (resolution(3.0) - 29.2).abs() < 0.06, "{}", resolution(1.0));
        let behind = |distance| camera.shell.equivalent_distance(distance, joint.e);
        let in_water = camera.depth_resolution_in_water(800.0, joint.delta_v, joint.e, PIXEL / 2.0, 1.0);
        let step = camera.spacing_at(behind(800.0 - 0.5 * in_water), joint.delta_v)
            - camera.spacing_at(behind(800.0 + 0.5 * in_water), joint.delta_v);
        assert!((step / (PIXEL / 2.0) - 1.0).abs() < 0.01, "{in_water} {step}");
        let per_delta_v = camera.spacing_per_delta_v(joint.equivalent_distance, joint.delta_v) / PIXEL;
        let per_e = camera.spacing_per_equivalent(joint.equivalent_distance, joint.delta_v) / PIXEL;
        assert!((per_delta_v + 8.7).abs() < 0.05 && (per_e + 0.16).abs() < 0.005, "{per_delta_v} {per_e}");
        // Steeper at e = 30 with Δv set for e = 0; nearly flat at e = 0 with the air design's Δv.
        let start = camera.clarity(30.0).equivalent_distance;
        let steep = camera.spacing_per_equivalent(start, joint.delta_v) / PIXEL;
        let flat = camera.spacing_per_equivalent(joint.equivalent_distance, 0.0) / PIXEL;
        assert!((steep + 0.34).abs() < 0.005 && (flat + 0.017).abs() < 5e-4, "{steep} {flat}");
    }

    #[test]
    fn the_air_design_is_sharp_about_its_own_distance() {
        let camera = reference_camera();
        assert!(camera.blur_in_air(800.0, 0.0) < 1e-12);
        let depth = camera.depth_of_field_in_air(0.0, PIXEL).unwrap();
        let far = depth.far.unwrap();
        assert!(depth.near < 800.0 && far > 800.0, "{depth:?}");
        for end in [depth.near, far] {
            assert!((camera.blur_in_air(end, 0.0) - PIXEL).abs() < 1e-12, "{end}");
        }
    }

    #[test]
    fn infinity_and_the_shell_end_the_depth_of_field() {
        let camera = reference_camera();
        let joint = camera.joint(0.0);
        let generous = camera.depth_of_field(joint.delta_v, joint.e, 0.025).unwrap();
        assert_eq!(generous.far, None);
        let all = camera.depth_of_field(joint.delta_v, joint.e, 0.2).unwrap();
        assert_eq!((all.near, all.far), (0.0, None));
        // The air design is focused too far for anything seen through the shell, Δv = 20 mm too near.
        assert_eq!(camera.depth_of_field(0.0, 0.0, 0.0005), None);
        assert_eq!(camera.depth_of_field(20.0, 0.0, 0.0005), None);
        // With the MLA where the air design has it, an object at infinity still has a > 0, and one nearer than f any a.
        let unbounded = camera.e_tolerance(0.0, 0.04).unwrap();
        assert_eq!((unbounded.low, unbounded.high), (None, None));
    }

    proptest! {
        #[test]
        fn the_ends_have_the_blur_of_the_limit(
            keplerian: bool, e in -5.0..40.0f64, limit in 0.0005..0.004f64, distance in 300.0..1500.0f64,
        ) {
            let mut camera = if keplerian { keplerian_camera() } else { reference_camera() };
            camera.object_distance = distance;
            let solution = camera.clarity(e);
            prop_assert!(camera.blur_at(distance, solution.delta_v, e) < 1e-12);
            let depth = camera.depth_of_field(solution.delta_v, e, limit).unwrap();
            prop_assert!(depth.near < distance && depth.far.is_none_or(|far| far > distance));
            if depth.near > 0.0 {
                prop_assert!((camera.blur_at(depth.near, solution.delta_v, e) - limit).abs() < 1e-10);
            }
            if let Some(far) = depth.far {
                prop_assert!((camera.blur_at(far, solution.delta_v, e) - limit).abs() < 1e-10);
            } else {
                prop_assert!(camera.blur_at(1e9, solution.delta_v, e) <= limit + 1e-9);
            }
            let interval = camera.e_tolerance(solution.delta_v, limit).unwrap();
            for end in [interval.low, interval.high].into_iter().flatten() {
                prop_assert!((camera.blur_at(distance, solution.delta_v, end) - limit).abs() < 1e-10);
            }
        }

        #[test]
        fn slopes_are_slopes(keplerian: bool, e in -5.0..40.0f64, shift in -0.1..0.1f64) {
            let camera = if keplerian { keplerian_camera() } else { reference_camera() };
            let solution = camera.clarity(e);
            let (equivalent, delta_v, h) = (solution.equivalent_distance, solution.delta_v + shift, 1e-4);
            let by_equivalent =
                (camera.spacing_at(equivalent + h, delta_v) - camera.spacing_at(equivalent - h, delta_v)) / (2.0 * h);
            let by_delta_v =
                (camera.spacing_at(equivalent, delta_v + h) - camera.spacing_at(equivalent, delta_v - h)) / (2.0 * h);
            prop_assert!((camera.spacing_per_equivalent(equivalent, delta_v) / by_equivalent - 1.0).abs() < 1e-5);
            prop_assert!((camera.spacing_per_delta_v(equivalent, delta_v) / by_delta_v - 1.0).abs() < 1e-5);
        }
    }
}
