//! Who asks.

use std::fmt;
use std::net::IpAddr;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Name of whoever asks from this machine while no token is demanded.
pub const LOCAL: &str = "local";

/// What somebody may do. Each scope holds those before it.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema, clap::ValueEnum,
)]
#[serde(rename_all = "snake_case")]
pub enum Scope {
    /// See everything, and stop the bench.
    View,
    /// Command the bench.
    Control,
    /// Hand out tokens, write the configuration, read the audit log, take the control over.
    Admin,
}

impl Scope {
    /// The word used on the wire and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::View => "view",
            Self::Control => "control",
            Self::Admin => "admin",
        }
    }
}

impl fmt::Display for Scope {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Who asks: found out before a handler runs, and handed to it as an extension of the request.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Principal {
    /// Name of the token, or [`LOCAL`]. No two tokens have the same.
    pub name: String,
    /// What they may do.
    pub scope: Scope,
    /// Where they ask from: the far end of the connection, or what a trusted proxy says of it.
    pub address: IpAddr,
}
