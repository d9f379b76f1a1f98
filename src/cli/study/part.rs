//! `plenalign study --shard K/N`: one part of the Monte Carlos.

use std::ops::Range;
use std::path::Path;
use std::process::ExitCode;

use serde_json::json;

use super::Context;
use super::progress::Bar;
use crate::study::{self, Part, Shard, StudyOptions};

pub(super) fn run(
    context: &Context,
    options: StudyOptions,
    shard: Shard,
    out: &Path,
    as_json: bool,
    bar: &Bar,
) -> anyhow::Result<ExitCode> {
    let path = Part::path(out, shard);
    let kept = Part::kept(&path, &context.config, options, shard)?;
    let was_there = kept.is_some();
    let part = match kept {
        Some(part) => part,
        None => {
            let part = study::run_part(&context.config, options, shard, bar)?;
            part.write(&path)?;
            part
        }
    };
    bar.end();
    let [benches, assemblies] = part.ranges();
    if as_json {
        let range = |range: &Range<u64>| json!({ "first": range.start, "end": range.end });
        let said = json!({
            "part": path.display().to_string(),
            "shard": shard,
            "kept": was_there,
            "benches": range(&benches),
            "assemblies": range(&assemblies),
        });
        println!("{said}");
    } else {
        let items = |range: &Range<u64>, of: u64| match range.is_empty() {
            true => format!("none of {of}"),
            false => format!("{} to {} of {of}, counted from 0", range.start, range.end - 1),
        };
        println!("part             {}{}", path.display(), if was_there { " (there from an earlier run)" } else { "" });
        println!("benches          {}", items(&benches, options.counts.benches));
        println!("assemblies       {}", items(&assemblies, options.counts.assemblies));
    }
    Ok(ExitCode::SUCCESS)
}
