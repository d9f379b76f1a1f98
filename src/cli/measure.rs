//! `plenalign measure`: grid and spacing of a raw frame, and where its object is.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use serde::Serialize;

use super::Context;
use crate::config::Config;
use crate::imaging::grid::Grid;
use crate::imaging::measurement::{FrameMeasurement, FrameOptions, WhiteModel, measure_frame};
use crate::imaging::spacing::Spacing;
use crate::optics::MlaMode;
use crate::raw::{self, RawImage};

/// Arguments of `plenalign measure`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The raw frame: PNG, TIFF or PGM, 8 or 16 bits.
    #[arg(value_name = "RAW")]
    raw: PathBuf,
    /// A white frame of the same camera, at this or another Δv.
    #[arg(long, value_name = "WHITE")]
    white: Option<PathBuf>,
    /// Δv at which the frame was taken, mm: gives the object distance, with --e or --air.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    delta_v: Option<f64>,
    /// e at which the frame was taken through the shell, mm.
    #[arg(long, value_name = "MM", allow_negative_numbers = true, conflicts_with = "air")]
    e: Option<f64>,
    /// The frame was taken in air, without the shell.
    #[arg(long)]
    air: bool,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// The grid on the wire.
#[derive(Debug, Serialize)]
pub(super) struct GridReport {
    array: &'static str,
    pitch_px: f64,
    rotation_deg: f64,
    centre_px: [f64; 2],
    micro_images: usize,
    residual_px: f64,
}

impl GridReport {
    pub(super) fn new(grid: &Grid) -> Self {
        Self {
            array: grid.array.name(),
            pitch_px: grid.pitch_px(),
            rotation_deg: grid.rotation().to_degrees(),
            centre_px: grid.centre,
            micro_images: grid.micro_images(),
            residual_px: grid.residual_px,
        }
    }
}

/// The spacing on the wire.
#[derive(Debug, Serialize)]
struct SpacingReport {
    on_axis_px: f64,
    on_axis_sigma_px: f64,
    on_axis_sigma_random_px: f64,
    tilt_x_px: f64,
    tilt_y_px: f64,
    curvature_px: f64,
    pairs: usize,
}

impl SpacingReport {
    fn new(spacing: &Spacing) -> Self {
        Self {
            on_axis_px: spacing.on_axis_px,
            on_axis_sigma_px: spacing.sigma_px,
            on_axis_sigma_random_px: spacing.sigma_random_px,
            tilt_x_px: spacing.tilt_x_px,
            tilt_y_px: spacing.tilt_y_px,
            curvature_px: spacing.curvature_px,
            pairs: spacing.pairs,
        }
    }
}

#[derive(Debug, Serialize)]
struct Report {
    grid: GridReport,
    spacing: SpacingReport,
    target_px: f64,
    in_focus: bool,
    /// Along the axis from O, or from the lens in air.
    object_distance_mm: Option<f64>,
    /// Why there is no object distance.
    object_distance_reason: Option<String>,
    frame_size_px: [usize; 2],
    warnings: Vec<String>,
}

pub(super) fn run(context: Context, args: Args) -> anyhow::Result<ExitCode> {
    let config = &context.config;
    for (name, value) in [("--delta-v", args.delta_v), ("--e", args.e)] {
        anyhow::ensure!(value.is_none_or(f64::is_finite), "{name} must be a finite number of millimetres");
    }
    let raw = raw::read(&args.raw)?;
    let white = read_white(args.white.as_deref())?;
    let options = frame_options(config);
    let measured = measure_frame(&raw, white.as_ref(), &options).with_context(|| args.raw.display().to_string())?;
    let report = report(config, &args, &raw, &measured);
    if args.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        print(&report);
    }
    Ok(ExitCode::SUCCESS)
}

/// The model of a white frame's file, where there is one.
pub(super) fn read_white(path: Option<&Path>) -> anyhow::Result<Option<WhiteModel>> {
    let Some(path) = path else { return Ok(None) };
    let white = raw::read(path)?;
    WhiteModel::new(&white).with_context(|| path.display().to_string()).map(Some)
}

/// What the configuration says about a frame: only the MLA pitch. Array and mode are found, and compared.
pub(super) fn frame_options(config: &Config) -> FrameOptions {
    FrameOptions::new(config.design().mla.pitch / config.pixel_pitch().millimetres())
}

/// What in the frame is not as the configuration says.
pub(super) fn disagreements(config: &Config, raw: &RawImage, grid: &Grid, spacing_px: f64) -> Vec<String> {
    let mut found = Vec::new();
    let (width, height) = (config.sensor.width_px as usize, config.sensor.height_px as usize);
    if [raw.width(), raw.height()] != [width, height] {
        found.push(format!(
            "the frame is {}x{} px, the configured sensor {width}x{height} px",
            raw.width(),
            raw.height()
        ));
    }
    let mla = config.design().mla;
    if grid.array != mla.array {
        found.push(format!(
            "the frame shows a {} array, the configured one is {}",
            grid.array.name(),
            mla.array.name()
        ));
    }
    let pitch_px = mla.pitch / config.pixel_pitch().millimetres();
    let ratio = grid.pitch_px() / pitch_px;
    // The micro-image pitch exceeds the MLA's by b/d, a few per cent.
    if !(0.98..1.1).contains(&ratio) {
        found.push(format!(
            "the micro-image pitch of {:.2} px does not belong to a configured MLA pitch of {pitch_px:.2} px",
            grid.pitch_px()
        ));
    }
    let (mode, side) = if spacing_px < pitch_px { (MlaMode::Galilean, "below") } else { (MlaMode::Keplerian, "above") };
    if mode != mla.mode {
        found.push(format!(
            "the spacing of {spacing_px:.2} px is {side} the MLA pitch, which the configured {:?} mode excludes",
            mla.mode
        ));
    }
    found
}

fn report(config: &Config, args: &Args, raw: &RawImage, measured: &FrameMeasurement) -> Report {
    let pixel = config.pixel_pitch().millimetres();
    let target_px = config.design().mla.target_spacing() / pixel;
    let spacing_px = measured.spacing.on_axis_px;
    let distance = object_distance(config, args, spacing_px * pixel);
    let mut warnings = disagreements(config, raw, &measured.grid, spacing_px);
    match measured.vignetting_fit {
        Some(fit) if !fit.fits() => warnings.push(format!(
            "the white frame's profile does not fit (misfit {:.3} ± {:.3}): take a white frame at this setting",
            fit.misfit, fit.misfit_sigma
        )),
        None => warnings.push("no white frame: the vignetting was estimated from the frame itself".to_owned()),
        Some(_) => {}
    }
    Report {
        grid: GridReport::new(&measured.grid),
        spacing: SpacingReport::new(&measured.spacing),
        target_px,
        in_focus: (spacing_px - target_px).abs() <= config.assembly.blur_limit_px,
        object_distance_mm: distance.as_ref().ok().copied(),
        object_distance_reason: distance.err(),
        frame_size_px: [raw.width(), raw.height()],
        warnings,
    }
}

/// Distance of the object along the axis, mm: from O through the shell, from the lens in air. The reason where there
/// is none.
fn object_distance(config: &Config, args: &Args, spacing_mm: f64) -> Result<f64, String> {
    let design = config.design();
    let Some(delta_v) = args.delta_v else {
        return Err("Δv is not given: --delta-v, with --e or --air".to_owned());
    };
    let equivalent = design.equivalent_from_spacing(spacing_mm, delta_v);
    let distance = match (args.e, args.air) {
        (_, true) => equivalent,
        (Some(e), false) => design.shell.object_distance(equivalent, e),
        (None, false) => return Err("neither e nor air is given: --e or --air".to_owned()),
    };
    if distance.is_finite() && distance > 0.0 {
        Ok(distance)
    } else {
        Err(format!("no real object has this spacing at Δv = {delta_v} mm: Δv, e or the configured camera are others"))
    }
}

fn print(report: &Report) {
    let (grid, spacing) = (&report.grid, &report.spacing);
    println!("frame            {} x {} px", report.frame_size_px[0], report.frame_size_px[1]);
    println!("array            {}, {} micro-images", grid.array, grid.micro_images);
    println!("pitch            {:.4} px, rotation {:+.4}°", grid.pitch_px, grid.rotation_deg);
    println!(
        "centre           {:.3}, {:.3} px, residual {:.3} px",
        grid.centre_px[0], grid.centre_px[1], grid.residual_px
    );
    println!(
        "spacing          {:.4} ± {:.4} px on the axis, {} pairs",
        spacing.on_axis_px, spacing.on_axis_sigma_px, spacing.pairs
    );
    println!("tilt             {:+.4}, {:+.4} px per half frame width", spacing.tilt_x_px, spacing.tilt_y_px);
    println!("curvature        {:+.4} px per half frame width squared", spacing.curvature_px);
    let focus = if report.in_focus { "in focus" } else { "out of focus" };
    println!("target           {:.4} px: {focus}", report.target_px);
    match (&report.object_distance_mm, &report.object_distance_reason) {
        (Some(distance), _) => println!("object distance  {distance:.2} mm"),
        (None, reason) => println!("object distance  unknown: {}", reason.as_deref().unwrap_or("not asked for")),
    }
    for warning in &report.warnings {
        println!("note             {warning}");
    }
}
