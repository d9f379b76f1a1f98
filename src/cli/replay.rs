//! `plenalign replay`: a recorded job done again from its frames, and compared with what was recorded.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;

use crate::control::replay::{Replay, Step, What, replay};

/// Exit code where something differs.
const DIFFERS: u8 = 1;
/// Exit code where the file cannot be replayed at all.
const UNREADABLE: u8 = 2;
/// Differences that are printed one by one; the others are counted.
const SHOWN: usize = 20;

/// Arguments of `plenalign replay`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The recording.
    #[arg(value_name = "FILE.mcap")]
    file: PathBuf,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Runtime::new().context("the async runtime does not start")?;
    let replayed = match runtime.block_on(replay(&args.file)) {
        Ok(replayed) => replayed,
        Err(error) => {
            eprintln!("plenalign: {error}");
            return Ok(ExitCode::from(UNREADABLE));
        }
    };
    if args.json {
        println!("{}", serde_json::to_string_pretty(&replayed)?);
    } else {
        print!("{}", text(&replayed));
    }
    Ok(if replayed.identical { ExitCode::SUCCESS } else { ExitCode::from(DIFFERS) })
}

fn text(replayed: &Replay) -> String {
    let simulated = if replayed.simulated { "SIMULATED " } else { "" };
    let kind = serde_json::to_value(replayed.kind).unwrap_or_default();
    let mut text = format!(
        "{simulated}{} {} ({})\n\n  {:>3}  {:<12} {:<8} {:>13} {:>13}  {:<4}  decided\n",
        kind.as_str().unwrap_or_default(),
        replayed.job,
        replayed.file,
        "no.",
        "",
        "",
        "recorded px",
        "replayed px",
        ""
    );
    for step in &replayed.steps {
        text.push_str(&line(step));
    }
    text.push('\n');
    for note in &replayed.notes {
        text.push_str(&format!("{note}\n"));
    }
    for difference in replayed.differences.iter().take(SHOWN) {
        text.push_str(&format!(
            "{}: {} was {}, is {}\n",
            difference.at, difference.field, difference.recorded, difference.replayed
        ));
    }
    if replayed.differences.len() > SHOWN {
        text.push_str(&format!("and {} differences more\n", replayed.differences.len() - SHOWN));
    }
    text.push_str(if replayed.identical { "identical\n" } else { "DIFFERENT\n" });
    text
}

fn line(step: &Step) -> String {
    let word = |value: serde_json::Value| value.as_str().unwrap_or_default().to_owned();
    let number = |px: Option<f64>| px.map_or("-".to_owned(), |px| format!("{px:.6}"));
    let (what, kind) = match step.what {
        What::Measurement => ("measured".to_owned(), String::new()),
        What::Decision => (
            word(serde_json::to_value(step.stage).unwrap_or_default()),
            word(serde_json::to_value(step.kind).unwrap_or_default()),
        ),
    };
    let decision = match (&step.recorded_decision, &step.replayed_decision) {
        (Some(then), Some(now)) if then != now => format!("{then}; now: {now}"),
        (then, now) => then.clone().or_else(|| now.clone()).unwrap_or_default(),
    };
    let line = format!(
        "  {:>3}  {what:<12} {kind:<8} {:>13} {:>13}  {:<4}  {decision}",
        step.number,
        number(step.recorded_px),
        number(step.replayed_px),
        if step.same { "same" } else { "DIFF" }
    );
    format!("{}\n", line.trim_end())
}
