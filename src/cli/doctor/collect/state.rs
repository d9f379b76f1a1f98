//! The state folder and what is in it.

use std::fs;
use std::path::{Path, PathBuf};

use jiff::Timestamp;
use nix::sys::statvfs::{FsFlags, statvfs};
use nix::unistd::{AccessFlags, eaccess};

use crate::access::TokenStore;
use crate::cli::doctor::facts::{FolderFacts, FolderKind, StateFacts, TokenFacts};
use crate::config::Config;
use crate::state_folder::state_folder;
use crate::store::{free, inspect};

/// Looks at the state folder; changes nothing in it.
pub(super) fn state(config: Option<&Config>) -> Result<StateFacts, String> {
    let path = state_folder().map_err(|error| error.to_string())?;
    let elsewhere = config.map(|config| config.record.folder.clone()).filter(|folder| !folder.as_os_str().is_empty());
    Ok(StateFacts {
        history: inspect(&path).map_err(|error| error.to_string()),
        tokens: tokens(&path),
        recordings: elsewhere.map(folder),
        folder: folder(path),
    })
}

fn tokens(state: &Path) -> Result<TokenFacts, String> {
    let store = TokenStore::open(state).map_err(|error| error.to_string())?;
    let (now, all) = (Timestamp::now(), store.list());
    let expired = all.iter().filter(|token| token.expires_at.is_some_and(|end| end <= now)).count();
    Ok(TokenFacts { valid: all.len() - expired, expired })
}

fn folder(path: PathBuf) -> FolderFacts {
    let path = std::path::absolute(&path).unwrap_or(path);
    let kind = match fs::metadata(&path) {
        Ok(found) if found.is_dir() => FolderKind::Folder,
        Ok(_) => FolderKind::Other,
        Err(_) => FolderKind::Missing,
    };
    let nearest = path.ancestors().find(|above| above.exists()).unwrap_or(Path::new("/")).to_owned();
    let said = statvfs(&nearest).ok();
    let free_bytes = said.as_ref().map(free);
    FolderFacts {
        kind,
        unwritable: unwritable(&nearest),
        read_only: said.is_some_and(|said| said.flags().contains(FsFlags::ST_RDONLY)),
        free_bytes,
        nearest,
        path,
    }
}

/// Why nothing can be made in what should be a folder; asked of the kernel, and not tried.
fn unwritable(path: &Path) -> Option<String> {
    if !path.is_dir() {
        return Some(format!("{} is no folder", path.display()));
    }
    let error = eaccess(path, AccessFlags::W_OK | AccessFlags::X_OK).err()?;
    Some(format!("{}: {}", path.display(), error.desc().to_lowercase()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_told_from_what_is_in_its_way() {
        let root = tempfile::tempdir().unwrap();
        let there = folder(root.path().to_owned());
        assert_eq!((there.kind, &there.unwritable), (FolderKind::Folder, &None));
        assert!(there.free_bytes.is_some_and(|free| free > 0) && !there.read_only);
        let missing = folder(root.path().join("deep/state"));
        assert_eq!((missing.kind, missing.nearest.as_path()), (FolderKind::Missing, root.path()));
        assert_eq!(missing.unwritable, None);
        let file = root.path().join("file");
        fs::write(&file, "no folder").unwrap();
        assert_eq!(folder(file.clone()).kind, FolderKind::Other);
        let below = folder(file.join("state"));
        assert_eq!(below.kind, FolderKind::Missing);
        assert!(below.unwritable.is_some_and(|why| why.contains("is no folder")));
    }

    #[test]
    fn tokens_are_counted_without_their_secrets() {
        let root = tempfile::tempdir().unwrap();
        assert_eq!(tokens(root.path()), Ok(TokenFacts::default()));
        let store = TokenStore::open(root.path()).unwrap();
        store.create("Ana", crate::access::Scope::View, None).unwrap();
        assert_eq!(tokens(root.path()), Ok(TokenFacts { valid: 1, expired: 0 }));
        fs::write(root.path().join("tokens.json"), "{").unwrap();
        assert!(tokens(root.path()).unwrap_err().contains("tokens.json"));
    }
}
