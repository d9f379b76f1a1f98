//! A client that decodes what it gets, as a viewer does.

use std::time::{Duration, Instant};

use futures_util::{SinkExt as _, StreamExt as _};
use nix::time::{ClockId, clock_gettime};
use plenalign::api::proto::{Reading, Viewed, viewed::What};
use prost::Message as _;
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::Message;

use crate::daemon::Daemon;
use crate::{Camera, Failure};

type Socket = tokio_tungstenite::WebSocketStream<tokio_tungstenite::MaybeTlsStream<tokio::net::TcpStream>>;

/// Viewers of parts of their own, as many as the daemon allows where nothing else is configured; one of them is the client
/// whose readings count.
const VIEWERS: u32 = 16;
/// Readings that come before the camera has its pace are not counted.
const FIRST: usize = 30;
/// A daemon that says nothing for so long is waited for no longer.
const PATIENCE: Duration = Duration::from_secs(60);
/// After it the meter rests once nobody reads.
const REST: Duration = Duration::from_secs(2);

/// What a client saw.
#[derive(Default)]
pub(crate) struct Seen {
    pub(crate) took: Duration,
    pub(crate) readings: Vec<(Reading, f64)>,
    /// Ages of the pictures decoded, ms.
    pub(crate) pictures: Vec<f64>,
    pub(crate) measuring_s: f64,
    /// Frames that the daemon measured meanwhile, a second.
    pub(crate) daemon_hz: f64,
}

/// A connection to the daemon.
pub(crate) struct Client(Socket);

impl Client {
    pub(crate) async fn connect(daemon: &Daemon) -> Result<Self, Failure> {
        Ok(Self(tokio_tungstenite::connect_async(format!("ws://{}/api/v1/ws", daemon.address)).await?.0))
    }

    async fn ask(&mut self, message: Value) -> Result<(), Failure> {
        Ok(self.0.send(Message::text(message.to_string())).await?)
    }

    pub(crate) async fn readings(&mut self, on: bool) -> Result<(), Failure> {
        self.ask(json!({ "type": "readings", "on": on })).await
    }

    /// Asks for pictures of a viewport.
    async fn pictures(&mut self, viewport: Value) -> Result<(), Failure> {
        self.ask(json!({ "type": "pictures", "on": true, "max_rate_hz": 60, "viewport": viewport, "window": 2 })).await
    }

    /// Says that a picture has been seen, so that the next may come.
    async fn seen(&mut self, seq: u64) -> Result<(), Failure> {
        self.ask(json!({ "type": "seen", "seq": seq })).await
    }

    /// What comes next for a viewer.
    async fn next(&mut self) -> Result<Option<What>, Failure> {
        loop {
            let message = tokio::time::timeout(PATIENCE, self.0.next()).await?;
            if let Message::Binary(bytes) = message.ok_or("the daemon closed the connection")?? {
                return Ok(Viewed::decode(bytes)?.what);
            }
        }
    }

    /// The next reading.
    pub(crate) async fn reading(&mut self) -> Result<Reading, Failure> {
        loop {
            if let Some(What::Reading(reading)) = self.next().await? {
                return Ok(reading);
            }
        }
    }

    /// Readings that still come until the meter rests.
    pub(crate) async fn rest(&mut self) -> Result<u64, Failure> {
        self.readings(false).await?;
        self.ask(json!({ "type": "pictures", "on": false })).await?;
        let (mut count, end) = (0, tokio::time::Instant::now() + REST);
        while let Ok(next) = tokio::time::timeout_at(end, self.next()).await {
            count += u64::from(matches!(next?, Some(What::Reading(_))));
        }
        Ok(count)
    }
}

fn now_us() -> Result<f64, Failure> {
    let now = clock_gettime(ClockId::CLOCK_MONOTONIC)?;
    Ok(now.tv_sec() as f64 * 1e6 + now.tv_nsec() as f64 / 1e3)
}

/// Reads for so long, with pictures besides where they are asked for.
pub(crate) async fn look(daemon: &Daemon, camera: &Camera, pictures: bool, lasting: Duration) -> Result<Seen, Failure> {
    let before = daemon.counted().await?;
    let mut client = Client::connect(daemon).await?;
    client.readings(true).await?;
    if pictures {
        client.pictures(camera.on_screen(0)).await?;
    }
    let (mut seen, mut all, mut begin) = (Seen::default(), 0u64, None);
    let (mut measuring, mut counted_at) = (0.0, 0);
    while begin.is_none_or(|begin: Instant| begin.elapsed() < lasting) {
        match client.next().await? {
            Some(What::Reading(reading)) => {
                let age_ms = (now_us()? - reading.captured_monotonic_us as f64) / 1e3;
                all += 1;
                if all as usize == FIRST {
                    begin = Some(Instant::now());
                    measuring = daemon.measuring_s()?;
                    counted_at = daemon.counted().await?;
                    seen.pictures.clear();
                } else if all as usize > FIRST {
                    seen.readings.push((reading, age_ms));
                }
            }
            Some(What::Frame(picture)) => {
                let decoded = image::load_from_memory_with_format(&picture.jpeg, image::ImageFormat::Jpeg)?;
                std::hint::black_box(decoded);
                seen.pictures.push((now_us()? - picture.captured_monotonic_us as f64) / 1e3);
                client.seen(picture.seq).await?;
            }
            _ => {}
        }
    }
    seen.took = begin.map_or(Duration::ZERO, |begin| begin.elapsed());
    seen.measuring_s = daemon.measuring_s()? - measuring;
    seen.daemon_hz = (daemon.counted().await? - counted_at) as f64 / seen.took.as_secs_f64();
    all += client.rest().await?;
    let counted = daemon.counted().await? - before;
    // One that was under way as the client stopped reading went to nobody; and of those that come while a picture is on its
    // way to a slow client, the newest wins.
    let most = if pictures { u64::MAX } else { all + 1 };
    if !(all..=most).contains(&counted) {
        return Err(format!("{}: {all} readings came, and the daemon measured {counted} frames", camera.label).into());
    }
    Ok(seen)
}

/// Viewers of a part each of their own, beside the client; they look as long as this is held.
pub(crate) async fn crowd(daemon: &Daemon, camera: &Camera) -> Result<tokio::task::JoinSet<()>, Failure> {
    let mut viewers = tokio::task::JoinSet::new();
    for nth in 1..VIEWERS {
        let mut viewer = Client::connect(daemon).await?;
        viewer.pictures(camera.on_screen(nth)).await?;
        viewers.spawn(async move {
            while let Ok(what) = viewer.next().await {
                if let Some(What::Frame(picture)) = what
                    && viewer.seen(picture.seq).await.is_err()
                {
                    return;
                }
            }
        });
    }
    Ok(viewers)
}
