//! The file of a journal: lines of a checksum and JSON, first what the part is made from, then benches as they are finished.
//! A line that is torn fails its checksum, and is not believed.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use uuid::Uuid;

use crate::config::Config;
use crate::study::loops::BenchOutcome;
use crate::study::monte_carlo::Shard;
use crate::study::monte_carlo::part::{Beginning, Origin, contents, failed, named, stem};
use crate::study::{StudyError, StudyOptions};

/// What says that a file is a journal.
const FORMAT: &str = "plenalign-study-journal";
/// The version of the file's layout; it rises with every change of it.
const FORMAT_VERSION: u64 = 1;
/// How the names of journals end.
const ENDING: &str = ".journal";
/// What an attempt is at.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::study::monte_carlo) struct Head {
    format: String,
    format_version: u64,
    pub(in crate::study::monte_carlo) shard: Shard,
    pub(in crate::study::monte_carlo) origin: Origin,
    /// How many benches the study has.
    pub(in crate::study::monte_carlo) benches: u64,
    /// How many assemblies the study has.
    pub(in crate::study::monte_carlo) assemblies: u64,
}

impl Head {
    /// That of a part of a study.
    pub(super) fn of(config: &Config, options: StudyOptions, shard: Shard) -> Self {
        Self {
            format: FORMAT.to_owned(),
            format_version: FORMAT_VERSION,
            shard,
            origin: Origin::of(config, options),
            benches: options.counts.benches,
            assemblies: options.counts.assemblies,
        }
    }
}

/// A finished bench.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Finished {
    pub(super) bench: u64,
    /// Wall time since the attempt began, s.
    pub(super) seconds: f64,
    pub(super) outcome: BenchOutcome,
}

/// A bench of a journal.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::study::monte_carlo) struct Bench {
    pub(in crate::study::monte_carlo) outcome: BenchOutcome,
    /// Wall time of the attempt from the bench that was finished before it to this one, s. Those of all benches are the
    /// attempt's time, however many were worked on at once; and where two attempts have a bench, one of them counts.
    pub(in crate::study::monte_carlo) seconds: f64,
}

/// What a journal holds that can be believed.
#[derive(Debug)]
pub(in crate::study::monte_carlo) struct Kept {
    pub(in crate::study::monte_carlo) head: Head,
    /// The finished benches, by their indices.
    pub(in crate::study::monte_carlo) benches: BTreeMap<u64, Bench>,
    /// Lines that were not believed.
    pub(in crate::study::monte_carlo) torn: usize,
}

/// What a file that is named as a journal is.
#[derive(Debug)]
pub(in crate::study::monte_carlo) enum Content {
    /// A journal.
    Kept(Kept),
    /// One that ends within its first line, or is not there any more.
    Nothing,
    /// It cannot be read, or begins as no journal of this program does: why.
    Unknown(StudyError),
}

/// The journals in a folder that are named for certain parts, by their names.
pub(in crate::study::monte_carlo) fn in_folder(
    folder: &Path,
    wanted: impl Fn(Shard) -> bool,
) -> Result<Vec<PathBuf>, StudyError> {
    let mut paths = named(folder, "part-", ENDING)?;
    paths.retain(|path| of_name(path).is_some_and(&wanted));
    Ok(paths)
}

/// Which part a journal is of, by its name.
fn of_name(path: &Path) -> Option<Shard> {
    let (stem, _) = path.file_name()?.to_str()?.split_once('.')?;
    let (number, of) = stem.strip_prefix("part-")?.split_once("-of-")?;
    format!("{number}/{of}").parse().ok()
}

/// A name for another journal of a part.
pub(super) fn new_path(folder: &Path, shard: Shard) -> PathBuf {
    folder.join(format!("{}.{}{ENDING}", stem(shard), Uuid::now_v7()))
}

/// Reads a journal.
pub(in crate::study::monte_carlo) fn read(path: &Path) -> Content {
    let bytes = match contents(path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == ErrorKind::NotFound => return Content::Nothing,
        Err(source) => return Content::Unknown(failed(path)(source)),
    };
    let text = String::from_utf8_lossy(&bytes);
    let mut lines = text.split_inclusive('\n');
    let first_line = lines.next().unwrap_or_default();
    if !first_line.ends_with('\n') {
        return Content::Nothing;
    }
    let head = match head(first_line) {
        Ok(head) => head,
        Err(why) => return Content::Unknown(StudyError::Part { path: path.display().to_string(), why }),
    };
    let share = head.shard.range(head.benches);
    let (mut kept, mut before) = (Kept { head, benches: BTreeMap::new(), torn: 0 }, 0.0);
    // A line that says nothing is a beat.
    for line in lines.filter(|line| *line != "\n") {
        let finished = believed(first_line, line).and_then(|text| serde_json::from_str::<Finished>(text).ok());
        match finished.filter(|finished| share.contains(&finished.bench)) {
            Some(Finished { bench, seconds, outcome }) => {
                kept.benches.insert(bench, Bench { outcome, seconds: seconds - before });
                before = seconds;
            }
            None => kept.torn += 1,
        }
    }
    Content::Kept(kept)
}

/// What a journal's first line says, or why it is not believed.
fn head(first_line: &str) -> Result<Head, String> {
    let text = believed("", first_line)
        .ok_or("the journal's first line is damaged: nothing in it is believed, and it is left alone")?;
    let beginning: Beginning =
        serde_json::from_str(text).map_err(|error| format!("not a journal of a part: {error}; it is left alone"))?;
    if beginning.format != FORMAT {
        return Err(format!("not a journal of a part: its format is {:?}; it is left alone", beginning.format));
    }
    if beginning.format_version != FORMAT_VERSION {
        return Err(format!(
            "a journal of version {} of the format, of which this program reads {FORMAT_VERSION}: it is left alone",
            beginning.format_version
        ));
    }
    serde_json::from_str(text).map_err(|error| format!("not a journal of a part: {error}; it is left alone"))
}

/// A line of a journal with this first line; that one's own has none before it.
pub(super) fn line(first_line: &str, text: &str) -> String {
    format!("{} {text}\n", checksum(first_line, text))
}

/// What a line says, where it is whole.
fn believed<'l>(first_line: &str, line: &'l str) -> Option<&'l str> {
    let (sum, text) = line.strip_suffix('\n')?.split_once(' ')?;
    (sum == checksum(first_line, text)).then_some(text)
}

fn checksum(first_line: &str, text: &str) -> String {
    let sum = Sha256::new().chain_update(first_line).chain_update(text).finalize();
    sum.iter().take(8).map(|byte| format!("{byte:02x}")).collect()
}
