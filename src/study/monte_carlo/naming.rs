//! Giving a file the name by which others find it, where no other file has that name: not even one that another machine
//! gives it at the same moment.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::Path;

use rustix::fs::{CWD, RenameFlags, renameat_with};
use rustix::io::Errno;

/// A way to give a file of one name another name in the same folder.
type Way = fn(&Path, &Path) -> io::Result<()>;

/// The ways, the best first: each takes the old name away, and fails with [`ErrorKind::AlreadyExists`] where the new one is
/// taken.
const WAYS: [Way; 3] = [renamed_alone, linked, renamed_where_none_was];

/// Gives a file another name in the same folder.
///
/// # Errors
/// [`ErrorKind::AlreadyExists`] where another file has it: that one is not touched. Why else it cannot be done.
pub(super) fn name(from: &Path, to: &Path) -> io::Result<()> {
    by(&WAYS, from, to)
}

fn by(ways: &[Way], from: &Path, to: &Path) -> io::Result<()> {
    let mut done = Err(ErrorKind::Unsupported.into());
    for way in ways {
        done = way(from, to);
        if !done.as_ref().is_err_and(is_unknown_here) {
            break;
        }
    }
    done
}

/// Whether an error says that the kernel or the file system cannot do such a thing at all. NFS and most of FUSE say
/// `EINVAL` to `RENAME_NOREPLACE`, filters of system calls `EPERM` or `ENOSYS`; file systems without hard links `EPERM` or
/// `EOPNOTSUPP` to those.
fn is_unknown_here(error: &io::Error) -> bool {
    let unknown = [Errno::INVAL, Errno::NOSYS, Errno::OPNOTSUPP, Errno::PERM];
    unknown.iter().any(|errno| error.raw_os_error() == Some(errno.raw_os_error()))
        || error.kind() == ErrorKind::Unsupported
}

/// By `renameat2`, in one step: ext4, XFS, Btrfs, tmpfs, overlayfs, FAT, SMB.
fn renamed_alone(from: &Path, to: &Path) -> io::Result<()> {
    Ok(renameat_with(CWD, from, CWD, to, RenameFlags::NOREPLACE)?)
}

/// By a second name for the same file, which the server gives or not: NFS. A power cut may leave both names.
fn linked(from: &Path, to: &Path) -> io::Result<()> {
    fs::hard_link(from, to)?;
    // The file has its name, which is what was asked for.
    let _ = fs::remove_file(from);
    Ok(())
}

/// Where the file system has neither, as some of FUSE: what another machine names just so between the look and the renaming is
/// replaced.
fn renamed_where_none_was(from: &Path, to: &Path) -> io::Result<()> {
    if to.symlink_metadata().is_ok() {
        return Err(ErrorKind::AlreadyExists.into());
    }
    fs::rename(from, to)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_way_replaces_what_is_there() {
        for (number, way) in WAYS.into_iter().enumerate() {
            let folder = tempfile::tempdir().unwrap();
            let [first, second, to] = ["first", "second", "to"].map(|name| folder.path().join(name));
            for file in [&first, &second] {
                fs::write(file, file.to_str().unwrap()).unwrap();
            }
            way(&first, &to).unwrap();
            let error = way(&second, &to).unwrap_err();
            assert_eq!((error.kind(), is_unknown_here(&error)), (ErrorKind::AlreadyExists, false), "{number}");
            assert_eq!(fs::read_to_string(&to).unwrap(), first.to_str().unwrap(), "{number}");
            assert!(!first.exists() && second.exists(), "{number}");
            let error = way(&first, &folder.path().join("other")).unwrap_err();
            assert_eq!((error.kind(), is_unknown_here(&error)), (ErrorKind::NotFound, false), "{number}");
        }
    }

    #[test]
    fn what_a_file_system_cannot_do_is_done_in_another_way() {
        let folder = tempfile::tempdir().unwrap();
        let [from, to] = ["from", "to"].map(|name| folder.path().join(name));
        fs::write(&from, "part").unwrap();
        let cannot: [Way; 4] = [
            |_, _| Err(Errno::INVAL.into()),
            |_, _| Err(Errno::PERM.into()),
            |_, _| Err(Errno::OPNOTSUPP.into()),
            |_, _| Err(Errno::NOSYS.into()),
        ];
        assert!(by(&cannot, &from, &to).is_err() && from.exists());
        by(&[&cannot[..], &[linked]].concat(), &from, &to).unwrap();
        assert!(!from.exists() && to.exists());
        // What went wrong otherwise is not tried again by what may replace another's.
        let full: Way = |_, _| Err(Errno::NOSPC.into());
        let error = by(&[full, renamed_where_none_was], &to, &from).unwrap_err();
        assert!(error.kind() == ErrorKind::StorageFull && to.exists());
    }
}
