//! `plenalign jobs`: what the history keeps of the jobs, from the state folder or from a running daemon.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context as _, bail};
use uuid::Uuid;

use super::output::put_if_read;
use super::remote::RemoteArgs;
use super::{Context, remote, report};
use crate::api::export::{self, JobExport};
use crate::api::jobs::history::{JobItem, JobList};
use crate::api::types::job_href;
use crate::control::history::read::{self, JobArchive, JobQuery, JobSummary};
use crate::control::job::JobState;
use crate::state_folder::state_folder;
use crate::store::{FILE_NAME, Store};

/// Arguments of `plenalign jobs`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    action: Action,
    /// Ask the daemon at this address, e.g. http://127.0.0.1:8080, instead of reading the state folder.
    #[arg(long, value_name = "URL", global = true)]
    server: Option<String>,
    #[command(flatten)]
    remote: RemoteArgs,
    /// Print one JSON object instead of text.
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// List the jobs, newest first.
    List {
        /// At most so many.
        #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..=500))]
        limit: u16,
        /// Only jobs in this state, e.g. `interrupted`.
        #[arg(long, value_parser = state)]
        state: Option<JobState>,
        /// Only jobs with these words in their id, reason or log.
        #[arg(long, value_name = "WORDS")]
        q: Option<String>,
    },
    /// Show a job: its iterations, its figures and its log.
    Show {
        /// The job's id.
        id: Uuid,
    },
    /// Write a job to a file, or to standard output.
    Export {
        /// The job's id.
        id: Uuid,
        /// Everything as JSON, the iterations as CSV, or a report to print.
        #[arg(long, value_enum, default_value_t = Format::Html)]
        format: Format,
        /// Where to; `-` for standard output. Without it a file named after the job, in the working folder.
        #[arg(long, short, value_name = "FILE")]
        output: Option<PathBuf>,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Format {
    Json,
    Csv,
    Html,
}

impl Format {
    const fn extension(self) -> &'static str {
        match self {
            Self::Json => "json",
            Self::Csv => "csv",
            Self::Html => "html",
        }
    }

    /// Last part of the path that a daemon has it at.
    const fn path(self) -> &'static str {
        match self {
            Self::Json => "export.json",
            Self::Csv => "export.csv",
            Self::Html => "report.html",
        }
    }
}

fn state(word: &str) -> Result<JobState, String> {
    serde_json::from_value(serde_json::Value::from(word)).map_err(|_| {
        format!("there is no such state; there are {}", JobState::ALL.map(|state| state.to_string()).join(", "))
    })
}

pub(super) fn run(_: Context, args: Args) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Runtime::new().context("the async runtime does not start")?;
    runtime.block_on(act(args))?;
    Ok(ExitCode::SUCCESS)
}

async fn act(args: Args) -> anyhow::Result<()> {
    let source = Source::new(args.server.as_deref(), &args.remote)?;
    match args.action {
        Action::List { limit, state, q } => {
            let list = source.list(state, q, limit.into()).await?;
            if args.json {
                say(&serde_json::to_string_pretty(&list)?)
            } else if list.jobs.is_empty() {
                say("no job")
            } else {
                list.jobs.iter().try_for_each(|item| say(&line(&item.job)))
            }
        }
        Action::Show { id } => {
            let text = source.export(id, Format::Json).await?;
            if args.json {
                return say(&text);
            }
            let found: JobExport = serde_json::from_str(&text).context("the export cannot be read")?;
            show(&found)
        }
        Action::Export { id, format, output } => {
            let text = source.export(id, format).await?;
            let simulated = if source.is_simulated(id).await? { "SIMULATED-" } else { "" };
            let named = PathBuf::from(format!("{simulated}plenalign-{id}.{}", format.extension()));
            let path = output.unwrap_or(named);
            if path.as_os_str() == "-" {
                return say(text.trim_end_matches('\n'));
            }
            std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
            if args.json {
                say(&serde_json::json!({ "file": path }).to_string())
            } else {
                say(&path.display().to_string())
            }
        }
    }
}

/// A line on standard output; whoever closed it has seen enough.
fn say(line: &str) -> anyhow::Result<()> {
    Ok(put_if_read(&format!("{line}\n"))?)
}

fn line(job: &JobSummary) -> String {
    let simulated = if job.simulated { "  SIMULATED" } else { "" };
    format!(
        "{}  {:.0}  {:<24} {:>3} iterations{simulated}  {}",
        job.id,
        job.created_at,
        report::outcome_words(job.state),
        job.iterations,
        job.reason.as_deref().unwrap_or_default()
    )
}

fn show(found: &JobExport) -> anyhow::Result<()> {
    let job = &found.job;
    say(&format!("job {}, {:.0}", job.id, job.created_at))?;
    if let Some(run) = &found.run {
        say(&format!("plenalign {} on {}", run.version, run.bench))?;
    }
    job.iterations.iter().try_for_each(|iteration| say(&report::iteration_line(iteration)))?;
    say("")?;
    say(report::report_text(job).trim_end())?;
    say("")?;
    job.log.iter().try_for_each(|entry| say(&format!("{:.0}  {}", entry.at, entry.message)))
}

/// Where jobs are read from.
enum Source {
    History(Store),
    Daemon(remote::Daemon),
}

impl Source {
    fn new(server: Option<&str>, remote: &RemoteArgs) -> anyhow::Result<Self> {
        if let Some(server) = server {
            return Ok(Self::Daemon(remote::Daemon::new(server, remote)?));
        }
        let folder = state_folder()?;
        if !folder.join(FILE_NAME).exists() {
            bail!("there is no history in {}: no job has been started with this state folder", folder.display());
        }
        Ok(Self::History(Store::to_read(&folder)))
    }

    async fn list(&self, state: Option<JobState>, text: Option<String>, limit: usize) -> anyhow::Result<JobList> {
        match self {
            Self::History(store) => {
                let query = JobQuery { states: state.into_iter().collect(), text, ..JobQuery::default() };
                let page = read::jobs(store, &query, limit).await?;
                let next = page.items.last().filter(|_| page.more).map(|job| job.id.to_string());
                let jobs = page.items.into_iter().map(|job| JobItem { href: job_href(job.id), job }).collect();
                Ok(JobList { jobs, next, history_fault: None })
            }
            Self::Daemon(daemon) => {
                let mut query = vec![("limit", limit.to_string())];
                if let Some(state) = state {
                    query.push(("state", serde_json::to_value(state)?.as_str().unwrap_or_default().to_owned()));
                }
                query.extend(text.map(|text| ("q", text)));
                daemon.get_with("/api/v1/jobs", &query).await
            }
        }
    }

    async fn export(&self, id: Uuid, format: Format) -> anyhow::Result<String> {
        match self {
            Self::History(store) => {
                let archive = self.archive(store, id).await?;
                Ok(match format {
                    Format::Json => export::json(&archive),
                    Format::Csv => export::csv(&archive),
                    Format::Html => export::html(&archive),
                })
            }
            Self::Daemon(daemon) => daemon.text(&format!("{}/{}", job_href(id), format.path())).await,
        }
    }

    async fn archive(&self, store: &Store, id: Uuid) -> anyhow::Result<JobArchive> {
        read::archive(store, id).await?.with_context(|| format!("there is no job {id} in the history"))
    }

    async fn is_simulated(&self, id: Uuid) -> anyhow::Result<bool> {
        match self {
            Self::History(store) => Ok(self.archive(store, id).await?.job.simulated),
            Self::Daemon(daemon) => {
                Ok(daemon.get::<crate::api::types::JobResource>(&job_href(id)).await?.job.simulated)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_state_is_taken_and_named_to_who_types_another() {
        let refused = state("done").unwrap_err();
        for each in JobState::ALL {
            assert_eq!(state(&each.to_string()), Ok(each));
            assert!(refused.contains(&format!(" {each}")), "{refused}");
        }
    }
}
