//! Entries of the audit log that are not on the disk yet: kept in order for as long as that takes, in bounded memory.

use std::collections::VecDeque;

use jiff::Timestamp;
use serde_json::json;

use super::records::Audit;

/// Entries that are kept at most.
const MOST: usize = 10_000;
/// Bytes of words that are kept at most: an entry may have a whole request in it.
const MOST_BYTES: usize = 8 << 20;
/// Entries that are written in one transaction.
pub(super) const BATCH: usize = 256;

/// What had to be dropped since there was no room.
#[derive(Debug)]
struct Dropped {
    count: u64,
    from: Timestamp,
    until: Timestamp,
}

/// Entries that wait. Where there is no room for more, the newest are dropped, so that nobody pushes out what they did
/// before; how many is an entry in their place.
#[derive(Debug, Default)]
pub(super) struct Backlog {
    entries: VecDeque<Audit>,
    bytes: usize,
    dropped: Option<Dropped>,
}

impl Backlog {
    /// Takes an entry in.
    pub(super) fn push(&mut self, entry: Audit) {
        let bytes = size(&entry);
        if self.entries.len() >= MOST || self.bytes + bytes > MOST_BYTES {
            self.drop_one(entry.at);
            return;
        }
        self.tell_dropped();
        self.bytes += bytes;
        self.entries.push_back(entry);
    }

    fn drop_one(&mut self, at: Timestamp) {
        if let Some(dropped) = &mut self.dropped {
            dropped.count += 1;
            dropped.until = at;
        } else {
            tracing::error!("the audit log takes no more while the history cannot be written: entries are lost");
            self.dropped = Some(Dropped { count: 1, from: at, until: at });
        }
    }

    /// Puts the count of what was dropped behind what is kept.
    fn tell_dropped(&mut self) {
        if let Some(Dropped { count, from, until }) = self.dropped.take() {
            let (who, what) = ("plenalign".to_owned(), "audit.dropped".to_owned());
            let detail = json!({ "count": count, "from": from, "until": until });
            let entry = Audit { at: until, who, what, detail, from: None };
            self.bytes += size(&entry);
            self.entries.push_back(entry);
        }
    }

    /// Whether nothing waits.
    pub(super) fn is_empty(&self) -> bool {
        self.entries.is_empty() && self.dropped.is_none()
    }

    /// The oldest entries, as many as are written at once; they stay until [`Backlog::written`] is told.
    pub(super) fn oldest(&mut self) -> Vec<Audit> {
        if self.entries.len() < BATCH {
            self.tell_dropped();
        }
        self.entries.iter().take(BATCH).cloned().collect()
    }

    /// So many of the oldest are on the disk.
    pub(super) fn written(&mut self, count: usize) {
        for entry in self.entries.drain(..count.min(self.entries.len())) {
            self.bytes = self.bytes.saturating_sub(size(&entry));
        }
    }

    /// Everything that waits, which is nobody's any more.
    pub(super) fn take(&mut self) -> Vec<Audit> {
        self.tell_dropped();
        self.bytes = 0;
        self.entries.drain(..).collect()
    }
}

/// How much of the room an entry takes, bytes.
fn size(entry: &Audit) -> usize {
    size_of::<Audit>() + entry.who.len() + entry.what.len() + entry.detail.to_string().len()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entry(n: usize, bytes: usize) -> Audit {
        let (who, what) = ("Ada".to_owned(), "job.create".to_owned());
        Audit { at: Timestamp::now(), who, what, detail: json!({ "n": n, "note": "x".repeat(bytes) }), from: None }
    }

    #[test]
    fn large_entries_are_bounded_as_well_as_many() {
        let mut backlog = Backlog::default();
        (0..2000).for_each(|n| backlog.push(entry(n, 16 << 10)));
        let first = backlog.take();
        let kept = first.len() - 1;
        assert!(kept * (16 << 10) <= MOST_BYTES && kept > 400, "{kept} are kept");
        assert_eq!(first[kept].detail["count"], 2000 - kept);
        assert!(backlog.is_empty());
        // There is room again, and as much as before.
        (0..2000).for_each(|n| backlog.push(entry(n, 16 << 10)));
        assert_eq!(backlog.take().len(), kept + 1);
    }

    #[test]
    fn what_is_dropped_stands_where_it_would_have_stood() {
        let mut backlog = Backlog::default();
        (0..MOST + 5).for_each(|n| backlog.push(entry(n, 0)));
        assert_eq!(backlog.oldest().len(), BATCH);
        backlog.written(BATCH);
        backlog.push(entry(MOST + 5, 0));
        let mut words = Vec::new();
        while !backlog.is_empty() {
            let batch = backlog.oldest();
            words.extend(batch.iter().map(|entry| entry.what.clone()));
            backlog.written(batch.len());
        }
        assert_eq!(words.len(), MOST - BATCH + 2);
        assert_eq!(words[words.len() - 2..], ["audit.dropped", "job.create"]);
    }
}
