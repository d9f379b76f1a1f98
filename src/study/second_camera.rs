//! Section 3.2 and Table 4: the second camera, N = 3.26, whose lens can come no nearer than l_bound = 19 mm. The whole
//! chain on rendered frames: calibration in air, l_bound by Eqs. 9–12, joint optimisation, and both loops' criteria; the
//! sweep of the initial e that the paper mentions; depth resolution of both cameras.

use std::sync::Arc;

use super::case::Case;
use super::chapter::{Chapter, Chart, Curve, Finding, Table};
use super::studio::{Studio, view_png};
use super::{Desk, StudyError};
use crate::config::Texture;
use crate::imaging::calibration::{CalibrationOptions, calibrate};
use crate::imaging::clarity::eog;
use crate::imaging::measurement::measure_frame;
use crate::optics::CameraDesign;
use crate::sim::renderer::{CameraTruth, Medium};
use crate::sim::scene::{Board, Scene, TripleBoard, texel_for};
use crate::sim::texture::TextureMap;

/// The paper's figures of its real camera.
const RESOLUTION: f64 = 3.26;
const L_BOUND_MM: f64 = 19.0;
const DEPTH_RESOLUTION_MM: f64 = 36.0;
/// e at which its shell is first mounted, mm: the paper does not print its Table 4.
const INITIAL_E_MM: f64 = 30.0;
/// Lens pitches over which the preset's depth resolution is the paper's 30 mm.
const BASELINE: f64 = 3.0;
/// Steps of the triple-level board, mm, about the middle one.
const LEVELS_MM: [f64; 3] = [-8.0, 0.0, 8.0];

/// Makes the chapter.
pub(super) fn write(desk: &Desk<'_>) -> Result<Chapter, StudyError> {
    let config = desk.config;
    let first = config.design();
    let pixel = config.pixel_pitch().millimetres();
    let design = second(&first, pixel);
    let side = if desk.options.quick { 640 } else { config.sensor.width_px.min(config.sensor.height_px) as usize };
    let studio = Studio { design, pixel, side, rays: 12, noise: 2.0, seed: desk.options.seed };
    let mut chapter = Chapter::default();
    chapter.text.push(format!(
        "Table 3 is not in the printed text. Of the real camera it says N = {RESOLUTION}, a depth resolution of \
         {DEPTH_RESOLUTION_MM} mm at 800 mm for half a pixel of parallax, and l_bound = {L_BOUND_MM} mm. This preset keeps the \
         shell, the array's pitch and focal length and the sensor of the first one and takes the f with which the depth \
         resolution comes out as the paper's over the same baseline: f = {:.3} mm.",
        design.main_lens.focal_length
    ));
    resolutions(&mut chapter, &first, &design, pixel);
    chain(&mut chapter, &studio, desk)?;
    sweep(&mut chapter, &studio, desk)?;
    Ok(chapter)
}

/// The second camera: the first with the paper's N, and the f that gives the paper's depth resolution.
fn second(first: &CameraDesign, pixel: f64) -> CameraDesign {
    let with = |focal_length: f64| {
        let mut design = *first;
        design.mla.angular_resolution = RESOLUTION;
        design.main_lens.focal_length = focal_length;
        design
    };
    let miss = |f: f64| with(f).depth_resolution_in_air(800.0, 0.0, 0.5 * pixel, BASELINE) - DEPTH_RESOLUTION_MM;
    // The resolution grows finer with f.
    let (mut low, mut high) = (8.0, 40.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if miss(middle) > 0.0 { low = middle } else { high = middle }
    }
    with(0.5 * (low + high))
}

fn resolutions(chapter: &mut Chapter, first: &CameraDesign, second: &CameraDesign, pixel: f64) {
    let mut table = Table::new(
        "depth_resolution",
        "Depth resolution at 800 mm in air for half a pixel of parallax, by the baseline over which it is taken",
        &["camera", "N", "one lens pitch, mm", "two, mm", "three, mm", "paper, mm"],
    );
    for (name, design, paper) in [("first", first, "30"), ("second", second, "36")] {
        let over = |pitches: f64| format!("{:.1}", design.depth_resolution_in_air(800.0, 0.0, 0.5 * pixel, pitches));
        table.push([
            name.to_owned(),
            format!("{:.2}", design.mla.angular_resolution),
            over(1.0),
            over(2.0),
            over(3.0),
            paper.to_owned(),
        ]);
    }
    let ours = first.depth_resolution_in_air(800.0, 0.0, 0.5 * pixel, BASELINE);
    chapter.tables.push(table);
    chapter.findings.push(Finding::compared(
        "depth resolution of the first camera",
        "30 mm",
        format!("{ours:.1} mm over three lens pitches"),
        (ours - 30.0).abs() < 1.5,
        "between adjacent lenses it is three times as much: the paper's baseline is about three lens pitches",
    ));
}

/// Calibration, l_bound, joint optimisation and what both criteria then say.
fn chain(chapter: &mut Chapter, studio: &Studio, desk: &Desk<'_>) -> Result<(), StudyError> {
    let design = &studio.design;
    let joint = design.joint(L_BOUND_MM);
    let pixel = studio.pixel;
    let mut table = Table::new("chain", "The chain, step by step", &["step", "truth", "measured", "difference"]);
    let texture = |distance: f64, medium: Medium, kind: Texture| {
        Arc::new(TextureMap::generate(kind, texel_for(design, medium, distance, pixel), studio.seed))
    };
    // 1. Calibration in air, of the camera as it is after the move of Δv.
    let camera_in_air =
        |delta_v: f64| CameraTruth::from_design(design, delta_v, Medium::Air, pixel, studio.side, studio.side);
    let middle = joint.equivalent_distance;
    let levels = LEVELS_MM.map(|step| middle + step);
    let triple_map = texture(middle, Medium::Air, Texture::Natural);
    let calibrated = |delta_v: f64, seed: u64| {
        let camera = camera_in_air(delta_v);
        let white = studio.white(&camera)?;
        let board = TripleBoard::new(&levels, camera.half_field_slope(), &triple_map);
        let raw = studio.expose(&camera, &Scene::TripleBoard(board), seed);
        let options = CalibrationOptions::new(studio.frame_options(), pixel, design.main_lens);
        calibrate(&raw, Some(&white), &levels, &options)
            .map(|calibration| calibration.line)
            .map_err(|error| StudyError::unseen("the triple-level board", error))
    };
    let line = calibrated(joint.delta_v, 11)?;
    let (d, b) = (design.lens_to_mla(joint.delta_v), design.mla.b());
    table.push(["d by calibration, mm".into(), format!("{d:.5}"), format!("{:.5}", line.d_mm), micro(line.d_mm - d)]);
    table.push(["b by calibration, mm".into(), format!("{b:.5}"), format!("{:.5}", line.b_mm), micro(line.b_mm - b)]);
    let (image, sigma) = line.image_distance(design.mla.signed_resolution());
    let delta_v = image - design.air_image_distance();
    table.push([
        "Δv_1 by Eq. 15, mm".into(),
        format!("{:.5}", joint.delta_v),
        format!("{delta_v:.5} ± {sigma:.5}"),
        micro(delta_v - joint.delta_v),
    ]);
    desk.watch.done(1, 6);
    // 2. l_bound: the lens against the shell, the spacing of the board in water, Eqs. 9 to 12.
    let case = |delta_v: f64, e: f64| Case { name: "at the shell", delta_v, e: Some(e) };
    let in_water = |delta_v: f64, e: f64, seed: u64| {
        let case = case(delta_v, e);
        let camera = studio.camera(&case);
        let white = studio.white(&camera)?;
        let map = texture(design.object_distance, case.medium(design), Texture::Natural);
        let raw = studio.expose(&camera, &Scene::Board(Board::new(design.object_distance, map)), seed);
        measure_frame(&raw, Some(&white), &studio.frame_options())
            .map(|seen| (seen.spacing.on_axis_px, seen.spacing.sigma_px, seen.spacing.window_px))
            .map_err(|error| StudyError::unseen(format!("the board in water at e = {e} mm"), error))
    };
    let (spacing, spacing_sigma, window) = in_water(joint.delta_v, L_BOUND_MM, 12)?;
    let paraxial = design.l_bound_from_spacing(spacing * pixel, line.d_mm, line.b_mm);
    let excess = design.exact_in_water(joint.delta_v, L_BOUND_MM).excess(window * pixel).unwrap_or(0.0);
    let exact = design.l_bound_from_spacing(spacing * pixel - excess, line.d_mm, line.b_mm);
    table.push([
        "l_bound by Eq. 12, as printed, mm".into(),
        format!("{L_BOUND_MM:.3}"),
        format!("{paraxial:.3}"),
        format!("{:+.3} mm", paraxial - L_BOUND_MM),
    ]);
    table.push([
        "l_bound, the shell's aberrations in the estimator's window taken off, mm".into(),
        format!("{L_BOUND_MM:.3}"),
        format!("{exact:.3}"),
        format!("{:+.3} mm", exact - L_BOUND_MM),
    ]);
    desk.watch.done(2, 6);
    // 3. Joint optimisation at the l_bound found, and its criterion in water.
    let found = design.joint(exact);
    table.push([
        "Δv of the joint solution at that l_bound, mm".into(),
        format!("{:.5}", joint.delta_v),
        format!("{:.5}", found.delta_v),
        micro(found.delta_v - joint.delta_v),
    ]);
    let target = design.mla.target_spacing() / pixel;
    let (spacing, sigma, window) = in_water(found.delta_v, L_BOUND_MM, 13)?;
    let excess = design.exact_in_water(found.delta_v, L_BOUND_MM).excess(window * pixel).unwrap_or(0.0) / pixel;
    table.push([
        "spacing in water there, px (Eq. 16, and by exact rays)".into(),
        format!("{target:.4}, {:.4}", target + excess),
        format!("{spacing:.4} ± {sigma:.4}"),
        format!("{:+.4} px", spacing - target - excess),
    ]);
    chapter.tables.push(table);
    let e_sigma = spacing_sigma * pixel / design.spacing_per_equivalent(joint.equivalent_distance, joint.delta_v).abs();
    chapter.findings.push(Finding::compared(
        "l_bound by Eqs. 9–12 from one frame",
        "19 mm",
        format!("{exact:.2} mm (spacing alone ± {e_sigma:.2} mm)"),
        (exact - L_BOUND_MM).abs() < 0.5,
        format!(
            "as printed, paraxially, {paraxial:.2} mm: rays through the whole micro-image have a spacing a little larger \
             than Eq. 9 takes it to be. d and b are the calibration's: 5 µm of them are 0.3 mm of e"
        ),
    ));
    let blur = (spacing - target - excess).abs();
    chapter.findings.push(Finding::compared(
        "the joint solution is in focus (Eq. 16)",
        "in focus by eye and EOG",
        format!("{blur:.3} px of blur left"),
        blur * pixel < desk.config.blur_limit().value(),
        "after one move by what was calibrated, without the loops' corrections",
    ));
    desk.watch.done(3, 6);
    Ok(())
}

fn micro(mm: f64) -> String {
    format!("{:+.2} µm", 1000.0 * mm)
}

/// Direct, clarity and joint over the e at which the shell is first mounted.
fn sweep(chapter: &mut Chapter, studio: &Studio, desk: &Desk<'_>) -> Result<(), StudyError> {
    let design = &studio.design;
    let joint = design.joint(L_BOUND_MM);
    let texel = {
        let medium = Medium::Water { shell: design.shell, e: joint.e, decentre: [0.0; 2] };
        texel_for(design, medium, design.object_distance, studio.pixel)
    };
    let map = Arc::new(TextureMap::generate(Texture::Oscar, texel, studio.seed));
    let mut energy = |case: &Case, picture: Option<&str>| {
        let scene = Scene::Board(Board::new(design.object_distance, Arc::clone(&map)));
        let shot = studio.take(case, &scene, 5)?;
        let view =
            shot.pictures.view([0.0; 2]).map_err(|error| StudyError::unseen("a view of the second camera", error))?;
        let found = eog(&view);
        if let Some(name) = picture {
            let caption =
                format!("{}: central view, EOG {:.2e} ({:.0} a pixel)", case.name, found.sum, found.mean_per_pixel);
            chapter.pictures.push(view_png(name, caption, &view));
        }
        Ok::<_, StudyError>(found)
    };
    let best = energy(&Case { name: "joint", delta_v: joint.delta_v, e: Some(joint.e) }, Some("joint"))?;
    let places: &[f64] = if desk.options.quick { &[30.0] } else { &[19.0, 24.0, 30.0, 36.0, 42.0, 48.0] };
    let mut table = Table::new(
        "initial_e",
        "The shell first mounted at other e: EOG of the view, mean per pixel and sum",
        &[
            "initial e, mm",
            "direct, per pixel",
            "clarity Δv, mm",
            "clarity, per pixel",
            "joint to direct, per pixel",
            "joint to direct, sum",
            "joint to clarity, per pixel",
        ],
    );
    let mut curves = [Vec::new(), Vec::new()];
    for (k, &e) in places.iter().enumerate() {
        let clarity = design.clarity(e);
        let shown = (e == INITIAL_E_MM).then_some("direct");
        let direct = energy(&Case { name: "direct", delta_v: 0.0, e: Some(e) }, shown)?;
        let sharp = energy(&Case { name: "clarity", delta_v: clarity.delta_v, e: Some(e) }, None)?;
        let ratio = best.mean_per_pixel / direct.mean_per_pixel;
        table.push([
            format!("{e:.0}"),
            format!("{:.1}", direct.mean_per_pixel),
            format!("{:.4}", clarity.delta_v),
            format!("{:.1}", sharp.mean_per_pixel),
            format!("{ratio:.2}"),
            format!("{:.2}", best.sum / direct.sum),
            format!("{:.2}", best.mean_per_pixel / sharp.mean_per_pixel),
        ]);
        curves[0].push([e, ratio]);
        curves[1].push([e, best.mean_per_pixel / sharp.mean_per_pixel]);
        desk.watch.done(4 + k as u64 * 2 / places.len() as u64, 6);
    }
    let at_start = places.iter().position(|&e| e == INITIAL_E_MM).map(|k| (curves[0][k][1], table.rows[k][5].clone()));
    chapter.tables.push(table);
    if let Some((per_pixel, sum)) = at_start {
        chapter.findings.push(Finding::compared(
            "joint against direct, EOG",
            "around 3 times",
            format!("{per_pixel:.2} times per pixel, {sum} times in sum"),
            per_pixel > 1.5,
            "four real scenes in the paper, a fish-like texture here; out of focus the view is smaller, too, so that its sum \
             falls further than its mean",
        ));
    }
    let [direct, clarity] = curves;
    if direct.len() > 1 {
        let least = direct.iter().map(|point| point[1]).fold(f64::INFINITY, f64::min);
        chapter.findings.push(Finding::compared(
            "other initial e",
            "“yield similar results”",
            format!("joint at least {least:.2} times direct per pixel"),
            least > 1.5,
            "the figures by e are in the table",
        ));
        chapter.charts.push(Chart {
            name: "initial_e".to_owned(),
            title: "EOG per pixel of the joint camera over that of others, by the initial e".to_owned(),
            x: "initial e, mm".to_owned(),
            y: "ratio".to_owned(),
            curves: vec![Curve::line("joint to direct", direct), Curve::line("joint to clarity", clarity)],
        });
    }
    Ok(())
}
