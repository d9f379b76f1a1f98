//! The camera as the air step left it: calibrated d and b instead of the design's, seen through the shell.

use bench::config::Config;
use plenoptics::imaging::spacing::nominal_mask_radius;
use plenoptics::optics::exact::ExactView;
use plenoptics::optics::{CameraDesign, mla};

/// Rounds of the fixed points from spacing to e and to a trim: the shell's aberrations change by a thousandth of what e does.
const E_ROUNDS: usize = 3;

/// A camera whose d and b were measured in air, behind its shell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibratedCamera {
    /// The design: main lens, pitch, shell and object distance are taken from it.
    pub design: CameraDesign,
    /// d as measured at the end of the air step, mm.
    pub lens_to_mla_mm: f64,
    /// b as measured, mm.
    pub mla_to_sensor_mm: f64,
    /// Standard uncertainty of d + N b, mm: what Δv is good to.
    pub image_distance_sigma_mm: f64,
    /// Side of a pixel, mm.
    pub pixel_mm: f64,
    /// Radius of the masks that the estimator compares pairs with, px: through the shell the spacing depends on it.
    /// `None` leaves the shell's aberrations out.
    pub window_px: Option<f64>,
    /// Standard uncertainty of what the shell's aberrations add, as a share of it.
    pub aberrations_sigma: f64,
}

impl CalibratedCamera {
    /// The configured camera as its design has it in focus at e (mm), with the masks that the estimator will then have.
    #[must_use]
    pub fn designed(config: &Config, e: f64) -> Self {
        let (design, pixel_mm) = (config.design(), config.pixel_pitch().millimetres());
        let (d, b) = (design.lens_to_mla(design.clarity(e).delta_v), design.mla.b());
        let pitch_px = mla::micro_image_pitch(design.mla.pitch, d, b) / pixel_mm;
        Self {
            design,
            lens_to_mla_mm: d,
            mla_to_sensor_mm: b,
            image_distance_sigma_mm: 0.0,
            pixel_mm,
            window_px: Some(nominal_mask_radius(pitch_px, design.mla.target_spacing() / pixel_mm)),
            aberrations_sigma: config.uncertainty.shell_aberrations,
        }
    }

    /// a (mm, signed) of the board in water, with the lens at e (mm) and the MLA moved by `trim` (mm) since the air
    /// step.
    fn a_mm(&self, e: f64, trim: f64) -> f64 {
        let equivalent = self.design.shell.equivalent_distance(self.design.object_distance, e);
        self.design.main_lens.image_distance(equivalent) - self.lens_to_mla_mm - trim
    }

    /// Image distance (mm) of whatever has this spacing (px), with the MLA moved by `trim` (mm).
    fn image_distance_mm(&self, spacing_px: f64, trim: f64) -> f64 {
        let a = mla::a_from_spacing(self.design.mla.pitch, spacing_px * self.pixel_mm, self.mla_to_sensor_mm);
        a + self.lens_to_mla_mm + trim
    }

    /// The spacing (px) that the estimator measures of the board in water with the lens at e (mm) and the MLA moved by
    /// `trim` (mm) since the air step.
    #[must_use]
    pub fn spacing_px(&self, e: f64, trim: f64) -> f64 {
        let paraxial = mla::spacing(self.design.mla.pitch, self.a_mm(e, trim), self.mla_to_sensor_mm);
        paraxial / self.pixel_mm + self.excess_px(e, trim)
    }

    /// By how much the spacing that the estimator measures at e and trim (mm) exceeds the paraxial one, px: the shell's
    /// aberrations, averaged over the estimator's window.
    #[must_use]
    pub fn excess_px(&self, e: f64, trim: f64) -> f64 {
        let Some(window_px) = self.window_px else { return 0.0 };
        let view = ExactView {
            lens_to_mla: self.lens_to_mla_mm + trim,
            b: self.mla_to_sensor_mm,
            ..self.design.exact_in_water(0.0, e)
        };
        // A pose from which no light at all comes has no picture either.
        view.excess(window_px * self.pixel_mm).unwrap_or(0.0) / self.pixel_mm
    }

    /// Standard uncertainty (px) of what the shell's aberrations add at e and trim (mm): a share of it, and out of focus all
    /// that it differs by from what it is in focus. Blur that is as large as what the aberrations make of it has a shape
    /// that no average over the window knows.
    #[must_use]
    pub fn excess_sigma_px(&self, e: f64, trim: f64) -> f64 {
        let excess = self.excess_px(e, trim);
        let in_focus = self.excess_px(e, trim + self.a_mm(e, trim) - self.design.mla.a());
        (self.aberrations_sigma * excess).hypot(excess - in_focus)
    }

    /// The spacing (px) that the estimator measures at e (mm) when Eq. 16 holds for rays near the axis.
    #[must_use]
    pub fn exact_target_px(&self, e: f64) -> f64 {
        self.design.mla.target_spacing() / self.pixel_mm + self.excess_px(e, 0.0)
    }

    /// The e (mm) at which the estimator measures this spacing (px) of the board in water.
    #[must_use]
    pub fn e_mm(&self, spacing_px: f64, trim: f64) -> f64 {
        let paraxial = |spacing_px| {
            let equivalent = self.design.main_lens.object_distance(self.image_distance_mm(spacing_px, trim));
            self.design.shell.e_from_equivalent(equivalent, self.design.object_distance)
        };
        let mut e = paraxial(spacing_px);
        for _ in 0..E_ROUNDS {
            if !e.is_finite() {
                break;
            }
            e = paraxial(spacing_px - self.excess_px(e, trim));
        }
        e
    }

    /// The distance (mm) from the lens of a board in air that has this spacing (px), and how it changes with the
    /// spacing (mm/px).
    #[must_use]
    pub fn air_distance_mm(&self, spacing_px: f64) -> (f64, f64) {
        let v = self.image_distance_mm(spacing_px, 0.0);
        let distance = self.design.main_lens.object_distance(v);
        // From Gauss, dL/dv = −(L / v)².
        let slope = -(distance / v).powi(2) / self.slope_a(v - self.lens_to_mla_mm);
        (distance, slope)
    }

    /// dl/da at a signed a (mm), px/mm: D b / a².
    fn slope_a(&self, a: f64) -> f64 {
        self.design.mla.pitch * self.mla_to_sensor_mm / (a * a) / self.pixel_mm
    }

    /// dl/de at e and trim (mm), px/mm.
    #[must_use]
    pub fn slope_e(&self, e: f64, trim: f64) -> f64 {
        let equivalent = self.design.shell.equivalent_distance(self.design.object_distance, e);
        let v = self.design.main_lens.image_distance(equivalent);
        // The equivalent distance grows with e one for one, and from Gauss dv/dL = −(v / L)².
        -self.slope_a(self.a_mm(e, trim)) * (v / equivalent).powi(2)
    }

    /// dl/dΔv at e and trim (mm), px/mm: the MLA moves towards the image.
    #[must_use]
    pub fn slope_delta_v(&self, e: f64, trim: f64) -> f64 {
        -self.slope_a(self.a_mm(e, trim))
    }

    /// The trim (mm) that takes one spacing (px) to another at an e, from a trim (mm) on: a, which is less by the trim, from
    /// both spacings, since over a trim that changes a by a part of itself no slope holds.
    #[must_use]
    pub fn trim_between(&self, from_px: f64, to_px: f64, e: f64, trim: f64) -> f64 {
        let a_mm = |spacing_px: f64, trim: f64| {
            let paraxial = (spacing_px - self.excess_px(e, trim)) * self.pixel_mm;
            mla::a_from_spacing(self.design.mla.pitch, paraxial, self.mla_to_sensor_mm)
        };
        let from = a_mm(from_px, trim);
        let mut by = 0.0;
        for _ in 0..=E_ROUNDS {
            by = from - a_mm(to_px, trim + by);
        }
        by
    }

    /// The tilt of the spacing (px per half frame width) that a board has whose distance changes by its own width, in water
    /// and in air, with the board in air where the one in water appears. `half_width_mm` is half the sensor's width.
    #[must_use]
    pub fn tilt_of_turned_board_px(&self, e: f64, trim: f64, half_width_mm: f64) -> [f64; 2] {
        let design = &self.design;
        let equivalent = design.shell.equivalent_distance(design.object_distance, e);
        let half_field_mm = half_width_mm * equivalent / design.main_lens.image_distance(equivalent);
        let along = design.shell.longitudinal_magnification(design.object_distance);
        // Across, the board is seen smaller or larger than along: m_along = m_across² / n.
        let across = (along * design.shell.n_water).sqrt();
        let slope = self.slope_e(e, trim);
        [slope * along * half_field_mm / across, slope * half_field_mm]
    }

    /// Standard uncertainty (mm) of the e that a spacing (px, with its sigma) gives: the spacing's, Δv's and the aberrations'
    /// share.
    #[must_use]
    pub fn e_sigma_mm(&self, e: f64, trim: f64, spacing_sigma_px: f64) -> f64 {
        let slope = self.slope_e(e, trim).abs();
        let by_delta_v = self.slope_delta_v(e, trim) * self.image_distance_sigma_mm;
        spacing_sigma_px.hypot(by_delta_v).hypot(self.excess_sigma_px(e, trim)) / slope
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// The preset as a perfect air step leaves it.
    pub(crate) fn preset() -> CalibratedCamera {
        let config = Config::default();
        let design = config.design();
        CalibratedCamera {
            design,
            lens_to_mla_mm: design.lens_to_mla(design.joint(0.0).delta_v),
            mla_to_sensor_mm: design.mla.b(),
            image_distance_sigma_mm: 0.0005,
            pixel_mm: config.pixel_pitch().millimetres(),
            window_px: None,
            aberrations_sigma: 0.0,
        }
    }

    #[test]
    fn the_window_sees_the_shells_aberrations() {
        let camera = CalibratedCamera { window_px: Some(9.0), ..preset() };
        // What optics.md has for a disc of 9 px at e = 0 is 0.017 px; the overlap of two discs is smaller.
        let excess = camera.excess_px(0.0, 0.0);
        assert!(excess > 0.005 && excess < 0.017, "{excess}");
        for e in [-0.1, 0.0, 5.0, 30.0] {
            let back = camera.e_mm(camera.spacing_px(e, 0.0), 0.0);
            assert!((back - e).abs() < 1e-5, "{e}: {back}");
        }
    }

    /// A lens of f/1 and 10 mm, behind a shell of 40 mm: what rendered frames show is within three of what is stated, in focus
    /// (by 0.16 of 13.4 px, of which a share is stated) and out of it.
    #[test]
    fn a_fast_lens_is_not_trusted_out_of_focus() {
        let mut config = Config::default();
        config.main_lens.focal_length_mm = 10.0;
        let (mla, shell) = (&mut config.mla, &mut config.shell);
        (mla.pitch_mm, mla.focal_length_mm, mla.angular_resolution) = (0.06, 0.12, 2.2);
        (config.sensor.pixel_um, config.object.distance_mm, config.object.air_distance_mm) = (2.4, 300.0, 300.0);
        (shell.outer_radius_mm, shell.inner_radius_mm, shell.refractive_index) = (40.0, 36.0, 1.52);
        let camera = CalibratedCamera::designed(&config, 0.0);
        for (e, seen_px, sigma_px) in [(3.435, 10.4187, 0.0384), (3.325, 10.5591, 0.0347), (0.325, 13.6609, 0.0030)] {
            let trim = -0.0009;
            let (shown, sigma) = (camera.e_mm(seen_px, trim), camera.e_sigma_mm(e, trim, sigma_px));
            assert!((shown - e).abs() < 3.0 * sigma, "{shown} ± {sigma} instead of {e}");
            assert!(sigma < 0.35, "{sigma}");
        }
    }

    #[test]
    fn the_preset_has_the_documented_slopes() {
        let camera = preset();
        assert!((camera.spacing_px(0.0, 0.0) - 19.724_962).abs() < 1e-5, "{}", camera.spacing_px(0.0, 0.0));
        assert!((camera.spacing_px(30.0, 0.0) - 12.68).abs() < 0.01);
        assert!((camera.slope_e(0.0, 0.0) + 0.16).abs() < 0.005);
        assert!((camera.slope_delta_v(0.0, 0.0) + 8.7).abs() < 0.1);
        assert!((camera.slope_e(30.0, 0.0) + 0.34).abs() < 0.01);
    }

    #[test]
    fn inverses_invert_and_slopes_are_the_differences() {
        let camera = preset();
        let h = 1e-4;
        for (e, trim) in [(0.0, 0.0), (12.0, 0.01), (30.0, -0.02)] {
            let spacing = camera.spacing_px(e, trim);
            assert!((camera.e_mm(spacing, trim) - e).abs() < 1e-9);
            let by_e = (camera.spacing_px(e + h, trim) - camera.spacing_px(e - h, trim)) / (2.0 * h);
            assert!((camera.slope_e(e, trim) / by_e - 1.0).abs() < 1e-6);
            let by_trim = (camera.spacing_px(e, trim + h) - camera.spacing_px(e, trim - h)) / (2.0 * h);
            assert!((camera.slope_delta_v(e, trim) / by_trim - 1.0).abs() < 1e-5);
            for by in [-0.15, 0.1] {
                let found = camera.trim_between(spacing, camera.spacing_px(e, trim + by), e, trim);
                assert!((found - by).abs() < 1e-6, "{found} for {by}");
            }
            let (near, far) = (camera.air_distance_mm(spacing - h), camera.air_distance_mm(spacing + h));
            let by_spacing = (far.0 - near.0) / (2.0 * h);
            assert!((camera.air_distance_mm(spacing).1 / by_spacing - 1.0).abs() < 1e-5);
        }
    }
}
