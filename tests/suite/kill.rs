//! `kill -9` at random moments: every started job is in the history and classified, and no motor goes on.
//!
//! An odd seed kills `plenalign serve --simulated` in an alignment. An even one kills `plenalign serve` with its stage
//! behind `plenalign sim-stage`, a program of its own that survives the kill and keeps its own record of motion.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::time::Duration;

use plenalign::api::error::LEASE_HEADER;
use plenalign::config::Config;
use plenalign::store::records::Move;
use plenalign::store::{Store, read};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use reqwest::{Client, Method};
use serde_json::{Value, json};
use tokio::time::{Instant, sleep, timeout};

use super::bench::{grbl_hardware, quick_axes, small_config};
use super::daemon::client;
use super::program::{Program, plenalign};
use super::until::{until, when};

/// An alignment takes about so long here, s: kills fall anywhere in it.
const ALIGNMENT_S: f64 = 12.0;
/// The script of moves by hand takes about so long, s.
const SCRIPT_S: f64 = 8.0;
/// A motion that nobody commands any more is over by then.
const AT_REST_ALLOWED: Duration = Duration::from_secs(25);
/// A move is told to a controller in pieces that last so long, µs.
const PIECE_US: i64 = 1_000_000;
/// Greatest speed of the axes on the stage, mm/s.
const SPEED_MM_PER_S: f64 = 8.0;
/// Quiet for so long, a stage is at rest.
const QUIET: Duration = Duration::from_millis(700);

/// Starts the program and waits for its first line.
fn start(arguments: &[&str], config: &Path, state: &Path) -> Program {
    let mut command = plenalign(state);
    command.args(arguments).arg("--json").arg("--config").arg(config);
    Program::start(command)
}

/// A daemon to be killed.
struct Daemon {
    program: Program,
    url: String,
    client: Client,
    /// Key of the control lease, once taken.
    lease: tokio::sync::OnceCell<String>,
}

impl Daemon {
    fn start(simulated: bool, config: &Path, state: &Path) -> Self {
        let mut arguments = vec!["serve", "--listen", "127.0.0.1:0"];
        arguments.extend(simulated.then_some("--simulated"));
        let program = start(&arguments, config, state);
        let url = program.url().to_owned();
        Self { program, url, client: client(), lease: tokio::sync::OnceCell::new() }
    }

    /// Takes the control lease from whoever had it before the kill.
    async fn take_lease(&self) -> Option<&str> {
        let take = async {
            let request = self.client.post(format!("{}/api/v1/lease/takeover", self.url));
            let grant: Value =
                request.json(&json!({ "owner": "a test", "ttl_s": 3600 })).send().await.ok()?.json().await.ok()?;
            grant["key"].as_str().map(str::to_owned)
        };
        self.lease.get_or_try_init(|| async { take.await.ok_or(()) }).await.ok().map(String::as_str)
    }

    async fn ask(&self, method: Method, path: &str, body: Option<Value>) -> Option<(u16, Value)> {
        let mut request =
            self.client.request(method.clone(), format!("{}{path}", self.url)).timeout(Duration::from_secs(20));
        if method != Method::GET {
            request = request.header(LEASE_HEADER, self.take_lease().await?);
        }
        if let Some(body) = body {
            request = request.json(&body);
        }
        let response = request.send().await.ok()?;
        let status = response.status().as_u16();
        Some((status, response.json().await.ok()?))
    }

    async fn get(&self, path: &str) -> Option<Value> {
        Some(self.ask(Method::GET, path, None).await?.1)
    }

    fn kill(self) {
        self.program.kill();
    }
}

/// What a test keeps between kills: the state folder with the history, and what has to be in it.
struct Ground {
    folder: tempfile::TempDir,
    jobs: Vec<String>,
}

impl Ground {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap(), jobs: Vec::new() }
    }

    fn state(&self) -> PathBuf {
        self.folder.path().join("state")
    }

    fn write_config(&self, config: &Config) -> PathBuf {
        let path = self.folder.path().join("bench.toml");
        std::fs::write(&path, toml::to_string(config).unwrap()).unwrap();
        path
    }

    /// Every job that was ever accepted is in the history, and over.
    async fn check_jobs(&self, daemon: &Daemon) -> BTreeMap<String, String> {
        let mut found = BTreeMap::new();
        let mut path = "/api/v1/jobs?limit=100".to_owned();
        loop {
            let list = daemon.get(&path).await.unwrap();
            assert_eq!(list["history_fault"], Value::Null);
            for job in list["jobs"].as_array().unwrap() {
                let of = |key: &str| job[key].as_str().unwrap().to_owned();
                found.insert(of("id"), of("state"));
            }
            let Some(next) = list["next"].as_str() else { break };
            path = format!("/api/v1/jobs?limit=100&cursor={next}");
        }
        for job in &self.jobs {
            let state = found.get(job).unwrap_or_else(|| panic!("job {job} is not in the history: {found:?}"));
            assert!(
                ["interrupted", "converged", "succeeded", "not_converged", "cancelled", "failed"]
                    .contains(&state.as_str()),
                "job {job} is {state}"
            );
        }
        found
    }
}

/// Waits until what an earlier run left open is closed.
async fn ready(daemon: &Daemon) -> Value {
    until("no job of an earlier run is open", async || {
        let open = daemon.get("/api/v1/jobs?state=pending,running,waiting_for_operator,cancelling").await?;
        let bench = daemon.get("/api/v1/bench").await?;
        let closed = open["history_fault"].is_null() && open["jobs"].as_array().is_some_and(Vec::is_empty);
        closed.then_some(bench)
    })
    .await
}

fn assert_unknown(bench: &Value) {
    for axis in bench["axes"].as_array().unwrap() {
        assert_eq!((&axis["homed"], &axis["position_mm"]), (&json!(false), &Value::Null), "{axis}");
        assert_eq!(axis["moving"], false, "{axis}");
    }
    assert_eq!((&bench["job"], &bench["shell"]), (&Value::Null, &json!("unknown")));
}

/// A bench that does a whole alignment in some seconds.
fn quick(seed: u64) -> Config {
    let mut config = small_config(seed);
    config.bench.simulation.rays = 4;
    quick_axes(&mut config.bench);
    for axis in [&mut config.bench.focus, &mut config.bench.e] {
        axis.settle_ms = 20;
    }
    config
}

/// Returns what happened, in a line.
async fn kill_in_an_alignment(ground: &mut Ground, seed: u64) -> String {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let (config, state) = (ground.write_config(&quick(seed)), ground.state());
    let daemon = Daemon::start(true, &config, &state);
    ready(&daemon).await;
    let created = daemon.ask(Method::POST, "/api/v1/jobs", Some(json!({ "kind": "joint_alignment" }))).await;
    let (status, job) = created.unwrap();
    assert_eq!(status, 201, "{job}");
    let (id, href) = (job["id"].as_str().unwrap().to_owned(), job["href"].as_str().unwrap().to_owned());
    ground.jobs.push(id.clone());
    let at = Duration::from_secs_f64(random.random_range(0.0..ALIGNMENT_S));
    let mut seen = job;
    let watch = until("watched to its end", async || {
        if let Some(job) = daemon.get(&href).await {
            seen = job;
        }
        false
    });
    assert!(timeout(at, watch).await.is_err());
    daemon.kill();

    let daemon = Daemon::start(true, &config, &state);
    assert_unknown(&ready(&daemon).await);
    let found = ground.check_jobs(&daemon).await;
    let kept = daemon.get(&href).await.unwrap();
    let final_before = seen["ended_at"].is_string();
    assert!(!final_before || kept["state"] == seen["state"], "{} became {}", seen["state"], kept["state"]);
    let iterations = |job: &Value| job["iterations"].as_array().unwrap().clone();
    let (before, after) = (iterations(&seen), iterations(&kept));
    for (index, iteration) in after.iter().enumerate() {
        assert_eq!(iteration["number"], index as u64 + 1);
        assert!(before.get(index).is_none_or(|seen| seen == iteration), "iteration {index} is another than was seen");
    }
    assert!(after.len() + 1 >= before.len(), "{} of {} iterations are kept", after.len(), before.len());
    let log = |job: &Value| job["log"].as_array().unwrap().clone();
    assert!(log(&kept).iter().zip(log(&seen)).all(|(kept, seen)| *kept == seen));
    // Every iteration after a move has the record of that move, and no move was begun that an iteration is missing for.
    let moves = daemon.get(&format!("{href}/moves")).await.unwrap()["moves"].as_array().unwrap().clone();
    assert!(moves.iter().all(|motion| motion["outcome"].is_string()), "{moves:?}");
    let done = moves.iter().filter(|motion| motion["what"] == "move" && motion["outcome"] == "done").count();
    let moved = after.iter().filter(|iteration| iteration["axis"].is_string()).count();
    assert!(moved <= done, "{moved} iterations after {done} moves");
    daemon.kill();
    format!(
        "seed {seed}: killed after {:.2} s, {} iterations seen, {} kept, {} moves, job {}",
        at.as_secs_f64(),
        before.len(),
        after.len(),
        moves.len(),
        found[&id]
    )
}

fn hardware(port: &Path) -> Config {
    let mut config = grbl_hardware(quick(1), port);
    for axis in [&mut config.bench.focus, &mut config.bench.e] {
        axis.speed_mm_per_s = SPEED_MM_PER_S;
    }
    config
}

/// What the stage itself says of its motion: when (µs), which axis, where (mm).
#[derive(Debug, Clone, Copy, PartialEq)]
struct Step {
    at: i64,
    axis: usize,
    mm: f64,
}

fn steps(record: &Path) -> Vec<Step> {
    let text = std::fs::read_to_string(record).unwrap();
    let step = |line: &str| {
        let mut words = line.split(' ');
        Some(Step {
            at: words.next()?.parse().ok()?,
            axis: words.next()?.parse().ok()?,
            mm: words.next()?.parse().ok()?,
        })
    };
    text.lines().map(|line| step(line).unwrap_or_else(|| panic!("{line:?}"))).collect()
}

/// Waits until the stage's record grows no more.
async fn at_rest(record: &Path) {
    let (mut length, mut since) = (0, Instant::now());
    let quiet = until("the stage is at rest", async || {
        let now = std::fs::metadata(record).unwrap().len();
        if now != length {
            (length, since) = (now, Instant::now());
        }
        since.elapsed() >= QUIET
    });
    timeout(AT_REST_ALLOWED, quiet).await.expect("the stage comes to rest");
}

/// Homes by a job, then moves by hand, for as long as it is let.
async fn drive(daemon: &Daemon, jobs: &mut Vec<String>, random: &mut Pcg64Mcg) {
    let Some((_, job)) = daemon.ask(Method::POST, "/api/v1/jobs", Some(json!({ "kind": "joint_alignment" }))).await
    else {
        return;
    };
    let (Some(id), Some(href)) = (job["id"].as_str(), job["href"].as_str()) else { panic!("{job}") };
    jobs.push(id.to_owned());
    let wait = async |what: &str| {
        let there = |job: &Value| job["state"] == what || job["ended_at"].is_string();
        let job = until(what, async || when(daemon.get(href).await.unwrap_or_default(), there)).await;
        assert_eq!(job["state"], what, "{}", job["reason"]);
    };
    // It asks for a white frame once both axes are homed.
    wait("waiting_for_operator").await;
    daemon.ask(Method::DELETE, href, None).await;
    wait("cancelled").await;
    loop {
        for axis in ["focus", "e"] {
            let homed = async || {
                let bench = daemon.get("/api/v1/bench").await.unwrap_or_default();
                let axes = bench["axes"].as_array().cloned().unwrap_or_default();
                axes.into_iter().find(|found| found["axis"] == axis).is_some_and(|axis| axis["homed"] == true)
            };
            if !homed().await {
                // The end of a cancelled job stops the axes, which may cost the position.
                daemon.ask(Method::POST, &format!("/api/v1/axes/{axis}/home"), None).await;
                until("it is homed", &homed).await;
            }
            let to = if axis == "e" { random.random_range(5.0..29.0) } else { random.random_range(-0.5..4.0) };
            let body = json!({ "position_mm": to });
            daemon.ask(Method::POST, &format!("/api/v1/axes/{axis}/move"), Some(body)).await;
            sleep(Duration::from_millis(random.random_range(100..1500))).await;
        }
    }
}

/// Returns what happened, in a line.
async fn kill_with_a_stage(ground: &mut Ground, seed: u64) -> String {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let (port, record) = (ground.folder.path().join("stage"), ground.folder.path().join("record"));
    let (config, state) = (ground.write_config(&hardware(&port)), ground.state());
    let (link, to) = (port.display().to_string(), record.display().to_string());
    let _stage = start(&["sim-stage", "--protocol", "grbl", "--link", &link, "--record", &to], &config, &state);
    let daemon = Daemon::start(false, &config, &state);
    ready(&daemon).await;
    let at = Duration::from_secs_f64(random.random_range(0.0..SCRIPT_S));
    let mut jobs = Vec::new();
    assert!(timeout(at, drive(&daemon, &mut jobs, &mut random)).await.is_err());
    ground.jobs.extend(jobs);
    let killed = jiff::Timestamp::now().as_microsecond();
    daemon.kill();
    at_rest(&record).await;
    let before = steps(&record);

    let daemon = Daemon::start(false, &config, &state);
    let bench = ready(&daemon).await;
    assert_unknown(&bench);
    ground.check_jobs(&daemon).await;
    at_rest(&record).await;
    assert_unknown(&daemon.get("/api/v1/bench").await.unwrap());
    assert_eq!(steps(&record), before, "something moved after the restart that nobody commanded");
    daemon.kill();

    let moves = Store::to_read(&state).read(|connection| read::newest_moves(connection, 200)).await.unwrap();
    assert!(moves.iter().all(|motion| motion.outcome.is_some()), "{moves:?}");
    let after = check_motion(&before, &moves, killed);
    format!(
        "seed {seed}: killed after {:.2} s, {} moves, {after:.2} mm of motion after the kill",
        at.as_secs_f64(),
        moves.len()
    )
}

/// Every step of the stage belongs to a motion that the history has; those after the kill to the one under way, and go
/// no further than it was to go. Returns how far the stage moved after the kill, mm.
fn check_motion(steps: &[Step], moves: &[Move], killed: i64) -> f64 {
    let axes = ["focus", "e"];
    let covers = |motion: &Move, step: &Step| {
        // The last steps may be told a moment after the controller has said that it stands.
        let ended = motion.ended_at.map_or(i64::MAX, |at| at.as_microsecond() + 150_000);
        motion.axis == axes[step.axis] && (motion.started_at.as_microsecond()..=ended).contains(&step.at)
    };
    let mut far: f64 = 0.0;
    let (mut stood, mut left) = ([None; 2], None);
    for step in steps {
        let Some(motion) = moves.iter().find(|motion| covers(motion, step)) else {
            panic!("{step:?} belongs to no motion of the history: {moves:#?}");
        };
        if step.at > killed + 50_000 {
            assert_eq!(motion.outcome.as_deref(), Some("interrupted"), "{step:?} after the kill: {motion:?}");
            far += stood[step.axis].map_or(0.0, |from: f64| (step.mm - from).abs());
            if let (Some(from), Some(to)) = (motion.from_mm, motion.to_mm) {
                // The piece that it had been told, and none after it.
                assert!(step.at < killed + PIECE_US + 400_000, "{step:?} is long after the kill at {killed}");
                let first = *left.get_or_insert(step.mm);
                assert!(
                    (step.mm - first).abs() < SPEED_MM_PER_S * 1.05,
                    "{step:?} is further than a piece from {first}"
                );
                // An approach leg ends this far beside the target.
                let margin = 0.3;
                let way = from.min(to) - margin..=from.max(to) + margin;
                assert!(way.contains(&step.mm), "{step:?} beyond {motion:?}");
            }
        }
        stood[step.axis] = Some(step.mm);
    }
    far
}

async fn kill_all(seeds: RangeInclusive<u64>, done: impl Fn(u64, &str), skip: impl Fn(u64) -> bool) {
    let (odd, even): (Vec<u64>, Vec<u64>) = seeds.filter(|seed| !skip(*seed)).partition(|seed| seed % 2 == 1);
    let alignments = async {
        let mut ground = Ground::new();
        for seed in odd {
            done(seed, &kill_in_an_alignment(&mut ground, seed).await);
        }
    };
    let stages = async {
        let mut ground = Ground::new();
        for seed in even {
            done(seed, &kill_with_a_stage(&mut ground, seed).await);
        }
    };
    tokio::join!(alignments, stages);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn ten_kills_lose_no_job_and_leave_no_motor_running() {
    kill_all(1..=10, |_, line| println!("{line}"), |_| false).await;
}

/// What `make test-long` runs: `KILLS=1-200`, and a result in `KILL_RESULTS` for each seed, so that a broken run goes on
/// where it ended.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "takes half an hour: make test-long"]
async fn many_kills_lose_no_job_and_leave_no_motor_running() {
    let range = std::env::var("KILLS").unwrap_or_else(|_| "1-200".to_owned());
    let (first, last) = range.split_once('-').expect("KILLS is a range such as 1-200");
    let results = PathBuf::from(std::env::var_os("KILL_RESULTS").expect("KILL_RESULTS names a folder"));
    let file = |seed: u64| results.join(format!("kill-{seed}.txt"));
    let done = |seed: u64, line: &str| {
        println!("{line}");
        std::fs::write(file(seed), format!("{line}\n")).unwrap();
    };
    kill_all(first.parse().unwrap()..=last.parse().unwrap(), done, |seed| file(seed).exists()).await;
}
