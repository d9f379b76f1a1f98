//! How far the measured spacing is from the truth, over many seeds: bias, scatter, the estimator's own uncertainties and
//! how often they cover the error. A frame for every seed: its own texture, rotation, offset and noise.
//!
//! ```sh
//! cargo bench --bench accuracy                      # 25 seeds of every case
//! cargo bench --bench accuracy -- 1-200 water       # 200 seeds of the cases whose name contains "water"
//! ```

use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use plenalign::config::Config;
use plenalign::imaging::measurement::{FrameOptions, WhiteModel, measure_frame};
use plenalign::imaging::spacing::Spacing;
use plenalign::sim::configured;
use plenalign::sim::exposure::expose;
use plenalign::sim::renderer::{CameraTruth, Medium, RenderOptions, Renderer};
use plenalign::sim::scene::{Board, Scene, texel_for};

const PIXEL_MM: f64 = 0.00345;
/// Side of a frame, px.
const SIDE: usize = 400;
const RAYS: u32 = 32;

/// One row of the table: what is seen, and how the configuration departs from the reference.
struct Case {
    name: String,
    config: Config,
    water: bool,
}

fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for (medium, water) in [("air", false), ("water", true)] {
        for array in ["square", "hexagonal"] {
            for texture in ["natural", "charuco", "guppy", "oscar"] {
                for noise in ["0", "2", "8"] {
                    let keys = [("mla.array", array), (TEXTURE, texture), (NOISE, noise)];
                    cases.push(case(format!("{medium} {array} {texture} {noise}"), water, &keys));
                }
            }
        }
    }
    let simulation = |key: &str| format!("bench.simulation.{key}");
    for (flaw, keys) in [
        ("cross-talk", &[("cross_talk", "true")][..]),
        // More would be an aberration of the near board's image on the axis too, which the exact rays do not have.
        ("distortion", &[("distortion_k1", "-0.1"), ("exit_pupil_walk_mm", "0.3")]),
        ("dust", &[("dust.specks", "60")]),
        ("dead", &[("microlenses.dead_share", "0.03"), ("microlenses.dirty_share", "0.05")]),
        ("bubbles", &[("bubbles.count", "12")]),
        ("two focal lengths", &[("microlenses.focal_factors", "[0.9, 1.1]")]),
        ("12 bits", &[("bits", "12")]),
        ("board moved", &[("motion.steps", "5"), ("motion.board_um", "[60.0, 0.0]")]),
    ] {
        let keys: Vec<(String, &str)> = keys.iter().map(|(key, value)| (simulation(key), *value)).collect();
        let mut all = vec![(TEXTURE, "natural"), (NOISE, "2")];
        all.extend(keys.iter().map(|(key, value)| (key.as_str(), *value)));
        for (medium, water) in [("air", false), ("water", true)] {
            cases.push(case(format!("{medium} flawed: {flaw}"), water, &all));
        }
    }
    let mosaic = [("sensor.mosaic", "rggb"), (TEXTURE, "natural"), (NOISE, "2")];
    cases.push(case("air mosaic".to_owned(), false, &mosaic));
    cases.push(case("water mosaic".to_owned(), true, &mosaic));
    cases
}

const TEXTURE: &str = "bench.simulation.texture";
const NOISE: &str = "bench.simulation.read_noise_levels";

fn case(name: String, water: bool, keys: &[(&str, &str)]) -> Case {
    let mut config = Config::default();
    for (key, value) in keys {
        config.set(key, value).unwrap_or_else(|error| panic!("{name}: {error}"));
    }
    Case { name, config, water }
}

/// A measured frame, its error (the spacing less what exact rays averaged over the estimator's window have), and the
/// time that preparing and measuring took, ms.
fn measured(case: &Case, seed: u64) -> Result<(Spacing, f64, f64), String> {
    let (config, design) = (&case.config, case.config.design());
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
    let simulation = &config.bench.simulation;
    let camera = CameraTruth::from_design(&design, delta_v, medium, PIXEL_MM, SIDE, SIDE);
    let camera = configured::camera(camera, simulation, seed);
    let renderer = Renderer::new(RenderOptions { rays: RAYS, seed });
    let flaws = configured::flaws(config, case.water, seed);
    let texel = texel_for(&design, medium, distance, PIXEL_MM);
    let map = Arc::new(configured::texture(config, simulation.texture, texel, seed));
    let shutter = configured::shutter(config);
    let frame = |scene: &Scene, noise: u64| {
        expose(&shutter.collect(&renderer, &camera, scene, &flaws), SIDE, SIDE, &configured::noise(simulation), noise)
    };
    let white = frame(&Scene::Diffuser, 2 * seed);
    let raw = frame(&Scene::Board(Board::new(distance, map)), 2 * seed + 1);
    let mut options = FrameOptions { mosaic: config.sensor.mosaic, ..FrameOptions::new(design.mla.pitch / PIXEL_MM) };
    options.spacing.bound = true;
    let white = WhiteModel::of(&white, &options).map_err(|error| error.to_string())?;
    let start = Instant::now();
    let spacing = measure_frame(&raw, Some(&white), &options).map_err(|error| error.to_string())?.spacing;
    let time = 1e3 * start.elapsed().as_secs_f64();
    let view = match case.water {
        true => design.exact_in_water(delta_v, 0.0),
        false => design.exact_in_air(delta_v, distance),
    };
    let excess = if case.water { view.excess(spacing.window_px * PIXEL_MM).unwrap_or(0.0) } else { 0.0 };
    let truth = (view.paraxial_spacing() + excess) / PIXEL_MM;
    let error = spacing.on_axis_px - truth;
    Ok((spacing, error, time))
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
    println!(
        "case                            frames  refused    bias     rms   sigma  random   bound  covered      ms"
    );
    for case in cases().iter().filter(|case| case.name.contains(&wanted)) {
        let results: Vec<_> = seeds.clone().map(|seed| measured(case, seed)).collect();
        let good: Vec<_> = results.iter().flatten().collect();
        let n = good.len().max(1) as f64;
        let mean = |value: &dyn Fn(&(Spacing, f64, f64)) -> f64| good.iter().map(|r| value(r)).sum::<f64>() / n;
        let bias = mean(&|(_, error, _)| *error);
        let rms = mean(&|(_, error, _)| error * error).sqrt();
        let sigma = mean(&|(spacing, ..)| spacing.sigma_px);
        let random = mean(&|(spacing, ..)| spacing.sigma_random_px);
        let bound = mean(&|(spacing, ..)| spacing.sigma_bound_px.unwrap_or(f64::NAN));
        let covered = mean(&|(spacing, error, _)| f64::from(u8::from(error.abs() < 2.0 * spacing.sigma_px)));
        println!(
            "{:30}  {:6}  {:7}  {:6.2}  {:6.2}  {:6.2}  {:6.2}  {:6.2}  {:5.1} %  {:6.1}",
            case.name,
            good.len(),
            results.len() - good.len(),
            1e3 * bias,
            1e3 * rms,
            1e3 * sigma,
            1e3 * random,
            1e3 * bound,
            100.0 * covered,
            mean(&|(_, _, time)| *time)
        );
        if let Some(Err(reason)) = results.iter().find(|result| result.is_err()) {
            println!("    refused: {reason}");
        }
    }
    ExitCode::SUCCESS
}
