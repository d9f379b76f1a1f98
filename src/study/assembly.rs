//! Tolerances of parts: how many assemblies meet the blur limit as built, and how many after both loops.

use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;
use rayon::prelude::*;

use super::chapter::{Chapter, Chart, Curve, Finding, Table};
use super::{Desk, StudyError};
use crate::optics::mla::a_from_spacing;
use crate::optics::{CameraDesign, MainLens, water};

/// A part or setting that varies: its name, unit and standard deviation.
struct Tolerance {
    name: &'static str,
    unit: &'static str,
    sigma: f64,
}

/// What varies, in the order in which [`Parts`] draws it.
const TOLERANCES: [Tolerance; 10] = [
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
const LEFT_DELTA_V_MM: f64 = 0.0015;
const LEFT_SPACING_PX: f64 = 0.006;

/// One assembly.
struct Parts {
    design: CameraDesign,
    /// b as built, mm.
    b: f64,
    d_error: f64,
    e_error: f64,
    left: [f64; 2],
}

impl Parts {
    fn draw(design: &CameraDesign, seed: u64, only: Option<usize>) -> Self {
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

    /// δ (mm): the blur of the object with the MLA `lens_to_mla` from the lens and the lens at e.
    fn blur(&self, lens_to_mla: f64, e: f64) -> f64 {
        let design = &self.design;
        let equivalent = design.shell.equivalent_distance(design.object_distance, e);
        let a = design.main_lens.image_distance(equivalent) - lens_to_mla;
        let focus = design.mla.focus_distance(a);
        design.mla.pitch * (focus - self.b).abs() / focus
    }

    /// Blur as built: Δv and e as designed, off by what a ruler and a readback leave.
    fn as_built(&self, nominal: &CameraDesign, l_bound: f64) -> f64 {
        let joint = nominal.joint(l_bound);
        self.blur(nominal.lens_to_mla(joint.delta_v) + self.d_error, joint.e + self.e_error)
    }

    /// Blur after both loops: Δv brought to its target by calibration, then e (held at the wall: the image distance) until
    /// the spacing meets Eq. 16. Only what the loops can see is adjusted: they know the design's b and N.
    fn aligned(&self, nominal: &CameraDesign, l_bound: f64, pixel: f64) -> f64 {
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

/// Further than this from its design e is not moved: Δv is what is off, and is trimmed.
const MOST_E_CHANGE_MM: f64 = 0.6;

/// Makes the chapter.
pub(super) fn write(desk: &Desk<'_>) -> Result<Chapter, StudyError> {
    let config = desk.config;
    let design = config.design();
    let pixel = config.pixel_pitch().millimetres();
    let limit = config.blur_limit().value();
    let l_bound = config.assembly.l_bound_mm;
    let count: u64 = if desk.options.quick { 4000 } else { 200_000 };
    let seed = |k: u64| desk.options.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(k);
    let chunks = 50;
    let finished = std::sync::atomic::AtomicU64::new(0);
    let mut blurs: Vec<[f64; 2]> = (0..chunks)
        .into_par_iter()
        .flat_map_iter(|chunk| {
            let part: Vec<[f64; 2]> = (chunk * count / chunks..(chunk + 1) * count / chunks)
                .map(|k| {
                    let parts = Parts::draw(&design, seed(k), None);
                    [parts.as_built(&design, l_bound), parts.aligned(&design, l_bound, pixel)]
                })
                .collect();
            desk.watch.done(finished.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1, chunks);
            part
        })
        .collect();
    let share = |stage: usize| blurs.iter().filter(|blur| blur[stage] <= limit).count() as f64 / blurs.len() as f64;
    let yields = [share(0), share(1)];

    let mut chapter = Chapter::default();
    chapter.text.push(format!(
        "{count} assemblies with parts drawn from normal laws, each judged by its blur on the axis at the object against \
         the limit of {} px. As built means Δv and e set by ruler and readback; aligned means both loops run to their end, \
         with what these leave (Δv {} µm, spacing {LEFT_SPACING_PX} px). The loops know the design's b and N only: what they \
         cannot mend is an MLA whose own focus is elsewhere.",
        config.assembly.blur_limit_px,
        1000.0 * LEFT_DELTA_V_MM,
    ));
    chapter.findings.push(Finding::new(
        "yield: assemblies within the blur limit",
        format!("{:.1} % as built, {:.1} % aligned", 100.0 * yields[0], 100.0 * yields[1]),
        "the paper aligns one camera; production aligns many",
    ));
    let mut table = Table::new(
        "tolerances",
        "What each tolerance alone does to the blur",
        &["part", "standard deviation", "blur as built, rms px", "blur aligned, rms px"],
    );
    let single = count.min(4000);
    for (k, tolerance) in TOLERANCES.iter().enumerate() {
        let (mut built, mut aligned) = (0.0, 0.0);
        for n in 0..single {
            let parts = Parts { left: [0.0; 2], ..Parts::draw(&design, seed(n), Some(k)) };
            built += (parts.as_built(&design, l_bound) / pixel).powi(2);
            aligned += (parts.aligned(&design, l_bound, pixel) / pixel).powi(2);
        }
        let rms = |sum: f64| (sum / single as f64).sqrt();
        table.push([
            tolerance.name.to_owned(),
            format!("{} {}", tolerance.sigma, tolerance.unit).trim().to_owned(),
            format!("{:.3}", rms(built)),
            format!("{:.3}", rms(aligned)),
        ]);
    }
    chapter.tables.push(table);
    let curve = |name: &str, stage: usize, blurs: &mut Vec<[f64; 2]>| {
        blurs.sort_unstable_by(|a, b| a[stage].total_cmp(&b[stage]));
        let of = |percent: usize| blurs[(blurs.len() - 1) * percent / 100][stage] / pixel;
        Curve::line(name, (0..=98).map(|percent| [of(percent), percent as f64]).collect())
    };
    let curves = vec![curve("as built", 0, &mut blurs), curve("aligned", 1, &mut blurs)];
    chapter.charts.push(Chart {
        name: "yield".to_owned(),
        title: "Share of assemblies within a blur limit".to_owned(),
        x: "blur limit, px".to_owned(),
        y: "assemblies within it, %".to_owned(),
        curves,
    });
    Ok(chapter)
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
                let parts = Parts { left: [0.0; 2], ..Parts::draw(&design, k, Some(only)) };
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
