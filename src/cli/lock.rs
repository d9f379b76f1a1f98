//! One process per bench: a lock file in the state folder, held for as long as the process lives.

use std::fs::{self, File, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};

use crate::config::{BenchConfig, BenchDriver};

/// Where the state folder is named.
const STATE_VARIABLE: &str = "PLENALIGN_STATE_DIR";

/// A bench held by this process until this is dropped.
#[derive(Debug)]
pub(super) struct BenchLock {
    _file: File,
}

/// The state folder: `PLENALIGN_STATE_DIR`, else the user's own state folder.
pub(super) fn state_folder() -> anyhow::Result<PathBuf> {
    let from = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    if let Some(folder) = from(STATE_VARIABLE) {
        return Ok(folder);
    }
    if let Some(folder) = from("XDG_STATE_HOME") {
        return Ok(folder.join("plenalign"));
    }
    match from("HOME") {
        Some(home) => Ok(home.join(".local/state/plenalign")),
        None => bail!("no state folder: neither {STATE_VARIABLE}, XDG_STATE_HOME nor HOME is set"),
    }
}

/// The name of a bench: the simulated one, or its serial ports.
fn bench_name(bench: &BenchConfig) -> String {
    match bench.driver {
        BenchDriver::Simulated => "simulated".to_owned(),
        BenchDriver::Hardware => {
            let mut ports: Vec<String> = bench.controllers.values().map(|c| c.port.display().to_string()).collect();
            ports.sort();
            ports.join("+").chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect()
        }
    }
}

impl BenchLock {
    /// Takes the bench for this process.
    ///
    /// # Errors
    /// When another process holds it (its pid is named), or the state folder cannot be written.
    pub(super) fn take(bench: &BenchConfig) -> anyhow::Result<Self> {
        Self::take_in(&state_folder()?, bench)
    }

    fn take_in(folder: &Path, bench: &BenchConfig) -> anyhow::Result<Self> {
        fs::create_dir_all(folder).with_context(|| format!("cannot make the state folder {}", folder.display()))?;
        let path = folder.join(format!("bench-{}.lock", bench_name(bench)));
        let mut file = File::options()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)
            .with_context(|| format!("cannot open the lock file {}", path.display()))?;
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
        file.set_len(0)
            .and_then(|()| file.rewind())
            .and_then(|()| file.write_all(pid.as_bytes()))
            .with_context(|| format!("cannot write the lock file {}", path.display()))?;
        Ok(Self { _file: file })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_held_bench_names_its_holder_and_is_free_again_after() {
        let folder = tempfile::tempdir().unwrap();
        let bench = BenchConfig::default();
        let held = BenchLock::take_in(folder.path(), &bench).unwrap();
        let refused = BenchLock::take_in(folder.path(), &bench).unwrap_err().to_string();
        assert!(refused.contains(&format!("pid {}", std::process::id())), "{refused}");
        drop(held);
        BenchLock::take_in(folder.path(), &bench).unwrap();
    }

    #[test]
    fn other_benches_are_free() {
        let folder = tempfile::tempdir().unwrap();
        let _held = BenchLock::take_in(folder.path(), &BenchConfig::default()).unwrap();
        let hardware = BenchConfig { driver: BenchDriver::Hardware, ..BenchConfig::default() };
        BenchLock::take_in(folder.path(), &hardware).unwrap();
    }
}
