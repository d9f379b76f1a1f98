//! Figure 3: the field of view in water against e, by Snell's law, and what each case sees: by theory, and measured in
//! rendered pictures of a board whose texture is known.

use std::sync::Arc;

use super::case::{Case, cases};
use super::chapter::{Chapter, Chart, Curve, Finding, Table};
use super::studio::{Shot, Studio};
use super::{Desk, StudyError};
use crate::config::Texture;
use crate::imaging::view::View;
use crate::optics::CameraDesign;
use crate::sim::scene::{Board, Scene, texel_for};
use crate::sim::texture::TextureMap;

/// The inner field of view by which Figure 3's law is shown, degrees: no sensor of the preset has it.
const SHOWN_FOV_DEG: f64 = 60.0;
/// Places along the middle row of a view, as shares of the half width, at which the board is looked up.
const PLACES: [f64; 12] = [-0.88, -0.75, -0.6, -0.45, -0.3, -0.15, 0.15, 0.3, 0.45, 0.6, 0.75, 0.88];
/// How far around the expected place the board is searched, mm.
const SEARCH_MM: f64 = 8.0;

/// Makes the chapter.
pub(super) fn write(desk: &Desk<'_>) -> Result<Chapter, StudyError> {
    let mut chapter = Chapter::default();
    let design = desk.config.design();
    law(&mut chapter, &design);
    each_case(&mut chapter, desk)?;
    Ok(chapter)
}

/// Field of view against e for a wide inner field.
fn law(chapter: &mut Chapter, design: &CameraDesign) {
    let shell = design.shell;
    let inner = SHOWN_FOV_DEG.to_radians();
    let e_max = shell.e_max(inner);
    let fov = |e: f64| shell.fov_in_water(inner, e).map(f64::to_degrees);
    let steps = 140;
    let curve: Vec<[f64; 2]> = (0..=steps)
        .map(|k| -shell.inner_radius + (e_max + shell.inner_radius) * f64::from(k) / f64::from(steps))
        .filter_map(|e| Some([e, fov(e)?]))
        .collect();
    let flat = 2.0 * ((inner / 2.0).sin() / shell.n_water).asin().to_degrees();
    chapter.charts.push(Chart {
        name: "fov_by_e".to_owned(),
        title: format!("Field of view in water against e, inner field {SHOWN_FOV_DEG}°"),
        x: "e, mm".to_owned(),
        y: "field of view in water, degrees".to_owned(),
        curves: vec![
            Curve::line("by Snell's law, both surfaces", curve),
            Curve::line("flat port", vec![[-shell.inner_radius, flat], [e_max, flat]]),
            Curve::line("inner field", vec![[-shell.inner_radius, SHOWN_FOV_DEG], [e_max, SHOWN_FOV_DEG]]),
        ],
    });
    let at = |e: f64| fov(e).map_or_else(|| "none".to_owned(), |fov| format!("{fov:.2}° at e = {e}"));
    chapter.findings.push(Finding::compared(
        "which way e acts on the field of view",
        "e < 0 widens it, e > 0 narrows it",
        [-30.0, 0.0, 30.0].map(at).join(", "),
        false,
        "By Snell's law it is the other way round. A ray that leaves M inside the air cavity meets the shell at an angle \
         to its normal that vanishes at e = 0; with the lens nearer to the water (e < 0) it meets it as it would a flatter \
         port and is bent towards the axis. The paper's own remark that e = −l_O'C resembles a flat port, which narrows \
         the field to about 1/1.33, says the same.",
    ));
    chapter.findings.push(Finding::new(
        "greatest e without black edges, l_O'C / tan(α/2)",
        format!("{e_max:.2} mm for {SHOWN_FOV_DEG}°"),
        "the paper's bound, over the field shown",
    ));
}

/// Degrees and width of board seen of each case.
fn each_case(chapter: &mut Chapter, desk: &Desk<'_>) -> Result<(), StudyError> {
    let (config, design) = (desk.config, desk.config.design());
    let pixel = config.pixel_pitch().millimetres();
    let side = if desk.options.quick { 500 } else { config.sensor.width_px.min(config.sensor.height_px) as usize };
    let studio = Studio { design, pixel, side, rays: 12, noise: 2.0, seed: desk.options.seed };
    let extent = side as f64 * pixel;
    let full = config.sensor_extent().width;
    let texel = texel_for(&design, cases(config)[3].medium(&design), design.object_distance, pixel);
    let texture = Arc::new(TextureMap::generate(Texture::Natural, 1.5 * texel, desk.options.seed));
    let mut table = Table::new(
        "cases",
        format!("What each case sees; half widths at {:.0} mm, of a sensor {side} px wide", design.object_distance),
        &[
            "case",
            "inner FOV, degrees",
            "FOV in water, degrees",
            "half width, whole sensor, mm",
            "half width by rays, mm",
            "half width measured, mm",
            "difference, %",
        ],
    );
    let mut widths = Vec::new();
    let mut angles = Vec::new();
    let mut worst: f64 = 0.0;
    let of = cases(config).len() as u64;
    for (k, case) in cases(config).into_iter().enumerate() {
        let shot =
            studio.take(&case, &Scene::Board(Board::new(case.distance(&design), Arc::clone(&texture))), k as u64)?;
        let theory = half_width(&design, &case, extent)
            .ok_or_else(|| StudyError::unseen("the field of view", "its edge lies beyond the shell's rim"))?;
        let measured = measured_half_width(&shot, &texture, theory)
            .ok_or_else(|| StudyError::unseen(format!("the board at the case “{}”", case.name), "not recognised"))?;
        let whole = half_width(&design, &case, full);
        let inner = design.inner_fov(full, case.delta_v).to_degrees();
        let water = match case.e {
            None => Some(inner),
            Some(e) => design.fov_in_water(full, case.delta_v, e).map(f64::to_degrees),
        };
        worst = worst.max((measured / theory - 1.0).abs());
        let shown = |value: Option<f64>, digits: usize| value.map_or("none".to_owned(), |v| format!("{v:.digits$}"));
        table.push([
            case.name.to_owned(),
            format!("{inner:.2}"),
            if case.e.is_some() { shown(water, 2) } else { "– (air)".to_owned() },
            shown(whole, 1),
            format!("{theory:.2}"),
            format!("{measured:.2}"),
            format!("{:+.2}", 100.0 * (measured / theory - 1.0)),
        ]);
        widths.push(whole.unwrap_or(f64::NAN));
        angles.push(water.unwrap_or(f64::NAN));
        desk.watch.done(k as u64 + 1, of);
    }
    chapter.tables.push(table);
    chapter.findings.push(Finding::new(
        "width of board seen, measured against traced rays",
        format!("within {:.2} % in every case", 100.0 * worst),
        "patches of the rendered view are found again on the known texture along its middle row; rays are traced through \
         M and both surfaces",
    ));
    let nearest = |values: &[f64]| {
        let distance = |k: usize| (values[k] - values[0]).abs();
        (1..values.len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b)))
    };
    let by_width = nearest(&widths).map_or("none", |k| cases(config)[k].name);
    let by_angle = nearest(&angles).map_or("none", |k| cases(config)[k].name);
    chapter.findings.push(Finding::compared(
        "the case whose field is nearest to the air camera's",
        "joint",
        format!("by width of board seen {by_width}, by degrees in the medium {by_angle}"),
        by_width == "joint",
        format!(
            "The inner field itself narrows with Δv, since d + b grows: {:.2}° in air, {:.2}° at the joint solution. e = 0 \
             keeps the field in water equal to that inner field, not to the air design's. By the width of board seen at \
             {:.0} mm the joint solution comes nearest ({:.1} mm against {:.1} mm in air and {:.1} mm added directly).",
            design.inner_fov(full, 0.0).to_degrees(),
            design.inner_fov(full, cases(config)[3].delta_v).to_degrees(),
            design.object_distance,
            widths[3],
            widths[0],
            widths[1],
        ),
    ));
    Ok(())
}

/// Half of the width of board that a case sees over an extent of sensor, mm.
fn half_width(design: &CameraDesign, case: &Case, extent: f64) -> Option<f64> {
    match case.e {
        None => Some(design.half_width_in_air(extent, case.delta_v, design.air_distance)),
        Some(e) => design.half_width_in_water(extent, case.delta_v, e),
    }
}

/// Half of the width of board in a view, mm: patches along its middle row are found on the texture, and the places found
/// are compared with those where traced rays end. `expected` (mm) only says where to look.
fn measured_half_width(shot: &Shot, texture: &TextureMap, expected: f64) -> Option<f64> {
    let view = shot.pictures.view([0.0; 2]).ok()?;
    let values = view.luminance();
    let sensor_half = 0.5 * shot.camera.width as f64 * shot.camera.pixel;
    // Half of the frame in pixels of the view, which has whole ones only.
    let half = 0.5 * shot.camera.width as f64 * view.scale;
    let mm_per_px = expected / half;
    let centre = [view.width, view.height].map(|count| (count as f64 - 1.0) / 2.0);
    let found: Vec<(f64, f64)> = PLACES
        .iter()
        .filter_map(|share| {
            let x = (centre[0] + share * half).round();
            let share = (x - centre[0]) / half;
            // The lens turns the picture round, and the view turns it back.
            let [ray, _] = shot.view.chief_board_point([-share * sensor_half, 0.0])?;
            Some((ray, look_up(&view, &values, texture, [x, centre[1].round()], ray, mm_per_px)?))
        })
        .collect();
    if found.len() < PLACES.len() / 2 {
        return None;
    }
    // What is common to all places is where the board's middle is, not how wide the field is.
    let count = found.len() as f64;
    let middle = found.iter().fold([0.0; 2], |sum, &(ray, seen)| [sum[0] + ray / count, sum[1] + seen / count]);
    let (mut across, mut square) = (0.0, 0.0);
    for (ray, seen) in found {
        across += (ray - middle[0]) * (seen - middle[1]);
        square += (ray - middle[0]).powi(2);
    }
    Some(expected * across / square)
}

/// The board's x (mm) of a view's place: where the texture looks most like the patch around it.
fn look_up(
    view: &View,
    values: &[f32],
    texture: &TextureMap,
    [x, y]: [f64; 2],
    expected: f64,
    mm_per_px: f64,
) -> Option<f64> {
    // A patch of some ten millimetres, but of enough pixels.
    let radius = (6.0 / mm_per_px).round().clamp(5.0, 16.0);
    let (left, top) = ((x - radius).round(), (y - radius).round());
    let span = 2 * radius as usize + 1;
    if left < 0.0 || top < 0.0 || left as usize + span > view.width || top as usize + span > view.height {
        return None;
    }
    let mut patch = Vec::with_capacity(span * span);
    let (mut xs, mut ys) = (Vec::new(), Vec::new());
    for j in 0..span {
        for i in 0..span {
            patch.push(values[(top as usize + j) * view.width + left as usize + i]);
            xs.push(((left + i as f64 - x) * mm_per_px) as f32);
            ys.push(((top + j as f64 - y) * mm_per_px) as f32);
        }
    }
    // As blurred as a pixel of the view is wide.
    let level = texture.level((mm_per_px / texture.texel()).log2().round().max(0.0) as usize);
    let step = 0.25 * mm_per_px;
    let steps = (SEARCH_MM / step).ceil() as i32;
    let score = |at: f64, down: f64| {
        let places: Vec<f32> = xs.iter().map(|dx| (at + f64::from(*dx)) as f32).collect();
        let rows: Vec<f32> = ys.iter().map(|dy| (down + f64::from(*dy)) as f32).collect();
        let mut seen = vec![0.0; places.len()];
        level.sample(&places, &rows, &mut seen);
        correlation(&patch, &seen)
    };
    let mut best = (f64::NEG_INFINITY, 0, 0.0);
    for row in -2..=2 {
        let down = f64::from(row) * mm_per_px;
        for k in -steps..=steps {
            let found = score(expected + f64::from(k) * step, down);
            if found > best.0 {
                best = (found, k, down);
            }
        }
    }
    let (top_score, k, down) = best;
    if top_score < 0.6 {
        return None;
    }
    let at = |k: i32| score(expected + f64::from(k) * step, down);
    let (before, after) = (at(k - 1), at(k + 1));
    let bend = before - 2.0 * top_score + after;
    let shift = if bend < 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
    Some(expected + (f64::from(k) + shift) * step)
}

/// Pearson's correlation of two patches.
fn correlation(one: &[f32], other: &[f32]) -> f64 {
    let n = one.len() as f64;
    let mean = |values: &[f32]| values.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
    let (a, b) = (mean(one), mean(other));
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (&x, &y) in one.iter().zip(other) {
        let (x, y) = (f64::from(x) - a, f64::from(y) - b);
        ab += x * y;
        aa += x * x;
        bb += y * y;
    }
    ab / (aa * bb).sqrt().max(f64::MIN_POSITIVE)
}
