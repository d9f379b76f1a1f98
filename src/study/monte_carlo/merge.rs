//! Parts to the outcomes of all items.

use std::ops::Range;
use std::path::{Path, PathBuf};

use super::part::Origin;
use super::{Block, Counts, Part, Shard};
use crate::config::Config;
use crate::study::assembly::Blur;
use crate::study::loops::BenchOutcome;
use crate::study::{StudyError, StudyOptions};

/// Ranges and parts that a message names, at the most.
const MOST_NAMED: usize = 12;

/// What all items of the Monte Carlos came to.
#[derive(Debug, Clone)]
pub struct Merged {
    options: StudyOptions,
    pub(in crate::study) benches: Block<BenchOutcome>,
    pub(in crate::study) assemblies: Block<Blur>,
}

impl Merged {
    /// The study that the parts are of.
    #[must_use]
    pub const fn options(&self) -> StudyOptions {
        self.options
    }

    /// Time that a chapter's parts took together, s; `None` for a chapter that is no Monte Carlo.
    pub(in crate::study) fn seconds(&self, chapter: &str) -> Option<f64> {
        match chapter {
            "loops" => Some(self.benches.seconds),
            "assembly" => Some(self.assemblies.seconds),
            _ => None,
        }
    }
}

/// Puts parts together, in whatever order they come: each with the file that it was read from.
///
/// # Errors
/// [`StudyError::Part`] for a part of another study, program or configuration, [`StudyError::Merge`] where items are held
/// by two parts, or by none.
pub fn merge(parts: Vec<(PathBuf, Part)>, config: &Config) -> Result<Merged, StudyError> {
    let Some((first, part)) = parts.first() else {
        return Err(StudyError::Merge("there is no part".to_owned()));
    };
    let counts = Counts { benches: part.benches.count, assemblies: part.assemblies.count };
    let options = StudyOptions { quick: part.origin.quick, seed: part.origin.seed, counts };
    let here = Origin::of(config, options);
    for (path, other) in &parts {
        if let Some(why) = stranger(other, &here, counts, first) {
            return Err(StudyError::Part { path: path.display().to_string(), why });
        }
    }
    let shards: Vec<Shard> = parts.iter().map(|(_, part)| part.shard).collect();
    let (mut benches, mut assemblies) = (Vec::new(), Vec::new());
    for (path, part) in parts {
        benches.push((path.clone(), part.benches));
        assemblies.push((path, part.assemblies));
    }
    let benches = in_order(benches, "benches")?;
    let assemblies = in_order(assemblies, "assemblies")?;
    let mut missing = gaps(&benches, "benches", counts.benches);
    missing.extend(gaps(&assemblies, "assemblies", counts.assemblies));
    if !missing.is_empty() {
        return Err(StudyError::Merge(format!("no part has {}{}", some(missing, " or "), without(&shards))));
    }
    Ok(Merged { options, benches: joined(benches, counts.benches), assemblies: joined(assemblies, counts.assemblies) })
}

/// Why a part does not belong to the others, the first of which is `first`, or not to this program as it is set.
fn stranger(part: &Part, here: &Origin, counts: Counts, first: &Path) -> Option<String> {
    let (origin, first) = (&part.origin, first.display());
    if origin.program_version != here.program_version {
        return Some(format!(
            "made by plenalign {}, and this is plenalign {}: merge with the program that made the parts, or have them made \
             again",
            origin.program_version, here.program_version
        ));
    }
    if origin.configuration_sha256 != here.configuration_sha256 {
        return Some(format!(
            "made with another configuration than this one (SHA-256 {:.12}…, here {:.12}…): merge with the --config and \
             --set that the parts were made with",
            origin.configuration_sha256, here.configuration_sha256
        ));
    }
    if origin.seed != here.seed {
        return Some(format!("made with seed {}, but {first} with seed {}", origin.seed, here.seed));
    }
    if origin.quick != here.quick {
        let made = |quick| if quick { "with --quick" } else { "without --quick" };
        return Some(format!("made {}, but {first} {}", made(origin.quick), made(here.quick)));
    }
    [("benches", part.benches.count, counts.benches), ("assemblies", part.assemblies.count, counts.assemblies)]
        .into_iter()
        .find(|(_, count, of)| count != of)
        .map(|(what, count, of)| format!("a part of {count} {what}, but {first} of {of}"))
}

/// Blocks that hold anything, by their indices, each of which only one may have.
fn in_order<T>(mut blocks: Vec<(PathBuf, Block<T>)>, what: &str) -> Result<Vec<Block<T>>, StudyError> {
    blocks.retain(|(_, block)| !block.outcomes.is_empty());
    blocks.sort_by_key(|(_, block)| block.first);
    for pair in blocks.windows(2) {
        if let [(before, earlier), (after, later)] = pair
            && later.first < earlier.range().end
        {
            let both = later.first..earlier.range().end.min(later.range().end);
            let (before, after) = (before.display(), after.display());
            return Err(StudyError::Merge(format!("{before} and {after} both have {}", indices(what, &both))));
        }
    }
    Ok(blocks.into_iter().map(|(_, block)| block).collect())
}

/// The indices that no block has.
fn gaps<T>(blocks: &[Block<T>], what: &str, count: u64) -> Vec<String> {
    let ends = blocks.iter().map(|block| block.range().end);
    let starts = blocks.iter().map(|block| block.first);
    std::iter::once(0)
        .chain(ends)
        .zip(starts.chain(std::iter::once(count)))
        .filter(|(end, start)| end < start)
        .map(|(end, start)| indices(what, &(end..start)))
        .collect()
}

/// Which shards are missing, where all that are there are of the same number of them.
fn without(shards: &[Shard]) -> String {
    let of = shards.first().map_or(0, |shard| shard.of());
    if shards.iter().any(|shard| shard.of() != of) {
        return String::new();
    }
    // One that no item falls to may be missing, too: it is named, since nobody knows better.
    let missing = (1..=of).filter(|number| shards.iter().all(|shard| shard.number() != *number));
    let missing = missing.take(MOST_NAMED + 1).map(|number| format!("{number}/{of}")).collect();
    format!("; not there: {}", some(missing, ", "))
}

/// As many of these as can be read in a line.
fn some(mut all: Vec<String>, between: &str) -> String {
    let more = if all.len() > MOST_NAMED { " and others" } else { "" };
    all.truncate(MOST_NAMED);
    format!("{}{more}", all.join(between))
}

/// `benches 25 to 49`.
fn indices(what: &str, range: &Range<u64>) -> String {
    format!("{what} {} to {}", range.start, range.end.saturating_sub(1))
}

/// All items in one block.
fn joined<T>(blocks: Vec<Block<T>>, count: u64) -> Block<T> {
    let mut all = Block { count, first: 0, seconds: 0.0, outcomes: Vec::new() };
    for block in blocks {
        all.seconds += block.seconds;
        all.outcomes.extend(block.outcomes);
    }
    all
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::part::ending;
    use super::*;
    use crate::study::loops::{Aligned, Ended, Taken};

    const OPTIONS: StudyOptions =
        StudyOptions { quick: true, seed: 3, counts: Counts { benches: 3, assemblies: 1001 } };

    /// A part with outcomes that say which item they are of.
    fn part(shard: &str, options: StudyOptions) -> (PathBuf, Part) {
        let shard: Shard = shard.parse().unwrap();
        let block = |count: u64| (shard.range(count), count);
        let (benches, count) = block(options.counts.benches);
        let bench = |index: u64| {
            let taken = Taken { moves: index as u32, travel_mm: 0.1 * index as f64, ..Taken::default() };
            let aligned = Aligned { air: taken, delta_v_error_mm: f64::NAN, ..Aligned::default() };
            BenchOutcome { plain: Ended::Aligned(aligned), ours: Ended::Refused(format!("bench {index}: \"dark\"")) }
        };
        let seconds = 0.5 * (benches.end - benches.start) as f64;
        let benches = Block { count, first: benches.start, seconds, outcomes: benches.map(bench).collect() };
        let (range, count) = block(options.counts.assemblies);
        let blur = |index: u64| Blur { as_built_mm: (index as f64).sqrt(), aligned_mm: 1.0 / index as f64 };
        let assemblies = Block { count, first: range.start, seconds: 0.25, outcomes: range.map(blur).collect() };
        let part = Part::new(&Config::default(), options, shard, benches, assemblies);
        (PathBuf::from(format!("part-{shard}")), part)
    }

    fn why(parts: Vec<(PathBuf, Part)>) -> String {
        merge(parts, &Config::default()).unwrap_err().to_string()
    }

    #[test]
    fn parts_are_all_items_in_order_through_their_files_too() {
        let folder = tempfile::tempdir().unwrap();
        let whole = merge(vec![part("1/1", OPTIONS)], &Config::default()).unwrap();
        for shards in [&["2/2", "1/2"][..], &["4/5", "1/5", "5/5", "2/5", "3/5"], &["4/4", "1/2", "3/4"]] {
            let parts = shards.iter().map(|shard| {
                let (_, part) = part(shard, OPTIONS);
                let path = Part::path(folder.path(), part.shard());
                part.write(&path).unwrap();
                let read = Part::read(&path).unwrap();
                (path, read)
            });
            let merged = merge(parts.collect(), &Config::default()).unwrap();
            assert_eq!(merged.options(), OPTIONS);
            // As text: not a number is like no other.
            assert_eq!(format!("{:?}", merged.benches.outcomes), format!("{:?}", whole.benches.outcomes));
            assert_eq!(merged.assemblies.outcomes.len(), 1001);
            for (a, b) in merged.assemblies.outcomes.iter().zip(&whole.assemblies.outcomes) {
                assert_eq!(
                    [a.as_built_mm, a.aligned_mm].map(f64::to_bits),
                    [b.as_built_mm, b.aligned_mm].map(f64::to_bits)
                );
            }
            assert_eq!(merged.seconds("loops"), Some(1.5));
        }
        assert_eq!(Part::in_folder(&Part::folder(folder.path())).unwrap().len(), 9);
    }

    #[test]
    fn what_does_not_belong_together_is_named() {
        let other = |change: &dyn Fn(&mut StudyOptions)| {
            let mut options = OPTIONS;
            change(&mut options);
            vec![part("1/2", OPTIONS), part("2/2", options)]
        };
        let seed = why(other(&|options| options.seed = 4));
        assert!(seed.contains("part-2/2: made with seed 4, but part-1/2 with seed 3"), "{seed}");
        let quick = why(other(&|options| options.quick = false));
        assert!(quick.contains("without --quick, but part-1/2 with --quick"), "{quick}");
        let fewer = why(other(&|options| options.counts.assemblies = 10));
        assert!(fewer.contains("a part of 10 assemblies, but part-1/2 of 1001"), "{fewer}");

        let mut config = Config::default();
        config.assembly.initial_e_mm = 25.0;
        let another = merge(vec![part("1/1", OPTIONS)], &config).unwrap_err().to_string();
        assert!(another.contains("part-1/1: made with another configuration"), "{another}");
        let mut old = part("1/1", OPTIONS);
        old.1.origin.program_version = "0.0.9".to_owned();
        let old = why(vec![old]);
        assert!(old.contains("made by plenalign 0.0.9, and this is"), "{old}");
    }

    #[test]
    fn items_are_there_once() {
        let none = why(Vec::new());
        assert!(none.contains("there is no part"), "{none}");
        let twice = why(vec![part("1/2", OPTIONS), part("2/2", OPTIONS), part("2/3", OPTIONS)]);
        assert!(twice.contains("both have benches 1 to 1"), "{twice}");
        let twice = why(vec![part("1/1", OPTIONS), part("1/1", OPTIONS)]);
        assert!(twice.contains("part-1/1 and part-1/1 both have benches 0 to 2"), "{twice}");
        let gap = why(vec![part("4/4", OPTIONS), part("1/4", OPTIONS)]);
        assert!(gap.contains("no part has benches 0 to 1 or assemblies 250 to 749; not there: 2/4, 3/4"), "{gap}");
        let mixed = why(vec![part("1/2", OPTIONS), part("4/4", OPTIONS)]);
        assert!(mixed.ends_with("no part has benches 1 to 1 or assemblies 500 to 749"), "{mixed}");
    }

    #[test]
    fn what_is_no_part_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let (_, good) = part("2/3", OPTIONS);
        let path = folder.path().join("part.json");
        good.write(&path).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let (before, _) = text.split_at(text.len() - ending(&[]).len());
        // As if it had been written so.
        let changed = |from: &str, to: &str| {
            assert_eq!(before.matches(from).count(), 1, "{from}");
            let changed = before.replacen(from, to, 1);
            format!("{changed}{}", ending(changed.as_bytes()))
        };
        let broken = [
            (String::new(), "not a part"),
            ("{}".to_owned(), "its format is \"\""),
            (changed("plenalign-study-part", "other"), "its format is \"other\""),
            (changed("\"format_version\":2", "\"format_version\":1"), "of version 1 of the format"),
            (text[..text.len() / 2].to_owned(), "not a part: "),
            (changed("\"shard\":\"2/3\"", "\"shard\":\"2/4\""), "part 2/4 of 3 benches is items 0 to 1"),
            (changed("\"shard\":\"2/3\"", "\"shard\":\"9/3\""), "the last one is 3/3"),
            (changed("\"first\":1,", "\"first\":18446744073709551615,"), "part 2/3 of 3 benches"),
            (changed("\"seed\"", "\"sead\""), "not a whole part: unknown field `sead`"),
            (text.replacen("0.1", "0.2", 1), "damaged: it does not end with the SHA-256 of what it holds"),
            (format!("{text}\n"), "damaged: "),
            (format!("{before}}}"), "damaged: "),
        ];
        for (text, says) in broken {
            std::fs::write(&path, text).unwrap();
            let error = Part::read(&path).unwrap_err().to_string();
            assert!(error.contains("part.json: ") && error.contains(says), "{says}: {error}");
        }
        assert!(
            Part::read(&folder.path().join("none.json")).unwrap_err().to_string().contains("none.json: No such file")
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        /// Wherever a bit is not what it was.
        #[test]
        fn nothing_damaged_is_believed(at: proptest::sample::Index, bit in 0u32..8) {
            let folder = tempfile::tempdir().unwrap();
            let counts = Counts { assemblies: 10, ..OPTIONS.counts };
            let (_, good) = part("1/2", StudyOptions { counts, ..OPTIONS });
            let path = folder.path().join("part.json");
            good.write(&path).unwrap();
            let mut bytes = std::fs::read(&path).unwrap();
            let at = at.index(bytes.len());
            bytes[at] ^= 1 << bit;
            std::fs::write(&path, bytes).unwrap();
            prop_assert!(Part::read(&path).is_err());
        }
    }

    #[test]
    fn only_the_same_part_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let (_, part) = part("2/3", OPTIONS);
        let path = Part::path(folder.path(), part.shard());
        let config = Config::default();
        assert_eq!(Part::kept(&path, &config, OPTIONS, part.shard()).unwrap(), None);
        part.write(&path).unwrap();
        let kept = |options| Part::kept(&path, &config, options, part.shard());
        assert!(kept(OPTIONS).unwrap().is_some());
        let another = Part::kept(&path, &config, OPTIONS, "3/3".parse().unwrap()).unwrap_err().to_string();
        assert!(
            another.contains("there is part 2/3 of a study") && another.contains("this is part 3/3 of one"),
            "{another}"
        );
        for other in [
            StudyOptions { seed: 4, ..OPTIONS },
            StudyOptions { counts: Counts { benches: 4, ..OPTIONS.counts }, ..OPTIONS },
        ] {
            assert!(kept(other).unwrap_err().to_string().contains("there is part 2/3 of a study (quick, seed 3, "));
        }
        // Nothing but the part is left in the folder.
        assert_eq!(std::fs::read_dir(Part::folder(folder.path())).unwrap().count(), 1);
    }
}
