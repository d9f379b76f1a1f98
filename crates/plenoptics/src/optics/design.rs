//! The design: the air camera, and clarity, FOV and joint optimisation in water (Eqs. 8, 13, 14).

use super::mla::{a_from_spacing, adjusted_image_distance, spacing};
use super::{MainLens, Mla, Shell};

/// A plenoptic camera designed in air, and the shell it is to work behind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraDesign {
    /// The main lens.
    pub main_lens: MainLens,
    /// The microlens array.
    pub mla: Mla,
    /// The shell, with the water outside.
    pub shell: Shell,
    /// d_OBJ in air, from M: the distance the air camera is focused on, mm.
    pub air_distance: f64,
    /// d_OBJ in water, from O: the distance to be in focus under water, mm.
    pub object_distance: f64,
}

/// One pair of Δv and e that puts the object in focus, and what follows from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// e, mm.
    pub e: f64,
    /// Δv, mm.
    pub delta_v: f64,
    /// l_A''M, mm.
    pub equivalent_distance: f64,
    /// v + Δv, mm.
    pub image_distance: f64,
    /// D_aper + ΔD_aper (Eq. 14): aperture diameter after the change, mm.
    pub aperture: f64,
    /// ΔD_aper, mm.
    pub aperture_change: f64,
    /// Working f-number of the main lens: (v + Δv) / (D_aper + ΔD_aper).
    pub main_lens_f_number: f64,
}

impl CameraDesign {
    /// v: image distance of the air design, mm from M.
    #[must_use]
    pub fn air_image_distance(&self) -> f64 {
        self.main_lens.image_distance(self.air_distance)
    }

    /// d of the air design: main lens to MLA, mm.
    #[must_use]
    pub fn air_lens_to_mla(&self) -> f64 {
        self.air_image_distance() - self.mla.a()
    }

    /// d at an image distance changed by `delta_v`, mm: the MLA moves with the sensor.
    #[must_use]
    pub fn lens_to_mla(&self, delta_v: f64) -> f64 {
        self.air_lens_to_mla() + delta_v
    }

    /// Eq. 14: aperture diameter (mm) that fills the micro-images at `delta_v`: d D_MLA / b.
    #[must_use]
    pub fn aperture(&self, delta_v: f64) -> f64 {
        self.lens_to_mla(delta_v) * self.mla.pitch / self.mla.b()
    }

    /// Eq. 8: the Δv (mm) that focuses on an equivalent distance (mm from M).
    #[must_use]
    pub fn delta_v_for_equivalent(&self, equivalent_distance: f64) -> f64 {
        self.main_lens.image_distance(equivalent_distance) - self.air_image_distance()
    }

    /// Clarity optimisation (Eqs. 5 and 8): Δv for a held e. Also "re-optimise Δv with e fixed" of Section 2.3.
    #[must_use]
    pub fn clarity(&self, e: f64) -> Solution {
        self.reoptimised(self.object_distance, e)
    }

    /// Re-optimises Δv with e fixed (Section 2.3) for an object at another distance in water (mm from O): what brings it
    /// into focus once it has left the depth of field.
    #[must_use]
    pub fn reoptimised(&self, object_distance: f64, e: f64) -> Solution {
        self.solution(e, self.shell.equivalent_distance(object_distance, e))
    }

    /// FOV optimisation (Eq. 13): the e (mm) that keeps the field of view, as near to 0 as l_bound (mm) allows.
    #[must_use]
    pub fn fov_optimal_e(l_bound: f64) -> f64 {
        l_bound.max(0.0)
    }

    /// Joint optimisation (Eqs. 5, 8 and 13): e = max(0, l_bound) and the Δv that belongs to it.
    #[must_use]
    pub fn joint(&self, l_bound: f64) -> Solution {
        self.clarity(Self::fov_optimal_e(l_bound))
    }

    fn solution(&self, e: f64, equivalent_distance: f64) -> Solution {
        let delta_v = self.delta_v_for_equivalent(equivalent_distance);
        let image_distance = self.air_image_distance() + delta_v;
        let aperture = self.aperture(delta_v);
        Solution {
            e,
            delta_v,
            equivalent_distance,
            image_distance,
            aperture,
            aperture_change: aperture - self.aperture(0.0),
            main_lens_f_number: MainLens::working_f_number(image_distance, aperture),
        }
    }

    /// The spacing (mm on the sensor) of an object at an equivalent distance (mm from M), with the MLA at `delta_v`.
    #[must_use]
    pub fn spacing_at(&self, equivalent_distance: f64, delta_v: f64) -> f64 {
        let a = self.main_lens.image_distance(equivalent_distance) - self.lens_to_mla(delta_v);
        spacing(self.mla.pitch, a, self.mla.b())
    }

    /// The equivalent distance (mm from M) whose spacing is `spacing` (mm on the sensor) with the MLA at `delta_v`:
    /// Eqs. 9–11 with the design's b.
    #[must_use]
    pub fn equivalent_from_spacing(&self, spacing: f64, delta_v: f64) -> f64 {
        let a = a_from_spacing(self.mla.pitch, spacing, self.mla.b());
        self.main_lens.object_distance(a + self.lens_to_mla(delta_v))
    }

    /// The Δv (mm) at which an object at an equivalent distance (mm from M) has this spacing (mm on the sensor).
    #[must_use]
    pub fn delta_v_from_spacing(&self, spacing: f64, equivalent_distance: f64) -> f64 {
        let a = a_from_spacing(self.mla.pitch, spacing, self.mla.b());
        self.main_lens.image_distance(equivalent_distance) - a - self.air_lens_to_mla()
    }

    /// The e (mm) at which the object in water has this spacing (mm on the sensor), with the MLA at `delta_v`.
    #[must_use]
    pub fn e_from_spacing(&self, spacing: f64, delta_v: f64) -> f64 {
        self.shell.e_from_equivalent(self.equivalent_from_spacing(spacing, delta_v), self.object_distance)
    }

    /// The object distance in water (mm from O) whose spacing is `spacing` (mm on the sensor) with the camera at Δv and
    /// e (mm).
    #[must_use]
    pub fn object_distance_from_spacing(&self, spacing: f64, delta_v: f64, e: f64) -> f64 {
        self.shell.object_distance(self.equivalent_from_spacing(spacing, delta_v), e)
    }

    /// Δv_1 (Eq. 15), mm: the Δv at which a camera with a calibrated d and b (mm) stands, v_ADJ − v.
    #[must_use]
    pub fn delta_v_from_calibration(&self, lens_to_mla: f64, b: f64) -> f64 {
        adjusted_image_distance(lens_to_mla, b, self.mla.signed_resolution()) - self.air_image_distance()
    }

    /// l_bound (Eqs. 9–12), mm: the e at which the lens stands when the board at `object_distance` in water has this
    /// spacing (mm on the sensor), with a calibrated d and b (mm).
    #[must_use]
    pub fn l_bound_from_spacing(&self, spacing: f64, lens_to_mla: f64, b: f64) -> f64 {
        let image_distance = a_from_spacing(self.mla.pitch, spacing, b) + lens_to_mla;
        self.shell.e_from_equivalent(self.main_lens.object_distance(image_distance), self.object_distance)
    }
}

#[cfg(test)]
mod tests {
    use crate::optics::tests::{keplerian_camera, reference_camera};
    use proptest::prelude::*;

    #[test]
    fn table_2_of_the_paper() {
        let camera = reference_camera();
        assert_eq!(format!("{:.3}", camera.clarity(30.0).delta_v), "1.745");
        assert_eq!(format!("{:.3}", camera.joint(0.0).delta_v), "2.205");
        assert!((camera.joint(0.0).equivalent_distance - 167.17).abs() < 0.006);
    }

    #[test]
    fn the_reference_aperture_and_its_numbers() {
        let camera = reference_camera();
        let joint = camera.joint(0.0);
        assert!((camera.aperture(0.0) - 5.7157).abs() < 5e-5 && (joint.aperture - 6.364).abs() < 5e-4);
        assert!((joint.main_lens_f_number - 3.57).abs() < 0.005);
        assert!((camera.main_lens.ring_f_number(joint.aperture) - 3.143).abs() < 5e-4);
        // The MLA's f-number is the slope of the cone that fills a micro-image.
        assert!((camera.lens_to_mla(joint.delta_v) / joint.aperture - camera.mla.f_number()).abs() < 1e-12);
    }

    #[test]
    fn e_is_held_at_the_bound_of_the_barrel() {
        let camera = reference_camera();
        assert_eq!(camera.joint(-4.0).e, 0.0);
        assert_eq!(camera.joint(19.0).e, 19.0);
    }

    #[test]
    fn the_air_board_stays_measurable_at_the_equivalent_distance() {
        let camera = reference_camera();
        let joint = camera.joint(0.0);
        assert!((camera.spacing_at(joint.equivalent_distance, 0.0) / 0.003_45 - 25.97).abs() < 0.006);
        assert!((camera.spacing_at(joint.equivalent_distance, joint.delta_v) / 0.003_45 - 19.725).abs() < 5e-4);
    }

    proptest! {
        #[test]
        fn the_solution_is_in_focus_and_every_inverse_finds_it(
            keplerian: bool, e in -10.0..50.0f64, distance in 300.0..2000.0f64, shift in -0.15..0.15f64,
        ) {
            let mut camera = if keplerian { keplerian_camera() } else { reference_camera() };
            camera.object_distance = distance;
            let solution = camera.clarity(e);
            let target = camera.mla.target_spacing();
            let in_focus = camera.spacing_at(solution.equivalent_distance, solution.delta_v);
            prop_assert!((in_focus / target - 1.0).abs() < 1e-10);
            let delta_v = solution.delta_v + shift;
            let spacing = camera.spacing_at(solution.equivalent_distance, delta_v);
            prop_assert!((camera.equivalent_from_spacing(spacing, delta_v) / solution.equivalent_distance - 1.0).abs() < 1e-9);
            prop_assert!((camera.delta_v_from_spacing(spacing, solution.equivalent_distance) - delta_v).abs() < 1e-9);
            prop_assert!((camera.e_from_spacing(spacing, delta_v) - e).abs() < 1e-7);
            prop_assert!((camera.object_distance_from_spacing(spacing, delta_v, e) / distance - 1.0).abs() < 1e-8);
            let (d, b) = (camera.lens_to_mla(delta_v), camera.mla.b());
            prop_assert!((camera.delta_v_from_calibration(d, b) - delta_v).abs() < 1e-12);
            prop_assert!((camera.l_bound_from_spacing(spacing, d, b) - e).abs() < 1e-7);
        }
    }
}
