//! Which parts of a study are done, running, interrupted and missing, and how long the rest takes.
//!
//! No clock of another machine is asked: a part is running where its journal grows while it is looked at.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::journal::{self, Content};
use super::part::{Origin, failed, opened};
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
    /// Journals of attempts at another split of this study, of which no part is done or running: these parts go on from
    /// what they have.
    pub left_over: u64,
}

/// What makes a study of its own of parts: they are made from the same, and as many.
type Key = (Origin, u64, u64, u64);

/// Benches that journals have, by their indices, and the time that each took, s: of all parts and splits, since whoever
/// begins a part goes on from them.
type Finished = BTreeMap<u64, f64>;

/// What is there of one part.
#[derive(Debug, Clone, Copy, Default)]
struct Found {
    done: bool,
    running: bool,
}

/// What is there of a study.
#[derive(Default)]
struct Study {
    parts: BTreeMap<u64, Found>,
    /// Items of whole parts and the time that they took, s: benches, then assemblies.
    known: [(u64, f64); 2],
    journals: u64,
    left_over: u64,
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
    for path in journal::in_folder(folder, |_| true)? {
        // Opened, since a network's file system may answer from what it remembers for a file that is not.
        // What cannot be opened does not grow; why is said when it is read.
        if let Ok(found) = opened(&path).and_then(|file| file.metadata()) {
            lengths.insert(path, found.len());
        }
    }
    Ok(lengths)
}

fn look(folder: &Path, grows: impl Fn(&Path) -> bool) -> Result<(Vec<Status>, Vec<StudyError>), StudyError> {
    let mut studies: Vec<(Key, Study)> = Vec::new();
    let mut finished: Vec<(Origin, Finished)> = Vec::new();
    let mut unusable = Vec::new();
    // Before the parts: one that is written meanwhile takes its journals away, and is then seen as a part.
    let mut journals = Vec::new();
    for path in journal::in_folder(folder, |_| true)? {
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
        let key = (part.origin, part.benches.count, part.assemblies.count, part.shard.of());
        let study = entry(&mut studies, key);
        study.parts.entry(part.shard.number()).or_default().done = true;
        for (known, items, seconds) in [
            (0, part.benches.outcomes.len(), part.benches.seconds),
            (1, part.assemblies.outcomes.len(), part.assemblies.seconds),
        ] {
            study.known[known].0 += items as u64;
            study.known[known].1 += seconds;
        }
    }
    for (path, kept) in journals {
        let head = kept.head;
        let benches = kept.benches.into_iter().map(|(bench, found)| (bench, found.seconds));
        entry(&mut finished, head.origin.clone()).extend(benches);
        let study = entry(&mut studies, (head.origin, head.benches, head.assemblies, head.shard.of()));
        study.parts.entry(head.shard.number()).or_default().running |= grows(&path);
        study.journals += 1;
    }
    let studies = without_left_over(studies).into_iter().map(|(key, study)| {
        let of_it = entry(&mut finished, key.0.clone());
        study.status(key, of_it)
    });
    Ok((studies.collect(), unusable))
}

/// What belongs to a key, from here on at least.
fn entry<K: PartialEq, V: Default>(all: &mut Vec<(K, V)>, key: K) -> &mut V {
    let at = all.iter().position(|(other, _)| *other == key).unwrap_or_else(|| {
        all.push((key, V::default()));
        all.len() - 1
    });
    &mut all[at].1
}

/// The studies without those that only journals tell of at which nobody is, and that cannot be gone on with, since parts of
/// another split of the same study are done.
fn without_left_over(studies: Vec<(Key, Study)>) -> Vec<(Key, Study)> {
    let any = |study: &Study, state: fn(&Found) -> bool| study.parts.values().any(state);
    let (mut kept, others): (Vec<_>, Vec<_>) =
        studies.into_iter().partition(|(_, study)| any(study, |part| part.done || part.running));
    for (key, other) in others {
        let same = |(begun, study): &&mut (Key, Study)| {
            (&begun.0, begun.1, begun.2) == (&key.0, key.1, key.2) && any(study, |part| part.done)
        };
        match kept.iter_mut().find(same) {
            Some((_, study)) => study.left_over += other.journals,
            None => kept.push((key, other)),
        }
    }
    kept
}

impl Study {
    fn status(self, (origin, benches, assemblies, of): Key, finished: &Finished) -> Status {
        let counts = Counts { benches, assemblies };
        let [mut known, aligned] = self.known;
        known.0 += finished.len() as u64;
        known.1 += finished.values().sum::<f64>();
        let per_item = [known, aligned].map(|(items, seconds)| (items > 0).then(|| seconds / items as f64));
        // Of so many benches at this rate, and assemblies at everybody's: where nobody knows, of assemblies alone it is
        // nothing, since all of them together take less than a bench.
        let takes = |benches: u64, per_bench: Option<f64>, assemblies: u64| {
            let aligned = if benches == 0 { Some(0.0) } else { per_bench.map(|seconds| seconds * benches as f64) };
            aligned.map(|seconds| seconds + per_item[1].unwrap_or(0.0) * assemblies as f64)
        };
        let length = |range: Range<u64>| range.end - range.start;
        let mut parts = Vec::new();
        let (mut missing, mut last) = (Vec::new(), 0);
        let mut work = Some(0.0);
        let mut add = |seconds: Option<f64>| work = work.zip(seconds).map(|(work, seconds)| work + seconds);
        for (number, found) in self.parts {
            let shard = Shard::new(number, of);
            let range = shard.range(benches);
            let (has, seconds) = within(finished, range.clone());
            let share = length(range);
            let own = (has > 0).then(|| seconds / has as f64);
            let (finished, rest_s) = match found.done {
                true => (share, Some(0.0)),
                false => (has, takes(share - has, own.or(per_item[0]), length(shard.range(assemblies)))),
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
            let items = |count| Shard::new(*first, of).range(count).start..Shard::new(*last, of).range(count).end;
            let (has, _) = within(finished, items(benches));
            add(takes(length(items(benches)) - has, per_item[0], length(items(assemblies))));
        }
        let running: Vec<Option<f64>> =
            parts.iter().filter(|part| part.state == State::Running).map(|part| part.rest_s).collect();
        // All of it shared out evenly, but no part sooner than it is done.
        let shared = work.filter(|_| !running.is_empty()).map(|work| work / running.len() as f64);
        let rest_s = running.iter().fold(shared, |rest, part| rest.zip(*part).map(|(rest, part)| rest.max(part)));
        Status {
            options: StudyOptions { quick: origin.quick, seed: origin.seed, counts },
            program_version: origin.program_version,
            configuration_sha256: origin.configuration_sha256,
            shards: of,
            parts,
            missing,
            work_s: work,
            rest_s,
            left_over: self.left_over,
        }
    }
}

/// How many of these benches are finished, and the time that they took, s.
fn within(finished: &Finished, benches: Range<u64>) -> (u64, f64) {
    finished.range(benches).fold((0, 0.0), |(items, seconds), (_, more)| (items + 1, seconds + more))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn origin() -> Origin {
        let config = crate::config::Config::default();
        Origin::of(&config, StudyOptions::new(true, 1))
    }

    fn found(done: bool, running: bool) -> Found {
        Found { done, running }
    }

    fn status(parts: &[(u64, Found)], known: [(u64, f64); 2], finished: &[(u64, f64)], of: (u64, u64, u64)) -> Status {
        let study = Study { parts: parts.iter().copied().collect(), known, ..Study::default() };
        study.status((origin(), of.0, of.1, of.2), &finished.iter().copied().collect())
    }

    #[test]
    fn the_rest_is_what_is_left_at_the_rates_seen() {
        // Of 40 benches in 8 parts: one done, one running at 10 s a bench, one interrupted at 20 s.
        let parts = [(2, found(true, false)), (5, found(false, true)), (6, found(false, false))];
        let journals = [(20, 10.0), (22, 10.0), (27, 20.0)];
        let done = [(5, 60.0), (100, 10.0)];
        let seen = status(&parts, done, &journals, (40, 800, 8));
        let states = [State::Done, State::Running, State::Interrupted];
        assert_eq!(seen.parts.iter().map(|part| part.state).collect::<Vec<_>>(), states);
        assert_eq!(seen.parts.iter().map(|part| part.finished).collect::<Vec<_>>(), [5, 2, 1]);
        assert_eq!(seen.missing, [(1, 1), (3, 4), (7, 8)]);
        // 100 assemblies of a part take 10 s.
        assert_eq!(seen.parts[1].rest_s, Some(3.0 * 10.0 + 10.0));
        assert_eq!(seen.parts[2].rest_s, Some(4.0 * 20.0 + 10.0));
        let work = 40.0 + 90.0 + 5.0 * (5.0 * 12.5 + 10.0);
        assert_eq!((seen.work_s, seen.rest_s), (Some(work), Some(work)));
        // Two that another split has finished are taken by parts that are not begun.
        let more = status(&parts, done, &[&journals[..], &[(0, 12.5), (39, 12.5)]].concat(), (40, 800, 8));
        assert_eq!((more.work_s, more.missing), (Some(work - 25.0), seen.missing));
    }

    #[test]
    fn the_last_to_run_is_waited_for() {
        let journals = [(0, 10.0), (1, 10.0), (2, 10.0), (3, 10.0), (5, 30.0)];
        let both = [(1, found(false, true)), (2, found(false, true))];
        let seen = status(&both, Default::default(), &journals, (10, 10, 2));
        assert_eq!((seen.work_s, seen.rest_s), (Some(10.0 + 120.0), Some(120.0)));
    }

    #[test]
    fn what_nobody_has_timed_is_not_made_up() {
        let begun = status(&[(1, found(false, true))], Default::default(), &[], (10, 10, u64::MAX));
        assert_eq!((begun.work_s, begun.rest_s), (None, None));
        assert_eq!(begun.missing, [(2, u64::MAX)]);
        let done = status(&[(1, found(true, false))], [(10, 5.0), (10, 0.1)], &[], (10, 10, 1));
        assert_eq!((done.work_s, done.rest_s, done.missing.len()), (Some(0.0), None, 0));
    }

    #[test]
    fn what_another_split_has_left_is_no_study_where_parts_are_done() {
        let study = |done: bool, running: bool, journals: u64| Study {
            parts: [(1, found(done, running))].into(),
            journals,
            ..Study::default()
        };
        let folded = |first: Study, second: Study| {
            let studies = vec![((origin(), 8, 8, 2), first), ((origin(), 8, 8, 4), second)];
            let kept = without_left_over(studies);
            kept.into_iter().map(|((.., of), study)| (of, study.left_over)).collect::<Vec<_>>()
        };
        assert_eq!(folded(study(false, false, 3), study(true, false, 0)), [(4, 3)]);
        // Somebody is at the one, or none is done of the other: either may become the study.
        assert_eq!(folded(study(false, true, 3), study(true, false, 0)), [(2, 0), (4, 0)]);
        assert_eq!(folded(study(false, false, 3), study(false, true, 1)), [(4, 0), (2, 0)]);
        let other = vec![((origin(), 9, 8, 2), study(false, false, 3)), ((origin(), 8, 8, 4), study(true, false, 0))];
        assert_eq!(without_left_over(other).len(), 2);
    }
}
