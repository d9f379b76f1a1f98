//! Cameras that nobody chose: drawn at random, each aligned on the simulated bench, and judged by the simulated truth. One
//! that cannot be aligned is refused before anything moves, by a key and a value.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use plenalign::config::{Config, ConfigOrigin, Texture};
use plenalign::control::job::{JobSnapshot, JobState};
use plenalign::control::plan::PlanView;
use plenalign::optics::{ArrayKind, MlaMode};
use plenalign::raw::CfaPattern;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::alignment::number;
use super::bench::{align, service, small_config};

/// How many pixels a drawn sensor has.
#[derive(Debug, Clone, Copy)]
enum Sensor {
    /// So few that it is rendered in a blink.
    Small,
    /// From half a megapixel to twenty.
    Any,
}

/// A camera with its bench, drawn from what underwater plenoptic cameras may be like.
fn drawn(seed: u64, sensor: Sensor) -> Config {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut even = |low: f64, high: f64| low + (high - low) * random.random::<f64>();
    let mut config = Config::default();
    // Evenly over the ratio.
    let mut by_ratio = |low: f64, high: f64| (even(low.ln(), high.ln())).exp();
    let focal_length = by_ratio(10.0, 60.0);
    let resolution = by_ratio(2.2, 8.0);
    let disc_px = by_ratio(12.0, 60.0);
    let radius = by_ratio(40.0, 200.0);
    let distance = by_ratio(300.0, 3000.0);
    let air_distance = by_ratio(300.0, 3000.0).max(10.0 * focal_length);
    let megapixels = by_ratio(0.5, 20.0);
    let keplerian = even(0.0, 1.0) < 0.5;
    let hexagonal = even(0.0, 1.0) < 0.5;
    let pixel_um = [2.4, 3.45, 4.5, 5.5][even(0.0, 4.0) as usize];
    let f_number = even(2.8, 6.0);
    let thickness = radius * even(0.04, 0.13);
    let aspect = even(0.7, 1.6);

    let pitch = disc_px * pixel_um / 1000.0;
    let signed = if keplerian { -resolution } else { resolution };
    config.main_lens.focal_length_mm = focal_length;
    config.mla.array = if hexagonal { ArrayKind::Hexagonal } else { ArrayKind::Square };
    config.mla.mode = if keplerian { MlaMode::Keplerian } else { MlaMode::Galilean };
    config.mla.angular_resolution = resolution;
    config.mla.pitch_mm = pitch;
    config.mla.focal_length_mm = f_number * pitch / (1.0 - 1.0 / signed);
    config.sensor.pixel_um = pixel_um;
    let [width, height] = match sensor {
        Sensor::Small => [600.0 * aspect.sqrt(), 600.0 / aspect.sqrt()],
        Sensor::Any => [(1e6 * megapixels * aspect).sqrt(), (1e6 * megapixels / aspect).sqrt()],
    };
    (config.sensor.width_px, config.sensor.height_px) = (2 * (width / 2.0) as u32, 2 * (height / 2.0) as u32);
    config.shell.outer_radius_mm = radius;
    config.shell.inner_radius_mm = radius - thickness;
    config.shell.refractive_index = if even(0.0, 1.0) < 0.5 { 1.49 } else { 1.517 };
    config.water.refractive_index = Some(if even(0.0, 1.0) < 0.5 { 1.333 } else { 1.34 });
    config.object.distance_mm = distance;
    config.object.air_distance_mm = air_distance;

    let (focus, simulation) = (&mut config.bench.focus, &mut config.bench.simulation);
    simulation.seed = seed;
    simulation.rays = 16;
    simulation.focus_scale_error = even(-0.05, 0.05);
    simulation.e_scale_error = even(-0.05, 0.05);
    simulation.e_zero_offset_mm = even(-0.15, 0.15);
    simulation.lens_to_mla_error_mm = even(-0.1, 0.1);
    // Travels wide enough, as whoever builds such a bench would have them.
    (focus.low_limit_mm, focus.high_limit_mm) = (-20.0, 60.0);
    config
}

/// What became of a camera.
#[derive(Debug)]
enum Became {
    Converged,
    /// Before anything moved: which keys.
    Refused(Vec<String>),
    /// What a healthy bench must not come to, in words.
    Wrong(String),
}

/// Whether a configuration has the key with that value, as an obstacle names it.
fn names_a_key(reason: &str) -> Option<Vec<String>> {
    let said = reason.strip_prefix("this cannot be aligned as it is configured: ")?;
    let keys: Vec<String> = said
        .split("; ")
        .filter_map(|obstacle| obstacle.split_once(" is ").map(|(key, _)| key.to_owned()))
        .filter(|key| key.contains('.'))
        .collect();
    (!keys.is_empty() && said.contains("would have to be")).then_some(keys)
}

fn judged(config: &Config, job: &JobSnapshot) -> Became {
    let reason = job.reason.clone().unwrap_or_default();
    let moved =
        job.log.iter().any(|line| line.message.starts_with("homing the") || line.message.contains("operator step"));
    match job.state {
        JobState::Converged => {}
        _ if !moved => {
            return names_a_key(&reason).map_or_else(|| Became::Wrong(reason.clone()), Became::Refused);
        }
        state => return Became::Wrong(format!("{state}: {reason}")),
    }
    let report = job.report.as_ref().unwrap();
    let (truth, budget) = (report.truth.as_ref().unwrap(), report.budget.as_ref().unwrap());
    let design = config.design();
    // d + N b less the configured v.
    let delta_v = number(truth, "lens_to_mla_mm") + design.mla.a() - design.air_image_distance();
    let slope_px = design.mla.spacing_slope(design.mla.a()) / config.pixel_pitch().millimetres();
    let off_focus_px = number(truth, "focus_error_mm") * slope_px;
    let z = |value: f64, truth: f64, sigma: f64| (value - truth) / sigma;
    let found = [
        ("Δv", z(budget.delta_v_mm, delta_v, budget.delta_v_sigma_mm)),
        ("e", z(budget.e_mm, number(truth, "e_mm"), budget.e_sigma_mm)),
        ("focus", z(budget.off_focus_px, off_focus_px, budget.off_focus_sigma_px)),
    ];
    let off: Vec<String> =
        found.iter().filter(|(_, z)| z.abs() > 3.0).map(|(name, z)| format!("{name} is {z:.1} σ off")).collect();
    if !off.is_empty() || off_focus_px.abs() > config.assembly.blur_limit_px / 4.0 {
        return Became::Wrong(format!("{}; the blur is {off_focus_px:.3} px", off.join(", ")));
    }
    if truth["touched_shell"] == true {
        return Became::Wrong("the lens has touched the shell".to_owned());
    }
    Became::Converged
}

async fn became(seed: u64, sensor: Sensor) -> Became {
    let config = drawn(seed, sensor);
    if let Err(error) = config.validate() {
        return Became::Refused(error.violations().iter().map(|fault| fault.key.clone()).collect());
    }
    let job = align(&service(config.clone()).await).await;
    let became = judged(&config, &job);
    if matches!(became, Became::Wrong(_)) {
        println!("seed {seed}:\n{}", toml::to_string(&config).unwrap());
        job.log.iter().for_each(|line| println!("{}", line.message));
        job.iterations.iter().for_each(|iteration| println!("{iteration:?}"));
    }
    became
}

/// Aligns the cameras of these seeds; what is wrong with any is said at the end. Returns how many converged.
async fn aligned(seeds: impl IntoIterator<Item = u64>) -> usize {
    let (mut converged, mut wrong) = (0, Vec::new());
    for seed in seeds {
        match became(seed, Sensor::Small).await {
            Became::Converged => converged += 1,
            Became::Refused(keys) => println!("seed {seed} is refused for {}", keys.join(", ")),
            Became::Wrong(why) => wrong.push(format!("seed {seed}: {why}")),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    converged
}

#[tokio::test(start_paused = true)]
async fn six_cameras_align() {
    // The last has few large micro-images before coarse print.
    assert_eq!(aligned((1..=5).chain([725])).await, 6);
}

#[tokio::test(start_paused = true)]
async fn six_more_cameras_align() {
    // The last has its first board in air far beyond the others.
    assert_eq!(aligned((6..=10).chain([805])).await, 6);
}

/// The cameras that are shipped as examples, with as much of their sensors as is rendered in a blink.
#[tokio::test(start_paused = true)]
async fn the_example_cameras_align() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/examples/cameras");
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 4, "{files:?}");
    for file in files {
        let mut config = Config::load(&file).unwrap();
        assert!(PlanView::of(&config, &ConfigOrigin::Preset).possible, "{}", file.display());
        (config.sensor.width_px, config.sensor.height_px) = (600, 600);
        config.bench.simulation.rays = 16;
        let became = judged(&config, &align(&service(config.clone()).await).await);
        assert!(matches!(became, Became::Converged), "{}: {became:?}", file.display());
    }
}

/// Sensors that are not square, with colour filters and of other depths; arrays turned as far as they can be, with lenses
/// of several focal lengths, and before print.
#[tokio::test(start_paused = true)]
async fn other_sensors_and_arrays_align() {
    let colour = {
        let mut config = small_config(21);
        (config.sensor.width_px, config.sensor.height_px) = (680, 520);
        config.sensor.mosaic = Some(CfaPattern::Rggb);
        config.bench.simulation.bits = 12;
        config
    };
    let several = {
        let mut config = small_config(22);
        (config.sensor.width_px, config.sensor.height_px) = (500, 640);
        config.mla.array = ArrayKind::Hexagonal;
        config.bench.simulation.microlenses.focal_factors = vec![1.0, 1.06, 0.94];
        config.bench.simulation.array_rotation_deg = Some(20.0);
        config.bench.simulation.bits = 16;
        config
    };
    // Print under a hexagonal array hides the lattice's own phases.
    let print = {
        let mut config = small_config(1);
        config.main_lens.focal_length_mm = 35.0;
        config.mla.array = ArrayKind::Hexagonal;
        (config.mla.pitch_mm, config.mla.focal_length_mm, config.mla.angular_resolution) = (0.12, 0.6, 4.0);
        (config.sensor.pixel_um, config.sensor.width_px, config.sensor.height_px) = (4.5, 640, 640);
        (config.shell.outer_radius_mm, config.shell.inner_radius_mm) = (90.0, 80.0);
        (config.object.distance_mm, config.object.air_distance_mm) = (1200.0, 1500.0);
        config.bench.focus.high_limit_mm = 14.0;
        config.bench.simulation.texture = Texture::Charuco;
        config
    };
    for config in [colour, several, print] {
        let became = judged(&config, &align(&service(config.clone()).await).await);
        assert!(matches!(became, Became::Converged), "{:?}: {became:?}", config.sensor);
    }
}

/// The seeds that an environment variable asks for.
fn seeds(variable: &str) -> RangeInclusive<u64> {
    let range = std::env::var(variable).unwrap_or_else(|_| "1-200".to_owned());
    let (first, last) = range.split_once('-').expect("a range such as 1-200");
    first.parse().expect("a number")..=last.parse().expect("a number")
}

/// Every one of them converges or is refused before anything moves; a line says how many did what, and why.
async fn many(seeds: RangeInclusive<u64>, sensor: Sensor) {
    let (mut cameras, mut converged, mut refused) = (0, 0, BTreeMap::<String, usize>::new());
    let mut wrong = Vec::new();
    for seed in seeds {
        cameras += 1;
        match became(seed, sensor).await {
            Became::Converged => converged += 1,
            Became::Refused(keys) => *refused.entry(keys.join(" and ")).or_default() += 1,
            Became::Wrong(why) => wrong.push(format!("seed {seed}: {why}")),
        }
    }
    println!("{cameras} cameras, {converged} converged, {} wrong, refused for {refused:?}", wrong.len());
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[tokio::test(start_paused = true)]
#[ignore = "minutes a camera: tests/long.sh"]
async fn many_cameras_align() {
    many(seeds("CAMERAS"), Sensor::Any).await;
}

#[tokio::test(start_paused = true)]
#[ignore = "seconds a camera: tests/long.sh"]
async fn many_small_cameras_align() {
    many(seeds("SMALL_CAMERAS"), Sensor::Small).await;
}
