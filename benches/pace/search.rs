//! How long the spacing stays lost.

use std::time::{Duration, Instant};

use plenalign::api::proto::{Reading, ReadingState};
use reqwest::Method;
use serde_json::json;

use crate::client::Client;
use crate::daemon::Daemon;
use crate::{Failure, moving};

/// How far the board is put away, mm.
const AWAY_MM: f64 = 60.0;
/// Where the focus axis is put meanwhile, mm.
const ELSEWHERE_MM: [f64; 2] = [2.2, 1.2];
/// How often each is tried.
const TIMES: usize = 6;
/// A spacing that differs by more is of another place of the board, px.
const CHANGED_PX: f64 = 0.1;
/// Readings for the meter to settle between two tries.
const READINGS: usize = 10;

/// The longest that a spacing was lost.
struct Longest(Duration);

impl Longest {
    /// From a reading that tells of a loss to the next that has a spacing.
    async fn until_found(&mut self, client: &mut Client, mut reading: Reading) -> Result<(), Failure> {
        let lost = Instant::now();
        while reading.state() != ReadingState::Measured {
            reading = client.reading().await?;
        }
        self.0 = self.0.max(lost.elapsed());
        Ok(())
    }
}

/// The board is put elsewhere and back, the axis stands.
pub(crate) async fn board_moved(daemon: &Daemon) -> Result<Duration, Failure> {
    let mut client = Client::connect(daemon).await?;
    client.readings(true).await?;
    let mut longest = Longest(Duration::ZERO);
    for time in 0..TIMES {
        let mut before = client.reading().await?;
        for _ in 0..READINGS {
            before = client.reading().await?;
        }
        let away = if time % 2 == 0 { AWAY_MM } else { 0.0 };
        daemon.ask(Method::PUT, "simulation/faults", &json!({ "scene": { "board_displaced_mm": away } })).await?;
        let mut reading = client.reading().await?;
        // Frames of the old place are on their way.
        while reading.state() == ReadingState::Measured && (reading.spacing_px - before.spacing_px).abs() < CHANGED_PX {
            reading = client.reading().await?;
        }
        longest.until_found(&mut client, reading).await?;
    }
    client.rest().await?;
    Ok(longest.0)
}

/// The axis goes elsewhere while nobody reads, so that the grid has moved, too: from when readings are asked for to the
/// first, the wait for a frame included.
pub(crate) async fn grid_moved(daemon: &Daemon) -> Result<Duration, Failure> {
    let mut client = Client::connect(daemon).await?;
    let mut longest = Longest(Duration::ZERO);
    for time in 0..TIMES {
        moving::go(daemon, ELSEWHERE_MM[time % 2]).await?;
        let asked = Instant::now();
        client.readings(true).await?;
        while client.reading().await?.state() != ReadingState::Measured {}
        longest.0 = longest.0.max(asked.elapsed());
        client.rest().await?;
    }
    Ok(longest.0)
}
