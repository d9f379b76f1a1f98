//! `[record]` and `[foxglove]`: what is recorded of jobs, and who may look on with Foxglove.

use std::net::SocketAddr;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::check::Faults;

/// Which jobs are recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum RecordJobs {
    /// Those whose request asks for it.
    Asked,
    /// All but those whose request says no.
    All,
}

/// `[record]`
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RecordConfig {
    /// Which jobs are recorded.
    pub jobs: RecordJobs,
    /// Folder of the recordings; empty for `recordings` in the state folder.
    pub folder: PathBuf,
    /// Longest recording, MB.
    pub max_file_mb: u32,
    /// Room on the disk that is left for others, MB.
    pub keep_free_mb: u32,
}

impl Default for RecordConfig {
    fn default() -> Self {
        Self { jobs: RecordJobs::Asked, folder: PathBuf::new(), max_file_mb: 4096, keep_free_mb: 1024 }
    }
}

impl RecordConfig {
    pub(super) fn check(&self, faults: &mut Faults) {
        let folder = &self.folder;
        faults.require(folder.as_os_str().is_empty() || folder.is_absolute(), "record.folder", || {
            format!(
                "{} is no absolute path; a folder is the same wherever the program is started from",
                folder.display()
            )
        });
        faults.require(self.max_file_mb > 0, "record.max_file_mb", || "must be 1 or more, not 0".to_owned());
    }
}

/// `[foxglove]`
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FoxgloveConfig {
    /// Where the bridge listens: an address of loopback with its port; empty for no bridge.
    pub listen: String,
    /// Origins of pages that may look on, as `https://app.foxglove.dev`, beside those served by this machine itself.
    pub origins: Vec<String>,
}

impl FoxgloveConfig {
    /// Where the bridge listens; `None` for no bridge.
    ///
    /// # Errors
    /// Why it cannot listen there, in words.
    pub fn address(&self) -> Result<Option<SocketAddr>, String> {
        if self.listen.is_empty() {
            return Ok(None);
        }
        let listen = &self.listen;
        let address: SocketAddr =
            listen.parse().map_err(|_| format!("{listen:?} is no address with a port, such as 127.0.0.1:8765"))?;
        if address.ip().is_loopback() {
            return Ok(Some(address));
        }
        Err(format!("{listen} is beyond loopback, and the bridge asks nobody who they are; use 127.0.0.1 or [::1]"))
    }

    pub(super) fn check(&self, faults: &mut Faults) {
        if let Err(wrong) = self.address() {
            faults.add("foxglove.listen", wrong);
        }
        for origin in &self.origins {
            let authority = origin.split_once("://").map_or("", |(_, authority)| authority);
            faults.require(!authority.is_empty() && !authority.contains('/'), "foxglove.origins", || {
                format!("{origin:?} is no origin, such as https://app.foxglove.dev")
            });
        }
    }
}
