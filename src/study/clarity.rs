//! Figure 8: raw frames and central views of a ChArUco board and two fish-like textures in all four cases, and their
//! energy of gradient.

use std::sync::Arc;

use super::case::{Case, cases};
use super::chapter::{Chapter, Chart, Curve, Finding, Table};
use super::on_board::{Raster, on_board};
use super::studio::{Shot, Studio, raw_png, view_png};
use super::{Desk, StudyError};
use crate::config::Texture;
use crate::imaging::clarity::{Eog, eog};
use crate::imaging::depth::DepthState;
use crate::imaging::view::View;
use crate::sim::scene::{Board, Scene, texel_for};
use crate::sim::texture::TextureMap;

/// The textures by name, and whether the paper has figures for them as a board (or as fishes).
const TEXTURES: [(Texture, &str); 3] =
    [(Texture::Charuco, "charuco"), (Texture::Guppy, "guppy"), (Texture::Oscar, "oscar")];
/// Side of a raw frame's piece that is shown, px.
const SHOWN_PX: usize = 300;
/// Frames of one pose with noise of their own, by whose scatter "within noise" is judged.
const REPEATS: u64 = 2;

/// One texture at one case.
struct Seen {
    case: &'static str,
    eog: Eog,
    size: [usize; 2],
    patch_px: f64,
    /// On the piece of board that all cases see, by repeat.
    on_board: Vec<f64>,
}

/// Makes the chapter.
pub(super) fn write(desk: &Desk<'_>) -> Result<Chapter, StudyError> {
    let (config, design) = (desk.config, desk.config.design());
    let pixel = config.pixel_pitch().millimetres();
    let side = if desk.options.quick { 400 } else { config.sensor.width_px.min(config.sensor.height_px) as usize };
    let studio = Studio { design, pixel, side, rays: 16, noise: 2.0, seed: desk.options.seed };
    let [.., joint] = cases(config);
    // One board for all: its finest detail is what the joint camera just resolves.
    let texel = texel_for(&design, joint.medium(&design), design.object_distance, pixel);
    // The piece of board that every case sees, and a scale that none of the cameras in focus has to invent.
    let narrowest = cases(config)
        .iter()
        .filter_map(|case| {
            let edge = case.view(&design).chief_board_point([0.44 * side as f64 * pixel, 0.0])?;
            Some(edge[0].abs())
        })
        .fold(f64::INFINITY, f64::min);
    let raster = Raster { half_mm: 0.95 * narrowest, pixel_mm: 10.0 * texel };

    let mut chapter = Chapter::default();
    chapter.text.push(format!(
        "One board per texture, {:.0} mm away in every case, a sensor of {side}×{side} px, {} rays a pixel, read noise of \
         {} grey levels. Views are made with patches whose size is each micro-image's own (pitch less spacing); the \
         energy of gradient (Eq. 20) is that of the view scaled to [0, 255]. It grows with the number of pixels, and the \
         view of a camera out of focus has fewer: sum and mean per pixel are given with the view's and the patch's size.",
        design.object_distance, studio.rays, studio.noise
    ));
    chapter.text.push(format!(
        "A larger energy of gradient counts edges in view, so a camera that sees more of the board has more. The last \
         columns compare the same piece of board, {:.0} mm wide, at the same scale of {:.2} mm a pixel, luminance brought \
         to the same mean as in Section 3.2; there the clarity and the joint camera see the same.",
        2.0 * raster.half_mm, raster.pixel_mm
    ));
    let mut table = Table::new(
        "eog",
        "Energy of gradient of the central view",
        &[
            "texture",
            "case",
            "view, px",
            "median patch, px",
            "EOG, sum",
            "to direct",
            "EOG, mean per pixel",
            "to direct",
            "same board, mean per pixel",
            "to direct",
        ],
    );
    let scales: &[f64] = if desk.options.quick { &[4.0, 12.0] } else { &[1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0] };
    let of = (TEXTURES.len() * 4 + scales.len()) as u64;
    let mut ratios: Vec<[[f64; 3]; 2]> = Vec::new();
    let mut pairs = Vec::new();
    for (number, (texture, name)) in TEXTURES.into_iter().enumerate() {
        let map = Arc::new(TextureMap::generate(texture, texel, desk.options.seed));
        let mut seen = Vec::new();
        for (k, case) in cases(config).into_iter().enumerate() {
            let board = Board::new(case.distance(&design), Arc::clone(&map));
            seen.push(look(&studio, &case, &Scene::Board(board), raster, name, &mut chapter)?);
            desk.watch.done((4 * number + k) as u64 + 1, of);
        }
        let direct = [seen[1].eog.sum, seen[1].eog.mean_per_pixel, mean(&seen[1].on_board)];
        let ratio = |seen: &Seen| {
            [seen.eog.sum / direct[0], seen.eog.mean_per_pixel / direct[1], mean(&seen.on_board) / direct[2]]
        };
        for seen in &seen {
            let [sum, per_pixel, same] = ratio(seen);
            table.push([
                name.to_owned(),
                seen.case.to_owned(),
                format!("{}×{}", seen.size[0], seen.size[1]),
                format!("{:.2}", seen.patch_px),
                format!("{:.3e}", seen.eog.sum),
                format!("{sum:.2}"),
                format!("{:.1}", seen.eog.mean_per_pixel),
                format!("{per_pixel:.2}"),
                format!("{:.1}", mean(&seen.on_board)),
                format!("{same:.2}"),
            ]);
        }
        ratios.push([ratio(&seen[2]), ratio(&seen[3])]);
        pairs.push((name, mean(&seen[3].on_board) / mean(&seen[2].on_board), noise_of(&seen[2], &seen[3])));
    }
    chapter.tables.push(table);
    findings(&mut chapter, &ratios, &pairs);
    let progress = |k: usize| desk.watch.done((4 * TEXTURES.len() + k) as u64, of);
    coarser(&mut chapter, &studio, &cases(config), texel, scales, &progress)?;
    Ok(chapter)
}

/// The gain over the direct case on boards whose detail is coarser: what the ratio of energies depends on most.
fn coarser(
    chapter: &mut Chapter,
    studio: &Studio,
    all: &[Case; 4],
    texel: f64,
    scales: &[f64],
    progress: &dyn Fn(usize),
) -> Result<(), StudyError> {
    let [_, direct, clarity, joint] = all;
    let mut curves = [Vec::new(), Vec::new()];
    let mut table = Table::new(
        "coarser",
        "The same with coarser detail: oscar, EOG to direct, sum",
        &["detail, times as coarse", "clarity to direct", "joint to direct"],
    );
    for (k, &scale) in scales.iter().enumerate() {
        let map = Arc::new(TextureMap::generate(Texture::Oscar, scale * texel, studio.seed));
        let energy = |case: &Case| {
            let board = Board::new(case.distance(&studio.design), Arc::clone(&map));
            let shot = studio.take(case, &Scene::Board(board), 0)?;
            let view = shot.pictures.view([0.0; 2]);
            let view = view.map_err(|error| StudyError::unseen(format!("coarser detail, “{}”", case.name), error))?;
            // Seen as large as it is: a view of fewer pixels shows the same board in steeper steps.
            Ok::<_, StudyError>(eog(&view).sum)
        };
        let reference = energy(direct)?;
        let ratios = [energy(clarity)? / reference, energy(joint)? / reference];
        table.push([format!("{scale}"), format!("{:.2}", ratios[0]), format!("{:.2}", ratios[1])]);
        for (curve, ratio) in curves.iter_mut().zip(ratios) {
            curve.push([scale, ratio]);
        }
        progress(k + 1);
    }
    let [by_clarity, by_joint] = curves;
    let least = by_clarity.iter().map(|point| point[1]).fold(f64::INFINITY, f64::min);
    chapter.text.push(format!(
        "How many times the energy grows depends on the board more than on the camera: blur takes fine detail first. With \
         detail as fine as the camera in focus just resolves, little is left in the direct case; the coarser the detail, \
         the nearer the ratio comes to the paper's (down to {least:.1} in the table below)."
    ));
    chapter.tables.push(table);
    chapter.charts.push(Chart {
        name: "coarser".to_owned(),
        title: "Gain in energy of gradient over the direct case, by how coarse the detail is".to_owned(),
        x: "detail, times as coarse as what the camera in focus just resolves".to_owned(),
        y: "EOG (sum) to direct".to_owned(),
        curves: vec![
            Curve::line("clarity", by_clarity),
            Curve::line("joint", by_joint),
            Curve::line("paper, ChArUco: clarity", vec![[scales[0], 2.34], [scales[scales.len() - 1], 2.34]]),
        ],
    });
    Ok(())
}

/// Takes a scene at a case, keeps the pictures and measures them.
fn look(
    studio: &Studio,
    case: &Case,
    scene: &Scene,
    raster: Raster,
    texture: &str,
    chapter: &mut Chapter,
) -> Result<Seen, StudyError> {
    let failed =
        |error: &dyn std::fmt::Display| StudyError::unseen(format!("{texture} at the case “{}”", case.name), error);
    let mut on = Vec::new();
    let mut first: Option<(Shot, View)> = None;
    for repeat in 0..REPEATS {
        let shot = studio.take(case, scene, repeat)?;
        let view = shot.pictures.view([0.0; 2]).map_err(|error| failed(&error))?;
        let piece =
            on_board(&shot, &view, raster).ok_or_else(|| failed(&"the common piece of board is not all in view"))?;
        on.push(energy(&piece));
        first.get_or_insert((shot, view));
    }
    let Some((shot, view)) = first else { return Err(failed(&"no frame was taken")) };
    let pitch = shot.pictures.grid().pitch_px();
    let mut patches: Vec<f64> = shot
        .pictures
        .depth
        .lenses
        .iter()
        .filter(|lens| lens.state != DepthState::Unknown)
        .map(|lens| (pitch - lens.spacing_px).abs())
        .collect();
    patches.sort_unstable_by(f64::total_cmp);
    let name = |kind: &str| format!("{texture}-{}-{kind}", case.name);
    chapter.pictures.push(raw_png(
        &name("raw"),
        format!("{texture}, {}: raw frame, middle", case.name),
        &shot.raw,
        SHOWN_PX,
    ));
    let found = eog(&view);
    let caption =
        format!("{texture}, {}: central view, EOG {:.2e} ({:.0} a pixel)", case.name, found.sum, found.mean_per_pixel);
    chapter.pictures.push(view_png(&name("view"), caption, &view));
    Ok(Seen {
        case: case.name,
        eog: found,
        size: [view.width, view.height],
        patch_px: patches.get(patches.len() / 2).copied().unwrap_or(f64::NAN),
        on_board: on,
    })
}

/// Energy of gradient a pixel of a picture as it is, without scaling its range: its mean has been set.
fn energy(view: &View) -> f64 {
    let (w, values) = (view.width, &view.planes[0]);
    let mut sum = 0.0;
    for y in 0..view.height - 1 {
        for x in 0..w - 1 {
            let here = f64::from(values[y * w + x]);
            sum +=
                (f64::from(values[y * w + x + 1]) - here).powi(2) + (f64::from(values[(y + 1) * w + x]) - here).powi(2);
        }
    }
    sum / ((w - 1) * (view.height - 1)) as f64
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// By how much the ratio of two cases scatters from frame to frame, as a share.
fn noise_of(one: &Seen, other: &Seen) -> f64 {
    let spread = |seen: &Seen| {
        let m = mean(&seen.on_board);
        seen.on_board.iter().map(|v| (v / m - 1.0).abs()).fold(0.0, f64::max)
    };
    spread(one).hypot(spread(other))
}

fn findings(chapter: &mut Chapter, ratios: &[[[f64; 3]; 2]], pairs: &[(&str, f64, f64)]) {
    let about = "The order is the paper's. The factor is larger: textures, MLA, aperture and pixels are ours, and our boards \
                 have detail as fine as the camera in focus just resolves, of which a blur of 5.7 px leaves nothing; see the \
                 chart for coarser detail.";
    let close = |ratio: f64, paper: f64| (ratio / paper - 1.0).abs() < 0.3;
    let [charuco, fishes @ ..] = ratios else { return };
    let range = |values: Vec<f64>| {
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        let greatest = values.iter().copied().fold(0.0, f64::max);
        format!("{least:.2} to {greatest:.2} times")
    };
    chapter.findings.push(Finding::compared(
        "ChArUco, clarity against direct",
        "2.34 times",
        format!(
            "{:.2} times in sum, {:.2} per pixel, {:.2} on the same board",
            charuco[0][0], charuco[0][1], charuco[0][2]
        ),
        close(charuco[0][0], 2.34),
        about,
    ));
    for (k, (case, paper)) in [("clarity", 2.52), ("joint", 5.44)].into_iter().enumerate() {
        let of = |figure: usize| range(fishes.iter().map(|fish| fish[k][figure]).collect());
        chapter.findings.push(Finding::compared(
            format!("fishes, {case} against direct"),
            format!("{paper} times"),
            format!("{} in sum, {} per pixel, {} on the same board", of(0), of(1), of(2)),
            fishes.iter().all(|fish| close(fish[k][0], paper)),
            about,
        ));
    }
    let joint_to_clarity = charuco[1][0] / charuco[0][0];
    chapter.findings.push(Finding::compared(
        "ChArUco, joint against clarity, whole views",
        "6200 / 5380 = 1.15",
        format!("{joint_to_clarity:.2} in sum"),
        joint_to_clarity > 1.0,
        "May go either way: both are in focus; e = 30 sees a wider piece of board by Snell and so more edges, the joint \
         camera draws the piece it sees larger. A difference between the two in whole views is one of field, not of \
         clarity.",
    ));
    for &(name, ratio, noise) in pairs {
        chapter.findings.push(Finding::new(
            format!("{name}, joint against clarity on the same piece of board at the same scale"),
            format!("{ratio:.3}; frames of one pose scatter by {noise:.3}"),
            "both are in focus at 800 mm, so that what is left is the sampling: the joint camera has about a fifth more \
             pixels a millimetre",
        ));
    }
}
