//! What the disk says before anything is written: whether the file is still the one that was opened, and whether there
//! is room.

use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;

use nix::sys::statvfs::{FsFlags, Statvfs, statvfs};

use super::health::StoreError;

/// Room that has to be left before motion may begin, bytes: a job's records and pictures need a tenth of it.
pub const ROOM_BYTES: u64 = 4 << 20;

/// Which file a path led to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Identity {
    device: u64,
    inode: u64,
}

impl Identity {
    /// Of the file at a path; `None` where there is none.
    pub(super) fn of(path: &Path) -> Option<Self> {
        let found = fs::metadata(path).ok()?;
        Some(Self { device: found.dev(), inode: found.ino() })
    }
}

/// Whether the disk below a file can be written and has room.
pub(super) fn check(file: &Path) -> Result<(), StoreError> {
    let folder = file.parent().unwrap_or(file);
    let said = statvfs(folder).map_err(|error| StoreError::Unusable(format!("{}: {error}", folder.display())))?;
    if said.flags().contains(FsFlags::ST_RDONLY) {
        return Err(StoreError::Unusable(format!("the disk of {} is mounted read-only", folder.display())));
    }
    let free = free(&said);
    if free < ROOM_BYTES {
        return Err(StoreError::Unusable(format!(
            "the disk of {} is full: {} kB are free, {} kB are needed",
            folder.display(),
            free >> 10,
            ROOM_BYTES >> 10
        )));
    }
    Ok(())
}

/// Room left on the disk of a file, bytes; `None` where the system does not say.
pub(super) fn free_bytes(file: &Path) -> Option<u64> {
    statvfs(file.parent().unwrap_or(file)).ok().map(|said| free(&said))
}

/// Room that a disk has left for this user, bytes.
#[must_use]
// The C library's widths differ between machines.
#[allow(clippy::unnecessary_cast)]
pub fn free(said: &Statvfs) -> u64 {
    said.blocks_available() as u64 * said.fragment_size() as u64
}
