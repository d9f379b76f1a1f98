//! The shell off the lens's axis: where the board then appears to be, by exact rays.
//!
//! A shell whose centre C is beside the axis acts as a weak prism with astigmatism. To first order the board's image tilts,
//! to second order it comes nearer: the one is seen in the picture, the other is an error of e that looks like none.

use nalgebra::Vector3;

use super::trace::Ray;
use super::{CameraDesign, Shell};

/// Half the distance of the rays that an image is told from, mm in the main lens's plane.
const BESIDE_MM: f64 = 1e-3;
/// The same of their slopes.
const SLOPE: f64 = 1e-5;

impl Shell {
    /// Distance (mm from M, along the lens's axis) of the image of what lies on a board at `object_distance` (mm from O),
    /// seen from M with a slope dx/dz, C being `decentre` (mm) off the axis along x: the mean of the tangential and the
    /// sagittal image. With neither decentre nor slope it is Eq. 5's equivalent distance. e in mm.
    ///
    /// `None` where no light comes that way.
    fn apparent_distance(&self, object_distance: f64, e: f64, decentre: f64, slope: f64) -> Option<f64> {
        let board = e + self.outer_radius + object_distance;
        // From M the shell's axis is at x = `decentre`; in the shell's own frame it is M that is beside.
        let meets = |beside: [f64; 2], slopes: [f64; 2]| {
            let ray = Ray::from_slopes(Vector3::new(beside[0] - decentre, beside[1], 0.0), slopes[0], slopes[1]);
            self.trace(&ray, e)?.at_plane(board)
        };
        // Two rays of one point of the board cross where X stays: X_h dh + X_s ds = 0, and the image is at −dh/ds.
        let image = |across: usize| {
            let mut unit = [0.0; 2];
            unit[across] = 1.0;
            let by = |beside: f64, slopes: f64| {
                let slopes = [slope + slopes * unit[0], slopes * unit[1]];
                Some(meets(unit.map(|part| beside * part), slopes)?[across])
            };
            let by_beside = (by(BESIDE_MM, 0.0)? - by(-BESIDE_MM, 0.0)?) / (2.0 * BESIDE_MM);
            let by_slope = (by(0.0, SLOPE)? - by(0.0, -SLOPE)?) / (2.0 * SLOPE);
            Some(by_slope / by_beside)
        };
        Some((image(0)? + image(1)?) / 2.0)
    }
}

/// What a decentred shell does to the board's image at one pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decentring {
    /// How far the image comes towards the lens for a decentre, mm for a mm², negative where it recedes.
    pub nearer: f64,
    /// How far the image's distance changes with the slope dx/dz of the line of sight for a decentre along x, mm for a mm.
    pub tilt: f64,
}

impl CameraDesign {
    /// What a decentred shell does at e (mm). `None` where no light comes that way.
    #[must_use]
    pub fn decentring(&self, e: f64) -> Option<Decentring> {
        // Small against the radii, large against what rounding leaves of a square.
        let decentre = 0.01 * self.shell.inner_radius;
        let slope = 0.01;
        let image = |decentre, slope| self.shell.apparent_distance(self.object_distance, e, decentre, slope);
        Some(Decentring {
            nearer: (image(0.0, 0.0)? - image(decentre, 0.0)?) / (decentre * decentre),
            tilt: (image(decentre, slope)? - image(decentre, -slope)?) / (2.0 * slope * decentre),
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::optics::tests::reference_camera;

    #[test]
    fn on_the_axis_it_is_the_equivalent_distance() {
        let camera = reference_camera();
        for e in [0.0, 10.0, 30.0] {
            let exact = camera.shell.apparent_distance(camera.object_distance, e, 0.0, 0.0).unwrap();
            let paraxial = camera.shell.equivalent_distance(camera.object_distance, e);
            assert!((exact / paraxial - 1.0).abs() < 1e-5, "{e}: {exact} {paraxial}");
        }
    }

    #[test]
    fn a_decentred_shell_tilts_the_image_and_brings_it_nearer() {
        let camera = reference_camera();
        let at = camera.decentring(0.0).unwrap();
        // Twice the decentre: twice the tilt, four times the way nearer.
        let image = |decentre: f64, slope: f64| {
            camera.shell.apparent_distance(camera.object_distance, 0.0, decentre, slope).unwrap()
        };
        let nearer = image(0.0, 0.0) - image(1.0, 0.0);
        assert!((nearer / at.nearer - 1.0).abs() < 0.01, "{nearer} {at:?}");
        let tilt = (image(-1.0, 0.02) - image(-1.0, -0.02)) / 0.04;
        assert!((tilt / -at.tilt - 1.0).abs() < 0.01, "{tilt} {at:?}");
    }
}
