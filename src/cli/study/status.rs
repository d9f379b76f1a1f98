//! `plenalign study status`: how far the parts are.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::ensure;
use serde_json::{Value, json};

use crate::study::{self, PartStatus, State, Status};

/// Arguments of `plenalign study status`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The study's folder.
    #[arg(long, value_name = "DIR", default_value = "study")]
    out: PathBuf,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let (studies, unusable) = study::status(&args.out)?;
    for why in &unusable {
        eprintln!("plenalign: {why}");
    }
    if args.json {
        let unusable: Vec<String> = unusable.iter().map(ToString::to_string).collect();
        println!("{}", json!({ "studies": studies.iter().map(as_json).collect::<Vec<_>>(), "unusable": unusable }));
    } else {
        let blocks: Vec<String> = studies.iter().map(block).collect();
        print!("{}", blocks.join("\n"));
    }
    ensure!(!studies.is_empty(), "{}: no part of a study has been begun here", args.out.display());
    Ok(ExitCode::SUCCESS)
}

fn as_json(status: &Status) -> Value {
    let part = |part: &PartStatus| {
        let state = match part.state {
            State::Done => "done",
            State::Running => "running",
            State::Interrupted => "interrupted",
        };
        json!({
            "shard": part.shard,
            "state": state,
            "benches_finished": part.finished,
            "benches": part.benches,
            "rest_s": part.rest_s,
        })
    };
    json!({
        "quick": status.options.quick,
        "seed": status.options.seed,
        "program_version": status.program_version,
        "configuration_sha256": status.configuration_sha256,
        "benches": status.options.counts.benches,
        "assemblies": status.options.counts.assemblies,
        "shards": status.shards,
        "parts": status.parts.iter().map(part).collect::<Vec<_>>(),
        "missing": status.missing.iter().map(|(first, last)| json!({ "first": first, "last": last })).collect::<Vec<_>>(),
        "work_s": status.work_s,
        "rest_s": status.rest_s,
        "left_over": status.left_over,
    })
}

/// The lines of a study.
fn block(status: &Status) -> String {
    let counts = status.options.counts;
    let quick = if status.options.quick { "quick, " } else { "" };
    let mut lines = vec![format!(
        "study            {quick}seed {}, {} benches, {} assemblies, in {} parts",
        status.options.seed, counts.benches, counts.assemblies, status.shards
    )];
    lines.push(format!(
        "made by          plenalign {}, configuration {:.12}…",
        status.program_version, status.configuration_sha256
    ));
    let of = |state: State| status.parts.iter().filter(move |part| part.state == state);
    let numbers = of(State::Done).map(|part| part.shard.number());
    lines.push(format!("done             {}", rows(numbers.map(|number| (number, number)))));
    for (state, word) in [(State::Running, "running"), (State::Interrupted, "interrupted")] {
        for part in of(state) {
            let rest = part.rest_s.map_or_else(|| "not known yet".to_owned(), time);
            let (finished, benches) = (part.finished, part.benches);
            lines.push(format!(
                "{word:16} {}: {finished} of {benches} benches; its rest takes {rest}",
                part.shard.number()
            ));
        }
    }
    lines.push(format!("missing          {}", rows(status.missing.iter().copied())));
    let running = of(State::Running).count();
    // One that is not written yet is not done, though its benches are.
    let all_done = status.missing.is_empty() && of(State::Done).count() == status.parts.len();
    lines.push(match (status.work_s, status.rest_s) {
        _ if all_done => "rest             none: `plenalign study merge` makes the report".to_owned(),
        (Some(work), Some(rest)) => {
            format!(
                "rest             {} with {running} at a time, as now; {} one after the other",
                time(rest),
                time(work)
            )
        }
        (Some(work), None) => format!("rest             {} one after the other; no part is running", time(work)),
        (None, _) => "rest             not known before the first bench is finished".to_owned(),
    });
    match status.left_over {
        0 => {}
        some => lines.push(format!(
            "left over        {some} journals of another split: parts that are not done go on from what they have"
        )),
    }
    lines.join("\n") + "\n"
}

/// Rows of parts in words, those that follow one another joined.
fn rows(all: impl Iterator<Item = (u64, u64)>) -> String {
    let mut joined: Vec<(u64, u64)> = Vec::new();
    for (first, last) in all {
        match joined.last_mut() {
            Some(before) if before.1.checked_add(1) == Some(first) => before.1 = last,
            _ => joined.push((first, last)),
        }
    }
    let words =
        joined.iter().map(|(first, last)| if first == last { first.to_string() } else { format!("{first}-{last}") });
    let words: Vec<String> = words.collect();
    if words.is_empty() { "none".to_owned() } else { words.join(", ") }
}

/// A time in the unit that suits it.
fn time(seconds: f64) -> String {
    match seconds {
        ..90.0 => format!("{seconds:.0} s"),
        ..5400.0 => format!("{:.0} min", seconds / 60.0),
        _ => format!("{:.1} h", seconds / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::{Counts, StudyOptions};

    fn part(shard: &str, state: State, finished: u64, rest_s: f64) -> PartStatus {
        PartStatus { shard: shard.parse().unwrap(), state, finished, benches: 5, rest_s: Some(rest_s) }
    }

    #[test]
    fn a_study_is_told_in_words() {
        let parts = vec![
            part("1/8", State::Done, 5, 0.0),
            part("2/8", State::Done, 5, 0.0),
            part("4/8", State::Done, 5, 0.0),
            part("5/8", State::Running, 2, 40.0),
            part("6/8", State::Interrupted, 1, 900.0),
        ];
        let counts = Counts { benches: 40, assemblies: 800 };
        let options = StudyOptions { quick: true, seed: 3, counts };
        let missing = vec![(3, 3), (7, 8)];
        let mut status = Status {
            options,
            program_version: "0.1.0".to_owned(),
            configuration_sha256: "0123456789abcdef".to_owned(),
            shards: 8,
            parts,
            missing,
            work_s: Some(7200.0),
            rest_s: Some(7200.0),
            left_over: 0,
        };
        assert_eq!(
            block(&status),
            "study            quick, seed 3, 40 benches, 800 assemblies, in 8 parts\n\
             made by          plenalign 0.1.0, configuration 0123456789ab…\n\
             done             1-2, 4\n\
             running          5: 2 of 5 benches; its rest takes 40 s\n\
             interrupted      6: 1 of 5 benches; its rest takes 15 min\n\
             missing          3, 7-8\n\
             rest             2.0 h with 1 at a time, as now; 2.0 h one after the other\n"
        );
        status.parts.truncate(3);
        status.rest_s = None;
        assert!(block(&status).ends_with("\nrest             2.0 h one after the other; no part is running\n"));
        status.work_s = None;
        assert!(block(&status).ends_with("not known before the first bench is finished\n"));
        (status.missing, status.work_s) = (Vec::new(), Some(0.0));
        status.parts[0].state = State::Interrupted;
        assert!(block(&status).ends_with("\nrest             0 s one after the other; no part is running\n"));
        status.parts[0].state = State::Done;
        assert!(block(&status).contains("missing          none\nrest             none: `plenalign study merge`"));
        status.left_over = 2;
        assert!(block(&status).contains("\nleft over        2 journals of another split: "));
    }
}
