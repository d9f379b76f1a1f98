//! The chapter of the assemblies, of the blurs of all.

use super::parts::{LEFT_DELTA_V_MM, LEFT_SPACING_PX, Parts, TOLERANCES};
use super::{Blur, seed};
use crate::config::Config;
use crate::study::chapter::{Chapter, Chart, Curve, Finding, Table};

/// Assemblies that show what a tolerance alone does, at the most.
const SINGLE: usize = 4000;

/// The chapter of a study's seed; the blurs are in the order of the assemblies' indices.
pub(super) fn chapter(config: &Config, study_seed: u64, blurs: &[Blur]) -> Chapter {
    let design = config.design();
    let pixel = config.pixel_pitch().millimetres();
    let limit = config.blur_limit().value();
    let l_bound = config.assembly.l_bound_mm;
    let count = blurs.len();
    let mut blurs: Vec<[f64; 2]> = blurs.iter().map(|blur| [blur.as_built_mm, blur.aligned_mm]).collect();
    let share = |stage: usize| blurs.iter().filter(|blur| blur[stage] <= limit).count() as f64 / count as f64;
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
    let single = count.min(SINGLE) as u64;
    for (k, tolerance) in TOLERANCES.iter().enumerate() {
        let (mut built, mut aligned) = (0.0, 0.0);
        for n in 0..single {
            let parts = Parts::draw(&design, seed(study_seed, n), Some(k)).with_nothing_left();
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
    chapter
}
