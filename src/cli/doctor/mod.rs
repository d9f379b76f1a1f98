//! `plenalign doctor`: what is found on this machine, what is wrong, and what to type to mend it.
//!
//! ```text
//!   collect   looks at the machine, and writes nothing
//!      |
//!    facts    what was found, as data
//!      |
//!   checks    facts to findings: functions, each of the facts alone
//!      |
//!   report    findings to a table or a JSON object
//! ```

mod checks;
mod collect;
mod facts;
mod finding;
mod report;

use std::path::Path;
use std::process::ExitCode;

use anyhow::Context as _;

use super::output::put_if_read;
use super::serve::DEFAULT_ADDRESS;
use collect::Wanted;
use report::Report;

/// Arguments of `plenalign doctor`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Exit code: 0 where nothing keeps the bench from working, 1 where something does.")]
pub(super) struct Args {
    /// Address at which the daemon serves, or is to.
    #[arg(long, value_name = "ADDR", default_value = DEFAULT_ADDRESS)]
    listen: String,
    /// Open the ports of the configured controllers and ask what is there: nothing moves by it, but a board that resets
    /// when its port is opened does so. Without it no port is opened.
    #[arg(long)]
    identify: bool,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// Examines the machine with the configuration of a file and what is set on the command line: a configuration that
/// cannot be used is a finding among others.
pub(super) fn run(file: Option<&Path>, set: &[String], args: &Args) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Runtime::new().context("the async runtime does not start")?;
    let wanted = Wanted { file, set, listen: &args.listen, identify: args.identify };
    let facts = runtime.block_on(collect::facts(wanted));
    // A look-up of a name that hangs must not hold the end up.
    runtime.shutdown_background();
    let report = Report::new(facts.system.version.clone(), checks::all(&facts));
    let text = if args.json { serde_json::to_string_pretty(&report)? + "\n" } else { report.text() };
    put_if_read(&text)?;
    Ok(if report.has_problems() { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}
