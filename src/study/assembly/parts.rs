//! One assembly: its parts drawn by its seed, and its blur as built and aligned.

use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;

use crate::optics::mla::a_from_spacing;
use crate::optics::{CameraDesign, MainLens, water};

/// A part or setting that varies: its name, unit and standard deviation.
pub(super) struct Tolerance {
    pub(super) name: &'static str,
    pub(super) unit: &'static str,
    pub(super) sigma: f64,
}

/// What varies, in the order in which [`Parts`] draws it.
pub(super) const TOLERANCES: [Tolerance; 10] = [
    Tolerance { name: "focal length of the main lens", unit: "%", sigma: 0.5 },
    Tolerance { name: "focal length of the microlenses", unit: "%", sigma: 0.5 },
    Tolerance { name: "distance b from MLA to sensor", unit: "µm", sigma: 1.5 },
    Tolerance { name: "outer radius of the shell", unit: "mm", sigma: 0.1 },
    Tolerance { name: "thickness of the shell", unit: "mm", sigma: 0.05 },
    Tolerance { name: "index of the shell", unit: "", sigma: 0.002 },
    Tolerance { name: "temperature of the water", unit: "°C", sigma: 3.0 },
    Tolerance { name: "distance of the object", unit: "mm", sigma: 3.0 },
    Tolerance { name: "distance d as built", unit: "mm", sigma: 0.05 },
    Tolerance { name: "e as built", unit: "mm", sigma: 0.3 },
];

/// Standard deviations of what the loops leave: Δv (mm) and e's spacing (px).
pub(super) const LEFT_DELTA_V_MM: f64 = 0.0015;
pub(super) const LEFT_SPACING_PX: f64 = 0.006;

/// Further than this from its design e is not moved: Δv is what is off, and is trimmed.
const MOST_E_CHANGE_MM: f64 = 0.6;

/// One assembly.
pub(super) struct Parts {
    design: CameraDesign,
    /// b as built, mm.
    b: f64,
    d_error: f64,
    e_error: f64,
    /// Errors that the loops leave: Δv's (mm) and the spacing's (px).
    left: [f64; 2],
}

impl Parts {
    /// The parts of a seed, each off by its tolerance; or only one of them.
    pub(super) fn draw(design: &CameraDesign, seed: u64, only: Option<usize>) -> Self {
        let mut random = Pcg64::seed_from_u64(seed ^ 0xa55e_3b1e);
        let mut normal = |sigma: f64| Normal::new(0.0, sigma).map_or(0.0, |law| law.sample(&mut random));
        let drawn: Vec<f64> = TOLERANCES.iter().map(|tolerance| normal(tolerance.sigma)).collect();
        let of = |k: usize| if only.is_none_or(|only| only == k) { drawn[k] } else { 0.0 };
        let left = [normal(LEFT_DELTA_V_MM), normal(LEFT_SPACING_PX)];
        let mut built = *design;
        built.main_lens = MainLens { focal_length: design.main_lens.focal_length * (1.0 + of(0) / 100.0) };
        built.mla.focal_length *= 1.0 + of(1) / 100.0;
        built.shell.outer_radius += of(3);
        built.shell.inner_radius += of(3) - of(4);
        built.shell.n_shell += of(5);
        let index = |temperature: f64| water::refractive_index(temperature, 0.0, 550.0).unwrap_or(f64::NAN);
        built.shell.n_water += index((20.0 + of(6)).clamp(0.0, 30.0)) - index(20.0);
        built.object_distance += of(7);
        Self { design: built, b: design.mla.b() + of(2) / 1000.0, d_error: of(8), e_error: of(9), left }
    }

    /// The same parts, with loops that leave nothing.
    pub(super) const fn with_nothing_left(self) -> Self {
        Self { left: [0.0; 2], ..self }
    }

    /// δ (mm): the blur of the object with the MLA `lens_to_mla` from the lens and the lens at e.
    fn blur(&self, lens_to_mla: f64, e: f64) -> f64 {
        let design = &self.design;
        let equivalent = design.shell.equivalent_distance(design.object_distance, e);
        let a = design.main_lens.image_distance(equivalent) - lens_to_mla;
        let focus = design.mla.focus_distance(a);
        design.mla.pitch * (focus - self.b).abs() / focus
    }

    /// Blur as built, mm: Δv and e as designed, off by what a ruler and a readback leave.
    pub(super) fn as_built(&self, nominal: &CameraDesign, l_bound: f64) -> f64 {
        let joint = nominal.joint(l_bound);
        self.blur(nominal.lens_to_mla(joint.delta_v) + self.d_error, joint.e + self.e_error)
    }

    /// Blur after both loops, mm: Δv brought to its target by calibration, then e (held at the wall: the image distance) until
    /// the spacing meets Eq. 16. Only what the loops can see is adjusted: they know the design's b and N.
    pub(super) fn aligned(&self, nominal: &CameraDesign, l_bound: f64, pixel: f64) -> f64 {
        let joint = nominal.joint(l_bound);
        let design = &self.design;
        let lens_to_mla = nominal.lens_to_mla(joint.delta_v) + self.left[0];
        let target = nominal.mla.target_spacing() + self.left[1] * pixel;
        // The image the criterion asks for, by the parts as they are.
        let a = a_from_spacing(design.mla.pitch, target, self.b);
        let wanted = design.main_lens.object_distance(lens_to_mla + a);
        let e = design.shell.e_from_equivalent(wanted, design.object_distance);
        if e >= l_bound && (e - joint.e).abs() <= MOST_E_CHANGE_MM {
            return self.blur(lens_to_mla, e);
        }
        let equivalent = design.shell.equivalent_distance(design.object_distance, joint.e);
        let trimmed = design.main_lens.image_distance(equivalent) - a;
        self.blur(trimmed, joint.e)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::optics::mla::spacing;

    #[test]
    fn perfect_parts_are_sharp_either_way() {
        let config = Config::default();
        let design = config.design();
        let perfect = Parts { design, b: design.mla.b(), d_error: 0.0, e_error: 0.0, left: [0.0; 2] };
        assert!(perfect.as_built(&design, 0.0) < 1e-9);
        assert!(perfect.aligned(&design, 0.0, 0.003_45) < 1e-9);
    }

    #[test]
    fn the_loops_mend_the_lens_but_not_the_array() {
        let design = Config::default().design();
        let rms = |only: usize| {
            let blurs = |k: u64| {
                let parts = Parts::draw(&design, k, Some(only)).with_nothing_left();
                [parts.as_built(&design, 0.0), parts.aligned(&design, 0.0, 0.003_45)]
            };
            let sums = (0..200).map(blurs).fold([0.0; 2], |sums, b| [sums[0] + b[0] * b[0], sums[1] + b[1] * b[1]]);
            sums.map(|sum: f64| (sum / 200.0).sqrt())
        };
        let [built, aligned] = rms(0);
        assert!(built > 0.001 && aligned < 0.01 * built, "f of the main lens: {built} {aligned}");
        let [built, aligned] = rms(2);
        assert!(aligned > 0.3 * built, "b: {built} {aligned}");
        // b off by itself: what the criterion makes of it, straight from Eqs. 6, 9 and 19.
        let mla = design.mla;
        let b = mla.b() + 0.001;
        let a = a_from_spacing(mla.pitch, mla.target_spacing(), b);
        assert!((spacing(mla.pitch, a, b) - mla.target_spacing()).abs() < 1e-12);
        let parts = Parts { design, b, d_error: 0.0, e_error: 0.0, left: [0.0; 2] };
        let expected = mla.pitch * (mla.focus_distance(a) - b).abs() / mla.focus_distance(a);
        assert!((parts.aligned(&design, 0.0, 0.003_45) - expected).abs() < 1e-9);
    }
}
