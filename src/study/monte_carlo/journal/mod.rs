//! What a part has finished while it is not whole: each attempt at it keeps its benches in a file of its own, so that the
//! next one goes on from there. Assemblies are not kept: to work one out takes less than to write it down.

mod file;

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

pub(super) use self::file::{Content, in_folder, read};
use self::file::{Finished, Head, line, new_path};
use super::part::failed;
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
    benches: BTreeMap<u64, BenchOutcome>,
    seconds: f64,
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
    /// Opens the journal of a new attempt at a part, and reads those of the earlier ones.
    ///
    /// # Errors
    /// [`StudyError::Folder`].
    pub fn open(study: &Path, config: &Config, options: StudyOptions, shard: Shard) -> Result<Self, StudyError> {
        let head = Head::of(config, options, shard);
        let folder = Part::folder(study);
        fs::create_dir_all(&folder).map_err(failed(&folder))?;
        let (mut benches, mut seconds, mut torn) = (BTreeMap::new(), 0.0, 0);
        let mut unknown = Vec::new();
        for path in in_folder(&folder, Some(shard))? {
            match read(&path) {
                Content::Kept(kept) if kept.head == head => {
                    seconds += kept.seconds;
                    torn += kept.torn;
                    benches.extend(kept.benches);
                }
                // Of another study; or somebody has only just begun.
                Content::Kept(_) | Content::Nothing => {}
                Content::Unknown(why) => unknown.push(why),
            }
        }
        let path = new_path(&folder, shard);
        let text = serde_json::to_string(&head).map_err(|error| failed(&path)(error.into()))?;
        let first_line = line("", &text);
        let opened = File::create(&path)
            .and_then(|mut file| file.write_all(first_line.as_bytes()).and_then(|()| file.sync_data()).map(|()| file));
        let file = opened.map_err(|source| {
            let _ = fs::remove_file(&path);
            failed(&path)(source)
        })?;
        let state = State { file, pending: String::new(), finished: 0, failure: None };
        let (begun, state) = (Instant::now(), Mutex::new(state));
        Ok(Self { head, first_line, path, benches, seconds, torn, unknown, begun, state })
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

    /// How many lines of theirs were not believed.
    #[must_use]
    pub const fn torn(&self) -> usize {
        self.torn
    }

    /// Journals of the part that are not of this program, and why.
    #[must_use]
    pub fn unknown(&self) -> &[StudyError] {
        &self.unknown
    }

    /// Time that earlier attempts took, s.
    pub(in crate::study) const fn seconds(&self) -> f64 {
        self.seconds
    }

    /// What a bench came to in an earlier attempt.
    pub(in crate::study) fn bench(&self, index: u64) -> Option<&BenchOutcome> {
        self.benches.get(&index)
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
        then(kept)
    }

    /// Writes the whole part, and takes the journals of it away.
    ///
    /// # Errors
    /// [`StudyError::Folder`]; the journals are there still.
    pub fn complete(&self, part: &Part, path: &Path) -> Result<(), StudyError> {
        let mut state = self.state();
        // What cannot be kept is not needed, where the part itself can.
        let _ = state.flush();
        part.write(path)?;
        let folder = self.path.parent().unwrap_or(Path::new("."));
        for journal in in_folder(folder, Some(self.head.shard))? {
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
mod tests {
    use proptest::prelude::*;

    use super::file::Kept;
    use super::*;
    use crate::study::Counts;
    use crate::study::loops::{Aligned, Ended};

    const OPTIONS: StudyOptions = StudyOptions { quick: true, seed: 3, counts: Counts { benches: 8, assemblies: 10 } };

    fn shard() -> Shard {
        "2/2".parse().unwrap()
    }

    fn open(folder: &Path, options: StudyOptions) -> Journal {
        Journal::open(folder, &Config::default(), options, shard()).unwrap()
    }

    fn outcome(bench: u64) -> BenchOutcome {
        let plain = Ended::Aligned(Aligned { delta_v_error_mm: 1.0 / bench as f64, ..Aligned::default() });
        BenchOutcome { plain, ours: Ended::Refused(format!("bench {bench}")) }
    }

    /// A folder in which an attempt has finished these benches and was then killed.
    fn attempted(benches: &[u64]) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let journal = open(folder.path(), OPTIONS);
        for bench in benches {
            journal.finish(*bench, &outcome(*bench)).unwrap();
        }
        assert_eq!(journal.end(Result::unwrap), benches.len() as u64);
        (folder, journal.path)
    }

    #[test]
    fn the_next_attempt_has_what_each_earlier_one_finished() {
        let (folder, _) = attempted(&[7, 4]);
        let second = open(folder.path(), OPTIONS);
        assert_eq!((second.found(), second.torn()), (2, 0));
        second.finish(5, &outcome(5)).unwrap();
        assert_eq!(second.end(Result::unwrap), 3);
        // Also of two that are at it at the same time.
        let (third, fourth) = (open(folder.path(), OPTIONS), open(folder.path(), OPTIONS));
        for journal in [&third, &fourth] {
            assert_eq!(journal.benches.keys().copied().collect::<Vec<_>>(), [4, 5, 7]);
            assert_eq!(journal.bench(5), Some(&outcome(5)));
            assert!(journal.seconds() > 0.0 && journal.bench(6).is_none());
        }
    }

    #[test]
    fn what_another_study_finished_is_neither_believed_nor_taken_away() {
        let (folder, path) = attempted(&[4]);
        let other = open(folder.path(), StudyOptions { seed: 4, ..OPTIONS });
        assert_eq!((other.found(), other.torn()), (0, 0));
        let more = Counts { benches: 9, ..OPTIONS.counts };
        assert_eq!(open(folder.path(), StudyOptions { counts: more, ..OPTIONS }).found(), 0);
        let mut config = Config::default();
        config.assembly.initial_e_mm = 25.0;
        assert_eq!(Journal::open(folder.path(), &config, OPTIONS, shard()).unwrap().found(), 0);
        assert!(path.exists());
    }

    #[test]
    fn a_whole_part_takes_its_journals_away() {
        let (folder, earlier) = attempted(&[4]);
        let (torn, other) = (earlier.with_file_name("part-2-of-2.x.journal"), open(folder.path(), OPTIONS));
        fs::write(&torn, "0123").unwrap();
        let later = earlier.with_file_name("part-2-of-2.y.journal");
        fs::write(&later, line("", r#"{"format":"plenalign-study-journal","format_version":9}"#)).unwrap();
        let damaged = earlier.with_file_name("part-2-of-2.z.journal");
        fs::write(&damaged, fs::read_to_string(&earlier).unwrap().replacen("seed", "sead", 1)).unwrap();
        let strangers = open(folder.path(), StudyOptions { seed: 4, ..OPTIONS });
        let block = |count: u64| {
            let range = shard().range(count);
            (count, range.start, range)
        };
        let (count, first, range) = block(8);
        let benches = super::super::Block { count, first, seconds: 1.0, outcomes: range.map(outcome).collect() };
        let (count, first, range) = block(10);
        let blur = |_| crate::study::assembly::Blur { as_built_mm: 0.1, aligned_mm: 0.0 };
        let assemblies = super::super::Block { count, first, seconds: 1.0, outcomes: range.map(blur).collect() };
        let part = Part::new(&Config::default(), OPTIONS, shard(), benches, assemblies);
        let path = Part::path(folder.path(), shard());
        let last = open(folder.path(), OPTIONS);
        let [of_later, of_damaged] = last.unknown() else { panic!("{:?}", last.unknown()) };
        assert!(
            of_later.to_string().ends_with("version 9 of the format, of which this program reads 1: it is left alone")
        );
        assert!(of_damaged.to_string().contains("z.journal: the journal's first line is damaged"), "{of_damaged}");
        assert_eq!((last.found(), last.torn()), (1, 0));
        last.complete(&part, &path).unwrap();
        let mut left = [strangers.path, later, damaged];
        left.sort();
        assert_eq!(in_folder(&Part::folder(folder.path()), None).unwrap(), left);
        // One that is at it still loses nothing but its journal.
        other.finish(5, &outcome(5)).unwrap();
        other.complete(&part, &path).unwrap();
        assert_eq!(Part::read(&path).unwrap(), part);
    }

    #[test]
    fn a_journal_grows_while_its_part_is_worked_out() {
        let folder = tempfile::tempdir().unwrap();
        let journal = open(folder.path(), OPTIONS);
        let length = || fs::metadata(&journal.path).unwrap().len();
        let before = length();
        let grown = journal.beating_each(Duration::from_millis(1), || {
            let begun = Instant::now();
            while length() == before && begun.elapsed() < 20 * BEAT {
                std::thread::yield_now();
            }
            Ok(length() > before)
        });
        assert!(grown.unwrap());
        assert!(matches!(read(&journal.path), Content::Kept(Kept { torn: 0, .. })));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// Cut off or damaged anywhere: what is believed is what was finished.
        #[test]
        fn nothing_torn_is_believed(cut in 0usize..1800, flip in 0usize..1800, with in 0u8..=255) {
            let (folder, path) = attempted(&[4, 5, 6, 7]);
            let mut bytes = fs::read(&path).unwrap();
            prop_assert!(bytes.len() < 1800 && bytes.len() > 900, "{}", bytes.len());
            if let Some(byte) = bytes.get_mut(flip) {
                *byte ^= with;
            }
            bytes.truncate(cut);
            fs::write(&path, &bytes).unwrap();
            let next = open(folder.path(), OPTIONS);
            for (bench, found) in &next.benches {
                prop_assert_eq!(found, &outcome(*bench));
            }
            prop_assert!(next.found() + next.torn() as u64 <= 5, "{} and {}", next.found(), next.torn());
        }
    }
}
