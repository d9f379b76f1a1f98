//! Journals that are cut off, damaged, of others, and of attempts at the same time.

use proptest::prelude::*;

use super::super::Block;
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
    // One that finished nothing leaves nothing.
    let idle = open(folder.path(), OPTIONS);
    assert_eq!(idle.end(Result::unwrap), 3);
    assert!(!idle.path.exists() && second.path.exists());
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
    let mut config = Config::default();
    config.assembly.initial_e_mm = 25.0;
    assert_eq!(Journal::open(folder.path(), &config, OPTIONS, shard()).unwrap().found(), 0);
    assert!(path.exists());
}

#[test]
fn what_was_finished_in_another_split_is_gone_on_from() {
    // The second of two has 4 to 7.
    let (folder, path) = attempted(&[4, 5, 6]);
    let at = |options, shard: &str| {
        let journal = Journal::open(folder.path(), &Config::default(), options, shard.parse().unwrap()).unwrap();
        assert!(journal.benches.iter().all(|(bench, found)| found.outcome == outcome(*bench)));
        (journal.benches.keys().copied().collect::<Vec<_>>(), journal.elsewhere())
    };
    assert_eq!(at(OPTIONS, "3/4"), (vec![4, 5], 2));
    assert_eq!(at(OPTIONS, "4/4"), (vec![6], 1));
    assert_eq!(at(OPTIONS, "1/1"), (vec![4, 5, 6], 3));
    assert_eq!(at(OPTIONS, "1/4"), (vec![], 0));
    let more = StudyOptions { counts: Counts { benches: 12, ..OPTIONS.counts }, ..OPTIONS };
    assert_eq!(at(more, "1/2"), (vec![4, 5], 2));
    assert_eq!(at(more, "2/2"), (vec![6], 1));
    assert_eq!(at(StudyOptions { seed: 4, ..more }, "1/1"), (vec![], 0));
    // It is another's, who may be at it still; and its own part has nothing from elsewhere.
    assert!(path.exists());
    assert_eq!(at(OPTIONS, "2/2"), (vec![4, 5, 6], 0));
}

/// A folder with the journals of attempts that were at it at the same time: the benches that each has finished, and when.
fn at_once(attempts: &[&[(u64, f64)]]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let journals: Vec<Journal> = attempts.iter().map(|_| open(folder.path(), OPTIONS)).collect();
    for (journal, benches) in journals.iter().zip(attempts) {
        let mut text = journal.first_line.clone();
        for (bench, seconds) in *benches {
            let finished = Finished { bench: *bench, seconds: *seconds, outcome: outcome(*bench) };
            text.push_str(&line(&journal.first_line, &serde_json::to_string(&finished).unwrap()));
        }
        fs::write(&journal.path, text).unwrap();
    }
    folder
}

#[test]
fn a_bench_that_two_attempts_finished_took_its_time_once() {
    let alone = at_once(&[&[(4, 10.0), (5, 21.0)]]);
    assert_eq!(open(alone.path(), OPTIONS).seconds(), 21.0);
    let twice = at_once(&[&[(4, 10.0), (5, 21.0)], &[(4, 10.0), (5, 21.0)]]);
    assert_eq!(open(twice.path(), OPTIONS).seconds(), 21.0);
    // The second bench of the other took 3 s.
    let more = at_once(&[&[(4, 10.0), (5, 21.0)], &[(4, 10.0), (6, 13.0)]]);
    assert_eq!(open(more.path(), OPTIONS).seconds(), 24.0);
}

/// The whole part, as it would be made.
fn whole_part(options: StudyOptions) -> Part {
    let share = |count: u64| (count, shard().range(count));
    let (count, range) = share(options.counts.benches);
    let first = range.start;
    let benches = Block { count, first, seconds: 1.0, outcomes: range.map(outcome).collect() };
    let (count, range) = share(options.counts.assemblies);
    let first = range.start;
    let blur = |_| crate::study::assembly::Blur { as_built_mm: 0.1, aligned_mm: 0.0 };
    let assemblies = Block { count, first, seconds: 1.0, outcomes: range.map(blur).collect() };
    Part::new(&Config::default(), options, shard(), benches, assemblies)
}

#[test]
fn another_studys_part_is_not_replaced_though_it_came_while_this_one_was_made() {
    let (folder, earlier) = attempted(&[4]);
    let path = Part::path(folder.path(), shard());
    let journal = open(folder.path(), OPTIONS);
    let strangers = whole_part(StudyOptions { seed: 4, ..OPTIONS });
    strangers.write(&path).unwrap();
    assert!(!journal.is_complete(&path));
    let error = journal.complete(&whole_part(OPTIONS), &path).unwrap_err().to_string();
    assert!(error.contains("there is part 2/2 of a study (quick, seed 4, "), "{error}");
    assert!(earlier.exists() && Part::read(&path).unwrap() == strangers);
    // What a killed attempt has left of a file is taken away, once there is the whole one.
    let left = path.with_file_name("part-2-of-2.x.partial");
    fs::write(&left, "{").unwrap();
    fs::remove_file(&path).unwrap();
    journal.complete(&whole_part(OPTIONS), &path).unwrap();
    assert!(journal.is_complete(&path) && !left.exists() && !earlier.exists());
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
    let part = whole_part(OPTIONS);
    let path = Part::path(folder.path(), shard());
    let last = open(folder.path(), OPTIONS);
    let [of_later, of_damaged] = last.unknown() else { panic!("{:?}", last.unknown()) };
    assert!(of_later.to_string().ends_with("version 9 of the format, of which this program reads 1: it is left alone"));
    assert!(of_damaged.to_string().contains("z.journal: the journal's first line is damaged"), "{of_damaged}");
    assert_eq!((last.found(), last.torn()), (1, 0));
    last.complete(&part, &path).unwrap();
    let mut left = [strangers.path, later, damaged];
    left.sort();
    assert_eq!(in_folder(&Part::folder(folder.path()), |_| true).unwrap(), left);
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
            prop_assert_eq!(&found.outcome, &outcome(*bench));
        }
        prop_assert!(next.found() + next.torn() as u64 <= 5, "{} and {}", next.found(), next.torn());
    }
}
