//! Which parts of a study are done, running, interrupted and missing, and how long the rest takes.
//!
//! No clock of another machine is asked: a part is running where its journal grows while it is looked at.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::journal::{self, Content};
use super::part::{Origin, failed};
use super::{Counts, Part, Shard};
use crate::study::{StudyError, StudyOptions};

/// How long a journal is looked at for it to grow.
const PATIENCE: Duration = Duration::from_secs(3 * journal::BEAT.as_secs());
const LOOK_AGAIN: Duration = Duration::from_millis(100);

/// How far a part is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// It is whole.
    Done,
    /// Somebody works on it.
    Running,
    /// It was begun, and nobody works on it.
    Interrupted,
}

/// A part of which something is there.
#[derive(Debug, Clone, PartialEq)]
pub struct PartStatus {
    /// Which one.
    pub shard: Shard,
    /// How far it is.
    pub state: State,
    /// How many of its benches are finished.
    pub finished: u64,
    /// How many benches it has.
    pub benches: u64,
    /// Time that its rest takes, s; `None` where that is not known yet.
    pub rest_s: Option<f64>,
}

/// What the parts of one study in a folder come to.
#[derive(Debug, Clone, PartialEq)]
pub struct Status {
    /// The study.
    pub options: StudyOptions,
    /// Version of the program that its parts are of.
    pub program_version: String,
    /// SHA-256 of the configuration that they are made with, as JSON.
    pub configuration_sha256: String,
    /// How many parts it is in.
    pub shards: u64,
    /// Those of which something is there, in order.
    pub parts: Vec<PartStatus>,
    /// The first and the last of each row of parts of which nothing is there.
    pub missing: Vec<(u64, u64)>,
    /// Time that the rest takes with one part at a time, s; `None` where that is not known yet.
    pub work_s: Option<f64>,
    /// Time that it takes with as many parts at a time as are running now, s; `None` where none is.
    pub rest_s: Option<f64>,
}

/// What makes a study of its own of parts: they are made from the same, and as many.
type Key = (Origin, u64, u64, u64);

/// What is there of one part.
#[derive(Default)]
struct Found {
    done: bool,
    running: bool,
    benches: BTreeMap<u64, ()>,
    /// Time that the benches of its journals took, s.
    bench_seconds: f64,
}

/// What is there of a study.
#[derive(Default)]
struct Study {
    parts: BTreeMap<u64, Found>,
    /// Items whose time is known, and that time, s: benches, then assemblies.
    known: [(u64, f64); 2],
}

/// Looks at the parts in a study's folder, for a few seconds where some are begun and not done. Beside the studies, what
/// is there and is no part of any.
///
/// # Errors
/// [`StudyError::Folder`].
pub fn status(study: &Path) -> Result<(Vec<Status>, Vec<StudyError>), StudyError> {
    let folder = Part::folder(study);
    if !folder.try_exists().map_err(failed(&folder))? {
        return Ok(Default::default());
    }
    let before = lengths(&folder)?;
    let begun = Instant::now();
    while begun.elapsed() < PATIENCE && lengths(&folder)?.iter().any(|(path, length)| before.get(path) == Some(length))
    {
        std::thread::sleep(LOOK_AGAIN);
    }
    let now = lengths(&folder)?;
    // One that was not there before has been begun meanwhile.
    look(&folder, |path| now.get(path).is_some_and(|length| before.get(path) != Some(length)))
}

/// The lengths of all journals in a folder of parts that are not done.
fn lengths(folder: &Path) -> Result<BTreeMap<PathBuf, u64>, StudyError> {
    let mut lengths = BTreeMap::new();
    for path in journal::in_folder(folder, None)? {
        // Opened, since a network's file system may answer from what it remembers for a file that is not.
        // What cannot be opened does not grow; why is said when it is read.
        if let Ok(found) = File::open(&path).and_then(|file| file.metadata()) {
            lengths.insert(path, found.len());
        }
    }
    Ok(lengths)
}

fn look(folder: &Path, grows: impl Fn(&Path) -> bool) -> Result<(Vec<Status>, Vec<StudyError>), StudyError> {
    let mut studies: Vec<(Key, Study)> = Vec::new();
    let mut unusable = Vec::new();
    let mut of = |key: Key, see: &mut dyn FnMut(&mut Study)| match studies.iter_mut().find(|(other, _)| *other == key) {
        Some((_, study)) => see(study),
        None => {
            let mut study = Study::default();
            see(&mut study);
            studies.push((key, study));
        }
    };
    // Before the parts: one that is written meanwhile takes its journals away, and is then seen as a part.
    let mut journals = Vec::new();
    for path in journal::in_folder(folder, None)? {
        match journal::read(&path) {
            Content::Kept(kept) => journals.push((path, kept)),
            Content::Nothing => {}
            Content::Unknown(why) => unusable.push(why),
        }
    }
    for path in Part::in_folder(folder)? {
        let part = match Part::read(&path) {
            Ok(part) => part,
            Err(error) => {
                unusable.push(error);
                continue;
            }
        };
        of((part.origin, part.benches.count, part.assemblies.count, part.shard.of()), &mut |study| {
            study.parts.entry(part.shard.number()).or_default().done = true;
            for (known, items, seconds) in [
                (0, part.benches.outcomes.len(), part.benches.seconds),
                (1, part.assemblies.outcomes.len(), part.assemblies.seconds),
            ] {
                study.known[known].0 += items as u64;
                study.known[known].1 += seconds;
            }
        });
    }
    for (path, kept) in journals {
        let head = kept.head;
        of((head.origin, head.benches, head.assemblies, head.shard.of()), &mut |study| {
            let found = study.parts.entry(head.shard.number()).or_default();
            if !found.done {
                found.running |= grows(&path);
                found.benches.extend(kept.benches.keys().map(|bench| (*bench, ())));
                found.bench_seconds += kept.seconds;
                study.known[0].0 += kept.benches.len() as u64;
                study.known[0].1 += kept.seconds;
            }
        });
    }
    Ok((studies.into_iter().map(|(key, study)| study.status(key)).collect(), unusable))
}

impl Study {
    fn status(self, (origin, benches, assemblies, of): Key) -> Status {
        let counts = Counts { benches, assemblies };
        let per_item = self.known.map(|(items, seconds)| (items > 0).then(|| seconds / items as f64));
        // Of so many benches at this rate, and assemblies at everybody's: where nobody knows, of assemblies alone it is
        // nothing, since all of them together take less than a bench.
        let takes = |benches: u64, per_bench: Option<f64>, assemblies: u64| {
            let aligned = if benches == 0 { Some(0.0) } else { per_bench.map(|seconds| seconds * benches as f64) };
            aligned.map(|seconds| seconds + per_item[1].unwrap_or(0.0) * assemblies as f64)
        };
        let length = |range: std::ops::Range<u64>| range.end - range.start;
        let mut parts = Vec::new();
        let (mut missing, mut last) = (Vec::new(), 0);
        let mut work = Some(0.0);
        let mut add = |seconds: Option<f64>| work = work.zip(seconds).map(|(work, seconds)| work + seconds);
        for (number, found) in self.parts {
            let shard = Shard::new(number, of);
            let share = length(shard.range(benches));
            let finished = if found.done { share } else { found.benches.len() as u64 };
            let own = (finished > 0 && !found.done).then(|| found.bench_seconds / finished as f64);
            let rest_s = match found.done {
                true => Some(0.0),
                false => takes(share - finished, own.or(per_item[0]), length(shard.range(assemblies))),
            };
            add(rest_s);
            let state = match (found.done, found.running) {
                (true, _) => State::Done,
                (false, true) => State::Running,
                (false, false) => State::Interrupted,
            };
            parts.push(PartStatus { shard, state, finished, benches: share, rest_s });
            if number - last > 1 {
                missing.push((last + 1, number - 1));
            }
            last = number;
        }
        if last < of {
            missing.push((last + 1, of));
        }
        for (first, last) in &missing {
            let items = |count| Shard::new(*last, of).range(count).end - Shard::new(*first, of).range(count).start;
            add(takes(items(benches), per_item[0], items(assemblies)));
        }
        let running: Vec<Option<f64>> =
            parts.iter().filter(|part| part.state == State::Running).map(|part| part.rest_s).collect();
        // All of it shared out evenly, but no part sooner than it is done.
        let shared = work.filter(|_| !running.is_empty()).map(|work| work / running.len() as f64);
        let rest_s = running.iter().fold(shared, |rest, part| rest.zip(*part).map(|(rest, part)| rest.max(part)));
        let options = StudyOptions { quick: origin.quick, seed: origin.seed, counts };
        let Origin { program_version, configuration_sha256, .. } = origin;
        Status { options, program_version, configuration_sha256, shards: of, parts, missing, work_s: work, rest_s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origin() -> Origin {
        let config = crate::config::Config::default();
        Origin::of(&config, StudyOptions::new(true, 1))
    }

    fn found(done: bool, running: bool, benches: &[u64], bench_seconds: f64) -> Found {
        Found { done, running, benches: benches.iter().map(|bench| (*bench, ())).collect(), bench_seconds }
    }

    #[test]
    fn the_rest_is_what_is_left_at_the_rates_seen() {
        // Of 40 benches in 8 parts: one done, one running at 10 s a bench, one interrupted at 20 s.
        let parts = [
            (2, found(true, false, &[], 0.0)),
            (5, found(false, true, &[20, 22], 20.0)),
            (6, found(false, false, &[27], 20.0)),
        ];
        let study = Study { parts: parts.into(), known: [(8, 100.0), (100, 10.0)] };
        let status = study.status((origin(), 40, 800, 8));
        let states = [State::Done, State::Running, State::Interrupted];
        assert_eq!(status.parts.iter().map(|part| part.state).collect::<Vec<_>>(), states);
        assert_eq!(status.parts.iter().map(|part| part.finished).collect::<Vec<_>>(), [5, 2, 1]);
        assert_eq!(status.missing, [(1, 1), (3, 4), (7, 8)]);
        // 100 assemblies of a part take 10 s.
        assert_eq!(status.parts[1].rest_s, Some(3.0 * 10.0 + 10.0));
        assert_eq!(status.parts[2].rest_s, Some(4.0 * 20.0 + 10.0));
        let work = 40.0 + 90.0 + 5.0 * (5.0 * 12.5 + 10.0);
        assert_eq!((status.work_s, status.rest_s), (Some(work), Some(work)));
    }

    #[test]
    fn the_last_to_run_is_waited_for() {
        let parts = [(1, found(false, true, &[0, 1, 2, 3], 40.0)), (2, found(false, true, &[5], 30.0))];
        let status = Study { parts: parts.into(), known: [(5, 70.0), (0, 0.0)] }.status((origin(), 10, 10, 2));
        assert_eq!((status.work_s, status.rest_s), (Some(10.0 + 120.0), Some(120.0)));
    }

    #[test]
    fn what_nobody_has_timed_is_not_made_up() {
        let begun = Study { parts: [(1, found(false, true, &[], 0.0))].into(), known: Default::default() };
        let status = begun.status((origin(), 10, 10, u64::MAX));
        assert_eq!((status.work_s, status.rest_s), (None, None));
        assert_eq!(status.missing, [(2, u64::MAX)]);
        let done = Study { parts: [(1, found(true, false, &[], 0.0))].into(), known: [(10, 5.0), (10, 0.1)] };
        let status = done.status((origin(), 10, 10, 1));
        assert_eq!((status.work_s, status.rest_s, status.missing.len()), (Some(0.0), None, 0));
    }
}
