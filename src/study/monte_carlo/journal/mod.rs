//! What a part has finished while it is not whole: each attempt at it keeps its benches in a file of its own, so that the
//! next one goes on from there, also where the study is split otherwise by then. Assemblies are not kept: to work one out
//! takes less than to write it down.

mod file;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

pub(super) use self::file::{Bench, Content, in_folder, read};
use self::file::{Finished, Head, line, new_path};
use super::part::{failed, keep_names};
use super::{Part, Shard};
use crate::config::Config;
use crate::study::loops::BenchOutcome;
use crate::study::{StudyError, StudyOptions};

/// How often a journal grows while its part is worked out, also where nothing was finished: whoever looks twice sees from
/// that alone, without any clock, that somebody is at work.
pub(super) const BEAT: Duration = Duration::from_secs(3);

/// The journal of an attempt at a part, and what earlier attempts have finished.
#[derive(Debug)]
pub struct Journal {
    head: Head,
    /// The first line, which the checksum of each other one is of, too: no line is believed in another file.
    first_line: String,
    path: PathBuf,
    benches: BTreeMap<u64, Bench>,
    elsewhere: u64,
    torn: usize,
    unknown: Vec<StudyError>,
    begun: Instant,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    file: File,
    /// Lines that are not in the file yet.
    pending: String,
    /// Benches finished in this attempt.
    finished: u64,
    /// Why nothing more can be kept.
    failure: Option<std::io::Error>,
}

impl Journal {
    /// Opens the journal of a new attempt at a part, and reads those of the earlier ones; also of attempts at other parts, of
    /// another number of parts or items, which have the same benches by the same indices.
    ///
    /// # Errors
    /// [`StudyError::Folder`].
    pub fn open(study: &Path, config: &Config, options: StudyOptions, shard: Shard) -> Result<Self, StudyError> {
        let head = Head::of(config, options, shard);
        let folder = Part::folder(study);
        fs::create_dir_all(&folder).map_err(failed(&folder))?;
        let (mut benches, mut others, mut torn) = (BTreeMap::new(), BTreeMap::new(), 0);
        let mut unknown = Vec::new();
        // Of other counts any part may have benches of this one.
        for path in in_folder(&folder, |_| true)? {
            match read(&path) {
                Content::Kept(kept) if kept.head == head => {
                    torn += kept.torn;
                    benches.extend(kept.benches);
                }
                Content::Kept(kept) if kept.head.origin == head.origin => others.extend(kept.benches),
                // Of another study; or somebody has only just begun.
                Content::Kept(_) | Content::Nothing => {}
                Content::Unknown(why) => unknown.push(why),
            }
        }
        let share = shard.range(options.counts.benches);
        others.retain(|bench, _| share.contains(bench) && !benches.contains_key(bench));
        let elsewhere = others.len() as u64;
        benches.append(&mut others);
        let path = new_path(&folder, shard);
        let text = serde_json::to_string(&head).map_err(|error| failed(&path)(error.into()))?;
        let first_line = line("", &text);
        let opened = File::create(&path)
            .and_then(|mut file| file.write_all(first_line.as_bytes()).and_then(|()| file.sync_data()).map(|()| file));
        let file = opened.map_err(|source| {
            let _ = fs::remove_file(&path);
            failed(&path)(source)
        })?;
        keep_names(&folder);
        let state = State { file, pending: String::new(), finished: 0, failure: None };
        let (begun, state) = (Instant::now(), Mutex::new(state));
        Ok(Self { head, first_line, path, benches, elsewhere, torn, unknown, begun, state })
    }

    /// Which part it is of.
    #[must_use]
    pub const fn shard(&self) -> Shard {
        self.head.shard
    }

    /// How many benches earlier attempts have finished.
    #[must_use]
    pub fn found(&self) -> u64 {
        self.benches.len() as u64
    }

    /// How many of these only attempts at parts of another number of parts or items have finished.
    #[must_use]
    pub const fn elsewhere(&self) -> u64 {
        self.elsewhere
    }

    /// How many lines of earlier attempts at this very part were not believed: torn, or damaged, in journals that are
    /// otherwise read. The benches of such lines are done again. Of journals that are not read at all [`Self::unknown`] tells.
    #[must_use]
    pub const fn torn(&self) -> usize {
        self.torn
    }

    /// Journals in the folder, of whichever part, of which nothing was read, and why: they cannot be opened, their first line
    /// is damaged, or it is of another version of the format. They are left alone. Lines of journals that were read
    /// are [`Self::torn`].
    #[must_use]
    pub fn unknown(&self) -> &[StudyError] {
        &self.unknown
    }

    /// Time that earlier attempts took for the benches that they have finished, s. One that several have counts once.
    pub(in crate::study) fn seconds(&self) -> f64 {
        self.benches.values().map(|bench| bench.seconds).sum()
    }

    /// What a bench came to in an earlier attempt.
    pub(in crate::study) fn bench(&self, index: u64) -> Option<&BenchOutcome> {
        self.benches.get(&index).map(|bench| &bench.outcome)
    }

    /// Keeps what a bench came to, with the next beat.
    ///
    /// # Errors
    /// [`StudyError::Folder`] where nothing more can be kept.
    pub(in crate::study) fn finish(&self, bench: u64, outcome: &BenchOutcome) -> Result<(), StudyError> {
        let seconds = self.begun.elapsed().as_secs_f64();
        let finished = Finished { bench, seconds, outcome: outcome.clone() };
        let text = serde_json::to_string(&finished).map_err(|error| failed(&self.path)(error.into()))?;
        let mut state = self.state();
        state.pending.push_str(&line(&self.first_line, &text));
        state.finished += 1;
        match &state.failure {
            // The same for all who ask: only one of them is heard.
            Some(error) => Err(failed(&self.path)(
                error.raw_os_error().map_or_else(|| error.kind().into(), std::io::Error::from_raw_os_error),
            )),
            None => Ok(()),
        }
    }

    /// Does some work, with the journal growing at each beat.
    ///
    /// # Errors
    /// The work's; [`StudyError::Folder`] where nothing more can be kept.
    pub(in crate::study) fn beating<T>(&self, work: impl FnOnce() -> Result<T, StudyError>) -> Result<T, StudyError> {
        self.beating_each(BEAT, work)
    }

    fn beating_each<T>(&self, beat: Duration, work: impl FnOnce() -> Result<T, StudyError>) -> Result<T, StudyError> {
        std::thread::scope(|scope| {
            let (end, ended) = mpsc::channel::<()>();
            scope.spawn(move || {
                while ended.recv_timeout(beat) == Err(RecvTimeoutError::Timeout) {
                    let mut state = self.state();
                    state.pending.push('\n');
                    if let Err(error) = state.flush() {
                        state.failure = Some(error);
                        return;
                    }
                }
            });
            let done = work();
            drop(end);
            done
        })
    }

    /// Keeps what is finished, and ends the attempt by `then`, which is told how many benches of the part are finished by
    /// all attempts, or why they could not be kept. Nothing is written meanwhile.
    pub fn end<T>(&self, then: impl FnOnce(Result<u64, StudyError>) -> T) -> T {
        let mut state = self.state();
        let finished = self.found() + state.finished;
        let kept = state.flush().map(|()| finished).map_err(failed(&self.path));
        if state.finished == 0 {
            // There is nothing in it to go on from.
            let _ = fs::remove_file(&self.path);
        }
        then(kept)
    }

    /// Whether the whole part is there, whoever has made it.
    #[must_use]
    pub fn is_complete(&self, path: &Path) -> bool {
        let Head { shard, origin, benches, assemblies, .. } = &self.head;
        Part::there(path, *shard, origin, [*benches, *assemblies]).is_ok_and(|part| part.is_some())
    }

    /// Writes the whole part, where it is not there, and takes the journals of it away.
    ///
    /// # Errors
    /// As [`Part::write`]; the journals are there still.
    pub fn complete(&self, part: &Part, path: &Path) -> Result<(), StudyError> {
        let mut state = self.state();
        // What cannot be kept is not needed, where the part itself can.
        let _ = state.flush();
        part.write(path)?;
        let folder = self.path.parent().unwrap_or(Path::new("."));
        // The part is there, whatever stays beside it.
        for journal in in_folder(folder, |named| named == self.head.shard).unwrap_or_default() {
            let same = match read(&journal) {
                Content::Kept(kept) => kept.head == self.head,
                Content::Nothing => true,
                // Another program may well be able to read it.
                Content::Unknown(_) => false,
            };
            if same {
                // It is of no use from here on, and harms nobody.
                let _ = fs::remove_file(&journal);
            }
        }
        Ok(())
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn flush(&mut self) -> std::io::Result<()> {
        let written = self.file.write_all(self.pending.as_bytes());
        if written.is_err() && !self.pending.starts_with('\n') {
            // Half a line may be there: what is written next does not go on from it.
            self.pending.insert(0, '\n');
        }
        written?;
        self.file.sync_data()?;
        self.pending.clear();
        Ok(())
    }
}

#[cfg(test)]
mod tests;
