//! The spherical shell, paraxially: Eqs. 1–5 and their inverses.

/// Refractive index of air, to which every other index here is relative.
pub const N_AIR: f64 = 1.0;

/// A concentric spherical shell between water and air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shell {
    /// l_OC: radius of the outer surface, mm.
    pub outer_radius: f64,
    /// l_O'C: radius of the inner surface, mm.
    pub inner_radius: f64,
    /// Refractive index of the shell, relative to air.
    pub n_shell: f64,
    /// Refractive index of the water outside, relative to air.
    pub n_water: f64,
}

impl Shell {
    /// l_O'O: the shell's thickness, mm.
    #[must_use]
    pub fn thickness(&self) -> f64 {
        self.outer_radius - self.inner_radius
    }

    /// l_O'A'' (Eq. 4): distance from the inner vertex O' to the virtual image of an on-axis object in water, mm,
    /// positive towards the water. `object_distance` is measured from the outer vertex O, mm; zero and infinity are
    /// allowed, and so is a thickness of zero.
    #[must_use]
    pub fn virtual_image_distance(&self, object_distance: f64) -> f64 {
        // Eqs. 1-3 joined as reciprocals: n_s / l_OA' (Eq. 1) may be zero and is never divided into on the way.
        let outer_vergence = self.outer_vergence(object_distance);
        let inner_power = (N_AIR - self.n_shell) / self.inner_radius;
        let inner_vergence = self.n_shell / (self.n_shell / outer_vergence - self.thickness());
        -N_AIR / (inner_power + inner_vergence)
    }

    /// n_s / l_OA' (Eq. 1), 1/mm.
    fn outer_vergence(&self, object_distance: f64) -> f64 {
        (self.n_shell - self.n_water) / self.outer_radius - self.n_water / object_distance
    }

    /// How much the virtual image recedes for a millimetre that the object recedes: d l_O'A'' / d d_OBJ at
    /// `object_distance` (mm from O), dimensionless and positive. It is also d l_A''M / d d_OBJ, since e is held.
    #[must_use]
    pub fn longitudinal_magnification(&self, object_distance: f64) -> f64 {
        let image = self.virtual_image_distance(object_distance);
        let through_shell = self.n_shell / (self.n_shell - self.thickness() * self.outer_vergence(object_distance));
        (image * through_shell / object_distance).powi(2) * self.n_water / N_AIR
    }

    /// The inverse of Eq. 4: distance in water from O to the object whose virtual image lies `virtual_image_distance`
    /// (mm) before O'. Infinite or negative where no real object in the water gives that image.
    #[must_use]
    pub fn object_distance_from_virtual(&self, virtual_image_distance: f64) -> f64 {
        let inner_power = (N_AIR - self.n_shell) / self.inner_radius;
        // n_s / l_O'A' from Eq. 3, then l_OA' = l_O'A' + thickness, then Eq. 1 solved for d_OBJ.
        let inner_vergence = -N_AIR / virtual_image_distance - inner_power;
        let outer_vergence = self.n_shell / (self.n_shell / inner_vergence + self.thickness());
        self.n_water / ((self.n_shell - self.n_water) / self.outer_radius - outer_vergence)
    }

    /// l_A''M (Eq. 5): equivalent object distance from the main lens's principal point M, mm.
    #[must_use]
    pub fn equivalent_distance(&self, object_distance: f64, e: f64) -> f64 {
        self.virtual_image_distance(object_distance) + self.inner_radius + e
    }

    /// The inverse of Eq. 5: object distance in water from O, mm, for an equivalent distance and e.
    #[must_use]
    pub fn object_distance(&self, equivalent_distance: f64, e: f64) -> f64 {
        self.object_distance_from_virtual(equivalent_distance - self.inner_radius - e)
    }

    /// The e (mm) at which an object at `object_distance` has this equivalent distance: Eq. 5 solved for e, which is
    /// also Eq. 12 for l_bound when the equivalent distance was measured with the lens against the shell.
    #[must_use]
    pub fn e_from_equivalent(&self, equivalent_distance: f64, object_distance: f64) -> f64 {
        equivalent_distance - self.inner_radius - self.virtual_image_distance(object_distance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn reference() -> Shell {
        Shell { outer_radius: 59.0, inner_radius: 51.0, n_shell: 1.49, n_water: 1.333 }
    }

    /// Eq. 4 as printed: finite object distances only.
    fn printed(shell: &Shell, d: f64) -> f64 {
        let image = shell.n_shell / ((shell.n_shell - shell.n_water) / shell.outer_radius - shell.n_water / d);
        -N_AIR / ((N_AIR - shell.n_shell) / shell.inner_radius + shell.n_shell / (image - shell.thickness()))
    }

    #[test]
    fn the_closed_form_is_the_printed_chain() {
        for distance in [1.0, 100.0, 300.0, 800.0, 5000.0] {
            let (closed, chain) = (reference().virtual_image_distance(distance), printed(&reference(), distance));
            assert!((closed / chain - 1.0).abs() < 1e-12, "{distance}: {closed} {chain}");
        }
    }

    #[test]
    fn it_is_finite_where_the_first_image_is_not() {
        // Eq. 1 has its pole where n_w / d_OBJ = (n_s - n_w) / l_OC.
        let shell = reference();
        let pole = shell.n_water * shell.outer_radius / (shell.n_shell - shell.n_water);
        let (at, beside) = (shell.virtual_image_distance(pole), shell.virtual_image_distance(pole * (1.0 + 1e-9)));
        assert!((at / beside - 1.0).abs() < 1e-8, "{at} {beside}");
        let (far, infinite) = (shell.virtual_image_distance(1e12), shell.virtual_image_distance(f64::INFINITY));
        assert!((far / infinite - 1.0).abs() < 1e-9 && infinite > 0.0, "{far} {infinite}");
        // An object on the shell is seen through the glass alone.
        let touching = shell.virtual_image_distance(0.0);
        assert!(touching > 0.0 && touching < shell.thickness(), "{touching}");
    }

    proptest! {
        #[test]
        fn inverses_invert(
            inner in 20.0..200.0f64, thickness in 0.5..20.0f64, n_shell in 1.3..1.8f64, n_water in 1.3..1.4f64,
            distance in 50.0..5000.0f64, e in -15.0..60.0f64,
        ) {
            let shell = Shell { outer_radius: inner + thickness, inner_radius: inner, n_shell, n_water };
            let equivalent = shell.equivalent_distance(distance, e);
            prop_assert!((shell.object_distance(equivalent, e) / distance - 1.0).abs() < 1e-9);
            prop_assert!((shell.e_from_equivalent(equivalent, distance) - e).abs() < 1e-9);
        }

        #[test]
        fn a_thin_shell_is_one_surface_between_water_and_air(
            radius in 20.0..200.0f64, n_shell in 1.3..1.8f64, n_water in 1.3..1.4f64, distance in 50.0..5000.0f64,
        ) {
            let shell = Shell { outer_radius: radius, inner_radius: radius, n_shell, n_water };
            let image = shell.virtual_image_distance(distance);
            // One refracting sphere: n_a / s' = (n_a - n_w) / R - n_w / d, with s' = -image.
            let single = -N_AIR / ((N_AIR - n_water) / radius - n_water / distance);
            prop_assert!((image / single - 1.0).abs() < 1e-12);
        }

        #[test]
        fn an_infinite_radius_is_a_flat_port(
            thickness in 0.0..20.0f64, n_shell in 1.3..1.8f64, n_water in 1.3..1.4f64, distance in 50.0..5000.0f64,
        ) {
            let shell = Shell { outer_radius: 1e12 + thickness, inner_radius: 1e12, n_shell, n_water };
            // Every layer appears as thick as its thickness over its index.
            let flat = distance / n_water + shell.thickness() / n_shell;
            prop_assert!((shell.virtual_image_distance(distance) / flat - 1.0).abs() < 1e-7);
        }

        #[test]
        fn water_like_air_leaves_a_thin_shell_without_power(
            radius in 20.0..200.0f64, n_shell in 1.3..1.8f64, distance in 50.0..5000.0f64,
        ) {
            let shell = Shell { outer_radius: radius, inner_radius: radius, n_shell, n_water: N_AIR };
            prop_assert!((shell.virtual_image_distance(distance) / distance - 1.0).abs() < 1e-12);
            prop_assert!((shell.longitudinal_magnification(distance) - 1.0).abs() < 1e-12);
        }

        #[test]
        fn a_glass_of_air_leaves_only_the_water(
            inner in 20.0..200.0f64, thickness in 0.0..20.0f64, n_water in 1.3..1.4f64, distance in 50.0..5000.0f64,
        ) {
            let shell = Shell { outer_radius: inner + thickness, inner_radius: inner, n_shell: N_AIR, n_water };
            let single = -N_AIR / ((N_AIR - n_water) / shell.outer_radius - n_water / distance);
            prop_assert!((shell.virtual_image_distance(distance) / (single + thickness) - 1.0).abs() < 1e-12);
        }

        #[test]
        fn longitudinal_magnification_is_the_slope(distance in 50.0..5000.0f64) {
            let shell = reference();
            let h = distance * 1e-4;
            let slope = (shell.virtual_image_distance(distance + h) - shell.virtual_image_distance(distance - h)) / (2.0 * h);
            prop_assert!((slope / shell.longitudinal_magnification(distance) - 1.0).abs() < 1e-6);
        }
    }
}
