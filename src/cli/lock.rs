//! One process per bench: a lock file in the state folder, held for as long as the process lives.

use std::fs::{self, File, TryLockError};
use std::io::{Read, Seek, Write};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail};

use crate::config::BenchConfig;
use crate::state_folder::state_folder;

/// A bench held by this process until this is dropped.
#[derive(Debug)]
pub(super) struct BenchLock {
    _file: File,
}

impl BenchLock {
    /// Takes the bench for this process. Where the state folder cannot be written (disk full, read-only) the lock is in
    /// the folder for temporary files, so that the bench can at least be looked at.
    ///
    /// # Errors
    /// When another process holds it (its pid is named), or no lock file can be opened.
    pub(super) fn take(bench: &BenchConfig) -> anyhow::Result<Self> {
        Self::take_in(&[&state_folder()?, &std::env::temp_dir()], bench)
    }

    /// The process that holds a bench, looked up without taking it.
    pub(super) fn holder(bench: &BenchConfig) -> Option<u32> {
        let state = state_folder().ok();
        let folders = state.into_iter().chain([std::env::temp_dir()]);
        folders.map(|folder| path_in(&folder, bench)).find_map(|path| Self::holder_of(&path))
    }

    /// The process that has written its number into a lock file and holds it still, as the kernel lists it.
    fn holder_of(path: &Path) -> Option<u32> {
        let pid: u32 = fs::read_to_string(path).ok()?.trim().parse().ok()?;
        let inode = fs::metadata(path).ok()?.ino();
        let locks = fs::read_to_string("/proc/locks").ok()?;
        let holds = |line: &str| {
            // Such as `1: FLOCK  ADVISORY  WRITE 1234 08:02:5678 0 EOF`; another namespace's process is 0 or below.
            let words: Vec<&str> = line.split_whitespace().collect();
            let [_, "FLOCK", _, _, holder, file, ..] = words[..] else { return false };
            let of_inode = file.rsplit_once(':').is_some_and(|(_, number)| number.parse() == Ok(inode));
            of_inode && (holder.parse() == Ok(pid) || holder.parse::<i64>().is_ok_and(|holder| holder <= 0))
        };
        locks.lines().any(holds).then_some(pid)
    }

    /// Takes it in the first of these folders that a lock file can be opened in.
    fn take_in(folders: &[&Path], bench: &BenchConfig) -> anyhow::Result<Self> {
        let mut why = None;
        for folder in folders {
            match Self::open_in(folder, bench) {
                Ok((file, path)) => return Self::hold(file, &path),
                Err(error) => {
                    tracing::warn!(error = format!("{error:#}"), "no lock file here");
                    why.get_or_insert(error);
                }
            }
        }
        Err(why.unwrap_or_else(|| anyhow!("no folder to have a lock file in")))
    }

    fn open_in(folder: &Path, bench: &BenchConfig) -> anyhow::Result<(File, PathBuf)> {
        fs::create_dir_all(folder).with_context(|| format!("cannot make the state folder {}", folder.display()))?;
        let path = path_in(folder, bench);
        let writing = File::options().read(true).write(true).create(true).truncate(false).open(&path);
        // What is there on a read-only disk can still be locked.
        let file = writing.or_else(|error| File::open(&path).map_err(|_| error));
        Ok((file.with_context(|| format!("cannot open the lock file {}", path.display()))?, path))
    }

    fn hold(mut file: File, path: &Path) -> anyhow::Result<Self> {
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                let mut pid = String::new();
                file.read_to_string(&mut pid).ok();
                bail!(
                    "another process drives this bench: pid {} (lock file {}); end it first, or align through it with --server",
                    pid.trim(),
                    path.display()
                );
            }
            Err(TryLockError::Error(error)) => {
                return Err(error).with_context(|| format!("cannot lock {}", path.display()));
            }
        }
        let pid = std::process::id().to_string();
        let written = file.set_len(0).and_then(|()| file.rewind()).and_then(|()| file.write_all(pid.as_bytes()));
        if let Err(error) = written {
            // It is held all the same; only its holder's number is missing.
            tracing::warn!(%error, path = %path.display(), "the lock file cannot be written");
        }
        Ok(Self { _file: file })
    }
}

fn path_in(folder: &Path, bench: &BenchConfig) -> PathBuf {
    folder.join(format!("bench-{}.lock", bench.name()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::BenchDriver;

    #[test]
    fn a_held_bench_names_its_holder_and_is_free_again_after() {
        let folder = tempfile::tempdir().unwrap();
        let bench = BenchConfig::default();
        let held = BenchLock::take_in(&[folder.path()], &bench).unwrap();
        let refused = BenchLock::take_in(&[folder.path()], &bench).unwrap_err().to_string();
        assert!(refused.contains(&format!("pid {}", std::process::id())), "{refused}");
        let path = path_in(folder.path(), &bench);
        assert_eq!(BenchLock::holder_of(&path), Some(std::process::id()));
        drop(held);
        assert_eq!(BenchLock::holder_of(&path), None);
        BenchLock::take_in(&[folder.path()], &bench).unwrap();
    }

    #[test]
    fn other_benches_are_free() {
        let folder = tempfile::tempdir().unwrap();
        let _held = BenchLock::take_in(&[folder.path()], &BenchConfig::default()).unwrap();
        let hardware = BenchConfig { driver: BenchDriver::Hardware, ..BenchConfig::default() };
        BenchLock::take_in(&[folder.path()], &hardware).unwrap();
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_no_reason_not_to_look_at_the_bench() {
        let folder = tempfile::tempdir().unwrap();
        let in_the_way = folder.path().join("state");
        std::fs::write(&in_the_way, "no folder").unwrap();
        let spare = folder.path().join("spare");
        let bench = BenchConfig::default();
        let _held = BenchLock::take_in(&[&in_the_way, &spare], &bench).unwrap();
        let refused = BenchLock::take_in(&[&in_the_way, &spare], &bench).unwrap_err().to_string();
        assert!(refused.contains("another process"), "{refused}");
        let nowhere = BenchLock::take_in(&[&in_the_way], &bench).unwrap_err().to_string();
        assert!(nowhere.contains(&in_the_way.display().to_string()), "{nowhere}");
    }
}
