//! `plenalign align`: a joint alignment, in process on the configured bench or through a running daemon.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use tokio::io::{AsyncBufReadExt, BufReader};
use tokio::sync::broadcast::error::RecvError;

use super::faults::{self, FaultArgs};
use super::lock::BenchLock;
use super::progress::Progress;
use super::serve::Signals;
use super::{Context, Settings, remote, report};
use crate::control::events::Event;
use crate::control::job::{JobKind, JobRequest, JobSnapshot, JobState};
use crate::control::motion::lease::{DEFAULT_TTL_S, LeaseRequest};
use crate::control::{Refusal, Service, ServiceError, Shown, open_bench};
use crate::state_folder::{mend, state_folder};
use crate::store::Store;

/// Arguments of `plenalign align`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Align through the daemon at this address, e.g. http://127.0.0.1:8080, instead of in process.
    #[arg(long, value_name = "URL", conflicts_with = "seed")]
    server: Option<String>,
    #[command(flatten)]
    remote: remote::RemoteArgs,
    /// Seed of the simulated bench's noise and textures.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    #[command(flatten)]
    faults: FaultArgs,
    /// Record it to this file, for Foxglove and `plenalign replay`.
    #[arg(long, value_name = "FILE.mcap")]
    record: Option<PathBuf>,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(settings: &Settings, args: Args) -> anyhow::Result<ExitCode> {
    if args.server.is_some() && args.faults.is_given() {
        anyhow::bail!(
            "--faults is for an alignment in process; a daemon takes a plan at /api/v1/simulation/fault-plan"
        );
    }
    let runtime = tokio::runtime::Runtime::new().context("the async runtime does not start")?;
    let job = match &args.server {
        Some(server) => {
            settings.refuse("with --server the daemon's own configuration is in force")?;
            runtime.block_on(remote::align(server, &args.remote, args.record.as_deref()))
        }
        None => runtime.block_on(in_process(settings.open()?, &args)),
    };
    // A read of standard input that still waits must not hold the end up.
    runtime.shutdown_background();
    let job = job?;
    if args.json {
        println!("{}", serde_json::to_string_pretty(&report::report_json(&job))?);
    } else {
        print!("{}", report::report_text(&job));
    }
    Ok(if job.state == JobState::Converged { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

async fn in_process(mut context: Context, args: &Args) -> anyhow::Result<JobSnapshot> {
    if let Some(seed) = args.seed {
        context.config.bench.simulation.seed = seed;
        context.config.validate()?;
    }
    let plan = args.faults.read()?;
    let config = Arc::new(context.config);
    let mut signals = Signals::new()?;
    let _lock = BenchLock::take(&config.bench)?;
    let state = state_folder()?;
    mend(&state);
    let store = Store::open(&state);
    let bench = open_bench(&config).await.context("the bench cannot be opened")?;
    if bench.is_simulated() {
        eprintln!("plenalign: SIMULATED bench: no real device is driven");
    }
    let service = Service::start(Arc::clone(&config), context.origin.describe(&config), bench, store);
    faults::put_in_force(&service, plan)?;
    let ended = follow(&service, &mut signals, args.record.clone()).await;
    service.shut_down().await;
    ended
}

/// What a line answers to a step.
#[derive(Debug, PartialEq, Eq)]
enum Answer {
    /// It has been carried out.
    Done,
    /// An earlier one is asked for again.
    Again(u32),
    /// Neither.
    Unknown,
}

impl Answer {
    fn of(line: &str) -> Self {
        let line = line.trim();
        let again = || line.strip_prefix("again ")?.trim().parse().ok();
        if line.is_empty() { Self::Done } else { again().map_or(Self::Unknown, Self::Again) }
    }
}

/// Runs the job to its end. The first signal cancels it, the second ends the program at once.
async fn follow(service: &Arc<Service>, signals: &mut Signals, record: Option<PathBuf>) -> anyhow::Result<JobSnapshot> {
    let mut events = service.subscribe();
    let request =
        LeaseRequest { owner: remote::lease_owner("align"), note: None, ttl: Duration::from_secs_f64(DEFAULT_TTL_S) };
    let grant = service.leases().acquire(request)?;
    let permit = service.leases().permit(Some(&grant.key))?;
    let request = JobRequest::of(JobKind::JointAlignment);
    let created = match record {
        Some(file) => service.create_job_recorded(&permit, request, file).await?,
        None => service.create_job(&permit, request).await?,
    };
    let id = created.id;
    let mut progress = Progress::new("press Enter when it is done".to_owned(), Some("again"));
    let mut lines = BufReader::new(tokio::io::stdin()).lines();
    let (mut interrupted, mut input_open) = (false, true);
    loop {
        let job = service.job(id)?;
        progress.show(&job);
        if job.state.is_final() {
            progress.finish();
            return Ok(job);
        }
        let waits = job.state == JobState::WaitingForOperator;
        tokio::select! {
            event = events.recv() => match event {
                Ok(Event::Job { .. } | Event::Bench { .. } | Event::Measurement { .. }) | Err(RecvError::Lagged(_)) => {}
                Err(RecvError::Closed) => anyhow::bail!("the bench's service ended before its job"),
            },
            line = lines.next_line(), if waits && input_open => {
                let line = line.ok().flatten();
                input_open = line.is_some();
                match (job.operator_step, line) {
                    (Some(step), Some(line)) => {
                        let shown = Shown { lease: Some(&grant.key), ..Shown::default() };
                        match Answer::of(&line) {
                            Answer::Done => match service.confirm(id, step.number, shown).await {
                                Err(ServiceError::Refused(why @ Refusal::OldPicture)) => progress.say(&why.to_string()),
                                confirmed => drop(confirmed?),
                            },
                            Answer::Unknown => progress.say(
                                "nothing was confirmed: Enter alone says that it is done, `again 1` asks for step 1 again",
                            ),
                            Answer::Again(earlier) => {
                                if let Err(error) = service.repeat(id, earlier, shown) {
                                    progress.say(&error.to_string());
                                }
                            }
                        }
                    }
                    _ => {
                        progress.say("standard input is closed: nobody can confirm the operator's steps; cancelling");
                        service.cancel(id, None)?;
                    }
                }
            }
            () = signals.next() => {
                if interrupted {
                    anyhow::bail!("ended at once by a second signal");
                }
                interrupted = true;
                progress.say("stopping the axes; a second signal ends at once");
                service.cancel(id, None)?;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_an_empty_line_confirms() {
        let answers = ["", "  ", "again 2", " again 12 ", "again", "again x", "Again 2", "agian 2", "again2", "y"];
        let of = answers.map(Answer::of);
        assert_eq!(of[..4], [Answer::Done, Answer::Done, Answer::Again(2), Answer::Again(12)]);
        assert!(of[4..].iter().all(|answer| *answer == Answer::Unknown), "{of:?}");
    }
}
