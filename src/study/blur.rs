//! Figure 6 and Section 2.3: the blur circle against distance, by Eqs. 17–19 and measured in rendered frames; depth of
//! field, tolerance of e, and re-optimising Δv for an object that has left the depth of field.

use std::sync::Arc;

use super::case::{Case, cases};
use super::chapter::{Chapter, Chart, Curve, Finding, Table};
use super::studio::Studio;
use super::{Desk, StudyError};
use crate::optics::CameraDesign;
use crate::sim::renderer::{CameraTruth, Medium, RenderOptions, Renderer, Tracer};
use crate::sim::scene::{Board, Scene};
use crate::sim::texture::TextureMap;

/// Side of the frames in which edges are measured, px.
const SIDE: usize = 240;
/// Rays a pixel: blur is what the rays of a pixel spread over.
const RAYS: u32 = 96;
/// Texels along a side of the board with the edge.
const TEXELS: usize = 512;
/// Reflectances on both sides of the edge.
const DARK: f32 = 0.1;
const BRIGHT: f32 = 0.9;
/// Half width of the window in which an edge is measured, px from the micro-image's centre: there the whole microlens is
/// lit.
const WINDOW_PX: f64 = 9.0;
/// Rows of a micro-image used, on each side of its centre.
const ROWS: i32 = 3;
/// Variance that pixels and the difference of neighbours add to an edge, px²: a twelfth for each, on the mean over the
/// places that an edge can have among the pixels.
const PIXEL_VARIANCE: f64 = 1.0 / 6.0;

/// Makes the chapter.
pub(super) fn write(desk: &Desk<'_>) -> Result<Chapter, StudyError> {
    let (config, design) = (desk.config, desk.config.design());
    let pixel = config.pixel_pitch().millimetres();
    let limit = config.blur_limit().value();
    let studio = Studio { design, pixel, side: SIDE, rays: RAYS, noise: 0.0, seed: desk.options.seed };
    let [air, direct, clarity, joint] = cases(config);
    let mut chapter = Chapter::default();
    chapter.text.push(format!(
        "The blur of Eqs. 17–19 is the diameter of a disc on the sensor. It is measured on a board with one straight edge, \
         rendered by exact rays: in each micro-image that holds the whole edge, row by row, the derivative across the edge \
         is the disc seen from the side, whose variance is δ²/16 (after a sixth of a pixel squared for the pixels \
         themselves). The limit of sharpness is {} px.",
        config.assembly.blur_limit_px
    ));
    curves(&mut chapter, &studio, &[air, joint], desk)?;
    depths(&mut chapter, &studio, &[air, direct, clarity, joint], limit);
    reoptimise(&mut chapter, &studio, &joint, limit)?;
    Ok(chapter)
}

/// Blur by theory, mm on the sensor.
fn theory(design: &CameraDesign, case: &Case, distance: f64) -> f64 {
    match case.e {
        Some(e) => design.blur_at(distance, case.delta_v, e),
        None => design.mla.blur(design.main_lens.image_distance(distance) - design.lens_to_mla(case.delta_v)),
    }
}

fn curves(chapter: &mut Chapter, studio: &Studio, shown: &[Case], desk: &Desk<'_>) -> Result<(), StudyError> {
    let distances: &[f64] = if desk.options.quick {
        &[550.0, 800.0, 1200.0]
    } else {
        &[450.0, 500.0, 550.0, 600.0, 650.0, 700.0, 800.0, 900.0, 1000.0, 1200.0, 1500.0, 2000.0]
    };
    let mut table = Table::new(
        "blur",
        "Blur by distance",
        &["case", "distance, mm", "δ by Eqs. 17–19, px", "δ measured, px", "edges", "difference, px"],
    );
    let mut drawn = Vec::new();
    let (mut worst, mut steps) = (0.0f64, 0);
    for case in shown {
        let by_theory: Vec<[f64; 2]> = (0..=160)
            .map(|k| 400.0 + 10.0 * f64::from(k))
            .map(|distance| [distance, theory(&studio.design, case, distance) / studio.pixel])
            .collect();
        let mut points = Vec::new();
        for &distance in distances {
            let expected = theory(&studio.design, case, distance) / studio.pixel;
            let camera = studio.camera(case);
            let (found, edges) = measured(studio, camera, distance).ok_or_else(|| {
                StudyError::unseen(format!("the blur at {distance} mm"), "no whole edge in a micro-image")
            })?;
            worst = worst.max((found - expected).abs());
            points.push([distance, found]);
            table.push([
                case.name.to_owned(),
                format!("{distance:.0}"),
                format!("{expected:.3}"),
                format!("{found:.3}"),
                edges.to_string(),
                format!("{:+.3}", found - expected),
            ]);
            steps += 1;
            desk.watch.done(steps, (shown.len() * distances.len()) as u64);
        }
        let medium = if case.e.is_some() { "in water from O" } else { "in air from M" };
        drawn.push(Curve::line(format!("{}, {medium}: Eqs. 17–19", case.name), by_theory));
        drawn.push(Curve::marks(format!("{}: measured", case.name), points));
    }
    chapter.tables.push(table);
    chapter.charts.push(Chart {
        name: "blur".to_owned(),
        title: "Blur circle against object distance".to_owned(),
        x: "object distance, mm".to_owned(),
        y: "δ, px".to_owned(),
        curves: drawn,
    });
    chapter.findings.push(Finding::compared(
        "blur measured in micro-images against Eqs. 17–19",
        "Figure 6, by theory only",
        format!("at most {worst:.2} px off"),
        worst < 0.3,
        "the equations are paraxial and take the microlens as a full disc; near focus the pixels' own width is most of \
         what is measured",
    ));
    Ok(())
}

/// Diameter of the blur disc (px) that the frame of an edge at a distance shows, and in how many rows of micro-images;
/// `None` where none holds it whole.
fn measured(studio: &Studio, camera: CameraTruth, distance: f64) -> Option<(f64, usize)> {
    // Turned a little, so that the edge lies at other fractions of a pixel in every micro-image.
    let camera = CameraTruth { rotation: 0.021, offset: [1.7, -2.3], ..camera };
    let probe = Board::new(distance, Arc::new(TextureMap::from_values(&[0.0], 1.0)));
    let tracer = Tracer::new(&camera);
    let texel = tracer.footprint(&probe)? / 6.0;
    let values: Vec<f32> = (0..TEXELS * TEXELS).map(|k| if k % TEXELS < TEXELS / 2 { BRIGHT } else { DARK }).collect();
    let map = TextureMap::from_values(&values, texel);
    // The edges of the repeated texture are half a period apart; one of them on the axis.
    let board = Board::new(distance, Arc::new(map));
    let renderer = Renderer::new(RenderOptions { rays: studio.rays, seed: studio.seed });
    let white = renderer.render(&camera, &Scene::Diffuser);
    let seen = renderer.render(&camera, &Scene::Board(board));
    let middle = tracer.microlens_at(camera.frame_from_sensor([0.0; 2]));
    let (mut sum, mut count) = (0.0, 0usize);
    for (i, j) in (-3..=3).flat_map(|j| (-3..=3).map(move |i| (i, j))) {
        let [cx, cy] = tracer.micro_image_centre(tracer.step(middle, i, j));
        for row in -ROWS..=ROWS {
            let y = cy.round() as i64 + i64::from(row);
            let (from, to) = ((cx - WINDOW_PX).ceil() as i64, (cx + WINDOW_PX).floor() as i64);
            if from < 0 || y < 0 || to >= camera.width as i64 || y >= camera.height as i64 {
                continue;
            }
            let line: Vec<f64> = (from..=to)
                .map(|x| y as usize * camera.width + x as usize)
                .map(|k| f64::from(seen[k]) / f64::from(white[k]).max(1e-6))
                .collect();
            if let Some(variance) = edge_variance(&line) {
                sum += variance;
                count += 1;
            }
        }
    }
    let variance = sum / count as f64 - PIXEL_VARIANCE;
    (count >= 8).then(|| (4.0 * variance.max(0.0).sqrt(), count))
}

/// Variance (px²) of the one edge in a row of values; `None` where there is no whole edge.
fn edge_variance(line: &[f64]) -> Option<f64> {
    let contrast = f64::from(BRIGHT - DARK);
    let steps: Vec<f64> = line.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let total: f64 = steps.iter().sum();
    // Flat at both ends, or part of the edge is outside.
    let flat = |part: &[f64]| part.iter().all(|step| step.abs() < 0.004 * contrast);
    if total.abs() < 0.99 * contrast || !flat(&steps[..2]) || !flat(&steps[steps.len() - 2..]) {
        return None;
    }
    let moment = |about: f64, power: i32| {
        steps.iter().enumerate().map(|(k, step)| step * (k as f64 - about).powi(power)).sum::<f64>() / total
    };
    Some(moment(moment(0.0, 1), 2))
}

fn depths(chapter: &mut Chapter, studio: &Studio, all: &[Case], limit: f64) {
    let (design, pixel) = (&studio.design, studio.pixel);
    let mut table = Table::new(
        "depth_of_field",
        "Depth of field and blur at the design's distance",
        &[
            "case",
            "δ at the design's distance, px",
            "nearest sharp, mm",
            "furthest sharp, mm",
            "least e, mm",
            "greatest e, mm",
        ],
    );
    let shown =
        |value: Option<f64>, none: &str, digits: usize| value.map_or(none.to_owned(), |v| format!("{v:.digits$}"));
    for case in all {
        let (near, far) = match case.e {
            Some(e) => match design.depth_of_field(case.delta_v, e, limit) {
                Some(depth) => (format!("{:.0}", depth.near), shown(depth.far, "∞", 0)),
                None => ("nothing in the water is sharp".to_owned(), "–".to_owned()),
            },
            None => in_air(design, case, limit),
        };
        let tolerance = case.e.and_then(|_| design.e_tolerance(case.delta_v, limit));
        table.push([
            case.name.to_owned(),
            format!("{:.2}", theory(design, case, case.distance(design)) / pixel),
            near,
            far,
            tolerance.map_or("–".to_owned(), |t| shown(t.low, "−∞", 2)),
            tolerance.map_or("–".to_owned(), |t| shown(t.high, "∞", 2)),
        ]);
    }
    chapter.tables.push(table);
}

/// Nearest and furthest sharp distance in air, in words.
fn in_air(design: &CameraDesign, case: &Case, limit: f64) -> (String, String) {
    let blur = |distance: f64| theory(design, case, distance);
    let edge = |outside: f64| {
        let (mut inside, mut outside) = (design.air_distance, outside);
        for _ in 0..80 {
            let middle = 0.5 * (inside + outside);
            if blur(middle) <= limit { inside = middle } else { outside = middle }
        }
        format!("{inside:.0}")
    };
    let far = 1e7;
    let furthest = if blur(far) <= limit { "∞".to_owned() } else { edge(far) };
    (edge(2.0 * design.main_lens.focal_length), furthest)
}

/// An object that has left the depth of field, before and after Δv is optimised again with e held.
fn reoptimise(chapter: &mut Chapter, studio: &Studio, joint: &Case, limit: f64) -> Result<(), StudyError> {
    let design = &studio.design;
    let Some(e) = joint.e else { return Ok(()) };
    let Some(depth) = design.depth_of_field(joint.delta_v, e, limit) else { return Ok(()) };
    let mut table = Table::new(
        "reoptimised",
        "Objects outside the depth of field, before and after Δv is optimised again (e held)",
        &["object at, mm", "Δv before, mm", "δ measured before, px", "Δv after, mm", "δ measured after, px"],
    );
    let beyond = depth.far.map(|far| 1.5 * far);
    let mut sharp = true;
    for distance in [Some(0.7 * depth.near), beyond].into_iter().flatten() {
        let again = design.reoptimised(distance, e);
        let blur = |delta_v: f64| {
            let medium = Medium::Water { shell: design.shell, e, decentre: [0.0; 2] };
            let camera = CameraTruth::from_design(design, delta_v, medium, studio.pixel, studio.side, studio.side);
            measured(studio, camera, distance).map(|(blur, _)| blur).ok_or_else(|| {
                StudyError::unseen(format!("the blur at {distance:.0} mm"), "no whole edge in a micro-image")
            })
        };
        let (before, after) = (blur(joint.delta_v)?, blur(again.delta_v)?);
        sharp &= before * studio.pixel > limit && after * studio.pixel < limit;
        table.push([
            format!("{distance:.0}"),
            format!("{:.4}", joint.delta_v),
            format!("{before:.2}"),
            format!("{:.4}", again.delta_v),
            format!("{after:.2}"),
        ]);
    }
    chapter.tables.push(table);
    chapter.findings.push(Finding::compared(
        "re-optimising Δv outside the depth of field, e held",
        "needed where δ_D > δ, by Eq. 8",
        if sharp { "blurred before, within the limit after" } else { "not within the limit after" },
        sharp,
        "measured on rendered edges",
    ));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disc's edge, averaged over pixels.
    fn edge(diameter: f64, at: f64) -> Vec<f64> {
        let contrast = f64::from(BRIGHT - DARK);
        let fine = 200;
        (0..20)
            .map(|pixel| {
                let inside = |k: i32| {
                    let x = f64::from(pixel) - 0.5 + (f64::from(k) + 0.5) / f64::from(fine) - at;
                    let t = (2.0 * x / diameter).clamp(-1.0, 1.0);
                    // Share of a disc on one side of a line.
                    0.5 + (t * (1.0 - t * t).sqrt() + t.asin()) / std::f64::consts::PI
                };
                f64::from(DARK) + contrast * (0..fine).map(inside).sum::<f64>() / f64::from(fine)
            })
            .collect()
    }

    #[test]
    fn an_edge_tells_the_disc_that_blurred_it() {
        for diameter in [1.0, 2.5, 4.0, 6.0] {
            // What pixels add depends on where the edge lies among them; a sixth is its mean over all places.
            let of = |tenth: u8| edge_variance(&edge(diameter, 9.0 + f64::from(tenth) / 10.0)).unwrap();
            let variance = (0..10).map(of).sum::<f64>() / 10.0 - PIXEL_VARIANCE;
            let found = 4.0 * variance.sqrt();
            assert!((found - diameter).abs() < 0.02, "{diameter}: {found}");
        }
        // Partly outside, or none at all.
        assert_eq!(edge_variance(&edge(4.0, 1.0)), None);
        assert_eq!(edge_variance(&[0.5; 20]), None);
    }
}
