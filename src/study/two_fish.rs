//! Section 3.3: two fish at 500 and 900 mm with grass, under water: the depth map, views with a small, a large and each
//! micro-image's own patch, and how much their patches show.

use std::sync::Arc;

use super::case::{Case, cases};
use super::chapter::{Chapter, Finding, Table};
use super::studio::{Shot, Studio, colour_png, raw_png, view_png};
use super::{Desk, StudyError};
use crate::config::Texture;
use crate::imaging::clarity::{blockiness, eog, eog_of_scene};
use crate::imaging::depth::DepthState;
use crate::imaging::view::{Blend, Patches, View};
use crate::optics::ExactView;
use crate::sim::renderer::{CameraTruth, Tracer};
use crate::sim::scene::{Board, Cutout, Scene, texel_for};
use crate::sim::texture::{SIDE as TEXELS, TextureMap};

/// Distances of the fish in the foreground and of fish and grass behind, mm from O: the paper's.
const NEAR_MM: f64 = 500.0;
const FAR_MM: f64 = 900.0;
/// Distance of the wall of the tank, mm.
const WALL_MM: f64 = 1100.0;
/// Side of the piece of a raw frame that is shown, px.
const SHOWN_PX: usize = 300;

/// Makes the chapter.
pub(super) fn write(desk: &Desk<'_>) -> Result<Chapter, StudyError> {
    let (config, design) = (desk.config, desk.config.design());
    let pixel = config.pixel_pitch().millimetres();
    let side = if desk.options.quick { 480 } else { config.sensor.width_px.min(config.sensor.height_px) as usize };
    let studio = Studio { design, pixel, side, rays: 16, noise: 2.0, seed: desk.options.seed };
    let [.., joint] = cases(config);
    let scene = Tank::new(&studio, &joint, desk.options.seed);
    let shot = studio.take(&joint, &Scene::Cutouts(scene.things.clone()), 0)?;
    desk.watch.done(1, 2);

    let mut chapter = Chapter::default();
    chapter.text.push(format!(
        "One fish at {NEAR_MM} mm in the upper half, another and grass at {FAR_MM} mm in the lower, before the wall of a \
         tank at {WALL_MM} mm, all in water; the joint camera, {side}×{side} px, noise of {} grey levels. Distances are \
         metric: each micro-image's spacing is led back through the shell by exact rays at its own place in the field, \
         which the paper leaves undone (its depth map is one of patch sizes).",
        studio.noise
    ));
    depth(&mut chapter, &scene, &shot);
    pictures(&mut chapter, &studio, &shot)?;
    desk.watch.done(2, 2);
    Ok(chapter)
}

/// What is in the tank.
struct Tank {
    things: Vec<Cutout>,
}

impl Tank {
    fn new(studio: &Studio, case: &Case, seed: u64) -> Self {
        let design = &studio.design;
        let medium = case.medium(design);
        let half_at = |distance: f64| {
            let view = ExactView { board_distance: distance, ..case.view(design) };
            let edge = view.chief_board_point([0.5 * studio.side as f64 * studio.pixel, 0.0]);
            edge.map_or(100.0, |[x, _]| x.abs())
        };
        // Everything is drawn on a square of the texture about its origin; the outline has the texture's own scale.
        let thing = |texture: Texture, distance: f64, seed: u64, inside: &dyn Fn(f64, f64) -> bool| {
            let texel = texel_for(design, medium, distance, studio.pixel);
            let half = half_at(distance);
            // The outline's map covers the field and a half: it repeats beyond.
            let outline_texel = 3.0 * half / TEXELS as f64;
            let coordinate = |k: usize| {
                let place = (k as f64 + 0.5) * outline_texel;
                let period = TEXELS as f64 * outline_texel;
                (if place > period / 2.0 { place - period } else { place }) / half
            };
            let values: Vec<f32> = (0..TEXELS * TEXELS)
                .map(|k| if inside(coordinate(k % TEXELS), coordinate(k / TEXELS)) { 1.0 } else { 0.0 })
                .collect();
            Cutout {
                board: Board::new(distance, Arc::new(TextureMap::generate(texture, 1.4 * texel, seed))),
                outline: Some(Arc::new(TextureMap::from_values(&values, outline_texel))),
            }
        };
        let wall = {
            let texel = texel_for(design, medium, WALL_MM, studio.pixel);
            let map = TextureMap::generate(Texture::Natural, 3.0 * texel, seed ^ 3);
            Cutout { board: Board::new(WALL_MM, Arc::new(map)), outline: None }
        };
        // Up in the upright view is −y on the boards.
        let near = thing(Texture::Guppy, NEAR_MM, seed, &|x, y| fish(x + 0.02, y + 0.48, 0.95, 0.4));
        let far = thing(Texture::Oscar, FAR_MM, seed ^ 1, &|x, y| fish(0.05 - x, y - 0.32, 0.65, 0.26));
        let grass = thing(Texture::Charuco, FAR_MM, seed ^ 2, &blades);
        Self { things: vec![near, far, grass, wall] }
    }

    /// The distance (mm) of what a whole micro-image sees; `None` where it sees several things.
    fn distance(&self, tracer: &Tracer, camera: &CameraTruth, centre_px: [f64; 2]) -> Option<f64> {
        let lens = tracer.microlens_at(centre_px);
        let reach = 0.42 * camera.mla_pitch / camera.pixel;
        let mut common = None;
        for (dx, dy) in (-2..=2).flat_map(|j| (-2..=2).map(move |i| (f64::from(i) / 2.0, f64::from(j) / 2.0))) {
            if dx.hypot(dy) > 1.2 {
                continue;
            }
            let place = [centre_px[0] + dx * reach, centre_px[1] + dy * reach];
            let seen = self.things.iter().find(|thing| {
                let Some([x, y]) = tracer.board_point(&thing.board, lens, place, [0.0; 2]) else { return false };
                thing.outline.as_ref().is_none_or(|outline| {
                    let mut there = [0.0];
                    outline.level(0).sample(&[x as f32], &[y as f32], &mut there);
                    there[0] > 0.5
                })
            })?;
            if common.is_some_and(|distance| distance != seen.board.distance) {
                return None;
            }
            common = Some(seen.board.distance);
        }
        common
    }
}

/// A fish's outline: an ellipse of half length `a` and half height `b` with a tail; it swims to the left.
fn fish(x: f64, y: f64, a: f64, b: f64) -> bool {
    let body = (x / (0.8 * a)).powi(2) + (y / b).powi(2) < 1.0;
    let tail = (0.55 * a..a).contains(&x) && y.abs() < b * (0.15 + 1.6 * (x / a - 0.55));
    let fin = (-0.2 * a..0.25 * a).contains(&x) && (-1.35 * b..0.0).contains(&y) && y > -1.35 * b + (x / a).abs() * b;
    body || tail || fin
}

/// Blades of grass from below, bent.
fn blades(x: f64, y: f64) -> bool {
    (0..9).any(|k| {
        let k = f64::from(k);
        let foot = -1.1 + 0.27 * k;
        let height = 0.55 + 0.25 * (1.7 * k).sin();
        let up = 1.3 - y;
        let top = 0.3 + height;
        let bend = 0.12 * (2.1 * k).cos() * up * up;
        up < top && (x - foot - bend).abs() < 0.055 * (1.0 - 0.6 * up / top)
    })
}

fn depth(chapter: &mut Chapter, scene: &Tank, shot: &Shot) {
    let tracer = Tracer::new(&shot.camera);
    let mut table = Table::new(
        "depth",
        "Distances of micro-images that see one thing only",
        &[
            "distance, mm",
            "micro-images",
            "measured",
            "median of z, mm",
            "median |z/z_true − 1|, %",
            "95th percentile, %",
        ],
    );
    let mut all = Vec::new();
    for distance in [NEAR_MM, FAR_MM, WALL_MM] {
        let (mut count, mut found) = (0, Vec::new());
        for (lens, &measured) in shot.pictures.depth.lenses.iter().zip(&shot.pictures.distances_mm) {
            if scene.distance(&tracer, &shot.camera, lens.centre_px) != Some(distance) {
                continue;
            }
            count += 1;
            if lens.state == DepthState::Measured {
                found.extend(measured);
            }
        }
        let mut errors: Vec<f64> = found.iter().map(|z| (z / distance - 1.0).abs()).collect();
        all.extend_from_slice(&errors);
        errors.sort_unstable_by(f64::total_cmp);
        found.sort_unstable_by(f64::total_cmp);
        let at = |values: &[f64], percent: usize| values.get(values.len().saturating_sub(1) * percent / 100).copied();
        let shown = |value: Option<f64>, scale: f64, digits: usize| {
            value.map_or("–".to_owned(), |v| format!("{:.digits$}", scale * v))
        };
        table.push([
            format!("{distance:.0}"),
            count.to_string(),
            found.len().to_string(),
            shown(at(&found, 50), 1.0, 1),
            shown(at(&errors, 50), 100.0, 2),
            shown(at(&errors, 95), 100.0, 2),
        ]);
    }
    chapter.tables.push(table);
    all.sort_unstable_by(f64::total_cmp);
    let median = all.get(all.len() / 2).copied().unwrap_or(f64::NAN);
    chapter.findings.push(Finding::compared(
        "median of |z/z_true − 1| over textured micro-images",
        "a map of patch sizes, no distances",
        format!("{:.2} %", 100.0 * median),
        median < 0.03,
        "micro-images at the outline of a thing see two distances and are left out of the figure",
    ));
    let least = 0.9 * NEAR_MM;
    let greatest = 1.05 * WALL_MM;
    if let Ok((extent, distances)) = shot.pictures.distances() {
        let colours: Vec<u8> = distances
            .iter()
            .flat_map(
                |&mm| if mm.is_nan() { [40, 40, 40] } else { colour((f64::from(mm) - least) / (greatest - least)) },
            )
            .collect();
        let caption = format!("depth map: {least:.0} mm (blue) to {greatest:.0} mm (yellow), grey: unknown");
        chapter.pictures.push(colour_png("depth", caption, extent.width, extent.height, &colours));
    }
}

/// A colour that grows lighter with the value, told apart by the colour-blind too: blue, grey, yellow.
fn colour(value: f64) -> [u8; 3] {
    let t = value.clamp(0.0, 1.0);
    let mix = |from: f64, to: f64| (from + (to - from) * t).round() as u8;
    [mix(0.0, 255.0), mix(34.0, 234.0), mix(120.0, 70.0)]
}

fn pictures(chapter: &mut Chapter, studio: &Studio, shot: &Shot) -> Result<(), StudyError> {
    let failed = |error| StudyError::unseen("a view of the two fish", error);
    let spacing = |distance: f64| ExactView { board_distance: distance, ..shot.view }.paraxial_spacing() / studio.pixel;
    let pitch = shot.pictures.grid().pitch_px();
    // The nearer thing has the larger spacing and the smaller patch.
    let [small, large] = [NEAR_MM, FAR_MM].map(spacing);
    let own = Patches::Own(&shot.pictures.depth);
    let views: [(&str, String, Patches, View); 4] = [
        (
            "small",
            format!("small patches, {:.2} px: the foreground's", pitch - small),
            Patches::Fixed(small),
            shot.pictures.fixed(small, Blend::Abutting).map_err(failed)?,
        ),
        (
            "large",
            format!("large patches, {:.2} px: the background's", pitch - large),
            Patches::Fixed(large),
            shot.pictures.fixed(large, Blend::Abutting).map_err(failed)?,
        ),
        (
            "all_in_focus",
            "all in focus, by the depth map".to_owned(),
            own,
            shot.pictures.all_in_focus().map_err(failed)?,
        ),
        ("central", "central view, by the depth map".to_owned(), own, shot.pictures.view([0.0; 2]).map_err(failed)?),
    ];
    let mut table = Table::new(
        "views",
        "The views of Figure 11, and the central one",
        &["view", "size, px", "EOG, sum", "EOG, mean per pixel", "EOG of the scene, sum", "block artefacts (1: none)"],
    );
    chapter.pictures.insert(0, raw_png("raw", "raw frame, middle", &shot.raw, SHOWN_PX));
    let mut figures = Vec::new();
    for (name, caption, patches, view) in views {
        let energy = eog(&view);
        let of_scene = eog_of_scene(&view, shot.pictures.grid(), patches, &shot.pictures.depth);
        let of_scene = of_scene.map_or(f64::NAN, |energy| energy.sum);
        let blocks = blockiness(&view, shot.pictures.grid()).unwrap_or(f64::NAN);
        table.push([
            caption.clone(),
            format!("{}×{}", view.width, view.height),
            format!("{:.3e}", energy.sum),
            format!("{:.1}", energy.mean_per_pixel),
            format!("{of_scene:.3e}"),
            format!("{blocks:.3}"),
        ]);
        figures.push((energy.sum, blocks, of_scene));
        chapter.pictures.push(view_png(name, caption, &view));
    }
    for distance in [NEAR_MM, FAR_MM] {
        let view = shot.pictures.refocused(distance).map_err(failed)?;
        let name = format!("refocus_{distance:.0}");
        chapter.pictures.push(view_png(&name, format!("refocused at {distance:.0} mm"), &view));
    }
    let fewer = figures[2].1 < figures[0].1 && figures[2].1 < figures[1].1;
    chapter.findings.push(Finding::compared(
        "block artefacts: step across patches over step within them",
        "fewest in all-in-focus, by eye",
        format!("{:.3} small, {:.3} large, {:.3} all in focus", figures[0].1, figures[1].1, figures[2].1),
        fewer,
        "views of one patch size are laid side by side as in the paper; the all-in-focus view takes each place from all \
         micro-images that see it",
    ));
    let above = |energy: &dyn Fn(usize) -> f64| energy(2) > energy(0) && energy(2) > energy(1);
    let shown = |energy: &dyn Fn(usize) -> f64| {
        format!("{:.3e} small, {:.3e} large, {:.3e} all in focus", energy(0), energy(1), energy(2))
    };
    let of_scene = |k: usize| figures[k].2;
    chapter.findings.push(Finding::compared(
        "energy of gradient of the scene: without the steps across patches, and with what a view shows twice counted once",
        "both fish sharp in all-in-focus, by eye",
        shown(&of_scene),
        above(&of_scene),
        "the sum, which does not change with the size a view is drawn at. A patch is sharp in itself whatever its size: a \
         view of one patch size loses what its patches are too small for, and repeats what they are too large for",
    ));
    let whole = |k: usize| figures[k].0;
    chapter.findings.push(Finding::compared(
        "energy of gradient of the whole views (Eq. 20)",
        "both fish sharp in all-in-focus, by eye",
        shown(&whole),
        above(&whole),
        "Eq. 20 counts block artefacts as edges, and what is shown twice as twice as much: patches of the background's size \
         show the foreground more than once over. A view of one patch size gains by being worse",
    ));
    chapter.tables.push(table);
    Ok(())
}
