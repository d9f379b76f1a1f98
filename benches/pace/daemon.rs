//! The daemon on its simulated bench, and what it counts about itself.

use std::io::BufRead as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use plenalign::api::error::LEASE_HEADER;
use reqwest::{Method, RequestBuilder};
use serde_json::{Value, json};

use crate::{Camera, Failure};

/// Between two looks at a job.
const ASK_AGAIN: Duration = Duration::from_millis(200);

/// The daemon, ended with this.
pub(crate) struct Daemon {
    process: Child,
    pub(crate) address: String,
    client: reqwest::Client,
    /// Key of the control lease.
    lease: String,
    _state: tempfile::TempDir,
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Daemon {
    /// Starts it with a camera, and takes the control lease. `more` is of its configuration, whole tables of it.
    pub(crate) async fn start(camera: &Camera, more: &str) -> Result<Self, Failure> {
        let state = tempfile::tempdir()?;
        let config = state.path().join("bench.toml");
        let Camera { width, height, rate_hz, .. } = camera;
        let text = format!(
            "[sensor]\nwidth_px = {width}\nheight_px = {height}\n{more}\
             [bench.simulation]\nrays = 16\npreview_rays = 16\npreview_rate_hz = {rate_hz:.1}\n\
             focus_scale_error = 0.0\nfocus_backlash_mm = 0.0\n"
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
        let mut daemon = Self { process, address, client, lease: String::new(), _state: state };
        let asked = json!({ "owner": "the benchmark", "ttl_s": 3600 });
        let lease = daemon.ask(Method::POST, "lease/takeover", &asked).await?;
        daemon.lease = lease["key"].as_str().ok_or("the lease has no key")?.to_owned();
        Ok(daemon)
    }

    /// Asks the API as the holder of the lease.
    pub(crate) async fn ask(&self, method: Method, path: &str, body: &Value) -> Result<Value, Failure> {
        let request = self.client.request(method, format!("http://{}/api/v1/{path}", self.address));
        self.answer(request.header(LEASE_HEADER, &self.lease).json(body)).await
    }

    async fn answer(&self, request: RequestBuilder) -> Result<Value, Failure> {
        let answer = request.send().await?;
        let (status, text) = (answer.status(), answer.text().await?);
        if status.is_success() { Ok(serde_json::from_str(&text)?) } else { Err(format!("{status}: {text}").into()) }
    }

    /// Runs a job, and returns it when it has succeeded.
    pub(crate) async fn job(&self, request: &Value) -> Result<Value, Failure> {
        let job = self.ask(Method::POST, "jobs", request).await?;
        let path = format!("jobs/{}", job["id"].as_str().ok_or("the job has no id")?);
        loop {
            let job = self.ask(Method::GET, &path, &Value::Null).await?;
            match job["state"].as_str() {
                Some("pending" | "running" | "waiting_for_operator") => tokio::time::sleep(ASK_AGAIN).await,
                Some("succeeded" | "converged") => return Ok(job),
                _ => return Err(format!("the job did not end well: {job}").into()),
            }
        }
    }

    /// Waits until the focus axis stands where it was sent.
    pub(crate) async fn stands(&self) -> Result<(), Failure> {
        loop {
            let bench = self.ask(Method::GET, "bench", &Value::Null).await?;
            let axes = bench["axes"].as_array().ok_or("the bench has no axes")?;
            let focus = axes.iter().find(|axis| axis["axis"] == "focus").ok_or("the bench has no focus axis")?;
            match (&focus["moving"], &focus["failure"]) {
                (Value::Bool(false), Value::Null) => return Ok(()),
                (_, Value::String(why)) => return Err(format!("the axis did not get there: {why}").into()),
                _ => tokio::time::sleep(ASK_AGAIN / 4).await,
            }
        }
    }

    /// Has a white frame and a flat board before the camera.
    pub(crate) async fn watch(&self) -> Result<(), Failure> {
        self.ask(Method::PUT, "shell", &json!({ "state": "off" })).await?;
        self.job(&json!({ "kind": "spacing_watch", "duration_s": 1.0 })).await?;
        Ok(())
    }

    /// The sum of what a metric counts by now, over all its labels.
    pub(crate) async fn metric(&self, name: &str) -> Result<f64, Failure> {
        let text = self.client.get(format!("http://{}/metrics", self.address)).send().await?.text().await?;
        let is_it = |line: &&str| line.strip_prefix(name).is_some_and(|rest| rest.starts_with(['{', ' ']));
        Ok(text.lines().filter(is_it).filter_map(|line| line.rsplit(' ').next()?.parse::<f64>().ok()).sum())
    }

    /// Frames that the meter has tried to read so far.
    pub(crate) async fn counted(&self) -> Result<u64, Failure> {
        Ok(self.metric("plenalign_readings_total").await? as u64)
    }

    /// Processor time of the meter's own threads so far, s.
    pub(crate) fn measuring_s(&self) -> Result<f64, Failure> {
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
