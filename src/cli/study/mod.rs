//! `plenalign study`: the paper's experiments on the simulated camera, as a report; whole, or its Monte Carlos in parts
//! that several machines work out.

mod merge;
mod part;
mod progress;
mod report;
mod slurm;
mod status;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use super::Context;
use crate::study::{self, Archive, Counts, StudyOptions};

/// Arguments of `plenalign study`.
#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(super) struct Args {
    #[command(subcommand)]
    action: Option<Action>,
    #[command(flatten)]
    study: StudyArgs,
}

#[derive(Debug, clap::Subcommand)]
enum Action {
    /// Put the parts that `--shard` made together, and write the study's report with them.
    Merge(merge::Args),
    /// Say which parts are done, running, interrupted and missing, and how long the rest takes.
    Status(status::Args),
}

#[derive(Debug, clap::Args)]
struct StudyArgs {
    /// Write report.html, results.json, tables and pictures into this folder. A study that was interrupted goes on from
    /// the chapters that are there.
    #[arg(long, value_name = "DIR", default_value = "study")]
    out: PathBuf,
    /// Print the results as one JSON object instead of text.
    #[arg(long)]
    json: bool,
    /// Small sensors and few seeds: a minute or two instead of half an hour.
    #[arg(long)]
    quick: bool,
    /// Seed of textures, noise, parts and benches.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Draw so many assemblies; without it 200000, or 4000 with --quick.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=Counts::MOST_ASSEMBLIES))]
    assemblies: Option<u64>,
    /// Run the loops on so many benches; without it 100, or 4 with --quick.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=Counts::MOST_BENCHES))]
    benches: Option<u64>,
    /// Only work out the K-th of N parts of the Monte Carlos (assemblies and benches), counted from 1, into DIR/parts;
    /// `plenalign study merge` puts the parts together. A part that was interrupted goes on from the benches that are
    /// finished. `slurm` is the part of this task of a Slurm array, with a thread for each processor that it was given.
    #[arg(long, value_name = "K/N|slurm")]
    shard: Option<part::Asked>,
    /// Only make the chapters that parts do not have, and no report: beside the parts, so that the merge finds them made.
    #[arg(long, conflicts_with_all = ["shard", "assemblies", "benches"])]
    other_chapters: bool,
}

pub(super) fn run(context: &Context, args: Args) -> anyhow::Result<ExitCode> {
    let (action, args) = (args.action, args.study);
    match action {
        Some(Action::Merge(args)) => return merge::run(context, &args),
        Some(Action::Status(args)) => return status::run(&args),
        None => {}
    }
    let mut options = StudyOptions::new(args.quick, args.seed);
    options.counts.assemblies = args.assemblies.unwrap_or(options.counts.assemblies);
    options.counts.benches = args.benches.unwrap_or(options.counts.benches);
    let bar = progress::Bar::new();
    if let Some(asked) = args.shard {
        return part::run(context, options, asked, &args.out, args.json, &bar);
    }
    let archive = Archive::open(&args.out, &context.config, options)?;
    let _held = archive.hold(|| waiting(&args.out))?;
    if args.other_chapters {
        let chapters = study::run_others(&context.config, options, &archive, &bar)?;
        bar.end();
        report::others(&args.out, &chapters, args.json);
        return Ok(ExitCode::SUCCESS);
    }
    let chapters = study::run(&context.config, options, &archive, &bar)?;
    bar.end();
    report::write(context, options, &archive, &chapters, args.json)?;
    Ok(ExitCode::SUCCESS)
}

/// Says that another study's end is waited for.
fn waiting(out: &Path) {
    eprintln!("plenalign: another study writes into {}: waiting for its end", out.display());
}
