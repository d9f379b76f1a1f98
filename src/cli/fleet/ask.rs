//! One daemon asked how it is.

use std::net::SocketAddr;
use std::time::Duration;

use jiff::Timestamp;
use reqwest::{StatusCode, Url};
use serde::Serialize;

use crate::api::types::{Health, JobResource, job_href};
use crate::cli::one_line;
use crate::cli::remote::{Daemon, Refusal, RemoteArgs};
use crate::control::events::{BenchView, MeasurementView};
use crate::control::job::{JobKind, JobState};
use crate::device::AxisName;

/// A daemon that is to be asked.
#[derive(Debug, Clone)]
pub(super) struct Target {
    /// What it is called here.
    pub(super) name: String,
    /// Where it is.
    pub(super) url: Url,
    /// Who asks, and how the daemon is known.
    pub(super) remote: RemoteArgs,
    /// The address that its host's name means, where that has been announced.
    pub(super) at: Option<SocketAddr>,
}

impl Target {
    /// A daemon by its address, called by its host and port.
    ///
    /// # Errors
    /// When that is none.
    pub(super) fn named(url: &str, remote: &RemoteArgs) -> anyhow::Result<Self> {
        let url = address(url)?;
        let host = url.host_str().unwrap_or_default();
        let name = url.port().map_or_else(|| host.to_owned(), |port| format!("{host}:{port}"));
        Ok(Self { name, url, remote: remote.clone(), at: None })
    }

    /// Whether another one is the same daemon, by host and port.
    pub(super) fn is_at(&self, other: &Self) -> bool {
        let port = |target: &Self| target.url.port_or_known_default();
        let host = |target: &Self| target.url.host_str().map(str::to_owned);
        let known = other.at.map(|at| at.ip().to_string());
        port(self) == port(other) && (host(self) == host(other) || host(self) == known)
    }
}

/// An address of a daemon.
///
/// # Errors
/// What would be one.
pub(super) fn address(text: &str) -> anyhow::Result<Url> {
    let url = Url::parse(text).ok().filter(|url| matches!(url.scheme(), "http" | "https") && url.host().is_some());
    url.ok_or_else(|| anyhow::anyhow!("{text:?} is not an address such as https://bench.lab:8443"))
}

/// How it stands with a daemon.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum State {
    /// Its bench can be worked with.
    Ready,
    /// It cannot: the reasons say why.
    NotReady,
    /// It does not let who asks look at its bench.
    NoAccess,
    /// No daemon answers.
    Unreachable,
}

impl State {
    /// For the table.
    pub(super) const fn words(self) -> &'static str {
        match self {
            Self::Ready => "ready",
            Self::NotReady => "NOT READY",
            Self::NoAccess => "NO ACCESS",
            Self::Unreachable => "UNREACHABLE",
        }
    }
}

/// A daemon as it was seen.
#[derive(Debug, Serialize)]
pub(super) struct Seen {
    pub(super) name: String,
    pub(super) url: String,
    pub(super) state: State,
    /// Why it is not ready, not to be looked at, or not reached.
    pub(super) reasons: Vec<String>,
    pub(super) version: Option<String>,
    pub(super) simulated: Option<bool>,
    pub(super) bench: Option<BenchSeen>,
}

impl Seen {
    pub(super) fn is_ready(&self) -> bool {
        self.state == State::Ready
    }
}

/// Its bench.
#[derive(Debug, Serialize)]
pub(super) struct BenchSeen {
    /// Whether motion is refused until the stop is reset.
    pub(super) stop_latched: bool,
    /// Who holds the control lease.
    pub(super) lease: Option<String>,
    pub(super) job: Option<JobSeen>,
    pub(super) spacing: Option<SpacingSeen>,
    pub(super) camera: CameraSeen,
    pub(super) axes: Vec<AxisSeen>,
}

/// The job under way.
#[derive(Debug, Serialize)]
pub(super) struct JobSeen {
    pub(super) id: uuid::Uuid,
    pub(super) kind: JobKind,
    pub(super) state: JobState,
    /// Steps done, and how many there will be.
    pub(super) step: u32,
    pub(super) of: u32,
    /// What is being done; where it waits for the operator, what that is to do.
    pub(super) doing: String,
}

/// The newest measurement.
#[derive(Debug, Serialize)]
pub(super) struct SpacingSeen {
    pub(super) spacing_px: f64,
    pub(super) spacing_sigma_px: f64,
    pub(super) target_px: f64,
    pub(super) in_focus: bool,
    pub(super) captured_at: Timestamp,
}

/// The camera.
#[derive(Debug, Serialize)]
pub(super) struct CameraSeen {
    pub(super) online: bool,
    pub(super) replay: bool,
    /// Age of the newest frame, ms.
    pub(super) frame_age_ms: Option<f64>,
}

/// One axis.
#[derive(Debug, Serialize)]
pub(super) struct AxisSeen {
    pub(super) axis: AxisName,
    pub(super) connected: bool,
    pub(super) homed: bool,
    pub(super) moving: bool,
    pub(super) position_mm: Option<f64>,
}

/// Asks a daemon how it is; returns within the time allowed.
pub(super) async fn ask(target: Target, allowed: Duration) -> Seen {
    let mut seen = Seen {
        name: target.name.clone(),
        url: target.url.as_str().trim_end_matches('/').to_owned(),
        state: State::Unreachable,
        reasons: Vec::new(),
        version: None,
        simulated: None,
        bench: None,
    };
    // What has been learnt until the time is up stays.
    let asked = tokio::time::timeout(allowed, fill(&mut seen, &target)).await;
    match asked {
        Ok(Ok(())) => {}
        Ok(Err(error)) => {
            let refused = error
                .downcast_ref::<Refusal>()
                .is_some_and(|refusal| matches!(refusal.status, StatusCode::UNAUTHORIZED | StatusCode::FORBIDDEN));
            seen.state = if refused { State::NoAccess } else { State::Unreachable };
            seen.reasons.push(one_line(&error));
        }
        Err(_) => {
            seen.state = State::Unreachable;
            seen.reasons.push(format!("no answer within {allowed:?}"));
        }
    }
    seen
}

async fn fill(seen: &mut Seen, target: &Target) -> anyhow::Result<()> {
    let known = target.url.host_str().zip(target.at);
    let daemon = Daemon::reached_at(&seen.url, &target.remote, known)?;
    let health: Health = daemon.get("/healthz").await?;
    (seen.version, seen.simulated) = (Some(health.version), Some(health.simulated));
    let hindrances = daemon.hindrances().await?;
    let bench: BenchView = daemon.get("/api/v1/bench").await?;
    let measurement = match daemon.get::<MeasurementView>("/api/v1/measurement").await {
        Ok(measurement) => Some(measurement),
        // Nothing has been measured.
        Err(error) if is_not_found(&error) => None,
        Err(error) => return Err(error),
    };
    let job = match bench.job {
        Some(id) => match daemon.get::<JobResource>(&job_href(id)).await {
            Ok(found) => Some(job_seen(&found)),
            // It may have ended meanwhile.
            Err(error) if is_not_found(&error) => None,
            Err(error) => return Err(error),
        },
        None => None,
    };
    seen.reasons = hindrances;
    seen.reasons.extend(bench.history_fault.iter().map(|why| format!("nothing moves: {why}")));
    seen.state = if seen.reasons.is_empty() { State::Ready } else { State::NotReady };
    seen.bench = Some(bench_seen(&bench, job, measurement.as_ref()));
    Ok(())
}

fn is_not_found(error: &anyhow::Error) -> bool {
    error.downcast_ref::<Refusal>().is_some_and(|refusal| refusal.status == StatusCode::NOT_FOUND)
}

fn job_seen(JobResource { job, .. }: &JobResource) -> JobSeen {
    let asked = job.operator_step.as_ref().filter(|_| job.state == JobState::WaitingForOperator);
    let doing = asked.map_or_else(|| job.progress.doing.clone(), |step| step.instruction.clone());
    JobSeen { id: job.id, kind: job.kind, state: job.state, step: job.progress.step, of: job.progress.of, doing }
}

fn bench_seen(bench: &BenchView, job: Option<JobSeen>, measurement: Option<&MeasurementView>) -> BenchSeen {
    BenchSeen {
        stop_latched: bench.stop.latched,
        lease: bench.lease.as_ref().map(|lease| lease.owner.clone()),
        job,
        spacing: measurement.map(|measured| SpacingSeen {
            spacing_px: measured.spacing.spacing_px,
            spacing_sigma_px: measured.spacing.spacing_sigma_px,
            target_px: measured.spacing_target_px,
            in_focus: measured.in_focus,
            captured_at: measured.captured_at,
        }),
        camera: CameraSeen {
            online: bench.camera.online,
            replay: bench.camera.replay,
            frame_age_ms: bench.camera.frame_age_ms,
        },
        axes: bench
            .axes
            .iter()
            .map(|axis| AxisSeen {
                axis: axis.axis,
                connected: axis.connected,
                homed: axis.homed,
                moving: axis.moving,
                position_mm: axis.position_mm,
            })
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_daemon_is_known_under_its_name_and_its_address() {
        let remote = RemoteArgs::default();
        let listed = Target::named("https://192.0.2.7:8443", &remote).unwrap();
        assert_eq!(listed.name, "192.0.2.7:8443");
        let mut announced = Target::named("https://bench:8443", &remote).unwrap();
        assert!(!listed.is_at(&announced));
        announced.at = Some("192.0.2.7:8443".parse().unwrap());
        assert!(listed.is_at(&announced));
        for wrong in ["bench.lab:8443", "ftp://bench.lab", "https://", ""] {
            let refused = Target::named(wrong, &remote).unwrap_err().to_string();
            assert!(refused.contains("https://bench.lab:8443"), "{refused}");
        }
    }
}
