//! `plenalign view`: pictures and distances from one raw frame.

use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail, ensure};
use serde::Serialize;

use super::Context;
use super::measure::{disagreements, frame_options, read_white};
use super::pose::PoseArgs;
use crate::config::Config;
use crate::imaging::clarity::eog;
use crate::imaging::pictures::{DepthFigures, LensFigures, Pictures, Pose, Spread};
use crate::imaging::view::View;
use crate::raw;

/// Grey levels of a depth map's PNG for each millimetre.
const LEVELS_PER_MM: f32 = 10.0;

/// Arguments of `plenalign view`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The raw frame: PNG, TIFF or PGM, 8 to 16 bits.
    #[arg(value_name = "RAW")]
    raw: PathBuf,
    /// A white frame of the same camera, at this or another Δv.
    #[arg(long, value_name = "WHITE")]
    white: Option<PathBuf>,
    /// Write the view into this PNG: the central one, or that of --angle or --refocus.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write the distances into this file: a PNG of 16 bits in tenths of a millimetre (0: unknown), or a TIFF of 32-bit
    /// floating point in millimetres (NaN: unknown).
    #[arg(long, value_name = "FILE")]
    depth: Option<PathBuf>,
    /// Write a picture that is sharp everywhere into this PNG.
    #[arg(long, value_name = "FILE")]
    all_in_focus: Option<PathBuf>,
    /// Make --out sharp at this distance only, mm: in water from the shell's outer vertex, in air from the main lens.
    #[arg(long, value_name = "MM", requires = "out", conflicts_with = "angle")]
    refocus: Option<f64>,
    /// Look from here in the main lens's aperture: right and down, from -1 to 1.
    #[arg(long, value_name = "U,V", value_delimiter = ',', allow_hyphen_values = true, requires = "out")]
    angle: Option<Vec<f64>>,
    #[command(flatten)]
    pose: PoseArgs,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
    /// With --json: what is known about every single micro-image too.
    #[arg(long, requires = "json")]
    lenses: bool,
}

/// What a picture's file says of itself.
#[derive(Debug, Serialize)]
struct PictureReport {
    file: String,
    width: usize,
    height: usize,
    eog_sum: f64,
    eog_mean_per_pixel: f64,
}

#[derive(Debug, Serialize)]
struct Report {
    raw: String,
    #[serde(flatten)]
    depth: DepthFigures,
    disagreements: Vec<String>,
    view: Option<PictureReport>,
    all_in_focus: Option<PictureReport>,
    depth_file: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    lenses: Option<Vec<LensFigures>>,
}

pub(super) fn run(context: Context, args: Args) -> anyhow::Result<ExitCode> {
    let config = &context.config;
    args.pose.check()?;
    ensure!(args.refocus.is_none_or(f64::is_finite), "--refocus must be a finite number of millimetres");
    let direction = match args.angle.as_deref() {
        None => [0.0; 2],
        Some(&[u, v]) => [u, v],
        Some(other) => bail!("--angle: two numbers, right and down, are wanted, not {}", other.len()),
    };
    ensure!(args.refocus.is_none_or(|mm| mm > 0.0), "--refocus must be a distance above 0 mm");
    for (name, path) in [("--out", &args.out), ("--all-in-focus", &args.all_in_focus)] {
        ensure!(path.as_deref().is_none_or(|path| has_extension(path, &["png"])), "{name}: a name that ends in .png");
    }
    let depth_named = args.depth.as_deref().is_none_or(|path| has_extension(path, &["png", "tif", "tiff"]));
    ensure!(depth_named, "--depth: a name that ends in .png, .tif or .tiff");
    let pose = pose(config, &args.pose)?;
    if pose.is_none() && (args.depth.is_some() || args.refocus.is_some()) {
        bail!("--depth and --refocus need to know where the camera was: --delta-v, and --e or --air");
    }
    let frame = raw::read(&args.raw)?;
    let white = read_white(&frame_options(&context), args.white.as_deref())?.map(|(_, model)| model);
    let mode = config.design().mla.mode;
    let pictures = Pictures::new(&frame, white.as_ref(), &frame_options(&context), mode, pose.as_ref())
        .with_context(|| args.raw.display().to_string())?;

    let view = args.out.as_deref().map(|path| {
        let view = match args.refocus {
            Some(distance_mm) => pictures.refocused(distance_mm)?,
            None => pictures.view(direction)?,
        };
        save(&view, path)
    });
    let view = view.transpose()?;
    let all_in_focus = args.all_in_focus.as_deref().map(|path| save(&pictures.all_in_focus()?, path)).transpose()?;
    if let Some(path) = &args.depth {
        save_distances(&pictures, path)?;
    }

    let report = report(config, &args, &frame, &pictures, view, all_in_focus);
    if args.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        print(&report);
    }
    Ok(ExitCode::SUCCESS)
}

fn has_extension(path: &Path, wanted: &[&str]) -> bool {
    path.extension().is_some_and(|found| wanted.iter().any(|&wanted| found.eq_ignore_ascii_case(wanted)))
}

/// Where the camera was, as far as the arguments say.
fn pose(config: &Config, args: &PoseArgs) -> anyhow::Result<Option<Pose>> {
    let design = config.design();
    let view = match (args.delta_v, args.e, args.air) {
        (Some(delta_v), Some(e), false) => design.exact_in_water(delta_v, e),
        (Some(delta_v), None, true) => design.exact_in_air(delta_v, design.air_distance),
        (Some(_), None, false) => bail!("--delta-v alone gives no distances: --e or --air too"),
        (None, Some(_), _) | (None, _, true) => bail!("--e and --air give no distances without --delta-v"),
        _ => return Ok(None),
    };
    Ok(Some(Pose { view, pixel_mm: config.pixel_pitch().millimetres() }))
}

fn save(view: &View, path: &Path) -> anyhow::Result<PictureReport> {
    let (width, height) = (u32::try_from(view.width)?, u32::try_from(view.height)?);
    let colour = if view.planes.len() == 3 { image::ColorType::Rgb8 } else { image::ColorType::L8 };
    image::save_buffer(path, &view.to_u8(), width, height, colour)
        .with_context(|| format!("{}: the picture could not be written", path.display()))?;
    let eog = eog(view);
    Ok(PictureReport {
        file: path.display().to_string(),
        width: view.width,
        height: view.height,
        eog_sum: eog.sum,
        eog_mean_per_pixel: eog.mean_per_pixel,
    })
}

fn save_distances(pictures: &Pictures, path: &Path) -> anyhow::Result<()> {
    let (extent, distances) = pictures.distances()?;
    let (width, height) = (u32::try_from(extent.width)?, u32::try_from(extent.height)?);
    let unwritten = || format!("{}: the distances could not be written", path.display());
    if has_extension(path, &["png"]) {
        let levels = distances.iter().map(|mm| (mm * LEVELS_PER_MM).round().clamp(0.0, f32::from(u16::MAX)));
        // What is unknown becomes 0.
        let levels: Vec<u16> = levels.map(|level| if level.is_nan() { 0 } else { level as u16 }).collect();
        let picture = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(width, height, levels);
        return picture.context("a view of another size")?.save(path).with_context(unwritten);
    }
    let file = BufWriter::new(File::create(path).with_context(unwritten)?);
    let mut encoder = tiff::encoder::TiffEncoder::new(file).with_context(unwritten)?;
    encoder.write_image::<tiff::encoder::colortype::Gray32Float>(width, height, &distances).with_context(unwritten)
}

fn report(
    config: &Config,
    args: &Args,
    frame: &raw::RawImage,
    pictures: &Pictures,
    view: Option<PictureReport>,
    all_in_focus: Option<PictureReport>,
) -> Report {
    let mla_pitch_px = config.design().mla.pitch / config.pixel_pitch().millimetres();
    let depth = pictures.figures(mla_pitch_px);
    let disagreements =
        depth.spacing_px.map_or_else(Vec::new, |spread| disagreements(config, frame, pictures.grid(), spread.median));
    Report {
        raw: args.raw.display().to_string(),
        depth,
        disagreements,
        view,
        all_in_focus,
        depth_file: args.depth.as_ref().map(|path| path.display().to_string()),
        lenses: args.lenses.then(|| pictures.lens_figures(mla_pitch_px).collect()),
    }
}

fn print(report: &Report) {
    println!("frame            {} of {}x{} px", report.raw, report.depth.frame_px[0], report.depth.frame_px[1]);
    println!(
        "micro-images     {} on a {} array, {:.3} px apart: {} measured, {} inferred, {} unknown; SSIM {:.3}",
        report.depth.micro_images,
        report.depth.array,
        report.depth.micro_image_pitch_px,
        report.depth.measured,
        report.depth.inferred,
        report.depth.unknown,
        report.depth.ssim_mean
    );
    let line = |name: &str, unit: &str, spread: Option<Spread>, digits: usize| {
        let Some(s) = spread else { return };
        println!(
            "{name:16} {:.digits$} to {:.digits$} {unit}, half of them from {:.digits$} to {:.digits$}, median {:.digits$}",
            s.least, s.greatest, s.lower_quartile, s.upper_quartile, s.median
        );
    };
    line("spacing", "px", report.depth.spacing_px, 3);
    line("patch", "px", report.depth.patch_px, 3);
    line("virtual depth", "a/b", report.depth.virtual_depth, 3);
    line("distance", "mm", report.depth.distance_mm, 1);
    for (name, picture) in [("view", &report.view), ("all in focus", &report.all_in_focus)] {
        if let Some(p) = picture {
            println!(
                "{name:16} {}: {}x{} px, EOG {:.4e} in sum, {:.1} a pixel",
                p.file, p.width, p.height, p.eog_sum, p.eog_mean_per_pixel
            );
        }
    }
    if let Some(file) = &report.depth_file {
        println!("depth            {file}");
    }
    for disagreement in &report.disagreements {
        println!("note             {disagreement}");
    }
}
