//! The main lens as a thin lens at its principal point M: the Gauss equation and f-numbers.

/// The main lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MainLens {
    /// f: focal length, mm, > 0.
    pub focal_length: f64,
}

impl MainLens {
    /// v (Gauss, as in Eqs. 8, 11, 17): image distance for an object at `object_distance` from M, mm; f for an object
    /// at infinity, negative for one nearer than f.
    #[must_use]
    pub fn image_distance(&self, object_distance: f64) -> f64 {
        1.0 / (1.0 / self.focal_length - 1.0 / object_distance)
    }

    /// The inverse of Gauss: object distance from M for an image distance, mm; infinite at f, negative (no real object)
    /// between 0 and f.
    #[must_use]
    pub fn object_distance(&self, image_distance: f64) -> f64 {
        1.0 / (1.0 / self.focal_length - 1.0 / image_distance)
    }

    /// The working f-number: image distance over aperture diameter, both mm (Section 2.2).
    #[must_use]
    pub fn working_f_number(image_distance: f64, aperture: f64) -> f64 {
        image_distance / aperture
    }

    /// The number on the lens's ring for an aperture diameter (mm): f / D_aper, not the working number.
    #[must_use]
    pub fn ring_f_number(&self, aperture: f64) -> f64 {
        self.focal_length / aperture
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_object_at_infinity_is_imaged_at_the_focal_length() {
        let lens = MainLens { focal_length: 20.0 };
        assert_eq!(lens.image_distance(f64::INFINITY), 20.0);
        assert_eq!(lens.object_distance(20.0), f64::INFINITY);
        // 1/20 = 1/40 + 1/40
        assert!((lens.image_distance(40.0) - 40.0).abs() < 1e-12);
        // The ring's number at the joint solution of the reference camera.
        assert!((lens.ring_f_number(6.364) - 3.143).abs() < 5e-4);
    }

    proptest! {
        #[test]
        fn gauss_inverts(focal_length in 5.0..200.0f64, ratio in 1.5..500.0f64) {
            let lens = MainLens { focal_length };
            let object = ratio * focal_length;
            prop_assert!((lens.object_distance(lens.image_distance(object)) / object - 1.0).abs() < 1e-9);
        }
    }
}
