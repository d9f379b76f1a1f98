//! How a design's figures change with e and with the object distance: what its curves are drawn from.

use super::CameraDesign;

/// What a camera comes to at one e, with Δv re-optimised for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AtE {
    /// e, mm.
    pub e: f64,
    /// Δv in focus (Eq. 8), mm; `None` where the object appears within the focal length.
    pub delta_v: Option<f64>,
    /// Field of view in water over the sensor's width, rad; `None` likewise, and where the edge ray brings no light.
    pub fov_water: Option<f64>,
}

impl CameraDesign {
    /// Δv and field of view over e from `low` to `high` (mm), at `count` places at even distances; `width` is the
    /// sensor's (mm).
    #[must_use]
    pub fn over_e(&self, width: f64, low: f64, high: f64, count: usize) -> Vec<AtE> {
        let at = |step: usize| {
            let e = low + (high - low) * step as f64 / count.saturating_sub(1).max(1) as f64;
            let equivalent = self.shell.equivalent_distance(self.object_distance, e);
            let delta_v = (equivalent > self.main_lens.focal_length).then(|| self.delta_v_for_equivalent(equivalent));
            let fov_water = delta_v.and_then(|delta_v| self.fov_in_water(width, delta_v, e));
            AtE { e, delta_v, fov_water }
        };
        (0..count).map(at).collect()
    }
}

/// `count` object distances (mm) about `distance`, from a part of it to a multiple, `factor`, at even ratios.
#[must_use]
pub fn distances_about(distance: f64, factor: f64, count: usize) -> Vec<f64> {
    let steps = count.saturating_sub(1).max(1) as f64;
    (0..count).map(|step| distance * factor.powf(2.0 * step as f64 / steps - 1.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::tests::reference_camera;

    #[test]
    fn the_curves_pass_through_the_solutions() {
        let camera = reference_camera();
        let curve = camera.over_e(4.002, -10.0, 30.0, 41);
        assert_eq!((curve.len(), curve[0].e, curve[40].e), (41, -10.0, 30.0));
        for (index, e) in [(10, 0.0), (40, 30.0)] {
            let solution = camera.clarity(e);
            assert!((curve[index].delta_v.unwrap() - solution.delta_v).abs() < 1e-12);
            assert_eq!(curve[index].fov_water, camera.fov_in_water(4.002, solution.delta_v, e));
        }
        // Further back, the lens sees the object further away and a wider field.
        assert!(
            curve.windows(2).all(|pair| pair[1].delta_v < pair[0].delta_v && pair[1].fov_water > pair[0].fov_water)
        );
    }

    #[test]
    fn where_nothing_is_imaged_the_curves_have_gaps() {
        let curve = reference_camera().over_e(4.002, -200.0, 0.0, 3);
        assert_eq!((curve[0].delta_v, curve[0].fov_water), (None, None));
        assert!(curve[2].delta_v.is_some());
    }

    #[test]
    fn distances_lie_about_the_one_given() {
        let distances = distances_about(800.0, 4.0, 5);
        for (found, expected) in distances.iter().zip([200.0, 400.0, 800.0, 1600.0, 3200.0]) {
            assert!((found - expected).abs() < 1e-9, "{distances:?}");
        }
    }
}
