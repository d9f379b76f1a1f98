//! `plenalign fleet`: several daemons at once.

mod ask;
mod discover;
mod file;
mod table;

use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context as _, bail};
use jiff::Timestamp;
use serde::Serialize;
use tokio::task::JoinSet;

use super::output::{put, put_if_read};
use super::remote::RemoteArgs;
use super::serve::Signals;
use ask::{Seen, Target, ask};

/// Clears a terminal and begins at its top.
const CLEAR: &str = "\x1b[H\x1b[2J";

/// Arguments of `plenalign fleet`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// Say of each of several daemons whether it can be reached, whether its bench can be worked with, and what it does.
    #[command(after_help = "Exit code: 0 where every daemon was reached, let itself be looked at and is ready; 1 \
                            otherwise.")]
    Status(StatusArgs),
}

#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("which").args(["server", "file", "discover"]).required(true).multiple(true))]
struct StatusArgs {
    /// A daemon's address, e.g. `https://bench.lab:8443`; may be repeated. --ca and PLENALIGN_TOKEN are for these, and for
    /// those of the file that name none of their own.
    #[arg(long, value_name = "URL")]
    server: Vec<String>,
    /// A file that lists daemons: name, url, ca and token_file of each.
    #[arg(long, value_name = "FLEET.toml")]
    file: Option<PathBuf>,
    /// Ask the daemons that announce themselves on the local network, too. The token goes to them only over TLS, to
    /// those that --ca vouches for.
    #[arg(long)]
    discover: bool,
    /// Longest time for a daemon to answer, s; all are asked at once.
    #[arg(long, value_name = "SECONDS", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=60))]
    timeout: u64,
    /// Look again and again, until interrupted.
    #[arg(long)]
    watch: bool,
    /// Between two looks, s.
    #[arg(long, value_name = "SECONDS", default_value_t = 2, value_parser = clap::value_parser!(u64).range(1..=3600))]
    every: u64,
    #[command(flatten)]
    remote: RemoteArgs,
    /// Print one JSON object instead of text; with --watch one a line.
    #[arg(long)]
    json: bool,
}

/// What one look has found.
#[derive(Debug, Serialize)]
struct Status {
    /// When it was looked.
    at: Timestamp,
    /// How many daemons are ready.
    ready: usize,
    daemons: Vec<Seen>,
}

pub(super) fn run(args: Args) -> anyhow::Result<ExitCode> {
    let Action::Status(args) = args.action;
    let runtime = tokio::runtime::Runtime::new().context("the async runtime does not start")?;
    let code = runtime.block_on(status(&args));
    // A look-up of a name that hangs must not hold the end up.
    runtime.shutdown_background();
    code
}

async fn status(args: &StatusArgs) -> anyhow::Result<ExitCode> {
    let mut targets = Vec::new();
    for url in &args.server {
        targets.push(Target::named(url, &args.remote)?);
    }
    if let Some(path) = &args.file {
        targets.extend(file::read(path, &args.remote)?);
    }
    if args.discover {
        let found = discover::daemons(&args.remote).await?;
        for daemon in found {
            if !targets.iter().any(|target| target.is_at(&daemon)) {
                targets.push(daemon);
            }
        }
    }
    if targets.is_empty() {
        bail!("no daemon has announced itself within {:?}: server.mdns = true has one do so", discover::LOOK);
    }
    let allowed = Duration::from_secs(args.timeout);
    if !args.watch {
        return show(&look(&targets, allowed).await, args);
    }
    let mut signals = Signals::new()?;
    let mut code = ExitCode::FAILURE;
    loop {
        let again = async {
            code = show(&look(&targets, allowed).await, args)?;
            tokio::time::sleep(Duration::from_secs(args.every)).await;
            anyhow::Ok(())
        };
        tokio::select! {
            done = again => done?,
            () = signals.next() => return Ok(code),
        }
    }
}

/// Asks every daemon at once; returns within the time that each is allowed.
async fn look(targets: &[Target], allowed: Duration) -> Status {
    let mut asked = JoinSet::new();
    for (number, target) in targets.iter().cloned().enumerate() {
        asked.spawn(async move { (number, ask(target, allowed).await) });
    }
    let mut seen = asked.join_all().await;
    seen.sort_by_key(|(number, _)| *number);
    let daemons: Vec<Seen> = seen.into_iter().map(|(_, seen)| seen).collect();
    Status { at: Timestamp::now(), ready: daemons.iter().filter(|seen| seen.is_ready()).count(), daemons }
}

/// Prints it; returns the exit code that it comes to.
fn show(status: &Status, args: &StatusArgs) -> anyhow::Result<ExitCode> {
    let text = match (args.json, args.watch) {
        (true, true) => serde_json::to_string(status)? + "\n",
        (true, false) => serde_json::to_string_pretty(status)? + "\n",
        (false, true) if std::io::stdout().is_terminal() => format!("{CLEAR}{}", table::text(status)),
        (false, _) => table::text(status),
    };
    if args.watch {
        // Where it is closed there is nobody left to look for.
        put(&text)?;
    } else {
        put_if_read(&text)?;
    }
    Ok(if status.ready == status.daemons.len() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
