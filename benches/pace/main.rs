//! End to end: the daemon with a simulated bench, and one client that decodes what it gets. Readings a second, how old they
//! are when they come, and what measuring them takes of the processor.
//!
//! The daemon's own counter of frames measured has to equal the readings that came to who does nothing but read: none is
//! made up, or lost.
//!
//! ```text
//!   cargo bench --bench pace [-- [--partial] [--out FILE]]
//!
//!   --partial    1160² alone, and shorter
//!   --out FILE   the figures as JSON, besides
//! ```

mod client;
mod daemon;
mod moving;
mod page;
mod search;

use std::process::ExitCode;
use std::time::Duration;

use plenalign::api::proto::ReadingState;
use plenalign::config::Config;
use serde_json::{Value, json};

use client::{Seen, crowd, look};
use daemon::Daemon;

type Failure = Box<dyn std::error::Error + Send + Sync>;

/// A camera, and what is to be reached with it.
struct Camera {
    label: &'static str,
    width: u32,
    height: u32,
    rate_hz: f64,
    wanted: Wanted,
}

struct Wanted {
    readings_hz: f64,
    age_ms: f64,
    share: f64,
    readings_beside_hz: f64,
    pictures_hz: f64,
    picture_age_ms: f64,
    readings_moving_hz: f64,
    page_pictures_hz: f64,
    page_readings_hz: f64,
    found_ms: f64,
    found_elsewhere_ms: f64,
    white_ms: f64,
    measuring_s: f64,
}

/// What an alignment may take, but for motion and operator, s.
const ALIGNMENT_S: f64 = 60.0;

/// Columns and rows of the screen that pictures are for.
const SCREEN_PX: [u32; 2] = [1920, 1080];

impl Camera {
    /// The configuration of a bench with it, everything else as it comes.
    fn config(&self) -> Result<Config, Failure> {
        let text = format!("[sensor]\nwidth_px = {}\nheight_px = {}\n", self.width, self.height);
        Ok(Config::from_toml(&text, "the benchmark")?)
    }

    /// The frame on the screen, but for its first columns.
    fn on_screen(&self, without: u32) -> Value {
        let [columns, rows] = SCREEN_PX.map(f64::from);
        let scale = (columns / f64::from(self.width)).min(rows / f64::from(self.height)).min(1.0);
        let room = |pixels: u32| (f64::from(pixels) * scale).round() as u32;
        let width = self.width - without;
        json!({
            "x_px": without, "y_px": 0, "width_px": width, "height_px": self.height,
            "picture_width_px": room(width), "picture_height_px": room(self.height),
        })
    }
}

const CAMERAS: [Camera; 2] = [
    Camera {
        label: "1160x1160",
        width: 1160,
        height: 1160,
        rate_hz: 60.0,
        wanted: Wanted {
            readings_hz: 55.0,
            age_ms: 30.0,
            share: 0.35,
            readings_beside_hz: 50.0,
            pictures_hz: 20.0,
            picture_age_ms: 60.0,
            readings_moving_hz: 50.0,
            page_pictures_hz: 10.0,
            page_readings_hz: 30.0,
            found_ms: 100.0,
            found_elsewhere_ms: 200.0,
            white_ms: 300.0,
            measuring_s: 1.0,
        },
    },
    Camera {
        label: "4096x3072",
        width: 4096,
        height: 3072,
        rate_hz: 30.0,
        wanted: Wanted {
            readings_hz: 25.0,
            age_ms: 80.0,
            share: 0.9,
            readings_beside_hz: 20.0,
            pictures_hz: 12.0,
            picture_age_ms: 120.0,
            readings_moving_hz: 20.0,
            page_pictures_hz: 5.0,
            page_readings_hz: 15.0,
            found_ms: 300.0,
            found_elsewhere_ms: 500.0,
            white_ms: 800.0,
            measuring_s: 4.0,
        },
    },
];

/// The value that so many of a hundred do not exceed.
fn percentile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values
        .get(((values.len() as f64 * share) as usize).min(values.len().saturating_sub(1)))
        .copied()
        .unwrap_or(f64::NAN)
}

/// A line of the table: what, how much, at least or at most how much.
#[derive(serde::Serialize)]
struct Line {
    camera: &'static str,
    what: &'static str,
    unit: &'static str,
    found: f64,
    wanted: f64,
    at_least: bool,
}

impl Line {
    fn reached(&self) -> bool {
        if self.at_least { self.found >= self.wanted } else { self.found <= self.wanted }
    }
}

/// The lines of the table that belong to a camera.
struct Lines(&'static str, Vec<Line>);

impl Lines {
    fn at_least(&mut self, what: &'static str, found: f64, wanted: f64, unit: &'static str) {
        self.put(Line { camera: self.0, what, unit, found, wanted, at_least: true });
    }

    fn at_most(&mut self, what: &'static str, found: f64, wanted: f64, unit: &'static str) {
        self.put(Line { camera: self.0, what, unit, found, wanted, at_least: false });
    }

    /// Tells it at once: the whole table takes minutes.
    fn put(&mut self, line: Line) {
        eprintln!("pace: {}: {}: {:.1} {}", line.camera, line.what, line.found, line.unit);
        self.1.push(line);
    }
}

fn rate(count: usize, seen: &Seen) -> f64 {
    count as f64 / seen.took.as_secs_f64()
}

/// Readings a second that have a spacing.
fn measured(seen: &Seen) -> f64 {
    rate(seen.readings.iter().filter(|(reading, _)| reading.state() == ReadingState::Measured).count(), seen)
}

fn age_p95(seen: &Seen) -> f64 {
    percentile(&mut seen.readings.iter().map(|(_, age)| *age).collect::<Vec<f64>>(), 0.95)
}

async fn measure(camera: &'static Camera, lasting: Duration) -> Result<Vec<Line>, Failure> {
    let mut lines = Lines(camera.label, Vec::new());
    let wanted = &camera.wanted;
    let daemon = Daemon::start(camera, "").await?;
    daemon.watch().await?;
    at_rest(&daemon, camera, lasting, &mut lines).await?;
    let page = page::show(&daemon, lasting).await?;
    lines.at_least("pictures painted by the page", page.pictures, wanted.page_pictures_hz, "/s");
    lines.at_least("readings in the page", page.readings, wanted.page_readings_hz, "/s");
    drop(daemon);
    let daemon = Daemon::start(camera, moving::CONFIG).await?;
    daemon.watch().await?;
    moving::trace(&daemon).await?;
    let moving = moving::sweep(&daemon, camera, lasting).await?;
    lines.at_least("readings, Δv at 0.5 mm/s", moving.rate, wanted.readings_moving_hz, "/s");
    lines.at_least("frames then that are read within 3 sigma", moving.right_percent, 99.0, "%");
    let milliseconds = |time: Duration| 1000.0 * time.as_secs_f64();
    let found = milliseconds(search::board_moved(&daemon).await?);
    lines.at_most("from lost to found, longest", found, wanted.found_ms, "ms");
    let found = milliseconds(search::grid_moved(&daemon).await?);
    lines.at_most("where the grid has moved too, longest", found, wanted.found_elsewhere_ms, "ms");
    drop(daemon);
    alignment(camera, &mut lines).await?;
    Ok(lines.1)
}

/// Nothing moves: readings alone, with pictures besides, and among many viewers.
async fn at_rest(daemon: &Daemon, camera: &Camera, lasting: Duration, lines: &mut Lines) -> Result<(), Failure> {
    let wanted = &camera.wanted;
    let alone = look(daemon, camera, false, lasting).await?;
    lines.at_least("readings at rest", measured(&alone), wanted.readings_hz, "/s");
    lines.at_most("age of the reading, p95", age_p95(&alone), wanted.age_ms, "ms");
    let share = alone.measuring_s / alone.took.as_secs_f64();
    lines.at_most("processor of the measuring", 100.0 * share, 100.0 * wanted.share, "% of a core");
    let mut beside = look(daemon, camera, true, lasting).await?;
    lines.at_least("readings, with pictures besides", measured(&beside), wanted.readings_beside_hz, "/s");
    lines.at_least("pictures decoded", rate(beside.pictures.len(), &beside), wanted.pictures_hz, "/s");
    let age = percentile(&mut beside.pictures, 0.95);
    lines.at_most("age of the picture, p95", age, wanted.picture_age_ms, "ms");
    let viewers = crowd(daemon, camera).await?;
    let crowded = look(daemon, camera, true, lasting).await?;
    drop(viewers);
    lines.at_least("measured, with 16 viewports besides", crowded.daemon_hz, wanted.readings_beside_hz, "/s");
    lines.at_least("readings then", measured(&crowded), wanted.readings_beside_hz, "/s");
    lines.at_most("age of the reading then, p95", age_p95(&crowded), wanted.age_ms, "ms");
    Ok(())
}

/// A joint alignment with an operator who needs no time, and nobody who looks.
async fn alignment(camera: &Camera, lines: &mut Lines) -> Result<(), Failure> {
    let daemon = Daemon::start(camera, "").await?;
    let job = daemon.job(&json!({ "kind": "joint_alignment" })).await?;
    let spent = &job["report"]["time_spent"];
    let part = |name: &str| spent[name].as_f64().ok_or_else(|| format!("the report lacks {name}: {spent}"));
    let white_s = daemon.metric("plenalign_white_frame_seconds_sum").await?;
    let whites = daemon.metric("plenalign_white_frame_seconds_count").await?;
    let wanted = &camera.wanted;
    lines.at_most("white frame, mean", 1000.0 * white_s / whites, wanted.white_ms, "ms");
    let measuring_s = part("measuring_s")? - white_s;
    lines.at_most("alignment: measuring, without white frames", measuring_s, wanted.measuring_s, "s");
    let besides = part("total_s")? - part("motion_s")? - part("operator_s")?;
    lines.at_most("alignment: all but motion and operator", besides, ALIGNMENT_S, "s");
    Ok(())
}

#[tokio::main(flavor = "current_thread")]
async fn main() -> ExitCode {
    let partial = std::env::args().any(|argument| argument == "--partial");
    let (cameras, lasting) = if partial { (&CAMERAS[..1], 5) } else { (&CAMERAS[..], 20) };
    let mut lines = Vec::new();
    for camera in cameras {
        match measure(camera, Duration::from_secs(lasting)).await {
            Ok(found) => lines.extend(found),
            Err(error) => {
                eprintln!("pace: {}: {error}", camera.label);
                return ExitCode::FAILURE;
            }
        }
    }
    let out = std::env::args().skip_while(|argument| argument != "--out").nth(1);
    if let Some(out) = out
        && let Err(error) = std::fs::write(&out, json!(lines).to_string())
    {
        eprintln!("pace: {out}: {error}");
        return ExitCode::FAILURE;
    }
    println!("| camera | what | found | wanted | reached |\n|---|---|---|---|---|");
    for line in &lines {
        let Line { camera, what, unit, found, wanted, at_least } = line;
        let (sign, reached) = (if *at_least { "≥" } else { "≤" }, if line.reached() { "yes" } else { "**no**" });
        println!("| {camera} | {what} | {found:.1} {unit} | {sign} {wanted:.0} {unit} | {reached} |");
    }
    ExitCode::SUCCESS
}
