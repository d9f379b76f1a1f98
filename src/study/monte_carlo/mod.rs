//! The study's Monte Carlos: items that are drawn and judged one by one, each by its index and the study's seed alone, so
//! that they may be worked out by several machines, and put together afterwards.
//!
//! ```text
//!   shard.rs   which of how many parts
//!   part.rs    the file that holds what a part's items came to
//!   naming.rs  giving it its name, where no other file has that
//!   journal/   what a part has finished while it is not whole
//!   status.rs  which parts are done, running, missing, and how long the rest takes
//!   merge.rs   parts to the outcomes of all items
//!   exact.rs   numbers in these files, to the last bit
//! ```

pub(super) mod exact;
mod journal;
mod merge;
mod naming;
mod part;
mod shard;
mod status;

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use journal::Journal;
pub use merge::{Merged, merge};
pub use part::Part;
pub use shard::Shard;
pub use status::{PartStatus, State, Status, status};

use super::{StudyError, Watch};

/// How many items the Monte Carlos have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counts {
    /// Benches that both loops are run on.
    pub benches: u64,
    /// Assemblies of which the yield is taken.
    pub assemblies: u64,
}

impl Counts {
    /// The most benches that a study may have: a frame of each is rendered some thirty times.
    pub const MOST_BENCHES: u64 = 100_000;
    /// The most assemblies that a study may have: all of them are held in memory, and in the parts' files.
    pub const MOST_ASSEMBLIES: u64 = 10_000_000;

    /// As many as a study has that is told nothing else.
    #[must_use]
    pub const fn usual(quick: bool) -> Self {
        match quick {
            true => Self { benches: 4, assemblies: 4000 },
            false => Self { benches: 100, assemblies: 200_000 },
        }
    }

    /// How many items a chapter is made of, by its name; `None` for a chapter that is no Monte Carlo.
    pub(super) fn of(self, chapter: &str) -> Option<u64> {
        match chapter {
            "loops" => Some(self.benches),
            "assembly" => Some(self.assemblies),
            _ => None,
        }
    }
}

/// What consecutive items of a Monte Carlo came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Block<T> {
    /// How many items the whole Monte Carlo has.
    pub(crate) count: u64,
    /// Index of the first item here, from 0.
    pub(crate) first: u64,
    /// Wall time that they took, s.
    pub(crate) seconds: f64,
    /// What they came to, in the order of their indices.
    pub(crate) outcomes: Vec<T>,
}

impl<T> Block<T> {
    /// The indices of its items.
    pub(crate) fn range(&self) -> Range<u64> {
        self.first..self.first.saturating_add(self.outcomes.len() as u64)
    }
}

/// Draws and judges the items of these indices, of so many in all, wherever a processor is free, and has them in order.
pub(super) fn judged<T: Send>(
    indices: Range<u64>,
    count: u64,
    watch: &dyn Watch,
    judge: impl Fn(u64) -> Result<T, StudyError> + Sync,
) -> Result<Block<T>, StudyError> {
    let start = Instant::now();
    let items = indices.end.saturating_sub(indices.start);
    // Told some hundred times, however many items there are.
    let between = (items / 100).max(1);
    let finished = AtomicU64::new(0);
    watch.done(0, items);
    let outcomes = (0..items as usize)
        .into_par_iter()
        .map(|offset| {
            let outcome = judge(indices.start + offset as u64)?;
            let done = finished.fetch_add(1, Ordering::Relaxed) + 1;
            if done.is_multiple_of(between) || done == items {
                watch.done(done, items);
            }
            Ok(outcome)
        })
        .collect::<Result<Vec<T>, StudyError>>()?;
    Ok(Block { count, first: indices.start, seconds: start.elapsed().as_secs_f64(), outcomes })
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Unwatched;

    impl Watch for Unwatched {
        fn chapter(&self, _: usize, _: usize, _: &str, _: super::super::Source) {}
        fn done(&self, _: u64, _: u64) {}
    }

    #[test]
    fn items_come_in_order_whoever_works_them_out() {
        let all = judged(40..1040, 2000, &Unwatched, |index| Ok(index * index)).unwrap();
        assert_eq!((all.count, all.range()), (2000, 40..1040));
        assert!(all.outcomes.iter().zip(40u64..).all(|(outcome, index)| *outcome == index * index));
        let none = judged(7..7, 10, &Unwatched, |_| Err::<u64, _>(StudyError::unseen("nothing", "empty"))).unwrap();
        assert!(none.outcomes.is_empty() && none.range() == (7..7));
        assert!(
            judged(0..9, 9, &Unwatched, |index| match index {
                5 => Err(StudyError::unseen("an item", "dark")),
                other => Ok(other),
            })
            .is_err()
        );
    }
}
