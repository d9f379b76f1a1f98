//! The file that holds what a part's items came to.

use std::fs;
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use uuid::Uuid;

use super::{Block, Shard, naming};
use crate::config::Config;
use crate::study::assembly::Blur;
use crate::study::loops::BenchOutcome;
use crate::study::{StudyError, StudyOptions};

/// What says that a file is a part.
const FORMAT: &str = "plenalign-study-part";
/// The version of the file's layout; it rises with every change of it.
const FORMAT_VERSION: u64 = 2;
/// The folder of parts in a study's folder.
const FOLDER: &str = "parts";
/// How the names of files end that are not whole yet.
const PARTIAL: &str = ".partial";

/// What the items of a part came to, and what it was made from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Part {
    format: String,
    format_version: u64,
    pub(super) shard: Shard,
    pub(super) origin: Origin,
    pub(super) benches: Block<BenchOutcome>,
    pub(super) assemblies: Block<Blur>,
}

/// What a part was made from. Only parts of the same origin belong together.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Origin {
    /// Version of this program.
    pub(super) program_version: String,
    /// SHA-256 of the configuration in force, as JSON.
    pub(super) configuration_sha256: String,
    pub(super) quick: bool,
    pub(super) seed: u64,
}

/// What every version of a part's file begins with, and of its journals.
#[derive(Deserialize)]
pub(super) struct Beginning {
    #[serde(default)]
    pub(super) format: String,
    #[serde(default)]
    pub(super) format_version: u64,
}

/// What a part's file ends with, by all that is before it there.
pub(super) fn ending(text: &[u8]) -> String {
    format!(r#","sha256":"{}"}}"#, hexadecimal(text))
}

/// The SHA-256 of some bytes.
fn hexadecimal(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// What a part's file, and those beside it while it is made, are named before the first point.
pub(super) fn stem(shard: Shard) -> String {
    format!("part-{}-of-{}", shard.number(), shard.of())
}

/// The files in a folder whose names begin and end like this, by their names.
pub(super) fn named(folder: &Path, begin: &str, end: &str) -> Result<Vec<PathBuf>, StudyError> {
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed(folder))? {
        let path = entry.map_err(failed(folder))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if name.starts_with(begin) && name.ends_with(end) {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

/// Has the names in a folder come through a power cut, where its file system can do that.
pub(super) fn keep_names(folder: &Path) {
    // What the files hold is safe by itself; more than ask for this cannot be done.
    let _ = fs::File::open(folder).and_then(|folder| folder.sync_all());
}

/// Opens a file to read it. What has a file's name and is a pipe would keep who opens it waiting for ever.
pub(super) fn opened(path: &Path) -> io::Result<fs::File> {
    // A folder says by itself that it is one.
    let kind = fs::metadata(path)?.file_type();
    if kind.is_file() || kind.is_dir() {
        return fs::File::open(path);
    }
    Err(io::Error::other("it is no file, but a pipe or a device: move it away"))
}

/// What a file holds.
pub(super) fn contents(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    opened(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// What could not be done with a file or folder.
pub(super) fn failed(path: &Path) -> impl FnOnce(std::io::Error) -> StudyError {
    let path = path.display().to_string();
    move |source| StudyError::Folder { path, source }
}

impl Origin {
    pub(super) fn of(config: &Config, options: StudyOptions) -> Self {
        let text = serde_json::to_vec(config).unwrap_or_default();
        Self {
            program_version: env!("CARGO_PKG_VERSION").to_owned(),
            configuration_sha256: hexadecimal(&text),
            quick: options.quick,
            seed: options.seed,
        }
    }

    /// What it is, for whoever has to tell two apart.
    fn in_words(&self, [benches, assemblies]: [u64; 2]) -> String {
        let quick = if self.quick { "quick, " } else { "" };
        format!(
            "{quick}seed {}, {benches} benches, {assemblies} assemblies, plenalign {}, configuration {:.12}…",
            self.seed, self.program_version, self.configuration_sha256
        )
    }
}

impl Part {
    pub(in crate::study) fn new(
        config: &Config,
        options: StudyOptions,
        shard: Shard,
        benches: Block<BenchOutcome>,
        assemblies: Block<Blur>,
    ) -> Self {
        Self {
            format: FORMAT.to_owned(),
            format_version: FORMAT_VERSION,
            shard,
            origin: Origin::of(config, options),
            benches,
            assemblies,
        }
    }

    /// Which part it is.
    #[must_use]
    pub const fn shard(&self) -> Shard {
        self.shard
    }

    /// The indices of its benches and of its assemblies.
    #[must_use]
    pub fn ranges(&self) -> [std::ops::Range<u64>; 2] {
        [self.benches.range(), self.assemblies.range()]
    }

    /// Where the part of a study is kept, by the study's folder.
    #[must_use]
    pub fn path(folder: &Path, shard: Shard) -> PathBuf {
        folder.join(FOLDER).join(format!("{}.json", stem(shard)))
    }

    /// The folder of parts in a study's folder.
    #[must_use]
    pub fn folder(study: &Path) -> PathBuf {
        study.join(FOLDER)
    }

    /// The parts in a folder, by their names.
    ///
    /// # Errors
    /// [`StudyError::Folder`].
    pub fn in_folder(folder: &Path) -> Result<Vec<PathBuf>, StudyError> {
        named(folder, "part-", ".json")
    }

    /// Reads a part.
    ///
    /// # Errors
    /// [`StudyError::Folder`] for a file that cannot be read, [`StudyError::Part`] for one that is no part.
    pub fn read(path: &Path) -> Result<Self, StudyError> {
        let wrong = |why: String| StudyError::Part { path: path.display().to_string(), why };
        let mut text = contents(path).map_err(failed(path))?;
        let head: Beginning = serde_json::from_slice(&text).map_err(|error| wrong(format!("not a part: {error}")))?;
        if head.format != FORMAT {
            return Err(wrong(format!("not a part: its format is \"{}\", not \"{FORMAT}\"", head.format)));
        }
        if head.format_version != FORMAT_VERSION {
            let version = head.format_version;
            return Err(wrong(format!(
                "of version {version} of the format, of which this program reads {FORMAT_VERSION}: have the part made \
                 again, or merge with the program that made it"
            )));
        }
        let end = text.len().saturating_sub(ending(&[]).len());
        if text[end..] != *ending(&text[..end]).as_bytes() {
            return Err(wrong("damaged: it does not end with the SHA-256 of what it holds".to_owned()));
        }
        text.truncate(end);
        text.push(b'}');
        let part: Self = serde_json::from_slice(&text).map_err(|error| wrong(format!("not a whole part: {error}")))?;
        for (what, count, range) in [
            ("benches", part.benches.count, part.benches.range()),
            ("assemblies", part.assemblies.count, part.assemblies.range()),
        ] {
            let share = part.shard.range(count);
            if range != share {
                return Err(wrong(format!(
                    "part {} of {count} {what} is items {} to {} (the last left out), but the file has {} to {}",
                    part.shard, share.start, share.end, range.start, range.end
                )));
            }
        }
        Ok(part)
    }

    /// The part at this place if it is there; `None` where there is none.
    ///
    /// # Errors
    /// As [`Part::read`], but for a file that is not there; [`StudyError::Part`] for a part of another study.
    pub fn kept(path: &Path, config: &Config, options: StudyOptions, shard: Shard) -> Result<Option<Self>, StudyError> {
        let counts = [options.counts.benches, options.counts.assemblies];
        Self::there(path, shard, &Origin::of(config, options), counts)
    }

    /// The part at this place, as [`Part::kept`], by its number, what it is made from, and how many benches and assemblies
    /// its study has.
    pub(super) fn there(
        path: &Path,
        shard: Shard,
        asked: &Origin,
        counts: [u64; 2],
    ) -> Result<Option<Self>, StudyError> {
        let wrong = |why: String| StudyError::Part { path: path.display().to_string(), why };
        let part = match Self::read(path) {
            Ok(part) => part,
            Err(StudyError::Folder { source, .. }) if source.kind() == ErrorKind::NotFound => return Ok(None),
            Err(StudyError::Part { why, .. }) => {
                return Err(wrong(format!("{why}; move it away to have it made again")));
            }
            Err(error) => return Err(error),
        };
        if part.shard == shard && part.is_of(asked, counts) {
            return Ok(Some(part));
        }
        Err(wrong(format!(
            "there is part {} of a study ({}), and this is part {shard} of one ({}): move it away, or write into another \
             folder by --out",
            part.shard,
            part.origin.in_words(part.counts()),
            asked.in_words(counts)
        )))
    }

    fn is_of(&self, origin: &Origin, counts: [u64; 2]) -> bool {
        self.origin == *origin && self.counts() == counts
    }

    /// How many benches and assemblies its study has.
    const fn counts(&self) -> [u64; 2] {
        [self.benches.count, self.assemblies.count]
    }

    /// Checks that no part of the same study is there which was split into another number of parts: the two would not fit.
    ///
    /// # Errors
    /// [`StudyError::Part`] where one is.
    pub fn check_split(study: &Path, config: &Config, options: StudyOptions, shard: Shard) -> Result<(), StudyError> {
        let folder = Self::folder(study);
        if !folder.try_exists().map_err(failed(&folder))? {
            return Ok(());
        }
        let (end, origin) = (format!("-of-{}.json", shard.of()), Origin::of(config, options));
        let counts = [options.counts.benches, options.counts.assemblies];
        for path in Self::in_folder(&folder)?.into_iter().filter(|path| !path.to_string_lossy().ends_with(&end)) {
            let Ok(part) = Self::read(&path) else { continue };
            let of = part.shard.of();
            if of != shard.of() && part.is_of(&origin, counts) {
                let why = format!(
                    "it is one of {of} parts of this study, and {shard} would be one of {}: ask for the part by its number of \
                     {of} (under Slurm with SHARDS and FIRST), or move the others away",
                    shard.of()
                );
                return Err(StudyError::Part { path: path.display().to_string(), why });
            }
        }
        Ok(())
    }

    /// Writes the part, whole or not at all, and makes its folder where it is not there. One of the same part that is there
    /// already is kept, also where it came meanwhile.
    ///
    /// # Errors
    /// As [`Part::kept`]; what is there is not replaced.
    pub fn write(&self, path: &Path) -> Result<(), StudyError> {
        if Self::there(path, self.shard, &self.origin, self.counts())?.is_some() {
            return Ok(());
        }
        let partial = self.write_beside(path)?;
        self.place(&partial, path)
    }

    /// Writes the part beside its place, into a file that nobody takes for it; where.
    fn write_beside(&self, path: &Path) -> Result<PathBuf, StudyError> {
        let folder = path.parent().unwrap_or(Path::new("."));
        fs::create_dir_all(folder).map_err(failed(folder))?;
        let mut text = serde_json::to_vec(self).map_err(|error| failed(path)(error.into()))?;
        // The last brace is the ending's.
        text.pop();
        let ending = ending(&text);
        text.extend_from_slice(ending.as_bytes());
        // A name of its own: a batch engine may have begun the same part twice, on two machines that share the folder.
        let partial = path.with_file_name(format!("{}.{}{PARTIAL}", stem(self.shard), Uuid::now_v7()));
        let written = fs::File::create(&partial).and_then(|mut file| {
            file.write_all(&text)?;
            file.sync_all()
        });
        written.map(|()| partial.clone()).map_err(|source| {
            // What is left of it is of no use; that it could not be written is what is told.
            let _ = fs::remove_file(&partial);
            failed(&partial)(source)
        })
    }

    /// Gives what was written beside its place the part's own name, where no file has it, and takes away what others have left
    /// there.
    fn place(&self, partial: &Path, path: &Path) -> Result<(), StudyError> {
        if let Err(source) = naming::name(partial, path) {
            let _ = fs::remove_file(partial);
            // Another machine, or another study, may have been faster.
            let there = Self::there(path, self.shard, &self.origin, self.counts())?;
            return there.map(drop).ok_or_else(|| match source.kind() {
                ErrorKind::AlreadyExists => {
                    let why =
                        "its place is taken by what is no file, such as a link to nowhere: move it away".to_owned();
                    StudyError::Part { path: path.display().to_string(), why }
                }
                _ => failed(path)(source),
            });
        }
        let folder = path.parent().unwrap_or(Path::new("."));
        keep_names(folder);
        // What attempts have left that were killed while they wrote. One that is writing now finds the part instead. It is of
        // no use, and harms nobody where it stays.
        for partial in named(folder, &format!("{}.", stem(self.shard)), PARTIAL).unwrap_or_default() {
            let _ = fs::remove_file(&partial);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::Counts;

    /// A part that no item falls to.
    fn part(seed: u64) -> Part {
        let options = StudyOptions { quick: true, seed, counts: Counts { benches: 1, assemblies: 1 } };
        let benches = Block { count: 1, first: 0, seconds: 0.0, outcomes: Vec::new() };
        let assemblies = Block { count: 1, first: 0, seconds: 0.0, outcomes: Vec::new() };
        Part::new(&Config::default(), options, "1/2".parse().unwrap(), benches, assemblies)
    }

    #[test]
    fn of_two_that_are_written_at_once_the_one_that_is_first_in_its_place_stays() {
        for (seeds, says) in [([1, 1], None), ([1, 2], Some("there is part 1/2 of a study (quick, seed 1, "))] {
            let folder = tempfile::tempdir().unwrap();
            let [first, second] = seeds.map(part);
            let path = Part::path(folder.path(), first.shard);
            // Both have seen that none is there, and come to the renaming one after the other.
            let [one, other] = [&first, &second].map(|part| part.write_beside(&path).unwrap());
            let aside = folder.path().join("aside");
            fs::rename(&other, &aside).unwrap();
            first.place(&one, &path).unwrap();
            fs::rename(&aside, &other).unwrap();
            let said = second.place(&other, &path).map_err(|error| error.to_string());
            match says {
                None => assert_eq!(said, Ok(())),
                Some(says) => assert!(said.as_ref().is_err_and(|said| said.contains(says)), "{said:?}"),
            }
            assert!(Part::read(&path).unwrap() == first && !one.exists() && !other.exists());
            // Where the first has swept away what the second wrote, it is the same.
            let said_of_swept = second.place(&other, &path).map_err(|error| error.to_string());
            assert_eq!(said_of_swept, said);
        }
    }

    #[test]
    fn what_is_no_file_is_told_and_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let first = part(1);
        let path = Part::path(folder.path(), first.shard);
        fs::create_dir(path.parent().unwrap()).unwrap();
        std::os::unix::fs::symlink("nowhere", &path).unwrap();
        let why = first.write(&path).unwrap_err().to_string();
        assert!(why.ends_with(
            "part-1-of-2.json: its place is taken by what is no file, such as a link to nowhere: move it away"
        ));
        assert_eq!(fs::read_dir(path.parent().unwrap()).unwrap().count(), 1);
        fs::remove_file(&path).unwrap();
        nix::unistd::mkfifo(&path, nix::sys::stat::Mode::S_IRWXU).unwrap();
        let why = first.write(&path).unwrap_err().to_string();
        assert!(why.ends_with("part-1-of-2.json: it is no file, but a pipe or a device: move it away"), "{why}");
    }
}
