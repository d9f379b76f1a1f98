//! `plenalign calibrate`: d and b from a raw frame of boards at known distances.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use serde::Serialize;

use super::Context;
use super::measure::{disagreements, frame_options, read_white};
use crate::imaging::calibration::{CalibrationOptions, ConjugateLine, Level, calibrate};
use crate::raw;

/// Arguments of `plenalign calibrate`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The raw frame of the boards, side by side, in air: PNG, TIFF or PGM, 8 or 16 bits.
    #[arg(value_name = "RAW")]
    raw: PathBuf,
    /// A white frame of the same camera, at this or another Δv.
    #[arg(long, value_name = "WHITE")]
    white: Option<PathBuf>,
    /// Distances of the boards from the main lens's principal point, mm, in any order.
    #[arg(long, value_name = "MM,MM,...", value_delimiter = ',', required = true)]
    levels: Vec<f64>,
    /// Hold b at the configured camera's value: for frames so far out of focus that they cannot tell it.
    #[arg(long)]
    hold_b: bool,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct LevelReport {
    distance_mm: f64,
    spacing_px: f64,
    sigma_px: f64,
}

#[derive(Debug, Serialize)]
struct Report {
    d_mm: f64,
    d_sigma_mm: f64,
    b_mm: f64,
    b_sigma_mm: f64,
    /// d + N b at the design's N: v_ADJ of Eq. 15.
    image_distance_mm: f64,
    image_distance_sigma_mm: f64,
    levels: Vec<LevelReport>,
    warnings: Vec<String>,
}

pub(super) fn run(context: Context, args: Args) -> anyhow::Result<ExitCode> {
    let config = &context.config;
    let design = config.design();
    let raw = raw::read(&args.raw)?;
    let white = read_white(config, args.white.as_deref())?;
    let options = CalibrationOptions {
        frame: frame_options(config),
        pixel_mm: config.pixel_pitch().millimetres(),
        main_lens: design.main_lens,
        distance_sigma_mm: config.main_lens.principal_from_mount_sigma_mm.unwrap_or(0.0),
        hold_b: args.hold_b.then(|| (design.mla.b(), 0.0)),
    };
    let calibration =
        calibrate(&raw, white.as_ref(), &args.levels, &options).with_context(|| args.raw.display().to_string())?;
    let line = &calibration.line;
    let (image_distance_mm, image_distance_sigma_mm) = line.image_distance(design.mla.signed_resolution());
    let spacing = line.levels.first().map_or(0.0, |l| l.spacing_px);
    let mut warnings = disagreements(config, &raw, &calibration.grid, spacing);
    warnings.extend(doubts(line, design.mla.b()));
    let report = Report {
        d_mm: line.d_mm,
        d_sigma_mm: line.d_sigma_mm(),
        b_mm: line.b_mm,
        b_sigma_mm: line.b_sigma_mm(),
        image_distance_mm,
        image_distance_sigma_mm,
        levels: levels(line),
        warnings,
    };
    if args.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        print(&report);
    }
    Ok(ExitCode::SUCCESS)
}

/// What makes it doubtful that these boards stood at the distances given.
fn doubts(line: &ConjugateLine, configured_b_mm: f64) -> Vec<String> {
    /// Standard deviations beyond which a difference is no chance.
    const TELLING: f64 = 4.0;
    let mut found = Vec::new();
    let per_degree = line.chi_squared / line.degrees_of_freedom.max(1) as f64;
    if line.degrees_of_freedom > 0 && per_degree > TELLING * TELLING {
        found.push(format!(
            "the boards do not lie on one line: what is left is {:.0} times the spacings' uncertainty; are the --levels \
             the boards' distances?",
            per_degree.sqrt()
        ));
    }
    if (line.b_mm - configured_b_mm).abs() > TELLING * line.b_sigma_mm().max(0.005 * configured_b_mm) {
        found.push(format!(
            "b = {:.4} mm is not the configured {configured_b_mm:.4} mm: check --levels, main_lens.focal_length_mm and \
             the [mla] section",
            line.b_mm
        ));
    }
    found
}

fn levels(line: &ConjugateLine) -> Vec<LevelReport> {
    let wire = |l: &Level| LevelReport { distance_mm: l.distance_mm, spacing_px: l.spacing_px, sigma_px: l.sigma_px };
    line.levels.iter().map(wire).collect()
}

fn print(report: &Report) {
    println!("d                {:.5} ± {:.5} mm (main lens to MLA)", report.d_mm, report.d_sigma_mm);
    println!("b                {:.6} ± {:.6} mm (MLA to sensor)", report.b_mm, report.b_sigma_mm);
    println!(
        "d + N b          {:.5} ± {:.5} mm (image distance of the point in focus)",
        report.image_distance_mm, report.image_distance_sigma_mm
    );
    for level in &report.levels {
        println!(
            "board            {:.3} mm: spacing {:.4} ± {:.4} px",
            level.distance_mm, level.spacing_px, level.sigma_px
        );
    }
    for warning in &report.warnings {
        println!("note             {warning}");
    }
}
