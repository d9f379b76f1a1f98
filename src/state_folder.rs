//! The state folder: where this program keeps what outlives it.

use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use nix::unistd::geteuid;

/// Where the state folder is named.
const VARIABLE: &str = "PLENALIGN_STATE_DIR";
/// The installed daemon's.
const INSTALLED: &str = "/var/lib/plenalign";

/// No variable that could name the state folder is set.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("no state folder: neither {VARIABLE}, XDG_STATE_HOME nor HOME is set")]
pub struct NoStateFolder;

/// The state folder: `PLENALIGN_STATE_DIR`; else the installed daemon's for the user that it belongs to, so that what this
/// user is told to do (`plenalign token create`) is done where the daemon looks; else the user's own. It may not exist yet.
///
/// # Errors
/// [`NoStateFolder`].
pub fn state_folder() -> Result<PathBuf, NoStateFolder> {
    let from = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    from(VARIABLE)
        .or_else(|| own(Path::new(INSTALLED)))
        .or_else(|| from("XDG_STATE_HOME").map(|folder| folder.join("plenalign")))
        .or_else(|| from("HOME").map(|home| home.join(".local/state/plenalign")))
        .ok_or(NoStateFolder)
}

/// A folder, where it is there and belongs to this process's user. Root has the whole machine and is not meant.
fn own(folder: &Path) -> Option<PathBuf> {
    let found = folder.metadata().ok()?;
    let user = geteuid();
    (found.is_dir() && !user.is_root() && found.uid() == user.as_raw()).then(|| folder.to_owned())
}
