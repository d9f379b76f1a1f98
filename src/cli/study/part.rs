//! `plenalign study --shard K/N`: one part of the Monte Carlos.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;
use std::sync::Arc;

use anyhow::Context as _;
use serde_json::json;
use tokio::runtime::Runtime;
use tokio::signal::unix::{Signal, SignalKind, signal};

use super::progress::Bar;
use super::{Context, slurm};
use crate::cli::output::put;
use crate::study::{self, Journal, Part, Shard, StudyOptions};

/// What a shell says of a program that a signal has ended: this, and the signal's number.
const SIGNALLED: i32 = 128;

/// Which part is asked for.
#[derive(Debug, Clone, Copy)]
pub(super) enum Asked {
    /// By its number.
    Numbered(Shard),
    /// That of this task of a Slurm array.
    Slurm,
}

impl FromStr for Asked {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "slurm" { Ok(Self::Slurm) } else { text.parse().map(Self::Numbered) }
    }
}

impl Asked {
    /// The part; under Slurm with as many threads as this task may have.
    fn shard(self) -> anyhow::Result<Shard> {
        if let Self::Numbered(shard) = self {
            return Ok(shard);
        }
        let variable = |name: &str| std::env::var(name).ok();
        let shard = slurm::shard(&variable)?;
        if let Some(threads) = slurm::threads(&variable)? {
            // More than there are would be in each other's way, whatever is told.
            let threads = std::thread::available_parallelism().map_or(threads, |most| most.min(threads));
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads.get())
                .thread_name(|number| format!("study-{number}"));
            pool.build_global().context("the threads do not start")?;
        }
        Ok(shard)
    }
}

pub(super) fn run(
    context: &Context,
    options: StudyOptions,
    asked: Asked,
    out: &Path,
    as_json: bool,
    bar: &Bar,
) -> anyhow::Result<ExitCode> {
    let shard = asked.shard()?;
    let path = Part::path(out, shard);
    let kept = Part::kept(&path, &context.config, options, shard)?;
    Part::check_split(out, &context.config, options, shard)?;
    let was_there = kept.is_some();
    let part = match kept {
        Some(part) => part,
        None => made(context, options, shard, out, bar)?,
    };
    bar.end();
    let [benches, assemblies] = part.ranges();
    let text = if as_json {
        let range = |range: &Range<u64>| json!({ "first": range.start, "end": range.end });
        let said = json!({
            "part": path.display().to_string(),
            "shard": shard,
            "kept": was_there,
            "benches": range(&benches),
            "assemblies": range(&assemblies),
        });
        format!("{said}\n")
    } else {
        let items = |range: &Range<u64>, of: u64| match range.is_empty() {
            true => format!("none of {of}"),
            false => format!("{} to {} of {of}, counted from 0", range.start, range.end - 1),
        };
        format!(
            "part             {}{}\nbenches          {}\nassemblies       {}\n",
            path.display(),
            if was_there { " (there from an earlier run)" } else { "" },
            items(&benches, options.counts.benches),
            items(&assemblies, options.counts.assemblies),
        )
    };
    // The part is what was asked for, and it is there: a log without room does not make it fail.
    let _ = put(&text);
    Ok(ExitCode::SUCCESS)
}

/// The part worked out, from where earlier attempts at it have come to.
fn made(context: &Context, options: StudyOptions, shard: Shard, out: &Path, bar: &Bar) -> anyhow::Result<Part> {
    let path = Part::path(out, shard);
    // Before anything is there of this attempt.
    let ends = Ends::heard()?;
    let journal = Arc::new(Journal::open(out, &context.config, options, shard)?);
    let share = shard.range(options.counts.benches);
    let benches = share.end - share.start;
    if journal.found() > 0 {
        let elsewhere = match journal.elsewhere() {
            0 => String::new(),
            some => format!(", {some} of them from when the study was split or counted otherwise"),
        };
        eprintln!(
            "{} of {benches} benches are there from earlier attempts at part {shard}{elsewhere}",
            journal.found()
        );
    }
    for why in journal.unknown() {
        eprintln!("plenalign: {why}");
    }
    if journal.torn() > 0 {
        eprintln!("{} torn lines of earlier attempts are not believed, and their benches done again", journal.torn());
    }
    end_with_what_is_finished(ends, Arc::clone(&journal), benches, path.clone())?;
    let made = study::run_part(&context.config, options, &journal, bar).and_then(|part| {
        journal.complete(&part, &path)?;
        Ok(part)
    });
    match made {
        Ok(part) => Ok(part),
        // Another task of the same part, which was done before and has taken the journals away.
        Err(error) => Part::kept(&path, &context.config, options, shard)?.ok_or_else(|| error.into()),
    }
}

/// The signals that end the program, heard from when this is made.
struct Ends {
    runtime: Runtime,
    terminate: Signal,
    interrupt: Signal,
}

impl Ends {
    fn heard() -> anyhow::Result<Self> {
        let runtime =
            tokio::runtime::Builder::new_current_thread().enable_all().build().context("signals cannot be taken")?;
        let guard = runtime.enter();
        let (terminate, interrupt) = (signal(SignalKind::terminate())?, signal(SignalKind::interrupt())?);
        drop(guard);
        Ok(Self { runtime, terminate, interrupt })
    }
}

/// Has a signal that ends the program keep first what is finished. Where the part is whole by then, it is no failure.
fn end_with_what_is_finished(ends: Ends, journal: Arc<Journal>, benches: u64, part: PathBuf) -> anyhow::Result<()> {
    let Ends { runtime, mut terminate, mut interrupt } = ends;
    let wait = move || {
        let kind = runtime.block_on(async {
            tokio::select! {
                _ = terminate.recv() => SignalKind::terminate(),
                _ = interrupt.recv() => SignalKind::interrupt(),
            }
        });
        journal.end(|kept| {
            if journal.is_complete(&part) {
                std::process::exit(0);
            }
            match kept {
                Ok(finished) => eprintln!(
                    "plenalign: ended by a signal: {finished} of {benches} benches of part {} are kept, and the same \
                     command goes on from there",
                    journal.shard()
                ),
                Err(error) => {
                    eprintln!("plenalign: ended by a signal, and what was finished last is not kept: {error}");
                }
            }
            std::process::exit(SIGNALLED + kind.as_raw_value())
        })
    };
    std::thread::Builder::new().name("signals".to_owned()).spawn(wait).context("signals cannot be taken")?;
    Ok(())
}
