//! `plenalign measure`: grid and spacing of raw frames, and where their object is.

mod report;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;

use super::Context;
use super::pose::PoseArgs;
use crate::config::{Config, ConfigOrigin};
use crate::imaging::grid::Grid;
use crate::imaging::known::Known;
use crate::imaging::measurement::{FrameOptions, WhiteModel, evened, measure_frames};
use crate::imaging::microlenses::flagged_microlenses;
use crate::imaging::overlay::{self, Tint};
use crate::imaging::spacing::SpacingOptions;
use crate::optics::MlaMode;
use crate::raw::{self, RawImage};

use report::{Refused, Report};

/// The overlay's tints are strongest this far from the wanted spacing, in units of the blur limit.
const OVERLAY_RANGE: f64 = 0.25;

/// Arguments of `plenalign measure`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The raw frames: PNG, TIFF or PGM, 8 to 16 bits. Several of one pose combine into one measurement.
    #[arg(value_name = "RAW", required = true)]
    raw: Vec<PathBuf>,
    /// A white frame of the same camera, at this or another Δv.
    #[arg(long, value_name = "WHITE")]
    white: Option<PathBuf>,
    #[command(flatten)]
    pose: PoseArgs,
    /// Draw micro-images, pairs, spacing error, rejected micro-images and flawed microlenses over the (first) frame, into this PNG.
    #[arg(long, value_name = "FILE")]
    overlay: Option<PathBuf>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
    /// With --json: the spacing about every single micro-image too.
    #[arg(long, requires = "json")]
    lenses: bool,
}

pub(super) fn run(context: Context, args: Args) -> anyhow::Result<ExitCode> {
    let config = &context.config;
    args.pose.check()?;
    if let Some(path) = &args.overlay {
        let png = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
        anyhow::ensure!(png, "--overlay {}: a name that ends in .png is needed", path.display());
    }
    let raws = args.raw.iter().map(|path| raw::read(path)).collect::<Result<Vec<_>, _>>()?;
    let options = FrameOptions { map: true, ..frame_options(&context) };
    // What is known without a spacing is worth having.
    let refused = |white: Option<&WhiteModel>, why: String| -> anyhow::Result<()> {
        let Some(raw) = raws.first() else { return Ok(()) };
        let refused = Refused::new(&Known::of(raw, white, &options), why);
        if args.json {
            println!("{}", serde_json::to_string(&refused)?);
        } else {
            refused.print();
        }
        Ok(())
    };
    let white = match read_white(&options, args.white.as_deref()) {
        Ok(white) => white,
        Err(error) => {
            refused(None, format!("{error:#}"))?;
            return Err(error);
        }
    };
    let flagged = white
        .as_ref()
        .map(|(raw, model)| flagged_microlenses(&evened(raw, config.sensor.mosaic), &model.grid, &model.vignetting));
    let white = white.map(|(_, model)| model);
    let names = || args.raw.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ");
    let measured = match measure_frames(&raws, white.as_ref(), &options) {
        Ok(measured) => measured,
        Err(error) => {
            refused(white.as_ref(), error.to_string())?;
            return Err(error).with_context(names);
        }
    };
    let white = white.as_ref().zip(flagged.as_deref());
    let report = Report::new(config, &args, &raws, white, &measured);
    if let (Some(path), Some(map)) = (&args.overlay, &measured.map) {
        let range_px = OVERLAY_RANGE * config.assembly.blur_limit_px;
        let tint = Tint { wanted_px: report.target_px(), range_px };
        let flagged = flagged.as_deref().unwrap_or_default();
        let picture = overlay::draw(&raws[0], map, flagged, measured.grid.pitch_px(), tint);
        picture.save(path).with_context(|| format!("{}: the overlay could not be written", path.display()))?;
        if !args.json {
            println!("overlay          {}: blue below the target, orange above, full at {range_px} px", path.display());
        }
    }
    if args.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        report.print();
    }
    Ok(ExitCode::SUCCESS)
}

/// A white frame's file and its model, where there is one.
pub(super) fn read_white(
    options: &FrameOptions,
    path: Option<&Path>,
) -> anyhow::Result<Option<(RawImage, WhiteModel)>> {
    let Some(path) = path else { return Ok(None) };
    let white = raw::read(path)?;
    let model = WhiteModel::of(&white, options).with_context(|| path.display().to_string())?;
    Ok(Some((white, model)))
}

/// What the configuration says about a frame: the MLA pitch, the mosaic, and where a camera is configured, not the preset
/// taken, its mode. The array is found, and compared.
pub(super) fn frame_options(context: &Context) -> FrameOptions {
    let config = &context.config;
    let designed = FrameOptions::of_design(&config.design(), config.pixel_pitch().millimetres());
    let mode = designed.spacing.mode.filter(|_| context.origin != ConfigOrigin::Preset);
    let spacing = SpacingOptions { mode, bound: true, ..designed.spacing };
    FrameOptions { spacing, array: None, mosaic: config.sensor.mosaic, ..designed }
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
    let (mode, side) = if spacing_px < pitch_px { (MlaMode::Galilean, "below") } else { (MlaMode::Keplerian, "above") };
    if mode != mla.mode {
        found.push(format!(
            "the spacing of {spacing_px:.2} px is {side} the MLA pitch, which the configured {:?} mode excludes",
            mla.mode
        ));
    }
    found
}
