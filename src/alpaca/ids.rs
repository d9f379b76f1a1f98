//! UniqueIDs of the devices: made once, and the same ever after.

use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use uuid::Uuid;

use crate::access::write_private;
use crate::device::AxisName;

/// Holds them, in the state folder.
const FILE: &str = "alpaca.json";

/// Why there are no UniqueIDs.
#[derive(Debug, thiserror::Error)]
pub enum IdsError {
    /// The file cannot be read or written.
    #[error("the UniqueIDs of the Alpaca devices cannot be kept in {path}: {source}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file holds something else.
    #[error(
        "{path} does not hold the UniqueIDs of the Alpaca devices: {why}; put it back, or remove it to have new ones made",
        path = path.display()
    )]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
}

/// The UniqueID of each device.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UniqueIds {
    focus: Uuid,
    e: Uuid,
    camera: Uuid,
}

impl UniqueIds {
    /// New ones, which nothing keeps.
    #[must_use]
    pub fn new() -> Self {
        Self { focus: Uuid::now_v7(), e: Uuid::now_v7(), camera: Uuid::now_v7() }
    }

    /// Those kept in a state folder, made now where there are none.
    ///
    /// # Errors
    /// When the file can be neither read nor written, or holds something else.
    pub fn open(state: &Path) -> Result<Self, IdsError> {
        let path = state.join(FILE);
        match std::fs::read(&path) {
            Ok(bytes) => {
                serde_json::from_slice(&bytes).map_err(|error| IdsError::Content { path, why: error.to_string() })
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                let ids = Self::new();
                let written = serde_json::to_vec_pretty(&ids).map_err(io::Error::from);
                match written.and_then(|bytes| write_private(&path, &bytes)) {
                    Ok(()) => Ok(ids),
                    Err(source) => Err(IdsError::File { path, source }),
                }
            }
            Err(source) => Err(IdsError::File { path, source }),
        }
    }

    pub(super) fn of_axis(&self, axis: AxisName) -> String {
        match axis {
            AxisName::Focus => self.focus.to_string(),
            AxisName::E => self.e.to_string(),
        }
    }

    pub(super) fn of_camera(&self) -> String {
        self.camera.to_string()
    }
}

impl Default for UniqueIds {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_are_made_once_and_a_wrong_file_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let made = UniqueIds::open(folder.path()).unwrap();
        assert_eq!(UniqueIds::open(folder.path()).unwrap(), made);
        let all = [made.of_axis(AxisName::Focus), made.of_axis(AxisName::E), made.of_camera()];
        assert!(all[0] != all[1] && all[1] != all[2] && all[0] != all[2], "{all:?}");
        let path = folder.path().join(FILE);
        for wrong in ["", "{}", "{\"focus\": 7}"] {
            std::fs::write(&path, wrong).unwrap();
            let error = UniqueIds::open(folder.path()).unwrap_err().to_string();
            assert!(error.contains("alpaca.json") && error.contains("remove it"), "{error}");
        }
        std::fs::remove_file(&path).unwrap();
        std::fs::create_dir(&path).unwrap();
        assert!(matches!(UniqueIds::open(folder.path()), Err(IdsError::File { .. })));
    }
}
