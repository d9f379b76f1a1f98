//! `plenalign completions`: what a shell needs in order to complete this program's arguments.

use std::io::Write as _;
use std::process::ExitCode;

use anyhow::Context as _;
use clap::CommandFactory as _;
use clap_complete::Shell;

use super::Cli;

/// Arguments of `plenalign completions`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The shell; its script goes to standard output.
    shell: Shell,
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let mut command = Cli::command();
    let name = command.get_name().to_owned();
    // Written as a whole: the generator panics where its output cannot be taken, as by `| head`.
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, name, &mut script);
    std::io::stdout().write_all(&script).context("the script cannot be written")?;
    Ok(ExitCode::SUCCESS)
}
