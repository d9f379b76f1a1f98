//! `plenalign study merge`: the parts of the Monte Carlos put together, and the report of the whole.

use std::collections::HashSet;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::bail;

use super::progress::Bar;
use super::{Context, report};
use crate::study::{self, Archive, Part};

/// Arguments of `plenalign study merge`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The parts, in any order, or folders of them; without any, all in DIR/parts. Seed, counts and --quick are theirs.
    #[arg(value_name = "PART")]
    parts: Vec<PathBuf>,
    /// Write report.html, results.json, tables and pictures into this folder. Chapters that are there and belong to the same
    /// study are kept.
    #[arg(long, value_name = "DIR", default_value = "study")]
    out: PathBuf,
    /// Print the results as one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(context: &Context, args: &Args) -> anyhow::Result<ExitCode> {
    let mut parts = Vec::new();
    for path in files(args)? {
        let part = Part::read(&path)?;
        parts.push((path, part));
    }
    let merged = study::merge(parts, &context.config)?;
    let options = merged.options();
    let archive = Archive::open(&args.out, &context.config, options)?;
    let _held = archive.hold(|| super::waiting(&args.out))?;
    let bar = Bar::new();
    let chapters = study::run_merged(&context.config, &merged, &archive, &bar)?;
    bar.end();
    report::write(context, options, &archive, &chapters, args.json)?;
    Ok(ExitCode::SUCCESS)
}

/// The files of the parts, each once, however often it was named.
fn files(args: &Args) -> anyhow::Result<Vec<PathBuf>> {
    let given = if args.parts.is_empty() { vec![Part::folder(&args.out)] } else { args.parts.clone() };
    let mut files = Vec::new();
    for path in given {
        if !path.is_dir() {
            files.push(path);
            continue;
        }
        let found = Part::in_folder(&path)?;
        if found.is_empty() {
            bail!("{}: there is no part-K-of-N.json, as `plenalign study --shard K/N` writes it", path.display());
        }
        files.extend(found);
    }
    files.sort();
    // One file may have been named in several ways.
    let mut seen = HashSet::new();
    files.retain(|path| seen.insert(path.canonicalize().unwrap_or_else(|_| path.clone())));
    Ok(files)
}
