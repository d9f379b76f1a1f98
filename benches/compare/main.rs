//! This program's side of the comparison with OpenCV and NumPy: renders frames, measures them, and leaves frames and
//! figures in the folder given, for `opencv.py` beside this file. `make bench` runs both.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use plenalign::config::{Config, Texture};
use plenalign::imaging::grid::{Grid, GridOptions, find_grid};
use plenalign::imaging::live::{LiveMeter, LiveOptions};
use plenalign::imaging::measurement::{FrameOptions, WhiteModel, prepare_frame};
use plenalign::imaging::spacing::measure_spacing;
use plenalign::optics::ArrayKind;
use plenalign::raw::{self, RawImage};
use plenalign::sim::exposure::{Noise, expose};
use plenalign::sim::renderer::{CameraTruth, Medium, RenderOptions, render};
use plenalign::sim::scene::{Board, Scene, texel_for};
use plenalign::sim::texture::TextureMap;
use serde_json::{Value, json};

const PIXEL_MM: f64 = 0.00345;
/// The fastest of so many runs counts.
const RUNS: usize = 3;

/// A frame with its white frame, and what is true of it.
struct Case {
    name: String,
    white: RawImage,
    raw: RawImage,
    array: ArrayKind,
    pitch_px: f64,
    rotation: f64,
    centre_px: [f64; 2],
    spacing_px: f64,
}

/// A frame of the reference camera in air, off focus by a little.
fn rendered(name: &str, width: usize, height: usize, array: ArrayKind, texture: Texture, rays: u32) -> Case {
    let mut config = Config::default();
    config.mla.array = array;
    let design = config.design();
    let joint = design.joint(0.0);
    let (delta_v, distance) = (joint.delta_v - 0.03, joint.equivalent_distance);
    let mut camera = CameraTruth::from_design(&design, delta_v, Medium::Air, PIXEL_MM, width, height);
    camera.rotation = 0.4f64.to_radians();
    camera.offset = [3.3, -6.1];
    let rays = RenderOptions { rays, seed: 1 };
    let map = Arc::new(TextureMap::generate(texture, texel_for(&design, Medium::Air, distance, PIXEL_MM), 1));
    let board = Scene::Board(Board::new(distance, map));
    let noise = Noise::default();
    let white = expose(&render(&camera, &Scene::Diffuser, rays), width, height, &noise, 1);
    let raw = expose(&render(&camera, &board, rays), width, height, &noise, 2);
    // Gauss, and the geometry of the array: nothing of the estimator's.
    let image = camera.focal_length * distance / (distance - camera.focal_length);
    let a = image - camera.lens_to_mla;
    let spacing_px = camera.mla_pitch * (a - camera.mla_to_sensor) / a / PIXEL_MM;
    let enlarged = (camera.lens_to_mla + camera.mla_to_sensor) / camera.lens_to_mla;
    let middle = [(width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0];
    Case {
        name: name.to_owned(),
        white,
        raw,
        array,
        pitch_px: camera.mla_pitch * enlarged / PIXEL_MM,
        rotation: camera.rotation,
        centre_px: [middle[0] + enlarged * camera.offset[0], middle[1] + enlarged * camera.offset[1]],
        spacing_px,
    }
}

/// A frame of another renderer, with its truth.
fn referee(name: &str) -> Case {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/referee");
    let read = |name: String| raw::read(&data.join(name)).expect("a referee frame");
    let text = std::fs::read_to_string(data.join("truth.json")).expect("the referee's truth");
    let truth: Value = serde_json::from_str(&text).expect("JSON");
    let truth = &truth["frames"][name];
    let number = |key: &str| truth[key].as_f64().expect("a number");
    let centre = |k: usize| truth["a_micro_image_centre_px"][k].as_f64().expect("a number");
    Case {
        name: format!("referee {name}"),
        white: read(format!("{name}_white.png")),
        raw: read(format!("{name}.png")),
        array: if truth["array"] == "square" { ArrayKind::Square } else { ArrayKind::Hexagonal },
        pitch_px: number("micro_image_pitch_px"),
        rotation: number("rotation_deg").to_radians(),
        centre_px: [centre(0), centre(1)],
        spacing_px: number("spacing_on_axis_px"),
    }
}

/// What `work` gives, and the shortest of its times, ms.
fn best_of<T>(mut work: impl FnMut() -> T) -> (T, f64) {
    let mut shortest = f64::INFINITY;
    let mut result = None;
    for _ in 0..RUNS {
        let start = Instant::now();
        result = Some(work());
        shortest = shortest.min(start.elapsed().as_secs_f64());
    }
    (result.expect("at least one run"), 1e3 * shortest)
}

fn basis(case: &Case) -> [[f64; 2]; 2] {
    let at = |angle: f64| [case.pitch_px * angle.cos(), case.pitch_px * angle.sin()];
    let step: f64 = if case.array == ArrayKind::Square { 90.0 } else { 60.0 };
    [at(case.rotation), at(case.rotation + step.to_radians())]
}

/// Root mean square distance of the grid's micro-images from the true ones, px.
fn grid_error(case: &Case, grid: &Grid) -> f64 {
    let truth = Grid::affine(case.array, case.centre_px, basis(case), grid.frame_size);
    let squares: Vec<f64> = grid
        .micro_images_within(0.75 * case.pitch_px)
        .map(|m| {
            let near = truth.nearest(m.x, m.y);
            (m.x - near.x).powi(2) + (m.y - near.y).powi(2)
        })
        .collect();
    (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt()
}

fn measured(case: &Case, folder: &Path, number: usize) -> Value {
    let names = [format!("{number}_white.png"), format!("{number}.png")];
    for (name, image) in names.iter().zip([&case.white, &case.raw]) {
        raw::write(&folder.join(name), image).expect("the folder can be written to");
    }
    let (grid, grid_ms) = best_of(|| find_grid(&case.white, &GridOptions::default()).expect("a grid"));
    let white = WhiteModel::new(&case.white).expect("a white frame");
    let options = FrameOptions { white_at_this_setting: true, ..FrameOptions::new(0.1 / PIXEL_MM) };
    let (spacing, spacing_ms) = best_of(|| {
        let prepared = prepare_frame(&case.raw, Some(&white), &options).expect("a frame");
        measure_spacing(&[prepared.frame], &options.spacing).expect("a spacing")
    });
    let live = LiveOptions { start_px: Some(case.spacing_px), ..LiveOptions::new(0.1 / PIXEL_MM) };
    let mut meter = LiveMeter::new(&white.grid, &white.vignetting, live).expect("a meter");
    let (live, live_ms) = best_of(|| meter.measure(&case.raw).expect("a live spacing"));
    json!({
        "name": case.name,
        "white": names[0],
        "raw": names[1],
        "width": case.raw.width(),
        "height": case.raw.height(),
        "array": case.array.name(),
        "pitch_px": case.pitch_px,
        "basis_px": basis(case),
        "centre_px": case.centre_px,
        "spacing_px": case.spacing_px,
        "grid_ms": grid_ms,
        "grid_error_px": grid_error(case, &grid),
        "spacing_ms": spacing_ms,
        "spacing_error_px": (spacing.on_axis_px - case.spacing_px).abs(),
        "live_ms": live_ms,
        "live_error_px": (live.on_axis_px - case.spacing_px).abs(),
    })
}

fn main() {
    let folder = std::env::args().skip(1).find(|argument| argument != "--bench").map(PathBuf::from);
    let folder = folder.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("target/compare"));
    std::fs::create_dir_all(&folder).expect("the folder can be made");
    let square = ArrayKind::Square;
    let cases = [
        referee("air_square"),
        referee("air_charuco"),
        rendered("1160x1160 square, natural", 1160, 1160, square, Texture::Natural, 32),
        rendered("1160x1160 hexagonal, guppy", 1160, 1160, ArrayKind::Hexagonal, Texture::Guppy, 32),
        rendered("4096x3072 square, natural", 4096, 3072, square, Texture::Natural, 16),
    ];
    let frames: Vec<Value> = cases.iter().enumerate().map(|(k, case)| measured(case, &folder, k)).collect();
    let text = serde_json::to_string_pretty(&json!({ "frames": frames })).expect("JSON");
    std::fs::write(folder.join("frames.json"), text).expect("the folder can be written to");
}
