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

use std::io::BufRead as _;
use std::path::Path;
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

use futures_util::{SinkExt as _, StreamExt as _};
use nix::time::{ClockId, clock_gettime};
use plenalign::api::error::LEASE_HEADER;
use plenalign::api::proto::{Reading, ReadingState, Viewed, viewed::What};
use prost::Message as _;
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::Message;

type Socket = tokio_tungstenite::WebSocketStream<tokio_tungstenite::MaybeTlsStream<tokio::net::TcpStream>>;
type Failure = Box<dyn std::error::Error + Send + Sync>;

/// A camera, and what is to be reached with it.
struct Camera {
    label: &'static str,
    width: u32,
    height: u32,
    rate_hz: f64,
    /// Raw pixels to a picture pixel, each way, for a screen of 1920 × 1080.
    wanted: Wanted,
}

struct Wanted {
    readings_hz: f64,
    age_ms: f64,
    share: f64,
    readings_beside_hz: f64,
    pictures_hz: f64,
    picture_age_ms: f64,
}

/// Columns and rows of the screen that pictures are for.
const SCREEN_PX: [u32; 2] = [1920, 1080];

/// Viewers of parts of their own, as many as the daemon allows where nothing else is configured; one of them is the client
/// whose readings count.
const VIEWERS: u32 = 16;

impl Camera {
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
        },
    },
];

/// Readings that come before the camera has its pace are not counted.
const FIRST: usize = 30;

/// After it the meter rests once nobody reads.
const REST: Duration = Duration::from_secs(2);

/// The daemon, ended with this.
struct Daemon {
    process: Child,
    address: String,
    client: reqwest::Client,
    _state: tempfile::TempDir,
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Daemon {
    fn start(camera: &Camera) -> Result<Self, Failure> {
        let state = tempfile::tempdir()?;
        let config = state.path().join("bench.toml");
        let Camera { width, height, rate_hz, .. } = camera;
        let text = format!(
            "[sensor]\nwidth_px = {width}\nheight_px = {height}\n\
             [bench.simulation]\nrays = 16\npreview_rays = 16\npreview_rate_hz = {rate_hz:.1}\n"
        );
        std::fs::write(&config, text)?;
        let mut process = Command::new(env!("CARGO_BIN_EXE_plenalign"))
            .args(["serve", "--simulated", "--json", "--listen", "127.0.0.1:0", "--config"])
            .arg(&config)
            .env("PLENALIGN_STATE_DIR", state.path())
            .env("RUST_LOG", "error")
            .stdout(Stdio::piped())
            .spawn()?;
        let mut line = String::new();
        let stdout = process.stdout.take().ok_or("the daemon has no output")?;
        std::io::BufReader::new(stdout).read_line(&mut line)?;
        let said: Value = serde_json::from_str(&line)?;
        let address = said["address"].as_str().ok_or("the daemon says no address")?;
        let address = address.trim_start_matches("http://").trim_end_matches('/').to_owned();
        plenalign::api::server::use_ring();
        let client = reqwest::Client::builder().no_proxy().tls_certs_only([]).build()?;
        Ok(Self { process, address, client, _state: state })
    }

    async fn send(&self, request: reqwest::RequestBuilder) -> Result<Value, Failure> {
        let answer = request.send().await?;
        let (status, text) = (answer.status(), answer.text().await?);
        if status.is_success() { Ok(serde_json::from_str(&text)?) } else { Err(format!("{status}: {text}").into()) }
    }

    fn url(&self, path: &str) -> String {
        format!("http://{}/api/v1/{path}", self.address)
    }

    /// Has a white frame and a flat board before the camera.
    async fn watch(&self) -> Result<(), Failure> {
        let lease = json!({ "owner": "the benchmark", "ttl_s": 3600 });
        let lease = self.send(self.client.post(self.url("lease/takeover")).json(&lease)).await?;
        let key = lease["key"].as_str().ok_or("the lease has no key")?;
        let off = self.client.put(self.url("shell")).header(LEASE_HEADER, key);
        self.send(off.json(&json!({ "state": "off" }))).await?;
        let job = self.client.post(self.url("jobs")).header(LEASE_HEADER, key);
        let job = self.send(job.json(&json!({ "kind": "spacing_watch", "duration_s": 1.0 }))).await?;
        let id = job["id"].as_str().ok_or("the job has no id")?;
        loop {
            let job = self.send(self.client.get(self.url(&format!("jobs/{id}")))).await?;
            match job["state"].as_str() {
                Some("pending" | "running" | "waiting_for_operator") => {
                    tokio::time::sleep(Duration::from_millis(200)).await;
                }
                Some("succeeded") => return Ok(()),
                _ => return Err(format!("the watch did not end well: {job}").into()),
            }
        }
    }

    /// Frames that the meter has tried to read so far.
    async fn counted(&self) -> Result<u64, Failure> {
        let text = self.client.get(format!("http://{}/metrics", self.address)).send().await?.text().await?;
        let counts = text.lines().filter(|line| line.starts_with("plenalign_readings_total{"));
        Ok(counts.filter_map(|line| line.rsplit(' ').next()?.parse::<f64>().ok()).sum::<f64>() as u64)
    }

    /// Processor time of the meter's own threads so far, s.
    fn measuring_s(&self) -> Result<f64, Failure> {
        let mut ticks = 0u64;
        for task in std::fs::read_dir(format!("/proc/{}/task", self.process.id()))? {
            let task = task?.path();
            // A thread may have ended meanwhile.
            let Ok(name) = std::fs::read_to_string(task.join("comm")) else { continue };
            if name.starts_with("meter-") {
                ticks += thread_ticks(&task)?;
            }
        }
        Ok(ticks as f64 / TICKS_PER_S)
    }
}

/// What the kernel counts a thread's time in, on every Linux there is for these machines.
const TICKS_PER_S: f64 = 100.0;

fn thread_ticks(task: &Path) -> Result<u64, Failure> {
    let stat = std::fs::read_to_string(task.join("stat"))?;
    // After the name in brackets: user and system time are the 12th and the 13th.
    let after = stat.rsplit_once(')').ok_or("a thread without a name")?.1;
    let fields: Vec<&str> = after.split_whitespace().collect();
    Ok(fields[11].parse::<u64>()? + fields[12].parse::<u64>()?)
}

/// What a client saw.
#[derive(Default)]
struct Seen {
    took: Duration,
    readings: Vec<(Reading, f64)>,
    /// Ages of the pictures decoded, ms.
    pictures: Vec<f64>,
    measuring_s: f64,
}

fn now_us() -> Result<f64, Failure> {
    let now = clock_gettime(ClockId::CLOCK_MONOTONIC)?;
    Ok(now.tv_sec() as f64 * 1e6 + now.tv_nsec() as f64 / 1e3)
}

async fn ask(socket: &mut Socket, message: Value) -> Result<(), Failure> {
    Ok(socket.send(Message::text(message.to_string())).await?)
}

/// Reads for so long, with pictures besides where they are asked for.
async fn look(daemon: &Daemon, camera: &Camera, pictures: bool, lasting: Duration) -> Result<Seen, Failure> {
    let before = daemon.counted().await?;
    let (mut socket, _) = tokio_tungstenite::connect_async(format!("ws://{}/api/v1/ws", daemon.address)).await?;
    ask(&mut socket, json!({ "type": "readings", "on": true })).await?;
    if pictures {
        let viewport = camera.on_screen(0);
        ask(
            &mut socket,
            json!({ "type": "pictures", "on": true, "max_rate_hz": 60, "viewport": viewport, "window": 2 }),
        )
        .await?;
    }
    let (mut seen, mut all, mut begin) = (Seen::default(), 0u64, None);
    let mut measuring = 0.0;
    loop {
        let message = tokio::time::timeout(Duration::from_secs(20), socket.next()).await?;
        let message = message.ok_or("the daemon closed the connection")??;
        let Message::Binary(bytes) = message else { continue };
        match Viewed::decode(bytes)?.what {
            Some(What::Reading(reading)) => {
                let age_ms = (now_us()? - reading.captured_monotonic_us as f64) / 1e3;
                all += 1;
                if all as usize == FIRST {
                    begin = Some(Instant::now());
                    measuring = daemon.measuring_s()?;
                    seen.pictures.clear();
                } else if all as usize > FIRST {
                    seen.readings.push((reading, age_ms));
                }
            }
            Some(What::Frame(picture)) => {
                let decoded = image::load_from_memory_with_format(&picture.jpeg, image::ImageFormat::Jpeg)?;
                std::hint::black_box(decoded);
                seen.pictures.push((now_us()? - picture.captured_monotonic_us as f64) / 1e3);
                ask(&mut socket, json!({ "type": "seen", "seq": picture.seq })).await?;
            }
            _ => {}
        }
        if begin.is_some_and(|begin| begin.elapsed() >= lasting) {
            break;
        }
    }
    seen.took = begin.map_or(Duration::ZERO, |begin| begin.elapsed());
    seen.measuring_s = daemon.measuring_s()? - measuring;
    ask(&mut socket, json!({ "type": "readings", "on": false })).await?;
    if pictures {
        ask(&mut socket, json!({ "type": "pictures", "on": false })).await?;
    }
    // What was on the way.
    let end = tokio::time::Instant::now() + REST;
    while let Ok(Some(Ok(message))) = tokio::time::timeout_at(end, socket.next()).await {
        if let Message::Binary(bytes) = message
            && let Some(What::Reading(_)) = Viewed::decode(bytes)?.what
        {
            all += 1;
        }
    }
    socket.close(None).await?;
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
async fn crowd(daemon: &Daemon, camera: &Camera) -> Result<tokio::task::JoinSet<()>, Failure> {
    let mut viewers = tokio::task::JoinSet::new();
    for nth in 1..VIEWERS {
        let (mut socket, _) = tokio_tungstenite::connect_async(format!("ws://{}/api/v1/ws", daemon.address)).await?;
        let viewport = camera.on_screen(nth);
        ask(
            &mut socket,
            json!({ "type": "pictures", "on": true, "max_rate_hz": 60, "viewport": viewport, "window": 2 }),
        )
        .await?;
        viewers.spawn(async move {
            while let Some(Ok(message)) = socket.next().await {
                let Message::Binary(bytes) = message else { continue };
                let Ok(Viewed { what: Some(What::Frame(picture)) }) = Viewed::decode(bytes) else { continue };
                if ask(&mut socket, json!({ "type": "seen", "seq": picture.seq })).await.is_err() {
                    return;
                }
            }
        });
    }
    Ok(viewers)
}

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

async fn measure(camera: &'static Camera, lasting: Duration) -> Result<Vec<Line>, Failure> {
    let daemon = Daemon::start(camera)?;
    daemon.watch().await?;
    let mut lines = Vec::new();
    let mut line = |what, unit, found, wanted, at_least| {
        lines.push(Line { camera: camera.label, what, unit, found, wanted, at_least });
    };
    let wanted = &camera.wanted;
    let alone = look(&daemon, camera, false, lasting).await?;
    let rate = |count: usize, seen: &Seen| count as f64 / seen.took.as_secs_f64();
    let measured = |seen: &Seen| seen.readings.iter().filter(|(r, _)| r.state() == ReadingState::Measured).count();
    let ages = |seen: &Seen| seen.readings.iter().map(|(_, age)| *age).collect::<Vec<f64>>();
    line("readings at rest", "/s", rate(measured(&alone), &alone), wanted.readings_hz, true);
    line("age of the reading, p95", "ms", percentile(&mut ages(&alone), 0.95), wanted.age_ms, false);
    let share = alone.measuring_s / alone.took.as_secs_f64();
    line("processor of the measuring", "% of a core", 100.0 * share, 100.0 * wanted.share, false);
    let mut beside = look(&daemon, camera, true, lasting).await?;
    line("readings, with pictures besides", "/s", rate(measured(&beside), &beside), wanted.readings_beside_hz, true);
    line("pictures decoded", "/s", rate(beside.pictures.len(), &beside), wanted.pictures_hz, true);
    line("age of the picture, p95", "ms", percentile(&mut beside.pictures, 0.95), wanted.picture_age_ms, false);
    let viewers = crowd(&daemon, camera).await?;
    let crowded = look(&daemon, camera, true, lasting).await?;
    drop(viewers);
    line(
        "readings, with 16 viewports besides",
        "/s",
        rate(measured(&crowded), &crowded),
        wanted.readings_beside_hz,
        true,
    );
    line("age of the reading then, p95", "ms", percentile(&mut ages(&crowded), 0.95), wanted.age_ms, false);
    Ok(lines)
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
