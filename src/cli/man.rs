//! `plenalign man`: the manual's pages, one a command, made from what its arguments say.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use clap::{Command, CommandFactory as _};
use clap_mangen::Man;

use super::Cli;

/// The manual that the pages belong to, in the middle of their first line.
const MANUAL: &str = "Plenalign";

/// Arguments of `plenalign man`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Folder that the pages are written into, made where it is not there.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let folder = &args.folder;
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    // What `help` says is said by `--help` and by these pages.
    let mut command = Cli::command().disable_help_subcommand(true);
    command.build();
    let pages = write(&command, folder)?;
    println!("{pages} pages in {}", folder.display());
    Ok(ExitCode::SUCCESS)
}

/// Writes the page of a command and those of the commands below it; how many there are.
fn write(command: &Command, folder: &Path) -> anyhow::Result<usize> {
    let source = format!("plenalign {}", env!("CARGO_PKG_VERSION"));
    let page = Man::new(command.clone()).manual(MANUAL).source(source);
    let name = page.get_filename();
    page.generate_to(folder).with_context(|| format!("cannot write {}", folder.join(name).display()))?;
    let below = command.get_subcommands().filter(|command| !command.is_hide_set());
    below.map(|command| write(command, folder)).sum::<anyhow::Result<usize>>().map(|pages| pages + 1)
}
