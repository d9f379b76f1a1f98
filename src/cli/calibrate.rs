//! `plenalign calibrate`: d and b from a raw frame of boards at known distances, or with known steps between them.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use clap::ValueEnum;
use serde::Serialize;

use super::Context;
use super::measure::{disagreements, frame_options, read_white};
use crate::imaging::calibration::{
    Calibration, CalibrationOptions, ConjugateLine, Estimate, FittedPitch, Known, Level, MicroImagePitch, PitchSource,
    calibrate,
};
use crate::imaging::measurement::WhiteModel;
use crate::raw;

/// Where the micro-image pitch is taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PitchName {
    /// The frame of the boards.
    Frame,
    /// The white frame, taken at the same Δv: many times as sharp.
    White,
}

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
    #[arg(long, value_name = "MM,MM,...", value_delimiter = ',', required = true, allow_hyphen_values = true)]
    levels: Vec<f64>,
    /// Of --levels only the steps between the boards are known: find the distance that they have in common.
    #[arg(long, conflicts_with = "sigma_distance")]
    unknown_distance: bool,
    /// Standard uncertainty that all of --levels share, mm; without it main_lens.principal_from_mount_sigma_mm.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    sigma_distance: Option<f64>,
    /// Standard uncertainty that each of --levels has of its own, mm.
    #[arg(long, value_name = "MM", default_value_t = 0.0, allow_negative_numbers = true)]
    sigma_step: f64,
    /// Use the pitch of the micro-images, which is D (d + b)/d, as one more equation.
    #[arg(long, value_enum, value_name = "FROM", num_args = 0..=1, require_equals = true, default_missing_value = "frame")]
    micro_image_pitch: Option<PitchName>,
    /// Standard relative uncertainty of the configured mla.pitch_mm, which counts against the micro-image pitch.
    #[arg(long, value_name = "FRACTION", default_value_t = 1e-5, allow_negative_numbers = true)]
    sigma_mla_pitch: f64,
    /// Find the main lens's f as well.
    #[arg(long, conflicts_with = "sigma_f")]
    fit_f: bool,
    /// Standard uncertainty of main_lens.focal_length_mm, mm: f is then fitted within it.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    sigma_f: Option<f64>,
    /// Hold b at the configured camera's value: for frames so far out of focus that they cannot tell it.
    #[arg(long)]
    hold_b: bool,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
struct LevelReport {
    /// From the principal point; where it was unknown, as found.
    distance_mm: f64,
    spacing_px: f64,
    sigma_px: f64,
    /// What the fit leaves of the board's image distance.
    residual_mm: f64,
}

#[derive(Debug, Serialize)]
struct PitchReport {
    measured_px: f64,
    /// With the MLA pitch's own uncertainty.
    sigma_px: f64,
    /// What the fitted d and b make it.
    fitted_px: f64,
}

/// The result on the wire; docs/calibration.md says what each field means.
#[derive(Debug, Serialize)]
struct Report {
    d_mm: f64,
    d_sigma_mm: f64,
    b_mm: f64,
    b_sigma_mm: f64,
    /// Of d and b, in this order.
    covariance_mm2: [[f64; 2]; 2],
    /// d + N b at the design's N: v_ADJ of Eq. 15.
    image_distance_mm: f64,
    image_distance_sigma_mm: f64,
    /// What the boards' distances have in common beyond --levels; null where it was held at 0.
    distance_shift_mm: Option<f64>,
    distance_shift_sigma_mm: Option<f64>,
    /// Null where f was held.
    focal_length_mm: Option<f64>,
    focal_length_sigma_mm: Option<f64>,
    /// Null where it was no equation.
    micro_image_pitch: Option<PitchReport>,
    /// Squared residuals of boards and pitch in units of their uncertainty.
    chi_squared: f64,
    degrees_of_freedom: usize,
    /// Of the equations, each unknown in units of what they tell of it alone: 1 at best.
    condition: f64,
    /// Tilt x, tilt y and curvature that the boards share.
    field_px: [f64; 3],
    levels: Vec<LevelReport>,
    warnings: Vec<String>,
}

impl Report {
    fn new(calibration: &Calibration, signed_resolution: f64, warnings: Vec<String>) -> Self {
        let line = &calibration.line;
        let (image_distance_mm, image_distance_sigma_mm) = line.image_distance(signed_resolution);
        let value = |estimate: Option<Estimate>| estimate.map(|e| e.value_mm);
        let sigma = |estimate: Option<Estimate>| estimate.map(|e| e.sigma_mm);
        let pitch = |pitch: FittedPitch| PitchReport {
            measured_px: pitch.measured.pitch_px,
            sigma_px: pitch.measured.sigma_px,
            fitted_px: pitch.fitted_px,
        };
        Self {
            d_mm: line.d_mm,
            d_sigma_mm: line.d_sigma_mm(),
            b_mm: line.b_mm,
            b_sigma_mm: line.b_sigma_mm(),
            covariance_mm2: line.covariance,
            image_distance_mm,
            image_distance_sigma_mm,
            distance_shift_mm: value(line.shift),
            distance_shift_sigma_mm: sigma(line.shift),
            focal_length_mm: value(line.focal_length),
            focal_length_sigma_mm: sigma(line.focal_length),
            micro_image_pitch: line.micro_image_pitch.map(pitch),
            chi_squared: line.chi_squared,
            degrees_of_freedom: line.degrees_of_freedom,
            condition: line.condition,
            field_px: calibration.field_px,
            levels: levels(line),
            warnings,
        }
    }
}

pub(super) fn run(context: Context, args: Args) -> anyhow::Result<ExitCode> {
    let config = &context.config;
    let design = config.design();
    let raw = raw::read(&args.raw)?;
    let white = read_white(&frame_options(&context), args.white.as_deref())?.map(|(_, model)| model);
    let pitch = pitch(&args, white.as_ref())?;
    let options = options(&context, &args, pitch);
    let calibration =
        calibrate(&raw, white.as_ref(), &args.levels, &options).with_context(|| args.raw.display().to_string())?;
    let line = &calibration.line;
    let spacing = line.levels.first().map_or(0.0, |l| l.spacing_px);
    let mut warnings = disagreements(config, &raw, &calibration.grid, spacing);
    warnings.extend(doubts(line, design.mla.b(), design.main_lens.focal_length));
    let report = Report::new(&calibration, design.mla.signed_resolution(), warnings);
    if args.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        print(&report);
    }
    Ok(ExitCode::SUCCESS)
}

/// Where the micro-image pitch is to come from, measured where that is the white frame.
fn pitch(args: &Args, white: Option<&WhiteModel>) -> anyhow::Result<Option<PitchSource>> {
    match (args.micro_image_pitch, white) {
        (None, _) => Ok(None),
        (Some(PitchName::Frame), _) => Ok(Some(PitchSource::Frame)),
        (Some(PitchName::White), Some(white)) => Ok(Some(PitchSource::Given(MicroImagePitch::of(&white.grid)))),
        (Some(PitchName::White), None) => bail!("--micro-image-pitch=white needs --white, taken at the same Δv"),
    }
}

fn options(context: &Context, args: &Args, micro_image_pitch: Option<PitchSource>) -> CalibrationOptions {
    let config = &context.config;
    let design = config.design();
    let mut frame = frame_options(context);
    // A white frame that gives the pitch was taken at this very setting.
    frame.white_at_this_setting = args.micro_image_pitch == Some(PitchName::White);
    let shared = args.sigma_distance.or(config.main_lens.principal_from_mount_sigma_mm);
    CalibrationOptions {
        distances: if args.unknown_distance { Known::NotAtAll } else { known(shared) },
        distance_each_sigma_mm: args.sigma_step,
        focal_length: if args.fit_f { Known::NotAtAll } else { known(args.sigma_f) },
        hold_b: args.hold_b.then(|| (design.mla.b(), 0.0)),
        micro_image_pitch,
        mla_pitch_relative_sigma: args.sigma_mla_pitch,
        ..CalibrationOptions::new(frame, config.pixel_pitch().millimetres(), design.main_lens)
    }
}

/// What a standard uncertainty (mm) says; an impossible one is left to the calibration to refuse.
fn known(sigma_mm: Option<f64>) -> Known {
    match sigma_mm {
        None | Some(0.0) => Known::Exactly,
        Some(sigma_mm) => Known::Within(sigma_mm),
    }
}

/// What makes it doubtful that these boards stood at the distances given.
fn doubts(line: &ConjugateLine, configured_b_mm: f64, configured_f_mm: f64) -> Vec<String> {
    /// Standard deviations beyond which a difference is no chance.
    const TELLING: f64 = 4.0;
    let mut found = Vec::new();
    let per_degree = line.chi_squared / line.degrees_of_freedom.max(1) as f64;
    if line.degrees_of_freedom > 0 && per_degree > TELLING * TELLING {
        let (also, doubted) = if line.micro_image_pitch.is_some() {
            (" with the micro-image pitch", " and mla.pitch_mm and sensor.pixel_um exact")
        } else {
            ("", "")
        };
        found.push(format!(
            "the boards do not lie on one line{also}: what is left is {:.0} times the spacings' uncertainty; are the \
             --levels the boards' distances{doubted}?",
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
    if let Some(f) = line.focal_length
        && (f.value_mm - configured_f_mm).abs() > TELLING * f.sigma_mm
    {
        found.push(format!("f = {:.4} mm is not the configured {configured_f_mm} mm", f.value_mm));
    }
    found
}

fn levels(line: &ConjugateLine) -> Vec<LevelReport> {
    let wire = |l: &Level| LevelReport {
        distance_mm: l.distance_mm,
        spacing_px: l.spacing_px,
        sigma_px: l.sigma_px,
        residual_mm: l.residual_mm,
    };
    line.levels.iter().map(wire).collect()
}

fn print(report: &Report) {
    println!("d                {:.5} ± {:.5} mm (main lens to MLA)", report.d_mm, report.d_sigma_mm);
    println!("b                {:.6} ± {:.6} mm (MLA to sensor)", report.b_mm, report.b_sigma_mm);
    println!(
        "d + N b          {:.5} ± {:.5} mm (image distance of the point in focus)",
        report.image_distance_mm, report.image_distance_sigma_mm
    );
    if let (Some(f), Some(sigma)) = (report.focal_length_mm, report.focal_length_sigma_mm) {
        println!("f                {f:.4} ± {sigma:.4} mm (main lens)");
    }
    if let (Some(shift), Some(sigma)) = (report.distance_shift_mm, report.distance_shift_sigma_mm) {
        println!("boards           {shift:+.3} ± {sigma:.3} mm from where --levels has them");
    }
    for level in &report.levels {
        println!(
            "board            {:.3} mm: spacing {:.4} ± {:.4} px",
            level.distance_mm, level.spacing_px, level.sigma_px
        );
    }
    if let Some(pitch) = &report.micro_image_pitch {
        println!(
            "micro-images     pitch {:.5} ± {:.5} px, fitted {:.5} px",
            pitch.measured_px, pitch.sigma_px, pitch.fitted_px
        );
    }
    for warning in &report.warnings {
        println!("note             {warning}");
    }
}
