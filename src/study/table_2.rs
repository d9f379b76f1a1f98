//! Table 2: Δv and e of the four cases, and what the table says about a camera whose Table 1 is not printed.

use super::case::cases;
use super::chapter::{Chapter, Chart, Curve, Finding, Table};
use super::{Desk, StudyError};
use crate::optics::{MainLens, Shell};

/// Δv of the clarity (e = 30) and the joint (e = 0) case as printed, mm, and half of their last digit.
const PRINTED: [f64; 2] = [1.745, 2.205];
const HALF_DIGIT: f64 = 0.0005;
/// e of the two printed cases, mm.
const PRINTED_E: [f64; 2] = [30.0, 0.0];
/// d_OBJ of the paper, mm.
const OBJECT: f64 = 800.0;

/// Makes the chapter.
pub(super) fn write(desk: &Desk<'_>) -> Result<Chapter, StudyError> {
    let config = desk.config;
    let design = config.design();
    let mut chapter = Chapter::default();
    let mut table = Table::new(
        "cases",
        "The four cases: the paper's values and ours",
        &["case", "Δv, paper, mm", "Δv, mm", "e, paper, mm", "e, mm", "l_A''M, mm", "aperture, mm"],
    );
    let paper = [("–", "–"), ("0", "30"), ("1.745", "30"), ("2.205", "0")];
    for (case, (delta_v, e)) in cases(config).into_iter().zip(paper) {
        let equivalent = case.e.map(|e| design.shell.equivalent_distance(design.object_distance, e));
        table.push([
            case.name.to_owned(),
            delta_v.to_owned(),
            format!("{:.5}", case.delta_v),
            e.to_owned(),
            case.e.map_or_else(|| "–".to_owned(), |e| format!("{e:.1}")),
            equivalent.map_or_else(|| format!("{:.2}", design.air_distance), |l| format!("{l:.2}")),
            format!("{:.3}", design.aperture(case.delta_v)),
        ]);
    }
    let [_, _, clarity, joint] = cases(config);
    for (case, printed) in [clarity, joint].into_iter().zip(PRINTED) {
        let off = (case.delta_v - printed).abs();
        chapter.findings.push(Finding::compared(
            format!("Δv, {} optimisation", case.name),
            format!("{printed:.3} mm"),
            format!("{:.5} mm", case.delta_v),
            off <= HALF_DIGIT,
            if off <= HALF_DIGIT {
                "rounds to the paper's figure"
            } else {
                "the configuration is not the preset that was inferred from Table 2"
            },
        ));
    }
    chapter.tables.push(table);
    infer(&mut chapter);
    Ok(chapter)
}

/// What Table 2 fixes and what it leaves open.
fn infer(chapter: &mut Chapter) {
    chapter.text.push(
        "Table 1 is not in the printed text. Table 2 replaces it in part: with the board at 800 mm in both media, \
         Eq. 8 at e = 30 and at e = 0 are two equations for the main lens's focal length f and the equivalent distance \
         l_A''M that the shell makes of 800 mm of water at e = 0; at e = 30 it is 30 mm more, whatever the shell."
            .to_owned(),
    );
    let ([focal_length, equivalent], ranges) = inferred();
    chapter.findings.push(Finding::new(
        "f that Table 2 implies",
        format!("{focal_length:.3} mm, {:.3} to {:.3} mm with its rounding", ranges[0][0], ranges[0][1]),
        "20.0 mm in the preset",
    ));
    chapter.findings.push(Finding::new(
        "l_A''M at e = 0 that Table 2 implies",
        format!("{equivalent:.2} mm, {:.2} to {:.2} mm with its rounding", ranges[1][0], ranges[1][1]),
        "that and f are all the table fixes",
    ));
    let mut table = Table::new(
        "shells",
        "Shells that fit Table 2: one outer radius for every material and thickness (f = 20 mm, n_water = 1.333)",
        &[
            "material",
            "n",
            "thickness, mm",
            "outer radius, mm",
            "Δv at e = 30, mm",
            "Δv at e = 0, mm",
            "e_max for 60°, mm",
        ],
    );
    let mut curves = Vec::new();
    let lens = MainLens { focal_length: 20.0 };
    let wanted = lens.object_distance(lens.image_distance(OBJECT) + PRINTED[1]);
    for (material, n_shell) in
        [("fused silica", 1.459), ("acrylic", 1.49), ("BK7 glass", 1.517), ("polycarbonate", 1.586)]
    {
        let mut points = Vec::new();
        for thickness in [0.5, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0] {
            let Some(shell) = fitting(n_shell, thickness, wanted) else { continue };
            points.push([thickness, shell.outer_radius]);
            let delta_v = PRINTED_E
                .map(|e| lens.image_distance(shell.equivalent_distance(OBJECT, e)) - lens.image_distance(OBJECT));
            table.push([
                material.to_owned(),
                format!("{n_shell:.3}"),
                format!("{thickness:.1}"),
                format!("{:.2}", shell.outer_radius),
                format!("{:.4}", delta_v[0]),
                format!("{:.4}", delta_v[1]),
                format!("{:.1}", shell.e_max(60.0f64.to_radians())),
            ]);
        }
        curves.push(Curve::line(format!("{material}, n = {n_shell}"), points));
    }
    chapter.text.push(
        "Every shell of the table below makes the printed Δv of both cases, so Table 2 leaves the shell a family: for \
         any material and thickness there is one radius. The preset takes acrylic with radii of 59 and 51 mm. Whatever \
         depends on the shell otherwise (where its rim cuts the field, the curvature of the field, how e acts) is \
         therefore ours and not the paper's."
            .to_owned(),
    );
    chapter.tables.push(table);
    chapter.charts.push(Chart {
        name: "shells".to_owned(),
        title: "Shells that make the Δv of Table 2".to_owned(),
        x: "thickness, mm".to_owned(),
        y: "outer radius, mm".to_owned(),
        curves,
    });
}

/// f and l_A''M at e = 0 (mm) by Table 2, and the ranges of both over the rounding of its figures.
fn inferred() -> ([f64; 2], [[f64; 2]; 2]) {
    let middle = solve(PRINTED);
    let mut ranges = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for signs in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]] {
        let corner = solve([PRINTED[0] + signs[0] * HALF_DIGIT, PRINTED[1] + signs[1] * HALF_DIGIT]);
        for (range, value) in ranges.iter_mut().zip(corner) {
            *range = [range[0].min(value), range[1].max(value)];
        }
    }
    (middle, ranges)
}

/// f and l_A''M (mm) from Δv at e = 30 and e = 0 (mm): Newton's method on Eq. 8.
fn solve(delta_v: [f64; 2]) -> [f64; 2] {
    let misses = |[f, l]: [f64; 2]| {
        let lens = MainLens { focal_length: f };
        [0, 1].map(|k| lens.image_distance(l + PRINTED_E[k]) - lens.image_distance(OBJECT) - delta_v[k])
    };
    let mut x = [20.0, 170.0];
    for _ in 0..30 {
        let here = misses(x);
        let h = 1e-6;
        let by_f = misses([x[0] + h, x[1]]);
        let by_l = misses([x[0], x[1] + h]);
        let j =
            [[(by_f[0] - here[0]) / h, (by_l[0] - here[0]) / h], [(by_f[1] - here[1]) / h, (by_l[1] - here[1]) / h]];
        let determinant = j[0][0] * j[1][1] - j[0][1] * j[1][0];
        x[0] -= (j[1][1] * here[0] - j[0][1] * here[1]) / determinant;
        x[1] -= (j[0][0] * here[1] - j[1][0] * here[0]) / determinant;
    }
    x
}

/// The shell of a material and thickness that has this l_A''M (mm) at e = 0; `None` where no radius up to a metre has.
fn fitting(n_shell: f64, thickness: f64, equivalent: f64) -> Option<Shell> {
    let shell =
        |outer_radius: f64| Shell { outer_radius, inner_radius: outer_radius - thickness, n_shell, n_water: 1.333 };
    let miss = |radius: f64| shell(radius).equivalent_distance(OBJECT, 0.0) - equivalent;
    let (mut low, mut high) = (thickness + 1.0, 1000.0);
    if miss(low) * miss(high) > 0.0 {
        return None;
    }
    for _ in 0..80 {
        let middle = 0.5 * (low + high);
        if miss(low) * miss(middle) <= 0.0 {
            high = middle;
        } else {
            low = middle;
        }
    }
    Some(shell(0.5 * (low + high)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_2_fixes_f_and_the_equivalent_distance() {
        let ([f, l], ranges) = inferred();
        assert!((f - 20.008).abs() < 0.002, "{f}");
        assert!(ranges[0][0] < 20.0 && ranges[0][1] > 20.0, "{ranges:?}");
        assert!((l - 167.2).abs() < 0.2, "{l}");
    }

    #[test]
    fn the_preset_is_one_of_the_family() {
        let lens = MainLens { focal_length: 20.0 };
        let wanted = lens.object_distance(lens.image_distance(OBJECT) + PRINTED[1]);
        let shell = fitting(1.49, 8.0, wanted).unwrap();
        assert!((shell.outer_radius - 59.0).abs() < 0.1, "{}", shell.outer_radius);
    }
}
