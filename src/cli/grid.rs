//! `plenalign grid`: the micro-images of raw frames alone, white or textured.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use serde::Serialize;

use super::Context;
use super::measure::frame_options;
use crate::config::ConfigOrigin;
use crate::imaging::grid::{Grid, GridOptions, find_grid, pixel_noise};
use crate::imaging::measurement::{evened, expected_grid};
use crate::raw;

/// Part by which the pitch may differ from one that is given.
const PITCH_SLACK: f64 = 0.1;

/// Arguments of `plenalign grid`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The raw frames, white or textured: PNG, TIFF or PGM, 8 to 16 bits. Each is looked at by itself.
    #[arg(value_name = "RAW", required = true)]
    raw: Vec<PathBuf>,
    /// About the micro-image pitch, px: only within a tenth of it is one looked for.
    #[arg(long, value_name = "PX")]
    pitch: Option<f64>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// A grid on the wire.
#[derive(Debug, Serialize)]
pub(super) struct GridReport {
    array: &'static str,
    pub(super) pitch_px: f64,
    pitch_sigma_px: f64,
    rotation_deg: f64,
    rotation_sigma_deg: f64,
    centre_px: [f64; 2],
    centre_sigma_px: f64,
    pub(super) micro_images: usize,
    residual_px: f64,
    scatter_px: f64,
}

impl GridReport {
    pub(super) fn new(grid: &Grid) -> Self {
        Self {
            array: grid.array.name(),
            pitch_px: grid.pitch_px(),
            pitch_sigma_px: grid.sigma.pitch_px,
            rotation_deg: grid.rotation().to_degrees(),
            rotation_sigma_deg: grid.sigma.rotation_rad.to_degrees(),
            centre_px: grid.centre,
            centre_sigma_px: grid.sigma.centre_px,
            micro_images: grid.micro_images(),
            residual_px: grid.residual_px,
            scatter_px: grid.scatter_px,
        }
    }

    /// What is printed of it, line by line: name and value.
    pub(super) fn rows(&self) -> [(&'static str, String); 3] {
        let [x, y] = self.centre_px;
        [
            ("array", format!("{}, {} micro-images", self.array, self.micro_images)),
            (
                "pitch",
                format!(
                    "{:.5} ± {:.5} px, rotation {:+.4} ± {:.4}°",
                    self.pitch_px, self.pitch_sigma_px, self.rotation_deg, self.rotation_sigma_deg
                ),
            ),
            ("centre", format!("{x:.3}, {y:.3} ± {:.3} px, residual {:.3} px", self.centre_sigma_px, self.residual_px)),
        ]
    }
}

/// A frame's noise (grey levels) in words.
pub(super) fn noise_words(noise: f64) -> String {
    format!("{noise:.2} grey levels, as far as one frame shows it")
}

/// What one frame comes to.
#[derive(Debug, Serialize)]
struct FrameReport {
    file: String,
    frame_size_px: [usize; 2],
    grid: Option<GridReport>,
    /// What its flattest parts show of its noise; none where they are clipped.
    noise_grey_levels: Option<f64>,
    /// Why there is no grid.
    refused: Option<String>,
}

/// All of them.
#[derive(Debug, Serialize)]
struct Report {
    frames: Vec<FrameReport>,
}

pub(super) fn run(context: Context, args: Args) -> anyhow::Result<ExitCode> {
    let any = GridOptions::default();
    let given = args.pitch.map(|pitch| [1.0 - PITCH_SLACK, 1.0 + PITCH_SLACK].map(|share| share * pitch));
    if let (Some(pitch), Some([least, most])) = (args.pitch, given) {
        let [finest, widest] = any.pitch_px;
        anyhow::ensure!(most >= finest && least <= widest, "--pitch {pitch}: {finest} to {widest} px are looked for");
    }
    let options = frame_options(&context);
    let mut report = Report { frames: Vec::new() };
    for path in &args.raw {
        let raw = raw::read(path).with_context(|| path.display().to_string())?;
        let even = evened(&raw, options.mosaic);
        let found = match given {
            Some(pitch_px) => find_grid(&even, &GridOptions { pitch_px, ..any }),
            None if context.origin == ConfigOrigin::Preset => find_grid(&even, &any),
            None => expected_grid(&even, &options),
        };
        report.frames.push(FrameReport {
            file: path.display().to_string(),
            frame_size_px: [raw.width(), raw.height()],
            grid: found.as_ref().ok().map(GridReport::new),
            noise_grey_levels: pixel_noise(&even),
            refused: found.err().map(|error| error.to_string()),
        });
    }
    if args.json {
        println!("{}", serde_json::to_string(&report)?);
    } else {
        report.frames.iter().for_each(FrameReport::print);
    }
    let whole = report.frames.iter().all(|frame| frame.grid.is_some());
    Ok(if whole { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

impl FrameReport {
    fn print(&self) {
        let row = |name: &str, value: &str| println!("{name:<16} {value}");
        let [width, height] = self.frame_size_px;
        row("frame", &format!("{}, {width} x {height} px", self.file));
        if let Some(grid) = &self.grid {
            grid.rows().iter().for_each(|(name, value)| row(name, value));
        }
        if let Some(refused) = &self.refused {
            if let Some(noise) = self.noise_grey_levels {
                row("noise", &noise_words(noise));
            }
            row("refused", refused);
        }
    }
}
