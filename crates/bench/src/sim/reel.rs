//! Light traced once for a pose and shown again: how the simulated camera keeps pace with an axis in motion.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use super::picture::{Light, Moment};
use super::truth::Pose;
use crate::config::ReelConfig;

/// Far below what any picture shows, far above what sums are rounded by, mm.
const RESOLUTION_MM: f64 = 1e-9;

/// Light by the pose, each a whole step of Δv from the next.
pub(super) struct Reel {
    step_mm: f64,
    most: usize,
    /// The one that was made longest ago first.
    kept: Mutex<VecDeque<Light>>,
}

impl Reel {
    /// The reel that is configured; none where poses are not rounded.
    pub(super) fn new(config: &ReelConfig) -> Option<Self> {
        let most = usize::try_from(config.poses).unwrap_or(usize::MAX);
        (config.step_um > 0.0).then(|| Self { step_mm: config.step_um / 1000.0, most, kept: Mutex::default() })
    }

    /// A pose with its Δv at the nearest step. All poses near a step become the same to the last bit.
    pub(super) fn nearest(&self, pose: &Pose) -> Pose {
        let delta_v_mm = (pose.delta_v_mm / self.step_mm).round() * self.step_mm;
        let at_zero = ((pose.lens_to_mla_mm - pose.delta_v_mm) / RESOLUTION_MM).round() * RESOLUTION_MM;
        Pose { delta_v_mm, lens_to_mla_mm: at_zero + delta_v_mm, ..*pose }
    }

    /// The light of a moment, made where it is not kept.
    pub(super) fn light(&self, moment: &Moment, make: impl FnOnce() -> Vec<f32>) -> Arc<Vec<f32>> {
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(light) = kept().iter().find(|light| light.moment == *moment) {
            return Arc::clone(&light.irradiance);
        }
        let irradiance = Arc::new(make());
        let mut kept = kept();
        kept.push_back(Light { moment: *moment, irradiance: Arc::clone(&irradiance) });
        while kept.len() > self.most {
            kept.pop_front();
        }
        irradiance
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::device::faults::Faults;
    use crate::sim::truth::Truth;

    #[test]
    fn the_light_of_a_step_is_made_once_while_it_is_kept() {
        let reel = Reel::new(&ReelConfig { step_um: 10.0, poses: 2 }).unwrap();
        let pose = Truth::new(&Arc::new(Config::default())).pose();
        let at = |delta_v_mm: f64| {
            let moved = Pose { delta_v_mm, lens_to_mla_mm: pose.lens_to_mla_mm + delta_v_mm - pose.delta_v_mm, ..pose };
            let near = reel.nearest(&moved);
            assert!((near.delta_v_mm - delta_v_mm).abs() < 0.005 + 1e-9);
            assert!((near.lens_to_mla_mm - near.delta_v_mm - pose.lens_to_mla_mm + pose.delta_v_mm).abs() < 1e-9);
            Moment::of(&near, &near, &Faults::default())
        };
        let light = |delta_v_mm: f64, made: f32| reel.light(&at(delta_v_mm), || vec![made])[0];
        assert_eq!([light(0.1, 1.0), light(0.1049, 2.0), light(0.0951, 3.0)], [1.0; 3]);
        assert_eq!([light(0.1051, 4.0), light(0.1, 5.0)], [4.0, 1.0]);
        let of_one_step: Vec<Moment> = (0..100).map(|nth| at(0.3 + 0.00004 * f64::from(nth))).collect();
        assert!(of_one_step.iter().all(|moment| *moment == of_one_step[0]));
        // A third takes the place of the first.
        assert_eq!([light(0.2, 6.0), light(0.11, 7.0), light(0.1, 8.0)], [6.0, 4.0, 8.0]);
        assert!(Reel::new(&ReelConfig::default()).is_none());
    }
}
