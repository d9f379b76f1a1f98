//! How far the measured spacing is from the truth, over many seeds: bias, scatter, the estimator's own uncertainties and
//! how often they cover the error. A frame for every seed: its own texture, rotation, offset and noise.
//!
//! ```sh
//! cargo bench --bench accuracy                      # 25 seeds of every case
//! cargo bench --bench accuracy -- 1-200 water       # 200 seeds of the cases whose name contains "water"
//! ```

use std::process::ExitCode;
use std::sync::Arc;

use plenalign::config::{Config, Texture};
use plenalign::imaging::measurement::{FrameOptions, WhiteModel, measure_frame};
use plenalign::imaging::spacing::Spacing;
use plenalign::optics::{ArrayKind, CameraDesign};
use plenalign::sim::exposure::{Noise, expose};
use plenalign::sim::renderer::{CameraTruth, Medium, RenderOptions, render};
use plenalign::sim::scene::{Board, Scene, texel_for};
use plenalign::sim::texture::TextureMap;

const PIXEL_MM: f64 = 0.00345;
/// Side of a frame, px.
const SIDE: usize = 400;
const RAYS: u32 = 32;

/// One row of the table.
struct Case {
    name: String,
    texture: Texture,
    array: ArrayKind,
    water: bool,
    noise: f64,
}

fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for (medium, water) in [("air", false), ("water", true)] {
        for (array_name, array) in [("square", ArrayKind::Square), ("hexagonal", ArrayKind::Hexagonal)] {
            for (texture_name, texture) in [
                ("natural", Texture::Natural),
                ("charuco", Texture::Charuco),
                ("guppy", Texture::Guppy),
                ("oscar", Texture::Oscar),
            ] {
                for noise in [0.0, 2.0, 8.0] {
                    let name = format!("{medium} {array_name} {texture_name} {noise}");
                    cases.push(Case { name, texture, array, water, noise });
                }
            }
        }
    }
    cases
}

fn design(array: ArrayKind) -> CameraDesign {
    let mut config = Config::default();
    config.mla.array = array;
    config.design()
}

/// A measured frame and its error: the spacing less what exact rays averaged over the estimator's window have.
fn measured(case: &Case, seed: u64) -> Result<(Spacing, f64), String> {
    let design = design(case.array);
    let (medium, distance) = match case.water {
        true => (Medium::Water { shell: design.shell, e: 0.0, decentre: [0.0; 2] }, design.object_distance),
        false => (Medium::Air, design.joint(0.0).equivalent_distance),
    };
    let chance = |k: u64| {
        let mixed = (seed * 97 + k).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (mixed >> 11) as f64 / (1u64 << 53) as f64
    };
    // A Δv that is a little off puts the spacing anywhere between whole pixels.
    let delta_v = design.joint(0.0).delta_v + 0.12 * (chance(1) - 0.5);
    let mut camera = CameraTruth::from_design(&design, delta_v, medium, PIXEL_MM, SIDE, SIDE);
    camera.rotation = (2.0 * (chance(2) - 0.5)).to_radians();
    camera.offset = [20.0 * (chance(3) - 0.5), 20.0 * (chance(4) - 0.5)];
    let rays = RenderOptions { rays: RAYS, seed };
    let noise = Noise { read_noise_levels: case.noise, ..Noise::default() };
    let map = Arc::new(TextureMap::generate(case.texture, texel_for(&design, medium, distance, PIXEL_MM), seed));
    let white = expose(&render(&camera, &Scene::Diffuser, rays), SIDE, SIDE, &noise, 2 * seed);
    let raw =
        expose(&render(&camera, &Scene::Board(Board::new(distance, map)), rays), SIDE, SIDE, &noise, 2 * seed + 1);
    let white = WhiteModel::new(&white).map_err(|error| error.to_string())?;
    let options = FrameOptions::new(design.mla.pitch / PIXEL_MM);
    let spacing = measure_frame(&raw, Some(&white), &options).map_err(|error| error.to_string())?.spacing;
    let view = match case.water {
        true => design.exact_in_water(delta_v, 0.0),
        false => design.exact_in_air(delta_v, distance),
    };
    let excess = if case.water { view.excess(spacing.window_px * PIXEL_MM).unwrap_or(0.0) } else { 0.0 };
    let truth = (view.paraxial_spacing() + excess) / PIXEL_MM;
    let error = spacing.on_axis_px - truth;
    Ok((spacing, error))
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    let (mut seeds, mut wanted) = (1..=25, String::new());
    for argument in arguments {
        match argument.split_once('-').map(|(first, last)| (first.parse::<u64>(), last.parse::<u64>())) {
            Some((Ok(first), Ok(last))) => seeds = first..=last,
            _ => wanted = argument,
        }
    }
    println!("errors in thousandths of a pixel; covered: |error| < 2 sigma");
    println!("case                            frames  refused    bias     rms   sigma  random   bound  covered");
    for case in cases().iter().filter(|case| case.name.contains(&wanted)) {
        let results: Vec<_> = seeds.clone().map(|seed| measured(case, seed)).collect();
        let good: Vec<_> = results.iter().flatten().collect();
        let n = good.len().max(1) as f64;
        let mean = |value: &dyn Fn(&(Spacing, f64)) -> f64| good.iter().map(|r| value(r)).sum::<f64>() / n;
        let bias = mean(&|(_, error)| *error);
        let rms = mean(&|(_, error)| error * error).sqrt();
        let sigma = mean(&|(spacing, _)| spacing.sigma_px);
        let random = mean(&|(spacing, _)| spacing.sigma_random_px);
        let bound = mean(&|(spacing, _)| spacing.sigma_bound_px);
        let covered = mean(&|(spacing, error)| f64::from(u8::from(error.abs() < 2.0 * spacing.sigma_px)));
        println!(
            "{:30}  {:6}  {:7}  {:6.2}  {:6.2}  {:6.2}  {:6.2}  {:6.2}  {:5.1} %",
            case.name,
            good.len(),
            results.len() - good.len(),
            1e3 * bias,
            1e3 * rms,
            1e3 * sigma,
            1e3 * random,
            1e3 * bound,
            100.0 * covered
        );
        if let Some(Err(reason)) = results.iter().find(|result| result.is_err()) {
            println!("    refused: {reason}");
        }
    }
    ExitCode::SUCCESS
}
