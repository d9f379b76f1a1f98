//! The state folder: where this program keeps what outlives it.

use std::path::PathBuf;

/// Where the state folder is named.
const VARIABLE: &str = "PLENALIGN_STATE_DIR";

/// No variable that could name the state folder is set.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("no state folder: neither {VARIABLE}, XDG_STATE_HOME nor HOME is set")]
pub struct NoStateFolder;

/// The state folder: `PLENALIGN_STATE_DIR`, else the user's own state folder. It may not exist yet.
///
/// # Errors
/// [`NoStateFolder`].
pub fn state_folder() -> Result<PathBuf, NoStateFolder> {
    let from = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    from(VARIABLE)
        .or_else(|| from("XDG_STATE_HOME").map(|folder| folder.join("plenalign")))
        .or_else(|| from("HOME").map(|home| home.join(".local/state/plenalign")))
        .ok_or(NoStateFolder)
}
