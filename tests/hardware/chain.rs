//! On the host: a whole joint alignment by a daemon in the guest that knows of no simulation. The world, its renderer and
//! the stage controller's firmware run here; frames go over the network into a loopback in the guest, the firmware sits on
//! a pseudo-terminal behind QEMU's USB serial adapter, and the operator is this program, over HTTP.

use std::io::{BufRead as _, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, ExitCode};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use async_trait::async_trait;
use plenalign::config::{BenchDriver, Config, ControllerConfig, ControllerDriver};
use plenalign::device::{
    AxisName, DeviceError, FrameSource as _, MoveTime, Setup, Stage, StageInfo, StageState, StopDelivery,
};
use plenalign::raw::Samples;
use plenalign::sim::camera::SimulatedCamera;
use plenalign::sim::stage::firmware;
use plenalign::sim::truth::Truth;
use plenalign::units::Millimetres;
use serde_json::{Value, json};
use tokio::sync::watch;

/// Where the guest's daemon and feeder are.
const DAEMON: &str = "http://127.0.0.1:18080/api/v1";
const FEEDER: &str = "127.0.0.1:18081";
/// How old a frame may be when it is written into the loopback: what the daemon is told as `pipeline_delay_ms`.
const DELAY: Duration = Duration::from_millis(1500);
/// Between frames, at least: rendering must leave the guest some of the machine.
const INTERVAL: Duration = Duration::from_millis(250);
/// The whole alignment: some minutes in emulation, several times that on a machine that is busy.
const LIMIT: Duration = Duration::from_secs(1200);
/// How long the camera's plug is pulled.
const PULLED: Duration = Duration::from_secs(9);

/// USB serial number of the stage's adapter: what the daemon finds it by, whatever its port is called after a replug.
const ADAPTER: &str = "CHAIN1";

/// Runs the chain; `share` is the guest's share.
pub(crate) fn run(share: &str) -> ExitCode {
    let runtime =
        tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().expect("a runtime");
    match runtime.block_on(chain(Path::new(share))) {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            println!("hardware: FAILED chain: {why}");
            ExitCode::FAILURE
        }
    }
}

/// The reference bench with a sensor small enough for emulation: larger pixels, and as many microlenses across as three
/// boards need.
fn world() -> Config {
    let mut config = Config::default();
    (config.sensor.width_px, config.sensor.height_px) = (374, 374);
    config.sensor.pixel_um = 5.175;
    config.bench.simulation.rays = 16;
    config
}

/// The same camera and limits as a hardware bench: what the guest's daemon is told.
fn hardware(world: &Config) -> Config {
    let mut config = world.clone();
    config.bench.driver = BenchDriver::Hardware;
    config.bench.simulation = Config::default().bench.simulation;
    let port = format!("usb:{ADAPTER}").into();
    let controller = ControllerConfig { driver: ControllerDriver::Grbl, port, baud: None, identity: None, address: 1 };
    config.bench.controllers.insert("main".to_owned(), controller);
    let camera = &mut config.bench.camera;
    camera.device = "card:Chain camera".to_owned();
    camera.frame_rate_hz = 1.0;
    camera.timeout_ms = 5000;
    camera.pipeline_delay_ms = DELAY.as_millis() as u64;
    config
}

async fn chain(share: &Path) -> Result<(), String> {
    let config = Arc::new(world());
    let truth = Truth::new(&config);
    let axes = [&config.bench.focus, &config.bench.e];
    let twin = firmware(ControllerDriver::Grbl, &axes, Arc::clone(&truth) as _);
    let terminal = twin.serve_on_terminal().map_err(|error| error.to_string())?;
    let told = toml::to_string(&hardware(&config)).map_err(|error| error.to_string())?;
    std::fs::write(share.join("chain.toml"), told).map_err(|error| error.to_string())?;
    for old in ["stop", "token"] {
        let _ = std::fs::remove_file(share.join(old));
    }
    let mut guest = Guest::boot(share, &terminal.display().to_string())?;

    let camera = Arc::new(Camera::start(&truth, &config));
    let result = tokio::time::timeout(LIMIT, align(&truth, &camera, share)).await;
    camera.ended.store(true, Ordering::Relaxed);
    guest.stop(share);
    let report = result.map_err(|_| format!("no end within {LIMIT:?}"))??;
    judge(&config, &truth, &report)?;
    let (frames, late) = (camera.frames.load(Ordering::Relaxed), camera.late.load(Ordering::Relaxed));
    let (oldest, told) = (camera.oldest_ms.load(Ordering::Relaxed), DELAY.as_millis());
    println!("chain: {frames} frames, {late} later than the {told} ms that the daemon was told, at most {oldest} ms");
    if camera.false_frames.load(Ordering::Relaxed) > 0 {
        return Err(
            "a frame came later than the daemon was told while an axis moved: this machine is too slow".to_owned()
        );
    }
    println!("hardware: ok     chain");
    Ok(())
}

/// The guest, which ends with this.
struct Guest(Child);

impl Guest {
    fn boot(share: &Path, terminal: &str) -> Result<Self, String> {
        let log = std::fs::File::create(share.join("../chain.log")).map_err(|error| error.to_string())?;
        let copy = log.try_clone().map_err(|error| error.to_string())?;
        let mut command = Command::new("tests/hardware/qemu.sh");
        command.args(["chain.sh", "-device", "qemu-xhci"]);
        command.args(["-chardev", &format!("serial,id=stage,path={terminal}")]);
        command.args(["-device", &format!("usb-serial,chardev=stage,id=stage,serial={ADAPTER}")]);
        command.args(["-qmp", &format!("unix:{},server=on,wait=off", share.join("../qmp").display())]);
        command.env("LIMIT", "1300").stdout(log).stderr(copy);
        command.spawn().map(Self).map_err(|error| format!("the guest does not boot: {error}"))
    }

    fn stop(&mut self, share: &Path) {
        let _ = std::fs::write(share.join("stop"), "");
        let until = Instant::now() + Duration::from_secs(20);
        while Instant::now() < until && matches!(self.0.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(200));
        }
        // Its `timeout` passes the signal on to QEMU.
        if let (Ok(None), Ok(id)) = (self.0.try_wait(), i32::try_from(self.0.id())) {
            let _ = nix::sys::signal::kill(nix::unistd::Pid::from_raw(id), nix::sys::signal::SIGTERM);
            let _ = self.0.wait();
        }
    }
}

/// Unplugs the stage's USB serial adapter and plugs it in again after a while.
fn replug_stage(share: &Path) -> std::io::Result<()> {
    let mut machine = std::os::unix::net::UnixStream::connect(share.join("../qmp"))?;
    machine.set_read_timeout(Some(Duration::from_secs(10)))?;
    let mut answers = BufReader::new(machine.try_clone()?);
    let mut order = |order: Value| -> std::io::Result<()> {
        writeln!(machine, "{order}")?;
        loop {
            let mut line = String::new();
            answers.read_line(&mut line)?;
            let answer: Value = serde_json::from_str(&line).map_err(std::io::Error::other)?;
            if let Some(error) = answer.get("error") {
                return Err(std::io::Error::other(error.to_string()));
            }
            // Events and the greeting come in between.
            if answer.get("return").is_some() {
                return Ok(());
            }
        }
    };
    order(json!({"execute": "qmp_capabilities"}))?;
    order(json!({"execute": "device_del", "arguments": {"id": "stage"}}))?;
    std::thread::sleep(Duration::from_secs(5));
    let adapter = json!({"driver": "usb-serial", "chardev": "stage", "id": "stage", "serial": ADAPTER});
    order(json!({"execute": "device_add", "arguments": adapter}))
}

/// What films the world and sends it to the guest.
struct Camera {
    /// Whether the plug is pulled.
    pulled: AtomicBool,
    ended: AtomicBool,
    /// Age of the oldest frame when it was written, ms.
    oldest_ms: AtomicU64,
    /// Frames written, and how many of them later than the daemon is told.
    frames: AtomicU64,
    late: AtomicU64,
    /// Late frames of a world that had changed since: the daemon may have taken them for frames of rest.
    false_frames: AtomicU64,
}

impl Camera {
    fn start(truth: &Arc<Truth>, config: &Config) -> Arc<Self> {
        let stage = |axis| Arc::new(Unseen(axis)) as Arc<dyn Stage>;
        let film = SimulatedCamera::new(Arc::clone(truth), stage(AxisName::Focus), stage(AxisName::E));
        let size = [config.sensor.width_px, config.sensor.height_px];
        let camera = Arc::new(Self {
            pulled: AtomicBool::new(false),
            ended: AtomicBool::new(false),
            oldest_ms: AtomicU64::new(0),
            frames: AtomicU64::new(0),
            late: AtomicU64::new(0),
            false_frames: AtomicU64::new(0),
        });
        let (shared, truth) = (Arc::clone(&camera), Arc::clone(truth));
        let handle = tokio::runtime::Handle::current();
        std::thread::spawn(move || {
            while !shared.ended.load(Ordering::Relaxed) {
                if shared.pulled.load(Ordering::Relaxed) || shared.send(&truth, &film, size, &handle).is_err() {
                    std::thread::sleep(Duration::from_millis(200));
                }
            }
        });
        camera
    }

    /// Sends frames until the connection breaks or the plug is pulled.
    fn send(
        &self,
        truth: &Truth,
        film: &SimulatedCamera,
        size: [u32; 2],
        handle: &tokio::runtime::Handle,
    ) -> std::io::Result<()> {
        let mut stream = TcpStream::connect(FEEDER)?;
        stream.set_read_timeout(Some(Duration::from_secs(30)))?;
        stream.write_all(&size.map(u32::to_le_bytes).concat())?;
        while !self.pulled.load(Ordering::Relaxed) && !self.ended.load(Ordering::Relaxed) {
            let (begun, pose) = (Instant::now(), truth.pose());
            let frame = handle.block_on(film.frame(tokio::time::Instant::now())).map_err(std::io::Error::other)?;
            // The first frame of a scene takes long, and shows what was: a camera would not send it now.
            if begun.elapsed() > DELAY / 2 {
                continue;
            }
            let Samples::U8(samples) = frame.image.samples() else { return Err(std::io::Error::other("8 bits")) };
            stream.write_all(samples)?;
            stream.read_exact(&mut [0])?;
            let age = begun.elapsed();
            self.oldest_ms.fetch_max(age.as_millis() as u64, Ordering::Relaxed);
            self.frames.fetch_add(1, Ordering::Relaxed);
            if age > DELAY {
                self.late.fetch_add(1, Ordering::Relaxed);
                if truth.pose() != pose {
                    self.false_frames.fetch_add(1, Ordering::Relaxed);
                }
            }
            std::thread::sleep(INTERVAL);
        }
        Ok(())
    }
}

/// Drives a job as an operator does and pulls the stage's plug while it waits: its axes come back, their positions do not,
/// and the job ends before it moves any. The next job homes and goes through, the camera's plug pulled once on the way.
async fn align(truth: &Arc<Truth>, camera: &Arc<Camera>, share: &Path) -> Result<Value, String> {
    plenalign::api::server::use_ring();
    let client = reqwest::Client::builder().timeout(Duration::from_secs(20)).tls_certs_only([]);
    let client = client.build().map_err(|error| error.to_string())?;
    let token = token(share).await;
    let get = async |path: &str| -> Result<Value, String> {
        let sent = client.get(format!("{DAEMON}{path}")).bearer_auth(&token);
        let answer = sent.send().await.map_err(|error| error.to_string())?;
        answer.json().await.map_err(|error| error.to_string())
    };
    let key = OnceLock::<String>::new();
    let post = async |path: &str, body: Value| -> Result<Value, String> {
        let sent = client.post(format!("{DAEMON}{path}")).bearer_auth(&token);
        let sent = sent.header("plenalign-lease", key.get().map_or("", String::as_str));
        let sent = sent.header("content-type", "application/json").body(body.to_string());
        let answer = sent.send().await.map_err(|error| error.to_string())?;
        let status = answer.status();
        let value: Value = answer.json().await.map_err(|error| error.to_string())?;
        if status.is_success() { Ok(value) } else { Err(format!("POST {path}: {value}")) }
    };
    let bench = loop {
        match get("/bench").await {
            Ok(bench) if bench["camera"]["online"] == true => break bench,
            _ => tokio::time::sleep(Duration::from_millis(500)).await,
        }
    };
    if bench["simulated"] != false {
        return Err(format!("the daemon calls its bench simulated: {bench}"));
    }
    println!("chain: {} with {}", bench["camera"]["identity"], bench["axes"][0]["identity"]);
    let lease = post("/lease", json!({"owner": "the chain", "ttl_s": 3600})).await?;
    let key_given = lease["key"].as_str().unwrap_or_default().to_owned();
    key.get_or_init(|| key_given);
    let job = post("/jobs", json!({"kind": "joint_alignment"})).await?;
    let path_of = |job: &Value| format!("/jobs/{}", job["id"].as_str().unwrap_or_default());
    let mut path = path_of(&job);
    let begun = Instant::now();
    let (mut confirmed, mut said, mut pulled, mut replugged, mut again) = (0, 0, false, false, false);
    loop {
        tokio::time::sleep(Duration::from_millis(300)).await;
        // The daemon's answers wait while it measures, in emulation.
        let Ok(job) = get(&path).await else { continue };
        for line in job["log"].as_array().into_iter().flatten().skip(said) {
            println!(
                "chain: {:>5.0} s  {}",
                begun.elapsed().as_secs_f64(),
                line["message"].as_str().unwrap_or_default()
            );
            said += 1;
        }
        match job["state"].as_str() {
            Some("waiting_for_operator") => {
                let step = &job["operator_step"];
                let number = step["number"].as_u64().unwrap_or(0);
                if number > confirmed {
                    truth.obey(&setup(step)?);
                    confirmed = number;
                    if !replugged {
                        replugged = true;
                        println!("chain: the stage is unplugged and plugged in again");
                        replug_stage(share).map_err(|error| error.to_string())?;
                        until_connected(&get).await?;
                    }
                    post(&format!("{path}/confirm"), json!({"step": number})).await?;
                }
            }
            Some("running") => {
                let measured = job["iterations"].as_array().map_or(0, Vec::len);
                if measured >= 2 && !pulled {
                    pulled = true;
                    pull(camera, &get).await?;
                }
            }
            Some("converged") if pulled => return Ok(job),
            Some("failed") if replugged && !again => {
                again = true;
                let reason = job["reason"].as_str().unwrap_or_default();
                if !reason.contains("not homed") {
                    return Err(format!("the job ended with another reason than that an axis is not homed: {reason}"));
                }
                println!("chain: the job has ended ({reason}), another is started");
                path = path_of(&post("/jobs", json!({"kind": "joint_alignment"})).await?);
                (confirmed, said) = (0, 0);
            }
            Some("pending" | "cancelling") | None => {}
            Some(_) => return Err(format!("the job ended: {} {}", job["state"], job["reason"])),
        }
    }
}

/// The token that the guest has made.
async fn token(share: &Path) -> String {
    loop {
        match std::fs::read_to_string(share.join("token")) {
            Ok(token) => return token.trim().to_owned(),
            Err(_) => tokio::time::sleep(Duration::from_millis(500)).await,
        }
    }
}

/// Waits until the daemon has both axes again, without their positions.
async fn until_connected(get: &impl AsyncFn(&str) -> Result<Value, String>) -> Result<(), String> {
    let until = Instant::now() + Duration::from_secs(60);
    loop {
        tokio::time::sleep(Duration::from_millis(500)).await;
        let bench = get("/bench").await.unwrap_or_default();
        let axes = bench["axes"].as_array();
        if let Some(axes) = axes.filter(|axes| axes.len() == 2 && axes.iter().all(|axis| axis["connected"] == true)) {
            println!("chain: both axes are back");
            let homed = axes.iter().any(|axis| axis["homed"] != false);
            return if homed { Err(format!("an axis kept its position through a replug: {axes:?}")) } else { Ok(()) };
        }
        if Instant::now() > until {
            return Err(format!("the stage did not come back: {}", bench["axes"]));
        }
    }
}

/// Pulls the camera's plug in the middle of the job, sees that the daemon says so, and pushes it back in.
async fn pull(camera: &Arc<Camera>, get: &impl AsyncFn(&str) -> Result<Value, String>) -> Result<(), String> {
    camera.pulled.store(true, Ordering::Relaxed);
    println!("chain: the camera is unplugged");
    let back = Instant::now() + PULLED;
    let mut fault = Value::Null;
    while Instant::now() < back {
        tokio::time::sleep(Duration::from_millis(500)).await;
        if let Ok(bench) = get("/bench").await
            && bench["camera"]["online"] == false
        {
            if !bench["camera"]["frame_seq"].is_null() {
                return Err(format!("a frame of before is shown: {}", bench["camera"]));
            }
            fault = bench["camera"]["fault"].clone();
        }
    }
    camera.pulled.store(false, Ordering::Relaxed);
    println!("chain: the camera is plugged in again; it was said to be gone: {fault}");
    if fault.is_null() { Err("the daemon did not say that its camera was gone".to_owned()) } else { Ok(()) }
}

/// What an operator's step asks for, by the numbers that the page shows large.
fn setup(step: &Value) -> Result<Setup, String> {
    let value = step["value"].as_str().unwrap_or_default();
    let numbers: Vec<f64> =
        value.split(|c: char| !(c.is_ascii_digit() || c == '.')).filter_map(|number| number.parse().ok()).collect();
    match (step["name"].as_str(), &numbers[..]) {
        (Some("white_frame"), _) => Ok(Setup::Diffuser),
        (Some("triple_board_in_air"), &[near, middle, far]) => {
            Ok(Setup::AirTripleBoard { distances_mm: [near, middle, far] })
        }
        (Some("aperture"), &[diameter_mm, ring_f_number]) => Ok(Setup::Aperture { diameter_mm, ring_f_number }),
        (Some("shell_and_water"), &[distance_mm]) => Ok(Setup::WaterBoard { distance_mm }),
        _ => Err(format!("this operator cannot do: {step}")),
    }
}

/// Judges the end by the world's truth, as tests/suite/alignment.rs does.
fn judge(config: &Config, truth: &Arc<Truth>, job: &Value) -> Result<(), String> {
    let (report, end) = (&job["report"], truth.report());
    println!("chain: {end}");
    let number = |value: &Value, key: &str| value[key].as_f64().ok_or_else(|| format!("no {key} in {value}"));
    let (spacing_px, target_px) = (number(report, "spacing_px")?, number(report, "spacing_target_px")?);
    let design = config.design();
    let equivalent = design.shell.equivalent_distance(design.object_distance, number(&end, "e_mm")?);
    let spacing = design.spacing_at(equivalent, number(&end, "delta_v_mm")?);
    let true_error_px = spacing / config.pixel_pitch().millimetres() - target_px;
    println!("chain: spacing {spacing_px:.4} px, wanted {target_px:.4} px, truly off by {true_error_px:+.4} px");
    // What 0.03 px are of the reference bench's finer pixels.
    if true_error_px.abs() >= 0.02 || (spacing_px - target_px).abs() >= 0.02 {
        return Err("the camera is not in focus".to_owned());
    }
    if end["touched_shell"] != false {
        return Err("the lens touched the shell".to_owned());
    }
    if job["simulated"] != false {
        return Err("the daemon calls the job simulated".to_owned());
    }
    Ok(())
}

/// A stage that the film camera sees nothing of: poses are the daemon's business.
struct Unseen(AxisName);

#[async_trait]
impl Stage for Unseen {
    fn info(&self) -> StageInfo {
        let unseen = String::new;
        StageInfo {
            axis: self.0,
            driver: unseen(),
            identity: unseen(),
            location: unseen(),
            disagreements: vec![],
            contradictions: vec![],
            firmware_limits: None,
        }
    }

    fn state(&self) -> watch::Receiver<StageState> {
        let state = StageState {
            connected: false,
            homed: false,
            position: Millimetres(0.0),
            moving: false,
            at_rest_since: None,
            limit_switch: false,
            fault: None,
        };
        watch::channel(state).1
    }

    async fn read_state(&self) -> Result<StageState, DeviceError> {
        Ok(self.state().borrow().clone())
    }

    async fn home(&self, _: u64) -> Result<(), DeviceError> {
        Err(DeviceError::NotHomed { axis: self.0 })
    }

    fn generation(&self) -> u64 {
        0
    }

    fn move_time(&self, _: Millimetres, _: Millimetres) -> MoveTime {
        MoveTime { predicted: Duration::ZERO, maximum: Duration::ZERO }
    }

    async fn set_position(&self, _: Millimetres, _: u64) -> Result<(), DeviceError> {
        Err(DeviceError::NotHomed { axis: self.0 })
    }

    async fn move_at(&self, _: Millimetres, _: f64, _: u64) -> Result<Millimetres, DeviceError> {
        Err(DeviceError::NotHomed { axis: self.0 })
    }

    fn forget_position(&self) {}

    async fn release(&self, _: u64) -> Result<(), DeviceError> {
        Ok(())
    }

    async fn stop(&self) -> StopDelivery {
        StopDelivery::Undeliverable
    }
}
