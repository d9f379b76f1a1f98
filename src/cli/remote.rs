//! A running daemon's API, and `plenalign align --server`: the same alignment through it.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, bail};
use reqwest::header::{AUTHORIZATION, HeaderMap, HeaderValue};
use reqwest::{Certificate, Client, Method, StatusCode};
use serde::Serialize;
use serde::de::DeserializeOwned;
use tokio::io::AsyncWriteExt as _;

use super::progress::Progress;
use crate::api::error::{LEASE_HEADER, Problem};
use crate::api::server::use_ring;
use crate::api::types::{Health, JobCreated, JobResource, LeaseAsked, Readiness};
use crate::control::job::{JobKind, JobRequest, JobSnapshot, Recording, RecordingState};
use crate::control::motion::lease::LeaseGrant;

/// Between two looks at the job.
const POLL: Duration = Duration::from_millis(250);
/// Longest wait for one answer.
const ANSWER: Duration = Duration::from_secs(10);
/// Longest wait for a command to be carried out: the daemon gives a search for the exposure up after a minute.
const COMMAND: Duration = Duration::from_secs(70);
/// Longest wait for a recording.
const DOWNLOAD: Duration = Duration::from_hours(1);
/// Looks in a row that may fail before the daemon counts as lost.
const FAILURES_ALLOWED: u32 = 8;

/// This machine's name.
pub(super) fn host_name() -> Option<String> {
    nix::unistd::gethostname().ok().and_then(|name| name.into_string().ok())
}

/// How a command names itself where it takes the control lease: its user and machine.
pub(super) fn lease_owner(command: &str) -> String {
    format!("{} (plenalign {command})", user_and_machine())
}

/// Who types a command, and where.
pub(super) fn user_and_machine() -> String {
    let user = std::env::var("USER").ok().filter(|user| !user.is_empty()).unwrap_or_else(|| "somebody".to_owned());
    let machine = host_name().unwrap_or_else(|| "this machine".to_owned());
    format!("{user}@{machine}")
}

/// How a command that asks a daemon says who it is, and knows the daemon.
#[derive(Debug, Clone, Default, clap::Args)]
pub(super) struct RemoteArgs {
    /// Token for the daemon. Other users of this machine can see it on a command line: better in the environment.
    #[arg(long, value_name = "TOKEN", env = "PLENALIGN_TOKEN", hide_env_values = true)]
    pub(super) token: Option<String>,
    /// PEM file with the certificate of the authority that vouches for the daemon, as `plenalign tls init` made it;
    /// without it, those that the system trusts.
    #[arg(long, value_name = "FILE")]
    pub(super) ca: Option<PathBuf>,
}

/// Runs a joint alignment at the daemon at `server`, such as `http://127.0.0.1:8080`, with its progress on standard
/// error. Confirms nothing in the operator's place.
///
/// # Errors
/// When the daemon cannot be reached, refuses, or is lost on the way.
pub(super) async fn align(server: &str, remote: &RemoteArgs, record: Option<&Path>) -> anyhow::Result<JobSnapshot> {
    let daemon = Daemon::new(server, remote)?;
    let health: Health = daemon.get("/healthz").await?;
    if health.simulated {
        eprintln!("plenalign: the bench at {server} is SIMULATED");
    }
    if let Some(file) = record.filter(|file| file.exists()) {
        bail!("{} is there already; a recording takes the place of no other file", file.display());
    }
    let request = JobRequest { record: record.map(|_| true), ..JobRequest::of(JobKind::JointAlignment) };
    let asked = LeaseAsked { owner: lease_owner("align"), note: Some("joint alignment".to_owned()), ttl_s: None };
    let lease: LeaseGrant = daemon.read(daemon.client.post(daemon.url("/api/v1/lease")).json(&asked)).await?;
    let start = daemon.client.post(daemon.url("/api/v1/jobs")).header(LEASE_HEADER, &lease.key).json(&request);
    let created = daemon.read::<JobCreated>(start).await;
    // The job has the lease from here on, and it is free again at the job's end; where there is no job, it is at once.
    let given_back = daemon.client.delete(daemon.url("/api/v1/lease")).header(LEASE_HEADER, &lease.key).send().await;
    let JobCreated { job: created, confirm_key } = created?;
    given_back.context("the control lease could not be given back")?;
    let how_to_confirm = if let Some(key) = confirm_key {
        let link = format!("{}/#/alignment/{}/{key}", daemon.base, created.job.id);
        eprintln!(
            "plenalign: hand this link on to whoever is to confirm what the job asks; it does nothing else: {link}"
        );
        "confirm it by the link above when it is done"
    } else {
        "confirm it on the page when it is done, by a key that an administrator makes"
    };
    let mut progress = Progress::new(how_to_confirm.to_owned(), None);
    let job = wait_for_end(&daemon, &created, &mut progress).await;
    progress.finish();
    let job = job?;
    if let Some(file) = record {
        if let Some(Recording { state: RecordingState::Failed, fault: Some(why), .. }) = &job.recording {
            eprintln!("plenalign: not all of the job is recorded: {why}");
        }
        let path = format!("{}/recording", created.href);
        let saved = daemon.save(&path, file).await;
        saved.with_context(|| format!("the recording is not in {}", file.display()))?;
    }
    Ok(job)
}

/// Looks at the job until it is over. The first interrupt cancels the job and waits on; the second leaves at once.
async fn wait_for_end(daemon: &Daemon, created: &JobResource, progress: &mut Progress) -> anyhow::Result<JobSnapshot> {
    let mut failures = 0;
    let mut interrupts = 0;
    loop {
        match daemon.get::<JobResource>(&created.href).await {
            Ok(resource) => {
                failures = 0;
                progress.show(&resource.job);
                if resource.job.state.is_final() {
                    return Ok(resource.job);
                }
            }
            Err(error) if failures >= FAILURES_ALLOWED => {
                return Err(error.context(format!("the daemon was lost; its job {} may go on", created.job.id)));
            }
            Err(_) => failures += 1,
        }
        tokio::select! {
            () = tokio::time::sleep(POLL) => {}
            _ = tokio::signal::ctrl_c() => {
                interrupts += 1;
                if interrupts > 1 {
                    bail!("left; the job {} may still be cancelling", created.job.id);
                }
                progress.say("cancelling the job; interrupt again to leave it alone");
                let cancelled: anyhow::Result<JobResource> =
                    daemon.read(daemon.client.delete(daemon.url(&created.href))).await;
                cancelled.context("the job could not be cancelled")?;
            }
        }
    }
}

/// A daemon's API.
pub(super) struct Daemon {
    client: Client,
    base: String,
}

impl Daemon {
    /// The daemon at `server`.
    ///
    /// # Errors
    /// When that is no address, or token or authority cannot be used.
    pub(super) fn new(server: &str, remote: &RemoteArgs) -> anyhow::Result<Self> {
        Self::reached_at(server, remote, None)
    }

    /// The same, whose host's name means an address that is known already.
    ///
    /// # Errors
    /// As [`Daemon::new`].
    pub(super) fn reached_at(
        server: &str,
        remote: &RemoteArgs,
        known: Option<(&str, SocketAddr)>,
    ) -> anyhow::Result<Self> {
        let base = server.trim_end_matches('/').to_owned();
        if !base.starts_with("http://") && !base.starts_with("https://") {
            bail!("{server:?} is not an address such as http://127.0.0.1:8080");
        }
        use_ring();
        let mut client = Client::builder().timeout(ANSWER).no_proxy();
        if let Some((host, address)) = known {
            client = client.resolve(host, address);
        }
        if let Some(token) = remote.token.as_deref().map(str::trim).filter(|token| !token.is_empty()) {
            let mut value =
                HeaderValue::from_str(&format!("Bearer {token}")).context("the token holds what none does")?;
            value.set_sensitive(true);
            client = client.default_headers(HeaderMap::from_iter([(AUTHORIZATION, value)]));
        }
        if let Some(ca) = &remote.ca {
            let text = std::fs::read(ca).with_context(|| format!("cannot read {}", ca.display()))?;
            let trusted =
                Certificate::from_pem_bundle(&text).with_context(|| format!("cannot use {}", ca.display()))?;
            if trusted.is_empty() {
                bail!("{} holds no certificate in PEM", ca.display());
            }
            client = client.tls_certs_only(trusted);
        } else if base.starts_with("http://") {
            // Nothing is encrypted: the system's authorities need not be read.
            client = client.tls_certs_only([]);
        }
        Ok(Self { client: client.build()?, base })
    }

    fn url(&self, path: &str) -> String {
        format!("{}{path}", self.base)
    }

    pub(super) async fn get<T: DeserializeOwned>(&self, path: &str) -> anyhow::Result<T> {
        self.read(self.client.get(self.url(path))).await
    }

    /// What keeps the bench from working, one sentence each; empty where nothing does.
    pub(super) async fn hindrances(&self) -> anyhow::Result<Vec<String>> {
        let Err(error) = self.get::<Readiness>("/readyz").await else { return Ok(Vec::new()) };
        match error.downcast_ref::<Refusal>() {
            Some(Refusal { status: StatusCode::SERVICE_UNAVAILABLE, problem: Some(problem), .. }) => {
                let listed = problem.members.get("hindrances").and_then(serde_json::Value::as_array);
                let listed = listed.into_iter().flatten().filter_map(|one| one.as_str().map(str::to_owned));
                let listed: Vec<String> = listed.collect();
                Ok(if listed.is_empty() { vec![problem.detail.clone()] } else { listed })
            }
            _ => Err(error),
        }
    }

    /// Does something for a command with the control lease, whose key it is given, and gives that back.
    ///
    /// # Errors
    /// What is done ends with, or that another has control.
    pub(super) async fn with_lease<T>(
        &self,
        (command, note): (&str, &str),
        work: impl AsyncFnOnce(&str) -> anyhow::Result<T>,
    ) -> anyhow::Result<T> {
        let ttl_s = Some(2.0 * COMMAND.as_secs_f64());
        let asked = LeaseAsked { owner: lease_owner(command), note: Some(note.to_owned()), ttl_s };
        let lease: LeaseGrant = self.read(self.client.post(self.url("/api/v1/lease")).json(&asked)).await?;
        let done = work(&lease.key).await;
        let back = self.client.delete(self.url("/api/v1/lease")).header(LEASE_HEADER, &lease.key).send().await;
        let done = done?;
        back.context("the control lease could not be given back")?;
        Ok(done)
    }

    /// A command by the holder of the lease of this key.
    pub(super) async fn command<T: DeserializeOwned>(
        &self,
        method: Method,
        path: &str,
        key: &str,
        body: &impl Serialize,
    ) -> anyhow::Result<T> {
        let request = self.client.request(method, self.url(path)).timeout(COMMAND);
        self.read(request.header(LEASE_HEADER, key).json(body)).await
    }

    /// Posts a query, without a body.
    pub(super) async fn post<T: DeserializeOwned>(&self, path: &str, query: &[(&str, String)]) -> anyhow::Result<T> {
        self.read(self.client.post(self.url(path)).query(query)).await
    }

    /// Deletes, with a body that says how.
    pub(super) async fn delete<T: DeserializeOwned>(&self, path: &str, body: &impl Serialize) -> anyhow::Result<T> {
        self.read(self.client.delete(self.url(path)).json(body)).await
    }

    /// The same as [`Daemon::get`] with a query.
    pub(super) async fn get_with<T: DeserializeOwned>(
        &self,
        path: &str,
        query: &[(&str, String)],
    ) -> anyhow::Result<T> {
        self.read(self.client.get(self.url(path)).query(query)).await
    }

    /// What is at a path, as text.
    pub(super) async fn text(&self, path: &str) -> anyhow::Result<String> {
        let body = self.send(self.client.get(self.url(path))).await?;
        String::from_utf8(body).with_context(|| format!("what {} sends is no text", self.base))
    }

    /// Saves what is at a path to a file.
    async fn save(&self, path: &str, file: &Path) -> anyhow::Result<()> {
        let request = self.client.get(self.url(path)).timeout(DOWNLOAD);
        let mut response = request.send().await.with_context(|| format!("no daemon answers at {}", self.base))?;
        if !response.status().is_success() {
            return Err(refused(&self.base, response.status(), &response.bytes().await?));
        }
        let mut saved = tokio::fs::File::create_new(file).await?;
        while let Some(piece) = response.chunk().await? {
            saved.write_all(&piece).await?;
        }
        Ok(saved.sync_all().await?)
    }

    async fn read<T: DeserializeOwned>(&self, request: reqwest::RequestBuilder) -> anyhow::Result<T> {
        let body = self.send(request).await?;
        serde_json::from_slice(&body)
            .with_context(|| format!("what answers at {} is not this version of plenalign", self.base))
    }

    /// Sends a request; a problem in the answer becomes the error, in the daemon's own words.
    async fn send(&self, request: reqwest::RequestBuilder) -> anyhow::Result<Vec<u8>> {
        let response = request.send().await.with_context(|| format!("no daemon answers at {}", self.base))?;
        let status = response.status();
        let body = response.bytes().await.with_context(|| format!("the answer from {} broke off", self.base))?;
        if status.is_success() {
            return Ok(body.to_vec());
        }
        Err(refused(&self.base, status, &body))
    }
}

/// A request that a daemon has answered, and not granted.
#[derive(Debug)]
pub(super) struct Refusal {
    /// The answer's status.
    pub(super) status: StatusCode,
    /// What the daemon says of it; absent where something else than a daemon has answered.
    pub(super) problem: Option<Problem>,
    base: String,
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.problem {
            Some(problem) => write!(f, "{}: {}", problem.title, problem.detail),
            None => write!(f, "{} answers {}", self.base, reason(self.status)),
        }
    }
}

impl std::error::Error for Refusal {}

/// A refusal in the daemon's own words.
fn refused(base: &str, status: StatusCode, body: &[u8]) -> anyhow::Error {
    Refusal { status, problem: serde_json::from_slice(body).ok(), base: base.to_owned() }.into()
}

fn reason(status: StatusCode) -> String {
    status.canonical_reason().map_or_else(|| status.to_string(), |words| format!("{} {words}", status.as_u16()))
}
