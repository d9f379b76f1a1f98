//! `plenalign camera exposure`: a running daemon's camera, its exposure and gain, and how its newest frame is exposed.

use std::fmt::Write as _;
use std::io::Write as _;
use std::process::ExitCode;

use anyhow::Context as _;
use reqwest::Method;
use serde::Serialize;
use serde_json::json;

use super::remote::{Daemon, RemoteArgs};
use crate::api::bench::camera::{ControlRequest, HistogramView};
use crate::control::service::light::{AutoExposureView, LightView};
use crate::device::light::ControlName;

/// The command that takes the lease, and what for.
const LEASED_FOR: (&str, &str) = ("camera", "the camera's exposure");
/// Widest bar of a histogram, and ranges that are shown.
const WIDTH: usize = 50;
const RANGES: usize = 16;

/// Arguments of `plenalign camera exposure`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The daemon's address.
    #[arg(long, value_name = "URL", default_value = "http://127.0.0.1:8080")]
    server: String,
    #[command(flatten)]
    remote: RemoteArgs,
    /// Set the exposure, in the camera's unit: milliseconds, as a rule.
    #[arg(long, value_name = "VALUE", conflicts_with = "auto")]
    exposure: Option<f64>,
    /// Set the gain, in the camera's unit.
    #[arg(long, value_name = "VALUE", conflicts_with = "auto")]
    gain: Option<f64>,
    /// Find both for a white frame: put the diffuser on the lens first.
    #[arg(long)]
    auto: bool,
    /// Show how many pixels of the newest frame have which grey level, too.
    #[arg(long)]
    histogram: bool,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// What is printed.
#[derive(Debug, Serialize)]
struct Shown {
    #[serde(flatten)]
    light: LightView,
    /// What came of finding the exposure.
    #[serde(skip_serializing_if = "Option::is_none")]
    found: Option<Found>,
    #[serde(skip_serializing_if = "Option::is_none")]
    histogram: Option<HistogramView>,
}

#[derive(Debug, Serialize)]
struct Found {
    changed: bool,
    frames: u32,
    bright_level: f64,
    clipped_share: f64,
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Runtime::new().context("the async runtime does not start")?;
    let shown = runtime.block_on(carry_out(args))?;
    let text = if args.json { serde_json::to_string_pretty(&shown)? + "\n" } else { text(&shown)? };
    std::io::stdout().write_all(text.as_bytes())?;
    Ok(ExitCode::SUCCESS)
}

async fn carry_out(args: &Args) -> anyhow::Result<Shown> {
    let daemon = Daemon::new(&args.server, &args.remote)?;
    let wanted = [(ControlName::Exposure, args.exposure), (ControlName::Gain, args.gain)];
    let wanted: Vec<(ControlName, f64)> = wanted.into_iter().filter_map(|(name, to)| Some((name, to?))).collect();
    let (mut light, mut found) = (None, None);
    if args.auto {
        let path = "/api/v1/camera/auto-exposure";
        let searched =
            daemon.with_lease(LEASED_FOR, async |key| daemon.command(Method::POST, path, key, &json!(null)).await);
        let AutoExposureView { light: now, changed, frames, bright_level, clipped_share } = searched.await?;
        (light, found) = (Some(now), Some(Found { changed, frames, bright_level, clipped_share }));
    } else if !wanted.is_empty() {
        let set = async |key: &str| {
            let mut now = None;
            for &(name, value) in &wanted {
                let path = format!("/api/v1/camera/controls/{name}");
                now = Some(daemon.command(Method::PUT, &path, key, &ControlRequest { value }).await?);
            }
            Ok(now)
        };
        light = daemon.with_lease(LEASED_FOR, set).await?;
    }
    let light = match light {
        Some(light) => light,
        None => daemon.get("/api/v1/camera/controls").await?,
    };
    let histogram = match args.histogram {
        true => Some(daemon.get(&format!("/api/v1/camera/histogram?ranges={RANGES}")).await?),
        false => None,
    };
    Ok(Shown { light, found, histogram })
}

fn text(shown: &Shown) -> Result<String, std::fmt::Error> {
    let mut out = String::new();
    for control in &shown.light.controls {
        let unit = control.unit.suffix();
        let value = control.value.map_or_else(|| "not known".to_owned(), |value| format!("{value}{unit}"));
        let limits = format!("{} to {}{unit} in steps of {}", control.minimum, control.maximum, control.step);
        writeln!(out, "{:<9} {value:<10} {limits}", control.name.name())?;
        if let Some(why) = &control.locked {
            writeln!(out, "          cannot be set: {why}")?;
        }
    }
    if shown.light.controls.is_empty() {
        writeln!(out, "this camera has no exposure and no gain that the daemon can set")?;
    }
    if let Some(found) = &shown.found {
        let Found { changed, frames, bright_level, clipped_share } = found;
        let how = if *changed { "found" } else { "left as it was" };
        writeln!(
            out,
            "{how}: the bright pixels are at {:.0} % of white, {:.2} % are clipped, after {frames} frame{}",
            100.0 * bright_level,
            100.0 * clipped_share,
            if *frames == 1 { "" } else { "s" }
        )?;
    }
    if let Some(histogram) = &shown.histogram {
        bars(&mut out, histogram)?;
    }
    Ok(out)
}

fn bars(out: &mut String, histogram: &HistogramView) -> std::fmt::Result {
    let pixels = histogram.counts.iter().sum::<u64>().max(1) as f64;
    let most = histogram.counts.iter().copied().max().unwrap_or(1).max(1) as f64;
    writeln!(out, "frame {}, {} bits:", histogram.frame_seq, histogram.bits)?;
    for (index, &count) in histogram.counts.iter().enumerate() {
        let bar = "#".repeat((WIDTH as f64 * count as f64 / most).round() as usize);
        let from = index as u64 * histogram.levels_per_range;
        let line = format!("  from {from:>5}  {:>5.1} %  {bar}", 100.0 * count as f64 / pixels);
        writeln!(out, "{}", line.trim_end())?;
    }
    let (black, clipped) = (100.0 * histogram.black_share, 100.0 * histogram.clipped_share);
    writeln!(out, "  {black:.1} % at black, {clipped:.2} % clipped")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::light::{ControlUnit, LightControl};

    #[test]
    fn values_are_shown_with_limits_and_what_keeps_them_from_being_set() {
        let control = |name: ControlName, unit, locked| LightControl {
            name,
            key: name.name().to_owned(),
            unit,
            value: Some(10.0),
            minimum: 0.1,
            maximum: 100.0,
            step: 0.1,
            default: 10.0,
            automatic: false,
            locked,
        };
        let locked = Some("the camera adjusts it by itself".to_owned());
        let controls = vec![
            control(ControlName::Exposure, ControlUnit::Ms, None),
            control(ControlName::Gain, ControlUnit::Driver, locked),
            control(ControlName::Gain, ControlUnit::Db, None),
        ];
        let histogram = HistogramView {
            frame_seq: 7,
            captured_at: jiff::Timestamp::UNIX_EPOCH,
            frame_age_ms: 3.0,
            bits: 12,
            levels_per_range: 2048,
            counts: vec![75, 25],
            black_share: 0.5,
            clipped_from: 4014,
            clipped_share: 0.001,
            overexposed: false,
            simulated: false,
            replayed: false,
        };
        let light = LightView { controls, white_frame: false, job: None };
        let found = Some(Found { changed: false, frames: 1, bright_level: 0.8, clipped_share: 0.0 });
        let text = text(&Shown { light, found, histogram: Some(histogram) }).unwrap();
        for line in [
            "exposure  10 ms      0.1 to 100 ms in steps of 0.1",
            "gain      10         0.1 to 100 in steps of 0.1",
            "          cannot be set: the camera adjusts it by itself",
            "gain      10 dB      0.1 to 100 dB in steps of 0.1",
            "left as it was: the bright pixels are at 80 % of white, 0.00 % are clipped, after 1 frame",
            "frame 7, 12 bits:",
            "  from  2048   25.0 %  #################",
            "  50.0 % at black, 0.10 % clipped",
        ] {
            assert!(text.lines().any(|shown| shown == line), "{line}\n{text}");
        }
    }
}
