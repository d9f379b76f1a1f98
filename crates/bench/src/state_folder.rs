//! The state folder: where this program keeps what outlives it, and who may read that. Nobody outside the owner's group
//! reads anything of it; the history, tokens, keys and locks are their owner's alone. Permissions are set by what is
//! here, so that they do not depend on the umask that the program happens to be started with.

use std::ffi::OsStr;
use std::fs::{self, DirBuilder, File, OpenOptions, Permissions};
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use nix::unistd::geteuid;

/// Where the state folder is named.
const VARIABLE: &str = "PLENALIGN_STATE_DIR";
/// The installed daemon's.
const INSTALLED: &str = "/var/lib/plenalign";

/// A secret's permissions: its owner's alone.
pub const OWNERS: u32 = 0o600;
/// A folder's that may hold secrets.
const OWNERS_FOLDER: u32 = 0o700;
/// What the folder itself may have at most: its group may look into it, and change nothing.
const FOLDER_AT_MOST: u32 = 0o7750;
/// Folders in it in which this program keeps files.
const FOLDERS: [&str; 2] = ["tls", "recordings"];
/// What everything else in it may have at most.
const AT_MOST: u32 = 0o7770;

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

/// Makes a folder that only its owner can read, with those above it, where it is not there yet.
///
/// # Errors
/// As the system says.
pub fn make_folder(folder: &Path) -> io::Result<()> {
    DirBuilder::new().recursive(true).mode(OWNERS_FOLDER).create(folder)
}

/// Opens a file for reading and writing that only its owner can read; makes it where it is not there yet.
///
/// # Errors
/// As the system says.
pub fn open_private(path: &Path) -> io::Result<File> {
    let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).mode(OWNERS).open(path)?;
    if file.metadata()?.permissions().mode() & 0o777 & !OWNERS != 0 {
        file.set_permissions(Permissions::from_mode(OWNERS))?;
    }
    Ok(file)
}

/// Takes from the state folder and what this program keeps in it what others could do with it, as an older version or
/// another umask has left it, and says so in the log. Where there is no such folder yet, nothing happens.
pub fn mend(folder: &Path) {
    restrict(folder, FOLDER_AT_MOST);
    mend_files(folder, "");
    for below in FOLDERS {
        restrict(&folder.join(below), AT_MOST);
        mend_files(folder, below);
    }
}

fn mend_files(folder: &Path, below: &str) {
    // Where there is no such folder, nobody can read it.
    let Ok(entries) = fs::read_dir(folder.join(below)) else { return };
    // What a link leads to is not this folder's.
    for entry in entries.flatten().filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_file())) {
        restrict(&entry.path(), if is_secret(&entry.file_name()) { OWNERS } else { AT_MOST });
    }
}

/// Whether a file of this name is its owner's alone.
fn is_secret(name: &OsStr) -> bool {
    let name = name.to_string_lossy();
    ["history.db", "tokens.", "login-url"].iter().any(|secret| name.starts_with(secret))
        || [".key", ".lock"].iter().any(|secret| name.ends_with(secret))
}

/// Leaves a file or folder no more than these permissions. By its name, never by opening it: to close the history's file
/// would let go of the locks that SQLite holds on it.
pub fn restrict(path: &Path, at_most: u32) {
    let Ok(found) = fs::symlink_metadata(path) else { return };
    let had = found.permissions().mode() & 0o7777;
    if found.is_symlink() || had & !at_most == 0 {
        return;
    }
    let (path_said, had_said, now) = (path.display(), format!("{had:o}"), had & at_most);
    match fs::set_permissions(path, Permissions::from_mode(now)) {
        Ok(()) => tracing::warn!(
            path = %path_said, had = had_said, now = format!("{now:o}"), "others could read this: no longer"
        ),
        Err(error) => tracing::warn!(path = %path_said, had = had_said, %error, "others may read this"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_opened_privately_is_its_owner_s_alone_whatever_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/lock");
        make_folder(path.parent().unwrap()).unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode(path.parent().unwrap()), 0o700);
        fs::write(&path, "there before").unwrap();
        fs::set_permissions(&path, Permissions::from_mode(0o666)).unwrap();
        open_private(&path).unwrap();
        assert_eq!((mode(&path), fs::read_to_string(&path).unwrap().as_str()), (0o600, "there before"));
    }

    #[test]
    fn a_group_keeps_what_is_no_secret() {
        let folder = tempfile::tempdir().unwrap();
        let (recordings, history) = (folder.path().join("recordings"), folder.path().join("history.db"));
        fs::create_dir(&recordings).unwrap();
        let recording = recordings.join("job.mcap");
        for (path, mode) in [(&recordings, 0o755), (&recording, 0o644), (&history, 0o640)] {
            if !path.exists() {
                fs::write(path, "").unwrap();
            }
            fs::set_permissions(path, Permissions::from_mode(mode)).unwrap();
        }
        fs::set_permissions(folder.path(), Permissions::from_mode(0o2775)).unwrap();
        mend(folder.path());
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o7777;
        assert_eq!(
            [mode(folder.path()), mode(&recordings), mode(&recording), mode(&history)],
            [0o2750, 0o750, 0o640, 0o600]
        );
        mend(&folder.path().join("not/there"));
    }
}
