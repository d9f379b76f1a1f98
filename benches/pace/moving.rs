//! The focus axis in motion: the camera shows light that was traced beforehand, by the pose, so that it keeps its pace, and
//! each frame's spacing is known from the optics.

use std::time::{Duration, Instant};

use plenalign::api::proto::{Reading, ReadingState};
use plenalign::config::Config;
use reqwest::Method;
use serde_json::{Value, json};

use crate::client::Client;
use crate::daemon::Daemon;
use crate::{Camera, Failure};

/// Δv goes to and fro between these, mm.
const WAY_MM: [f64; 2] = [1.2, 2.2];
/// From a pose that is shown to the next, mm.
const STEP_MM: f64 = 0.02;
/// Steps by which a frame's readback may lag behind what it shows: the controller is asked at its own times.
const LAG_STEPS: i64 = 2;
/// A reading counts as right within so many of its standard uncertainties.
const SIGMAS: f64 = 3.0;
/// How near a pose an axis has to be to stand at it, mm.
const NEAR_MM: f64 = 0.001;

/// Of the configuration, what has the axis go at 0.5 mm/s and the camera keep each pose's light.
pub(crate) const CONFIG: &str = "[bench.focus]\nspeed_mm_per_s = 0.5\nbacklash_mm = 0.0\n\
                                 [bench.simulation.reel]\nstep_um = 20.0\nposes = 120\n";

/// What was read on the way.
pub(crate) struct OnTheWay {
    /// Readings a second.
    pub(crate) rate: f64,
    /// How many of a hundred were right, of all frames that came.
    pub(crate) right_percent: f64,
}

/// The spacing at a step of Δv, px: the flat board stands in air where it would be in focus, and without a shell exact rays
/// and Eq. 16 agree.
fn spacing_px(config: &Config, step: i64) -> f64 {
    let design = config.design();
    let distance_mm = design.joint(config.assembly.l_bound_mm).equivalent_distance;
    let view = design.exact_in_air(step as f64 * STEP_MM, distance_mm);
    view.paraxial_spacing() / config.pixel_pitch().millimetres()
}

/// How many of its standard uncertainties a reading is off, from the nearest of the poses that the frame may show.
fn sigmas(config: &Config, reading: &Reading) -> Option<f64> {
    let nearest = (reading.focus_mm? / STEP_MM).round() as i64;
    let off = |step| (reading.spacing_px - spacing_px(config, step)).abs() / reading.spacing_sigma_px;
    (nearest - LAG_STEPS..=nearest + LAG_STEPS).map(off).min_by(f64::total_cmp)
}

/// Moves the focus axis, and returns when it stands.
pub(crate) async fn go(daemon: &Daemon, position_mm: f64) -> Result<(), Failure> {
    daemon.ask(Method::POST, "axes/focus/move", &json!({ "position_mm": position_mm })).await?;
    daemon.stands().await
}

/// Homes the axis, and has the light of every pose on the way traced.
pub(crate) async fn trace(daemon: &Daemon) -> Result<(), Failure> {
    daemon.ask(Method::POST, "axes/focus/home", &Value::Null).await?;
    daemon.stands().await?;
    let mut client = Client::connect(daemon).await?;
    client.readings(true).await?;
    let [from, to] = WAY_MM.map(|end| (end / STEP_MM).round() as i64);
    for step in from..=to {
        let position_mm = step as f64 * STEP_MM;
        go(daemon, position_mm).await?;
        let is_there = |reading: &Reading| {
            reading.settled && reading.focus_mm.is_some_and(|mm| (mm - position_mm).abs() < NEAR_MM)
        };
        while !is_there(&client.reading().await?) {}
    }
    client.rest().await?;
    Ok(())
}

/// Goes to and fro for so long.
pub(crate) async fn sweep(daemon: &Daemon, camera: &Camera, lasting: Duration) -> Result<OnTheWay, Failure> {
    let config = camera.config()?;
    let mut client = Client::connect(daemon).await?;
    client.readings(true).await?;
    let (mut measured, mut right, mut came, mut took) = (0u32, 0u32, 0u32, 0.0);
    let begin = Instant::now();
    let mut ends = WAY_MM.iter().cycle();
    while begin.elapsed() < lasting {
        let to = *ends.next().unwrap_or(&WAY_MM[0]);
        let mut before: Option<Reading> = None;
        let motion = go(daemon, to);
        tokio::pin!(motion);
        loop {
            let reading = tokio::select! {
                ended = &mut motion => break ended?,
                reading = client.reading() => reading?,
            };
            // From one frame in motion to the next: starting and stopping are no part of it.
            if let Some(before) = before.replace(reading.clone())
                && before.focus_mm != reading.focus_mm
                && !reading.settled
            {
                took += (reading.captured_monotonic_us as f64 - before.captured_monotonic_us as f64) / 1e6;
                came += 1;
                if reading.state() == ReadingState::Measured {
                    measured += 1;
                    right += u32::from(sigmas(&config, &reading).is_some_and(|sigmas| sigmas < SIGMAS));
                }
            }
        }
    }
    client.rest().await?;
    let [measured, right, came] = [measured, right, came].map(f64::from);
    Ok(OnTheWay { rate: measured / took, right_percent: 100.0 * right / came })
}
