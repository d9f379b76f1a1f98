//! `plenalign render`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, bail, ensure};
use clap::ValueEnum;
use serde_json::json;

use super::Context;
use crate::config::{Config, Texture};
use crate::raw;
use crate::sim::configured;
use crate::sim::exposure::expose;
use crate::sim::renderer::{CameraTruth, Medium, RenderOptions, Renderer};
use crate::sim::scene::{Board, Scene, TripleBoard, texel_for};

/// What is on the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum TextureName {
    /// A chessboard with marker-like squares.
    Charuco,
    /// Random, with the spectrum of natural scenes.
    Natural,
    /// Guppies over gravel.
    Guppy,
    /// Oscars before plants.
    Oscar,
}

impl From<TextureName> for Texture {
    fn from(name: TextureName) -> Self {
        match name {
            TextureName::Charuco => Self::Charuco,
            TextureName::Natural => Self::Natural,
            TextureName::Guppy => Self::Guppy,
            TextureName::Oscar => Self::Oscar,
        }
    }
}

/// Arguments of `plenalign render`.
///
/// The configured optics count as the true ones; of `[bench.simulation]` come the array's rotation, tilts, decentre,
/// the lens's aberrations, cross-talk, texture, noise, depth, seed and rays, and its sections: microlenses, dust, bubbles,
/// motion and mosaic.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// File to write: .png, .tiff or .pgm.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// A white frame (a diffuser on the lens) instead of a board.
    #[arg(long, conflicts_with_all = ["distance", "texture", "levels"])]
    white: bool,
    /// Δv, mm; without it that of the joint solution.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    delta_v: Option<f64>,
    /// e, mm, with the shell on and in water; without it (and without --air) that of the joint solution.
    #[arg(long, value_name = "MM", allow_negative_numbers = true, conflicts_with = "air")]
    e: Option<f64>,
    /// In air, without the shell.
    #[arg(long)]
    air: bool,
    /// Distance of the board, mm: in water from the shell's outer vertex (without it the configured one), in air from
    /// the lens (without it the equivalent distance of the joint solution).
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    distance: Option<f64>,
    /// Boards side by side at these distances, mm, from the left of the frame to its right.
    #[arg(
        long,
        value_name = "MM,MM,MM",
        value_delimiter = ',',
        conflicts_with = "distance",
        allow_negative_numbers = true
    )]
    levels: Vec<f64>,
    /// What is on the board; without it the configured texture.
    #[arg(long, value_enum, value_name = "NAME")]
    texture: Option<TextureName>,
    /// Diameter of the main lens's aperture, mm; without it the one that fills the micro-images (Eq. 14).
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    aperture: Option<f64>,
    /// Seed of rotation, offset, texture, rays and noise; without it the configured one.
    #[arg(long)]
    seed: Option<u64>,
    /// Rays a pixel, 1 to 4096; without it the configured number.
    #[arg(long)]
    rays: Option<u32>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// A frame's setting, every default filled in.
struct Setting {
    camera: CameraTruth,
    delta_v: f64,
    e: Option<f64>,
    distances: Vec<f64>,
    texture: Texture,
    texel: f64,
    seed: u64,
    rays: u32,
}

pub(super) fn run(context: Context, args: Args) -> anyhow::Result<ExitCode> {
    let setting = setting(&context.config, &args)?;
    let simulation = &context.config.bench.simulation;
    let start = Instant::now();
    let scene = scene(&context.config, &args, &setting);
    let renderer = Renderer::new(RenderOptions { rays: setting.rays, seed: setting.seed });
    let flaws = configured::flaws(&context.config, setting.e.is_some(), setting.seed);
    let irradiance = configured::shutter(&context.config).collect(&renderer, &setting.camera, &scene, &flaws);
    let (width, height) = (setting.camera.width, setting.camera.height);
    let frame = expose(&irradiance, width, height, &configured::noise(simulation), setting.seed);
    let seconds = start.elapsed().as_secs_f64();
    raw::write(&args.out, &frame).context("the frame could not be written")?;
    if args.json {
        println!("{}", report(&context.config, &args, &setting, seconds));
    } else {
        let medium = setting.e.map_or("in air".to_owned(), |e| format!("in water, e = {e} mm"));
        println!(
            "{}: {} x {} px, {medium}, Δv = {:.4} mm, {} rays a pixel, {seconds:.2} s",
            args.out.display(),
            setting.camera.width,
            setting.camera.height,
            setting.delta_v,
            setting.rays,
        );
    }
    Ok(ExitCode::SUCCESS)
}

fn setting(config: &Config, args: &Args) -> anyhow::Result<Setting> {
    let design = config.design();
    let joint = design.joint(config.assembly.l_bound_mm);
    let delta_v = finite("--delta-v", args.delta_v)?.unwrap_or(joint.delta_v);
    let e = if args.air { None } else { Some(finite("--e", args.e)?.unwrap_or(joint.e)) };
    let pixel = config.pixel_pitch().millimetres();
    let seed = args.seed.unwrap_or(config.bench.simulation.seed);
    let rays = args.rays.unwrap_or(config.bench.simulation.rays);
    ensure!((1..=4096).contains(&rays), "--rays {rays}: between 1 and 4096 rays a pixel are traced");
    let medium = match e {
        None => Medium::Air,
        Some(e) => {
            ensure!(
                e.abs() < design.shell.inner_radius,
                "--e {e}: the lens is inside the shell, so |e| is below its inner radius of {} mm",
                design.shell.inner_radius
            );
            Medium::Water { shell: design.shell, e, decentre: [0.0, 0.0] }
        }
    };
    ensure!(
        design.lens_to_mla(delta_v) > 0.0,
        "--delta-v {delta_v}: puts the array before the main lens; it must be above {:.3} mm",
        -design.air_lens_to_mla()
    );
    let (width, height) = (config.sensor.width_px as usize, config.sensor.height_px as usize);
    let camera = CameraTruth::from_design(&design, delta_v, medium, pixel, width, height);
    let mut camera = configured::camera(camera, &config.bench.simulation, seed);
    if let Some(aperture) = args.aperture {
        ensure!(aperture.is_finite() && aperture > 0.0, "--aperture {aperture}: a diameter above 0 mm is needed");
        camera.aperture = aperture;
    }
    let distances = if args.levels.is_empty() {
        let usual = if args.air { joint.equivalent_distance } else { design.object_distance };
        vec![args.distance.unwrap_or(usual)]
    } else {
        args.levels.clone()
    };
    if let Some(wrong) = distances.iter().find(|distance| !distance.is_finite() || **distance <= 0.0) {
        bail!("a board at {wrong} mm: a distance above 0 mm before the camera is needed");
    }
    let texture = args.texture.map_or(config.bench.simulation.texture, Texture::from);
    let middle = distances.iter().sum::<f64>() / distances.len() as f64;
    let texel = texel_for(&design, medium, middle, pixel);
    Ok(Setting { camera, delta_v, e, distances, texture, texel, seed, rays })
}

fn finite(option: &str, value: Option<f64>) -> anyhow::Result<Option<f64>> {
    match value {
        Some(value) if !value.is_finite() => bail!("{option} {value}: a finite length in mm is needed"),
        value => Ok(value),
    }
}

fn scene(config: &Config, args: &Args, setting: &Setting) -> Scene {
    if args.white {
        return Scene::Diffuser;
    }
    let tilt = config.bench.simulation.board_tilt_mrad.map(|tilt| tilt / 1000.0);
    let texture = Arc::new(configured::texture(config, setting.texture, setting.texel, setting.seed));
    if let [distance] = setting.distances[..] {
        return Scene::Board(Board { tilt, ..Board::new(distance, texture) });
    }
    let mut triple = TripleBoard::new(&setting.distances, setting.camera.half_field_slope(), &texture);
    triple.strips.iter_mut().for_each(|strip| strip.board.tilt = tilt);
    Scene::TripleBoard(triple)
}

fn report(config: &Config, args: &Args, setting: &Setting, seconds: f64) -> serde_json::Value {
    let camera = &setting.camera;
    json!({
        "out": args.out,
        "width_px": camera.width,
        "height_px": camera.height,
        "white": args.white,
        "medium": if setting.e.is_some() { "water" } else { "air" },
        "delta_v_mm": setting.delta_v,
        "e_mm": setting.e,
        "distances_mm": if args.white { None } else { Some(&setting.distances) },
        "texture": if args.white { None } else { Some(setting.texture) },
        "texel_mm": if args.white { None } else { Some(setting.texel) },
        "aperture_mm": camera.aperture,
        "array": camera.array.name(),
        "rotation_deg": camera.rotation.to_degrees(),
        "offset_px": camera.offset,
        "bits": config.bench.simulation.bits,
        "cfa": config.sensor.mosaic,
        "lens_to_mla_mm": camera.lens_to_mla,
        "mla_to_sensor_mm": camera.mla_to_sensor,
        "seed": setting.seed,
        "rays": setting.rays,
        "seconds": seconds,
    })
}
