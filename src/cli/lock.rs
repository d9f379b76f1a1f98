//! One process per bench: a lock file in the state folder, held for as long as the process lives.

use std::fs::{self, File, TryLockError};
use std::io::{Read, Seek, Write};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail};
use nix::unistd::geteuid;

use crate::config::BenchConfig;
use crate::control::bench_name;
use crate::state_folder::{make_folder, open_private, state_folder};
use crate::store::BenchName;

/// A bench held by this process until this is dropped.
#[derive(Debug)]
pub(super) struct BenchLock {
    _files: Vec<File>,
}

impl BenchLock {
    /// Takes the bench for this process: by its devices, so that another spelling of their ports is no other bench, and by
    /// how these are spelled, by which alone it can be told while a device is away. Where the state folder cannot be
    /// written (disk full, read-only) the lock is in a folder of this user's own among the temporary ones, so that the
    /// bench can at least be looked at.
    ///
    /// # Errors
    /// When another process holds it (its pid is named), or no lock file can be opened.
    pub(super) fn take(bench: &BenchConfig) -> anyhow::Result<Self> {
        Self::take_in(&[&state_folder()?, &temporary_folder()], &bench_name(bench))
    }

    /// The process that holds a bench, looked up without taking it.
    pub(super) fn holder(bench: &BenchConfig) -> Option<u32> {
        let (state, name) = (state_folder().ok(), bench_name(bench));
        let folders = state.into_iter().chain([temporary_folder()]);
        folders.flat_map(|folder| paths_in(&folder, &name)).find_map(|path| Self::holder_of(&path))
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

    /// Takes it in the first of these folders that lock files can be opened in.
    fn take_in(folders: &[&Path], name: &BenchName) -> anyhow::Result<Self> {
        let mut why = None;
        for (index, folder) in folders.iter().enumerate() {
            // Others may write beside every one but the first, the state folder.
            let shared = index > 0;
            match Self::open_in(folder, shared, name) {
                Ok(files) => {
                    let held = files.into_iter().map(|(file, path)| Self::hold(file, &path));
                    return Ok(Self { _files: held.collect::<anyhow::Result<_>>()? });
                }
                Err(error) => {
                    tracing::warn!(error = format!("{error:#}"), "no lock file here");
                    why.get_or_insert(error);
                }
            }
        }
        Err(why.unwrap_or_else(|| anyhow!("no folder to have a lock file in")))
    }

    fn open_in(folder: &Path, shared: bool, name: &BenchName) -> anyhow::Result<Vec<(File, PathBuf)>> {
        make_folder(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        if shared {
            check_own(folder)?;
        }
        let open = |path: PathBuf| {
            // What is there on a read-only disk can still be locked.
            let file = open_private(&path).or_else(|error| File::open(&path).map_err(|_| error));
            Ok((file.with_context(|| format!("cannot open the lock file {}", path.display()))?, path))
        };
        paths_in(folder, name).into_iter().map(open).collect()
    }

    fn hold(mut file: File, path: &Path) -> anyhow::Result<File> {
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
        Ok(file)
    }
}

/// Where the lock is while the state folder cannot be used: by this user's number, in a folder that is theirs.
fn temporary_folder() -> PathBuf {
    let runtime = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from).filter(|folder| folder.is_absolute());
    match runtime {
        Some(folder) => folder.join("plenalign"),
        None => std::env::temp_dir().join(format!("plenalign-{}", geteuid())),
    }
}

/// Whether nobody else can put a lock file into a folder, or a link in its place.
fn check_own(folder: &Path) -> anyhow::Result<()> {
    let found = fs::symlink_metadata(folder).with_context(|| format!("cannot look at {}", folder.display()))?;
    if found.is_dir() && found.uid() == geteuid().as_raw() && found.permissions().mode() & 0o022 == 0 {
        return Ok(());
    }
    bail!("{} is not a folder that this user alone can write; remove it", folder.display())
}

fn paths_in(folder: &Path, name: &BenchName) -> Vec<PathBuf> {
    let mut names = vec![&name.spelled];
    names.extend(name.devices.as_ref().filter(|devices| **devices != name.spelled));
    names.into_iter().map(|name| folder.join(format!("bench-{name}.lock"))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn simulated() -> BenchName {
        bench_name(&BenchConfig::default())
    }

    #[test]
    fn a_held_bench_names_its_holder_and_is_free_again_after() {
        let folder = tempfile::tempdir().unwrap();
        let bench = simulated();
        let held = BenchLock::take_in(&[folder.path()], &bench).unwrap();
        let refused = BenchLock::take_in(&[folder.path()], &bench).unwrap_err().to_string();
        assert!(refused.contains(&format!("pid {}", std::process::id())), "{refused}");
        let path = paths_in(folder.path(), &bench).remove(0);
        assert_eq!(BenchLock::holder_of(&path), Some(std::process::id()));
        drop(held);
        assert_eq!(BenchLock::holder_of(&path), None);
        BenchLock::take_in(&[folder.path()], &bench).unwrap();
    }

    #[test]
    fn other_benches_are_free() {
        let folder = tempfile::tempdir().unwrap();
        let _held = BenchLock::take_in(&[folder.path()], &simulated()).unwrap();
        let hardware = BenchName { spelled: "by-id".to_owned(), devices: Some("usb".to_owned()) };
        let held = BenchLock::take_in(&[folder.path()], &hardware).unwrap();
        // The same devices by another spelling, and the same spelling with the devices away.
        for (spelled, devices) in [("tty", Some("usb")), ("by-id", None)] {
            let other = BenchName { spelled: spelled.to_owned(), devices: devices.map(str::to_owned) };
            let refused = BenchLock::take_in(&[folder.path()], &other).unwrap_err().to_string();
            assert!(refused.contains("another process"), "{refused}");
        }
        drop(held);
        BenchLock::take_in(&[folder.path()], &BenchName { spelled: "tty".to_owned(), devices: None }).unwrap();
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_no_reason_not_to_look_at_the_bench() {
        let folder = tempfile::tempdir().unwrap();
        let in_the_way = folder.path().join("state");
        std::fs::write(&in_the_way, "no folder").unwrap();
        let spare = folder.path().join("spare");
        let bench = simulated();
        let _held = BenchLock::take_in(&[&in_the_way, &spare], &bench).unwrap();
        let refused = BenchLock::take_in(&[&in_the_way, &spare], &bench).unwrap_err().to_string();
        assert!(refused.contains("another process"), "{refused}");
        let nowhere = BenchLock::take_in(&[&in_the_way], &bench).unwrap_err().to_string();
        assert!(nowhere.contains(&in_the_way.display().to_string()), "{nowhere}");
    }
}
