//! Where the slides stand that a stage's twin, a program of its own, moves: read along from its record.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::path::PathBuf;
use std::str::FromStr;

use crate::device::AxisName;

/// A slide in motion is told at least so often, µs: between two motions that are further apart it stood.
const TOLD_EVERY_US: i64 = 10_000;
/// How far back places are kept, µs: what a frame may be exposed before it is asked where the slides stood.
const KEPT_US: i64 = 10_000_000;

/// By so many of its first bytes a record is told from another.
const HEAD_BYTES: u64 = 64;

/// A record of slides: a file that `plenalign sim-stage --record` writes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SlideRecord {
    path: PathBuf,
    /// The axis of a stage that has but one; otherwise the bench's axes in their order.
    only: Option<AxisName>,
}

impl FromStr for SlideRecord {
    type Err = String;

    /// `FILE`, of a controller with both axes; `focus=FILE` or `e=FILE`, of one with that axis only.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        for axis in AxisName::ALL {
            if let Some(path) = text.strip_prefix(&format!("{axis}=")) {
                return Ok(Self { path: path.into(), only: Some(axis) });
            }
        }
        if text.is_empty() { Err("no file is named".to_owned()) } else { Ok(Self { path: text.into(), only: None }) }
    }
}

/// Slides that are followed.
#[derive(Debug)]
pub(super) struct Slides {
    records: Vec<Followed>,
    /// Where each axis stood, and when (µs since 1970), the newest last.
    tracks: [VecDeque<(i64, f64)>; 2],
}

#[derive(Debug)]
struct Followed {
    record: SlideRecord,
    read: u64,
    /// The beginning of a line.
    begun: String,
    /// How the record begins: with a moment, which no other begins with.
    head: Vec<u8>,
}

impl Slides {
    pub(super) fn new(records: Vec<SlideRecord>) -> Self {
        let records =
            records.into_iter().map(|record| Followed { record, read: 0, begun: String::new(), head: Vec::new() });
        Self { records: records.collect(), tracks: Default::default() }
    }

    /// Reads what has been written since. A record that is not there yet, or not at the moment, is waited for.
    pub(super) fn follow(&mut self) {
        for followed in &mut self.records {
            let lines = match followed.lines() {
                Ok(lines) => lines,
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                Err(error) => {
                    tracing::error!(path = %followed.record.path.display(), %error, "a stage's record cannot be read");
                    continue;
                }
            };
            for line in lines.lines() {
                let Some((at, axis, mm)) = told(line, followed.record.only) else { continue };
                let track = &mut self.tracks[axis as usize];
                track.push_back((at, mm));
                // One from before what is kept says where the slide stood then.
                while track.get(1).is_some_and(|&(then, _)| then < at - KEPT_US) {
                    track.pop_front();
                }
            }
        }
    }

    /// Where a slide stood at a moment, mm; `None` where nothing has been told of it.
    pub(super) fn at(&self, axis: AxisName, moment: i64) -> Option<f64> {
        let track = &self.tracks[axis as usize];
        let after = track.partition_point(|&(at, _)| at <= moment);
        let Some(&(then, from)) = after.checked_sub(1).and_then(|before| track.get(before)) else {
            return track.front().map(|&(_, mm)| mm);
        };
        let Some(&(next, to)) = track.get(after) else { return Some(from) };
        let began = then.max(next - TOLD_EVERY_US);
        let share = (moment - began) as f64 / (next - began).max(1) as f64;
        Some(from + (to - from) * share.clamp(0.0, 1.0))
    }

    /// When a slide was last told to have moved.
    pub(super) fn moved_at(&self, axis: AxisName) -> Option<i64> {
        self.tracks[axis as usize].back().map(|&(at, _)| at)
    }
}

impl Followed {
    /// The whole lines that are new.
    fn lines(&mut self) -> io::Result<String> {
        let mut file = File::open(&self.record.path)?;
        let mut head = Vec::new();
        file.by_ref().take(HEAD_BYTES).read_to_end(&mut head)?;
        if !head.starts_with(&self.head) {
            // Begun anew: the stage was.
            (self.read, self.begun) = (0, String::new());
        }
        self.head = head;
        file.seek(SeekFrom::Start(self.read))?;
        self.read += file.read_to_string(&mut self.begun)? as u64;
        let whole = self.begun.rfind('\n').map_or(0, |end| end + 1);
        let rest = self.begun.split_off(whole);
        Ok(std::mem::replace(&mut self.begun, rest))
    }
}

/// What a line of a record tells: when, of which axis, its place in mm.
fn told(line: &str, only: Option<AxisName>) -> Option<(i64, AxisName, f64)> {
    let mut words = line.split(' ');
    let (at, number, mm) =
        (words.next()?.parse().ok()?, words.next()?.parse::<usize>().ok()?, words.next()?.parse().ok()?);
    let axis = match (only, number) {
        (Some(axis), 0) => axis,
        (Some(_), _) => return None,
        (None, number) => *AxisName::ALL.get(number)?,
    };
    Some((at, axis, mm))
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    #[test]
    fn slides_are_where_their_record_has_them_also_between_two_lines() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("record");
        let mut slides = Slides::new(vec![path.to_str().unwrap().parse().unwrap()]);
        slides.follow();
        assert_eq!(slides.at(AxisName::E, 0), None);
        let mut file = File::create(&path).unwrap();
        file.write_all(b"1000000 0 1.0\n1000000 1 20.0\n2000000 0 2.0\n2008000 0 4.0\n20080").unwrap();
        slides.follow();
        let at = |slides: &Slides, moment| slides.at(AxisName::Focus, moment).unwrap();
        assert_eq!(at(&slides, 900_000), 1.0);
        // It stood until it began to move, at most 10 ms before it was told.
        assert_eq!([at(&slides, 1_500_000), at(&slides, 1_995_000), at(&slides, 2_004_000)], [1.0, 1.5, 3.0]);
        assert_eq!(at(&slides, 9_000_000), 4.0);
        assert_eq!(slides.at(AxisName::E, 9_000_000), Some(20.0));
        file.write_all(b"00 1 21.0\n").unwrap();
        slides.follow();
        assert_eq!(slides.moved_at(AxisName::E), Some(2_008_000));
        // A stage that was started again begins its record anew; it may have written more already than before.
        File::create(&path).unwrap().write_all(b"3000000 1 25.0\n").unwrap();
        slides.follow();
        assert_eq!(slides.at(AxisName::E, 3_000_000), Some(25.0));
        let anew: String = (4..20).map(|s| format!("{s}000000 1 {s}.0\n")).collect();
        File::create(&path).unwrap().write_all(anew.as_bytes()).unwrap();
        slides.follow();
        assert_eq!([12_000_000, 19_000_000].map(|at| slides.at(AxisName::E, at)), [Some(12.0), Some(19.0)]);
    }

    #[test]
    fn the_record_of_a_stage_with_one_axis_is_named_by_it() {
        let record: SlideRecord = "e=/tmp/lens".parse().unwrap();
        assert_eq!((record.path.to_str(), record.only), (Some("/tmp/lens"), Some(AxisName::E)));
        assert_eq!(told("5 0 1.5", record.only), Some((5, AxisName::E, 1.5)));
        assert_eq!(told("5 1 1.5", record.only), None);
        assert_eq!(told("5 2 1.5", None), None);
        assert!("".parse::<SlideRecord>().is_err());
    }
}
