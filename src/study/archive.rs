//! A folder with the chapters finished so far.

use std::fs::{self, File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use nix::errno::Errno;
use serde::{Deserialize, Serialize};

use super::{Chapter, Counts, StudyError, StudyOptions};
use crate::config::Config;

/// A folder in which finished chapters are kept, each with what it was made from: chapters of another version, seed,
/// thoroughness or configuration, or of another number of items, are not taken for this study's.
#[derive(Debug, Clone)]
pub struct Archive {
    folder: PathBuf,
    origin: Origin,
    counts: Counts,
}

/// What a chapter was made from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Origin {
    version: String,
    quick: bool,
    seed: u64,
    config: serde_json::Value,
}

#[derive(Serialize, Deserialize)]
struct Kept {
    origin: Origin,
    /// How many items a Monte Carlo was made of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    items: Option<u64>,
    chapter: Chapter,
}

impl Archive {
    /// Opens a folder, making it where it is not there.
    ///
    /// # Errors
    /// [`StudyError::Folder`].
    pub fn open(folder: &Path, config: &Config, options: StudyOptions) -> Result<Self, StudyError> {
        let archive = Self {
            folder: folder.to_owned(),
            origin: Origin {
                version: env!("CARGO_PKG_VERSION").to_owned(),
                quick: options.quick,
                seed: options.seed,
                config: serde_json::to_value(config).unwrap_or_default(),
            },
            counts: options.counts,
        };
        for folder in [archive.chapters(), archive.pictures()] {
            fs::create_dir_all(&folder).map_err(|source| failed(&folder, source))?;
        }
        Ok(archive)
    }

    /// Has nobody else write into the folder until what is returned is dropped. Where somebody does, `waiting` is called, and
    /// their end waited for.
    ///
    /// # Errors
    /// [`StudyError::Folder`].
    pub fn hold(&self, waiting: impl FnOnce()) -> Result<File, StudyError> {
        let path = self.folder.join(".lock");
        let file = File::create(&path).map_err(|source| failed(&path, source))?;
        let held = match file.try_lock() {
            Ok(()) => Ok(()),
            Err(TryLockError::WouldBlock) => {
                waiting();
                file.lock()
            }
            // A file system that knows no locks: nothing is known of others there.
            Err(TryLockError::Error(error))
                if error.kind() == ErrorKind::Unsupported || error.raw_os_error() == Some(Errno::ENOLCK as i32) =>
            {
                Ok(())
            }
            Err(TryLockError::Error(error)) => Err(error),
        };
        held.map(|()| file).map_err(|source| failed(&path, source))
    }

    fn chapters(&self) -> PathBuf {
        self.folder.join("chapters")
    }

    fn pictures(&self) -> PathBuf {
        self.folder.join("pictures")
    }

    fn picture(&self, chapter: &str, picture: &str) -> PathBuf {
        self.pictures().join(format!("{chapter}-{picture}.png"))
    }

    /// A chapter finished earlier with the same options; `None` where there is none.
    ///
    /// # Errors
    /// [`StudyError::Chapter`] for a file that is no chapter, [`StudyError::Folder`] for one that cannot be read.
    pub(super) fn chapter(&self, name: &str) -> Result<Option<Chapter>, StudyError> {
        let path = self.chapters().join(format!("{name}.json"));
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(source) => return Err(failed(&path, source)),
        };
        let kept: Kept = serde_json::from_str(&text)
            .map_err(|error| StudyError::Chapter { path: path.display().to_string(), why: error.to_string() })?;
        if kept.origin != self.origin || kept.items != self.counts.of(name) {
            return Ok(None);
        }
        let mut chapter = kept.chapter;
        for picture in &mut chapter.pictures {
            match fs::read(self.picture(name, &picture.name)) {
                Ok(png) => picture.png = png,
                // A chapter without its pictures is made again.
                Err(_) => return Ok(None),
            }
        }
        Ok(Some(chapter))
    }

    /// Keeps a finished chapter: its pictures first, so that a chapter that is there is whole.
    ///
    /// # Errors
    /// [`StudyError::Folder`].
    pub(super) fn keep(&self, chapter: &Chapter) -> Result<(), StudyError> {
        for picture in &chapter.pictures {
            write(&self.picture(&chapter.name, &picture.name), &picture.png)?;
        }
        let items = self.counts.of(&chapter.name);
        let kept = Kept { origin: self.origin.clone(), items, chapter: chapter.clone() };
        let path = self.chapters().join(format!("{}.json", chapter.name));
        let text = serde_json::to_vec_pretty(&kept).map_err(|error| failed(&path, error.into()))?;
        write(&path, &text)
    }

    /// Writes a file of the study's folder by name, whole or not at all.
    ///
    /// # Errors
    /// [`StudyError::Folder`].
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<PathBuf, StudyError> {
        let path = self.folder.join(name);
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(|source| failed(folder, source))?;
        }
        write(&path, bytes)?;
        Ok(path)
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), StudyError> {
    let partial = path.with_extension("partial");
    let written = fs::write(&partial, bytes).map_err(|source| failed(&partial, source));
    let written = written.and_then(|()| fs::rename(&partial, path).map_err(|source| failed(path, source)));
    if written.is_err() {
        // Its room is needed.
        let _ = fs::remove_file(&partial);
    }
    written
}

fn failed(path: &Path, source: std::io::Error) -> StudyError {
    StudyError::Folder { path: path.display().to_string(), source }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::Picture;

    const OPTIONS: StudyOptions = StudyOptions::new(true, 4);

    fn chapter() -> Chapter {
        let picture =
            Picture { name: "view".to_owned(), caption: String::new(), width: 1, height: 1, png: vec![1, 2, 3] };
        Chapter { name: "clarity".to_owned(), title: "t".to_owned(), pictures: vec![picture], ..Chapter::default() }
    }

    #[test]
    fn a_kept_chapter_comes_back_for_the_same_study_only() {
        let folder = tempfile::tempdir().unwrap();
        let config = Config::default();
        let archive = Archive::open(folder.path(), &config, OPTIONS).unwrap();
        assert_eq!(archive.chapter("clarity").unwrap(), None);
        archive.keep(&chapter()).unwrap();
        assert_eq!(archive.chapter("clarity").unwrap(), Some(chapter()));

        let mut other = Config::default();
        other.assembly.initial_e_mm = 25.0;
        for (config, options) in [(&config, StudyOptions { seed: 5, ..OPTIONS }), (&other, OPTIONS)] {
            let archive = Archive::open(folder.path(), config, options).unwrap();
            assert_eq!(archive.chapter("clarity").unwrap(), None);
        }
        // Without one of its pictures it is not whole.
        fs::remove_file(archive.picture("clarity", "view")).unwrap();
        assert_eq!(archive.chapter("clarity").unwrap(), None);
    }

    #[test]
    fn a_monte_carlo_comes_back_for_the_same_number_of_items_only() {
        let folder = tempfile::tempdir().unwrap();
        let config = Config::default();
        let archive = Archive::open(folder.path(), &config, OPTIONS).unwrap();
        for name in ["assembly", "clarity"] {
            archive.keep(&Chapter { name: name.to_owned(), ..Chapter::default() }).unwrap();
        }
        let more = Counts { assemblies: 5000, ..OPTIONS.counts };
        let archive = Archive::open(folder.path(), &config, StudyOptions { counts: more, ..OPTIONS }).unwrap();
        assert!(archive.chapter("assembly").unwrap().is_none() && archive.chapter("clarity").unwrap().is_some());
    }

    #[test]
    fn what_is_no_chapter_is_named_and_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let archive = Archive::open(folder.path(), &Config::default(), OPTIONS).unwrap();
        let path = archive.chapters().join("clarity.json");
        fs::write(&path, "{\"origin\": 3}").unwrap();
        let error = archive.chapter("clarity").unwrap_err().to_string();
        assert!(error.contains("clarity.json") && error.contains("not a chapter"), "{error}");
        assert!(path.exists());
    }
}
